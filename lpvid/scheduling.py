"""Scheduling variables, and the bases in which coefficients depend on them."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError


@dataclass(frozen=True)
class Scheduling:
    """Named scheduling variables with the box they live in and how fast they may move.

    Parameters
    ----------
    names : tuple of str
        Channel names; empty for a time-invariant model.
    lower, upper : tuple of float
        Box, in the variables' SI units.
    rate : tuple of (float or None), optional
        Bound on |dp/dt| in units per second; None leaves the variation arbitrary.
    units : tuple of str, optional
        SI units, for printing.

    Examples
    --------
    >>> current = Scheduling(("current",), (0.0,), (2.5,), rate=(100.0,), units=("A",))
    >>> current.contains(np.array([[1.0], [3.0]]))
    array([ True, False])
    """

    names: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    rate: tuple[float | None, ...] = ()
    units: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n = len(self.names)
        set_ = object.__setattr__
        set_(self, "names", tuple(self.names))
        set_(self, "lower", tuple(_checks.real(v, "a lower scheduling bound") for v in self.lower))
        set_(self, "upper", tuple(_checks.real(v, "an upper scheduling bound") for v in self.upper))
        set_(self, "rate", tuple(self.rate) or (None,) * n)
        set_(self, "units", tuple(self.units) or ("",) * n)
        if not len(self.lower) == len(self.upper) == len(self.rate) == len(self.units) == n:
            raise InputError("scheduling needs one lower, upper, rate and unit for each name", got=self)
        for name, low, high in zip(self.names, self.lower, self.upper, strict=True):
            if low > high:
                raise InputError(f"scheduling variable '{name}': lower bound above the upper", got=f"{low} > {high}")
        for name, rate in zip(self.names, self.rate, strict=True):
            if rate is not None and _checks.real(rate, f"the rate bound of '{name}'") < 0:
                raise InputError(f"the rate bound of '{name}' must not be negative", got=rate)
        if len(set(self.names)) < n:
            raise InputError("scheduling names a variable twice", got=", ".join(self.names))

    @classmethod
    def of(cls, names: Sequence[str], p: np.ndarray, units: Sequence[str] = ()) -> Scheduling:
        """The smallest box around samples `p` of shape (n, len(names))."""
        return cls(tuple(names), tuple(p.min(axis=0)), tuple(p.max(axis=0)), units=tuple(units))

    @property
    def centre(self) -> np.ndarray:
        """(len(names),) middle of the box."""
        return 0.5 * (np.array(self.lower) + np.array(self.upper))

    @property
    def half_width(self) -> np.ndarray:
        """(len(names),) half the box."""
        return 0.5 * (np.array(self.upper) - np.array(self.lower))

    def contains(self, p: np.ndarray, *, tolerance: float = 1e-9) -> np.ndarray:
        """(n,) bool: which samples of `p` (n, len(names)) lie in the box, within `tolerance` of its width."""
        slack = tolerance * np.maximum(self.half_width, 1e-300)
        return np.all((p >= np.array(self.lower) - slack) & (p <= np.array(self.upper) + slack), axis=1)

    def grid(self, points: int) -> np.ndarray:
        """(points**len(names), len(names)) tensor grid over the box."""
        axes = [np.linspace(lo, up, points) for lo, up in zip(self.lower, self.upper, strict=True)]
        return np.array(list(itertools.product(*axes))) if axes else np.empty((1, 0))

    def to_dict(self) -> dict:
        """Plain data for JSON."""
        return {"names": list(self.names), "lower": list(self.lower), "upper": list(self.upper),
                "rate": list(self.rate), "units": list(self.units)}

    @classmethod
    def from_dict(cls, data: Mapping) -> Scheduling:
        """Inverse of `to_dict`."""
        return cls(*(tuple(data[k]) for k in ("names", "lower", "upper", "rate", "units")))


class Basis(ABC):
    """Functions φ_1(p) … φ_M(p) of the scheduling variables, in physical units outside, normalised inside.

    A basis is bound to a box by `bound`; unbound it takes p as it is.
    """

    names: tuple[str, ...]

    @property
    @abstractmethod
    def size(self) -> int:
        """Number M of functions."""

    @property
    @abstractmethod
    def labels(self) -> tuple[str, ...]:
        """A short name of every function."""

    @property
    @abstractmethod
    def degree(self) -> int | None:
        """Polynomial degree in p along any straight line, or None for a basis that is not polynomial."""

    @property
    @abstractmethod
    def lags(self) -> tuple[int, int]:
        """Smallest and largest delay, in samples, at which p is read; (0, 0) for p(k) alone."""

    @abstractmethod
    def evaluate(self, p: np.ndarray) -> np.ndarray:
        """(n, M) values along a trajectory `p` of shape (n, len(names)); beyond its ends the end values hold."""

    @abstractmethod
    def derivative(self, p: np.ndarray, name: str) -> np.ndarray:
        """(n, M) partial derivatives with respect to one variable, per physical unit."""

    @abstractmethod
    def bound(self, box: Scheduling) -> Basis:
        """The same basis, normalised to a box that names its variables."""

    @abstractmethod
    def to_dict(self) -> dict:
        """Plain data for JSON."""

    @property
    def redundant(self) -> int | None:
        """Index of a function to drop where a second copy of the constant would make regressors dependent."""
        return 0


def _normalisation(names: tuple[str, ...], box: Scheduling) -> tuple[tuple[float, ...], tuple[float, ...]]:
    index = [box.names.index(_checks.known_name(n, box.names, "scheduling variable")) for n in names]
    half = box.half_width[index]
    return tuple(box.centre[index].tolist()), tuple(np.where(half > 0, half, 1.0).tolist())


@dataclass(frozen=True)
class Polynomial(Basis):
    """Monomials z_1^e_1 z_2^e_2 … of total degree up to `degree`, with z = (p − centre)/half_width.

    Díaz Salas 2011 (3.7) has one variable and a_i(p) = Σ_j a_ij p^j; several variables come with their products.

    Parameters
    ----------
    names : str or sequence of str
        Scheduling variables; empty for the constant alone.
    degree : int
        Highest total degree.
    centre, half_width : tuple of float, optional
        Normalisation; left out, z = p.

    Examples
    --------
    >>> Polynomial("current", degree=2).evaluate(np.array([[2.0]]))
    array([[1., 2., 4.]])
    >>> Polynomial(("p", "q"), degree=2).labels
    ('1', 'p', 'q', 'p^2', 'p*q', 'q^2')
    """

    names: tuple[str, ...] = ()
    degree: int = 1  # type: ignore[assignment]
    centre: tuple[float, ...] = ()
    half_width: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        names = _checks.names(self.names, "a polynomial basis") if self.names else ()
        set_ = object.__setattr__
        set_(self, "names", names)
        set_(self, "degree", _checks.count(self.degree, "the degree of a polynomial basis"))
        set_(self, "centre", tuple(self.centre) or (0.0,) * len(names))
        set_(self, "half_width", tuple(self.half_width) or (1.0,) * len(names))
        if not names:
            set_(self, "degree", 0)
        if not len(self.centre) == len(self.half_width) == len(names) or not all(h > 0 for h in self.half_width):
            raise InputError("a polynomial basis needs one centre and one positive half width for each variable",
                             got=f"{self.centre} and {self.half_width}")

    @cached_property
    def exponents(self) -> np.ndarray:
        """(M, len(names)) exponent of each variable in each function, by rising total degree."""
        rows = [e for total in range(self.degree + 1) for e in _exponents(len(self.names), total)]
        return np.array(rows, dtype=int).reshape(len(rows), len(self.names))

    @property
    def size(self) -> int:
        return len(self.exponents)

    @property
    def labels(self) -> tuple[str, ...]:
        def label(row: np.ndarray) -> str:
            parts = [n if e == 1 else f"{n}^{e}" for n, e in zip(self.names, row, strict=True) if e]
            return "*".join(parts) or "1"

        return tuple(label(row) for row in self.exponents)

    @property
    def lags(self) -> tuple[int, int]:
        return (0, 0)

    def _normalised(self, p: np.ndarray) -> np.ndarray:
        return (np.asarray(p, dtype=float) - np.array(self.centre)) / np.array(self.half_width)

    def _powers(self, z: np.ndarray, exponents: np.ndarray) -> np.ndarray:
        values = np.empty((exponents.shape[0], z.shape[0]))  # one contiguous row per function
        fresh = np.ones(exponents.shape[0], dtype=bool)
        for column in range(z.shape[1]):
            base = np.ascontiguousarray(z[:, column])
            power = base
            for e in range(1, int(exponents[:, column].max(initial=0)) + 1):
                power = base if e == 1 else power * base
                for row in np.flatnonzero(exponents[:, column] == e):
                    if fresh[row]:
                        values[row], fresh[row] = power, False
                    else:
                        values[row] *= power
        values[fresh] = 1.0
        return values.T

    def evaluate(self, p: np.ndarray) -> np.ndarray:
        return self._powers(self._normalised(p), self.exponents)

    def derivative(self, p: np.ndarray, name: str) -> np.ndarray:
        column = self.names.index(_checks.known_name(name, self.names, "scheduling variable"))
        lowered = self.exponents.copy()
        factor = lowered[:, column] / self.half_width[column]
        lowered[:, column] = np.maximum(lowered[:, column] - 1, 0)
        return self._powers(self._normalised(p), lowered) * factor

    def bound(self, box: Scheduling) -> Polynomial:
        centre, half = _normalisation(self.names, box)
        return replace(self, centre=centre, half_width=half)

    def to_dict(self) -> dict:
        return {"kind": "polynomial", "names": list(self.names), "degree": self.degree,
                "centre": list(self.centre), "half_width": list(self.half_width)}


def _exponents(variables: int, total: int) -> list[tuple[int, ...]]:
    if variables == 0:
        return [()] if total == 0 else []
    if variables == 1:
        return [(total,)]
    return [(first, *rest) for first in range(total, -1, -1) for rest in _exponents(variables - 1, total - first)]


@dataclass(frozen=True)
class Spline(Basis):
    """B-splines of one scheduling variable on equal segments of its box; degree 1 interpolates a grid linearly.

    Outside the box the end value holds (and validation counts the share of samples out there).

    Parameters
    ----------
    name : str
        Scheduling variable.
    segments : int
        Number of polynomial pieces.
    order : int
        Degree of each piece, 1 to 5.
    knots : tuple of float, optional
        Breakpoints in physical units, ``segments + 1`` of them; left out, equal pieces of the bound box.

    Examples
    --------
    >>> Spline("current", segments=2, order=1, knots=(0.0, 1.0, 2.0)).evaluate(np.array([[0.5]]))
    array([[0.5, 0.5, 0. ]])
    """

    name: str
    segments: int = 3
    order: int = 3
    knots: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        _checks.count(self.segments, "segments of a spline", at_least=1)
        if not 1 <= _checks.count(self.order, "order of a spline") <= 5:
            raise InputError("the order of a spline must lie between 1 and 5", got=self.order)
        if self.knots and (len(self.knots) != self.segments + 1 or np.any(np.diff(self.knots) <= 0)):
            raise InputError("a spline needs segments + 1 rising knots", got=self.knots)
        object.__setattr__(self, "knots", tuple(float(k) for k in self.knots))

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        return (self.name,)

    @property
    def size(self) -> int:
        return self.segments + self.order

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(f"B{i}({self.name})" for i in range(self.size))

    @property
    def degree(self) -> None:  # type: ignore[override]
        return None

    @property
    def lags(self) -> tuple[int, int]:
        return (0, 0)

    def _full_knots(self) -> np.ndarray:
        if not self.knots:
            raise InputError(f"the spline in '{self.name}' has no knots yet", mend="bind it to a box with .bound(box)")
        k = np.array(self.knots)
        return np.concatenate([np.repeat(k[0], self.order), k, np.repeat(k[-1], self.order)])

    def evaluate(self, p: np.ndarray) -> np.ndarray:
        from scipy.interpolate import BSpline

        knots = self._full_knots()
        inside = np.clip(np.asarray(p, dtype=float)[:, 0], knots[0], knots[-1])
        return BSpline.design_matrix(inside, knots, self.order).toarray()

    def derivative(self, p: np.ndarray, name: str) -> np.ndarray:
        from scipy.interpolate import BSpline

        _checks.known_name(name, self.names, "scheduling variable")
        knots = self._full_knots()
        values = np.asarray(p, dtype=float)[:, 0]
        inside = (values >= knots[0]) & (values <= knots[-1])
        slope = BSpline(knots, np.eye(self.size), self.order).derivative()(np.clip(values, knots[0], knots[-1]))
        return np.where(inside[:, None], slope, 0.0)

    def bound(self, box: Scheduling) -> Spline:
        if self.knots:
            return self
        i = box.names.index(_checks.known_name(self.name, box.names, "scheduling variable"))
        if not box.upper[i] > box.lower[i]:
            raise InputError(f"a spline needs '{self.name}' to move", got=f"the constant {box.lower[i]}")
        return replace(self, knots=tuple(np.linspace(box.lower[i], box.upper[i], self.segments + 1)))

    def to_dict(self) -> dict:
        return {"kind": "spline", "name": self.name, "segments": self.segments, "order": self.order,
                "knots": list(self.knots)}


class _Composite(Basis):
    """Several bases over the union of their variables."""

    factors: tuple[Basis, ...]

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        return tuple(dict.fromkeys(n for f in self.factors for n in f.names))

    @property
    def lags(self) -> tuple[int, int]:
        pairs = [f.lags for f in self.factors]
        return min(p[0] for p in pairs), max(p[1] for p in pairs)

    def _columns(self, factor: Basis, p: np.ndarray) -> np.ndarray:
        return np.asarray(p, dtype=float)[:, [self.names.index(n) for n in factor.names]]

    def _slope(self, factor: Basis, p: np.ndarray, name: str) -> np.ndarray:
        columns = self._columns(factor, p)
        return factor.derivative(columns, name) if name in factor.names else np.zeros((columns.shape[0], factor.size))


@dataclass(frozen=True)
class Product(_Composite):
    """All products φ_i(p)·ψ_j(q) of two bases: a tensor grid over several scheduling variables.

    Examples
    --------
    >>> Product(Polynomial("p", degree=1), Polynomial("q", degree=1)).labels
    ('1', 'q', 'p', 'p*q')
    """

    first: Basis
    second: Basis

    @property
    def factors(self) -> tuple[Basis, ...]:  # type: ignore[override]
        return (self.first, self.second)

    @property
    def size(self) -> int:
        return self.first.size * self.second.size

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple("*".join(x for x in (a, b) if x != "1") or "1"
                     for a in self.first.labels for b in self.second.labels)

    @property
    def degree(self) -> int | None:  # type: ignore[override]
        first, second = self.first.degree, self.second.degree
        return None if first is None or second is None else first + second

    def _outer(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.einsum("ni,nj->nij", a, b).reshape(a.shape[0], -1)

    def evaluate(self, p: np.ndarray) -> np.ndarray:
        return self._outer(*(f.evaluate(self._columns(f, p)) for f in self.factors))

    def derivative(self, p: np.ndarray, name: str) -> np.ndarray:
        _checks.known_name(name, self.names, "scheduling variable")
        a, b = (f.evaluate(self._columns(f, p)) for f in self.factors)
        return self._outer(self._slope(self.first, p, name), b) + self._outer(a, self._slope(self.second, p, name))

    def bound(self, box: Scheduling) -> Product:
        return Product(self.first.bound(box), self.second.bound(box))

    def to_dict(self) -> dict:
        return {"kind": "product", "first": self.first.to_dict(), "second": self.second.to_dict()}


@dataclass(frozen=True)
class Stacked(_Composite):
    """The functions of several bases side by side (realisations that read p at several times need this).

    Examples
    --------
    >>> Stacked((Polynomial("p", degree=1), Shifted(Polynomial("p", degree=1), 1))).labels
    ('1', 'p', '1', 'p(k-1)')
    """

    factors: tuple[Basis, ...]  # type: ignore[assignment]

    @property
    def size(self) -> int:
        return sum(f.size for f in self.factors)

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(label for f in self.factors for label in f.labels)

    @property
    def degree(self) -> int | None:  # type: ignore[override]
        degrees = [f.degree for f in self.factors]
        known = [d for d in degrees if d is not None]
        return max(known) if len(known) == len(degrees) else None

    def evaluate(self, p: np.ndarray) -> np.ndarray:
        return np.hstack([f.evaluate(self._columns(f, p)) for f in self.factors])

    def derivative(self, p: np.ndarray, name: str) -> np.ndarray:
        _checks.known_name(name, self.names, "scheduling variable")
        return np.hstack([self._slope(f, p, name) for f in self.factors])

    def bound(self, box: Scheduling) -> Stacked:
        return Stacked(tuple(f.bound(box) for f in self.factors))

    @property
    def redundant(self) -> int | None:
        return None

    def to_dict(self) -> dict:
        return {"kind": "stacked", "factors": [f.to_dict() for f in self.factors]}


@dataclass(frozen=True)
class Shifted(Basis):
    """The same functions of p(k − lag): dynamic dependence; a negative lag reads future p.

    Examples
    --------
    >>> Shifted(Polynomial("p", degree=1), 1).evaluate(np.array([[1.0], [2.0], [3.0]]))
    array([[1., 1.], [1., 1.], [1., 2.]])
    """

    basis: Basis
    lag: int

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        return self.basis.names

    @property
    def size(self) -> int:
        return self.basis.size

    @property
    def labels(self) -> tuple[str, ...]:
        return tuple(x if x == "1" or not self.lag else f"{x}(k{-self.lag:+d})" for x in self.basis.labels)

    @property
    def degree(self) -> int | None:  # type: ignore[override]
        return self.basis.degree

    @property
    def lags(self) -> tuple[int, int]:
        low, high = self.basis.lags
        return low + self.lag, high + self.lag

    def _moved(self, p: np.ndarray) -> np.ndarray:
        n = np.asarray(p).shape[0]
        return np.asarray(p, dtype=float)[np.clip(np.arange(n) - self.lag, 0, max(n - 1, 0))]

    def evaluate(self, p: np.ndarray) -> np.ndarray:
        return self.basis.evaluate(self._moved(p))

    def derivative(self, p: np.ndarray, name: str) -> np.ndarray:
        return self.basis.derivative(self._moved(p), name)

    def bound(self, box: Scheduling) -> Shifted:
        return Shifted(self.basis.bound(box), self.lag)

    @property
    def redundant(self) -> int | None:
        return self.basis.redundant

    def to_dict(self) -> dict:
        return {"kind": "shifted", "basis": self.basis.to_dict(), "lag": self.lag}


def basis_from_dict(data: Mapping) -> Basis:
    """Rebuild a basis from `Basis.to_dict`."""
    kind = data.get("kind")
    if kind == "polynomial":
        return Polynomial(tuple(data["names"]), data["degree"], tuple(data["centre"]), tuple(data["half_width"]))
    if kind == "spline":
        return Spline(data["name"], data["segments"], data["order"], tuple(data["knots"]))
    if kind == "product":
        return Product(basis_from_dict(data["first"]), basis_from_dict(data["second"]))
    if kind == "stacked":
        return Stacked(tuple(basis_from_dict(f) for f in data["factors"]))
    if kind == "shifted":
        return Shifted(basis_from_dict(data["basis"]), data["lag"])
    raise InputError("unknown basis in a model file", got=kind)
