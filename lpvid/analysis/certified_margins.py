"""How far a certificate reaches: the largest range, the largest rate, the share of drawn models it still covers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from lpvid import _checks
from lpvid.analysis.certificates import Range, Rate, certificate_for, certificate_within, requested_box
from lpvid.analysis.frozen import Model
from lpvid.analysis.hull_stability import certificate_on, moving_certificate_on
from lpvid.analysis.stability_certificate import StabilityCertificate
from lpvid.analysis.uncertainty import StabilityProbability, share_of
from lpvid.errors import InputError
from lpvid.lmi.certificate import grid
from lpvid.lmi.driven import autonomous
from lpvid.lmi.polytope_positivity import CUBES, dense
from lpvid.lmi.search import frozen_rates
from lpvid.model.adaptable import checked_matrices
from lpvid.model.hull import Hull, design_hull
from lpvid.scheduling import Scheduling

WIDEST = 16.0
"""Factor on the box beyond which nothing is tried."""
PRECISION = 0.02
SLOWEST = 1e-4
"""Rate, in box widths per time constant (or sample), below which nothing is tried."""
PATIENCE = 4_000
"""Matrices that the re-check of one drawn model may look at."""


@dataclass(frozen=True, eq=False)
class LargestRange:
    """The widest box, scaled from the one requested, on which stability was certified; or the widest hull of a design.

    Parameters
    ----------
    factor : float
        On the widths of the box; 0 where even a fraction of it fails.
    box : Scheduling or None
        Of a hull the box around it.
    towards : str
        "centre": both ends move; "upper" or "lower": that end moves and the other one stays.
    limit : str
        "frozen": frozen poles leave the stable region just beyond; "certificate": frozen-stable beyond, but no
        certificate was found; "none": certified up to `WIDEST` times the box.
    certificate : StabilityCertificate or None
        For that box.
    hull : Hull or None
        Scaled about its middle, in place of the box; with factor 0 that of the design.
    """

    factor: float
    box: Scheduling | None
    towards: str
    limit: str
    certificate: StabilityCertificate | None
    hull: Hull | None = None

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Plain values by name.
        """
        box = self.box
        ends = {} if box is None else {n: [a, b] for n, a, b in zip(box.names, box.lower, box.upper, strict=True)}
        vertices = {} if self.hull is None else {"vertices": self.hull.vertices().tolist()}
        return {"factor": self.factor, "range": ends, **vertices, "towards": self.towards, "limit": self.limit,
                "between_grid": bool(self.certificate and self.certificate.between_grid),
                "certificate": None if self.certificate is None else self.certificate.to_dict()}

    def __repr__(self) -> str:
        if self.box is None:
            return f"largest certified range: none about this {'one' if self.hull is None else 'hull'}"
        ends = ", ".join(f"{n} in [{a:.6g}, {b:.6g}] {u}".rstrip() for n, a, b, u in
                         zip(self.box.names, self.box.lower, self.box.upper, self.box.units, strict=True))
        why = {"frozen": "frozen poles leave the stable region just beyond",
               "certificate": "beyond it no certificate was found, though held values stay stable",
               "none": f"nothing beyond {WIDEST:g} times the range was tried"}[self.limit]
        within = "" if self.hull is None else f"{self.hull.text} within "
        return f"largest certified range: {within}{ends} ({self.factor:.3g} times as wide); {why}"


@dataclass(frozen=True, eq=False)
class LargestRate:
    """The fastest motion of the scheduling within its box, or the hull of a design, for which stability was certified.

    Parameters
    ----------
    rates : tuple of float or None
        [units per second], one for each variable, in proportion to the widths of the box; infinite where any motion
        is covered; None where not even very slow motion is.
    names, units : tuple of str
    certificate : StabilityCertificate or None
        For these rates.
    """

    rates: tuple[float, ...] | None
    names: tuple[str, ...]
    units: tuple[str, ...]
    certificate: StabilityCertificate | None

    @property
    def arbitrary(self) -> bool:
        """Any motion is covered."""
        return self.rates is not None and all(math.isinf(r) for r in self.rates)

    def to_dict(self) -> dict:
        """Plain data for JSON; null for any motion, see "arbitrary".

        Returns
        -------
        dict
            Plain values by name.
        """
        rates = None if self.rates is None or self.arbitrary else dict(zip(self.names, self.rates, strict=True))
        return {"rate": rates, "arbitrary": self.arbitrary, "certified": self.rates is not None,
                "between_grid": bool(self.certificate and self.certificate.between_grid),
                "certificate": None if self.certificate is None else self.certificate.to_dict()}

    def __repr__(self) -> str:
        if self.rates is None:
            return "largest certified rate: none, not even for very slow motion"
        if self.arbitrary:
            within = "range" if self.certificate is None or self.certificate.vertices is None else (
                f"polytope of {len(self.certificate.vertices)} vertices")
            return f"largest certified rate: any motion within the {within} is covered"
        return "largest certified rate: " + ", ".join(
            f"|d {n}/dt| <= {r:.4g} {u or '1'}/s" for n, r, u in zip(self.names, self.rates, self.units, strict=True))


