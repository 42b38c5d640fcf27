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
HEAD_BITS = 18
"""information of first rows by which a record is recognised: beside `HEADS`, 2^6, of them one record in 2^12 agrees by
chance; a step from rest, or one to and fro, holds less."""
HASH_BITS = 52
"""of a print: whole numbers that JSON holds exactly, and as unlikely to agree by chance."""
BLOCK = 4096
"""stretches examined at once."""
LONG = 1 << 20
"""stretches of which the prints are compared at once: 8 MB for each array."""
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
    found = [_information(sliding_window_view(values, ROWS)[b]) >= BITS for b in blocks]
    return np.concatenate(found or [np.zeros(0, bool)])


def _information(stretches: np.ndarray) -> np.ndarray:
    """Bits in the steps from row to row of each stretch, by how often each occurs in it; 0 with missing rows."""
    n, steps_of = len(stretches), stretches.shape[1] - 1
    steps = np.sort(np.diff(stretches, axis=1), axis=1)
    scale = np.maximum(np.abs(stretches).max(axis=1, keepdims=True), np.finfo(float).tiny)
    new = np.diff(steps, axis=1) > 1e-9 * scale
    level = steps_of * np.arange(n)[:, None] + np.pad(np.cumsum(new, axis=1), ((0, 0), (1, 0)))
    counts = np.bincount(level.ravel(), minlength=n * steps_of).reshape(n, steps_of)
    bits = (counts * np.log2(steps_of / np.maximum(counts, 1))).sum(axis=1)
    return np.where(np.isfinite(stretches).all(axis=1), bits, 0.0)


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

    @classmethod
    def merged(cls, several: Sequence[TrainingRows]) -> TrainingRows:
        """Those of parts that were taken in apart, one after the other.

        Parameters
        ----------
        several : sequence of TrainingRows

        Returns
        -------
        TrainingRows
        """
        found = cls(sample_time=several[0].sample_time if several else None)
        found.spacing = max((part.spacing for part in several), default=1)
        for part in several:  # each begins where a print may stand that it has kept
            begin = -(-found.rows // found.spacing) * found.spacing
            found.prints |= {begin + k: v for k, v in part.prints.items() if k % found.spacing == 0}
            found.rows = begin + part.rows
            found.heads += part.heads[:HEADS - len(found.heads)]
        while found.rows > found.spacing * STRETCHES:
            found.spacing *= 2
        found.prints = {k: v for k, v in found.prints.items() if k % found.spacing == 0}
        return found

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
    """What has been found of one record: its rows, whether some, or not all, are training rows.

    `open` are the places between two prints at which the record, were it a part of the training rows, could begin
    without a stretch of which the print is kept: none, and it is no such part. Of the rows `tail` and `new`, the new
    ones are still to be compared.
    """

    name: str
    open: np.ndarray
    rows: int = 0
    seen: bool = False
    other: bool = False
    first: np.ndarray = field(default_factory=lambda: np.zeros(0))
    tail: np.ndarray = field(default_factory=lambda: np.zeros(0))
    new: list[np.ndarray] = field(default_factory=list)


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
        self.prints = np.sort(np.array(known.get("prints", []), dtype=np.uint64))
        self.heads = [np.asarray(h, dtype=float) for h in known.get("heads", [])]
        self.records: list[_Compared] = []

    @property
    def needed(self) -> int | None:
        """Rows from which a moving record is sure to hold a stretch with a print that is kept; None without prints."""
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
            self.records.append(_Compared(name, np.ones(self.spacing or 1, dtype=bool)))
        own = self.records[-1]
        own.rows += values.size
        if own.first.size < ROWS:
            own.first = _first(np.concatenate([own.first, values]))
        if self.spacing is None:
            return
        own.new.append(values)
        if sum(v.size for v in own.new) >= self.spacing:  # fewer would be compared anew with each piece
            self._compare(own, self.spacing)

    def _compare(self, own: _Compared, spacing: int) -> None:
        """Compare what has arrived of a record: with the rows before, back to where the last print would stand."""
        joined = np.concatenate([own.tail, *own.new])
        begin = own.rows - joined.size
        known = max(own.tail.size - ROWS + 1, 0)
        own.tail, own.new = joined[joined.size - min(spacing + ROWS - 1, joined.size):].copy(), []
        if joined.size < ROWS:
            return
        found = np.concatenate([self._known(joined[k: k + LONG + ROWS - 1])
                                for k in range(0, joined.size - ROWS + 1, LONG)])
        at = np.flatnonzero(found)
        if at.size:
            own.seen = True
            beside = np.unique(np.concatenate([at - spacing, at + spacing]))
            beside = beside[(beside >= 0) & (beside < found.size)]
            beside = beside[~found[beside]]  # of training rows that go on, these would be known, where they are any
            own.other |= bool(beside.size and _recognisable(joined, beside).any())
        for first in range(known, found.size, BLOCK):
            if own.seen or not own.open.any():
                break
            starts = np.arange(first, min(first + BLOCK, found.size))
            starts = starts[own.open[(begin + starts) % spacing]]
            own.open[(begin + starts[_recognisable(joined, starts)]) % spacing] = False

    def _known(self, values: np.ndarray) -> np.ndarray:
        """Whether the print of each stretch is one of the training rows'."""
        prints = _prints(values)
        return self.prints[np.searchsorted(self.prints, prints).clip(max=self.prints.size - 1)] == prints

    def _begins(self, own: _Compared) -> np.ndarray | None:
        """First rows of a training record with which a record begins, or which hold it where it is shorter."""
        n = own.first.size
        if n < 2 or _information(own.first[None])[0] < HEAD_BITS:
            return None
        heads = [h[:n] for h in self.heads if h.size >= n]
        return next((h for h in heads if min(np.abs(h - own.first).max(), np.abs(h + own.first).max())
                     <= AGREES * np.ptp(h)), None)

    def _label(self, own: _Compared) -> str:
        if own.new and self.spacing is not None:
            self._compare(own, self.spacing)
        if own.seen:
            return PARTLY if own.other else TRAINING
        decided, head = not own.open.any(), self._begins(own)
        if head is not None:  # rows that were written anew, with fewer digits, have other prints than these first ones
            alike = np.array_equal(np.abs(_whole_numbers(head)), np.abs(_whole_numbers(own.first)))
            return PARTLY if decided and alike else TRAINING
        return HELD_OUT if decided or not self.known else OPEN

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
        undecided = [r for r, label in labels if label == OPEN]
        found = (seen_remark(seen),) if seen else ()
        brief = [r for r in undecided if r.rows < (self.needed or 0)]
        if brief:
            fewest = f"{min(r.rows for r in brief)} rows{' and more' if len(brief) > 1 else ''}"
            found += (f"not known to be held-out: {_listed([r.name for r in brief])}, whose {fewest} are too few to "
                      f"decide whether the model was fitted to them; {self.needed} rows are enough",)
        alike = [r.name for r in undecided if r not in brief]
        if alike:
            why = ("the model keeps no rows of its training data" if self.needed is None else
                   "too little of the output moves by more than a few steps of its resolution")
            found += (f"not known to be held-out: {_listed(alike)}; {why} by which to decide whether the model was "
                      "fitted to them",)
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
    found, period = RowComparison(metadata), RowComparison(metadata).sample_time
    if period is not None and all(r.has(output) for r in records):
        for record in records:
            found.add(record[output], record.name)
        alike = all(abs(r.time_base.period / period - 1) <= RATE_TOLERANCE for r in records)
        if alike or found.label in (TRAINING, PARTLY):  # some training records may have another rate than the first
            return found
        found = RowComparison(metadata)
    for piece in pieces:
        found.add(piece[output], piece.name)
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
