"""Verdicts: what all findings together allow to say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.diagnosis.deciding import EXPLAINED, JudgedEffect
from lpvid.diagnosis.effect import Effect
from lpvid.diagnosis.selection import SIGNIFICANT

LEFT = 0.05
"""rms of the error that a regression on the inputs still predicts, as a share of the output's spread, beyond which
nothing counts as explained in full"""
LEAST, FORMS = 0.5, 0.9
"""share of the excess error to explain whatever its standard error; the second number for flexible forms"""
PARTLY = 0.9
"""share of the excess error, within two standard errors, below which causes, however steady, are not named"""
FOLLOWS = 0.1
"""share of the error that a regression on the inputs must predict to count as structure by itself"""
STAYS = 0.5
"""share of the squared error that must stay to be told beside what is explained of the excess"""
LOUD = 3.0
"""squared error over what repeats of the same input do not share of it, above which it is no noise, whatever it looks
like"""


@dataclass(frozen=True, eq=False)
class Findings:
    """What a verdict rests on.

    Attributes
    ----------
    named : sequence of Effect
        Causes that passed every gate.
    contested : sequence of (Effect, tuple of Effect)
        Causes that did but for their rivals, and these.
    dropped : sequence of Judged
        What was objected to.
    resembling : sequence of Effect
        Of the set, whose work functions of the inputs without a name do as well.
    beyond : float
        What these explain beyond the set, at most, as a share of what all causes win; 0 where that is not what is
        held against any.
    phi : (share, standard error) or None
        Of the excess error that the causes explain; None where there are none.
    predictable : float
        Share of the squared error they leave that a regression on the inputs still predicts; 0 where that is not sure.
    before, after : float
        Mean squared error out of fold of the baseline and of the set, in the output's unit squared.
    spread : float
        Of the output.
    unshared : float or None
        Variance of that part of the baseline's error which repeats of the same input do not share, by noise of its
        output and of its inputs; None where nothing repeats, or something is named.
    least : float
        Smallest p-value of the screening.
    coloured : bool
        Whether what is left is coloured.
    unit : str
        Of the output.
    """

    named: Sequence[Effect]
    contested: Sequence[tuple[Effect, tuple[Effect, ...]]]
    dropped: Sequence[JudgedEffect]
    resembling: Sequence[Effect]
    beyond: float
    phi: tuple[float, float] | None
    predictable: float
    before: float
    after: float
    spread: float
    unshared: float | None
    least: float
    coloured: bool
    unit: str


def described(f: Findings) -> tuple[str, str]:
    """Verdict and reason."""
    if not f.resembling:
        return _of_the_named(f)
    more = f", and explain {f.beyond:.0%} more" if f.beyond > 0 else ""
    alike = (f"{', '.join(e.name for e in f.resembling)} would do for a part, but functions of the inputs without a "
             f"name do that as well{more}")
    if f.phi is None:
        return "unexplained", alike
    verdict, reason = _of_the_named(f)
    return "partly-explained" if verdict == "explained" else verdict, f"{reason}; {alike}"


def _of_the_named(f: Findings) -> tuple[str, str]:
    """The same, whatever else stays in the simulation."""
    if f.phi is None:
        return _nothing(f)
    share, uncertain = f.phi
    causes = [*f.named, *(e for e, _ in f.contested)]
    forms = all(e.catch_all for e in causes)  # what is flexible has no excuse
    stated = ", ".join(e.name for e in causes)
    if not (share + 2 * uncertain >= EXPLAINED and share >= (FORMS if forms else LEAST)):
        partly = share + 2 * uncertain >= PARTLY and share >= LEAST and not forms
        word = "explains" if partly else "resembles it but explains"
        text = f"{stated} {word} {share:.0%} of the excess error only; the rest is unexplained"
        return ("partly-explained" if partly else "unexplained"), text
    left = float(np.sqrt(f.predictable * f.after)) / f.spread
    if left > LEFT and any(e.catch_all for e in causes):
        return "unexplained", (f"{stated} resembles it, but a flexible form is among them, and what is left still "
                               f"follows the inputs, by {left:.0%} of the output's spread")
    if not f.named:
        groups = "; ".join(f"{e.name} or {' or '.join(r.name for r in rivals)}" for e, rivals in f.contested)
        return "cannot-tell", f"these data cannot keep apart {groups}"
    text = f"{', '.join(e.name for e in f.named)} explains {min(share, 1.0):.0%} of the excess error"
    if f.contested:
        return "partly-explained", text + f"; {', '.join(e.name for e, _ in f.contested)} has rivals"
    if left > LEFT:
        text += f", but what is left still follows the inputs, by {left:.0%} of the output's spread"
        return "partly-explained", text
    if f.after > STAYS * f.before:
        text += f"; {min(f.after / f.before, 1.0):.0%} of the squared error stays, which looks like noise"
    return "explained", text


def _nothing(f: Findings) -> tuple[str, str]:
    """Without any cause: whether there is nothing to explain, or something that nobody explains."""
    small = all(j.minor for j in f.dropped)
    if f.least < SIGNIFICANT and not (f.dropped and small) and f.predictable:
        nearest = max(f.dropped, key=lambda j: j.won, default=None)
        why = f"; {nearest.effect.name} comes nearest, but {nearest.objections[0]}" if nearest else ""
        return "unexplained", "the error follows the inputs, but no candidate explains it" + why
    if f.predictable > FOLLOWS:
        return "unexplained", (f"a regression on the inputs predicts {f.predictable:.0%} of the error, "
                               "but no candidate does")
    left = f.after if small else f.before  # what is small stays in the simulation
    if f.unshared is not None and left > LOUD * f.unshared:
        return "unexplained", (f"the errors of repeats differ by {np.sqrt(2 * f.unshared):.3g} {f.unit} rms only, but "
                               f"no candidate explains the {np.sqrt(left):.3g} {f.unit} that are left")
    there = [j.effect.name for j in f.dropped if j.minor and j.p_value < SIGNIFICANT]
    if there and small:
        return "nothing-to-explain", f"{', '.join(there)} may be present, but too small to be worth naming"
    kind = "coloured noise" if f.coloured else "white noise"
    return "nothing-to-explain", f"what is left looks like {kind}: no candidate stands out over the blocks"
