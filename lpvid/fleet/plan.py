"""What is to be done with which file, and where its results go."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.identification.arx import ARX
from lpvid.scheduling import Polynomial

STEPS = ("audit", "identify", "diagnose")
"""What can be done with every file, in order."""


@dataclass(frozen=True)
class Job:
    """One file.

    Attributes
    ----------
    path : Path
    name : str
        Unique in the fleet: the path below the common folder, with "__" between folders.
    folder : Path
        Where its results go.
    """

    path: Path
    name: str
    folder: Path


@dataclass(frozen=True)
class FleetPlan:
    """Files, steps and settings of a fleet.

    Attributes
    ----------
    jobs : tuple of Job
    do : tuple of str
        Of `STEPS`.
    out : Path
    structure : ARX
        Of the one model of all files.
    roles : mapping of str to str
    baseline : str or None
        Law or model file from which `diagnose` starts; None for the installed law that suits healthy files best, or the
        fleet's own model where none does.
    fdr : float
        Share of false names among the files that are named, at most.
    limit : float
        Seconds after which a step of a file is stopped; the later ones of that file are skipped.
    retries : int
        Further attempts at a step whose process died.
    """

    jobs: tuple[Job, ...]
    do: tuple[str, ...]
    out: Path
    structure: ARX
    roles: Mapping[str, str] = field(default_factory=dict)
    baseline: str | None = None
    fdr: float = 0.05
    limit: float = 600.0
    retries: int = 2

    def key(self, step: str) -> str:
        """Hash of what the result of a step depends on beside its file.

        Parameters
        ----------
        step : str
            "audit", "scan", "identify" or "diagnose".

        Returns
        -------
        str
            16 hexadecimal digits: of the roles, of the structure but for the audit, of the baseline for a diagnosis.
        """
        about: dict[str, Any] = {"step": step, "roles": dict(self.roles)}
        if step != "audit":
            about["structure"] = self.structure.to_dict()
        if step == "diagnose":
            about |= {"baseline": self.baseline}
        return hashlib.sha256(json.dumps(about, sort_keys=True, default=str).encode()).hexdigest()[:16]


def plan_fleet(paths: Sequence[str], out: str | os.PathLike, *, do: Sequence[str] = ("audit", "identify"),
               structure: ARX | None = None, roles: Mapping[str, str] | None = None, baseline: str | None = None,
               fdr: float = 0.05, limit: float = 600.0,
               retries: int = 2) -> FleetPlan:
    """A plan over files, patterns (``**`` goes through folders) and folders.

    Parameters
    ----------
    paths : sequence of str
    out : path
    do : sequence of str
        Of `STEPS`; "diagnose" needs "identify" unless it has a baseline of its own.
    structure : ARX, optional
        Left out: velocity to force, four lags each from lag 0, with a constant.
    roles, baseline, fdr, limit, retries
        As in `FleetPlan`.

    Returns
    -------
    FleetPlan

    Raises
    ------
    InputError
        No file, an unknown step, settings out of range.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> for name in ("a/run.csv", "b/run.csv"):
    ...     (folder / name).parent.mkdir()
    ...     _ = (folder / name).write_text("time [s],velocity [m/s],force [N]")
    >>> [job.name for job in plan_fleet([f"{folder}/**/*.csv"], folder / "out").jobs]
    ['a__run', 'b__run']
    """
    from lpvid.files import find

    found = find(paths)
    for step in do:
        _checks.known_name(step, STEPS, "step")
    if "diagnose" in do and "identify" not in do and baseline is None:
        raise InputError("a diagnosis needs a model to judge", got="--do without identify",
                         mend="--do audit,identify,diagnose, or --baseline LAW")
    if not 0.0 < fdr < 1.0:
        raise InputError("the false discovery rate lies between 0 and 1", got=f"{fdr:g}")
    home = Path(out)
    names = _names(found)
    arx = structure or ARX(4, 4, 0, "velocity", "force", Polynomial(), affine=1)
    return FleetPlan(tuple(Job(p, n, home / "files" / n) for p, n in zip(found, names, strict=True)),
                     tuple(s for s in STEPS if s in do), home, arx, dict(roles or {}), baseline, fdr,
                     _checks.positive(limit, "limit", "s"), retries)


def _names(paths: Sequence[Path]) -> list[str]:
    """Unique names: the path below the common folder, without the suffix unless two differ in it alone."""
    whole = [p.absolute() for p in paths]
    common = Path(os.path.commonpath([p.parent for p in whole]))
    parts = [p.relative_to(common) for p in whole]
    bare = ["__".join(p.with_suffix("").parts) for p in parts]
    return [b if bare.count(b) == 1 else "__".join(p.parts) for b, p in zip(bare, parts, strict=True)]
