"""Hydraulic networks: golden numbers of source 003, inverses, gradients, limits, recovery."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from lpvid.errors import InputError
from lpvid.record import Record
from quartercar.dampers.facts import Facts
from quartercar.dampers.fitting import fit
from quartercar.dampers.laws.hydraulics import (
    Laminar,
    Parallel,
    Series,
    Turbulent,
    mixed_flow,
    mixed_pressure,
    parallel_flow,
    parallel_pressure,
    series_flow,
    series_pressure,
)
from quartercar.dampers.laws.network import (
    MixedNetwork,
    NetworkDamper,
    ParallelNetwork,
    SeriesNetwork,
    network_force,
    network_gradient,
)

MODELS = [SeriesNetwork, ParallelNetwork, MixedNetwork]
TRUTH = {"orifice_mobility": 1.5e8**-0.5, "leak_mobility": 1.5e-6, "laminar_damping": 1.2e5, "quadratic_damping": 1.5e8,
         "friction": 15.0, "offset": -4.0}


def printed_parallel(Q: float, a: float, b: float) -> float:
    """(6) as the source prints it."""
    return (b**2 + 2 * a * Q - np.sqrt(b**4 + 4 * a * b**2 * Q)) / (2 * a**2)


# -- pressure domain, golden numbers of equations.md 6.3 -------------------------------------------------------------
def test_golden_pressures() -> None:
    assert parallel_pressure(2.0, 1.3, 0.7) == pytest.approx(1.0, abs=1e-15)
    # printed 0.0271771248; ((√9.4 − 3)/0.4)² = 0.02717712433: the sheet's last digit is off
    assert parallel_pressure(0.5, 0.2, 3.0) == pytest.approx(0.0271771248, abs=5e-10)
    assert parallel_pressure(0.5, 0.2, 3.0) == pytest.approx(((9.4**0.5 - 3) / 0.4) ** 2, rel=1e-13)
    assert parallel_pressure(1e-12, 1.3, 0.7) == pytest.approx(2.0408163e-24, rel=1e-7)


def test_the_printed_inverse_loses_all_digits_at_small_flow() -> None:
    assert printed_parallel(2.0, 1.3, 0.7) == pytest.approx(parallel_pressure(2.0, 1.3, 0.7), rel=1e-14)
    for flow in (1e-9, 1e-12):
        exact = (flow / 0.7) ** 2  # to first order; the next term is 1e-9 of it
        assert parallel_pressure(flow, 1.3, 0.7) == pytest.approx(exact, rel=1e-8)
        assert abs(printed_parallel(flow, 1.3, 0.7) / exact - 1) > 0.5


def test_golden_slopes() -> None:
    q = np.array([1e-3, 1e-2, 0.1, 1.0, 10.0])
    series = np.diff(np.log(series_pressure(q, 1.0, 1.0))) / np.diff(np.log(q))
    parallel = np.diff(np.log(parallel_pressure(q, 1.0, 1.0))) / np.diff(np.log(q))
    assert np.allclose(series, [1.0039, 1.0371, 1.2596, 1.7404], atol=5e-5)
    assert np.allclose(parallel, [1.9923, 1.9324, 1.6582, 1.2812], atol=5e-5)


@given(st.floats(-14, 4), st.floats(-6, 6), st.floats(-6, 6), st.floats(-6, 6), st.sampled_from([-1.0, 1.0]))
def test_pressure_and_flow_invert_each_other(q: float, low: float, high: float, leak: float, sign: float) -> None:
    flow, a, b, c = sign * 10**q, 10**low, 10**high, 10**leak
    assert series_flow(series_pressure(flow, a, b), a, b) == pytest.approx(flow, rel=1e-13)
    assert parallel_flow(parallel_pressure(flow, a, b), a, b) == pytest.approx(flow, rel=1e-13)
    assert mixed_flow(mixed_pressure(flow, a, b, c), a, b, c) == pytest.approx(flow, rel=1e-13)


def test_mixed_pressure_against_a_root_search() -> None:
    for flow in (1e-3, 0.3, 20.0):
        root = brentq(lambda p, q=flow: float(mixed_flow(p, 0.8, 2.5, 0.3)) - q, 0.0, 1e4, xtol=1e-15)
        assert mixed_pressure(flow, 0.8, 2.5, 0.3) == pytest.approx(root, rel=1e-12)


def test_limits_are_inside() -> None:
    q = np.array([-3.0, -1e-6, 0.0, 1e-9, 0.5, 40.0])
    assert np.array_equal(mixed_pressure(q, 0.8, 2.5, 0.0), series_pressure(q, 0.8, 2.5))
    assert np.allclose(mixed_pressure(q, 0.0, 2.5, 0.3), parallel_pressure(q, 0.3, 2.5**-0.5), rtol=1e-14, atol=0)
    assert np.allclose(parallel_pressure(q, 0.5, 0.0), q / 0.5)
    assert np.allclose(series_flow(q, 2.0, 0.0), q / 2.0)


# -- arbitrary compositions ------------------------------------------------------------------------------------------
def test_compositions_agree_with_the_closed_forms() -> None:
    q = np.array([-2.0, 0.0, 1e-12, 1e-3, 0.4, 30.0])
    series, orifice = Series(Laminar(0.8), Turbulent(2.5)), Turbulent(2.5)
    assert np.allclose(series.flow(series_pressure(q, 0.8, 2.5)), q, rtol=1e-13, atol=0)
    assert np.allclose(Parallel(Laminar(1 / 0.3), orifice).pressure(q), parallel_pressure(q, 0.3, 2.5**-0.5),
                       rtol=1e-13, atol=0)
    assert np.allclose(Parallel(series, Laminar(1 / 0.3)).pressure(q), mixed_pressure(q, 0.8, 2.5, 0.3), rtol=1e-12,
                       atol=0)


def test_conductances_add_in_parallel_and_resistances_in_series() -> None:
    """E3.1: the source adds the resistances of parallel branches."""
    assert float(Parallel(Laminar(2.0), Laminar(3.0), Laminar(6.0)).pressure(1.0)) == pytest.approx(1.0, rel=1e-14)
    assert float(Series(Laminar(2.0), Laminar(3.0)).flow(1.0)) == pytest.approx(0.2, rel=1e-14)
    # E3.2: two equal orifices side by side pass twice the flow: b doubles, C_Q falls to a quarter
    assert float(Parallel(Turbulent(4.0), Turbulent(4.0)).pressure(1.0)) == pytest.approx(1.0, rel=1e-14)


@pytest.mark.seconds
def test_a_nested_composition_balances_at_every_node() -> None:
    bleed, valve, seat = Laminar(5.0), Turbulent(0.7), Series(Turbulent(0.1), Laminar(0.2))
    net = Series(Parallel(bleed, Series(valve, seat)), Turbulent(0.05))
    p = net.pressure(1.7)
    over = p - Turbulent(0.05).pressure(1.7)
    assert float(bleed.flow(over) + Series(valve, seat).flow(over)) == pytest.approx(1.7, rel=1e-12)
    assert float(net.flow(p)) == pytest.approx(1.7, rel=1e-12)
    with pytest.raises(InputError, match="at least one path"):
        Series()
    with pytest.raises(InputError, match="must be positive"):
        Laminar(0.0)


# -- dampers ---------------------------------------------------------------------------------------------------------
def build(kind: type[NetworkDamper], asymmetric: bool = False) -> NetworkDamper:
    bare = kind(asymmetric=asymmetric, smoothing=1e-6)
    return bare.with_values(**{n: next(v for k, v in TRUTH.items() if n.startswith(k)) * (1.4 if "compr" in n else 1.0)
                               for n in bare.names})


def test_the_force_domain_is_the_pressure_domain_scaled_by_the_piston() -> None:
    area, v = 1.3e-3, np.geomspace(1e-5, 1.0, 30)
    low, high, leak = 2e9, 4e14, 3e-11
    force = network_force(v, area**2 * low, area**3 * high, leak / area**2)
    assert np.allclose(force, area * mixed_pressure(area * v, low, high, leak), rtol=1e-13)


def test_gradient_of_the_network_against_the_complex_step() -> None:
    v, theta = np.array([0.0, 1e-5, 1e-3, 0.2]), np.array([1.2e5, 1.5e8, 1.5e-6])
    g = network_gradient(v, *theta)
    for k in range(3):
        moved = theta.astype(complex)
        moved[k] *= 1 + 1e-30j
        assert np.allclose(g[:, k], np.imag(network_force(v, *moved)) / (1e-30 * theta[k]), rtol=1e-12)
    assert np.allclose(g[1:, 3], np.imag(network_force(v * (1 + 1e-30j), *theta))[1:] / (1e-30 * v[1:]), rtol=1e-12)


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("asymmetric", [False, True])
def test_gradient_of_the_law(kind: type[NetworkDamper], asymmetric: bool) -> None:
    m = build(kind, asymmetric)
    v = np.array([-2e-3, -1e-4, -1e-6, 0.0, 1e-6, 3e-4, 1.5e-3])
    z = np.zeros(v.size)
    g = m.law_gradient(z, v, z, m.vector)
    for k, name in enumerate(m.names):
        h = 1e-5 * max(abs(m.vector[k]), 1.0 if name in ("friction", "offset") else 0.0)
        up, down = m.vector, m.vector
        up[k] += h
        down[k] -= h
        difference = (m.law(z, v, z, up) - m.law(z, v, z, down)) / (2 * h)
        assert np.allclose(g[:, k], difference, rtol=1e-6, atol=1e-8 * np.abs(g[:, k]).max())


def test_nested_networks_are_the_same_damper() -> None:
    v = np.linspace(-2e-3, 2e-3, 41)
    mixed = build(MixedNetwork)
    assert np.array_equal(mixed.with_values(leak_mobility=0.0).force(0, v), build(SeriesNetwork).force(0, v))
    parallel = build(ParallelNetwork)
    assert np.allclose(mixed.with_values(laminar_damping=0.0).force(0, v), parallel.force(0, v), rtol=1e-13)
    leak = parallel.with_values(orifice_mobility=0.0, friction=0.0, offset=0.0)
    assert np.allclose(leak.force(0, v), v / 1.5e-6, rtol=1e-13)
    orifice = parallel.with_values(leak_mobility=0.0, friction=0.0, offset=0.0)
    assert np.allclose(orifice.force(0, v), 1.5e8 * v * np.abs(v), rtol=1e-13)
    z = np.zeros(v.size)
    assert np.all(np.isfinite(leak.law_gradient(z, v, z, leak.vector)))


@pytest.mark.parametrize("kind", MODELS)
def test_odd_but_for_the_offset_monotone_and_passive(kind: type[NetworkDamper]) -> None:
    m = build(kind).with_values(offset=0.0)
    v = np.linspace(-0.01, 0.01, 401)
    f = m.force(0, v)
    assert np.allclose(f, -f[::-1])
    assert np.all(np.diff(f) > 0)
    assert np.all(f * v >= 0)
    assert np.allclose(build(kind).conservative_force(np.zeros(3)), -4.0)


def test_work_of_a_sine_cycle_of_the_series_network() -> None:
    """W = π c_L ω X² + (8/3) c_Q ω² X³ + 4 F_c X, the closed forms of equations.md 9.1."""
    m = build(SeriesNetwork).with_values(offset=0.0)
    x, w = 1e-3, 2 * np.pi * 0.3
    closed = np.pi * 1.2e5 * w * x**2 + 8 / 3 * 1.5e8 * w**2 * x**3 + 4 * 15.0 * x
    assert m.energy_per_cycle(x, 0.3) == pytest.approx(closed, rel=1e-4)


def record(m: NetworkDamper, noise: float, rng: np.random.Generator) -> Record:
    t = np.arange(4000) / 200.0
    v = 2e-3 * np.sin(2 * np.pi * 0.31 * t) * (0.1 + 0.9 * t / t[-1])
    force = m.law(0 * v, v, 0 * v, m.vector)
    return Record({"velocity": v, "force": force + noise * force.std() * rng.standard_normal(v.size)},
                  sample_time=1 / 200.0, name="sweep")


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("asymmetric", [False, True])
def test_starts_are_near_the_truth(kind: type[NetworkDamper], asymmetric: bool, rng: np.random.Generator) -> None:
    m = build(kind, asymmetric)
    drive = m.drive(record(m, 0.0, rng), force=True)
    assert drive.force is not None
    first = m.starts([drive], 8, rng)
    assert len(first) == (8 if kind is not SeriesNetwork else 7)
    error = m.response(drive, first[0]) - drive.force
    assert error @ error < 0.02 * (drive.force @ drive.force)
    assert all(np.all(s >= [p.lower for p in m.parameters]) for s in first)


@pytest.mark.thinned(2, "slow", "seconds")
@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("asymmetric", [False, True])
def test_a_fit_recovers_the_network(kind: type[NetworkDamper], asymmetric: bool, rng: np.random.Generator) -> None:
    m = build(kind, asymmetric)
    r = record(m, 0.01, rng)
    found = fit(m.with_vector(np.array([p.default for p in m.parameters])), [r])
    std = np.array([found.std[n] for n in m.names], dtype=float)
    assert np.all(np.abs(found.damper.vector - m.vector) < 4.5 * std)
    v = np.linspace(-2e-3, 2e-3, 50)
    again = m.with_vector(found.damper.vector)
    assert np.abs(again.force(0, v) - m.force(0, v)).max() < 0.01 * np.abs(m.force(0, v)).max()


def test_structure_suited_to_data(rng: np.random.Generator) -> None:
    m = MixedNetwork.suited(Facts.of([record(build(SeriesNetwork), 0.0, rng)]))
    assert m.asymmetric and m.smoothing == pytest.approx(2e-5, rel=0.06)
    with pytest.raises(InputError, match="no LPV form"):
        m.to_lpv(0.01)
    with pytest.raises(InputError, match="physical bounds"):
        SeriesNetwork(values={"laminar_damping": -1.0})
    with pytest.raises(InputError, match="must be positive"):
        SeriesNetwork(smoothing=0.0)


def test_it_is_stored_with_its_settings() -> None:
    m = build(MixedNetwork, asymmetric=True)
    back = MixedNetwork.from_dict(m.to_dict())
    assert back.asymmetric and np.array_equal(back.vector, m.vector) and back.smoothing == m.smoothing
