"""Fitting of damper models: certified values, closed forms, invariants, honest reports."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import numpy as np
import pytest
from helpers.monte_carlo import coverage
from helpers.toy_dampers import Misra, Redundant, Tanh, Wave, record, sweep
from scipy.optimize import lsq_linear

import quartercar
from lpvid import InputError, NumericalError, Record
from lpvid.least_squares import bounded_least_squares, bounded_step
from quartercar.dampers import DamperFit, FitSettings, Guo, Kwok, Linear, Parameter, fit
from quartercar.dampers.drive import Drive
from quartercar.dampers.evaluation.scoring import score
from quartercar.dampers.fitting.problem import DamperFitProblem, MovingFit, ProjectedFit
from quartercar.dampers.fitting.searching import estimate_law
from quartercar.dampers.fitting.solver import SearchCoordinates

MISRA = np.array([[77.6, 114.9, 141.1, 190.8, 239.9, 289.0, 332.8, 378.4, 434.8, 477.3, 536.8, 593.1, 689.1, 760.0],
                  [10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05, 61.01, 66.40, 75.47, 81.78]])
"""NIST StRD Misra1a, x and y."""


def _drive(velocity: np.ndarray, force: np.ndarray) -> Drive:
    return Drive(0.002, velocity, np.zeros(velocity.size), np.zeros(velocity.size), force)


def _tanh(noise: float, seed: int = 0, n: int = 3000, **fields) -> tuple[Tanh, Record]:
    true, v = Tanh(values={"height": 350.0, "sharpness": 12.0, "damping": 900.0}, **fields), sweep(n)
    force = true.response(_drive(v, v), true.vector)
    return true, record(v, force + noise * np.random.default_rng(seed).normal(size=n))


# -- the solver -----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("projected", [True, False])
def test_certified_values_and_standard_deviations(projected: bool) -> None:
    """NIST StRD Misra1a: certified to eleven digits, from the harder start b = (500, 1e-4)."""
    x, y = MISRA
    found = estimate_law(Misra(projected=projected), [_drive(x, y)], FitSettings())
    assert found.damper.vector == pytest.approx([2.3894212918e2, 5.5015643181e-4], rel=1e-7)
    assert found.covariance is not None
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx([2.7070075241, 7.2668688436e-6], rel=1e-5)
    residual = found.damper.response(_drive(x, y), found.damper.vector) - y
    assert residual @ residual == pytest.approx(1.2455138894e-1, rel=1e-8)


def test_bounded_least_squares_satisfies_its_optimality_conditions(rng: np.random.Generator) -> None:
    for _ in range(40):
        a, b = rng.normal(size=(30, 6)) * rng.uniform(1e-3, 1e3, 6), rng.normal(size=30) * 10
        free = np.linalg.lstsq(a, b, rcond=None)[0]
        low = np.where(rng.random(6) < 0.5, free + np.abs(free) * rng.uniform(-1, 0.7, 6), -np.inf)
        high = np.where(rng.random(6) < 0.5, np.maximum(low, free) + np.abs(free) * rng.uniform(0, 1, 6), np.inf)
        best = bounded_least_squares(a, b, low, high)
        gradient = a.T @ (a @ best - b) / np.linalg.norm(a, axis=0) / np.linalg.norm(b)
        inside = (best > low) & (best < high)
        assert (best >= low).all() and (best <= high).all()
        assert np.abs(gradient[inside]).max(initial=0) < 1e-9
        assert (gradient[best == low] > -1e-9).all() and (gradient[best == high] < 1e-9).all()
        assert np.sum((a @ best - b) ** 2) <= 2 * lsq_linear(a, b, (low, high), tol=1e-12).cost * (1 + 1e-6)


def test_a_column_without_effect_takes_the_value_nearest_zero() -> None:
    a = np.column_stack([np.ones(5), np.zeros(5)])
    assert bounded_least_squares(a, 3 * np.ones(5), np.array([-1.0, 2.0]), np.array([9.0, 8.0])).tolist() == [3.0, 2.0]


def test_a_step_without_bounds_is_levenberg_marquardts(rng: np.random.Generator) -> None:
    triangle, gradient, scale = np.triu(rng.normal(size=(4, 4))), rng.normal(size=4), rng.uniform(0.5, 2, 4)
    wide = np.full(4, np.inf)
    step = bounded_step(triangle, gradient, 0.3, scale, -wide, wide)
    normal = triangle.T @ triangle + 0.3 * np.diag(scale**2)
    assert step == pytest.approx(np.linalg.solve(normal, -triangle.T @ gradient), rel=1e-8)


def test_coordinates_there_and_back() -> None:
    place = SearchCoordinates(
        [Parameter("a", "", "a", 2.0, 1e-3, 1e3, log=True), Parameter("b", "", "b", 0.0, -5.0, 5.0)]
    )
    theta = np.array([7.0, -3.0])
    assert place.values(place.of(theta)) == pytest.approx(theta, rel=1e-15)
    assert place.values(np.array([place.upper[0], place.lower[1]])).tolist() == [1e3, -5.0]
    moved = place.of(theta) + np.array([1e-7, 1e-7])
    assert (place.values(moved) - theta) / 1e-7 == pytest.approx(place.slope(theta), rel=1e-5)


def test_the_projected_derivative_has_the_gradient_of_the_projected_cost() -> None:
    """Kaufman's derivative leaves a term out that is orthogonal to the residual: its gradient is exact."""
    _, given = _tanh(30.0)
    problem = DamperFitProblem(Tanh(), (Tanh().drive(given, force=True),))
    view, point = ProjectedFit(problem), np.array([np.log(4.0)])
    trial = view.trial(point)
    assert trial is not None
    ends = [view.trial(point + h) for h in (1e-5, -1e-5)]
    assert ends[0] is not None and ends[1] is not None
    slope = (ends[0].cost - ends[1].cost) / 2e-5
    assert 2 * view.jacobian(trial)[:, 0] @ trial.residual == pytest.approx(slope, rel=1e-6)
    least = lsq_linear(problem.jacobian(trial.theta)[:, [0, 2]], problem.measured).cost
    assert trial.cost == pytest.approx(2 * least, rel=1e-10)


