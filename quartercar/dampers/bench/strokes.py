"""Strokes of a run: turning points, and the plateau of the velocity between two of them."""

from __future__ import annotations

import numpy as np

from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.toolkit import checks
from quartercar.dampers.bench.settling import effective_samples

SMOOTH = 0.1
"""share of a stroke's middle half over which deviations from the straight line are averaged."""
CURVED = 3.0
"""standard errors by which a speed must vary to be refused."""


def travel(record: Record) -> tuple[np.ndarray, bool]:
    """Displacement, or the integral of the velocity; and whether it is the measured one.

    Parameters
    ----------
    record : Record
        Uniform, with displacement or velocity.

    Returns
    -------
    travel : (n,) array
        The integral starts at 0 [m].
    measured : bool
        False for the integral.

    Raises
    ------
    InputError
        Neither displacement nor velocity.
    """
    for role in ("displacement", "velocity"):
        if record.has(role):
            values = checks.finite(record[role], f"record '{record.name}': {role}")
            if role == "displacement":
                return values, True
            steps = 0.5 * float(record.sample_time or 0.0) * (values[1:] + values[:-1])
            return np.concatenate([[0.0], np.cumsum(steps)]), False
    raise InputError(f"record '{record.name}' has neither displacement nor velocity", got=", ".join(record.channels),
                     mend=checks.role_mend("displacement"))


def turning_points(x: np.ndarray, threshold: float) -> np.ndarray:
    """Indices of the turning points between which x travels more than `threshold`, ends of the record included.

    Parameters
    ----------
    x : (n,) array
        Displacement [m].
    threshold : float
        [m]; not above zero where nothing moves.

    Returns
    -------
    (m,) array of int
        Rising; empty for a threshold that is not above zero.
    """
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


def plateau(x: np.ndarray, first: int, last: int, straight: float, period: float) -> tuple[int, int, float, float]:
    """Samples over which x follows the line through its middle half, that line's slope, and the share of the stroke.

    Parameters
    ----------
    x : (n,) array
        Displacement [m].
    first, last : int
        Samples of the turning points at both ends of the stroke.
    straight : float
        Deviation from the line that ends the plateau, as a share of the stroke; the noise of x is allowed besides.
    period : float
        Sample time [s].

    Returns
    -------
    begin, end : int
        Samples of the plateau, the second not included.
    velocity : float
        [m/s].
    share : float
        Of the stroke that the plateau covers; 0 where the stroke has too few samples or is nowhere straight.
    """
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


def speed_varies(x: np.ndarray) -> bool:
    """Whether the speed varies by more than 3 % over a plateau, and that stands out of the noise (a sine does).

    Parameters
    ----------
    x : (n,) array
        Displacement over the plateau [m].

    Returns
    -------
    bool
        By the second and third Legendre coefficient of x.
    """
    s = np.linspace(-1.0, 1.0, x.size)
    design = np.polynomial.legendre.legvander(s, 3)
    coefficients, *_ = np.linalg.lstsq(design, x, rcond=None)
    residual = x - design @ coefficients
    error = float(residual.std()) / np.sqrt(effective_samples(residual))
    for degree in (2, 3):
        change = degree * abs(coefficients[degree]) / max(abs(coefficients[1]), 1e-300)  # rms speed of P_2, P_3, nearly
        if change > 0.03 and abs(coefficients[degree]) > CURVED * error * np.sqrt(2 * degree + 1):
            return True
    return False
