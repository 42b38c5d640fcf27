"""Certificates of an induced L2 gain, re-checked with numpy alone: no solver, and no trust in one.

The claim ‖z‖ ≤ γ‖w‖ from zero state is, for every p in the box and every admissible motion,

    P(p) ≻ 0    [ −AᵀP − PA − Ṗ   −PB    Cᵀ ]                  [ P − AᵀP⁺A   −AᵀP⁺B      Cᵀ ]
                [ ⋆               γI     Dᵀ ] ≻ 0     or       [ ⋆           γI − BᵀP⁺B  Dᵀ ] ≻ 0
                [ ⋆               ⋆      γI ]                  [ ⋆           ⋆           γI ]

in continuous and in discrete time, with Ṗ = Σ ṗ_i ∂P/∂p_i and P⁺ = P(p(k+1)) (bounded-real lemma; equations sheet,
section 5.3). It includes exponential stability.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from lpvid.codec import ADDED, UNWRITTEN
from lpvid.errors import InputError
from lpvid.lmi.certificate import EPS, Recheck, diagonal
from lpvid.lmi.certificate_common import StorageCertificate, certificate_kind, describe_set, vertices_fault
from lpvid.lmi.coordinates import over_states
from lpvid.lmi.driven import Driven
from lpvid.lmi.inequality import LyapunovInequality, Pieces, recheck_inequality
from lpvid.lmi.polytope_positivity import recheck_polytope
from lpvid.lmi.storage import Storage
from lpvid.model.state_space import LPVStateSpace, Matrices
from lpvid.scheduling import Basis, Scheduling


@dataclass(frozen=True, eq=False)
class BoundedReal(LyapunovInequality):
    """The bounded-real inequality of a system with a storage function and a gain γ > 0.

    Parameters
    ----------
    system : Driven
        w → z.
    storage : Storage
        xᵀP(p)x.
    gamma : float
        γ, in the unit of the outputs over that of the inputs.
    backward : bool
        In discrete time P⁺ and P change places: what the dual system needs of a P that moves.
    """

    system: Driven
    storage: Storage
    gamma: float
    backward: bool = False

    @property
    def power(self) -> int:  # type: ignore[override]
        """Degree in the system's matrices."""
        return 1 if self.system.sample_time is None else 2

    def matrix(self, pieces: Pieces) -> np.ndarray:
        discrete = self.system.sample_time is not None
        if self.backward and discrete:
            now = np.broadcast_to(pieces.P, pieces.later.shape)
            pieces = replace(pieces, P=pieces.later, later=now)
        return _bounded_real(pieces, self.gamma, discrete)

    def congruence(self, root: np.ndarray) -> np.ndarray:
        signals = np.eye(len(self.system.inputs) + len(self.system.outputs)) / math.sqrt(self.gamma)
        return diagonal(root * math.sqrt(pace(self.system, self.storage, root)), signals)


def pace(system: Driven, storage: Storage, root: np.ndarray) -> float:
    """Time [s] in which the state changes by its own size, in the norm of P at the centre; 1 in discrete time.

    Parameters
    ----------
    system : Driven
        Its A at the centre of the box counts.
    storage : Storage
        Gives the centre.
    root : (n, n) array
        W with W P(centre) Wᵀ = I.

    Returns
    -------
    float
        1 also where A is zero or there is no state.
    """
    if system.sample_time is not None or not len(root):
        return 1.0
    a = system.matrices(storage.box.centre[None, :])[0][0]
    size = float(np.linalg.norm(np.linalg.solve(root.T, a) @ root.T, 2))
    return 1 / size if 0 < size < math.inf else 1.0