def largest_range(model: Model, rate: Rate = None, range: Range = None, *, towards: str = "centre") -> LargestRange:
    """Scale the box until stability can no longer be certified, by bisection to 2 %; each end is re-checked.

    The hull for which a controller or closed loop was designed is scaled about its middle.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
    rate, range
        As for `certify_stability`; the rates stay while the box, or the hull, is scaled.
    towards : str
        "centre", "upper" or "lower": which ends move; a hull has no ends, and is scaled about its middle.

    Returns
    -------
    LargestRange

    Raises
    ------
    InputError
        A model without scheduling variables that have a width; an end of a hull.

    Examples
    --------
    >>> from lpvid.model.transfer_function import LPVTransferFunction
    >>> from lpvid.scheduling import Polynomial
    >>> model = LPVTransferFunction.siso(a=[[-0.5, 0.25]], b=[[0, 0], [1, 0]], basis=Polynomial("p", degree=1),
    ...                                  sample_time=0.1)                       # pole at 0.5 − 0.25 p
    >>> found = largest_range(model)                                            # beyond p = −2: above 1
    >>> 1.95 < found.factor <= 2, found.limit
    (True, 'frozen')
    """
    _checks.one_of(towards, ("centre", "upper", "lower"), "towards")
    checked_matrices(model, "a certificate is for a model")
    start = requested_box(model.box, rate, range)
    if not np.any(start.half_width > 0):
        raise InputError("a largest range needs a scheduling variable that moves", got="none")
    hull = design_hull(model) if range is None else None
    if hull is not None:
        return _largest_hull(model, hull, start, towards)
    factor, best = _edge(lambda share: certificate_for(model, scaled(start, share, towards)), 1.0, 1 / 64, WIDEST)
    if factor is None:
        return LargestRange(0.0, None, towards, _why(model, scaled(start, 1 / 64, towards)), None)
    limit = "none" if factor >= WIDEST else _why(model, scaled(start, factor * (1 + 2 * PRECISION), towards))
    return LargestRange(factor, scaled(start, factor, towards), towards, limit, best)


def _largest_hull(model: Model, hull: Hull, box: Scheduling, towards: str) -> LargestRange:
    """The widest hull about the middle of that of a design."""
    if towards != "centre":
        raise InputError("a hull is scaled about its middle", got=f"towards {towards}", why="it has no upper or lower "
                         "end", mend='towards="centre", or a range in place of the hull')
    system = autonomous(model)
    columns = [box.names.index(r.name) for r in system.readings]

    def why(factor: float) -> str:
        points = dense(hull.scaled(factor).over(box.names).vertices())[:, columns]
        return "frozen" if frozen_rates(system, points).max() >= 0 else "certificate"

    factor, best = _edge(lambda share: certificate_within(model, hull.scaled(share), box), 1.0, 1 / 64, WIDEST)
    if factor is None:
        return LargestRange(0.0, None, towards, why(1 / 64), None, hull)
    limit = "none" if factor >= WIDEST else why(factor * (1 + 2 * PRECISION))
    wide = hull.scaled(factor)
    return LargestRange(factor, wide.enclosing(box), towards, limit, best, wide)


