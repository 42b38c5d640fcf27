"""LPV structures with what causes require of them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.toy_viscous import CATALOGUE, DRY, NOISE, Added, measured, sign

import lpvid as lpv
from lpvid.condition.derivation import derived
from lpvid.effects import LpvChange
from lpvid.effects.lpv_extension import LpvExtension, common_structure, enlarged, measured_extension
from lpvid.errors import InputError


@pytest.mark.parametrize(("low", "high", "scheduled"), [(0.0, 0.04, True), (0.0, 1.0, True), (3.0, 3.059, False),
                                                        (0.5, 0.5, False)])
def test_a_current_schedules_where_a_model_can_be_scheduled_on_it(low: float, high: float, scheduled: bool) -> None:
    """0.04 A are all of a small coil's current, and 0.059 A of 3 A are 2 %: what counts is the share, not ampere."""
    n = 400
    rng = np.random.default_rng(0)
    channels = {"velocity": (rng.standard_normal(n), "m/s"), "force": (rng.standard_normal(n), "N"),
                "current": (np.linspace(low, high, n), "A")}
    record = lpv.Record({k: lpv.Channel(*v) for k, v in channels.items()}, 0.01, name="run")
    found = common_structure([record], "force")
    assert found is not None and found.basis.names == (("current",) if scheduled else ())


def test_an_lpv_structure_takes_in_what_the_causes_ask_for():
    record = derived([measured()])[0]
    start = lpv.ARX(2, 2, 1, basis=lpv.Polynomial(("velocity_sign",), 1))
    changes = [LpvChange("", degree=1, order=1), LpvChange("", regressors=("displacement", "1", "velocity|velocity|")),
               LpvChange("", schedule_filter="rise-fall"), LpvChange("", schedule_filter="delay")]
    wide = enlarged(start, changes, [record])
    assert wide.na == 3 and wide.width == (3, 3, 3) and wide.delay == (1, 1, 1) and wide.affine == 1
    assert wide.input == ("velocity", "displacement", "velocity_square") and wide.basis.degree == 2
    assert wide.schedule_filter == "rise-fall-delay"
    with pytest.raises(InputError, match="needs temperature"):
        enlarged(start, [LpvChange("", schedule=("temperature",))], [record])


@pytest.mark.parametrize(("before", "after", "end"), [(0.4, 0.1, "held-out"), (0.1, 0.2, "; no gain"),
                                                    (1.4, 1.5, "no better than the mean of these data")])
def test_an_lpv_extension_that_gains_nothing_says_so(before, after, end):
    runs = [SimpleNamespace(held_out=SimpleNamespace(overall=SimpleNamespace(free_run=SimpleNamespace(esr=e))))
            for e in (before, after)]
    assert str(LpvExtension(*runs, ("a constant as a further input",), ())).endswith(end)


def test_the_lpv_extension_gains_what_the_cause_costs():
    """On y = slope v + friction sign v + noise: without the sign the error is bounded below, with it only noise is."""
    found = measured_extension([measured()], lpv.ARX(0, 1, 0), [DRY, CATALOGUE[1]], [measured(1)])
    other = measured(1)
    floor = NOISE**2 / np.var(other["force"])
    assert found.esr[1] == pytest.approx(floor, rel=0.1) and found.esr[0] > 3 * floor
    assert found.gain_percent == pytest.approx(100 * (1 - found.esr[1] / found.esr[0]))
    assert found.left_out == ("square: no LPV structure represents it",) and found.changes == ("dry: sign",)
    assert lpv.validate(found.extended.model, other).overall.free_run.esr == pytest.approx(found.esr[1])


def test_the_lpv_extension_leaves_a_filter_out_where_the_scheduling_rests():
    """Held currents do not show a lag: `identify` refuses such a filter, and the extension goes on without it."""
    lag = Added("lag", sign, change=LpvChange("scheduled on the lagged current", schedule_filter="lag"))
    runs = [measured(k, current=np.full(4000, float(k))) for k in (0, 1)]
    structure = lpv.ARX(0, 1, 0, basis=lpv.Polynomial("current", 1))
    found = measured_extension(runs, structure, [DRY, lag], [measured(2, current=np.ones(4000))])
    assert found.left_out == ("lag: current is constant within every record",) and found.changes == ("dry: sign",)
