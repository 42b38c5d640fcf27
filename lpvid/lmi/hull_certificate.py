"""HullCertificate: a P that bounds a gain at every vertex of a polytope, and so on the polytope."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lpvid.codec import UNWRITTEN
from lpvid.errors import InputError
from lpvid.lmi.certificate import Recheck
from lpvid.lmi.certificate_common import Certificate, within
from lpvid.lmi.driven import Driven, driven
from lpvid.lmi.gain_certificate import certify_gain
from lpvid.model.state_space import LPVStateSpace


@dataclass(frozen=True, eq=False, repr=False)
class HullCertificate(Certificate):
    """A P that bounds a gain for every trajectory, however fast, in a polytope of the scheduling.

    One matrix; in discrete time also P(p) affine in p (Daafouz & Bernussou 2001). The inequality for a step from p to
    p⁺ is then linear in P(p) and P(p⁺), and concave in the system's matrices: with p = Σλ_k v_k and p⁺ = Σμ_l v_l it is
    at least Σ λ_k μ_l times those of the pairs of vertices, which are positive.

    Parameters
    ----------
    gamma : float
    matrix : (n, n) array
        P, or P(0).
    names : tuple of str
    vertices : (V, len(names)) array
    sample_time : float or None
    model_hash : str
    inputs, outputs : tuple of str
    margin : float
    solver : str
    slopes : (len(names), n, n) array, optional
        ∂P/∂p_i of a P that follows the scheduling, in discrete time.
    """

    gamma: float
    matrix: np.ndarray
    names: tuple[str, ...]
    vertices: np.ndarray
    sample_time: float | None
    model_hash: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    margin: float
    solver: str = ""
    slopes: np.ndarray | None = field(default=None, metadata=UNWRITTEN)

    SCHEMA = "lpvid/hull-certificate/1"
    NOUN = "a hull certificate"
    between_grid = True

    @property
    def kind(self) -> str:  # type: ignore[override]
        """"quadratic" for one P, "poly-quadratic" for one that follows the scheduling."""
        return "quadratic" if self.slopes is None else "poly-quadratic"

    @property
    def claim(self) -> str:
        """What the certificate states, in words."""
        return (f"gain from {', '.join(self.inputs)} to {', '.join(self.outputs)} at most {self.gamma:.6g} for every "
                f"trajectory of {within(self.names, self.vertices)}, however fast")

    def subject(self, model: LPVStateSpace) -> Driven:
        return affine_driven(model, self.names)

    def fault(self, model: LPVStateSpace, subject: Driven) -> str:
        fault = super().fault(model, subject)
        if not fault and (self.inputs, self.outputs) != (subject.inputs, subject.outputs):
            fault = "the certificate names other signals than the model has"
        if not fault and not np.array_equal(self.matrix, self.matrix.T):
            fault = "the certificate's matrix is not symmetric"
        if not fault and (not len(self.vertices) or not np.isfinite(self.vertices).all()):
            fault = "the certificate's polytope has no vertices, or one that is not finite"
        if not fault and self.slopes is not None:
            if self.sample_time is None:
                fault = "in continuous time vertices do not decide about a matrix that moves"
            elif self.slopes.shape != (len(self.names), *self.matrix.shape):
                fault = "the certificate's slopes are of another size than its matrix"
            elif not np.array_equal(self.slopes, self.slopes.swapaxes(1, 2)):
                fault = "the certificate's slopes are not symmetric"
        return fault

    def recheck(self, model: LPVStateSpace, subject: Driven) -> Recheck:
        return recheck_at(subject, self.names, self.vertices, self.matrix, self.gamma, self.slopes)

    @classmethod
    def array_shapes(cls, values: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
        n = len(values["matrix"])
        return {"matrix": (n, n), "vertices": (-1, len(values["names"]))} | (
            {"slopes": (-1, n, n)} if values.get("slopes") is not None else {})


def affine_driven(system: LPVStateSpace, names: tuple[str, ...]) -> Driven:
    """The linear part of a system that is affine in its scheduling, with a hull of all that it reads.

    Parameters
    ----------
    system : LPVStateSpace
    names : tuple of str
        Variables of the hull.

    Returns
    -------
    Driven

    Raises
    ------
    InputError
        A function of higher degree, a variable that the hull lacks.
    """
    basis, found = system.basis, driven(system)
    if not found.affine:
        raise InputError("a hull needs a system that is affine in its scheduling variables",
                         got=", ".join(basis.labels), mend="name products as further variables, or use l2_gain on the "
                         "box")
    if {r.label for r in found.readings} - set(names):
        raise InputError("the hull lacks a scheduling variable of the system", got=", ".join(names),
                         why=f"it reads {', '.join(r.label for r in found.readings)}",
                         mend="a hull of samples of all of them")
    return found


def scheduling_points(system: Driven, names: tuple[str, ...], vertices: np.ndarray) -> np.ndarray:
    """The vertices over what the system reads.

    Parameters
    ----------
    system : Driven
    names : tuple of str
        Variables of the hull.
    vertices : (V, len(names)) array

    Returns
    -------
    (·, readings) array
        Each once.
    """
    return np.unique(vertices[:, [names.index(r.label) for r in system.readings]], axis=0)


def recheck_at(system: Driven, names: tuple[str, ...], vertices: np.ndarray, p: np.ndarray, gamma: float,
               slopes: np.ndarray | None = None) -> Recheck:
    """Whether P bounds the gain at every vertex, by numpy; one that moves, for the steps between all of them.

    Parameters
    ----------
    system : Driven
    names : tuple of str
        Variables of the hull.
    vertices : (V, len(names)) array
    p : (n, n) array
        P, or P(0).
    gamma : float
    slopes : (len(names), n, n) array, optional
        ∂P/∂p_i, in discrete time.

    Returns
    -------
    Recheck
        With the margin of the worst vertex.
    """
    if slopes is not None:
        at = p + np.tensordot(vertices, slopes, axes=1)
        ahead = np.broadcast_to(at, (len(at), *at.shape))
        matrices = system.matrices(vertices[:, [names.index(r.label) for r in system.readings]])
        found = certify_gain(matrices, at, gamma, later=ahead)
        why = "proven on the polytope by the steps between its vertices" if found.holds else found.why
        return Recheck(found.holds, found.holds, found.margin, why)
    points = scheduling_points(system, names, vertices)
    everywhere = np.broadcast_to(p, (len(points), *p.shape))
    later = everywhere[:, None] if system.sample_time is not None else None
    found = certify_gain(system.matrices(points), everywhere, gamma, later=later)
    why = "proven on the polytope by its vertices" if found.holds else found.why
    return Recheck(found.holds, found.holds, found.margin, why)
