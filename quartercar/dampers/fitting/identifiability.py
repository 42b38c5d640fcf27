"""Identifiability: which parameters the data determine, and which combinations they leave open."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from quartercar.dampers.families import LawDamper

OPEN = 0.5
"""relative standard error of a combination above which the data do not determine it."""
SINGULAR = 1e-7
"""share of the largest singular value below which a direction is open whatever the noise."""
NEGLIGIBLE = 0.05
"""share of the measured force that counts as a parameter's natural size where its value is near zero."""
NAMED = 0.3
"""share of a direction from which a parameter is named, up to three."""


@dataclass(frozen=True)
class Identifiability:
    """What the data determine of each direction in parameter space.

    Attributes
    ----------
    undetermined : tuple of str
        A sentence for each open direction.
    condition : float
        Largest over smallest singular value of the scaled sensitivities.
    """

    undetermined: tuple[str, ...]
    condition: float


def identifiability(damper: LawDamper, theta: np.ndarray, jacobian: np.ndarray, measured: np.ndarray,
                    covariance: np.ndarray, free: np.ndarray) -> Identifiability:
    """Singular directions of the sensitivities to relative changes of the free parameters.

    A direction v of relative changes is open where √(vᵀ D⁻¹ C D⁻¹ v) > ½ with C the covariance and D the natural sizes,
    or where the sensitivities are singular to seven digits, so that no noise is needed to lose it.

    Parameters
    ----------
    damper : LawDamper
    theta : (P,) array
    jacobian : (m, P) array
        At the optimum.
    measured : (m,) array
    covariance : (P, P) array
    free : (P,) bool array
    """
    names = [n for n, f in zip(damper.names, free, strict=True) if f]
    if not names:
        return Identifiability((), 1.0)
    sizes = natural_sizes(damper, theta, jacobian, measured)[free]
    norms = np.linalg.norm(jacobian[:, free], axis=0) * sizes
    lost = ~(norms > SINGULAR * norms.max()) if norms.max() > 0 else np.ones(len(names), dtype=bool)
    out = [f"{n}: has no effect on these data" for n, gone in zip(names, lost, strict=True) if gone]
    kept = np.flatnonzero(~lost)
    if not kept.size:
        return Identifiability(tuple(out), float("inf"))
    scaled = np.linalg.qr(jacobian[:, free][:, kept] * sizes[kept], mode="r")
    _, s, vt = np.linalg.svd(scaled / np.linalg.norm(scaled, axis=0).max(), full_matrices=False)
    relative = covariance[np.ix_(free, free)][np.ix_(kept, kept)] / np.outer(sizes[kept], sizes[kept])
    for k in range(s.size):
        error = float(np.sqrt(max(vt[k] @ relative @ vt[k], 0.0)))
        if error > OPEN or s[k] < SINGULAR * s[0]:
            out.append(_sentence([names[i] for i in kept], vt[k], error, s[k] < SINGULAR * s[0]))
    condition = float(s[0] / s[-1]) if s[-1] > 0 else float("inf")
    return Identifiability(tuple(out), float("inf") if lost.any() else condition)


def natural_sizes(damper: LawDamper, theta: np.ndarray, jacobian: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """(P,) what a change of 100 % is: the value, or where that is near zero, what moves the force by a twentieth."""
    effect = np.linalg.norm(jacobian, axis=0)
    small = np.where(effect > 0, NEGLIGIBLE * np.linalg.norm(measured) / np.where(effect > 0, effect, 1.0), 0.0)
    log = np.array([p.log for p in damper.parameters])
    default = np.array([abs(p.default) for p in damper.parameters])
    sizes = np.where(log, np.abs(theta), np.maximum(np.abs(theta), small))
    return np.where(sizes > 0, sizes, np.where(default > 0, default, 1.0))


def _sentence(names: list[str], direction: np.ndarray, error: float, singular: bool) -> str:
    order = np.argsort(-np.abs(direction))
    leading = [int(i) for i in order[:3] if abs(direction[i]) >= NAMED * abs(direction[order[0]])]
    known = "no bound to it" if singular else f"uncertain by {100 * error:.0f} %" if error < 100 else "without limit"
    if len(leading) == 1:
        return f"{names[leading[0]]}: not determined by these data ({known})"
    sign = np.sign(direction[leading[0]])
    moves = ", ".join(f"{names[i]} {100 * sign * direction[i] / abs(direction[leading[0]]):+.0f} %" for i in leading)
    return f"{' and '.join(names[i] for i in leading)}: not determined apart; moving {moves} together is {known}"
