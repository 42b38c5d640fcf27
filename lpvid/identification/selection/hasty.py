"""The short search of an output error that only serves a comparison, and the whole search of the one that is taken."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from lpvid.identification.output_error import OutputError
from lpvid.identification.structure import Structure

HASTY: Mapping[str, Any] = {"starts": 1, "tolerance": 1e-4, "max_iterations": 40}
"""settings of an output-error search that only serves a comparison: on the measured quarter car it takes a third of the
time, and its free-run error out of fold is within a quarter of that of the whole search at orders 2 to 8."""


def hasty(structure: OutputError) -> OutputError:
    """The same with a short search, to be compared with others.

    Parameters
    ----------
    structure : OutputError

    Returns
    -------
    OutputError
        With the settings `HASTY`.
    """
    return replace(structure, **HASTY)


def in_full(structure: Structure) -> Structure:
    """The same with the whole search, to be reported.

    Parameters
    ----------
    structure : Structure
        Any.

    Returns
    -------
    Structure
        Of output error with the default settings in place of `HASTY`; others as they are.
    """
    if not isinstance(structure, OutputError):
        return structure
    return replace(structure, **{n: getattr(OutputError, n) for n in HASTY})
