"""The phase transition model: against linear theory, a tight integration, its own inverse and measured dampers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import StateSpace, lsim

import lpvid as lpv
from lpvid import InputError
from lpvid.condition import resample
from quartercar.dampers import Drive, FitSettings
from quartercar.dampers.facts import Facts
from quartercar.dampers.fitting import fit
from quartercar.dampers.laws.wang_kamath import WangKamath


def drive(duration: float, rate: float = 512.0, current: float = 0.0, seed: int = 0) -> Drive:
    """A multisine of about 6 mm and 0.15 m/s at a current that swings by half."""
    t = np.arange(0.0, duration, 1 / rate)
    f, phase = np.linspace(0.5, 12, 20), np.random.default_rng(seed).uniform(0, 2 * np.pi, 20)
    angle = 2 * np.pi * np.outer(t, f) + phase
    return Drive(1 / rate, np.cos(angle) @ (0.003 * 2 * np.pi * np.sqrt(f)), np.sin(angle) @ (0.003 / np.sqrt(f)),
                 current * (1 + 0.5 * np.sin(3 * t)))


def rms(error: np.ndarray, force: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)) / force.std())


def test_with_a_straight_flow_it_is_a_linear_filter() -> None:
    """w_4 = w_5 → 0: a second-order filter of the velocity, exact where that is linear between samples."""
    model = WangKamath(values={"force_inertia": 2e-6, "force_lag": 5e-4, "linear_flow": 0.2, "cubic_flow": 0.0,
                               "quintic_flow": 1e-8})
    given = drive(1.0)
    w1, w2, w3, *_ = model.vector
    state = model.rest(0.0, given.velocity[0], 0.0, None, model.vector)
    system = StateSpace([[0, 1], [-w3 / w1, -w2 / w1]], [[0], [1 / w1]], [[1000.0, 0]], [[0]])
    _, exact, _ = lsim(system, given.velocity, given.times, X0=state)
    assert rms(model.response(given, model.vector) - exact, exact) < 2e-4


@pytest.mark.parametrize(("degree", "values", "tolerance"), [
    (0, {}, 5e-4), (0, {"linear_flow": -0.02}, 5e-4), (0, {"linear_flow": 0.05, "cubic_flow": -0.1}, 5e-4),
    (0, {"force_inertia": 1e-7}, 5e-4), (0, {"force_lag": 3e-4}, 2e-3), (1, {}, 5e-4),
    (2, {"cubic_flow_1": 0.05}, 5e-4)])
@pytest.mark.slow
def test_against_lsoda(degree: int, values: dict[str, float], tolerance: float) -> None:
    """Smooth, bistable (w_3 < 0), three-branched (w_4 < 0), stiff (w_1 → 0), ringing (w_2 → 0), with the current."""
    model = WangKamath(degree=degree, values=values, current_scale=2.0)
    given = drive(0.3, 1024.0, 1.0 if degree else 0.0)

    def at(t: float) -> tuple[float, float, float]:
        return 0.0, float(np.interp(t, given.times, given.velocity)), float(np.interp(t, given.times, given.current))

    start = model.rest(*at(0.0), None, model.vector)
    run = solve_ivp(lambda t, s: model.rates(s, *at(t)), (0, given.times[-1]), start, "LSODA", given.times, rtol=1e-9,
                    atol=1e-11, max_step=1 / 1024)
    exact = 1000.0 * run.y[0]
    assert rms(model.response(given, model.vector) - exact, exact) < tolerance


def test_second_order() -> None:
    """Each halving of the sample time of a finely sampled motion quarters the error."""
    from quartercar.dampers.laws._wang_kamath_kernels import wang_kamath_run

    model, given = WangKamath(), drive(0.5)
    theta = np.ascontiguousarray(model.coefficients(given.current, model.vector))
    f, g = model.rest(0.0, given.velocity[0], 0.0, None, model.vector)
    runs = [wang_kamath_run(given.velocity, given.sample_time, np.full(theta.shape[0] - 1, k), theta, f, g)
            for k in (2, 4, 8, 64)]
    errors = [rms(r - runs[-1], runs[-1]) for r in runs[:-1]]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.25)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.25)


def test_static_force_solves_the_quintic_and_is_where_a_run_ends() -> None:
    for values in ({}, {"linear_flow": -0.02}, {"linear_flow": 0.05, "cubic_flow": -0.08}):
        both = {f"{name}_{m}": value for name, value in values.items() for m in (0, 1)}
        model = WangKamath(degree=1, current_scale=2.0, values=both)
        v = np.array([-0.4, -0.03, 0.01, 0.2])
        for current in (0.0, 1.5):
            w = model.coefficients(current, model.vector)[0]
            f = model.static_force(v, current) / 1000.0
            assert w[2] * f + w[3] * f**3 + w[4] * f**5 == pytest.approx(v, rel=1e-9)
            assert (np.sign(f) == np.sign(v)).all()
            for speed, force in zip(v, f, strict=True):
                still = Drive(1e-3, np.full(3000, speed), np.zeros(3000), np.full(3000, current), np.zeros(3000))
                assert model.response(still, model.vector)[-1] == pytest.approx(1000 * force, rel=1e-5)


def test_bistable_law_jumps_between_two_forces() -> None:
    """w_3 < 0: at rest it holds ±√(−w_3/w_5)^{1/2}, by what it was last pushed to."""
    model = WangKamath(values={"linear_flow": -0.02, "cubic_flow": 0.0, "quintic_flow": 0.1})
    held = 1000.0 * (0.02 / 0.1) ** 0.25
    t = np.arange(0.0, 3.0, 1e-3)
    for sign in (1.0, -1.0):
        push = Drive(1e-3, sign * 0.1 * (t < 1.0), np.zeros(t.size), np.zeros(t.size))
        assert model.response(push, model.vector)[-1] == pytest.approx(sign * held, rel=1e-6)


def test_first_force_is_the_measured_one() -> None:
    given, model = drive(0.1), WangKamath()
    known = Drive(given.sample_time, given.velocity, given.displacement, given.current, np.full(given.n_samples, 123.0))
    assert model.response(known, model.vector)[0] == pytest.approx(123.0, rel=1e-12)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_coefficients_stay_above_zero_between_and_beyond_the_ends(degree: int, rng: np.random.Generator) -> None:
    model = WangKamath(degree=degree, current_scale=1.5)
    vector = np.abs(rng.normal(size=model.vector.size)) + 1e-6
    w = model.coefficients(np.linspace(-1.0, 4.0, 101), vector)
    assert (w > 0).all()
    ends = vector.reshape(5, degree + 1)
    assert model.coefficients(0.0, vector)[0] == pytest.approx(ends[:, 0])
    assert model.coefficients(1.5, vector)[0] == pytest.approx(ends[:, -1])
    inside = np.linspace(0, 1.5, degree + 2)
    again = np.polynomial.Polynomial.fit(inside, model.coefficients(inside, vector)[:, 3], degree)
    assert model.coefficients(0.77, vector)[0, 3] == pytest.approx(again(0.77))


def test_the_regression_of_its_own_force_starts_next_to_the_truth(rng: np.random.Generator) -> None:
    model, given = WangKamath(), drive(4.0)
    force = model.response(given, model.vector)
    known = Drive(given.sample_time, given.velocity, given.displacement, given.current, force)
    best = WangKamath().starts([known], 1, rng)[0]
    assert rms(model.response(given, best) - force, force) < 0.05
    assert best[[1, 2, 4]] == pytest.approx(model.vector[[1, 2, 4]], rel=0.25)


@pytest.mark.seconds
def test_recovered_from_its_own_simulation() -> None:
    truth = WangKamath(degree=1, current_scale=2.0, values={
        "force_inertia_0": 3e-6, "force_inertia_1": 2e-6, "force_lag_0": 8e-4, "force_lag_1": 5e-4,
        "linear_flow_0": 0.03, "linear_flow_1": 0.01, "cubic_flow_0": 0.02, "cubic_flow_1": 0.01,
        "quintic_flow_0": 0.08, "quintic_flow_1": 0.02})
    given = drive(2.0, current=1.2)
    motion = lpv.Record({"velocity": given.velocity, "current": given.current}, sample_time=given.sample_time,
                        units={"velocity": "m/s", "current": "A"})
    record = motion.with_channel("force", truth.simulate(motion).output[:, 0], "N")
    found = fit(WangKamath(degree=1, current_scale=2.0), [record], settings=FitSettings(starts=4, polished=1))
    assert found.damper.vector == pytest.approx(truth.vector, rel=1e-4)


def test_growing_force_is_one_law_in_other_units() -> None:
    """At a constant current i it is the same law with F_s(1 + g i) for F_s."""
    given = drive(0.5, current=1.0)
    still = Drive(given.sample_time, given.velocity, given.displacement, np.full(given.n_samples, 0.7))
    grown = WangKamath(growing=True, values={"force_growth": 4.0})
    plain = WangKamath(force_scale=1000.0 * 3.8)
    assert grown.response(still, grown.vector) == pytest.approx(plain.response(still, plain.vector), rel=1e-12)
    assert grown.static_force(np.array([0.2]), 0.7) == pytest.approx(plain.static_force(np.array([0.2])), rel=1e-12)
    w = WangKamath(degree=1, values={f"{n}_{m}": v / 3.8**p for m in (0, 1) for n, v, p in zip(
        ("force_inertia", "force_lag", "linear_flow", "cubic_flow", "quintic_flow"), plain.vector, (1, 1, 1, 3, 5),
        strict=True)})
    assert w.response(still, w.vector) == pytest.approx(plain.response(still, plain.vector), rel=1e-9)


def test_structure_follows_the_data_and_bad_settings_are_refused() -> None:
    given = drive(1.0, current=1.0)
    channels = {"velocity": given.velocity, "force": 3000 * given.velocity}
    units = {"velocity": "m/s", "current": "A", "force": "N"}
    bare = WangKamath.suited(Facts.of([lpv.Record(channels, sample_time=1 / 512, units=units)]))
    assert (bare.degree, bare.reads) == (0, ("velocity",))
    assert bare.force_scale == pytest.approx(2 * 3000 * given.velocity.std(), rel=0.05)
    swung = WangKamath.suited(Facts.of([lpv.Record({**channels, "current": given.current}, sample_time=1 / 512,
                                                   units=units)]))
    assert (swung.growing, swung.degree, swung.reads) == (True, 0, ("velocity", "current"))
    with pytest.raises(InputError, match="not by both"):
        WangKamath(growing=True, degree=1)
    with pytest.raises(InputError, match="degree"):
        WangKamath(degree=3)
    with pytest.raises(InputError, match="force_scale"):
        WangKamath(force_scale=0.0)
    with pytest.raises(InputError, match="no LPV form"):
        WangKamath().to_lpv(1e-3)


@pytest.mark.slow
def test_on_the_measured_lord_damper_it_is_mediocre(shared_data) -> None:
    """Held-out ESR about 0.11: no lag from the voltage to the force, no preload; the Bouc-Wen model has 0.023."""
    found = lpv.read(shared_data / "mr_damper_random" / "estimation.csv", roles={"current": "voltage"})
    record = resample(found[0] if isinstance(found, list) else found, 500.8)
    train, test = record.slice(0, 4006), record.slice(4006, record.n_samples)
    fitted = fit(WangKamath.suited(Facts.of([train])), [train], [test])
    assert 0.03 < fitted.held_out.esr < 0.13
