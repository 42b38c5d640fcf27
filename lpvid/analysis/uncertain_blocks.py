"""Blocks of uncertainty p = Δ(q), each with the integral quadratic constraints that every Δ of its kind satisfies.

    ∫₀ᵀ rᵀ M r dt ≥ 0  for all T,        r = Ψ (q, p)

with a filter Ψ that is fixed and multipliers M in a convex set (Megretski & Rantzer, IEEE TAC 42 (1997) 819-830). All
those below hold over every finite horizon ("hard"), so that with a storage function they prove bounds for systems that
vary with time (Pfifer & Seiler, Int. J. Robust Nonlinear Control 26 (2016) 2218-2239). Filters are H = (1, a₁/(s + a₁),
…), in discrete time (1, (1 − α)/(z − α), …) with α = exp(−aT).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import ClassVar

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.lmi.affine import Affine, block, block_diagonal
from lpvid.lmi.certificate import diagonal
from lpvid.model.state_space import Matrices

PSD, SKEW = "symmetric, positive semidefinite", "antisymmetric"


@dataclass(frozen=True)
class Block(ABC):
    """p = Δ(q): the block drives `inputs` of the system from its `outputs`.

    Parameters
    ----------
    inputs : str or sequence of str
        p: names of inputs of the system.
    outputs : str or sequence of str
        q: names of outputs of the system.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    follows: ClassVar[bool] = False
    """The nominal block is p = q, not p = 0."""

    def __post_init__(self) -> None:
        for field in ("inputs", "outputs"):
            value = getattr(self, field)
            object.__setattr__(self, field, (value,) if isinstance(value, str) else tuple(value))
        if not self.inputs or not self.outputs:
            raise InputError("a block of uncertainty needs inputs and outputs of the system", got=repr(self))

    def _square(self) -> int:
        if len(self.inputs) != len(self.outputs):
            raise InputError(f"a {type(self).__name__} block has as many inputs as outputs",
                             got=f"{len(self.inputs)} and {len(self.outputs)}")
        return len(self.inputs)

    @abstractmethod
    def filter(self, poles: Sequence[float], sample_time: float | None) -> Matrices:
        """Ψ as (A, B, C, D) from (q, p) to r.

        Parameters
        ----------
        poles : sequence of float
            Poles of the bank of filters; none for a block without dynamics in its multiplier.
        sample_time : float or None
            Period [s]; None in continuous time.

        Returns
        -------
        tuple of arrays
            A, B, C, D; the columns of B and D belong to q, then p, the rows of C and D to r.
        """

    @abstractmethod
    def unknowns(self, poles: Sequence[float]) -> tuple[tuple[str, int], ...]:
        """Kind and size of the matrices that M is made of.

        Parameters
        ----------
        poles : sequence of float
            As for `filter`.

        Returns
        -------
        tuple of (str, int)
            Kind (`PSD`, `SKEW`) and size of each matrix.
        """

    @abstractmethod
    def multiplier(self, parts: Sequence[Affine], poles: Sequence[float]) -> Affine:
        """M from its matrices.

        Parameters
        ----------
        parts : sequence of Affine
            The matrices that `unknowns` names, in its order.
        poles : sequence of float
            As for `filter`.

        Returns
        -------
        Affine
            (r, r), symmetric.
        """

    @abstractmethod
    def draw(self, s: complex, generator: np.random.Generator | int) -> np.ndarray:
        """(p, q) complex gain that some linear time-invariant Δ of this kind has at s = jω.

        Parameters
        ----------
        s : complex
            Point of the frequency axis, jω [rad/s] in continuous time.
        generator : numpy.random.Generator or int
            Source of the draw.

        Returns
        -------
        (p, q) complex array
            A gain that the block allows at s.
        """

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Kind and fields of the block.
        """
        return {"kind": type(self).__name__, **{k: list(v) if isinstance(v, tuple) else v
                                                for k, v in self.__dict__.items()}}


@dataclass(frozen=True)
class Bounded(Block):
    """A block whose size has a bound.

    Parameters
    ----------
    bound : float
        Of the kind's own size.
    """

    bound: float = 1.0
    SIZE: ClassVar[str] = "the bound of a block"
    """What an error calls it."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _checks.positive(self.bound, self.SIZE)


