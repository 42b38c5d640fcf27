"""Between samples: a law without memory on a faster clock than that of the record."""

from __future__ import annotations

import numpy as np

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.budgets import LONG
from lpvid.baselines.signals import Signals
from lpvid.baselines.spectra import weighed_alike
from quartercar.effects.electrical import clocked
from quartercar.effects.splines import spline_resampled

FAST, FINEST = 2000.0, 8
"""rate of evaluation of a nonlinear law without memory [1/s], whose output has components above half the sample rate;
and the largest ratio of that rate to the record's"""


def times_as_fast(baseline: Baseline, s: Signals) -> int:
    """Ratio of the rate at which a law is evaluated to that of the record; 1 for a law with memory.

    Parameters
    ----------
    baseline : Baseline
    s : Signals

    Returns
    -------
    int
        At most `FINEST`, and so that there are no more than `LONG` samples in all, to limit time and memory.
    """
    most = int(np.clip(LONG // s.n_samples, 1, FINEST))
    return int(np.clip(np.ceil(FAST * s.sample_time), 1, most)) if baseline.static else 1


def between(s: Signals, finer: int) -> Signals:
    """The same signals on a clock `finer` times as fast: cubic splines, and a current linear or in steps.

    Parameters
    ----------
    s : Signals
    finer : int
        1 for the signals themselves.

    Returns
    -------
    Signals
        Computed once; `coarse` holds the given ones, the output is held between its samples.
    """
    def make() -> Signals:
        channels = {c: spline_resampled(x, finer) for c, x in s.channels.items() if c != "current"}
        if s.has("current"):
            n, current = np.arange(s.n_samples), s["current"]
            at = np.minimum(np.arange(finer * s.n_samples) / finer, n[-1])
            channels["current"] = np.repeat(current, finer) if clocked(s) else np.interp(at, n, current)
        own = s.record is None
        at = None if own else np.interp(np.arange(finer * s.n_samples) / finer, np.arange(s.n_samples), s.places)
        found = Signals(s.sample_time / finer, channels, np.repeat(s.output, finer), s.name, s.span, record=s.record,
                        at=at, finer=finer * s.finer, coarse=s)
        return weighed_alike(found, s)

    return s if finer == 1 else s.cached(("between samples", finer), make)
