"""How far a stability statement reaches: the parts of the stability report that are made when requested."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lpvid.analysis.certificates import Rate
from lpvid.analysis.certified_margins import LargestRange, LargestRate, certified_share, largest_range, largest_rate
from lpvid.analysis.frozen import Model
from lpvid.analysis.gain import Gain, l2_gain
from lpvid.analysis.stability_certificate import StabilityCertificate
from lpvid.analysis.uncertainty import StabilityProbability
from lpvid.identification.layout import ParameterCloud
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization import realize
from lpvid.report.formatting import number, percent
from lpvid.report.page import Item, Notes, PageTable
from lpvid.units import quotient

UNCONSTRAINED = "the covariance leaves out the constraint of passivity, which the estimate keeps and draws would not"


@dataclass(frozen=True)
class Questions:
    """What to add to the report.

    Attributes
    ----------
    range, rate, gain : bool
    draws : int
        Models to draw from the parameters' covariance; 0 for none.
    """

    range: bool = False
    rate: bool = False
    gain: bool = False
    draws: int = 0


@dataclass(frozen=True, eq=False)
class StabilityAnswers:
    """Answers to `Questions`; None where there was no question, or no answer (see `notes`).

    Attributes
    ----------
    largest_range : LargestRange or None
        Widest range of the scheduling for which a certificate was found.
    largest_rate : LargestRate or None
        Fastest scheduling for which one was found.
    draws : StabilityProbability or None
        Share of drawn models that the same certificate covers.
    l2_gain : Gain or None
        Induced gain, bounded from both sides.
    gain_unit : str
        Its unit, e.g. "N/(m/s)"; "SI" where the inputs or the outputs have different ones.
    notes : tuple of str
        Why a question has no answer.
    """

    largest_range: LargestRange | None = None
    largest_rate: LargestRate | None = None
    draws: StabilityProbability | None = None
    l2_gain: Gain | None = None
    gain_unit: str = ""
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict:
        """Their keys in stability.json.

        Returns
        -------
        dict
            Plain values by name.
        """
        return {name: None if (found := getattr(self, name)) is None else found.to_dict()
                for name in ("largest_range", "largest_rate", "draws", "l2_gain")}

    def lines(self) -> list[str]:
        """One line for each answer.

        Returns
        -------
        list of str
            For the terminal, the notes last; the induced gain may take two.
        """
        found: list[str] = [str(x) for x in (self.largest_range, self.largest_rate) if x is not None]
        if self.draws is not None:
            found.append(_share_in_words(self.draws))
        if self.l2_gain is not None:
            found.append(f"induced gain [{self.gain_unit or '1'}]: " + str(self.l2_gain).splitlines()[0])
            found += [line.strip() for line in str(self.l2_gain).splitlines()[1:2]]
        return [*found, *self.notes]

    def items(self) -> list[Item]:
        """For the page.

        Returns
        -------
        list of Item
            A table of the answers, then the notes; empty without questions.
        """
        rows: list[tuple[str, str]] = []
        if self.largest_range is not None:
            rows.append(("largest certified range", str(self.largest_range).removeprefix("largest certified range: ")))
        if self.largest_rate is not None:
            rows.append(("largest certified rate", str(self.largest_rate).removeprefix("largest certified rate: ")))
        if self.draws is not None:
            rows.append(("certificate under the parameters' uncertainty", _share_in_words(self.draws)))
        if self.l2_gain is not None:
            gain = self.l2_gain
            rows += [("induced gain, certified", f"{number(gain.upper, 6, self.gain_unit)} ({gain.verdict})"),
                     ("induced gain, reached", number(gain.lower, 6, self.gain_unit)
                      + (f": {gain.worst}" if gain.worst else ""))]
        items: list[Item] = [PageTable((), tuple(rows), "Every bound was re-checked with numpy.")] if rows else []
        return items + ([Notes(self.notes)] if self.notes else [])


NOTHING = StabilityAnswers()
"""No question."""


def _share_in_words(draws: StabilityProbability) -> str:
    """The share with its interval."""
    return (f"the same matrices prove stability for {percent(draws.probability, 4)} of {draws.draws} drawn models "
            f"({draws.level:.0%} interval {percent(draws.interval[0], 4)} … {percent(draws.interval[1], 4)})")


def reach(model: Model, certificate: StabilityCertificate, rate: Rate, questions: Questions, seed: int,
          report_progress: Callable[[str], None]) -> StabilityAnswers:
    """Answers to the questions about one model and its certificate.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        With the range requested as its box.
    certificate : StabilityCertificate
    rate
        As for `certify_stability`.
    questions : Questions
    seed : int
        Of the draws.
    report_progress : callable
        Receives what is being done.

    Returns
    -------
    StabilityAnswers
        With None where there was no question.
    """
    notes: list[str] = []
    moves = any(up > low for low, up in zip(model.box.lower, model.box.upper, strict=True))
    if (questions.range or questions.rate) and not moves:
        notes.append("no scheduling variable moves: there is no largest range or rate")
    wide = speed = None
    if questions.range and moves:
        report_progress("the largest certified range")
        wide = largest_range(model, rate)
    if questions.rate and moves:
        report_progress("the largest certified rate")
        speed = largest_rate(model)
    share = None
    if questions.draws:
        report_progress("the certificate for drawn models")
        share, why = _share(model, certificate, questions.draws, seed)
        notes += [why] if why else []
    gain = None
    if questions.gain:
        report_progress("the induced gain")
        gain = _gain(model, rate)
    return StabilityAnswers(wide, speed, share, gain, _gain_unit(model), tuple(notes))


def is_constrained(model: Model) -> bool:
    """Whether a model was estimated under a constraint that its parameters' covariance leaves out.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        With its metadata.

    Returns
    -------
    bool
    """
    return "passive" in model.metadata


def _share(model: Model, certificate: StabilityCertificate, count: int, seed: int
           ) -> tuple[StabilityProbability | None, str]:
    cloud = ParameterCloud.of(model)
    if is_constrained(model):
        return None, f"{UNCONSTRAINED}: no models are drawn"
    if cloud is None:
        return None, "the covariance of the parameters is not known: no models can be drawn"
    if cloud.fault:
        return None, f"{cloud.fault}: no models can be drawn"
    if not certificate.verified:
        return None, "without a certificate there is no share of draws that it covers"
    return certified_share(certificate, cloud.draw(np.random.default_rng(seed), count)), ""


def _gain_unit(model: Model) -> str:
    """Unit of output over input behind any input stage; "SI" where several differ."""
    above, below = {s.unit for s in model.outputs}, {s.unit for s in model.filter_inputs}
    if len(above) > 1 or len(below) > 1:
        return "SI"
    over, under = above.pop(), below.pop()
    if over == under:
        return "1"
    return quotient(over, under)


def _gain(model: Model, rate: Rate) -> Gain:
    """The induced gain of the linear part, in a form that is exact while the scheduling moves."""
    if isinstance(model, LPVTransferFunction):
        model = realize(model, "observable" if model.lagged else "augmented").model
    assert isinstance(model, LPVStateSpace)
    return l2_gain(model, rate=np.inf if rate is None else rate)
