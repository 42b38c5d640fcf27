"""Whether a form may be used where the scheduling moves: its gap against what the model gets wrong anyway."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lpvid.codec import Encoded
from lpvid.record import Record
from lpvid.simulation import _outputs, simulate

if TYPE_CHECKING:
    from lpvid.realization.realization import Realization

VERDICTS = ("safe", "costs", "not safe")


@dataclass(frozen=True)
class Judgement(Encoded):
    """A form's gap beside the model's own error, both in free run on measured records and relative to the output.

    With e the ESR of the transfer function, f that of the form on the same records, and g the difference between the
    two runs over the variance of the output, (√e − √g)² ≤ f ≤ (√e + √g)², and f = e + g where gap and error are
    unrelated. What the form costs is f − e ::

        safe       f − e ≤ s   no more than these records leave open about e itself
        costs      f − e ≤ e   the conversion gets less wrong than the model does
        not safe   f − e > e   the conversion gets more wrong than all that the model does

    s is the standard error of e by batch means over blocks of ⌊√n⌋ samples (Flegal & Jones 2010), which are long enough
    for errors that are correlated in time. No limit is set by hand.

    Attributes
    ----------
    own : (n_outputs,) tuple of float
        e, the transfer function's pooled ESR.
    spread : (n_outputs,) tuple of float
        s.
    gap : (n_outputs,) tuple of float
        g, over the measured output's variance (`Gap.esr` is over the simulated one's).
    form : (n_outputs,) tuple of float
        The form's own pooled ESR; inf where it diverges.
    label : str
        "training", "held-out", or "" where the caller gave none.
    """

    JSON = ("verdict", "label", ("own_esr", "own"), ("own_esr_std", "spread"), ("gap_esr", "gap"), ("form_esr", "form"))

    own: tuple[float, ...]
    spread: tuple[float, ...]
    gap: tuple[float, ...]
    form: tuple[float, ...]
    label: str = ""

    @property
    def worst(self) -> int:
        """The output on which the verdict rests: the one with the largest (f − e)/e."""
        return int(np.argmax([(f - e) / max(e, 1e-300) for f, e in zip(self.form, self.own, strict=True)]))

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`."""
        o = self.worst
        extra = self.form[o] - self.own[o]
        return "safe" if extra <= self.spread[o] else "costs" if extra <= self.own[o] else "not safe"

    def text(self, output: str, moves: bool) -> str:
        """The verdict with its figures.

        Parameters
        ----------
        output : str
            Name of the output that the gap is given for.
        moves : bool
            Whether the scheduling moves in these records.

        Returns
        -------
        str
        """
        o, where = self.worst, f", {self.label}" if self.label else ""
        errors = (f"free-run ESR{where} {self.own[o]:.3g} ± {self.spread[o]:.1g} as a transfer function, "
                  + (f"{self.form[o]:.3g} in this form" if np.isfinite(self.form[o]) else "this form diverges"))
        share = f"the gap is {100 * np.sqrt(self.gap[o]):.3g} % of {output} (rms)"
        if self.verdict == "safe":
            still = "" if moves else "; the scheduling never moves in these records"
            return f"safe: {share}, and costs no more than these records leave open about the error ({errors}){still}"
        if self.verdict == "costs":
            return f"costs: {share}, and adds less than the model's own error ({errors})"
        return f"not safe when the scheduling moves: {share}, and adds more than the model's own error ({errors})"


def judge(realization: Realization, records: Sequence[Record], label: str = "") -> Judgement | None:
    """Both models in free run on measured records; None where none of them holds the outputs, or all are too short.

    Parameters
    ----------
    realization : Realization
        With its source.
    records : sequence of Record
        Those without the outputs, or no longer than the models' starts, are left out.
    label : str
        What the records are to the model: "training", "held-out", or "" (not stated).

    Returns
    -------
    Judgement or None
        None also where the transfer function diverges or an output does not move.
    """
    source, model = realization.source, realization.model
    first, names = max(source.start, model.start), [s.name for s in source.outputs]
    squares, gaps, forms, powers = [], [], [], []
    for record in records:
        if not all(record.has(n) for n in names) or record.n_samples <= first + 1:
            continue
        y = _outputs(source, record)[first:]
        runs = [simulate(m, record) for m in (source, model)]
        if runs[0].diverged_at is not None:
            return None
        io, ss = (r.output[first:] for r in runs)
        with np.errstate(over="ignore", invalid="ignore"):
            broken = runs[1].diverged_at is not None
            gaps.append(np.full(y.shape[1], np.inf) if broken else np.sum((ss - io) ** 2, axis=0))
            forms.append(np.full(y.shape[1], np.inf) if broken else np.sum((y - ss) ** 2, axis=0))
        squares.append((y - io) ** 2)
        powers.append(np.sum((y - y.mean(axis=0)) ** 2, axis=0))
    if not squares:
        return None
    power, rows = np.sum(powers, axis=0), sum(len(s) for s in squares)
    if not np.all(power > 0):
        return None
    own = np.sum([s.sum(axis=0) for s in squares], axis=0)
    spread = _standard_error(squares) * rows
    gap, form = np.sum(gaps, axis=0) / power, np.sum(forms, axis=0) / power
    return Judgement(tuple((own / power).tolist()), tuple((spread / power).tolist()), tuple(gap.tolist()),
                     tuple(form.tolist()), label)


def _standard_error(squares: Sequence[np.ndarray]) -> np.ndarray:
    """(n_outputs,) standard error of the mean of correlated series by batch means; 0 where there is only one batch."""
    length = max(int(np.sqrt(sum(len(s) for s in squares))), 1)
    batches = [s[k * length: (k + 1) * length].mean(axis=0) for s in squares for k in range(len(s) // length)]
    if len(batches) < 2:
        return np.zeros(squares[0].shape[1])
    return np.std(batches, axis=0, ddof=1) / np.sqrt(len(batches))