def largest_rate(model: Model, range: Range = None) -> LargestRate:
    """The largest rates, in proportion to the widths of the box, at which stability is certified; to 2 %.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
    range
        As for `certify_stability`: left out, the box, or the hull of a design.

    Returns
    -------
    LargestRate
    """
    checked_matrices(model, "a certificate is for a model")
    box, hull = requested_box(model.box, None, range), design_hull(model) if range is None else None
    found = None if hull is None else certificate_on(model, hull, box)
    box = box if hull is None else hull.enclosing(box)
    found = certificate_for(model, box) if found is None else found
    if found is not None and found.between_grid:
        return LargestRate((math.inf,) * len(box.names), box.names, box.units, found)
    system = autonomous(model)
    columns = [box.names.index(r.name) for r in system.readings]
    points = (grid(box, 9 if len(box.names) < 3 else 3) if hull is None
              else dense(hull.over(box.names).vertices()))
    slow = frozen_rates(system, points[:, columns])
    pace = 1 / model.sample_time if model.sample_time is not None else float(np.abs(slow).max())
    width = 2 * box.half_width

    def rates(speed: float) -> tuple[float, ...]:
        return tuple(float(w * speed * pace) for w in width)

    def certified(speed: float) -> StabilityCertificate | None:
        fast = replace(box, rate=rates(speed))
        within = None if hull is None else moving_certificate_on(model, hull, fast)
        return certificate_for(model, fast) if within is None else within

    speed, best = (None, None) if slow.max() >= 0 else _edge(certified, 0.05, SLOWEST,
                                                             1.0 if model.sample_time else 1e3)
    return LargestRate(None if speed is None else rates(speed), box.names, box.units, best)


def certified_share(certificate: StabilityCertificate, models: Iterable[Model], level: float = 0.95
                    ) -> StabilityProbability:
    """Share of drawn models for which the very same matrices still prove stability, with its Wilson interval.

    Parameters
    ----------
    certificate : StabilityCertificate
        Of the model that was identified.
    models : iterable of LPVTransferFunction or LPVStateSpace
        Draws from the covariance of its parameters.
    level : float
        Coverage of the interval.

    Returns
    -------
    StabilityProbability
        ``exact`` where every draw was decided between grid points.

    Raises
    ------
    InputError
        The certificate makes no claim, or no model was drawn.
    """
    if not certificate.verified:
        raise InputError("a certificate without a claim covers no model", got=certificate.verdict)
    patience = PATIENCE if certificate.vertices is None else CUBES * PATIENCE
    hits, count, exact = 0, 0, True
    for model in models:
        found = certificate.decrease(autonomous(model), budget=patience)
        hits += found.holds and found.between_grid >= certificate.between_grid
        exact &= found.between_grid or found.margin <= 0  # else shown on a grid, or not decided
        count += 1
    if not count:
        raise InputError("no model was drawn", mend="give at least one model")
    return share_of(hits, count, level, exact)


def scaled(box: Scheduling, factor: float, towards: str) -> Scheduling:
    """The box with its widths times a factor.

    Parameters
    ----------
    box : Scheduling
        Ranges and rates.
    factor : float
        Above zero.
    towards : str
        "centre": both ends move; "upper" or "lower": that end moves and the other one stays.

    Returns
    -------
    Scheduling
        With the same rates.

    Examples
    --------
    >>> scaled(Scheduling(("p",), (0.0,), (2.0,)), 2.0, "upper").upper
    (4.0,)
    """
    low, high = np.array(box.lower), np.array(box.upper)
    grow = (factor - 1) * (high - low)
    share = {"centre": 0.5, "upper": 0.0, "lower": 1.0}[towards]
    return replace(box, lower=tuple((low - share * grow).tolist()),
                   upper=tuple((high + (1 - share) * grow).tolist()))


def _edge(certified: Callable[[float], StabilityCertificate | None], start: float, least: float, most: float
          ) -> tuple[float | None, StabilityCertificate | None]:
    """The largest value to `PRECISION` that is certified between grid points, with its certificate.

    From `start` by doubling or halving and then bisection.
    """
    best: dict[float, StabilityCertificate] = {}

    def holds(value: float) -> bool:
        found = certified(value)
        if found is not None and found.between_grid:
            best[value] = found
        return value in best

    low, high = (start, None) if holds(start) else (None, start)
    while high is None and low is not None and low < most:
        trial = min(2 * low, most)
        low, high = (trial, None) if holds(trial) else (low, trial)
    while low is None and high is not None and high > least:
        trial = max(0.5 * high, least)
        low, high = (trial, high) if holds(trial) else (None, trial)
    while low is not None and high is not None and high - low > PRECISION * low:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return (None, None) if low is None else (low, best[low])


def _why(model: Model, box: Scheduling) -> str:
    system = autonomous(model)
    columns = [box.names.index(r.name) for r in system.readings]
    points = grid(box, {1: 401, 2: 41, 3: 13}.get(len(box.names), 5))[:, columns]
    return "frozen" if frozen_rates(system, points).max() >= 0 else "certificate"
