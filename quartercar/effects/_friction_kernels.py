"""Compiled presliding friction; arrays only."""

from __future__ import annotations

import math

import numpy as np

from lpvid.toolkit import njit

DOUBLED = 2.0 ** np.arange(-1, 3)
NODES = np.unique(np.concatenate([-DOUBLED, np.zeros_like(DOUBLED), DOUBLED]))
"""speeds, in ε, between which tanh(v/ε) is taken as linear in the displacement: from ε/2 to 4ε in either direction"""


@njit()
def bristles(velocity: np.ndarray, step: float, deflection: float, reversal: float, nodes: np.ndarray,
             start: float, out: np.ndarray) -> None:
    """d dz/d|x| = g − z, g = tanh(v/ε), along a velocity that is linear between samples.

    Each interval is divided at the `nodes`, one of which is the reversal. Along a piece of length L, g is linear in the
    displacement from g₀ to g₁: z = g₁ + (z₀ − g₀) e^(−L/d) − (g₁ − g₀) (1 − e^(−L/d)) d/L. As d → 0 that is tanh(v/ε).
    The initial value is `start`.
    """
    z = start
    out[0] = z
    for k in range(1, velocity.size):
        before, after = velocity[k - 1], velocity[k]
        outwards = 1 if after > before else -1
        v, begun = before, math.tanh(before / reversal)
        for j in range(nodes.size + 1):
            then = after
            if j < nodes.size:
                then = reversal * (nodes[j] if outwards > 0 else nodes[nodes.size - 1 - j])
                if (then - v) * outwards <= 0.0 or (after - then) * outwards <= 0.0:
                    continue
            share = (then - v) / (after - before) if after != before else 1.0
            way = 0.5 * abs(v + then) * share * step / deflection
            goal = math.tanh(then / reversal)
            lag = -math.expm1(-way) / way if way > 0.0 else 1.0
            z = goal + (z - begun) * math.exp(-way) - (goal - begun) * lag
            v, begun = then, goal
        out[k] = z


@njit()
def hysteresis(velocity: np.ndarray, step: float, deflection: float, share: float, out: np.ndarray) -> None:
    """d ż = v − (1 − s)|v| z − s v |z| along a velocity that is linear between samples, divided where its sign changes.

    Piecewise exact in the path length L = ∫|v|dt. With σ = sign v: where σz ≥ 0, 1 − σz = (1 − σz₀) e^(−L/d); where
    u = −σz > 0, d u' = −(1 + c u), c = 1 − 2s, so that u = (u₀ + 1/c) e^(−cL/d) − 1/c, down to u = 0.
    """
    z, c = 0.0, 1.0 - 2.0 * share
    out[0] = z
    for k in range(1, velocity.size):
        before, after = velocity[k - 1], velocity[k]
        turn = before / (before - after) if before * after < 0.0 else 1.0
        for part in range(2):
            span = turn if part == 0 else 1.0 - turn
            if span <= 0.0:
                continue
            middle = 0.5 * after if part == 1 else 0.5 * (before + after) if turn == 1.0 else 0.5 * before
            sign = 1.0 if middle > 0.0 else -1.0
            way, u = abs(middle) * span * step / deflection, -sign * z
            if u > 0.0:
                back = u if c == 0.0 else math.log1p(c * u) / c
                if way < back:
                    u = u - way if c == 0.0 else u * math.exp(-c * way) + math.expm1(-c * way) / c
                    z = -sign * u
                    continue
                way, z = way - back, 0.0
            z = sign * (1.0 - (1.0 - sign * z) * math.exp(-way))
        out[k] = z
