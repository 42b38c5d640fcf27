"""Passivity and polarity of dampers against closed forms."""

from __future__ import annotations

import json

import numpy as np
import pytest
from helpers.toy_dampers import Redundant, Tanh, record, sweep

from lpvid import InputError, Record
from quartercar.dampers import Linear, check_passivity, fit
from quartercar.dampers.evaluation.passivity import FREQUENCIES
from quartercar.dampers.polarity import common_polarity, polarity_of


def test_negative_damping_gives_most_at_the_greatest_speed() -> None:
    found = check_passivity(Tanh(values={"height": 0.0, "damping": -300.0}), speed=1.5)
    assert not found.passive
    assert found.power == pytest.approx(-300 * 1.5**2)
    assert abs(found.power_at[0]) == pytest.approx(1.5)
    assert found.work_share == pytest.approx(-1.0)
    assert "NOT passive" in str(found) and "\n" not in str(found)


def test_a_wrong_sign_of_the_tanh_is_found_where_it_gives_most() -> None:
    found = check_passivity(Tanh(values={"height": -600.0, "sharpness": 20.0, "damping": 1500.0}))
    v = np.linspace(0, 2, 2_000_001)
    power = (1500 * v - 600 * np.tanh(20 * v)) * v
    assert not found.passive and not found.stored
    assert found.power == pytest.approx(power.min(), rel=1e-4)
    assert abs(found.power_at[0]) == pytest.approx(v[power.argmin()], abs=0.01)


@pytest.mark.parametrize(("mass", "passive"), [(0.0, True), (2.0, True), (40.0, True)])
def test_inertia_stores_but_never_gives_net_work(mass: float, passive: bool) -> None:
    """F = m a + c v leads v by φ = atan(mω/c): work over energy exchanged is π cos φ/(2 (cos φ asin cos φ + sin φ))."""
    found = check_passivity(Linear(values={"damping": 500.0, "mass": mass, "stiffness": 9000.0, "offset": -70.0}))
    phi = np.arctan(mass * 2 * np.pi * FREQUENCIES[-1] / 500.0)
    cosine = np.cos(phi)
    share = 0.5 * np.pi * cosine / (cosine * np.arcsin(cosine) + np.sin(phi))
    assert found.passive is passive
    assert found.work_share == pytest.approx(share, abs=2e-4)


def test_a_small_loss_near_zero_velocity_is_stored_energy() -> None:
    small = Tanh(values={"height": -1.0, "sharpness": 1e4, "damping": 200.0})
    assert not check_passivity(small).passive  # a law of the velocity alone has nowhere to store it
    found = check_passivity(small.replace(in_place=True))
    assert found.passive and found.stored and found.power < 0
    assert "stored energy" in str(found)
    wide = check_passivity(small.replace(in_place=True).with_values(height=-20.0))
    assert not wide.passive and wide.power == pytest.approx(-0.5, rel=1e-3)  # −A²/4c at v = A/2c


def test_every_current_of_the_fitted_range_is_asked() -> None:
    damper = Tanh(per_current=0.4, values={"height": 0.0, "damping": 1000.0}, current_range=(0.0, 2.0))
    assert check_passivity(damper).passive
    beyond = check_passivity(damper.replace(current_range=(0.0, 3.0)))
    assert not beyond.passive and beyond.power_at[1] == 3.0
    assert beyond.power == pytest.approx(1000 * (1 - 0.4 * 3) * 4)


