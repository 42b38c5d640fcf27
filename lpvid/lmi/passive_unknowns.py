"""What the programs for passive models are made of: their unknowns, their units and their coordinates."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from lpvid.lmi.affine import Affine
from lpvid.lmi.passive_form import sector_basis, supplied
from lpvid.lmi.program import Program
from lpvid.lmi.readings import box_of
from lpvid.lmi.search import frozen_gramian
from lpvid.lmi.storage import symmetric_units
from lpvid.model.transfer_function import LPVTransferFunction

CONTRACTED = 0.999
"""largest modulus to which an unstable model's poles are drawn for coordinates to be found."""


@dataclass(frozen=True, eq=False)
class Iterate:
    """A model's storage function and multiplier, and the damping still missing.

    Attributes
    ----------
    matrices : (K, n, n) array
        P(p) over the storage basis.
    multiplier : (L, ) array
        λ(p) over `sector_basis`; empty without a stage.
    shortage : float
        ε, in units of the form: M + ε·diag(0, I) ≻ 0 was reached. Negative for a passive model with room.
    """

    matrices: np.ndarray
    multiplier: np.ndarray
    shortage: float


class PassiveUnknowns:
    """Where the unknowns stand: parameters, P, λ, lower bounds of λ v₀, ε.

    Parameters
    ----------
    n : int
        Order of P.
    functions, sector : int
        Functions of P and of λ.
    pace : (k,) array
        Unit of each parameter.
    products : int
        Points at which the product λ v₀ is an unknown of its own.
    """

    def __init__(self, n: int, functions: int, sector: int, pace: np.ndarray, products: int = 0) -> None:
        self.pace, self.parameters = pace, len(pace)
        self.units = symmetric_units(n)
        storage = functions * len(self.units)
        self.storage = slice(self.parameters, self.parameters + storage)
        self.multiplier = slice(self.storage.stop, self.storage.stop + sector)
        self.product = slice(self.multiplier.stop, self.multiplier.stop + products)
        self.size = self.product.stop + 1

    def program(self) -> Program:
        """An empty program over these unknowns.

        Returns
        -------
        Program
            All unknowns declared as one row, without constraints and objective.
        """
        program = Program()
        program.unknowns.matrix(1, self.size)
        return program


def scaled(model: LPVTransferFunction, speed: float, force: float) -> LPVTransferFunction:
    """The model with its first input in units of `speed` and its output in units of `force`; storage in their product.

    Parameters
    ----------
    model : LPVTransferFunction
        With a tanh stage or none.
    speed : float
        [unit of the first input], above zero.
    force : float
        [unit of the output], above zero.

    Returns
    -------
    LPVTransferFunction
        Its inputs other than the first, as that behind the stage, keep their unit.
    """
    b = model.b / force
    b[:, :, 0] *= speed
    stage = model.input_stage
    assert model.c is not None
    if stage is not None:
        stage = replace(stage, v0=stage.v0 / speed, slope=stage.slope / speed)  # type: ignore[call-arg]
    return model.replace(b=b, c=model.c / force, input_stage=stage)


def frame_of(model: LPVTransferFunction) -> np.ndarray:
    """(n, n) coordinates of the past in which the frozen model at the centre of the box is a contraction.

    Parameters
    ----------
    model : LPVTransferFunction
        One of which passivity can be stated.

    Returns
    -------
    (n, n) array
        T of x = T x̃; poles outside of `CONTRACTED` are drawn in for it.
    """
    system = supplied(model, np.zeros(sector_basis(model).size))
    if not system.order:
        return np.zeros((0, 0))
    a = system.matrices(box_of(system.readings, model.box).centre[None])[0][0]
    size = max(float(np.abs(np.linalg.eigvals(a)).max()), 1e-3)
    gramian = frozen_gramian(a * min(1.0, CONTRACTED / size), np.eye(len(a)))
    return np.linalg.inv(np.linalg.cholesky(gramian)).T


def mixed(psi: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """(m, m, K·q) ψ_j times each of the parts (q, m, m).

    Parameters
    ----------
    psi : (K,) array
        Values of the functions.
    parts : (q, m, m) array
        One for each unknown of a symmetric matrix.

    Returns
    -------
    (m, m, K·q) array
        The unknowns of a function stand together.
    """
    q, m, _ = parts.shape
    return np.einsum("j,qab->abjq", psi, parts).reshape(m, m, len(psi) * q)


def affine(constant: np.ndarray, linear: np.ndarray) -> Affine:
    """A matrix of unknowns from arrays.

    Parameters
    ----------
    constant : (m, n) array
        Its constant part.
    linear : (m, n, K) array
        What each of the K unknowns multiplies.

    Returns
    -------
    Affine
        (m, n).
    """
    return Affine(constant, sparse.csr_array(linear.reshape(constant.size, -1)))
