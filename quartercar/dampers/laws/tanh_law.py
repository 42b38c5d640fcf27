"""TanhLaw: yield and viscous force of the same lagged velocity, whose coefficients may depend on the current."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lpvid.record import Record
from quartercar.dampers.drive import Drive
from quartercar.dampers.families import StaticDamper
from quartercar.dampers.laws.coefficients import Coefficient, Controlled, settled_span
from quartercar.dampers.parameter import Parameter

if TYPE_CHECKING:
    from lpvid.export.expression import Expr
    from lpvid.export.step_builder import StepBuilder

YIELD = Parameter("yield_force", "N", "dynamic yield force A_1", 0.0, 0.0)
SHARPNESS = Parameter("sharpness", "s/m", "pre-yield sharpness A_3", 20.0, 1e-2, 1e4, log=True)
POST_YIELD = Parameter("post_yield_damping", "N*s/m", "post-yield damping A_2", 0.0, 0.0)
RATIO = Parameter("critical_ratio", "1/s", "critical ratio κ = V_0/X_0", 3.0, 0.0)
OFFSET = Parameter("offset", "N", "constant force F_0", 0.0)
KNEES = (0.5, 1.0, 2.0, 5.0, 12.0, 30.0, 80.0)
"""Sharpness of the starts, in terms of the root mean square speed."""
LAGS = (0.0, 0.03, 0.1, 0.3, 1.0)
"""Critical ratio of the starts, in terms of the motion's mean frequency in rad/s."""


