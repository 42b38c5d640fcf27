"""One contract over all structures: what every estimate promises, whoever made it."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import lpvid as lpv
from lpvid.identification.structure import Structure

BASIS = lpv.Polynomial("p", degree=1)
SIGNALS = {"input": "u", "output": "y", "basis": BASIS}
MAKERS: dict[str, Callable[[], Structure]] = {
    "arx": lambda: lpv.ARX(na=2, nb=2, **SIGNALS),
    "arx-ridge": lambda: lpv.ARX(na=2, nb=2, ridge=lpv.Ridge(), **SIGNALS),
    "oe": lambda: lpv.OutputError(na=2, nb=2, **SIGNALS),
    "bj": lambda: lpv.BoxJenkins(na=2, nb=2, nc=1, nd=1, **SIGNALS),
    "armax": lambda: lpv.ARMAX(na=2, nb=2, nc=1, **SIGNALS),
    "riv": lambda: lpv.RefinedIV(na=2, nb=2, **SIGNALS),
    "recursive": lambda: lpv.Recursive(lpv.ARX(na=2, nb=2, **SIGNALS)),
    "subspace": lambda: lpv.Subspace(order=2, **SIGNALS),
    "pem-ss": lambda: lpv.StateSpaceError(order=2, **SIGNALS),
    "coprime": lambda: lpv.RightCoprime(na=2, nb=2, **SIGNALS),
    "quasi": lambda: lpv.QuasiLPV(na=1, nb=2, input="u", output="y", basis=lpv.Spline("y", segments=4, order=1)),
    "compliance": lambda: lpv.Compliance(input="u", output="y"),
}
LINEAR = tuple(n for n in MAKERS if n not in ("quasi", "compliance"))


def plant(seed: int = 0, n: int = 1200, unit: float = 1.0, noise: float = 0.02) -> lpv.Record:
    """A stable second-order LPV system in controllable form at slow p, output noise; `unit` rescales u, y and p."""
    rng = np.random.default_rng(seed)
    u = np.convolve(rng.normal(size=n), [0.6, 0.3, 0.1])[:n]
    p = 0.9 * np.sin(2 * np.pi * np.arange(n) / 600 + rng.uniform(0, 6))
    y = np.zeros(n)
    for k in range(2, n):
        y[k] = ((1.1 - 0.15 * p[k]) * y[k - 1] - (0.4 - 0.05 * p[k]) * y[k - 2] + (0.5 + 0.1 * p[k]) * u[k - 1]
                + 0.2 * u[k - 2])
    y = y + noise * rng.normal(size=n)
    return lpv.Record({"u": unit * u, "p": unit * p, "y": unit * y}, sample_time=0.01, name="plant")


@cache
def fitted(name: str) -> lpv.Identification:
    """The structure fitted to one record, once."""
    return lpv.identify(plant(), MAKERS[name](), held_out=[plant(1)])


@pytest.mark.parametrize("name", MAKERS)
class TestContract:
    def test_figures_are_finite_and_labelled(self, name: str) -> None:
        result = fitted(name)
        assert result.training is not None and result.held_out is not None
        assert (result.training.label, result.held_out.label) == ("training", "held-out")
        for validation in (result.training, result.held_out):
            figures = validation.overall.free_run
            assert figures.esr is not None and 0 <= figures.esr < 1
            assert figures.fit_percent == pytest.approx(100 * (1 - np.sqrt(figures.esr)))

    def test_a_linear_plant_is_found(self, name: str) -> None:
        held_out = fitted(name).held_out
        assert held_out is not None
        esr = held_out.overall.free_run.esr
        assert esr is not None
        assert esr < (0.02 if name in LINEAR else 0.4)

    def test_parameters_errors_and_names_belong_together(self, name: str) -> None:
        result = fitted(name)
        k = len(result.parameters)
        assert len(result.parameter_names) == len(set(result.parameter_names)) == k
        assert result.covariance.shape == (k, k)
        assert np.isfinite(result.standard_errors).all() and np.isfinite(result.parameters).all()
        values = np.linalg.eigvalsh(0.5 * (result.covariance + result.covariance.T))
        assert values.min() >= -1e-8 * max(values.max(), 1e-300)

    def test_its_own_parameters_give_its_own_model(self, name: str) -> None:
        result = fitted(name)
        again = result.with_parameters(result.parameters)
        fresh = plant(2, 300)
        np.testing.assert_allclose(lpv.simulate(again, fresh, "zero").output,
                                   lpv.simulate(result.model, fresh, "zero").output, rtol=1e-8, atol=1e-10)

    def test_draws_are_models(self, name: str) -> None:
        draws = fitted(name).draw(np.random.default_rng(0), 3)
        assert len(draws) == 3
        assert all(np.isfinite(lpv.simulate(m, plant(3, 100), "zero").output).any() for m in draws)

    def test_it_can_be_written_and_read(self, name: str, tmp_path: Path) -> None:
        result, fresh = fitted(name), plant(4, 300)
        json.dumps(result.to_dict())
        lpv.save(result.model, tmp_path / "model.json")
        loaded = lpv.load(tmp_path / "model.json")
        np.testing.assert_array_equal(lpv.simulate(loaded, fresh).output, lpv.simulate(result.model, fresh).output)

    def test_it_knows_its_training_data(self, name: str) -> None:
        assert lpv.validate(fitted(name).model, plant()).label == "training"

    def test_twice_the_same(self, name: str) -> None:
        again = lpv.identify(plant(), MAKERS[name]())
        np.testing.assert_array_equal(again.parameters, fitted(name).parameters)

    def test_units_change_nothing(self, name: str) -> None:
        training = fitted(name).training
        scaled = lpv.identify(plant(unit=1000.0), MAKERS[name]()).training
        assert training is not None and scaled is not None
        assert scaled.overall.free_run.esr == pytest.approx(training.overall.free_run.esr, rel=0.05)

    def test_bad_data_end_in_one_line(self, name: str) -> None:
        record = plant()
        for bad in (record.slice(0, 6), lpv.Record({"u": record["u"], "p": record["p"]}, sample_time=0.01)):
            with pytest.raises(lpv.InputError) as error:
                lpv.identify(bad, MAKERS[name]())
            assert "\n" not in str(error.value)

    def test_it_prints_itself_in_a_few_lines(self, name: str) -> None:
        assert 3 <= len(repr(fitted(name)).splitlines()) <= 12
