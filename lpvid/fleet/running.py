"""run_fleet: every step of every file on a Dask cluster, one model of all files, and those that differ from it."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from lpvid._threads import SHARE, processors
from lpvid.errors import InputError
from lpvid.fleet import steps
from lpvid.fleet.causes import FileCauses, read_causes
from lpvid.fleet.comparing import Stage, diagnosed
from lpvid.fleet.differing import FEWEST, Differing, from_factors, needed_score
from lpvid.fleet.plan import FleetPlan, Job
from lpvid.fleet.state import StepOutcome, keep, short_hash
from lpvid.identification.streaming import merged_factor
from lpvid.scheduling import Scheduling
from lpvid.training_fingerprint import of_files

if TYPE_CHECKING:
    from distributed import Client

    from lpvid.identification.result import Identification

ROUNDS = 5
"""Fits of the fleet's model at most: each without the files that differed from the one before."""
SCHEDULER_TIMEOUT = 20.0
"""Seconds that a scheduler has to answer."""
CONSTANT = "constant-scheduling"
"""Finding on a scheduling variable that never moves."""
FIGURES = "free run of the model of all, training data"
"""What the errors of the files are."""
MANY = 40
"""Files with which a comparison is given: from about there on more files no longer help to find a single one."""
LOST = "lost"
"""Message of a step whose workers were killed more often than it may be tried again."""


