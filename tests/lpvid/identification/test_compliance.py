"""The compliance damper: closed forms, a stiff solver, nestedness, bounds, sensitivities, recovery, files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import lpvid as lpv
from lpvid.condition import split_tail
from lpvid.errors import InputError
from lpvid.identification.compliance import Compliance
from lpvid.identification.compliance_problem import ComplianceProblem
from lpvid.model.compliance import ComplianceModel, Element
from lpvid.model.scheduling_stage import SchedulingLag
from lpvid.scheduling import Polynomial, Scheduling, Spline

PERIOD = 1 / 512
KNOTS = (-0.5, -0.1, -0.03, -0.01, 0.0, 0.01, 0.03, 0.1, 0.5)
STIFFNESS = 5e5
SIGNALS = ((lpv.Signal("velocity", "m/s"),), (lpv.Signal("force", "N"),))


def smooth_law(w: np.ndarray | float) -> np.ndarray:
    return 1000 * np.tanh(np.asarray(w) / 0.05) + 1500 * np.asarray(w)


def model_of(law: np.ndarray, knots=KNOTS, stiffness: float = STIFFNESS, **more) -> ComplianceModel:
    return ComplianceModel([Element(np.atleast_2d(law), stiffness)], np.array(knots), np.zeros(0), np.zeros(0), 0.0,
                           PERIOD, *SIGNALS, **more)


def random_law(rng: np.random.Generator, rows: int = 1) -> np.ndarray:
    law = np.cumsum(rng.uniform(0.1, 300, (rows, len(KNOTS))), axis=1)
    return law - law[:, 4:5]


def random_model(rng: np.random.Generator, states: int = 2) -> ComplianceModel:
    box = Scheduling(("current",), (0.0,), (2.0,))
    elements = [Element(random_law(rng, 3), k) for k in rng.uniform(1e5, 1e6, states)]
    return ComplianceModel(elements, np.array(KNOTS), rng.normal(size=2) * 300, rng.normal(size=1) * 100, 20.0, PERIOD,
                           (*SIGNALS[0], lpv.Signal("displacement", "m")), SIGNALS[1],
                           Spline("current", 2, 1).bound(box), box, SchedulingLag(0.004, 0.008), 3)


def driven(rng: np.random.Generator, n: int = 200, amplitude: float = 0.2) -> lpv.Record:
    v = amplitude * np.convolve(rng.normal(size=n), np.ones(5) / 5**0.5, mode="same")
    return lpv.Record({"velocity": v, "displacement": np.cumsum(v) * PERIOD, "force": 100 * rng.normal(size=n),
                       "current": np.repeat(rng.uniform(0, 2, n // 20 + 1), 20)[:n]}, sample_time=PERIOD)


# -- simulation --------------------------------------------------------------------------------------------------------
def test_maxwell_element_has_the_closed_form_work_per_cycle() -> None:
    """W = π c ω X²/(1 + ω²τ²) and F(v=0) = cω²Xτ/(1 + ω²τ²), equation sheet 9.1."""
    c, frequency, stroke = 2000.0, 8.0, 0.01
    omega, tau = 2 * np.pi * frequency, c / STIFFNESS * 5
    time = np.arange(64 * 20 + 1) * PERIOD
    x, v = stroke * np.sin(omega * time), stroke * omega * np.cos(omega * time)
    model = model_of(c * np.array(KNOTS), stiffness=STIFFNESS / 5, substeps=200)
    record = lpv.Record({"velocity": v, "force": np.zeros(v.size)}, sample_time=PERIOD)
    force = lpv.simulate(model, record).output[:, 0]
    cycle = slice(-65, None)
    work = np.trapezoid(force[cycle], x[cycle])
    assert work == pytest.approx(np.pi * c * omega * stroke**2 / (1 + (omega * tau) ** 2), rel=0.003)
    crest = -65 + 16
    assert force[crest] == pytest.approx(c * omega**2 * stroke * tau / (1 + (omega * tau) ** 2), rel=0.01)


@pytest.mark.seconds
def test_simulation_converges_to_a_stiff_solver(rng: np.random.Generator) -> None:
    """Against scipy's Radau on Ḟ = k_h (v − g(F)), g the inverse of the same piecewise linear law; order one."""
    from scipy.integrate import solve_ivp

    law = smooth_law(np.array(KNOTS))
    v = driven(rng, 120)["velocity"]
    time = np.arange(120) * PERIOD

    def rate(t: float, force: np.ndarray) -> np.ndarray:
        return STIFFNESS * (np.interp(t, time, v) - np.interp(force, law, KNOTS))

    solved = solve_ivp(rate, (0, time[-1]), [0.0], "Radau", t_eval=time, rtol=1e-8, atol=1e-6, max_step=PERIOD / 2)
    exact = solved.y[0]
    record = lpv.Record({"velocity": v, "force": np.zeros(120)}, sample_time=PERIOD)
    errors = [np.sqrt(np.mean((lpv.simulate(model_of(law, substeps=s), record).output[:, 0] - exact) ** 2))
              for s in (4, 16, 64)]
    assert errors[0] < 0.04 * exact.std() and errors[2] < 0.0025 * exact.std()
    assert 3 < errors[0] / errors[1] < 5 and 3 < errors[1] / errors[2] < 5


