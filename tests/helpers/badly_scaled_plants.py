"""Random plants in bad units: orders 3 to 10, near-integrators, weak penalties, weak noise, gridded dependence.

States, controls and measurements are up to 10⁶ apart; time-invariant, affine, or tables of sqrt(p), sin(p) and 1/p.
"""

from __future__ import annotations

import numpy as np

import lpvid as lpv
from helpers.synthesis_plants import plant
from lpvid.synthesis.design_grid import interpolating

KINDS = {"still": None, "affine": lambda p: p, "sqrt": lambda p: np.sqrt(p + 1.05) - 1, "sin": lambda p: np.sin(2 * p),
         "inverse": lambda p: 1 / (p + 1.4) - 1}
KNOTS = 9


def random_case(seed: int) -> tuple[lpv.GeneralizedPlant, lpv.OutputFeedback, tuple[str, ...]]:
    """Plant, design and traits of a seed."""
    rng = np.random.default_rng([seed, 27])
    n, kind = int(rng.integers(3, 11)), str(rng.choice(list(KINDS)))
    nw, nz, nu, ny = (int(rng.integers(1, 3)) for _ in range(4))
    unstable, slow, rated = rng.random() < 0.3, rng.random() < 0.3, kind != "still" and rng.random() < 0.25
    a = rng.normal(size=(n, n)) / np.sqrt(n)
    a += (rng.uniform(0.05, 0.5) * (1 if unstable else -1) - np.linalg.eigvals(a).real.max()) * np.eye(n)
    if slow:  # a near-integrator of a performance signal, as a weight is
        a[:, 0] = 0.0
        a[0, 0] = -(10 ** rng.uniform(-7, -2))
    more = rng.uniform(0.1, 0.35) * rng.normal(size=(n, n)) / np.sqrt(n)
    more[:, 0] *= not slow
    b1, b2 = rng.normal(size=(n, nw)), rng.normal(size=(n, nu))
    c1, c2 = rng.normal(size=(nz, n)), rng.normal(size=(ny, n))
    effort, noise = np.diag(10 ** rng.uniform(-3, 0.3, nu)), np.diag(10 ** rng.uniform(-3, 0.3, ny))
    b1, c1 = np.hstack([b1, np.zeros((n, ny))]), np.vstack([c1, np.zeros((nu, n))])
    d12, d21 = np.vstack([np.zeros((nz, nu)), effort]), np.hstack([np.zeros((ny, nw)), noise])
    x, u, y = (10 ** rng.uniform(-3, 3, k) for k in (n, nu, ny))
    pace = 10 ** rng.uniform(-1, 2)
    a, more = (pace * m * x / x[:, None] for m in (a, more))
    b1, b2, c1, c2 = pace * b1 / x[:, None], pace * b2 * u / x[:, None], c1 * x, c2 * x * y[:, None]
    d12, d21 = d12 * u, d21 * y[:, None]
    traits = (kind, f"n{n}", *(t for t, on in (("unstable", unstable), ("slow", slow), ("rated", rated)) if on))
    parts = (b1, b2, c1, np.zeros((nz + nu, nw + ny)), d12, c2, d21)
    if kind == "still":
        return plant(a, *parts), lpv.OutputFeedback(), traits
    box = lpv.Scheduling(("p",), (-1.0,), (1.0,), (0.5 * pace if rated else None,))
    knots = np.linspace(-1, 1, 2 if kind == "affine" else KNOTS)
    whole = np.array([a + KINDS[kind](p) * more for p in knots])
    still = [np.broadcast_to(m, (len(knots), *m.shape)) for m in parts]
    design = lpv.OutputFeedback(lpv.Polynomial("p", 1) if rated else None, varying="controls")
    return plant(whole, *still, basis=interpolating(box, (knots,)), box=box), design, traits
