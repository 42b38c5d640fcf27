"""Embeddings E1-E8: a run of the nonlinear car comes back from the LPV plant with the run's own scheduling."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from lpvid.errors import InputError
from quartercar import roads
from quartercar.dampers import Guo, Guo6, Linear, PowerLawFrictionGas
from quartercar.lpv_models import (
    AdmissibleForce,
    LimitedForce,
    LimitedPair,
    NominalForce,
    Prefiltered,
    Reach,
    SaturationPair,
    SpeedScheduled,
    VariableDamping,
    YieldingLaw,
    pair_box,
    pair_hull,
    replay,
)
from quartercar.lpv_models.car_part import SPEED, bare_car, passive_sense
from quartercar.lpv_models.embedding import output_gap
from quartercar.lpv_models.region import Region
from quartercar.parameters import BENCH, MEGANE
from quartercar.vehicle.linear import LinearCar
from quartercar.vehicle.nonlinear import Coil, QuarterCar
from quartercar.vehicle.result import CarRun

SPAN = (0.0, 2.5)
VALUES = {"yield_force_at_low": 100.0, "yield_force_at_high": 1500.0, "sharpness": 13.8,
          "post_yield_damping": 800.0}
DAMPER = Guo6(values={**VALUES, "critical_ratio": 0.77}, span=SPAN)
PLAIN = Guo(values={"yield_force_at_low": 100.0, "yield_force_at_high": 1500.0, "sharpness": 13.8,
                    "post_yield_damping_at_low": 700.0, "post_yield_damping_at_high": 1500.0}, degree=1,
            hysteresis=False, span=SPAN)
LAW = YieldingLaw.of(DAMPER)
SMOOTH = Coil(rise_time=0.01, fall_time=0.01, highest=2.5)


def driven(damper, step: float = 1e-3, seconds: float = 2.0, coil: Coil | None = None, seed: int = 2,
           over: float = 0.0) -> CarRun:
    """A car on a rough road with a smooth current; `over` drives the command that far beyond the coil's limits."""
    rng = np.random.default_rng(seed)
    n = round(seconds / 1e-3) + 1
    t = 1e-3 * np.arange(n)
    road = np.cumsum(rng.standard_normal(n)) * 4e-4
    road = np.convolve(road, np.hanning(41) / np.hanning(41).sum(), "same")
    fine = step * np.arange(round(seconds / step) + 1)
    road = np.interp(fine, t, road - road[0])
    current = 1.25 + (1.2 + over) * np.sin(2 * np.pi * 3.1 * fine)
    car = QuarterCar(MEGANE, damper, coil=coil or Coil(highest=2.5), lift_off=False, longest_step=step)
    return car.run(road, step, current)


def error(embedding, run: CarRun) -> float:
    found, wanted = replay(embedding, run), embedding.along(run).states
    return float((np.abs(found - wanted).max(axis=0) / np.abs(wanted).max(axis=0)).max())


def embeddings():
    weak = AdmissibleForce.of(DAMPER, SPAN).nominal(0.2)
    return {"E1": (SaturationPair(MEGANE, LAW), DAMPER), "E1 box": (SaturationPair(MEGANE, LAW, tight=False), DAMPER),
            "E2": (LimitedPair(MEGANE, LAW), DAMPER), "E5": (NominalForce(MEGANE, weak), DAMPER),
            "E5 other": (NominalForce(MEGANE, weak), PLAIN), "E6": (VariableDamping(MEGANE, 0.0, 3e4), PLAIN),
            "E7": (SpeedScheduled(MEGANE, weak), PLAIN)}


# -- exactness ---------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", list(embeddings()))
def test_equations_hold_at_every_sample(name: str) -> None:
    embedding, damper = embeddings()[name]
    assert output_gap(embedding, driven(damper)) < 1e-9


@pytest.mark.seconds
@pytest.mark.parametrize("name", list(embeddings()))
def test_replay_is_the_run_to_integration_accuracy(name: str) -> None:
    # both sides are of second order in the step
    # but where the current jumps at the samples (E2, no lag in the coil)
    embedding, damper = embeddings()[name]
    coil = Coil(highest=2.5) if name == "E2" else SMOOTH
    errors = [error(embedding, driven(damper, step, coil=coil)) for step in (1e-3, 5e-4, 2.5e-4)]
    assert errors[0] < 1e-2
    order = 1.9 if name == "E2" else 3.5
    assert errors[0] / errors[1] > order and errors[1] / errors[2] > order


