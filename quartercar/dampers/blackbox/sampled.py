"""SampledDamper: dampers that are models of lpvid underneath, identified from samples, run at their own rate only."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from lpvid.condition.segmentation import RATE_TOLERANCE
from lpvid.errors import InputError
from lpvid.identification.covariance import bartlett, inverse_gram, residual_memory
from lpvid.model.state_space import LPVStateSpace
from lpvid.record import Record
from lpvid.simulation import simulate
from quartercar.dampers.blackbox.rest import at_rest, record_of, state_at_rest
from quartercar.dampers.contract import Damper
from quartercar.dampers.drive import UNITS, Drive
from quartercar.dampers.parameter import Parameter

if TYPE_CHECKING:
    from lpvid.identification import Identification
    from quartercar.dampers.blackbox.held import Held, Inner
    from quartercar.dampers.fitting.estimate import Estimate
    from quartercar.dampers.fitting.settings import FitSettings
    from quartercar.dampers.stepper import DamperStepper


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class SampledDamper(Damper):
    """A damper whose law is an input-output model of lpvid: past samples of force, motion and current.

    Its parameters are those of the model, with their names there, and have no physical bounds. Before a fit it holds
    settings alone. Fitted, it runs at its own sample time; its velocity, displacement and current are the record's
    roles of those names.

    Attributes
    ----------
    stored : mapping or None
        The model inside as plain data; `model` is the object.
    """

    stored: Mapping[str, Any] | None = None

    # -- what a kind describes ----------------------------------------------------------------------------------
    @abstractmethod
    def check_orders(self) -> None:
        """Refuse settings that make no model."""

    @property
    @abstractmethod
    def past(self) -> int:
        """Samples from which a run starts, before there is a model."""

    @abstractmethod
    def identified(self, records: Sequence[Record]) -> tuple[Self, Identification, tuple[str, ...]]:
        """Identify from records in the damper's own sense: the settings as chosen, the estimate, notes on it.

        Parameters
        ----------
        records : sequence of Record
            Training data with the channels that the damper reads and the force, tension positive, displacement from the
            centre.

        Returns
        -------
        damper : SampledDamper
            With its open settings as chosen on these records; not yet fitted.
        found : Identification
            The estimate, with the layout of its parameters.
        notes : tuple of str
            What was chosen and by which figures.
        """

    # -- the model ---------------------------------------------------------------------------------------------------
    def check_settings(self) -> None:
        self.check_orders()
        held = None
        if self.stored is not None:
            from quartercar.dampers.blackbox.held import Held

            held = Held.of(self.stored)
            read = {s.name for s in held.model.inputs} | set(held.model.box.names)
            if not read <= {"velocity", "displacement", "current"}:
                raise InputError("the model inside a damper reads velocity, displacement and current",
                                 got=", ".join(sorted(read)))
        object.__setattr__(self, "_held", held)
        object.__setattr__(self, "_parameters", () if held is None else held.parameters)

    @property
    def held(self) -> Held:
        """The model inside with the places of its parameters; InputError before a fit."""
        held: Held | None = self._held  # type: ignore[attr-defined]
        if held is None:
            raise InputError(f"{self.name} has not been fitted yet", why="it has no parameters of its own",
                             mend="fit it to records first")
        return held

    @property
    def model(self) -> Inner | None:
        """The lpvid model at the present parameters, in the damper's own sense; None before a fit."""
        return None if self.stored is None else self.held.at(self.vector)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return self._parameters  # type: ignore[attr-defined]

    @property
    def reads(self) -> tuple[str, ...]:
        if self.stored is None:
            return self.wanted
        model = self.held.model
        return tuple(dict.fromkeys((*(s.name for s in model.inputs), *model.box.names)))

    @property
    @abstractmethod
    def wanted(self) -> tuple[str, ...]:
        """Roles that a fit would read, before there is a model."""

    @property
    def start(self) -> int:
        return self.past if self.stored is None else self.held.model.start

    @property
    def clock(self) -> float | None:
        return None if self.stored is None else self.held.model.sample_time

    # -- running -----------------------------------------------------------------------------------------------------
    def stepper(self, step: float) -> DamperStepper:
        from quartercar.dampers.blackbox.sampled_stepper import sampled_stepper

        return sampled_stepper(self.at_clock(step))

    def response(self, drive: Drive, vector: np.ndarray) -> np.ndarray:
        model = self.held.at(vector)
        self._check_clock(drive.sample_time)
        if drive.force is not None:
            return np.array(simulate(model, record_of(drive, drive.force), "measured").output[:, 0])
        if isinstance(model, LPVStateSpace):
            state, _ = state_at_rest(model, drive.velocity[:1], drive.current[0], drive.displacement[0])
            quiet = record_of(drive, np.zeros(drive.n_samples))
            return np.array(simulate(model, quiet, state[0] if np.isfinite(state).all() else "zero").output[:, 0])
        before = drive.displacement[0] + drive.velocity[0] * drive.sample_time * np.arange(-model.start, 0)
        rest = [at_rest(model, drive.velocity[:1], drive.current[0], x) for x in before]
        heads = np.full(model.start, drive.velocity[0]), before, np.full(model.start, drive.current[0])
        padded = Drive(drive.sample_time, *(np.concatenate(pair) for pair in zip(
            heads, (drive.velocity, drive.displacement, drive.current), strict=True)))
        out = simulate(model, record_of(padded, np.zeros(padded.n_samples)), np.reshape(rest, (model.start, 1)))
        return np.array(out.output[model.start:, 0])

    def _check_clock(self, sample_time: float) -> None:
        clock = self.held.model.sample_time
        assert clock is not None
        if abs(sample_time / clock - 1) > RATE_TOLERANCE:
            raise InputError(f"this {self.name} runs at the rate of its training data only",
                             got=f"{1 / sample_time:.6g} Hz against {1 / clock:.6g} Hz",
                             mend=f"resample the record to {1 / clock:.6g} Hz (--sample-rate {1 / clock:.6g})")

    def static_force(self, velocity: np.ndarray, current: float = 0.0, displacement: float = 0.0) -> np.ndarray:
        """(n,) force at constant velocities, once all has settled, as the motion passes through `displacement` [N]."""
        model = self.held.at(self.vector)
        speeds = np.atleast_1d(np.asarray(velocity, dtype=float))
        return at_rest(model, speeds.ravel(), float(current), float(displacement)).reshape(speeds.shape)

    def conservative_force(self, displacement: np.ndarray) -> np.ndarray:
        """What stays at rest; these models are affine in the displacement, so that two points of it suffice."""
        low = 0.0 if self.usual_currents is None else self.usual_currents[0]
        zero, one = (float(self.static_force(np.zeros(1), low, x)[0]) for x in (0.0, 1.0))
        return zero + (one - zero) * np.asarray(displacement, dtype=float)

    def at_clock(self, sample_time: float) -> Inner:
        """The model inside, in the damper's own sense; InputError at another rate than its own.

        Parameters
        ----------
        sample_time : float
            [s].

        Returns
        -------
        LPVTransferFunction, LPVStateSpace or SelfScheduled
            At the present parameters.
        """
        self._check_clock(sample_time)
        return self.held.at(self.vector)

    def to_model(self, sample_time: float) -> Any:
        """The model inside along records as measured (their polarity, their zero of displacement), at its own rate.

        Parameters
        ----------
        sample_time : float
            Any: the model keeps its own period (`Adaptable.to_model`), so that what resamples to it can ask with the
            period of the data. Along a record at another rate `lpvid.simulate` refuses it; `at_clock` refuses at once.

        Returns
        -------
        LPVTransferFunction, LPVStateSpace or SelfScheduled
            Velocity and displacement, as far as it reads them, to the force of the records.
        """
        from quartercar.dampers.as_model import turned

        return turned(self.held.at(self.vector), self)

    def to_linear_model(self) -> Any:
        """The model inside, whatever the polarity of its records: one that schedules itself is judged as such."""
        return self.held.at(self.vector)

    # -- fitting -----------------------------------------------------------------------------------------------------
    def estimate(self, records: Sequence[Record], settings: FitSettings) -> Estimate[Damper]:
        from lpvid.identification.output_error import OutputError
        from lpvid.identification.stage_fit import knee_remarks, shorten
        from quartercar.dampers.blackbox.held import Held
        from quartercar.dampers.blackbox.simulation_error import MOST_SAMPLES
        from quartercar.dampers.fitting.estimate import Estimate

        fresh = self.replace(stored=None, values={})
        own = [_own_sense(fresh, r) for r in records]
        chosen, found, notes = fresh.identified(own)
        held = Held(found.model, found.layout)  # type: ignore[arg-type]
        covariance = held.spread(found.covariance)
        if isinstance(found.structure, OutputError) and not np.isfinite(covariance).all():
            joint = _free_run_covariance(held, shorten(own, MOST_SAMPLES, held.model.start + 50))
            covariance = covariance if joint is None else joint
        fitted = chosen.replace(stored=held.to_dict())
        stage, remarks, at_bounds = held.model.input_stage, knee_remarks(found.model, own), tuple[str, ...]()
        if stage is not None and stage.first_knee is not None:
            place = fitted.names.index(knee := f"shape_{stage.KNEE[0]}")
            error = float(np.sqrt(covariance[place, place]))
            if remarks:
                covariance = covariance.copy()
                covariance[place], covariance[:, place] = np.nan, np.nan
                at_bounds = (knee,) * (stage.at_bound or stage.beyond_data)
            elif error > stage.first_knee:  # a positive number whose order of magnitude is open
                remarks = (f"{knee}: not determined by these data ({stage.first_knee:.3g} ± {error:.2g} "
                           f"{fitted.parameters[place].unit})",)
        return Estimate(fitted, covariance, at_bounds, undetermined=remarks, notes=(*notes, *found.notes),
                        condition=found.scaled_condition)


