"""Uniform, finite pieces of records that arrive in chunks, and which continue each other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lpvid.condition.segmentation import RATE_TOLERANCE, segments
from lpvid.errors import InputError
from lpvid.record import Record


@dataclass
class Cutter:
    """Uniform, finite pieces in order, and whether each continues the one before.

    Attributes
    ----------
    period : float or None
        Of all pieces [s]; of the first, where it is not given.
    name : str or None
        Of the last piece.
    end : float
        Time at which the next sample would stand [s].
    """

    period: float | None = None
    name: str | None = None
    end: float = 0.0

    def cut(self, chunk: Record, channels: tuple[str, ...]) -> Iterator[tuple[Record, bool]]:
        """Pieces of one chunk.

        Parameters
        ----------
        chunk : Record
            The next one.
        channels : tuple of str
            Those that must be finite.

        Yields
        ------
        Record, bool
            A piece, and whether it continues the one before.

        Raises
        ------
        InputError
            Another sampling rate than before.
        """
        for piece in _finite_pieces(chunk, channels):
            step = piece.sample_time
            assert step is not None
            if self.period is not None and abs(step / self.period - 1) > RATE_TOLERANCE:
                raise InputError(f"record '{chunk.name}' changes its sampling rate",
                                 got=f"{1 / step:.6g} Hz after {1 / self.period:.6g} Hz", mend="resample it before")
            self.period = step if self.period is None else self.period
            continues = self.name == chunk.name and abs(piece.start - self.end) < 0.5 * self.period
            yield piece, continues
            self.name, self.end = chunk.name, piece.start + piece.n_samples * step


def _finite_pieces(chunk: Record, channels: tuple[str, ...]) -> list[Record]:
    if "velocity" in channels and not chunk.has("velocity"):
        raise InputError("a stream needs its velocity as a channel", got=", ".join(chunk.channels),
                         why="it is derived from whole records", mend="write it into the files, or read them whole")
    used = [chunk.channel(n) for n in channels]
    if chunk.is_uniform and all(c.fault is None and c.unit_known and np.isfinite(c.values.sum()) for c in used):
        segments([chunk.slice(0, 2)], channels, minimum=1)  # what it refuses of units and names
        return [replace(chunk, time=None, sample_time=chunk.sample_time)]
    sound = all(c.fault is None and c.unit_known and not np.isinf(c.values).any() for c in used)
    if sound and not np.isfinite(chunk.matrix(channels)).all(axis=1).any():
        return []  # a stretch of missing samples only
    return [replace(piece, time=None, name=chunk.name) for piece in segments([chunk], channels, minimum=1)]
