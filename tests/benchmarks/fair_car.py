"""Independent fit of the bench quarter car: which of its suspects the motion of the sprung mass supports.

    python tests/benchmarks/fair_car.py FOLDER [car:1]

Two masses on a measured road with an actuator between them, integrated by semi-implicit Euler steps of half a
millisecond; no line of the project is used. The sprung mass is held at its nominal 2.45 kg, the scale of all others::

    m_s z_s'' =  f,   m_u z_u'' = k_t (z_r - z_u) + c_t (z_r - z_u)' - f
    f = k_s (z_u - z_s) + c_s (z_u - z_s)' + F_c tanh((z_u - z_s)'/eps) + g u(t - T)
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import real_records
from fair_laws import advanced
from numba import njit
from scipy.optimize import least_squares

SPRUNG, SUB, EPS = 2.45, 4, 2e-3
NOMINAL = {"k_s": 900.0, "c_s": 7.5, "m_u": 1.0, "k_t": 2500.0, "c_t": 5.0}
SUSPECTS = ((), ("g",), ("F_c",), ("g", "F_c"), ("g", "T"), ("g", "F_c", "T"), ("g", "F_c", "road"))
FIRST = {"g": 1.0, "F_c": 0.1, "T": 0.0, "road": 1.0}


@njit(cache=True)
def _moved(road, force, h, k_s, c_s, m_u, k_t, c_t, friction, out):
    z = zu = road[0]
    v = vu = 0.0
    step = h / SUB
    for n in range(1, road.size):
        rate = (road[n] - road[n - 1]) / h
        for s in range(SUB):
            ground = road[n - 1] + rate * (s + 1) * step
            strut = (k_s * (zu - z) + c_s * (vu - v) + friction * np.tanh((vu - v) / EPS) + force[n - 1])
            v += step * strut / SPRUNG
            vu += step * (k_t * (ground - zu) + c_t * (rate - vu) - strut) / m_u
            z += step * v
            zu += step * vu
        out[n] = z


def simulated(record: dict[str, np.ndarray], values: dict[str, float]) -> np.ndarray:
    """(n,) m of the sprung mass."""
    h = float(record["time"][1] - record["time"][0])
    u = values["sign"] * values.get("g", 1.0) * advanced(record["actuator force"], values.get("T", 0.0) / h)
    out = np.full(u.size, record["sprung"][0])
    k_s, c_s, m_u, k_t, c_t = (values[n] for n in NOMINAL)
    _moved(values.get("road", 1.0) * record["road"], u, h, k_s, c_s, m_u, k_t, c_t, values.get("F_c", 0.0), out)
    return out


def main() -> None:
    """Print one line of JSON per set of suspects and sign of the actuator."""
    group = real_records.group(sys.argv[2] if len(sys.argv) > 2 else "car")
    first, other = (real_records.read(Path(sys.argv[1]), p[0]) for p in (group.training, group.held_out))
    for sign in (1.0, -1.0):
        for suspects in SUSPECTS:
            print(json.dumps(_fitted(first, other, suspects, sign)), flush=True)


def _fitted(first: dict[str, np.ndarray], other: dict[str, np.ndarray], suspects: tuple[str, ...],
            sign: float) -> dict:
    names = (*NOMINAL, *suspects)
    start = np.array([NOMINAL.get(n, FIRST.get(n, 0.0)) for n in names])
    scale = np.array([{"T": 0.01}.get(n, max(abs(s), 0.1)) for n, s in zip(names, start, strict=True)])
    low = np.array([-5.0 if n == "g" else -0.05 if n == "T" else 0.0 if n in ("F_c", "c_t", "c_s") else 0.1 * s
                    for n, s in zip(names, start, strict=True)])
    high = np.array([5.0 if n == "g" else 0.05 if n == "T" else 5.0 if n == "F_c" else 100 * max(s, 1.0)
                     for n, s in zip(names, start, strict=True)])

    def errors(q: np.ndarray) -> np.ndarray:
        return (simulated(first, dict(zip(names, q, strict=True)) | {"sign": sign}) - first["sprung"]) * 1e3

    with np.errstate(all="ignore"):
        found = least_squares(lambda q: np.clip(np.nan_to_num(errors(q), nan=1e3), -1e3, 1e3), start, x_scale=scale,
                              bounds=(low, high), diff_step=1e-4, max_nfev=60)
    values = dict(zip(names, map(float, found.x), strict=True)) | {"sign": sign}
    def esr(r: dict[str, np.ndarray]) -> float:
        return float(np.mean((simulated(r, values) - r["sprung"]) ** 2) / np.var(r["sprung"]))
    return {"suspects": suspects, "sign": sign, "training": round(esr(first), 5), "held_out": round(esr(other), 5),
            "values": {k: float(f"{v:.4g}") for k, v in values.items()}}


if __name__ == "__main__":
    main()