def boolean(value: object, name: str) -> bool:
    """True or False, nothing that merely counts as one.

    Parameters
    ----------
    value : object
        What was given.
    name : str
        Of the setting, for the message.

    Returns
    -------
    bool
        `value` itself.

    Raises
    ------
    InputError
        Anything but True or False: 0, 1 and text too.
    """
    if not isinstance(value, bool):
        raise InputError(f"{name} is true or false", got=value)
    return value


def _own_sense(damper: SampledDamper, record: Record) -> Record:
    """A record with the damper's own signs and zero, and no other channels than it reads."""
    drive = damper.drive(record, force=True)
    assert drive.force is not None
    units = {**UNITS, "current": "" if damper.current_unit == "1" else damper.current_unit}
    names = (*damper.reads, "force")
    return Record({n: getattr(drive, n) for n in names}, drive.sample_time, units={n: units[n] for n in names},
                  name=record.name, start=record.start)


STEP = 1e-6
"""share of a parameter by which it is moved for its difference quotient."""


def _free_run_covariance(held: Held, records: Sequence[Record]) -> np.ndarray | None:
    """H⁻¹ S H⁻¹ with H = JᵀJ and S the sum of lagged products of the scores J(t) e(t); None where a run diverges.

    J holds central differences of the free run, whose start is fitted to the data at every trial. S has Bartlett
    weights over the residual's memory (Newey & West 1987), for the error of a free run is not white.

    Parameters
    ----------
    held : Held
        At the estimate.
    records : sequence of Record
        Training data, in the damper's own sense.
    """
    theta = held.vector
    steps = STEP * np.maximum(np.abs(theta), 1e-3 * np.abs(theta[theta != 0]).min(initial=1.0))

    def runs(vector: np.ndarray) -> list[np.ndarray]:
        model = held.at(vector)
        return [np.asarray(simulate(model, r, "estimate").output[:, 0]) for r in records]

    columns = []
    for j, step in enumerate(steps):
        up, down = theta.copy(), theta.copy()
        up[j] += step
        down[j] -= step
        columns.append([(a - b) / (2 * step) for a, b in zip(runs(up), runs(down), strict=True)])
    jacobians = [np.column_stack([column[k] for column in columns]) for k in range(len(records))]
    errors = [r["force"] - run for r, run in zip(records, runs(theta), strict=True)]
    if not all(np.isfinite(a).all() for a in (*jacobians, *errors)):
        return None
    scores = [j * e[:, None] for j, e in zip(jacobians, errors, strict=True)]
    inverse = inverse_gram(np.vstack(jacobians))
    return inverse @ bartlett(scores, residual_memory(errors)) @ inverse
