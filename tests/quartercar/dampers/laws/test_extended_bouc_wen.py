"""The extended Bouc-Wen model against its printed equations, integrated tightly; its steps against Runge-Kutta's."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lpvid import InputError, Record
from quartercar.dampers.drive import Drive
from quartercar.dampers.facts import Facts
from quartercar.dampers.laws.extended_bouc_wen import DIRECTIONS, ExtendedBoucWen

H = 1e-3
A, W = 0.025, 2 * np.pi * 0.8
"""the sine of source 002, equation (12)"""
RK4_END = 2.785
"""end of Runge-Kutta 4's stability on the negative real axis"""


def sine(duration: float, step: float = H, current: float = 0.0) -> Drive:
    t = np.arange(round(duration / step)) * step
    return Drive(step, A * W * np.cos(W * t), A * np.sin(W * t), np.full(t.size, current))


def asymmetric(**changes: float) -> ExtendedBoucWen:
    """Two nodes, everything different, T and τ shared."""
    base, rng = ExtendedBoucWen(nodes=(0.1, 0.5), lag="shared", current_unit="1"), np.random.default_rng(4)
    moved = {p.name: float(np.clip(p.default * rng.uniform(0.7, 1.4), p.lower, p.upper)) for p in base.parameters}
    return base.with_values(**{**moved, "gas_preload": -200.0, **changes})


def uniform(sharpness: float, yield_force: float = 600.0) -> ExtendedBoucWen:
    """No current, both directions alike, no gas spring."""
    row = {"damping": 1000.0, "stiffness": 1000.0, "roll_off_damping": 14000.0, "yield_force": yield_force,
           "sharpness": sharpness, "unloading": 0.6}
    return ExtendedBoucWen(values={"gas_stiffness": 0.0, **{f"{n}_{d}": v for d in DIRECTIONS for n, v in row.items()}})


def printed(damper: ExtendedBoucWen, motion: Callable, scale: float = 1.0) -> tuple[Callable, Callable]:
    """Equations (1) to (5) as printed, with all seven parameters at a settled current, z measured in 1/scale.

    Returns (rates(t, state, u), force(t, state, u)); the tables are read from `values`, not from the model's code.
    """
    p, nodes = damper.values, damper.nodes
    names = ("damping", "stiffness", "roll_off_damping", "yield_force", "sharpness", "unloading")

    def of(direction: str, u: float) -> np.ndarray:
        rows = []
        for mark in [f"_{j + 1}" for j in range(len(nodes))] or [""]:
            c0, k0, c1, alpha, delta, share = (p[f"{n}_{direction}{mark}"] for n in names)
            beta, gamma = (1 - share) * delta, share * delta
            rows.append([c0, k0, c1, alpha / scale, beta / scale, gamma / scale, delta * scale])
        return np.array([np.interp(u, nodes, column) for column in np.array(rows).T]) if nodes else np.array(rows[0])

    def parts(t: float, state: np.ndarray, u: float) -> tuple:
        x, v = motion(t)
        y, z = state[:2]
        s = 0.5 * np.tanh(v / damper.switch_speed) + 0.5
        c0, k0, c1, alpha, beta, gamma, delta = s * of("rebound", u) + (1 - s) * of("compression", u)
        rate = (alpha * z + c0 * v + k0 * (x - y)) / (c0 + c1)
        slip = v - rate
        hysteretic = -gamma * abs(slip) * z * abs(z) - beta * slip * abs(z) ** 2 + delta * slip
        force = c0 * slip + k0 * (x - y) + alpha * z + p["gas_stiffness"] * x + p["gas_preload"]
        return np.array([rate, hysteretic]), force

    return lambda t, s, u: parts(t, s, u)[0], lambda t, s, u: parts(t, s, u)[1]


def motion_at(t: float) -> tuple[float, float]:
    return A * np.sin(W * t), A * W * np.cos(W * t)


def tight(damper: ExtendedBoucWen, drive: Drive, scale: float = 1.0) -> np.ndarray:
    """Force by Radau, rtol 1e-10, at the constant current of a drive."""
    rates, force = printed(damper, motion_at, scale)
    u = float(drive.current[0])
    start = damper.rest(drive.displacement[0], drive.velocity[0], u, None, damper.vector)[1:] * [1.0, scale]
    run = solve_ivp(rates, (0.0, drive.times[-1]), start, "Radau", drive.times, args=(u,), rtol=1e-10,
                    atol=1e-12 * max(scale, 1.0))
    assert run.success
    return np.array([force(t, s, u) for t, s in zip(run.t, run.y.T, strict=True)])