@dataclass(frozen=True, eq=False)
class FleetResult:
    """What came out.

    Attributes
    ----------
    plan : FleetPlan
    outcomes : mapping of str to mapping of str to StepOutcome
        By file, then by step.
    found : Identification or None
        The one model of all files that do not differ.
    errors : mapping of str to mapping
        Free run of that model along each file: ``esr``, ``rmse``, ``unit``, ``mean_error``.
    differing : Differing or None
    diagnoses : mapping of str to FileCauses
        Of the files that differ.
    left_out : mapping of str to str
        Files that take no part in the common model, and why.
    against : str
        What the files that differ were diagnosed against.
    """

    plan: FleetPlan
    outcomes: Mapping[str, Mapping[str, StepOutcome]]
    found: Identification | None
    errors: Mapping[str, Mapping[str, Any]]
    differing: Differing | None
    diagnoses: Mapping[str, FileCauses]
    left_out: Mapping[str, str]
    against: str = ""

    @cached_property
    def warned(self) -> dict[str, tuple[str, ...]]:
        """Names of the faults and warnings that the audit of a file found, of files with any.

        A scheduling variable that is constant in a file, and another in others, is none.
        """
        read = self._findings
        levels: dict[str, list[float | None]] = {}
        for finding in (f for found in read.values() for f in found if f["name"] == CONSTANT):
            levels.setdefault(finding["channel"], []).append(finding["value"])
        vary = {c for c, held in levels.items() if len(set(held)) > 1 or len(held) < len(read)}
        named = {name: tuple(dict.fromkeys(f["name"] for f in found
                                           if f["name"] != CONSTANT or f["channel"] not in vary))
                 for name, found in read.items()}
        return {name: found for name, found in named.items() if found}

    @property
    def faulty(self) -> tuple[str, ...]:
        """Files in which the audit found a fault, to be mended before use."""
        return tuple(name for name, found in self._findings.items() if any(f["severity"] == "fault" for f in found))

    @cached_property
    def _findings(self) -> dict[str, tuple[dict[str, Any], ...]]:
        """Faults and warnings of every file that was audited."""
        return {job.name: steps.findings_of(job) for job in self.plan.jobs
                if "audit" in self.outcomes.get(job.name, {}) and self.outcomes[job.name]["audit"].state == "done"}

    @property
    def causes(self) -> dict[str, tuple[str, ...]]:
        """Names of the causes of each file with a diagnosis."""
        return {name: found.names for name, found in self.diagnoses.items()}

    def esr(self, name: str) -> float:
        """Free-run ESR of the fleet's model along a file, training; infinite where it diverges or was not run.

        Parameters
        ----------
        name : str
            Of the file, as in `Job.name`.

        Returns
        -------
        float
            [1]; 0 is a perfect fit.
        """
        value = self.errors.get(name, {}).get("esr")
        return np.inf if value is None else float(value)

    @property
    def median_esr(self) -> float:
        """Of all files."""
        return float(np.median([self.esr(n) for n in self.errors])) if self.errors else float("nan")

    @property
    def diverging(self) -> tuple[str, ...]:
        """Files along which the free run of the model of all diverges, though it was fitted to them."""
        return tuple(n for n, row in self.errors.items() if row.get("diverged"))

    @property
    def failed(self) -> tuple[str, ...]:
        """Files of which some step was not done."""
        return tuple(n for n, found in self.outcomes.items() if any(o.state != "done" for o in found.values()))

    @property
    def hanging(self) -> tuple[str, ...]:
        """Files of which a step was stopped at the time limit, and the later ones skipped."""
        return tuple(n for n, found in self.outcomes.items() if _stuck(found) is not None)

    @property
    def verdict(self) -> str:
        """One sentence."""
        count = len(self.plan.jobs)
        stated = f"{count - len(self.failed)} of {count} files done"
        if self.failed:
            stated += f", {len(self.failed)} not (first: {self.failed[0]})"
        if self.hanging:
            stated += f", hanging: {', '.join(self.hanging[:3])}"
            stated += f" and {len(self.hanging) - 3} more" if len(self.hanging) > 3 else ""
        if self.differing is None:
            return f"{stated}{self._audited()}."
        named = [n + (f" ({', '.join(self.causes[n])})" if self.causes.get(n) else "") for n in self.differing.named]
        who = f"{len(named)} differ from the fleet's model: {', '.join(named[:6])}" if named else "none differs"
        more = f" and {len(named) - 6} more" if len(named) > 6 else ""
        judged = f"{who}{more}, at a false discovery rate of {self.differing.fdr:g}{'' if named else self._reach()}"
        if not np.isfinite(self.differing.centre):
            judged = f"which of them differ is open: that takes {FEWEST} files"
        return f"{stated}; {judged}{self._audited()}."

    def _spread(self) -> str:
        """Median and largest of the files' free-run errors, and where the run diverges; empty without any."""
        if not self.errors:
            return ""
        worst = max(self.errors, key=self.esr)
        most = "" if not np.isfinite(self.esr(worst)) else f", {self.esr(worst):.4g} at most ({worst})"
        gone = "" if not self.diverging else f"; it diverges in {len(self.diverging)} (first: {self.diverging[0]})"
        median = f"ESR {self.median_esr:.4g} in the median" if np.isfinite(self.median_esr) else "no median ESR"
        return f": {median}{most}{gone}"

    def _reach(self) -> str:
        """How far off a file would have to be to be named, and how far the farthest is."""
        assert self.differing is not None
        d = self.differing
        if not d.q:
            return ""
        farthest = min(d.q, key=lambda n: (d.q[n], -abs(d.score[n])))
        nearest = f"the nearest to it is {farthest} with q = {d.q[farthest]:.2g}"
        if d.needed is None:
            return f" ({nearest})"
        return (f" ({nearest}; of {len(d.q)} files one must lie {d.needed:.2g} times their spread away, which several "
                f"faulty ones widen; of {MANY} files {needed_score(MANY, d.fdr):.2g} times)")

    def _audited(self) -> str:
        """What the audits warn of, in how many files; empty without a warning."""
        if not self.warned:
            return ""
        count = Counter(finding for found in self.warned.values() for finding in found)
        listed = ", ".join(f"{finding} in {n}" for finding, n in count.most_common(4))
        bad = len(self.faulty)
        faults = f"; the audit finds faults in {bad} file{'s' * (bad != 1)}, to be mended first" if bad else ""
        return f"{faults}; the audit warns of {listed}{' and more' if len(count) > 4 else ''}"

    def to_dict(self) -> dict:
        """fleet.json.

        Returns
        -------
        dict
            Verdict and settings, and under "files" one row per file.
        """
        def stated(job: Job) -> dict | None:
            return self.diagnoses[job.name].to_dict() if job.name in self.diagnoses else None

        def row(job: Job) -> dict:
            d = self.differing
            return {"name": job.name, "file": str(job.path), **dict(self.errors.get(job.name, {})),
                    "score": None if d is None else d.score.get(job.name),
                    "q": None if d is None else d.q.get(job.name), "differs": d is not None and job.name in d.named,
                    "causes": list(self.causes.get(job.name, ())), "diagnosis": stated(job),
                    "left_out": self.left_out.get(job.name), "warnings": list(self.warned.get(job.name, ())),
                    "steps": {s: {"state": o.state, "message": o.message if o.state != "done" else "",
                                  "seconds": o.seconds} for s, o in self.outcomes.get(job.name, {}).items()}}

        return {"schema": "lpvid/fleet/1", "verdict": self.verdict, "do": list(self.plan.do), "fdr": self.plan.fdr,
                "diagnosed_against": self.against or None, "figures": FIGURES,
                "files": [row(j) for j in self.plan.jobs]}

    def __str__(self) -> str:
        lines = [f"Fleet: {self.verdict}"]
        if self.found is not None:
            lines += [f"  model of all: {self.found.model}", f"  errors of the files: {FIGURES}{self._spread()}"]
        if self.against:
            lines.append(f"  diagnosed against {self.against}")
        for name in (() if self.differing is None else self.differing.named)[:12]:
            lines.append(f"  {name}: free-run ESR {self.esr(name):.4g} (median of the fleet {self.median_esr:.4g}), "
                         f"q {self.differing.q[name]:.2g}"  # type: ignore[union-attr]
                         + (f"; {self.diagnoses[name]}" if name in self.diagnoses else ""))
        for name, warnings in list(self.warned.items())[:12]:
            lines.append(f"  {name}: the audit warns of {', '.join(warnings)}")
        for name in self.failed[:12]:
            bad = next(o for o in self.outcomes[name].values() if o.state != "done")
            lines.append(f"  {name}: {bad.step} {bad.state}: {bad.message}")
        lines += [f"  {name}: not in the common model: {why}" for name, why in list(self.left_out.items())[:12]]
        return "\n".join(lines)


