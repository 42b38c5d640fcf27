"""Where a report comes from: date, command, version, the files that were read and those that were written."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

DIGITS = 12
"""Hexadecimal digits of SHA-256 that a report shows: two of a thousand files share them once in 10⁸ reports."""
CHUNK = 1 << 20
DESCRIPTIONS = {"model.json": "the model, for lpvid validate, simulate, stability, export and quartercar design, ride",
        "identification.json": "all figures, parameters and remarks",
        "selection.json": "the whole ranking of structures", "state_space.json": "the model as a state space",
        "form.json": "figures of the re-estimated form", "validation.json": "all figures", "audit.json": "all findings",
        "simulation.json": "figures of the runs", "compare.json": "all figures", "stability.json": "everything found",
        "certificate.json": "the proof, for lpvid verify", "closed_loop.json": "what the certificate was made for",
        "controller.json": "the controller, for quartercar ride and export", "synthesis.json": "everything found",
        "diagnosis.json": "everything found", "extended_model.json": "the extended model",
        "extended_lpv.json": "the causes in an LPV model", "experiment.toml": "the experiment, for quartercar rig",
        "comparison.json": "all figures", "ride.json": "all figures", "demo.json": "everything found",
        "plan.toml": "the plan", "simulation.csv": "measured, simulated, residual and scheduling, sample by sample",
        "locus.png": "the figure of the poles", "fleet.json": "everything found", "fleet.csv": "one row for each file",
        "characterisation.json": "everything that was read off", "forces.csv": "forces at the standard speeds",
        "characteristics.csv": "every other quantity, with its standard error",
        "velocity_histogram.csv": "shares of the time by class of velocity"}


@dataclass(frozen=True)
class Source:
    """A file that was read: its name and the first digits of its SHA-256.

    Attributes
    ----------
    name : str
        Path, as it was given.
    digest : str
        `DIGITS` hexadecimal digits.
    """

    name: str
    digest: str


@dataclass(frozen=True)
class Origin:
    """How a page came about.

    Attributes
    ----------
    command : str
        As it would be typed.
    when : datetime or None
        With its time zone.
    sources : tuple of Source
    files : tuple of str
        What stands beside the report in its folder.
    folder : str
        That folder, as it was named.
    """

    command: str = ""
    when: datetime | None = None
    sources: tuple[Source, ...] = ()
    files: tuple[str, ...] = ()
    folder: str = ""

    @property
    def date(self) -> str:
        """The date for a reader.

        Examples
        --------
        >>> from datetime import timezone
        >>> Origin(when=datetime(2011, 3, 4, 17, 5, tzinfo=timezone.utc)).date
        '4 March 2011, 17:05 UTC'
        """
        return "" if self.when is None else f"{self.when.day} {self.when:%B %Y, %H:%M %Z}"

    def listed(self) -> list[tuple[str, str]]:
        """Files with what they hold.

        Returns
        -------
        list of (str, str)
            Name and description, by `DESCRIPTIONS`; "" for a file that is not described there.
        """
        return [(name, DESCRIPTIONS.get(name, "")) for name in self.files]


def sources_of(paths: Iterable[Path]) -> tuple[Source, ...]:
    """Files with their hashes; those that are gone are left out.

    Parameters
    ----------
    paths : iterable of Path
        Files that were read; one that comes twice counts once.

    Returns
    -------
    tuple of Source
        In the same order; files that cannot be read are left out too.
    """
    found = []
    for path in dict.fromkeys(paths):
        digest = hashlib.sha256()
        try:
            with path.open("rb") as stream:
                while chunk := stream.read(CHUNK):
                    digest.update(chunk)
        except OSError:
            continue
        found.append(Source(str(path), digest.hexdigest()[:DIGITS]))
    return tuple(found)


def shown_names(sources: Sequence[Source]) -> list[tuple[str, str]]:
    """(name, digest), with as much of the path as separates the files.

    Parameters
    ----------
    sources : sequence of Source
        Files that were read.

    Returns
    -------
    list of (str, str)
        The file's name, with its folder in front where another file has the same name.
    """
    paths = [Path(s.name) for s in sources]
    names = [p.name for p in paths]
    short = [name if names.count(name) == 1 else str(Path(*p.parts[-2:])) for name, p in zip(names, paths, strict=True)]
    return [(name, s.digest) for name, s in zip(short, sources, strict=True)]
