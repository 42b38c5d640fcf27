"""What a design requires of its closed loop: bounds on gains between named signals, and regions for its poles."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.lmi.affine import Affine, block, trace
from lpvid.lmi.program import Program
from lpvid.synthesis.shaped_loop import Matrix, ShapedLoop

if TYPE_CHECKING:
    from lpvid.synthesis.generalized_plant import GeneralizedPlant

STRICT = 1e-9
"""Margin of strict inequalities, in the scaled coordinates of a design."""


@dataclass(frozen=True)
class _Channel:
    """A bound on what some disturbances do to some performance signals.

    Parameters
    ----------
    disturbances, performance : tuple of str
        Names of signals of the plant; empty for all of them.
    bound : float or None
        The level to keep; None: as low as possible.
    weight : float
        Of this level in the sum to minimise, where several are free.
    """

    disturbances: tuple[str, ...] = ()
    performance: tuple[str, ...] = ()
    bound: float | None = None
    weight: float = 1.0

    def __post_init__(self) -> None:
        for name in ("disturbances", "performance"):
            value = getattr(self, name)
            object.__setattr__(self, name, (value,) if isinstance(value, str) else tuple(value))
        if self.bound is not None:
            object.__setattr__(self, "bound", _checks.positive(self.bound, "the bound of a criterion"))
        object.__setattr__(self, "weight", _checks.positive(self.weight, "the weight of a criterion"))

    def indices(self, plant: GeneralizedPlant) -> tuple[list[int], list[int]]:
        """Places of the channel's signals among the plant's disturbances and performance signals."""
        chosen = []
        for what, given, known in (("disturbance", self.disturbances, plant.disturbances),
                                   ("performance signal", self.performance, plant.performance)):
            chosen.append([known.index(_checks.known_name(n, known, what)) for n in given or known])
        return chosen[0], chosen[1]

    def selection(self, plant: GeneralizedPlant) -> tuple[np.ndarray, np.ndarray]:
        """(n_w, ·) and (·, n_z) matrices that pick the channel's signals."""
        into, out = self.indices(plant)
        return np.eye(len(plant.disturbances))[:, into], np.eye(len(plant.performance))[out]

    def description(self, plant: GeneralizedPlant) -> str:
        """The channel in words."""
        return (f"{', '.join(self.disturbances or plant.disturbances)} to "
                f"{', '.join(self.performance or plant.performance)}")


@dataclass(frozen=True)
class HInfinity(_Channel):
    """Bound γ of the induced L2 gain (H-infinity norm where nothing varies) of a channel.

    [He 𝐀, 𝐁, 𝐂ᵀ; ⋆, −γI, 𝐃ᵀ; ⋆, ⋆, −γI] ≺ 0, or in discrete time [𝐗⁺, 𝐀, 𝐁, 0; ⋆, 𝐗, 0, 𝐂ᵀ; ⋆, ⋆, γI, 𝐃ᵀ;
    ⋆, ⋆, ⋆, γI] ≻ 0 (Scherer, Gahinet & Chilali 1997; de Oliveira, Geromel & Bernussou 2002).

    Examples
    --------
    >>> HInfinity(disturbances="road", bound=2.0).bound
    2.0
    """

    def require(self, program: Program, loops: Sequence[ShapedLoop], level: Affine,
                chosen: tuple[np.ndarray, np.ndarray], *, squared: bool = False) -> None:
        """The channel's gain is at most `level` (1, 1) in every loop, or its square is.

        Squared, the storage is measured in |w|² as that of an H2 criterion: the two then share 𝐗 with less loss
        (Bernstein & Haddad 1989).

        Parameters
        ----------
        program : Program
            Where that is required.
        loops : sequence of ShapedLoop
            At the points and moves that are looked at.
        level : Affine
            (1, 1) γ, or γ².
        chosen : ((n_w, ·) array, (n_z, ·) array)
            What picks the channel's signals, as `selection` gives it.
        squared : bool
            The level is γ².
        """
        for loop in loops:
            into, out = (chosen[1].T, chosen[0].T) if loop.turned else chosen
            b, c, d = loop.entry @ into, out @ loop.exit, out @ loop.through @ into
            nz, nw = out.shape[0], into.shape[1]
            w: Matrix = np.eye(nw) if squared else level.times(np.eye(nw))
            z, n = level.times(np.eye(nz)), loop.order
            if loop.discrete:
                rows = [[loop.later(), loop.dynamics, b, np.zeros((n, nz))],
                        [loop.dynamics.T, loop.lyapunov, np.zeros((n, nw)), c.T],
                        [b.T, np.zeros((nw, n)), w, d.T], [np.zeros((nz, n)), c, d, z]]
            else:
                scale = -1 / math.sqrt(loop.pace)
                b, c = scale * b, scale * c
                rows = [[-loop.flow(), b, c.T], [b.T, w, -d.T], [c, -d, z]]
            program.require(block(rows), margin=STRICT)


