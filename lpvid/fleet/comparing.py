"""Causes of one file relative to its fleet: what healthy files share is part of the law, and no cause of a file."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lpvid.fleet import steps
from lpvid.fleet.causes import FileCauses, read_causes
from lpvid.fleet.differing import CONSISTENT, EFFICIENCY, FEWEST
from lpvid.fleet.plan import FleetPlan, Job
from lpvid.fleet.state import StepOutcome, short_hash

POOLED = 4
"""healthy files that are diagnosed together: what one specimen of four has in 3 % less of is lost among the others"""
SHARING = 20
"""healthy files from which the spread between specimens is taken: a median absolute deviation of 20 normal values has a
relative standard error of 26 %"""
ROUNDS = 3
"""diagnoses of the pooled files at most, each beside what the one before found: a set holds four causes"""

Stage = Callable[..., Mapping[Job, StepOutcome]]


def diagnosed(plan: FleetPlan, model: Path, version: str, named: Sequence[Job], healthy: Sequence[Job],
              stage: Stage) -> tuple[dict[str, FileCauses], str]:
    """Diagnose the files that differ against what the healthy ones share.

    1. Some healthy files together are diagnosed, again and again beside what was found, until nothing more is: law and
       causes that the fleet shares.
    2. Its numbers are refitted along each of up to twenty healthy files: the spread between specimens.
    3. A file that differs is diagnosed against that law, whose numbers stay within this spread. A cause that the fleet
       has is a cause of the file where its strength does not (`effects.fleet_law.FleetLaw`).
    4. The strengths of its causes are refitted in healthy files: one that lies within their spread is the fleet's.

    Parameters
    ----------
    plan : FleetPlan
    model : Path
        The fleet's model, from which it starts where no law suits.
    version : str
        Of that model.
    named, healthy : sequences of Job
        Files that differ, and those that do not.
    stage : callable
        Runs a step of many files.

    Returns
    -------
    causes : dict of str to FileCauses
    against : str
        What the files were diagnosed against, in words.
    """
    law, tag, why = shared_law(plan, model, version, _spread(healthy, POOLED), stage)
    if law is None:  # nothing is known of what they share
        stage("diagnose", steps.diagnose, named, plan.baseline or model, version)
        return read_causes(named), f"{plan.baseline or 'the model of all'}, without what healthy files share: {why}"
    some = _spread(healthy, SHARING)
    found = stage("specimen", steps.specimen, some, law, tag)
    usable = [j for j in some if found[j].state == "done"]
    start = _bounded(law, [json.loads(found[j].message) for j in usable])
    tag = f"{tag}-{short_hash(start.read_bytes())}"
    done = stage("diagnose", steps.diagnose, named, start, tag)
    files = [j for j in named if done[j].state == "done"]
    strengths = stage("compare", steps.compare, files, usable, tag)
    causes = read_causes(named)
    found_causes = {n: causes[n] if j not in strengths or strengths[j].state != "done" else
                    _beside(causes[n], json.loads(strengths[j].message), plan.fdr)
                    for j in named if (n := j.name) in causes}
    return found_causes, _described(start, len(usable))


def shared_law(plan: FleetPlan, model: Path, version: str, some: Sequence[Job], stage: Stage
               ) -> tuple[Path | None, str, str]:
    """Law and causes that some healthy files share.

    Parameters
    ----------
    plan : FleetPlan
    model : Path
        The fleet's model.
    version : str
        Of that model.
    some : sequence of Job
        Healthy files.
    stage : callable

    Returns
    -------
    law : Path or None
        The file that holds them; None where no diagnosis works.
    tag : str
        Its version.
    why : str
        What the last diagnosis that did not work states.
    """
    from lpvid.diagnosis.task import AUTO
    from lpvid.effects.fleet_law import FleetLaw
    from lpvid.export.serialise import load, save

    begun = [plan.baseline] if plan.baseline else [AUTO, str(model)]
    law, start, count, why = None, begun.pop(0), 0, "no file is healthy"
    tag = f"{version}-{short_hash([j.name for j in some])}"
    while some and count < ROUNDS:
        job = Job(some[0].path, "healthy files together", model.parent / f"shared-{count + 1}")
        done = stage("pool", steps.pool, [job], [j.path for j in some], start, f"{tag}-{short_hash(start)}")
        if done[job].state != "done":
            why = f"{start}: {done[job].message}"
            if not begun or law is not None:
                break
            start = begun.pop(0)
            continue
        found = load(job.folder / "diagnosis" / "extended_model.json")
        if law is not None and not found.effects:
            break
        count += 1
        law = model.parent / f"law-{count}.json"
        save(FleetLaw.free(found), law)
        start, tag = str(law), f"{tag}-{short_hash(law.read_bytes())}"
    return law, tag, why


def _described(law: Path, specimens: int) -> str:
    from lpvid.export.serialise import load

    found = load(law)
    shared = ", ".join(found.shared.effects) or "no causes"
    return f"{found.inner.baseline.name} with what healthy files share ({shared}), from {specimens} of them"


def _beside(causes: FileCauses, found: Mapping[str, Mapping[str, Any]], fdr: float) -> FileCauses:
    return causes.beside(shared_causes(found, fdr), {name: stated_strength(s) for name, s in found.items()})


def stated_strength(strengths: Mapping[str, Any]) -> str:
    """The strengths of a cause in a file and the median of healthy files, in words.

    Parameters
    ----------
    strengths : mapping
        ``names``, ``units``, ``here``, ``healthy`` as `strengths.strengths` gives them.

    Returns
    -------
    str

    Examples
    --------
    >>> stated_strength({"names": ["friction"], "units": ["N"], "here": [110.0], "healthy": [[19.0], [20.0], [22.0]]})
    'friction 110 N, 20 N in healthy files'
    """
    middle = np.median(np.array(strengths["healthy"], dtype=float), axis=0) if strengths["healthy"] else []
    return "; ".join(f"{n} {here:.4g} {u}".rstrip() + (f", {middle[k]:.4g} {u}".rstrip() + " in healthy files"
                                                       if len(middle) else "")
                     for k, (n, u, here) in enumerate(zip(strengths["names"], strengths["units"], strengths["here"],
                                                          strict=True)))


def shared_causes(found: Mapping[str, Mapping[str, Any]], fdr: float) -> tuple[str, ...]:
    """Causes whose strengths in a file lie within the spread of healthy files.

    Student's t of the distance from their median in standard deviations by the median absolute deviation, with 0.37 n
    degrees of freedom as in `differing`, two-sided; the smallest p-value of several strengths times their number.

    Parameters
    ----------
    found : mapping of str to mapping
        Per cause ``here``, its strengths in the file, and ``healthy``, a list of them for each healthy file.
    fdr : float
        p-value above which a strength is one of the fleet.

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> healthy = [[19.0], [20.0], [21.0], [20.5], [19.5], [20.2], [19.9], [20.1]]
    >>> shared_causes({"friction": {"here": [20.4], "healthy": healthy}}, 0.05)
    ('friction',)
    >>> shared_causes({"friction": {"here": [110.0], "healthy": healthy}}, 0.05)
    ()
    """
    from scipy.stats import t

    out = []
    for name, strengths in found.items():
        values, here = np.array(strengths["healthy"], dtype=float), np.array(strengths["here"], dtype=float)
        if len(values) < FEWEST:
            continue
        away = np.abs(here - np.median(values, axis=0))
        spread = CONSISTENT * np.median(np.abs(values - np.median(values, axis=0)), axis=0)
        tiny = np.finfo(float).eps * np.abs(here)
        p = 2 * t.sf(away / np.maximum(spread, np.maximum(tiny, 1e-300)), EFFICIENCY * len(values))
        if float(p.min()) * p.size > fdr:
            out.append(name)
    return tuple(out)


def _bounded(law: Path, specimens: Sequence[Sequence[float]]) -> Path:
    """The law within the spread of specimens, as a file; free where they are too few for a spread."""
    from lpvid.effects.fleet_law import FleetLaw
    from lpvid.export.serialise import load, save

    if len(specimens) < FEWEST:
        return law
    path = law.with_name("baseline.json")
    save(FleetLaw.of(load(law).shared, [np.array(s) for s in specimens]), path)
    return path


def _spread(jobs: Sequence[Job], count: int) -> list[Job]:
    """So many of them, evenly in their order."""
    return [jobs[k] for k in np.unique(np.linspace(0, len(jobs) - 1, count).round().astype(int))] if jobs else []
