"""Dampers as models of lpvid: what lets `lpvid.simulate` and `lpvid.validate` run them along records as measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from lpvid.condition.band_limited import IN_BAND
from lpvid.model.compliance import ComplianceModel
from lpvid.model.noise_model import NoiseModel
from lpvid.model.quasi import SelfScheduled
from lpvid.model.signals import Signal
from lpvid.scheduling import Scheduling
from quartercar.dampers.contract import Damper
from quartercar.dampers.drive import UNITS, Drive
from quartercar.dampers.moved import Movable, moved

OPEN = 1e300
"""Box of a current of which no range is known."""


@dataclass(frozen=True, eq=False)
class DamperModel(SelfScheduled):
    """A physical law, run at one rate: velocity (and displacement) in, force out, the current as scheduling.

    It was fitted to its free run and has no noise model of its own: the prediction from any past is the free run.

    Attributes
    ----------
    damper : Damper
    sample_time : float
        [s].
    box : Scheduling
        The fitted range of the current; without end where none is known; empty for a law without current.
    """

    damper: Damper
    sample_time: float
    box: Scheduling
    scheduling_stage: None = None
    noise: ClassVar[NoiseModel] = NoiseModel("output")

    @classmethod
    def of(cls, damper: Damper, sample_time: float) -> DamperModel:
        """The adaptor of a damper at a period.

        Parameters
        ----------
        damper : Damper
            A law of physical parameters.
        sample_time : float
            [s].

        Returns
        -------
        DamperModel
            Its box is the fitted range of the current, wider by the damper's `slack` at either end.
        """
        if "current" not in damper.reads:
            return cls(damper, sample_time, Scheduling((), (), ()))
        low, high = damper.current_range or (-OPEN, OPEN)
        slack = damper.slack
        unit = "" if damper.current_unit == "1" else damper.current_unit
        return cls(damper, sample_time, Scheduling(("current",), (low - slack,), (high + slack,), units=(unit,)))

    @property
    def inputs(self) -> tuple[Signal, ...]:  # type: ignore[override]
        """Velocity, then displacement where the law reads it."""
        return tuple(Signal(n, UNITS[n]) for n in ("velocity", "displacement") if n in self.damper.reads)

    @property
    def outputs(self) -> tuple[Signal, ...]:  # type: ignore[override]
        """Force."""
        return (Signal("force", "N"),)

    @property
    def metadata(self) -> Mapping[str, Any]:  # type: ignore[override]
        """The damper's; lpvid recognises training data by it."""
        return _with_polarity(self.damper)

    @property
    def start(self) -> int:
        return self.damper.start

    @property
    def memory(self) -> int:
        return self.damper.start

    @property
    def vector(self) -> np.ndarray:
        return self.damper.vector

    def with_vector(self, vector: np.ndarray) -> DamperModel:
        """The same model with other parameters of the damper.

        Parameters
        ----------
        vector : (P,) array
            In the order of `parameter_names`, SI.

        Returns
        -------
        DamperModel
            A copy.
        """
        return self.replace(damper=self.damper.with_vector(vector))

    @property
    def parameter_names(self) -> tuple[str, ...]:
        return self.damper.names

    def free_run(self, u: np.ndarray, p: np.ndarray, past: np.ndarray, limit: float) -> tuple[np.ndarray, int | None]:
        columns = {s.name: u[:, k] for k, s in enumerate(self.inputs)}
        zeros = np.zeros(len(u))
        measured = None
        if past.size:
            measured = np.full(len(u), past[-1] * self.damper.polarity)
            measured[: past.size] = past * self.damper.polarity
        displacement = columns.get("displacement")
        drive = Drive(self.sample_time, np.ascontiguousarray(columns.get("velocity", zeros)),
                      zeros if displacement is None else displacement - self.damper.centre,
                      np.ascontiguousarray(p[:, 0]) if p.shape[1] else zeros, measured)
        with np.errstate(over="ignore", invalid="ignore"):
            y = self.damper.polarity * self.damper.response(drive, self.damper.vector)
        y[: past.size] = past
        return y, _first_outside(y, limit)

    def predict(self, u: np.ndarray, p: np.ndarray, y: np.ndarray, horizon: int) -> np.ndarray:
        """The free run from the first `start` samples: no later output is read.

        Parameters
        ----------
        u : (n, m) array
            Velocity [m/s] and displacement [m], as `inputs` names them.
        p : (n, 1) or (n, 0) array
            Current, where the law reads it.
        y : (n,) array
            Force as measured; its first `start` samples are read [N].
        horizon : int
            Not read: the same from any past.

        Returns
        -------
        (n,) array
            In the polarity of the records [N].
        """
        return self.free_run(u, p, y[: self.start], np.inf)[0]

    def __repr__(self) -> str:
        return f"{self.damper!r} at {1 / self.sample_time:.6g} Hz"


