"""Systems whose induced gains are known."""

from __future__ import annotations

import numpy as np

from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Fourier, Polynomial, Scheduling

STILL = Polynomial((), 0)


def time_invariant(a, b, c, d, sample_time: float | None = None) -> LPVStateSpace:
    """An LTI model."""
    return LPVStateSpace(*(np.asarray(x, dtype=float)[None] for x in (a, b, c, d)), STILL, sample_time)


def vanishing(rate: float | None = None) -> LPVStateSpace:
    """A = −I, B = [1; d], C = [d, −1]: zero for every frozen d, gain 1 when d moves at will (synthesis sheet, 1)."""
    eye = np.eye(2)
    return LPVStateSpace([-eye, 0 * eye], [[[1], [0]], [[0], [1]]], [[[0, -1]], [[1, 0]]], np.zeros((2, 1, 1)),
                         Polynomial("d", degree=1), None, Scheduling(("d",), (-1.0,), (1.0,), (rate,)))


def rotating(inner: np.ndarray, rate: float | None = None) -> LPVStateSpace:
    """A(q) = T(q)ᵀ A₀ T(q), B = C = I: in rotating coordinates the LTI system A₀ + q̇ J, so gains are known exactly."""
    basis, angles = Fourier("q", 2), np.linspace(0, 6, 25)
    turns = [np.array([[np.cos(q), -np.sin(q)], [np.sin(q), np.cos(q)]]) for q in angles]
    values = np.array([t.T @ inner @ t for t in turns]).reshape(len(angles), -1)
    a = np.linalg.lstsq(basis.evaluate(angles[:, None]), values, rcond=None)[0].reshape(-1, 2, 2)
    eye = np.zeros((basis.size, 2, 2))
    eye[0] = np.eye(2)
    return LPVStateSpace(a, eye, eye, 0 * eye, basis, None, Scheduling(("q",), (-np.pi,), (np.pi,), (rate,)))


def random_stable(rng: np.random.Generator, n: int, variables: int, discrete: bool) -> LPVStateSpace:
    """A random affine model that is quadratically stable by construction: ‖A(p)‖ < 1, or He A(p) ≺ 0."""
    basis = Polynomial(tuple(f"p{i}" for i in range(variables)), degree=1)
    a = rng.normal(size=(basis.size, n, n))
    spread = sum(np.linalg.norm(x, 2) for x in a)
    if discrete:
        a = 0.9 * a / spread
    else:
        a = a - a.swapaxes(1, 2) + 0.3 * (a + a.swapaxes(1, 2)) / spread
        a[0] -= 0.7 * np.eye(n)
    b, c, d = (rng.normal(size=(basis.size, *shape)) for shape in ((n, 2), (1, n), (1, 2)))
    box = Scheduling(basis.names, (-1.0,) * variables, (1.0,) * variables, (0.5,) * variables)
    return LPVStateSpace(a, b, c, 0.1 * d, basis, 0.1 if discrete else None, box)