@dataclass(frozen=True)
class CovarianceCriterion(_Channel, ABC):
    """Bound on z from a matrix above the covariance of the states; 𝐃 must be 0 in continuous time.

    [He 𝐀, 𝐁; ⋆, −I] ≺ 0, [Z, 𝐂; ⋆, 𝐗] ≻ 0 (continuous time); [𝐗⁺, 𝐀, 𝐁; ⋆, 𝐗, 0; ⋆, ⋆, I] ≻ 0, [Z, 𝐂, 𝐃; ⋆, 𝐗, 0;
    ⋆, ⋆, I] ≻ 0 (discrete time). The criteria differ in what they ask of Z.
    """

    kind: ClassVar[str]
    peak: ClassVar[bool]

    @abstractmethod
    def output(self, program: Program, level: Affine, size: int) -> Affine:
        """(size, size) Z that keeps `level`, ν or its square.

        Parameters
        ----------
        program : Program
            Where what is asked of Z is required.
        level : Affine
            (1, 1).
        size : int
            Number of performance signals.

        Returns
        -------
        Affine
            Z.
        """

    def require(self, program: Program, loops: Sequence[ShapedLoop], level: Affine,
                chosen: tuple[np.ndarray, np.ndarray], *, squared: bool = True) -> None:
        """The criterion is at most `level` in every loop, or its square is.

        Not squared, 𝐗 and Z are those of the squared form times and over ν, which keeps them of like size.

        Parameters
        ----------
        program : Program
            Where that is required.
        loops : sequence of ShapedLoop
            At the points and moves that are looked at.
        level : Affine
            (1, 1) ν, or ν².
        chosen : ((n_w, ·) array, (n_z, ·) array)
            What picks the channel's signals, as `selection` gives it.
        squared : bool
            The level is ν².
        """
        for loop in loops:
            b, c, d = loop.entry @ chosen[0], chosen[1] @ loop.exit, chosen[1] @ loop.through @ chosen[0]
            nz, nw, n = chosen[1].shape[0], chosen[0].shape[1], loop.order
            w: Matrix = np.eye(nw) if squared else level.times(np.eye(nw))
            z = self.output(program, level, nz)
            if loop.discrete:
                program.require(block([[loop.later(), loop.dynamics, b],
                                       [loop.dynamics.T, loop.lyapunov, np.zeros((n, nw))],
                                       [b.T, np.zeros((nw, n)), w]]), margin=STRICT)
                program.require(block([[z, c, d], [c.T, loop.lyapunov, np.zeros((n, nw))],
                                       [d.T, np.zeros((nw, n)), w]]), margin=STRICT)
                continue
            b = (-1 / math.sqrt(loop.pace)) * b
            program.require(block([[-loop.flow(), b], [b.T, w]]), margin=STRICT)
            program.require(block([[z, c], [c.T, loop.lyapunov]]), margin=STRICT)


@dataclass(frozen=True)
class H2(CovarianceCriterion):
    """Bound ν of the H2 norm of a channel: the rms of z while w is white noise of unit intensity; trace Z ≤ ν².

    For a varying plant it bounds the variance at every instant of every trajectory.

    Examples
    --------
    >>> H2("road", "comfort").performance
    ('comfort',)
    """

    kind: ClassVar[str] = "H2"
    peak: ClassVar[bool] = False

    def output(self, program: Program, level: Affine, size: int) -> Affine:
        z = program.unknowns.symmetric(size)
        program.require(level - trace(z))
        return z


@dataclass(frozen=True)
class GeneralizedH2(CovarianceCriterion):
    """Bound ν of the peak of z for a w of unit energy: |z(t)| ≤ ν‖w‖₂ at every t; Z = ν²I (Rotea 1993).

    For one z it is the H2 norm; for several, |z| is their Euclidean length. A stroke that must not reach its stop is
    bounded so, under every road of limited energy; for a varying plant, on every trajectory.

    References
    ----------
    Rotea, M. A. (1993). The generalized H2 control problem. Automatica 29, 373-385.

    Examples
    --------
    >>> GeneralizedH2("road", "stroke", bound=0.05).bound
    0.05
    """

    kind: ClassVar[str] = "generalized H2"
    peak: ClassVar[bool] = True

    def output(self, program: Program, level: Affine, size: int) -> Affine:
        return level.times(np.eye(size))


Criterion = HInfinity | CovarianceCriterion


