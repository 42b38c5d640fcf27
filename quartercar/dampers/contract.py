"""Damper: the contract of every damper model; `quartercar.dampers.families` holds what most of them are."""

from __future__ import annotations

import warnings
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from lpvid.errors import ExtrapolationWarning, InputError
from lpvid.model.adaptable import Adaptable
from lpvid.record import Record
from lpvid.simulation import Simulation
from lpvid.toolkit import Shown, checks
from quartercar.dampers.drive import Drive
from quartercar.dampers.evaluation.energy import Cycle, steady_cycle
from quartercar.dampers.evaluation.passivity import Passivity, check_passivity
from quartercar.dampers.simulated import SimulatedDamper

if TYPE_CHECKING:
    from lpvid.export.expression import Expr
    from lpvid.export.step_builder import StepBuilder
    from quartercar.dampers.facts import Facts
    from quartercar.dampers.fitting.estimate import Estimate
    from quartercar.dampers.fitting.settings import FitSettings
    from quartercar.dampers.stepper import DamperStepper


@dataclass(frozen=True)
class LinearElements:
    """F = m a + c v + k x.

    Attributes
    ----------
    damping : float
        c [N·s/m].
    mass : float
        m, an inerter's [kg].
    stiffness : float
        k [N/m].
    """

    damping: float = 0.0
    mass: float = 0.0
    stiffness: float = 0.0


