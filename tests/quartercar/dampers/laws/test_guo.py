"""Guo's laws: the golden number, what is identifiable, closed forms of the critical ratio, LPV forms."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from lpvid.condition import resample, with_velocity
from lpvid.errors import InputError
from lpvid.files import read
from lpvid.record import Record
from lpvid.simulation import simulate
from quartercar.dampers import Drive, Facts, FitSettings, fit
from quartercar.dampers.laws.coefficients import Controlled
from quartercar.dampers.laws.guo import Guo, Guo5, Guo6, Guo7, Guo15, jenkins_ratio
from quartercar.dampers.laws.tanh_law import TanhLaw
from quartercar.dampers.parameter import Parameter

GOLDEN = {"yield_force": 600.0, "sharpness": 20.0, "post_yield_damping": 1500.0, "critical_ratio": 3.0}
FAMILY = [Guo(), Guo(degree=2, offset=True), Guo(degree=1, span=(0.0, 2.5)), Guo(hysteresis=False), Guo5(),
          Guo5(offset=True),
          Guo6(span=(0.0, 2.5)), Guo7(), Guo7(offset=True), Guo15(span=(0.2, 2.0)), Guo15(offset=True)]


@pytest.fixture
def record(rng: np.random.Generator) -> Record:
    t = np.arange(400) / 200
    return Record({"displacement": 0.01 * np.sin(9 * t) + 0.004 * np.sin(31 * t),
                   "velocity": 0.09 * np.cos(9 * t) + 0.124 * np.cos(31 * t),
                   "current": 1.0 + np.sin(2 * t)}, sample_time=1 / 200,
                  units={"displacement": "m", "velocity": "m/s", "current": "A"})


def test_the_golden_force() -> None:
    # equations.md 6.5
    assert Guo(values=GOLDEN).force(0.01, 0.1)[0] == pytest.approx(788.4164, abs=5e-5)


def test_the_thesis_forms_at_a_constant_current_are_guo() -> None:
    x, v, i = 0.008, np.linspace(-0.4, 0.4, 9), 1.6
    plain = Guo(values=GOLDEN).force(x, v)
    five = Guo5(values={"yield_force_per_current": 600.0 / i, "sharpness": 20.0, "post_yield_damping": 1500.0,
                        "critical_ratio": 3.0})
    seven = Guo7(values={**five.values, "post_yield_ratio": 3.0})
    six = Guo6(values={"yield_force_at_low": 600.0, "yield_force_at_high": 600.0, "sharpness": 20.0,
                       "post_yield_damping": 1500.0, "critical_ratio": 3.0})
    for law in (five, six, seven):
        np.testing.assert_allclose(law.force(x, v, i), plain, rtol=1e-12)
    other_reading = Guo7(offset=True, values={**five.values, "post_yield_ratio": 1.0, "offset": -80.0}).force(x, v, i)
    expected = 600 * np.tanh(20 * (v + 3 * x)) + 1500 * (v + 1 * x) - 80
    np.testing.assert_allclose(other_reading, expected, rtol=1e-12)


def test_fifteen_quadratics_have_one_scale_too_many() -> None:
    rng = np.random.default_rng(5)
    law = Guo15(span=(0.0, 2.0))
    x, v, i = rng.normal(scale=0.01, size=500), rng.normal(scale=0.2, size=500), rng.uniform(0, 2, 500)
    powers = law.current_powers()
    plain = Parameter("c", "", "c", 1.0)
    # the printed form, V_0 and X_0 by powers of the current, reproduced for two values of the scale that cancels
    speed = Controlled(plain, (4.0, 5.0, 9.0), (0.0, 2.0)).powers(np.array([4.0, 5.0, 9.0]))
    stroke = Controlled(plain, (1.0, 0.4, 0.8), (0.0, 2.0)).powers(np.array([1.0, 0.4, 0.8]))

    def at(c: np.ndarray) -> np.ndarray:
        return np.polynomial.polynomial.polyval(i, c)

    for scale in (1.0, 7.0):
        s = v + at(scale * speed) / at(scale * stroke) * x
        printed = (at(powers["yield_force"]) * np.tanh(at(powers["sharpness"]) * s)
                   + at(powers["post_yield_damping"]) * s)
        np.testing.assert_allclose(law.law(x, v, i, law.vector), printed, rtol=1e-10, atol=1e-10)
    gradient = law.law_gradient(x, v, i, law.vector)
    assert gradient.shape[1] == 14
    assert np.linalg.matrix_rank(gradient / np.linalg.norm(gradient, axis=0), tol=1e-6) == 14


@pytest.mark.parametrize(("law", "count"), [(Guo(), 4), (Guo5(), 4), (Guo6(), 5), (Guo7(), 5)])
def test_fewer_parameters_than_the_names_say(law: TanhLaw, count: int, rng: np.random.Generator) -> None:
    x, v, i = rng.normal(scale=0.01, size=300), rng.normal(scale=0.2, size=300), rng.uniform(0, 1, 300)
    gradient = law.law_gradient(x, v, i, law.vector)
    assert gradient.shape[1] == count
    assert np.linalg.matrix_rank(gradient / np.linalg.norm(gradient, axis=0), tol=1e-6) == count


@pytest.mark.parametrize("law", FAMILY, ids=lambda d: f"{d.name}-{len(d.names)}")
def test_gradient_is_that_of_the_law(law: TanhLaw, rng: np.random.Generator) -> None:
    x, v, i = rng.normal(scale=0.01, size=80), rng.normal(scale=0.2, size=80), rng.uniform(0.2, 1, 80)
    exact = law.law_gradient(x, v, i, law.vector)
    for j in range(law.vector.size):
        step = np.zeros(law.vector.size)
        step[j] = 1e-6 * max(abs(law.vector[j]), 1e-2)
        moved = (law.law(x, v, i, law.vector + step) - law.law(x, v, i, law.vector - step)) / (2 * step[j])
        np.testing.assert_allclose(exact[:, j], moved, rtol=1e-5, atol=2e-6 * np.abs(exact[:, j]).max())


def test_control_values_bound_the_coefficient_between_them() -> None:
    c = Controlled(Parameter("c", "N", "c", 1.0, 0.0), (0.0, 0.0, 1.0), (0.5, 2.5))
    i = np.linspace(0.5, 2.5, 101)
    values = c.value(i, np.array([3.0, 0.0, 1.0]))
    assert values.min() >= 0 and values[0] == pytest.approx(3.0) and values[-1] == pytest.approx(1.0)
    powers = c.powers(np.array([3.0, 0.0, 1.0]))
    np.testing.assert_allclose(np.polynomial.polynomial.polyval(i, powers), values, atol=1e-12)


def test_span_left_out_is_that_of_the_fit() -> None:
    i = np.array([0.5, 1.1, 2.0])
    chosen, left_out = Guo6(span=(0.5, 2.0)), Guo6(current_range=(0.5, 2.0))
    np.testing.assert_array_equal(chosen.force(0.01, 0.1, i), left_out.force(0.01, 0.1, i))
    np.testing.assert_array_equal(chosen.force(0.01, 0.1, i), chosen.replace(current_range=(0, 9)).force(0.01, 0.1, i))


def test_no_constant_ratio_serves_two_amplitudes() -> None:
    # equations.md 9.2: F_y = 1 kN, k = 1 MN/m, at 1, 5 and 15 Hz
    for amplitude, ratios in ((0.002, (10.9, 54.4, 163)), (0.005, (4.7, 23.6, 70.7)), (0.020, (2.07, 10.3, 31.0))):
        got = [jenkins_ratio(1e3, 1e6, amplitude, f) for f in (1.0, 5.0, 15.0)]
        np.testing.assert_allclose(got, ratios, rtol=6e-3)
    assert jenkins_ratio(1e3, 1e6, 0.0009, 1.0) == np.inf


@pytest.mark.parametrize("amplitude", [0.002, 0.005])
def test_the_ratio_against_the_yield_element_itself(amplitude: float) -> None:
    # a return map of the elastic-plastic element is its exact solution: F ← clip(F + k dx, ±F_y)
    n, omega, force = 20000, 2 * np.pi * 5.0, 0.0
    t = np.arange(2 * n + 1) / n * 2 * np.pi / omega
    x, v = amplitude * np.sin(omega * t), amplitude * omega * np.cos(omega * t)
    forces = []
    for dx in np.diff(x, prepend=x[0]):
        force = min(max(force + 1e6 * dx, -1e3), 1e3)
        forces.append(force)
    crossings = [k for k, (a, b) in enumerate(pairwise(forces)) if k > n and a * b < 0]
    at = crossings[0]
    assert -v[at] / x[at] == pytest.approx(jenkins_ratio(1e3, 1e6, amplitude, 5.0), rel=5e-3)


def test_positive_ratio_means_lag() -> None:
    loop = Guo(values=GOLDEN).cycle(0.01, 2.0)
    k = int(np.argmax(loop.displacement))
    assert loop.force[k] > 0.5 * 600 * np.tanh(20 * 3 * 0.01)      # at +X the force is still that of extension
    spring_free = Guo(values={**GOLDEN, "critical_ratio": 0.0}).cycle(0.01, 2.0)
    assert abs(spring_free.force[int(np.argmax(spring_free.displacement))]) < 5.0


@pytest.mark.parametrize("law", [
    Guo(hysteresis=False, values={"yield_force": 600.0}),
    Guo(degree=1, offset=True, current_range=(0.0, 2.0), hysteresis=False, values={"offset": -120.0}, polarity=-1)])
def test_without_displacement_it_is_a_hammerstein_model(law: Guo, record: Record) -> None:
    model = law.to_lpv(record.sample_time or 0.0)
    run = simulate(model, record.with_channel("force", np.zeros(record.n_samples), "N"))
    np.testing.assert_allclose(run.output[:, 0], law.simulate(record).output[:, 0], rtol=1e-10, atol=1e-8)


@pytest.mark.parametrize("law", [
    Guo(values=GOLDEN), Guo(degree=1, offset=True, span=(0.0, 2.0), centre=0.003, values={"offset": -120.0}),
    Guo(degree=2, span=(0.0, 2.0)), Guo5(), Guo6(),
    Guo7(offset=True, values={"offset": 40.0}, polarity=-1)])
def test_with_displacement_it_is_quasi_lpv_in_the_saturation(law: TanhLaw, record: Record) -> None:
    scheduled = law.with_saturation(record)
    assert 0 < scheduled["saturation"].min() < scheduled["saturation"].max() <= 1
    model = law.to_lpv(record.sample_time or 0.0)
    run = simulate(model, scheduled.with_channel("force", np.zeros(record.n_samples), "N"))
    np.testing.assert_allclose(run.output[:, 0], law.simulate(record).output[:, 0], rtol=1e-9, atol=1e-8)


def test_guo_15_has_no_lpv_form() -> None:
    with pytest.raises(InputError, match="no polynomials"):
        Guo15().to_lpv(1 / 500)


def test_the_elastic_part_leaves_a_dissipative_rest(rng: np.random.Generator) -> None:
    law = Guo(offset=True, values={**GOLDEN, "offset": -100.0})
    x, v = rng.normal(scale=0.02, size=2000), rng.normal(scale=0.2, size=2000)
    rest = law.law(x, v, 0 * v, law.vector) - law.conservative_force(x)
    assert (rest * v).min() >= 0
    assert law.conservative_force(np.zeros(1))[0] == pytest.approx(-100.0)


def test_structure_follows_the_data() -> None:
    def facts(displacement: bool, varies: bool) -> Facts:
        return Facts(displacement, varies, varies, "V", (0.0, 2.25) if varies else None, (), 0.0, 0.01, 0.5, 500.0,
                     1 / 500, 1000, 1)

    law = Guo.suited(facts(True, True))
    assert law.degree == 1 and law.span == (0.0, 2.25) and not law.offset and law.current_unit == "V"
    assert Guo.suited(facts(False, False)).reads == ("velocity",)
    for kind in (Guo5, Guo6, Guo7, Guo15):
        assert not kind.suited(facts(True, True)).offset
        with pytest.raises(InputError, match="current"):
            kind.suited(facts(True, False))
        with pytest.raises(InputError, match="displacement"):
            kind.suited(facts(False, True))
    assert Guo5(current_unit="V").parameters[0].unit == "N/V"


@pytest.mark.parametrize("law", FAMILY, ids=lambda d: f"{d.name}-{len(d.names)}")
def test_starts_come_near_the_truth(law: TanhLaw, rng: np.random.Generator) -> None:
    t = np.arange(3000) / 300
    x = 0.01 * np.sin(9 * t) + 0.004 * np.sin(41 * t)
    drive = Drive(1 / 300, np.gradient(x, 1 / 300), x, 1 + 0.8 * np.sin(3 * t))
    force = law.response(drive, law.vector)
    seen = Drive(drive.sample_time, drive.velocity, x, drive.current, force + rng.normal(scale=5, size=t.size))
    best = law.starts([seen], 4, rng)
    share = 0.3 if isinstance(law, Guo15) else 0.15        # starts know a constant sharpness and ratio only
    assert np.std(law.response(drive, best[0]) - force) < share * force.std()


def test_settings_and_bounds_are_refused() -> None:
    with pytest.raises(InputError, match="span"):
        Guo6(span=(1.0, 1.0))
    with pytest.raises(InputError, match="degree"):
        Guo(degree=3)
    with pytest.raises(InputError, match="yield_force"):
        Guo(values={"yield_force": -1.0})


def real(folder: Path, pattern: str) -> list[Record]:
    return [with_velocity(r) for path in sorted(folder.glob(pattern)) for r in read(path)]


@pytest.mark.seconds
def test_real_sines_at_a_current_that_was_not_fitted(shared_data: Path) -> None:
    runs = {level: real(shared_data / "mr_damper_sines", f"*Hz{level}A.csv") for level in ("0", "0p25", "0p75", "1")}
    training = [r for level in ("0", "0p25", "1") for r in runs[level]]
    for kind, least in ((Guo, 0.03), (Guo6, 0.03)):
        found = fit(kind.suited(Facts.of(training)), training, runs["0p75"], FitSettings(sample_rate=200.0))
        assert found.held_out is not None and found.held_out.esr < least
        assert found.passivity.passive and not found.at_bounds
        none, full = (found.damper.coefficients_at(i)["A_1"] for i in (0.0, 1.0))
        assert 50 < none < 150 and 900 < full < 1300


@pytest.mark.seconds
def test_real_random_motion_and_switched_voltage(shared_data: Path) -> None:
    [record] = real(shared_data / "mr_damper_random", "*.csv")
    record = resample(record.with_roles({"current": "voltage"}), 500.8)
    cut = round(8 * 500.8)
    training, rest = [record.slice(0, cut)], [record.slice(cut, record.n_samples)]
    found = fit(Guo.suited(Facts.of(training)), training, rest)
    assert found.held_out is not None and found.held_out.esr < 0.13     # no memory, no driver lag: a tenth is left
    assert found.damper.current_unit == "V" and found.damper.values["critical_ratio"] > 0
