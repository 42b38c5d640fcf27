"""Resonances: the natural frequencies at which an effect of second order is screened."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lpvid.baselines.signals import Signals


def natural_frequencies(count: int, bounds: tuple[float, float], signals: tuple[Signals, ...],
                        scale: Callable[[str], float | None]) -> np.ndarray | None:
    """Natural frequencies, evenly in the logarithm between that of the motion and half the sampling rate.

    Below the motion's frequency a second-order low-pass would leave no force, above half the sampling rate it is a
    delay.

    Parameters
    ----------
    count : int
    bounds : (float, float)
        Least and largest one [Hz].
    signals : tuple of Signals
        Of one rate.
    scale : callable
        Natural size of a quantity of a unit, of "Hz" that of a radian of the motion.

    Returns
    -------
    (count,) array or None
        [Hz]; None where nothing moves.
    """
    radians = scale("Hz")
    if radians is None:
        return None
    low, high = np.clip((radians / (2 * np.pi), 0.5 / signals[0].sample_time), *bounds).tolist()
    return np.geomspace(low, high, count + 2)[1:-1]
