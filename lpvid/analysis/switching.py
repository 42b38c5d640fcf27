"""Arbitrary switching between matrices: bounds of the joint spectral radius, and poly-quadratic certificates."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.codec import Encoded
from lpvid.errors import InputError
from lpvid.lmi.certificate import EPS, Recheck
from lpvid.lmi.certificate_common import Certificate
from lpvid.lmi.driven import Model, autonomous
from lpvid.lmi.readings import box_of

MOST_PRODUCTS = 30_000
DEEPEST = 60


@dataclass(frozen=True, eq=False)
class JointSpectralRadius(Encoded):
    """How fast products of the matrices can grow, per factor.

    Parameters
    ----------
    lower : float
        ρ(Π)^{1/k} of the product Π along `word`: switching like this grows as fast.
    upper : float
        No product grows faster: proven by norms of products, rounding included.
    word : tuple of int
        Indices of the matrices, in the order in which they act.
    products : int
        Number of products looked at.
    """

    JSON = (..., "stable")

    lower: float
    upper: float
    word: tuple[int, ...]
    products: int

    @property
    def stable(self) -> bool | None:
        """True or False where the bounds decide it; None where they enclose 1."""
        return True if self.upper < 1 else False if self.lower > 1 else None

    def __repr__(self) -> str:
        verdict = {True: "stable", False: "unstable", None: "undecided"}[self.stable]
        return (f"{verdict} under arbitrary switching: joint spectral radius between {self.lower:.6g} and "
                f"{self.upper:.6g}\n  the lower bound is reached by the word "
                f"{' '.join(map(str, self.word))} ({self.products} products)")


def joint_spectral_radius(matrices: Sequence[np.ndarray] | np.ndarray | Model, accuracy: float = 1e-3
                          ) -> JointSpectralRadius:
    """Enclose the joint spectral radius of a set of matrices, by branch and bound in an ellipsoidal norm.

    A word is followed only while all its prefixes have ‖Π_j‖^{1/j} above the lower bound by `accuracy` (Gripenberg,
    Linear Algebra and its Applications 234 (1996) 43-60). The norm is that of a common quadratic Lyapunov function
    as tight as it can be had.

    Parameters
    ----------
    matrices : (K, n, n) array or discrete model
        Of a model whose matrices are affine in every scheduling variable, the vertices: their hull has the same
        radius, so that the bounds hold for any motion in the box.
    accuracy : float
        Relative distance of the bounds to aim at.

    Returns
    -------
    JointSpectralRadius

    Examples
    --------
    >>> nilpotent = np.array([[[0, 2.0], [0, 0]], [[0, 0], [2.0, 0]]])      # both have spectral radius 0
    >>> joint_spectral_radius(nilpotent).stable
    False
    """
    stack = vertices(matrices) if not isinstance(matrices, (np.ndarray, Sequence)) else _stack(matrices)
    _checks.positive(accuracy, "accuracy")
    count, n = stack.shape[:2]
    if not n:
        return JointSpectralRadius(0.0, 0.0, (0,), 0)
    size = float(np.abs(stack).max(initial=0.0))
    if not size:
        return JointSpectralRadius(0.0, 0.0, (0,), count)
    root, inverse = _norm(stack / size)
    moved = root @ stack @ inverse
    rounding = 1 + 8 * n * EPS * float(np.linalg.cond(root))
    radii = np.abs(np.linalg.eigvals(stack)).max(axis=1)
    lower, word = float(radii.max()), (int(radii.argmax()),)
    words, products = np.arange(count)[:, None], moved
    least = np.linalg.norm(moved, 2, axis=(1, 2)) * rounding
    seen, upper = count, math.inf
    for depth in itertools.count(2):
        upper = min(upper, max(float(least.max(initial=0.0)), lower))
        keep = least > lower * (1 + accuracy)
        words, products, least = words[keep], products[keep], least[keep]
        if not len(words):
            upper = min(upper, max(lower * (1 + accuracy), 1e-300))
            break
        if seen + len(words) * count > MOST_PRODUCTS or depth > DEEPEST:
            break
        words = np.hstack([np.repeat(words, count, axis=0), np.tile(np.arange(count), len(words))[:, None]])
        products = moved[words[:, -1]] @ np.repeat(products, count, axis=0)
        seen += len(words)
        radii = np.abs(np.linalg.eigvals(products)).max(axis=1) ** (1 / depth)
        if radii.max() > lower:
            best = int(radii.argmax())
            lower, word = float(radii[best]), tuple(int(i) for i in words[best])
        sizes = np.linalg.norm(products, 2, axis=(1, 2)) * rounding**depth
        least = np.minimum(np.repeat(least, count), sizes ** (1 / depth))
    exact = _radius(stack, word)
    return JointSpectralRadius(min(exact, upper), upper, word, seen)


def _radius(stack: np.ndarray, word: tuple[int, ...]) -> float:
    product = np.eye(stack.shape[1])
    for index in word:
        product = stack[index] @ product
    return float(np.abs(np.linalg.eigvals(product)).max()) ** (1 / len(word))


def _norm(stack: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(W, W⁻¹) with max ‖W A W⁻¹‖ as small as a semidefinite program finds it."""
    from lpvid.lmi.program import Program

    n = stack.shape[1]
    program = Program()
    p, margin = program.unknowns.symmetric(n), program.unknowns.scalar()
    for a in stack:
        program.require(-(a.T @ (p @ a)) - margin.times(np.eye(n)), scaled={"square": p})
    program.require(p - 1e-6 * np.eye(n))
    program.require(-p + np.eye(n))
    program.minimise(-margin)
    low = float(np.abs(np.linalg.eigvals(stack)).max())
    high = float(np.linalg.norm(stack, 2, axis=(1, 2)).max())
    best = np.eye(n)
    for _ in range(12):
        if high - low < 1e-3 * high:
            break
        middle = 0.5 * (low + high)
        found = next(program.solve({"square": middle**2}, solvers=("CLARABEL",)), None)
        value = None if found is None else found[p]
        if value is not None and np.linalg.eigvalsh(value)[0] > 0:
            factor = np.linalg.cholesky(value).T
            reached = float(np.linalg.norm(factor @ stack @ np.linalg.inv(factor), 2, axis=(1, 2)).max())
            if reached < high:
                best, high = factor, reached
                continue
        low = middle
    return best, np.linalg.inv(best)


