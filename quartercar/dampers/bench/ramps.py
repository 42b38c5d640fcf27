"""Coefficients of the gas-filled damper from ramps: friction, gas and both directions in one weighted fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from lpvid.errors import InputError
from lpvid.identification.covariance import clusters, inverse_gram
from lpvid.least_squares import FunctionResiduals, StopRule, minimise_dense
from lpvid.record import Record
from quartercar.dampers.bench.creep import steady_means
from quartercar.dampers.bench.steady_windows import WindowSettings
from quartercar.dampers.laws.power_law import DIRECTIONS, PowerLawFrictionGas

RAMPS = WindowSettings(drift=0.95)
"""30 ms dropped after a turn and the centre half kept (equations.md 7.1); the gas spring may drift."""
BINS = 5
"""means taken along a slope, so that the gas stiffness shows"""
FLOOR = 50.0
"""least force that weighs a point [N]: weights are 1/max(|F|, 50 N)"""
SHARP = 0.2
"""width of the friction's turn by the slowest speed: the points lie beyond it"""
MISSED = 0.05
"""relative residual from which a law does not describe its own points"""
EXPONENTS = (1.3, 1.8, 2.3, 2.8)


@dataclass(frozen=True, eq=False)
class RampFit:
    """A gas-filled damper identified from ramps.

    Attributes
    ----------
    law : PowerLawFrictionGas
    covariance : (P, P) array
        In the order of ``law.names``, SI; NaN for what was held. Of the sandwich kind, because the weights serve the
        relative error and do not follow the noise (White 1980, with n/(n − p)).
    held : tuple of str
        Parameters that were left out: a direction without a power term.
    displacement, velocity, force : (n,) array
        The points [m], [m/s], [N].
    rms : float
        Of the residual relative to max(|F|, 50 N).
    """

    law: PowerLawFrictionGas
    covariance: np.ndarray
    held: tuple[str, ...]
    displacement: np.ndarray
    velocity: np.ndarray
    force: np.ndarray
    rms: float

    @property
    def std(self) -> dict[str, float | None]:
        """Standard error by parameter; None for what was held."""
        errors = np.sqrt(np.diag(self.covariance))
        return {n: None if np.isnan(e) else float(e) for n, e in zip(self.law.names, errors, strict=True)}

    @property
    def correlation(self) -> np.ndarray:
        """(P, P) correlation of the estimates."""
        errors = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(errors, errors)

    @property
    def describes(self) -> bool:
        """Whether the points lie on the law, to `MISSED` of their force."""
        return self.rms < MISSED

    def __repr__(self) -> str:
        lines = [f"Ramp fit: {self.force.size} points, relative residual {self.rms:.2%} rms"]
        for p in self.law.parameters:
            error = self.std[p.name]
            stated = "held: no power term in this direction" if error is None else f"± {error:.2g} {p.unit}"
            lines.append(f"  {p.name:<26}{self.law.values[p.name]:10.5g} {stated}")
        if not self.describes:
            lines.append("  it does not describe its own points: a law of another shape (quartercar fit --models all)")
        return "\n".join(lines)


