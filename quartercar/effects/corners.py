"""Corners: where the velocity bends between two samples, found from it and from the displacement together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lpvid.diagnosis.signals import Signals

EDGE = 0.02
"""least distance of a corner from the samples beside it, as a share of the time between them"""
SHARP = 0.01
"""share of the rms velocity by which the mean over an interval must differ for it to be marched in short steps"""


class Corners(NamedTuple):
    """What the velocity does between samples beyond a straight line: a tent in each interval.

    Attributes
    ----------
    rise : (n,) array
        Mean velocity from the sample before to each, beyond that of a straight line [m/s].
    place : (n,) array
        Where the tent has its top, as a share of the interval.
    sharp : (n,) bool array
        Intervals in which that matters.
    """

    rise: np.ndarray
    place: np.ndarray
    sharp: np.ndarray


def corners(s: Signals) -> Corners:
    """Corners of the motion of a record, none where no displacement was measured.

    A drive that turns with limited acceleration bends its velocity at instants between two samples. A straight line
    from one to the next then misses up to Δa h/8 of the mean velocity there, Δa the change of the acceleration over
    the two neighbouring intervals, h the sampling period: way enough to compress air or take up play by a tenth too
    little. The displacement shows by how much it misses, Δx/h − (v₀ + v₁)/2; that is used as far as the velocity
    has room for it, so that neither the noise of the one sensor nor a lag or a gain between the two counts for more
    than what the other one shows. The corner lies where the straight lines that come from both sides meet::

        v ───┐·.  top at the share d₁/(d₀ + d₁) of the way, d₀ and d₁ the second differences
               ·.\\   of the velocity at the sample before and behind
                 ·└── straight line from sample to sample

    Parameters
    ----------
    s : Signals
        With velocity; found once for them.

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
        bend = np.pad(-np.diff(v, 2), 1)  # none is known at the ends
        room = (bend[1:] + bend[:-1]) / 8
        rise[1:] = np.where(missed * room > 0, np.sign(room) * np.minimum(np.abs(missed), np.abs(room)), 0.0)
        before, behind = np.abs(bend[:-1]), np.abs(bend[1:])
        both = before + behind
        place[1:] = np.clip(np.divide(behind, both, out=np.full(n - 1, 0.5), where=both > 0), EDGE, 1 - EDGE)
    return Corners(rise, place, np.abs(rise) > SHARP * np.sqrt(np.mean(s["velocity"] ** 2)))
