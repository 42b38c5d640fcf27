"""Whether records hold rows that a model was fitted to: prints of stretches of its training data, kept with the model.

The output alone is compared: every model has one that is measured, and its noise makes a stretch of it recognisable.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from lpvid.condition.segmentation import RATE_TOLERANCE
from lpvid.record import Record

ROWS = 32
"""rows of a stretch."""
STRETCHES = 512
"""prints kept at most, evenly spread: a record of one part in 256 of the training rows, and `ROWS` more, holds one."""
HEADS = 64
"""records of which the first rows are kept as they are, for records that are shorter than a stretch."""
BITS = 48
"""information of a stretch that is kept: 512 stretches against 1e8 rows are 2^36 comparisons, of which with 2^-48 each
one in 4000 sets agrees by chance."""
HASH_BITS = 52
"""of a print: whole numbers that JSON holds exactly, and as unlikely to agree by chance."""
BLOCK = 4096
"""stretches examined at once."""
AGREES = 1e-6
"""share of the range of first rows by which they may differ from those of a record that was written anew."""
MULTIPLIERS = np.random.default_rng(20_260_101).integers(0, 2**63, ROWS, dtype=np.int64).view(np.uint64) * 2 + 1

HELD_OUT, TRAINING, PARTLY, OPEN = "held-out", "training", "partly training", "held-out or training"


# -- prints of stretches ---------------------------------------------------------------------------------------------
def _whole_numbers(values: np.ndarray) -> np.ndarray:
    """Signed whole numbers of the nearest float32: −x has the negative one; the rounding of units is lost."""
    pattern = np.abs(np.asarray(values, dtype=np.float32)).view(np.int32).astype(np.int64)
    return np.where(np.signbit(values), -pattern, pattern)


def _prints(values: np.ndarray, starts: slice | np.ndarray = slice(None)) -> np.ndarray:
    """Print of the stretch that begins at each of `starts`; a stretch that is turned round has the same one."""
    stretches = sliding_window_view(_whole_numbers(values).view(np.uint64), ROWS)[starts]
    found = np.zeros(len(stretches), np.uint64)
    for k, factor in enumerate(MULTIPLIERS):  # linear modulo 2^64: the sum of −x is that of x with the sign turned
        found += stretches[:, k] * factor
    return np.abs(found.view(np.int64)).view(np.uint64) >> np.uint64(64 - HASH_BITS)


def _recognisable(values: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Which stretches hold at least `BITS` of information in the differences of their rows, and no missing one."""
    blocks = [starts[k: k + BLOCK] for k in range(0, len(starts), BLOCK)]
    return np.concatenate([_informative(sliding_window_view(values, ROWS)[b]) for b in blocks] or [np.zeros(0, bool)])


def _informative(stretches: np.ndarray) -> np.ndarray:
    steps = np.sort(np.diff(stretches, axis=1), axis=1)
    scale = np.maximum(np.abs(stretches).max(axis=1, keepdims=True), np.finfo(float).tiny)
    new = np.diff(steps, axis=1) > 1e-9 * scale
    level = np.concatenate([np.zeros((len(stretches), 1), int), np.cumsum(new, axis=1)], axis=1)
    counts = (level[:, :, None] == level[:, None, :]).sum(axis=2)
    bits = np.log2((ROWS - 1) / counts).sum(axis=1)
    return np.isfinite(stretches).all(axis=1) & (bits >= BITS)


def _first(values: np.ndarray) -> np.ndarray:
    """The first finite rows, `ROWS` at most."""
    start = values[: 4 * ROWS]
    start = start[np.isfinite(start)]
    return (values[np.isfinite(values)] if start.size < ROWS else start)[:ROWS]


