"""Free run and one-step prediction of a transfer function along records that arrive in pieces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lpvid.errors import InputError
from lpvid.model.quasi import SelfScheduled
from lpvid.model.scheduling_stage import SchedulingStage, memory
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Channel, Record
from lpvid.simulation import Model, predict, simulate


class StreamedRuns:
    """Carries what the next piece needs: the last samples, the free run's last outputs, the filter's past.

    Parameters
    ----------
    model : LPVTransferFunction
        With equation or output noise, and a basis that does not read ahead.

    Raises
    ------
    InputError
        Another kind of model.
    """

    def __init__(self, model: Model) -> None:
        if not isinstance(model, LPVTransferFunction) or isinstance(model, SelfScheduled) or \
                model.noise.kind not in ("equation", "output"):
            raise InputError("a stream runs along transfer functions with equation or output noise",
                             got=repr(model)[:60], mend="read the records whole: lpv.read(...)")
        if model.basis.lags[0] < 0:
            raise InputError("a stream cannot read the scheduling ahead of time", mend="read the records whole")
        self.stage = model.scheduling_stage
        self.model = model if self.stage is None else model.replace(scheduling_stage=None)
        assert model.sample_time is not None
        self.reach = 0 if self.stage is None else memory(self.stage, model.sample_time)
        self.channels = tuple(dict.fromkeys((*(s.name for s in (*model.inputs, *model.outputs)), *model.box.names)))
        self.cut()

    def cut(self) -> None:
        """What comes next does not continue what came before."""
        self.tail: Record | None = None
        self.past = np.zeros((0, self.model.n_outputs))
        self.raw = np.zeros((0, len(self.model.box.names)))
        self.diverged = False

    def run(self, piece: Record) -> tuple[np.ndarray, np.ndarray, int, int | None] | None:
        """The next piece of a record.

        Returns
        -------
        (free, one_step, first, diverged_at) or None
            Outputs of the samples from `first` of the piece on; None while the piece is too short to begin with.
        """
        piece = self._filtered(piece)
        start = self.model.start
        whole = piece if self.tail is None else _joined(self.tail, piece, self.channels)
        if whole.n_samples <= start:
            self.tail = whole
            return None
        fresh = self.past.shape[0] == 0 and not self.diverged
        first = max(start - (whole.n_samples - piece.n_samples), 0)
        step = predict(self.model, whole, 1)
        if self.diverged:
            free, at = np.full_like(step.output, np.nan), 0
        else:
            run = simulate(self.model, whole, "measured" if fresh or not start else self.past)
            free, at = run.output, run.diverged_at
            self.diverged = at is not None
        if start:
            self.past = np.array(free[-start:])
            self.tail = whole.slice(whole.n_samples - start, whole.n_samples)
        return free[start:], step.output[start:], first, None if at is None else max(at - start, 0)

    def _filtered(self, piece: Record) -> Record:
        """The piece with the scheduling as the coefficients see it."""
        stage = self.stage
        if not isinstance(stage, SchedulingStage):
            return piece
        names = list(self.model.box.names)
        raw = np.vstack([self.raw, piece.matrix(names)])
        assert self.model.sample_time is not None
        p = stage.apply(raw, self.model.sample_time)[len(self.raw):]
        self.raw = raw[max(len(raw) - self.reach, 0):]
        channels = {n: Channel(piece[n], piece.unit(n)) for n in self.channels}
        channels |= {n: Channel(p[:, k], piece.unit(n)) for k, n in enumerate(names)}
        return replace(piece, channels=channels, time=None, roles={})


def _joined(tail: Record, piece: Record, names: tuple[str, ...]) -> Record:
    values = {n: Channel(np.concatenate([tail[n], piece[n]]), piece.unit(n)) for n in names}
    return Record(values, sample_time=piece.sample_time, name=piece.name)
