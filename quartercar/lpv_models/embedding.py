"""Embedding: the nonlinear car written as an LPV plant, and the replay of a run through it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lpvid.errors import InputError
from lpvid.model.state_space import LPVStateSpace
from quartercar.lpv_models.car_part import STATES
from quartercar.lpv_models.region import Region
from quartercar.vehicle.linear import RELATIVE
from quartercar.vehicle.result import CarRun


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A run in the coordinates of an embedding, at the run's samples.

    Attributes
    ----------
    states : (n, n_x) array
    inputs : (n, n_u) array
        At the samples; those in `Embedding.held` keep their value up to the next.
    scheduling : (n, n_p) array
    """

    states: np.ndarray
    inputs: np.ndarray
    scheduling: np.ndarray


class Embedding(ABC):
    """A quarter car with a semi-active damper as an LPV system, exact along every trajectory inside its region.

    What is nonlinear in the car is put into scheduling variables that are signals of the car itself. Bump stops and
    lift-off are left out: an embedding holds for a car between its stops with the tyre on the road.
    """

    number: ClassVar[str]
    """in the equation sheet, 4.3"""
    held: ClassVar[tuple[str, ...]] = ("road_velocity",)
    """inputs that keep their value from one sample of a run to the next; the others are linear in between"""

    @property
    @abstractmethod
    def system(self) -> LPVStateSpace:
        """The plant; its box is the smallest one around `region`."""

    @property
    @abstractmethod
    def region(self) -> Region:
        """Admissible scheduling."""

    @property
    @abstractmethod
    def control(self) -> str | None:
        """Name of the input that a controller drives; None for a plant that is there to be analysed."""

    @abstractmethod
    def along(self, run: CarRun) -> Trajectory:
        """States, inputs and scheduling of a run of the nonlinear car.

        Parameters
        ----------
        run : CarRun
            Of the nonlinear car with the damper that is embedded, between its stops and with the tyre on the road.

        Returns
        -------
        Trajectory
            At the samples of the run.
        """


def car_states(run: CarRun) -> np.ndarray:
    """(n, 4) z_d, ż_s, z_t, ż_us.

    Parameters
    ----------
    run : CarRun
        Of any car.

    Returns
    -------
    (n, 4) array
        In the order of `STATES` [m, m/s, m, m/s].
    """
    return np.column_stack([run[name] for name in STATES])


def road_velocity(run: CarRun) -> np.ndarray:
    """(n,) slope of the road from each sample to the next [m/s]; the last is repeated.

    Parameters
    ----------
    run : CarRun
        With at least two samples.

    Returns
    -------
    (n,) array
        [m/s].
    """
    slope = np.diff(run["road"]) / run.sample_time
    return np.append(slope, slope[-1:])


def need_rate(run: CarRun, period: float) -> None:
    """Refuse a run at another rate than that of the identified damper.

    Parameters
    ----------
    run : CarRun
    period : float
        Of the damper [s].

    Raises
    ------
    InputError
        With both rates.
    """
    if abs(run.sample_time / period - 1) > 1e-6:
        raise InputError("E9 replays runs at the damper's rate",
                         got=f"{1 / run.sample_time:.6g} Hz against {1 / period:.6g} Hz")


def replay(embedding: Embedding, run: CarRun) -> np.ndarray:
    """(n, n_x) states of the embedding from the run's first state, with the run's inputs and scheduling.

    A discrete embedding is iterated. A continuous one is integrated by the exponential of the mean of the matrices at
    the ends of each step, which is of second order in the step.

    Parameters
    ----------
    embedding : Embedding
        Of the car that was run.
    run : CarRun
        At the embedding's own rate where that is discrete.

    Returns
    -------
    (n, n_x) array
        In free run: nothing but the first state is taken from the run's states.
    """
    path, model = embedding.along(run), embedding.system
    phi = model.basis.evaluate(path.scheduling)
    a, b = (np.einsum("km,mij->kij", phi, x) for x in (model.A, model.B))
    out = np.empty_like(path.states)
    out[0] = path.states[0]
    if model.is_discrete:
        for k in range(len(out) - 1):
            out[k + 1] = a[k] @ out[k] + b[k] @ path.inputs[k]
        return out
    from scipy.linalg import expm

    n = model.order
    held = [i for i, s in enumerate(model.inputs) if s.name in embedding.held]
    after = path.inputs[1:].copy()
    after[:, held] = path.inputs[:-1, held]
    drive = 0.5 * (np.einsum("kij,kj->ki", b[:-1], path.inputs[:-1]) + np.einsum("kij,kj->ki", b[1:], after))
    block = np.zeros((n + 1, n + 1))
    for k in range(len(out) - 1):
        block[:n, :n], block[:n, n] = 0.5 * (a[k] + a[k + 1]), drive[k]
        e = expm(block * run.sample_time)
        out[k + 1] = e[:n, :n] @ out[k] + e[:n, n]
    return out


def output_gap(embedding: Embedding, run: CarRun) -> float:
    """Largest error of C(p)x + D(p)u against the run's own signals, as a share of their largest value.

    No integration is involved: an exact embedding leaves rounding alone. The first sample and outputs that jump with
    the road's slope (a tyre with damping) are left out.

    Parameters
    ----------
    embedding : Embedding
        Of the car that was run.
    run : CarRun
        As `Embedding.along` takes it.

    Returns
    -------
    float
        Largest over all outputs, dimensionless.
    """
    path, model = embedding.along(run), embedding.system
    phi = model.basis.evaluate(path.scheduling)
    out = (np.einsum("km,mij,kj->ki", phi, model.C, path.states)
           + np.einsum("km,mij,kj->ki", phi, model.D, path.inputs))
    names = [s.name for s in model.outputs]
    worst = 0.0
    for name in (*RELATIVE, "damper_force"):
        if name not in names or (name == "tyre_force" and run.car.parameters.tyre_damping):
            continue
        wanted = run[name] - (run.car.preload if name == "damper_force" else 0.0)
        worst = max(worst, float(np.abs(out[1:, names.index(name)] - wanted[1:]).max() / np.abs(wanted).max()))
    return worst
