"""Relief-valve lag dampers: golden numbers, the curvature of the two models, stops, compressibility, integration."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lpvid import InputError, Record
from quartercar.dampers import FitSettings
from quartercar.dampers.bench.characteristic import characteristic_line
from quartercar.dampers.drive import Drive
from quartercar.dampers.families import complex_slope
from quartercar.dampers.fitting import fit
from quartercar.dampers.laws.relief_valve import LagDamper, ReliefValve, ReliefValveOrifice
from quartercar.dampers.laws.relief_valve_design import ReliefValveDesign, effective_compressibility

AMPLITUDES = np.geomspace(0.23e-3, 27.28e-3, 11)
OMEGA = 2 * np.pi * 3.5
KINDS = pytest.mark.parametrize("kind", [ReliefValve, ReliefValveOrifice])


def sine(amplitude: float, cycles: float = 1.3, rate: float = 2048.0) -> Drive:
    t = np.arange(int(cycles / 3.5 * rate)) / rate
    return Drive(1 / rate, amplitude * OMEGA * np.cos(OMEGA * t), amplitude * np.sin(OMEGA * t), 0 * t)


def test_golden_numbers_of_valve_and_ring() -> None:
    """C_D A of the valve 0.7·2e-6 m², of the ring 4·0.65·1e-6 m², ρ = 960: equation sheet 6.2."""
    design = ReliefValveDesign(holes=4, hole_area=1e-6, hole_discharge=0.65, density=960.0, discharge=0.7,
                               discharge_rise=1e9, seat_diameter=0.01, cone_half_angle=math.radians(15))
    lift = 2e-6 / (math.pi * 0.01 * math.sin(math.radians(15)))
    assert design.valve_flow(lift) == pytest.approx(6.390096504e-8, rel=1e-4)
    assert design.bypass_flow(lift) == pytest.approx(5.626295298e-8, rel=1e-4)
    assert design.valve_share(lift) == pytest.approx(0.775229, rel=1e-4)


def test_design_maps_to_the_force_domain() -> None:
    design = ReliefValveDesign(holes=4)
    damper = ReliefValveOrifice.from_design(design)
    assert damper.poppet_mass == pytest.approx(design.poppet_mass)
    assert damper.poppet_damping == pytest.approx(design.poppet_damping)
    assert damper.spring_rate == pytest.approx(design.spring_rate)
    assert damper.values["hydraulic_stiffness"] == pytest.approx(1.5e-3**2 / (4e-9 * 3.75e-5))
    with pytest.raises(InputError, match="holes behind"):
        ReliefValveOrifice.from_design(ReliefValveDesign())
    assert 1 / effective_compressibility(1e9, container=1e9, gas=1e5, gas_share=1e-4) == pytest.approx(1 / 3e-9)


@KINDS
def test_static_force_balances_flow_and_poppet(kind: type[LagDamper]) -> None:
    """In metres and pascals: A_P ẏ = Q_O + Q_V(x) at the lift where spring and pressure agree, by bisection."""
    design = ReliefValveDesign(holes=4 if kind is ReliefValveOrifice else 0)
    damper = kind.from_design(design).replace(smoothing=1e-6)
    for speed in (0.02, 0.1, 0.6):
        pressure = float(damper.static_force(np.array([speed]))[0]) / design.piston_area
        low, high = 0.0, 5e-3
        for _ in range(80):
            x = 0.5 * (low + high)
            rate = design.discharge_rise * x / (1 + design.discharge_rise * x)
            jet = 1 - 4 * design.discharge * rate * x / design.seat_diameter * math.sin(2 * design.cone_half_angle)
            push = pressure * design.seat_area * jet * (design.valve_share(x) if x > 0 else 1.0)
            low, high = (x, high) if push > design.spring_rate * (x + design.precompression) else (low, x)
        orifice = design.flow_coefficient(design.orifice_discharge * design.orifice_area)
        flow = (orifice + (design.bypass_flow(low) if low > 1e-12 else 0.0)) * math.sqrt(pressure)
        assert flow == pytest.approx(design.piston_area * speed, rel=2e-6)


def test_concave_turns_convex_in_the_curve_and_in_the_simulated_line() -> None:
    v = np.linspace(0.12, 0.6, 60)
    concave, convex = (np.diff(k().static_force(v), 2) for k in (ReliefValve, ReliefValveOrifice))
    assert (concave < 0).all() and (convex > 0).all()
    amplitudes = np.linspace(0.15, 0.6, 6) / OMEGA
    lines = [characteristic_line(k(), amplitudes, 3.5) for k in (ReliefValve, ReliefValveOrifice)]
    assert np.diff(lines[0].extending, 2).mean() < 0 < np.diff(lines[1].extending, 2).min()
    assert (lines[1].highest >= lines[1].extending).all()


def test_far_past_the_valve_only_the_holes_and_the_orifice_are_left() -> None:
    damper = ReliefValveOrifice(values={"valve_loss": 1e-3, "friction": 0.0}, cone_half_angle=1e-6)
    a, b = damper.values["orifice_loss"], damper.values["series_loss"]
    force = damper.static_force(np.array([20.0]))[0]
    assert force == pytest.approx(400 / (a**-0.5 + b**-0.5) ** 2, rel=1e-3)


def test_loop_area_over_velocity_grows_with_frequency() -> None:
    damper = ReliefValveOrifice()
    areas = [characteristic_line(damper, [0.03 / (2 * np.pi * f)], f).lag_area[0] for f in (1.0, 3.0, 9.0)]
    assert areas[0] < areas[1] < areas[2]


@pytest.mark.seconds
@pytest.mark.thinned(2)
@KINDS
def test_series_of_amplitudes_against_radau(kind: type[LagDamper]) -> None:
    damper = kind()
    for amplitude in AMPLITUDES[::2]:
        drive = sine(amplitude, 0.6)

        def rates(t: float, z: np.ndarray, x: float = amplitude) -> np.ndarray:
            return damper.rates(z, x * math.sin(OMEGA * t), x * OMEGA * math.cos(OMEGA * t), 0.0)

        start = damper.rest(0.0, amplitude * OMEGA, 0.0, None, damper.vector)
        run = solve_ivp(rates, (0.0, drive.times[-1]), start, "Radau", drive.times, rtol=1e-6,
                        atol=[1e-10, 1e-7, 1e-10, 1e-7, 1.0], max_step=0.01)
        exact = [damper.output(z, 0.0, v, 0.0) for z, v in zip(run.y.T, drive.velocity, strict=True)]
        error = damper.response(drive, damper.vector) - exact
        assert np.sum(error**2) / np.sum((exact - np.mean(exact)) ** 2) < 1e-5
        assert np.minimum(run.y[0], run.y[2]).max() < 1e-6  # one valve at a time


def test_a_lift_stop_makes_the_orifices_fixed() -> None:
    damper = ReliefValve(lift_stop=0.5e-3, values={"friction": 0.0})
    force = damper.static_force(np.array([0.5, 1.0]))
    assert force[1] / force[0] == pytest.approx(4.0, rel=1e-4)


def test_moving_volumes_stiffen_towards_the_ends_and_must_hold_the_stroke() -> None:
    damper = ReliefValve(chamber_lengths=(0.05, 0.05))
    assert damper.reads == ("velocity", "displacement")
    held = damper.rates(np.zeros(5), 0.04, 0.1, 0.0)[4] / damper.rates(np.zeros(5), 0.0, 0.1, 0.0)[4]
    assert held == pytest.approx(1 / (1 - 0.8**2))
    with pytest.raises(InputError, match="leaves the chambers"):
        damper.response(sine(0.06), damper.vector)
    with pytest.raises(InputError, match="two lengths"):
        ReliefValve(chamber_lengths=(0.05,))  # type: ignore[arg-type]


@pytest.mark.seconds
@KINDS
@pytest.mark.parametrize("measured", [None, -900.0])
def test_sensitivities_of_what_acts_beside_the_oil(kind: type[LagDamper], measured: float | None, monkeypatch) -> None:
    """Friction and preload need one run at most, for the force that the oil starts with; by the complex step all."""
    design = ReliefValveDesign(holes=4 if kind is ReliefValveOrifice else 0)
    damper, drive = kind.from_design(design, friction=40.0, preload=25.0), sine(0.02)
    if measured is not None:
        drive = replace(drive, force=np.full(drive.n_samples, measured))
    vector = np.array(damper.vector)
    expected = np.stack([complex_slope(lambda x: damper.response(drive, x), vector, j) for j in range(vector.size)], 1)
    assert np.abs(expected[:5, 7] - 1).max() > (0.01 if measured is not None else -1)
    runs, response = [], kind.response
    monkeypatch.setattr(kind, "response", lambda *args: runs.append(1) or response(*args))
    found = damper.sensitivity(drive, vector, range(vector.size))
    assert len(runs) == vector.size - (2 if measured is None else 1)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_allclose(damper.sensitivity(drive, vector, [7, 2, 6]), expected[:, [7, 2, 6]], rtol=1e-12,
                               atol=1e-12)


@pytest.mark.seconds
@KINDS
def test_first_order_arithmetic_is_the_derivative(kind: type[LagDamper]) -> None:
    """Against central differences of real runs, whose steps' grid is the same at a change of 1e-7."""
    design = ReliefValveDesign(holes=4 if kind is ReliefValveOrifice else 0)
    damper, drive = kind.from_design(design), sine(0.01)
    vector = np.array(damper.vector)
    slopes = damper.sensitivity(drive, vector, range(vector.size))
    for j in (1, 2, 3):  # orifice, opening force, valve
        step = np.zeros(vector.size)
        step[j] = 1e-7 * vector[j]
        differences = (damper.response(drive, vector + step) - damper.response(drive, vector - step)) / (2 * step[j])
        assert np.median(np.abs(slopes[:, j] - differences)) < 1e-5 * np.abs(slopes[:, j]).max()


@pytest.mark.slow
def test_parameters_are_recovered_from_the_series_of_amplitudes(rng: np.random.Generator) -> None:
    true = ReliefValveOrifice(values={"friction": 80.0, "hydraulic_stiffness": 1.2e7, "valve_loss": 3000.0})
    records = []
    for amplitude in AMPLITUDES:
        drive = sine(amplitude, 2.0, 512.0)
        force = true.response(drive, true.vector)
        records.append(Record({"velocity": drive.velocity, "force": force + 0.01 * force.std() * rng.normal(
            size=force.size)}, sample_time=drive.sample_time, units={"velocity": "m/s", "force": "N"}))
    settings = FitSettings(starts=3, polished=1, short_evaluations=6, evaluations=40, tolerance=1e-6)
    found = fit(ReliefValveOrifice(), records, settings=settings)
    assert found.covariance is not None and not found.undetermined
    assert np.abs((found.damper.vector - true.vector) / np.sqrt(np.diag(found.covariance))).max() < 4.5
    assert found.training.esr is not None and found.training.esr < 1.3e-4