def test_an_endless_stiffness_gives_the_static_law(rng: np.random.Generator) -> None:
    record = driven(rng)
    law = random_law(rng)
    run = lpv.simulate(model_of(law, stiffness=1e16), record).output[1:, 0]
    static = np.interp(record["velocity"], KNOTS, law[0])
    inside = np.abs(record["velocity"][1:]) < 0.5
    np.testing.assert_allclose(run[inside], static[1:][inside], rtol=1e-6, atol=1e-4)


def test_one_step_starts_from_the_measured_force(rng: np.random.Generator) -> None:
    model, record = random_model(rng, 1), driven(rng, 60)
    held = replace(model, scheduling_stage=None)
    one = lpv.predict(held, record, 1).output[:, 0]
    for k in (5, 33, 59):
        assert one[k] == pytest.approx(lpv.simulate(held, record.slice(k - 2, k + 1)).output[-1, 0], rel=1e-10)
    np.testing.assert_allclose(lpv.predict(model, record, 60).output, lpv.simulate(model, record).output, rtol=1e-9)


def test_the_start_is_estimated(rng: np.random.Generator) -> None:
    model, record = model_of(random_law(rng)), driven(rng, 100, 0.02)
    y = lpv.simulate(model, record, np.array([[400.0]])).output[:, 0]
    found = lpv.simulate(model, record.with_channel("force", y), "estimate")
    assert np.abs(found.output[:, 0] - y).max() < 0.02 * np.abs(y).max()


# -- bounds ------------------------------------------------------------------------------------------------------------
@pytest.mark.seconds
@given(seed=st.integers(0, 10_000), amplitude=st.floats(1e-3, 1e3), stiffness=st.floats(1e2, 1e10),
       steps=st.booleans())
def test_force_stays_in_the_static_law_s_range(seed: int, amplitude: float, stiffness: float, steps: bool) -> None:
    """max|F| ≤ max|F_s(±U)| from rest, for any stiffness, step length and velocity within ±U."""
    rng = np.random.default_rng(seed)
    law = random_law(rng)
    v = amplitude * (np.sign(rng.normal(size=200)) if steps else rng.uniform(-1, 1, 200))
    run = lpv.simulate(model_of(law, stiffness=stiffness, substeps=1),
                       lpv.Record({"velocity": v, "force": np.zeros(200)}, sample_time=PERIOD), "zero").output
    slope = np.diff(law[0])[[0, -1]] / np.diff(KNOTS)[[0, -1]]
    ends = [law[0, 0] - slope[0] * max(amplitude - 0.5, 0), law[0, -1] + slope[1] * max(amplitude - 0.5, 0)]
    assert np.abs(run).max() <= max(np.abs(ends)) * (1 + 1e-9)
    assert model_of(law).force_bound(amplitude) <= max(np.abs(ends)) * (1 + 1e-9)


def test_two_runs_forget_their_start(rng: np.random.Generator) -> None:
    model, record = model_of(random_law(rng), stiffness=1e6), driven(rng, 400)
    runs = [lpv.simulate(model, record, np.array([[f]])).output[:, 0] for f in (-5000.0, 5000.0)]
    gap = runs[1] - runs[0]
    assert np.all(np.diff(gap) <= 1e-9) and np.all(gap >= -1e-9) and gap[-1] < 1e-3


# -- sensitivities -----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("states", [1, 2])
@pytest.mark.parametrize("asymmetric", [True, False])
def test_sensitivities_are_difference_quotients(rng: np.random.Generator, states: int, asymmetric: bool) -> None:
    problem = ComplianceProblem.of([driven(rng, 60)], random_model(rng, states), True, asymmetric)
    x = problem.start()
    _, jacobian = next(iter(problem.pieces(x, True)))
    assert jacobian is not None and jacobian.shape[1] == x.size
    for place in range(x.size):
        step = np.zeros(x.size)
        step[place] = 1e-6 * max(1.0, abs(x[place])) if place < x.size - 2 else 1e-8
        up, down = (next(iter(problem.pieces(x + s * step, False)))[0] for s in (1, -1))
        quotient = (up - down) / (2 * step[place])
        np.testing.assert_allclose(jacobian[:, place], quotient, rtol=1e-3, atol=2e-4 * (1e-3 + np.abs(quotient).max()))