@pytest.mark.thinned(4)  # the next but one integrates as tightly, under a moving current
@pytest.mark.parametrize("current", [pytest.param(0.1, marks=pytest.mark.seconds), 0.23, 0.5, 0.9])
def test_response_against_the_printed_equations(current: float) -> None:
    damper, drive = asymmetric(), sine(1.6, current=current)
    exact = tight(damper, drive)
    assert np.abs(damper.response(drive, damper.vector) - exact).max() < 2e-4 * exact.std()


@pytest.mark.seconds
def test_the_scale_of_z_that_was_removed_leaves_the_force_unchanged() -> None:
    """z' = κz, δ' = κδ, γ' = γ/κ, β' = β/κ, α' = α/κ; sheet 7.1, n = 2."""
    damper, drive = asymmetric(), sine(0.8, current=0.3)
    one, other = tight(damper, drive), tight(damper, drive, scale=0.02)
    assert np.abs(one - other).max() < 1e-7 * one.std()


@pytest.mark.seconds
def test_a_moving_current_against_a_tight_integration() -> None:
    """Three states, the command delayed in closed form before it enters."""
    damper = asymmetric(time_constant=0.013, delay=0.0037)
    drive = sine(1.0, step=5e-4)

    def command(t: float | np.ndarray) -> float | np.ndarray:
        return 0.3 + 0.2 * np.sin(9 * np.maximum(t, 0.0))

    drive = Drive(drive.sample_time, drive.velocity, drive.displacement, np.asarray(command(drive.times)))
    rates, force = printed(damper, motion_at)

    def all_rates(t: float, s: np.ndarray) -> np.ndarray:
        return np.r_[rates(t, s, s[2]), (command(t - 0.0037) - s[2]) / 0.013]

    start = np.r_[damper.rest(0.0, A * W, 0.3, None, damper.vector)[1:], 0.3]
    run = solve_ivp(all_rates, (0, drive.times[-1]), start, "LSODA", drive.times, rtol=1e-9, atol=1e-11, max_step=1e-3)
    exact = np.array([force(t, s, s[2]) for t, s in zip(run.t, run.y.T, strict=True)])
    assert np.abs(damper.response(drive, damper.vector) - exact).max() < 2e-4 * exact.std()


def test_half_the_step_changes_the_force_by_less_than_a_thousandth_at_512_hz() -> None:
    damper = asymmetric()
    coarse = damper.response(sine(2.0, 1 / 512, 0.3), damper.vector)
    fine = damper.response(sine(2.0, 1 / 2048, 0.3), damper.vector)[::4]
    assert np.abs(coarse - fine[: coarse.size]).max() < 1e-3 * fine.std()


def test_a_run_starts_from_the_measured_force() -> None:
    damper, drive = asymmetric(), sine(0.05, current=0.3)
    for force in (-240.0, -120.0):
        begun = Drive(H, np.zeros(5), np.full(5, 0.01), np.full(5, 0.3), np.full(5, force))
        assert damper.response(begun, damper.vector)[0] == pytest.approx(force)
    far = Drive(H, drive.velocity, drive.displacement, drive.current, np.full(drive.n_samples, 1e6))
    assert damper.rest(0.0, far.velocity[0], 0.3, 1e6, damper.vector)[2] == 1.0


def test_static_force_is_where_a_long_slow_ramp_ends() -> None:
    """Without k_0, which a constant speed would load without end."""
    damper = asymmetric(**{f"stiffness_{d}_{j}": 0.0 for d in DIRECTIONS for j in (1, 2)})
    for v in (-0.2, -0.004, 0.002, 0.1):
        n = 4000
        drive = Drive(5e-3, np.full(n, v), v * 5e-3 * np.arange(n), np.full(n, 0.4))
        x = drive.displacement[-1]
        end = damper.response(drive, damper.vector)[-1] - damper.conservative_force(x)
        assert end == pytest.approx(damper.static_force(np.array([v]), 0.4)[0] + 200.0, rel=1e-6)


@pytest.mark.parametrize("lag", [pytest.param("shared", marks=pytest.mark.slow),
                                 pytest.param("full", marks=pytest.mark.seconds)])
