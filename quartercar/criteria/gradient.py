"""Figures of a ride with their gradients by its signals: comfort, tyre load, stroke, use of the room, energy given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from quartercar.criteria import comfort_weighting
from quartercar.criteria.figures import SETTLED
from quartercar.vehicle.adjoint import AdjointCar, GradientRun

SIGNALS = ("acceleration", "tyre_force", "deflection", "speed", "force")
"""Of a `GradientRun`, in the order of `AdjointCar.gradient`."""


@dataclass(frozen=True, eq=False)
class RideFigure:
    """A figure and its (n,) gradients by the signals that it reads.

    Attributes
    ----------
    value : float
        In the unit of the figure.
    slopes : mapping of str to (n,) array
        By the names of `SIGNALS`, in the unit of the figure per SI unit of the signal; signals that do not count are
        left out.
    """

    value: float
    slopes: Mapping[str, np.ndarray]


class RideGradient:
    """Figures of a trajectory as `criteria.judge` and `passivity_balance.ride_passivity` compute them, with gradients.

    Comfort is ‖h ∗ z̈_s‖ over the samples that count, h the impulse response of W_k; the gradient of a convolution is
    the correlation with the same h, both by the discrete Fourier transform. Energy given is −Σ min(F ż_d, 0) T, F the
    damper's force less that of displacement alone.

    Parameters
    ----------
    car : AdjointCar
    settle : float
        Time at the start that does not count [s]; the weighting has then run in.
    """

    def __init__(self, car: AdjointCar, settle: float) -> None:
        self.car, self._time = car, car.sample_time
        self._size = car.road.size
        self._skip = int(np.ceil(settle / self._time - 1e-9))
        self._count = self._size - self._skip
        self._padded = 1 << int(np.ceil(np.log2(self._size + SETTLED / self._time)))
        self._weight = comfort_weighting(np.fft.rfftfreq(self._padded, self._time))

    def of(self, run: GradientRun) -> dict[str, RideFigure]:
        """comfort [m/s²], tyre_load [N], stroke [m], room (share used, where there are stops), given [J].

        Parameters
        ----------
        run : GradientRun
            Of `car`.

        Returns
        -------
        dict of str to RideFigure
            By name.
        """
        found = {"comfort": self._comfort(run.acceleration),
                 "tyre_load": self._spread(run.tyre_force, "tyre_force"),
                 "stroke": self._spread(run.deflection, "deflection"), "given": self._given(run)}
        if self.car.car.stops is not None:
            found["room"] = self._room(run.deflection)
        return found

    def _comfort(self, a: np.ndarray) -> RideFigure:
        n, size = self._size, self._padded
        weighted = np.fft.irfft(np.fft.rfft(a, size) * self._weight, size)[:n]
        weighted[:self._skip] = 0.0
        value = float(np.sqrt(np.sum(weighted**2) / self._count))
        by = weighted / (self._count * value) if value else weighted
        return RideFigure(
            value, {"acceleration": np.fft.irfft(np.fft.rfft(by, size) * np.conj(self._weight), size)[:n]}
        )

    def _spread(self, signal: np.ndarray, name: str) -> RideFigure:
        """Standard deviation."""
        centred = np.zeros(self._size)
        centred[self._skip:] = signal[self._skip:] - signal[self._skip:].mean()
        value = float(np.sqrt(np.sum(centred**2) / self._count))
        return RideFigure(value, {name: centred / (self._count * value) if value else centred})

    def _given(self, run: GradientRun) -> RideFigure:
        power = run.force * run.speed
        back = (power < 0) & (np.arange(self._size) >= self._skip)
        return RideFigure(float(-np.sum(power[back]) * self._time),
                      {"speed": np.where(back, -run.force * self._time, 0.0),
                       "force": np.where(back, -run.speed * self._time, 0.0)})

    def _room(self, z: np.ndarray) -> RideFigure:
        """Largest share of the room; the gradient is that of the largest sample."""
        stops = self.car.car.stops
        assert stops is not None
        shares = np.where(z > 0, z / stops.rebound, -z / stops.compression)
        shares[:self._skip] = -np.inf
        k, by = int(np.argmax(shares)), np.zeros(self._size)
        by[k] = 1 / stops.rebound if z[k] > 0 else -1 / stops.compression
        return RideFigure(float(shares[k]), {"deflection": by})

    def gradient(self, run: GradientRun, figures: Mapping[str, RideFigure], weights: Mapping[str, float]) -> np.ndarray:
        """(n,) gradient by the command of Σ weight·figure.

        Parameters
        ----------
        run : GradientRun
            The run of the figures.
        figures : mapping of str to RideFigure
            As `of` returns them.
        weights : mapping of str to float
            By the names of figures, per unit of each.

        Returns
        -------
        (n,) array
            Per unit of current; zero at the last sample.
        """
        return self.car.gradient(run, *self.bars(figures, weights))

    def bars(self, figures: Mapping[str, RideFigure], weights: Mapping[str, float]) -> list[np.ndarray]:
        """(n,) gradients of Σ weight·figure by the signals, in the order of `SIGNALS`.

        Parameters
        ----------
        figures : mapping of str to RideFigure
            As `of` returns them.
        weights : mapping of str to float
            By the names of figures, per unit of each; a figure without a weight does not count.

        Returns
        -------
        list of (n,) arrays
            One for each of `SIGNALS`, per SI unit of the signal.
        """
        bars = {s: np.zeros(self._size) for s in SIGNALS}
        for name, weight in weights.items():
            for signal, slope in figures[name].slopes.items() if weight else ():
                bars[signal] += weight * slope
        return [bars[s] for s in SIGNALS]
