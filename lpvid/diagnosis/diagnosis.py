"""Diagnosis: what the simulation gets wrong, the causes, what the data cannot decide, and the gain."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from lpvid._shown import Shown
from lpvid.codec import UNWRITTEN, Encoded
from lpvid.diagnosis.localise import ErrorRegime
from lpvid.validation.figures import gain_percent

if TYPE_CHECKING:
    from lpvid.auditing import Audit
    from lpvid.diagnosis.evidence.calibration import Support
    from lpvid.effects.extended import ExtendedModel

VERDICTS = ("explained", "partly-explained", "unexplained", "nothing-to-explain", "cannot-tell")


@dataclass(frozen=True)
class Estimated(Encoded):
    """A number with its standard error, SI; or a choice, with what it means.

    Attributes
    ----------
    name : str
    value : float
    std : float or None
        In the unit of the value; None where it is not known, as at a bound.
    unit : str
    choice : str or None
        What the value means where it is a choice; None for a number.
    bound : {"lower", "upper"} or None
        End of the range of the search at which the value stands, so that it has no standard error; None inside.
    held : bool
        Whether it was not fitted.
    """

    name: str
    value: float
    std: float | None
    unit: str
    choice: str | None = field(default=None, metadata=UNWRITTEN)
    bound: str | None = field(default=None, metadata=UNWRITTEN)
    held: bool = field(default=False, metadata=UNWRITTEN)

    def __str__(self) -> str:
        if self.choice is not None:
            return f"{self.name} {self.choice}"
        error = "" if self.std is None else f" ± {self.std:.2g}"
        end = " (held)" if self.held else "" if self.bound is None else f" (its {self.bound} bound)"
        return f"{self.name} {self.value:.4g}{error} {self.unit}".rstrip() + end


@dataclass(frozen=True)
class Cause(Encoded):
    """A named cause.

    Attributes
    ----------
    name, description : str
    parameters : tuple of Estimated
    p_value : float
        Of the largest screening statistic, by flipping blocks.
    delta_bic : float or None
        BIC with it less BIC without it, the others in place; negative is evidence for it. None where no evidence is
        defined without it, as with a strength at its bound.
    share_alone, share_given_others : float
        Share of the baseline's excess squared error that it removes by itself; and in addition to the other causes.
    held_out_gain : float
        100 (1 − squared error with / without it) on held-out blocks, the others in place [%].
    blocks_better : float
        Share of the held-out blocks in which the error is lower with it.
    contribution : float
        Root mean square of what it adds to the output, in the output's unit.
    probability : float
        That it is present, calibrated on cases of two rigs.
    family : str
        Of causes.
    weight : float
        Posterior weight of the visited sets of causes that hold it.
    form : str or None
        Effect that simulates it in the extended model, where that is a special form which is not sure; else None.
    """

    name: str
    description: str
    parameters: tuple[Estimated, ...]
    p_value: float
    delta_bic: float | None
    share_alone: float
    share_given_others: float
    held_out_gain: float
    blocks_better: float
    contribution: float
    probability: float
    family: str
    weight: float
    form: str | None = field(default=None, metadata=UNWRITTEN)


@dataclass(frozen=True)
class Rivals(Encoded):
    """Causes that these data do not distinguish, and the experiment that would.

    Attributes
    ----------
    names : tuple of str
        The one of the most probable set first.
    similarity : float
        One less the probability of the first.
    experiment : str
        That would distinguish them.
    parameters : mapping of str to tuple of Estimated
        Of each in a set of its own.
    """

    names: tuple[str, ...]
    similarity: float
    experiment: str
    parameters: Mapping[str, tuple[Estimated, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class CannotTell(Encoded):
    """A candidate that these data could not reveal, and the measurement that would.

    Attributes
    ----------
    name : str
        Of the effect.
    reason : str
    smallest_detectable : float or None
        Strength from which on it is detectable, in `unit`; None where no strength is, or it could not be screened.
    unit : str
        Of the strength.
    experiment : str
        The measurement, in one sentence.
    """

    name: str
    reason: str
    smallest_detectable: float | None
    unit: str
    experiment: str

    @property
    def unmeasured(self) -> str:
        """The channels without which the cause could not be screened, with commas; empty where it could."""
        found = re.fullmatch(r"no (.+) was measured", self.reason)
        return "" if found is None else found[1]


@dataclass(frozen=True)
class Rejected(Encoded):
    """A candidate that was screened and not named.

    Attributes
    ----------
    name : str
        Of the effect.
    why : str
    """

    name: str
    why: str


@dataclass(frozen=True)
class VisitedSet(Encoded):
    """A visited set of causes, its posterior weight among these, and its error where it was measured.

    Attributes
    ----------
    names : tuple of str
        Of the effects; empty for the baseline alone.
    probability : float
    held_out_esr : float or None
        Free-run ESR; None where it was not measured.
    """

    names: tuple[str, ...]
    probability: float
    held_out_esr: float | None


@dataclass(frozen=True)
class SetProbabilities:
    """Weights of sets of causes, of families and of components.

    Attributes
    ----------
    families : mapping of str to float
        Probability that some cause of a family is there.
    nothing : float
        That none is.
    discrepancy : float
        Error of the law itself, a smooth function of its inputs, over the output: root mean squares.
    where : str
        Regimes that hold most of it.
    sets : tuple of VisitedSet
        Best first.
    components : mapping of str to Support
        Support for every component, wherever it sits, that some visited set holds; the most probable first.
    """

    families: Mapping[str, float]
    nothing: float
    discrepancy: float
    where: str
    sets: tuple[VisitedSet, ...]
    components: Mapping[str, Support] = field(default_factory=dict)

    @property
    def causes(self) -> dict[str, float]:
        """Probability of every component."""
        return {k: s.probability for k, s in self.components.items()}

    def to_dict(self) -> dict:
        """Keys of diagnosis.json, schema 2.

        Returns
        -------
        dict
            ``probabilities`` and ``weights`` of the components, ``families``, ``probability_of_nothing``,
            ``discrepancy`` and ``sets``.
        """
        return {"probabilities": self.causes, "weights": {k: s.weight for k, s in self.components.items()},
                "families": [{"name": n, "probability": p} for n, p in self.families.items()],
                "probability_of_nothing": self.nothing,
                "discrepancy": {"share": self.discrepancy, "where": self.where},
                "sets": [s.to_dict() for s in self.sets]}


@dataclass(frozen=True)
class Errors:
    """Free-run error of one model: ESR and rmse on training and held-out samples.

    Those of further records count every sample. Training samples, and those of two folds, are in the blocks: without
    the start-up and the end of each record and the first tenth of each block.

    Attributes
    ----------
    esr_training, esr_held_out : float
        Squared error over the output's squared deviation from its mean; 1 for a constant at that mean.
    rmse : float
        Root mean square of the error on held-out samples, in the output's unit.
    part : {"held-out", "training", "partly training"}
        What `esr_held_out` and `rmse` are of. "training": nothing was held out, as in an interrupted diagnosis, or
        nothing but rows of the training records; "partly training": further records hold some of these rows.
    """

    esr_training: float
    esr_held_out: float
    rmse: float
    part: str = "held-out"

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            ``esr`` with ``training`` and ``held_out`` (None unless `part` is "held-out"), and ``rmse``.
        """
        return {"esr": {"training": self.esr_training,
                        "held_out": self.esr_held_out if self.part == "held-out" else None}, "rmse": self.rmse}