def _stuck(outcomes: Mapping[str, StepOutcome]) -> StepOutcome | None:
    """The step of a file that was stopped; None where none was."""
    return next((o for o in outcomes.values() if o.state == "stopped"), None)


def run_fleet(plan: FleetPlan, *, scheduler: str | None = None, workers: int | None = None,
              report_progress: Callable[[str], None] = lambda text: None) -> FleetResult:
    """Do a plan; what stands in its folder already is not done again.

    Parameters
    ----------
    plan : FleetPlan
    scheduler : str, optional
        Address of a running Dask scheduler whose workers see the same files; left out, a cluster on this machine.
    workers : int, optional
        Processes of that local cluster; left out, one for each core and no more than files.
    report_progress : callable
        Receives progress.

    Returns
    -------
    FleetResult

    Raises
    ------
    InputError
        Without Dask, or where the scheduler does not answer.
    """
    with connected(scheduler, workers, len(plan.jobs)) as client:
        plan.out.mkdir(parents=True, exist_ok=True)
        outcomes: dict[str, dict[str, StepOutcome]] = {j.name: {} for j in plan.jobs}

        def step_of(step: str, function: Callable[..., StepOutcome], jobs: Sequence[Job], *more: Any
                    ) -> dict[Job, StepOutcome]:
            found = {j: StepOutcome(step, "skipped", f"{stuck.step} {stuck.message}", 0.0, "")
                     for j in jobs if (stuck := _stuck(outcomes.get(j.name, {}))) is not None}
            going = [j for j in jobs if j not in found]
            found |= dict(_stage(client, step, function, going, plan, more, report_progress)) if going else {}
            for job in found.keys() & set(plan.jobs):
                outcomes[job.name][step] = found[job]
            return found

        def stage(step: str, function: Callable[..., StepOutcome], jobs: Sequence[Job], *more: Any) -> list[Job]:
            found = step_of(step, function, jobs, *more)
            return [j for j in jobs if found[j].state == "done"]

        if "audit" in plan.do:
            stage("audit", steps.audit, plan.jobs)
        if "identify" not in plan.do:
            if "diagnose" in plan.do:
                stage("diagnose", steps.diagnose, plan.jobs, plan.baseline, "own")
            return FleetResult(plan, outcomes, None, {}, None, read_causes(plan.jobs), {})
        return _common(plan, stage, step_of, outcomes, report_progress)