# -- poly-quadratic --------------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class PolytopicCertificate(Certificate):
    """S_1 … S_K ≻ 0 with S_i⁻¹ − A_iᵀ S_j⁻¹ A_i ≻ 0 for all i, j: V = xᵀ(Σ α_i S_i)⁻¹x decreases whatever α does.

    Daafouz & Bernussou, Systems & Control Letters 43 (2001) 355-359: necessary and sufficient for such a V.

    Parameters
    ----------
    matrices : (K, n, n) array
        S_i, one for each vertex.
    vertices : (K, n, n) array
        A_i.
    margin : float
        Smallest eigenvalue of the inequalities, each after the congruence that makes S_i⁻¹ the identity.
    solver : str
    """

    matrices: np.ndarray
    vertices: np.ndarray
    margin: float
    solver: str = ""

    SCHEMA = "lpvid/polytopic-certificate/1"
    NOUN = "a polytopic certificate"
    JSON = (("schema", "SCHEMA"), "kind", "claim", ...)
    FUNCTION = "Lyapunov function"
    kind = "polytopic"
    between_grid = True

    @property
    def claim(self) -> str:
        """What the certificate states, in words."""
        return (f"with zero input the state decays for every motion in the hull of {len(self.vertices)} vertices, "
                "however fast")

    def subject(self, model: Model | np.ndarray) -> np.ndarray:
        return _stack(model) if isinstance(model, np.ndarray) else vertices(model)

    def fault(self, model: Model | np.ndarray, subject: np.ndarray) -> str:
        same = subject.shape == self.vertices.shape and np.array_equal(subject, self.vertices)
        return "" if same else "the certificate was made for other vertices"

    def recheck(self, model: Model | np.ndarray, subject: np.ndarray) -> Recheck:
        margin = _polytopic_margin(subject, self.matrices)
        if not margin > 0:
            return Recheck(False, False, margin, "V does not decrease between some vertices")
        return Recheck(True, True, margin, "holds at every pair of vertices, and so at every point in their hull")


