"""LPV-OE: prediction is the free run, estimates are consistent under coloured noise, intervals cover, real data."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.monte_carlo import coverage, joint_bias_test
from scipy.signal import lfilter

from lpvid import files
from lpvid.identification import identify
from lpvid.identification.arx import ARX
from lpvid.identification.output_error import OutputError
from lpvid.model.input_stage import TanhStage
from lpvid.model.noise_model import NoiseModel
from lpvid.model.scheduling_stage import SchedulingLag
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization import realize
from lpvid.record import Record
from lpvid.scheduling import Polynomial
from lpvid.simulation import predict, simulate

TRUTH = np.array([-1.0, 0.3, 0.4, -0.2, 0.6, 0.3, 0.3, -0.2])
BASIS = Polynomial("p", degree=1)
SETTINGS = {"na": 2, "nb": 2, "nk": 1, "input": "u", "output": "y", "basis": BASIS}


def coloured(rng: np.random.Generator, n: int = 2000, scale: float = 0.3) -> Record:
    """The system of `TRUTH` with noise (1 + 0.5 q⁻¹)/(1 − 0.85 q⁻¹) e at its output, by plain loops."""
    u = rng.normal(size=n)
    p = np.clip(lfilter([0.3], [1, -0.9], rng.normal(size=n)), -1, 1)
    p[:2] = -1, 1  # the box is then (−1, 1) and the parameters are those of p itself
    x = np.zeros(n)
    for k in range(2, n):
        x[k] = ((1.0 - 0.3 * p[k]) * x[k - 1] - (0.4 - 0.2 * p[k]) * x[k - 2]
                + (0.6 + 0.3 * p[k]) * u[k - 1] + (0.3 - 0.2 * p[k]) * u[k - 2])
    return Record({"u": u, "p": p, "y": x + lfilter([1, 0.5], [1, -0.85], scale * rng.normal(size=n))}, sample_time=1.0)


def random_record(rng: np.random.Generator, n: int) -> Record:
    return Record({"u1": rng.normal(size=n), "p": rng.uniform(-1, 1, n), "y1": rng.normal(size=n)}, sample_time=1.0)


def study(structure, runs: int, system=coloured) -> tuple[np.ndarray, np.ndarray]:
    """Estimates and standard errors (runs, 8) on fresh data each time."""
    found = [identify(system(np.random.default_rng(r)), structure) for r in range(runs)]
    return np.array([f.parameters for f in found]), np.array([f.standard_errors for f in found])


@pytest.mark.seconds
def test_consistent_where_least_squares_is_not_sample():
    estimates, errors = study(OutputError(**SETTINGS, starts=1), 12)
    assert joint_bias_test(estimates, TRUTH) > 0.001
    assert coverage(estimates, errors, TRUTH) > 0.85
    biased, _ = study(ARX(**SETTINGS), 12)
    assert np.abs(biased.mean(axis=0) - TRUTH).max() > 0.1
    assert np.abs(estimates.mean(axis=0) - TRUTH).max() < 0.06


@pytest.mark.slow
def test_consistent_where_least_squares_is_not():
    estimates, errors = study(OutputError(**SETTINGS, starts=1), 100)
    biased, biased_errors = study(ARX(**SETTINGS), 100)
    print(f"OE: p = {joint_bias_test(estimates, TRUTH):.3f}, coverage {coverage(estimates, errors, TRUTH):.3f}; "
          f"least squares: p = {joint_bias_test(biased, TRUTH):.1e}, "
          f"coverage {coverage(biased, biased_errors, TRUTH):.3f}, "
          f"largest bias {np.abs(biased.mean(axis=0) - TRUTH).max():.3f}")
    assert joint_bias_test(estimates, TRUTH) > 0.001
    assert 0.90 <= coverage(estimates, errors, TRUTH) <= 0.98
    assert joint_bias_test(biased, TRUTH) < 1e-6


@pytest.mark.seconds
def test_never_worse_than_its_start():
    for seed in range(4):
        record = coloured(np.random.default_rng(seed), 700, 0.5)
        first, found = identify(record, ARX(**SETTINGS)), identify(record, OutputError(**SETTINGS))
        assert found.training.overall.free_run.esr <= first.training.overall.free_run.esr


def test_the_prediction_is_the_free_run(rng):
    model = LPVTransferFunction.siso([[-0.8, 0.1]], [[0, 0], [1.0, 0.5]], BASIS, 1.0, noise=NoiseModel("output"))
    record = random_record(rng, 50)
    free = simulate(model, record)
    for horizon in (1, 7):
        ahead = predict(model, record, horizon)
        np.testing.assert_array_equal(ahead.output, free.output)
        assert ahead.horizon == horizon


def test_a_realisation_has_an_observer_gain_only_for_equation_noise(rng):
    model = LPVTransferFunction.siso([[-0.8, 0.1]], [[0, 0], [1.0, 0.5]], BASIS, 1.0)
    assert realize(model, "augmented").model.observer_gain is not None
    coloured_model = model.replace(noise=NoiseModel("output"))
    found = realize(coloured_model, "augmented").model
    assert found.observer_gain is None
    record = random_record(rng, 30)
    expected = simulate(model, record, "zero").output
    np.testing.assert_allclose(simulate(found, record, "zero").output, expected, atol=1e-12)


@pytest.mark.seconds
def test_two_outputs_and_two_inputs(rng):
    n = 3000
    u, p, x = rng.normal(size=(n, 2)), rng.uniform(-1, 1, n), np.zeros((n, 2))
    p[:2] = -1, 1
    a0, a1 = np.array([[0.6, 0.2], [-0.1, 0.5]]), np.array([[0.1, 0.0], [0.05, -0.2]])
    b = np.array([[1.0, 0.3], [0.0, 50.0]])
    for k in range(1, n):
        x[k] = (a0 + a1 * p[k]) @ x[k - 1] + b @ u[k - 1]
    noise = rng.normal(size=(n, 2)) * [0.1, 5.0]
    y = x + lfilter([1], [1, -0.7], noise, axis=0) @ np.array([[1, 10], [0, 1]])
    record = Record({"u1": u[:, 0], "u2": u[:, 1], "p": p, "y1": y[:, 0], "y2": y[:, 1]}, sample_time=1.0)
    found = identify(record, OutputError(1, 1, 1, ("u1", "u2"), ("y1", "y2"), BASIS))
    error = (found.parameters - _flat(a0, a1, b)) / found.standard_errors
    assert np.mean(np.abs(error) < 1.96) >= 0.8
    assert np.abs(error).max() < 4.0


def _flat(a0: np.ndarray, a1: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Output by output: a over sources and functions, then b."""
    rows = []
    for o in range(2):
        rows += [v for q in range(2) for v in (-a0[o, q], -a1[o, q])]
        rows += [v for q in range(2) for v in (b[o, q], 0.0)]
    return np.array(rows)