def test_the_scheduling_of_a_run_is_in_the_region() -> None:
    run = driven(DAMPER)
    reach = Reach.of(run)
    for embedding in (SaturationPair(MEGANE, LAW, reach), LimitedPair(MEGANE, LAW, reach)):
        assert embedding.region.contains(embedding.along(run).scheduling).all()
        assert not embedding.region.contains(np.array([[0.0, 0.1], [0.99, 0.99]])).any()
    speed = SpeedScheduled(MEGANE, 1000.0, reach)
    assert speed.region.contains(speed.along(run).scheduling).all()


@pytest.mark.seconds
def test_demands_beyond_the_limits() -> None:
    run = driven(DAMPER, over=2.0)
    embedding = LimitedPair(MEGANE, LAW, Reach.of(run))
    path = embedding.along(run)
    assert np.abs(path.inputs[:, 1]).max() > 2 * LAW.half_range
    assert output_gap(embedding, run) < 1e-9
    assert error(embedding, driven(DAMPER, 2.5e-4, over=2.0)) < 3e-3
    with pytest.raises(InputError, match=r"not its lag.*SaturationPair"):
        embedding.along(driven(DAMPER, coil=SMOOTH, seconds=0.2))
    asked = path.inputs[:, 1]
    np.testing.assert_allclose(embedding.ratio(asked) * asked, np.clip(asked, -LAW.half_range, LAW.half_range))
    soft = LimitedPair(MEGANE, LAW, limiter="tanh")
    np.testing.assert_allclose(soft.ratio(asked) * asked, LAW.half_range * np.tanh(asked / LAW.half_range), atol=1e-9)


@pytest.mark.seconds
def test_the_prefilter_is_the_coil() -> None:
    coil = Coil(rise_time=0.02, fall_time=0.02, highest=2.5)
    embedding = Prefiltered(SaturationPair(MEGANE, LAW), 0.02)
    assert not embedding.system.B[1:].any() and not embedding.system.D[:, :, 1].any()
    run = driven(DAMPER, coil=coil)
    assert output_gap(embedding, run) < 1e-9
    errors = [error(embedding, driven(DAMPER, step, coil=coil)) for step in (1e-3, 5e-4)]
    assert errors[0] < 5e-3 and errors[0] / errors[1] > 3


@pytest.mark.parametrize("inner", [LimitedPair(MEGANE, LAW), NominalForce(MEGANE, 1000.0)])
def test_only_a_yield_force_lags_as_the_coil_does(inner) -> None:
    # the plant holds for a design; a run with a lagging coil is none of it
    behind = Prefiltered(inner, 0.01)
    assert behind.held == ("road_velocity", inner.control) and not behind.system.B[1:].any()
    with pytest.raises(InputError, match=r"lag of a coil.*SaturationPair"):
        behind.along(driven(DAMPER, coil=SMOOTH, seconds=0.2))


def test_what_a_damper_gives_of_a_demand() -> None:
    run = driven(PLAIN)
    band = AdmissibleForce.of(PLAIN, SPAN)
    embedding = LimitedForce(MEGANE, band.nominal(0.2))
    v = run["suspension_velocity"]
    asked = np.random.default_rng(1).uniform(-4000, 4000, v.size)
    given = band.clip(embedding.nominal_damping * v + asked, v)
    share = embedding.share(given, v, asked)
    inside = (band.distance(embedding.nominal_damping * v, v) == 0)
    assert inside.mean() > 0.9
    np.testing.assert_allclose((embedding.nominal_damping * v + share * asked)[inside], given[inside], atol=1e-9)
    # along a run whose demand is met halfway
    path = embedding.along(run)
    twice = embedding.demanded(run, 2 * path.inputs[:, 1])
    np.testing.assert_allclose(twice.scheduling[1:], 0.5)
    np.testing.assert_allclose(twice.scheduling[:, 0] * twice.inputs[:, 1], path.inputs[:, 1])


# -- sign, sense, invariants -------------------------------------------------------------------------------------------
def test_a_force_in_extension_pulls_the_body_down() -> None:
    """E8."""
    car = bare_car(MEGANE)
    assert car.B[1, 1] == -1 / MEGANE.sprung_mass and car.B[3, 1] == 1 / MEGANE.unsprung_mass
    np.testing.assert_allclose(car.A + np.outer(car.B[:, 1], 1500.0 * SPEED), LinearCar(MEGANE).relative().A)


