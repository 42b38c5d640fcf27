"""Starting points: for static laws grids with bounded least squares, for others candidates ranked by their free run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from quartercar.dampers.drive import Drive
from quartercar.dampers.families import LawDamper, StaticDamper

SAMPLES = 3000
"""samples that rank the points of a grid"""


def best_starts(damper: StaticDamper, drives: Sequence[Drive], grid: Sequence[Mapping[str, float]],
                count: int) -> list[np.ndarray]:
    """Vectors with the nonlinear parameters of a grid and the linear ones of bounded least squares, the best first.

    Parameters
    ----------
    damper : StaticDamper
        Its values serve for what the grid does not name.
    drives : sequence of Drive
        With forces.
    grid : sequence of mapping
        Values of nonlinear parameters; clipped to their bounds.
    count : int
        How many to return.

    Returns
    -------
    list of (P,) array
        Parameters, SI, inside their bounds, by rising squared residual on about `SAMPLES` samples.
    """
    thin = [_thinned(d, -(-sum(e.n_samples for e in drives) // SAMPLES)) for d in drives]
    force = np.concatenate([d.force for d in thin if d.force is not None])
    names = list(damper.names)
    columns = [names.index(n) for n in damper.linear]
    lower = np.array([p.lower for p in damper.parameters])
    upper = np.array([p.upper for p in damper.parameters])
    ranked = []
    for point in grid:
        vector = damper.vector
        for name, value in point.items():
            vector[names.index(name)] = value
        vector = np.clip(vector, lower, upper)
        gradient = np.vstack([damper.jacobian(d, vector) for d in thin])[:, columns]
        vector[columns], cost = bounded_fit(gradient, force, lower[columns], upper[columns])
        ranked.append((cost, vector))
    ranked.sort(key=lambda pair: pair[0])
    return [vector for _, vector in ranked[:count]]


def ranked_starts(damper: LawDamper, drives: Sequence[Drive], candidates: Iterable[np.ndarray],
                  count: int) -> list[np.ndarray]:
    """Candidates by the residual of their free run, the best first; the earlier one where two are alike.

    Parameters
    ----------
    damper : LawDamper
    drives : sequence of Drive
        With forces.
    candidates : iterable of (P,) array
    count : int
        How many to return.

    Returns
    -------
    list of (P,) array
        Those that diverge last.
    """
    ranked = []
    for vector in candidates:
        with np.errstate(all="ignore"):
            residual = np.concatenate([damper.response(d, vector) - d.force for d in drives])
            cost = float(residual @ residual)
        ranked.append((cost if np.isfinite(cost) else np.inf, vector))
    ranked.sort(key=lambda pair: pair[0])
    return [vector for _, vector in ranked[:count]]


def _thinned(drive: Drive, step: int) -> Drive:
    keep = slice(None, None, max(step, 1))
    return Drive(drive.sample_time * max(step, 1), drive.velocity[keep], drive.displacement[keep],
                 drive.current[keep], None if drive.force is None else drive.force[keep])


def bounded_fit(columns: np.ndarray, target: np.ndarray, lower: np.ndarray,
                upper: np.ndarray | float = np.inf) -> tuple[np.ndarray, float]:
    """Least squares inside bounds, columns scaled to one size.

    Parameters
    ----------
    columns : (n, k) array
    target : (n,) array
    lower, upper : (k,) array
        Bounds; infinite for none.

    Returns
    -------
    solution : (k,) array
    cost : float
        Sum of squares.
    """
    from scipy.optimize import lsq_linear

    size = column_size(columns)
    found = lsq_linear(columns / size, target, (lower * size, upper * size), method="bvls")
    return np.clip(found.x / size, lower, upper), float(2 * found.cost)


def nonnegative_fit(columns: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, float]:
    """Least squares without negative coefficients, columns scaled to one size.

    Parameters
    ----------
    columns : (n, k) array
    target : (n,) array

    Returns
    -------
    solution : (k,) array
    error : float
        Root of the sum of squares.
    """
    from scipy.optimize import nnls

    size = column_size(columns)
    found, error = nnls(columns / size, target)
    return found / size, float(error)


def column_size(columns: np.ndarray) -> np.ndarray:
    """(k,) norms by which columns are scaled to one size; next to nothing for a column of zeros.

    Parameters
    ----------
    columns : (n, k) array

    Returns
    -------
    (k,) array
    """
    return np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
