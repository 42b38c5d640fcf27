"""Starting points of the modified Bouc-Wen model, read off the force-velocity loop."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from quartercar.dampers.drive import Drive, joined
from quartercar.dampers.fitting.starting import bounded_fit
from quartercar.dampers.parameter import Parameter
from quartercar.dampers.sizes import path

KNEES = (0.1, 0.3, 1.0)
"""speed at which c_1 v reaches the yield force, as a share of the rms speed"""
SLIPS = (0.003, 0.03, 0.3)
"""slip x_y as a share of the rms displacement"""
RATES = (0.06, 0.3)
"""rates of the current's lag, per sample"""


def loop_candidates(parameters: Sequence[Parameter], exponent: float,
                    drives: Sequence[Drive]) -> Iterator[np.ndarray]:
    """Vectors whose plateau is that of the measured loop.

    Parameters
    ----------
    parameters : sequence of Parameter
        Of a `BoucWen`.
    exponent : float
        n, a start for it where it is a parameter.
    drives : sequence of Drive
        With forces.

    Returns
    -------
    iterator of (P,) arrays
        By knee, slip and rate of the current.
    """
    names = {p.name for p in parameters}
    v, x, i, f = joined(drives, "velocity", "displacement", "current", "force")
    plateau = _plateau(v, x, i, f, names)
    travel = np.concatenate([d.displacement if d.displacement.any() else path(d) for d in drives]).std()
    grid = product(KNEES, SLIPS, RATES if "current_rate" in names else RATES[:1])
    speed = float(np.sqrt(np.mean(v**2)))
    for knee, slip, rate in grid:
        yield _assembled(parameters, exponent, plateau, knee * speed, slip * float(travel),
                         rate / drives[0].sample_time)


def _plateau(v: np.ndarray, x: np.ndarray, i: np.ndarray, f: np.ndarray, names: set[str]) -> dict[str, float]:
    """Least squares of F = (c + c_i i) v + (h + h_i i) sign v + k x + F_g over the faster half of the samples."""
    fast = np.abs(v) >= np.median(np.abs(v))
    v, x, i, f = v[fast], x[fast], i[fast], f[fast]
    columns = {"c": v, "h": np.sign(v)}
    if "yield_force_per_current" in names:
        columns |= {"c_i": v * i, "h_i": np.sign(v) * i}
    if "gas_stiffness" in names:
        columns["k"] = x
    columns["offset"] = np.ones(v.size)
    lower = [-np.inf if name == "offset" else 0.0 for name in columns]
    found, _ = bounded_fit(np.column_stack(list(columns.values())), f, np.array(lower))
    out = {"c": 0.0, "h": 0.0, "c_i": 0.0, "h_i": 0.0, "k": 0.0} | dict(zip(columns, map(float, found), strict=True))
    return out | {"top": float(np.abs(i).max()), "spread": float(f.std())}


def _assembled(parameters: Sequence[Parameter], exponent: float, p: dict[str, float], knee: float, slip: float,
               rate: float) -> np.ndarray:
    """Series dashpot from the knee, then the parallel elements so that the plateau stays."""
    height = max(p["h"] + p["h_i"] * p["top"], 0.05 * p["spread"])
    slope = max(p["c"] + p["c_i"] * p["top"], 0.01 * p["spread"] / (knee or 1.0))
    series = max(height / (knee or 1.0), 2.0 * slope)
    lift = series / (series - slope)
    values = {"viscous_damping": lift * max(p["c"], 0.05 * slope), "series_damping": series,
              "yield_force": lift * max(p["h"], 0.05 * height), "yield_displacement": slip,
              "hysteresis_shape": 0.5, "viscous_damping_per_current": lift * p["c_i"],
              "series_damping_per_current": 0.01 * series / (p["top"] or 1.0),
              "yield_force_per_current": lift * p["h_i"], "current_rate": rate, "parallel_stiffness": 0.5 * p["k"],
              "gas_stiffness": 0.5 * p["k"], "gas_force": p["offset"], "exponent": exponent}
    return np.array([np.clip(values[q.name], q.lower, q.upper) for q in parameters])