def test_derivatives_against_the_complex_step(lag: str) -> None:
    """Im F(θ + i h e_j)/h of the plain run, current moving within and beyond the nodes, start at a measured force."""
    damper, moved = ExtendedBoucWen(nodes=(0.1, 0.3, 0.5), lag=lag), sine(0.8)
    current = np.random.default_rng(1).uniform(0.05, 0.55, 16).repeat(50)
    drive = Drive(H, moved.velocity, moved.displacement, current, np.full(800, -150.0))
    found, theta = damper.jacobian(drive, damper.vector), damper.vector.astype(complex)
    for j in range(theta.size):
        step = 1e-30j * (np.arange(theta.size) == j)
        exact = np.imag(damper.response(drive, theta + step)) / 1e-30
        assert np.abs(found[:, j] - exact).max() < 1e-10 * np.abs(exact).max(), damper.names[j]


@pytest.mark.seconds
def test_derivatives_only_of_rows_that_the_current_reaches() -> None:
    damper = ExtendedBoucWen(nodes=(0.0, 0.5, 1.0, 2.0))
    found = damper.jacobian(sine(0.3, current=0.7), damper.vector)
    touched = np.abs(found).max(axis=0) > 0
    names = np.array(damper.names)
    assert {n[-1] for n in names[touched] if n[-1].isdigit()} == {"2", "3"}
    step = 1e-4 * damper.vector[names == "damping_rebound_4"][0] * (names == "damping_rebound_4")
    drive = sine(0.3, current=0.7)
    assert np.array_equal(damper.response(drive, damper.vector + step), damper.response(drive, damper.vector))


# -- the fixed step of 1 ms ------------------------------------------------------------------------------------------
def runge_kutta(damper: ExtendedBoucWen, drive: Drive) -> np.ndarray | None:
    """Force by the classical Runge-Kutta method at the drive's step; None where it diverges."""
    rates, force = printed(damper, motion_at)
    s, h, out = damper.rest(0.0, drive.velocity[0], 0.0, None, damper.vector)[1:], drive.sample_time, []
    for t in drive.times:
        if not np.isfinite(s).all() or np.abs(s).max() > 1e6:
            return None
        out.append(force(t, s, 0.0))
        k1 = rates(t, s, 0.0)
        k2 = rates(t + h / 2, s + h / 2 * k1, 0.0)
        k3 = rates(t + h / 2, s + h / 2 * k2, 0.0)
        s = s + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(t + h, s + h * k3, 0.0))
    return np.array(out)


@pytest.mark.seconds
def test_runge_kutta_at_1_ms_diverges_beyond_its_limit_where_this_step_stays_accurate() -> None:
    """(αδ + k_0)/(c_0 + c_1) = 3200 s⁻¹ > 2785 s⁻¹, sheet 1.2.5; slip is kept small so that nothing else is fast."""
    damper, drive = uniform(3.2e4, yield_force=1500.0), sine(2.5)
    assert (1500.0 * 3.2e4 + 1000.0) / 15000.0 * H > RK4_END
    assert runge_kutta(damper, drive) is None
    exact, ours = tight(damper, drive), damper.response(drive, damper.vector)
    assert np.abs(ours - exact).max() < 4e-4 * exact.std()


@pytest.mark.seconds
def test_runge_kutta_also_fails_where_only_the_saturated_hysteresis_is_fast() -> None:
    """(αδ + k_0)/(c_0 + c_1) = 67 s⁻¹ says nothing of n δ |r| = 3460 s⁻¹."""
    damper, drive = uniform(1.5e4, yield_force=30.0), sine(1.0)
    exact, explicit = tight(damper, drive), runge_kutta(damper, drive)
    assert (30.0 * 1.5e4 + 1000.0) / 15000.0 < 100.0 < RK4_END / H < damper.fastest_rate(A * W)
    assert explicit is None or np.abs(explicit - exact).max() > 0.1 * exact.std()
    assert np.abs(damper.response(drive, damper.vector) - exact).max() < 2e-4 * exact.std()


@pytest.mark.seconds
def test_runge_kutta_serves_below_the_limit() -> None:
    damper, drive = uniform(9e3, yield_force=30.0), sine(1.0)
    assert damper.fastest_rate(A * W) * H < 0.8 * RK4_END
    explicit = runge_kutta(damper, drive)
    exact = tight(damper, drive)
    assert explicit is not None and np.abs(explicit - exact).max() < 1e-3 * exact.std()