def fit_ramps(records: Sequence[Record], polarity: int = 1) -> RampFit:
    """Weighted least squares for F_c, F_gst, K_gas and C_1, P, n of both directions on the steady points of ramps.

    Slow ramps (creep runs) among the records separate friction from linear damping, which the seed's two steps
    (creep first, then a fit of what is left) leave mixed. A direction keeps its power term only where that is worth its
    two parameters (BIC); otherwise it is linear, as the seed's compression.

    Parameters
    ----------
    records : sequence of Record
        Triangles with ``force`` and ``displacement`` (without one the gas stiffness is left out).
    polarity : {1, −1}
        −1 where the force is measured against the velocity.

    Returns
    -------
    RampFit
        Of least BIC over the directions that keep their power term.

    Raises
    ------
    InputError
        No steady slopes, or fewer speeds than a direction needs.
    """
    places, speeds, forces = steady_means(records, RAMPS, BINS, polarity)
    spring = all(r.has("displacement") for r in records)
    for side, sign in zip(DIRECTIONS, (1, -1), strict=True):
        count = np.unique(np.round(speeds[speeds * sign > 0], 4)).size
        if count < 4:
            raise InputError(f"ramps in {side} are too few", got=f"{count} speeds",
                             why="4 separate friction, linear and power term")
    start = PowerLawFrictionGas(reference_speed=round(0.7 * float(np.abs(speeds).max()), 4), spring=spring,
                                friction_speed=min(2e-3, SHARP * float(np.abs(speeds).min())))
    points = places, speeds, forces
    best: tuple[float, PowerLawFrictionGas, tuple[str, ...]] | None = None
    for left_out in ((), DIRECTIONS[1:], DIRECTIONS[:1], DIRECTIONS):
        held = tuple(f"{name}_{side}" for side in left_out for name in ("power_force", "exponent"))
        law, cost = _fitted(start, held, points)
        score = forces.size * np.log(cost / forces.size) + (len(start.names) - len(held)) * np.log(forces.size)
        if best is None or score < best[0]:
            best = score, law, held
    assert best is not None
    _, law, held = best
    return _described(law, held, points)


def _described(law: PowerLawFrictionGas, held: tuple[str, ...], points: tuple[np.ndarray, ...]) -> RampFit:
    places, speeds, forces = points
    free = [k for k, n in enumerate(law.names) if n not in held]
    weight = 1 / np.maximum(np.abs(forces), FLOOR)
    gradient = law.law_gradient(places, speeds, 0 * speeds, law.vector)[:, free] * weight[:, None]
    residual = (law.law(places, speeds, 0 * speeds, law.vector) - forces) * weight
    inverse, middle = inverse_gram(gradient), clusters(gradient * residual[:, None], np.arange(residual.size))
    covariance = np.full((len(law.names), len(law.names)), np.nan)
    inflation = forces.size / max(forces.size - len(free), 1)
    covariance[np.ix_(free, free)] = inflation * (inverse @ middle @ inverse)
    return RampFit(law, covariance, held, places, speeds, forces, float(np.sqrt(np.mean(residual**2))))


def _fitted(start: PowerLawFrictionGas, held: tuple[str, ...],
            points: tuple[np.ndarray, ...]) -> tuple[PowerLawFrictionGas, float]:
    """Best law from a grid of exponents, with the `held` parameters at no power term, and its weighted cost."""
    places, speeds, forces = points
    weight, zero = 1 / np.maximum(np.abs(forces), FLOOR), np.zeros(speeds.size)
    free = [k for k, n in enumerate(start.names) if n not in held]
    lower = np.array([p.lower for p in start.parameters])[free]
    upper = np.array([p.upper for p in start.parameters])[free]
    base = start.with_values(**{n: 1.0 if n.startswith("exponent") else 0.0 for n in held}).vector

    def whole(theta: np.ndarray) -> np.ndarray:
        vector = base.copy()
        vector[free] = theta
        return vector

    residuals = FunctionResiduals(
        lambda theta: (start.law(places, speeds, zero, whole(theta)) - forces) * weight,
        lambda theta: start.law_gradient(places, speeds, zero, whole(theta))[:, free] * weight[:, None])
    found, least = base, np.inf
    moved = [n for n in ("exponent_extension", "exponent_compression") if n not in held]
    for exponents in product(EXPONENTS, repeat=len(moved)):
        begin = start.with_values(**dict(zip(moved, exponents, strict=True))).vector[free]
        result = minimise_dense(residuals, np.clip(begin, lower, upper), StopRule(), (lower, upper))
        if result is not None and result.cost < least:
            found, least = whole(result.trial.point), result.cost
    return start.with_vector(found), least
