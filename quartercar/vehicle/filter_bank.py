"""FilterBank, StateBank: identified dampers, transfer functions or state spaces, carried along in many cars at once."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from lpvid.model.input_stage import TanhStage
from lpvid.model.scheduling_stage import SchedulingLag
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from quartercar.dampers.blackbox.rest import at_rest, state_at_rest
from quartercar.dampers.blackbox.sampled import SampledDamper
from quartercar.dampers.contract import Damper

INPUTS = ("velocity", "displacement")


def filter_of(damper: Damper | None) -> LPVTransferFunction | LPVStateSpace | None:
    """The transfer function or state space inside a damper, where a `bank` can run it; else None.

    That is: inputs velocity and displacement, at most a tanh stage on the velocity, coefficients by the present current
    behind at most a lag.

    Parameters
    ----------
    damper : Damper or None
        None gives None.

    Returns
    -------
    LPVTransferFunction or LPVStateSpace or None
        With the present values of the damper's parameters.
    """
    if not isinstance(damper, SampledDamper) or damper.stored is None:
        return None
    model = damper.held.at(damper.vector)
    if isinstance(model, LPVTransferFunction):
        present = not (model.lagged and model.box.names) and model.n_affine <= 1
    elif isinstance(model, LPVStateSpace):
        present = True
    else:
        return None
    names, stage, lag = [s.name for s in model.inputs], model.input_stage, model.scheduling_stage
    plain = set(names) <= set(INPUTS) and model.box.names in ((), ("current",)) and model.basis.lags == (0, 0)
    shaped = stage is None or (isinstance(stage, TanhStage) and names[stage.channel] == "velocity")
    lagging = lag is None or (isinstance(lag, SchedulingLag) and lag.delay == 0)
    return model if present and plain and shaped and lagging else None


def bank(model: LPVTransferFunction | LPVStateSpace, cars: int) -> Bank:
    """Copies of a model, as `filter_of` gives it, side by side.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        As `filter_of` gives it.
    cars : int
        How many copies.

    Returns
    -------
    Bank
        Not yet settled: `begin` comes first.
    """
    return FilterBank(model, cars) if isinstance(model, LPVTransferFunction) else StateBank(model, cars)


class Bank(ABC):
    """Copies of one model, one per car, on the same clock.

    Per sample: `approach` with the filtered currents at the coming sample, which gives what the force there will be as
    a law of the motion there; then `commit` that motion.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        As `filter_of` gives it.
    cars : int

    Attributes
    ----------
    force : (cars,) array
        At the last committed sample [N].
    """

    def __init__(self, model: LPVTransferFunction | LPVStateSpace, cars: int) -> None:
        self._basis, self._scheduled, self._cars = model.basis, bool(model.box.names), cars
        self._names = [s.name for s in model.inputs]
        stage = model.input_stage
        self._shape = (stage.v0, stage.slope) if isinstance(stage, TanhStage) else None
        self.force = np.zeros(cars)

    @abstractmethod
    def begin(self, current: np.ndarray) -> None:
        """Settled at zero motion.

        Parameters
        ----------
        current : (cars,) array
            Filtered currents [A].
        """

    @abstractmethod
    def approach(self, p: np.ndarray) -> np.ndarray:
        """Law of the force at the coming sample.

        Parameters
        ----------
        p : (cars,) array
            Filtered currents there [A].

        Returns
        -------
        (cars, 8) array
            In the form of `tanh_form`.
        """

    @abstractmethod
    def commit(self, z: np.ndarray, v: np.ndarray) -> None:
        """Take the sample that was approached.

        Parameters
        ----------
        z, v : (cars,) arrays
            Displacements [m] and velocities [m/s] of the dampers.
        """

    @abstractmethod
    def ahead(self, z: np.ndarray, v: np.ndarray, p: np.ndarray, steps: int) -> np.ndarray:
        """Force some samples ahead, were the motion held and the filtered current each of some values.

        Parameters
        ----------
        z, v : (cars,) arrays
            Displacements [m] and velocities [m/s].
        p : (G,) array
            Filtered currents [A].
        steps : int
            Samples ahead.

        Returns
        -------
        (cars, G) array
            Force [N].
        """

    def _scheduling(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Basis functions (n, M) and 1/v0 (n,) at filtered currents."""
        phi = self._basis.evaluate(p[:, None] if self._scheduled else np.zeros((p.size, 0)))
        if self._shape is None:
            return phi, np.zeros(p.size)
        v0, slope = self._shape
        moving = slope * p if slope and self._scheduled else np.zeros(p.size)
        return phi, 1 / np.maximum(v0 + moving, 0.05 * v0)

    def _inputs(self, z: np.ndarray, v: np.ndarray, sharpness: np.ndarray) -> np.ndarray:
        """(…, inputs) behind the static stage."""
        motion = {"velocity": v, "displacement": z}
        columns = [np.broadcast_to(motion[n], sharpness.shape) for n in self._names]
        if self._shape is not None:
            columns.append(np.tanh(sharpness * v))
        return np.stack(columns, axis=-1)

    def _law(self, past: np.ndarray, direct: np.ndarray, sharpness: np.ndarray) -> np.ndarray:
        """(cars, 8) law of a force of the past and direct terms (cars, inputs)."""
        out = np.zeros((self._cars, 8))
        out[:, 0], out[:, 4], out[:, 7] = past, sharpness, 1.0
        for column, name in enumerate(self._names):
            out[:, 1 + INPUTS.index(name)] = direct[:, column]
        if self._shape is not None:
            out[:, 3] = direct[:, -1]
        return out


