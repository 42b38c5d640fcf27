"""Steady windows of triangle runs: turning points, plateaus of the velocity, straight lines through the force."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.record import Record

TURN = 0.1
"""a stroke shorter than this share of the record's travel is not one."""
COMPLETE = 0.75
"""share of the median stroke below which the first and the last count as cut off."""
LATER = ((0.5, 0.95), (0.75, 0.95))
"""parts of the plateau tried after the centre part while the pressure is still building up."""
SMOOTH = 0.1
"""share of a stroke's middle half over which deviations from the straight line are averaged."""
CLIP = 5.0
"""robust standard deviations beyond which a sample of the force counts as a spike."""
SPIKES = 0.1
"""share of spikes from which a window is refused."""
BLOCKS, LAGS = 120, 16
"""block means and trial time constants by which a lag of the force is looked for."""
LAG_FOUND = 12.0
"""F ratio (2 parameters) above which a lag counts as found."""
CURVED = 3.0
"""standard errors by which a speed must vary to be refused."""


@dataclass(frozen=True)
class WindowSettings:
    """How steady a slope must be.

    Attributes
    ----------
    reaction_time : float
        Dropped after every turn [s]; at least 5 τ of the damper's pressure build-up (7.4).
    centre : float
        Share of the plateau that is kept, in its middle.
    straight : float
        Deviation of the displacement from a straight line that ends a plateau, as a share of the stroke.
    unsettled : float
        Part of the force that is still to build up, as a share of it, above which a window is refused.
    drift : float
        Change of the force along the window, as a share of it, above which it is refused: a pressure that builds up
        more slowly than the stroke lasts looks straight.
    least : int
        Samples that a window needs.
    """

    reaction_time: float = 0.03
    centre: float = 0.5
    straight: float = 0.002
    unsettled: float = 0.005
    drift: float = 0.3
    least: int = 12

    def __post_init__(self) -> None:
        for name in ("centre", "straight", "unsettled", "drift"):
            if not 0 < _checks.real(getattr(self, name), name) < 1:
                raise InputError(f"{name} is a share between 0 and 1", got=getattr(self, name))
        if _checks.real(self.reaction_time, "reaction_time") < 0:
            raise InputError("reaction_time cannot be negative", got=f"{self.reaction_time} s")
        _checks.count(self.least, "least", at_least=6)


@dataclass(frozen=True)
class SteadyWindow:
    """One slope of one record and the point that it gives.

    Attributes
    ----------
    record : str
    start, stop : float
        Of the window, in the record's time from its first sample [s].
    velocity, force, std : float
        Slope of the displacement [m/s]; the force's line at the middle [N], with its standard error, which allows for
        correlated noise by the effective number of samples n(1−ρ)/(1+ρ).
    velocity_std : float
        Standard error of the velocity [m/s].
    position : float
        Displacement at the middle [m]; 0 where it is not measured.
    drift : float
        Slope of the force's line over the displacement [N/m]: a gas spring, or pressure still building up.
    fault : str
        Why it gives no point; empty where it does.
    """

    record: str
    start: float
    stop: float
    velocity: float
    force: float = float("nan")
    std: float = float("nan")
    velocity_std: float = 0.0
    position: float = 0.0
    drift: float = float("nan")
    fault: str = ""

    @property
    def direction(self) -> int:
        """+1 in extension, −1 in compression."""
        return 1 if self.velocity > 0 else -1

    @property
    def speed(self) -> float:
        """|v| [m/s]."""
        return abs(self.velocity)


def steady_windows(record: Record, settings: WindowSettings | None = None, polarity: int = 1) -> list[SteadyWindow]:
    """One window for every slope of a record, refused ones with their reason.

    Raises
    ------
    InputError
        No force, neither displacement nor velocity, no uniform clock, NaN.
    """
    settings = settings or WindowSettings()
    if record.sample_time is None:
        raise InputError(f"record '{record.name}' has no uniform clock", mend="lpvid.condition.resample")
    if not record.has("force"):
        raise InputError(f"record '{record.name}' has no force", got=", ".join(record.channels),
                         mend="--role force=CHANNEL")
    force = polarity * _checks.finite(record["force"], f"record '{record.name}': force")
    x, measured = _travel(record)
    turns = _turns(x, TURN * float(np.ptp(x)))
    slopes = [(int(a), int(b)) for a, b in pairwise(turns) if abs(x[b] - x[a]) > TURN * float(np.ptp(x))]
    whole = COMPLETE * float(np.median([abs(x[b] - x[a]) for a, b in slopes])) if len(slopes) > 2 else 0.0
    if slopes and abs(x[slopes[-1][1]] - x[slopes[-1][0]]) < whole:  # cut off by the ends of the record, off centre
        slopes.pop()
    if slopes and abs(x[slopes[0][1]] - x[slopes[0][0]]) < whole:
        slopes.pop(0)
    return [_window(record, x, force, a, b, settings, measured) for a, b in slopes]