def _common(plan: FleetPlan, stage: Callable[..., list[Job]], step_of: Stage,
            outcomes: dict[str, dict[str, StepOutcome]], report_progress: Callable[[str], None]) -> FleetResult:
    """One model of all, the files that differ, and why."""
    from lpvid.export.serialise import save

    ready = stage("scan", steps.scan, plan.jobs)
    facts = {j.name: json.loads(outcomes[j.name]["scan"].message) for j in ready}
    left_out = {j.name: outcomes[j.name]["scan"].message for j in plan.jobs if j not in ready}
    if not ready:
        return FleetResult(plan, outcomes, None, {}, None, {}, left_out)
    rate = 1.0 / float(np.median([f["sample_time"] for f in facts.values()]))
    box = _box(plan, [facts[j.name] for j in ready])
    tag = short_hash((box.names, box.lower, box.upper, round(rate, 9)))
    fitted = stage("identify", steps.factor, ready, box, rate, tag)
    left_out |= {j.name: outcomes[j.name]["identify"].message for j in ready if j not in fitted}
    if not fitted:
        return FleetResult(plan, outcomes, None, {}, None, {}, left_out)
    kept, apart = fitted, None
    for round_ in range(ROUNDS):
        report_progress(f"one model of {len(kept)} files, round {round_ + 1}")
        found = _solved(plan, kept, box, rate)
        path = plan.out / "model" / "model.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        save(found.model, path)
        version = f"{tag}-{short_hash(np.round(found.parameters, 12).tobytes())}"
        theta = found.parameters.reshape(len(plan.structure.output), -1).T
        apart = from_factors({j.name: steps.read_factor(j) for j in fitted}, theta, plan.fdr)
        following = [j for j in fitted if j.name not in apart.named]
        if following == kept or not following:
            break
        kept = following
    assert apart is not None
    judged = stage("judge", steps.judge, fitted, path, rate, version)
    errors = {j.name: json.loads(outcomes[j.name]["judge"].message) for j in judged}
    named = [j for j in fitted if j.name in apart.named]
    causes: dict[str, FileCauses] = {}
    against = ""
    if "diagnose" in plan.do and named:
        healthy = [j for j in fitted if j.name not in apart.named]
        causes, against = diagnosed(plan, path, version, named, healthy, step_of)
    return FleetResult(plan, outcomes, found, errors, apart, causes, left_out, against)


def _box(plan: FleetPlan, facts: Sequence[Mapping[str, Any]]) -> Scheduling:
    """Around the scheduling of all files."""
    names = plan.structure.basis.names
    if not names:
        return Scheduling((), (), ())
    low = np.min([f["low"] for f in facts], axis=0)
    high = np.max([f["high"] for f in facts], axis=0)
    for name, a, b in zip(names, low, high, strict=True):
        if not b > a:
            raise InputError(f"scheduling variable '{name}' is constant over the whole fleet", got=f"{a:.6g}",
                             mend="leave --schedule out, or add files at other levels")
    return Scheduling(names, tuple(low.tolist()), tuple(high.tolist()), units=tuple(facts[0]["units"]))


