"""The files that commands of this program wrote into a folder; a list beside them distinguishes them from others."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

MANIFEST = ".results.json"
"""Name of that list: by command, the name of each file with its SHA-256 digest and whether it is data to be read."""
_BLOCK = 1 << 20


def listed(folder: Path) -> dict[str, dict[str, dict[str, Any]]]:
    """What a folder's list holds; empty without one.

    Parameters
    ----------
    folder : Path

    Returns
    -------
    dict of str to dict of str to dict
        By command and file name: ``sha256`` (None in a list of an earlier version) and ``data``. Names that lead out of
        the folder are left out.
    """
    try:
        found = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        return {str(command): {n: _facts(files, n) for n in files if isinstance(n, str) and n == Path(n).name}
                for command, files in found.items()}
    except (OSError, ValueError, AttributeError, TypeError):
        return {}


def _facts(files: Any, name: str) -> dict[str, Any]:
    facts = files.get(name) if isinstance(files, Mapping) else None
    facts = facts if isinstance(facts, Mapping) else {}
    return {"sha256": facts.get("sha256"), "data": bool(facts.get("data", False))}


def note_written(folder: Path, command: str, names: Iterable[str], data: Iterable[str]) -> None:
    """Replace a command's part of the list by these files, which stand in the folder now.

    Parameters
    ----------
    folder : Path
    command : str
        Such as "lpvid identify".
    names : iterable of str
    data : iterable of str
        Those among them that are meant to be read as data, as the records of a virtual rig are.
    """
    read = set(data)
    files = {n: {"sha256": _digest(folder / n), "data": n in read} for n in names}
    text = json.dumps({**listed(folder), command: files}, indent=1) + "\n"
    (folder / MANIFEST).write_text(text, encoding="utf-8")


def is_own(path: Path) -> bool:
    """Whether a command wrote this file and nobody has changed it since.

    Parameters
    ----------
    path : Path

    Returns
    -------
    bool
    """
    return bool(_entries(path))


def without_results(paths: Iterable[Path]) -> list[Path]:
    """The files that no command wrote as a result, or that were changed since; records that one wrote are data.

    Parameters
    ----------
    paths : iterable of Path

    Returns
    -------
    list of Path
        In their order.
    """
    names: dict[Path, set[str]] = {}
    kept = []
    for path in paths:
        if path.parent not in names:
            names[path.parent] = {n for files in listed(path.parent).values() for n in files}
        found = _entries(path) if path.name in names[path.parent] else []
        if not found or any(facts["data"] for facts in found):
            kept.append(path)
    return kept


def _entries(path: Path) -> list[dict[str, Any]]:
    """Entries of the list beside a file that its content agrees with, the digest computed where one needs it."""
    found = [files[path.name] for files in listed(path.parent).values() if path.name in files]
    if not found or not path.is_file():
        return []
    own = _digest(path) if any(f["sha256"] is not None for f in found) else None
    return [f for f in found if f["sha256"] in (None, own)]


def _digest(path: Path) -> str:
    found = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            found.update(block)
    return found.hexdigest()