def test_ripple_of_the_current_is_seen_by_the_fit_but_not_asked_for_passivity() -> None:
    """F = 1000 (1 − 0.4 i) v gives energy above 2.5 A, where eight samples of 3000 are."""
    v, rng = sweep(), np.random.default_rng(3)
    steps = np.repeat(rng.integers(0, 3, v.size // 200 + 1), 200)[:v.size].astype(float)
    steps[::400] = 3.0
    law = Tanh(per_current=0.4)
    found = fit(law, record(v, 1000 * (1 - 0.4 * steps) * v + rng.normal(size=v.size), steps))
    assert found.damper.current_range == (0.0, 3.0) and found.damper.usual_currents == (0.0, 2.0)
    assert found.passivity.passive and not found.flags
    assert not found.damper.replace(metadata={}).passivity().passive
    again = Tanh.from_dict(json.loads(json.dumps(found.damper.to_dict())))
    assert again.usual_currents == (0.0, 2.0) and again.passivity().passive
    assert found.damper.replace(current_range=(0.0, 1.0)).usual_currents == (0.0, 1.0)


def test_the_verdict_is_on_the_damper_whatever_the_polarity() -> None:
    damper = Linear(polarity=-1)
    assert damper.passivity().passive
    assert damper.passivity().to_dict() == Linear().passivity().to_dict()


def test_a_damper_that_does_nothing_is_passive() -> None:
    assert check_passivity(Tanh(values={"height": 0.0, "damping": 0.0})).passive


def test_a_speed_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="speed must be positive"):
        check_passivity(Redundant(), speed=0.0)


def test_polarity_of_records() -> None:
    v = sweep()
    noise = np.random.default_rng(0).normal(size=v.size)
    assert polarity_of(record(v, 200 * v + 20 * noise)).sign == 1
    turned = polarity_of(record(v, -200 * v + 500 + 20 * noise))
    assert turned.sign == -1
    assert turned.power == pytest.approx(-200 * np.var(v), rel=0.05)
    assert polarity_of(record(v, 1000 * noise)).sign == 0
    assert polarity_of(record(v[:50], 200 * v[:50])).sign == 0


@pytest.mark.parametrize("cycles", [0.2, 0.45, 0.75, 0.9, 1.2])
@pytest.mark.parametrize("phase", np.linspace(0, 6, 9))
def test_less_than_a_cycle_against_a_spring_decides_nothing_wrong(cycles: float, phase: float) -> None:
    """F = c v + k x with k/(cω) = 7: over a part of a cycle the spring gives up to ½kX², the damper takes πcωX²."""
    omega, rng = 2 * np.pi * 0.1, np.random.default_rng(1)
    angle = phase + omega * np.arange(0.0, cycles / 0.1, 0.02)
    x, v = 0.025 * np.sin(angle), 0.025 * omega * np.cos(angle)
    found = polarity_of(record(v, 2000 * v + 7 * 2000 * omega * x + 0.1 * rng.standard_normal(v.size)))
    assert found.sign in ((0,) if cycles < 0.5 else (0, 1)), found


def test_slow_parts_do_not_contradict_the_fast_records() -> None:
    """A quarter cycle towards the middle gives the spring's energy: alone it would vote against every other record."""
    omega, t = 2 * np.pi * 0.05, np.arange(0.0, 5.0, 0.002)
    x, v = 0.025 * np.cos(omega * t), -0.025 * omega * np.sin(omega * t)
    slow = record(v, 300 * v + 9000 * x, name="slow")
    assert np.mean(slow["force"] * v) < 0 and polarity_of(slow).sign == 0
    fast = record(sweep(), 300 * sweep(), name="fast")
    assert common_polarity([slow, fast, slow]) == 1
    assert common_polarity([slow, fast.flip("force")]) == -1


def test_records_that_disagree_are_named() -> None:
    v = sweep()
    good, bad = record(v, 200 * v, name="good"), record(v, -200 * v, name="bad")
    quiet = record(v, np.random.default_rng(0).normal(size=v.size), name="quiet")
    assert common_polarity([good, quiet]) == 1
    assert common_polarity([bad, quiet]) == -1
    assert common_polarity([quiet]) == 0
    with pytest.raises(InputError, match=r"reversed: 'bad'\..*--flip force"):
        common_polarity([good, good, bad, quiet])
    with pytest.raises(InputError, match=r"not reversed: 'good'"):
        common_polarity([good, bad, record(v, -300 * v, name="worse")])


def test_a_statement_names_no_current_of_a_law_without_and_says_what_the_records_never_reached():
    giving = Tanh(values={"height": 0.0, "damping": -300.0})
    assert " A" not in str(check_passivity(giving))
    known = giving.replace(metadata={"training": {"ranges": {"velocity": [-0.1, 0.13]}}})
    assert known.largest_speed == 0.13 and giving.largest_speed is None
    text = check_passivity(known).description
    assert text.count("beyond the 0.13 m/s of the training records") == ("up to" in text)
    only_fast = known.with_values(height=600.0, sharpness=20.0, damping=-400.0)  # 600 tanh(20 v) > 400 v up to 1.5 m/s
    text = check_passivity(only_fast).description
    assert "beyond the 0.13 m/s of the training records" in text and " A" not in text
    still = known.replace(metadata={"training": {"ranges": {"velocity": [-3.0, 3.0]}}})
    assert "beyond" not in check_passivity(still).description


@pytest.mark.parametrize("sign", [1, -1])
def test_many_pieces_of_less_than_a_cycle_decide_together(sign: int) -> None:
    """Twenty-four pieces of .4 cycles, as a logger's dropouts leave them, against a spring of 7 cω."""
    omega, rng, pieces = 2 * np.pi * 1.3, np.random.default_rng(4), []
    for k in range(24):
        angle = 1.1 * k + omega * np.arange(0.0, 0.31, 0.002)
        x, v = 0.01 * np.sin(angle), 0.01 * omega * np.cos(angle)
        force = sign * 900 * v + 7 * 900 * omega * x - 80 + 4 * rng.standard_normal(v.size)
        pieces.append(Record({"displacement": x, "velocity": v, "force": force}, sample_time=0.002, name=f"run#{k + 1}",
                             units={"displacement": "m", "velocity": "m/s", "force": "N"}))
    assert all(polarity_of(p).sign == 0 for p in pieces)
    assert common_polarity(pieces) == sign
    assert common_polarity(pieces[:10]) == 0
    aimless = [p.with_channel("force", 50 * rng.standard_normal(p.n_samples), "N") for p in pieces]
    assert common_polarity(aimless) == 0
