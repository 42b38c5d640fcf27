"""The families that most damper models belong to: laws with physical parameters, without memory and with states."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from lpvid.errors import InputError
from lpvid.record import Record
from quartercar.dampers.contract import Damper
from quartercar.dampers.drive import Drive
from quartercar.dampers.stepper import DamperStepper, StateStepper, StaticStepper, SteppedLaw, SteppedStates, rates_move

if TYPE_CHECKING:
    from lpvid.export.expression import Expr
    from lpvid.export.step_builder import StepBuilder
    from lpvid.model.quasi import SelfScheduled
    from quartercar.dampers.fitting.estimate import Estimate
    from quartercar.dampers.fitting.settings import FitSettings

COMPLEX_STEP = 1e-30
"""imaginary part, relative to a parameter, by which exact derivatives are taken."""


def complex_slope(function: Callable[[np.ndarray], np.ndarray], vector: np.ndarray, place: int) -> np.ndarray:
    """∂f/∂θ_j by the complex step: Im f(θ + i h e_j)/h has no difference to round off, for any h.

    Squire, Trapp (1998), SIAM Review 40(1), 110-112. Kernels take moduli and signs by the real part.

    Parameters
    ----------
    function : callable
        f, of (P,) complex parameters.
    vector : (P,) array
        θ.
    place : int
        j.

    Returns
    -------
    array
        Of the shape of f.
    """
    step = COMPLEX_STEP * max(abs(float(vector[place])), 1e-6)
    moved = vector.astype(complex)
    moved[place] += 1j * step
    return np.imag(function(moved)) / step


class LawDamper(Damper):
    """A damper with physical parameters that the search of `quartercar.dampers.fitting` can fit."""

    clock: ClassVar[float | None] = None
    real_runs: ClassVar[bool] = False
    """whether differences of runs take the place of complex steps in linear parameters: a real run costs less"""
    forward: ClassVar[bool] = False
    """whether all columns of `jacobian` are carried along one run, which takes less time than one more run for each"""
    of_typical_size: ClassVar[bool] = False
    """whether its parameters state what a damper of `quartercar.dampers.sizes.TYPICAL` sizes has, to be carried over to
    the sizes of the data"""

    @property
    def integrated_states(self) -> int:
        return 0

    def all_free(self) -> LawDamper:
        """This law without a number that is held at a usual value: what a diagnosis judges, not the usual value.

        Returns
        -------
        LawDamper
        """
        return self

    def to_model(self, sample_time: float) -> SelfScheduled:
        """As a model of lpvid at this period; its predictions are its free run.

        Parameters
        ----------
        sample_time : float
            Period of the model [s].

        Returns
        -------
        SelfScheduled
            Velocity (and displacement, where the law reads it) to force, the current as scheduling.
        """
        from quartercar.dampers.as_model import DamperModel

        return DamperModel.of(self, sample_time)

    def estimate(self, records: Sequence[Record], settings: FitSettings) -> Estimate[Damper]:
        from quartercar.dampers.fitting.searching import estimate_law

        return estimate_law(self, [self.drive(r, force=True) for r in records], settings)

    @property
    @abstractmethod
    def linear(self) -> tuple[str, ...]:
        """Parameters in which the force is affine while the others are held (variable projection); may be empty."""

    @abstractmethod
    def jacobian(self, drive: Drive, vector: np.ndarray) -> np.ndarray:
        """(n, P) derivative of `response` in every parameter, exact.

        Parameters
        ----------
        drive : Drive
            Motion and current of one record.
        vector : (P,) array
            Parameters in the order of `names`, SI.

        Returns
        -------
        (n, P) array
            [N per unit of the parameter].
        """

    @abstractmethod
    def sensitivity(self, drive: Drive, vector: np.ndarray, columns: Sequence[int]) -> np.ndarray:
        """Derivative of `response` in the parameters at these places, exact.

        Parameters
        ----------
        drive : Drive
        vector : (P,) array
        columns : sequence of int

        Returns
        -------
        (n, len(columns)) array
            [N per unit of the parameter]; a new array, which the caller scales in place.
        """

    @abstractmethod
    def starts(self, drives: Sequence[Drive], count: int, rng: np.random.Generator) -> list[np.ndarray]:
        """At most `count` starting vectors, the most promising first, drawn from what the measured forces look like.

        Parameters
        ----------
        drives : sequence of Drive
            Training data with measured force.
        count : int
            Most vectors to return.
        rng : numpy.random.Generator
            Scatters the starts of a law that draws them; others do not read it.

        Returns
        -------
        list of (P,) array
            Starting vectors, SI, in the order of `names`.
        """


class StaticDamper(LawDamper, SteppedLaw):
    """A damper without memory: force is a function of displacement, velocity and current at the same instant."""

    start: ClassVar[int] = 0

    @abstractmethod
    def law_gradient(self, displacement: np.ndarray, velocity: np.ndarray, current: np.ndarray,
                     vector: np.ndarray) -> np.ndarray:
        """(n, P) derivative of `law` in every parameter, analytic.

        Parameters
        ----------
        displacement, velocity, current, vector : array
            As in `law`.

        Returns
        -------
        (n, P) array
            [N per unit of the parameter].
        """

    def force(self, displacement: np.ndarray | float, velocity: np.ndarray | float,
              current: np.ndarray | float = 0.0) -> np.ndarray:
        """Force at displacements [m], velocities [m/s] and currents, broadcast against each other [N].

        Parameters
        ----------
        displacement : array or float
            From the damper's centre [m].
        velocity : array or float
            [m/s].
        current : array or float
            In the damper's `current_unit`.

        Returns
        -------
        array
            Force [N], of the common shape of the arguments; (1,) where all are numbers.
        """
        x, v, i = np.broadcast_arrays(*(np.atleast_1d(np.asarray(a, dtype=float))
                                        for a in (displacement, velocity, current)))
        return self.law(x.ravel(), v.ravel(), i.ravel(), self.vector).reshape(v.shape)

    def response(self, drive: Drive, vector: np.ndarray) -> np.ndarray:
        return self.law(drive.displacement, drive.velocity, drive.current, vector)

    def jacobian(self, drive: Drive, vector: np.ndarray) -> np.ndarray:
        return self.law_gradient(drive.displacement, drive.velocity, drive.current, vector)

    def sensitivity(self, drive: Drive, vector: np.ndarray, columns: Sequence[int]) -> np.ndarray:
        """Columns of the analytic gradient.

        Parameters
        ----------
        drive : Drive
        vector : (P,) array
        columns : sequence of int

        Returns
        -------
        (n, len(columns)) array
            [N per unit of the parameter].
        """
        return self.jacobian(drive, vector)[:, list(columns)]

    def static_force(self, velocity: np.ndarray, current: float = 0.0, displacement: float = 0.0) -> np.ndarray:
        return self.force(displacement, velocity, current)

    def without_lpv_form(self) -> InputError:
        """What `to_lpv` raises for a law whose slope is a function of the velocity.

        Returns
        -------
        InputError
        """
        return InputError(f"no LPV form of '{self.name}'",
                          why="it has no memory and no scheduling: its slope is a function of the velocity itself",
                          mend="none is needed: no memory, no poles; quartercar fit states whether it is passive")

    def stepper(self, step: float) -> DamperStepper:
        return StaticStepper(self)


class DynamicDamper(LawDamper, SteppedStates):
    """A damper with states: ż = f(z, x, v, i), F = h(z, x, v, i), motion and current linear between samples."""

    exported_instead: ClassVar[str] = "extended-bouc-wen"
    """the model with a step of fixed length that is nearest to this one"""
    real_runs: ClassVar[bool] = True
    start: ClassVar[int] = 1

    @property
    @abstractmethod
    def states(self) -> tuple[str, ...]:
        """Names of the states, with units, e.g. ``"z [m]"``."""

    @property
    def integrated_states(self) -> int:
        return len(self.states)

    def stepper(self, step: float) -> DamperStepper:
        return StateStepper(self, rates_move(self, step))

    def expression(self, b: StepBuilder) -> Callable[[Expr, Expr, Expr], Expr]:
        raise InputError(f"'{self.name}' has no exported step",
                         why="its integration steps follow the motion, so that their number has no bound",
                         mend=f"fit and export '{self.exported_instead}', whose step is fixed; "
                              "bouc-wen and wang-kamath export as they are to model exchange (fmu2)")

    def flow(self, b: StepBuilder, x: Expr, v: Expr, i: Expr) -> Expr | None:
        """The force as an expression, the rates of the states declared in `b`: for a model-exchange FMU.

        Parameters
        ----------
        b : StepBuilder
        x, v, i : Expr
            Displacement from the centre, velocity, current.

        Returns
        -------
        Expr or None
            None for a damper whose rates are no expression.
        """
        return None

    def jacobian(self, drive: Drive, vector: np.ndarray) -> np.ndarray:
        return self.sensitivity(drive, vector, range(vector.size))

    def sensitivity(self, drive: Drive, vector: np.ndarray, columns: Sequence[int]) -> np.ndarray:
        """By the complex step (`complex_slope`).

        Parameters
        ----------
        drive : Drive
        vector : (P,) array
        columns : sequence of int

        Returns
        -------
        (n, len(columns)) array
            [N per unit of the parameter].
        """
        out = np.empty((drive.n_samples, len(columns)))
        for place, j in enumerate(columns):
            out[:, place] = complex_slope(lambda moved: self.response(drive, moved), vector, j)
        return out
