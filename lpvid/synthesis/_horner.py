"""A matrix polynomial in several variables as a linear fractional form, by nested rank factorisation."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

ROUNDING = 1e-13
"""Singular values below this share of the largest are rounding, not rank."""


def fractional(coefficients: np.ndarray, exponents: np.ndarray) -> tuple[np.ndarray, tuple[int, ...]]:
    """S(δ) = Σ_e S_e δ^e as K11 + K12 Δ (I − K22 Δ)⁻¹ K21 with few repetitions; K22 Δ is nilpotent.

    In every order of the variables, row by row and column by column, Horner's scheme
    S = T_0 + L_1 δ (B_1 + L_2 δ (B_2 + …)) takes [T_1 … T_d] = L_1 [B …] at its rank. What no input reaches
    or no output depends on is then removed (Cockburn & Morton 1997), and the smallest form is returned.

    Parameters
    ----------
    coefficients : (M, rows, columns) array
    exponents : (M, variables) array

    Returns
    -------
    (rows + r, columns + r) array
        [K11 K12; K21 K22], Δ sorted by variable.
    tuple of int
        Repetitions of every variable.

    Examples
    --------
    >>> k, repetitions = fractional(np.array([[[1.0]], [[0.0]], [[4.0]]]), np.array([[0], [1], [2]]))    # 1 + 4 δ²
    >>> repetitions
    (2,)
    """
    variables = exponents.shape[1]
    orders = itertools.permutations(range(variables)) if variables <= 4 else [tuple(range(variables))]
    best: tuple[np.ndarray, tuple[int, ...]] | None = None
    for order in orders:
        for flip in (False, True):
            c = coefficients.transpose(0, 2, 1) if flip else coefficients
            k, repetitions = _nested(c, exponents[:, list(order)])
            k = _sorted(k, c.shape[1:], repetitions, order)
            counts = [repetitions[order.index(i)] for i in range(variables)]
            k, counts = reachable(k, c.shape[1:], counts)
            k, counts = reachable(k.T, c.shape[:0:-1], counts)  # transposed: what the outputs see
            if best is None or sum(counts) < sum(best[1]):
                best = (k if flip else k.T), tuple(counts)
    assert best is not None
    return best


def reachable(k: np.ndarray, shape: tuple[int, ...], repetitions: Sequence[int]) -> tuple[np.ndarray, list[int]]:
    """The form without the channels of Δ that no input reaches: the smallest V_i ⊇ K21_i + Σ_j K22_ij V_j."""
    rows, columns = shape
    edges = np.concatenate([[0], np.cumsum(repetitions)]).astype(int)
    driven, loop = k[rows:, :columns], k[rows:, columns:]
    parts = [slice(a, b) for a, b in itertools.pairwise(edges)]
    scale = max(float(np.abs(k).max(initial=0.0)), 1e-300)
    spans = grown = [np.zeros((n, 0)) for n in repetitions]
    for _ in range(edges[-1] + 1):
        grown = [_span([driven[p], *(loop[p, q] @ v for q, v in zip(parts, spans, strict=True))], scale) for p in parts]
        if [v.shape[1] for v in grown] == [v.shape[1] for v in spans]:
            break
        spans = grown
    if not spans:
        return k, []
    whole = np.zeros((edges[-1], sum(v.shape[1] for v in grown)))
    at = 0
    for p, v in zip(parts, grown, strict=True):
        whole[p, at : at + v.shape[1]] = v
        at += v.shape[1]
    kept = np.block([[k[:rows, :columns], k[:rows, columns:] @ whole],
                     [whole.T @ driven, whole.T @ loop @ whole]])
    return kept, [v.shape[1] for v in grown]


def _span(blocks: Sequence[np.ndarray], scale: float) -> np.ndarray:
    """An orthonormal basis of the columns."""
    u, s, _ = np.linalg.svd(np.hstack(blocks), full_matrices=False)
    return u[:, s > 1e-11 * scale]


def _nested(coefficients: np.ndarray, exponents: np.ndarray) -> tuple[np.ndarray, list[int]]:
    """One variable after the other: rows collect what the later ones still multiply."""
    _, rows, columns = coefficients.shape
    table = {tuple(e): coefficients[i] for i, e in enumerate(exponents.tolist())}
    stages: list[tuple[int, np.ndarray, np.ndarray]] = []  # (rows before, C over all earlier rows, A)
    for _ in range(exponents.shape[1]):
        rest = sorted({e[1:] for e in table})
        degree = max(e[0] for e in table)
        height = next(iter(table.values())).shape[0]
        flat = [np.hstack([table.get((k, *e), np.zeros((height, columns))) for e in rest]) for k in range(degree + 1)]
        lefts, constants = _chain(flat)
        sizes = [x.shape[1] for x in lefts]
        c, a = np.zeros((height, sum(sizes))), np.zeros((sum(sizes), sum(sizes)))
        starts = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
        for k, left in enumerate(lefts):
            target = c if k == 0 else a[starts[k - 1] : starts[k]]
            target[:, starts[k] : starts[k + 1]] = left
        stages.append((height, c, a))
        whole = np.vstack([flat[0], *constants])
        table = {e: whole[:, i * columns : (i + 1) * columns] for i, e in enumerate(rest)}
    return _assembled(table[()], stages, rows)


def _chain(flat: Sequence[np.ndarray]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """L_1, L_2 … and B_1, B_2 … of Horner's scheme, each at its rank."""
    lefts, constants = [], []
    remaining = list(flat[1:])
    scale = max((np.abs(x).max(initial=0.0) for x in flat), default=0.0)
    while remaining:
        joined = np.hstack(remaining)
        u, s, v = np.linalg.svd(joined, full_matrices=False)
        rank = int(np.sum(s > ROUNDING * max(joined.shape) * max(s[0] if s.size else 0.0, scale)))
        if rank == 0:
            break
        root = np.sqrt(s[:rank])
        width = remaining[0].shape[1]
        right = root[:, None] * v[:rank]
        lefts.append(u[:, :rank] * root)
        constants.append(right[:, :width])
        remaining = [right[:, (k + 1) * width : (k + 2) * width] for k in range(len(remaining) - 1)]
    return lefts, constants


def _assembled(top: np.ndarray, stages: Sequence[tuple[int, np.ndarray, np.ndarray]], rows: int
               ) -> tuple[np.ndarray, list[int]]:
    """[K11 K12; K21 K22] from the constant matrix and what each stage feeds back into the rows above it."""
    repetitions = [a.shape[0] for _, _, a in stages]
    r, columns = sum(repetitions), top.shape[1]
    out = np.zeros((rows + r, columns + r))
    out[:, :columns] = top
    at = columns
    for height, c, a in stages:
        size = a.shape[0]
        out[:height, at : at + size] = c
        out[height : height + size, at : at + size] = a
        at += size
    return out, repetitions


def _sorted(k: np.ndarray, shape: tuple[int, int], repetitions: Sequence[int], order: Sequence[int]) -> np.ndarray:
    """Δ's channels in the order of the variables instead of that of the elimination."""
    starts = np.concatenate([[0], np.cumsum(repetitions)]).astype(int)
    parts = [np.arange(int(starts[i]), int(starts[i + 1])) for i in np.argsort(order)]
    channels = np.concatenate([np.zeros(0, dtype=int), *parts])
    rows = np.concatenate([np.arange(shape[0]), shape[0] + channels])
    columns = np.concatenate([np.arange(shape[1]), shape[1] + channels])
    return k[np.ix_(rows, columns)]