def test_projection_and_the_full_search_agree() -> None:
    _, given = _tanh(30.0)
    found = fit(Tanh(), given)
    problem = DamperFitProblem(Tanh(), (Tanh().drive(given, force=True),))
    view = MovingFit(problem)
    gradient = view.jacobian(view.trial(view.start(found.damper.vector))).T  # type: ignore[arg-type]
    residual = problem.model(found.damper.vector) - problem.measured
    size = np.linalg.norm(gradient, axis=1) * np.linalg.norm(residual)
    assert np.abs(gradient @ residual / size).max() < 1e-6


def test_runs_that_diverge_count_as_bad_trials() -> None:
    true, given = _tanh(5.0, limit=40.0)
    found = fit(Tanh(limit=40.0, values={"sharpness": 30.0}), given, settings=FitSettings(starts=8))
    assert found.damper.vector == pytest.approx(true.vector, rel=0.01)
    with pytest.raises(NumericalError, match="diverges from each of"):
        fit(Tanh(limit=1e-3), given)


def test_many_starts_find_the_minimum_that_one_misses() -> None:
    v = sweep()
    given = record(v, 80 * np.sin(11 * v) + 2 * np.random.default_rng(0).normal(size=v.size))
    alone = fit(Wave(), given, settings=FitSettings(starts=1))
    many = fit(Wave(), given)
    assert alone.training.esr is not None and alone.training.esr > 0.3
    assert many.damper.vector == pytest.approx([80, 11], rel=0.01)
    starts = many.estimate.starts
    assert starts is not None and 1 <= starts.agreed < starts.searched <= 20
    assert f"{starts.agreed} of {starts.searched} starts agree" in repr(many)


@pytest.mark.seconds
def test_the_same_seed_gives_the_same_fit() -> None:
    _, given = _tanh(30.0)
    one, two = (fit(Tanh(), given, settings=FitSettings(seed=3)) for _ in range(2))
    assert np.array_equal(one.damper.vector, two.damper.vector)
    assert one.estimate.starts == two.estimate.starts
    assert one.estimate.starts is not None and one.estimate.starts.agreed >= 10


@pytest.mark.seconds
def test_forces_in_another_unit_scale_the_linear_parameters() -> None:
    _, given = _tanh(30.0)
    scaled = given.with_channel("force", 8.0 * given["force"], "N")
    one, two = fit(Tanh(), given), fit(Tanh(), scaled)
    assert two.damper.vector == pytest.approx(one.damper.vector * [8, 1, 8], rel=1e-6)
    assert np.array(list(two.std.values()), dtype=float) == pytest.approx(
        np.array(list(one.std.values()), dtype=float) * [8, 1, 8], rel=1e-4)
    assert two.training.esr == pytest.approx(one.training.esr, rel=1e-6)


