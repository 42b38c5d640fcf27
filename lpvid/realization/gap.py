"""What an inexact state-space form costs on a user's own scheduling trajectory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lpvid import _checks
from lpvid.codec import Encoded
from lpvid.errors import InputError
from lpvid.model.state_space import LPVStateSpace
from lpvid.realization.judgement import Judgement, judge
from lpvid.record import Channel, Record
from lpvid.simulation import _signals, simulate

if TYPE_CHECKING:
    from lpvid.realization.realization import Realization

SLOW, FAST = 0.02, 0.05
"""steps of p per sample, relative to its range, below and above which a static form serves or does not."""
NEGLIGIBLE = 1e-4
"""error-to-signal ratio (fit 99 %) of a gap not worth another form."""


@dataclass(frozen=True)
class RecordGap(Encoded):
    """The gap on one record.

    Attributes
    ----------
    name : str
        The record.
    esr : (n_outputs,) tuple of float
        Σ(y_ss − y_io)² / Σ(y_io − mean y_io)² for each output; 0 for equal outputs, inf beyond a constant one.
    largest_step : (n_scheduling,) tuple of float
        max |p(k+1) − p(k)| relative to the variable's range, behind any scheduling filter.
    diverged_at : int or None
        Sample at which one of the two free runs left all bounds; the figures cover the samples before it.
    diverged : str
        Which of them: "", "input-output model", "state space" or "both".
    """

    JSON = ("name", "esr", "fit_percent", "largest_step", "diverged_at", "diverged")

    name: str
    esr: tuple[float, ...]
    largest_step: tuple[float, ...]
    diverged_at: int | None
    diverged: str

    @property
    def fit_percent(self) -> tuple[float, ...]:
        """100 (1 − √ESR) for each output."""
        return tuple(100 * (1 - float(np.sqrt(e))) for e in self.esr)


@dataclass(frozen=True, eq=False)
class Gap(Encoded):
    """Difference between a realisation and the input-output model it came from, in free run from rest.

    Attributes
    ----------
    form : str
    exact, causal : bool
    records : tuple of RecordGap
    esr : tuple of float
        Pooled over the records (numerators and denominators summed), for each output.
    largest_step : tuple of float
        Largest step of each scheduling variable per sample, relative to its range.
    outputs, scheduling : tuple of str
        Names.
    advice : str
        Which form serves on these data.
    judgement : Judgement or None
        The gap beside the model's own error, where the records hold the measured outputs.
    """

    JSON = ("form", "exact", "causal", "esr", "fit_percent", "largest_step", "outputs", "scheduling", "advice",
            "verdict", "judgement", "records")

    form: str
    exact: bool
    causal: bool
    records: tuple[RecordGap, ...]
    esr: tuple[float, ...]
    largest_step: tuple[float, ...]
    outputs: tuple[str, ...]
    scheduling: tuple[str, ...]
    advice: str
    judgement: Judgement | None = None

    @property
    def verdict(self) -> str | None:
        """"safe", "costs" or "not safe" while the scheduling moves; None where it is not exact and nothing measured."""
        if self.exact:
            return "safe"
        return None if self.judgement is None else self.judgement.verdict

    @property
    def fit_percent(self) -> tuple[float, ...]:
        """100 (1 − √ESR) for each output, pooled."""
        return tuple(100 * (1 - float(np.sqrt(e))) for e in self.esr)

    def __str__(self) -> str:
        steps = ", ".join(f"{n} {100 * s:.3g} %" for n, s in zip(self.scheduling, self.largest_step, strict=True))
        lines = [f"Realisation gap of the {self.form} form: {self.advice}",
                 f"  largest step per sample, relative to the range: {steps or 'none'}"]
        for name, esr, fit in zip(self.outputs, self.esr, self.fit_percent, strict=True):
            lines.append(f"  {name}: fit {fit:.5g} %, ESR {esr:.3g} against the input-output model"
                         f" (free run from rest, {len(self.records)} record(s) pooled)")
        if len(self.records) > 1:
            lines += [f"    {r.name}: worst fit {min(r.fit_percent):.5g} %" for r in self.records[:5]]
            if len(self.records) > 5:
                lines.append(f"    and {len(self.records) - 5} more")
        lines += [f"  {r.name}: {r.diverged} diverged at sample {r.diverged_at}; figures cover what came before"
                  for r in self.records if r.diverged_at is not None]
        return "\n".join(lines)

    __repr__ = __str__


def measure_gap(realization: Realization, records: Sequence[Record], label: str = "") -> Gap:
    """Simulate both models along each record's inputs and scheduling, from rest, and compare their outputs.

    Rest is the equilibrium at the first scheduling value with zero input, so that neither start counts as gap.

    Parameters
    ----------
    realization : Realization
    records : sequence of Record
    label : str
        What the records are to the model: "training", "held-out", or "" (not stated).

    Returns
    -------
    Gap

    Raises
    ------
    InputError
        No record, or one of fewer than two samples.
    """
    if not records:
        raise InputError("a gap is measured on at least one record", got="none")
    for record in records:
        if record.n_samples < 2:
            raise InputError(f"record '{record.name}' cannot show a gap", got=f"{record.n_samples} samples",
                             mend="give a record of two samples or more")
    model, source = realization.model, realization.source
    trajectories = [_signals(source, record)[1] for record in records]
    width = _range(realization, trajectories)
    measured = []
    numerator, denominator = np.zeros(model.n_outputs), np.zeros(model.n_outputs)
    for record, p in zip(records, trajectories, strict=True):
        y_io, y_ss, diverged_at, diverged = _both_runs(realization, record)
        error = np.sum((y_ss - y_io) ** 2, axis=0)
        signal = np.sum((y_io - y_io.mean(axis=0)) ** 2, axis=0) if len(y_io) else np.zeros(model.n_outputs)
        numerator, denominator = numerator + error, denominator + signal
        step = np.abs(np.diff(p, axis=0)).max(axis=0, initial=0.0) / width
        measured.append(RecordGap(record.name, _ratio(error, signal), tuple(step.tolist()), diverged_at, diverged))
    esr = _ratio(numerator, denominator)
    steps = tuple(float(max(each)) for each in zip(*(r.largest_step for r in measured), strict=True))
    ran_away = any(r.diverged == "state space" for r in measured)
    judged = None if realization.exact else judge(realization, records, label)
    return Gap(realization.form, realization.exact, realization.causal, tuple(measured), esr, steps,
               tuple(s.name for s in model.outputs), tuple(source.box.names),
               _advice(realization, max(steps, default=0.0), np.inf if ran_away else max(esr), judged), judged)


def _both_runs(realization: Realization, record: Record) -> tuple[np.ndarray, np.ndarray, int | None, str]:
    """Outputs of both models up to the first divergence, and which of them diverged where."""
    source, model, lead = realization.source, realization.model, realization.source.start
    names = list(source.box.names)
    at_rest = {s.name: 0.0 for s in source.inputs} | {n: float(record[n][0]) for n in names}
    rest, level = _rest(model, at_rest)
    held = Record({n: Channel(np.concatenate([np.full(lead, v), record[n]])) for n, v in at_rest.items()},
                  sample_time=record.sample_time, name=record.name)
    io = simulate(source, held, initial=np.tile(level, (lead, 1)))
    ss = simulate(model, held, initial=rest)
    runs = {"input-output model": io, "state space": ss}
    early = {k: max(r.diverged_at - lead, 0) for k, r in runs.items() if r.diverged_at is not None}
    end = min([record.n_samples, *early.values()])
    which = "both" if len(early) == 2 else next(iter(early), "")
    return io.output[lead:][:end], ss.output[lead:][:end], end if early else None, which


def _rest(model: LPVStateSpace, at_rest: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """State and output of the equilibrium at given inputs and scheduling; zero where there is none."""
    assert model.state_offset is not None and model.output_offset is not None
    p = np.array([[at_rest[n] for n in model.box.names]])
    u = np.array([[at_rest[s.name] for s in model.inputs]])
    u = u if model.input_stage is None else model.input_stage.apply(u, p)
    phi = model.basis.evaluate(_checks.finite(p, "the first scheduling sample"))[0]
    a, b, c, d, f, g = (np.tensordot(phi, x, axes=1) for x in (
        model.A, model.B, model.C, model.D, model.state_offset, model.output_offset))
    drive, level = b @ u[0] + f, d @ u[0] + g
    matrix = np.eye(model.order) - a
    if not (np.any(drive) or np.any(level)) or (model.order and np.linalg.cond(matrix) > 1e12):
        return np.zeros(model.order), np.zeros(model.n_outputs)
    x = np.linalg.solve(matrix, drive)
    return x, c @ x + level


def _range(realization: Realization, trajectories: Sequence[np.ndarray]) -> np.ndarray:
    """Range of each scheduling variable: its box, or what the records reach if that is more."""
    width = np.maximum(2 * realization.source.box.half_width, np.ptp(np.vstack(trajectories), axis=0))
    return np.where(width > 0, width, 1.0)


def _ratio(error: np.ndarray, signal: np.ndarray) -> tuple[float, ...]:
    safe = np.where(signal > 0, signal, 1.0)
    return tuple(np.where(signal > 0, error / safe, np.where(error > 0, np.inf, 0.0)).tolist())


def _advice(realization: Realization, step: float, esr: float, judged: Judgement | None) -> str:
    if realization.exact and realization.causal:
        return "exact, nothing is lost"
    if realization.exact:
        return "exact, but it reads future scheduling: for control use form 'augmented', or identify with lagged=True"
    other = "use form 'augmented', or identify with lagged=True, whose observable form is exact"
    if judged is not None:
        stated = judged.text(realization.model.outputs[judged.worst].name, step > 0)
        mend = f"; re-estimate it in this form (refit_form, --refit-form), or {other}"
        return stated + (mend if judged.verdict != "safe" else "")
    if realization.source.order >= 2 and step > FAST:
        why = f"the scheduling moves up to {100 * step:.3g} % of its range per sample"
        return f"{why}: {other}" if esr > NEGLIGIBLE else f"{why}, yet on these data the gap is negligible"
    if esr > NEGLIGIBLE:
        return f"the gap is not negligible on these data: {other}"
    if realization.source.order >= 2 and step > SLOW:
        return "negligible on these data, but the scheduling moves 2 to 5 % of its range per sample: a faster one costs"
    return "negligible: the scheduling moves slowly enough for this form"
