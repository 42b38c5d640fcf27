"""The search behind `select`: screen, filter, cross-validate, look around the winner, rank."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from lpvid._forks import processor_time
from lpvid.errors import InputError, NumericalError
from lpvid.identification.arx import ARX
from lpvid.identification.prediction_error import PredictionError
from lpvid.identification.selection.choosing import TOLERATED, Tried, close_to_least, simplest_supported
from lpvid.identification.selection.free_run import (
    LEFT,
    TIME_UP,
    Fold,
    Trial,
    cross_validate,
    estimated,
    open_stages,
    squares,
    unstable_share,
)
from lpvid.identification.selection.hasty import in_full
from lpvid.identification.selection.result import CandidateRow
from lpvid.identification.selection.screening import Refused, Screened, screen
from lpvid.identification.selection.starting import fit_from_measured_samples
from lpvid.identification.structure import Structure
from lpvid.record import Record
from lpvid.simulation import Model

BY_BIC, BY_AICC = 6, 3
"""places on the short list by either criterion; the rest goes to variety."""
ROUNDS = 3
"""times the neighbours of the best are tried."""

ROUND_DONE = "• "
"""how a line of progress begins that ends a round."""

Progress = Callable[[int, int, str], None]


class StructureSearch:
    """State of a search that may be interrupted at any time.

    Parameters
    ----------
    records : sequence of Record
        On which candidates are compared: uniform and finite.
    parts : sequence of Fold
        (training, held-out) records of every fold.
    limit : float
        Share of the samples at which a frozen pole may lie outside the unit circle.
    places : int
        Screened candidates that are cross-validated at most.
    progress : callable or None
        ``progress(done, total, text)``.
    budget : float, optional
        Processor time of the search and of the refit of its choice [s]; left out, no limit.
    begun : float, optional
        Processor time of the process from which the budget counts [s]; left out, now.
    """

    def __init__(self, records: Sequence[Record], parts: Sequence[Fold], limit: float, places: int,
                 progress: Progress | None, budget: float | None = None, begun: float | None = None) -> None:
        self.records, self.parts, self.limit, self.places, self.progress = records, parts, limit, places, progress
        self.begun, self.budget = processor_time() if begun is None else begun, budget
        self.unscreened, self.unreached = 0, set[int]()
        self.left_out: list[str] = []
        self.first: tuple[Structure, ...] = ()
        self.refit_seconds: dict[Structure, float] = {}
        self.screened: list[Screened] = []
        self.refused: list[CandidateRow] = []
        self.direct: list[Structure] = []
        self.outside: dict[int, float] = {}
        self.trials: dict[int, Trial] = {}
        self.others: list[tuple[Structure, Trial]] = []
        self.barred: set[Structure] = set()

    # -- steps --------------------------------------------------------------------------------------------------
    def try_first(self, structures: Iterable[Structure]) -> None:
        """Structures before all others; the first of them is tried whatever the budget.

        Parameters
        ----------
        structures : iterable of Structure
            One of every kind, cheap before dear.
        """
        self.first = tuple(structures)
        self.try_others(self.first)
        self.report_progress(f"one of every kind done after {self.seconds:.0f} s", line=True)

    def screen(self, candidates: Sequence[Structure]) -> None:
        """Information criteria for every plain ARX; everything else waits for cross-validation.

        Parameters
        ----------
        candidates : sequence of Structure
            An ARX with ridge is not plain.
        """
        plain = [s for s in candidates if isinstance(s, ARX) and not s.ridge]
        self.direct = [s for s in candidates if not (isinstance(s, ARX) and not s.ridge)]
        if plain:
            for done, found in enumerate(screen(self.records, plain, lambda text: self._report(0, text)), start=1):
                if isinstance(found, Refused):
                    self.refused.append(CandidateRow(found.asked, reason=found.reason))
                else:
                    self.screened.append(found)
                if self.late():
                    self.unscreened = len(plain) - done
                    break
        self.screened.sort(key=lambda s: (s.bic, s.n_parameters))

    def cross_validate(self) -> None:
        """The short list, other structures, then the neighbours of the best."""
        for index in self._short_list():
            self._try(index)
        for _ in range(ROUNDS):
            for index in self._neighbours():
                self._try(index)
        self.try_others(self.direct)

    def try_others(self, structures: Iterable[Structure]) -> None:
        """Structures that no factor can screen, those tried before left out; each is left once it cannot win.

        Parameters
        ----------
        structures : iterable of Structure
            In the order in which they are tried.
        """
        for structure in structures:
            if any(structure == known for known, _ in self.others):
                continue
            self.others.append((structure, self._tried(structure)))

    def resume(self) -> None:
        """Continue with what was left beside a structure that is among `barred` now."""
        for i, (structure, trial) in enumerate(self.others):
            best = self.best
            could = best is None or squares(trial) <= squares(best[1])
            if trial.failure.startswith(LEFT) and could and not self.late():
                self.others[i] = (structure, self._tried(structure))

    def _tried(self, structure: Structure) -> Trial:
        """Cross-validation against the best so far, and whether the structure could be taken."""
        self._report(len(self.trials) + len(self.others), f"cross-validating in free run {structure.summary}")
        best, begin = self.best, self.begin_of(structure)
        trial = cross_validate(structure, self.parts, self.records, None if best is None else best[1], self.late, begin)
        return trial if trial.failure else self._admitted(structure, trial, begin)

    def late(self) -> bool:
        """Whether the time is up but for the refit of the best; never before there is a candidate that could be taken.

        What that refit takes is what the estimate of the best on all records took.

        Returns
        -------
        bool
            False without a budget.
        """
        if self.budget is None or (best := self.best) is None:
            return False
        return self.seconds + self.refit_seconds.get(best[0], 0.0) > self.budget

    def unfinished(self, structures: Iterable[Structure]) -> int:
        """How many of them the time ran out on.

        Parameters
        ----------
        structures : iterable of Structure
            Those asked about.

        Returns
        -------
        int
        """
        asked = tuple(structures)
        return sum(t.failure.startswith(TIME_UP) for s, t in self.others if s in asked)

    @property
    def seconds(self) -> float:
        """Processor time since the search began [s], forks included: what else the machine does changes nothing."""
        return processor_time() - self.begun

    @property
    def best(self) -> tuple[Structure, Trial] | None:
        """Structure and trial of least free-run error so far, of those that can be taken."""
        tried = [*((self.screened[i].asked, t) for i, t in self.trials.items()), *self.others]
        good = [(s, t) for s, t in tried if not t.failure and s not in self.barred]
        return min(good, key=lambda row: row[1].counted) if good else None

    def simplest(self, kind: type) -> Structure | None:
        """Of a kind that no factor screens, the one of fewest parameters within `TOLERATED` of its least counted error.

        Parameters
        ----------
        kind : type
            Class of structures.

        Returns
        -------
        Structure or None
            None where none of the kind gave figures.
        """
        good = self.ranked_among(kind)
        near = [(s, t) for s, t in good if t.counted <= (1 + TOLERATED) * good[0][1].counted]
        return min(near, key=lambda row: (row[1].n_parameters or 0, row[1].counted))[0] if near else None

    def ranked_among(self, kind: type) -> list[tuple[Structure, Trial]]:
        """Structures of a kind that no factor screens with their trials, least counted error first.

        Counted with its run from measured samples (`Trial.counted`): further structures are built on one that could be
        taken. By cross-validation alone the search of `car:1` in `tests/benchmarks/auto_study.py` looked around orders
        seven and eight, whose run from measured samples is worse than the mean, and never around the one it took.

        Parameters
        ----------
        kind : type
            Class of structures.

        Returns
        -------
        list of (Structure, Trial)
            Without failures.
        """
        good = [(s, t) for s, t in self.others if not t.failure and isinstance(s, kind)]
        return sorted(good, key=lambda row: row[1].counted)

    def leader(self) -> ARX | None:
        """The screened ARX of least counted free-run error, with its basis bound and its stages fitted.

        Where none was cross-validated, the best of those tried first.

        Returns
        -------
        ARX or None
            None where there is neither.
        """
        tried = [i for i, t in self.trials.items() if not t.failure]
        if tried:
            return self.screened[min(tried, key=lambda i: self.trials[i].counted)].structure
        bound = [s for s, _ in self.ranked_among(ARX) if isinstance(s, ARX) and not s.ridge]
        return bound[0] if bound else None

    def asked_leader(self) -> ARX | None:
        """The leader with its basis bound, its stages by name where they were requested by name.

        Returns
        -------
        ARX or None
        """
        leader = self.leader()
        asked = next((s.asked for s in self.screened if s.structure is leader), leader)
        return leader if leader is None or asked is None else replace(
            leader, stage=asked.stage, schedule_filter=asked.schedule_filter)

    def begin_of(self, structure: Structure) -> ARX | None:
        """Least squares with stages that the screening fitted, where the search of a structure with named ones begins.

        Parameters
        ----------
        structure : Structure

        Returns
        -------
        ARX or None
            None where the structure is no prediction-error estimate with a named stage, or none of these was screened.
        """
        if not isinstance(structure, PredictionError) or not open_stages(structure):
            return None
        asked = structure.arx
        for found in self.screened:
            fitted = found.structure
            if (asked.basis in (fitted.basis, found.asked.basis)
                    and (found.asked.stage, found.asked.schedule_filter) == (asked.stage, asked.schedule_filter)):
                return replace(asked, stage=fitted.stage, schedule_filter=fitted.schedule_filter)
        return None

    def _admitted(self, structure: Structure, trial: Trial, begin: ARX | None) -> Trial:
        """A trial that could be taken, failed where its estimate on all records has frozen poles outside."""
        begun = self.seconds
        try:
            model = estimated(structure, self.records, begin).model
            self.refit_seconds[structure] = self.seconds - begun
            share = unstable_share(model, self.records)
        except (InputError, NumericalError, np.linalg.LinAlgError) as problem:
            why = problem.what if isinstance(problem, InputError) else str(problem)
            return replace(trial, failure=f"cannot be fitted to all training data: {why}")
        failure = f"frozen pole outside at {100 * share:.2g} % of training samples" if share > self.limit else ""
        whole = in_full(structure)
        if not failure and whole != structure and self._leads(trial):  # what would be taken is the whole search's end
            begun = self.seconds
            with suppress(InputError, NumericalError, np.linalg.LinAlgError):  # the refit at the end judges it again
                model = estimated(whole, self.records, begin).model
            self.refit_seconds[structure] = self.seconds - begun
        return replace(trial, failure=failure, outside=share, measured=self._measured(model, trial))

    def _leads(self, trial: Trial) -> bool:
        """Whether cross-validation would make it the leader of the race."""
        best = self.best
        return best is None or trial.mean < best[1].counted

    def _measured(self, model: Model, trial: Trial) -> float:
        """ESR from measured samples of a structure that would be the best so far, else 0."""
        if not self._leads(trial):
            return 0.0
        return (1 - fit_from_measured_samples(model, self.records, len(self.parts)) / 100) ** 2

    def admissible(self, index: int) -> bool:
        """Whether a screened candidate keeps its frozen poles inside along the training trajectory.

        Parameters
        ----------
        index : int
            Place in `screened`.

        Returns
        -------
        bool
            Outside at no more than `limit` of the samples; without an estimate it counts as outside throughout.
        """
        if index not in self.outside:
            try:
                model = self.screened[index].identification(self.records).model
                self.outside[index] = unstable_share(model, self.records)
            except (InputError, np.linalg.LinAlgError):
                self.outside[index] = 1.0
        return self.outside[index] <= self.limit

    def _try(self, index: int) -> None:
        if index in self.trials:
            return
        if self.late():
            self.unreached.add(index)
        else:
            self._report(len(self.trials), f"cross-validating in free run {self.screened[index].asked.summary}")
            trial = cross_validate(self.screened[index].structure, self.parts, self.records)
            if not trial.failure:
                trial = replace(trial, measured=self._measured(self._of_screened(index), trial))
            self.trials[index] = trial

    def report_progress(self, text: str, *, line: bool = False) -> None:
        """Progress in words; a line ends a round and may be kept.

        Parameters
        ----------
        text : str
            The figures of the best so far are added.
        line : bool
            Whether a round ends here.
        """
        self._report(len(self.trials) + len(self.others), (ROUND_DONE if line else "") + text)

    def _report(self, done: int, text: str) -> None:
        if self.progress is not None:
            best = self.best
            so_far = "" if best is None else f"; best so far {best[0].summary}, {fit_percent(best[1]):.1f} %"
            self.progress(done, self.places + len(self.direct), text + so_far)

    # -- who is tried -------------------------------------------------------------------------------------------
    def _short_list(self) -> list[int]:
        """The best admissible by BIC and by AICc, then the best of every trait not yet among them."""
        chosen: list[int] = []
        by_aicc = sorted(range(len(self.screened)), key=lambda i: (self.screened[i].aicc, i))
        for order, count in ((range(len(self.screened)), BY_BIC), (by_aicc, BY_BIC + BY_AICC)):
            for index in order:
                if len(chosen) >= min(count, self.places) or self.late():
                    break
                if index not in chosen and self.admissible(index):
                    chosen.append(index)
        seen = {trait for i in chosen for trait in _traits(self.screened[i].asked)}
        for index, candidate in enumerate(self.screened):
            if len(chosen) >= self.places or self.late():
                break
            fresh = _traits(candidate.asked) - seen
            if fresh and self.admissible(index):
                chosen.append(index)
                seen |= _traits(candidate.asked)
        return chosen

    def _neighbours(self) -> list[int]:
        """Untried admissible candidates that differ from the best in one trait, best BIC first."""
        tried = [i for i, t in self.trials.items() if not t.failure]
        if not tried:
            return []
        best = _traits(self.screened[min(tried, key=lambda i: self.trials[i].mean)].asked)
        near = [i for i, s in enumerate(self.screened)
                if i not in self.trials and len(_traits(s.asked) - best) == 1]
        chosen: list[int] = []
        for index in near:
            if len(chosen) >= self.places or self.late():
                break
            if self.admissible(index):
                chosen.append(index)
        return chosen

    # -- verdict ------------------------------------------------------------------------------------------------
    def ranked(self) -> list[tuple[Structure, CandidateRow]]:
        """Structures in order of preference with their rows: the first is the choice.

        Returns
        -------
        list of (Structure, CandidateRow)
            Failed, untried and refused candidates at the end, with their reasons.
        """
        tested = [(self._row(i), Tried(t, self.screened[i].n_parameters, partial(self._of_screened, i)))
                  for i, t in self.trials.items()]
        tested += [(CandidateRow(s, t.n_parameters, outside=t.outside),
                    Tried(t, t.n_parameters, partial(self._of_structure, s))) for s, t in self.others]
        good = sorted((item for item in tested if not item[1].trial.failure), key=lambda item: item[1].trial.mean)
        failed = [replace(row, reason=tried.trial.failure) for row, tried in tested if tried.trial.failure]
        rows = [*self._chosen(good), *failed, *self._untried(), *self.refused]
        return [(row.structure, row) for row in rows]

    def _of_screened(self, index: int) -> Model:
        return self.screened[index].identification(self.records).model

    def _of_structure(self, structure: Structure) -> Model:
        return structure.estimate(self.records).model

    def _chosen(self, good: Sequence[tuple[CandidateRow, Tried]]) -> list[CandidateRow]:
        """Rows with reasons, least error first, but the choice before all."""
        if not good:
            return []
        trials = [tried.trial for _, tried in good]
        running = sum(t.mean < 1 for t in trials) or len(trials)
        near = close_to_least(trials[:running])
        chosen = simplest_supported([tried for _, tried in good[:running]], self.records)
        rows = []
        for i, (row, tried) in enumerate(good):
            if i == chosen:
                reason = "chosen: least free-run error" if i == 0 else (
                    "chosen: within one standard error of the best, with frozen poles inside in more of the range, or "
                    "with fewer parameters and not worse by AIC")
            elif i in near:
                reason = "least free-run error, but no sure one: see the choice" if i == 0 else (
                    "within one standard error of the best, but no simpler, worse on all training data by AIC, or with "
                    "frozen poles outside in more of the range")
            elif i >= running:
                reason = "its free run is worse than the mean of the output"
            else:
                reason = f"free-run error {_above(tried.trial.mean / max(trials[0].mean, 1e-300))}"
            rows.append(replace(row, esr=tried.trial.mean, esr_error=tried.trial.error,
                                esr_folds=tuple(tried.trial.esr.tolist()), reason=reason))
        return [rows[chosen], *(r for i, r in enumerate(rows) if i != chosen)]

    def _row(self, index: int, reason: str = "") -> CandidateRow:
        s = self.screened[index]
        return CandidateRow(s.asked, s.n_parameters, s.bic, s.aicc, s.one_step, self.outside.get(index), reason=reason)

    def _untried(self) -> list[CandidateRow]:
        rows = []
        for i in range(len(self.screened)):
            if i in self.trials:
                continue
            share = self.outside.get(i)
            if i in self.unreached:
                reason = f"{TIME_UP} before it was cross-validated"
            elif share is not None and share > self.limit:
                reason = f"frozen pole outside at {100 * share:.2g} % of training samples"
            elif not self.trials:
                reason = f"{TIME_UP} before any of these was cross-validated"
            else:
                reason = f"BIC {self.screened[i].bic - self.screened[0].bic:.4g} above the least: not cross-validated"
            rows.append(self._row(i, reason))
        return rows


def fit_percent(trial: Trial) -> float:
    """Free-run fit [%] of a cross-validation.

    Parameters
    ----------
    trial : Trial

    Returns
    -------
    float
        100 (1 − √ESR); −inf after a failure.
    """
    return float(100 * (1 - np.sqrt(trial.mean)))


def _traits(structure: ARX) -> set[tuple]:
    terms = "none" if not structure.affine else "all" if structure.affine == structure.na + 1 else "one"
    return {("na", structure.na), ("nb − na", tuple(b - structure.na for b in structure.width)),
            ("nk", structure.delay), ("basis", structure.basis), ("affine", terms), ("lagged", structure.lagged),
            ("stages", structure.stage, structure.schedule_filter)}


def _above(ratio: float) -> str:
    """How far an error lies above the least, in words that three digits carry."""
    return f"{ratio:.3g} times the least" if ratio >= 1.01 else f"{100 * (ratio - 1):.1g} % above the least"