@pytest.mark.thinned(4, "slow", "seconds")
@pytest.mark.parametrize(("sharpness", "explicit_error"), [(5e3, 1e-4), (2e4, 0.25), (8e4, None), (1e6, None)])
def test_the_figures_that_the_docstring_states(sharpness: float, explicit_error: float | None) -> None:
    damper, drive = uniform(sharpness), sine(1.3)
    exact, explicit = tight(damper, drive), runge_kutta(damper, drive)
    error = damper.response(drive, damper.vector) - exact
    assert np.abs(error).max() < 7e-4 * exact.std() and error.std() < 3e-5 * exact.std()
    if explicit_error is None:
        assert explicit is None
    else:
        assert explicit is not None
        assert 0.3 * explicit_error < np.abs(explicit - exact).max() / exact.std() < explicit_error


@pytest.mark.parametrize("z", [0.0, 0.9999, -0.9999])
def test_fastest_rate_is_no_less_than_the_eigenvalues(z: float) -> None:
    damper = uniform(2e4)
    rates, _ = printed(damper, lambda t: (0.0, 0.13))
    jacobian = np.empty((2, 2))
    for j, step in enumerate((1e-8, 1e-6)):
        e = np.eye(2)[j] * step
        above, below = (rates(0.0, np.array([0.0, z]) + sign * e, 0.0) for sign in (1, -1))
        jacobian[:, j] = (above - below) / (2 * step)
    fastest = np.abs(np.linalg.eigvals(jacobian)).max()
    bound = damper.fastest_rate(0.13)
    assert fastest <= 1.01 * bound
    assert z != 0.9999 or fastest == pytest.approx(bound, rel=0.02)


def test_stepped_sample_by_sample_it_is_the_same_run_and_allocates_nothing() -> None:
    damper, drive = asymmetric(), sine(1.5)
    u = np.where(np.arange(drive.n_samples) % 300 < 130, 0.5, 0.15)
    drive = Drive(H, drive.velocity, drive.displacement, u)
    whole = damper.response(drive, damper.vector)
    samples = list(zip(drive.displacement.tolist(), drive.velocity.tolist(), u.tolist(), strict=True))
    stepper = damper.real_time(step=H)
    assert np.allclose([stepper(*now) for now in samples], whole, rtol=0, atol=1e-9)
    assert np.array_equal(damper.response(drive.head(700), damper.vector), whole[:700])  # nothing looks ahead
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    tracemalloc.reset_peak()
    for now in samples:
        stepper(*now)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak - before < 8 * len(samples)  # not one number per call, whatever other threads of the process do


def test_structure_follows_from_the_data() -> None:
    t = H * np.arange(2000)
    channels = {"velocity": 0.4 * np.cos(20 * t), "force": 300 * np.cos(20 * t), "current": np.repeat([0.1, 0.5], 1000)}
    units = {"velocity": "m/s", "force": "N", "current": "A"}
    with pytest.raises(InputError, match="displacement"):
        ExtendedBoucWen.suited(Facts.of([Record(channels, sample_time=H, units=units)]))
    channels["displacement"] = 0.02 * np.sin(20 * t)
    found = ExtendedBoucWen.suited(Facts.of([Record(channels, sample_time=H, units={**units, "displacement": "m"})]))
    assert found.nodes == (0.1, 0.5) and found.lag == "full"
    with pytest.raises(InputError, match="exponent"):
        ExtendedBoucWen(exponent=0.5)


def test_a_series_damping_far_larger_at_one_node_leaves_that_of_the_next_node():
    """c_1 of 2e65 and 1e49 N·s/m at two nodes: their difference added to the first left 0, and c_0 + c_1 divides."""
    damper = ExtendedBoucWen(nodes=(0.0, 1.0), lag="none").with_values(**{
        f"{name}_{side}_{node}": value for side in ("compression", "rebound") for name, value in (
            ("damping", 0.0), ("stiffness", 1e5)) for node in (1, 2)}, **{
        f"roll_off_damping_{side}_{node}": value for side in ("compression", "rebound")
        for node, value in ((1, 2e65), (2, 1e49))})
    assert damper.mixture(0.1, 1.0, damper.vector)[2] == pytest.approx(1e49)
    t = np.arange(500) / 500
    run = Record({"displacement": 0.01 * np.sin(10 * t), "velocity": 0.1 * np.cos(10 * t),
                  "current": np.ones(t.size)}, sample_time=1 / 500,
                 units={"displacement": "m", "velocity": "m/s", "current": "A"})
    assert np.isfinite(damper.simulate(run).output).all()