@dataclass(frozen=True)
class Parametric(Bounded):
    """p = δ q with an unknown real number |δ| ≤ bound, the same for all pairs of a block.

    A constant δ commutes with filters: [b²S T; Tᵀ −S] with S ⪰ 0 and T = −Tᵀ over (Hq, Hp). A δ that moves keeps S and
    T without filters.

    Parameters
    ----------
    bound : float
    moving : bool
        δ(t) may change arbitrarily fast.

    Examples
    --------
    >>> Parametric("p", "q", 0.2).to_dict()["bound"]
    0.2
    """

    moving: bool = False
    SIZE: ClassVar[str] = "the bound of a parameter"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._square()

    def filter(self, poles: Sequence[float], sample_time: float | None) -> Matrices:
        return _both(bank((), None) if self.moving else bank(poles, sample_time), len(self.outputs), len(self.inputs))

    def unknowns(self, poles: Sequence[float]) -> tuple[tuple[str, int], ...]:
        size = len(self.inputs) * (1 if self.moving else 1 + len(poles))
        return ((PSD, size), (SKEW, size))

    def multiplier(self, parts: Sequence[Affine], poles: Sequence[float]) -> Affine:
        s, t = parts
        return block([[self.bound**2 * s, t], [t.T, -s]])

    def draw(self, s: complex, generator: np.random.Generator | int) -> np.ndarray:
        generator = _checks.generator(generator, "generator")
        return self.bound * float(generator.choice([-1.0, 1.0, generator.uniform(-1, 1)])) * np.eye(len(self.inputs))


@dataclass(frozen=True)
class Dynamic(Bounded):
    """p = Δ q with an unknown stable linear time-invariant system, ‖Δ‖∞ ≤ bound: neglected dynamics.

    diag(b² S⊗I, −S⊗I) over (Hq, Hp), S ⪰ 0: filters of one signal commute with Δ, of whatever size it is.

    Parameters
    ----------
    bound : float
        Largest gain ‖Δ‖∞.
    """

    SIZE: ClassVar[str] = "the bound of neglected dynamics"

    def filter(self, poles: Sequence[float], sample_time: float | None) -> Matrices:
        return _both(bank(poles, sample_time), len(self.outputs), len(self.inputs))

    def unknowns(self, poles: Sequence[float]) -> tuple[tuple[str, int], ...]:
        return ((PSD, 1 + len(poles)),)

    def multiplier(self, parts: Sequence[Affine], poles: Sequence[float]) -> Affine:
        return _norm_bounded(parts[0], self.bound, len(self.outputs), len(self.inputs))

    def draw(self, s: complex, generator: np.random.Generator | int) -> np.ndarray:
        generator = _checks.generator(generator, "generator")
        u, v = (generator.standard_normal(n) + 1j * generator.standard_normal(n)
                for n in (len(self.inputs), len(self.outputs)))
        return self.bound * np.outer(u / np.linalg.norm(u), v.conj() / np.linalg.norm(v))


@dataclass(frozen=True)
class Lipschitz(Bounded):
    """p = φ(q, t) without memory and |φ(q, t)| ≤ bound·|q|, of any size: τ(b²|q|² − |p|²), τ ≥ 0.

    Parameters
    ----------
    bound : float
        Lipschitz constant of a φ with φ(0) = 0.
    """

    SIZE: ClassVar[str] = "a Lipschitz constant"

    def filter(self, poles: Sequence[float], sample_time: float | None) -> Matrices:
        return _both(bank((), None), len(self.outputs), len(self.inputs))

    def unknowns(self, poles: Sequence[float]) -> tuple[tuple[str, int], ...]:
        return ((PSD, 1),)

    def multiplier(self, parts: Sequence[Affine], poles: Sequence[float]) -> Affine:
        return _norm_bounded(parts[0], self.bound, len(self.outputs), len(self.inputs))

    def draw(self, s: complex, generator: np.random.Generator | int) -> np.ndarray:
        generator = _checks.generator(generator, "generator")
        u, v = (generator.standard_normal(n) for n in (len(self.inputs), len(self.outputs)))
        return self.bound * np.outer(u / np.linalg.norm(u), v / np.linalg.norm(v))


