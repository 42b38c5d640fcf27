"""Comparison: every damper model that the data allow, fitted and ranked by its free run on data no fit has seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import overload

import numpy as np

from lpvid.errors import InputError, LpvError
from lpvid.record import Record
from lpvid.remark import OutOfTime
from lpvid.toolkit import checks, in_forks, in_processes, processors
from lpvid.training_rows import PARTLY, TRAINING, compared_rows
from quartercar.dampers import model_class, model_names
from quartercar.dampers.blackbox.lpv import LpvArx
from quartercar.dampers.contract import Damper
from quartercar.dampers.evaluation.compared import FITTED_BEFORE, Compared, Comparison
from quartercar.dampers.evaluation.scoring import score, stretches, time_per_simulated_second
from quartercar.dampers.facts import Facts
from quartercar.dampers.families import DynamicDamper, LawDamper
from quartercar.dampers.fitting import DamperFit, FitSettings, fit
from quartercar.dampers.fitting.front import recognising
from quartercar.dampers.preparing import Prepared, prepare

SMALL = 3
"""states up to which a step of integration costs about the same"""
SETTLED = 0.01
"""of its standard error, by which the last steps of a search may still move a parameter: a step of δ standard errors
lowers the cost by the share δ²/N"""
STRETCH = 512
"""samples of a stretch, where training data are thinned"""
SAMPLED = 5e-4
"""seconds of a fit by sample: narx-3 2e-4 (600 s), of quasi-lpv, compliance and lpv-arx 9e-4. These and the
following: 30 s at 512 Hz, one processor, `tests/benchmarks/fit_times.py`; they weigh the time that is left"""
LAW, STEP, IMPLICIT_STEP = 2.5e-8, 2e-7, 1.2e-5
"""seconds by simulated sample and parameter: guo 2e-9 (600 s), guo-15 and extended-bouc-wen 2e-8, force-map 3e-8 of
a formula; bouc-wen 2e-7 of an integration; relief-valve 1.2e-5 of one of more than `SMALL` states"""
QUICK = FitSettings()
"""for models without states, whose free run is a formula"""
SLOW = FitSettings(starts=10, polished=2, evaluations=50, short_evaluations=10, short_samples=1500)
"""for models with states, whose free run is an integration"""
STIFF = FitSettings(starts=4, polished=1, evaluations=30, short_evaluations=8, short_samples=800)
"""for models of more states than `SMALL`, whose integration is many times slower still"""


@dataclass(frozen=True)
class CompareSettings:
    """How much computation a comparison takes.

    Attributes
    ----------
    seed : int
        Of the starting points; the same seed gives the same comparison.
    sample_rate : float or None
        Resample to this rate [Hz] first.
    quick_work, slow_work : int
        Samples times parameters above which training data are thinned, for models without states and with: stretches
        spread evenly over all records are kept, and a note states so.
    sampled_samples : int
        Samples above which they are thinned for models identified from samples, such as NARX and LPV.
    thorough : bool
        All data and twenty starts for every model, however long that takes.
    passive : bool
        Models that can be fitted under the constraint of passivity (lpv-arx) are; the others are checked only.
    workers : int or None
        Processes that fit; None for one on each processor. The comparison does not depend on it.
    budget : float or None
        Wall time [s] after which fits that are not done are left out; cheap models come first.
    """

    seed: int = 0
    sample_rate: float | None = None
    quick_work: int = 1_500_000
    slow_work: int = 80_000
    sampled_samples: int = 40_000
    thorough: bool = False
    passive: bool = False
    workers: int | None = 1
    budget: float | None = None

    def __post_init__(self) -> None:
        checks.count(self.seed, "seed")
        for name in ("quick_work", "slow_work", "sampled_samples"):
            checks.count(getattr(self, name), name, at_least=1)
        if self.workers is not None:
            checks.count(self.workers, "workers", at_least=1)
        if self.budget is not None:
            checks.positive(self.budget, "budget", "s")


def compare(records: Sequence[Record], models: str | Sequence[str | Damper] = "all",
            held_out: Sequence[Record] | None = None, settings: CompareSettings | None = None,
            progress: Callable[[str], None] = lambda text: None) -> Comparison:
    """Fit every damper model that the data allow and rank them by held-out free-run ESR, all on the same samples.

    Parameters
    ----------
    records : sequence of Record
        Training data as read; see `quartercar.dampers.preparing.prepare` for what is done to them.
    models : "all", or names and dampers
        Names of `model_names` are fitted; a `Damper` is compared as it is (a published parameter set, a saved fit).
    held_out : sequence of Record, optional
        Data that no fit uses; left out, the last third of every record.
    settings : CompareSettings, optional
    progress : callable
        Receives what is being done.

    Returns
    -------
    Comparison
        When interrupted, of the models that were done by then, and a note states so.

    Raises
    ------
    InputError
        Unusable data; no model that could be compared, with the reasons.

    Examples
    --------
    >>> t = np.arange(3000) / 500
    >>> v = 0.1 * np.sin(12 * t) + 0.05 * np.sin(31 * t)
    >>> run = Record({"velocity": v, "force": 1500 * v - 120}, sample_time=1 / 500, name="run",
    ...              units={"velocity": "m/s", "force": "N"})
    >>> found = compare([run], ["linear"])
    >>> found.best.name, bool(found.best.held_out.total.esr < 1e-9), found.best.held_out.total.n_samples
    ('linear', True, 1000)
    """
    settings = settings or CompareSettings()
    wanted = _wanted(models)
    training, kept, notes = _held_out(records, held_out)
    progress("preparing the records")
    data = prepare(training, kept, settings.sample_rate)
    facts = Facts.of(data.training, data.polarity)
    given = [_as_given(m, data) for m in wanted if isinstance(m, Damper)]
    suited, refused = _suited([m for m in wanted if isinstance(m, str)], facts)
    if settings.passive:
        suited = [d.replace(passive=True) if isinstance(d, LpvArx) else d for d in suited]
        notes = (*notes, *_constrained(suited))
    fits, failed, complete = _fit_all(suited, data, settings, progress)
    refused += failed
    fits = [recognising(f, training) for f in fits]
    dampers = [*(f.damper for f in fits), *given]
    if not dampers:
        raise InputError("no damper model could be fitted to these data",
                         got="; ".join(f"{name}: {why}" for name, why in refused) or "no model was named",
                         mend="a larger --budget" if any(isinstance(why, OutOfTime) for _, why in refused) else None)
    progress("comparing")
    first = max(d.start for d in dampers)
    rows = _rows(dampers, [*fits, *([None] * len(given))], data, first, settings.workers)
    rows = [_known_before(row, kept, data) for row in rows]
    rows.sort(key=lambda row: np.inf if row.held_out.total.esr is None else row.held_out.total.esr)
    return Comparison(tuple(rows), tuple(refused), data, first, (*data.notes, *notes, *_thinned(fits, data)), complete)


def _wanted(models: str | Sequence[str | Damper]) -> list[str | Damper]:
    """Names, checked, and dampers; an empty list is refused."""
    known = list(model_names())
    listed: Sequence[str | Damper] = models.split(",") if isinstance(models, str) else models
    names = [m.strip() if isinstance(m, str) else m for m in listed]
    if "all" in [n for n in names if isinstance(n, str)]:
        names = [*known, *(n for n in names if isinstance(n, Damper))]
    for name in names:
        if isinstance(name, str):
            checks.known_name(name, known, "damper model")
    if not names:
        raise InputError("no damper model to compare", mend='"all", or names such as "guo,bouc-wen"')
    return list(dict.fromkeys(names))


def _held_out(records: Sequence[Record], held_out: Sequence[Record] | None) -> tuple[list[Record], list[Record],
                                                                                     tuple[str, ...]]:
    from lpvid.condition import split_tail

    if held_out:
        return list(records), list(held_out), ()
    pairs = [split_tail(r) for r in records]
    return [a for a, _ in pairs], [b for _, b in pairs], ("held out: the last third of every record",)


def _as_given(damper: Damper, data: Prepared) -> Damper:
    """A damper that is not fitted, in the polarity of the records; InputError where it needs what they lack."""
    for role in damper.reads:
        if not data.training[0].has(role):
            raise InputError(f"{damper.name} as given reads the {role}, which these records do not have",
                             mend=checks.role_mend(role))
    return damper.replace(polarity=data.polarity)


def _suited(names: Sequence[str], facts: Facts) -> tuple[list[Damper], list[tuple[str, str]]]:
    """The models that these data allow, quick ones first, and why not the others."""
    found, refused = [], []
    for name in names:
        try:
            found.append(model_class(name).suited(facts))
        except InputError as error:
            refused.append((name, _reason(error, name)))
    return sorted(found, key=_effort), refused


def _effort(damper: Damper) -> tuple[int, int]:
    states = damper.integrated_states
    kind = 1 if states is None else 2 if states else 0
    return kind, len(damper.parameters)


def _reason(error: Exception, name: str) -> str:
    """What stands in the way, without the model's name and without the mend."""
    stated = " ".join(str(error).split()).split(" Mend: ")[0].rstrip(".")
    return stated.removeprefix(f"{name} ").removeprefix(f"{name}: ")


