"""Certificates of loops whose controller reads how fast the scheduling moves: p and ṗ are tied to each other."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from lpvid.codec import ADDED
from lpvid.lmi.box_positivity import everywhere
from lpvid.lmi.certificate import GRID, Recheck, grid
from lpvid.lmi.certificate_common import StorageCertificate
from lpvid.lmi.coordinates import Coordinates, over_states
from lpvid.lmi.driven import Driven, driven
from lpvid.lmi.gain_certificate import BoundedReal, certify_gain
from lpvid.lmi.inequality import budget_for, positive_everywhere, root_of
from lpvid.lmi.storage import Storage
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Polynomial, Scheduling

RATE = "_rate"
"""What a scheduling variable's name gets appended for the variable that holds its derivative."""

CORNER = 2
"""Seconds, about, for a corner of the rates: those of Wu et al. 1996 take 8400 matrices of 25 rows, 0.7 s each."""


@dataclass(frozen=True, eq=False, repr=False)
class RatedGainCertificate(StorageCertificate):
    """A storage function ξᵀP(p)ξ, x = Tξ, that bounds the gain of a loop with scheduling p and ṗ, both read by it.

    To a `GainCertificate` the variables ``p_rate`` would be free of p: it needs He(PA(p, v)) + Ṗ(p, ṗ) at every v
    and ṗ. Here v = ṗ. With A affine in v the inequality is affine in ṗ, so that corners of the rates suffice at each p.
    At each corner it is a polynomial, or a wave, of p alone, which is decided on the whole box where the budget allows;
    else it is looked at on a grid of p.

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
        As in `GainCertificate`; of one that is shown on a grid, after the congruence that makes P(p) the identity at
        each point.
    between_grid : bool
        Proven on the whole box.
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
        if not found.holds:
            return None
        whole = made._on_box(loop, system)
        return replace(made, margin=whole.margin if whole.holds else found.margin, between_grid=whole.holds)

    @classmethod
    def within(cls, loop: LPVStateSpace, matrices: np.ndarray, basis: Basis, gammas: Iterable[float],
               states: np.ndarray | None = None) -> RatedGainCertificate | None:
        """The one of the least of several gains that is proven on the whole box; else the least that holds on a grid.

        Parameters
        ----------
        loop, matrices, basis, states
            As in `of`.
        gammas : iterable of float
            Rising.

        Returns
        -------
        RatedGainCertificate or None
        """
        first: RatedGainCertificate | None = None
        for gamma in gammas:
            if first is None:
                first = made = cls.of(loop, matrices, basis, gamma, states)
            else:  # what holds on the grid holds there for any larger gain
                made = replace(first, gamma=gamma, between_grid=True)
                whole = made._on_box(loop, driven(loop))
                made = replace(made, margin=whole.margin) if whole.holds else None
            if made is not None and made.between_grid:
                return made
        return first

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
        """The claim in words."""
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
        if not 0 < self.gamma < math.inf:
            return f"a gain of {self.gamma:g} is no bound"
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
        return self._on_box(model, subject) if self.between_grid else self._looked_at(model)

    def _on_box(self, model: LPVStateSpace, subject: Driven) -> Recheck:
        """The bounded-real inequality at every corner of the rates, at every p of the box."""
        readings = subject.readings
        names = tuple(r.label for r in readings)
        limits = dict(zip(self.box.names, zip(self.box.lower, self.box.upper, strict=True), strict=True))
        rates = [i for i, n in enumerate(names) if n.endswith(RATE)]
        fault = self._tied(model)
        if not fault and (any(limits[names[i]][0] != -limits[names[i]][1] for i in rates)
                          or not set(self.basis.names) <= set(names)):
            fault = "the rates that the model reads are not symmetric, or it reads none"
        if not fault and not {n + RATE for n in self.basis.names} <= set(names):
            fault = "P depends on a variable whose rate the model does not read"
        system = over_states(subject, self.states)
        if fault or system is None:
            return Recheck(False, False, math.nan, fault or "the states of the certificate are singular, or nearly")
        speeds = tuple(limits[n + RATE][1] if n + RATE in limits else None for n in names)
        box = Scheduling(names, tuple(limits[n][0] for n in names), tuple(limits[n][1] for n in names), speeds)
        storage = Storage(self.matrices, self.basis, box, None)
        problem, root = BoundedReal(system, storage, self.gamma), root_of(storage)
        if root is None:
            return Recheck(False, False, -math.inf, "P is not positive definite at the centre of the box")
        scale = problem.congruence(root)
        own, budget = [i for i in range(len(names)) if i not in rates], CORNER * budget_for(len(scale))
        positive = positive_everywhere(storage, root, budget)
        axes = [storage.axes(readings, problem.power)[0][i] for i in own]
        ceiling = problem.ceiling(scale) if any(a.frequency for a in axes) else math.inf
        margin, corners = math.inf, list(itertools.product((-1.0, 1.0), repeat=len(rates)))
        for signs in corners if positive.holds else ():
            move, still = np.full((1, len(names)), 0.5), np.zeros(len(names))
            for i, sign in zip(rates, signs, strict=True):
                still[i], of = sign * limits[names[i]][1], names[i].removesuffix(RATE)
                move[0, names.index(of) if of in names else i] = 0.5 * (1 + sign)

            def value(p: np.ndarray, _: np.ndarray, move: np.ndarray = move, still: np.ndarray = still
                      ) -> tuple[np.ndarray, float]:
                whole = np.repeat(still[None, :], len(p), axis=0)
                whole[:, own] = p
                return problem.evaluate(whole, move, scale)

            proof = everywhere(value, axes, [], budget=budget, ceiling=ceiling)
            if not proof.holds:
                return Recheck(False, False, proof.bound, "not shown between the points of a grid")
            margin = min(margin, proof.bound)
        if not positive.holds:
            return Recheck(False, False, positive.bound, "P(p) is not shown to be positive definite on the box")
        return Recheck(True, True, margin, "proven on the whole box by Bernstein coefficients")

    def _tied(self, model: LPVStateSpace) -> str:
        """Why corners of the rates would not be enough; empty where they are."""
        if not _affine_in_rates(model):
            return "the model is not affine in the rates"
        if any(n + RATE not in self.box.names for n in self.basis.names):
            return "P depends on a variable whose rate the model does not read"
        return ""

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
        fault = self._tied(model)
        if fault:
            return Recheck(False, False, math.nan, fault)
        own = [i for i in range(len(names)) if i not in rates]
        still = self.box.part([names[i] for i in own])
        points = grid(still, GRID.get(len(own), 3))
        columns = [still.names.index(n) for n in self.basis.names]
        p = np.tensordot(self.basis.evaluate(points[:, columns]), self.matrices, axes=1)
        slopes = {n: np.tensordot(self.basis.derivative(points[:, columns], n), self.matrices, axes=1)
                  for n in self.basis.names}
        margin = math.inf
        for corner in itertools.product(*((self.box.lower[i], self.box.upper[i]) for i in rates)):
            whole = np.zeros((len(points), len(names)))
            whole[:, own], whole[:, rates] = points, corner
            a, b, c, d = model.at(whole)
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
    read = [r for r in model.basis.readings() if r.name.endswith(RATE)]
    if not any(r.degree > 1 or r.frequency for r in read):
        return True
    if not isinstance(model.basis, Polynomial):
        return False
    columns = [model.basis.names.index(r.name) for r in read]
    high = model.basis.exponents[:, columns].max(axis=1) > 1
    return not any(m[high].any() for m in (model.A, model.B, model.C, model.D))
