"""Reference plants of output feedback, with their sources."""

import math

import numpy as np

import lpvid as lpv
from lpvid.model.signals import Signal
from lpvid.synthesis.generalized_plant import GeneralizedPlant


def plant(a, b1, b2, c1, d11, d12, c2, d21, basis=None, box=None, sample_time=None, d22=None):
    """A generalised plant from blocks (…) or (M, …) over a basis, with signals w1…, u1…, z1…, y1…."""
    blocks = [np.asarray(m, dtype=float) for m in (a, b1, b2, c1, d11, d12, c2, d21)]
    blocks = [m if m.ndim == 3 else m[None] for m in blocks]
    a, b1, b2, c1, d11, d12, c2, d21 = blocks
    d22 = np.zeros((len(a), c2.shape[1], b2.shape[2])) if d22 is None else np.asarray(d22, dtype=float)[None]
    b = np.concatenate([b1, b2], axis=2)
    c = np.concatenate([c1, c2], axis=1)
    d = np.concatenate([np.concatenate([d11, d12], axis=2), np.concatenate([d21, d22], axis=2)], axis=1)
    w, u = [f"w{i + 1}" for i in range(b1.shape[2])], [f"u{i + 1}" for i in range(b2.shape[2])]
    z, y = [f"z{i + 1}" for i in range(c1.shape[1])], [f"y{i + 1}" for i in range(c2.shape[1])]
    system = lpv.LPVStateSpace(a, b, c, d, basis or lpv.Polynomial((), 0), sample_time, box,
                               inputs=tuple(map(Signal, w + u)), outputs=tuple(map(Signal, z + y)))
    return GeneralizedPlant(system, u, y)


def column(*values):
    """(n, 1)."""
    return np.array(values, dtype=float)[:, None]


def scherer(d22=0.0):
    """Scherer, Gahinet & Chilali, IEEE TAC 42 (1997) 896-911, example 7: optimum 9.50808."""
    return plant([[0, 10, 2], [-1, 1, 0], [0, 2, -5]], column(1, 0, 1), column(0, 1, 0), [[1, 0, 0], [0, 0, 0]],
                 np.zeros((2, 1)), column(0, 1), [[0, 1, 0]], [[2.0]], d22=[[d22]])


def sb10fd():
    """Example data of SLICOT's SB10FD (examples/data/SB10FD.dat of the SLICOT reference): optimum 10.1843."""
    a = [[-1, 0, 4, 5, -3, -2], [-2, 4, -7, -2, 0, 3], [-6, 9, -5, 0, 2, -1], [-8, 4, 7, -1, -3, 0],
         [2, 5, 8, -9, 1, -4], [3, -5, 8, 0, 2, -6]]
    b = np.array([[-3, -4, -2, 1, 0], [2, 0, 1, -5, 2], [-5, -7, 0, 7, -2], [4, -6, 1, 1, -2], [-3, 9, -8, 0, 5],
                  [1, -2, 3, -6, -2.0]])
    c = np.array([[1, -1, 2, -4, 0, -3], [-3, 0, 5, -1, 1, 1], [-7, 5, 0, -8, 2, -2], [9, -3, 4, 0, 3, 7],
                  [0, 1, -2, 1, -6, -2.0]])
    d = np.array([[1, -2, -3, 0, 0], [0, 4, 0, 1, 0], [5, -3, -4, 0, 1], [0, 1, 0, 1, -3], [0, 0, 1, 7, 1.0]])
    return plant(a, b[:, :3], b[:, 3:], c[:3], d[:3, :3], d[:3, 3:], c[3:], d[3:, :3], d22=d[3:, 3:])


def ill_conditioned():
    """Optimum √0.65, where Riccati equations of a common library give 0.00623 and a loop of 0.9014."""
    return plant(-np.eye(2), np.diag([0.0, 1.0]), column(1, 1), np.eye(2), 0.5 * np.eye(2), column(0, 1), [[1, 1]],
                 [[0, 1]])


def trivial():
    """Optimum 0, not attained."""
    return plant([[-1]], [[1]], [[1]], [[1]], [[0]], [[1]], [[1]], [[1]])