@dataclass
class TrainingRows:
    """Prints of training data that arrive record by record, or piece by piece; memory does not grow with them.

    Attributes
    ----------
    rows : int
        So far.
    spacing : int
        Rows from one print to the next, a power of two.
    prints : dict of int to int
        By the row at which the stretch begins.
    heads : list of list of float
        First rows of the first records, to nine digits; still ones are left out.
    tail : list of float
        Last rows of the record so far, with which a stretch that its next piece completes begins.
    sample_time : float or None
        Of the rows [s].

    Examples
    --------
    >>> force = np.random.default_rng(0).normal(size=900)
    >>> whole, parts = TrainingRows(), TrainingRows()
    >>> whole.add(force)
    >>> parts.add(force[:500]), parts.add(force[500:], continues=True)
    (None, None)
    >>> whole.spacing, len(whole.prints), whole == parts
    (2, 435, True)
    """

    rows: int = 0
    spacing: int = 1
    prints: dict[int, int] = field(default_factory=dict)
    heads: list[list[float]] = field(default_factory=list)
    tail: list[float] = field(default_factory=list)
    sample_time: float | None = None

    @classmethod
    def of(cls, records: Sequence[Record], output: str) -> TrainingRows:
        """Those of whole records.

        Parameters
        ----------
        records : sequence of Record
            As read where that is possible: a part of a file that is resampled has other samples than the whole.
        output : str
            Channel or role that all of them have.

        Returns
        -------
        TrainingRows
        """
        found = cls(sample_time=records[0].time_base.period if records else None)
        for record in records:
            found.add(record[output])
        return found

    def add(self, values: np.ndarray, continues: bool = False) -> None:
        """Take in the output of a record, or of its next piece.

        Parameters
        ----------
        values : (n,) array
        continues : bool
            Whether the piece goes on where the one before ended.
        """
        values = np.asarray(values, dtype=float)
        if not continues and len(self.heads) < HEADS:
            head = _first(values)
            if head.size and np.ptp(head) > 0:
                self.heads.append([float(f"{x:.9g}") for x in head])
        known = np.array(self.tail if continues else [])
        begin, joined = self.rows - known.size, np.concatenate([known, values])
        self.rows += values.size
        while self.rows > self.spacing * STRETCHES:
            self.spacing *= 2
        self.prints = {k: v for k, v in self.prints.items() if k % self.spacing == 0}
        starts = np.arange(-begin % self.spacing, joined.size - ROWS + 1, self.spacing)
        if starts.size:
            kept = starts[_recognisable(joined, starts)]
            self.prints |= dict(zip((begin + kept).tolist(), _prints(joined, kept).tolist(), strict=True))
        self.tail = joined[joined.size - min(ROWS - 1, joined.size):].tolist()

    def to_dict(self) -> dict[str, Any]:
        """For ``metadata["training"]["rows"]``.

        Returns
        -------
        dict
            Plain values by name.
        """
        return {"sample_time": self.sample_time, "spacing": self.spacing, "prints": sorted(set(self.prints.values())),
                "heads": self.heads}

    def state(self) -> dict[str, Any]:
        """Plain data from which `restored` goes on.

        Returns
        -------
        dict
        """
        return {**vars(self), "prints": [[k, v] for k, v in self.prints.items()]}

    @classmethod
    def restored(cls, state: Mapping[str, Any]) -> TrainingRows:
        """What goes on from a `state`.

        Parameters
        ----------
        state : mapping

        Returns
        -------
        TrainingRows
        """
        return cls(**{**state, "prints": {int(k): int(v) for k, v in state["prints"]}})


# -- comparison ------------------------------------------------------------------------------------------------------
@dataclass
class _Compared:
    """What has been found of one record: its rows, whether some, or not all, are training rows."""

    name: str
    rows: int = 0
    seen: bool = False
    other: bool = False
    first: np.ndarray = field(default_factory=lambda: np.zeros(0))
    tail: np.ndarray = field(default_factory=lambda: np.zeros(0))