@dataclass(frozen=True, eq=False)
class Turned(SelfScheduled):
    """A self-scheduled model of the damper itself, along records whose force has the other sign or whose zero is moved.

    Attributes
    ----------
    inner : SelfScheduled
        In the damper's own sense.
    polarity : {1, −1}
    centre : float
        Displacement of the record that `inner` calls zero [m].
    metadata : mapping
    """

    inner: SelfScheduled
    polarity: int
    centre: float
    metadata: Mapping

    @property
    def sample_time(self) -> float:  # type: ignore[override]
        """Period [s]."""
        return self.inner.sample_time

    @property
    def box(self) -> Scheduling:  # type: ignore[override]
        """Range of the current."""
        return self.inner.box

    @property
    def inputs(self) -> tuple[Signal, ...]:  # type: ignore[override]
        """Velocity, then displacement where it is read."""
        return self.inner.inputs

    @property
    def outputs(self) -> tuple[Signal, ...]:  # type: ignore[override]
        """Force."""
        return self.inner.outputs

    @property
    def scheduling_stage(self):  # type: ignore[override]
        """Filter on the current."""
        return self.inner.scheduling_stage

    @property
    def start(self) -> int:
        return self.inner.start

    @property
    def memory(self) -> int:
        return self.inner.memory

    @property
    def noise(self) -> NoiseModel:
        return self.inner.noise

    @property
    def vector(self) -> np.ndarray:
        return self.inner.vector

    def with_vector(self, vector: np.ndarray) -> Turned:
        """The same model with other parameters of the inner one.

        Parameters
        ----------
        vector : (P,) array
            In the order of `parameter_names`.

        Returns
        -------
        Turned
            A copy.
        """
        return self.replace(inner=self.inner.with_vector(vector))

    @property
    def parameter_names(self) -> tuple[str, ...]:
        return self.inner.parameter_names

    def free_run(self, u: np.ndarray, p: np.ndarray, past: np.ndarray, limit: float) -> tuple[np.ndarray, int | None]:
        y, diverged = self.inner.free_run(self._moved(u), p, self.polarity * past, limit)
        return self.polarity * y, diverged

    def predict(self, u: np.ndarray, p: np.ndarray, y: np.ndarray, horizon: int) -> np.ndarray:
        """The prediction of the inner model, with the force's sign and the displacement's zero of the records.

        Parameters
        ----------
        u : (n, m) array
            Velocity [m/s] and displacement [m], as `inputs` names them.
        p : (n, 1) or (n, 0) array
            Current, where the model is scheduled by it.
        y : (n,) array
            Force as measured [N].
        horizon : int
            Samples from the last output that is read to the predicted one.

        Returns
        -------
        (n,) array
            In the polarity of the records; the first `start` are `y` [N].
        """
        return self.polarity * self.inner.predict(self._moved(u), p, self.polarity * y, horizon)

    def _moved(self, u: np.ndarray) -> np.ndarray:
        out = np.array(u, dtype=float)
        for k, signal in enumerate(self.inputs):
            if signal.name == "displacement":
                out[:, k] -= self.centre
        return out

    def __repr__(self) -> str:
        return f"{self.inner!r}, force measured with sign {self.polarity}"


def turned(model: Movable, damper: Damper) -> Movable:
    """A model of the damper itself as one of the records: their polarity, and their zero of the displacement.

    Parameters
    ----------
    model : LPVTransferFunction, LPVStateSpace or SelfScheduled
        In the damper's own sense.
    damper : Damper
        Gives polarity, centre and metadata.

    Returns
    -------
    LPVTransferFunction, LPVStateSpace or SelfScheduled
        Of the same kind where that has an exact form (`quartercar.dampers.moved`); a `Turned` for a compliance model of
        reversed polarity.
    """
    metadata = _with_polarity(damper)
    if damper.polarity < 0 and isinstance(model, ComplianceModel):
        return Turned(model, damper.polarity, damper.centre, metadata)
    return moved(model, damper.polarity, -damper.centre).replace(metadata=metadata)


def _with_polarity(damper: Damper) -> dict[str, Any]:
    """A damper's metadata, with lpvid's words for how it reads a record: the sense of the force, a derived velocity."""
    return {**damper.metadata, **IN_BAND, **({"polarity": "reversed"} if damper.polarity < 0 else {})}


def _first_outside(y: np.ndarray, limit: float) -> int | None:
    sane = np.abs(y) < limit
    return None if sane.all() else int(np.argmin(sane))
