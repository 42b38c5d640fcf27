"""Power laws: published numbers of source 000, closed-form work, units, starts."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.errors import InputError
from quartercar.dampers import Drive, Facts
from quartercar.dampers.bench.sine_work import SWIFT_2012, power_integral, sine_work
from quartercar.dampers.laws.power_law import PowerLaw, PowerLawFrictionGas

SPEEDS = np.array([0.05, 0.1, 0.25, 0.3, 0.5, 0.7])


def test_forces_of_the_published_law() -> None:
    # equations.md 6.1
    forces = SWIFT_2012.force(0.0, np.array([-0.6, -0.3, -0.05, 0.05, 0.3, 0.6]))
    np.testing.assert_allclose(forces, [-591.0, -408.0, -255.5, -69.464, 527.587, 2320.873], atol=6e-4)


def test_static_curve_of_the_published_law() -> None:
    # equations.md 1.0.4: without friction and gas
    np.testing.assert_allclose(SWIFT_2012.damping_force(SPEEDS), [61.5, 136, 487, 659, 1693, 3393], rtol=4e-3)
    np.testing.assert_allclose(SWIFT_2012.damping_force(-SPEEDS), [-30.5, -61, -152, -183, -305, -427], rtol=4e-3)
    ratio = SWIFT_2012.damping_force(0.7) / -SWIFT_2012.damping_force(-0.7)
    assert ratio[0] == pytest.approx(7.9, abs=0.06)


WORKS = [(0.010, 0.05, 1.967), (0.010, 8.0, 29.942), (0.030, 0.5, 14.146), (0.030, 3.5, 144.054),
         (0.063, 1.0, 130.031), (0.063, 1.5, 250.419)]


@pytest.mark.parametrize(("amplitude", "frequency", "work"), WORKS)
def test_work_per_cycle_in_closed_form_and_by_simulation(amplitude: float, frequency: float, work: float) -> None:
    assert sine_work(SWIFT_2012, amplitude, frequency) == pytest.approx(work, abs=6e-4)
    sharp = SWIFT_2012.replace(friction_speed=1e-7)
    assert sharp.energy_per_cycle(amplitude, frequency) == pytest.approx(work, rel=2e-5, abs=5e-4)


def test_smoothed_friction_takes_less_work_where_the_motion_is_slow() -> None:
    slow, fast = (0.010, 0.05), (0.010, 8.0)
    assert SWIFT_2012.energy_per_cycle(*slow) < 0.9 * sine_work(SWIFT_2012, *slow)
    assert SWIFT_2012.energy_per_cycle(*fast) == pytest.approx(sine_work(SWIFT_2012, *fast), rel=1e-3)


@pytest.mark.parametrize(("exponent", "share"), [(1.0, 1.0), (1.5, 0.91531), (2.0, 0.84883), (2.4993, 0.79495)])
def test_equivalent_damping_of_a_power_term(exponent: float, share: float) -> None:
    # equations.md 9.1: c_eq = W/(πωX²) = (2/π) C V^{n−1} I(n+1)
    law = PowerLaw(values={f"{name}_{side}": value for side in ("extension", "compression")
                           for name, value in (("damping", 0.0), ("power_force", 100.0), ("exponent", exponent))})
    assert 2 / np.pi * power_integral(exponent + 1) == pytest.approx(share, abs=2e-5)
    amplitude, omega = 0.02, 2 * np.pi * 1.5
    peak = omega * amplitude
    equivalent = law.energy_per_cycle(amplitude, 1.5) / (np.pi * omega * amplitude**2)
    assert equivalent == pytest.approx(share * 100.0 * (peak / 0.5) ** exponent / peak, rel=2e-5)


def test_printed_constants_in_both_units_are_one_law() -> None:
    printed = SWIFT_2012.printed("mm")
    assert tuple(printed["extension"]) == pytest.approx((1.1602, 0.0002, 2.4993), rel=1e-12)
    assert SWIFT_2012.printed("SI")["extension"].power == pytest.approx(6294, abs=0.5)
    metric = SWIFT_2012.printed("SI")
    again = PowerLaw.from_printed(metric["extension"], metric["compression"], reference_speed=0.2)
    np.testing.assert_allclose(again.force(0.0, SPEEDS), SWIFT_2012.damping_force(SPEEDS), rtol=1e-12)
    with pytest.raises(InputError, match="unit"):
        SWIFT_2012.printed("inch")


def test_power_force_and_exponent_are_apart_at_the_reference_speed() -> None:
    # in (C_n, n) the two sensitivities are all but parallel, in (P, n) they are not
    v = np.linspace(0.01, 0.7, 200)
    law = SWIFT_2012
    gradient = law.law_gradient(0 * v, v, 0 * v, law.vector)[:, 1:3]
    coefficient, n = law.printed("mm")["extension"].power, 2.4993
    printed = np.column_stack([(1e3 * v)**n, coefficient * (1e3 * v)**n * np.log(1e3 * v)])

    def cosine(pair: np.ndarray) -> float:
        return float(abs(pair[:, 0] @ pair[:, 1]) / np.linalg.norm(pair[:, 0]) / np.linalg.norm(pair[:, 1]))

    assert cosine(printed) > 0.9995
    assert cosine(gradient) < 0.75


@pytest.mark.parametrize("law", [PowerLaw(), PowerLawFrictionGas(), PowerLawFrictionGas(spring=False)])
def test_gradient_is_that_of_the_law(law: PowerLaw, rng: np.random.Generator) -> None:
    x, v = rng.normal(scale=0.01, size=60), np.concatenate([[0.0, 1e-9], rng.normal(scale=0.3, size=58)])
    exact = law.law_gradient(x, v, 0 * v, law.vector)
    for j in range(law.vector.size):
        step = np.zeros(law.vector.size)
        step[j] = 1e-6 * max(abs(law.vector[j]), 1.0)
        moved = (law.law(x, v, 0 * v, law.vector + step) - law.law(x, v, 0 * v, law.vector - step)) / (2 * step[j])
        np.testing.assert_allclose(exact[:, j], moved, rtol=1e-5, atol=1e-5 * np.abs(exact[:, j]).max() + 1e-9)


def test_starts_come_near_the_truth(rng: np.random.Generator) -> None:
    x, v = rng.normal(scale=0.02, size=4000), rng.normal(scale=0.3, size=4000)
    force = SWIFT_2012.law(x, v, 0 * v, SWIFT_2012.vector)
    drive = Drive(1 / 500, v, x, 0 * v, force + rng.normal(scale=5.0, size=v.size))
    best = SWIFT_2012.starts([drive], 3, rng)
    assert len(best) == 3
    assert np.std(SWIFT_2012.response(drive, best[0]) - force) < 0.02 * force.std()


def test_structure_follows_the_data() -> None:
    facts = Facts(False, False, False, "A", None, (), 0.0, 0.0, 0.6, 300.0, 1 / 500, 1000, 1)
    law = PowerLawFrictionGas.suited(facts)
    assert law.reads == ("velocity",) and "gas_stiffness" not in law.names
    assert law.reference_speed == pytest.approx(0.42)
    assert PowerLaw.suited(facts).reads == ("velocity",)


def test_bounds_and_settings_are_refused() -> None:
    with pytest.raises(InputError, match="exponent_extension"):
        PowerLaw(values={"exponent_extension": 0.5})
    with pytest.raises(InputError, match="friction_speed"):
        PowerLawFrictionGas(friction_speed=0.0)
    with pytest.raises(InputError, match="no LPV form"):
        SWIFT_2012.to_lpv(1 / 500)
    np.testing.assert_allclose(SWIFT_2012.conservative_force(np.array([0.0, 0.01])), [-178.0, -173.1])
    assert not PowerLaw().conservative_force(np.array([0.0, 0.01])).any()
