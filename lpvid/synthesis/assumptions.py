"""What a plant must have before any controller is looked for, checked at frozen points and stated by its signals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import matrix_balance

from lpvid.errors import InputError
from lpvid.scheduling import Scheduling
from lpvid.synthesis.generalized_plant import GeneralizedPlant, PlantMatrices
from lpvid.synthesis.reach_between import least_reach

TINY = 1e-9
"""relative size below which a signal counts as unable to reach, or to show, a mode."""


@dataclass(frozen=True)
class Fault:
    """What no controller can mend: a verdict of `Synthesis`, with why and mend.

    Parameters
    ----------
    verdict : str
        "unstabilisable" or "undetectable".
    why : str
        Which mode, by its pole, at which scheduling.
    mend : str
        What to add or to change.
    """

    verdict: str
    why: str
    mend: str


def refuse_dead_signals(plant: GeneralizedPlant, at: PlantMatrices) -> None:
    """Raise for no control, one without effect, one whose polarity turns over, and measurements alike.

    Parameters
    ----------
    plant : GeneralizedPlant
        Whose controls and measurements are looked at.
    at : PlantMatrices
        Its matrices at the points of the design, (N, …) each.

    Raises
    ------
    InputError
        Naming the signal.
    """
    for field, chosen in (("control", plant.controls), ("measurement", plant.measurements)):
        if not chosen:
            raise InputError(f"output feedback needs a {field}", got=f"a plant without {field}s",
                             mend=f"name one in {field}s")
    push = np.concatenate([at.B2, at.D12], axis=1)
    seen = np.concatenate([at.C2, at.D21], axis=2).swapaxes(1, 2)
    shown = _shown(at)
    for j, name in enumerate(plant.controls):
        if not push[:, :, j].any():
            raise InputError(f"the control '{name}' has no effect on any state or performance signal",
                             got="zero authority at every point in the scheduling box",
                             mend=f"remove '{name}' from the controls, or connect it")
        if _turns_over(push[:, :, j]) or _turns_over(at.B2[:, shown, j]):
            raise InputError(f"the control '{name}' acts in opposite directions within the scheduling box",
                             got="a reversed polarity", why="between the two it has no authority at all",
                             mend=f"check the sign of '{name}' in the model, or design for the two parts separately")
    for j, name in enumerate(plant.measurements):
        if not seen[:, :, j].any():
            raise InputError(f"the measurement '{name}' depends on no state and no disturbance",
                             mend=f"remove '{name}' from the measurements, or connect it")
        if _turns_over(seen[:, :, j]):
            raise InputError(f"the measurement '{name}' changes its sign within the scheduling box",
                             got="a reversed polarity", why="between the two it shows nothing at all",
                             mend=f"check the sign of '{name}' in the model, or design for the two parts separately")


def fault_of(plant: GeneralizedPlant, at: PlantMatrices, points: np.ndarray, *, between: bool = False) -> Fault | None:
    """A mode that does not decay and that the controls cannot reach, or the measurements do not show.

    Popov-Belevitch-Hautus test at every point of the scheduling; trajectories that stay there are admissible. With
    `between`, also where a single control or measurement reaches a mode least on the lines between the points.

    Parameters
    ----------
    plant : GeneralizedPlant
        For the names of its signals and its sample time.
    at : PlantMatrices
        Its matrices at the points.
    points : (N, n_scheduling) array
        Scheduling values, in its units.
    between : bool
        Look between the points too.

    Returns
    -------
    Fault or None
        The first fault found, controls before measurements at each point; None where there is none.
    """
    discrete = plant.sample_time is not None
    if between:
        inside = least_reach(plant.at, points, discrete)
        if len(inside):
            fault = fault_of(plant, at, points)
            return fault_of(plant, plant.at(inside), inside) if fault is None else fault
    for k in range(len(at.A)):
        where = _where(plant.box, points[k])
        p = at.point(k)
        controls, sensors = ", ".join(plant.controls), ", ".join(plant.measurements)
        for a, b, verdict, text, remedy in (
                (p.A, p.B2, "unstabilisable", f"no control ({controls}) reaches", "an actuator that moves"),
                (p.A.T, p.C2.T, "undetectable", f"no measurement ({sensors}) shows", "a sensor for")):
            pole = _out_of_reach(a, b, discrete)
            if pole is not None:
                return Fault(verdict, f"{where}{text} the mode with pole {_pole_text(pole)}, which does not decay",
                             f"add {remedy} it; if it belongs to a weight, make the weight stable (a slow pole in "
                             "place of an integrator)")
    return None


def remarks(plant: GeneralizedPlant, at: PlantMatrices) -> tuple[str, ...]:
    """What Riccati equations would refuse, by the signals concerned: the inequalities do not need it.

    Parameters
    ----------
    plant : GeneralizedPlant
        For the names of its signals.
    at : PlantMatrices
        Its matrices at the points of the design, (N, …) each.

    Returns
    -------
    tuple of str
        One sentence for D12, one for D21, at the point of lowest rank; empty where both have full rank everywhere.
    """
    found = []
    for matrix, names, text in (
            (at.D12, plant.controls, "no performance signal limits {0} at high frequency (D12 has rank {1} of {2})"),
            (at.D21.swapaxes(1, 2), plant.measurements, "no noise reaches {0} (D21 has rank {1} of {2})")):
        ranks = [_rank(m) for m in matrix]
        k = int(np.argmin(ranks))
        if ranks[k] < len(names):
            found.append(text.format(_blind(matrix[k], names), ranks[k], len(names))
                         + ": Riccati equations need it, these inequalities do not")
    return tuple(found)


def slow_mode_out_of_reach(plant: GeneralizedPlant, points: np.ndarray, decay: float) -> str:
    """Where between points the only control or measurement loses a mode that decays slowly; empty for nowhere.

    The gain there is at least that of the mode by itself, however high it is.

    Parameters
    ----------
    plant : GeneralizedPlant
    points : (N, n_scheduling) array
        A full grid.
    decay : float
        That counts as slow [1/s, or per sample].

    Returns
    -------
    str
        Half a sentence.
    """
    discrete, found = plant.sample_time is not None, []
    places = least_reach(plant.at, points, discrete, decay)
    for place in places:
        p = plant.at(place[None]).point(0)
        for a, b, text in ((p.A, p.B2, f"no control ({', '.join(plant.controls)}) reaches"),
                           (p.A.T, p.C2.T, f"no measurement ({', '.join(plant.measurements)}) shows")):
            pole = _out_of_reach(a, b, discrete, decay)
            if pole is not None:
                found.append((1 - abs(pole) if discrete else -pole.real, f"{_where(plant.box, place)}{text}", pole))
    if not found:
        return ""
    _, text, pole = min(found, key=lambda f: f[0])
    return f"{text} the mode with pole {_pole_text(pole)}, which decays slowly and makes up the gain there"


def _out_of_reach(a: np.ndarray, b: np.ndarray, discrete: bool, decay: float = 0.0) -> complex | None:
    if not a.size:
        return None
    a, (scale, _) = matrix_balance(a, permute=False, separate=True)
    b = b / scale[:, None]
    size = max(np.linalg.norm(a, 2), 1e-300)
    for pole in np.linalg.eigvals(a):
        nearly = max(TINY * abs(pole), 1e-13 * size, decay)
        if abs(pole) < 1 - max(TINY, decay) if discrete else pole.real < -nearly:
            continue
        test = np.hstack([a - pole * np.eye(len(a)), b * size / max(np.linalg.norm(b), 1e-300)])
        if np.linalg.svd(test, compute_uv=False)[-1] < TINY * size:
            return complex(pole)
    return None


def _shown(at: PlantMatrices) -> np.ndarray:
    """(n,) which states a measurement can depend on, by the pattern of A and C2: the states of weights are not."""
    pattern = np.asarray(at.A.any(axis=0))
    shown = np.asarray(at.C2.any(axis=(0, 1)))
    for _ in range(len(shown)):
        shown = shown | pattern[shown].any(axis=0)
    return shown


def _turns_over(columns: np.ndarray) -> bool:
    """A direction that stays, times a factor whose sign does not (N, rows)."""
    size = np.linalg.norm(columns, axis=1)
    if not size.any():
        return False
    strongest = columns[int(size.argmax())]
    along = columns @ strongest / max(float(strongest @ strongest), 1e-300)
    aside = np.abs(columns - along[:, None] * strongest).max()
    return bool(aside <= 1e-9 * size.max() and along.min() < -1e-9)


def _rank(matrix: np.ndarray) -> int:
    s = np.linalg.svd(matrix, compute_uv=False)
    return int((s > 1e-9 * max(s.max(initial=0.0), 1e-300)).sum())


def _blind(matrix: np.ndarray, names: tuple[str, ...]) -> str:
    """Names of the columns, or of the combinations of them, that a matrix does not pass."""
    empty = [n for n, column in zip(names, matrix.T, strict=True) if not column.any()]
    if len(empty) == len(names) - _rank(matrix):
        return ", ".join(empty)
    return "a combination of " + ", ".join(names)


def _where(box: Scheduling, point: np.ndarray) -> str:
    text = ", ".join(f"{n} = {v:.6g} {u}".rstrip() for n, v, u in zip(box.names, point, box.units, strict=True))
    return f"at {text}, " if text else ""


def _pole_text(pole: complex) -> str:
    return f"{pole.real:.4g}" + (f"{pole.imag:+.4g}j" if abs(pole.imag) > 1e-9 * abs(pole) else "")
