"""Between samples: a law without memory on a faster clock than that of the record, for what bends it there."""

from __future__ import annotations

import numpy as np

from lpvid.diagnosis.baseline import Baseline
from lpvid.diagnosis.signals import Signals
from lpvid.diagnosis.spectra import weighed_alike
from quartercar.effects.electrical import clocked
from quartercar.effects.splines import spread

FAST, FINEST, MOST = 2000.0, 8, 80_000
"""rate of evaluation of a law without memory [1/s]: what it makes of a motion goes beyond half the sample rate, where
a filter would have taken it away; the most samples that are put between two for that; and samples in all, beyond which
a law is evaluated less often, down to the record's own: it would cost minutes and gigabytes"""


def times_as_fast(baseline: Baseline, s: Signals) -> int:
    """How many times as fast as the record a law is evaluated; 1 for one with a memory, whose steps are its own.

    Parameters
    ----------
    baseline : Baseline
    s : Signals

    Returns
    -------
    int
        At most `FINEST`, so that the samples in all are no more than `MOST`.
    """
    most = int(np.clip(MOST // s.n_samples, 1, FINEST))
    return int(np.clip(np.ceil(FAST * s.sample_time), 1, most)) if baseline.static else 1


def between(s: Signals, finer: int) -> Signals:
    """The same signals on a clock `finer` times as fast: cubic splines, and a current in straight lines or in steps.

    Parameters
    ----------
    s : Signals
    finer : int
        1 for the signals themselves.

    Returns
    -------
    Signals
        Found once; `coarse` holds the given ones, the output is held between its samples.
    """
    def ask() -> Signals:
        channels = {c: spread(x, finer) for c, x in s.channels.items() if c != "current"}
        if s.has("current"):
            n, current = np.arange(s.n_samples), s["current"]
            at = np.minimum(np.arange(finer * s.n_samples) / finer, n[-1])
            channels["current"] = np.repeat(current, finer) if clocked(s) else np.interp(at, n, current)
        own = s.record is None
        at = None if own else np.interp(np.arange(finer * s.n_samples) / finer, np.arange(s.n_samples), s.places)
        found = Signals(s.sample_time / finer, channels, np.repeat(s.output, finer), s.name, s.span, record=s.record,
                        at=at, finer=finer * s.finer, coarse=s)
        return weighed_alike(found, s)

    return s if finer == 1 else s.cached(("between samples", finer), ask)
