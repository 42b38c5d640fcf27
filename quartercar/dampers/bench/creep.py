"""Static forces from creep runs: friction, gas preload and gas stiffness, and how much damping they still contain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError
from lpvid.identification.covariance import inverse_gram
from lpvid.record import Record
from quartercar.dampers.bench.steady_windows import SteadyWindow, WindowSettings, steady_windows
from quartercar.dampers.laws.power_law import PowerLawDamper

CREEPING = WindowSettings(reaction_time=0.05, centre=0.8, unsettled=0.05, drift=0.95)
"""Most of a slope counts: the gas stiffness is its drift."""
BINS = 8
"""means taken along a slope"""
TWO_SPEEDS = 1.5
"""ratio of creep speeds from which friction and damping can be separated"""


@dataclass(frozen=True)
class CreepForces:
    """What a damper exerts when it creeps (source 000, (7)-(9)).

    Attributes
    ----------
    friction, friction_std : float
        F_f, half the difference of the forces pushed in and pulled out, without the damping share [N].
    preload, preload_std : float
        F_gst at displacement 0, outwards [N].
    stiffness, stiffness_std : float
        K_gas = dF_g/dX; the seed prints dF_gst/dX, the slope of a constant [N/m].
    half_difference : float
        (7) as it stands [N].
    contamination : float or None
        Damping force in it [N]; None where nothing shows it.
    source : str
        What shows it: ``"law"``, ``"speeds"`` or ``""``.
    inward, outward : float
        F_in and F_out at displacement 0, compression positive as in the seed [N].
    speed : float
        Mean creep speed [m/s].
    """

    friction: float
    friction_std: float
    preload: float
    preload_std: float
    stiffness: float
    stiffness_std: float
    half_difference: float
    contamination: float | None
    source: str
    inward: float
    outward: float
    speed: float

    def __repr__(self) -> str:
        share = ("contains an unknown share of damping: an upper bound (creep at a second speed separates it)"
                 if self.contamination is None else
                 f"{self.contamination:.3g} N of damping taken off the half difference {self.half_difference:.4g} N")
        return "\n".join([
            f"Static forces, creeping at {1e3 * self.speed:.3g} mm/s: in {self.inward:.4g} N, out {self.outward:.4g} N",
            f"  friction     {self.friction:8.4g} ± {self.friction_std:.2g} N, {share}",
            f"  gas preload  {self.preload:8.4g} ± {self.preload_std:.2g} N outwards",
            f"  gas stiffness{self.stiffness:8.4g} ± {self.stiffness_std:.2g} N/m"])


def static_forces(records: Sequence[Record], law: PowerLawDamper | None = None, polarity: int = 1) -> CreepForces:
    """Friction and gas force from slow strokes in both directions.

    Source 000 in the project's signs (tension positive, F_in = −F(v < 0), F_out = −F(v > 0))::

        F_f = ½ (F_in − F_out)     F_g = ½ (F_in + F_out) = F_gst − K_gas x     K_gas = −dF_g/dx        (7)-(9)

    as one regression of all slopes on sign v, 1 and x. A creep of 20 mm/s is not free of damping (17.5 N of the seed's
    47 N): with a `law` its damping force is subtracted; without one, runs at speeds `TWO_SPEEDS` apart show the share
    that is proportional to speed, per direction; else the friction is marked an upper bound. Damping that differs
    between the directions is in F_g too.

    Parameters
    ----------
    records : sequence of Record
        With ``displacement`` [m] and ``force`` [N]: triangles, or strokes at constant speed.
    law : PowerLaw or PowerLawFrictionGas, optional
        Damping, e.g. of a ramp fit.
    polarity : {1, −1}
        −1 where the force is measured against the velocity.

    Returns
    -------
    CreepForces
        With standard errors from the scatter of the means about the regression.

    Raises
    ------
    InputError
        No steady stroke in one of the directions.
    """
    places, speeds, forces = steady_means(records, CREEPING, BINS, polarity)
    if not (np.any(speeds > 0) and np.any(speeds < 0)):
        raise InputError("creep runs need steady strokes in and out",
                         got="out only" if np.any(speeds > 0) else "in only")
    side = np.sign(speeds)
    plain = np.column_stack([side, -np.ones(side.size), places])
    raw = np.linalg.lstsq(plain, forces, rcond=None)[0]
    magnitudes = np.abs(speeds)
    design, target, source = plain, forces, ""
    if law is not None:
        target, source = forces - law.damping_force(speeds), "law"
    elif magnitudes.max() > TWO_SPEEDS * magnitudes.min():
        design = np.column_stack([plain, np.maximum(speeds, 0.0), np.minimum(speeds, 0.0)])
        source = "speeds"
    solution = np.linalg.lstsq(design, target, rcond=None)[0]
    residual = target - design @ solution
    variance = float(residual @ residual) / max(target.size - solution.size, 1)
    std = np.sqrt(variance * np.diag(inverse_gram(design)))
    return CreepForces(float(solution[0]), float(std[0]), float(solution[1]), float(std[1]), float(solution[2]),
                        float(std[2]), float(raw[0]), float(raw[0] - solution[0]) if source else None, source,
                        float(raw[1] + raw[0]), float(raw[1] - raw[0]), float(magnitudes.mean()))


def steady_means(records: Sequence[Record], settings: WindowSettings, bins: int,
                 polarity: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacement, velocity and force, each (n,): means along the steady part of every slope.

    Parameters
    ----------
    records : sequence of Record
        Uniform, with ``force`` and ``displacement`` or ``velocity``.
    settings : WindowSettings
        How steady a slope must be.
    bins : int
        Means taken along each slope.
    polarity : {1, −1}
        −1 where the force is measured against the velocity.

    Returns
    -------
    displacement : (n,) array
        Means along the slopes [m]; zeros where it was not measured.
    velocity : (n,) array
        Of the slope that each mean belongs to [m/s].
    force : (n,) array
        In the damper's own sense [N].

    Raises
    ------
    InputError
        No slope is steady: the message gives the first reason.
    """
    rows: list[tuple[float, float, float]] = []
    looked: list[SteadyWindow] = []
    for record in records:
        found = steady_windows(record, settings, polarity)
        looked += found
        for window in (w for w in found if np.isfinite(w.force)):
            period = float(record.sample_time or 0.0)
            span = slice(round(window.start / period), round(window.stop / period))
            x = record["displacement"] if record.has("displacement") else np.zeros(record.n_samples)
            parts = zip(np.array_split(x[span], bins), np.array_split(record["force"][span], bins), strict=True)
            rows += [(float(a.mean()), window.velocity, polarity * float(b.mean())) for a, b in parts if a.size]
    if not rows:
        raise InputError("no slope of these records is steady", why=looked[0].fault if looked else "nothing moves",
                         mend="strokes at constant speed (triangles)")
    places, speeds, forces = np.array(rows).T
    return places, speeds, forces