@pytest.mark.parametrize("embedding, point", [
    (VariableDamping(MEGANE, 900.0, 4300.0), [1500.0]), (NominalForce(MEGANE, 1500.0), []),
    (SpeedScheduled(MEGANE, 1500.0), [0.7]), (LimitedForce(MEGANE, 1500.0), [0.3])])
def test_frozen_at_the_passive_damping_it_is_the_linear_car(embedding, point) -> None:
    # golden numbers of the equation sheet, 6.10, and the invariants of 4.1
    a, b, c, d = embedding.system.frozen(point)
    poles = np.linalg.eigvals(a)
    np.testing.assert_allclose(np.sort(poles.real), [-20.5215, -20.5215, -1.8594, -1.8594], atol=1e-4)
    np.testing.assert_allclose(np.sort(poles.imag), [-76.3057, -8.9743, 8.9743, 76.3057], atol=1e-4)

    def gain(frequency: float, row: int) -> float:
        s = 2j * np.pi * frequency
        return abs(s * (c @ np.linalg.solve(s * np.eye(4) - a, b[:, 0]) + d[:, 0])[row])  # from z_r, not ż_r

    for f, acceleration, stroke, tyre in ((0.5, 11.203, 0.1181, 0.0186), (1.4, 215.64, 2.1019, 0.3357),
                                          (12.0, 669.85, 1.8053, 1.8928)):
        np.testing.assert_allclose([gain(f, 0), gain(f, 1), gain(f, 2)], [acceleration, stroke, tyre], rtol=6e-4)
    p = MEGANE
    np.testing.assert_allclose(gain(np.sqrt(p.tyre_stiffness / p.unsprung_mass) / 2 / np.pi, 0),
                               p.tyre_stiffness / p.sprung_mass, rtol=1e-10)
    total = p.sprung_mass + p.unsprung_mass
    np.testing.assert_allclose(gain(np.sqrt(p.tyre_stiffness / total) / 2 / np.pi, 1), total / p.sprung_mass,
                               rtol=1e-10)


@pytest.mark.parametrize("embedding", [SaturationPair(MEGANE, LAW), LimitedPair(MEGANE, LAW),
                                       VariableDamping(MEGANE, 500.0, 5000.0), SpeedScheduled(MEGANE, 1500.0)])
def test_no_suspension_force_moves_the_invariant_points(embedding) -> None:
    # at the wheel's frequency k_t/m_us the body's acceleration is k_t/m_s whatever the scheduling
    omega = np.sqrt(MEGANE.tyre_stiffness / MEGANE.unsprung_mass)
    for p in embedding.region.corners:
        a, b, c, d = embedding.system.frozen(p)
        h = 1j * omega * (c @ np.linalg.solve(1j * omega * np.eye(4) - a, b[:, 0]) + d[:, 0])
        np.testing.assert_allclose(abs(h[0]), MEGANE.tyre_stiffness / MEGANE.sprung_mass, rtol=1e-9)


def test_h2_norms_of_the_frozen_passive_car() -> None:
    # reference numbers of synthesis.md, 1
    from scipy.linalg import solve_continuous_lyapunov

    model = VariableDamping(MEGANE.replace(tyre_stiffness=208e3), 900.0, 4300.0).system
    a, b, c, _ = model.frozen([1500.0])
    p = solve_continuous_lyapunov(a, -b @ b.T)
    norms = np.sqrt(np.diag(c @ p @ c.T))
    np.testing.assert_allclose(norms[:3], [51.0168, 0.342783, 0.126520], rtol=1e-5)


def test_a_damped_tyre_is_carried_along() -> None:
    run = QuarterCar(BENCH, Linear(values={"damping": 7.5}), lift_off=False).run(
        0.01 * np.hanning(800), 1e-3)
    embedding = NominalForce(BENCH, 5.0)
    assert output_gap(embedding, run) < 1e-9
    assert error(embedding, run) < 1e-3


def test_reversed_polarity_is_refused() -> None:
    for wrong in (DAMPER.replace(polarity=-1), Linear(values={"stiffness": 0.0}).replace(polarity=-1)):
        with pytest.raises(InputError, match=r"reversed sign.*flip force"):
            passive_sense(wrong)
    with pytest.raises(InputError, match="points along the motion"):
        passive_sense(_Backwards())
    with pytest.raises(InputError, match="reversed sign"):
        YieldingLaw.of(DAMPER.replace(polarity=-1))


class _Backwards(PowerLawFrictionGas):
    def static_force(self, velocity, current=0.0, displacement=0.0):
        return -1000.0 * np.asarray(velocity)