class Region(ABC):
    """A convex region of the complex plane, L + sM + s̄Mᵀ ≺ 0 (Chilali & Gahinet 1996), that all frozen poles share."""

    discrete: ClassVar[bool | None]
    """True where the plane is that of z, False for s, None for both."""

    @abstractmethod
    def matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """L (symmetric) and M.

        Returns
        -------
        (m, m) array
            L, symmetric.
        (m, m) array
            M, of any form.
        """

    def require(self, program: Program, loops: Sequence[ShapedLoop]) -> None:
        """L ⊗ 𝐗 + M ⊗ 𝐀 + Mᵀ ⊗ 𝐀ᵀ ≺ 0 in every loop.

        Parameters
        ----------
        program : Program
            Where that is required.
        loops : sequence of ShapedLoop
            At the points that are looked at.
        """
        fixed, varying = self.matrices()
        for loop in loops:
            rows = [[(-1.0 / loop.pace) * (float(fixed[i, j]) * loop.lyapunov + float(varying[i, j]) * loop.dynamics
                                           + float(varying[j, i]) * loop.dynamics.T)
                     for j in range(len(fixed))] for i in range(len(fixed))]
            program.require(block(rows), margin=STRICT)

    def distance(self, poles: np.ndarray) -> np.ndarray:
        """(n,) largest eigenvalue of L + sM + s̄Mᵀ at each pole: negative inside.

        Parameters
        ----------
        poles : (n,) array
            Complex [1/s], or of the z plane.

        Returns
        -------
        (n,) array
            0 on the boundary.
        """
        fixed, varying = self.matrices()
        s = np.asarray(poles, dtype=complex).reshape(-1, 1, 1)
        return np.linalg.eigvalsh(fixed + s * varying + s.conj() * varying.T)[:, -1]

    def slack(self, lyapunov: np.ndarray, matrix: np.ndarray) -> float:
        """Smallest eigenvalue of −(L ⊗ P + M ⊗ PA + Mᵀ ⊗ (PA)ᵀ) relative to P: positive, all poles of A are inside.

        Parameters
        ----------
        lyapunov : (n, n) array
            P, positive definite.
        matrix : (n, n) array
            Dynamics A of the closed loop.

        Returns
        -------
        float
            Eigenvalue in coordinates where P is the identity.
        """
        fixed, varying = self.matrices()
        factor = np.linalg.cholesky(lyapunov)
        a = factor.T @ matrix @ np.linalg.inv(factor.T)
        total = np.kron(fixed, np.eye(len(a))) + np.kron(varying, a) + np.kron(varying.T, a.T)
        return float(-np.linalg.eigvalsh(total)[-1])


@dataclass(frozen=True)
class HalfPlane(Region):
    """Re s < −decay: everything settles at least as exp(−decay·t).

    Parameters
    ----------
    decay : float
        [1/s]

    Examples
    --------
    >>> HalfPlane(2.0).distance([-3.0, -1.0]).tolist()
    [-2.0, 2.0]
    """

    decay: float = 0.0
    discrete: ClassVar[bool | None] = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "decay", _checks.real(self.decay, "the decay of a half plane"))

    def matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """L = 2·decay and M = 1: 2 Re s + 2·decay < 0."""
        return np.array([[2.0 * self.decay]]), np.eye(1)


@dataclass(frozen=True)
class Disc(Region):
    """|s − centre| < radius; in discrete time Disc(0, r) is a decay by r per sample.

    Parameters
    ----------
    centre : float
        On the real axis [1/s, or of the z plane].
    radius : float
        In the same unit.
    """

    centre: float
    radius: float
    discrete: ClassVar[bool | None] = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", _checks.real(self.centre, "the centre of a disc"))
        object.__setattr__(self, "radius", _checks.positive(self.radius, "the radius of a disc"))

    def matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """[−radius, s − centre; s̄ − centre, −radius] ≺ 0."""
        return (np.array([[-self.radius, -self.centre], [-self.centre, -self.radius]]),
                np.array([[0.0, 1.0], [0.0, 0.0]]))


@dataclass(frozen=True)
class Cone(Region):
    """Damping ratio above `damping`: |Im s| < −Re s · tan(arccos damping).

    Parameters
    ----------
    damping : float
        Damping ratio ζ, between 0 and 1.

    Examples
    --------
    >>> Cone(0.5).distance([-1.0 + 1.7j, -1.0 + 1.8j]).round(3).tolist()
    [-0.032, 0.068]
    """

    damping: float
    discrete: ClassVar[bool | None] = False

    def __post_init__(self) -> None:
        if not 0 < _checks.real(self.damping, "the damping of a cone") < 1:
            raise InputError("the damping ratio of a cone must lie between 0 and 1", got=self.damping)

    def matrices(self) -> tuple[np.ndarray, np.ndarray]:
        """L = 0, M of sin θ = √(1 − ζ²) on the diagonal and ± cos θ = ± ζ beside it."""
        cosine, sine = self.damping, math.sqrt(1 - self.damping**2)
        return np.zeros((2, 2)), np.array([[sine, cosine], [-cosine, sine]])
