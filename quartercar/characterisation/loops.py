"""Loops: energy per cycle, loss angle, dynamic and elastic stiffness of every test."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from quartercar.characterisation.cycles import HARMONICS, Block, RecordedCycle, harmonics_of


@dataclass(frozen=True)
class ForceLoop:
    """One block's force-displacement loop, means over its settled cycles with their standard errors.

    Attributes
    ----------
    specimen : str
    current : float or None
    record, test : str
    kind : str
    frequency, amplitude, peak : float
        [Hz], [m], [m/s].
    energy, energy_std : float
        ∮F dx [J].
    velocity_area : float or None
        |∮F dv| [W], the area of the force-velocity loop; 0 for a damper without memory. Not of triangles.
    dynamic_stiffness, elastic_stiffness, stiffness_std : float or None
        |K*| and K' = Re K* [N/m], K* = F_1/x_1 of the fundamentals. Not of triangles.
    loss_angle, loss_angle_std : float or None
        δ = arg K* [rad]: π/2 for a pure damper, 0 for a spring. Not of triangles.
    damping : float or None
        Equivalent viscous damping Im K*/ω [N·s/m]. Not of triangles.
    cycles : int
    """

    specimen: str
    current: float | None
    record: str
    test: str
    kind: str
    frequency: float
    amplitude: float
    peak: float
    energy: float
    energy_std: float
    velocity_area: float | None
    dynamic_stiffness: float | None
    elastic_stiffness: float | None
    stiffness_std: float | None
    loss_angle: float | None
    loss_angle_std: float | None
    damping: float | None
    cycles: int


def loop_of(block: Block) -> ForceLoop:
    """Energy and, but of a triangle, complex stiffness.

    With the complex amplitudes of the Fourier series of one cycle, x = Σ Re x_k e^{ikωt} and F alike::

        K* = F_1/x_1 = K' + iK''     δ = arg K*     c = K''/ω
        ∮F dv = π Σ_k k Im(F_k v̄_k),   v_k = ikω x_k
        ∮F dx = π Σ_k k Im(F_k x̄_k)   of a sine

    What drifts from cycle to cycle, a gas that warms, is taken off first, as a line through the cycles' means: a slope
    fitted within one cycle is as good as unknown beside a sine of it, and would be counted as stiffness. The energy of
    what is no sine is ∮F dx by the trapezoidal rule between the two crossings of mid stroke. For a pure sine the
    energy equals π |x_1|² K''.

    Parameters
    ----------
    block : Block
        With a force.

    Returns
    -------
    ForceLoop
        Means over the settled cycles; errors NaN or None from a single one.
    """
    run = block.run
    work = np.concatenate([[0.0], np.cumsum(0.5 * (run.force[1:] + run.force[:-1]) * np.diff(run.displacement))])
    place = np.arange(work.size)
    energies = np.array([np.interp(c.stop, place, work) - np.interp(c.start, place, work) for c in block.settled])
    n = len(energies)
    area = stiffness = elastic = spread = angle = angle_std = damping = None
    if block.kind != "triangle":
        drifts = _drift(block, [run.force[c.span] for c in block.settled]), _drift(
            block, [c.displacement for c in block.settled])
        parts = [_stiffness(c, run.force[c.span], run.period, drifts) for c in block.settled]
        mean = sum(k for k, _, _ in parts) / n
        ratios = [k / mean for k, _, _ in parts]
        if block.kind == "sine":
            energies = np.array([work for _, _, work in parts])
        stiffness, elastic, angle = abs(mean), mean.real, float(np.angle(mean))
        damping, area = mean.imag * block.settled[0].period / (2 * np.pi), float(np.mean([a for _, a, _ in parts]))
        if n > 1:
            spread = abs(mean) * float(np.std([r.real for r in ratios], ddof=1) / np.sqrt(n))
            angle_std = float(np.std([r.imag for r in ratios], ddof=1) / np.sqrt(n))
    error = float(energies.std(ddof=1) / np.sqrt(n)) if n > 1 else float("nan")
    return ForceLoop(run.specimen, run.level, run.name, block.label, block.kind, block.frequency, block.amplitude,
                block.peak, float(energies.mean()), error, area, stiffness, elastic, spread, angle, angle_std, damping,
                n)


def _drift(block: Block, values: Sequence[np.ndarray]) -> float:
    """Slope of the cycles' means over time [unit/s]; 0 of a single cycle."""
    if len(values) < 2:
        return 0.0
    middle = [0.5 * (c.start + c.stop) * block.run.period for c in block.settled]
    return float(np.polyfit(middle, [v.mean() for v in values], 1)[0])


def _stiffness(cycle: RecordedCycle, force: np.ndarray, period: float,
               drifts: tuple[float, float]) -> tuple[complex, float, float]:
    """K*, the area of the force-velocity loop and that of the force-displacement loop of one cycle."""
    order = max(1, min(HARMONICS, force.size // 8))
    t = period * np.arange(force.size)
    f = harmonics_of(force - drifts[0] * t, period, cycle.period, order)
    x = harmonics_of(cycle.displacement - drifts[1] * t, period, cycle.period, order)
    k = np.arange(1, order + 1)
    v = 2j * np.pi / cycle.period * k * x
    return (complex(f[0] / x[0]), abs(float(np.pi * np.sum(k * np.imag(f * np.conj(v))))),
            float(np.pi * np.sum(k * np.imag(f * np.conj(x)))))