def missile():
    """Missile autopilot over (Z, M), 6 states with its weights; D21 = [1; 0]. Polytopic, cited optimum 0.197."""
    import control

    w2 = control.ss(control.tf([9.6785, 0.029035, 0, 0], [1, 12064, 1.136e7, 1.0661e10]))
    n = 6
    a, b1, b2 = np.zeros((3, n, n)), np.zeros((3, n, 1)), np.zeros((3, n, 1))
    a[0, 0, 1], a[1, 0, 0], a[2, 1, 0] = 1.0, -1.0, -1.0          # rows: constant, Z, M
    a[0, 2, 0], a[0, 2, 2], b1[0, 2, 0] = 1.0, -0.20101, 1.0      # e = r − y1 = r + x1 through 2.0101/(s + .20101)
    a[0, 3:, 3:], b2[0, 3:], b2[0, 1, 0] = w2.A, w2.B, 1.0
    c1, d12 = np.zeros((3, 2, n)), np.zeros((3, 2, 1))
    c1[0, 0, 2], c1[0, 1, 3:], d12[0, 1, 0] = 2.0101, w2.C[0], w2.D[0, 0]
    c2, d21 = np.zeros((3, 2, n)), np.zeros((3, 2, 1))
    c2[0, 0, 0], c2[0, 1, 1], d21[0, 0, 0] = 1.0, 1.0, 1.0
    box = lpv.Scheduling(("Z", "M"), (0.5, 0.0), (4.0, 106.0))
    return plant(a, b1, b2, c1, np.zeros((3, 2, 1)), d12, c2, d21, lpv.Polynomial(("Z", "M"), 1), box)


def wu(rate):
    """Wu, Yang, Packard & Becker, Int. J. Robust Nonlinear Control 6 (1996) 983-998, with its weights: 8 states."""
    from lpvid.scheduling import Fourier

    a, b1, b2 = np.zeros((3, 8, 8)), np.zeros((3, 8, 5)), np.zeros((3, 8, 2))
    a[0, 0, :2], a[0, 1, 1] = (0.75, 2), 0.5
    a[0, 2, 2] = a[0, 3, 3] = -10
    a[1, 0, 2] = a[1, 1, 3] = 1.0                                 # cos rho
    a[2, 0, 3], a[2, 1, 2] = 1.0, -1.0                            # sin rho
    a[0, 4, 4] = a[0, 5, 5] = -0.2                                # Wr = 20/(s + .2)
    a[0, 6, 6] = a[0, 7, 7] = -1000                               # Wn = 10 − 9900/(s + 1000)
    b1[0, 1, 0] = 3.0
    b1[0, 4, 1] = b1[0, 5, 2] = 4.0
    b1[0, 6, 3] = b1[0, 7, 4] = 100.0
    b2[0, 2, 0] = b2[0, 3, 1] = 10.0
    c1, c2, d12, d21 = (np.zeros((3, *s)) for s in ((4, 8), (2, 8), (4, 2), (2, 5)))
    for i in range(2):
        c1[0, i, i], c1[0, i, 4 + i] = 1.0, -5.0                  # e = v − Wr r
        c2[0, i, i], c2[0, i, 4 + i], c2[0, i, 6 + i] = 1.0, -5.0, -99.0
        d12[0, 2 + i, i], d21[0, i, 3 + i] = 1 / 280, 10.0
    box = lpv.Scheduling(("rho",), (-math.pi,), (math.pi,), (rate,), ("rad",))
    return plant(a, b1, b2, c1, np.zeros((3, 4, 5)), d12, c2, d21, Fourier("rho", 1), box)


def spring(rate=None, sample_time=None):
    """A mass on a spring of moving stiffness, position measured; sampled with Euler's rule where a period is given."""
    a = np.array([[[0.0, 1], [0, -0.2]], [[0, 0], [-1, 0]]])
    b1, b2 = np.array([[[0.0, 0], [1, 0]], np.zeros((2, 2))]), np.array([[[0.0], [1]], np.zeros((2, 1))])
    if sample_time is not None:
        a, b1, b2 = a * sample_time, b1 * sample_time, b2 * sample_time
        a[0] += np.eye(2)
    c1, d12 = np.array([[[1.0, 0], [0, 0]], np.zeros((2, 2))]), np.array([[[0.0], [0.3]], np.zeros((2, 1))])
    c2, d21 = np.array([[[1.0, 0]], [[0, 0]]]), np.array([[[0.0, 0.1]], [[0, 0]]])
    box = lpv.Scheduling(("k",), (1.0,), (4.0,), (rate,))
    return plant(a, b1, b2, c1, np.zeros((2, 2, 2)), d12, c2, d21, lpv.Polynomial("k", 1), box, sample_time)
