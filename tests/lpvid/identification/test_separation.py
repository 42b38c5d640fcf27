"""Inputs that move together: closed forms of the split, coverage of the bands on independent inputs, remarks."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

import lpvid as lpv
from lpvid.analysis.bands import free_run_band
from lpvid.auditing.coherence import coherent_inputs, one_per_motion
from lpvid.auditing.view import View
from lpvid.identification import separation
from lpvid.record import Record

INPUTS = ("u1", "u2")
N = 3000


def system(seed: int, *, noise: float = 0.02, sensor: float = 0.0, together: bool = True) -> tuple[Record, Record]:
    """Training data in which u2 is u1 behind a first-order lag, and noise-free data with independent inputs."""
    rng = np.random.default_rng(seed)
    radius, angle = rng.uniform(0.6, 0.95), rng.uniform(0.1, 1.2)
    a = [1, -2 * radius * np.cos(angle), radius**2]
    b1, b2, lag = rng.normal(size=2), rng.normal(size=2), rng.uniform(0.3, 0.9)

    def slow(u: np.ndarray) -> np.ndarray:
        return 2 * lfilter([1 - lag], [1, -lag], u)

    def record(u1: np.ndarray, u2: np.ndarray, share: float, dirt: float) -> Record:
        y = lfilter([0, *b1], a, u1) + lfilter([0, *b2], a, u2)
        white = rng.standard_normal((3, u1.size))
        return Record({"u1": u1 + dirt * u1.std() * white[0], "u2": u2 + dirt * u2.std() * white[1],
                       "y": y + share * y.std() * white[2]}, sample_time=0.01, name=f"system {seed}")

    u = rng.normal(size=N)
    training = record(u, slow(u if together else rng.normal(size=N)), noise, sensor)
    return training, record(rng.normal(size=1000), slow(rng.normal(size=1000)), 0.0, 0.0)


def structure(kind: str) -> lpv.ARX | lpv.OutputError | lpv.StateSpaceError:
    if kind == "pem-ss":
        return lpv.StateSpaceError(order=2, input=INPUTS, output="y")
    return {"arx": lpv.ARX, "oe": lpv.OutputError}[kind](na=2, nb=2, nk=1, input=INPUTS, output="y")


def covered(found: lpv.Identification, fresh: Record, seed: int = 1) -> float:
    """Share of the true output on independent inputs inside the 95 % band of the free run."""
    band = free_run_band(found.draw(np.random.default_rng(seed), 400), fresh)
    return float(band.contains(fresh["y"][:, None])[5:].mean())


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "sensor"), [
    ("arx", 0.0), ("oe", 0.02), *(pytest.param(*case, marks=pytest.mark.slow) for case in (
        ("arx", 0.02), ("oe", 0.0), ("pem-ss", 0.0), ("pem-ss", 0.02)))])
def test_bands_cover_the_truth_on_independent_inputs(kind: str, sensor: float, monkeypatch) -> None:
    """Ten systems whose inputs have a coherence of 1 in training. Without the prior the bands cover almost nothing."""
    rows, before = [], []
    for seed in range(10):
        training, fresh = system(seed, sensor=sensor)
        found = lpv.identify(training, structure(kind))
        rows.append(covered(found, fresh))
        assert found.model.metadata["coherent_inputs"]["regularised"]
        with monkeypatch.context() as patch:
            patch.setattr("lpvid.identification.separated", lambda found, records: found)
            plain = lpv.identify(training, structure(kind))
        before.append(covered(plain, fresh))
        assert found.fit > plain.fit - 0.1  # the fit is not given away for the prior
    assert np.mean(rows) >= 0.9
    assert np.mean(before) < 0.3


@pytest.mark.parametrize("kind", ["arx", "oe", "pem-ss"])
def test_independent_inputs_are_left_as_they_are(kind: str) -> None:
    training, fresh = system(3, together=False)
    found = lpv.identify(training, structure(kind), held_out=fresh)
    assert "coherent_inputs" not in found.model.metadata
    assert not any("together" in n or "independent" in n for n in found.notes)
    assert found.held_out.overall.free_run.fit_percent > 95


def test_a_gain_between_the_inputs_splits_as_the_closed_form_says() -> None:
    """u2 = 2 u1, memoryless: y = 3 u1 determines b1 + 2 b2 = 3 alone. In units in which each contribution has unit
    power, v = (1, −1)/√2, and the estimate of least contributions is b1 = 3/2, b2 = 3/4."""
    rng = np.random.default_rng(0)
    u = rng.normal(size=N)
    record = Record({"u1": u, "u2": 2 * u, "y": 3 * u + 0.01 * rng.normal(size=N)}, sample_time=0.1)
    found = lpv.identify(record, lpv.ARX(na=0, nb=1, nk=0, input=INPUTS, output="y"))
    np.testing.assert_allclose(found.parameters, [1.5, 0.75], rtol=1e-3)
    power = float(np.mean(u**2))
    v = np.array([1.0, -0.5]) / np.sqrt(2 * power)  # vᵀ G v = 1 with G = power · diag(1, 4)
    spread = 2.0 * float(np.var(record["y"]))  # two inputs, one open direction
    np.testing.assert_allclose(found.covariance, spread * np.outer(v, v), rtol=2e-3, atol=1e-4)
    assert found.model.metadata["coherent_inputs"]["undetermined"] == pytest.approx(1.0)


@pytest.mark.seconds
def test_units_of_an_input_change_nothing() -> None:
    training, fresh = system(4, sensor=0.01)
    base = lpv.identify(training, structure("oe"))
    scaled = training.with_channel("u2", 1e3 * training["u2"])
    other = lpv.identify(scaled, structure("oe"))
    again = lpv.simulate(other.model, fresh.with_channel("u2", 1e3 * fresh["u2"])).output
    np.testing.assert_allclose(again, lpv.simulate(base.model, fresh).output, rtol=0, atol=1e-3 * fresh["y"].std())


@pytest.mark.seconds
def test_a_record_that_breaks_the_coherence_lifts_the_remark() -> None:
    together, fresh = system(5)
    alone = system(5, together=False)[0]
    assert "coherent_inputs" in lpv.identify(together, structure("oe")).model.metadata
    pooled = lpv.identify([together, alone], structure("oe"), held_out=fresh)
    assert "coherent_inputs" not in pooled.model.metadata
    assert pooled.held_out.overall.free_run.fit_percent > 95


@pytest.mark.seconds
def test_held_out_figures_say_what_they_speak_for() -> None:
    whole, fresh = system(6)
    training, likewise = whole.slice(0, 2000), whole.slice(2000, N)
    same = lpv.identify(training, structure("oe"), held_out=likewise)
    assert any("do not hold for independent inputs" in n for n in same.notes)
    assert any("do not hold for independent inputs" in n for n in same.held_out.notes)
    other = lpv.identify(training, structure("oe"), held_out=fresh)
    assert any("held-out inputs move independently" in n for n in other.notes)


def test_a_model_that_is_not_linear_in_its_inputs_says_that_it_is_not_regularised() -> None:
    training = system(7)[0]
    found = lpv.identify(training, lpv.QuasiLPV(nb=2, nk=1, input=INPUTS, output="y",
                                                basis=lpv.Spline("y", 3, 1)))
    assert found.model.metadata["coherent_inputs"] == {
        "inputs": list(INPUTS), "explained": found.model.metadata["coherent_inputs"]["explained"],
        "regularised": False}
    assert any("is not regularised" in n for n in found.notes)


def test_dependent_columns_of_one_input_are_still_refused() -> None:
    rng = np.random.default_rng(1)
    u = np.repeat(rng.normal(size=N // 2), 2)
    record = Record({"u1": u, "u2": rng.normal(size=N), "p": np.full(N, 1.0), "y": rng.normal(size=N)}, 0.1)
    with pytest.raises(lpv.InputError, match="constant over the whole data set"):
        lpv.identify(record, lpv.ARX(na=1, nb=1, input=INPUTS, output="y", basis=lpv.Polynomial("p", degree=1)))


@pytest.mark.seconds
def test_the_split_is_one_of_information_and_metric() -> None:
    """Oracle: generalised eigenvectors by scipy on the same matrices."""
    from scipy.linalg import eigh

    training, _ = system(8, sensor=0.02)
    found = lpv.identify(training, structure("oe"))
    coherence = separation.coherence_of([training], INPUTS)
    assert coherence is not None
    split = separation._split(found, [training], coherence)
    assert split is not None
    root, _ = separation._root(found, [training], split.places)
    assert root is not None
    information, first = root.T @ root, np.array(["u1" in n for n in found.parameter_names])[split.places]
    metric = np.where(first[:, None] == first, information, 0.0)
    values = eigh(information, metric, eigvals_only=True)
    np.testing.assert_allclose(np.diag(split.directions.T @ information @ split.directions),
                               values[values <= 1 / 20], rtol=1e-6)
    np.testing.assert_allclose(split.directions.T @ metric @ split.directions, np.eye(len(split.weight)), atol=1e-8)
    np.testing.assert_allclose(split.duals, metric @ split.directions, rtol=1e-6)


def test_a_displacement_and_its_velocity_are_one_motion_that_nothing_can_part() -> None:
    rng = np.random.default_rng(3)
    x = lfilter([0.02], [1, -1.9, 0.92], rng.normal(size=N))
    v = np.gradient(x, 0.01)
    y = lfilter([0, 0.5], [1, -0.6], v) + 3 * x + 0.01 * rng.normal(size=N)
    moved = Record({"displacement": x, "velocity": v, "force": y}, sample_time=0.01,
                   units={"displacement": "m", "velocity": "m/s", "force": "N"})
    found = lpv.identify(moved, lpv.ARX(1, 2, 1, ("velocity", "displacement"), "force"))
    assert "coherent_inputs" not in found.model.metadata
    views = [View(moved, ())]
    assert one_per_motion(views, ("velocity", "displacement")) == ("displacement",)
    assert list(coherent_inputs(views, ("velocity", "displacement"))) == []
    assert one_per_motion(views, ("velocity", "force")) == ("velocity", "force")
    copied = Record({"displacement": x, "other": 2 * x, "force": y}, sample_time=0.01)
    assert [f.name for f in coherent_inputs([View(copied, ())], ("displacement", "other"))] == ["coherent-inputs"]