@dataclass(frozen=True, eq=False)
class Run(Simulation):
    """A free run of a damper.

    Attributes
    ----------
    extrapolation_share : float
        Share of the samples whose current lies outside the fitted range.
    """

    extrapolation_share: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Damper(SimulatedDamper, Adaptable, Shown):
    """A damper model: a law with named parameters, from motion and current to force.

    Extension and tension are positive: a passive damper has mean(F·v) > 0 and a gas preload is a negative force.
    `force`, `response` and `static_force` have the damper's sign; `simulate` has the record's, so that it turns the
    sign of a model that was fitted to a record of reversed polarity.

    Attributes
    ----------
    values : mapping of str to float
        Parameters by name, SI; those left out take their defaults.
    current_range : (float, float) or None
        Currents that the fit has seen.
    current_unit : str
        Unit of what schedules the model: ``"A"``, ``"V"`` or ``"1"`` (duty).
    centre : float
        Displacement of the record that the model calls zero [m].
    polarity : {1, −1}
        −1 where the record's force is measured against the velocity; stated wherever it matters.
    metadata : mapping
    """

    DRAWN_BY: ClassVar[str] = "quartercar.plot.drawings"

    # -- what a model describes ---------------------------------------------------------------------------------
    @classmethod
    @abstractmethod
    def suited(cls, facts: Facts) -> Damper:
        """The structure of this kind that these data allow.

        Parameters
        ----------
        facts : Facts
            Channels, currents and excitation of the training records.

        Returns
        -------
        Damper
            With starting values, not yet fitted.

        Raises
        ------
        InputError
            Why this kind cannot be fitted to these data.
        """

    @abstractmethod
    def estimate(self, records: Sequence[Record], settings: FitSettings) -> Estimate[Damper]:
        """Parameters from uniform, finite records with this model's channels and a force; `quartercar.fit` calls it.

        Parameters
        ----------
        records : sequence of Record
            Training records.
        settings : FitSettings
            Starts, limits and solver of the fit.

        Returns
        -------
        Estimate
            Parameters, covariance and the solver's report.
        """

    @abstractmethod
    def to_lpv(self, sample_time: float) -> Any:
        """The model as an LPV model of `lpvid`, where one exists; InputError where none does.

        Parameters
        ----------
        sample_time : float
            Period [s].

        Returns
        -------
        model
            LPV state space or transfer function from the damper's channels to its force [N].
        """

    def to_linear_model(self) -> Any:
        """The LPV model of the law at its period, whatever the polarity and the zero of its records.

        Returns
        -------
        model
            What `to_lpv` returns at the damper's own period.

        Raises
        ------
        InputError
            A law that has none, or none without a signal of its own as scheduling.
        """
        period = self.period
        if period is None:
            raise InputError(f"'{self.name}' has no sampling rate", why="a parameter set has none",
                             mend="fit it: quartercar fit DATA writes a damper that does")
        return self.to_lpv(period)

    @property
    def period(self) -> float | None:
        """Its own period or that of its training data [s]; None where neither is known."""
        training = self.metadata.get("training", {})
        given = training.get("sample_time") if isinstance(training, Mapping) else None
        return self.clock or (None if given is None else checks.positive(given, "sample_time of the training", "s"))

    # -- in a simulation and in exported code ------------------------------------------------------------------------
    def stepper(self, step: float) -> DamperStepper:
        """This damper inside a simulation of fixed step, e.g. a car.

        The families of `quartercar.dampers.families` have one; a kind with a compiled step of its own gives that.

        Parameters
        ----------
        step : float
            [s]; a model with a clock of its own takes only that.

        Returns
        -------
        DamperStepper
            Its `begin` is yet to be called.

        Raises
        ------
        InputError
            A kind that cannot be stepped, or a clock that is not the step.
        """
        raise InputError(f"a car cannot simulate a '{self.name}' damper", got=type(self).__name__,
                         mend="a static, dynamic, semi-active or sampled damper of quartercar.dampers")

    def tanh_form(self) -> Callable[[np.ndarray], np.ndarray] | None:
        """Coefficients of a law of one tanh, which cars step compiled, many at once and with gradients.

        Returns
        -------
        callable or None
            (n,) currents -> (n, 8) of F = a_0 + a_1 v + a_2 x + a_3 tanh(a_4 v + a_5 x + a_6 tanh(x/a_7));
            None for a damper that is not of this form.
        """
        return None

    @property
    def linear_elements(self) -> LinearElements | None:
        """The damper as a dashpot, an inerter and a spring, which belong to the linear part of a car; None for others.

        Returns
        -------
        LinearElements or None
        """
        return None

    def expression(self, b: StepBuilder) -> Callable[[Expr, Expr, Expr], Expr]:
        """One step of fixed length as an expression, for C, FMU and MATLAB.

        Parameters
        ----------
        b : StepBuilder
            Takes the parameters and, for a damper with memory, the states.

        Returns
        -------
        callable
            (displacement from the centre, velocity, current) -> force in the damper's own sense.

        Raises
        ------
        InputError
            A kind that has none, with the nearest that has one.
        """
        raise InputError(f"'{self.name}' has no exported step", why="its class gives no expression of its force",
                         mend="write its method `expression` (docs/extending.md), or export another damper")

    # -- parameters --------------------------------------------------------------------------------------------------
    def replace(self, **changes: Any) -> Self:
        """A copy with some fields changed.

        Parameters
        ----------
        **changes
            New values by field.

        Returns
        -------
        Damper
            A copy.
        """
        return replace(self, **changes)

    # -- running -----------------------------------------------------------------------------------------------------
    def drive(self, record: Record, force: bool = False) -> Drive:
        """What this model reads of a record.

        Parameters
        ----------
        record : Record
            With the channels that `reads` names.
        force : bool
            Take the measured force too.

        Returns
        -------
        Drive
            In the damper's own polarity, displacement from its centre.
        """
        return Drive.of(record, self.reads, force, self.centre, self.polarity)

    def simulate(self, record: Record) -> Run:
        """Free run along a record: its motion and current, never its force but for the first `start` samples.

        Parameters
        ----------
        record : Record
            Uniform, with the roles in `reads`.

        Returns
        -------
        Run
            In the polarity of the record.

        Raises
        ------
        InputError
            A missing channel, NaN, no uniform clock.

        Warns
        -----
        ExtrapolationWarning
            Currents outside the range of the fit.
        """
        drive = self.drive(record)
        outside = self.outside(drive.current)
        if outside:
            assert self.current_range is not None
            low, high = self.current_range
            warnings.warn(f"{self.name}: {outside:.0%} of record '{record.name}' has a current outside the fitted "
                          f"{low:g} to {high:g} {self.current_unit}", ExtrapolationWarning, stacklevel=2)
        with np.errstate(over="ignore", invalid="ignore"):
            force = self.polarity * self.response(drive, self.vector)
        bad = np.flatnonzero(~np.isfinite(force))
        diverged = int(bad[0]) if bad.size else None
        if diverged is not None:
            force[diverged:] = np.nan
        begin = self.start if drive.force is not None else 0
        origin = "first measured force" if begin else "rest"
        return Run(force[:, None], begin, None, diverged, origin, ("force",), ("N",), drive.sample_time, outside)

    def outside(self, current: np.ndarray) -> float:
        """Share of currents outside the fitted range, with a hundredth of the range as tolerance.

        Parameters
        ----------
        current : (n,) array
            In the unit of the training records.

        Returns
        -------
        float
            Between 0 and 1; 0 for a damper without current or without a known range.
        """
        if self.current_range is None or "current" not in self.reads:
            return 0.0
        low, high = self.current_range
        return float(np.mean((current < low - self.slack) | (current > high + self.slack)))

    @property
    def slack(self) -> float:
        """How far outside the fitted range a current still counts as inside."""
        low, high = self.current_range or (0.0, 0.0)
        return 0.01 * max(high - low, abs(high), 1e-9)

    def trained(self, role: str) -> tuple[float, float] | None:
        """Least and largest sample of a role in the training records, SI; None where that is not known.

        Parameters
        ----------
        role : str
            Role of a channel: ``velocity``, ``current`` …

        Returns
        -------
        tuple of float or None
            Least and largest sample.
        """
        training = self.metadata.get("training", {})
        ranges = training.get("ranges", {}) if isinstance(training, Mapping) else {}
        given = ranges.get(role) if isinstance(ranges, Mapping) else None
        if given is None:
            return None
        low, high = (checks.real(x, f"a {role} of the training") for x in given)
        return low, high

    @property
    def integrated_states(self) -> int | None:
        """States that a run integrates: 0 for a formula, None for a model that is identified and not searched."""
        return None

    # -- asking ------------------------------------------------------------------------------------------------------
    def cycle(self, amplitude: float, frequency: float, current: float = 0.0) -> Cycle:
        """A steady sine cycle and its work; see `quartercar.dampers.evaluation.energy.steady_cycle`.

        Parameters
        ----------
        amplitude : float
            [m]
        frequency : float
            [Hz]
        current : float
            Held, in the unit of the training records.

        Returns
        -------
        Cycle
            One settled cycle.
        """
        return steady_cycle(self, amplitude, frequency, current)

    def energy_per_cycle(self, amplitude: float, frequency: float, current: float = 0.0) -> float:
        """Work taken from the motion x = X sin 2πft over one steady cycle [J]; positive where energy is dissipated.

        Parameters
        ----------
        amplitude : float
            X [m].
        frequency : float
            f [Hz].
        current : float
            Held, in the unit of the training records.

        Returns
        -------
        float
            Work [J].
        """
        return self.cycle(amplitude, frequency, current).work

    def passivity(self, speed: float = 2.0) -> Passivity:
        """Whether it only ever takes energy; see `quartercar.dampers.evaluation.passivity.check_passivity`.

        Parameters
        ----------
        speed : float
            Largest speed of the check [m/s].

        Returns
        -------
        Passivity
            Verdict and, where it fails, where.
        """
        return check_passivity(self, speed)

    # -- storing -----------------------------------------------------------------------------------------------------
    @property
    def settings(self) -> dict[str, Any]:
        """Fields that a kind adds to the common ones (orders, tables, degrees)."""
        common = {f.name for f in fields(Damper)}
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name not in common}

    def to_dict(self) -> dict:
        """Plain data for JSON, with units.

        Returns
        -------
        dict
            What `from_dict` reads.
        """
        return {**super().to_dict(),
                "current_range": None if self.current_range is None else list(self.current_range),
                "current_unit": self.current_unit, "centre": self.centre, "polarity": self.polarity,
                "metadata": dict(self.metadata)}

    @classmethod
    def from_dict(cls, data: Mapping) -> Self:
        """Inverse of `to_dict`.

        Parameters
        ----------
        data : mapping
            What `to_dict` returned.

        Returns
        -------
        Damper
            Of the kind that the method is called on.

        Raises
        ------
        InputError
            A parameter is missing, or a value is no number.
        """
        span = data.get("current_range")
        settings = {k: tuple(v) if isinstance(v, list) else v for k, v in data["settings"].items()}
        found = cls(**settings, values={p["name"]: p["value"] for p in data["parameters"]},
                    current_range=None if span is None else (span[0], span[1]), current_unit=data["current_unit"],
                    centre=checks.real(data["centre"], "centre"), polarity=data["polarity"],
                    metadata=data["metadata"])
        missing = set(found.names) - {p["name"] for p in data["parameters"]}
        if missing:
            raise InputError(f"parameters of {cls.name} are missing", got=", ".join(sorted(missing)))
        return found

    def _shown(self) -> str:
        more = f", … {len(self.parameters)} in all" if len(self.parameters) > 8 else ""
        return super()._shown() + more + (", polarity reversed" if self.polarity < 0 else "")
