"""Three straight lines per current level, and their coefficients as polynomials in the current."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.zone_lines import ZoneLines
from lpvid.record import Record

STILL = 1e-6
"""spread over the whole range within which a scheduling variable is constant."""
CANDIDATES = np.linspace(0.02, 0.9, 45)
"""shares of a level's largest |velocity| between which v_high is sought, before the best interval is searched."""


@dataclass(frozen=True)
class ZoneRegression:
    """The lines of each level, and the stage that runs through them.

    Attributes
    ----------
    levels : (L,) tuple of float
        Of the scheduling variable.
    limits : (L,) tuple of float
        v_high found level by level.
    lines : (L, 3, 2) nested tuple of float
        Slope and intercept in zones I, II and III (3.14).
    stage : ZoneLines
        v_high of first degree (3.16), slopes and intercepts of the degree requested (3.19)-(3.20).
    """

    levels: tuple[float, ...]
    limits: tuple[float, ...]
    lines: tuple[tuple[tuple[float, float], ...], ...]
    stage: ZoneLines

    def __str__(self) -> str:
        rows = ["level     v_high     m_1      c_1      m_2      m_3      c_3"]
        for level, limit, ((m1, c1), (m2, _), (m3, c3)) in zip(self.levels, self.limits, self.lines, strict=True):
            rows.append(f"{level:5.3g} {limit:10.4f} {m1:8.0f} {c1:8.0f} {m2:8.0f} {m3:8.0f} {c3:8.0f}")
        return "\n".join(rows)


def regress_zones(records: Sequence[Record], input: str = "velocity", output: str = "force",
                  variable: str = "current", degree: int = 1) -> ZoneRegression:
    """Fit (3.14) to every level at which the scheduling is constant, and its coefficients over the levels.

    ::

        F = m_1 v + c_1 (v < −v_high),  m_2 v + c_2 (|v| ≤ v_high),  m_3 v + c_3 (v > v_high)      per level
        v_high(i) = π_0 + π_1 i,   m_j(i), c_j(i) polynomials of `degree`                          over the levels

    Díaz Salas 2011 (3.14)-(3.22) by separate least squares in each zone. v_high of a level is the one with the least
    squared error; the thesis does not print how it was found.

    Parameters
    ----------
    records : sequence of Record
        Those in which the scheduling moves are passed over.
    input, output, variable : str
        Channels.
    degree : int
        Of slopes and intercepts in the scheduling variable.

    Returns
    -------
    ZoneRegression

    Raises
    ------
    InputError
        Fewer levels than the degree needs, or zones without samples.

    Examples
    --------
    >>> v = np.linspace(-0.3, 0.3, 601)
    >>> law = lambda i: 9000 * np.clip(v, -0.04 - 0.02 * i, 0.04 + 0.02 * i) + (600 + 100 * i) * v
    >>> runs = [Record({"velocity": v, "force": law(i), "current": np.full(v.size, i)}, sample_time=0.01)
    ...         for i in (0.0, 1.0, 2.0)]
    >>> [round(c, 3) for c in regress_zones(runs).stage.limit]
    [0.04, 0.02]
    """
    degree = _checks.count(degree, "degree")
    groups = _levels(records, variable)
    if len(groups) <= max(degree, 1):
        raise InputError(f"a regression of degree {max(degree, 1)} over '{variable}' needs {max(degree, 1) + 1} levels "
                         "at which it is constant", got=f"{len(groups)}",
                         mend="add records at constant levels, or use stage='three-zone', which needs none")
    levels = np.array(sorted(groups))
    samples = [tuple(np.concatenate([r[c] for r in groups[g]]) for c in (input, output)) for g in sorted(groups)]
    limits = np.array([_limit(v, f) for v, f in samples])
    limit = np.polynomial.polynomial.polyfit(levels, limits, 1)
    lines = np.array([_lines(v, f, max(float(np.polynomial.polynomial.polyval(i, limit)), 1e-9))
                      for i, (v, f) in zip(levels, samples, strict=True)])
    fit = [[tuple(np.polynomial.polynomial.polyfit(levels, lines[:, zone, part], degree).tolist())
            for part in (0, 1)] for zone in range(3)]
    stage = ZoneLines(tuple(limit.tolist()), fit[0][0], fit[1][0], fit[2][0], fit[0][1], fit[2][1])
    return ZoneRegression(tuple(levels.tolist()), tuple(limits.tolist()),
                          tuple(tuple((float(m), float(c)) for m, c in row) for row in lines), stage)


def _levels(records: Sequence[Record], variable: str) -> dict[float, list[Record]]:
    """Records at which the scheduling is constant, by their mean level.

    It counts as constant where it scatters about its mean by less than half of the way to the next level, so that a
    sensor's noise does not blur the levels. Records are taken in the order of their scatter; those that move more are
    passed over.
    """
    span = float(np.ptp(np.concatenate([r[variable] for r in records]))) or 1.0
    found: dict[float, list[Record]] = {}
    for record in sorted(records, key=lambda r: float(np.std(r[variable]))):
        mean, scatter = float(np.mean(record[variable])), max(float(np.std(record[variable])), STILL * span)
        away = {level: abs(level - mean) for level in found}
        same = next((level for level, d in away.items() if d <= 2.0 * scatter), None)
        if scatter > 0.5 * min([d for level, d in away.items() if level != same], default=span):
            continue
        found.setdefault(mean if same is None else same, []).append(record)
    return found


def _limit(v: np.ndarray, force: np.ndarray) -> float:
    """v_high with the least squared error of three separate lines."""
    from scipy.optimize import minimize_scalar

    reach = float(np.abs(v).max())
    costs = [_cost(v, force, share * reach) for share in CANDIDATES]
    best = int(np.argmin(costs))
    if not np.isfinite(costs[best]):
        raise InputError("a zone of the three-zone regression holds no samples", got=f"|velocity| up to {reach:.3g}",
                         mend="add records that reach lower and higher velocities at every level")
    low, high = CANDIDATES[max(best - 1, 0)], CANDIDATES[min(best + 1, CANDIDATES.size - 1)]
    found = minimize_scalar(lambda share: _cost(v, force, share * reach), bounds=(low, high), method="bounded",
                            options={"xatol": 1e-5})
    return reach * float(found.x if found.fun <= costs[best] else CANDIDATES[best])


def _cost(v: np.ndarray, force: np.ndarray, high: float) -> float:
    total = 0.0
    for here in (v < -high, np.abs(v) <= high, v > high):
        if here.sum() < 3:
            return np.inf
        total += float(np.sum((force[here] - np.polyval(np.polyfit(v[here], force[here], 1), v[here])) ** 2))
    return total


def _lines(v: np.ndarray, force: np.ndarray, high: float) -> list[tuple[float, float]]:
    """Slope and intercept in each zone."""
    zones = (v < -high, np.abs(v) <= high, v > high)
    if min(z.sum() for z in zones) < 3:
        raise InputError("a zone of the three-zone regression holds no samples", got=f"v_high {high:.3g}",
                         mend="add records that reach lower and higher velocities at every level")
    return [tuple(np.polyfit(v[z], force[z], 1).tolist()) for z in zones]
