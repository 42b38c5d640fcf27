"""HullCertificate: one P that bounds a gain at every vertex of a polytope, and so on the polytope."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lpvid.errors import InputError
from lpvid.lmi.certificate import Recheck
from lpvid.lmi.certificate_common import Certificate
from lpvid.lmi.driven import Driven, driven
from lpvid.lmi.gain_certificate import certify_gain
from lpvid.model.state_space import LPVStateSpace


@dataclass(frozen=True, eq=False, repr=False)
class HullCertificate(Certificate):
    """One P that bounds a gain for every trajectory, however fast, in a polytope of the scheduling.

    Parameters
    ----------
    gamma : float
    matrix : (n, n) array
        P.
    names : tuple of str
    vertices : (V, len(names)) array
    sample_time : float or None
    model_hash : str
    inputs, outputs : tuple of str
    margin : float
    solver : str
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

    SCHEMA = "lpvid/hull-certificate/1"
    NOUN = "a hull certificate"
    kind = "quadratic"
    between_grid = True

    @property
    def claim(self) -> str:
        """What the certificate states, in words."""
        return (f"gain from {', '.join(self.inputs)} to {', '.join(self.outputs)} at most {self.gamma:.6g} for every "
                f"trajectory of {', '.join(self.names)} in a polytope of {len(self.vertices)} vertices, however fast")

    def subject(self, model: LPVStateSpace) -> Driven:
        return affine_driven(model, self.names)

    def fault(self, model: LPVStateSpace, subject: Driven) -> str:
        fault = super().fault(model, subject)
        if not fault and (self.inputs, self.outputs) != (subject.inputs, subject.outputs):
            fault = "the certificate names other signals than the model has"
        if not fault and not np.array_equal(self.matrix, self.matrix.T):
            fault = "the certificate's matrix is not symmetric"
        return fault

    def recheck(self, model: LPVStateSpace, subject: Driven) -> Recheck:
        return recheck_at(subject, self.names, self.vertices, self.matrix, self.gamma)

    @classmethod
    def array_shapes(cls, values: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
        n = len(values["matrix"])
        return {"matrix": (n, n), "vertices": (-1, len(values["names"]))}


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


def recheck_at(system: Driven, names: tuple[str, ...], vertices: np.ndarray, p: np.ndarray, gamma: float) -> Recheck:
    """Whether P bounds the gain at every vertex, by numpy.

    Parameters
    ----------
    system : Driven
    names : tuple of str
        Variables of the hull.
    vertices : (V, len(names)) array
    p : (n, n) array
        P.
    gamma : float

    Returns
    -------
    Recheck
        With the margin of the worst vertex.
    """
    points = scheduling_points(system, names, vertices)
    everywhere = np.broadcast_to(p, (len(points), *p.shape))
    later = everywhere[:, None] if system.sample_time is not None else None
    found = certify_gain(system.matrices(points), everywhere, gamma, later=later)
    why = "proven on the polytope by its vertices" if found.holds else found.why
    return Recheck(found.holds, found.holds, found.margin, why)