@dataclass(frozen=True)
class Sector(Block):
    """p = φ(q, t) without memory in the sector [lower, upper]: (p − lower·q)(upper·q − p) ≥ 0.

    With `slope` φ is one function of q alone whose slope, too, lies in [lower, upper]; `odd` adds φ(−q) = −φ(q). Then
    causal Zames-Falb multipliers p̃ (λ v − Σ μᵢ Hᵢ v), p̃ = p − lower·q, v = (upper·q − p)/(upper − lower), with
    Σ|μᵢ| ≤ λ, and μᵢ ≥ 0 unless φ is odd (Zames & Falb, SIAM J. Control 6 (1968) 89-108). ∫ p̃ v(t − τ) ≤ ∫ p̃ v over
    every horizon, since p̃ is a monotone function of v and the integral of its potential is not negative.

    Parameters
    ----------
    lower, upper : float
        The sector's slopes.
    slope : bool
        φ is one function of q whose slope lies between them too.
    odd : bool
        φ(−q) = −φ(q).
    """

    lower: float = 0.0
    upper: float = 1.0
    slope: bool = False
    odd: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.inputs) != 1 or len(self.outputs) != 1:
            raise InputError("a sector is about one signal", got=f"{len(self.outputs)} and {len(self.inputs)}",
                             mend="one block for each, or Lipschitz")
        if not _checks.real(self.lower, "lower") < _checks.real(self.upper, "upper"):
            raise InputError("a sector's lower bound lies below its upper one", got=f"{self.lower} and {self.upper}")

    def filter(self, poles: Sequence[float], sample_time: float | None) -> Matrices:
        a, b, c, _ = bank(poles if self.slope else (), sample_time)
        k, v = len(a), self._rows()[1]
        return a, b @ v, np.vstack([np.zeros((2, k)), c[1:]]), np.vstack([np.eye(2), np.zeros((k, 2))])

    def unknowns(self, poles: Sequence[float]) -> tuple[tuple[str, int], ...]:
        return ((PSD, 1),) * (1 + (2 if self.odd else 1) * (len(poles) if self.slope else 0))

    def multiplier(self, parts: Sequence[Affine], poles: Sequence[float]) -> Affine:
        k = len(poles) if self.slope else 0
        p, v = (np.hstack([row, np.zeros((1, k))]) for row in self._rows())
        total = parts[0].times(p.T @ v + v.T @ p)
        for i, part in enumerate(parts[1:]):
            past = np.eye(2 + k)[2 + i % k][None]
            for sign, row in ((1.0, v), (-1.0 if i < k else 1.0, past)):
                total = total + part.times(sign * (p.T @ row + row.T @ p))
        return total

    def draw(self, s: complex, generator: np.random.Generator | int) -> np.ndarray:
        generator = _checks.generator(generator, "generator")
        between = generator.uniform(self.lower, self.upper)
        return np.array([[float(generator.choice([self.lower, self.upper, between]))]])

    def _rows(self) -> tuple[np.ndarray, np.ndarray]:
        """p̃ and v as rows over (q, p)."""
        width = self.upper - self.lower
        return np.array([[-self.lower, 1.0]]), np.array([[self.upper / width, -1.0 / width]])