# -- what is known of the parameters ----------------------------------------------------------------------------------
@pytest.mark.seconds
def test_standard_errors_of_white_residuals_cover() -> None:
    true, _ = _tanh(0.0)
    found = [fit(Tanh(), _tanh(40.0, seed, 800)[1], settings=FitSettings(starts=2)) for seed in range(60)]
    std = np.array([list(f.std.values()) for f in found], dtype=float)
    assert 0.90 <= coverage(np.array([f.damper.vector for f in found]), std, true.vector) <= 0.985


@pytest.mark.seconds
def test_standard_errors_of_coloured_residuals_cover() -> None:
    """AR(1) noise of pole 0.9: plain standard errors would be about four times too small for slow motion."""
    v, estimates, errors = np.sin(0.02 * np.arange(6000)), [], []
    rng, true = np.random.default_rng(4), Linear(spring=False, values={"damping": 800.0, "offset": -50.0})
    for _ in range(60):
        white = rng.normal(size=v.size)
        noise = np.zeros(v.size)
        for k in range(1, v.size):
            noise[k] = 0.9 * noise[k - 1] + white[k]
        found = fit(Linear(spring=False, values={"mass": 1.0}), record(v, 800 * v - 50 + 20 * noise))
        estimates.append(found.damper.vector[[0, 2]])
        errors.append([found.std["damping"], found.std["offset"]])
        assert any("sandwich" in n for n in found.notes)
    assert 0.87 <= coverage(np.array(estimates), np.array(errors), true.vector[[0, 2]]) <= 0.99


def test_a_parameter_at_its_bound_is_held_and_named() -> None:
    v = sweep()
    force = 700 * v - 3.0 * np.gradient(v, 0.002) + np.random.default_rng(0).normal(size=v.size)
    found = fit(Linear(spring=False), record(v, force))
    assert found.at_bounds == ("mass",) and found.damper.values["mass"] == 0.0
    assert found.std["mass"] is None and found.std["damping"] is not None
    assert found.damper.values["damping"] == pytest.approx(v @ (force - found.damper.values["offset"]) / (v @ v))


def test_what_the_data_leave_open_is_said() -> None:
    v = sweep()
    found = fit(Redundant(), record(v, 300 * v + np.random.default_rng(0).normal(size=v.size)))
    assert found.damper.vector[0] * found.damper.vector[1] == pytest.approx(300, rel=1e-3)
    assert any(s.startswith("idle: has no effect") for s in found.undetermined)
    together = [s for s in found.undetermined if "first" in s and "second" in s]
    assert len(together) == 1 and "+100 %" in together[0] and "-100 %" in together[0]
    assert len(found.undetermined) == 2
    assert found.estimate.condition == np.inf
    assert found.std["idle"] is None
    assert found.unidentified == ("first", "second", "idle")
    assert "first [N] not identifiable, second [s/m] not identifiable, idle [1] not identifiable" in repr(found)


def test_what_the_data_determine_is_not_doubted() -> None:
    assert fit(Tanh(), _tanh(30.0)[1]).undetermined == ()


