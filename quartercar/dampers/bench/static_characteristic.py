"""Static characteristic of a damper from triangle runs: steady windows found, forces fitted, repeats pooled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from lpvid.codec import Encoded
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.toolkit import checks
from quartercar.dampers.bench.steady_windows import SteadyWindow, WindowSettings, steady_windows

SAME_SPEED = 0.05
"""speeds of one direction whose logarithms differ by less are repeats of one another."""
SHOWN = 8
"""points that a printed characteristic lists."""


@dataclass(frozen=True, eq=False)
class StaticCharacteristic(Encoded):
    """Steady force over steady velocity, sorted by velocity.

    Nothing is subtracted: the source's F_offset = min F forces one residual to zero and is correlated with the laminar
    coefficient (E3.7), so that friction is left to the fits. `parts` splits off what does not change sign with the
    velocity (gas preload, load-cell zero).

    Attributes
    ----------
    velocity : (n,) array
        Signed [m/s].
    force : (n,) array
        Signed, at the middle of the windows [N].
    std : (n,) array
        Standard error of the force: noise within the windows and repeatability between them [N].
    count : (n,) array of int
        Windows pooled into the point.
    repeatability : float
        Scatter between windows of one point beyond their noise, as a share of the force; NaN without repeats.
    windows : tuple of SteadyWindow
        Every slope looked at, also those that were refused, with the reason.

    Examples
    --------
    >>> c = StaticCharacteristic([-2e-3, -1e-3, 1e-3, 2e-3], [-330.0, -170.0, 150.0, 310.0], [1.0, 1.0, 1.0, 1.0])
    >>> c.side(-1).force
    array([170., 330.])
    >>> odd, offset, std = c.parts()
    >>> odd.force, round(offset, 6)
    (array([160., 320.]), -10.0)
    """

    JSON = (("velocity_m_per_s", "velocity"), ("force_N", "force"), ("std_N", "std"), "count",
            "repeatability", "refused")

    velocity: np.ndarray
    force: np.ndarray
    std: np.ndarray
    count: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    repeatability: float = float("nan")
    windows: tuple[SteadyWindow, ...] = ()

    def __post_init__(self) -> None:
        order = np.argsort(np.asarray(self.velocity, dtype=float), kind="stable")
        count = np.asarray(self.count) if len(self.count) else np.ones(order.size, dtype=int)
        for name in ("velocity", "force", "std"):
            values = checks.frozen_array(getattr(self, name), f"a characteristic's {name}", ndim=1)
            checks.finite(checks.shaped(values, (order.size,), f"a characteristic's {name}"), name)
            object.__setattr__(self, name, checks.frozen_array(values[order], name))
        object.__setattr__(self, "count", checks.frozen_array(count[order], "count", ndim=1, dtype=int))
        if np.any(self.velocity == 0.0):
            raise InputError("a static characteristic has no point at zero velocity", why="friction has no value there")

    @property
    def n_points(self) -> int:
        """Number of points."""
        return self.velocity.size

    @property
    def speed(self) -> np.ndarray:
        """(n,) |v| [m/s]."""
        return np.abs(self.velocity)

    @property
    def direction(self) -> np.ndarray:
        """(n,) +1 in extension, −1 in compression."""
        return np.sign(self.velocity).astype(int)

    @property
    def refused(self) -> tuple[SteadyWindow, ...]:
        """Slopes that gave no point."""
        return tuple(w for w in self.windows if w.fault)

    def side(self, direction: int) -> StaticCharacteristic:
        """The points of one direction, turned into the first quadrant: speeds and resisting forces, rising.

        Parameters
        ----------
        direction : {1, −1}
            1 for extension, −1 for compression.

        Returns
        -------
        StaticCharacteristic
            Positive speeds [m/s], forces that resist positive [N].

        Raises
        ------
        InputError
            Another direction, or no point in this one.
        """
        if direction not in (1, -1):
            raise InputError("direction is 1 or -1", got=direction)
        keep = self.direction == direction
        if not keep.any():
            raise InputError("the characteristic has no point in this direction",
                             got="extension only" if direction < 0 else "compression only")
        return StaticCharacteristic(self.speed[keep], direction * self.force[keep], self.std[keep], self.count[keep],
                                    self.repeatability, tuple(w for w in self.windows if w.direction == direction))

    def parts(self) -> tuple[StaticCharacteristic, float, float]:
        """Odd part ½(F(v) − F(−v)) over speed, and mean even part ½(F(v) + F(−v)) with its standard error [N].

        Only speeds measured in both directions count. A gas preload or a zero error of the load cell is even; an
        asymmetric damper has an even part that grows with speed, and then `side` is the right view.

        Returns
        -------
        odd : StaticCharacteristic
            Positive speeds [m/s], forces [N].
        offset : float
            Mean even part [N].
        std : float
            Its standard error, with the scatter of the even parts between speeds [N].

        Raises
        ------
        InputError
            No speed is common to both directions.
        """
        out, back = self.side(1), self.side(-1)
        nearest = np.abs(np.log(out.speed[:, None] / back.speed)).argmin(axis=1)
        pairs = [(i, j) for i, j in enumerate(nearest) if abs(np.log(out.speed[i] / back.speed[j])) < SAME_SPEED]
        if not pairs:
            raise InputError("no speed was run in both directions", mend="take one direction with side()")
        i, j = np.array(pairs).T
        std = 0.5 * np.hypot(out.std[i], back.std[j])
        odd = StaticCharacteristic(0.5 * (out.speed[i] + back.speed[j]), 0.5 * (out.force[i] + back.force[j]), std,
                                   out.count[i] + back.count[j], self.repeatability, self.windows)
        even = 0.5 * (out.force[i] - back.force[j])
        weight = 1.0 / np.maximum(std, 1e-12 * np.abs(odd.force).max()) ** 2
        mean = float(weight @ even / weight.sum())
        spread = float(weight @ (even - mean) ** 2 / weight.sum())
        return odd, mean, float(np.sqrt(1.0 / weight.sum() + spread / len(pairs)))

    def select(self, keep: np.ndarray) -> StaticCharacteristic:
        """Some of the points, by a boolean or index array.

        Parameters
        ----------
        keep : (n,) array of bool or of int
            Which to keep, by rising velocity.

        Returns
        -------
        StaticCharacteristic
            A copy, with all windows.
        """
        return StaticCharacteristic(self.velocity[keep], self.force[keep], self.std[keep], self.count[keep],
                                    self.repeatability, self.windows)

    def __repr__(self) -> str:
        used = len(self.windows) - len(self.refused)
        source = f" from {used} of {len(self.windows)} slopes" if self.windows else ""
        lines = [f"Static characteristic: {self.n_points} points{source}, "
                 f"{1e3 * self.speed.min():.4g} to {1e3 * self.speed.max():.4g} mm/s"]
        if np.isfinite(self.repeatability):
            lines.append(f"  repeats agree to {self.repeatability:.2%} of the force beyond their noise")
        shown = np.unique(np.linspace(0, self.n_points - 1, SHOWN).round().astype(int))
        lines += [f"  {1e3 * self.velocity[k]:+10.4g} mm/s {self.force[k]:+10.4g} ± {self.std[k]:.2g} N, "
                  f"{self.count[k]} slope(s)" for k in shown]
        if self.n_points > len(shown):
            lines.append(f"  … {self.n_points - len(shown)} points between them")
        if self.refused:
            lines.append(f"  refused {len(self.refused)}, the first: {self.refused[0].fault}")
        if np.mean(self.force * self.velocity) < 0:
            lines.append("  the force opposes the velocity: reversed polarity (polarity=-1 turns it)")
        return "\n".join(lines)


def static_points(records: Sequence[Record], settings: WindowSettings | None = None,
                  polarity: int = 1) -> StaticCharacteristic:
    """Measure the static characteristic from iso-kinetic (triangle, ramp) runs.

    Every slope between two turning points gives one window: the plateau of the velocity, without the reaction time
    after the turn, its centre part; there a straight line is fitted to the force (source 003, 2.3, 3.1; drop of 30 ms
    and centre half: equations.md 7.1). Where the force is still building up (compressibility) the window moves later;
    where it never settles, or the velocity is not constant (a sine), the slope is refused and states why.

    Parameters
    ----------
    records : sequence of Record
        Uniform, with ``force`` and ``displacement`` or ``velocity``.
    settings : WindowSettings, optional
    polarity : {1, −1}
        −1 where the force is measured against the velocity.

    Returns
    -------
    StaticCharacteristic
        Repeats (speeds within 5 %) pooled. The standard error of a point is that of its lines' means, with the scatter
        between repeats, estimated over all points as one share of the force.

    Raises
    ------
    InputError
        A channel is missing, or no slope is steady: the message gives the first reason.
    """
    if not records:
        raise InputError("no records to take static points from")
    if polarity not in (1, -1):
        raise InputError("polarity is 1 or -1", got=polarity)
    windows = tuple(w for r in records for w in steady_windows(r, settings or WindowSettings(), polarity))
    good = [w for w in windows if not w.fault]
    if not good:
        reason = windows[0].fault if windows else "the displacement never moves"
        raise InputError("no slope of these records is steady", why=reason, mend="triangle runs at constant speed")
    groups = [g for d in (-1, 1) for g in _groups([w for w in good if w.direction == d])]
    scatter = _repeatability(groups)
    extra = 0.0 if np.isnan(scatter) else scatter
    velocity = np.array([np.mean([w.velocity for w in g]) for g in groups])
    force = np.array([np.mean([w.force for w in g]) for g in groups])
    count = np.array([len(g) for g in groups])
    within = np.array([np.mean([w.std**2 for w in g]) for g in groups])
    slack = np.array([np.mean([w.velocity_std**2 for w in g]) for g in groups])
    variance = (within + _slopes(velocity, force) ** 2 * slack + (extra * force) ** 2) / count
    return StaticCharacteristic(velocity, force, np.sqrt(variance), count, scatter, windows)


def _slopes(velocity: np.ndarray, force: np.ndarray) -> np.ndarray:
    """dF/dv from the neighbours of the same direction, F/v where there are none [N·s/m]."""
    slopes = np.abs(force / velocity)
    for side in (np.flatnonzero(velocity < 0), np.flatnonzero(velocity > 0)):
        order = side[np.argsort(velocity[side])]
        if order.size > 1:
            slopes[order] = np.gradient(force[order], velocity[order])
    return slopes


def _groups(windows: list[SteadyWindow]) -> list[list[SteadyWindow]]:
    """Windows of one direction by speed: a new group where the speed rises by more than `SAME_SPEED`."""
    groups: list[list[SteadyWindow]] = []
    for w in sorted(windows, key=lambda w: w.speed):
        if groups and np.log(w.speed / groups[-1][0].speed) < SAME_SPEED:
            groups[-1].append(w)
        else:
            groups.append([w])
    return groups


def _repeatability(groups: list[list[SteadyWindow]]) -> float:
    """Scatter between repeats in excess of the noise within them, as a share of the force, over all points."""
    excess, freedom = 0.0, 0
    for g in (g for g in groups if len(g) > 1):
        force = np.array([w.force for w in g])
        scale = max(float(np.mean(force**2)), 1e-300)
        noise = np.mean([w.std**2 + (w.force / w.velocity * w.velocity_std) ** 2 for w in g])
        excess += (len(g) - 1) * float(force.var(ddof=1) - noise) / scale
        freedom += len(g) - 1
    return float(np.sqrt(max(excess / freedom, 0.0))) if freedom else float("nan")
