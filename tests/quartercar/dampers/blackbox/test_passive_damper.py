"""A passive lpv-arx: fitted, driven, and its balance of energy in a car."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.errors import InputError
from lpvid.record import Record
from quartercar.dampers import compare, fit
from quartercar.dampers.blackbox.lpv import LpvArx
from quartercar.dampers.evaluation.comparison import CompareSettings
from quartercar.dampers.evaluation.sampled_passivity import certificate_for, margin_of, stored_energy
from quartercar.parameters import MEGANE
from quartercar.vehicle.nonlinear import Coil, QuarterCar
from quartercar.vehicle.passivity_balance import ride_passivity

STEP = 1 / 500


@pytest.fixture(scope="module")
def runs() -> list[Record]:
    """(500 + 200 i) v + 400 i tanh(v/0.04), behind a lag of three samples: not passive."""
    rng, found = np.random.default_rng(0), []
    for name in ("a", "b"):
        v = 0.1 * np.convolve(rng.normal(size=2500), np.ones(8) / np.sqrt(8), "same")
        i = np.repeat(rng.uniform(0, 2.5, 50), 50)
        force, settled = np.zeros(v.size), (500 + 200 * i) * v + 400 * i * np.tanh(v / 0.04)
        for k in range(1, v.size):
            force[k] = 0.7 * force[k - 1] + 0.3 * settled[k]
        channels = {"velocity": v, "displacement": np.cumsum(v) * STEP, "current": i, "force": force - 40.0}
        found.append(Record(channels, STEP, name=name,
                            units={"velocity": "m/s", "displacement": "m", "current": "A", "force": "N"}))
    return found


@pytest.fixture(scope="module")
def passive(runs) -> LpvArx:
    found = fit(LpvArx(order=2, degree=1, passive=True), runs)
    assert any(n.startswith("what it costs") for n in found.notes)
    return found.damper


@pytest.mark.seconds
def test_the_setting_is_kept_and_the_damper_certified(passive):
    again = type(passive).from_dict(passive.to_dict())
    assert again.passive and certificate_for(again).verified
    assert not margin_of(passive).active


@pytest.mark.thinned(4, "slow", "seconds")
@pytest.mark.parametrize("current", [0.0, 1.2, 2.5, "jumping"])
def test_in_a_car_it_gives_no_more_than_it_has(passive, current):
    rng = np.random.default_rng(1)
    box = certificate_for(passive).box
    road = 0.02 * np.cumsum(rng.normal(size=1500)) * np.sqrt(STEP)
    command = (np.repeat(rng.uniform(box.lower[0], box.upper[0], 375), 4) if current == "jumping" else
               np.full(1500, np.clip(current, box.lower[0], box.upper[0])))
    run = QuarterCar(MEGANE, passive, coil=Coil(lowest=box.lower[0], highest=box.upper[0])).run(road, STEP, command)
    found = ride_passivity(run)
    assert found.storage == "known" and found.holds
    exchanged = float(np.sum(np.abs(run["damper_force"] * run["suspension_velocity"]))) * STEP
    assert found.lowest >= -1e-12 * exchanged  # zero to rounding


@pytest.mark.seconds
def test_stored_energy_stands_for_what_the_past_holds(passive):
    """By hand for two samples: x = [F(k−1), F(k−2), v(k−1), w(k−1)]."""
    certificate, stage = certificate_for(passive), passive.model.input_stage
    v, i, force = np.array([0.1, -0.2]), np.array([1.0, 1.0]), np.array([120.0, -50.0])
    found = stored_energy(passive, v, i, force)
    w = np.tanh(v / (stage.v0 + stage.slope * 1.0))
    x = np.array([[0, 0, 0, 0], [force[0], 0, v[0], w[0]], [force[1], force[0], v[1], w[1]]], dtype=float)
    p = certificate.storage_at(np.ones((3, 1)))
    assert found == pytest.approx(STEP * np.einsum("ni,nij,nj->n", x, p, x))
    assert stored_energy(passive, v, np.array([9.0, 9.0]), force) is None  # beyond what is certified


@pytest.mark.slow
def test_a_comparison_constrains_what_it_can_and_names_the_rest(runs):
    found = compare(runs, ["linear", "lpv-arx"], settings=CompareSettings(passive=True))
    assert found["lpv-arx"].damper.passive
    described = str(found)
    assert "lpv-arx, what it costs: training free-run ESR" in described
    assert "lpv-arx certified: passive" in described and "the laws of linear are checked instead" in described


@pytest.mark.slow
def test_an_unconstrained_fit_of_an_active_force_says_so(runs):
    late = [Record({n: (np.roll(r[n], 2) if n == "force" else r[n]) for n in r.channels}, STEP, units=r.units,
                   name=r.name) for r in runs]
    described = str(compare(late, ["lpv-arx"]))
    assert "lpv-arx is NOT passive" in described and "--passive" in described


def test_three_zones_cannot_be_passive():
    with pytest.raises(InputError, match="tanh"):
        LpvArx(shape="three-zone", passive=True)
