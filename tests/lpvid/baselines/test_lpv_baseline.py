"""LPV models as baselines: their run is the library's own, their derivative that of the run, in the device's sign."""

from __future__ import annotations

import numpy as np
import pytest

import lpvid as lpv
from lpvid.baselines.budgets import MOST_FREE
from lpvid.baselines.lpv_baseline import LpvBaseline
from lpvid.errors import InputError
from lpvid.model.compliance import ComplianceModel, Element
from lpvid.model.input_stage import TanhStage
from lpvid.model.quasi import QuasiLPVModel
from lpvid.model.scheduling_stage import SchedulingLag
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Channel, Record
from lpvid.scheduling import Polynomial, Scheduling, Spline

PERIOD = 0.002
V, F = (Signal("velocity", "m/s"),), (Signal("force", "N"),)
BOX = Scheduling(("current",), (0.0,), (2.0,), units=("A",))


@pytest.fixture
def record(rng: np.random.Generator) -> Record:
    n = 900
    t = PERIOD * np.arange(n)
    velocity = 0.1 * np.sin(9 * t) + 0.05 * np.sin(31 * t)
    current = np.repeat(rng.uniform(0, 2, n // 30), 30)
    return Record({"velocity": Channel(velocity, "m/s"), "current": Channel(current, "A"),
                   "displacement": Channel(np.cumsum(velocity) * PERIOD, "m"),
                   "force": Channel(800 * velocity + rng.standard_normal(n), "N")}, PERIOD)


def transfer_function(metadata: dict | None = None) -> LPVTransferFunction:
    return LPVTransferFunction.siso([[-1.2, 0.05], [0.4, -0.02]], [[0, 0], [90.0, 20.0], [60.0, 10.0]],
                                    Polynomial("current", 1), PERIOD, c=[[3.0, 0.5]], scheduling=BOX, inputs=V,
                                    outputs=F, scheduling_stage=SchedulingLag(0.006, 0.01), metadata=metadata or {})


def shaped() -> LPVTransferFunction:
    b = np.array([[[[90.0, 20.0], [70.0, 30.0]]]])
    return LPVTransferFunction([[[[-0.6, 0.05]]]], b, Polynomial("current", 1), PERIOD, BOX, inputs=V, outputs=F,
                               input_stage=TanhStage(0.03, 0.002))


def state_space() -> LPVStateSpace:
    return LPVStateSpace([[[0.6, 0.1], [0.0, 0.5]], [[0.05, 0.0], [0.0, 0.02]]], [[[1.0], [0.5]], [[0.0], [0.1]]],
                         [[[200.0, 90.0]], [[10.0, 0.0]]], [[[50.0]], [[5.0]]], Polynomial("current", 1), PERIOD, BOX,
                         output_offset=[[4.0], [0.0]], inputs=V, outputs=F)


def quasi() -> QuasiLPVModel:
    return QuasiLPVModel([[[0.7, 200.0, 2.0]], [[0.5, 150.0, 2.0]]], Spline("force", 1, 1, (-100.0, 100.0)), 1, (1,),
                         (0,), PERIOD, V, F)


def compliance() -> ComplianceModel:
    return ComplianceModel((Element([[-100.0, 0.0, 100.0]], 2e4),), [-0.2, 0.0, 0.2], [5.0], [], 3.0, PERIOD, V, F)


ALL = (transfer_function, shaped, state_space, quasi, compliance)


@pytest.mark.parametrize("make", ALL)
def test_its_run_is_that_of_simulate_and_a_stored_one_runs_alike(make, record):
    model = make()
    baseline = LpvBaseline(model)
    signals = baseline.signals(record)
    mine = baseline.core(baseline.vector)(signals)
    np.testing.assert_allclose(mine, lpv.simulate(model, record).output[:, 0], rtol=1e-12, atol=1e-12)
    again = LpvBaseline.from_dict(baseline.to_dict())
    np.testing.assert_array_equal(again.core(again.vector)(signals), mine)
    assert again.channels == baseline.channels


@pytest.mark.thinned(5, "seconds")
@pytest.mark.parametrize("make", ALL)
def test_every_coefficient_moves_the_run_and_the_derivative_is_that_of_central_differences(make, record):
    baseline = LpvBaseline(make())
    signals = baseline.signals(record)
    vector = baseline.vector
    found = baseline.sensitivities(signals, vector)
    assert found.shape == (record.n_samples, vector.size) and vector.size == len(baseline.coefficients)
    for j, coefficient in enumerate(baseline.coefficients):
        step = 1e-4 * coefficient.scale * np.eye(vector.size)[j]
        central = (baseline.core(vector + step)(signals) - baseline.core(vector - step)(signals)) / (2 * step[j])
        assert np.abs(central).max() > 0
        np.testing.assert_allclose(found[:, j], central, atol=3e-3 * np.abs(central).max())


def test_filter_and_shape_are_free_too():
    names = [c.name for c in LpvBaseline(transfer_function()).coefficients]
    assert names[-2:] == ["schedule_filter[0]", "schedule_filter[1]"]
    assert [c.name for c in LpvBaseline(shaped()).coefficients][-2:] == ["shape[0]", "shape[1]"]
    moved = LpvBaseline(transfer_function()).with_vector(LpvBaseline(transfer_function()).vector * 1.5)
    np.testing.assert_allclose(moved.model.scheduling_stage.vector, [0.009, 0.015])
    np.testing.assert_allclose(moved.model.b[1, 0, 0], [135.0, 30.0])


def test_a_large_model_frees_only_what_its_run_is_linear_in(record):
    n, rng = 6, np.random.default_rng(0)
    a = 0.3 * rng.standard_normal((2, n, n)) / n
    model = LPVStateSpace(a, rng.standard_normal((2, n, 1)), 50 * rng.standard_normal((2, 1, n)), np.ones((2, 1, 1)),
                          Polynomial("current", 1), PERIOD, BOX, inputs=V, outputs=F)
    assert a.size + 2 * n > MOST_FREE
    baseline = LpvBaseline(model)
    assert baseline.vector.size == 2 * n + 2
    signals = baseline.signals(record)
    y1, y2 = (baseline.core(k * baseline.vector)(signals)[model.start:] for k in (1.0, 1.0 + 1e-9))
    np.testing.assert_allclose(y1, y2, rtol=1e-6, atol=1e-4)


def test_reversed_records_are_turned_and_the_model_with_them(record):
    turned = Record({**record.channels, "force": Channel(-record["force"], "N")}, PERIOD)
    plain = transfer_function()
    reverse = plain.replace(b=-plain.b, c=-plain.c, metadata={"polarity": "reversed"})
    here, there = LpvBaseline(plain), LpvBaseline(reverse)
    assert (here.polarity, there.polarity) == (1, -1)
    s, r = here.signals(record), there.signals(turned)
    np.testing.assert_array_equal(r.output, s.output)
    np.testing.assert_allclose(there.core(there.vector)(r), here.core(here.vector)(s), rtol=1e-12)
    device = LpvBaseline(plain, "damper", "device", -1)
    np.testing.assert_allclose(device.core(device.vector)(device.signals(turned)), here.core(here.vector)(s),
                               rtol=1e-12)


def test_what_cannot_run_is_not_finite_and_what_is_no_baseline_is_refused(record):
    baseline = LpvBaseline(transfer_function())
    wild = baseline.vector.copy()
    wild[0] = -9.0
    assert not np.isfinite(baseline.core(wild)(baseline.signals(record))).all()
    falling = LpvBaseline(compliance())
    assert np.isnan(falling.core(np.full(falling.vector.size, np.inf))(falling.signals(record))).all()
    with pytest.raises(InputError, match="one output"):
        LpvBaseline(state_space().replace(sample_time=None))
    with pytest.raises(InputError, match="another rate"):
        baseline.signals(Record({n: record.channels[n] for n in ("velocity", "current", "force")}, 2 * PERIOD))
