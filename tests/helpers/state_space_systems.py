"""Random LPV state-space systems and their records, simulated by plain loops."""

from __future__ import annotations

import numpy as np

import lpvid as lpv


class StateSpaceSystem:
    """x⁺ = A(p) x + B(p) u + K e, y = C(p) x + e, affine in p ∈ [−1, 1]ᴹ⁻¹; `radius` of the poles at p = 0."""

    def __init__(self, rng: np.random.Generator, order: int, inputs: int, outputs: int, letters: int,
                 radius: float = 0.85) -> None:
        shrink = np.array([1.0] + [0.3] * (letters - 1))[:, None, None]
        a = rng.normal(size=(letters, order, order))
        a[0] *= radius / np.abs(np.linalg.eigvals(a[0])).max()
        for m in range(1, letters):
            a[m] *= 0.3 / np.linalg.norm(a[m], 2) / (letters - 1)
        self.a, self.b = a, shrink * rng.normal(size=(letters, order, inputs))
        self.c = shrink * rng.normal(size=(letters, outputs, order))
        self.k = np.zeros((order, outputs))

    @property
    def names(self) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
        """Inputs, outputs, scheduling."""
        sizes = (self.b.shape[2], self.c.shape[1], len(self.a) - 1)
        u, y, p = (tuple(f"{letter}{i + 1}" for i in range(size)) for letter, size in zip("uyp", sizes, strict=True))
        return u, y, p

    @property
    def settings(self) -> dict:
        """Channels and basis for a structure."""
        u, y, p = self.names
        return {"input": u, "output": y, "basis": lpv.Polynomial(p, degree=1)}

    def record(self, rng: np.random.Generator, n: int, snr: float | None, *, hold: int = 5, innovation: bool = False,
               x0: np.ndarray | None = None) -> lpv.Record:
        """White inputs, scheduling held for `hold` samples; noise at `snr` dB on the output, or through K as well."""
        u = rng.normal(size=(n, self.b.shape[2]))
        p = np.repeat(rng.uniform(-1, 1, (n // hold + 1, len(self.a) - 1)), hold, axis=0)[:n]
        clean, _ = self.run(u, p, np.zeros((n, self.c.shape[1])), x0)
        e = np.zeros_like(clean)
        if snr is not None:
            e = 10 ** (-snr / 20) * clean.std(axis=0) * rng.normal(size=clean.shape)
        y = self.run(u, p, e, x0)[0] if innovation else clean + e
        names = self.names
        channels = {}
        for listed, values in zip(names, (u, y, p), strict=True):
            channels |= {name: values[:, i] for i, name in enumerate(listed)}
        channels |= {f"{name} clean": clean[:, i] for i, name in enumerate(names[1])}
        return lpv.Record(channels, sample_time=0.01)

    def run(self, u: np.ndarray, p: np.ndarray, e: np.ndarray,
            x0: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Outputs (n, ny) and states (n, order)."""
        x = np.zeros(self.a.shape[1]) if x0 is None else x0
        y, states = np.zeros_like(e), np.zeros((len(u), x.size))
        for k in range(len(u)):
            phi = np.concatenate([[1.0], p[k]])
            states[k] = x
            y[k] = np.tensordot(phi, self.c, 1) @ x + e[k]
            x = np.tensordot(phi, self.a, 1) @ x + np.tensordot(phi, self.b, 1) @ u[k] + self.k @ e[k]
        return y, states

    def best_fit(self, record: lpv.Record) -> float:
        """Free-run fit in percent of the system itself: what its noise leaves."""
        y = record.matrix(self.names[1])
        clean = record.matrix([f"{name} clean" for name in self.names[1]])
        esr = np.sum((y - clean) ** 2, axis=0) / np.sum((y - y.mean(axis=0)) ** 2, axis=0)
        return 100 * (1 - float(np.sqrt(np.mean(esr))))
