"""Corners: changes of the acceleration between two samples, from velocity and displacement together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lpvid.baselines.signals import Signals
from lpvid.rounding import STEP
from quartercar.effects.viscous import SLOW


class Corners(NamedTuple):
    """The velocity between samples less its linear course: a triangle in each interval.

    Attributes
    ----------
    rise : (n,) array
        Mean velocity in the interval before each sample, less that of a linear course [m/s].
    place : (n,) array
        Place of the triangle's vertex, as a share of the interval.
    sharp : (n,) bool array
        Intervals in which it exceeds `SLOW` of the rms velocity, which are integrated in short steps.
    """

    rise: np.ndarray
    place: np.ndarray
    sharp: np.ndarray


def corners(s: Signals) -> Corners:
    """Corners of the motion of a record, none where no displacement was measured.

    A drive of limited acceleration changes its acceleration at instants between two samples. Linear interpolation of
    the velocity then has an error of up to Δa h/8 in its mean over the interval, Δa the change of the acceleration over
    the two neighbouring intervals, h the sampling period; air is compressed, or play taken up, by up to a tenth too
    little. The displacement gives that error, Δx/h − (v₀ + v₁)/2. It is limited to the largest one that the second
    differences of the velocity allow, so that the noise of either sensor, and a lag or a gain between the two, have
    little effect. The corner is at the intersection of the lines through the samples on both sides::

        v ───┐·.  vertex at the share d₁/(d₀ + d₁) of the interval, d₀ and d₁ the second
               ·.\\   differences of the velocity at its first and last sample
                 ·└── line from sample to sample

    Parameters
    ----------
    s : Signals
        With velocity; computed once for them.

    Returns
    -------
    Corners

    Examples
    --------
    >>> t = np.arange(8.0)
    >>> s = Signals(1.0, {"velocity": np.maximum(t - 3.25, 0), "displacement": np.maximum(t - 3.25, 0)**2 / 2}, t)
    >>> found = corners(s)
    >>> found.rise.round(4).tolist(), float(found.place[4].round(4))
    ([0.0, 0.0, 0.0, 0.0, -0.0938, 0.0, 0.0, 0.0], 0.25)
    """
    return s.cached("corners", lambda: _corners(s))


def _corners(s: Signals) -> Corners:
    n = s.n_samples
    rise, place = np.zeros(n), np.full(n, 0.5)
    if s.has("displacement") and n > 2:
        v = s["velocity"]
        missed = np.diff(s["displacement"]) / s.sample_time - (v[1:] + v[:-1]) / 2
        bend = np.pad(-np.diff(v, 2), 1)  # there is none at the ends
        room = 0.5 * (bend[1:] + bend[:-1]) / 4  # the mean of a triangle is half of its height
        rise[1:] = np.where(missed * room > 0, np.sign(room) * np.minimum(np.abs(missed), np.abs(room)), 0.0)
        before, behind = np.abs(bend[:-1]), np.abs(bend[1:])
        both = before + behind
        vertex = np.divide(behind, both, out=np.full(n - 1, 0.5), where=both > 0)
        place[1:] = np.clip(vertex, STEP, 1 - STEP)
    return Corners(rise, place, np.abs(rise) > SLOW * np.sqrt(np.mean(s["velocity"] ** 2)))
