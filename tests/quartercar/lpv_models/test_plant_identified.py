"""E9: the identified discrete damper in the car, its current scheduling variable and control at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.known_dampers import ONE, STEP, damper, held_force_run, road_and_current

from lpvid.errors import InputError
from lpvid.model.input_stage import ThreeZoneStage
from quartercar.dampers import Guo6, LpvArx
from quartercar.dampers.blackbox.held import Held
from quartercar.dampers.blackbox.identified import Identified
from quartercar.dampers.contract import ExtrapolationWarning
from quartercar.lpv_models import IdentifiedDamper, Prefiltered, RampedDamper, replay
from quartercar.lpv_models.identified_study import driven
from quartercar.lpv_models.prefilter import prefiltered
from quartercar.parameters import MEGANE
from quartercar.rides.default_damper import identified_damper
from quartercar.vehicle.nonlinear import QuarterCar


@pytest.mark.thinned(3, "slow", "seconds")
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("slope, affine", [(0.0, 0.0), (0.008, -15.0)])
@pytest.mark.parametrize("form", ["augmented", "observable", "controllable"])
def test_the_identity_is_exact(order: int, slope: float, affine: float, form: str) -> None:
    # of every form the damper's steps; of the augmented one the difference equation and the whole run
    law = damper(order, slope, affine)
    run = held_force_run(law, *road_and_current())
    embedding = IdentifiedDamper(MEGANE, law, 1.0, form).around(run)
    path, model = embedding.along(run), embedding.system
    phi = model.basis.evaluate(path.scheduling)
    ahead = (np.einsum("km,mij,kj->ki", phi, model.A, path.states)
             + np.einsum("km,mij,kj->ki", phi, model.B, path.inputs))[:-1]
    rows = slice(0 if form == "augmented" else 4, None)
    scale = np.abs(path.states).max(axis=0)[rows] + 1e-12
    assert (np.abs(ahead - path.states[1:])[:, rows] / scale).max() < 1e-9
    if form == "augmented":
        np.testing.assert_allclose(replay(embedding, run) / scale, path.states / scale, atol=1e-9)
        force = embedding.damper_states(run["suspension_velocity"], embedding.filtered_current(run))[1]
        np.testing.assert_allclose(force, run["damper_force"], atol=1e-9 * np.abs(force).max())
    assert embedding.realization.exact == (form == "augmented")
    assert embedding.region.contains(path.scheduling).all()
    if form == "augmented":
        assert len(embedding.names) == (3 if slope else 2)


@pytest.mark.seconds
def test_outputs_are_those_of_the_run() -> None:
    law = damper(2, affine=-10.0)
    run = QuarterCar(MEGANE, law, lift_off=False).run(*_long(600))
    embedding = IdentifiedDamper(MEGANE, law).around(run)
    path, model = embedding.along(run), embedding.system
    phi = model.basis.evaluate(path.scheduling)
    out = np.einsum("km,mij,kj->ki", phi, model.C, path.states) + np.einsum("km,mij,kj->ki", phi, model.D, path.inputs)
    rest = embedding._rest[1]
    for row, name in ((0, "body_acceleration"), (7, "damper_force")):
        wanted = run[name] - (rest if name == "damper_force" else 0.0)
        np.testing.assert_allclose(out[:, row], wanted, atol=2e-7 * np.abs(wanted).max())


def _long(n: int) -> tuple[np.ndarray, float, np.ndarray]:
    road, current = road_and_current(n)
    return road, STEP, current


@pytest.mark.seconds
def test_the_nonlinear_car_to_a_stated_error() -> None:
    # the car lets the damper's force rise linearly over a sample, the plant holds it
    law = damper(2)
    run = QuarterCar(MEGANE, law, lift_off=False).run(*_long(800))
    embedding = IdentifiedDamper(MEGANE, law).around(run)
    found, wanted = replay(embedding, run), embedding.along(run).states
    gap = np.std(found - wanted, axis=0)[:4] / np.std(wanted, axis=0)[:4]
    assert gap.max() < 0.15
    assert gap[0] < 0.08


def test_the_middle_of_no_change_has_the_derivative() -> None:
    # δ = 0: r is ∂F/∂i at the same state, here by the difference over 1e-4 A
    law = damper(1, slope=0.01)
    embedding = IdentifiedDamper(MEGANE, law, 1.0)
    state, v = np.array([[40.0, 0.3, 0.9]]), np.array([0.11])
    here = embedding.scheduled(state, v, np.array([1.0]))
    near = embedding.scheduled(state, v, np.array([1.0001]))
    np.testing.assert_allclose(here, near, rtol=1e-3)


def test_control_is_lost_where_the_damper_stands_still() -> None:
    law = damper(1)
    embedding = IdentifiedDamper(MEGANE, law, 1.0)
    r = embedding.scheduled(np.zeros((1, 3)), np.zeros(1), np.array([2.0]))[:, -1]
    np.testing.assert_allclose(r, 0.0, atol=1e-9)


def test_a_coil_in_front_makes_the_control_constant() -> None:
    law = damper(1, lag=False)
    run = held_force_run(law, *road_and_current(300))
    embedding = IdentifiedDamper(MEGANE, law).around(run)
    plant = prefiltered(embedding.system, embedding.control, 0.008)
    assert not plant.B[1:].any() and not plant.D[:, :, 1].any()
    np.testing.assert_allclose(plant.A[0, -1, -1], np.exp(-STEP / 0.008))
    # a unit command fills the lag as e^(-t/τ) says
    x = np.zeros(plant.order)
    for _ in range(5):
        x = plant.A[0] @ x + plant.B[0, :, 1]
    np.testing.assert_allclose(x[-1], 1 - np.exp(-5 * STEP / 0.008))
    with pytest.raises(InputError):
        Prefiltered(embedding, -1.0).system


def test_what_E9_refuses() -> None:
    law = damper(1)
    with pytest.raises(InputError, match="limited by recorded runs"):
        IdentifiedDamper(MEGANE, law).region
    with pytest.raises(InputError, match="reversed sign"):
        IdentifiedDamper(MEGANE, law.replace(polarity=-1))
    with pytest.raises(InputError):
        IdentifiedDamper(MEGANE, Guo6())  # type: ignore[arg-type]
    with pytest.raises(InputError, match="form"):
        IdentifiedDamper(MEGANE, law, form="shifted")
    run = QuarterCar(MEGANE, damper(1), lift_off=False).run(np.zeros(10), STEP)
    wrong = replace(run, sample_time=1e-3)
    with pytest.raises(InputError, match="at the damper's rate"):
        IdentifiedDamper(MEGANE, law).along(wrong)
    bent = law.at_clock(STEP)
    zones = bent.replace(input_stage=ThreeZoneStage(), b=bent.b[:, :, :1])
    with pytest.raises(InputError, match="shaped by a tanh"):
        IdentifiedDamper(MEGANE, LpvArx(order=1, stored=Held(zones, ONE).to_dict()))
    with pytest.raises(InputError, match="read the present current"):
        IdentifiedDamper(MEGANE, LpvArx(order=1, stored=Held(bent.replace(lagged=True), ONE).to_dict()))


@pytest.mark.thinned(4, "slow", "seconds")
@pytest.mark.parametrize("which, centre", [("plain", 1.25), ("moving knee", 1.25), ("embedded", 0.3),
                                           ("embedded", 1.25)])
def test_a_ramped_force_is_the_nonlinear_car(which: str, centre: float) -> None:
    # no gap left but the tolerance of the car's implicit solution, 1e-8 of the force at every step; the embedded damper
    # frozen at 1.25 A is unstable in the car, so that rounding grows over a replay
    laws = {"plain": damper(2), "moving knee": damper(1, slope=0.008, affine=-15.0), "embedded": identified_damper()}
    run = QuarterCar(MEGANE, laws[which], lift_off=False).run(*_long(800))
    embedding = RampedDamper(MEGANE, laws[which], centre).around(run)
    path, model = embedding.along(run), embedding.system
    phi = model.basis.evaluate(path.scheduling)
    ahead, out = (np.einsum("km,mij,kj->ki", phi, x, path.states) + np.einsum("km,mij,kj->ki", phi, y, path.inputs)
                  for x, y in ((model.A, model.B), (model.C, model.D)))
    scale = np.abs(path.states).max(axis=0)
    assert (np.abs(ahead[:-1] - path.states[1:]).max(axis=0) / scale).max() < 1e-7
    np.testing.assert_allclose(out[:, 0], run["body_acceleration"], atol=1e-6 * np.abs(run["body_acceleration"]).max())
    assert embedding.region.contains(path.scheduling).all()
    if (which, centre) != ("embedded", 1.25):
        assert (np.abs(replay(embedding, run) - path.states).max(axis=0) / scale).max() < 1e-5


def test_a_damper_that_does_not_act_at_once_needs_no_ramp() -> None:
    late = damper(1).at_clock(STEP)
    b = late.b.copy()
    b[0] = 0.0
    with pytest.raises(InputError, match="acts at once"):
        RampedDamper(MEGANE, LpvArx(order=1, stored=Held(late.replace(b=b), ONE).to_dict()))


@pytest.mark.seconds
def test_runs_side_by_side_are_those_of_each_car_alone() -> None:
    law = damper(2, 0.008, -15.0)
    car = QuarterCar(MEGANE, law, lift_off=False)
    found = driven(MEGANE, law, (0.0, 2.0))
    assert len(found) == 9
    for name in ("ISO C, 20 m/s, lowest current", "ISO D, 20 m/s, random current", "bump, 50 mm, random current"):
        run = found[name]
        alone = car.run(run["road"], STEP, run["command"])
        for signal in ("suspension_velocity", "damper_force", "body_acceleration", "current"):
            np.testing.assert_allclose(run[signal], alone[signal], atol=1e-6 * np.abs(alone[signal]).max())


def test_a_run_that_leaves_all_bounds_is_named() -> None:
    model = damper(2).at_clock(STEP)
    gives = Identified.of(model.replace(b=-20 * model.b), "gives energy")
    with pytest.raises(InputError, match=r"leaves all bounds on (ISO|bump).* current"):
        driven(MEGANE, gives, (0.0, 2.0))


@pytest.mark.seconds
def test_currents_outside_the_fit_are_stated() -> None:
    law = identified_damper()
    assert law.current_range is not None
    with pytest.warns(ExtrapolationWarning, match="outside the fitted"):
        driven(MEGANE, law, (0.0, law.current_range[1] + 0.5))
