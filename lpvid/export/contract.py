"""What an exporter gives: a model as a step program, with the simulation that the program must reproduce."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lpvid.errors import InputError
from lpvid.export.step_program import StepProgram
from lpvid.model.quasi import SelfScheduled

SAMPLES = 200
"""samples of the reference data of a self-test"""
MEMORY = 0.7
"""pole, in z, of the low pass behind a random trajectory of a self-test"""


@dataclass(frozen=True, eq=False)
class Options:
    """How a model is exported.

    Attributes
    ----------
    name : str
        Prefix of files and functions; left out, one from the model's kind.
    clamp : bool or None
        Hold the scheduling inside the model's box; left out, for designed controllers only.
    sample_time : float or None
        Period of what runs at any [s]; what is sampled keeps its own.
    at : mapping of str to float
        Inputs to hold: a model frozen at its scheduling.
    """

    name: str = ""
    clamp: bool | None = None
    sample_time: float | None = None
    at: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Exportable:
    """A step program with its oracle.

    Attributes
    ----------
    program : StepProgram
    reference : callable
        (n, inputs) samples to (n, outputs): this package's own simulation from rest, not the program.
    excite : callable
        (n, rng) to (n, inputs): a random trajectory inside the ranges.
    model : object
        What was exported.
    """

    program: StepProgram
    reference: Callable[[np.ndarray], np.ndarray]
    excite: Callable[[int, np.random.Generator], np.ndarray]
    model: Any

    def __repr__(self) -> str:
        return f"Exportable {type(self.model).__name__} as {self.program!r}"

    def trial(self, samples: int = SAMPLES, seed: int = 0, single: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """A random trajectory and what the simulation makes of it.

        Parameters
        ----------
        samples, seed : int
        single : bool
            Inputs that single precision holds exactly, so that only the arithmetic is compared.

        Returns
        -------
        (n, inputs) array
        (n, outputs) array

        Raises
        ------
        InputError
            A simulation that is not finite.
        """
        u = self.excite(samples, np.random.default_rng(seed))
        u = u.astype(np.float32).astype(float) if single else u
        y = np.asarray(self.reference(u), dtype=float).reshape(samples, len(self.program.outputs))
        if not np.isfinite(y).all():
            raise InputError("an unstable model is not exported as a step",
                             got=f"a self-test of {self.program.name} that leaves all bounds at sample "
                             f"{int(np.argmin(np.isfinite(y).all(axis=1)))}",
                             mend="identify again with --na 0, which is bounded by construction"
                             if isinstance(self.model, SelfScheduled) else
                             "identify again with a lower order, or a damper with --passive")
        return u, y

    def rounding(self, samples: int = SAMPLES) -> float:
        """How far rounding of the inputs to single precision moves the simulation, relative to the largest output.

        No arithmetic in single precision can be expected to do better: it is the condition of the task times 6e-8.

        Parameters
        ----------
        samples : int
            Length of the random trajectory; its sample time is that of the program.

        Returns
        -------
        float
            Largest over the outputs; 0 where there are none.
        """
        u, y = self.trial(samples, single=True)
        signs = np.random.default_rng(1).choice([-1.0, 1.0], u.shape)
        moved = np.asarray(self.reference(u * (1 + signs * 2.0**-24)), dtype=float).reshape(y.shape)
        return relative_error(moved, y)


def relative_error(got: np.ndarray, wanted: np.ndarray, scale: np.ndarray | None = None) -> float:
    """Largest error of any output, relative to the largest value of that output.

    Parameters
    ----------
    got, wanted : ndarray, shape (n_samples, n_outputs)
    scale : ndarray, shape (any, n_outputs), optional
        Where the largest values are taken from; left out, `wanted`.

    Returns
    -------
    float
        0 where there are no outputs; an output that is zero throughout counts with its error itself.
    """
    largest = np.abs(wanted if scale is None else scale).max(axis=0, initial=0.0)
    error = np.abs(got - wanted).max(axis=0, initial=0.0)
    return float((error / np.where(largest > 0, largest, 1.0)).max(initial=0.0))


@dataclass(frozen=True, eq=False)
class Exporter:
    """What one package can export.

    Attributes
    ----------
    accepts : callable
        Noun to bool.
    prepare : callable
        (noun, Options) to Exportable; InputError where this one has no step, with the nearest that has.
    flow : callable
        (noun, Options) to `lpvid.export.flow.Flow`, or None for what is not continuous.
    """

    accepts: Callable[[Any], bool]
    prepare: Callable[[Any, Options], Exportable]
    flow: Callable[[Any, Options], Any] = lambda noun, options: None


def smooth_noise(samples: int, columns: int, rng: np.random.Generator) -> np.ndarray:
    """(n, columns) low-passed noise within ±1: a random trajectory that visits the whole range.

    Parameters
    ----------
    samples, columns : int
        Length and number of the trajectories.
    rng : numpy.random.Generator
        Source of the white noise.

    Returns
    -------
    (samples, columns) array
        Every column scaled so that its largest magnitude is 1.
    """
    raw = rng.standard_normal((samples + 50, columns))
    out = np.zeros_like(raw)
    for k in range(1, len(raw)):
        out[k] = MEMORY * out[k - 1] + (1 - MEMORY) * raw[k]
    out = out[50:]
    return out / np.maximum(np.abs(out).max(axis=0, initial=0.0), 1e-300)


def within(samples: int, low: np.ndarray, high: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n, k) random trajectories that fill [low, high].

    Parameters
    ----------
    samples : int
        Length of the trajectories.
    low, high : (k,) arrays
        Ends of each range, in the unit of the channel.
    rng : numpy.random.Generator
        Source of the noise.

    Returns
    -------
    (samples, k) array
        Each trajectory touches one end of its range at least.
    """
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    return 0.5 * (low + high) + 0.5 * (high - low) * smooth_noise(samples, low.size, rng)
