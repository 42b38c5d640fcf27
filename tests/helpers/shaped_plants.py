"""Plants that several tests of synthesis share."""

from __future__ import annotations

import numpy as np

import lpvid as lpv
from lpvid.synthesis.generalized_plant import GeneralizedPlant

STILL = lpv.Polynomial((), 0)


def plant_of(a, b1, b2, c1, d11, d12, c2, d21, sample_time=None, *, basis=STILL, more=(), box=None) -> GeneralizedPlant:
    """A plant w, u -> z, y with signals w0…, u0…, z0…, y0…; `more` are the coefficients of A after the first."""
    a, b1, b2, c1, d11, d12, c2, d21 = (np.atleast_2d(np.asarray(m, dtype=float))
                                        for m in (a, b1, b2, c1, d11, d12, c2, d21))
    nw, nu, nz, ny = b1.shape[1], b2.shape[1], c1.shape[0], c2.shape[0]
    stacks = [[m] + [np.zeros_like(m)] * len(more) for m in
              (a, np.hstack([b1, b2]), np.vstack([c1, c2]), np.block([[d11, d12], [d21, np.zeros((ny, nu))]]))]
    stacks[0][1:] = [np.asarray(m, dtype=float) for m in more]
    system = lpv.LPVStateSpace(*stacks, basis, sample_time, box, inputs=_named("w", nw) + _named("u", nu),
                               outputs=_named("z", nz) + _named("y", ny))
    return GeneralizedPlant(system, [f"u{i}" for i in range(nu)], [f"y{i}" for i in range(ny)])


def _named(letter: str, count: int) -> tuple[lpv.Signal, ...]:
    return tuple(lpv.Signal(f"{letter}{i}") for i in range(count))


def regulator(rng: np.random.Generator, n: int = 4, nu: int = 2, sample_time: float | None = None):
    """A random plant that measures its states, with z = [x; u] and w on every state: (plant, A, B)."""
    a, b = rng.standard_normal((n, n)), rng.standard_normal((n, nu))
    if sample_time is not None:
        a, b = np.eye(n) + sample_time * a, sample_time * b
    c1, d12 = np.vstack([np.eye(n), np.zeros((nu, n))]), np.vstack([np.zeros((n, nu)), np.eye(nu)])
    return plant_of(a, np.eye(n), b, c1, np.zeros((n + nu, n)), d12, np.eye(n), np.zeros((n, n)), sample_time), a, b


def spring_mass(lower: float = 1.0, upper: float = 4.0, rate: float | None = None, sample_time: float | None = None,
                full: bool = True) -> GeneralizedPlant:
    """x'' = −p x − 0.2 x' + w0 + u; z = [x, 0.3 u]; y = both states, or x with noise w1."""
    box = lpv.Scheduling(("stiffness",), (lower,), (upper,), (rate,))
    a0, a1 = np.array([[0.0, 1.0], [0.0, -0.2]]), np.array([[0.0, 0.0], [-1.0, 0.0]])
    b1, b2 = np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([[0.0], [1.0]])
    if sample_time is not None:
        a0, a1, b1, b2 = np.eye(2) + sample_time * a0, sample_time * a1, sample_time * b1, sample_time * b2
    c2, d21 = (np.eye(2), np.zeros((2, 2))) if full else (np.array([[1.0, 0.0]]), np.array([[0.0, 0.1]]))
    return plant_of(a0, b1, b2, [[1.0, 0.0], [0.0, 0.0]], np.zeros((2, 2)), [[0.0], [0.3]], c2, d21, sample_time,
                    basis=lpv.Polynomial("stiffness", 1), more=(a1,), box=box)


def scherer_1997() -> GeneralizedPlant:
    """Scherer, Gahinet & Chilali 1997, example 7: the least H-infinity gain is 9.50808."""
    return plant_of([[0, 10, 2], [-1, 1, 0], [0, 2, -5]], [[1], [0], [1]], [[0], [1], [0]], [[1, 0, 0], [0, 0, 0]],
                    [[0], [0]], [[0], [1]], [[0, 1, 0]], [[2]])


def simulated_gain(loop: lpv.LPVStateSpace, rng: np.random.Generator, steps: int = 4000, period: float = 0.01,
                   jump: bool = True) -> float:
    """‖z‖/‖w‖ of one run with a random disturbance and a random admissible scheduling: no bound may be below it."""
    dt = loop.sample_time or period
    box, nw = loop.box, len(loop.inputs)
    level = rng.uniform(box.lower, box.upper, (steps, len(box.names)))
    for i, rate in enumerate(box.rate):
        if rate is not None:
            drift = np.cumsum(rng.choice([-1.0, 1.0], steps // 50 + 1).repeat(50)[:steps]) * rate * dt
            width = box.upper[i] - box.lower[i]
            level[:, i] = box.lower[i] + np.abs((drift % (2 * width)) - width)  # a triangle keeps the rate
        else:
            level[:, i] = np.repeat(level[::20, i], 20)[:steps] if jump else level[0, i]
    w = np.zeros((steps, nw))
    k = np.arange(steps // 2)
    w[: steps // 2] = np.sin(np.outer(k * dt, rng.uniform(0.2, 4.0, nw)) + rng.uniform(0, 6.0, nw))
    phi = loop.basis.evaluate(level[:, [box.names.index(n) for n in loop.basis.names]])
    x, energy = np.zeros(loop.order), 0.0
    for row, v in zip(phi, w, strict=True):
        a, b, c, d = (np.tensordot(row, m, axes=1) for m in (loop.A, loop.B, loop.C, loop.D))
        z = c @ x + d @ v
        energy += float(z @ z)
        if loop.sample_time is None:
            half = np.eye(len(a)) - 0.5 * dt * a
            x = np.linalg.solve(half, (np.eye(len(a)) + 0.5 * dt * a) @ x + dt * (b @ v))
        else:
            x = a @ x + b @ v
    return float(np.sqrt(energy / np.sum(w**2)))