@dataclass(frozen=True)
class Delay(Block):
    """p(t) = q(t − τ) with an unknown constant delay 0 ≤ τ ≤ longest [s]; in continuous time.

    Of e = p − q: ‖e‖ ≤ 2‖q‖ and, since e = −∫ q̇ over the delay, ‖e‖ ≤ longest·‖q̇‖, both with filters before and after:
    4 H q against H e with S₁, longest² s H̃ q against H̃ e with S₂, H̃ the strictly proper ones among H.

    Parameters
    ----------
    longest : float
        Largest delay [s].
    """

    longest: float = 0.0
    follows: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        self._square()
        _checks.positive(self.longest, "the longest delay", "s")

    def filter(self, poles: Sequence[float], sample_time: float | None) -> Matrices:
        if sample_time is not None:
            raise InputError("an uncertain delay is stated in continuous time", got=f"a period of {sample_time:g} s",
                             mend="a known one in discrete time is exact: lpv.delay")
        m = len(self.inputs)
        filters = bank(poles, None)
        a, b, c, d = filters
        slow = a, b, (c @ a)[1:], (c @ b)[1:]                       # s H̃: C A x + C B u
        plain = a, b, c[1:], d[1:]
        eye, zero = np.eye(m), np.zeros((m, m))
        rows = [(filters, np.hstack([eye, zero])), (filters, np.hstack([-eye, eye])), (slow, np.hstack([eye, zero])),
                (plain, np.hstack([-eye, eye]))]
        return _stacked([(_repeated(f, m), into) for f, into in rows])

    def unknowns(self, poles: Sequence[float]) -> tuple[tuple[str, int], ...]:
        if not poles:
            raise InputError("a delay needs at least one pole of the filters", got="none")
        return (PSD, 1 + len(poles)), (PSD, len(poles))

    def multiplier(self, parts: Sequence[Affine], poles: Sequence[float]) -> Affine:
        m = len(self.inputs)
        return block_diagonal([_norm_bounded(s, b, m, m) for s, b in zip(parts, (2.0, self.longest), strict=True)])

    def draw(self, s: complex, generator: np.random.Generator | int) -> np.ndarray:
        generator = _checks.generator(generator, "generator")
        tau = self.longest * float(generator.choice([0.0, 1.0, generator.uniform(0, 1)]))
        return np.exp(-s * tau) * np.eye(len(self.inputs))


KINDS: Mapping[str, type[Block]] = {c.__name__: c for c in (Parametric, Dynamic, Lipschitz, Sector, Delay)}


def block_from_dict(data: Mapping) -> Block:
    """Inverse of `Block.to_dict`.

    Parameters
    ----------
    data : mapping
        What `Block.to_dict` returned.

    Returns
    -------
    Block
        The same block.
    """
    kind = KINDS[_checks.known_name(data["kind"], list(KINDS), "kind of uncertainty")]
    return kind(**{k: v for k, v in data.items() if k != "kind"})


def bank(poles: Sequence[float], sample_time: float | None) -> Matrices:
    """(1, a/(s + a), …) of one signal, in discrete time (1, (1 − α)/(z − α), …).

    Parameters
    ----------
    poles : sequence of float
        a [1/s].
    sample_time : float or None
        Period [s].

    Returns
    -------
    tuple of arrays
        A, B, C, D.
    """
    a = np.asarray(poles, dtype=float)
    if sample_time is not None:
        a = np.exp(-a * sample_time)
    n = len(a)
    into = a if sample_time is None else 1 - a
    return (np.diag(-a if sample_time is None else a), into[:, None], np.vstack([np.zeros((1, n)), np.eye(n)]),
            np.vstack([np.ones((1, 1)), np.zeros((n, 1))]))


def _repeated(f: Matrices, m: int) -> Matrices:
    """The filter for each of m signals; outputs by filter first."""
    a, b, c, d = (np.kron(x, np.eye(m)) for x in f)
    return a, b, c, d


def _both(f: Matrices, nq: int, np_: int) -> Matrices:
    return _stacked([(_repeated(f, nq), np.eye(nq, nq + np_)), (_repeated(f, np_), np.eye(np_, nq + np_, nq))])


def _stacked(parts: Sequence[tuple[Matrices, np.ndarray]]) -> Matrices:
    """Filters one above the other, each with its own reading of (q, p)."""
    a, c = (diagonal(*(f[i] for f, _ in parts)) for i in (0, 2))
    b, d = (np.vstack([f[i] @ into for f, into in parts]) for i in (1, 3))
    return a, b, c, d


def _norm_bounded(s: Affine, bound: float, nq: int, np_: int) -> Affine:
    """diag(b² S⊗I, −S⊗I)."""
    return block_diagonal([bound**2 * _spread(s, nq), -_spread(s, np_)])


def _spread(s: Affine, m: int) -> Affine:
    """S⊗I."""
    parts = (np.kron(np.eye(s.shape[0]), e[:, None]) for e in np.eye(m))
    return reduce(add, (into @ s @ into.T for into in parts))