# -- estimation --------------------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_stiffness_and_law_are_recovered(rng: np.random.Generator) -> None:
    """Data from a fine Euler run of the smooth law (its inverse by interpolation), with 1 % noise."""
    fine, n = 40, 1500
    v = np.repeat(rng.normal(size=n // 10), 10) * 0.12
    v = np.convolve(v, np.ones(8) / 8, mode="same")
    table = np.linspace(-1.5, 1.5, 6001)
    force, at = np.zeros(n), 0.0
    for k in range(1, n):
        for s in range(fine):
            share = (s + 0.5) / fine
            speed = v[k - 1] * (1 - share) + v[k] * share
            at += PERIOD / fine * STIFFNESS * (speed - np.interp(at, smooth_law(table), table))
        force[k] = at
    record = lpv.Record({"velocity": v, "force": force + 0.01 * force.std() * rng.normal(size=n)}, sample_time=PERIOD)
    knots = np.array([0.015, 0.03, 0.05, 0.075, 0.11, 0.16, 0.25])
    structure = Compliance(knots=(*-knots[::-1], 0.0, *knots), lags=0, asymmetric=False, substeps=16)
    found = lpv.identify(record, structure)
    model = found.model
    assert isinstance(model, ComplianceModel) and found.fit is not None and found.fit > 98
    assert model.stiffness[0] == pytest.approx(STIFFNESS, rel=0.06)
    w = np.array([-0.15, -0.05, 0.02, 0.05, 0.1, 0.15])
    np.testing.assert_allclose(model.static_force(w), smooth_law(w), rtol=0.05)
    errors = found.standard_errors[list(model.parameter_names).index("ln k_h")]
    assert abs(np.log(model.stiffness[0] / STIFFNESS)) < 5 * errors + 0.03  # 0.03: the law's polygon


@pytest.mark.seconds
def test_real_damper_with_voltage(shared_data: Path) -> None:
    record = lpv.read(str(shared_data / "mr_damper_random" / "estimation.csv"))[0]
    training, held_out = split_tail(record)
    structure = Compliance(current="voltage", levels=1, lags=3, side="displacement", schedule_filter="rise-fall",
                           substeps=2, max_iterations=15)
    found = lpv.identify(training, structure, held_out=held_out, sample_rate=500.8)
    assert found.held_out is not None
    esr = found.held_out.overall.free_run.esr
    assert esr is not None and esr < 0.02


@pytest.mark.slow
def test_virtual_rig_sample() -> None:
    from quartercar.rig import default_records

    training, held_out = (default_records(0, part, ["test-1"])[0].slice(0, 2500) for part in ("training", "held-out"))
    structure = Compliance(current="current", levels=2, schedule_filter="rise-fall-delay", max_iterations=15)
    found = lpv.identify(training, structure, held_out=held_out)
    assert found.held_out is not None
    esr = found.held_out.overall.free_run.esr
    assert esr is not None and esr < 0.002


# -- files and refusals ------------------------------------------------------------------------------------------------
def test_a_file_holds_all_of_it(rng: np.random.Generator, tmp_path: Path) -> None:
    model = random_model(rng)
    again = lpv.load(lpv.save(model, tmp_path / "compliance.json"))
    assert lpv.model_hash(again) == lpv.model_hash(model)
    record = driven(rng)
    np.testing.assert_array_equal(lpv.simulate(again, record).output, lpv.simulate(model, record).output)
    assert len(model.parameter_names) == model.vector.size
    np.testing.assert_allclose(model.with_vector(model.vector).elements[1].law, model.elements[1].law, rtol=1e-10)


def test_refusals(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="rise"):
        model_of(np.zeros(9))
    with pytest.raises(InputError, match="0 inside"):
        Compliance(knots=(-1.0, 0.5, 1.0))
    with pytest.raises(InputError, match="one or two"):
        Compliance(states=3)
    with pytest.raises(InputError, match="needs a current"):
        Compliance(schedule_filter="lag")
    with pytest.raises(InputError, match="hat functions"):
        replace(random_model(rng), current=Polynomial("current", degree=2))
    record = driven(rng)
    opposed = record.with_channel("force", -1000 * record["velocity"])
    with pytest.raises(InputError, match="opposite senses"):
        lpv.identify(opposed, Compliance())


@pytest.mark.parametrize(("stiffness", "named"), [(1e13, True), (2e5, False)])
def test_a_spring_that_the_data_do_not_show_is_named(stiffness: float, named: bool) -> None:
    """The deflection of the stiff one is 1e-10 m at 1 kN, the motion of a sample 1e-4 m; the soft one yields 5 mm."""
    rng = np.random.default_rng(8)
    record = driven(rng, 2500)
    truth = model_of(smooth_law(np.array(KNOTS)), stiffness=stiffness)
    force = lpv.simulate(truth, record, "zero").output[:, 0] + 5.0 * rng.normal(size=2500)
    run = lpv.Record({"velocity": record["velocity"], "force": force}, sample_time=PERIOD,
                     units={"velocity": "m/s", "force": "N"})
    found = lpv.identify(run, Compliance(current=None, knots=KNOTS))
    assert any("not identifiable: the stiffness k_h" in n for n in found.notes) is named
