"""StateBank: an identified damper in state space carried along in many cars at once."""

from __future__ import annotations

import numpy as np

from lpvid.model.input_stage import TanhStage
from lpvid.model.state_space import LPVStateSpace
from quartercar.dampers.blackbox.rest import state_at_rest
from quartercar.vehicle.filter_bank import INPUTS


class StateBank:
    """Copies of one state space, one per car, on the same clock; used as a `FilterBank`.

    ::

        F = C(p) d + D(p) U(v, z) + g(p),    d⁺ = A(p) d + B(p) U(v, z) + f(p)

    Parameters
    ----------
    model : LPVStateSpace
        As `quartercar.vehicle.filter_bank.filter_of` gives it.
    cars : int

    Attributes
    ----------
    force : (cars,) array
        At the last committed sample [N].
    """

    def __init__(self, model: LPVStateSpace, cars: int) -> None:
        assert model.state_offset is not None and model.output_offset is not None
        self._model, self._cars = model, cars
        self._names = [s.name for s in model.inputs]
        stage = model.input_stage
        self._shape = (stage.v0, stage.slope) if isinstance(stage, TanhStage) else None
        self._stacks = (model.A, model.B, model.C[:, 0], model.D[:, 0], model.state_offset, model.output_offset[:, 0])
        self._state = np.zeros((cars, model.order))
        self._look: tuple[tuple[np.ndarray, ...], np.ndarray, np.ndarray] | None = None
        self.force = np.zeros(cars)

    def begin(self, current: np.ndarray) -> None:
        """Settled at zero motion and (cars,) filtered currents."""
        found = [state_at_rest(self._model, np.zeros(1), float(i), 0.0) for i in current]
        self._state = np.array([state[0] for state, _ in found])
        self.force = np.array([force[0] for _, force in found])

    def _matrices(self, p: np.ndarray) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
        """A, B, C, D, f, g and 1/v0, each (n, …), at filtered currents."""
        phi = self._model.basis.evaluate(p[:, None] if self._model.box.names else np.zeros((p.size, 0)))
        if self._shape is None:
            sharpness = np.zeros(p.size)
        else:
            v0, slope = self._shape
            moving = slope * p if slope and self._model.box.names else np.zeros(p.size)
            sharpness = 1 / np.maximum(v0 + moving, 0.05 * v0)
        return tuple(np.tensordot(phi, x, axes=1) for x in self._stacks), sharpness

    def _inputs(self, z: np.ndarray, v: np.ndarray, sharpness: np.ndarray) -> np.ndarray:
        """(…, inputs) behind the static stage."""
        motion = {"velocity": v, "displacement": z}
        columns = [np.broadcast_to(motion[n], sharpness.shape) for n in self._names]
        if self._shape is not None:
            columns.append(np.tanh(sharpness * v))
        return np.stack(columns, axis=-1)

    def approach(self, p: np.ndarray) -> np.ndarray:
        """(cars, 8) law of the force at the coming sample, in the form of `tanh_form`, at (cars,) filtered currents."""
        matrices, sharpness = self._matrices(p)
        _, _, c, d, _, g = matrices
        past = np.einsum("cn,cn->c", c, self._state) + g
        out = np.zeros((self._cars, 8))
        out[:, 0], out[:, 4], out[:, 7] = past, sharpness, 1.0
        for column, name in enumerate(self._names):
            out[:, 1 + INPUTS.index(name)] = d[:, column]
        if self._shape is not None:
            out[:, 3] = d[:, -1]
        self._look = matrices, past, sharpness
        return out

    def commit(self, z: np.ndarray, v: np.ndarray) -> None:
        """Take the sample that was approached, at (cars,) displacements and velocities."""
        assert self._look is not None
        (a, b, _, d, f, _), past, sharpness = self._look
        u = self._inputs(z, v, sharpness)
        self.force = past + np.einsum("ci,ci->c", d, u)
        self._state = np.einsum("cij,cj->ci", a, self._state) + np.einsum("cij,cj->ci", b, u) + f

    def ahead(self, z: np.ndarray, v: np.ndarray, p: np.ndarray, steps: int) -> np.ndarray:
        """(cars, G) force some samples ahead, were the motion held and the filtered current each of (G,) values."""
        (a, b, c, d, f, g), sharpness = self._matrices(p)
        u = self._inputs(z[:, None], v[:, None], np.broadcast_to(sharpness, (len(z), p.size)))
        push = np.einsum("gij,cgj->cgi", b, u) + f
        state = np.broadcast_to(self._state[:, None], push.shape)
        for _ in range(steps - 1):
            state = np.einsum("gij,cgj->cgi", a, state) + push
        return np.einsum("gi,cgi->cg", c, state) + np.einsum("gi,cgi->cg", d, u) + g
