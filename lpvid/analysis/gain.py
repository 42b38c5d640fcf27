"""Induced L2 gain of an LPV system: certified from above, reached from below."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from lpvid.analysis.certificates import Range, Rate, requested_box
from lpvid.analysis.frozen_norms import largest_frozen_norm
from lpvid.analysis.gain_bounds import GainBounds, usable, worst_pole
from lpvid.analysis.worst_case import WorstCase, worst_trajectory
from lpvid.codec import Coded, null
from lpvid.errors import InputError
from lpvid.lmi.certificate_common import verdict_of
from lpvid.lmi.driven import Driven, driven
from lpvid.lmi.gain_certificate import GainCertificate
from lpvid.lmi.hull_certificate import HullCertificate
from lpvid.lmi.readings import box_of
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Scheduling

VERDICTS = ("certified", "certified on a grid only", "not certified", "unstable")


@dataclass(frozen=True, eq=False)
class Gain(Coded):
    """What is known of sup ‖z‖/‖w‖ over all inputs and all admissible trajectories of the scheduling.

    Parameters
    ----------
    verdict : str
        One of `VERDICTS`.
    upper : float
        Certified; infinite where nothing could be certified.
    lower : float
        Reached by `worst`; infinite for a frozen system that is unstable.
    worst : WorstCase or None
        A scheduling, held or moving, with which the gain is at least `lower`.
    certificate : GainCertificate or None
        What `lpvid.verify` re-checks.
    inputs, outputs : tuple of str
    why, mend : str
        Why there is no certificate, and what can be done.
    seconds : float
    """

    JSON = ("verdict", "upper", "lower", "between_grid", "inputs", "outputs", "worst", "certificate", "why", "mend",
            "seconds")

    verdict: str
    upper: float = field(metadata=null(math.inf))
    lower: float = field(metadata=null(math.inf))
    worst: WorstCase | None
    certificate: GainCertificate | None = field(metadata={"read": lambda data, _: _certificate(data)})
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    why: str = ""
    mend: str = ""
    seconds: float = 0.0

    @property
    def between_grid(self) -> bool:
        """`upper` is proven on the whole scheduling box."""
        return self.certificate is not None and self.certificate.between_grid

    def __repr__(self) -> str:
        lines = [f"{self.verdict}: {self.why or self.certificate.claim if self.certificate else self.why}"]
        if math.isfinite(self.lower):
            lines.append(f"  at least {self.lower:.6g}: {self.worst}" if self.worst else f"  at least {self.lower:.6g}")
        if self.certificate is not None:
            lines.append(f"  {self.certificate.kind} storage function, margin {self.certificate.margin:.3g}, "
                         "re-checked with numpy")
        if self.mend:
            lines.append(f"  mend: {self.mend}")
        return "\n".join(lines)


def l2_gain(system: LPVStateSpace, rate: Rate = None, basis: Basis | None = None, *, range: Range = None,
            trajectories: bool = True) -> Gain:
    """Bounds of the induced L2 (ℓ2) gain from a model's inputs to its outputs while its scheduling moves.

    The upper bound is the least γ for which a storage function xᵀP(p)x passes our own re-check of the bounded-real
    inequality (equations sheet, 5.3); a solver only proposes it. The lower bound is reached: the largest frozen
    H-infinity norm, or a moving scheduling with its worst input. The linear part is meant: after an input stage, and
    without affine terms.

    Parameters
    ----------
    system : LPVStateSpace
        Continuous or discrete.
    rate : float, sequence or mapping of name to float, optional
        Bound on |dp/dt| [units per second]; infinite for arbitrary variation. Left out, those of the model's box.
    basis : Basis, optional
        Functions of p in P(p); left out, a constant and then polynomials up to degree 3.
    range : (lower, upper), one pair for each variable, or mapping of name to pair, optional
        Left out, the model's own box.
    trajectories : bool
        Look for moving schedulings that raise the lower bound.

    Returns
    -------
    Gain

    Raises
    ------
    InputError
        No state-space model; a rate, range or basis that does not fit it.

    Examples
    --------
    >>> import numpy as np
    >>> from lpvid.scheduling import Polynomial
    >>> eye = np.eye(2)                               # A = −I, B = [1; d], C = [d, −1]: zero for every frozen d
    >>> model = LPVStateSpace([-eye, 0 * eye], [[[1], [0]], [[0], [1]]], [[[0, -1]], [[1, 0]]], np.zeros((2, 1, 1)),
    ...                       Polynomial("d", degree=1), None, Scheduling(("d",), (-1,), (1,)))
    >>> slow, any_speed = (l2_gain(model, rate=r, trajectories=False) for r in (0.1, math.inf))
    >>> round(slow.upper, 3), round(any_speed.upper, 3), any_speed.between_grid
    (0.099, 1.0, True)
    """
    return l2_gains(system, (rate,), basis, range=range, trajectories=trajectories)[0]


def l2_gains(system: LPVStateSpace, rates: Sequence[Rate], basis: Basis | None = None, *, range: Range = None,
             trajectories: bool = False) -> tuple[Gain, ...]:
    """`l2_gain` for several rate bounds; the semidefinite programs are compiled once.

    Parameters
    ----------
    system, basis, range, trajectories
        As for `l2_gain`.
    rates : sequence
        Each as the ``rate`` of `l2_gain`.

    Returns
    -------
    tuple of Gain
        One for each rate; all "unstable" where a frozen model is.

    Raises
    ------
    InputError
        No rate at all, and whatever `l2_gain` refuses.
    """
    also = () if basis is None else tuple(n for n in basis.names if n in system.box.names)
    plant = driven(system, also)
    boxes = [box_of(plant.readings, rated(system.box, rate, range)) for rate in rates]
    if not boxes:
        raise InputError("a sweep needs at least one rate", got="none")
    begun = time.perf_counter()
    level, at = worst_pole(plant, boxes[0])
    if level >= 0:
        where = ", ".join(f"{n} = {v:.6g}" for n, v in zip(boxes[0].names, at, strict=True))
        lost = Gain("unstable", math.inf, math.inf, None, None, plant.inputs, plant.outputs,
                    "the model has a pole that does not decay" + (f" at {where}" if where else ""),
                    "narrow the scheduling range, or stabilise the model first", time.perf_counter() - begun)
        return (lost,) * len(boxes)
    norm, point, frequency = largest_frozen_norm(plant, boxes[0])
    frozen = WorstCase.frozen(boxes[0], point, frequency, norm)
    bounds: dict[tuple, GainBounds] = {}
    found = []
    for box in boxes:
        started = time.perf_counter()
        pattern = tuple(r is None for r in box.rate)
        if pattern not in bounds:
            fitted = None if basis is None else usable(basis, box, plant.sample_time is not None)
            bounds[pattern] = GainBounds(plant, box, fitted, norm)
            if len(boxes) > 1 and plant.sample_time is None:
                bounds[pattern].prepare(box.rate)
        worst = worst_trajectory(plant, box, frozen) if trajectories else frozen
        certificate = bounds[pattern].certify(box.rate)
        found.append(_judged(plant, worst, certificate, time.perf_counter() - started))
    return tuple(found)


def _judged(plant: Driven, worst: WorstCase, certificate: GainCertificate | None, seconds: float) -> Gain:
    if certificate is None:
        return Gain("not certified", math.inf, worst.gain, worst, None, plant.inputs, plant.outputs,
                    "no storage function was found that bounds the gain",
                    "give a rate bound, narrow the range, or look for a trajectory that grows with "
                    "lpvid.certify_stability", seconds)
    verdict = verdict_of(certificate.between_grid)
    return Gain(verdict, certificate.gamma, worst.gain, worst, certificate, plant.inputs, plant.outputs,
                seconds=seconds)


def requested(system: LPVStateSpace, rate: Rate, basis: Basis | None, range: Range) -> tuple[Driven, Scheduling]:
    """What an analysis is about: the linear part of a system, and the box of what it reads.

    Parameters
    ----------
    system : LPVStateSpace
        The model.
    rate, range
        As for `rated`.
    basis : Basis or None
        Of the storage function: what it reads is listed too.

    Returns
    -------
    (Driven, Scheduling)
        Both with one entry for each reading.
    """
    plant = driven(system, () if basis is None else tuple(n for n in basis.names if n in system.box.names))
    return plant, box_of(plant.readings, rated(system.box, rate, range))


def rated(box: Scheduling, rate: Rate, range: Range) -> Scheduling:
    """The requested box: rates left out are the box's own, an infinite one is no bound.

    Parameters
    ----------
    box : Scheduling
        The model's variables with their own range and rates.
    rate : float, sequence or mapping of name to float, or None
        Bound of |dp/dt| [units per second]; infinite for any motion.
    range : pair, pairs or mapping of name to pair, or None
        Lower and upper value; None keeps the box's own.

    Returns
    -------
    Scheduling
        The same variables in the same order.
    """
    def bounded_rate(value: float | None) -> float | None:
        return None if value is None or value == math.inf else value

    if isinstance(rate, Mapping):
        rate = {name: bounded_rate(value) for name, value in rate.items()}
    elif isinstance(rate, Sequence):
        rate = [bounded_rate(value) for value in rate]
    return requested_box(box, None if rate == math.inf else rate, range, keep=rate is None)


def _certificate(data: Mapping) -> GainCertificate:
    kind = HullCertificate if data.get("schema") == HullCertificate.SCHEMA else GainCertificate
    return kind.from_dict(data)  # type: ignore[return-value]
