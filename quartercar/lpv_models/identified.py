"""E9: the identified discrete damper, whose current is at once scheduling variable and control, inside the car."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from lpvid.errors import InputError
from lpvid.model.input_stage import TanhStage
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization import Realization, realize
from lpvid.scheduling import Polynomial
from lpvid.toolkit import checks
from quartercar.dampers.blackbox.sampled import SampledDamper
from quartercar.dampers.laws.secant import secant
from quartercar.lpv_models.car_part import SPEED, bare_car, car_plant, passive_sense
from quartercar.lpv_models.embedding import Embedding, Trajectory, car_states, need_rate, road_velocity
from quartercar.lpv_models.region import Region, limits_around
from quartercar.parameters import CarParameters
from quartercar.vehicle.result import CarRun

FORMS = ("augmented", "observable", "controllable")
SECANT = "secant"
CURRENT_STEP = 1e-9
"""δ below which the difference quotients are taken as derivatives [A]."""


@dataclass(frozen=True, eq=False)
class IdentifiedDamper(Embedding):
    """Car and identified LPV damper at the damper's rate, with the change of current δ = i − i_0 as control (E9).

    ::

        d⁺ = A(i_0) d + B(i_0) U(ρ_v) v_d + r_1 δ        car⁺ = Φ car + Γ_w ż_r + Γ_F F        (exact for held F, ż_r)
        F  = C(i_0) d + D(i_0) U(ρ_v) v_d + r_2 δ        U = [1; ρ_v],  ρ_v = tanh(v_d/v_0(i_0))/v_d

        r_1 = A_1 d + c_1 + [B(i) u(v, i) − B(i_0) u(v, i_0)]/δ,     r_2 = C_1 d + g_1 + [D(i) u(v, i) − …]/δ

    for i = i_0 + δ; at δ = 0 the quotients are derivatives. r_1 and r_2 schedule what the current does, ρ_v what the
    velocity does; in the augmented form r_1 is r_2 in the row that holds past force and, where the knee v_0 does not
    move with the current, zero elsewhere, so that one variable r remains. States are deviations from rest at i_0, whose
    force the car's spring carries. Control is lost at r = 0. Equation sheet 4.3 (E9), 5.6 for the forms.

    The box of r and ρ_v is that of recorded runs (`around`) and has to be watched at run time. What is not exact: the
    force is held over a sample, where the nonlinear car lets it rise linearly (`replay` against a run shows how much);
    and forms other than the augmented one change the damper when the current moves (`realization.gap`).

    Attributes
    ----------
    parameters : CarParameters
    damper : LpvArx or another SampledDamper whose model is a transfer function
    centre : float
        i_0 [A].
    form : {"augmented", "observable", "controllable"}
    limits : mapping of str to (float, float)
        Of the scheduling variables; `around` finds them.
    """

    number: ClassVar[str] = "E9"
    control: ClassVar[str] = "current_change"  # type: ignore[misc]

    parameters: CarParameters
    damper: SampledDamper
    centre: float = 1.25
    form: str = "augmented"
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        checks.one_of(self.form, FORMS, "form")
        passive_sense(self.damper)
        model = self.model
        basis = model.basis
        if not (isinstance(basis, Polynomial) and basis.names == ("current",) and basis.degree == 1):
            raise InputError("E9 embeds a damper that is affine in the current", got=", ".join(basis.labels),
                             mend="degree = 1")
        if model.lagged or model.n_affine > 1:
            raise InputError("E9 embeds coefficients that read the present current", got="coefficients of past ones",
                             mend="lagged = False, one affine term")
        if [s.name for s in model.inputs] != ["velocity"]:
            raise InputError("E9 embeds a damper whose input is the velocity",
                             got=", ".join(s.name for s in model.inputs))
        if model.input_stage is not None and not isinstance(model.input_stage, TanhStage):
            raise InputError("E9 embeds a velocity that is shaped by a tanh, or not at all",
                             got=type(model.input_stage).__name__, mend='shape = "tanh"')

    def around(self, runs: list[CarRun] | CarRun, margin: float = 1.1) -> IdentifiedDamper:
        """The same with a box for the scheduling around runs, widened by a margin about its middle.

        Parameters
        ----------
        runs : list of CarRun or CarRun
            At the damper's rate.
        margin : float
            Factor on the width of every range, 1 for the runs alone.

        Returns
        -------
        IdentifiedDamper
            With `limits` of every scheduling variable; those of ρ_v stay between 0 and 1/v_0.
        """
        listed = runs if isinstance(runs, list) else [runs]
        limits = limits_around(self.names, np.vstack([self.along(run).scheduling for run in listed]), margin)
        if SECANT in limits:
            limits[SECANT] = (max(limits[SECANT][0], 0.0), min(limits[SECANT][1], float(1 / self._knee)))
        return IdentifiedDamper(self.parameters, self.damper, self.centre, self.form, limits)

    # -- the damper ---------------------------------------------------------------------------------------------------
    @cached_property
    def model(self) -> LPVTransferFunction:
        """The transfer function inside the damper."""
        clock = self.damper.clock
        model = None if clock is None else self.damper.at_clock(clock)
        if not isinstance(model, LPVTransferFunction):
            raise InputError("E9 embeds an identified transfer function", got=self.damper.name, mend="lpv-arx")
        return model

    @cached_property
    def realization(self) -> Realization:
        """State space of the damper; its `gap` measures what the form costs while the current moves."""
        return realize(self.model, self.form)

    @property
    def sample_time(self) -> float:
        """Period of the damper [s]."""
        return self.model.sample_time

    def _frozen(self, current: float) -> tuple[np.ndarray, ...]:
        """A, B, C, D, f, g of the damper at a current."""
        return tuple(x[0] for x in self._along_currents(np.array([current])))

    def _along_currents(self, current: np.ndarray) -> tuple[np.ndarray, ...]:
        """(n, ·, ·) of each, with the basis read at one sample alone."""
        space = self.realization.model
        assert space.state_offset is not None and space.output_offset is not None
        phi = np.vstack([space.basis.evaluate(np.full((1, 1), i)) for i in current])
        return tuple(np.tensordot(phi, x, axes=1) for x in (space.A, space.B, space.C, space.D, space.state_offset,
                                                            space.output_offset))

    @cached_property
    def _here(self) -> tuple[np.ndarray, ...]:
        return self._frozen(self.centre)

    @cached_property
    def _rest(self) -> tuple[np.ndarray, float]:
        """State and force at rest at i_0."""
        a, _, c, _, f, g = self._here
        d = np.linalg.solve(np.eye(len(a)) - a, f)
        return d, float((c @ d + g)[0])

    @property
    def _knee(self) -> float:
        """v_0(i_0) [m/s]."""
        stage = self.model.input_stage
        assert isinstance(stage, TanhStage)
        return float(max(stage.v0 + stage.slope * self.centre, 0.05 * stage.v0))

    def _shaped(self, velocity: np.ndarray, current: np.ndarray) -> np.ndarray:
        """(n, m) inputs of the damper's filter."""
        stage = self.model.input_stage
        u = np.asarray(velocity, dtype=float)[:, None]
        return u if stage is None else stage.apply(u, np.asarray(current, dtype=float)[:, None])

    @cached_property
    def _rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows of the damper's state that become the force, and the others that the current moves."""
        stage = self.model.input_stage
        shifts = isinstance(stage, TanhStage) and bool(stage.slope)
        a, b, f = (self._here[k] for k in (0, 1, 4))
        echo = np.ones(len(a), dtype=bool)
        touched = np.abs(b[:, 1:]).any(axis=1) & shifts
        for current in (self.centre, *self.model.box.lower, *self.model.box.upper):
            at = self._frozen(current)
            state, force = np.hstack([at[0], at[1], at[4][:, None]]), np.hstack([at[2][0], at[3][0], at[5]])
            echo &= np.isclose(state, force, rtol=1e-12, atol=0.0).all(axis=1)
            touched |= (state != np.hstack([a, b, f[:, None]])).any(axis=1)
        return np.flatnonzero(echo), np.flatnonzero(touched & ~echo)

    # -- the plant ----------------------------------------------------------------------------------------------------
    @property
    def names(self) -> tuple[str, ...]:
        """ρ_v where the velocity is shaped, r, and one r_1 for each further row that the current moves."""
        shaped = (SECANT,) if self.model.input_stage is not None else ()
        return (*shaped, "force_per_current", *(f"state_per_current_{j}" for j in self._rows[1]))

    @cached_property
    def region(self) -> Region:  # type: ignore[override]
        return Region.of_runs(self.names, self.limits)

    @cached_property
    def _car(self) -> tuple[np.ndarray, np.ndarray]:
        """Φ and [Γ_w Γ_F] of the car for inputs held over a sample."""
        from scipy.linalg import expm

        car = bare_car(self.parameters)
        block = np.zeros((6, 6))
        block[:4, :4], block[:4, 4:] = car.A, car.B
        e = expm(block * self.sample_time)
        return e[:4, :4].copy(), e[:4, 4:].copy()

    @cached_property
    def system(self) -> LPVStateSpace:  # type: ignore[override]
        (a, b, c, d, _, _), names = self._here, self.names
        n, place = len(a), {name: 1 + k for k, name in enumerate(names)}
        delta = 4 + n + 1
        force = np.zeros((1 + len(names), delta + 1))  # F over the car's states, the damper's, ż_r and δ
        inner = np.zeros((1 + len(names), n, delta + 1))  # d⁺ over the same
        force[0, 4:4 + n], inner[0, :, 4:4 + n] = c[0], a
        force[0, :4], inner[0, :, :4] = d[0, 0] * SPEED, np.outer(b[:, 0], SPEED)
        if SECANT in place:
            force[place[SECANT], :4] = d[0, 1] * SPEED
            inner[place[SECANT], :, :4] = np.outer(b[:, 1], SPEED)
        force[place["force_per_current"], delta] = 1.0
        inner[place["force_per_current"], self._rows[0], delta] = 1.0
        for j in self._rows[1]:
            inner[place[f"state_per_current_{j}"], j, delta] = 1.0
        phi, gamma = self._car
        units = tuple("s/m" if name == SECANT else "N/A" for name in names)
        return car_plant(replace(bare_car(self.parameters), A=phi, B=gamma), force, inner, self.region,
                         (Signal(self.control, "A"),), units, self.sample_time)

    # -- along runs ---------------------------------------------------------------------------------------------------
    def damper_states(self, velocity: np.ndarray, current: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, n_d) states from rest and (n,) forces [N] of the damper along velocities and (filtered) currents.

        Parameters
        ----------
        velocity : (n,) array
            v_d at the damper's rate [m/s].
        current : (n,) array
            Behind the model's own filter [A].

        Returns
        -------
        states : (n, n_d) array
            In the coordinates of the form; the first is settled for the first velocity and current.
        force : (n,) array
            The force at rest included [N].
        """
        u = self._shaped(velocity, current)
        a, b, c, d, f, g = self._along_currents(np.asarray(current, dtype=float))
        n = a.shape[1]
        x = np.zeros((len(u) + 1, n))
        x[0] = np.linalg.solve(np.eye(n) - a[0], f[0] + b[0] @ u[0])
        force = np.empty(len(u))
        for k in range(len(u)):
            force[k] = (c[k] @ x[k] + d[k] @ u[k] + g[k])[0]
            x[k + 1] = a[k] @ x[k] + b[k] @ u[k] + f[k]
        return x[:-1], force

    def scheduled(self, states: np.ndarray, velocity: np.ndarray, current: np.ndarray) -> np.ndarray:
        """(n, n_p) ρ_v, r and further r_1 at damper states, velocities and (filtered) currents.

        Parameters
        ----------
        states : (n, n_d) array
            As `damper_states` returns them.
        velocity : (n,) array
            v_d [m/s].
        current : (n,) array
            Behind the model's own filter [A]; closer to i_0 than `CURRENT_STEP` the quotients are taken over that step.

        Returns
        -------
        (n, n_p) array
            In the order of `names`: ρ_v [s/m] where the velocity is shaped, r [N/A], r_1 [N/A].
        """
        a, b, c, d, f, g = self._here
        v, delta = np.asarray(velocity, dtype=float), np.asarray(current, dtype=float) - self.centre
        step = np.where(np.abs(delta) < CURRENT_STEP, CURRENT_STEP, delta)
        here, there = self._shaped(v, np.full(v.size, self.centre)), self._shaped(v, self.centre + step)
        moved = self._along_currents(self.centre + step)

        def quotient(row: int, matrices: tuple[int, int, int], still: tuple[np.ndarray, ...]) -> np.ndarray:
            on_state, on_input, alone = (moved[k][:, row] for k in matrices)
            now = np.einsum("ki,ki->k", on_state - still[0][row], states) + alone - still[2][row]
            return (now + np.einsum("ki,ki->k", on_input, there) - here @ still[1][row]) / step

        columns = [quotient(0, (2, 3, 5), (c, d, g))]
        columns += [quotient(j, (0, 1, 4), (a, b, f)) for j in self._rows[1]]
        if SECANT in self.names:
            columns.insert(0, secant(v / self._knee) / self._knee)
        return np.column_stack(columns)

    def filtered_current(self, run: CarRun) -> np.ndarray:
        """(n,) current behind the model's own filter [A].

        Parameters
        ----------
        run : CarRun
            At the damper's rate.

        Returns
        -------
        (n,) array
            The coil's current itself where the model has no filter.
        """
        i = np.asarray(run["current"], dtype=float)
        stage = self.model.scheduling_stage
        return i if stage is None else stage.apply(i[:, None], self.sample_time)[:, 0]

    def along(self, run: CarRun) -> Trajectory:
        """As the base class, from runs at the damper's rate.

        Raises
        ------
        InputError
            A run at another rate.
        """
        need_rate(run, self.sample_time)
        v, i = np.asarray(run["suspension_velocity"]), self.filtered_current(run)
        states, _ = self.damper_states(v, i)
        rest, force = self._rest
        car = car_states(run)
        car[:, 0] += (force - run.car.preload) / self.parameters.spring_stiffness
        inputs = np.column_stack([road_velocity(run), i - self.centre])
        return Trajectory(np.hstack([car, states - rest]), inputs, self.scheduled(states, v, i))
