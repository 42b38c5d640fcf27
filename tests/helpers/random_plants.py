"""Random plants for output feedback: stable and unstable, well and ill conditioned, one to three parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import lpvid as lpv
from helpers.synthesis_plants import plant

ORDERS = (2, 2, 3, 3, 4, 4, 5, 6, 8, 12)


@dataclass(frozen=True, eq=False)
class RandomPlant:
    """A plant with the design to try on it, and what it is."""

    seed: int
    plant: lpv.GeneralizedPlant
    design: lpv.OutputFeedback
    traits: tuple[str, ...]
    reachable: bool


def random_plant(seed: int) -> RandomPlant:
    """The plant of a seed; one in twenty has an unstable mode out of the controls' reach."""
    rng = np.random.default_rng([seed, 20261])
    n, s = int(rng.choice(ORDERS)), int(rng.integers(1, 4))
    nu, ny, nw, nz = (int(rng.integers(1, 3)) for _ in range(4))
    unstable, ill, discrete = rng.random() < 0.4, rng.random() < 0.4, rng.random() < 0.25
    lost = rng.random() < 0.05
    names = ("p", "q", "r")[:s]
    a = _dynamics(rng, n, unstable or lost, s)
    blocks = {name: _varying(rng, shape, s, 0.2 if free else 0.0)
              for name, shape, free in (("b1", (n, nw), True), ("b2", (n, nu), False), ("c1", (nz, n), True),
                                        ("c2", (ny, n), False))}
    d12, d21 = (_varying(rng, shape, s, 0.0) for shape in ((nz + nu, nu), (ny, nw + ny)))
    d12[0, :nz] *= 0.2
    d12[0, nz:], d21[0, :, nw:] = np.diag(10 ** rng.uniform(-1.5, 0.5, nu)), np.diag(10 ** rng.uniform(-1.5, 0.5, ny))
    singular = rng.random() < 0.1
    if singular:
        d12[:] = 0.0
    blocks["b1"] = np.concatenate([blocks["b1"], np.zeros((s + 1, n, ny))], axis=2)
    blocks["c1"] = np.concatenate([blocks["c1"], np.zeros((s + 1, nu, n))], axis=1)
    d11 = _varying(rng, (nz + nu, nw + ny), s, 0.1) * (0.1 if rng.random() < 0.5 else 0.0)
    if lost:
        a[:, 0] = a[:, :, 0] = 0.0
        a[0, 0, 0], blocks["b2"][:, 0] = 0.5, 0.0
    h = None
    if discrete:
        h = 0.05
        a, blocks = _sampled(a, blocks, h)
    if ill:
        scale, pace = 10 ** rng.uniform(-3, 3, n), 1.0 if discrete else 10 ** rng.uniform(-2, 3)
        a = pace * a * scale / scale[:, None]
        for name in blocks:
            blocks[name] = pace * blocks[name] / scale[:, None] if name[0] == "b" else blocks[name] * scale
    else:
        pace = 1.0
    slow = not discrete and rng.random() < 0.4
    rate = (float(0.5 * pace),) + (None,) * (s - 1) if slow else (None,) * s
    box = lpv.Scheduling(names, (-1.0,) * s, (1.0,) * s, rate)
    lyapunov = lpv.Polynomial("p", 1) if slow else None
    varying = str(rng.choice(["both", "controls", "measurements"]))
    design = lpv.OutputFeedback(lyapunov, varying=varying, points={1: 7, 2: 3, 3: 3}[s])
    present = (("unstable", unstable), ("ill", ill), ("discrete", discrete), ("singular", singular), ("rated", slow),
               ("lost", lost))
    traits = (*(t for t, on in present if on), f"n{n}", f"s{s}")
    p = plant(a, blocks["b1"], blocks["b2"], blocks["c1"], d11, d12, blocks["c2"], d21, lpv.Polynomial(names, 1), box,
              sample_time=h)
    return RandomPlant(seed, p, design, traits, not lost)


def _dynamics(rng: np.random.Generator, n: int, unstable: bool, s: int) -> np.ndarray:
    a = np.zeros((s + 1, n, n))
    a[0] = rng.normal(size=(n, n)) / np.sqrt(n)
    level = np.linalg.eigvals(a[0]).real.max()
    a[0] += (rng.uniform(0.05, 0.6) * (1 if unstable else -1) - level) * np.eye(n)
    a[1:] = rng.uniform(0.05, 0.35) * rng.normal(size=(s, n, n)) / np.sqrt(n)
    return a


def _varying(rng: np.random.Generator, shape: tuple[int, int], s: int, share: float) -> np.ndarray:
    m = np.zeros((s + 1, *shape))
    m[0] = rng.normal(size=shape)
    m[1:] = share * rng.normal(size=(s, *shape))
    return m


def _sampled(a: np.ndarray, blocks: dict, h: float) -> tuple[np.ndarray, dict]:
    """Euler's rule: exact enough for a random plant, and it stays affine."""
    ahead = 4 * h * a
    ahead[0] += np.eye(a.shape[1])
    return ahead, {k: 4 * h * v if k[0] == "b" else v for k, v in blocks.items()}
