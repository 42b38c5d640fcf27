"""Kwok's law as a quasi-LPV model, scheduled on the current and two secants."""

from __future__ import annotations

import numpy as np

from lpvid.model.signals import Signal
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.scheduling import Polynomial, Product, Scheduling
from quartercar.dampers.laws.coefficients import settled_span
from quartercar.dampers.laws.kwok import Kwok
from quartercar.dampers.laws.tanh_lpv import saturation

SECANTS = ("saturation", "turning")


def to_lpv(damper: Kwok, sample_time: float) -> LPVTransferFunction:
    r"""Kwok's law as a static quasi-LPV model with inputs v and x, exact.

    With ρ = tanh(s)/s of s = β v + δ(i) tanh(x/ε), and χ = ρ tanh(x/ε)/(x/ε), both in (0, 1]::

        F = [c(i) + α(i) β ρ] v + [k(i) + α(i) δ(i) χ/ε] x + f_0(i)

    scheduled on the current, ρ (``saturation``) and χ (``turning``), which `with_secants` adds to a record.

    Parameters
    ----------
    damper : Kwok
        At its own parameters.
    sample_time : float
        Period of the model [s].

    Returns
    -------
    LPVTransferFunction
        Without memory; along records as measured: their polarity and zero of the displacement.
    """
    degree = damper.degree
    blocks = dict(zip(damper.functions, np.split(damper.vector[:-1], len(damper.functions)), strict=True))
    powers = {name: f.powers(blocks[name]) for name, f in damper.functions.items()}
    quadratic = 2 * degree                                                 # α δ is quadratic where both are affine

    def padded(c: np.ndarray) -> np.ndarray:
        return np.pad(c, (0, quadratic + 1 - c.size))

    none = np.zeros(quadratic + 1)
    sharpness, width = float(damper.vector[-1]), damper.turning_stroke
    alpha, delta = powers["hysteresis_force"], powers["hysteresis_shift"]
    speed = np.column_stack([padded(powers["viscous_damping"]), padded(sharpness * alpha), none]).ravel()
    stroke = np.column_stack([padded(powers["stiffness"]), none, padded(np.convolve(alpha, delta) / width)]).ravel()
    constant = np.column_stack([padded(powers["offset"]), none, none]).ravel() - damper.centre * stroke
    secants = Polynomial(SECANTS, degree=1)
    basis = Product(Polynomial(("current",), degree=quadratic), secants) if degree else secants
    low, high = damper.current_range or settled_span(damper.span, None)
    current = [("current", low, high, damper.current_unit)] if degree else []
    names, lower, upper, units = zip(*current, *((n, 0.0, 1.0, "") for n in SECANTS), strict=True)
    return LPVTransferFunction(
        np.zeros((0, 1, 1, basis.size)), damper.polarity * np.stack([speed, stroke])[None, None], basis, sample_time,
        Scheduling(names, lower, upper, units=units), damper.polarity * constant[None, None],
        inputs=(Signal("velocity", "m/s"), Signal("displacement", "m")), outputs=(Signal("force", "N"),),
        metadata={"damper": damper.name, "polarity": damper.polarity})


def with_secants(damper: Kwok, record: Record) -> Record:
    """The record with the channels ``saturation`` and ``turning`` that schedule the model of `to_lpv`.

    Parameters
    ----------
    damper : Kwok
        At its own parameters.
    record : Record
        With displacement, velocity and, where the law depends on it, current.

    Returns
    -------
    Record
        A copy with both channels [1].
    """
    drive = damper.drive(record)
    _, _, _, delta, _ = damper.coefficients(drive.current, damper.vector)
    side = drive.displacement / damper.turning_stroke
    rho = saturation(damper.vector[-1] * drive.velocity + delta * np.tanh(side))
    note = f"secant of the hysteresis of '{damper.name}'"
    return record.with_channel(SECANTS[0], rho, note=note).with_channel(SECANTS[1], rho * saturation(side), note=note)

