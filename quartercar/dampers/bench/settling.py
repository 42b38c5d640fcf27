"""How a force settles on a plateau: straight line, spikes, and the part that is still building up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

CLIP = 5.0
"""robust standard deviations beyond which a sample of the force counts as a spike."""
BLOCKS, LAGS = 120, 16
"""block means and trial time constants by which a lag of the force is looked for."""
FOUND = 12.0
"""F ratio (2 parameters) above which a lag counts as found."""
DOUBT = 0.3
"""error of a remainder that was found and taken off, as a share of it: networks do not settle exponentially."""
SHORT = 0.25
"""longest time constant, in lengths of the plateau, that noise may stand for where no lag was found."""


@dataclass(frozen=True)
class Settling:
    """A exp(−t/τ) beside a straight line.

    Attributes
    ----------
    amount : float
        A, at the first sample [N].
    tau : float
        τ [samples].
    found : bool
        Whether it stands out of the noise.
    """

    amount: float
    tau: float
    found: bool

    def left(self, first: int, last: int) -> float:
        """Mean over samples first … last − 1 of the part that is still to settle [N].

        Parameters
        ----------
        first, last : int
            Samples from the one at which `amount` stands.

        Returns
        -------
        float
            With the sign of `amount` [N].
        """
        return self.amount * float(np.mean(np.exp(-np.arange(first, last) / self.tau)))

    def settled(self, level: float, std: float, left: float) -> tuple[float, float]:
        """Level and standard error without the remainder: taken off where it was found, else doubt.

        Parameters
        ----------
        level : float
            Force as the straight line has it [N].
        std : float
            Its standard error [N].
        left : float
            Remainder, as `left` returns it [N].

        Returns
        -------
        level : float
            [N].
        std : float
            Larger than before, by `DOUBT` of the remainder where that was found, else by all of it [N].
        """
        if self.found:
            return level - left, float(np.hypot(std, DOUBT * left))
        return level, float(np.hypot(std, left))


def straight_line(force: np.ndarray) -> tuple[float, float, float, float]:
    """Straight line through a window: value and standard error at its middle, step per sample, share of spikes.

    Parameters
    ----------
    force : (n,) array
        Samples of the window [N].

    Returns
    -------
    level : float
        At the middle [N].
    std : float
        For correlated noise, by `effective_samples` [N].
    step : float
        [N per sample].
    spikes : float
        Share of the samples that were left out as beyond `CLIP` robust standard deviations.
    """
    k = np.arange(force.size) - 0.5 * (force.size - 1)
    keep = np.ones(force.size, dtype=bool)
    residual, line = force, np.zeros(2)
    for _ in range(4):
        line = np.polyfit(k[keep], force[keep], 1)
        residual = force - np.polyval(line, k)
        spread = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
        inliers = np.abs(residual) <= max(CLIP * spread, 1e-9 * float(np.abs(force).max()))
        if inliers.sum() < 4 or np.array_equal(inliers, keep):
            break
        keep = inliers
    std = float(residual[keep].std(ddof=2)) / np.sqrt(effective_samples(residual[keep]))
    return float(line[1]), float(std), float(line[0]), float(1.0 - keep.mean())


def effective_samples(residual: np.ndarray) -> float:
    """Independent samples that an autocorrelated residual is worth, n(1−ρ)/(1+ρ).

    Parameters
    ----------
    residual : (n,) array
        About zero.

    Returns
    -------
    float
        At least 3; ρ is the correlation of neighbours, 0 where it is negative.
    """
    power = float(residual @ residual)
    rho = float(residual[1:] @ residual[:-1]) / power if power > 0 else 0.0
    rho = min(max(rho, 0.0), 0.999)
    return max(residual.size * (1 - rho) / (1 + rho), 3.0)


def settling(force: np.ndarray) -> Settling:
    """Least squares of a + b t + A exp(−t/τ) on block means, over trial τ up to the length of the plateau.

    Parameters
    ----------
    force : (n,) array
        Samples of a plateau [N].

    Returns
    -------
    Settling
        Where none stands out of the noise, that of the best trial τ up to `SHORT` of the plateau; amount 0 where the
        means lie on a straight line.
    """
    width = max(1, force.size // BLOCKS)
    means = force[:force.size // width * width].reshape(-1, width).mean(axis=1)
    t = np.arange(means.size, dtype=float)
    straight = np.column_stack([np.ones(t.size), t / t.size])
    rest = means - straight @ np.linalg.lstsq(straight, means, rcond=None)[0]
    line_only, floor = float(rest @ rest), max((1e-9 * float(np.abs(means).max())) ** 2 * t.size, 1e-300)
    if line_only <= floor:
        return Settling(0.0, 1.0, False)
    trials = []
    for tau in np.geomspace(t.size / 40.0, 1.0 * t.size, LAGS):
        design = np.column_stack([straight, np.exp(-t / tau)])
        solution = np.linalg.lstsq(design, means, rcond=None)[0]
        error = means - design @ solution
        trials.append((float(error @ error), float(solution[2]), float(tau)))
    best, amount, tau = min(trials)
    found = 0.5 * (line_only - best) > FOUND * max(best, floor) / max(t.size - 4, 1)
    if not found:
        _, amount, tau = min(row for row in trials if row[2] <= SHORT * t.size)
    return Settling(amount, tau * width, found)
