"""Gains of a fixed structure from which a descent may start: close to another controller, or at random."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.linalg import schur, solve_continuous_are, solve_discrete_are

from lpvid.analysis.frozen_norms import response_at
from lpvid.errors import InputError, NumericalError
from lpvid.model.state_space import LPVStateSpace
from lpvid.synthesis.controller_structures import Attached, LowOrder, ObserverBased, Structure
from lpvid.synthesis.controller_table import matrices_at
from lpvid.synthesis.coprime_reduction import reduce_coprime
from lpvid.synthesis.generalized_plant import GeneralizedPlant, PlantMatrices
from lpvid.synthesis.interconnection import close_loop_at
from lpvid.synthesis.reduction import reduce_order
from lpvid.synthesis.scaling import Matrices

FREQUENCIES = 40
"""at which a controller is approximated, from a third of the slowest to three times the fastest mode of its loop"""


def approximated(structure: Structure, attached: Attached, plant: GeneralizedPlant, model: LPVStateSpace,
             points: np.ndarray) -> np.ndarray | None:
    """(N, n_v, n_ξ) gains with which the structure comes close to a controller of any order; None where it cannot.

    Without feedback inside the interface ξ = J(jω) y: least squares of (K − G J) T over frequencies, T the response
    from w to y of the controller's own loop. States of the structure's own are what `shortened` finds.

    Parameters
    ----------
    structure : Structure
        The structure to give gains to.
    attached : Attached
        The plant with its interface.
    plant : GeneralizedPlant
        The plant without it.
    model : LPVStateSpace
        The controller of any order.
    points : (N, n) array
        Points of the scheduling, in its units.

    Returns
    -------
    (N, n_v, n_ξ) array or None
        Gains at each point.
    """
    at = plant.at(points)
    if isinstance(structure, (LowOrder, ObserverBased)) or attached.interface.basis.names:
        return None
    k = matrices_at(model, plant.box, points)
    loops = close_loop_at(at, *k)
    poles = np.abs(np.linalg.eigvals(loops[0])) if loops[0].shape[1] else np.ones((1, 1))
    poles = poles[poles > 1e-9 * poles.max()]
    discrete = plant.sample_time is not None
    omega = np.geomspace(poles.min() / 3, 3 * poles.max(), FREQUENCIES)
    z = np.exp(1j * np.linspace(1e-3, np.pi, FREQUENCIES)) if discrete else 1j * omega
    ny, nu = len(plant.measurements), len(plant.controls)
    ja, jb, jc, jd = attached.interface.frozen([])
    found = []
    for i in range(len(points)):
        own = tuple(x[i] for x in k)
        left, right = [], []
        for s in z:
            y = _measured(at.point(i), own, s)
            wanted = response_at(own, s) @ y
            reading = response_at((ja, jb[:, :ny], jc[nu:], jd[nu:, :ny]), s) @ y
            left.append(np.hstack([np.real(wanted), np.imag(wanted)]))
            right.append(np.hstack([np.real(reading), np.imag(reading)]))
        wanted, reading = np.hstack(left), np.hstack(right)
        gain = np.zeros(attached.free.shape)
        for r, free in enumerate(attached.free):
            gain[r, free] = np.linalg.lstsq(reading[free].T, wanted[r], rcond=None)[0]
        found.append(gain)
    return np.array(found)


def observed(plant: GeneralizedPlant, points: np.ndarray) -> np.ndarray | None:
    """(N, n_u + n, n_y + n) gains of linear quadratic control and a Kalman filter at each point; None for no answer.

    Parameters
    ----------
    plant : GeneralizedPlant
        The plant without interface.
    points : (N, n) array
        Points of the scheduling, in its units.

    Returns
    -------
    (N, n_u + n, n_y + n) array or None
        Gains at each point.
    """
    at, found = plant.at(points), []
    n, nu, ny = plant.order, len(plant.controls), len(plant.measurements)
    solve = solve_continuous_are if plant.sample_time is None else solve_discrete_are
    for i in range(len(points)):
        m = at.point(i)
        try:
            q, r = _definite(m.C1.T @ m.C1), _definite(m.D12.T @ m.D12)
            x = solve(m.A, m.B2, q, r)
            w, v = _definite(m.B1 @ m.B1.T), _definite(m.D21 @ m.D21.T)
            y = solve(m.A.T, m.C2.T, w, v)
        except (np.linalg.LinAlgError, ValueError):
            return None
        gain = np.zeros((nu + n, ny + n))
        if plant.sample_time is None:
            gain[:nu, ny:], gain[nu:, :ny] = -np.linalg.solve(r, m.B2.T @ x), np.linalg.solve(v, m.C2 @ y).T
        else:
            gain[:nu, ny:] = -np.linalg.solve(r + m.B2.T @ x @ m.B2, m.B2.T @ x @ m.A)
            gain[nu:, :ny] = np.linalg.solve(v + m.C2 @ y @ m.C2.T, m.C2 @ y @ m.A.T).T
        found.append(gain)
    return np.array(found)


def drawn(size: int, count: int, generator: np.random.Generator) -> Iterator[np.ndarray]:
    """Zero, which may be a saddle, then normal gains of rising size in scaled units.

    Parameters
    ----------
    size : int
        Number of free gains.
    count : int
        How many are drawn.
    generator : numpy.random.Generator
        Source of the draws.

    Yields
    ------
    (size,) array
        In scaled units.
    """
    yield np.zeros(size)
    for i in range(count):
        yield generator.standard_normal(size) * (0.03, 0.3, 1.0, 3.0)[i % 4]


def shortened(structure: LowOrder, attached: Attached, model: LPVStateSpace, plant: GeneralizedPlant,
              points: np.ndarray) -> Iterator[np.ndarray]:
    """Gains of a controller with as many states as a structure has, out of one that has more, in two ways.

    By its balanced states, or those of its coprime factors where it is unstable; and by its slowest states, the others
    at their static gain, which keeps an integrator's zero that the balanced states lose.

    Parameters
    ----------
    structure : LowOrder
        The structure to give gains to.
    attached : Attached
        The plant with its interface.
    model : LPVStateSpace
        The controller of any order.
    plant : GeneralizedPlant
        The plant without it.
    points : (N, n) array
        Points of the scheduling, in its units.

    Yields
    ------
    (N, n_v, n_ξ) array
        Gains at each point.
    """
    inputs = [[s.name for s in model.inputs].index(n) for n in plant.measurements]
    outputs = [[s.name for s in model.outputs].index(n) for n in plant.controls]
    whole = matrices_at(model, plant.box, points)
    short = [whole] if model.order <= structure.order else [
        None if (found := _reduced(model, structure.order)) is None else matrices_at(found, plant.box, points),
        None if model.is_discrete else _slowest(whole, structure.order)]
    for found in short:
        if found is not None:
            a, b, c, d = found
            yield _table((a, b[:, :, inputs], c[:, outputs], d[:, outputs][:, :, inputs]), structure.order, plant
                         ) * attached.free


def _table(controller: Matrices, k: int, plant: GeneralizedPlant) -> np.ndarray:
    """(N, n_u + k, k + n_y) gains of a controller with at most k states."""
    a, b, c, d = controller
    n, nu, ny = a.shape[1], c.shape[1], b.shape[2]
    gains = np.zeros((len(a), nu + k, k + ny))
    gains[:, :nu, :n], gains[:, :nu, k:] = c, d
    gains[:, nu : nu + n, :n], gains[:, nu : nu + n, k:] = a, b
    if n < k:  # states that nothing drives and that decay
        rate = 0.0 if plant.sample_time is not None else -max(float(np.abs(a).max(initial=1.0)), 1e-3)
        gains[:, nu + n :, n:k] = rate * np.eye(k - n)
    return gains


def _reduced(model: LPVStateSpace, order: int) -> LPVStateSpace | None:
    """By balanced truncation, of an unstable controller by its coprime factors; None for neither."""
    for reduce in (reduce_order, reduce_coprime):
        try:
            return reduce(model, order, certified=False).model
        except (InputError, NumericalError, np.linalg.LinAlgError, ValueError):
            continue
    return None


def _slowest(controller: Matrices, order: int) -> Matrices | None:
    """The slowest modes of a controller at its middle point, the rest at their static gain; None where that is none.

    With x = T [x₁; x₂] of the ordered Schur form and x₂ = −A₂₂⁻¹(A₂₁x₁ + B₂y).
    """
    a, b, c, d = controller
    speeds = np.sort(np.abs(np.linalg.eigvals(a[len(a) // 2])))
    limit = 0.5 * (speeds[order - 1] + speeds[order]) if order else -1.0
    ordered: Any = schur(a[len(a) // 2], sort=lambda re, im: np.hypot(re, im) <= limit)
    t, kept = np.asarray(ordered[1]), int(ordered[2])
    if kept != order:  # a pair of complex poles would be torn apart
        return None
    a, b, c = t.T @ a @ t, t.T @ b, c @ t
    try:
        back = np.linalg.inv(a[:, order:, order:])
    except np.linalg.LinAlgError:
        return None
    into, out = -a[:, :order, order:] @ back, -c[:, :, order:] @ back
    return (a[:, :order, :order] + into @ a[:, order:, :order], b[:, :order] + into @ b[:, order:],
            c[:, :, :order] + out @ a[:, order:, :order], d + out @ b[:, order:])


def _measured(m: PlantMatrices, k: Matrices, s: complex) -> np.ndarray:
    """(n_y, n_w) response from disturbances to measurements of a loop."""
    y = response_at((m.A, m.B1, m.C2, m.D21), s)
    loop = response_at((m.A, m.B2, m.C2, m.D22), s)
    return np.linalg.solve(np.eye(len(y)) - loop @ response_at(k, s), y)


def _definite(matrix: np.ndarray) -> np.ndarray:
    return matrix + 1e-6 * max(float(np.trace(matrix)) / max(len(matrix), 1), 1e-9) * np.eye(len(matrix))
