"""Lifting: the functions of the scheduling taken as scheduling variables, in which the system is affine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Polynomial, Scheduling


@dataclass(frozen=True, eq=False)
class Lifting:
    """θ = φ(p): the affine system in θ, and the map to it.

    Parameters
    ----------
    system : LPVStateSpace
        Affine in θ, whose box holds every value of φ; its rates are arbitrary.
    basis : Basis
        φ of the system it came from.
    kept : tuple of int
        Which functions of the basis are the variables θ.

    Notes
    -----
    The system is exact, the box is not: it lets the θ move on their own, so a design for it covers more than the
    system it came from.
    """

    system: LPVStateSpace
    basis: Basis
    kept: tuple[int, ...]

    def variables(self, points: np.ndarray) -> np.ndarray:
        """(N, n_θ) values of θ at points of p, shape (N, n_p).

        Parameters
        ----------
        points : (N, n_p) array
            Scheduling values, in the units of p.

        Returns
        -------
        (N, n_θ) array
            In the order of the lifted box's variables.
        """
        return self.basis.evaluate(np.asarray(points, dtype=float))[:, list(self.kept)]


def lift(system: LPVStateSpace) -> Lifting:
    """Every function of the basis that moves becomes a scheduling variable; exact, but for the box conservative.

    Affine, and so polytopic (`to_polytopic`) or linear fractional (`to_lft`), whatever the basis was.

    Parameters
    ----------
    system : LPVStateSpace
        With a basis that reads p at one time.

    Returns
    -------
    Lifting
        The affine system and the map to θ.

    Raises
    ------
    InputError
        A basis that reads p at several times.

    Examples
    --------
    >>> system = LPVStateSpace([[[-1.0]], [[0.0]], [[-2.0]]], np.zeros((3, 1, 0)), np.zeros((3, 0, 1)),
    ...                        np.zeros((3, 0, 0)), Polynomial("p", 2), None, Scheduling(("p",), (-1.0,), (2.0,)))
    >>> lifted = lift(system)
    >>> lifted.system.box.names, lifted.system.box.lower, lifted.system.box.upper
    (('p^2',), (0.0,), (4.0,))
    """
    basis = system.basis
    if basis.lags != (0, 0):
        raise InputError("a system that reads its scheduling at several times cannot be lifted",
                         got=", ".join(basis.labels))
    arrays = {n: np.array(getattr(system, n)) for n in ("A", "B", "C", "D", "state_offset", "output_offset")}
    one = basis.unity
    constant = {n: np.zeros_like(x[0]) for n, x in arrays.items()}
    if one is not None:
        pivot = int(np.argmax(np.abs(one)))  # φ_pivot = (1 − Σ_other one_m φ_m)/one_pivot
        for name, x in arrays.items():
            constant[name] = x[pivot] / one[pivot]
            arrays[name] = x - one.reshape(-1, *[1] * (x.ndim - 1)) * constant[name]
            arrays[name][pivot] = 0.0
    moving = [m for m in range(basis.size) if any(x[m].any() for x in arrays.values())]
    lower, upper = (r[moving] for r in basis.ranges(system.box.limits))
    labels = [basis.labels[m] for m in moving]
    names = tuple(x if labels.count(x) == 1 else f"{x}#{i + 1}" for i, x in enumerate(labels))
    box = Scheduling(names, tuple(lower.tolist()), tuple(upper.tolist()))
    full = {n: np.concatenate([constant[n][None], x[moving]]) for n, x in arrays.items()}
    affine = Polynomial(names, 1)
    lifted = LPVStateSpace(full["A"], full["B"], full["C"], full["D"], affine, system.sample_time, box,
                           full["state_offset"], full["output_offset"], inputs=system.inputs, outputs=system.outputs)
    return Lifting(lifted, basis, tuple(moving))
