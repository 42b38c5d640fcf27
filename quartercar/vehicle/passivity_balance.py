"""What a damper stores and takes along a run: passivity as it happened."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lpvid.codec import Encoded
from quartercar.dampers.blackbox.sampled import SampledDamper
from quartercar.dampers.evaluation.sampled_passivity import stored_energy
from quartercar.dampers.families import StaticDamper

if TYPE_CHECKING:
    from quartercar.dampers.contract import Damper
    from quartercar.vehicle.result import CarRun

ROUNDING = 1e-6
"""share of the power or energy exchanged below which a loss is rounding"""
POINTS = 41
"""of the grids on which a law's power is looked at"""


@dataclass(frozen=True)
class RidePassivity(Encoded):
    """Whether a damper gave more energy than it had stored.

    Attributes
    ----------
    dissipated : float
        Delivered by the motion, less what is stored more at the end than at the start [J]; without a storage function
        what was delivered beside the force of displacement alone.
    storage : {"known", "unknown"}
        Whether the damper's model has a storage function (gas, spring, moved mass).
    lowest : float or None
        Least of delivered − stored + initial storage over the run, the force of displacement left out of all three
        [J]; None where the storage is unknown.
    holds : bool or None
        Whether that never fell below zero but for rounding.
    negative_share : float
        Share of the samples with F·v < 0, the force of displacement alone left out.
    negative_energy : float
        Energy given in them [J].
    returned : float
        Most that came back at a stretch: the largest fall of the delivered energy from any earlier level [J].
    """

    dissipated: float
    storage: str
    lowest: float | None
    holds: bool | None
    negative_share: float
    negative_energy: float
    returned: float

    def __str__(self) -> str:
        stated = (f"F*v < 0 in {self.negative_share:.1%} of the samples, {self.negative_energy:.3g} J in all, at most "
                f"{self.returned:.3g} J at a stretch")
        if self.holds is None:
            return f"{self.dissipated:.4g} J taken; no storage function: {stated}"
        verdict = "never gave more than it had" if self.holds else f"GAVE {-(self.lowest or 0):.3g} J it never had"
        return f"{self.dissipated:.4g} J dissipated; {verdict}; {stated}"


def ride_passivity(run: CarRun, currents: tuple[float, float] = (0.0, 2.5)) -> RidePassivity:
    """Energy of the damper along a run.

    Parameters
    ----------
    run : CarRun
    currents : (float, float)
        Range over which a law is tested for a storage function.

    Returns
    -------
    RidePassivity

    Notes
    -----
    E(t) = ∫F v dt, by the trapezoidal rule. A damper with storage S ≥ 0 has E(t) − S(t) ≥ −S(0) for every t (Willems
    1972, Arch. Rational Mech. Anal. 45, 321-351). A law without memory F = F_gas(z) + F_d(z, v, i) with F_d·v ≥ 0 on a
    grid has S = ∫F_gas dz, and a moved mass ½ m v² beside it; a rising law in series with a spring (`Compliance` of one
    velocity lag) has F_s²/2k_h beside it. A sampled model with a certificate of passivity has S = T·x'P x in its past.
    The sum T·Σ F(k) v(k) at its own samples bounds that, and is taken in place of the integral; the car moves by the
    trapezoidal rule, whose work is less by ¼T·Σ ΔF Δv. Other models have none that is known.
    """
    damper = run.car.damper
    z, v, force = (run[n] for n in ("suspension_deflection", "suspension_velocity", "damper_force"))
    spring = np.zeros(z.size) if damper is None else np.asarray(damper.conservative_force(z), dtype=float)
    free = force - spring
    sampled = stored_energy(damper, v, run["current"], free)
    delivered = _integral(free * v, run.sample_time)
    if sampled is not None:  # the sum that the dissipation inequality of a sampled model bounds
        delivered = np.cumsum(free * v) * run.sample_time
    power = free * v
    given = power < -ROUNDING * max(float(np.abs(power).max(initial=0.0)), 1e-12)
    returned = float(np.max(np.maximum.accumulate(delivered) - delivered))
    exchanged = float(np.sum(np.abs(power)) * run.sample_time)
    common = {"negative_share": float(given.mean()), "returned": returned,
              "negative_energy": float(-np.sum(power[given]) * run.sample_time)}
    stored = _stored(damper, free, v, currents) if sampled is None else sampled[1:]
    if stored is None:
        return RidePassivity(float(delivered[-1]), "unknown", None, None, **common)
    balance = delivered - (stored - (stored[0] if sampled is None else sampled[0]))
    lowest = float(balance.min())
    return RidePassivity(float(balance[-1]), "known", lowest, lowest >= -1e-3 * max(exchanged, 1e-12), **common)


def _stored(damper: Damper | None, free: np.ndarray, v: np.ndarray,
            currents: tuple[float, float]) -> np.ndarray | None:
    """(n,) energy stored beside that of the force of displacement [J]; None where it is not known."""
    elements = None if damper is None else damper.linear_elements
    if elements is not None:
        return 0.5 * elements.mass * v**2
    series = _series_spring(damper)
    if series is not None:
        stiffness, parallel = series
        return (free - parallel * v) ** 2 / (2 * stiffness)
    return np.zeros(v.size) if has_storage(damper, currents) else None


def _series_spring(damper: Damper | None) -> tuple[float, float] | None:
    """(k_h [N/m], viscous damping in parallel [N·s/m]) of a rising law in series with a spring; None for any other."""
    from lpvid.model.compliance import ComplianceModel

    if not isinstance(damper, SampledDamper) or damper.stored is None:
        return None
    model = damper.held.at(damper.vector)
    if not isinstance(model, ComplianceModel) or len(model.elements) > 1 or model.direct.size > 1:
        return None
    parallel = float(model.direct.sum())
    return (model.elements[0].stiffness, parallel) if parallel >= 0 else None


def has_storage(damper: Damper | None, currents: tuple[float, float]) -> bool:
    """Whether gas, spring and moved mass are all that a damper stores: F_d·v ≥ 0 wherever it is evaluated.

    A force at rest that the current moves (Guo's hysteresis) has none: the current could be used to take energy out.

    Parameters
    ----------
    damper : Damper or None
        None for the viscous one, which stores nothing.
    currents : (float, float)
        Range over which a law is evaluated, in the damper's unit; displacements up to 80 mm, velocities up to 2 m/s.

    Returns
    -------
    bool
        False for every damper with a memory.

    Examples
    --------
    >>> from quartercar.dampers import Guo
    >>> has_storage(Guo(hysteresis=False), (0.0, 2.0)), has_storage(Guo(degree=1), (0.0, 2.0))
    (True, False)
    """
    if damper is None or damper.linear_elements is not None:
        return True
    if not isinstance(damper, StaticDamper):
        return False
    z, v, i = (a.ravel() for a in np.meshgrid(np.linspace(-0.08, 0.08, POINTS), np.linspace(-2, 2, POINTS),
                                              np.linspace(*currents, 5)))
    power = (damper.law(z, v, i, damper.vector) - damper.conservative_force(z)) * v
    return bool(np.all(power >= -ROUNDING * np.abs(power).max()))


def _integral(power: np.ndarray, step: float) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) * step])
