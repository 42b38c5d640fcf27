"""The lag of the current and the force map: against closed forms, scipy's integrator and scipy's interpolation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import RegularGridInterpolator

from lpvid import InputError, Record
from quartercar.dampers.drive import Drive
from quartercar.dampers.facts import Facts
from quartercar.dampers.laws.current_lag import CurrentLag
from quartercar.dampers.laws.force_map import ForceMap

H = 1e-3
FULL = {"rise_time_compression": 0.010, "rise_delay_compression": 0.0043, "fall_time_compression": 0.020,
        "fall_delay_compression": 0.0021, "rise_time_rebound": 0.030, "rise_delay_rebound": 0.0067,
        "fall_time_rebound": 0.015, "fall_delay_rebound": 0.00913}


def lag_vector(lag: CurrentLag) -> np.ndarray:
    return np.array([FULL[p.name] for p in lag.parameters])


def ramp_response(t: np.ndarray, length: float, time: float) -> np.ndarray:
    """Closed form: first-order lag behind a ramp from 0 to 1 of a given length, from t = 0."""
    def ramp(s: np.ndarray) -> np.ndarray:
        s = np.maximum(s, 0.0)
        return (s - time * (1 - np.exp(-s / time))) / length
    return ramp(t) - ramp(t - length)


@pytest.mark.thinned(4, "seconds")
@pytest.mark.parametrize("direction", ["compression", "rebound"])
@pytest.mark.parametrize("edge", ["rise", "fall"])
def test_each_edge_and_direction_has_its_own_delay_and_time_constant(direction: str, edge: str) -> None:
    lag = CurrentLag("full")
    step = np.r_[np.zeros(10), np.ones(190)]
    command = step if edge == "rise" else 1 - step
    v = np.full(200, 0.15 if direction == "rebound" else -0.15)
    found = lag.follow(command, v, H, lag_vector(lag))
    t = H * np.arange(200) - 9 * H - FULL[f"{edge}_delay_{direction}"]
    expected = ramp_response(t, H, FULL[f"{edge}_time_{direction}"])
    assert np.abs(found - (expected if edge == "rise" else 1 - expected)).max() < 1e-12


@pytest.mark.seconds
@pytest.mark.parametrize("sharing", ["shared", "edges", "full"])
def test_its_derivatives_are_those_of_complex_steps(sharing: str) -> None:
    """Carried along one run; through kinks of the command within a sub-step, and where it rests."""
    lag, rng = CurrentLag(sharing), np.random.default_rng(5)
    vector = np.array([FULL.get(p.name, p.default) for p in lag.parameters])
    command = np.repeat(rng.uniform(0.0, 2.0, 40), 25)
    command[500:] += 0.02 * rng.normal(size=500)
    v = 0.1 * np.sin(0.02 * np.arange(1000))
    found = lag.sensitivity(command, v, 2 * H, vector)
    for j in range(vector.size):
        moved = vector.astype(complex)
        moved[j] += 1e-30j
        expected = lag.follow(command, v, 2 * H, moved).imag / 1e-30
        assert np.abs(found[:, j] - expected).max() <= 1e-11 * np.abs(expected).max()


@pytest.mark.parametrize(("rise", "fall"), [(0.003, 0.009), (0.009, 0.003)])
def test_a_pulse_is_delayed_by_each_edges_own_delay(rise: float, fall: float) -> None:
    lag, n = CurrentLag("edges"), 300
    command = np.zeros(n)
    command[50:150] = 1.0
    found = lag.follow(command, np.zeros(n), H, np.array([0.004, rise, 0.006, fall]))
    t = H * np.arange(n)
    up = ramp_response(t - 49 * H - rise, H, 0.004)
    down = ramp_response(t - 149 * H - fall, H, 0.006)
    assert np.abs(found - (up - down)).max() < 1e-9


def test_a_moving_command_against_a_tight_integration() -> None:
    """Linear between samples, τ = 3.7 samples, direction changing smoothly; scipy has the same interpolated command."""
    lag = CurrentLag("shared", width=0.05)
    n, (time, delay) = 400, (0.013, 0.0037)
    t = H * np.arange(n)
    u = 0.3 + 0.2 * np.sin(40 * t)
    found = lag.follow(u, 0.1 * np.cos(15 * t), H, np.array([time, delay]))
    exact = solve_ivp(lambda s, y: (np.interp(s - delay, t, u) - y) / time, (0, t[-1]), u[:1], "LSODA", t, rtol=1e-10,
                      atol=1e-12, max_step=2e-4)
    assert np.abs(found - exact.y[0]).max() < 1e-7


@pytest.mark.seconds
def test_derivatives_in_times_and_delays_are_exact() -> None:
    lag, rng = CurrentLag("full"), np.random.default_rng(0)
    u = np.repeat(rng.uniform(0, 1, 40), 50)
    v = 0.1 * np.sin(6.3 * H * np.arange(u.size))
    theta = lag_vector(lag)
    for j in range(8):
        moved, step = theta.astype(complex), np.zeros(8)
        moved[j] += 1e-30j
        step[j] = 1e-8
        exact = np.imag(lag.follow(u, v, H, moved)) / 1e-30
        differences = (lag.follow(u, v, H, theta + step) - lag.follow(u, v, H, theta - step)) / 2e-8
        assert np.abs(exact - differences).max() < 1e-6 * np.abs(differences).max()


def test_the_followed_current_never_leaves_the_range_of_the_command() -> None:
    lag, rng = CurrentLag("full"), np.random.default_rng(3)
    u = rng.uniform(0, 1, 3000)
    found = lag.follow(u, rng.normal(size=u.size), H, lag_vector(lag))
    assert u.min() <= found.min() and found.max() <= u.max()


def make_map(**changes: object) -> ForceMap:
    """Three nodes, seven knots, entries at random."""
    rng, base = np.random.default_rng(1), ForceMap(nodes=(0.0, 0.5, 2.0), **changes)  # type: ignore[arg-type]
    values = {n: float(rng.normal(0, 500)) for n in base.names if n.startswith("force")}
    return base.with_values(**values, gas_preload=-180.0, **({"gas_stiffness": 2100.0} if base.spring else {}))


def test_table_against_scipys_bilinear_interpolation() -> None:
    damper, rng = make_map(lag="none"), np.random.default_rng(2)
    inside = RegularGridInterpolator((damper.nodes, damper.knots), damper.table(damper.vector))
    v, u, x = rng.uniform(-0.5, 0.5, 500), rng.uniform(0, 2, 500), rng.uniform(-0.05, 0.05, 500)
    expected = inside(np.column_stack([u, v])) + 2100.0 * x - 180.0
    assert np.allclose(damper.response(Drive(H, v, x, u), damper.vector), expected, atol=1e-9)


def test_beyond_the_ends_the_slope_in_velocity_and_the_value_in_current_are_kept() -> None:
    damper = make_map(lag="none")
    ends = damper.static_force(np.array([0.2, 0.5, 0.9]), current=2.0)
    assert (ends[2] - ends[1]) / 0.4 == pytest.approx((ends[1] - ends[0]) / 0.3)
    v = np.linspace(-1, 1, 9)
    assert np.array_equal(damper.static_force(v, current=5.0), damper.static_force(v, current=2.0))
    assert np.array_equal(damper.static_force(v, current=-1.0), damper.static_force(v, current=0.0))


def test_at_rest_only_the_gas_spring_is_left() -> None:
    damper = make_map()
    for u in (0.0, 0.7, 2.0):
        assert damper.static_force(np.zeros(1), u, 0.02)[0] == pytest.approx(2100 * 0.02 - 180)
    assert damper.conservative_force(np.array([0.02]))[0] == pytest.approx(2100 * 0.02 - 180)


def test_without_current_and_without_displacement() -> None:
    damper = ForceMap(spring=False)
    assert damper.reads == ("velocity",)
    assert damper.linear == damper.names and "gas_preload" in damper.names and "gas_stiffness" not in damper.names
    v = np.linspace(-0.4, 0.4, 9)
    table = dict(zip(damper.knots, damper.table(damper.vector)[0], strict=True))
    assert np.allclose(damper.static_force(v), np.interp(v, list(table), list(table.values())))
    channels: dict[str, Any] = {"velocity": v}
    record = Record(channels, sample_time=H, units={"velocity": "m/s"})
    assert np.allclose(damper.simulate(record).output[:, 0], damper.static_force(v))


@pytest.mark.parametrize(("settings", "message"), [
    ({"knots": (-0.1, 0.1)}, "velocity knots"), ({"knots": (0.0, 0.1)}, "velocity knots"),
    ({"knots": (-0.1, 0.0, 0.2, 0.1)}, "velocity knots"), ({"nodes": (0.5,)}, "current nodes"),
    ({"nodes": (0.5, 0.2)}, "current nodes"), ({"lag": "some", "nodes": (0.0, 1.0)}, "lag must be"),
    ({"switch_speed": 0.0, "nodes": (0.0, 1.0)}, "switch_speed")])
def test_settings_that_make_no_model_are_refused(settings: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        ForceMap(**settings)


def facts_of(current: np.ndarray, displacement: bool = True) -> Facts:
    t = H * np.arange(2000)
    channels: dict[str, Any] = {"velocity": 0.4 * np.cos(20 * t), "force": 300 * np.cos(20 * t), "current": current}
    if displacement:
        channels["displacement"] = 0.02 * np.sin(20 * t)
    units = {"velocity": "m/s", "force": "N", "current": "A", "displacement": "m"}
    return Facts.of([Record(channels, sample_time=H, units={k: u for k, u in units.items() if k in channels})])


def test_structure_follows_from_the_data() -> None:
    steps = ForceMap.suited(facts_of(np.repeat([0.0, 0.5, 1.0, 0.5], 500)))
    assert steps.nodes == (0.0, 0.5, 1.0) and steps.lag == "full" and steps.spring
    constant = ForceMap.suited(facts_of(np.full(2000, 0.5), displacement=False))
    assert constant.nodes == () and not constant.spring
    assert not constant.current_lag.parameters
    assert max(steps.knots) == pytest.approx(0.36)
    sweep = ForceMap.suited(facts_of(np.linspace(0.0, 2.0, 2000)))
    assert sweep.nodes == pytest.approx((0.0, 2 / 3, 4 / 3, 2.0))


def test_stepped_sample_by_sample_it_gives_the_same_force_and_looks_at_nothing_later() -> None:
    damper, rng = make_map(), np.random.default_rng(5)
    n = 1500
    x, v, u = 0.02 * rng.normal(size=n), 0.3 * np.sin(0.05 * np.arange(n)), np.repeat(rng.uniform(0, 2, 30), 50)
    whole = damper.response(Drive(H, v, x, u), damper.vector)
    stepper = damper.real_time(H)
    stepped = [stepper(*now) for now in zip(x.tolist(), v.tolist(), u.tolist(), strict=True)]
    assert np.allclose(stepped, whole, rtol=0, atol=1e-9)
    part = damper.response(Drive(H, v[:700], x[:700], u[:700]), damper.vector)
    assert np.array_equal(part, whole[:700])
    stepper.reset()
    assert stepper(x[0], v[0], u[0]) == stepped[0]


@pytest.mark.parametrize("damper", [ForceMap(nodes=(0.0, 1.0, 2.0)), ForceMap(nodes=(0.0, 2.0), spring=False),
                                    ForceMap()], ids=["three rows", "no spring", "no current"])
def test_columns_stand_where_they_are_asked_for(damper: ForceMap) -> None:
    """In any order, and without those that are not: the force is what the linear ones add up to."""
    rng = np.random.default_rng(3)
    drive = Drive(1 / 512, 0.4 * rng.standard_normal(300), 0.01 * rng.standard_normal(300), rng.uniform(-0.2, 2.5, 300))
    vector = damper.vector
    whole = damper.sensitivity(drive, vector, range(vector.size))
    for columns in ([], [0], rng.permutation(vector.size).tolist(), range(damper._affine, vector.size)):
        np.testing.assert_array_equal(damper.sensitivity(drive, vector, list(columns)), whole[:, list(columns)])
    affine = slice(None, damper._affine)
    np.testing.assert_allclose(whole[:, affine] @ vector[affine], damper.response(drive, vector), atol=1e-9)
