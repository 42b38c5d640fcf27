"""What the diagnosis of one file of a fleet names: causes with their probabilities, and their rivals."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from lpvid.fleet.plan import Job


@dataclass(frozen=True)
class FileCauses:
    """Causes of one file, as its diagnosis.json holds them.

    Attributes
    ----------
    names : tuple of str
        Named causes.
    probabilities : tuple of (float or None)
        That each is there, calibrated on cases of two rigs with named laws as baselines; None where none was computed.
    rivals : tuple of tuple of str
        Groups of causes that the file's data cannot distinguish.
    verdict : str
    strengths : mapping of str to str
        Of a cause, its strength here and the median of healthy files, in words.
    shared : tuple of str
        Causes that its diagnosis names and healthy files have as strongly: no causes of this file.

    Examples
    --------
    >>> str(FileCauses(("coil-lag",), (0.934,), (("payload", "gas-stiffness"),), "partly-explained"))
    'coil-lag (probability 0.93); payload or gas-stiffness'
    >>> str(FileCauses((), (), (), "unexplained"))
    'unexplained'
    >>> both = FileCauses(("coil-lag", "asymmetry"), (0.9, 0.8), (), "explained")
    >>> str(both.beside(["asymmetry"], {"coil-lag": "tau 0.02 s, 0.007 s in healthy files"}))
    'coil-lag (tau 0.02 s, 0.007 s in healthy files; probability 0.90); as in healthy files: asymmetry'
    """

    names: tuple[str, ...]
    probabilities: tuple[float | None, ...]
    rivals: tuple[tuple[str, ...], ...]
    verdict: str
    shared: tuple[str, ...] = ()
    strengths: Mapping[str, str] = field(default_factory=dict)

    def beside(self, shared: Sequence[str], strengths: Mapping[str, str] | None = None) -> FileCauses:
        """Without causes, and groups of rivals, that the fleet has as strongly.

        Parameters
        ----------
        shared : sequence of str
        strengths : mapping of str to str, optional
            Per cause, here and in healthy files.

        Returns
        -------
        FileCauses
        """
        own = [(n, p) for n, p in zip(self.names, self.probabilities, strict=True) if n not in shared]
        return FileCauses(tuple(n for n, _ in own), tuple(p for _, p in own),
                          tuple(r for r in self.rivals if not set(r) & set(shared)), self.verdict,
                          tuple(n for n in shared if n in self.names or any(n in r for r in self.rivals)),
                          {n: text for n, text in (strengths or {}).items() if n in dict(own)})

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> FileCauses:
        """Of diagnosis.json.

        Parameters
        ----------
        data : mapping
            Its content.

        Returns
        -------
        FileCauses
        """
        named = data.get("causes", [])
        return cls(tuple(c["name"] for c in named), tuple(c.get("probability") for c in named),
                   tuple(tuple(r["names"]) for r in data.get("rivals", [])), data.get("verdict", ""))

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            ``verdict``, ``causes`` with their probabilities, ``rivals``, ``shared``.
        """
        return {"verdict": self.verdict, "rivals": [list(r) for r in self.rivals], "shared": list(self.shared),
                "causes": [{"name": n, "probability": p, **self._strength(n)}
                           for n, p in zip(self.names, self.probabilities, strict=True)]}

    def _strength(self, name: str) -> dict[str, str]:
        return {"strength": self.strengths[name]} if name in self.strengths else {}

    def __str__(self) -> str:
        alike = f"; as in healthy files: {', '.join(self.shared)}" if self.shared else ""
        sure = [n if p is None else f"{n} ({'; '.join((*self._strength(n).values(), f'probability {p:.2f}'))})"
                for n, p in zip(self.names, self.probabilities, strict=True)]
        return ("; ".join([*sure, *(" or ".join(r) for r in self.rivals)]) or self.verdict) + alike


def read_causes(jobs: Iterable[Job]) -> dict[str, FileCauses]:
    """Causes by file, of the diagnoses on disk.

    Parameters
    ----------
    jobs : iterable of Job

    Returns
    -------
    dict of str to FileCauses
        Without the files that have no diagnosis.
    """
    found = {}
    for job in jobs:
        try:
            data = json.loads((job.folder / "diagnosis" / "diagnosis.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue
        found[job.name] = FileCauses.from_dict(data)
    return found
