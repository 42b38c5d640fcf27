"""Tanh laws as LPV models: Hammerstein without displacement, quasi-LPV in the saturation with it."""

from __future__ import annotations

import numpy as np

from lpvid.errors import InputError
from lpvid.model.input_stage import TanhStage
from lpvid.model.signals import Signal
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.scheduling import Polynomial, Product, Scheduling
from quartercar.dampers.laws.coefficients import Coefficient, Controlled, Proportional
from quartercar.dampers.laws.tanh_law import TanhLaw

SATURATION = "saturation"


def to_lpv(damper: TanhLaw, sample_time: float) -> LPVTransferFunction:
    r"""A tanh law as a static LPV model, exact in both forms.

    Without displacement a Hammerstein model with inputs v and tanh(A_3 v), scheduled on the current::

        F = A_2(i) v + A_1(i) tanh(v/v_0) + F_0          v_0 = 1/A_3

    With it a quasi-LPV model with inputs v and x, scheduled on the current and on the saturation ρ of the lagged
    velocity s, which `with_saturation` adds to a record::

        F = A_1(i) A_3 ρ (v + κ x) + A_2(i) (v + κ' x) + F_0       ρ = tanh(A_3 s)/(A_3 s) ∈ (0, 1],  s = v + κ x

    Do, Sename, Dugard (2010) schedule the semi-active damper so. The coefficient of F on v is positive for every ρ.

    Parameters
    ----------
    damper : TanhLaw
        At its own parameters.
    sample_time : float
        Period of the model [s].

    Returns
    -------
    LPVTransferFunction
        Without memory; along records as measured: their polarity and zero of the displacement.

    Raises
    ------
    InputError
        A_3 or κ depend on the current: the coefficients are then no polynomials in the scheduling.
    """
    terms, vector = damper.terms, damper.vector
    pieces = damper.pieces(vector)
    fixed = [c for c in (terms.sharpness, terms.ratio, terms.post_ratio) if c is not None]
    if not all(isinstance(c, Controlled) and c.degree == 0 for c in fixed):
        raise InputError(f"no LPV form of '{damper.name}'", mend="guo, guo-6 or guo-7",
                         why="its sharpness and critical ratio depend on the current, so that the coefficients are no "
                             "polynomials in it")
    force, damping = _powers(terms.yield_force, pieces[0]), _powers(terms.post_yield, pieces[2])
    degree = max(force.size, damping.size) - 1
    force, damping = (np.pad(a, (0, degree + 1 - a.size)) for a in (force, damping))
    sharpness = float(pieces[1][0])
    offset = float(vector[-1]) if damper.offset else 0.0
    names = {"outputs": (Signal("force", "N"),), "metadata": {"damper": damper.name, "polarity": damper.polarity}}
    if terms.ratio is None:
        basis = Polynomial(("current",) if degree else (), degree=degree)
        b, c = np.stack([damping, force])[None, None], offset * np.eye(1, basis.size)[:, None]
        return LPVTransferFunction(np.zeros((0, 1, 1, basis.size)), damper.polarity * b, basis, sample_time,
                                   _box(damper, degree, False), damper.polarity * c,
                                   inputs=(Signal("velocity", "m/s"),), input_stage=TanhStage(v0=1 / sharpness),
                                   **names)
    ratio = float(pieces[3][0])
    post_ratio = ratio if terms.post_ratio is None else float(pieces[4][0])
    saturation = Polynomial((SATURATION,), degree=1)
    basis = Product(Polynomial(("current",), degree=degree), saturation) if degree else saturation
    speed = np.column_stack([damping, sharpness * force]).ravel()
    stroke = np.column_stack([post_ratio * damping, ratio * sharpness * force]).ravel()
    constant = offset * np.eye(1, basis.size)[0] - damper.centre * stroke
    return LPVTransferFunction(np.zeros((0, 1, 1, basis.size)), damper.polarity * np.stack([speed, stroke])[None, None],
                               basis, sample_time, _box(damper, degree, True),
                               damper.polarity * constant[None, None],
                               inputs=(Signal("velocity", "m/s"), Signal("displacement", "m")), **names)


def with_saturation(damper: TanhLaw, record: Record) -> Record:
    """The record with a channel ``saturation``, ρ = tanh(A_3 s)/(A_3 s), that schedules the model of `to_lpv`.

    Parameters
    ----------
    damper : TanhLaw
        At its own parameters.
    record : Record
        With the channels that the law reads.

    Returns
    -------
    Record
        A copy with the channel [1].
    """
    drive = damper.drive(record)
    factors = damper.factors(drive.displacement, drive.velocity, drive.current, damper.vector)
    rho = saturation(factors.sharpness * factors.lagged)
    return record.with_channel(SATURATION, rho, note=f"saturation of the lagged velocity of '{damper.name}'")


def saturation(s: np.ndarray) -> np.ndarray:
    """(n,) tanh(s)/s, 1 at 0.

    Parameters
    ----------
    s : (n,) array
        Argument of the tanh.

    Returns
    -------
    (n,) array
        In (0, 1].
    """
    near = np.abs(s) < 1e-6
    return np.where(near, 1 - s**2 / 3, np.tanh(s) / np.where(near, 1.0, s))


def _powers(coefficient: Coefficient, theta: np.ndarray) -> np.ndarray:
    if isinstance(coefficient, Controlled):
        return coefficient.powers(theta)
    assert isinstance(coefficient, Proportional)
    return np.array([0.0, theta[0]])


def _box(damper: TanhLaw, degree: int, saturated: bool) -> Scheduling:
    low, high = damper.current_range or damper.currents
    rows = [("current", low, high, damper.current_unit)] if degree else []
    rows += [(SATURATION, 0.0, 1.0, "")] if saturated else []
    names, lower, upper, units = zip(*rows, strict=True) if rows else ((), (), (), ())
    return Scheduling(names, lower, upper, units=units)
