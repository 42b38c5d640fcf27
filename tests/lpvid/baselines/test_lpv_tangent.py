"""Forward sensitivities of a transfer function against central differences of its run, alone and inside effects."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.baselines.lpv_baseline import LpvBaseline
from lpvid.baselines.signals import Signals
from lpvid.effects.composition import Composition
from lpvid.effects.effect import by_name
from lpvid.model.input_stage import TanhStage
from lpvid.model.scheduling_stage import SchedulingLag
from lpvid.model.signals import Signal
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Polynomial, Scheduling
from quartercar.effects import CATALOGUE

PERIOD = 0.002
V, F = (Signal("velocity", "m/s"),), (Signal("force", "N"),)
BOX = Scheduling(("current",), (0.0,), (2.0,), units=("A",))


def plain(lagged: bool = False) -> LPVTransferFunction:
    """Three lags back, three of the input, a constant; coefficients at the sample or at that of their lag."""
    return LPVTransferFunction.siso([[-1.1, 0.05], [0.35, -0.02], [0.05, 0.01]], [[0, 0], [90.0, 20.0], [60.0, 10.0]],
                                    Polynomial("current", 1), PERIOD, c=[[3.0, 0.5]], scheduling=BOX, inputs=V,
                                    outputs=F, scheduling_stage=SchedulingLag(0.006, 0.01), lagged=lagged)


def shaped() -> LPVTransferFunction:
    """A shaped input: two inputs of the filter."""
    b = np.array([[[[90.0, 20.0], [70.0, 30.0]]]])
    return LPVTransferFunction([[[[-0.6, 0.05]]]], b, Polynomial("current", 1), PERIOD, BOX, inputs=V, outputs=F,
                               input_stage=TanhStage(0.03, 0.002))


def signals(n: int = 700) -> Signals:
    rng, t = np.random.default_rng(3), PERIOD * np.arange(n)
    v = 0.1 * np.sin(9 * t) + 0.05 * np.sin(31 * t)
    return Signals(PERIOD, {"velocity": v, "displacement": np.cumsum(v) * PERIOD,
                            "current": np.repeat(rng.uniform(0, 2, n // 35), 35)}, 800 * v + rng.standard_normal(n),
                   span=(0.0, 1.0))


def central(composition: Composition, s: Signals, vector: np.ndarray, columns: range) -> np.ndarray:
    """(n, columns) by central differences of whole runs."""
    out = np.empty((s.n_samples, len(columns)))
    for column, j in enumerate(columns):
        step = 1e-5 * composition.scales[j]
        up, down = vector.copy(), vector.copy()
        up[j], down[j] = up[j] + step, down[j] - step
        out[:, column] = (composition.predict(s, up) - composition.predict(s, down)) / (2 * step)
    return out


@pytest.mark.parametrize("model", [plain(), plain(lagged=True), shaped()], ids=["plain", "lagged", "shaped"])
@pytest.mark.parametrize("polarity", [1, -1])
def test_alone(model: LPVTransferFunction, polarity: int) -> None:
    baseline, s = LpvBaseline(model, polarity=polarity), signals()
    assert baseline.forward
    found = baseline.sensitivities(s, baseline.vector)
    exact = central(Composition(baseline), s, baseline.vector, range(baseline.vector.size))
    for j in range(baseline.vector.size):
        assert np.abs(found[:, j] - exact[:, j]).max() <= 2e-5 * max(float(np.abs(exact[:, j]).max()), 1e-12), j


@pytest.mark.parametrize(("names", "values"), [
    (("coulomb-friction",), [20.0, 0.0, 2e-3]), (("displacement-delay", "gas-stiffness"), [500.0, 3.0, 0.004, 0.2]),
    (("asymmetry", "force-clipping"), [0.3, 1 / 60]), (("fixture-resonance",), [0.003, 0.2])])
def test_inside_effects(names: tuple[str, ...], values: list[float]) -> None:
    causes = by_name(CATALOGUE)
    baseline, s = LpvBaseline(plain()), signals()
    composition = Composition(baseline, tuple(causes[n] for n in names))
    vector = np.concatenate([baseline.vector, values])
    found = composition.sensitivities(s, vector)[:, : composition.own]
    exact = central(composition, s, vector, range(composition.own))
    for j in range(composition.own):
        assert np.linalg.norm(found[:, j] - exact[:, j]) <= 2e-3 * max(float(np.linalg.norm(exact[:, j])), 1e-12), j