# -- the law and its strip ---------------------------------------------------------------------------------------------
def test_the_law_is_the_damper() -> None:
    rng = np.random.default_rng(4)
    z, v, i = rng.uniform(-0.05, 0.05, 50), rng.uniform(-1, 1, 50), rng.uniform(0, 2.5, 50)
    x = np.column_stack([z, v, np.zeros(50), np.zeros(50)])
    force = LAW.least + (LAW.most - LAW.least) * i / 2.5
    np.testing.assert_allclose(x @ LAW.linear + force * np.tanh(x @ LAW.argument), DAMPER.force(z, v, i))


def test_other_laws_are_refused() -> None:
    with pytest.raises(InputError, match="more than the yield force follows the current"):
        YieldingLaw.of(PLAIN)
    with pytest.raises(InputError, match="no law with a yield force"):
        YieldingLaw.of(Linear())
    with pytest.raises(InputError, match="room to move"):
        YieldingLaw.of(Guo6(values={"yield_force_at_low": 500.0, "yield_force_at_high": 500.0}, span=SPAN))


@pytest.mark.parametrize("tangents", [0, 1, 4])
def test_the_hull_holds_the_curve_and_little_else(tangents: int) -> None:
    reach = Reach(0.4, 0.05)
    box, hull = pair_box(LAW, reach), pair_hull(LAW, reach, tangents)
    far = reach.argument(LAW)
    xi = np.linspace(-far, far, 2001)
    curve = np.column_stack([np.tanh(xi), np.where(xi == 0, 1.0, np.tanh(xi) / np.where(xi == 0, 1.0, xi))])
    assert hull.contains(curve).all() and box.contains(curve).all()
    assert len(hull.corners) == 2 * tangents + 4
    # never smaller than the exact hull of the curve (scipy), and close to it with many tangents
    exact = ConvexHull(curve).volume
    assert exact < hull.volume < box.volume
    if tangents == 4:
        assert hull.volume < 1.05 * exact
    # the strip of the sheet
    assert np.all(curve[:, 1] >= 1 - curve[:, 0] ** 2 - 1e-12)
    assert np.all(curve[:, 1] <= 1 - curve[:, 0] ** 2 / 3 + 1e-12)


def test_a_flat_region_is_a_box() -> None:
    flat = Region.box(("p", "q"), (0.0, 1.0), (1.0, 1.0), "")
    np.testing.assert_array_equal(flat.contains(np.array([[0.5, 1.0], [0.5, 1.1]])), [True, False])


# -- the admissible forces ---------------------------------------------------------------------------------------------
def test_admissible_forces_are_those_of_the_ends_of_the_current() -> None:
    band = AdmissibleForce.of(PLAIN, SPAN)
    v = np.linspace(-1.2, 1.2, 37)
    ends = np.array([PLAIN.force(0.0, v, i) for i in SPAN])
    low, high = band(v)
    np.testing.assert_allclose(low, ends.min(axis=0), atol=2e-3 * np.abs(ends).max())
    np.testing.assert_allclose(high, ends.max(axis=0), atol=2e-3 * np.abs(ends).max())
    np.testing.assert_allclose(band(np.array([3.0]))[1], PLAIN.force(0.0, 3.0, 2.5), rtol=1e-2)
    assert band.distance(np.array([1e4]), np.array([-0.2]))[0] > 1e4


def test_a_preload_is_no_force_of_the_damper() -> None:
    base = {"post_yield_damping": 800.0, "yield_force_at_low": 50.0, "yield_force_at_high": 900.0}
    with_gas = Guo6(values={**base, "offset": -180.0}, offset=True, span=SPAN)
    plain, gas = AdmissibleForce.of(Guo6(values=base, span=SPAN), SPAN), AdmissibleForce.of(with_gas, SPAN)
    np.testing.assert_allclose(gas.least, plain.least, atol=1e-9)
    run = driven(with_gas, seconds=0.5)
    assert output_gap(NominalForce(MEGANE, 800.0), run) < 1e-9
    assert output_gap(SaturationPair(MEGANE, YieldingLaw.of(with_gas)), run) < 1e-9


def test_road_of_the_issue_stays_within_the_default_reach() -> None:
    z = roads.iso8608(4000, 1000.0, "C", speed=20.0, rng=np.random.default_rng(0))
    run = QuarterCar(MEGANE, DAMPER, lift_off=False).run(z - z[0], 1e-3, 1.0)
    assert np.abs(run["suspension_velocity"]).max() < Reach().speed
    assert np.abs(run["suspension_deflection"]).max() < Reach().stroke
