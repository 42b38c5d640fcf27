"""Matrices under construction whose entries depend on the scheduling through several bases at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from lpvid.errors import InputError
from lpvid.scheduling import Basis, Polynomial, Product, Shifted, Stacked

Term = tuple[Basis, np.ndarray]
"""A basis with M functions, and coefficients of shape (…, M) over it."""


class Varying:
    """An array M(p) = Σ_b Σ_m parts[b][…, m] φ_m^b(p), filled entry by entry while a realisation is built.

    Parameters
    ----------
    *shape : int
        Shape of the array.
    """

    def __init__(self, *shape: int) -> None:
        self.shape = shape
        self.parts: dict[Basis, np.ndarray] = {}

    def add(self, where: object, term: Term, factor: float = 1.0) -> None:
        """Add ``factor`` times a term into the entries at `where` (any index of the array).

        Parameters
        ----------
        where : index
            Of one or several entries.
        term : (Basis, (…, M) array)
            Shaped like what stands at `where`, with the functions last.
        factor : float
        """
        basis, coefficients = term
        if basis not in self.parts:
            self.parts[basis] = np.zeros((*self.shape, basis.size))
        self.parts[basis][where] += factor * coefficients  # type: ignore[index]

    def __iter__(self) -> Iterator[Term]:
        return iter(self.parts.items())


def unity(basis: Basis) -> np.ndarray:
    """(M,) coefficients with which the functions of a basis add up to the constant 1.

    Parameters
    ----------
    basis : Basis

    Returns
    -------
    (M,) array

    Raises
    ------
    InputError
        A basis of which that is not known.
    """
    one = basis.unity
    if one is not None:
        return one
    raise InputError(f"basis {type(basis).__name__} does not state how its functions add up to 1",
                     why="a realisation has entries that do not move",
                     mend="put it beside a polynomial in Stacked, or write its property `unity`")


def constant(basis: Basis, matrix: np.ndarray) -> Term:
    """A matrix that does not move, written over a basis.

    Parameters
    ----------
    basis : Basis
        One that holds the constant.
    matrix : array
        Of any shape.

    Returns
    -------
    (Basis, (…, M) array)
    """
    return basis, np.asarray(matrix, dtype=float)[..., None] * unity(basis)


def constant_part(term: Term) -> np.ndarray | None:
    """The matrix a term stands for if it does not depend on the scheduling, else None.

    Parameters
    ----------
    term : (Basis, (…, M) array)

    Returns
    -------
    array or None
    """
    basis, coefficients = term
    one = unity(basis)
    pivot = int(np.argmax(one))
    level = coefficients[..., pivot] / one[pivot]
    return level if np.array_equal(coefficients, level[..., None] * one) else None


def at(basis: Basis, coefficients: np.ndarray, lag: int) -> Term:
    """Coefficients taken at p(k − lag); what does not move stays with the basis itself.

    Parameters
    ----------
    basis : Basis
    coefficients : (…, M) array
    lag : int
        [samples]; negative reads future p.

    Returns
    -------
    (Basis, (…, M) array)
    """
    if lag == 0 or not basis.names or constant_part((basis, coefficients)) is not None:
        return basis, coefficients
    return basis.shifted(lag), coefficients


def product(left: Term, right: Term) -> Term:
    """Matrix product of two terms, of shapes (q, r) and (r, s) or (r,).

    Polynomials of the same variables at the same time give a polynomial of the summed degree (no higher than needed);
    other pairs give all products of their functions.

    Parameters
    ----------
    left : (Basis, (q, r, M) array)
    right : (Basis, (r, s, N) or (r, N) array)

    Returns
    -------
    (Basis, (q, s, K) or (q, K) array)
    """
    (first, x), (second, y) = left, right
    still_x, still_y = constant_part(left), constant_part(right)
    if still_x is not None:
        return second, np.einsum("ij,j...->i...", still_x, y)
    if still_y is not None:
        return first, np.einsum("ijm,j...->i...m", x, still_y)
    pairs = np.einsum("ijm,j...n->i...mn", x, y)
    (lag, plain_first), (other_lag, plain_second) = _unshifted(first), _unshifted(second)
    if (lag == other_lag and isinstance(plain_first, Polynomial) and isinstance(plain_second, Polynomial)
            and _family(plain_first) == _family(plain_second)):
        basis, coefficients = _polynomial_product(plain_first, plain_second, pairs)
        return basis.shifted(lag), coefficients
    return Product(first, second), pairs.reshape(*pairs.shape[:-2], -1)


def assemble(base: Basis, arrays: Mapping[str, Varying]) -> tuple[Basis, dict[str, np.ndarray]]:
    """One basis for all arrays, and each array as (M, …) coefficients over it.

    `base` comes first and always stays; a basis that no array needs is left out; polynomials of the same variables at
    the same time are merged into the one of the highest degree.

    Parameters
    ----------
    base : Basis
        That of the model.
    arrays : mapping of str to Varying

    Returns
    -------
    Basis
        M functions.
    dict of str to (M, …) array
    """
    needed = [b for v in arrays.values() for b, x in v if np.any(x)]
    terms = _merged([base, *dict.fromkeys(needed)])
    basis = terms[0] if len(terms) == 1 else Stacked(tuple(terms))
    firsts = np.concatenate([[0], np.cumsum([t.size for t in terms])])
    out = {}
    for name, varying in arrays.items():
        total = np.zeros((*varying.shape, basis.size))
        for b, x in varying:
            if np.any(x):
                first = firsts[next(i for i, t in enumerate(terms) if _covers(t, b))]
                total[..., first : first + b.size] += x
        out[name] = np.moveaxis(total, -1, 0)
    return basis, out


def _unshifted(basis: Basis) -> tuple[int, Basis]:
    return (basis.lag, basis.basis) if isinstance(basis, Shifted) else (0, basis)


def _family(basis: Polynomial) -> tuple:
    return basis.names, basis.centre, basis.half_width


def _covers(wide: Basis, basis: Basis) -> bool:
    """True when the functions of `basis` are the first ones of `wide` (monomials are listed by rising degree)."""
    if wide == basis:
        return True
    (lag, a), (other, b) = _unshifted(wide), _unshifted(basis)
    return (lag == other and isinstance(a, Polynomial) and isinstance(b, Polynomial) and _family(a) == _family(b)
            and a.degree >= b.degree)


def _merged(terms: Sequence[Basis]) -> list[Basis]:
    kept: list[Basis] = []
    for term in terms:
        place = next((i for i, t in enumerate(kept) if _covers(t, term) or _covers(term, t)), None)
        if place is None:
            kept.append(term)
        elif _covers(term, kept[place]):
            kept[place] = term
    return kept


def _polynomial_product(first: Polynomial, second: Polynomial, pairs: np.ndarray) -> Term:
    wide = replace(first, degree=first.degree + second.degree)
    place = {tuple(e): i for i, e in enumerate(wide.exponents.tolist())}
    coefficients = np.zeros((*pairs.shape[:-2], wide.size))
    for m, e in enumerate(first.exponents):
        for n, f in enumerate(second.exponents):
            coefficients[..., place[tuple((e + f).tolist())]] += pairs[..., m, n]
    used = np.flatnonzero(coefficients.any(axis=tuple(range(coefficients.ndim - 1))))
    highest = int(wide.exponents[used].sum(axis=1).max(initial=0))
    narrow = replace(first, degree=max(highest, first.degree, second.degree))
    return narrow, coefficients[..., : narrow.size]
