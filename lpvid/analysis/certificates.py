"""Stability while the scheduling moves: certificates that anyone can re-check with numpy alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol, runtime_checkable

import numpy as np

from lpvid import _checks
from lpvid.analysis.divergence import diverging_trajectory
from lpvid.analysis.hull_stability import certificate_on, moving_certificate_on
from lpvid.analysis.stability_certificate import StabilityCertificate, Verification
from lpvid.errors import InputError
from lpvid.lmi.bounds import recheck_decrease
from lpvid.lmi.certificate import Recheck, grid
from lpvid.lmi.certificate_common import certificate_kind
from lpvid.lmi.driven import Driven, Model, autonomous
from lpvid.lmi.hull_certificate import HullCertificate
from lpvid.lmi.readings import box_of
from lpvid.lmi.search import LyapunovSearch, dependent, frozen_rates
from lpvid.lmi.storage import Storage
from lpvid.model.adaptable import checked_matrices
from lpvid.model.hull import Hull, design_hull
from lpvid.scheduling import Polynomial, Scheduling

_range = range  # `range` is an argument of the public function

Rate = float | Sequence[float | None] | Mapping[str, float | None] | None
Range = Sequence[float] | Sequence[Sequence[float]] | Mapping[str, Sequence[float]] | None
MAX_DEGREE = 3


@runtime_checkable
class Checkable(Protocol):
    """A certificate that can recompute its claim for a model."""

    def check(self, model: Any) -> Recheck:
        """What numpy finds about the claim.

        Parameters
        ----------
        model : model
            What the certificate is about.

        Returns
        -------
        Recheck
            Whether the claim holds, its margin, and why where it does not.
        """
        ...


def certify_stability(model: Model, rate: Rate = None, range: Range = None) -> StabilityCertificate:
    """Look for a Lyapunov function that proves a model stable while its scheduling variables move.

    Quadratic first (V with one P), then P(p) of degree 1 to 3; the inequalities stand in `lpvid.lmi.bounds`.
    Whatever a solver proposes counts only after a re-check with numpy, on the whole box and not only on a grid.

    A model with a scheduling filter is tried on any motion of the filter's output first, then on what the filter
    lets through, for its lag bounds the rate whatever the command does; the filter's own state decays and never leaves
    the range. A controller or closed loop that was designed for a hull is examined on that polytope: one P at its
    vertices, then P(p) at the rates, else P(p) on the box around it. Without a certificate, an admissible trajectory
    along which the model grows is searched for; that is sufficient for instability, and the lack of both leaves the
    question open.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
    rate : float, sequence or mapping of name to float, optional
        Bound on |dp/dt| [units per second]; None, as a whole or for a variable, leaves the variation arbitrary.
    range : (lower, upper), one pair for each variable, or mapping of name to pair, optional
        Left out, the model's own box, or the hull of its design.

    Returns
    -------
    StabilityCertificate

    Raises
    ------
    InputError
        For a rate or range that does not fit the model.

    References
    ----------
    Daafouz & Bernussou, Systems & Control Letters 43 (2001) 355-359, for P(p) with arbitrary jumps.

    Examples
    --------
    >>> from lpvid.model.transfer_function import LPVTransferFunction
    >>> from lpvid.scheduling import Polynomial
    >>> model = LPVTransferFunction.siso(a=[[-0.5, 0.2]], b=[[0, 0], [1, 0]], basis=Polynomial("p", degree=1),
    ...                                  sample_time=0.1)
    >>> certify_stability(model).verdict
    'certified'
    """
    checked_matrices(model, "a stability certificate is for a model")
    scheduling, hull = requested_box(model.box, rate, range), design_hull(model) if range is None else None
    found = None if hull is None else certificate_within(model, hull, scheduling)
    scheduling = scheduling if hull is None else hull.enclosing(scheduling)
    found = certificate_for(model, scheduling) if found is None else found
    if found is not None:
        return found
    system, scheduling = autonomous(model), behind_filter(model, scheduling)
    n, box = system.order, box_of(system.readings, scheduling)
    return StabilityCertificate("none", np.zeros((0, n, n)), Polynomial((), 0), box, system.sample_time,
                                system.digest, False, math.nan, False, 0.0,
                                diverging_trajectory(system, scheduling, hull))


def certificate_within(model: Model, hull: Hull, scheduling: Scheduling) -> StabilityCertificate | None:
    """The certificate of `certify_stability` for a polytope: by one P, or by one that moves no faster than the rates.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
    hull : Hull
        Over the model's variables.
    scheduling : Scheduling
        The model's variables, with the rates to cover.

    Returns
    -------
    StabilityCertificate or None
    """
    found = certificate_on(model, hull, scheduling)
    return moving_certificate_on(model, hull, scheduling) if found is None else found


def certificate_for(model: Model, scheduling: Scheduling) -> StabilityCertificate | None:
    """The certificate of `certify_stability` for a box with rates, or None; trajectories are not searched for.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        With a basis of polynomials or splines.
    scheduling : Scheduling
        The model's variables, with the range and rates [units per second] to cover; None for any motion.

    Returns
    -------
    StabilityCertificate or None
        None also where a frozen model is unstable.
    """
    system = autonomous(model)
    box = box_of(system.readings, scheduling)
    frozen = frozen_rates(system, grid(box, {0: 1, 1: 201, 2: 31, 3: 11}.get(len(box.names), 3)))
    if frozen.max() >= 0:
        return None
    best = _best(system, box, float(frozen.max()))
    filtered = behind_filter(model, scheduling)
    if best is None and filtered != scheduling:
        box = box_of(system.readings, filtered)
        best = _best(system, box, float(frozen.max()))
    if best is None:
        return None
    lyapunov, outcome, solver, decay = best
    assert isinstance(lyapunov.basis, Polynomial)
    return StabilityCertificate(certificate_kind(lyapunov), lyapunov.matrices, lyapunov.basis, box, system.sample_time,
                                system.digest, outcome.holds, outcome.margin, outcome.between_grid, decay, None, solver)


def behind_filter(model: Model, scheduling: Scheduling) -> Scheduling:
    """The scheduling with the rate bounds that the model's own filter imposes, whatever the command does.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        With a scheduling filter or none.
    scheduling : Scheduling
        Range and rates of the command.

    Returns
    -------
    Scheduling
        `scheduling` itself without a filter, and in continuous time.
    """
    stage = model.scheduling_stage
    if stage is None or model.sample_time is None:
        return scheduling
    limits = stage.rate_limits(2 * scheduling.half_width, model.sample_time)
    tighter = [limit if bound is None else bound if limit is None else min(bound, limit)
               for bound, limit in zip(scheduling.rate, limits, strict=True)]
    return replace(scheduling, rate=tuple(tighter))


def verify(certificate: Checkable, model: Any) -> Verification:
    """Recompute a certificate from the model and its matrices, with numpy alone.

    Parameters
    ----------
    certificate : StabilityCertificate, GainCertificate or another with ``check(model)``
    model : LPVTransferFunction or LPVStateSpace
        What it was made for; for the certificate of a synthesis, its closed loop.

    Returns
    -------
    Verification

    Raises
    ------
    InputError
        What is no certificate.
    """
    if not isinstance(certificate, Checkable):
        raise InputError("this is no certificate", got=type(certificate).__name__)
    found = certificate.check(model)
    why = found.why + (_left_out(certificate, model) if found.holds else "")
    return Verification(found.holds, found.margin, found.between_grid, why)


def _left_out(certificate: Checkable, model: Any) -> str:
    """A remark where a certificate's polytope is smaller than the hull of the model's design."""
    vertices = getattr(certificate, "vertices", None)
    hull = None if vertices is None else design_hull(model)
    if vertices is None or hull is None:
        return ""
    names = certificate.names if isinstance(certificate, HullCertificate) else certificate.box.names  # type: ignore
    if not set(names) <= set(hull.names):
        return ""
    wanted = hull.over(names).vertices()
    out = int((~Hull.of(names, vertices).contains(wanted)).sum())
    return f"; {out} of the {len(wanted)} vertices of the design's hull lie outside of it" if out else ""


def _candidates(system: Driven, box: Scheduling) -> Iterator[tuple[Storage, str]]:
    """Cheapest and strongest statements first."""
    search = LyapunovSearch(system, box)
    yield from ((candidate, "closed form") for candidate in search.closed_forms())
    yield from search.solved(0)
    if not dependent(system, box):
        return
    slow = any(rate is not None for rate in box.rate)
    for degree in _range(1, MAX_DEGREE + 1):
        fitted = search.fitted(degree) if slow else None
        if fitted is not None:
            yield fitted, "closed form"
        yield from search.solved(degree)


def _best(system: Driven, box: Scheduling, frozen: float) -> tuple[Storage, Recheck, str, float] | None:
    on_grid: tuple[Storage, Recheck, str] | None = None
    for lyapunov, solver in _candidates(system, box):
        outcome = recheck_decrease(system, lyapunov)
        if outcome.holds and outcome.between_grid:
            return _sharpened(system, box, frozen, (lyapunov, outcome, solver))
        if outcome.holds and (on_grid is None or outcome.margin > on_grid[1].margin):
            on_grid = (lyapunov, outcome, solver)
    return None if on_grid is None else (*on_grid, _decay(system, on_grid[0], frozen, on_grid[1]))


def _sharpened(system: Driven, box: Scheduling, frozen: float, found: tuple[Storage, Recheck, str]
               ) -> tuple[Storage, Recheck, str, float]:
    """Ask the solver for faster decay where a certificate promises much less than the frozen poles."""
    decay = _decay(system, found[0], frozen, found[1])
    low, high = decay, -frozen
    for _ in _range(3):
        if low > 0.6 * high or not 0 < system.order <= 8:
            break
        target = 0.5 * (low + high)
        better = next(LyapunovSearch(system, box).solved(found[0].basis.degree or 0, target), None)
        pace = None if better is None else recheck_decrease(system, better[0], target)
        if better is not None and pace is not None and pace.holds and pace.between_grid:
            outcome = recheck_decrease(system, better[0])
            if outcome.holds and outcome.between_grid:
                found, low, decay = (better[0], outcome, better[1]), target, target
                continue
        high = target
    return (*found, max(decay, _decay(system, found[0], frozen, found[1])))


def _decay(system: Driven, lyapunov: Storage, frozen: float, outcome: Recheck) -> float:
    """The largest α [1/s], to 3 %, at which the re-check still holds as strongly; never more than the frozen rate."""
    if not system.order:
        return -math.log(1e-3) / system.sample_time if system.sample_time else 0.0
    low, high = 0.0, -frozen
    for _ in _range(12):
        if high - low < 0.03 * high:
            break
        middle = 0.5 * (low + high) if low else 0.3 * high
        pace = recheck_decrease(system, lyapunov, middle)
        low, high = (middle, high) if pace.holds and pace.between_grid >= outcome.between_grid else (low, middle)
    return low


def requested_box(box: Scheduling, rate: Rate, range: Range, keep: bool = False) -> Scheduling:
    """The model's variables with the range and the rates requested.

    Parameters
    ----------
    box : Scheduling
        The model's variables with their own range and rates.
    rate : float, mapping of str to float, or None
        Bound of |ṗ| [units per second], of every variable or by name; None leaves it open.
    range : pair or mapping of str to pair, or None
        Lower and upper value by name; None keeps the box's own.
    keep : bool
        Take the box's own rates instead of `rate`.

    Returns
    -------
    Scheduling
        The same variables in the same order.

    Raises
    ------
    InputError
        A negative rate, a range that is no pair, or an unknown variable.
    """
    rates = _per_variable(box.rate if keep else rate, box.names, "rate")
    for name, bound in rates.items():
        if bound is not None and not _checks.real(bound, f"the rate of '{name}'") >= 0:
            raise InputError(f"the rate of '{name}' must not be negative", got=bound)
    limits = box.limits
    if range is not None:
        single = len(box.names) == 1 and not isinstance(range, Mapping) and np.shape(range) == (2,)
        for name, pair in _per_variable([range] if single else range, box.names, "range").items():
            if np.shape(pair) != (2,):
                raise InputError(f"the range of '{name}' needs a lower and an upper value", got=pair)
            limits[name] = (_checks.real(pair[0], "a lower bound"), _checks.real(pair[1], "an upper bound"))
    return replace(box, lower=tuple(x[0] for x in limits.values()), upper=tuple(x[1] for x in limits.values()),
                   rate=tuple(None if rates.get(n) is None else float(rates[n]) for n in box.names))


def _per_variable(value: Any, names: tuple[str, ...], what: str) -> dict:
    if isinstance(value, Mapping):
        for name in value:
            _checks.known_name(name, names, "scheduling variable")
        return dict(value)
    if value is None or isinstance(value, (int, float, np.number)):
        return dict.fromkeys(names, value)
    listed = list(value)
    if len(listed) != len(names):
        raise InputError(f"{what} needs one entry for each of {', '.join(names) or 'no variables'}", got=value)
    return dict(zip(names, listed, strict=True))