class Terms(NamedTuple):
    """What a law of this family is made of.

    Attributes
    ----------
    yield_force, sharpness, post_yield : Coefficient
        A_1 [N], A_3 [s/m], A_2 [N·s/m].
    ratio : Coefficient or None
        κ of the yield term [1/s]; None where the displacement is left out.
    post_ratio : Coefficient or None
        κ' of the viscous term [1/s]; None where it is that of the yield term.
    """

    yield_force: Coefficient
    sharpness: Coefficient
    post_yield: Coefficient
    ratio: Coefficient | None
    post_ratio: Coefficient | None


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class TanhLaw(StaticDamper):
    """F = A_1(i) tanh[A_3(i) (v + κ x)] + A_2(i) (v + κ' x) + F_0, mostly with κ' = κ.

    The pairs (V_0, X_0) of Guo (2006) enter by their ratio κ alone, so that the ratio is the parameter. κ > 0 makes the
    force lag the velocity, as a spring in series does; but the κ of such a spring changes with amplitude and frequency
    (`quartercar.dampers.laws.guo.jenkins_ratio`), so that a constant one is a compromise over the fitted motion.

    Coefficients that depend on the current are given by control values over a span of currents
    (`quartercar.dampers.laws.coefficients.Controlled`): they stay positive over all of it. `current_powers` shows them
    as powers of the current.

    Attributes
    ----------
    span : (float, float) or None
        Currents over which coefficients that depend on them keep their bounds; left out, those of the fit.
    offset : bool
        Whether there is a constant F_0, which the printed laws do not have.
    """

    span: tuple[float, float] | None = None
    offset: bool = False

    def check_settings(self) -> None:
        settled_span(self.span, self.current_range)

    @property
    @abstractmethod
    def terms(self) -> Terms:
        """The coefficients."""

    @property
    def currents(self) -> tuple[float, float]:
        """Currents over which the coefficients keep their bounds."""
        return settled_span(self.span, self.current_range)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        rows = [p for c in self.terms if c is not None for p in c.parameters]
        return (*rows, *((OFFSET,) if self.offset else ()))

    @property
    def reads(self) -> tuple[str, ...]:
        terms = self.terms
        static = all(isinstance(c, Controlled) and c.degree == 0 for c in terms if c is not None)
        return ("velocity", *(() if terms.ratio is None else ("displacement",)), *(() if static else ("current",)))

    @property
    def linear(self) -> tuple[str, ...]:
        terms = self.terms
        rows = [p.name for c in (terms.yield_force, terms.post_yield) for p in c.parameters]
        return (*rows, *((OFFSET.name,) if self.offset else ()))

    def law(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
            vector: np.ndarray) -> np.ndarray:
        f = self.factors(displacement, velocity, current, vector)
        constant = vector[-1] if self.offset else 0.0
        return f.yield_force * np.tanh(f.sharpness * f.lagged) + f.post_yield * f.post_lagged + constant

    def tanh_form(self) -> Callable[[np.ndarray], np.ndarray]:
        def coefficients(current: np.ndarray) -> np.ndarray:
            vector, zero, one = self.vector, np.zeros(current.size), np.ones(current.size)
            still = self.factors(zero, one, current, vector)  # x = 0, v = 1: the coefficients of v
            moved = self.factors(one, zero, current, vector)  # x = 1, v = 0: κ and κ'
            out = np.zeros((current.size, 8))
            out[:, 0] = vector[-1] if self.offset else 0.0
            out[:, 1], out[:, 2] = still.post_yield, still.post_yield * moved.post_lagged
            out[:, 3] = still.yield_force
            out[:, 4], out[:, 5], out[:, 7] = still.sharpness, still.sharpness * moved.lagged, 1.0
            return out

        return coefficients

    def expression(self, b: StepBuilder) -> Callable[[Expr, Expr, Expr], Expr]:
        from quartercar.dampers.laws.expressions import tanh_expression

        return tanh_expression(b, self)

    def law_gradient(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
                     vector: np.ndarray) -> np.ndarray:
        f = self.factors(displacement, velocity, current, vector)
        curve = np.tanh(f.sharpness * f.lagged)
        steep = f.yield_force * (1 - curve**2)
        by_yield_ratio, by_post_ratio = steep * f.sharpness * displacement, f.post_yield * displacement
        shared = self.terms.post_ratio is None
        outer = (curve, steep * f.lagged, f.post_lagged, by_yield_ratio + (by_post_ratio if shared else 0.0),
                 by_post_ratio)
        thetas = self.pieces(vector)
        columns = [a[:, None] * c.gradient(current, theta)
                   for a, c, theta in zip(outer, self.terms, thetas, strict=True) if c is not None]
        return np.hstack([*columns, *([np.ones((velocity.size, 1))] if self.offset else [])])

    def pieces(self, vector: np.ndarray) -> list[np.ndarray]:
        """θ of each of `terms`; empty where there is none.

        Parameters
        ----------
        vector : (P,) array
            Parameters in the order of `names`, SI.

        Returns
        -------
        list of array
            Five, in the order of `Terms`.
        """
        return [vector[place] for place in self.places]

    @cached_property
    def settled(self) -> Terms:
        """`terms`, found once."""
        return self.terms

    @cached_property
    def places(self) -> tuple[slice, ...]:
        """Where the parameters of each of `terms` stand in the vector."""
        sizes = [0 if c is None else len(c.parameters) for c in self.settled]
        return tuple(slice(end - size, end) for size, end in zip(sizes, accumulate(sizes), strict=True))

    def factors(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
                 vector: np.ndarray) -> Factors:
        """Coefficients and lagged velocities along a motion.

        Parameters
        ----------
        displacement, velocity, current : (n,) array
            Motion from the centre [m], [m/s], and current.
        vector : (P,) array
            Parameters in the order of `names`, SI.

        Returns
        -------
        Factors
            (n,) each.
        """
        values = [None if c is None else c.value(current, theta)
                  for c, theta in zip(self.settled, self.pieces(vector), strict=True)]
        y, s, c, ratio, post_ratio = values
        assert y is not None and s is not None and c is not None
        lagged = velocity if ratio is None else velocity + ratio * displacement
        post_lagged = lagged if post_ratio is None else velocity + post_ratio * displacement
        return Factors(y, s, c, lagged, post_lagged)

    def starts(self, drives: Sequence[Drive], count: int, rng: np.random.Generator) -> list[np.ndarray]:
        """Bounded least squares for everything linear on a grid of sharpness and critical ratio, the best first."""
        from quartercar.dampers.fitting.starting import best_starts

        v = np.concatenate([d.velocity for d in drives])
        x = np.concatenate([d.displacement for d in drives])
        speed, stroke = float(np.sqrt(np.mean(v**2))) or 1.0, float(np.sqrt(np.mean(x**2)))
        omega = speed / stroke if stroke else 0.0
        _, sharpness, _, ratio, post_ratio = self.terms
        ratios = [omega * lag for lag in LAGS]
        grid = [{**sharpness.constant(knee / speed), **({} if ratio is None else ratio.constant(k)),
                 **({} if post_ratio is None else post_ratio.constant(post))}
                for knee, k, post in product(KNEES, ratios if ratio else [0.0], ratios[::2] if post_ratio else [0.0])]
        return best_starts(self, drives, grid, count)

    def conservative_force(self, displacement: np.ndarray) -> np.ndarray:
        """F at v = 0 and the current nearest to zero: with κ a spring, whose force is stored and not dissipated."""
        x = np.asarray(displacement, dtype=float)
        return self.force(x, 0.0, float(np.clip(0.0, *self.currents))).reshape(x.shape)

    def current_powers(self) -> dict[str, np.ndarray]:
        """Coefficients of the powers 1, i, i² of every coefficient that is a polynomial in the current, SI.

        Returns
        -------
        dict of str to (d + 1,) array
            By the name of the coefficient; a constant has one entry.
        """
        return {c.prototype.name: c.powers(theta)
                for c, theta in zip(self.terms, self.pieces(self.vector), strict=True) if isinstance(c, Controlled)}

    def coefficients_at(self, current: float) -> Mapping[str, float]:
        """A_1, A_3, A_2, κ (and κ' where it differs) at a current, by the names of the sheet.

        Parameters
        ----------
        current : float
            In the damper's `current_unit`.

        Returns
        -------
        mapping of str to float
            ``A_1`` [N], ``A_3`` [s/m], ``A_2`` [N·s/m], ``kappa`` and ``kappa_post`` [1/s], as far as the law has them.
        """
        names = ("A_1", "A_3", "A_2", "kappa", "kappa_post")
        at = np.array([float(current)])
        return {n: float(c.value(at, theta)[0])
                for n, c, theta in zip(names, self.terms, self.pieces(self.vector), strict=True) if c is not None}

    def to_lpv(self, sample_time: float) -> Any:
        """Hammerstein model without displacement, quasi-LPV model with it; see `quartercar.dampers.laws.tanh_lpv`.

        With displacement it is scheduled on a channel ``saturation``: run it along ``damper.with_saturation(record)``.
        """
        from quartercar.dampers.laws.tanh_lpv import to_lpv

        return to_lpv(self, sample_time)

    def with_saturation(self, record: Record) -> Record:
        """The record with the channel that schedules `to_lpv`; see `quartercar.dampers.laws.tanh_lpv`.

        Parameters
        ----------
        record : Record
            With the channels that the law reads.

        Returns
        -------
        Record
            With one channel more, ``saturation`` [1].
        """
        from quartercar.dampers.laws.tanh_lpv import with_saturation

        return with_saturation(self, record)


class Factors(NamedTuple):
    """(n,) each: A_1, A_3, A_2, v + κ x and v + κ' x.

    Attributes
    ----------
    yield_force, sharpness, post_yield : (n,) array
        A_1 [N], A_3 [s/m], A_2 [N·s/m].
    lagged, post_lagged : (n,) array
        v + κ x and v + κ' x [m/s].
    """

    yield_force: np.ndarray
    sharpness: np.ndarray
    post_yield: np.ndarray
    lagged: np.ndarray
    post_lagged: np.ndarray
