"""The thesis's shaped input as it was regressed: three lines whose slopes and intercepts are polynomials in current."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.input_stage import InputStage
from lpvid.model.signals import Signal


@dataclass(frozen=True)
class ZoneLines(InputStage):
    """Three lines over velocity, Díaz Salas 2011 (3.16)-(3.22), as separate regressions leave them.

    ::

        u = (m_1 v + c_1) / m_2    v < −v_high       m_j(p) = Σ_k m_jk p^k,  c_j(p) alike
        u = v                      |v| ≤ v_high      v_high(p) = limit_0 + limit_1 p
        u = (m_3 v + c_3) / m_2    v > v_high

    The lines of neighbouring zones need not meet at v_high, so u may jump there; `ThreeZoneStage` imposes that they do.

    Parameters
    ----------
    limit : tuple of float
        Coefficients of v_high, lowest power first [unit of the input].
    lower, middle, upper : tuple of float
        Those of the slopes m_1, m_2, m_3 (of the output per input; only their ratios matter).
    lower_intercept, upper_intercept : tuple of float
        Those of c_1 and c_3, in the output's unit over that of m_2; c_2 is left out, as in the thesis.
    channel, variable : int
        Which measured input is shaped, and which scheduling variable moves the lines.

    Examples
    --------
    >>> stage = ZoneLines((0.06,), (900.0,), (12000.0,), (900.0,), (-666.0,), (666.0,))
    >>> stage.apply(np.array([[-0.3], [0.03], [0.3]]), np.zeros((3, 1))).ravel().round(3)
    array([-0.078,  0.03 ,  0.078])
    """

    kind = "zone-lines"

    limit: tuple[float, ...]
    lower: tuple[float, ...]
    middle: tuple[float, ...]
    upper: tuple[float, ...]
    lower_intercept: tuple[float, ...]
    upper_intercept: tuple[float, ...]
    channel: int = 0
    variable: int = 0

    LINES: ClassVar[tuple[str, ...]] = ("lower", "middle", "upper", "lower_intercept", "upper_intercept")

    def __post_init__(self) -> None:
        for name in ("limit", *self.LINES):
            values = tuple(_checks.real(v, f"{name} of a stage of zone lines") for v in getattr(self, name))
            if not values:
                raise InputError(f"{name} of a stage of zone lines needs a coefficient", got="none")
            object.__setattr__(self, name, values)

    @property
    def vector(self) -> np.ndarray:
        return np.concatenate([self.limit, *(getattr(self, n) for n in self.LINES)])

    def with_vector(self, vector: np.ndarray) -> ZoneLines:
        parts, first = {}, 0
        for name in ("limit", *self.LINES):
            last = first + len(getattr(self, name))
            parts[name] = tuple(np.asarray(vector[first:last], dtype=float).tolist())
            first = last
        return replace(self, **parts)

    def signals(self, inputs: tuple[Signal, ...]) -> tuple[Signal, ...]:
        return self._zoned(inputs)

    def _zones(self, u: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """v, the zone of every sample (−1, 0, 1), and the lines' values over p, m_2 kept from changing its sign."""
        v = u[:, self.channel]
        moving = self._moving(p)
        lines = {n: np.polynomial.polynomial.polyval(moving, getattr(self, n)) for n in ("limit", *self.LINES)}
        high = np.maximum(lines["limit"], 0.0)
        sign = np.sign(self.middle[0]) or 1.0
        floor = 1e-3 * np.abs(self.middle).max()
        lines["middle"] = sign * np.maximum(sign * lines["middle"], floor)
        return v, np.where(v > high, 1, np.where(v < -high, -1, 0)), lines

    def apply(self, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        v, zone, lines = self._zones(u, p)
        out = np.array(u, dtype=float)
        for side, name in ((-1, "lower"), (1, "upper")):
            here = zone == side
            out[here, self.channel] = ((lines[name] * v + lines[f"{name}_intercept"]) / lines["middle"])[here]
        return out

    def knee(self, p: np.ndarray) -> np.ndarray:
        moving = self._moving(p)
        return np.maximum(np.polynomial.polynomial.polyval(moving, self.limit), 0.0)

    def slopes(self, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        v, zone, lines = self._zones(u, p)
        moving = self._moving(p)
        by = {n: np.zeros(v.size) for n in self.LINES}
        for side, name in ((-1, "lower"), (1, "upper")):
            here = zone == side
            by[name] += here * v / lines["middle"]
            by[f"{name}_intercept"] += here / lines["middle"]
            by["middle"] -= here * (lines[name] * v + lines[f"{name}_intercept"]) / lines["middle"] ** 2
        columns = [np.zeros((v.size, len(self.limit)))]
        columns += [by[n][:, None] * moving[:, None] ** np.arange(len(getattr(self, n))) for n in self.LINES]
        out = np.zeros((len(u), u.shape[1], self.vector.size))
        out[:, self.channel] = np.hstack(columns)
        return out

    def starts(self, u: np.ndarray, p: np.ndarray) -> list[InputStage]:
        return [self]

    def scales(self, reach: float) -> np.ndarray:
        """Zero for v_high, across which u jumps, and for the level of m_2, by which all others may be divided."""
        parts = [np.zeros(len(self.limit))]
        for name in self.LINES:
            own = getattr(self, name)
            size = max(np.abs(own).max(), np.abs(self.middle).max() * 0.01)
            parts.append(0.3 * size / max(reach, 1e-12) ** np.arange(len(own)))
        out = np.concatenate(parts)
        out[len(self.limit) + len(self.lower)] = 0.0
        return out
