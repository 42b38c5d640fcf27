"""A damper that follows a current which the law does not read: found, with its lag, from a linear baseline."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.effect_signals import guo
from scipy.signal import lfilter

import lpvid as lpv
from lpvid.baselines.signals import Signals
from lpvid.diagnosis.evidence.engine import prepared
from lpvid.diagnosis.evidence.relations import compatible
from quartercar.baselines.damper import DamperBaseline
from quartercar.dampers.laws.linear import Linear
from quartercar.effects import CATALOGUE
from quartercar.effects.controlled_force import CurrentDependence, at_rest
from quartercar.effects.electrical import CoilLag

RATE, YIELD, VISCOUS = 500.0, 300.0, 400.0
CHEAP = [e for e in CATALOGUE if e.name != "remanence" and (
    e.family in ("electrical", "friction", "model") or e.name in ("gas-preload", "gas-stiffness"))]


def bingham(current: np.ndarray, seed: int = 0, lag: float = 0.0) -> lpv.Record:
    """A Bingham damper in white noise of 1 %: (100 + 300 i) tanh(v/.01) + (500 + 400 i) v, i behind a lag."""
    rng = np.random.default_rng(seed)
    n = current.size
    t = np.arange(n) / RATE
    v = sum(a * np.cos(2 * np.pi * f * t + p) for a, f, p in zip(
        (0.1, 0.08, 0.05), (1.1, 2.3, 3.7), rng.uniform(0, 6, 3), strict=True))
    x = np.cumsum(v) / RATE
    share = 1 - np.exp(-1 / (RATE * lag)) if lag else 1.0
    i = current[0] + lfilter([share], [1, share - 1], current - current[0])
    force = (100 + YIELD * i) * np.tanh(v / 0.01) + (500 + VISCOUS * i) * v
    force += 0.01 * force.std() * rng.standard_normal(n)
    return lpv.Record({"displacement": x, "velocity": v, "current": current, "force": force}, sample_time=1 / RATE,
                      units={"displacement": "m", "velocity": "m/s", "current": "A", "force": "N"})


def random_levels(seconds: float = 20.0, seed: int = 3) -> np.ndarray:
    """Currents of 0 to 1 A that step ten times a second."""
    levels = np.random.default_rng(seed).uniform(0, 1, round(10 * seconds))
    return np.repeat(levels, round(RATE / 10))


def named(record: lpv.Record, baseline: str) -> dict[str, dict[str, float]]:
    found = lpv.diagnose(record, baseline, CHEAP)
    return {c.name: {p.name: p.value for p in c.parameters} for c in found.causes}


def test_force_is_the_formula():
    rng = np.random.default_rng(1)
    v, i = rng.standard_normal((2, 50))
    base = DamperBaseline(Linear().replace(values={"damping": 7.0}))
    s = Signals(0.01, {"velocity": v, "current": i}, np.zeros(50))
    force = CurrentDependence().compose(base.core(base.vector), np.array([3.0, 5.0, 0.2]), base)(s)
    np.testing.assert_allclose(force, 7 * v + i * (3 * np.tanh(v / 0.2) + 5 * v), rtol=1e-12)


@pytest.mark.seconds
def test_found_from_a_linear_law_with_its_numbers():
    causes = named(bingham(random_levels()), "linear")
    assert {"current-dependence", "coulomb-friction"} <= causes.keys()
    found = causes["current-dependence"]
    assert found["yield_force"] == pytest.approx(YIELD, rel=0.05)
    assert found["viscous"] == pytest.approx(VISCOUS, rel=0.15)
    assert "coil-lag" not in causes


@pytest.mark.slow
def test_its_lag_is_found_beside_it():
    causes = named(bingham(random_levels(), lag=0.02), "linear")
    lags = {"coil-lag", "command-delay", "rise-fall-lag"} & causes.keys()
    assert "current-dependence" in causes and lags


def test_no_lag_of_a_current_without_what_reads_it():
    lag, follows = CoilLag(), CurrentDependence()
    assert not compatible([lag], ("velocity", "force")) and compatible([lag], ("velocity", "current"))
    assert compatible([lag, follows], ("velocity", "force"))


def test_steady_and_read_currents_are_refused():
    steady = bingham(np.full(5000, 0.6) + 1e-4 * np.random.default_rng(0).standard_normal(5000))
    base = DamperBaseline(Linear().replace(values={"damping": 700.0}))
    search, unusable = prepared([steady], base, CATALOGUE, lambda text: None)
    why = {c.name: c.reason for c in unusable}
    assert "the same in all records" in why["current-dependence"] and "does not depend" in why["coil-lag"]
    moving = bingham(random_levels(10.0))
    search, unusable = prepared([moving], base, CATALOGUE, lambda text: None)
    assert {"current-dependence", "coil-lag"} <= {e.name for e in search.candidates}
    assert "reads the current" in str(CurrentDependence().applies(guo(), tuple(search.problem.signals)))


def test_currents_that_rest_in_each_of_several_records_do_not_move():
    """A search cuts its records together, and between two of them a current goes from level to level."""
    rng = np.random.default_rng(0)
    records = [bingham(np.full(5000, level) + 2e-3 * rng.standard_normal(5000)) for level in (0.0, 1.2, 2.5)]
    search, unusable = prepared(records, guo(), (CoilLag(),), lambda text: None)
    assert len(search.problem.signals) == 1 and not search.candidates
    assert "constant" in unusable[0].reason


def test_levels_between_records_are_no_rest():
    def at(level: float) -> Signals:
        return Signals(0.01, {"current": np.full(400, level)}, np.zeros(400))

    assert at_rest([at(1.0), at(1.0)]) and not at_rest([at(0.2), at(1.0)])