def certify_switching(matrices: Sequence[np.ndarray] | np.ndarray | Model) -> PolytopicCertificate | None:
    """Look for a poly-quadratic Lyapunov function of a family of matrices that may jump at every sample.

    Parameters
    ----------
    matrices : (K, n, n) array or discrete model
        As for `joint_spectral_radius`.

    Returns
    -------
    PolytopicCertificate or None

    Examples
    --------
    >>> certify_switching(np.array([[[0.5, 0.4], [0, 0.5]], [[0.5, 0], [0.4, 0.5]]])) is None
    False
    """
    from lpvid.lmi.program import Program

    stack = vertices(matrices) if not isinstance(matrices, (np.ndarray, Sequence)) else _stack(matrices)
    n = stack.shape[1]
    program = Program()
    p, margin = [program.unknowns.symmetric(n) for _ in stack], program.unknowns.scalar()
    for own, a in zip(p, stack, strict=True):
        program.require(own - margin.times(np.eye(n)))
        program.require(-own + np.eye(n))
        for after in p:
            program.require(own - a.T @ (after @ a) - margin.times(np.eye(n)))
    program.minimise(-margin)
    for found in program.solve(solvers=("CLARABEL", "MOSEK", "SDPA", "CVXOPT")):
        values = np.stack([found[m] for m in p])
        if np.linalg.eigvalsh(values)[:, 0].min() <= 0:
            continue
        inverse = np.linalg.inv(values)
        inverse = 0.5 * (inverse + inverse.swapaxes(1, 2))
        reached = _polytopic_margin(stack, inverse)
        if reached > 0:
            return PolytopicCertificate(inverse, stack, reached, found.solver)
    return None


def _polytopic_margin(stack: np.ndarray, matrices: np.ndarray) -> float:
    """1 − max ‖R_j⁻¹ A_i R_i‖² with S = R Rᵀ, less a bound of the rounding."""
    try:
        roots = np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        return -math.inf
    n = stack.shape[1]
    moved = np.linalg.inv(roots)[None] @ (stack @ roots)[:, None]
    rounding = 20 * n * EPS * float(np.linalg.cond(roots).max(initial=1.0))
    return 1 - float(np.linalg.norm(moved, 2, axis=(2, 3)).max(initial=0.0)) ** 2 * (1 + rounding) - rounding


def vertices(model: Model) -> np.ndarray:
    """(K, n, n) A at the corners of the box, of a discrete model affine in each variable by itself.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        Discrete in time.

    Returns
    -------
    (K, n, n) array
        2^v matrices for v readings; p at another delay counts as a further one.

    Raises
    ------
    InputError
        A continuous model, or one whose values in the box are no mixtures of those at the corners.
    """
    system = autonomous(model)
    if system.sample_time is None:
        raise InputError("arbitrary switching is about discrete time", got="a continuous model",
                         mend="discretise it first, or use lpvid.decay_rate")
    curved = [r.label for r in system.readings if r.degree > 1 or len(r.breaks) > 2]
    if curved:
        raise InputError("the values in the box are no mixtures of those at its corners",
                         got=f"a dependence on {', '.join(curved)} that is not affine",
                         mend="use lpvid.certify_stability, or give the vertices of a polytope around it")
    box = box_of(system.readings, model.box)
    corners = np.array(list(itertools.product(*zip(box.lower, box.upper, strict=True))), dtype=float)
    return system.state_matrices(corners.reshape(-1, len(box.names)))


def _stack(matrices: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    stack = _checks.finite(_checks.frozen_array(matrices, "matrices", ndim=3), "matrices")
    if not len(stack) or stack.shape[1] != stack.shape[2]:
        raise InputError("switching needs square matrices of one size", got=f"shape {stack.shape}")
    return stack
