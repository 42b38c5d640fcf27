"""Static input stages of an LPV-Hammerstein model: what the damper does to velocity before the filter."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from lpvid import _checks
from lpvid.codec import Coded
from lpvid.model.signals import Signal
from lpvid.units import quotient

NARROWEST = 1e-9
"""Lower bound of a knee under search, in the shaped input's SI unit: as good as sign(u), and no division by zero."""


CYCLE = 2000
"""samples of a period by which a describing function is computed: to 1e-4 across corners"""


class InputStage(Coded, ABC):
    """A memoryless map of measured inputs and scheduling to the inputs of an LPV filter.

    Its free parameters are a vector so that an estimator can fit them without knowing the shape.

    Attributes
    ----------
    widest : float
        Upper bound of the knee at scheduling 0 under search, in the shaped input's unit.
    """

    NOUN = "input stage"
    KINDS_IN = ("lpvid.model.zone_lines",)
    JSON = ("kind", ...)
    STRAIGHT: ClassVar[float] = 0.0
    """Share of the knee up to which the stage is straight, so that no motion within it determines the knee."""
    KNEE: ClassVar[tuple[str, ...]] = ()
    """Names of the knee at scheduling 0 and of its change with the scheduling; none where it is a polynomial."""

    channel: int
    variable: int
    widest = np.inf

    @property
    @abstractmethod
    def vector(self) -> np.ndarray:
        """(k,) free parameters, in SI units."""

    @abstractmethod
    def with_vector(self, vector: np.ndarray) -> InputStage:
        """The same stage with other parameters, projected onto their admissible range.

        Parameters
        ----------
        vector : (k,) array
            Parameters in the order of `vector`.

        Returns
        -------
        InputStage
            A copy.
        """

    def stated(self, shaped: str, scheduling: str) -> str:
        """Parameters by name with their units, for a note of a fit.

        Parameters
        ----------
        shaped, scheduling : str
            Units of the shaped input and of the scheduling variable that moves the stage.

        Returns
        -------
        str
        """
        per = quotient("", scheduling)
        units = {name: "" if per == "1" else per for name in self.to_dict() if name.endswith("slope")}
        if self.KNEE:
            units |= {self.KNEE[0]: shaped, self.KNEE[1]: quotient(shaped, scheduling)}
        return ", ".join(f"{k} {v:.4g} {units.get(k, '')}".rstrip() for k, v in self.to_dict().items()
                         if isinstance(v, float))

    @property
    def first_knee(self) -> float | None:
        """The knee at scheduling 0, in the shaped input's unit; None for a stage without one."""
        return getattr(self, self.KNEE[0]) if self.KNEE else None

    @property
    def at_bound(self) -> bool:
        """Whether the search has taken the knee at scheduling 0 to its lower bound."""
        return self.first_knee is not None and self.first_knee <= NARROWEST

    @property
    def beyond_data(self) -> bool:
        """Whether the search has taken the knee at scheduling 0 to its upper bound, beyond what the data reach."""
        return self.first_knee is not None and self.first_knee >= self.widest

    @abstractmethod
    def signals(self, inputs: tuple[Signal, ...]) -> tuple[Signal, ...]:
        """The filter's inputs, given the measured ones.

        Parameters
        ----------
        inputs : tuple of Signal
            The measured inputs.

        Returns
        -------
        tuple of Signal
            m of them.
        """

    def _zoned(self, inputs: tuple[Signal, ...]) -> tuple[Signal, ...]:
        """The measured inputs with zones in place of the shaped one."""
        shaped = list(inputs)
        shaped[self.channel] = Signal(f"zones({inputs[self.channel].name})", inputs[self.channel].unit)
        return tuple(shaped)

    def _moving(self, p: np.ndarray) -> np.ndarray:
        """(n,) the scheduling variable of the stage along `p`; zeros where nothing is scheduled."""
        return p[:, self.variable] if p.shape[1] else np.zeros(len(p))

    @abstractmethod
    def apply(self, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        """(n, m) filter inputs from measured inputs `u` (n, n_inputs) and scheduling `p` (n, n_scheduling).

        Parameters
        ----------
        u : (n, n_inputs) array
            Measured inputs, in their units.
        p : (n, n_scheduling) array
            Scheduling, in the units of its variables.

        Returns
        -------
        (n, m) array
            Inputs of the filter.
        """

    @abstractmethod
    def knee(self, p: np.ndarray) -> np.ndarray:
        """(n,) size of the shaped input at which the stage bends, along scheduling `p` (n, n_scheduling).

        Parameters
        ----------
        p : (n, n_scheduling) array
            Scheduling, in the units of its variables.

        Returns
        -------
        (n,) array
            In the unit of the shaped input.
        """

    @abstractmethod
    def slopes(self, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        """(n, m, k) derivative of `apply` by each entry of `vector`, from the inside where the map has a corner.

        Parameters
        ----------
        u : (n, n_inputs) array
            Measured inputs, in their units.
        p : (n, n_scheduling) array
            Scheduling, in the units of its variables.

        Returns
        -------
        (n, m, k) array
            Derivatives.
        """

    def amplitude_gains(self, p: np.ndarray, largest: float = np.inf) -> tuple[np.ndarray, np.ndarray] | None:
        """Gains from the one measured input to the filter's inputs for small and for large motions.

        Parameters
        ----------
        p : (n_scheduling,) array
            Scheduling, in the units of its variables.
        largest : float
            Amplitude of the large motion, in the unit of the input.

        Returns
        -------
        ((m,) array, (m,) array) or None
            None for a stage of which they are not known.
        """
        return None

    def _describing_gains(self, p: np.ndarray, amplitude: float) -> np.ndarray:
        """(m,) describing function: the fundamental of the filter's inputs for V sin θ, over V.

        N(V) = (1/πV) ∫ f(V sin θ) sin θ dθ over a period, by the midpoint rule.
        """
        sine = np.sin(2 * np.pi * (np.arange(CYCLE) + 0.5) / CYCLE)
        shaped = self.apply(amplitude * sine[:, None], np.broadcast_to(p, (CYCLE, len(p))))
        return 2 * (sine @ shaped) / (CYCLE * amplitude)

    @abstractmethod
    def starts(self, u: np.ndarray, p: np.ndarray) -> list[InputStage]:
        """A few starting points for a fit, from the data's own spread.

        Parameters
        ----------
        u : (n, n_inputs) array
            Measured inputs, in their units.
        p : (n, n_scheduling) array
            Scheduling, in the units of its variables.

        Returns
        -------
        list of InputStage
            Stages of the same kind.
        """

    @abstractmethod
    def scales(self, reach: float) -> np.ndarray:
        """(k,) search step of each parameter for a scheduling half range `reach`; 0 keeps a parameter fixed.

        Parameters
        ----------
        reach : float
            Half range of the scheduling variable, in its unit; 0 where it does not move.

        Returns
        -------
        (k,) array
            In the units of the parameters.
        """


@dataclass(frozen=True)
class TanhStage(InputStage):
    """Adds tanh(v/v0(p)) as a further filter input, v0(p) = v0 + slope·p (smooth yield of an MR damper).

    The yield part of Guo 2006, F = A_1 tanh(A_3 v) + A_2 v, with the filter providing A_1(p) and A_2(p).

    Parameters
    ----------
    v0 : float
        Velocity scale of the yield [unit of the input].
    slope : float
        Change of v0 per unit of the scheduling variable.
    channel, variable : int
        Which measured input is shaped, and which scheduling variable widens the knee.
    widest : float
        Upper bound of v0 under search [unit of the input]; not part of a file.

    Examples
    --------
    >>> TanhStage(v0=0.1).apply(np.array([[0.1]]), np.zeros((1, 0))).round(4)
    array([[0.1   , 0.7616]])
    """

    kind = "tanh"
    JSON = ("kind", "v0", "slope", "channel", "variable")
    KNEE: ClassVar[tuple[str, ...]] = ("v0", "slope")
    STRAIGHT: ClassVar[float] = 0.2
    """tanh r = r − r³/3 + 2r⁵/15 − …: at r = 1/5 it departs from a line by r²/3 = 1.3 %, and that departure from a
    cubic by 2r²/5 = 1.6 % of itself, less than any free run leaves: up to there only the gain over v0³ counts."""

    v0: float = 0.05
    slope: float = 0.0
    channel: int = 0
    variable: int = 0
    widest: float = field(default=np.inf, compare=False, repr=False)

    def __post_init__(self) -> None:
        _checks.positive(self.v0, "v0 of a tanh stage")
        _checks.real(self.slope, "slope of a tanh stage")

    @property
    def vector(self) -> np.ndarray:
        return np.array([self.v0, self.slope])

    def with_vector(self, vector: np.ndarray) -> TanhStage:
        return replace(self, v0=min(max(float(vector[0]), NARROWEST), self.widest), slope=float(vector[1]))

    def signals(self, inputs: tuple[Signal, ...]) -> tuple[Signal, ...]:
        return (*inputs, Signal(f"tanh({inputs[self.channel].name})"))

    def apply(self, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        return np.column_stack([u, np.tanh(u[:, self.channel] / self.knee(p))])

    def knee(self, p: np.ndarray) -> np.ndarray:
        moving = self.slope * p[:, self.variable] if self.slope and p.shape[1] else np.zeros(len(p))
        return np.maximum(self.v0 + moving, 0.05 * self.v0)

    def slopes(self, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        moving = self._moving(p)
        free = self.v0 + self.slope * moving
        scale = np.maximum(free, 0.05 * self.v0)
        bent = free >= 0.05 * self.v0
        ratio = u[:, self.channel] / scale
        by_scale = -ratio / scale / np.cosh(np.minimum(np.abs(ratio), 300.0)) ** 2
        out = np.zeros((len(u), u.shape[1] + 1, 2))
        out[:, -1, 0] = by_scale * np.where(bent, 1.0, 0.05)
        out[:, -1, 1] = by_scale * np.where(bent, moving, 0.0)
        return out

    def amplitude_gains(self, p: np.ndarray, largest: float = np.inf) -> tuple[np.ndarray, np.ndarray]:
        u = np.full((1, 1), 1e-9 * self.v0)
        slope = self.apply(u, np.asarray(p)[None])[0, 1] / u[0, 0]
        far = self._describing_gains(np.asarray(p), largest) if np.isfinite(largest) else np.array([1.0, 0.0])
        return np.array([1.0, slope]), far

    def starts(self, u: np.ndarray, p: np.ndarray) -> list[InputStage]:
        spread = float(np.sqrt(np.mean(u[:, self.channel] ** 2))) or 1.0
        widest = float(np.abs(u[:, self.channel]).max()) / self.STRAIGHT or np.inf
        return [replace(self, v0=factor * spread, slope=0.0, widest=widest) for factor in (0.05, 0.15, 0.4, 1.0)]

    def scales(self, reach: float) -> np.ndarray:
        return np.array([self.v0, 0.5 * self.v0 / reach if reach else 0.0])


@dataclass(frozen=True)
class ThreeZoneStage(InputStage):
    """The thesis's shaped input: three straight zones whose slopes and limits depend on current.

    Díaz Salas 2011 (3.16)-(3.22), normalised to slope 1 in the middle zone and *continuous at the knees*
    (c_3 = (m_2 − m_3)·v_high imposed; separate regressions break it)::

        u = σ_I v − (1 − σ_I) v_high      v < −v_high
        u = v                             |v| ≤ v_high
        u = σ_III v + (1 − σ_III) v_high  v > v_high

    with v_high(p) = limit + limit_slope·p and σ(p) = ratio + ratio_slope·p, each per zone.

    Parameters
    ----------
    limit, limit_slope : float
        v_high [unit of the input] and its change per unit of the scheduling variable.
    upper, upper_slope, lower, lower_slope : float
        Slope ratios m_3/m_2 (zone III) and m_1/m_2 (zone I), and their change.
    channel, variable : int
        Which measured input is shaped, and which scheduling variable moves the zones.

    Examples
    --------
    >>> stage = ThreeZoneStage(limit=0.06, upper=0.075, lower=0.075)
    >>> stage.apply(np.array([[-0.3], [0.03], [0.3]]), np.zeros((3, 1))).ravel().round(3)
    array([-0.078,  0.03 ,  0.078])
    """

    kind = "three-zone"
    KNEE: ClassVar[tuple[str, ...]] = ("limit", "limit_slope")
    STRAIGHT: ClassVar[float] = 1.0

    limit: float = 0.05
    limit_slope: float = 0.0
    upper: float = 0.1
    upper_slope: float = 0.0
    lower: float = 0.1
    lower_slope: float = 0.0
    channel: int = 0
    variable: int = 0

    def __post_init__(self) -> None:
        _checks.positive(self.limit, "limit of a three-zone stage")
        for name in ("limit_slope", "upper", "upper_slope", "lower", "lower_slope"):
            _checks.real(getattr(self, name), f"{name} of a three-zone stage")

    @property
    def vector(self) -> np.ndarray:
        return np.array([self.limit, self.limit_slope, self.upper, self.upper_slope, self.lower, self.lower_slope])

    def with_vector(self, vector: np.ndarray) -> ThreeZoneStage:
        limit, limit_slope, upper, upper_slope, lower, lower_slope = (float(x) for x in vector)
        return replace(self, limit=max(limit, NARROWEST), limit_slope=limit_slope, upper=upper, upper_slope=upper_slope,
                       lower=lower, lower_slope=lower_slope)

    def signals(self, inputs: tuple[Signal, ...]) -> tuple[Signal, ...]:
        return self._zoned(inputs)

    def apply(self, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        v = u[:, self.channel]
        moving = self._moving(p)
        high = self.knee(p)
        above = np.maximum(v - high, 0.0)
        below = np.minimum(v + high, 0.0)
        shaped = np.clip(v, -high, high) + (self.upper + self.upper_slope * moving) * above
        shaped = shaped + (self.lower + self.lower_slope * moving) * below
        out = np.array(u, dtype=float)
        out[:, self.channel] = shaped
        return out

    def knee(self, p: np.ndarray) -> np.ndarray:
        moving = self._moving(p)
        return np.maximum(self.limit + self.limit_slope * moving, 0.02 * self.limit)

    def slopes(self, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        v = u[:, self.channel]
        moving = self._moving(p)
        free = self.limit + self.limit_slope * moving
        high = np.maximum(free, 0.02 * self.limit)
        bent = free >= 0.02 * self.limit
        above, below = np.maximum(v - high, 0.0), np.minimum(v + high, 0.0)
        by_high = ((1.0 - self.upper - self.upper_slope * moving) * (v > high)
                   - (1.0 - self.lower - self.lower_slope * moving) * (v < -high))
        out = np.zeros((len(u), u.shape[1], 6))
        out[:, self.channel] = np.column_stack([
            by_high * np.where(bent, 1.0, 0.02), by_high * np.where(bent, moving, 0.0),
            above, moving * above, below, moving * below])
        return out

    def amplitude_gains(self, p: np.ndarray, largest: float = np.inf) -> tuple[np.ndarray, np.ndarray]:
        """The steepest zone for small motions, as one may rest anywhere; the mean of the outer zones for large ones."""
        reach = 1e6 * self.limit  # far out, where the zones' slopes are the gain
        outer = [float(self.apply(np.full((1, 1), s * reach), np.asarray(p)[None])[0, 0] / (s * reach))
                 for s in (1, -1)]
        far = self._describing_gains(np.asarray(p), largest) if np.isfinite(largest) else \
            np.array([0.5 * (outer[0] + outer[1])])
        return np.array([max(1.0, *outer)]), far

    def starts(self, u: np.ndarray, p: np.ndarray) -> list[InputStage]:
        spread = float(np.sqrt(np.mean(u[:, self.channel] ** 2))) or 1.0
        flat = {"limit_slope": 0.0, "upper_slope": 0.0, "lower_slope": 0.0}
        return [replace(self, limit=factor * spread, upper=ratio, lower=ratio, **flat)
                for factor in (0.1, 0.3, 0.8) for ratio in (0.1, 0.4)]

    def scales(self, reach: float) -> np.ndarray:
        per_unit = 1.0 / reach if reach else 0.0
        return np.array([self.limit, 0.5 * self.limit * per_unit, 0.3, 0.2 * per_unit, 0.3, 0.2 * per_unit])


STAGES = {"tanh": TanhStage, "three-zone": ThreeZoneStage}
