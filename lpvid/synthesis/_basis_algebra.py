"""Sums and products of functions given over different bases, written over one basis without error."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from lpvid.scheduling import Basis, Polynomial, Product, Shifted, Spline, Stacked

ONE = Polynomial((), 0)
"""The basis of what does not move."""


def unity(basis: Basis) -> np.ndarray | None:
    """(M,) coefficients with which the functions of a basis add up to 1; None if they do not."""
    if isinstance(basis, Polynomial):
        return np.eye(1, basis.size)[0]
    if isinstance(basis, Spline):
        return np.ones(basis.size)
    if isinstance(basis, Shifted):
        return unity(basis.basis)
    if isinstance(basis, Product):
        first, second = unity(basis.first), unity(basis.second)
        return None if first is None or second is None else np.kron(first, second)
    if isinstance(basis, Stacked):
        known = [unity(f) for f in basis.factors]
        place = next((i for i, one in enumerate(known) if one is not None), None)
        if place is not None:
            return np.concatenate([k if i == place else np.zeros(f.size)
                                   for i, (k, f) in enumerate(zip(known, basis.factors, strict=True))])  # type: ignore[misc]
    return None


def common(first: Basis, second: Basis) -> tuple[Basis, np.ndarray, np.ndarray]:
    """A basis that spans both, and the maps into it: φ = E χ for the first, ψ = F χ for the second.

    Polynomials become one polynomial over all their variables, in the normalisation of the first; what has no closed
    form stands side by side in a `Stacked`.

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
    if first == ONE and (one := unity(second)) is not None:
        return second, one[None], np.eye(second.size)
    if second == ONE and (one := unity(first)) is not None:
        return first, np.eye(first.size), one[None]
    kept: list[Basis] = []
    places: list[list[tuple[int, np.ndarray]]] = [[], []]  # for each side: (atom in kept, map into it)
    for side, basis in enumerate((first, second)):
        for atom in _atoms(basis):
            i = next((i for i, k in enumerate(kept) if _mergeable(k, atom)), len(kept))
            if i == len(kept):
                kept.append(atom)
                places[side].append((i, np.eye(atom.size)))
                continue
            kept[i], old, new = _merged(kept[i], atom)
            places = [[(j, e @ old if j == i else e) for j, e in side_places] for side_places in places]
            places[side].append((i, new))
    starts = np.concatenate([[0], np.cumsum([k.size for k in kept])])
    maps = []
    for side in places:
        rows = []
        for i, e in side:
            row = np.zeros((len(e), starts[-1]))
            row[:, starts[i] : starts[i + 1]] = e
            rows.append(row)
        maps.append(np.vstack(rows))
    return kept[0] if len(kept) == 1 else Stacked(tuple(kept)), maps[0], maps[1]