def _constrained(suited: Sequence[Damper]) -> tuple[str, ...]:
    """Which models --passive constrains."""
    bound = [d.name for d in suited if isinstance(d, LpvArx)]
    free = [d.name for d in suited if not isinstance(d, LpvArx)]
    stated = f"passive: {', '.join(bound)} fitted under the constraint" if bound else "passive constrains lpv-arx only"
    return (stated + (f"; the laws of {', '.join(free)} are checked instead (flag not-passive)" if free else ""),)


def _fit_all(suited: Sequence[Damper], data: Prepared, settings: CompareSettings,
             progress: Callable[[str], None]) -> tuple[list[DamperFit], list[tuple[str, str]], bool]:
    """Fits, failures, and whether the work came to its end."""
    costs = [_cost(*_job(d, data, settings)) for d in suited]
    order = _order(costs, settings)
    jobs = _Jobs([suited[place] for place in order], data, settings)

    def stated(done: int, running: list[int], left: float | None) -> None:
        names = ", ".join(suited[order[k]].name for k in running)
        about = "" if left is None else f", about {left:.0f} s left"
        if names:
            progress(f"fitting {names} ({done} of {len(suited)} done{about})")

    ended = in_processes(_fitted, jobs, workers=settings.workers, budget=settings.budget,
                         costs=[costs[place] for place in order], report_progress=stated)
    fits: list[DamperFit] = []
    failed: list[tuple[str, str]] = []
    for place, one in sorted(zip(order, ended, strict=True), key=lambda pair: pair[0]):
        damper = suited[place]
        if one.stopped:
            failed.append((damper.name, one.stopped if settings.budget is None or one.stopped != "budget" else
                           OutOfTime(f"not done within --budget {settings.budget:g} s")))
        elif one.error is not None:
            if not isinstance(one.error, (LpvError, ArithmeticError, np.linalg.LinAlgError, RuntimeError)):
                raise one.error
            failed.append((damper.name, _reason(one.error, damper.name)))
        else:
            assert one.value is not None
            fits.append(one.value)
    return fits, failed, not any(one.stopped == "interrupted" for one in ended)


