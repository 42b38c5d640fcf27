"""Gain scheduling by scaled small gain: a controller with its own copy of the scheduling block Δ.

Packard 1994; Apkarian & Gahinet 1995. The plant is a linear fractional form; a controller of the same form uses a copy
of Δ, and one scaling 𝓛 that commutes with diag(Δ, Δ) makes the loop contractive for every trajectory of the scheduling.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lpvid.errors import InputError
from lpvid.lmi.certificate import diagonal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial
from lpvid.synthesis.assumptions import fault_of
from lpvid.synthesis.block_proof import gain_figure
from lpvid.synthesis.criteria import HInfinity
from lpvid.synthesis.design_grid import check_back_off, fitted
from lpvid.synthesis.figures import Figure, measure
from lpvid.synthesis.fractional_plant import FractionalController, FractionalPlant, fractional_plant
from lpvid.synthesis.fractional_search import recovered, scaled_levels, settled_levels
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.interconnection import close_loop
from lpvid.synthesis.plant_functions import written
from lpvid.synthesis.preconditioning import preconditioned
from lpvid.synthesis.progress import remember, stage
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.shaped_program import SignalCoordinates

MOST = 1.03
"""times the promise up to which the controller's own storage function is tried for a proof: writing the rational
controller down as a polynomial costs a little"""


@dataclass(frozen=True, eq=False)
class LFTFeedback:
    """Output feedback whose controller holds a copy of Δ: scaled small gain, for rational dependence.

    ::

              ┌──────────┐                       N_Sᵀ(…S, L, γ…)N_S ≺ 0, N_Rᵀ(…R, J, γ…)N_R ≺ 0,
          ┌──>│ plant    │──┐   p = Δ q          [R, I; I, S] ⪰ 0, [J, I; I, L] ⪰ 0,
          │   └──────────┘  │   p_K = Δ q_K      J, L commute with Δ (Apkarian & Gahinet 1995)
          │   ┌──────────┐  │
          └───│ controller│<┘
              └──────────┘

    The scheduling may move arbitrarily fast. The controller, rational in the scheduling, is returned as a polynomial
    (or a table) that is fitted to it, and verified as returned.

    Parameters
    ----------
    back_off : float
        Factor above the lowest γ at which R, S and the scalings are then made small and kept apart.

    Examples
    --------
    >>> LFTFeedback(back_off=1.1).back_off
    1.1
    """

    back_off: float = 1.05

    def __post_init__(self) -> None:
        check_back_off(self.back_off)

    def solve(self, plant: GeneralizedPlant) -> Synthesis:
        """The controller for a plant with a polynomial basis, its closed loop verified.

        Parameters
        ----------
        plant : GeneralizedPlant
            D22 = 0, over polynomials.

        Returns
        -------
        Synthesis
            The first controller that keeps its promise, else the best that was verified; "numerical" where none was
            recovered.

        Raises
        ------
        InputError
            Controls that reach the measurements directly, or a basis that is no polynomial.
        """
        started, corners = time.perf_counter(), plant.box.grid(3)
        at = plant.at(corners)
        fault = fault_of(plant, at, corners, between=True)
        if fault is not None:
            return Synthesis(fault.verdict, why=fault.why, mend=fault.mend, method="scaled small gain")
        if at.D22.any():
            raise InputError(f"the controls {', '.join(plant.controls)} reach the measurements directly",
                             mend="delay them by a fast lag, or use OutputFeedback")
        ready = preconditioned(plant, corners)
        inner, turn = ready.plant, ready.turn
        c = SignalCoordinates.of(inner.at(corners), plant.sample_time is not None)
        lowest, best = math.inf, None
        for least, fractional, found in settled_levels(fractional_plant(inner, c), self.back_off):
            lowest = min(lowest, least)
            stage(f"recovering a controller for {least:.4g}")
            outcome = self._recovered(plant, turn, c, fractional, least, found)
            if outcome is not None and (best is None or _rank(outcome) < _rank(best)):
                best = remember(replace(outcome, infimum=lowest, seconds=time.perf_counter() - started))
            if best is not None and best.verdict == "solved":
                return best
        if best is not None:
            return best
        why = (f"the scaled small-gain inequalities admit {lowest:.6g}, but no controller recovered from the solvers' "
               "answers keeps the loop stable" if math.isfinite(lowest) else "no solver found scalings and a Lyapunov "
               "matrix that bound the gain for arbitrarily fast scheduling; that none exist is not shown")
        return Synthesis("numerical", why=why, method="scaled small gain",
                         mend="use OutputFeedback with a Lyapunov matrix that depends on the scheduling, and rates",
                         infimum=lowest if math.isfinite(lowest) else None, seconds=time.perf_counter() - started)

    def _recovered(self, plant: GeneralizedPlant, turn: np.ndarray, c: SignalCoordinates, fractional: FractionalPlant,
                   lowest: float, found: dict[str, np.ndarray]) -> Synthesis | None:
        """The first controller that keeps its promise, or the best that was verified."""
        best: Synthesis | None = None
        for factor in dict.fromkeys((self.back_off, 1.2, 1.5)):
            gamma = lowest * factor
            levels = scaled_levels(fractional, gamma)
            matrices = found if factor == self.back_off else next(levels, (gamma, None))[1]
            if matrices is None:
                continue
            for law, solver in _tried(fractional, gamma * 1.001, matrices):
                controller = _written(plant, c, law)
                loop = close_loop(plant, controller)
                seen = (_proven(plant, loop, gamma, law, turn, c)
                        or measure(HInfinity(), plant, loop, gamma, Polynomial((), 0)))
                if not np.isfinite(seen.verified):
                    continue
                kept = seen.verified <= 1.005 * gamma
                result = Synthesis(
                    "solved" if kept and factor == self.back_off else "backed-off", gamma, seen.verified,
                    seen.lower, controller, loop, seen.certificate, seen.between_grid,
                    why=_why(kept, factor, self.back_off),
                    notes=tuple(f"the scheduling block repeats {n} {k} time(s)" for n, k in
                                zip(plant.box.names, fractional.repetitions, strict=True)),
                    solver=solver, method="scaled small gain", infimum=lowest)
                if kept:
                    return result
                if best is None or seen.verified < (best.gamma_verified or np.inf):
                    best = result
        return best


def _proven(plant: GeneralizedPlant, loop: LPVStateSpace, promised: float, law: FractionalController, turn: np.ndarray,
            c: SignalCoordinates) -> Figure | None:
    """The promise by the storage function that came with the controller; None where that does not prove it."""
    if law.storage is None:
        return None
    v, own = law.storage, diagonal(turn * c.states, np.eye(law.order))  # of x and x_K times the root of the pace
    root = np.sqrt(c.pace)
    found = gain_figure(HInfinity().description(plant), loop, promised,
                        replace(v, first=v.first / c.pace, second=v.second / c.pace, mix=own / root @ v.mix))
    return found if found is not None and found.between_grid and found.verified <= MOST * promised else None


def _rank(found: Synthesis) -> tuple[bool, float]:
    """Solved first, then by the gain that was verified."""
    return found.verdict != "solved", found.gamma_verified or math.inf


def _why(kept: bool, factor: float, asked: float) -> str:
    if not kept:
        return "the closed loop was verified, but above the promise"
    if factor == asked:
        return "the closed loop keeps what the scaled small-gain inequalities promised"
    return (f"no controller was recovered at {asked:g} times the least bound of the scaled small-gain inequalities; "
            f"the closed loop keeps what they promise at {factor:g} times")


def _tried(plant: FractionalPlant, gamma: float, found: dict[str, np.ndarray]
           ) -> Iterator[tuple[FractionalController, str]]:
    try:
        yield from recovered(plant, gamma, found)
    except np.linalg.LinAlgError:
        return


def _written(plant: GeneralizedPlant, c: SignalCoordinates, law: FractionalController) -> LPVStateSpace:
    """A controller over the scheduling in the plant's units: a polynomial through its values."""
    box, n, root = plant.box, law.order, np.sqrt(c.pace)
    half = np.where(box.half_width > 0, box.half_width, 1.0)
    left = np.concatenate([np.full(n, root), c.controls])
    right = np.concatenate([np.full(n, root), 1 / c.measurements])

    def values(points: np.ndarray) -> np.ndarray:
        parts = [law.at((p - box.centre) / half) for p in points]
        return np.array([left[:, None] * np.block([[a, b], [k, d]]) * right for a, b, k, d in parts])

    axes = tuple(np.unique(np.linspace(low, high, 5)) for low, high in zip(box.lower, box.upper, strict=True))
    basis, g = fitted(values, box, axes, Polynomial(box.names, 1))
    return written(plant, g, n, basis)


