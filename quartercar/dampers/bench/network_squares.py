"""The least squares of source 003 for two losses in series or in parallel, as printed: (7) and (8)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError
from lpvid.toolkit import checks
from quartercar.dampers.laws.hydraulics import parallel_pressure, series_pressure

POINTS = 21
"""of 23 that the source uses: at the two lowest speeds friction dominates"""
FORMS = ("series", "parallel")


@dataclass(frozen=True)
class NetworkSquares:
    """Two losses fitted by linear least squares.

    Attributes
    ----------
    form : {"series", "parallel"}
    coefficients : tuple of float
        c_L [N·s/m] and c_Q [N·s²/m²] in series; a [m/(s·N)] and b [m/(s·√N)] in parallel.
    offset : float
        min F, taken off first [N].
    esr : float
        Of the force over the points used.
    """

    form: str
    coefficients: tuple[float, float]
    offset: float
    esr: float = float("nan")

    def force(self, speed: np.ndarray) -> np.ndarray:
        """F(v) [N], the parallel law by its inverse without cancellation.

        Where the fit has given a conductance below zero, there is no force beyond some speed; it is NaN there.

        Parameters
        ----------
        speed : (n,) array
            ≥ 0 [m/s].

        Returns
        -------
        (n,) array
            With the offset [N].
        """
        first, second = self.coefficients
        if self.form == "series":
            return self.offset + series_pressure(speed, first, second)
        with np.errstate(invalid="ignore"):
            return self.offset + parallel_pressure(speed, first, second)


def fit_network_squares(speed: np.ndarray, force: np.ndarray, form: str, points: int = POINTS) -> NetworkSquares:
    """(7) or (8) of the source, on the quadrant of positive speed and force.

    ::

        F~ = F - min F
        series    (7):  F~ = c_L v + c_Q v^2      error of F~
        parallel  (8):  v = a F~ + b sqrt(F~)     error of v

    The two errors are of different quantities, and min F holds some of the viscous force, so that one residual is
    forced to zero (E3.6, E3.7 of the equation sheet): `choose_network` fits both jointly with the friction in ln F.

    Parameters
    ----------
    speed, force : (n,) array
        Points, slowest first [m/s], [N].
    form : {"series", "parallel"}
    points : int
        How many of the fastest are used; the offset is of all.

    Returns
    -------
    NetworkSquares

    Raises
    ------
    InputError
        Fewer than three points; speeds that are not positive and rising.

    Examples
    --------
    >>> v = np.linspace(0.0, 1.0, 23)
    >>> found = fit_network_squares(v, 5.0 + 2.0 * v + 3.0 * v**2, "series")
    >>> [round(c, 2) for c in found.coefficients]
    [2.0, 3.0]
    """
    checks.one_of(form, FORMS, "the form of a network")
    speed, force = np.asarray(speed, dtype=float), np.asarray(force, dtype=float)
    if speed.size < 3 or np.any(speed < 0) or np.any(np.diff(speed) <= 0):
        raise InputError("the least squares need three points at least, by rising positive speed",
                         got=f"{speed.size} points", mend="take one side of a static characteristic (.side(1))")
    offset = float(force.min())
    v, f = speed[-points:], force[-points:] - offset
    columns, target = ([v, v**2], f) if form == "series" else ([f, np.sqrt(f)], v)
    first, second = np.linalg.lstsq(np.column_stack(columns), target, rcond=None)[0]
    found = NetworkSquares(form, (float(first), float(second)), offset)
    error = force[-points:] - found.force(v)
    return NetworkSquares(form, found.coefficients, offset, float(np.sum(error**2) / np.sum((f - f.mean()) ** 2)))
