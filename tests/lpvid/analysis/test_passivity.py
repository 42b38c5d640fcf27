"""Margins and certificates of passivity against analytic cases and against energy along random motions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.passive_models import BOX, STEP, late, maxwell, motion, record, yielding

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.lmi.passive_form import preload


def test_a_delayed_damper_is_active_from_its_analytic_frequency():
    model = late(delay=2)
    edge = 0.25 / (2 * STEP)  # cos(2π f T·2) < 0 from a quarter period on
    margin = lpv.passivity_margin(model, frequencies=np.linspace(1, 249, 997))
    given = margin.frequencies[margin.mask[0]]
    assert given.min() == pytest.approx(edge, abs=0.3) and given.max() == pytest.approx(3 * edge, abs=0.3)
    assert margin.damping.min() == pytest.approx(-500.0, rel=1e-4)
    assert margin.active and "62.5 to 187 Hz" in margin.description(None) and margin.description(25.0) == ""
    found = lpv.certify_passivity(model)
    assert not found.verified and "it is active" in found.why


@pytest.mark.parametrize(("own", "verdict"), [(505.0, "certified"), (495.0, "not certified")])
def test_direct_damping_makes_up_for_a_delay_exactly_where_it_is_as_large(own, verdict):
    assert lpv.certify_passivity(late(own=own)).verdict == verdict


def test_damping_in_steady_motion_is_the_work_of_a_simulated_sine():
    model = yielding(lag=0.6)
    frequency, current = 30.0, 1.3
    k = np.arange(5000)
    works = []
    for amplitude in (1e-4, 0.02, 0.1, 5e4):
        v = amplitude * np.sin(2 * np.pi * frequency * STEP * k)
        run = lpv.simulate(model, record(v, np.full(v.size, current)), "zero")
        steady = slice(2500, 5000)  # 150 periods
        works.append(2 * np.mean(run.output[steady, 0] * v[steady]) / amplitude**2)
    margin = lpv.passivity_margin(model, [current], [frequency])
    assert margin.damping[0, 0] == pytest.approx(min(works), rel=2e-3)
    assert works[3] < works[2] < works[1] and margin.large[0, 0]


def test_damping_up_to_an_amplitude_is_that_of_the_largest_motion():
    """N(V) falls with V: within a bound the least damping is that of the bound, as a simulated sine has it."""
    model = yielding(lag=0.6)
    frequency, current, size = 30.0, 1.3, 0.1
    v = size * np.sin(2 * np.pi * frequency * STEP * np.arange(5000))
    run = lpv.simulate(model, record(v, np.full(v.size, current)), "zero")
    work = 2 * np.mean(run.output[2500:, 0] * v[2500:]) / size**2
    margin = lpv.passivity_margin(model, [current], [frequency], largest=size)
    assert margin.damping[0, 0] == pytest.approx(work, rel=2e-3)
    assert margin.damping[0, 0] > lpv.passivity_margin(model, [current], [frequency]).damping[0, 0]
    assert margin.largest == size
    with pytest.raises(InputError, match="largest must be positive"):
        lpv.passivity_margin(model, largest=0.0)


def test_a_spring_and_a_damper_in_series_are_certified_and_stay_so_in_a_file(tmp_path):
    model = maxwell()
    found = lpv.certify_passivity(model)
    assert found.verdict == "certified" and found.between_grid
    lpv.save(found, tmp_path / "c.json")
    again = lpv.load(tmp_path / "c.json")
    assert lpv.verify(again, model).holds
    assert not lpv.verify(again, maxwell(damping=700.0)).holds


def test_a_static_yield_is_certified_for_any_current():
    found = lpv.certify_passivity(yielding())
    assert found.verdict == "certified" and found.box.rate == (None,) and "however fast" in found.claim


def test_no_motion_takes_more_than_is_stored():
    b = yielding(lag=0.25)
    found = lpv.certify_passivity(b)
    assert found.verdict == "certified"
    rng = np.random.default_rng(3)
    for _ in range(20):
        v, i = motion(rng, 600, speed=float(rng.choice([0.01, 0.1, 1.0])))
        force = lpv.simulate(b, record(v, i), "zero").output[:, 0]
        w = np.tanh(v / (0.03 + 0.01 * i))
        past = np.column_stack([force])
        stored = found.stored(past, np.append(i[1:], i[-1])[:, None])
        assert b.n_lags == 1 and w.size == v.size and past.shape[1] == found.matrices.shape[1]
        delivered = np.cumsum(force * v) * STEP
        assert np.all(delivered - stored >= -1e-9 * np.sum(np.abs(force * v)) * STEP)
        assert stored.min() >= 0


@pytest.mark.seconds
def test_a_violation_between_grid_points_is_refused():
    """Damping (i − ½)² ∓ 10⁻⁶: negative within a thousandth of ½ A, where no grid looks."""
    basis = lpv.Polynomial("current", degree=2)
    good, bad = (lpv.LPVTransferFunction.siso([], [[0.25 + e, -1.0, 1.0]], basis, STEP, scheduling=BOX)
                 for e in (1e-6, -1e-6))
    found = lpv.certify_passivity(good)
    assert found.verdict == "certified"
    assert not lpv.passivity_margin(bad).active  # on its grid it looks passive
    assert not lpv.certify_passivity(bad).verified
    outcome = lpv.verify(replace(found, model_hash=_digest(bad)), bad)
    assert not outcome.holds and "fails somewhere in the box" in outcome.why


def test_a_certificate_that_claims_more_than_it_proves_does_not_hold():
    model = yielding()
    found = lpv.certify_passivity(model)
    assert lpv.verify(found, model).holds
    for forged in (replace(found, margin=10 * found.margin), replace(found, multiplier=-found.multiplier),
                   replace(found, multiplier=20 * found.multiplier), replace(found, preload=3.0),
                   replace(found, kind="parameter-dependent")):
        assert not lpv.verify(forged, model).holds


def test_a_force_at_rest_that_follows_the_current_has_no_certificate():
    model = yielding()
    fixed = model.replace(c=np.array([[[-120.0, 0.0]]]))
    moved = model.replace(c=np.array([[[-120.0, 5.0]]]))
    assert preload(fixed) == pytest.approx(-120.0) and preload(moved) is None
    found = lpv.certify_passivity(fixed)
    assert found.verdict == "certified" and found.preload == pytest.approx(-120.0)
    assert f"the constant output of -120 {fixed.outputs[0].unit}".rstrip() in found.claim
    assert "does work when that moves" in lpv.certify_passivity(moved).why
    # the work of a current that alternates against the motion, at v small: more than any storage
    k = np.arange(4000)
    v, i = 1e-6 * np.sign(np.sin(0.1 * k)), 1 - np.sign(np.sin(0.1 * k))
    force = lpv.simulate(moved, record(v, i), "zero").output[:, 0]
    assert np.sum((force + 120.0) * v) * STEP < 0


def test_units_do_not_decide():
    model = yielding(lag=0.25)
    millimetres = model.replace(b=model.b * np.array([1e-6, 1e-3])[None, None, :, None],
                                input_stage=lpv.TanhStage(30.0, 10.0))  # mm/s in, kN out
    assert lpv.certify_passivity(millimetres).verdict == lpv.certify_passivity(model).verdict == "certified"


@pytest.mark.parametrize("model", [
    late().replace(lagged=True),
    lpv.LPVTransferFunction(np.zeros((0, 1, 1, 1)), np.ones((1, 1, 2, 1)), lpv.Polynomial(), STEP),
    lpv.LPVTransferFunction(np.zeros((0, 1, 1, 1)), np.ones((1, 1, 1, 1)), lpv.Polynomial(), STEP,
                            input_stage=lpv.ThreeZoneStage()),
])
def test_models_of_which_nothing_is_stated_say_why(model):
    found = lpv.certify_passivity(model)
    assert found.verdict == "not certified" and "passivity" in found.why


def test_bad_input_is_refused_in_one_line():
    with pytest.raises(InputError, match="half the sampling rate"):
        lpv.passivity_margin(late(), frequencies=[300.0])
    with pytest.raises(InputError, match="transfer function"):
        lpv.certify_passivity(3)  # type: ignore[arg-type]


def _digest(model):
    from lpvid.lmi.passive_form import supplied

    return supplied(model, np.zeros(0)).digest


def test_only_the_scheduling_of_unstable_poles_is_stated_as_unstable():
    """y(k) = −p y(k−1) + u(k): the pole −p leaves the circle where |p| > 1, over p in −2 … 2 in two stretches."""
    model = lpv.LPVTransferFunction.siso(
        a=[[0.0, 2.0]], b=[[1.0, 0.0]], sample_time=0.01, basis=lpv.Polynomial("current", 1, (0.0,), (2.0,)),
        scheduling=lpv.Scheduling(("current",), (-2.0,), (2.0,), units=("A",)))
    margin = lpv.passivity_margin(model, np.linspace(-2.0, 2.0, 41))
    assert "is unstable at -2 to -1 A and 1 to 2 A" in margin.statement()
    assert margin.description(25.0) == "is unstable at -2 to -1 A and 1 to 2 A" == margin.statement()
    assert margin.active and margin.unstable.sum() == 22


def test_energy_beside_instability_is_stated_of_the_stable_scheduling_alone():
    """The damping of −1/(1 + p z⁻¹) is negative for every p < 1; the frozen model is unstable from p = 1 on."""
    model = lpv.LPVTransferFunction.siso(
        a=[[1.0, 1.0]], b=[[-1.0, 0.0], [0.0, 0.0]], sample_time=0.01,
        basis=lpv.Polynomial("current", 1, (1.0,), (1.0,)),
        scheduling=lpv.Scheduling(("current",), (0.0,), (2.0,), units=("A",)))
    stated = lpv.passivity_margin(model, np.linspace(0.0, 2.0, 21)).statement()
    assert stated.startswith("is unstable at 1 to 2 A; ") and "gives energy at 0 to 0.9 A" in stated