def _solved(plan: FleetPlan, jobs: Sequence[Job], box: Scheduling, rate: float) -> Identification:
    """The model that the factors of some files hold, in the order of their names."""
    from dataclasses import replace

    in_order = sorted(jobs, key=lambda j: j.name)
    whole = merged_factor([steps.read_factor(j) for j in in_order])
    head = next(iter(steps.records(in_order[0], plan, rate)))
    heads = [replace(head.slice(0, 1), time=None, sample_time=1.0 / rate, name=j.name) for j in in_order]
    bound = replace(plan.structure, basis=plan.structure.basis.bound(box))
    found = bound.solved(heads, box, whole)
    known = found.model.metadata
    training = {**known.get("training", {}), **steps.read_training(in_order)}
    roles = of_files(heads, plan.structure.channels)
    return found.replace(model=found.model.replace(metadata={**known, "training": training, **roles}))




# -- cluster -----------------------------------------------------------------------------------------------------------
@contextmanager
def connected(scheduler: str | None, workers: int | None, files: int | None = None) -> Iterator[Client]:
    """A client of the scheduler at an address, or of a cluster on this machine that ends with it.

    Parameters
    ----------
    scheduler : str or None
        Address, "tcp://host:8786" for instance; None for a cluster on this machine.
    workers : int or None
        Processes of that cluster; None for one per core. Without effect where a scheduler is named.
    files : int, optional
        Most processes where `workers` is None: more would have nothing to do.

    Yields
    ------
    distributed.Client
        Closed at the end; a scheduler at an address goes on.

    Raises
    ------
    InputError
        Dask is not installed, or the scheduler does not answer.
    """
    try:
        from dask import config
        from dask.system import CPU_COUNT
        from distributed import Client, LocalCluster
    except ImportError:
        raise InputError("a fleet needs Dask", mend="pip install 'lpvid[scale]'") from None
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=SCHEDULER_TIMEOUT)
        except (OSError, ValueError) as error:
            raise InputError(f"the scheduler at '{scheduler}' does not answer", why=str(error).splitlines()[0],
                             mend="start one with dask scheduler, or leave --scheduler out") from None
        try:
            yield client
        finally:
            client.close()
        return
    cores = min(CPU_COUNT, processors())  # CPU_COUNT knows the limits of a container as well
    count = workers or min(cores, files or cores)
    share = max(cores // count, 1)  # of each worker and the commands that it starts: no forks beyond the cores
    plain: dict[str, Any] = {"dashboard_address": None, "env": {SHARE: str(share)}}
    with config.set({"distributed.scheduler.allowed-failures": 5}):
        cluster = LocalCluster(n_workers=count, threads_per_worker=1, processes=True, silence_logs=50, **plain)
        with cluster, Client(cluster) as client:
            yield client


def _stage(client: Client, step: str, function: Callable[..., StepOutcome], jobs: Sequence[Job], plan: FleetPlan,
           more: tuple[Any, ...], report_progress: Callable[[str], None]) -> Iterator[tuple[Job, StepOutcome]]:
    """One step of many files; a file whose workers are killed again and again is reported; the others go on."""
    from distributed import as_completed

    shared = client.scatter(plan, broadcast=True, hash=False) if len(jobs) > 1 else plan
    futures = {client.submit(function, job, shared, *more, pure=False, retries=plan.retries): job for job in jobs}
    for count, future in enumerate(as_completed(futures), 1):
        job = futures[future]
        try:
            found = future.result()
        except Exception as error:  # whatever a worker met: the rest goes on, and this file states so
            stated = str(error).splitlines()[0] if str(error) else type(error).__name__
            found = keep(job, StepOutcome(step, "died", f"{LOST}: {stated}"[:300], 0.0, "died"))
        report_progress(f"{step}: {count} of {len(jobs)} files")
        yield job, found
