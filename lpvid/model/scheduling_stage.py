"""Scheduling filters: between the logged command and what the damper's field does lie a lag and a delay."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np

from lpvid import _checks
from lpvid.codec import Coded
from lpvid.errors import InputError

FORGOTTEN = 40.0
"""time constants after which a lag's start is below rounding: exp(−40) = 4e-18."""


class SchedulingStage(Coded, ABC):
    """A causal filter from the logged scheduling to the one that the coefficients see.

    It never leaves the range of its input, so a model's box holds for both. Its free parameters are a vector so that an
    estimator can fit them without knowing the filter.
    """

    NOUN = "scheduling filter"
    JSON = ("kind", ...)

    @property
    @abstractmethod
    def vector(self) -> np.ndarray:
        """(k,) free parameters."""

    @abstractmethod
    def with_vector(self, vector: np.ndarray) -> SchedulingStage:
        """The same filter with other parameters, projected onto their admissible range.

        Parameters
        ----------
        vector : (k,) array
            In the order of `vector`.

        Returns
        -------
        SchedulingStage
        """

    def stated(self) -> str:
        """Parameters by name, which are times, for a note of a fit.

        Returns
        -------
        str
        """
        return ", ".join(f"{k} {v:.4g} s" for k, v in self.to_dict().items() if isinstance(v, float))

    @abstractmethod
    def apply(self, p: np.ndarray, sample_time: float) -> np.ndarray:
        """(n, n_scheduling) filtered trajectory; the filter starts settled at the first sample.

        Parameters
        ----------
        p : (n, n_scheduling) array
            As logged.
        sample_time : float
            Period [s].

        Returns
        -------
        (n, n_scheduling) array
        """

    @abstractmethod
    def starts(self, sample_time: float) -> list[SchedulingStage]:
        """A few starting points for a fit.

        Parameters
        ----------
        sample_time : float
            Period [s], the scale of a filter that a record can show.

        Returns
        -------
        list of SchedulingStage
        """

    @abstractmethod
    def scales(self) -> np.ndarray:
        """(k,) search step of each parameter.

        Returns
        -------
        (k,) array
            In the units of the parameters; 0 for one that a fit does not move.
        """

    @abstractmethod
    def rate_limits(self, width: np.ndarray, sample_time: float) -> list[float | None]:
        """Fastest |dp/dt| [units per second] at the filter's output when its input moves at will in a range of `width`.

        One entry for each variable; None where the filter does not limit it. A stability statement may use it.

        Parameters
        ----------
        width : (n_scheduling,) array
            Range of each variable, in its unit.
        sample_time : float
            Period [s].

        Returns
        -------
        list of float or None
        """


@dataclass(frozen=True)
class SchedulingLag(SchedulingStage):
    """First-order lag with different time constants for rising and falling, behind a pure delay.

    ::

        q(k) = p(k − delay/T_s)                                    (linear between samples)
        s(k) = s(k−1) + (1 − exp(−T_s/τ)) (q(k) − s(k−1)),  τ = τ_rise where q(k) > s(k−1), else τ_fall

    Coil and flux lag, driver dead time (equation sheet 3.12-3.14; the direction latches on the filter's error, (5) of
    source 002). τ → 0 and delay 0 give p back exactly, so a model without the filter is nested in one with it.

    Parameters
    ----------
    tau_rise, tau_fall : float
        Time constants [s].
    delay : float
        Dead time [s].
    variable : int
        Which scheduling variable is filtered.
    symmetric : bool
        One time constant for both directions (``tau_rise``).
    with_delay : bool
        Whether a fit may move the delay.

    Examples
    --------
    >>> SchedulingLag(tau_rise=0.01, symmetric=True).apply(np.array([[0.0], [1.0], [1.0]]), 0.01).ravel().round(4)
    array([0.    , 0.6321, 0.8647])
    """

    kind = "lag"

    tau_rise: float = 0.005
    tau_fall: float = 0.005
    delay: float = 0.0
    variable: int = 0
    symmetric: bool = False
    with_delay: bool = False

    def __post_init__(self) -> None:
        for name in ("tau_rise", "tau_fall", "delay"):
            value = _checks.real(getattr(self, name), f"{name} of a scheduling lag")
            if value < 0:
                raise InputError(f"{name} of a scheduling lag must not be negative", got=value)
            object.__setattr__(self, name, value)
        if self.symmetric:
            object.__setattr__(self, "tau_fall", self.tau_rise)

    @property
    def vector(self) -> np.ndarray:
        taus = [self.tau_rise] if self.symmetric else [self.tau_rise, self.tau_fall]
        return np.array([*taus, self.delay] if self.with_delay else taus)

    def with_vector(self, vector: np.ndarray) -> SchedulingLag:
        values = np.abs(np.asarray(vector, dtype=float)).tolist()
        fall = values[0] if self.symmetric else values[1]
        return replace(self, tau_rise=values[0], tau_fall=fall, delay=values[-1] if self.with_delay else self.delay)

    def apply(self, p: np.ndarray, sample_time: float) -> np.ndarray:
        from lpvid._kernels import switched_lag

        out = np.array(p, dtype=float)
        if not len(out):
            return out
        column = out[:, self.variable]
        if self.delay:
            place = np.arange(len(column)) - self.delay / sample_time
            column = np.interp(place, np.arange(len(column)), column)
        gains = [1.0 if tau == 0 else -np.expm1(-sample_time / tau) for tau in (self.tau_rise, self.tau_fall)]
        out[:, self.variable] = switched_lag(np.ascontiguousarray(column), gains[0], gains[1])
        return out

    def starts(self, sample_time: float) -> list[SchedulingStage]:
        delay = sample_time if self.with_delay else 0.0
        return [replace(self, tau_rise=k * sample_time, tau_fall=k * sample_time, delay=delay) for k in (1.0, 4.0)]

    def scales(self) -> np.ndarray:
        return np.maximum(0.7 * self.vector, 1e-9)

    def rate_limits(self, width: np.ndarray, sample_time: float) -> list[float | None]:
        """(1 − exp(−T_s/τ))·width per sample, with the smaller time constant: one step of the lag's recursion."""
        limits: list[float | None] = [None] * len(width)
        tau = min(self.tau_rise, self.tau_fall)
        if tau > 0:
            limits[self.variable] = float(-np.expm1(-sample_time / tau) * width[self.variable] / sample_time)
        return limits


FITTED = {
    "lag": SchedulingLag(symmetric=True),
    "rise-fall": SchedulingLag(),
    "lag-delay": SchedulingLag(symmetric=True, with_delay=True),
    "rise-fall-delay": SchedulingLag(with_delay=True),
}
"""Names by which a structure asks for a filter to be fitted."""


def memory(stage: object, sample_time: float) -> int:
    """Samples after which a filter's start is below rounding.

    Parameters
    ----------
    stage : SchedulingStage
        Scheduling filter.
    sample_time : float
        Period [s].

    Returns
    -------
    int
        [samples].

    Raises
    ------
    InputError
        A filter of which that is not known.
    """
    if not isinstance(stage, SchedulingLag):
        raise InputError("a stream needs the memory of a scheduling filter", got=type(stage).__name__,
                         mend="use a SchedulingLag")
    slowest = max(stage.tau_rise, stage.tau_fall)
    return int(np.ceil((stage.delay + FORGOTTEN * slowest) / sample_time)) + 2
