"""CommonError: what a law leaves alike in all files of a fleet, as a regression on its inputs and their past.

e = F(u) (w + H z) + noise: F are fixed functions of the inputs, w what all healthy files share, H z what a specimen may
differ from that in. Least squares adds up from file to file, so that no two files are held at a time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lpvid import _checks
from lpvid.codec import Coded
from lpvid.diagnosis.signals import Signals

UNITS = 600
"""random functions. Of the power of the force an LPV-ARX left 15.5 % in healthy files of the rig, 0.61 % beside 300 of
these, 0.35 % beside 600, in files not fitted to (fleet_study)"""
STEEPNESS = (1.0, 2.0, 4.0, 8.0)
"""widths of the random directions in the inputs, per standard deviation"""
LAGS = (1.0, 2.0, 4.0, 8.0, 16.0)
"""time constants of the past of the channels, in samples: a band of four octaves below the clock"""
AFTER = (0.0, 2.0, 4.0, 8.0)
"""time constants behind the functions, in samples"""
RIDGES = (1e-8, 1e-6, 1e-4, 1e-2)
"""penalties tried; the one by which one half of the files predicts the other best counts"""
PER_MODE = 4
"""files for each direction in which specimens may differ, at least"""
BLOCK = 32
"""functions computed at a time: a long record holds no more of them"""


@dataclass(frozen=True)
class ErrorFeatures(Coded):
    """Fixed functions of the inputs, of what schedules the law and of its own run, and of their past.

    s(a x_1 + b x_2 + c p + d y + e), s(x) = x/√(1 + x²), with random gains: x₁, x₂ the values of an input at one of
    several lags, p a scheduling variable, y another input or the law's output; half of them times a scheduling
    variable, most of them behind a lag (Rahimi, Recht 2007, random features; Wiener and Hammerstein structures). With
    them all values themselves, and one. Every channel is standardised by its mean and standard deviation in the fleet.

    Attributes
    ----------
    inputs, schedule : tuple of str
        Roles.
    centre, spread : tuple of float
        Of the inputs, the scheduling variables and the law's output, in this order, in their units.
    """

    inputs: tuple[str, ...]
    schedule: tuple[str, ...]
    centre: tuple[float, ...]
    spread: tuple[float, ...]

    @property
    def size(self) -> int:
        """p, number of functions."""
        return self._versions + UNITS + 1

    @property
    def _versions(self) -> int:
        return (len(LAGS) + 1) * (len(self.inputs) + len(self.schedule) + 1)

    @cached_property
    def _drawn(self) -> tuple[np.ndarray, ...]:
        """What each function reads: picks, gains, shifts, factors, decays."""
        rng = np.random.default_rng(0)
        each, inputs, schedule = len(LAGS) + 1, len(self.inputs), len(self.schedule)
        picks, gains = np.zeros((UNITS, 4), dtype=np.int64), rng.standard_normal((UNITS, 4))
        factor = np.full(UNITS, -1, dtype=np.int64)
        for u in range(UNITS):
            steep, own = STEEPNESS[u % len(STEEPNESS)], (u // len(STEEPNESS)) % inputs
            other = (*range(inputs), inputs + schedule)[rng.integers(inputs + 1)]
            groups = (own, own, inputs + int(rng.integers(max(schedule, 1))), other)
            picks[u] = [g * each + rng.integers(each) for g in groups]
            gains[u, :2] *= steep
            gains[u, 2] *= bool(schedule)
            gains[u, 3] *= bool(rng.random() < 0.5)
            if schedule and u < UNITS // 2:
                factor[u] = inputs * each + u % (schedule * each)
        picks = np.minimum(picks, self._versions - 1)
        after = np.array(AFTER)[(np.arange(UNITS) // (2 * len(STEEPNESS))) % len(AFTER)]
        decay = np.where(after > 0, np.exp(-1 / np.where(after > 0, after, 1.0)), 0.0)
        return picks, gains, rng.uniform(-1.5, 1.5, UNITS), factor, decay

    def versions(self, s: Signals, run: np.ndarray) -> np.ndarray:
        """(q, n) standardised channels at all lags."""
        from lpvid.diagnosis._common_error_kernels import lagged

        out, row = np.empty((self._versions, s.n_samples)), 0
        for x, c, w in zip((*(s[n] for n in (*self.inputs, *self.schedule)), run), self.centre, self.spread,
                           strict=True):
            z = (x - c) / w
            out[row] = z
            for k, lag in enumerate(LAGS, row + 1):
                lagged(z, float(np.exp(-1 / lag)), out[k])
            row += len(LAGS) + 1
        return out

    def along(self, s: Signals, run: np.ndarray) -> np.ndarray:
        """(p, n) all functions along signals, along which the law gives `run`."""
        z = self.versions(s, run)
        out = np.empty((self.size, s.n_samples))
        out[: len(z)], out[-1] = z, 1.0
        self._mix(z, slice(0, UNITS), out[len(z): -1])
        return out

    def combined(self, s: Signals, run: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """(k, n) weighted sums of the functions, weights (k, p), a few functions at a time."""
        z = self.versions(s, run)
        out = weights[:, : len(z)] @ z + weights[:, -1:]
        part = np.empty((BLOCK, s.n_samples))
        for first in range(0, UNITS, BLOCK):
            last = min(first + BLOCK, UNITS)
            self._mix(z, slice(first, last), part[: last - first])
            out += weights[:, len(z) + first: len(z) + last] @ part[: last - first]
        return out

    def _mix(self, z: np.ndarray, units: slice, out: np.ndarray) -> None:
        from lpvid.diagnosis._common_error_kernels import mixed

        mixed(z, *(drawn[units] for drawn in self._drawn), out)


@dataclass(frozen=True, eq=False)
class ErrorMoments:
    """Normal equations of one file: F F', F e, e'e and samples.

    Attributes
    ----------
    gram : (p, p) array
    moment : (p,) array
    power : float
    rows : int
    """

    gram: np.ndarray
    moment: np.ndarray
    power: float
    rows: int

    @classmethod
    def of(cls, features: ErrorFeatures, s: Signals, run: np.ndarray, start: int = 0) -> ErrorMoments:
        """Of one record.

        Parameters
        ----------
        features : ErrorFeatures
        s : Signals
        run : (n,) array
            The law's free run along them.
        start : int
            Samples at the head that count for nothing.
        """
        f, e = features.along(s, run)[:, start:], (s.output - run)[start:]
        return cls(f @ f.T, f @ e, float(e @ e), e.size)

    def __add__(self, other: ErrorMoments) -> ErrorMoments:
        return ErrorMoments(self.gram + other.gram, self.moment + other.moment, self.power + other.power,
                            self.rows + other.rows)

    def left(self, weights: np.ndarray) -> float:
        """Squared error that weights leave."""
        return float(self.power - 2 * weights @ self.moment + weights @ self.gram @ weights)

    def solved(self, ridge: float) -> np.ndarray:
        """(p,) weights by ridge regression."""
        return np.linalg.solve(self.gram + ridge * self.rows * np.eye(len(self.moment)), self.moment)


@dataclass(frozen=True, eq=False)
class CommonError:
    """What all files of a fleet share beyond their law, and directions in which its specimens differ.

    Attributes
    ----------
    features : ErrorFeatures
    weights : (p,) array
        w, in the output's unit.
    modes : (K, p) array
        H', each of a size of one standard deviation between the specimens.
    left : float
        Share of the power of the law's error that w leaves in files it was not fitted to.
    """

    features: ErrorFeatures
    weights: np.ndarray
    modes: np.ndarray
    left: float

    def __post_init__(self) -> None:
        size = self.features.size
        weights = _checks.shaped(_checks.frozen_array(self.weights, "weights", ndim=1), (size,), "weights")
        object.__setattr__(self, "weights", _checks.finite(weights, "weights"))
        modes = np.asarray(self.modes, dtype=float).reshape(-1, size)
        object.__setattr__(self, "modes", _checks.finite(_checks.frozen_array(modes, "modes", ndim=2), "modes"))

    @classmethod
    def of(cls, features: ErrorFeatures, files: Sequence[ErrorMoments]) -> CommonError:
        """Of healthy files.

        The modes are principal directions of what each file's own regression would take away beyond w, in coordinates
        in which noise is white: those that stand out of the noise's eigenvalues, (1 + √(m/p))² times their median at
        the most for m files and p functions (Marchenko, Pastur 1967), and one for every four files at most.

        Parameters
        ----------
        features : ErrorFeatures
        files : sequence of ErrorMoments
            At least two.
        """
        halves = [_total(files[k::2]) for k in (0, 1)]
        power = sum(h.power for h in halves)
        left = {r: sum(b.left(a.solved(r)) for a, b in (halves, halves[::-1])) / power for r in RIDGES}
        ridge = min(left, key=lambda r: left[r])
        whole = halves[0] + halves[1]
        weights, count = whole.solved(ridge), len(files)
        from scipy.linalg import solve_triangular

        mean = (whole.gram + ridge * whole.rows * np.eye(features.size)) / count
        root = np.linalg.cholesky(mean)
        own = solve_triangular(root, np.column_stack([f.moment - f.gram @ weights for f in files]), lower=True)
        left_vectors, values, _ = np.linalg.svd(own, full_matrices=False)
        reach = float(np.trace(np.linalg.solve(mean, whole.gram / count)))  # functions that the penalty leaves free
        edge = float(np.median(values**2)) * (1 + np.sqrt(count / reach)) ** 2
        kept = min(int(np.sum(values**2 > edge)), count // PER_MODE)
        scales = values[:kept] / np.sqrt(count)
        modes = solve_triangular(root.T, left_vectors[:, :kept] * scales, lower=False).T
        return cls(features, weights, modes, left[ridge])

    def along(self, s: Signals, run: np.ndarray) -> np.ndarray:
        """(1 + K, n) the common error and a standard deviation of every mode, along signals."""
        return self.features.combined(s, run, np.vstack([self.weights, self.modes]))

    def to_dict(self) -> dict:
        """Plain data for JSON."""
        return {"features": self.features.to_dict(), "weights": self.weights.tolist(), "modes": self.modes.tolist(),
                "left": self.left}

    @classmethod
    def from_dict(cls, data: Mapping) -> CommonError:
        """Inverse of `to_dict`."""
        return cls(ErrorFeatures.from_dict(data["features"]), np.array(data["weights"], dtype=float),
                   np.array(data["modes"], dtype=float), float(data["left"]))


def _total(files: Sequence[ErrorMoments]) -> ErrorMoments:
    out = files[0]
    for f in files[1:]:
        out += f
    return out