class RowComparison:
    """Records beside the training rows of a model, record by record or piece by piece.

    Parameters
    ----------
    metadata : mapping
        Of the model.

    Examples
    --------
    >>> force = np.random.default_rng(0).normal(size=900)
    >>> known = TrainingRows()
    >>> known.add(force[:600])
    >>> metadata = {"training": {"rows": known.to_dict()}}
    >>> for part in (force[600:], force[:12], force[300:500], force, force[100:112]):
    ...     compared = RowComparison(metadata)
    ...     compared.add(part, "run")
    ...     print(compared.label)
    held-out
    training
    training
    partly training
    held-out or training
    """

    def __init__(self, metadata: Mapping) -> None:
        training = metadata.get("training", {})
        training = training if isinstance(training, Mapping) else {}
        known = training.get("rows", {"heads": training["heads"]} if "heads" in training else None)
        self.known = isinstance(known, Mapping)
        known = known if isinstance(known, Mapping) else {}
        self.sample_time: float | None = known.get("sample_time")
        self.spacing: int | None = known.get("spacing") if known.get("prints") else None
        self.prints = np.array(known.get("prints", []), dtype=np.uint64)
        self.heads = [np.asarray(h, dtype=float) for h in known.get("heads", [])]
        self.records: list[_Compared] = []

    @property
    def needed(self) -> int | None:
        """Rows from which a record is sure to hold a stretch of which the print is kept; None where there are none."""
        return None if self.spacing is None else self.spacing + ROWS - 1

    def add(self, values: np.ndarray, name: str, continues: bool = False) -> None:
        """Compare the output of a record, or of its next piece.

        Parameters
        ----------
        values : (n,) array
        name : str
            Of the record.
        continues : bool
            Whether the piece goes on where the one before ended.
        """
        values = np.asarray(values, dtype=float)
        if not continues:
            self.records.append(_Compared(name))
        own = self.records[-1]
        own.rows += values.size
        if own.first.size < ROWS:
            own.first = _first(np.concatenate([own.first, values]))
        joined = np.concatenate([own.tail, values])
        own.tail = joined[joined.size - min(ROWS - 1, joined.size):].copy()
        if self.spacing is None or joined.size < ROWS:
            return
        found = np.isin(_prints(joined), self.prints)
        at = np.flatnonzero(found)
        if not at.size:
            return
        own.seen = True
        beside = np.unique(np.concatenate([at - self.spacing, at + self.spacing]))
        beside = beside[(beside >= 0) & (beside < found.size)]
        beside = beside[~found[beside]]  # of training rows that go on, these would be known, where they are any
        own.other |= bool(beside.size and _recognisable(joined, beside).any())

    def _begins(self, own: _Compared) -> bool:
        """Whether a record begins with the first rows of a training record, or is shorter than these and has them."""
        n = own.first.size
        heads = [h for h in self.heads if n > 1 and h.size >= n and np.ptp(h[:n]) > 0]
        return any(min(np.abs(h[:n] - own.first).max(), np.abs(h[:n] + own.first).max()) <= AGREES * np.ptp(h)
                   for h in heads)

    def _label(self, own: _Compared) -> str:
        if own.seen or self._begins(own):
            return PARTLY if own.other else TRAINING
        if not self.known or (self.needed is not None and own.rows >= self.needed):
            return HELD_OUT
        return OPEN if self.needed is not None or own.rows < ROWS else HELD_OUT

    @property
    def label(self) -> str:
        """What the records are to the model: "held-out", "training", "partly training" or "held-out or training"."""
        found = {label for _, label in self._labels()} or {HELD_OUT}
        if len(found) == 1:
            return found.pop()
        return PARTLY if found & {TRAINING, PARTLY} else OPEN

    def _labels(self) -> list[tuple[_Compared, str]]:
        """Records with their labels; a piece that a gap cut off is too short only where its whole record is."""
        found = [(r, self._label(r)) for r in self.records]
        decided = {_whole(r) for r, label in found if label == HELD_OUT}
        return [(r, label) for r, label in found if label != OPEN or _whole(r) not in decided]

    def labelled(self, claim: str | None = None) -> tuple[str, tuple[str, ...]]:
        """The label of a validation, and its remarks.

        Parameters
        ----------
        claim : str, optional
            What the caller knows the records to be; "held-out" holds where nothing contradicts it.

        Returns
        -------
        str, tuple of str
            At most one line on records that hold training rows, and one on records of which that is not known.
        """
        found = self.label
        if claim is not None and (claim != HELD_OUT or found == OPEN):
            return claim, ()
        return found, self._notes()

    def _notes(self) -> tuple[str, ...]:
        labels = self._labels()
        seen = list(dict.fromkeys(r.name for r, label in labels if label in (TRAINING, PARTLY)))
        brief = [r for r, label in labels if label == OPEN]
        found = (seen_remark(seen),) if seen else ()
        if brief:
            fewest = f"{min(r.rows for r in brief)} rows{' and more' if len(brief) > 1 else ''}"
            found += (f"not known to be held-out: {_listed([r.name for r in brief])}, whose {fewest} are too few to "
                      f"decide whether the model was fitted to them; {self.needed or ROWS} rows are enough",)
        return found


def compared_rows(metadata: Mapping, records: Sequence[Record], pieces: Sequence[Record], output: str) -> RowComparison:
    """Records beside the training rows of a model: as read where those were, resampled where those were.

    Parameters
    ----------
    metadata : mapping
        A model's.
    records : sequence of Record
        As read, in the model's roles.
    pieces : sequence of Record
        The same, uniform and at the model's rate.
    output : str
        The model's first output.

    Returns
    -------
    RowComparison
    """
    found = RowComparison(metadata)
    period = found.sample_time
    raw = period is not None and all(
        r.has(output) and abs(r.time_base.period / period - 1) <= RATE_TOLERANCE for r in records)
    for record in records if raw else pieces:
        found.add(record[output], record.name)
    return found


def _whole(piece: _Compared) -> str:
    """Name of the record that a piece was cut from."""
    return piece.name.rpartition("#")[0] or piece.name


def _listed(names: Sequence[str]) -> str:
    names = list(dict.fromkeys(names))
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def seen_remark(names: Sequence[str]) -> str:
    """What a validation states of records that the model was fitted to.

    Parameters
    ----------
    names : sequence of str
        Of the records, at least one; beyond four their number.

    Returns
    -------
    str

    Examples
    --------
    >>> seen_remark(["a"]), seen_remark(["a", "b", "c", "d", "e"])[:41]
    ('not held-out: a holds samples that the model was fitted to', 'not held-out: a, b, c, d and 1 more hold ')
    """
    verb = "hold" if len(names) > 1 else "holds"
    return f"not held-out: {_listed(names)} {verb} samples that the model was fitted to"
