"""YieldingLaw: the damper of Do (2010), viscous and elastic forces beside a yield force that is the control."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError
from lpvid.toolkit import checks
from quartercar.dampers.contract import Damper
from quartercar.dampers.laws.coefficients import Controlled
from quartercar.dampers.laws.tanh_law import TanhLaw
from quartercar.lpv_models.car_part import passive_sense

CURRENTS = (0.0, 2.5)
"""Currents of the coil [A]."""


@dataclass(frozen=True)
class YieldingLaw:
    """F_d = c_0 v_d + k_0 z_d + f_I tanh(c_1 v_d + k_1 z_d), f_min ≤ f_I ≤ f_max (Do, Sename, Dugard 2010).

    Attributes
    ----------
    damping, stiffness : float
        c_0 [N·s/m], k_0 [N/m].
    speed_slope, stroke_slope : float
        c_1 [s/m], k_1 [1/m].
    least, most : float
        f_min, f_max [N].

    Examples
    --------
    >>> from quartercar.dampers import Guo6
    >>> law = YieldingLaw.of(Guo6(values={"post_yield_damping": 800.0, "critical_ratio": 5.0}, span=(0.0, 2.5)))
    >>> law.damping, law.stiffness, law.middle, law.half_range
    (800.0, 4000.0, 700.0, 500.0)
    """

    damping: float
    stiffness: float
    speed_slope: float
    stroke_slope: float
    least: float
    most: float

    def __post_init__(self) -> None:
        checks.positive(self.speed_slope, "slope of the yield force in the velocity", "s/m")
        if not self.least < self.most:
            raise InputError("the yield force must have room to move", got=f"{self.least:g} to {self.most:g} N",
                             why="nothing is left to control")

    @classmethod
    def of(cls, damper: Damper, currents: tuple[float, float] = CURRENTS) -> YieldingLaw:
        """From a tanh law whose yield force alone depends on the current.

        Parameters
        ----------
        damper : Damper
            With a yield force, as the laws guo-6 and guo-7.
        currents : (float, float)
            Limits of the command [A]; the range of the yield force is that between them.

        Returns
        -------
        YieldingLaw
            With the present values of the damper's parameters.

        Raises
        ------
        InputError
            Another kind of damper, one of reversed polarity, or a law whose other coefficients move with the current.
        """
        if not isinstance(damper, TanhLaw):
            raise InputError(f"'{damper.name}' is no law with a yield force", mend="guo-6 or guo-7; any damper serves "
                             "for the embeddings by force (NominalForce, LimitedForce)")
        passive_sense(damper)
        terms, pieces = damper.terms, damper.pieces(damper.vector)
        fixed = (terms.sharpness, terms.post_yield, terms.ratio, terms.post_ratio)
        if not all(c is None or (isinstance(c, Controlled) and c.degree == 0) for c in fixed):
            raise InputError(f"in '{damper.name}' more than the yield force follows the current",
                             why="f_I would not be the only control", mend="guo-6 or guo-7")
        sharpness, damping = float(pieces[1][0]), float(pieces[2][0])
        ratio = float(pieces[3][0]) if terms.ratio is not None else 0.0
        post = float(pieces[4][0]) if terms.post_ratio is not None else ratio
        ends = terms.yield_force.value(np.linspace(*currents, 51), pieces[0])
        return cls(damping, damping * post, sharpness, sharpness * ratio, float(ends.min()), float(ends.max()))

    @property
    def middle(self) -> float:
        """F_0 = (f_max + f_min)/2 [N]."""
        return 0.5 * (self.most + self.least)

    @property
    def half_range(self) -> float:
        """U = (f_max − f_min)/2 [N]."""
        return 0.5 * (self.most - self.least)

    @property
    def argument(self) -> np.ndarray:
        """C_2 with ξ = C_2 x, in the car's states."""
        return np.array([self.stroke_slope, self.speed_slope, 0.0, -self.speed_slope])

    @property
    def linear(self) -> np.ndarray:
        """Row of c_0 v_d + k_0 z_d in the car's states."""
        return np.array([self.stiffness, self.damping, 0.0, -self.damping])


@dataclass(frozen=True)
class Reach:
    """How far the suspension moves: from these come the scheduling boxes that a motion limits.

    Attributes
    ----------
    speed : float
        Largest |v_d| [m/s].
    stroke : float
        Largest |z_d| [m].
    """

    speed: float = 1.2
    stroke: float = 0.08

    def __post_init__(self) -> None:
        checks.positive(self.speed, "largest suspension velocity", "m/s")
        checks.positive(self.stroke, "largest stroke", "m")

    @classmethod
    def of(cls, run, margin: float = 1.2) -> Reach:
        """That of a run, times a margin.

        Parameters
        ----------
        run : CarRun
            Any mapping with `suspension_velocity` [m/s] and `suspension_deflection` [m].
        margin : float
            Factor on the largest values of the run.

        Returns
        -------
        Reach
            Of both.
        """
        return cls(margin * float(np.abs(run["suspension_velocity"]).max()),
                   margin * float(np.abs(run["suspension_deflection"]).max()))

    def argument(self, law: YieldingLaw) -> float:
        """Largest |ξ| of a law.

        Parameters
        ----------
        law : YieldingLaw
            For the slopes in ξ.

        Returns
        -------
        float
            ξ̂, dimensionless: that of the largest velocity at the largest deflection.
        """
        return law.speed_slope * self.speed + law.stroke_slope * self.stroke


def yield_force(run, signal: str = "current") -> np.ndarray:
    """(n,) f_I of a run with a tanh law [N], by the damper's own coefficient at the coil's current, or the command's.

    A command outside the coil's limits is the demand of a controller without limits. A sample's current is the one that
    was driven up to it, so that with no lag in the coil it is the command of the sample before.

    Parameters
    ----------
    run : CarRun
        Of a car with a tanh law.
    signal : str
        "current" or "command".

    Returns
    -------
    (n,) array
        At the samples [N].

    Raises
    ------
    InputError
        A car with another damper, or without one.
    """
    damper = run.car.damper
    if not isinstance(damper, TanhLaw):
        raise InputError("this embedding replays runs of a car with a tanh law", got=type(damper).__name__)
    return damper.terms.yield_force.value(np.asarray(run[signal]), damper.pieces(damper.vector)[0])