@dataclass(frozen=True, eq=False)
class Diagnosis(Shown):
    """Verdict, causes, rivals and the extended model of a diagnosis.

    Attributes
    ----------
    verdict : str
        One of `VERDICTS`.
    reason : str
        One sentence for it.
    baseline : mapping
        Name and parameters.
    before, after : Errors
        Of the baseline and of the extended model, free run; held-out as `held_out` states.
    noise_floor : float or None
        Standard deviation of the error that does not repeat [output's unit]; None where nothing repeats.
    noise : mapping
        Colour of what is left, its level, what repeats, and the 95 % interval of the error that repeats.
    wrong : tuple of ErrorRegime
    causes : tuple of Cause
    rivals : tuple of Rivals
    cannot_tell : tuple of CannotTell
    rejected : tuple of Rejected
    explained_share : (float, float) or None
        Share of the excess squared error that the causes explain, and its standard error.
    held_out : str
        What the held-out figures were taken on.
    extended : ExtendedModel or None
    unit : str
        Of the output.
    audit : Audit or None
    evidence : mapping
        Per candidate: likelihood ratio, p-value, smallest detectable strength.
    seconds : float
    notes : tuple of str
        What was done to the data, and what to beware of.
    complete : bool
        False after an interruption.
    weights : SetProbabilities or None
        Of sets and families; None where no sets were evaluated.
    """

    verdict: str
    reason: str
    baseline: Mapping[str, Any]
    before: Errors
    after: Errors
    noise_floor: float | None
    noise: Mapping[str, Any]
    wrong: tuple[ErrorRegime, ...]
    causes: tuple[Cause, ...]
    rivals: tuple[Rivals, ...]
    cannot_tell: tuple[CannotTell, ...]
    rejected: tuple[Rejected, ...]
    explained_share: tuple[float, float] | None
    held_out: str
    extended: ExtendedModel | None
    unit: str
    audit: Audit | None = None
    evidence: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    seconds: float = 0.0
    notes: tuple[str, ...] = ()
    complete: bool = True
    weights: SetProbabilities | None = None

    @property
    def gain_percent(self) -> float:
        """100 (1 − ESR_extended/ESR_baseline), on the samples that `Errors.part` states."""
        before = self.before.rmse**2  # of the same samples, finite where their output is constant
        return gain_percent(before, self.after.rmse**2) if before > 0 else 0.0

    @property
    def stand_ins(self) -> tuple[str, ...]:
        """Effects of the extended model that are not named: they lower its error on data that its fit has not seen."""
        stated = {*(n for c in self.causes for n in (c.name, c.form)),
                  *(n for r in self.rivals for n in (*r.names, *r.parameters))}
        return () if self.extended is None else tuple(n for n in self.extended.effects if n not in stated)

    def to_dict(self) -> dict:
        """diagnosis.json.

        Returns
        -------
        dict
            Plain data for JSON of schema ``lpvid/diagnosis/2`` where sets were evaluated, else ``lpvid/diagnosis/1``.
        """
        share = self.explained_share
        return {
            "schema": f"lpvid/diagnosis/{1 if self.weights is None else 2}",
            "verdict": self.verdict, "reason": self.reason,
            "baseline": {**self.baseline, **self.before.to_dict(), "noise_floor": self.noise_floor},
            "unit": self.unit, "held_out": self.held_out, "noise": dict(self.noise),
            "wrong": [w.to_dict() for w in self.wrong],
            "causes": [c.to_dict() for c in self.causes],
            "rivals": [r.to_dict() for r in self.rivals],
            "cannot_tell": [c.to_dict() for c in self.cannot_tell],
            "rejected": [r.to_dict() for r in self.rejected],
            "explained_share": None if share is None else {"value": share[0], "std": share[1]},
            "extended": {**self.after.to_dict(), "gain_percent": self.gain_percent, "model": "extended_model.json",
                         "stand_ins": list(self.stand_ins)},
            "evidence": {k: dict(v) for k, v in self.evidence.items()}, "seconds": self.seconds,
            "notes": list(self.notes), "complete": self.complete,
            "audit": None if self.audit is None else self.audit.to_dict(),
            **({} if self.weights is None else self.weights.to_dict()),
        }

    def __repr__(self) -> str:
        lines = [f"{self.verdict}: {self.reason}",
                 f"  baseline {self.baseline.get('name')}: free-run ESR {self.before.esr_training:.4g} training"
                 + (f", {self.before.esr_held_out:.4g} held-out" if self.before.part == "held-out" else "")
                 + f" ({self.held_out}), {self.before.part} rmse {self.before.rmse:.4g} {self.unit}"]
        lines += [f"  cause {c.name}{f' as {c.form}' if c.form else ''}: {', '.join(map(str, c.parameters))}; "
                  f"held-out gain {c.held_out_gain:.1f} %, probability {c.probability:.2f}" for c in self.causes[:3]]
        lines += [f"  cannot be distinguished: {', '.join(r.names)}; {r.experiment}" for r in self.rivals[:2]]
        if self.extended is not None and self.extended.effects:
            other = f"; with {', '.join(self.stand_ins)}, not named" if self.stand_ins else ""
            lines.append(f"  extended model: free-run ESR {self.after.esr_held_out:.4g} {self.after.part}, "
                         f"gain {self.gain_percent:.1f} %{other}")
        if self.wrong:
            lines.append("  wrong above all: " + "; ".join(f"{w.where} ({w.share:.0%} of the error)"
                                                           for w in self.wrong[:3]) + ", training")
        if hidden := [c.name for c in self.cannot_tell if not c.unmeasured]:
            lines.append(f"  {len(hidden)} candidates these data could not reveal: " + ", ".join(hidden))
        if absent := [c.unmeasured for c in self.cannot_tell if c.unmeasured]:
            lines.append(f"  {len(absent)} need a channel that was not measured: " + "; ".join(dict.fromkeys(absent)))
        lines += [f"  note: {n}" for n in self.notes[:4]]
        return "\n".join(lines)
