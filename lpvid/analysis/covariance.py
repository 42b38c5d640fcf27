"""Rms under white noise and peak under a disturbance of unit energy, by a matrix above the covariance of the states."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from lpvid.analysis.bound import scaled_outputs
from lpvid.analysis.certificates import Range, Rate
from lpvid.analysis.gain import requested
from lpvid.analysis.gain_bounds import storage_bases, worst_pole
from lpvid.lmi.bound_certificate import has_h2_norm
from lpvid.lmi.bounds import CovarianceBound
from lpvid.lmi.certificate import grid
from lpvid.lmi.driven import Driven
from lpvid.lmi.frame import frame_of, gramian
from lpvid.lmi.inequality import recheck_inequality
from lpvid.lmi.storage import Storage
from lpvid.lmi.storage_search import StorageSearch
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Polynomial, Scheduling

RAISED = (1e-6, 1e-4, 1e-3, 5e-3, 2e-2)
"""shares above the solver's level at which its matrix is checked: what one on the edge of its inequalities, known to a
solver's accuracy, needs in systems of four to twelve states"""


@dataclass(frozen=True, eq=False)
class OutputBound:
    """Bounds of the rms under white noise, or of the peak for unit energy, of an LPV system's outputs.

    Parameters
    ----------
    peak : bool
        Peak of the Euclidean length of the outputs; otherwise their rms together.
    lower, upper : float
        Reached with the scheduling held; shown by the matrix, infinite where none was found.
    between_grid : bool
        Shown on the whole box.
    storage : Storage or None
        Q(p), above the covariance of the states.
    """

    peak: bool
    lower: float
    upper: float
    between_grid: bool
    storage: Storage | None

    def __repr__(self) -> str:
        what = "peak for unit energy" if self.peak else "rms under white noise"
        if self.storage is None:
            return f"not bounded: no matrix above the covariance was found; {what} at least {self.lower:.6g}"
        where = "on the whole box" if self.between_grid else "at the points of a grid only"
        return f"{what} at most {self.upper:.6g}, at least {self.lower:.6g}, re-checked with numpy {where}"


def peak_gain(system: LPVStateSpace, rate: Rate = None, basis: Basis | None = None, *, range: Range = None
              ) -> OutputBound:
    """Bounds of the largest |z(t)| that a disturbance of unit energy, ‖w‖₂ ≤ 1, can cause: the generalised H2 norm.

    Parameters
    ----------
    system : LPVStateSpace
        Stable for every fixed scheduling; in continuous time without feedthrough.
    rate, basis, range
        As for `lpvid.l2_gain`; a matrix without basis is constant, and of degree one where that has a lower bound.

    Returns
    -------
    OutputBound

    References
    ----------
    Rotea, M. A. (1993). The generalized H2 control problem. Automatica 29, 373-385.

    Examples
    --------
    >>> lag = LPVStateSpace([[[-2.0]]], [[[1.0]]], [[[1.0]]], [[[0.0]]], Polynomial((), 0), None)
    >>> found = peak_gain(lag)                                   # 1/(s + 2): ½, by w = 2e^(2t) before the peak
    >>> round(found.lower, 4), round(found.upper, 4), found.between_grid
    (0.5, 0.5, True)
    """
    return output_bound(system, True, rate, basis, range)


def output_bound(system: LPVStateSpace, peak: bool, rate: Rate = None, basis: Basis | None = None,
                 range: Range = None) -> OutputBound:
    """Of the peak for unit energy, or of the rms under white noise at every instant.

    Parameters
    ----------
    system : LPVStateSpace
    peak : bool
    rate, basis, range
        As for `peak_gain`.

    Returns
    -------
    OutputBound
    """
    plant, box = requested(system, rate, basis, range)
    if not has_h2_norm(plant) or worst_pole(plant, box)[0] >= 0:
        return OutputBound(peak, math.inf, math.inf, False, None)
    lower = _reached(plant, box, peak)
    if not plant.order or not box.half_width.any():
        return _still(plant, box, peak, lower)
    best = OutputBound(peak, lower, math.inf, False, None)
    for own in storage_bases(plant, box, basis, highest=1):
        found = _searched(plant, box, own, peak, lower)
        if found is not None and (best.storage is None
                                  or (found.between_grid, -found.upper) > (best.between_grid, -best.upper)):
            best = found
    return best