@pytest.mark.seconds
def test_a_scheduling_filter_by_name_joins_the_search_and_an_object_stays(rng):
    n = 3000
    u = rng.normal(size=n)
    p = np.repeat(rng.uniform(-1, 1, n // 25), 25)
    lag = SchedulingLag(tau_rise=0.03, tau_fall=0.08)
    q, x = lag.apply(p[:, None], 0.01)[:, 0], np.zeros(n)
    for k in range(1, n):
        x[k] = (0.6 + 0.3 * q[k]) * x[k - 1] + (1 + 0.5 * q[k]) * u[k - 1]
    record = Record({"u": u, "p": p, "y": x + 0.02 * rng.normal(size=n)}, sample_time=0.01)
    settings = {"na": 1, "nb": 1, "input": "u", "output": "y", "basis": BASIS}
    found = identify(record, OutputError(**settings, schedule_filter="rise-fall", starts=1))
    stage = found.model.scheduling_stage
    np.testing.assert_allclose([stage.tau_rise, stage.tau_fall], [0.03, 0.08], rtol=0.02)
    given = SchedulingLag(tau_rise=0.05, tau_fall=0.05)
    fixed = identify(record, OutputError(**settings, schedule_filter=given, starts=1))
    assert fixed.model.scheduling_stage == given
    assert fixed.training.overall.free_run.esr > found.training.overall.free_run.esr


@pytest.mark.seconds
def test_poles_outside_the_circle_are_followed_where_the_data_ask_for_them(rng):
    """A stable system whose frozen pole is 1.15 at one end of the range: held inside the circle, it cannot be found."""
    n = 3000
    u, p, x = rng.normal(size=n), rng.uniform(-1, 1, n), np.zeros(n)
    p[:2] = -1, 1
    for k in range(1, n):
        x[k] = (0.7 + 0.45 * p[k]) * x[k - 1] + u[k - 1]
    record = Record({"u": u, "p": p, "y": x + 0.3 * x.std() * rng.normal(size=n)}, sample_time=1.0)
    found = identify(record, OutputError(na=1, nb=1, input="u", output="y", basis=BASIS))
    np.testing.assert_allclose(found.parameters[:2], [-0.7, -0.45], atol=4 * found.standard_errors[:2].max())
    assert found.standard_errors[:2].max() < 0.03
    assert any("frozen pole outside the unit circle" in note for note in found.notes)
    inside = identify(record, OutputError(na=1, nb=1, input="u", output="y", basis=BASIS, frozen_poles="inside"))
    a = inside.parameters[0] + np.outer(p, inside.parameters[1:2]).ravel()  # the pole of every sample is −a
    assert np.abs(a).max() < 1.0
    assert inside.training.overall.free_run.esr > found.training.overall.free_run.esr


def thirds(record: Record) -> tuple[Record, Record]:
    cut = 2 * record.n_samples // 3
    return record.slice(0, cut), record.slice(cut, record.n_samples)


@pytest.mark.slow
def test_gyroscope_held_out_is_no_worse_than_least_squares(shared_data):
    training, held = thirds(files.read(shared_data / "gyroscope" / "estimation.csv")[0])
    settings = {"na": 4, "nb": 4, "nk": 1, "input": "motor current", "output": "gimbal speed", "affine": 5,
                "lagged": True, "basis": Polynomial(("p1", "p2", "p3"), degree=1)}
    first = identify(training, ARX(**settings), held_out=[held])
    found = identify(training, OutputError(**settings), held_out=[held])
    one, two = (f.held_out.overall.free_run.fit_percent for f in (first, found))
    print(f"gyroscope, held-out free run: ARX {one:.2f} %, OE {two:.2f} %")
    assert two >= one
    assert two >= 95.0
    assert found.training.overall.free_run.esr <= first.training.overall.free_run.esr


@pytest.mark.slow
def test_magnetorheological_damper_with_a_scheduling_filter(shared_data):
    training, held = thirds(files.read(shared_data / "mr_damper_random" / "estimation.csv")[0])
    structure = OutputError(4, 4, 0, "velocity", "force", Polynomial("voltage", degree=1), affine=1, stage="tanh",
                            schedule_filter="rise-fall")
    found = identify(training, structure, sample_rate=500.8, held_out=[held])
    print(f"MR damper, held-out free-run ESR {found.held_out.overall.free_run.esr:.4f}")
    assert found.held_out.overall.free_run.esr <= 0.03


@pytest.mark.seconds
def test_the_covariance_of_a_vague_estimate_has_no_negative_variance(rng):
    """Two outputs of a first-order system fitted with two poles too many, in coloured noise: condition above 1e8."""
    n = 1500
    u = np.cumsum(rng.normal(size=n)) / 30
    x = np.zeros(n)
    for k in range(1, n):
        x[k] = 0.98 * x[k - 1] + 0.02 * u[k - 1]
    noise = np.array([np.convolve(rng.normal(size=n), np.ones(20) / 20, "same") for _ in range(2)])
    record = Record({"u": u, "y": x + 1e-3 * noise[0], "z": 0.5 * x + 1e-3 * noise[1]}, sample_time=0.002)
    found = identify(record, OutputError(na=3, nb=3, nk=1, input="u", output=("y", "z"), basis=Polynomial(), starts=1,
                                         max_iterations=3))
    deviation = np.sqrt(np.diag(found.covariance))
    assert np.all(deviation > 0) and "autoregression" in found.covariance_kind
    values = np.linalg.eigvalsh(found.covariance / np.outer(deviation, deviation))
    assert values[0] >= -len(values) * np.finfo(float).eps * values[-1]


@pytest.mark.seconds
def test_a_search_begins_at_every_knee_where_a_knee_is_all_that_a_stage_has(rng, monkeypatch):
    """None where the stage is given, none of a stage with slopes, one for each start of the stage's own search."""
    from lpvid.identification import output_error

    v = 0.1 * np.sin(2 * np.pi * 0.5 * 0.01 * np.arange(400)) + 0.01 * rng.normal(size=400)
    y = lfilter([0.5], [1, -0.5], np.tanh(v / 0.02)) + 0.01 * rng.normal(size=400)
    record, begun = Record({"velocity": v, "force": y}, sample_time=0.01), []
    starts = output_error.knee_starts
    monkeypatch.setattr(output_error, "knee_starts", lambda *a: begun.append(starts(*a)) or begun[-1])
    tanh = TanhStage().starts(v[:, None], np.zeros((400, 0)))
    for stage in ("tanh", "three-zone", tanh[1]):
        identify(record, OutputError(1, 1, 0, "velocity", "force", stage=stage, starts=1))
    knees = {model.input_stage.v0 for _, model in begun[0]}
    assert knees == {s.v0 for s in tanh}
    assert begun[1:] == [[], []]


@pytest.mark.seconds
def test_the_knee_of_friction_is_found_where_least_squares_leads_astray(shared_data):
    training, = files.read(shared_data / "emps" / "first.csv")
    found = identify(training, OutputError(2, 3, 0, "velocity", "force", affine=1, stage="tanh", frozen_poles="inside"),
                     held_out=files.read(shared_data / "emps" / "last.csv"))
    assert found.training.overall.free_run.fit_percent > 95.5  # from the knee of least squares 92.2
    assert found.held_out.overall.free_run.fit_percent > 95.3  # 92.1
