"""What may be said of which findings."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from helpers.toy_diagnosis import Cubic, Dry, Late

from lpvid.diagnosis.verdicts import Findings, described


class Form(Cubic):
    catch_all = True


NOTHING: dict[str, Any] = {
    "named": [], "contested": [], "dropped": [], "resembling": [], "beyond": 0.0, "phi": None, "predictable": 0.0,
    "before": 1.0, "after": 1.0, "spread": 10.0, "unshared": None, "least": 0.5, "coloured": False, "unit": "N"}


def description(**found: Any) -> tuple[str, str]:
    return described(Findings(**{**NOTHING, **found}))


def dropped(minor: bool, p_value: float = 0.001) -> SimpleNamespace:
    return SimpleNamespace(effect=Dry(), minor=minor, p_value=p_value, won=1.0, objections=("it is not steady",))


@pytest.mark.parametrize(("found", "verdict", "part"), [
    ({}, "nothing-to-explain", "white noise"),
    ({"coloured": True}, "nothing-to-explain", "coloured noise"),
    ({"unshared": 0.9}, "nothing-to-explain", "white noise"),
    ({"unshared": 0.02}, "unexplained", "the errors of repeats differ by 0.2 N rms only"),
    ({"unshared": 0.02, "dropped": [dropped(minor=True)]}, "unexplained", "the errors of repeats"),
    ({"unshared": 0.02, "after": 0.03, "dropped": [dropped(minor=True)]}, "nothing-to-explain", "dry may be present"),
    ({"predictable": 0.3}, "unexplained", "predicts 30% of the error"),
    ({"predictable": 0.05}, "nothing-to-explain", "white noise"),
    ({"predictable": 0.05, "least": 0.01, "dropped": [dropped(minor=False)]}, "unexplained",
     "dry comes nearest, but it is not steady"),
    ({"phi": (0.99, 0.01), "named": [Dry()]}, "explained", "dry explains 99%"),
    ({"phi": (0.96, 0.0), "named": [Dry()], "predictable": 0.5, "after": 4.0}, "partly-explained", "by 14%"),
    ({"phi": (0.99, 0.0), "named": [Dry(), Form()], "predictable": 0.5, "after": 4.0}, "unexplained", "flexible form"),
    ({"phi": (0.99, 0.0), "named": [Dry(), Form()]}, "explained", "dry, cubic explains 99%"),
    ({"phi": (0.92, 0.0), "named": [Dry()]}, "partly-explained", "explains 92% of the excess error only"),
    ({"phi": (0.7, 0.0), "named": [Dry()]}, "unexplained", "resembles it but explains 70%"),
    ({"phi": (0.4, 0.5), "named": [Dry()]}, "unexplained", "resembles it"),
    ({"phi": (1.0, 0.0), "contested": [(Dry(), (Cubic(),))]}, "cannot-tell", "dry or cubic"),
    ({"resembling": [Dry()], "beyond": 0.2}, "unexplained", "dry would do for a part, but functions of the inputs"),
    ({"phi": (1.0, 0.0), "named": [Dry()], "after": 0.89}, "explained",
     "of the excess error; 89% of the squared error stays, which looks like noise"),
    ({"phi": (1.0, 0.0), "named": [Late()], "resembling": [Dry()], "beyond": 0.2, "after": 0.1}, "partly-explained",
     "late explains 100% of the excess error; dry would do for a part"),
    ({"phi": (0.5, 0.0), "named": [Late()], "resembling": [Dry()], "beyond": 0.2}, "unexplained", "dry would do"),
    ({"phi": (1.0, 0.0), "contested": [(Late(), (Cubic(),))], "resembling": [Dry()], "beyond": 0.2}, "cannot-tell",
     "late or cubic; dry would do"),
    ({"phi": (1.0, 0.0), "named": [Late()], "contested": [(Dry(), (Cubic(),))]}, "partly-explained", "dry has rivals"),
])
def test_told(found: dict[str, Any], verdict: str, part: str) -> None:
    got = description(**found)
    assert got[0] == verdict and part in got[1]