def _travel(record: Record) -> tuple[np.ndarray, bool]:
    """Displacement, or the integral of the velocity; and whether it is the measured one."""
    for role in ("displacement", "velocity"):
        if record.has(role):
            values = _checks.finite(record[role], f"record '{record.name}': {role}")
            if role == "displacement":
                return values, True
            steps = 0.5 * float(record.sample_time or 0.0) * (values[1:] + values[:-1])
            return np.concatenate([[0.0], np.cumsum(steps)]), False
    raise InputError(f"record '{record.name}' has neither displacement nor velocity", got=", ".join(record.channels),
                     mend="--role displacement=CHANNEL")


def _turns(x: np.ndarray, threshold: float) -> np.ndarray:
    """Indices of the turning points between which x travels more than `threshold`, ends of the record included."""
    if threshold <= 0:
        return np.zeros(0, dtype=int)
    rising = np.diff(x) > 0
    candidates = np.concatenate([[0], np.flatnonzero(rising[1:] != rising[:-1]) + 1, [x.size - 1]])
    turns, low, high, sense = [0], 0, 0, 0
    for k in candidates:
        low = k if x[k] < x[low] else low
        high = k if x[k] > x[high] else high
        if sense >= 0 and x[high] - x[k] > threshold:  # has come down from the highest point
            if sense or high > 0:
                turns.append(high)
            sense, low = -1, k
        elif sense <= 0 and x[k] - x[low] > threshold:
            if sense or low > 0:
                turns.append(low)
            sense, high = 1, k
    last = high if sense > 0 else low
    turns.append(int(last) if sense else x.size - 1)
    return np.unique(turns)


def _window(record: Record, x: np.ndarray, force: np.ndarray, first: int, last: int, settings: WindowSettings,
            measured: bool) -> SteadyWindow:
    period = float(record.sample_time or 0.0)
    begin, end, velocity, share = _plateau(x, first, last, settings.straight, period)

    def refuse(why: str) -> SteadyWindow:
        return SteadyWindow(record.name, begin * period, end * period, velocity, fault=why)

    place = f"record '{record.name}' at {first * period:.3g} s"
    if share < 0.5:
        return refuse(f"{place}: the speed is constant over {share:.0%} of the stroke only")
    length, dropped = end - begin, begin + int(np.ceil(settings.reaction_time / period))
    last_used = begin + round(LATER[-1][1] * length)
    if last_used - dropped < 2 * settings.least:
        return refuse(f"{place}: {max(last_used - dropped, 0)} steady samples, {2 * settings.least} needed")
    if _varies(x[begin:end]):
        return refuse(f"{place}: the speed is not constant")
    amount, tau = _lag(force[dropped:last_used])
    half, left = 0.5 * settings.centre, np.inf
    for low, high in ((0.5 - half, 0.5 + half), *LATER):
        a, b = max(begin + round(low * length), dropped), begin + round(high * length)
        if b - a < settings.least:
            continue
        line = _line(force[a:b])
        left = abs(amount) * float(np.mean(np.exp(-(np.arange(a, b) - dropped) / tau))) / max(abs(line[0]), 1e-300)
        if left <= settings.unsettled:
            return _point(record, x, line, a, b, settings, place, measured)
    return refuse(f"{place}: the force does not settle, {min(left, 9.99):.1%} of it still to build up at the end")


def _point(record: Record, x: np.ndarray, line: tuple[float, float, float, float], a: int, b: int,
           settings: WindowSettings, place: str, measured: bool) -> SteadyWindow:
    """The window from its line through the force, unless that drifts or is spiked."""
    period = float(record.sample_time or 0.0)
    level, std, slope, spikes = line
    _, error, step, _ = _line(x[a:b])
    fault = ""
    if spikes > SPIKES:
        fault = f"{place}: {spikes:.0%} of the force samples are spikes"
    elif abs(slope) * (b - a) > settings.drift * abs(level) + 4 * std:
        fault = f"{place}: the force changes by {abs(slope * (b - a) / level):.0%} along the window"
    return SteadyWindow(record.name, a * period, b * period, step / period, level, std,
                        float(error * np.sqrt(12.0) / (b - a) / period), float(x[a:b].mean()) if measured else 0.0,
                        slope / step, fault)