def products(first: Basis, second: Basis) -> tuple[Basis, np.ndarray]:
    """A basis that spans all products φ_i ψ_j, and their coefficients over it.

    Polynomials multiply to a polynomial; other pairs to a `Product`.

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
    for a in _atoms(first):
        tables.append([])
        for b in _atoms(second):
            basis, table = _atom_product(a, b)
            if whole is None:
                whole = basis
            else:
                whole, old, new = common(whole, basis)
                tables = [[t @ old for t in row] for row in tables]
                table = table @ new
            tables[-1].append(table)
    assert whole is not None
    width = whole.size
    full = [np.concatenate([_padded(t, width) for t in row], axis=1) for row in tables]
    return whole, np.concatenate(full, axis=0)


def _padded(table: np.ndarray, width: int) -> np.ndarray:
    return table if table.shape[2] == width else np.pad(table, ((0, 0), (0, 0), (0, width - table.shape[2])))


def _atoms(basis: Basis) -> list[Basis]:
    return [a for f in basis.factors for a in _atoms(f)] if isinstance(basis, Stacked) else [basis]


def _factors(atom: Basis) -> list[Basis]:
    return [f for g in atom.factors for f in _factors(g)] if isinstance(atom, Product) else [atom]


def _as_polynomial(basis: Basis) -> tuple[Polynomial, np.ndarray] | None:
    """A basis of polynomials as one polynomial, and its functions over that; None for any other basis."""
    if isinstance(basis, Polynomial):
        return basis, np.eye(basis.size)
    if not isinstance(basis, Product):
        return None
    first, second = _as_polynomial(basis.first), _as_polynomial(basis.second)
    if first is None or second is None:
        return None
    wide, table = _polynomial_product(first[0], second[0])
    return wide, np.einsum("ai,bj,ijm->abm", first[1], second[1], table).reshape(basis.size, wide.size)


def _mergeable(a: Basis, b: Basis) -> bool:
    return a == b or (_as_polynomial(a) is not None and _as_polynomial(b) is not None)


def _merged(a: Basis, b: Basis) -> tuple[Basis, np.ndarray, np.ndarray]:
    if a == b:
        return a, np.eye(a.size), np.eye(a.size)
    first, second = _as_polynomial(a), _as_polynomial(b)
    assert first is not None and second is not None
    wide = _wide(first[0], second[0], max(first[0].degree, second[0].degree))
    return wide, first[1] @ rewritten(first[0], wide), second[1] @ rewritten(second[0], wide)


def _wide(a: Polynomial, b: Polynomial, degree: int) -> Polynomial:
    """Polynomial of a degree over the variables of both, normalised as the first that names a variable."""
    extra = [i for i, n in enumerate(b.names) if n not in a.names]
    return Polynomial(a.names + tuple(b.names[i] for i in extra), degree, a.centre + tuple(b.centre[i] for i in extra),
                      a.half_width + tuple(b.half_width[i] for i in extra))


def rewritten(narrow: Polynomial, wide: Polynomial) -> np.ndarray:
    """(M_narrow, M_wide) the monomials of one polynomial basis over another with at least its variables and degree."""
    place = {tuple(e): i for i, e in enumerate(wide.exponents.tolist())}
    out = np.zeros((narrow.size, wide.size))
    for row, exponents in enumerate(narrow.exponents.tolist()):
        for key, value in _expanded(exponents, narrow, wide).items():
            out[row, place[key]] += value
    return out


def _expanded(exponents: list[int], narrow: Polynomial, wide: Polynomial) -> dict[tuple[int, ...], float]:
    """One monomial as a sum of others: each variable z becomes scale·z + shift."""
    terms = {(0,) * len(wide.names): 1.0}
    for j, power in enumerate(exponents):
        column = wide.names.index(narrow.names[j])
        scale = wide.half_width[column] / narrow.half_width[j]
        shift = (wide.centre[column] - narrow.centre[j]) / narrow.half_width[j]
        grown: dict[tuple[int, ...], float] = {}
        for key, value in terms.items():
            for e in range(power + 1):
                new = (*key[:column], key[column] + e, *key[column + 1 :])
                grown[new] = grown.get(new, 0.0) + value * math.comb(power, e) * scale**e * shift ** (power - e)
        terms = grown
    return {key: value for key, value in terms.items() if value}


def _atom_product(a: Basis, b: Basis) -> tuple[Basis, np.ndarray]:
    """Product of two bases that are no stacks: matching factors multiply, the others stand in a `Product`."""
    if b == ONE:
        return a, np.eye(a.size)[:, None, :]
    if a == ONE:
        return b, np.eye(b.size)[None]
    first, second = _as_polynomial(a), _as_polynomial(b)
    if first is not None and second is not None:
        wide, table = _polynomial_product(first[0], second[0])
        return wide, np.einsum("ai,bj,ijm->abm", first[1], second[1], table)
    kept: list[tuple[Basis, np.ndarray, int | None]] = [(f, np.eye(f.size)[:, None, :], None) for f in _factors(a)]
    for k, factor in enumerate(_factors(b)):
        i = next((i for i, (f, _, used) in enumerate(kept) if used is None and _multipliable(f, factor)), None)
        if i is None:
            kept.append((factor, np.eye(factor.size)[None], k))
        else:
            kept[i] = (*_factor_product(kept[i][0], factor), k)
    return _tensor(kept, a.size, b.size)


def _tensor(kept: list[tuple[Basis, np.ndarray, int | None]], rows: int, columns: int) -> tuple[Basis, np.ndarray]:
    """One `Product` of factors, each with its table and the place it takes among the second basis's factors."""
    basis, table, _ = kept[0]
    for other, t, _ in kept[1:]:
        basis = Product(basis, other)
        table = np.einsum("...m,cdn->...cdmn", table, t).reshape(*table.shape[:-1], *t.shape[:2], -1)
    n = len(kept)
    live = sorted((k, i) for i, (_, _, k) in enumerate(kept) if k is not None)
    rest = [i for i, (_, _, k) in enumerate(kept) if k is None]
    axes = [*(2 * i for i in range(n)), *(2 * i + 1 for _, i in live), *(2 * i + 1 for i in rest), 2 * n]
    return basis, table.transpose(axes).reshape(rows, columns, -1)


def _multipliable(a: Basis, b: Basis) -> bool:
    return isinstance(a, Polynomial) and isinstance(b, Polynomial)


def _factor_product(a: Basis, b: Basis) -> tuple[Basis, np.ndarray]:
    assert isinstance(a, Polynomial) and isinstance(b, Polynomial)
    return _polynomial_product(a, b)


def _polynomial_product(a: Polynomial, b: Polynomial) -> tuple[Polynomial, np.ndarray]:
    wide = _wide(a, b, a.degree + b.degree)
    left, right = rewritten(a, replace(wide, degree=a.degree)), rewritten(b, replace(wide, degree=b.degree))
    place = {tuple(e): i for i, e in enumerate(wide.exponents.tolist())}
    table = np.zeros((a.size, b.size, wide.size))
    for i in range(left.shape[1]):
        for j in range(right.shape[1]):
            target = place[tuple((wide.exponents[i] + wide.exponents[j]).tolist())]
            table[:, :, target] += np.outer(left[:, i], right[:, j])
    return wide, table
