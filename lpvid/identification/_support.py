"""Supports of a sparse regression: the path of garrote or lasso on an R factor, and what follows from each support."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lpvid.identification.regression import Factor
from lpvid.scheduling import Basis, Scheduling

POLISHING = 200
"""moves of the final search at most."""


def variables_of(basis: Basis, box: Scheduling) -> list[frozenset[str]]:
    """Variables on which each basis function depends: where its derivative is not zero throughout the box."""
    if not basis.names:
        return [frozenset()] * basis.size
    places = np.array([0.03, 0.21, 0.38, 0.57, 0.71, 0.93])
    axes = np.array([np.roll(places, 2 * i + i // 3) for i in range(len(box.names))]).T
    p = np.array(box.lower) + axes * (np.array(box.upper) - np.array(box.lower))
    points = np.vstack([p, box.grid(3)]) if len(box.names) <= 4 else p
    named: list[set[str]] = [set() for _ in range(basis.size)]
    for name in basis.names:
        columns = points[:, [box.names.index(n) for n in basis.names]]
        for f in np.flatnonzero(np.any(np.abs(basis.derivative(columns, name)) > 1e-12, axis=0)):
            named[int(f)].add(name)
    return [frozenset(n) for n in named]


def units_of(places: np.ndarray, basis: Basis, box: Scheduling, group: str) -> tuple[list[np.ndarray], np.ndarray]:
    """Columns that go in or out together, and those that always stay."""
    if group == "parameter":
        return [np.array([i]) for i in range(len(places))], np.empty(0, dtype=int)
    variables = variables_of(basis, box)
    members: dict[tuple, list[int]] = {}
    always = []
    for column, (part, index, signal, function) in enumerate(places.tolist()):
        if not variables[function]:
            always.append(column)
        else:
            key = tuple(sorted(variables[function]))
            members.setdefault(key if group == "variable" else (part, index, signal, *key), []).append(column)
    return [np.array(m) for m in members.values()], np.array(always, dtype=int)


@dataclass(frozen=True, eq=False)
class Supports:
    """One output's regression y ≈ X θ behind its R factor, and the supports along its path.

    Attributes
    ----------
    x : (k, k) array
        R, with unit columns.
    y : (k,) array
    scale : (k,) array
        Norms that were divided by.
    rest : float
        Squared residual that no column can explain.
    rows, output : int
    units : list of int arrays
        Columns that go in or out together.
    always : int array
    signed : bool
        Adaptive lasso rather than garrote.
    """

    x: np.ndarray
    y: np.ndarray
    scale: np.ndarray
    rest: float
    rows: int
    output: int
    units: Sequence[np.ndarray]
    always: np.ndarray
    signed: bool

    @classmethod
    def of(cls, factor: Factor, output: int, units: Sequence[np.ndarray], always: np.ndarray, signed: bool) -> Supports:
        """From the R factor of all columns."""
        k = factor.columns
        r11 = factor.r[:k, :k]
        scale = np.linalg.norm(r11, axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        rest = float(np.sum(factor.r[k:, k + output] ** 2))
        return cls(r11 / scale, factor.r[:k, k + output], scale, rest, factor.rows, output, units, always, signed)

    def columns(self, chosen: Sequence[int]) -> np.ndarray:
        """Columns of the chosen units and those that always stay, in order."""
        return np.sort(np.concatenate([self.always, *(self.units[u] for u in chosen)]).astype(int))

    def _theta(self, columns: np.ndarray) -> np.ndarray:
        return np.linalg.lstsq(self.x[:, columns], self.y, rcond=None)[0]

    def cost(self, chosen: Sequence[int]) -> float:
        """Residual sum of squares of the refit."""
        columns = self.columns(chosen)
        return float(np.sum((self.y - self.x[:, columns] @ self._theta(columns)) ** 2)) + self.rest

    def bic(self, cost: float, size: int) -> float:
        """N ln(RSS/N) + size ln N."""
        return self.rows * np.log(max(cost, 1e-300) / self.rows) + size * np.log(self.rows)

    @cached_property
    def path(self) -> list[tuple[int, ...]]:
        """Sets of units along the path, from none to all."""
        theta = np.linalg.lstsq(self.x, self.y, rcond=None)[0]
        if self.signed:
            z = self.x * np.abs(theta)
        else:
            z = np.column_stack([self.x[:, u] @ theta[u] / len(u) for u in self.units])
        target = self.y
        if self.always.size:
            q = np.linalg.qr(self.x[:, self.always])[0]
            z, target = z - q @ (q.T @ z), target - q @ (q.T @ target)
        return homotopy(z, target, not self.signed)

    def best_by_bic(self) -> tuple[int, ...]:
        """The support of least BIC on the path."""
        return min(self.path, key=lambda s: (self.bic(self.cost(s), self.columns(s).size), len(s)))

    def polished(self, chosen: tuple[int, ...]) -> np.ndarray:
        """Columns after adding or dropping the one unit that lowers BIC most, until none does."""
        current = set(chosen)
        for _ in range(POLISHING):
            gains = self._gains(current)
            unit = min(gains, key=lambda u: (gains[u], u))
            if gains[unit] >= -1e-9 * self.rows:
                break
            current ^= {unit}
        return self.columns(sorted(current))

    def _gains(self, current: set[int]) -> dict[int, float]:
        """Change of BIC by adding or dropping every unit, from one QR of the current columns."""
        columns = self.columns(sorted(current))
        q, r = np.linalg.qr(self.x[:, columns])
        residual = self.y - q @ (q.T @ self.y)
        cost = float(residual @ residual) + self.rest
        now = self.bic(cost, columns.size)
        theta, inverse = np.linalg.solve(r, q.T @ self.y), np.linalg.inv(r)
        place = {int(c): i for i, c in enumerate(columns)}
        outside = self.x - q @ (q.T @ self.x)
        gains = {}
        for u, unit in enumerate(self.units):
            if u in current:
                at = [place[int(c)] for c in unit]
                block = inverse[at] @ inverse[at].T
                change, size = float(theta[at] @ np.linalg.solve(block, theta[at])), columns.size - unit.size
            else:
                fitted = outside[:, unit] @ np.linalg.lstsq(outside[:, unit], residual, rcond=1e-10)[0]
                change, size = -float(fitted @ fitted), columns.size + unit.size
            gains[u] = self.bic(cost + change, size) - now
        return gains

    def of_size(self, size: int) -> np.ndarray:
        """Columns of the last support on the path with at most `size` units."""
        return self.columns([s for s in self.path if len(s) <= size][-1])

    def errors_by_size(self, held: Factor) -> np.ndarray:
        """Mean squared one-step error on held-out equations, for 0, 1, … units."""
        k = self.x.shape[1]
        target = held.r[:, k + self.output]
        errors = []
        for size in range(len(self.units) + 1):
            columns = self.of_size(size)
            theta = self._theta(columns) / self.scale[columns]
            errors.append(float(np.sum((target - held.r[:, :k][:, columns] @ theta) ** 2)) / held.rows)
        return np.array(errors)


def homotopy(z: np.ndarray, y: np.ndarray, positive: bool) -> list[tuple[int, ...]]:
    """Supports of min ‖y − Zc‖² + 2μ Σ|c| (c ≥ 0 if `positive`) as μ falls to 0.

    Between two events the active coefficients move along a straight line; an event is a column whose correlation
    reaches μ, or a coefficient that reaches zero (Osborne, Presnell & Turlach 2000; Efron et al. 2004).
    """
    k = z.shape[1]
    c, active, supports = np.zeros(k), [], [()]
    correlation = z.T @ y
    usable = np.linalg.norm(z, axis=0) > 1e-12 * max(float(np.linalg.norm(y)), 1e-300)
    mu = float(np.max(np.where(usable, correlation if positive else np.abs(correlation), -np.inf), initial=-np.inf))
    first = mu
    dropped = -1
    for _ in range(8 * k + 8):
        if not mu > 1e-12 * first or not np.isfinite(mu):
            break
        correlation = z.T @ (y - z @ c)
        reach = correlation if positive else np.abs(correlation)
        waiting = [j for j in np.flatnonzero(usable & (reach >= mu * (1 - 1e-9))) if j not in active and j != dropped]
        active += [int(j) for j in waiting]
        if not active:
            break
        signs = np.ones(len(active)) if positive else np.sign(correlation[active])
        r = np.asarray(np.linalg.qr(z[:, active], mode="r"))
        direction = np.linalg.lstsq(r.T @ r, signs, rcond=1e-14)[0]
        step, leaving = _next_event(z, c, active, direction, correlation, mu, usable, positive, dropped)
        c[active] += step * direction
        mu -= step
        dropped = -1
        if leaving >= 0:
            dropped = active.pop(leaving)
            c[dropped] = 0.0
        supports.append(tuple(sorted(active)))
    return list(dict.fromkeys(supports))


def _next_event(z: np.ndarray, c: np.ndarray, active: list[int], direction: np.ndarray, correlation: np.ndarray,
                mu: float, usable: np.ndarray, positive: bool, dropped: int) -> tuple[float, int]:
    """How far μ falls until the next event, and the place in `active` that leaves then, or −1."""
    slope = z.T @ (z[:, active] @ direction)
    step, leaving = mu, -1
    for j in np.flatnonzero(usable):
        if j in active or j == dropped:
            continue
        for sign in (1.0,) if positive else (1.0, -1.0):
            rate = 1.0 - sign * slope[j]
            if rate > 1e-12:
                step = min(step, max((mu - sign * correlation[j]) / rate, 0.0))
    for place, j in enumerate(active):
        if c[j] != 0.0 and c[j] * direction[place] < 0 and -c[j] / direction[place] < step:
            step, leaving = -c[j] / direction[place], place
    return step, leaving