def proven(storage: Storage, plant: Driven, peak: bool, level: float) -> OutputBound | None:
    """The least of some levels above a given one that a given Q(p) shows; None where it shows none.

    Parameters
    ----------
    storage : Storage
        Q(p).
    plant : Driven
    peak : bool
    level : float

    Returns
    -------
    OutputBound or None
    """
    best: OutputBound | None = None
    for share in RAISED:
        raised = level * (1 + share)
        checked = recheck_inequality(CovarianceBound(plant, storage, raised, peak))
        if checked.holds and (best is None or checked.between_grid > best.between_grid):
            best = OutputBound(peak, 0.0, raised, checked.between_grid, storage)
        if checked.holds and checked.between_grid:
            break
    return best


def _searched(plant: Driven, box: Scheduling, basis: Basis, peak: bool, lower: float) -> OutputBound | None:
    """A Q(p) of least level, scaled by that share of the noise that makes it strict."""
    typical = lower or 1.0
    frame = replace(frame_of(scaled_outputs(plant, 1 / typical), grid(box, {0: 1, 1: 9, 2: 4}.get(len(box.names), 2))),
                    gain=1.0)
    unit = scaled_outputs(plant, 1 / (typical * math.sqrt(frame.time)))  # ν is about one in the frame's unit of time
    search = StorageSearch(unit, box, basis, frame,
                           lambda square: partial(CovarianceBound, level=math.sqrt(square), peak=peak))
    if not search.affordable:
        return None
    into = frame.states @ frame.states.T / frame.time  # Q = T Q̃ Tᵀ/τ of what comes back as τ T⁻ᵀ Q̃ T⁻¹
    for found_inside in search.least():
        if not found_inside.level > 0:
            continue
        matrices, level = into @ found_inside.matrices @ into.T, math.sqrt(found_inside.level)
        for share in RAISED:  # Q is homogeneous in the intensity of the noise: more of it leaves room everywhere
            storage = Storage(matrices * (1 + share), basis, box, plant.sample_time)
            found = proven(storage, plant, peak, level * typical * (1 + share))
            if found is not None:
                return replace(found, lower=lower)
    return None


def _still(plant: Driven, box: Scheduling, peak: bool, lower: float) -> OutputBound:
    """Of a system that does not vary: the covariance itself, a little noise added."""
    a, b, _, _ = (m[0] for m in plant.matrices(np.array(box.lower).reshape(1, -1)))
    for share in RAISED:
        size = float(np.linalg.norm(b @ b.T)) if len(a) else 0.0
        q = gramian(a, b @ b.T + share * size * np.eye(len(a)), plant.sample_time is not None)
        storage = Storage(q[None], Polynomial((), 0), box, plant.sample_time)
        found = proven(storage, plant, peak, max(lower, 1e-300) * (1 + share))
        if found is not None:
            return replace(found, lower=lower)
    return OutputBound(peak, lower, math.inf, False, None)


def _reached(plant: Driven, box: Scheduling, peak: bool) -> float:
    best, discrete = 0.0, plant.sample_time is not None
    for a, b, c, d in zip(*plant.matrices(grid(box, {0: 1, 1: 81, 2: 13, 3: 6}.get(len(box.names), 3))), strict=True):
        seen = c @ gramian(a, b @ b.T, discrete) @ c.T + (d @ d.T if discrete else 0.0)
        best = max(best, float(np.linalg.eigvalsh(seen)[-1]) if peak else float(np.trace(seen)))
    return math.sqrt(best)
