"""E9 in continuous time: filter, conversion, reduction and replay of an identified damper in the car."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.known_dampers import ONE, STEP, damper, held_force_run, road_and_current

from lpvid.errors import InputError
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Polynomial
from quartercar.controllers.designed.damper_design import DamperTask, synthesized_gain
from quartercar.dampers import Guo6, LpvArx
from quartercar.dampers.blackbox.held import Held
from quartercar.lpv_models import ContinuousDamper, FrozenDamper, IdentifiedDamper, replay
from quartercar.lpv_models.frozen_damper import filtered, response
from quartercar.lpv_models.identified_study import EmbeddedDamper, conversion_error, frozen_stable, replay_error, study
from quartercar.parameters import MEGANE
from quartercar.rides.default_damper import identified_damper
from quartercar.vehicle.nonlinear import QuarterCar

CURRENTS = (0.0, 2.5)


def fourth_order() -> LpvArx:
    """`damper(2)` with two more poles and zeros, fast and almost upon each other."""
    model = damper(2).at_clock(STEP)
    q, r = np.array([1.0, -0.20, 0.05]), np.array([1.0, -0.203, 0.0505])
    a = np.zeros((4, 1, 1, 2))
    monic = np.concatenate([[[1.0, 0.0]], model.a[:, 0, 0]])
    for k in range(2):
        a[:, 0, 0, k] = np.convolve(monic[:, k], q)[1:]
    b = np.array([[np.convolve(model.b[:, 0, i, k], r) for k in range(2)] for i in range(2)])
    wide = LPVTransferFunction(a, np.moveaxis(b, 2, 0)[:, None], model.basis, STEP, model.box, model.c,
                               inputs=model.inputs, outputs=model.outputs, input_stage=model.input_stage,
                               scheduling_stage=model.scheduling_stage, noise_covariance=np.array([[900.0]]))
    return LpvArx(order=4, stored=Held(wide, ONE).to_dict())


@pytest.fixture(scope="module")
def embedded() -> EmbeddedDamper:
    return study(MEGANE, identified_damper(), CURRENTS)


@pytest.fixture(scope="module")
def reduced() -> EmbeddedDamper:
    return study(MEGANE, fourth_order(), CURRENTS)


# -- the filter --------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("order", [1, 2])
def test_the_added_force_is_that_of_e9(order: int) -> None:
    # f = g r δ where the knee does not move, with r of the discrete embedding
    law = damper(order, affine=-15.0)
    run = held_force_run(law, *road_and_current())
    frozen, discrete = FrozenDamper.of(law, 1.0), IdentifiedDamper(MEGANE, law, 1.0)
    path = discrete.along(run)
    wanted = frozen.settled * path.scheduling[:, 1] * path.inputs[:, 1]
    found = frozen.added(run["suspension_velocity"], run["damper_force"])
    np.testing.assert_allclose(found, wanted, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.parametrize("slope", [0.0, 0.008])
@pytest.mark.parametrize("centre", [0.0, 1.3])
def test_the_filter_gives_the_force_for_any_course_of_the_current(slope: float, centre: float) -> None:
    law = damper(2, slope, -10.0)
    run = held_force_run(law, *road_and_current())
    frozen = FrozenDamper.of(law, centre)
    v, force = run["suspension_velocity"], run["damper_force"]
    drive = np.column_stack([frozen.inputs(v), frozen.added(v, force)])
    _, found = filtered(frozen.continuous, drive, STEP)
    np.testing.assert_allclose(found[:, 0], force - frozen.rest, atol=1e-7 * np.abs(force).max())
    a, b, c, d = frozen.discrete
    x = np.linalg.solve(np.eye(2) - a, b @ drive[0])
    for k in range(200):
        assert abs((c @ x + d @ drive[k])[0] - force[k] + frozen.rest) < 1e-7 * np.abs(force).max()
        x = a @ x + b @ drive[k]


def test_the_conversion_bends_the_frequencies_alone() -> None:
    # tan(πfT)/(πT) for f: the same values, so that positive realness is carried over
    frozen = FrozenDamper.of(damper(2), 0.5)
    f = np.linspace(0.5, 250.0, 60)
    there = response(frozen.continuous, 2j * np.tan(np.pi * f * STEP) / STEP)
    np.testing.assert_allclose(there, response(frozen.discrete, np.exp(2j * np.pi * f * STEP)), rtol=1e-9)
    assert conversion_error(frozen, 5.0) < conversion_error(frozen, 25.0) < 0.02


# -- the plant ---------------------------------------------------------------------------------------------------------
@pytest.mark.slow
def test_the_nonlinear_car_is_replayed_within_the_stated_error(embedded: EmbeddedDamper) -> None:
    assert max(embedded.replay_error.values()) < 0.03 and embedded.output_error < 1e-3
    road, current = road_and_current(1500, seed=12)  # a road and currents that the study has not seen
    run = QuarterCar(MEGANE, identified_damper(), lift_off=False).run(road, STEP, current)
    assert replay_error(embedded.plant, run) < 0.05
    assert embedded.plant.limits is not None and embedded.plant.region.contains(
        embedded.plant.along(run).scheduling).mean() > 0.99


@pytest.mark.seconds
def test_a_lag_in_front_replays_the_added_force() -> None:
    law = damper(2)
    run = QuarterCar(MEGANE, law, lift_off=False).run(*_short())
    plant = ContinuousDamper(MEGANE, FrozenDamper.of(law, 1.0), lag=0.004).around(run)
    found, wanted = replay(plant, run), plant.along(run).states
    np.testing.assert_allclose(found[:, -1], wanted[:, -1], atol=1e-6 * np.abs(wanted[:, -1]).max())


def _short() -> tuple[np.ndarray, float, np.ndarray]:
    road, current = road_and_current(600)
    return road, STEP, current


def passive() -> LpvArx:
    """`damper(1)` with b_1 = b_0: (1 + z)/(z − α) is positive real for every α in (−1, 1)."""
    model = damper(1).at_clock(STEP)
    return LpvArx(order=1, stored=Held(model.replace(b=np.repeat(model.b[:1], 2, axis=0)), ONE).to_dict())


@pytest.mark.slow
def test_a_passive_damper_in_a_passive_car_loses_energy_by_itself() -> None:
    # positive real at every ρ_v on a grid; one storage function for all of them is found by the design, whose bound
    # without control is that of this plant
    frozen = FrozenDamper.of(passive(), 0.0)
    f = np.linspace(0.0, 255.0, 300)
    parts = response(frozen.discrete, np.exp(2j * np.pi * f * STEP))[:, 0]
    for rho in np.linspace(0.0, 1 / frozen.knee, 9):
        assert (parts[:, 0] + rho * parts[:, 1]).real.min() > 0
    assert frozen_stable(ContinuousDamper(MEGANE, frozen))
    found = synthesized_gain(DamperTask(MEGANE, passive(), CURRENTS))
    assert found.solved and found.between_grid
    p = found.certificate.matrices[0]
    for rho in found.closed_loop.box.grid(9)[:, 0]:
        a = found.closed_loop.frozen([rho, 0.0])[0]
        assert np.linalg.eigvalsh(p @ a + a.T @ p).max() < 0


@pytest.mark.slow
def test_reduction_drops_what_the_car_does_not_move(reduced: EmbeddedDamper) -> None:
    assert (reduced.full_order, reduced.order) == (4, 2)
    assert 0 < reduced.reduction_error <= 0.3 * 30.0  # the model's own error is 30 N
    kept = study(MEGANE, fourth_order(), CURRENTS, order=4)
    assert kept.order == 4 and kept.reduction_error < 1e-6
    assert max(reduced.replay_error.values()) < max(kept.replay_error.values()) + 0.05
    with pytest.raises(InputError, match="the damper's order in the plant"):
        study(MEGANE, fourth_order(), CURRENTS, order=5)


@pytest.mark.seconds
def test_the_study_says_what_it_found(embedded: EmbeddedDamper) -> None:
    text, kept = str(embedded), embedded.to_dict()
    assert "damper about 0 A" in text and "free-run replay" in text and "as identified" in text
    assert kept["damper_order"] == 2 and kept["secant"][1] == pytest.approx(1 / embedded.plant.frozen.knee)
    assert kept["conversion_error"] < 0.02 and kept["force_per_current"][0] < 0 < kept["force_per_current"][1]


# -- what cannot be embedded -------------------------------------------------------------------------------------------
def _active(model: LPVTransferFunction) -> LpvArx:
    return LpvArx(order=2, stored=Held(model.replace(b=-model.b), ONE).to_dict())


@pytest.mark.slow
def test_what_cannot_be_embedded() -> None:
    with pytest.raises(InputError, match="needs an identified transfer function"):
        FrozenDamper.of(Guo6(), 0.0)
    with pytest.raises(InputError, match="needs an identified damper"):
        study(MEGANE, Guo6(), CURRENTS)
    with pytest.raises(InputError, match=r"leaves all bounds|at no current"):
        study(MEGANE, _active(damper(2).at_clock(STEP)), CURRENTS)
    with pytest.raises(InputError, match="centre of the plant"):
        study(MEGANE, damper(2), CURRENTS, centre=3.0)
    still = damper(1).at_clock(STEP)
    fixed = LPVTransferFunction(still.a[..., :1], still.b[..., :1], Polynomial((), 0), STEP, inputs=still.inputs,
                                outputs=still.outputs, input_stage=still.input_stage)
    with pytest.raises(InputError, match="does not read the current"):
        FrozenDamper.of(LpvArx(order=1, stored=Held(fixed, ONE).to_dict()), 0.0)
    with pytest.raises(InputError, match="limited by recorded runs"):
        ContinuousDamper(MEGANE, FrozenDamper.of(damper(1), 0.0)).system
    run = QuarterCar(MEGANE, damper(1), lift_off=False).run(np.zeros(50), STEP)
    with pytest.raises(InputError, match="damper's rate"):
        ContinuousDamper(MEGANE, FrozenDamper.of(damper(1), 0.0)).along(
            type(run)(1e-3, run.signals, run.units, run.static_load, run.car))


@pytest.mark.slow
def test_a_centre_where_the_car_grows_is_refused() -> None:
    # the embedded damper gives energy at the knee from about half an ampere on (frozen, at small velocities)
    with pytest.raises(InputError, match=r"frozen at 1\.25 A is not stable"):
        study(MEGANE, identified_damper(), CURRENTS, centre=1.25)