def _order(costs: Sequence[float], settings: CompareSettings) -> list[int]:
    """Places of the models, quick ones first, in the order of their fits.

    Several processes begin with the dearest fits by `_cost`, but for one that begins with the cheaper half of all, so
    that an interruption finds some of them done. Then the dearest that is left comes next, and none is left alone with
    a long one at the end. Where a budget may end the work, all take the quick ones first. The two relief-valve models
    are the dearest and share kernels that take as long to compile as to run: begun apart, one compiles them for both.
    """
    count = len(costs)
    workers = min(settings.workers or processors(), count)
    if workers <= 1 or settings.budget is not None:
        return list(range(count))
    dear = sorted(range(count), key=lambda k: (-costs[k], -k))
    cheap = dear[max(count - count // 2, workers - 1):][::-1]
    return [*dear[: workers - 1], *cheap, *(k for k in dear[workers - 1:] if k not in cheap)]


_Job = tuple[Damper, tuple[Record, ...], FitSettings]


def _job(damper: Damper, data: Prepared, settings: CompareSettings) -> _Job:
    """Model, records and settings of one fit."""
    effort = QUICK
    if isinstance(damper, DynamicDamper) and not settings.thorough:
        effort = SLOW if len(damper.states) <= SMALL else STIFF
    effort = replace(effort, seed=settings.seed, polarity=data.polarity)
    if settings.thorough:
        return damper, data.training, effort
    records = tuple(stretches(data.training, _affordable(damper, settings), STRETCH))
    samples = sum(r.n_samples for r in records)
    return damper, records, replace(effort, tolerance=max(effort.tolerance, SETTLED**2 / samples))


class _Jobs(Sequence[_Job]):
    """The fits of these dampers; stretches of the records are cut when a job is taken."""

    def __init__(self, dampers: Sequence[Damper], data: Prepared, settings: CompareSettings) -> None:
        self.dampers, self.data, self.settings = dampers, data, settings

    def __len__(self) -> int:
        return len(self.dampers)

    @overload
    def __getitem__(self, place: int) -> _Job: ...
    @overload
    def __getitem__(self, place: slice) -> list[_Job]: ...
    def __getitem__(self, place: int | slice) -> _Job | list[_Job]:
        if isinstance(place, slice):
            return [self[k] for k in range(*place.indices(len(self)))]
        return _job(self.dampers[place], self.data, self.settings)


def _fitted(job: _Job) -> DamperFit:
    damper, records, effort = job
    return fit(damper, records, settings=effort)


def _cost(damper: Damper, records: Sequence[Record], effort: FitSettings) -> float:
    """Seconds that a fit may take, from what it simulates: every start on shortened data, and the best on all.

    A law that is linear in all of its parameters is fitted by one regression, from one start.
    """
    count, samples, states = max(len(damper.parameters), 1), sum(r.n_samples for r in records), damper.integrated_states
    if states is None:
        return SAMPLED * samples
    if isinstance(damper, LawDamper) and len(damper.linear) == count:
        return LAW * samples * count**2
    simulated = (effort.starts * effort.short_evaluations * min(effort.short_samples, samples)
                 + effort.polished * effort.evaluations * samples)
    return (LAW if not states else STEP if states <= SMALL else IMPLICIT_STEP) * simulated * (count + 1)


def _affordable(damper: Damper, settings: CompareSettings) -> int:
    """Training samples that a fit may see: by the model's size, not by a clock, so that fits repeat."""
    states = damper.integrated_states
    if states is None:
        return settings.sampled_samples
    count = max(len(damper.parameters), 1)
    if not states:
        return settings.quick_work // count
    step = max(1.0, states**3 / SMALL**3)  # an implicit step solves a system of that many equations
    return round(settings.slow_work / (count * step))


def _thinned(fits: Sequence[DamperFit], data: Prepared) -> tuple[str, ...]:
    """Which models saw only a part of the training data, by how much."""
    total = sum(r.n_samples for r in data.training)
    seen = [(f.damper.name, f.n_samples / total) for f in fits if f.n_samples < 0.9 * total]
    if not seen:
        return ()
    return ("fitted to stretches spread over the training data, to save time: "
            + ", ".join(f"{name} {share:.0%}" for name, share in seen) + " (figures are on all of them; --thorough "
            "fits to all)",)


def _known_before(row: Compared, kept: Sequence[Record], data: Prepared) -> Compared:
    """The row, flagged where its model was fitted to rows of the held-out data (`kept`, as read)."""
    label = compared_rows(row.damper.metadata, kept, data.held_out, "force").label
    return replace(row, flags=(*row.flags, FITTED_BEFORE)) if label in (TRAINING, PARTLY) else row


def _rows(dampers: Sequence[Damper], fits: Sequence[DamperFit | None], data: Prepared, first: int,
          workers: int | None) -> list[Compared]:
    """A row for each damper, by forks where several processes may work."""
    pairs = list(zip(dampers, fits, strict=True))
    if workers == 1:
        return [_compared(damper, found, data, first) for damper, found in pairs]
    held = [*dampers, *(f for found in fits if found is not None for f in (found, found.passivity))]
    return in_forks(lambda pair: _compared(*pair, data, first), pairs, held)


def _compared(damper: Damper, found: DamperFit | None, data: Prepared, first: int) -> Compared:
    """One row, with its figures and flags."""
    held_out = score(damper, data.held_out, first)
    training = score(damper, data.training, first)
    passivity = found.passivity if found is not None else damper.passivity()
    raised = {"diverged": held_out.total.diverged_at is not None or training.total.diverged_at is not None,
              "not-passive": not passivity.passive,
              "at-bounds": found is not None and bool(found.at_bounds),
              "undetermined": found is not None and bool(found.undetermined),
              "reversed-polarity": damper.polarity < 0, "extrapolates": held_out.extrapolation_share > 0}
    speed = time_per_simulated_second(damper, data.held_out)
    return Compared(damper, found, training, held_out, speed, passivity,
                    tuple(flag for flag, is_so in raised.items() if is_so))