class FilterBank(Bank):
    """Copies of one transfer function.

    Parameters
    ----------
    model : LPVTransferFunction
        As `filter_of` gives it.
    cars : int
    """

    def __init__(self, model: LPVTransferFunction, cars: int) -> None:
        super().__init__(model, cars)
        self._model = model
        self._a = model.a[:, 0, 0]
        self._b = model.b[:, 0]
        self._c = np.zeros(model.basis.size) if model.c is None or not model.n_affine else model.c[0, 0]
        self._past_y = np.zeros((cars, len(self._a)))
        self._past_u = np.zeros((cars, len(self._b) - 1, self._b.shape[1]))
        self._look: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def begin(self, current: np.ndarray) -> None:
        self.force = np.array([at_rest(self._model, np.zeros(1), float(i), 0.0)[0] for i in current])
        self._past_y[:] = self.force[:, None]
        self._past_u[:] = 0.0

    def _coefficients(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """a (n, na), b (n, lags, inputs), c (n,), 1/v0 (n,) at filtered currents."""
        phi, sharpness = self._scheduling(p)
        return (np.einsum("nm,am->na", phi, self._a), np.einsum("nm,jim->nji", phi, self._b),
                np.einsum("nm,m->n", phi, self._c), sharpness)

    def approach(self, p: np.ndarray) -> np.ndarray:
        a, b, c, sharpness = self._coefficients(p)
        past = c - np.einsum("ca,ca->c", a, self._past_y) + np.einsum("cji,cji->c", b[:, 1:], self._past_u)
        self._look = past, b[:, 0], sharpness
        return self._law(*self._look)

    def commit(self, z: np.ndarray, v: np.ndarray) -> None:
        assert self._look is not None
        past, direct, sharpness = self._look
        u = self._inputs(z, v, sharpness)
        self.force = past + np.einsum("ci,ci->c", direct, u)
        if self._past_y.shape[1]:
            self._past_y = np.concatenate([self.force[:, None], self._past_y[:, :-1]], axis=1)
        if self._past_u.shape[1]:
            self._past_u = np.concatenate([u[:, None], self._past_u[:, :-1]], axis=1)

    def ahead(self, z: np.ndarray, v: np.ndarray, p: np.ndarray, steps: int) -> np.ndarray:
        a, b, c, sharpness = self._coefficients(p)
        cars, size = len(z), p.size
        u = self._inputs(z[:, None], v[:, None], np.broadcast_to(sharpness, (cars, size)))
        here = np.einsum("gi,cgi->cg", b[:, 0], u) + c
        y = np.broadcast_to(self._past_y[:, None], (cars, size, self._past_y.shape[1]))
        past = np.broadcast_to(self._past_u[:, None], (cars, size, *self._past_u.shape[1:]))
        for _ in range(steps):
            new = here - np.einsum("ga,cga->cg", a, y) + np.einsum("gji,cgji->cg", b[:, 1:], past)
            y = np.concatenate([new[..., None], y[..., :-1]], axis=-1)
            past = np.concatenate([u[:, :, None], past[:, :, :-1]], axis=2)
        return y[..., 0]


class StateBank(Bank):
    """Copies of one state space.

    ::

        F = C(p) d + D(p) U(v, z) + g(p),    d⁺ = A(p) d + B(p) U(v, z) + f(p)

    Parameters
    ----------
    model : LPVStateSpace
        As `filter_of` gives it.
    cars : int
    """

    def __init__(self, model: LPVStateSpace, cars: int) -> None:
        assert model.state_offset is not None and model.output_offset is not None
        super().__init__(model, cars)
        self._model = model
        self._stacks = (model.A, model.B, model.C[:, 0], model.D[:, 0], model.state_offset, model.output_offset[:, 0])
        self._state = np.zeros((cars, model.order))
        self._look: tuple[tuple[np.ndarray, ...], np.ndarray, np.ndarray] | None = None

    def begin(self, current: np.ndarray) -> None:
        found = [state_at_rest(self._model, np.zeros(1), float(i), 0.0) for i in current]
        self._state = np.array([state[0] for state, _ in found])
        self.force = np.array([force[0] for _, force in found])

    def _matrices(self, p: np.ndarray) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
        """A, B, C, D, f, g and 1/v0, each (n, …), at filtered currents."""
        phi, sharpness = self._scheduling(p)
        return tuple(np.tensordot(phi, x, axes=1) for x in self._stacks), sharpness

    def approach(self, p: np.ndarray) -> np.ndarray:
        matrices, sharpness = self._matrices(p)
        _, _, c, d, _, g = matrices
        past = np.einsum("cn,cn->c", c, self._state) + g
        self._look = matrices, past, sharpness
        return self._law(past, d, sharpness)

    def commit(self, z: np.ndarray, v: np.ndarray) -> None:
        assert self._look is not None
        (a, b, _, d, f, _), past, sharpness = self._look
        u = self._inputs(z, v, sharpness)
        self.force = past + np.einsum("ci,ci->c", d, u)
        self._state = np.einsum("cij,cj->ci", a, self._state) + np.einsum("cij,cj->ci", b, u) + f

    def ahead(self, z: np.ndarray, v: np.ndarray, p: np.ndarray, steps: int) -> np.ndarray:
        (a, b, c, d, f, g), sharpness = self._matrices(p)
        u = self._inputs(z[:, None], v[:, None], np.broadcast_to(sharpness, (len(z), p.size)))
        push = np.einsum("gij,cgj->cgi", b, u) + f
        state = np.broadcast_to(self._state[:, None], push.shape)
        for _ in range(steps - 1):
            state = np.einsum("gij,cgj->cgi", a, state) + push
        return np.einsum("gi,cgi->cg", c, state) + np.einsum("gi,cgi->cg", d, u) + g
