"""Selection of a structure: `select(records, candidates) -> Selection`, and `auto` with candidates of its own."""

from __future__ import annotations

from lpvid.identification.selection.automatic import auto
from lpvid.identification.selection.candidates import Candidates
from lpvid.identification.selection.ceiling import Ceiling, noise_ceiling
from lpvid.identification.selection.free_run import unstable_share
from lpvid.identification.selection.result import CandidateRow, Selection, describe
from lpvid.identification.selection.selecting import select

__all__ = [
    "CandidateRow",
    "Candidates",
    "Ceiling",
    "Selection",
    "auto",
    "describe",
    "noise_ceiling",
    "select",
    "unstable_share",
]
