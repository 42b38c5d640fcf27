"""State of a file's steps on disk: what is done, with what outcome, for which version of file and settings."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path

from lpvid.export.json_files import write_text
from lpvid.fleet.plan import Job

FILE = "state.json"


@dataclass(frozen=True)
class StepOutcome:
    """How a step of a file ended.

    Attributes
    ----------
    step : str
    state : {"done", "refused", "stopped", "died", "skipped"}
        Refused: the input is at fault. Stopped: the time limit. Died: its process ended without a word. Skipped: an
        earlier step of the file was stopped; not kept, so that the next run tries.
    message : str
    seconds : float
    key : str
        Hash of settings and file that this outcome is of.
    """

    step: str
    state: str
    message: str
    seconds: float
    key: str

    @property
    def final(self) -> bool:
        """Whether trying again would give the same."""
        return self.state in ("done", "refused")


def stamp(path: Path, key: str) -> str:
    """Key of a step with the version of the file that it reads.

    Parameters
    ----------
    path : Path
        File that the step reads.
    key : str
        Of step and settings, from `FleetPlan.key`.

    Returns
    -------
    str
        The key with size [byte] and time of modification [ns] of the file.
    """
    about = path.stat()
    return f"{key}-{about.st_size}-{about.st_mtime_ns}"


def short_hash(about: object) -> str:
    """Twelve digits that differ where what a step depends on does.

    Parameters
    ----------
    about : object
        Bytes, or anything with a representation of its own.

    Returns
    -------
    str
    """
    return hashlib.sha256(about if isinstance(about, bytes) else repr(about).encode()).hexdigest()[:12]


def outcome(job: Job, step: str, key: str) -> StepOutcome | None:
    """What stands on disk for a step of the same file and settings; None where there is nothing.

    Parameters
    ----------
    job : Job
        One file with the folder of its results.
    step : str
        Name of the step.
    key : str
        From `stamp`, with what else the step depends on.

    Returns
    -------
    StepOutcome or None
        None also where the file or a setting has changed since.
    """
    found = _read(job.folder).get(step)
    return StepOutcome(**found) if found is not None and found["key"] == key else None


def keep(job: Job, found: StepOutcome) -> StepOutcome:
    """Write an outcome beside those of the other steps.

    Parameters
    ----------
    job : Job
        One file with the folder of its results; that is made where it does not exist.
    found : StepOutcome
        It replaces an earlier outcome of the same step.

    Returns
    -------
    StepOutcome
        The same.
    """
    job.folder.mkdir(parents=True, exist_ok=True)
    steps = {**_read(job.folder), found.step: asdict(found)}
    write_text(json.dumps(steps, indent=1) + "\n", job.folder / FILE)
    return found


def _read(folder: Path) -> dict[str, dict]:
    try:
        data = json.loads((folder / FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return data if isinstance(data, dict) else {}
