"""Induced L2 gain of an LPV system: certified from above, reached from below."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from lpvid.analysis.certificates import Range, Rate, requested_box
from lpvid.analysis.frozen import pole_margins
from lpvid.analysis.frozen_norms import h_infinity_norm, largest_frozen_norm
from lpvid.analysis.gain_bounds import GainBounds, usable, worst_pole
from lpvid.analysis.hull_certificate import hull_gain
from lpvid.analysis.induced_gain import Gain
from lpvid.analysis.worst_case import WorstCase, worst_trajectory
from lpvid.errors import InputError
from lpvid.lmi.certificate_common import verdict_of
from lpvid.lmi.driven import Driven, driven
from lpvid.lmi.gain_certificate import GainCertificate
from lpvid.lmi.readings import box_of
from lpvid.model.hull import Hull, design_hull
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Scheduling

MOST_ENTRIES = 150_000
"""of all inequalities together, some twenty seconds of a solver (0.09 to 0.16 ms each, measured for orders 2 to 8 with
10 to 60 vertices): beyond it the steps between all pairs of vertices are left out"""

__all__ = ["Gain", "l2_gain", "l2_gains", "rated", "requested"]


def l2_gain(system: LPVStateSpace, rate: Rate = None, basis: Basis | None = None, *, range: Range = None,
            trajectories: bool = True) -> Gain:
    """Bounds of the induced L2 (ℓ2) gain from a model's inputs to its outputs while its scheduling moves.

    The upper bound is the least γ for which a storage function xᵀP(p)x passes our own re-check of the bounded-real
    inequality (equations sheet, 5.3); a solver only proposes it. The lower bound is reached: the largest frozen
    H-infinity norm, or a moving scheduling with its worst input. The linear part is meant: after an input stage, and
    without affine terms. Of a closed loop that was designed for a hull that polytope is meant: one P at its vertices
    (`hull_gain`), in discrete time an affine P(p) too, or P(p) on the box around it, whichever is lower; trajectories
    are not searched for there.

    Parameters
    ----------
    system : LPVStateSpace
        Continuous or discrete.
    rate : float, sequence or mapping of name to float, optional
        Bound on |dp/dt| [units per second]; infinite for arbitrary variation. Left out, those of the model's box.
    basis : Basis, optional
        Functions of p in P(p); left out, a constant and then polynomials up to degree 3.
    range : (lower, upper), one pair for each variable, or mapping of name to pair, optional
        Left out, the model's own box, or the hull of its design.
    trajectories : bool
        Look for moving schedulings that raise the lower bound.

    Returns
    -------
    Gain

    Raises
    ------
    InputError
        No state-space model; a rate, range or basis that does not fit it.

    Examples
    --------
    >>> import numpy as np
    >>> from lpvid.scheduling import Polynomial
    >>> eye = np.eye(2)                               # A = −I, B = [1; d], C = [d, −1]: zero for every frozen d
    >>> model = LPVStateSpace([-eye, 0 * eye], [[[1], [0]], [[0], [1]]], [[[0, -1]], [[1, 0]]], np.zeros((2, 1, 1)),
    ...                       Polynomial("d", degree=1), None, Scheduling(("d",), (-1,), (1,)))
    >>> slow, any_speed = (l2_gain(model, rate=r, trajectories=False) for r in (0.1, math.inf))
    >>> round(slow.upper, 3), round(any_speed.upper, 3), any_speed.between_grid
    (0.099, 1.0, True)
    """
    return l2_gains(system, (rate,), basis, range=range, trajectories=trajectories)[0]


def l2_gains(system: LPVStateSpace, rates: Sequence[Rate], basis: Basis | None = None, *, range: Range = None,
             trajectories: bool = False) -> tuple[Gain, ...]:
    """`l2_gain` for several rate bounds; the semidefinite programs are compiled once.

    Parameters
    ----------
    system, basis, range, trajectories
        As for `l2_gain`.
    rates : sequence
        Each as the ``rate`` of `l2_gain`.

    Returns
    -------
    tuple of Gain
        One for each rate; all "unstable" where a frozen model is.

    Raises
    ------
    InputError
        No rate at all, and whatever `l2_gain` refuses.
    """
    also = () if basis is None else tuple(n for n in basis.names if n in system.box.names)
    plant = driven(system, also)
    hull = design_hull(system) if range is None else None
    if hull is not None and rates:
        return tuple(_on_hull(system, plant, hull, rate, basis) for rate in rates)
    boxes = [box_of(plant.readings, rated(system.box, rate, range)) for rate in rates]
    if not boxes:
        raise InputError("a sweep needs at least one rate", got="none")
    begun = time.perf_counter()
    level, at = worst_pole(plant, boxes[0])
    if level >= 0:
        where = ", ".join(f"{n} = {v:.6g}" for n, v in zip(boxes[0].names, at, strict=True))
        lost = Gain("unstable", math.inf, math.inf, None, None, plant.inputs, plant.outputs,
                    "the model has a pole that does not decay" + (f" at {where}" if where else ""),
                    "narrow the scheduling range, or stabilise the model first", time.perf_counter() - begun)
        return (lost,) * len(boxes)
    norm, point, frequency = largest_frozen_norm(plant, boxes[0])
    frozen = WorstCase.frozen(boxes[0], point, frequency, norm)
    bounds: dict[tuple, GainBounds] = {}
    found = []
    for box in boxes:
        started = time.perf_counter()
        pattern = tuple(r is None for r in box.rate)
        if pattern not in bounds:
            fitted = None if basis is None else usable(basis, box, plant.sample_time is not None)
            bounds[pattern] = GainBounds(plant, box, fitted, norm)
            if len(boxes) > 1 and plant.sample_time is None:
                bounds[pattern].prepare(box.rate)
        worst = worst_trajectory(plant, box, frozen) if trajectories else frozen
        certificate = bounds[pattern].certify(box.rate)
        found.append(_judged(plant, worst, certificate, time.perf_counter() - started))
    return tuple(found)


def _on_hull(system: LPVStateSpace, plant: Driven, hull: Hull, rate: Rate, basis: Basis | None) -> Gain:
    """The lowest of the bounds by one P at the vertices, by P(p) between them at the rates, and on the box around."""
    started = time.perf_counter()
    box = hull.enclosing(rated(system.box, rate, None))
    points = hull.points
    a, b, c, d = system.at(points[:, [box.names.index(n) for n in system.basis.names]])
    levels = pole_margins(a, system.is_discrete)
    worst = int(levels.argmax())
    signals = plant.inputs, plant.outputs
    if levels[worst] >= 0:
        where = ", ".join(f"{n} = {v:.6g}" for n, v in zip(box.names, points[worst], strict=True))
        return Gain("unstable", math.inf, math.inf, None, None, *signals,
                    f"the model has a pole that does not decay at {where}",
                    "a smaller hull, or stabilise the model first", time.perf_counter() - started)
    norms = [h_infinity_norm(m, system.is_discrete) for m in zip(a, b, c, d, strict=True)]
    most = int(np.argmax([norm for norm, _ in norms]))
    frozen = WorstCase.frozen(box, points[most], norms[most][1], norms[most][0])
    affine = basis is None and plant.affine
    found = [hull_gain(system, hull)] if affine else []
    readings = box_of(plant.readings, box)
    corners = hull.over(readings.names).vertices() if readings.names else np.zeros((0, 0))
    size = plant.order + len(plant.inputs) + len(plant.outputs)
    if (readings.names and (not affine or any(r is not None for r in readings.rate))
            and len(corners) * 2 ** len(readings.names) * size**2 <= MOST_ENTRIES):
        own = None if basis is None else usable(basis, readings, system.is_discrete)
        moving = GainBounds(plant, readings, own, norms[most][0], corners)
        found += [_judged(plant, frozen, moving.certify(readings.rate), 0.0)]
    # the box around it, for what polytopes do not decide: P of a higher degree in discrete time, and no polynomials
    if not any(g.certificate is not None for g in found) or (system.is_discrete and basis is None):
        found.append(l2_gain(system, rate, basis, range=box.limits, trajectories=False))
    if system.is_discrete and affine and len(hull.vertices()) ** 2 * size**2 <= MOST_ENTRIES:
        found.append(hull_gain(system, hull, moving=True))
    best = min(found, key=lambda gain: (not gain.between_grid, gain.upper))
    if best.certificate is None:
        lost = _judged(plant, frozen, None, time.perf_counter() - started)
        return replace(lost, mend="a smaller hull, or rate bounds")
    return replace(best, lower=min(frozen.gain, best.upper), worst=frozen, seconds=time.perf_counter() - started)


def _judged(plant: Driven, worst: WorstCase, certificate: GainCertificate | None, seconds: float) -> Gain:
    if certificate is None:
        return Gain("not certified", math.inf, worst.gain, worst, None, plant.inputs, plant.outputs,
                    "no storage function was found that bounds the gain",
                    "give a rate bound, narrow the range, or look for a trajectory that grows with "
                    "lpvid.certify_stability", seconds)
    verdict = verdict_of(certificate.between_grid)
    return Gain(verdict, certificate.gamma, worst.gain, worst, certificate, plant.inputs, plant.outputs,
                seconds=seconds)


def requested(system: LPVStateSpace, rate: Rate, basis: Basis | None, range: Range) -> tuple[Driven, Scheduling]:
    """What an analysis is about: the linear part of a system, and the box of what it reads.

    Parameters
    ----------
    system : LPVStateSpace
        The model.
    rate, range
        As for `rated`.
    basis : Basis or None
        Of the storage function: what it reads is listed too.

    Returns
    -------
    (Driven, Scheduling)
        Both with one entry for each reading.
    """
    plant = driven(system, () if basis is None else tuple(n for n in basis.names if n in system.box.names))
    return plant, box_of(plant.readings, rated(system.box, rate, range))


def rated(box: Scheduling, rate: Rate, range: Range) -> Scheduling:
    """The requested box: rates left out are the box's own, an infinite one is no bound.

    Parameters
    ----------
    box : Scheduling
        The model's variables with their own range and rates.
    rate : float, sequence or mapping of name to float, or None
        Bound of |dp/dt| [units per second]; infinite for any motion.
    range : pair, pairs or mapping of name to pair, or None
        Lower and upper value; None keeps the box's own.

    Returns
    -------
    Scheduling
        The same variables in the same order.
    """
    def bounded_rate(value: float | None) -> float | None:
        return None if value is None or value == math.inf else value

    if isinstance(rate, Mapping):
        rate = {name: bounded_rate(value) for name, value in rate.items()}
    elif isinstance(rate, Sequence):
        rate = [bounded_rate(value) for value in rate]
    return requested_box(box, None if rate == math.inf else rate, range, keep=rate is None)

