"""An extended model at one rate, as simulation and validation run it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lpvid.condition.band_limited import IN_BAND
from lpvid.diagnosis.extended import ExtendedModel
from lpvid.model.noise_model import NoiseModel
from lpvid.model.quasi import SelfScheduled
from lpvid.model.signals import Signal
from lpvid.record import Channel, Record
from lpvid.scheduling import Scheduling

OPEN = 1e300
"""box of a scheduling variable of which no range is known"""
SLACK = 0.01
"""share of its range by which a scheduling variable may leave it before that counts as extrapolation"""


@dataclass(frozen=True, eq=False)
class ExtendedRun(SelfScheduled):
    """A composition along records as measured: its channels in, its output out, in the records' sense.

    It was fitted to its free run and has no noise model of its own: the prediction from any past is the free run.

    Attributes
    ----------
    model : ExtendedModel
    sample_time : float
        [s].
    """

    model: ExtendedModel
    sample_time: float
    scheduling_stage: None = None

    @property
    def scheduled(self) -> tuple[str, ...]:
        """Roles that schedule it."""
        return tuple(n for n in self.model.composition.baseline.schedule if n in self.model.reads)

    @property
    def box(self) -> Scheduling:  # type: ignore[override]
        """Training range of what schedules it, a hundredth wider."""
        ranges = [self.model.ranges.get(n, (-OPEN, OPEN)) for n in self.scheduled]
        slack = [SLACK * max(b - a, abs(b), 1e-9) for a, b in ranges]
        return Scheduling(self.scheduled, tuple(a - s for (a, _), s in zip(ranges, slack, strict=True)),
                          tuple(b + s for (_, b), s in zip(ranges, slack, strict=True)),
                          units=tuple(self.model.units.get(n, "") for n in self.scheduled))

    @property
    def inputs(self) -> tuple[Signal, ...]:  # type: ignore[override]
        """What it reads besides."""
        return tuple(Signal(n, self.model.units.get(n, "")) for n in self.model.reads if n not in self.scheduled)

    @property
    def outputs(self) -> tuple[Signal, ...]:  # type: ignore[override]
        """Its output."""
        baseline = self.model.composition.baseline
        return (Signal(baseline.output, baseline.output_unit),)

    @property
    def metadata(self) -> Mapping[str, Any]:  # type: ignore[override]
        """The model's; lpvid recognises training data by it."""
        turned = {"polarity": "reversed"} if self.model.composition.baseline.polarity < 0 else {}
        return {**self.model.metadata, **IN_BAND, **turned}

    @property
    def start(self) -> int:
        return self.model.composition.baseline.start

    @property
    def memory(self) -> int:
        return self.start

    @property
    def noise(self) -> NoiseModel:
        return NoiseModel("output")

    @property
    def vector(self) -> np.ndarray:
        return self.model.vector

    def with_vector(self, vector: np.ndarray) -> ExtendedRun:
        """The same run with other parameters.

        Parameters
        ----------
        vector : (P,) array
            The baseline's, then each effect's.

        Returns
        -------
        ExtendedRun
        """
        from dataclasses import replace

        return self.replace(model=replace(self.model, vector=vector))

    @property
    def parameter_names(self) -> tuple[str, ...]:
        return self.model.composition.names

    def free_run(self, u: np.ndarray, p: np.ndarray, past: np.ndarray, limit: float) -> tuple[np.ndarray, int | None]:
        columns = {s.name: (u[:, k], s.unit) for k, s in enumerate(self.inputs)}
        columns |= {n: (p[:, k], self.model.units.get(n, "")) for k, n in enumerate(self.scheduled)}
        measured = np.zeros(len(u))
        if past.size:
            measured[:] = past[-1]
            measured[: past.size] = past
        output = self.outputs[0]
        channels = {n: Channel(v, unit) for n, (v, unit) in columns.items()}
        record = Record({**channels, output.name: Channel(measured, output.unit)}, self.sample_time)
        with np.errstate(over="ignore", invalid="ignore"):
            y = np.array(self.model.predict(record))
        y[: past.size] = past
        sane = np.abs(y) < limit
        return y, None if sane.all() else int(np.argmin(sane))

    def predict(self, u: np.ndarray, p: np.ndarray, y: np.ndarray, horizon: int) -> np.ndarray:
        """The free run, whatever the horizon: it has no noise model that would make use of later outputs.

        Parameters
        ----------
        u : (n, inputs) array
            By `inputs`.
        p : (n, scheduled) array
            By `scheduled`.
        y : (n,) array
            Measured outputs, of which the first `start` begin the run.
        horizon : int
            Without effect.

        Returns
        -------
        (n,) array
            In the output's unit; the first `start` are y.
        """
        return self.free_run(u, p, y[: self.start], np.inf)[0]

    def __repr__(self) -> str:
        return f"{self.model!r} at {1 / self.sample_time:.6g} Hz"
