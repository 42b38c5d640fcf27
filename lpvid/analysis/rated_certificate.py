"""Certificates of loops whose controller reads how fast the scheduling moves: p and ṗ are tied to each other."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from lpvid.codec import ADDED
from lpvid.lmi.certificate import GRID, Recheck, grid
from lpvid.lmi.certificate_common import StorageCertificate
from lpvid.lmi.coordinates import Coordinates
from lpvid.lmi.driven import Driven, driven
from lpvid.lmi.gain_certificate import certify_gain
from lpvid.lmi.readings import readings_of
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Polynomial, Scheduling

RATE = "_rate"
"""What a scheduling variable's name gets appended for the variable that holds its derivative."""


@dataclass(frozen=True, eq=False)
class RatedGainCertificate(StorageCertificate):
    """A storage function ξᵀP(p)ξ, x = Tξ, that bounds the gain of a loop with scheduling p and ṗ, both read by it.

    To a `GainCertificate` the variables ``p_rate`` would be free of p: it needs He(PA(p, v)) + Ṗ(p, ṗ) at every v
    and ṗ. Here v = ṗ. With A affine in v the inequality is affine in ṗ, so that corners of the rates suffice at each p;
    it is looked at on a grid of p.

    T is for the digits. Where a plant's states and its controller's all but cancel in V, the products PA over the
    loop's own states cancel too, and their rounding errors can exceed the margin: for Wu et al. 1996 with X and Y
    moving they are 4e-7 at a margin of 1e-7, over the states in which V falls into two blocks 4e-10.

    Parameters
    ----------
    gamma : float
        Bound of ‖z‖/‖w‖ in L2.
    matrices : (K, n, n) array
        P(p) = Σ_k matrices[k] ψ_k(p).
    basis : Basis
        ψ, over variables that are no rates.
    box : Scheduling
        Of the loop; the range of ``p_rate`` is the bound of the rate of p.
    model_hash : str
    inputs, outputs : tuple of str
    margin : float
        As in `GainCertificate`.
    states : (n, n) array, optional
        T; left out, the identity.
    """

    gamma: float
    matrices: np.ndarray
    basis: Basis
    box: Scheduling
    model_hash: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    margin: float
    between_grid: bool = False
    states: np.ndarray | None = field(default=None, metadata=ADDED)

    SCHEMA = "lpvid/rated-gain-certificate/1"
    NOUN = "a certificate of a loop that reads rates,"
    JSON = (("schema", "SCHEMA"), "kind", "claim", ...)
    FUNCTION = ""
    kind = "rated"
    sample_time = None

    @classmethod
    def of(cls, loop: LPVStateSpace, matrices: np.ndarray, basis: Basis, gamma: float,
           states: np.ndarray | None = None) -> RatedGainCertificate | None:
        """The certificate of a loop with a storage function, where numpy agrees.

        Parameters
        ----------
        loop : LPVStateSpace
            Continuous, over p and ``p_rate``.
        matrices : (K, n, n) array
        basis : Basis
            Bound to the box.
        gamma : float
        states : (n, n) array, optional
            T of x = Tξ, over whose ξ the matrices are.

        Returns
        -------
        RatedGainCertificate or None
        """
        system = driven(loop)
        made = cls(gamma, matrices, basis, loop.box, system.digest, system.inputs, system.outputs, -math.inf,
                   states=states)
        found = made._looked_at(loop)
        return replace(made, margin=found.margin) if found.holds else None

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON.

        Returns
        -------
        dict
            Without T where there is none: a file of before is written again as it was.
        """
        plain = super().to_dict()
        return plain if self.states is not None else {k: v for k, v in plain.items() if k != "states"}

    @property
    def claim(self) -> str:
        """What the certificate says, in words."""
        own = [n for n in self.box.names if not n.endswith(RATE)]
        where = ", ".join(f"{n} in [{self.box.lower[i]:.6g}, {self.box.upper[i]:.6g}]"
                          for i, n in enumerate(self.box.names) if n in own)
        speeds = ", ".join(f"|d {n.removesuffix(RATE)}/dt| <= {self.box.upper[i]:.6g}"
                           for i, n in enumerate(self.box.names) if n not in own)
        return (f"gain from {self.signals} at most {self.gamma:.6g} for every trajectory of {where} with {speeds}, "
                f"which the loop reads{self.where}")

    @property
    def proven_kind(self) -> str:
        return self.kind

    def subject(self, model: LPVStateSpace) -> Driven:
        return driven(model)

    def fault(self, model: LPVStateSpace, subject: Driven) -> str:
        if self.model_hash != subject.digest or model.is_discrete:
            return "the certificate was made for another model"
        if self.inputs != subject.inputs or self.outputs != subject.outputs or self.box.names != model.box.names:
            return "the certificate names other signals or variables than the model"
        if self.matrices.shape != (self.basis.size, subject.order, subject.order):
            return "matrices and basis of the certificate do not fit the model"
        if self.states is not None and self.states.shape != (subject.order, subject.order):
            return "the states of the certificate do not fit the model"
        return ""

    def recheck(self, model: LPVStateSpace, subject: Driven) -> Recheck:
        return self._looked_at(model)

    def _looked_at(self, model: LPVStateSpace) -> Recheck:
        """The bounded-real inequality at every corner of the rates, on a grid of p.

        He(PA) + Ṗ = He(P(A + ½P⁻¹Ṗ)): the drift is written as part of A.
        """
        over = Coordinates.of(self.states, self.matrices.shape[-1])
        if over is None:
            return Recheck(False, False, math.nan, "the states of the certificate are singular, or nearly")
        names = self.box.names
        rates = [i for i, n in enumerate(names) if n.endswith(RATE)]
        moving = [names.index(names[i].removesuffix(RATE)) for i in rates]
        if not _affine_in_rates(model):
            return Recheck(False, False, math.nan, "the model is not affine in the rates")
        if set(self.basis.names) - {names[i] for i in moving}:
            return Recheck(False, False, math.nan, "P depends on a variable whose rate the model does not read")
        own = [i for i in range(len(names)) if i not in rates]
        still = Scheduling(*(tuple(getattr(self.box, f)[i] for i in own)
                             for f in ("names", "lower", "upper", "rate", "units")))
        points = grid(still, GRID.get(len(own), 3))
        columns = [still.names.index(n) for n in self.basis.names]
        p = np.tensordot(self.basis.evaluate(points[:, columns]), self.matrices, axes=1)
        slopes = {n: np.tensordot(self.basis.derivative(points[:, columns], n), self.matrices, axes=1)
                  for n in self.basis.names}
        margin = math.inf
        for corner in itertools.product(*((self.box.lower[i], self.box.upper[i]) for i in rates)):
            whole = np.zeros((len(points), len(names)))
            whole[:, own], whole[:, rates] = points, corner
            phi = model.basis.evaluate(whole[:, [names.index(n) for n in model.basis.names]])
            a, b, c, d = (np.tensordot(phi, m, axes=1) for m in (model.A, model.B, model.C, model.D))
            drift = sum((speed * slopes[names[i]] for i, speed in zip(moving, corner, strict=True)
                         if names[i] in slopes), start=np.zeros_like(p))
            try:
                drift = 0.5 * np.linalg.solve(p, drift)
            except np.linalg.LinAlgError:
                return Recheck(False, False, -math.inf, "P is singular at a point")
            sizes = over.magnitudes(a, b, c)
            a, b, c = over.back @ a @ over.into + drift, over.back @ b, c @ over.into
            found = certify_gain((a, b, c, d), p, self.gamma, magnitudes=(sizes[0] + np.abs(drift), *sizes[1:], d))
            if not found.holds:
                return found
            margin = min(margin, found.margin)
        return Recheck(True, False, margin, f"shown on a grid of {len(points)} points only, not between them")


def _affine_in_rates(model: LPVStateSpace) -> bool:
    """Along each rate; a polynomial over p and the rates lists every term of its degree, so by its coefficients."""
    read = [r for r in readings_of(model.basis) if r.name.endswith(RATE)]
    if not any(r.degree > 1 or r.frequency for r in read):
        return True
    if not isinstance(model.basis, Polynomial):
        return False
    columns = [model.basis.names.index(r.name) for r in read]
    high = model.basis.exponents[:, columns].max(axis=1) > 1
    return not any(m[high].any() for m in (model.A, model.B, model.C, model.D))
