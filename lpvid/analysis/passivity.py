"""Passivity while the scheduling moves: a storage function that anyone can re-check with numpy alone."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from lpvid.analysis.bound import first_proven
from lpvid.analysis.certificates import Range, Rate, behind_filter, requested_box
from lpvid.analysis.passivity_certificate import PassivityCertificate, reading_box, recheck_passivity
from lpvid.analysis.passivity_margin import passivity_margin
from lpvid.errors import InputError
from lpvid.lmi.certificate import Recheck
from lpvid.lmi.certificate_common import certificate_kind
from lpvid.lmi.passive_form import obstacle, preload, sector_basis, slack, supplied
from lpvid.lmi.passive_search import PassiveProgram, current_centre
from lpvid.lmi.passive_unknowns import Iterate, frame_of, scaled
from lpvid.lmi.storage import Storage
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Polynomial, Scheduling

HIGHEST = 2
"""degree of P in the scheduling up to which it is looked for."""
RECENTRED = 3
"""programs for each degree, each in the coordinates of the answer before."""


def certify_passivity(model: LPVTransferFunction, rate: Rate = None, range: Range = None,
                      degree: int = HIGHEST) -> PassivityCertificate:
    """Look for a storage function that proves a model passive while its scheduling moves.

    The dissipation inequality stands in `lpvid.lmi.passive_form`: P(p) of rising degree, and a multiplier λ(p) for the
    sector of a tanh stage. Whatever a solver proposes counts only after a re-check with numpy, on the whole box where
    the dependence is polynomial. Any motion of the scheduling is tried first, then that which the model's own
    scheduling filter lets through.

    Parameters
    ----------
    model : LPVTransferFunction
        From one input (a velocity) to one output (a force), coefficients at p(k).
    rate : float, sequence or mapping of name to float, optional
        Bound on |dp/dt| [units per second]; None leaves the variation arbitrary.
    range : (lower, upper), one pair for each variable, or mapping of name to pair, optional
        Left out, the model's own box.
    degree : int
        Highest degree of P in the scheduling.

    Returns
    -------
    PassivityCertificate
        "not certified" with the reason where none was found. A model that is active in a steady motion is named as
        such; else the question is open.

    Raises
    ------
    InputError
        A rate or range that does not fit the model.

    References
    ----------
    Willems, Arch. Rational Mech. Anal. 45 (1972) 321-393; Daafouz & Bernussou, Systems & Control Letters 43 (2001)
    355-359, for P(p) with arbitrary jumps; Yakubovich 1971 for the S-procedure.

    Examples
    --------
    >>> spring_and_damper = LPVTransferFunction.siso(a=[[-0.5, 0.1]], b=[[1.0, 0.2]], basis=Polynomial("p", degree=1),
    ...                                              sample_time=0.01)
    >>> certify_passivity(spring_and_damper).verdict
    'certified'
    """
    if not isinstance(model, LPVTransferFunction):
        raise InputError("a passivity certificate needs an LPV transfer function", got=type(model).__name__)
    scheduling = requested_box(model.box, rate, range)
    fault = obstacle(model) or _hopeless(model, scheduling)
    if fault:
        return _none(model, scheduling, fault)
    found = first_proven(_certificates(model, scheduling, degree))
    return found or _none(model, scheduling, "no storage function was found, nor a steady motion that gives energy: "
                            "passivity is open here")


def _certificates(model: LPVTransferFunction, scheduling: Scheduling, degree: int) -> Iterator[PassivityCertificate]:
    for box in dict.fromkeys((scheduling, behind_filter(model, scheduling))):
        for order in np.arange(degree + 1 if _moves(model, box) else 1):
            for proof in _proofs(model, box, int(order)):
                yield certificate_of(model, *proof)


def certificate_of(model: LPVTransferFunction, storage: Storage, multiplier: np.ndarray, outcome: Recheck
                   ) -> PassivityCertificate:
    """The certificate of what `recheck_passivity` found to hold.

    Parameters
    ----------
    model : LPVTransferFunction
        What it is about.
    storage : Storage
        P, in the model's own units.
    multiplier : (L,) array
        λ over `sector_basis` [unit of the output]; empty without a stage.
    outcome : Recheck
        Of the three.

    Returns
    -------
    PassivityCertificate
        `verified` where the outcome holds.
    """
    return PassivityCertificate(
        certificate_kind(storage),
        storage.matrices,
        storage.basis,
        multiplier,
        preload(model) or 0.0,
        storage.box,
        model.sample_time,
        supplied(model, multiplier).digest,
        outcome.holds,
        outcome.margin,
        outcome.between_grid,
        "",
        "CLARABEL",
        model.outputs[0].unit,
    )


def proven(model: LPVTransferFunction, program: PassiveProgram, iterate: Iterate, units: tuple[float, float]
           ) -> tuple[Storage, np.ndarray, Recheck]:
    """The storage function and multiplier of a scaled program in the model's own units, and their check by numpy.

    Parameters
    ----------
    model : LPVTransferFunction
    program : PassiveProgram
        Of the model `scaled` by `units`.
    iterate : Iterate
    units : (float, float)
        Speed and force.

    Returns
    -------
    Storage
        P over the box of what the inequality reads.
    (L,) array
        λ [unit of the output].
    Recheck
        Of both, for the model.
    """
    speed, force = units
    nu, na = model.n_filter_inputs, model.na
    size = np.ones(program.sizes[0])
    size[:na] = force
    size[na::nu] = speed
    matrices = speed * force * iterate.matrices / np.outer(size, size)
    box = reading_box(model, program.box)
    storage = Storage(0.5 * (matrices + matrices.swapaxes(1, 2)), program.basis, box, model.sample_time)
    multiplier = iterate.multiplier * force
    return storage, multiplier, recheck_passivity(model, storage, multiplier)


def _proofs(model: LPVTransferFunction, box: Scheduling, degree: int
            ) -> Iterator[tuple[Storage, np.ndarray, Recheck]]:
    units = _natural_units(model)
    for density in (1, 2):
        program = PassiveProgram(scaled(model, *units), box, degree, np.zeros((0, 5), dtype=int), density)
        frame, room = frame_of(program.model), 0.0
        for _ in np.arange(RECENTRED):
            found = program.given(frame, room)
            if found is None:
                return
            if found.shortage < 0:
                outcome = proven(model, program, found, units)
                if outcome[2].holds:
                    yield outcome
                    return
            try:
                frame, room = np.linalg.inv(np.linalg.cholesky(current_centre(program, found))).T, 1.0
            except np.linalg.LinAlgError:
                break


def _natural_units(model: LPVTransferFunction) -> tuple[float, float]:
    """(speed, force) in which the model's input and output are about one, at the centre of its box."""
    centre = model.box.centre[None]
    speed = float(slack(model, centre)[0]) if model.n_filter_inputs > 1 else 1.0
    a, b, _ = model.coefficients(model.box.centre)
    gains = np.abs(b[:, 0].sum(axis=0) / (1 + a[:, 0, 0].sum()))
    force = float(gains[0] * speed + gains[1:].sum())
    return (speed if speed > 0 else 1.0), (force if 0 < force < math.inf else 1.0)


def _moves(model: LPVTransferFunction, box: Scheduling) -> bool:
    read = sector_basis(model).names
    return any(high > low and n in read for n, low, high in zip(box.names, box.lower, box.upper, strict=True))


def _hopeless(model: LPVTransferFunction, scheduling: Scheduling) -> str:
    """Why no storage function can exist, from what is seen without a search."""
    if preload(model) is None:
        return ("its affine terms are not those of a constant preload: a force at rest that depends on the scheduling "
                "does work when that moves")
    margin = passivity_margin(model.replace(scheduling=scheduling))
    return f"it is active: {margin.description(None)}" if margin.active else ""


def _none(model: LPVTransferFunction, scheduling: Scheduling, why: str) -> PassivityCertificate:
    return PassivityCertificate("none", np.zeros((0, 0, 0)), Polynomial((), 0), np.zeros(0), 0.0, scheduling,
                                model.sample_time, "", False, math.nan, False, why)