def _plateau(x: np.ndarray, first: int, last: int, straight: float, period: float) -> tuple[int, int, float, float]:
    """Samples over which x follows the line through its middle half, that line's slope, and the share of the stroke."""
    stroke, travel = x[first:last + 1], float(x[last] - x[first])
    inside = np.flatnonzero(np.abs(stroke - 0.5 * (x[first] + x[last])) < 0.25 * abs(travel))
    if inside.size < 3:
        return first, last, travel / (period * max(last - first, 1)), 0.0
    k = np.arange(stroke.size)
    core = slice(int(inside[0]), int(inside[-1]) + 1)
    line = np.polyfit(k[core], stroke[core], 1)
    off = stroke - np.polyval(line, k)
    sigma = float(np.std(np.diff(off[core]))) / np.sqrt(2)
    width = max(1, min(int(SMOOTH * inside.size), inside.size // 3))
    padded = np.pad(off, (width // 2, width - 1 - width // 2), mode="edge")
    smooth = np.convolve(padded, np.ones(width) / width, "valid")
    limit = straight * abs(travel) + 4.0 * sigma / np.sqrt(width)
    middle = int(inside[inside.size // 2])
    outside = np.flatnonzero(np.abs(smooth) > limit)
    below, above = outside[outside < middle], outside[outside > middle]
    a = int(below[-1]) + 1 if below.size else 0
    b = int(above[0]) if above.size else stroke.size
    share = 0.0 if middle in outside else abs(float(np.polyval(line, b - 1) - np.polyval(line, a))) / abs(travel)
    return first + a, first + b, float(line[0]) / period, share


def _line(force: np.ndarray) -> tuple[float, float, float, float]:
    """Straight line through a window: value and standard error at its middle, step per sample, share of spikes."""
    k = np.arange(force.size) - 0.5 * (force.size - 1)
    keep = np.ones(force.size, dtype=bool)
    residual, line = force, np.zeros(2)
    for _ in range(4):
        line = np.polyfit(k[keep], force[keep], 1)
        residual = force - np.polyval(line, k)
        spread = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
        inliers = np.abs(residual) <= max(CLIP * spread, 1e-9 * float(np.abs(force).max()))
        if inliers.sum() < 4 or np.array_equal(inliers, keep):
            break
        keep = inliers
    std = float(residual[keep].std(ddof=2)) / np.sqrt(_effective(residual[keep]))
    return float(line[1]), float(std), float(line[0]), float(1.0 - keep.mean())


def _effective(residual: np.ndarray) -> float:
    """Independent samples that an autocorrelated residual is worth, n(1−ρ)/(1+ρ)."""
    power = float(residual @ residual)
    rho = float(residual[1:] @ residual[:-1]) / power if power > 0 else 0.0
    rho = min(max(rho, 0.0), 0.999)
    return max(residual.size * (1 - rho) / (1 + rho), 3.0)


def _varies(x: np.ndarray) -> bool:
    """Whether the speed varies by more than 3 % over a plateau, and that stands out of the noise (a sine does)."""
    s = np.linspace(-1.0, 1.0, x.size)
    design = np.polynomial.legendre.legvander(s, 3)
    coefficients, *_ = np.linalg.lstsq(design, x, rcond=None)
    residual = x - design @ coefficients
    error = float(residual.std()) / np.sqrt(_effective(residual))
    for degree in (2, 3):
        change = degree * abs(coefficients[degree]) / max(abs(coefficients[1]), 1e-300)  # rms speed of P_2, P_3, nearly
        if change > 0.03 and abs(coefficients[degree]) > CURVED * error * np.sqrt(2 * degree + 1):
            return True
    return False


def _lag(force: np.ndarray) -> tuple[float, float]:
    """A and τ [samples] of F = a + b t + A exp(−t/τ), with A = 0 where that is no better than a straight line."""
    width = max(1, force.size // BLOCKS)
    means = force[:force.size // width * width].reshape(-1, width).mean(axis=1)
    t = np.arange(means.size, dtype=float)
    straight = np.column_stack([np.ones(t.size), t / t.size])
    rest = means - straight @ np.linalg.lstsq(straight, means, rcond=None)[0]
    best, amount, tau = float(rest @ rest), 0.0, 1.0
    floor = max((1e-9 * float(np.abs(means).max())) ** 2 * t.size, 1e-300)
    if best <= floor:
        return 0.0, 1.0
    line_only = best
    for trial in np.geomspace(t.size / 40.0, 1.0 * t.size, LAGS):
        design = np.column_stack([straight, np.exp(-t / trial)])
        solution = np.linalg.lstsq(design, means, rcond=None)[0]
        error = means - design @ solution
        if error @ error < best:
            best, amount, tau = float(error @ error), float(solution[2]), float(trial)
    ratio = 0.5 * (line_only - best) / (max(best, floor) / max(t.size - 4, 1))
    return (amount, tau * width) if ratio > LAG_FOUND else (0.0, 1.0)
