"""Starting points of the relief-valve dampers: the settled curve by linear least squares, the dynamics by trial."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from quartercar.dampers.drive import Drive, joined
from quartercar.dampers.families import LawDamper
from quartercar.dampers.fitting.starting import nonnegative_fit, ranked_starts
from quartercar.dampers.sizes import Sizes

BINS = 40
"""speeds at which the settled curve is read"""
NEXT_TO_NONE = 1e-4
"""gain of a main orifice that is closed, relative to the largest speed over the root of its force"""
CURVES = 4
"""settled curves tried with each stiffness and poppet"""
OPENINGS = (0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.93, 1.5)
"""opening forces tried, relative to the largest force"""
RATIOS = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
"""losses of the series orifice tried, relative to the valve's"""
STIFFNESSES = (2.0, 6.0, 20.0, 60.0, 200.0)
"""tried, relative to force over stroke"""
POPPETS = ((0.08, 1.0), (0.25, 0.7))
"""frequencies, as shares of the sample rate, and damping ratios tried"""


def starting_vectors(damper: LawDamper, shape: tuple, drives: Sequence[Drive], count: int) -> list[np.ndarray]:
    """At most `count` vectors, the least free-run error first.

    The settled law is explicit in the force: given opening force and a_S/a_V, the lift follows from F, and
    v = R(F)/√a_O + e(F)/√a_V is linear in what is left.
    """
    speeds, forces, preload = settled_points(drives)
    velocity, total = joined(drives, "velocity", "force")
    bend = np.concatenate([np.gradient(d.velocity, d.sample_time) for d in drives])
    stroke = float(np.mean(velocity**2) / (np.sqrt(np.mean(bend**2)) or 1.0))
    base = float(total.std()) / (stroke or Sizes.of(drives).length)
    candidates = []
    best = curves("series_loss" in damper.names, shape, speeds, forces)[:CURVES]
    for curve, stiffness, (frequency, damping) in product(best, STIFFNESSES, POPPETS):
        named = {**curve, "hydraulic_stiffness": base * stiffness, "valve_frequency": frequency / drives[0].sample_time,
                 "valve_damping": damping, "friction": 0.01 * float(forces.max()), "preload": preload}
        candidates.append(np.array([np.clip(named[p.name], p.lower, p.upper) for p in damper.parameters]))
    return ranked_starts(damper, drives, candidates, count)


def settled_points(drives: Sequence[Drive]) -> tuple[np.ndarray, np.ndarray, float]:
    """(speeds, forces, preload): force binned over speed, directions and loop branches averaged."""
    v, force = joined(drives, "velocity", "force")
    edges = np.unique(np.quantile(np.abs(v), np.linspace(0.0, 1.0, BINS + 1)))
    places = np.clip(np.searchsorted(edges, np.abs(v), side="right") - 1, 0, max(edges.size - 2, 0))
    speeds, forces, middles = [], [], []
    for k in range(edges.size - 1):
        up, down = force[(places == k) & (v > 0)], force[(places == k) & (v < 0)]
        if up.size and down.size:
            speeds.append(float(np.abs(v[places == k]).mean()))
            forces.append(0.5 * float(up.mean() - down.mean()))
            middles.append(0.5 * float(up.mean() + down.mean()))
    if not speeds:
        return np.array([float(np.abs(v).max())]), np.array([float(np.abs(force).max())]), 0.0
    return np.array(speeds), np.maximum(np.array(forces), 1e-9 * float(np.abs(force).max())), float(np.median(middles))


def curves(series: bool, shape: tuple, speeds: np.ndarray, forces: np.ndarray) -> list[dict[str, float]]:
    """Settled laws on a grid of opening forces and loss ratios, the best first."""
    from quartercar.dampers.laws._relief_valve_kernels import settled_branches

    found = []
    for opening in OPENINGS:
        for ratio in RATIOS if series else (0.0,):
            limit = opening * float(forces.max())
            branches = settled_branches(forces, (1.0, 1.0, limit, 1.0, 1.0, 1.0, ratio), shape)
            weight = 1.0 / np.maximum(speeds, 0.05 * speeds.max())
            gains, error = nonnegative_fit(branches * weight[:, None], speeds * weight)
            least = NEXT_TO_NONE * float((speeds / np.sqrt(forces)).max())
            curve = {"opening_force": limit, "orifice_loss": 1.0 / max(gains[0], least) ** 2}
            valve = gains[1] if gains[1] > 0 else 10.0 * max(gains[0], least)
            curve["valve_loss"] = 1.0 / valve**2
            if series:
                curve["series_loss"] = ratio * curve["valve_loss"]
            found.append((error, curve))
    found.sort(key=lambda pair: pair[0])
    return [curve for _, curve in found]
