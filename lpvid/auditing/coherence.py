"""Inputs that move together: what a model of several inputs can determine of each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.auditing.findings import Finding
from lpvid.auditing.view import View
from lpvid.units import quotient

INFLATION = 10.0
"""variance inflation 1/(1 − γ²) from which inputs count as not separable: the usual rule for collinear regressors
(Marquardt 1970, Technometrics 12, 605): standard errors are then over three times those of independent inputs."""
AVERAGES = 16
"""averaged segments per input: the mean coherence of independent inputs is then below 1/16."""
SHORTEST = 16
"""samples of a segment, at least: two inputs are compared from 264 samples on. Of 25 pairs of 300 samples of which one
was the other through a first-order filter all were found; of 150 independent ones of six kinds none, and four of 25
with two steps in all, at the same instants."""
LONGEST = 4096
"""samples of a segment, at most."""


@dataclass(frozen=True, eq=False)
class InputCoherence:
    """How much of each input moves on its own.

    Attributes
    ----------
    names : tuple of str
    frequency : (n_f,) array
        [Hz].
    coherence : (m, n_f) array
        Multiple coherence of each input with all others, γ_i² = 1 − 1/(S_ii [S⁻¹]_ii) for the spectral matrix S of the
        inputs (Bendat & Piersol 2010, 7.3).
    share : (m,) array
        Share of each input's power that the others do not explain, Σ S_ii (1 − γ_i²)/Σ S_ii.
    floor : (m,) array
        Share of each input's power that white noise of its own may have: that of the median over the
        frequencies of the power that the others do not explain. What is white there may be its sensor; what an input
        does by itself in less than half of the band is not counted.
    ratio : complex
        Last input over the first, at the frequency where the first is strongest.
    strongest : float
        That frequency [Hz].
    """

    names: tuple[str, ...]
    frequency: np.ndarray
    coherence: np.ndarray
    share: np.ndarray
    floor: np.ndarray
    ratio: complex
    strongest: float

    @property
    def inflation(self) -> np.ndarray:
        """(m,) factor on the variance of what is estimated of each input, against independent ones."""
        return 1.0 / np.maximum(self.share, np.finfo(float).eps)

    @property
    def separable(self) -> bool:
        """Whether every input moves enough on its own."""
        return bool(self.inflation.max() < INFLATION)


def input_coherence(views: Sequence[View], names: Sequence[str]) -> InputCoherence | None:
    """Coherence of several inputs over all records together; None where there is too little to average.

    Parameters
    ----------
    views : sequence of View
        Records of one rate; those without these channels, or of another rate, are left out.
    names : sequence of str
        Two inputs or more, by channel or role.

    Returns
    -------
    InputCoherence or None
    """
    from scipy.signal import get_window

    runs = []
    for v in views:
        if v.period is not None and all(v.record.has(n) for n in names):
            found = v.run(*(v.record.resolve(n) for n in names))
            if found is not None and abs(v.period / (runs[0][1] if runs else v.period) - 1) < 0.01:
                runs.append((np.vstack(found), v.period))
    total = sum(u.shape[1] for u, _ in runs)
    size = min(LONGEST, 2 * total // (AVERAGES * len(names) + 1))
    if size < SHORTEST:
        return None
    window, spectra = get_window("hann", size), np.zeros((size // 2 + 1, len(names), len(names)), dtype=complex)
    for u, _ in runs:
        for first in range(0, u.shape[1] - size + 1, size // 2):
            piece = u[:, first:first + size]
            f = np.fft.rfft((piece - piece.mean(axis=1, keepdims=True)) * window, axis=1)
            spectra += np.einsum("if,jf->fij", f, f.conj())
    spectra = spectra[1:]
    power = np.einsum("fii->fi", spectra).real
    if not (power.sum(axis=0) > 0).all():
        return None
    scale = 1.0 / np.sqrt(np.maximum(power, np.finfo(float).tiny))
    normal = spectra * scale[:, :, None] * scale[:, None, :]
    ridge = np.finfo(float).eps * len(names) * np.eye(len(names))
    inverse = np.linalg.inv(normal + ridge)
    own = np.clip(1.0 / np.maximum(np.einsum("fii->fi", inverse).real, 1.0), 0.0, 1.0)
    top = int(np.argmax(power[:, 0]))
    frequency = np.arange(1, size // 2 + 1) / (size * runs[0][1])
    alone, total_power = power * own, power.sum(axis=0)
    floor = len(alone) * np.median(alone, axis=0) / total_power
    return InputCoherence(tuple(names), frequency, (1.0 - own).T, alone.sum(axis=0) / total_power, floor,
                          complex(spectra[top, -1, 0] / power[top, 0]), float(frequency[top]))


def one_per_motion(views: Sequence[View], names: Sequence[str]) -> tuple[str, ...]:
    """The inputs without those that are the time derivative of another one.

    A displacement and its velocity are coherent in every record that can be made: no excitation breaks what kinematics
    joins, so that nothing is lost by it either. A channel counts as the derivative of another where
    Σ|V(f) − j2πf X(f)|² is at most 1/`INFLATION` of Σ|V(f)|², below half of the highest frequency.

    Parameters
    ----------
    views : sequence of View
    names : sequence of str

    Returns
    -------
    tuple of str
    """
    kept = list(names)
    for slow in names:
        for fast in names:
            if fast != slow and slow in kept and fast in kept and _is_derivative(views, slow, fast):
                kept.remove(fast)
    return tuple(kept)


def _is_derivative(views: Sequence[View], slow: str, fast: str) -> bool:
    wrong, power = 0.0, 0.0
    for v in views:
        found = None if v.period is None or not all(v.record.has(n) for n in (slow, fast)) else \
            v.run(v.record.resolve(slow), v.record.resolve(fast))
        if found is None or found[0].size < 32 or v.period is None:
            continue
        window = np.hanning(found[0].size)
        x, u = (np.fft.rfft((c - c.mean()) * window) for c in found)
        frequency = np.fft.rfftfreq(found[0].size, v.period)
        low = slice(4, max(5, frequency.size // 2))  # below it the window's own slope counts
        wrong += float(np.sum(np.abs(u[low] - 2j * np.pi * frequency[low] * x[low]) ** 2))
        power += float(np.sum(np.abs(u[low]) ** 2))
    return power > 0 and wrong < power / INFLATION


def coherent_inputs(views: Sequence[View], names: Sequence[str]) -> Iterator[Finding]:
    """Inputs of a model that move together in all records, so that their shares in the output cannot be separated.

    Parameters
    ----------
    views : sequence of View
        The data set.
    names : sequence of str
        Inputs of the model, by channel or role.

    Yields
    ------
    Finding
        ``coherent-inputs``, a warning; its value is the inflation of the variance.
    """
    motions = one_per_motion(views, names)
    apart = input_coherence(views, motions) if len(motions) > 1 else None
    found = None if apart is None or apart.separable else input_coherence(views, names)
    if found is None or found.separable:
        return
    worst = int(np.argmin(found.share))
    units = [views[0].record.unit(n) if views[0].record.has(n) else "" for n in (names[-1], names[0])]
    unit = "" if units[0] == units[1] else f" {quotient(*units)}"
    others = ", ".join(n for k, n in enumerate(names) if k != worst)
    yield Finding(
        "coherent-inputs", views[0].name if len(views) == 1 else "", names[worst], "warning",
        f"{100 * (1 - found.share[worst]):.4g} % of its power is explained by {others} in these records together: a "
        f"model of these inputs cannot separate their shares (variance inflated {found.inflation[worst]:.3g} times); "
        f"determined is the sum of their responses with {names[-1]} = H {names[0]}, "
        f"|H| = {abs(found.ratio):.3g}{unit}, phase {np.degrees(np.angle(found.ratio)):z.0f} deg at "
        f"{found.strongest:.3g} Hz",
        f"add a record in which {names[worst]} moves by itself, or identify one input at a time; figures on equally "
        "coherent data give no information on independent inputs", float(found.inflation[worst]))
