"""A plant and a controller as linear fractional forms of the scheduling block Δ, in coordinates of one size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.lmi.certificate import diagonal
from lpvid.model.lft import LFTModel
from lpvid.model.state_space import LPVStateSpace, Matrices
from lpvid.synthesis.forms import to_lft
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.loop_check import LoopStorage
from lpvid.synthesis.shaped_program import SignalCoordinates


@dataclass(frozen=True, eq=False)
class FractionalPlant:
    """x⁺ = A x + B_d p + B1 w + B2 u, q = C_d x + …, z = C1 x + …, y = C2 x + …, p = Δ q, Δ = diag(δ_i I_{r_i}).

    Parameters
    ----------
    blocks : (n + r + n_z + n_y, n + r + n_w + n_u) array
        [A B_d B1 B2; C_d D_dd D_d1 D_d2; C1 D_1d D_11 D_12; C2 D_2d D_21 0], |δ_i| ≤ 1.
    order, repetitions : int and tuple of int
        n and r_i.
    outer : (int, int, int, int)
        n_w, n_u, n_z, n_y.
    discrete : bool
    turn : (n, n) array, optional
        T of x = T x̃, where coordinates were changed since the plant was made.
    """

    blocks: np.ndarray
    order: int
    repetitions: tuple[int, ...]
    outer: tuple[int, int, int, int]
    discrete: bool
    turn: np.ndarray | None = None

    def part(self, row: str, column: str) -> np.ndarray:
        """A block by its letters: rows x, q, z, y; columns x, p, w, u.

        Parameters
        ----------
        row : str
            One of x, q, z, y.
        column : str
            One of x, p, w, u.

        Returns
        -------
        2-D array
            A view into `blocks`; empty where the plant has no such signal.
        """
        nw, nu, nz, ny = self.outer
        n, r = self.order, sum(self.repetitions)
        tall, wide = np.cumsum([0, n, r, nz, ny]), np.cumsum([0, n, r, nw, nu])
        i, j = "xqzy".index(row), "xpwu".index(column)
        return self.blocks[tall[i] : tall[i + 1], wide[j] : wide[j + 1]]

    def stack(self, rows: str, columns: str) -> np.ndarray:
        """Several blocks side by side and above each other.

        Parameters
        ----------
        rows : str
            Letters among x, q, z, y, in the order wanted.
        columns : str
            Letters among x, p, w, u, in the order wanted.

        Returns
        -------
        2-D array
            One matrix of all of them.
        """
        return np.block([[self.part(r, c) for c in columns] for r in rows])


    def dual(self) -> FractionalPlant:
        """The transposed plant, in which z and w, and y and u, change places.

        Returns
        -------
        FractionalPlant
            Without `turn`.
        """
        nw, nu, nz, ny = self.outer
        return FractionalPlant(self.blocks.T, self.order, self.repetitions, (nz, ny, nw, nu), self.discrete)

    def in_coordinates(self, states: np.ndarray, channels: np.ndarray) -> FractionalPlant:
        """The same plant for x = `states` x̃, p = `channels` p̃ and q = `channels` q̃, which commute with Δ.

        Parameters
        ----------
        states : (n, n) array
            Regular.
        channels : (r, r) array
            Regular, block diagonal as Δ is.

        Returns
        -------
        FractionalPlant
            Its `turn` leads back to the states it was made with.
        """
        nw, nu, nz, ny = self.outer
        left = diagonal(np.linalg.inv(states), np.linalg.inv(channels), np.eye(nz + ny))
        return FractionalPlant(left @ self.blocks @ diagonal(states, channels, np.eye(nw + nu)), self.order,
                               self.repetitions, self.outer, self.discrete,
                               states if self.turn is None else self.turn @ states)


@dataclass(frozen=True, eq=False)
class FractionalController:
    """x_K⁺, u, q_K = Ω [x_K; y; p_K] with p_K = Δ q_K, and the storage function that proves its bound, where known.

    Parameters
    ----------
    matrix : (n_K + n_u + r, n_K + n_y + r) array
        Ω, rows x_K⁺, u, q_K and columns x_K, y, p_K.
    order : int
        n_K, number of states.
    repetitions : tuple of int
        r_i of Δ = diag(δ_i I_{r_i}); r is their sum.
    storage : LoopStorage, optional
        Of the closed loop; None where the controller came without one.
    """

    matrix: np.ndarray
    order: int
    repetitions: tuple[int, ...]
    storage: LoopStorage | None = None

    def at(self, delta: np.ndarray) -> Matrices:
        """A_K, B_K, C_K, D_K at normalised scheduling values δ of shape (len(repetitions),).

        Parameters
        ----------
        delta : (len(repetitions),) array
            Between −1 and 1; I − Ω_qp Δ must be regular there.

        Returns
        -------
        (A, B, C, D)
            Frozen matrices, in the coordinates of Ω.
        """
        n, r = self.order, sum(self.repetitions)
        m = self.matrix
        outer, inner = m.shape[0] - r, m.shape[1] - r
        block_ = np.diag(np.repeat(delta, self.repetitions))
        closed = m[:outer, :inner] + m[:outer, inner:] @ block_ @ np.linalg.solve(
            np.eye(r) - m[outer:, inner:] @ block_, m[outer:, :inner])
        return closed[:n, :n], closed[:n, n:], closed[n:, :n], closed[n:, n:]


def fractional_plant(plant: GeneralizedPlant, c: SignalCoordinates) -> FractionalPlant:
    """The linear fractional form of a plant, its signals sorted, factorised in scaled coordinates.

    The factorisation cuts small singular values, which means something only where states and signals are of one size.

    Parameters
    ----------
    plant : GeneralizedPlant
        Over polynomials of the scheduling.
    c : SignalCoordinates
        Scales of states, controls, measurements and time.

    Returns
    -------
    FractionalPlant
        In these coordinates.
    """
    model = to_lft(_scaled(plant, c)).model
    assert isinstance(model, LFTModel)
    n, r = model.order, model.width
    names_in, names_out = [s.name for s in model.inputs], [s.name for s in model.outputs]
    columns = [*range(n + r), *(n + r + names_in.index(x) for x in (*plant.disturbances, *plant.controls))]
    rows = [*range(n + r), *(n + r + names_out.index(x) for x in (*plant.performance, *plant.measurements))]
    outer = (len(plant.disturbances), len(plant.controls), len(plant.performance), len(plant.measurements))
    return FractionalPlant(model.matrix[np.ix_(rows, columns)], n, model.repetitions, outer,
                           plant.sample_time is not None)


def _scaled(plant: GeneralizedPlant, c: SignalCoordinates) -> LPVStateSpace:
    """The plant's system in scaled states, controls and measurements, time in units of 1/pace."""
    system, root = plant.system, np.sqrt(c.pace)
    size_in = dict(zip(plant.controls, c.controls, strict=True))
    size_out = dict(zip(plant.measurements, c.measurements, strict=True))
    right = np.concatenate([c.states / root, [size_in.get(s.name, 1.0) for s in system.inputs]])
    left = np.concatenate([1 / (c.states * root), [1 / size_out.get(s.name, 1.0) for s in system.outputs]])
    n = system.order
    whole = left[:, None] * np.block([[system.A, system.B], [system.C, system.D]]) * right
    return system.replace(A=whole[:, :n, :n], B=whole[:, :n, n:], C=whole[:, n:, :n], D=whole[:, n:, n:])