def test_a_sharpness_that_the_motion_never_shows_is_open() -> None:
    """Far beyond the knee tanh is a sign: its sharpness cannot be known."""
    v = np.where(np.arange(2000) // 100 % 2 == 0, 1.0, -1.0) * np.random.default_rng(1).uniform(0.8, 1.0, 2000)
    noise = np.random.default_rng(2).normal(size=2000)
    found = fit(Tanh(), record(v, 350 * np.sign(v) + 900 * v + 10 * noise))
    assert any("sharpness" in s for s in found.undetermined)
    assert not any("damping" in s for s in found.undetermined)


def test_the_size_of_which_a_share_is_open_is_stated() -> None:
    """An offset near zero: per cent of the force's twentieth in newtons, not of a value of next to nothing."""
    rng = np.random.default_rng(3)
    t = np.arange(120) * 0.01
    x, v = 0.01 * np.sin(20 * t) + 0.04 * np.sin(6 * t), 0.2 * np.cos(20 * t) + 0.24 * np.cos(6 * t)
    force = 3000 * v + 30e3 * x + 4.0 + 400 * rng.normal(size=t.size)
    found = fit(Linear(), Record({"displacement": x, "velocity": v, "force": force}, 0.01,
                                 units={"displacement": "m", "velocity": "m/s", "force": "N"}))
    (said,) = (s for s in found.undetermined if s.startswith("offset: "))
    share, size = re.search(r"uncertain by (\d+) % of ([\d.]+) N, which moves the force by a twentieth", said).groups()
    assert float(share) / 100 * float(size) == pytest.approx(found.std["offset"], rel=0.03)
    names = [s for s in found.undetermined if " together is " in s]
    assert all(" % of " in s for s in names if "offset" in s)


# -- polarity, records, figures ---------------------------------------------------------------------------------------
def test_reversed_records_keep_the_parameters_and_say_so() -> None:
    _, given = _tanh(30.0)
    straight, turned = fit(Tanh(), given), fit(Tanh(), given.flip("force"))
    assert turned.damper.polarity == -1
    assert np.array_equal(turned.damper.vector, straight.damper.vector)
    assert "against the velocity" in turned.notes[0] and "--flip force" in turned.notes[0]
    assert any("reversed polarity" in f for f in turned.flags)
    assert turned.passivity.passive
    run = turned.damper.simulate(given.flip("force")).output[:, 0]
    assert np.array_equal(run, -straight.damper.simulate(given).output[:, 0])
    assert turned.training == straight.training and straight.flags == ()


def test_records_of_both_senses_are_refused_held_out_or_not() -> None:
    _, given = _tanh(30.0)
    with pytest.raises(InputError, match="disagree"):
        fit(Tanh(), [given, given.flip("force")])
    with pytest.raises(InputError, match="disagree"):
        fit(Tanh(), given, given.flip("force"))


def test_a_polarity_that_nothing_decides_is_assumed_and_noted() -> None:
    noise = np.random.default_rng(0).normal(size=(2, 500))
    assert any("do not decide" in n for n in fit(Linear(spring=False), record(noise[0], noise[1])).notes)


def test_gaps_cut_and_velocity_is_derived_with_a_note() -> None:
    t = 0.002 * np.arange(3000)
    x = 0.02 * np.sin(9 * t)
    force = 0.18 * 600 * np.cos(9 * t)
    force[1000:1010] = np.nan
    given = Record({"displacement": x, "force": force}, sample_time=0.002, units={"displacement": "m", "force": "N"})
    found = fit(Linear(), given)
    assert found.damper.values["damping"] == pytest.approx(600, rel=1e-3)
    assert found.n_samples == 2990
    assert any("velocity derived" in n for n in found.notes) and any("cut into 2 pieces" in n for n in found.notes)


@pytest.mark.seconds
def test_currents_are_remembered_and_those_outside_counted() -> None:
    v, rng = sweep(), np.random.default_rng(0)
    low, high = rng.uniform(0, 1, v.size), rng.uniform(0.5, 1.5, v.size)
    damper = Tanh(per_current=-0.5, current_unit="V")
    held = record(v, 900 * v * (1 + 0.5 * high), high)
    found = fit(damper, record(v, 900 * v * (1 + 0.5 * low) + rng.normal(size=v.size), low), held)
    assert found.damper.current_range == pytest.approx((0, 1), abs=1e-2) and found.damper.current_unit == "A"
    assert found.held_out_score is not None
    assert found.held_out_score.extrapolation_share == pytest.approx(np.mean(high > 1.01), abs=0.01)
    assert "outside the fitted range" in repr(found) and found.flags[0].startswith("extrapolation: ")
    assert fit(damper, record(v, 900 * v * (1 + 0.5 * low), low), record(v, 900 * v, low)).flags == ()


def test_energy_error_is_the_share_of_work_missed() -> None:
    v = sweep()
    damper = Linear(spring=False, values={"damping": 800.0})
    found = score(damper, [record(v, 1000.0 * v)])
    assert found.energy_error == pytest.approx(0.2)
    assert found.total.figures.esr == pytest.approx(0.04, rel=1e-3)
    assert found.total.sqrt_sse == pytest.approx(200 * np.linalg.norm(v))


@pytest.mark.seconds
def test_a_constant_that_the_printed_law_lacks_is_told() -> None:
    """Guo's force less 200 N: the law cannot follow, its residual keeps most of that; with the constant it does."""
    v, rng = sweep(), np.random.default_rng(5)
    force = 600 * np.tanh(20 * v) + 1500 * v + 10 * rng.normal(size=v.size)
    law = Guo(hysteresis=False)
    for sign in (1, -1):
        found = fit(law, record(v, sign * (force - 200)))
        described = [n for n in found.notes if "offset=True adds one" in n]
        assert len(described) == 1 and float(described[0].split("mean of ")[1].split()[0]) == pytest.approx(
            -200, rel=0.02
        )
    for given, data in ((law, force), (law.replace(offset=True), force - 200)):
        assert not any("offset=True" in n for n in fit(given, record(v, data)).notes)


@pytest.mark.seconds
def test_a_fit_that_is_not_passive_is_flagged() -> None:
    v = sweep()
    found = fit(Tanh(), record(v, 1500 * v - 600 * np.tanh(20 * v)))
    assert not found.passivity.passive
    assert any(f.startswith("not passive") for f in found.flags)


def test_it_prints_in_ten_lines_and_saves_as_json() -> None:
    _, given = _tanh(30.0)
    found = fit(Tanh(), given.flip("force").slice(0, 2000), given.flip("force").slice(2000, 3000))
    lines = repr(found).splitlines()
    assert len(lines) <= 10
    assert "training free-run" in lines[0] and "held-out free-run" in lines[1] and "N = 2000" in lines[0]
    data = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert data["schema"] == "quartercar/fit/1"
    assert data["held_out"]["free_run"]["n_samples"] == 1000
    assert data["damper"]["polarity"] == -1
    assert type(found.damper).from_dict(data["damper"]).vector == pytest.approx(found.damper.vector, rel=1e-15)
    assert isinstance(found, DamperFit) and quartercar.fit is fit


@pytest.mark.parametrize(("records", "description"), [
    ([], "no records"),
    (record(np.zeros(10), np.zeros(10)), "no record is long enough"),
    (Record({"velocity": np.ones(100)}, sample_time=0.01), "channel 'force'"),
])
def test_records_that_cannot_be_fitted_are_refused_in_one_line(records, description: str) -> None:
    with pytest.raises(InputError, match=description) as caught:
        fit(Tanh(), records)
    assert len(str(caught.value).splitlines()) == 1


def test_what_is_no_damper_and_values_that_are_no_mapping_are_refused() -> None:
    for wrong in ("guo", Tanh):
        with pytest.raises(InputError, match="fit takes a damper"):
            fit(wrong, [])  # type: ignore[arg-type]
    with pytest.raises(InputError, match="values are a mapping of names to numbers: got list"):
        Tanh(values=[1.0])  # type: ignore[arg-type]


def test_held_out_records_of_another_rate_are_refused_and_can_be_resampled() -> None:
    _, given = _tanh(30.0)
    slow = Record({n: c.values[::2] for n, c in given.channels.items()}, sample_time=0.004,  # type: ignore[arg-type]
                  units={n: c.unit for n, c in given.channels.items()})
    with pytest.raises(InputError, match="--sample-rate 250"):
        fit(Tanh(), given, slow)
    found = fit(Tanh(), given, slow, FitSettings(sample_rate=250.0))
    assert found.n_samples == 1500 and found.held_out is not None and found.held_out.n_samples == 1500


def test_settings_are_checked() -> None:
    for wrong in ({"starts": 0}, {"polished": 0}, {"tolerance": 0.0}, {"seed": -1}, {"evaluations": 1.5},
                  {"polarity": 2}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            FitSettings(**wrong)  # type: ignore[arg-type]


def test_the_package_stays_light() -> None:
    probe = ("import sys, quartercar; quartercar.dampers.Linear(); quartercar.rig; quartercar.roads; "
             "print([m for m in ('numba', 'scipy.optimize', 'scipy.signal', 'matplotlib') if m in sys.modules])")
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_law_without_its_displacement_names_the_part_that_reads_it(rng: np.random.Generator) -> None:
    velocity = rng.normal(size=900)
    record = Record({"velocity": velocity, "force": 900 * velocity}, 1 / 200, units={"velocity": "m/s", "force": "N"})
    with pytest.raises(InputError, match=r"no displacement, which its stiffness reads. Mend: Linear\(spring=False\)"):
        fit(Linear(), record)
    assert round(fit(Linear(spring=False), record).damper.values["damping"]) == 900
    with pytest.raises(InputError, match=r"Mend: Guo\(hysteresis=False\) is without"):
        fit(Guo(), record)
    with pytest.raises(InputError, match="Kwok reads the displacement, which record 'record' does not have"):
        fit(Kwok(), record)
