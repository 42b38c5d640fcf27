"""Stretches: parts of signals, one after the other on one clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from lpvid.baselines.signals import Signals, SignalStretch


def cut_together(parts: Sequence[tuple[Signals, int, int]], spans: Sequence[tuple[float, float]], transition: int
                 ) -> Signals:
    """Stretches one after the other, the first samples of each a smooth transition.

    Parameters
    ----------
    parts : sequence of (Signals, int, int)
        Signals, first sample, and the one after the last.
    spans : sequence of (float, float)
        Of each in the time of all records, from 0 to 1.
    transition : int
        Samples.

    Returns
    -------
    Signals
    """
    head = parts[0][0]
    roles = [r for r in head.channels if all(s.has(r) for s, _, _ in parts)]
    channels = {r: _concatenated([s[r][a:b] for s, a, b in parts], transition) for r in roles}
    firsts = np.cumsum([0, *(b - a for _, a, b in parts)])[:-1]
    found = Signals(head.sample_time, channels, np.concatenate([s.output[a:b] for s, a, b in parts]), "stretches",
                    (0.0, 1.0), stretches=tuple(
                        SignalStretch(int(at), span, cut(s, a) if a else None, s)
                        for at, span, (s, a, _) in zip(firsts, spans, parts, strict=True)))
    return replace(found, peers=(found,))


def _concatenated(pieces: Sequence[np.ndarray], transition: int) -> np.ndarray:
    """Values one after the other; the first of each replaced by a cubic transition from the ones before."""
    out, at = np.concatenate(pieces), 0
    ease = np.linspace(0.0, 1.0, transition + 1)[:-1]
    ease = ease**2 * (3 - 2 * ease)
    for before, piece in pairwise(pieces):
        at += before.size
        n = min(transition, piece.size - 1)
        out[at: at + n] = before[-1] + ease[:n] * (piece[n] - before[-1])
    return out


def cut(s: Signals, last: int) -> Signals:
    """The first samples of signals.

    Parameters
    ----------
    s : Signals
    last : int
        How many.

    Returns
    -------
    Signals
    """
    return Signals(s.sample_time, {r: c[:last] for r, c in s.channels.items()}, s.output[:last], s.name)
