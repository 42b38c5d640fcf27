"""Sums and products of functions given over different bases, written over one basis without error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.scheduling._families import BasisFamily, FourierFamily, PolynomialFamily, SplineFamily
from lpvid.scheduling.basis import Basis
from lpvid.scheduling.polynomial import Polynomial
from lpvid.scheduling.product import Product
from lpvid.scheduling.stacked import Stacked

ONE = Polynomial((), 0)
"""The basis of what does not move."""
FAMILIES: tuple[BasisFamily, ...] = (PolynomialFamily(), FourierFamily(), SplineFamily())
"""Bases that are closed under sum and product; a new one adds its line here."""


def common(first: Basis, second: Basis) -> tuple[Basis, np.ndarray, np.ndarray]:
    """A basis that spans both, and the maps into it: φ = E χ for the first, ψ = F χ for the second.

    Polynomials become one polynomial over all their variables, in the normalisation of the first, Fourier bases of one
    period the one of more harmonics; what has no closed form stands side by side in a `Stacked`.

    Parameters
    ----------
    first, second : Basis
        Of any variables.

    Returns
    -------
    Basis
        M functions χ.
    (M_first, M) and (M_second, M) arrays

    Examples
    --------
    >>> basis, _, into = common(Polynomial("p", 1), Polynomial("q", 1))
    >>> basis.labels, into.tolist()
    (('1', 'p', 'q'), [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    """
    if first == second:
        return first, np.eye(first.size), np.eye(first.size)
    if first == ONE and (one := second.unity) is not None:
        return second, one[None], np.eye(second.size)
    if second == ONE and (one := first.unity) is not None:
        return first, np.eye(first.size), one[None]
    kept: list[Basis] = []
    places: list[list[tuple[int, np.ndarray]]] = [[], []]  # for each side: (atom in kept, map into it)
    for side, basis in enumerate((first, second)):
        for atom in atoms(basis):
            i, merged = next(((i, m) for i, k in enumerate(kept) if (m := _joined(k, atom)) is not None),
                             (len(kept), None))
            if merged is None:
                kept.append(atom)
                places[side].append((i, np.eye(atom.size)))
                continue
            kept[i], old, new = merged
            places = [[(j, e @ old if j == i else e) for j, e in entries] for entries in places]
            places[side].append((i, new))
    starts = np.concatenate([[0], np.cumsum([k.size for k in kept])])
    maps = []
    for entries in places:
        out = np.zeros((sum(len(e) for _, e in entries), starts[-1]))
        row = 0
        for i, e in entries:
            out[row : row + len(e), starts[i] : starts[i + 1]] = e
            row += len(e)
        maps.append(out)
    return kept[0] if len(kept) == 1 else Stacked(tuple(kept)), maps[0], maps[1]


def products(first: Basis, second: Basis) -> tuple[Basis, np.ndarray]:
    """A basis that spans all products φ_i ψ_j, and their coefficients over it.

    Polynomials multiply to a polynomial, Fourier bases of one period to one, splines of one variable to a spline on the
    knots of both; other pairs to a `Product`.

    Parameters
    ----------
    first, second : Basis
        Of any variables.

    Returns
    -------
    Basis
        M functions χ.
    (M_first, M_second, M) array
        φ_i ψ_j = Σ_m T[i, j, m] χ_m.

    Examples
    --------
    >>> basis, table = products(Polynomial("p", 1), Polynomial("p", 1))
    >>> basis.labels, table[1, 1].tolist()
    (('1', 'p', 'p^2'), [0.0, 0.0, 1.0])
    """
    whole: Basis | None = None
    tables: list[list[np.ndarray]] = []
    for a in atoms(first):
        tables.append([])
        for b in atoms(second):
            basis, table = _atom_product(a, b)
            if whole is None:
                whole = basis
            else:
                whole, old, new = common(whole, basis)
                tables = [[t @ old for t in row] for row in tables]
                table = table @ new
            tables[-1].append(table)
    assert whole is not None
    return whole, np.concatenate([np.concatenate(row, axis=1) for row in tables], axis=0)


def atoms(basis: Basis) -> list[Basis]:
    """The bases that are stacked in one, in order; the basis itself if it is no stack.

    Parameters
    ----------
    basis : Basis

    Returns
    -------
    list of Basis
        None of them a `Stacked`.
    """
    return [a for f in basis.factors for a in atoms(f)] if isinstance(basis, Stacked) else [basis]


def _factors(atom: Basis) -> list[Basis]:
    return [f for g in atom.factors for f in _factors(g)] if isinstance(atom, Product) else [atom]


def _joined(a: Basis, b: Basis) -> tuple[Basis, np.ndarray, np.ndarray] | None:
    """A basis without stacks that spans both; products are joined factor by factor."""
    if a == b:
        return a, np.eye(a.size), np.eye(a.size)
    whole = next((m for f in FAMILIES if (m := f.joined(a, b)) is not None), None)
    if whole is not None or not (isinstance(a, Product) and isinstance(b, Product)):
        return whole
    first, second = _joined(a.first, b.first), _joined(a.second, b.second)
    if first is None or second is None:
        return None
    return Product(first[0], second[0]), np.kron(first[1], second[1]), np.kron(first[2], second[2])


@dataclass(frozen=True, eq=False)
class _Factor:
    """A factor of a product with its (M_a, M_b, M) table, and its places among the factors of both sides."""

    basis: Basis
    table: np.ndarray
    left: int | None
    right: int | None


def _multiplied(a: Basis, b: Basis) -> tuple[Basis, np.ndarray] | None:
    return next((m for f in FAMILIES if (m := f.multiplied(a, b)) is not None), None)


def _atom_product(a: Basis, b: Basis) -> tuple[Basis, np.ndarray]:
    """Product of two bases that are no stacks: matching factors multiply, the others stand in a `Product`."""
    if b == ONE:
        return a, np.eye(a.size)[:, None, :]
    if a == ONE:
        return b, np.eye(b.size)[None]
    whole = _multiplied(a, b)
    if whole is not None:
        return whole
    kept = [_Factor(f, np.eye(f.size)[:, None, :], k, None) for k, f in enumerate(_factors(a))]
    for k, factor in enumerate(_factors(b)):
        found = next(((i, m) for i, f in enumerate(kept)
                      if f.right is None and (m := _multiplied(f.basis, factor)) is not None), None)
        if found is None:
            kept.append(_Factor(factor, np.eye(factor.size)[None], None, k))
        else:
            kept[found[0]] = _Factor(*found[1], kept[found[0]].left, k)
    return _tensor(sorted(kept, key=lambda f: (type(f.basis).__name__, f.basis.names)), a.size, b.size)


def _tensor(kept: list[_Factor], rows: int, columns: int) -> tuple[Basis, np.ndarray]:
    """One `Product` of factors in a fixed order, whichever side they came from."""
    basis, table = kept[0].basis, kept[0].table
    for f in kept[1:]:
        basis = Product(basis, f.basis)
        table = np.einsum("...m,cdn->...cdmn", table, f.table).reshape(*table.shape[:-1], *f.table.shape[:2], -1)
    n = len(kept)
    left = [2 * i for _, i in sorted((-1 if f.left is None else f.left, i) for i, f in enumerate(kept))]
    right = [2 * i + 1 for _, i in sorted((-1 if f.right is None else f.right, i) for i, f in enumerate(kept))]
    return basis, table.transpose([*left, *right, 2 * n]).reshape(rows, columns, -1)
