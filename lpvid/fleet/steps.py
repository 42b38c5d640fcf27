"""The steps of one file, as any worker runs them: each leaves its results and its outcome on disk."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from queue import Empty, Queue
from threading import Thread
from typing import TYPE_CHECKING, Any

import numpy as np

from lpvid.errors import InputError
from lpvid.fleet.plan import FleetPlan, Job
from lpvid.fleet.state import StepOutcome, keep, outcome, stamp
from lpvid.identification.regression import Factor
from lpvid.identification.streaming import stream_factor
from lpvid.record import Record
from lpvid.scheduling import Scheduling
from lpvid.training_rows import TrainingRows

if TYPE_CHECKING:
    from lpvid.files.streaming import Chunks

LARGE = 256e6
"""Bytes of a CSV or Parquet file above which it is read in parts."""
ROWS = 500_000
"""Samples of a part."""


def audit(job: Job, plan: FleetPlan) -> StepOutcome:
    """`lpvid inspect` in a process of its own.

    Parameters
    ----------
    job : Job
        One file with the folder of its results.
    plan : FleetPlan
        Its roles, limit and retries are used.

    Returns
    -------
    StepOutcome
        The audit itself stands in the folder ``audit``.
    """
    words = ["inspect", str(job.path), "--out", str(job.folder / "audit"), "--json", *_roles(plan)]
    return _command("audit", job, plan, words, stamp(job.path, plan.key("audit")))


def findings_of(job: Job) -> tuple[dict[str, Any], ...]:
    """Faults and warnings in the audit of a file.

    Parameters
    ----------
    job : Job

    Returns
    -------
    tuple of dict
        As in its audit.json; empty where no audit is there.
    """
    path = job.folder / "audit" / "audit.json"
    if not path.is_file():
        return ()
    found = json.loads(path.read_text(encoding="utf-8"))["findings"]
    return tuple(f for f in found if f["severity"] in ("fault", "warning"))


def scan(job: Job, plan: FleetPlan) -> StepOutcome:
    """Range of the scheduling variables, period and length: what all files must agree on before a common fit.

    Parameters
    ----------
    job : Job
        One file with the folder of its results.
    plan : FleetPlan
        Its structure states the channels.

    Returns
    -------
    StepOutcome
        Its message holds as JSON: low, high and units of each variable, samples, duration [s] and sample_time [s].
        Refused for a file without a record, a record without a uniform clock or without a channel.
    """

    def work() -> str:
        names = plan.structure.basis.names
        low, high = np.full(len(names), np.inf), np.full(len(names), -np.inf)
        units: tuple[str, ...] = ("",) * len(names)
        samples, duration, period = 0, 0.0, None
        for record in records(job, plan, None):
            if record.sample_time is None:
                raise InputError(f"record '{record.name}' has no uniform clock", mend="resample it before")
            for name in plan.structure.channels:
                record.channel(name)
            p = record.matrix(names)
            low, high = np.fmin(low, np.fmin.reduce(p)), np.fmax(high, np.fmax.reduce(p))
            units = tuple(record.unit(n) for n in names)
            samples, duration = samples + record.n_samples, duration + record.duration
            period = record.sample_time
        if period is None:
            raise InputError(f"'{job.path}' holds no record", mend="leave it out")
        data = {"low": low.tolist(), "high": high.tolist(), "units": units, "samples": samples, "duration": duration,
                "sample_time": period}
        return json.dumps(data)

    return _here("scan", job, stamp(job.path, plan.key("scan")), work, plan.limit)


def factor(job: Job, plan: FleetPlan, box: Scheduling, rate: float, tag: str) -> StepOutcome:
    """R of the file's regression, as factor.npz.

    Parameters
    ----------
    job : Job
        One file with the folder of its results.
    plan : FleetPlan
        With the structure of the common model.
    box : Scheduling
        Of all files together.
    rate : float
        Of all files [Hz].
    tag : str
        Hash of box and rate: another one makes the step run again.

    Returns
    -------
    StepOutcome
        Its message is the number of samples.
    """

    def work() -> str:
        found = stream_factor(records(job, plan, rate), plan.structure, box)
        target = job.folder / "factor.npz"
        part = target.with_suffix(".part.npz")
        training = json.dumps({"rows": found.rows.state(), "ranges": found.ranges})
        np.savez(part, r=found.factor.r, rows=found.factor.rows, columns=found.factor.columns, training=training)
        part.replace(target)
        return f"{found.samples} samples"

    return _here("identify", job, f"{stamp(job.path, plan.key('identify'))}-{tag}", work, plan.limit)


def judge(job: Job, plan: FleetPlan, model: Path, rate: float, tag: str) -> StepOutcome:
    """Free run of the fleet's model along the file: error, power of the output.

    Parameters
    ----------
    job : Job
        One file with the folder of its results.
    plan : FleetPlan
        Its roles and channels are used.
    model : Path
        File of the fleet's model.
    rate : float
        Of all files [Hz].
    tag : str
        Hashes of box, rate and model: another one makes the step run again.

    Returns
    -------
    StepOutcome
        Its message holds as JSON: esr, rmse, unit, mean_error and whether the run diverged.
    """

    def work() -> str:
        from lpvid.export.serialise import load
        from lpvid.files.streaming import Chunks
        from lpvid.validation import validate

        fitted = load(model)
        data = records(job, plan, rate)
        if isinstance(data, Chunks) and plan.structure.basis.lags[0] < 0:
            data = list(data)  # no stream reads the scheduling ahead of time
        found = validate(fitted, data, label="training")
        free = found.overall.free_run
        return json.dumps({"esr": free.esr, "rmse": free.rmse, "unit": free.rmse_unit, "mean_error": free.mean_error,
                           "diverged": free.diverged_at is not None})

    return _here("judge", job, f"{stamp(job.path, plan.key('identify'))}-{tag}", work, plan.limit)


def diagnose(job: Job, plan: FleetPlan, baseline: str | Path, tag: str) -> StepOutcome:
    """`lpvid diagnose` against a law or a model, in a process of its own.

    Parameters
    ----------
    job : Job
        One file with the folder of its results.
    plan : FleetPlan
        Its roles, limit and retries are used.
    baseline : str or Path
        Name of a law, or file of a law or model.
    tag : str
        Version of the baseline, "own" or hashes: another one makes the step run again.

    Returns
    -------
    StepOutcome
        The diagnosis itself stands in the folder ``diagnosis``.
    """
    return _diagnosis("diagnose", job, plan, [job.path], str(baseline), tag)


def pool(job: Job, plan: FleetPlan, paths: Sequence[Path], baseline: str, tag: str) -> StepOutcome:
    """`lpvid diagnose` of some healthy files together.

    Parameters
    ----------
    job : Job
    plan : FleetPlan
    paths : sequence of Path
    baseline : str
    tag : str

    Returns
    -------
    StepOutcome
    """
    return _diagnosis("pool", job, plan, paths, baseline, tag)


def specimen(job: Job, plan: FleetPlan, law: Path, tag: str) -> StepOutcome:
    """Parameters of the law that healthy files share, refitted along one of them.

    Parameters
    ----------
    job : Job
    plan : FleetPlan
    law : Path
    tag : str

    Returns
    -------
    StepOutcome
        Its message holds them as JSON.
    """

    def work() -> str:
        from lpvid.export.serialise import load
        from lpvid.fleet.strengths import refitted

        return json.dumps(refitted(load(law), _whole(job, plan)).tolist())

    return _here("specimen", job, f"{stamp(job.path, plan.key('diagnose'))}-{tag}", work, plan.limit)


def compare(job: Job, plan: FleetPlan, healthy: Sequence[Job], tag: str) -> StepOutcome:
    """Strengths of a file's causes in that file and, refitted, in healthy ones.

    Parameters
    ----------
    job : Job
    plan : FleetPlan
    healthy : sequence of Job
    tag : str

    Returns
    -------
    StepOutcome
        Its message holds them as JSON (`strengths.strengths`).
    """

    def work() -> str:
        from lpvid.export.serialise import load
        from lpvid.fleet.strengths import strengths

        extended = load(job.folder / "diagnosis" / "extended_model.json")
        found = strengths(extended, [_whole(j, plan) for j in healthy]) if extended.effects else {}
        return json.dumps(found)

    return _here("compare", job, f"{stamp(job.path, plan.key('diagnose'))}-{tag}", work, plan.limit)


def _whole(job: Job, plan: FleetPlan) -> list[Record]:
    from lpvid.files import read

    return list(read(job.path, roles=plan.roles))


def _diagnosis(step: str, job: Job, plan: FleetPlan, paths: Sequence[Path], baseline: str, tag: str) -> StepOutcome:
    words = ["diagnose", *map(str, paths), "--baseline", baseline, "--out", str(job.folder / "diagnosis"), "--json",
             *_roles(plan)]
    return _command(step, job, plan, words, f"{stamp(job.path, plan.key('diagnose'))}-{tag}")


def records(job: Job, plan: FleetPlan, rate: float | None) -> Sequence[Record] | Chunks:
    """The file's records at one rate; a large file in parts, where nothing has to be made of it as a whole.

    Parameters
    ----------
    job : Job
        The file.
    plan : FleetPlan
        With roles, and the channels of its structure.
    rate : float or None
        Rate to resample to [Hz]; None for the file's own.

    Returns
    -------
    sequence of Record or Chunks
        Of a CSV or Parquet file above `LARGE` its parts, at most `ROWS` samples each, where its first part has this
        rate already and no channel has to be derived: both need whole records.
    """
    from lpvid.condition import segments, with_derived
    from lpvid.files import read
    from lpvid.files.streaming import read_chunks

    channels = plan.structure.channels
    if job.path.stat().st_size > LARGE and job.path.suffix.lower() in (".csv", ".parquet"):
        parts = read_chunks(job.path, ROWS, roles=plan.roles)
        first = next(iter(parts), None)
        if first is None or _usable(first, channels, rate):
            return parts
    found = with_derived(read(job.path, roles=plan.roles), channels)
    return found if rate is None else segments(found, channels, sample_rate=rate, minimum=1)


def _usable(part: Record, channels: Sequence[str], rate: float | None) -> bool:
    """Whether a part of a record is at the rate requested, with all that a model reads measured."""
    from lpvid.condition import with_derived
    from lpvid.condition.segmentation import RATE_TOLERANCE

    base = part.time_base
    timely = rate is None or (base.steady and abs(rate * base.period - 1) <= RATE_TOLERANCE)
    return timely and list(with_derived([part], channels)[0].channels) == list(part.channels)


def read_factor(job: Job) -> Factor:
    """What `factor` left.

    Parameters
    ----------
    job : Job
        A file whose step `factor` is done.

    Returns
    -------
    Factor
        Read from ``factor.npz`` in its folder.
    """
    with np.load(job.folder / "factor.npz") as data:
        return Factor(data["r"], int(data["rows"]), int(data["columns"]))


def read_training(jobs: Sequence[Job]) -> dict[str, Any]:
    """What a model keeps of its training data, from what `factor` left of several files.

    Parameters
    ----------
    jobs : sequence of Job
        Files whose step `factor` is done.

    Returns
    -------
    dict
        Prints of rows and range of each channel; empty where a file was done by a version that kept none.
    """
    several = []
    for job in jobs:
        with np.load(job.folder / "factor.npz") as data:
            if "training" not in data:
                return {}
            several.append(json.loads(str(data["training"])))
    names = dict.fromkeys(n for one in several for n in one["ranges"])
    spans = {n: np.array([one["ranges"][n] for one in several if n in one["ranges"]]) for n in names}
    rows = TrainingRows.merged([TrainingRows.restored(one["rows"]) for one in several])
    return {"rows": rows.to_dict(),
            "ranges": {n: [float(s[:, 0].min()), float(s[:, 1].max())] for n, s in spans.items()}}


def _roles(plan: FleetPlan) -> list[str]:
    return [word for role, channel in plan.roles.items() for word in ("--role", f"{role}={channel}")]


def _here(step: str, job: Job, key: str, work: Callable[[], str], limit: float) -> StepOutcome:
    """A step inside the worker, in a thread that is left behind where it hangs beyond the limit."""
    found = outcome(job, step, key)
    if found is not None and found.final:
        return found
    begun, ended = time.monotonic(), Queue[tuple[str, str] | Exception]()

    def run() -> None:
        try:
            ended.put((work(), "done"))
        except InputError as error:
            ended.put((" ".join(str(error).split()), "refused"))
        except Exception as error:  # handed to the thread that waits, and from there to Dask
            ended.put(error)

    Thread(target=run, daemon=True).start()
    try:
        answer = ended.get(timeout=limit)
    except Empty:
        answer = f"stopped after {limit:g} s", "stopped"
    if isinstance(answer, Exception):
        raise answer
    return keep(job, StepOutcome(step, answer[1], answer[0], round(time.monotonic() - begun, 3), key))


def _command(step: str, job: Job, plan: FleetPlan, words: Sequence[str], key: str) -> StepOutcome:
    """A step as a command in a process of its own, stopped after the limit; tried again where its process died."""
    found = outcome(job, step, key)
    if found is not None and found.final:
        return found
    begun = time.monotonic()
    state, message = "died", ""
    for _ in range(1 + plan.retries):
        state, message = _once(words, plan.limit)
        if state != "died":
            break
    return keep(job, StepOutcome(step, state, message, round(time.monotonic() - begun, 3), key))


def _once(words: Sequence[str], limit: float) -> tuple[str, str]:
    quiet = {**os.environ, "LPVID_PROGRESS": "quiet", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run([sys.executable, "-m", "lpvid", *words], capture_output=True, text=True, timeout=limit,
                              env=quiet, check=False)
    except subprocess.TimeoutExpired:
        return "stopped", f"stopped after {limit:g} s"
    if done.returncode in (0, 3):
        return "done", ""
    last = (done.stderr.strip().splitlines() or [""])[-1]
    if done.returncode == 2:
        return "refused", last.removeprefix("error: ")
    return "died", f"exit code {done.returncode}: {last}"