def _bounded_real(q: Pieces, gamma: float, discrete: bool) -> np.ndarray:
    """(N, T, m, m) the matrix of the bounded-real inequality, of values or (with sign +1) of magnitudes."""
    s, at, bt = q.sign, q.A.swapaxes(2, 3), q.B.swapaxes(2, 3)
    moves = (*q.later.shape[:2],)
    if discrete:
        weighted = at @ q.later
        state, cross = q.P + s * (weighted @ q.A), s * (weighted @ q.B)
        supply = q.eye(q.B.shape[3], gamma) + s * (bt @ q.later @ q.B)
    else:
        product = q.P @ q.A
        state, cross = s * (product + product.swapaxes(2, 3) + q.later), s * (q.P @ q.B)
        supply = q.eye(q.B.shape[3], gamma)

    def wide(x: np.ndarray) -> np.ndarray:
        return np.broadcast_to(x, (*moves, *x.shape[2:]))

    output, direct = wide(q.C), wide(q.D)
    return np.block([[wide(state), wide(cross), output.swapaxes(2, 3)],
                     [wide(cross).swapaxes(2, 3), supply, direct.swapaxes(2, 3)],
                     [output, direct, q.eye(q.C.shape[2], gamma)]])


@dataclass(frozen=True, eq=False, repr=False)
class GainCertificate(StorageCertificate):
    """A storage function ξᵀP(p)ξ, x = Tξ, that bounds the gain of a model from its inputs to its outputs.

    T is for the digits: where a plant's states and its controller's all but cancel in the storage function, as those of
    a near-integrator and its copy in the controller do, the products over the model's own states cancel too, and their
    rounding errors exceed the margin.

    With `inverse` the storage function is ξᵀQ(p)⁻¹ξ, and `matrices` are those of Q, where that has few terms and P has
    not: a design whose X moves has Q = diag(Y⁻¹, X(p) − Y⁻¹). The inequality, multiplied by Q from both sides, is that
    of the dual system (Aᵀ, Cᵀ, Bᵀ, Dᵀ) with the storage function Q and the opposite rates, which are as fast; in
    discrete time with Q(p⁺) and Q(p) exchanged.

    With `vertices` the scheduling stays in their convex hull, which the box encloses. The inequality is of a higher
    degree in p than one, so that vertices alone do not decide; Bernstein coefficients on simplices do
    (`lpvid.lmi.polytope_positivity`), for polynomials of any degree.

    Parameters
    ----------
    kind : str
        "quadratic" (one P), "poly-quadratic" (P(p), arbitrary jumps) or "parameter-dependent" (P(p), bounded rate).
    gamma : float
        Bound of ‖z‖/‖w‖ in L2 or ℓ2, in the unit of the outputs over that of the inputs.
    matrices : (K, n, n) array
        P(p) = Σ_k matrices[k] ψ_k(p), with ψ_k the functions of `basis`.
    basis : Basis
    box : Scheduling
        Range and rate bounds [units per second]; a variable read at several times has an entry for each.
    sample_time : float or None
    model_hash : str
        sha256 of the matrices, the basis and the sampling time it was made for.
    inputs, outputs : tuple of str
    margin : float
        Smallest eigenvalue of the inequality after the congruence that makes P(centre), and γ, 1, less a bound of the
        rounding errors (a pure number).
    between_grid : bool
        Proven on the whole box, not only on the points of a grid.
    solver : str
        What proposed the matrices.
    states : (n, n) array, optional
        T; left out, the identity.
    inverse : bool
        The matrices are those of P⁻¹.
    vertices : (V, len(box.names)) array, optional
        Of a polytope in place of the box; it is proven between them, or not at all.
    """

    kind: str
    gamma: float
    matrices: np.ndarray
    basis: Basis
    box: Scheduling
    sample_time: float | None
    model_hash: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    margin: float
    between_grid: bool
    solver: str = ""
    states: np.ndarray | None = field(default=None, metadata=ADDED)
    inverse: bool = field(default=False, metadata=ADDED)
    vertices: np.ndarray | None = field(default=None, metadata=UNWRITTEN)

    SCHEMA = "lpvid/gain-certificate/1"
    NOUN = "a gain certificate"

    @classmethod
    def of(cls, system: Driven, storage: Storage, gamma: float, found: Recheck, solver: str = "",
           states: np.ndarray | None = None, inverse: bool = False, vertices: np.ndarray | None = None
           ) -> GainCertificate:
        """The certificate of a storage function that was re-checked.

        Parameters
        ----------
        system : Driven
        storage : Storage
        gamma : float
        found : Recheck
            Of the three.
        solver : str
            What proposed the matrices.
        states : (n, n) array, optional
            T, where the storage function is over other states.
        inverse : bool
            The matrices are those of P⁻¹.
        vertices : (V, readings) array, optional
            Of a polytope in place of the box.

        Returns
        -------
        GainCertificate
        """
        return cls(certificate_kind(storage), gamma, storage.matrices, storage.basis, storage.box, system.sample_time,
                   system.digest, system.inputs, system.outputs, found.margin, found.between_grid, solver, states,
                   inverse, vertices)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON.

        Returns
        -------
        dict
            Without T where there is none, and without `inverse` where the matrices are P's: a file of before is written
            again as it was.
        """
        given = {"states": self.states is not None, "inverse": self.inverse}
        return {k: v for k, v in super().to_dict().items() if given.get(k, True)}

    @property
    def claim(self) -> str:
        """What the certificate states, in words."""
        covered = describe_set(self.box, self.vertices, self.kind)
        return f"gain from {self.signals} at most {self.gamma:.6g}{covered}{self.where}"

    def fault(self, model: LPVStateSpace, subject: Driven) -> str:
        fault = super().fault(model, subject)
        if not fault and self.states is not None and self.states.shape != (subject.order, subject.order):
            fault = "the states of the certificate do not fit the model"
        fault = fault or ("" if self.vertices is None else vertices_fault(self.vertices, self.box))
        return fault or ("" if 0 < self.gamma < math.inf else "the certificate holds a gain that is not positive")

    def recheck(self, model: LPVStateSpace, subject: Driven) -> Recheck:
        return recheck_gain(subject, self.storage, self.gamma, states=self.states, inverse=self.inverse,
                            vertices=self.vertices)

    @classmethod
    def array_shapes(cls, values: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
        return super().array_shapes(values) | (
            {} if values.get("vertices") is None else {"vertices": (-1, len(values["box"].names))})


def recheck_gain(system: Driven, storage: Storage, gamma: float, *, budget: int | None = None,
                 states: np.ndarray | None = None, inverse: bool = False, vertices: np.ndarray | None = None
                 ) -> Recheck:
    """Check that a storage function proves a gain, between grid points if the budget allows.

    Parameters
    ----------
    system : Driven
        w → z.
    storage : Storage
        ξᵀP(p)ξ.
    gamma : float
        Bound of the gain.
    budget : int, optional
        Matrices that subdivision may examine; left out, about a second's worth.
    states : (n, n) array, optional
        T of x = Tξ; left out, the identity.
    inverse : bool
        The storage function is ξᵀQ(p)⁻¹ξ, and `storage` is Q.
    vertices : (V, readings) array, optional
        Of a polytope in place of the box; then there is no proof on a grid.

    Returns
    -------
    Recheck
        Fails, with a margin of NaN, for a γ that is not positive and finite.

    Examples
    --------
    >>> from lpvid.lmi.driven import driven
    >>> from lpvid.scheduling import Polynomial
    >>> model = LPVStateSpace([[[-2.0]]], [[[1.0]]], [[[1.0]]], [[[0.0]]], Polynomial((), 0), None)
    >>> system, still = driven(model), Scheduling((), (), ())
    >>> lag = Storage(np.array([[[1.0]]]), Polynomial((), 0), still, None)
    >>> recheck_gain(system, lag, 0.501).holds, recheck_gain(system, lag, 0.499).holds
    (True, False)
    """
    if not 0 < gamma < math.inf:
        return Recheck(False, False, math.nan, "a gain bound is positive and finite")
    changed = over_states(system, states)
    if changed is None:
        return Recheck(False, False, math.nan, "the states of the certificate are singular, or nearly")
    problem = BoundedReal(changed.dual if inverse else changed, storage, gamma, inverse)
    if vertices is None:
        return recheck_inequality(problem, budget=budget)
    return recheck_polytope(problem, vertices, budget=budget)


def certify_gain(system: Matrices, P: np.ndarray, gamma: float, *, slopes: np.ndarray | None = None,
                 rate: np.ndarray | float | None = None, later: np.ndarray | None = None,
                 magnitudes: Matrices | None = None) -> Recheck:
    """Check the bounded-real inequality at N points for matrices given as arrays, with a bound of the rounding errors.

    Continuous time unless `later` is given. What lies between the points is not covered.

    Parameters
    ----------
    system : (A, B, C, D), each (N, …)
    P : (N, n, n) array
    gamma : float
    slopes : (N, v, n, n) array, optional
        ∂P/∂p_i; all 2^v corners of |ṗ_i| ≤ rate_i are checked.
    rate : (v,) array or float, optional
        Units per second.
    later : (N, T, n, n) array, optional
        Discrete time: P at the T scheduling values that one sample can lead to.
    magnitudes : (A, B, C, D), each (N, …), optional
        What of the system's matrices the rounding errors are shares of: left out, their absolute values. A system that
        was computed from another has more.

    Returns
    -------
    Recheck
        Its margin is the smallest eigenvalue after the congruence that makes P, at each point, and γ the identity.

    Examples
    --------
    >>> lag = tuple(np.array([[[x]]]) for x in (-2.0, 1.0, 1.0, 0.0))
    >>> certify_gain(lag, np.array([[[1.0]]]), 0.501).holds, certify_gain(lag, np.array([[[1.0]]]), 0.499).holds
    (True, False)
    """
    a, b, c, d = (np.asarray(x, dtype=float) for x in system)
    p = np.asarray(P, dtype=float)
    discrete = later is not None
    after, after_size = (np.asarray(later, dtype=float),) * 2 if discrete else _corners(p, slopes, rate)
    if not all(np.all(np.isfinite(x)) for x in (a, b, c, d, p, after)) or not 0 < gamma < math.inf:
        return Recheck(False, False, math.nan, "a matrix or the gain is not finite")
    try:
        root = np.linalg.inv(np.linalg.cholesky(0.5 * (p + p.swapaxes(1, 2))))
    except np.linalg.LinAlgError:
        return Recheck(False, False, -math.inf, "P is not positive definite at a point")
    n, m = p.shape[1], b.shape[2] + c.shape[1]
    weight = root
    if not discrete and n:
        speed = np.linalg.norm(np.linalg.solve(root.swapaxes(1, 2), a) @ root.swapaxes(1, 2), 2, axis=(1, 2))
        weight = root / np.sqrt(np.maximum(speed, 1e-300))[:, None, None]
    scale = diagonal(weight, np.eye(m) / math.sqrt(gamma))[:, None]
    large = [np.abs(x) for x in magnitudes or (a, b, c, d)]
    with np.errstate(over="ignore", invalid="ignore"):
        value = scale @ _bounded_real(Pieces.of((a, b, c, d), p, after), gamma, discrete) @ scale.swapaxes(2, 3)
        size = _bounded_real(Pieces.of(large, np.abs(p), np.abs(after_size), 1.0), gamma, discrete)
        size = np.abs(scale) @ size @ np.abs(scale.swapaxes(2, 3))
    if not np.all(np.isfinite(value)):
        return Recheck(False, False, math.nan, "the inequality is not finite at a point")
    rounding = (6 * (n + m) + 30) * EPS * size.sum(axis=-1).max(axis=-1)
    lowest = np.linalg.eigvalsh(0.5 * (value + value.swapaxes(2, 3)))[..., 0] - rounding
    margin = float(lowest.min())
    text = f"shown at {len(a)} points only, not between them"
    return Recheck(margin > 0, False, margin, text if margin > 0 else f"fails at point {int(lowest.min(1).argmin())}")


def _corners(p: np.ndarray, slopes: np.ndarray | None, rate: np.ndarray | float | None
             ) -> tuple[np.ndarray, np.ndarray]:
    """(N, 2^v, n, n) Ṗ at all corners of the rates, and its magnitude."""
    if slopes is None:
        return np.zeros((len(p), 1, *p.shape[1:])), np.zeros((len(p), 1, *p.shape[1:]))
    slopes = np.asarray(slopes, dtype=float)
    v = slopes.shape[1]
    if rate is None:
        raise InputError("P changes with p, so the rate of p needs a bound", got="rate=None")
    rates = np.broadcast_to(np.asarray(rate, dtype=float), (v,))
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=v))).reshape(2**v, v)
    size = np.einsum("v,nvij->nij", rates, np.abs(slopes))
    return np.einsum("tv,nvij->ntij", signs * rates, slopes), np.repeat(size[:, None], len(signs), axis=1)
