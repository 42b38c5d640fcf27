"""TanhLaw: yield and viscous force of the same lagged velocity, whose coefficients may depend on the current."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, product
from typing import ClassVar, NamedTuple

import numpy as np

from lpvid.errors import InputError
from lpvid.export.expression import Expr, call
from lpvid.export.step_builder import StepBuilder
from lpvid.model.input_stage import TanhStage
from lpvid.model.signals import Signal
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.scheduling import Polynomial
from quartercar.dampers.drive import Drive, joined
from quartercar.dampers.families import StaticDamper
from quartercar.dampers.laws.coefficients import Coefficient, Controlled, settled_span
from quartercar.dampers.laws.expressions import Law, named_parameters
from quartercar.dampers.laws.secant import secant
from quartercar.dampers.laws.secant_model import box, origin, secant_model
from quartercar.dampers.parameter import POSITIVE, Parameter

SATURATION = "saturation"
"""Channel that schedules the LPV form of a law with displacement."""
YIELD = Parameter("yield_force", "N", "dynamic yield force A_1", 0.0, 0.0)
SHARPNESS = Parameter("sharpness", "s/m", "pre-yield sharpness A_3", 20.0, POSITIVE, log=True, search=(1e-2, 1e4))
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

    of_typical_size: ClassVar[bool] = True
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

    def expression(self, b: StepBuilder) -> Law:
        named = named_parameters(b, self)
        force, sharp, post, ratio, post_ratio = (None if c is None else c.expression(named) for c in self.terms)
        assert force is not None and sharp is not None and post is not None

        def law(x: Expr, v: Expr, i: Expr) -> Expr:
            lagged = v if ratio is None else b.let("lagged", v + ratio(i) * x)
            post_lagged = lagged if post_ratio is None else v + post_ratio(i) * x
            total = force(i) * call("tanh", sharp(i) * lagged) + post(i) * post_lagged
            return total + named["offset"] if self.offset else total

        return law

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

        v, x = joined(drives, "velocity", "displacement")
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

    def to_lpv(self, sample_time: float) -> LPVTransferFunction:
        r"""A tanh law as a static LPV model, exact in both forms.

        Without displacement a Hammerstein model with inputs v and tanh(A_3 v), scheduled on the current::

            F = A_2(i) v + A_1(i) tanh(v/v_0) + F_0          v_0 = 1/A_3

        With it a quasi-LPV model with inputs v and x, scheduled on the current and on the saturation ρ of the lagged
        velocity s, which `with_saturation` adds to a record::

            F = A_1(i) A_3 ρ (v + κ x) + A_2(i) (v + κ' x) + F_0       ρ = tanh(A_3 s)/(A_3 s) ∈ (0, 1],  s = v + κ x

        Do, Sename, Dugard (2010) schedule the semi-active damper so. The coefficient of F on v is positive for every ρ.

        Parameters
        ----------
        sample_time : float
            Period of the model [s].

        Returns
        -------
        LPVTransferFunction
            Without memory; along records as measured: their polarity and zero of the displacement.
            With displacement it runs along ``damper.with_saturation(record)``.

        Raises
        ------
        InputError
            A_3 or κ depend on the current: the coefficients are then no polynomials in the scheduling.
        """
        terms, vector = self.terms, self.vector
        pieces = self.pieces(vector)
        fixed = [c for c in (terms.sharpness, terms.ratio, terms.post_ratio) if c is not None]
        if not all(isinstance(c, Controlled) and c.degree == 0 for c in fixed):
            raise InputError(f"no LPV form of '{self.name}'", mend="guo, guo-6 or guo-7",
                             why="its sharpness and critical ratio depend on the current, so that the coefficients are "
                                 "no polynomials in it")
        force, damping = terms.yield_force.powers(pieces[0]), terms.post_yield.powers(pieces[2])
        degree = max(force.size, damping.size) - 1
        force, damping = (np.pad(a, (0, degree + 1 - a.size)) for a in (force, damping))
        sharpness, currents = float(pieces[1][0]), self.current_range or self.currents
        offset = np.zeros((degree + 1, 2))
        offset[0, 0] = vector[-1] if self.offset else 0.0
        if terms.ratio is None:
            basis = Polynomial(("current",) if degree else (), degree=degree)
            return LPVTransferFunction(np.zeros((0, 1, 1, basis.size)),
                                       self.polarity * np.stack([damping, force])[None, None], basis, sample_time,
                                       box(self, degree, currents), self.polarity * offset[None, None, :, 0],
                                       inputs=(Signal("velocity", "m/s"),), outputs=(Signal("force", "N"),),
                                       input_stage=TanhStage(v0=1 / sharpness), metadata=origin(self))
        ratio = float(pieces[3][0])
        post_ratio = ratio if terms.post_ratio is None else float(pieces[4][0])
        return secant_model(self, sample_time, (SATURATION,), currents,
                            np.column_stack([damping, sharpness * force]),
                            np.column_stack([post_ratio * damping, ratio * sharpness * force]), offset)

    def with_saturation(self, record: Record) -> Record:
        """The record with a channel ``saturation``, ρ = tanh(A_3 s)/(A_3 s), that schedules the model of `to_lpv`.

        Parameters
        ----------
        record : Record
            With the channels that the law reads.

        Returns
        -------
        Record
            A copy with the channel [1].
        """
        drive = self.drive(record)
        factors = self.factors(drive.displacement, drive.velocity, drive.current, self.vector)
        rho = secant(factors.sharpness * factors.lagged)
        return record.with_channel(SATURATION, rho, note=f"saturation of the lagged velocity of '{self.name}'")


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
