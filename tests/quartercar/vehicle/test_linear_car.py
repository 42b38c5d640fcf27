"""The linear quarter car against published and worked-out numbers, and against scipy and python-control."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from lpvid.errors import InputError, NumericalError
from quartercar.parameters import BENCH, DEMO, INOVE, MEGANE, MOTORCYCLE, SAVARESI, SETS, SH_ADD, CarParameters
from quartercar.vehicle.linear import OUTPUTS, RELATIVE, LinearCar

REFERENCE = LinearCar(MEGANE.replace(tyre_stiffness=208e3))
"""the car of synthesis.md, section 1"""


def test_modes_of_the_reference_car():
    (body, body_damping), (wheel, wheel_damping) = REFERENCE.modes()
    assert body == pytest.approx(1.4579, abs=5e-5) and body_damping == pytest.approx(0.2025, abs=5e-5)
    assert wheel == pytest.approx(12.5225, abs=5e-5) and wheel_damping == pytest.approx(0.2609, abs=5e-5)


def test_h2_norms_of_the_reference_car():
    norms = REFERENCE.h2_norms()
    assert norms["body_acceleration"] == pytest.approx(51.0168, rel=1e-5)
    assert norms["suspension_deflection"] == pytest.approx(0.342783, rel=1e-5)
    assert norms["tyre_deflection"] == pytest.approx(0.126520, rel=1e-5)


@pytest.mark.parametrize("name", [n for n, p in SETS.items() if not p.tyre_damping])
def test_closed_form_is_the_lyapunov_solution(name: str):
    car = LinearCar(SETS[name])
    closed, solved = car.h2_norms(), car.lyapunov_norms()
    assert set(closed) == set(solved) == set(RELATIVE)
    for output in RELATIVE:
        assert closed[output] == pytest.approx(solved[output], rel=1e-9)


@pytest.mark.thinned(2, "seconds")
@pytest.mark.parametrize("parameters", [MEGANE, BENCH])
def test_lyapunov_is_the_integral_of_the_response(parameters: CarParameters):
    # white velocity of two-sided intensity 1: norm² = 2 ∫_0^∞ |G(f)/(2πf)|² df
    car = LinearCar(parameters)
    f = np.geomspace(1e-4, 1e5, 200_000)
    for output in ("body_acceleration", "suspension_deflection", "tyre_deflection"):
        square = np.abs(car.frequency_response(f, output) / (2 * np.pi * f)) ** 2
        assert car.lyapunov_norms()[output] == pytest.approx(np.sqrt(2 * np.trapezoid(square, f)), rel=2e-3)


@pytest.mark.parametrize("damping", [0.0, 300.0, 1500.0, 5000.0])
def test_no_damper_changes_the_invariants(damping: float):
    car = LinearCar(REFERENCE.parameters.replace(damping=damping))
    for output, (frequency, gain) in car.invariants().items():
        assert abs(car.frequency_response(np.array([frequency]), output)[0]) == pytest.approx(gain, rel=1e-9)
    assert car.invariants()["body_acceleration"][1] == pytest.approx(660.3175, abs=5e-5)
    assert car.invariants()["suspension_deflection"][1] == pytest.approx(1.119048, abs=5e-7)


def test_invariants_hold_under_any_force_between_the_masses():
    # F = (K(s)) z_d with an arbitrary complex K: the same gains
    system = REFERENCE.absolute()
    frequency, gain = REFERENCE.invariants()["body_acceleration"]
    s = 2j * np.pi * frequency
    for k in (3e4 - 5e4j, -1e4 + 2e3j):
        a = system.A + np.outer(system.B[:, 2], k * system.C[1])
        x = np.linalg.solve(s * np.eye(4) - a, system.B[:, 0])
        assert abs(s**2 * x[0]) == pytest.approx(gain, rel=1e-9)


@pytest.mark.parametrize(("parameters", "frequencies", "damping", "invariants"), [
    (MEGANE, (1.441, 12.73), (0.203, 0.260), (11.91, 3.88)), (SAVARESI, (1.284, 10.81), (0.176, 0.230), (10.07, 3.36)),
    (SH_ADD, (1.083, 11.70), (0.238, 0.209), (11.25, 3.75)),
    (MOTORCYCLE, (2.228, 13.84), (0.501, 0.426), (12.99, 5.87)),
    (INOVE.replace(spring_stiffness=1396 + 170.4), (3.934, 37.47), (0.507, 0.637), (35.26, 11.11)),
    (DEMO, (1.116, 9.33), (0.203, 0.147), (8.96, 3.66))])
def test_sets_of_the_literature(parameters, frequencies, damping, invariants):
    # equation sheet 4.2: undamped frequencies, damping ratios of the damped car, invariant frequencies
    undamped = LinearCar(parameters.replace(damping=0.0)).modes()
    assert [f for f, _ in undamped] == pytest.approx(frequencies, rel=1e-3)
    assert [z for _, z in LinearCar(parameters).modes()] == pytest.approx(damping, abs=6e-4)
    found = LinearCar(parameters).invariants()
    assert found["body_acceleration"][0] == pytest.approx(invariants[0], abs=6e-3)
    assert found["suspension_deflection"][0] == pytest.approx(invariants[1], abs=6e-3)


def test_golden_table_of_the_megane():
    # equation sheet 6.10
    car = LinearCar(MEGANE)
    poles = sorted(np.linalg.eigvals(car.relative().A), key=lambda p: (round(p.real, 4), p.imag))
    np.testing.assert_allclose(poles, [-20.5215 - 76.3057j, -20.5215 + 76.3057j, -1.8594 - 8.9743j, -1.8594 + 8.9743j],
                               atol=6e-5)
    table = {0.5: (1.1351, 11.203, 0.1181, 0.0186), 1: (1.7635, 69.620, 0.7081, 0.1121),
             1.4: (2.7868, 215.64, 2.1019, 0.3357), 4: (0.2684, 169.57, 1.1158, 0.2296),
             10: (0.1314, 518.60, 1.6542, 1.2293), 12: (0.1178, 669.85, 1.8053, 1.8928),
             20: (0.0199, 314.09, 0.5186, 1.4758)}
    outputs = ("body_displacement", "body_acceleration", "suspension_deflection", "tyre_deflection")
    for column, output in enumerate(outputs):
        gains = np.abs(car.frequency_response(np.array(list(table)), output))
        digits = 10.0 ** -np.array([4, 3, 4, 4])[column]
        for gain, row in zip(gains, table.values(), strict=True):
            assert gain == pytest.approx(row[column], abs=max(0.6 * digits, 5e-5 * row[column]))


def test_iso_roads_of_the_megane():
    for road, acceleration, load, tyre, stroke in (("A", 0.4066, 210.8, 1.004e-3, 2.72e-3),
                                                   ("B", 0.8133, 421.5, 2.007e-3, 5.45e-3),
                                                   ("C", 1.6266, 843.0, 4.014e-3, 10.90e-3)):
        found = LinearCar(MEGANE).road_rms(road, 20.0)
        assert found["body_acceleration"] == pytest.approx(acceleration, rel=2e-4)
        assert found["tyre_force"] == pytest.approx(load, rel=2e-4)
        assert found["tyre_deflection"] == pytest.approx(tyre, rel=1e-3)
        assert found["suspension_deflection"] == pytest.approx(stroke, rel=2e-3)
    reference = REFERENCE.road_rms("B", 20.0)
    assert reference["body_acceleration"] == pytest.approx(0.81093, rel=1e-5)
    assert reference["tyre_force"] == pytest.approx(418.3, rel=2e-4)


@pytest.mark.parametrize("parameters", [MEGANE, BENCH])
def test_both_state_orders_are_one_car(parameters: CarParameters):
    car = LinearCar(parameters)
    relative = car.relative().select(inputs=("road_velocity",))
    f = np.array([0.3, 2.0, 9.0, 40.0])
    for output in RELATIVE:
        row = relative.select(outputs=(output,))
        by_velocity = [(row.C @ np.linalg.solve(s * np.eye(4) - row.A, row.B) + row.D)[0, 0] * s
                       for s in 2j * np.pi * f]
        np.testing.assert_allclose(car.frequency_response(f, output), by_velocity, rtol=1e-9)


def test_the_identity_of_the_masses():
    # m_s z̈_s + m_us z̈_us + k_t (z_us − z_r) = 0 for any force: rows of the state equations
    p = REFERENCE.parameters
    system = REFERENCE.relative()
    total = p.sprung_mass * system.A[1] + p.unsprung_mass * system.A[3]
    np.testing.assert_allclose(total, [0, 0, -p.tyre_stiffness, 0], atol=1e-9)
    np.testing.assert_allclose(p.sprung_mass * system.B[1] + p.unsprung_mass * system.B[3], 0, atol=1e-12)


def test_python_control_agrees():
    control = pytest.importorskip("control")
    for system in (LinearCar(BENCH).relative(), LinearCar(BENCH).absolute()):
        described = system.to_control()
        assert isinstance(described, control.StateSpace)
        assert tuple(described.output_labels) == system.outputs and tuple(described.input_labels) == system.inputs
        s = 7j
        wanted = system.C @ np.linalg.solve(s * np.eye(4) - system.A, system.B) + system.D
        np.testing.assert_allclose(described(s), wanted, rtol=1e-9, atol=1e-12)


def test_tyre_damping_lets_white_noise_through_to_the_tyre_force_only():
    norms = LinearCar(BENCH).lyapunov_norms()
    assert [n for n, v in norms.items() if np.isinf(v)] == ["tyre_force"]
    system = LinearCar(BENCH).relative()
    p = solve_continuous_lyapunov(system.A, -np.outer(system.B[:, 0], system.B[:, 0]))
    assert norms["suspension_deflection"] == pytest.approx(np.sqrt(p[0, 0]), rel=1e-12)


def test_questions_without_an_answer():
    with pytest.raises(InputError, match="tyre without damping"):
        LinearCar(BENCH).h2_norms()
    with pytest.raises(InputError, match="tyre without damping"):
        LinearCar(BENCH).invariants()
    undamped = LinearCar(MEGANE.replace(damping=0.0))
    with pytest.raises(InputError, match="without damping"):
        undamped.h2_norms()
    with pytest.raises(NumericalError, match="not asymptotically stable"):
        undamped.lyapunov_norms()
    with pytest.raises(InputError, match="body_acceleration"):
        REFERENCE.frequency_response(np.ones(1), "body_aceleration")
    assert set(RELATIVE) < set(OUTPUTS)
