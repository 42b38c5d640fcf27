"""What every control law must do: described, kept in a file, reading only what it names, within what a damper can."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.law_signals import HIGH, LOW, SETTING, force, seen

from lpvid import load, save
from quartercar import controllers as laws
from quartercar.controllers.contract import SIGNALS, Setting, start_together
from quartercar.parameters import MEGANE

EVERY = [name for name, _, _ in laws.LAWS if name not in ("scheduled", "identified-plant")]
NAMES = [name for name in EVERY if not name.startswith("lpv") and name != "mpc"]
"""those without a synthesis or a damper behind them"""
SECONDS = ("mpc", "lpv-hinf-identified")
"""laws whose kernels take longer to compile, or whose design takes longer, than those of all others together"""


@pytest.mark.parametrize("name", EVERY)
def test_says_what_it_is_and_comes_back_from_a_file(name: str, tmp_path):
    law = laws.law_class(name)()
    assert law.name == name and law.title and law.source
    assert set(law.reads) <= set(SIGNALS) and law.demands in ("force", "current")
    for p in law.parameters:
        assert np.isfinite([p.lower, p.upper]).all() and p.lower <= p.default <= p.upper and p.description
    moved = law.with_vector([0.5 * (p.lower + p.upper) for p in law.parameters])
    back = load(save(moved, tmp_path / "law.json"))
    assert type(back) is type(law) and dict(back.values) == dict(moved.values)


@pytest.mark.parametrize(("name", "ahead"), [
    pytest.param(n, k, marks=pytest.mark.seconds if n in SECONDS else ())
    for n, k in (*((n, 0) for n in EVERY), ("preview-lqr", 6), ("preview-lpv", 6), ("mpc", 6))])
def test_reads_nothing_else_and_cars_do_not_mix(name: str, ahead: int):
    law = laws.law_class(name)()
    rows = [seen(seed=k, ahead=ahead) for k in range(20)]
    setting = replace(SETTING, sample_time=1 / 512, preview=ahead)  # the damper's rate
    together = law.start(setting)
    all_at_once = np.array([together.step({n: s[n] for n in law.reads}) for s in rows])
    one = law.start(replace(setting, cars=1))
    alone = np.array([one.step({n: s[n][3:4] for n in law.reads}) for s in rows])
    np.testing.assert_array_equal(np.broadcast_to(all_at_once, (20, 7))[:, 3], alone[:, 0])
    assert np.isfinite(all_at_once).all()


@pytest.mark.parametrize("name", [n for n in NAMES if n != "passive"])
def test_force_is_one_that_a_damper_can_have(name: str):
    law = laws.law_class(name)().with_values(low_damping=LOW, high_damping=HIGH)
    s = seen(400, seed=2)
    v, f = s["suspension_velocity"], force(law, s)
    edges = np.sort([LOW * v, HIGH * v], axis=0)
    moving = np.abs(v) > 5e-3
    assert np.all((f >= edges[0] - 1e-9) & (f <= edges[1] + 1e-9) | ~moving)
    assert np.all(f * v >= -1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_laws_side_by_side_are_the_laws_alone(name: str):
    kind = laws.law_class(name)
    low, high = ([p.lower + share * (p.upper - p.lower) for p in kind().parameters] for share in (0.3, 0.6))
    pair = [kind().with_vector(low), kind().with_vector(high)]
    running = start_together(pair, Setting(0.002, 2, MEGANE))
    singles = [law.start(Setting(0.002, 1, MEGANE)) for law in pair]
    for k in range(10):
        s = seen(2, seed=k)
        both = running.step(s)
        each = [one.step({n: a[c:c + 1] for n, a in s.items()})[0] for c, one in enumerate(singles)]
        np.testing.assert_array_equal(both, each)
