"""Is a hydraulic damper a series or a parallel network of losses, or both at once? Seed 003, by 23 triangle runs."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from lpvid import Channel, Record
from lpvid.excitation import triangle
from lpvid.plot import show
from quartercar.dampers import NetworkChoice, choose_network, static_points
from quartercar.dampers.laws.hydraulics import mixed_flow

SPEEDS = np.geomspace(1e-5, 2e-3, 23)  # below 2 mm/s
TRUTHS = {"series": (5e4, 2e8, 0.0), "mixed": (2e5, 2e10, 5e-7)}  # c_L [N s/m], c_Q [N s²/m²], 1/c_leak [m/(N s)]
FRICTION, STIFFNESS, RATE, SAMPLES = 10.0, 4e6, 100.0, 2001  # [N], of the oil column [N/m], [Hz], two cycles


def run(speed: float, network: tuple[float, float, float], rng: np.random.Generator) -> Record:
    """Rounded triangle, compressible oil Ḟ/k + v_network(F) = v in exponential Euler steps, friction, 1 % noise."""
    x = triangle(SAMPLES, RATE, amplitude=2.5 * speed, frequency=0.1, acceleration=4 * speed)
    v, force, (low, high, leak) = np.gradient(x, 1 / RATE), np.zeros(SAMPLES), network
    for k, f in enumerate(force[:-1]):
        slope = 1.0 / np.sqrt(low**2 + 4 * high * abs(f)) + leak
        force[k + 1] = f - (v[k + 1] - mixed_flow(f, *network)) / slope * np.expm1(-STIFFNESS * slope / RATE)
    force += FRICTION * np.tanh(v / (0.02 * speed)) + 0.01 * force.std() * rng.standard_normal(SAMPLES)
    return Record({"displacement": Channel(x, "m"), "force": Channel(force, "N")}, sample_time=1 / RATE)


def draw(choices: dict[str, NetworkChoice], path: Path | None) -> None:
    """Force beyond friction and its log-log slope, measured and fitted."""
    figure = Figure(figsize=(9, 6), layout="constrained")
    for (truth, c), (top, bottom) in zip(choices.items(), figure.subplots(2, 2, sharex=True).T, strict=True):
        v, f_c = np.geomspace(c.points.speed.min(), c.points.speed.max(), 200), c.best.theta[3]
        top.loglog(1e3 * c.points.speed, c.points.force - f_c, "k.", label="triangle runs (virtual)")
        bottom.errorbar(1e3 * c.slopes.speed, c.slopes.slope, c.slopes.std, fmt="k.")
        for name, style in (("series", "-"), ("parallel", "--"), ("mixed", ":")):
            net = np.maximum(c.fits[name].force(v) - f_c, 1e-3)
            top.loglog(1e3 * v, net, style, label=name)
            bottom.semilogx(1e3 * v, np.gradient(np.log(net), np.log(v)), style)
        top.legend(title=f"F − F_c [N], truth {truth}, chosen {c.verdict}")
        bottom.set(xlabel="speed [mm/s]", ylabel="d ln(F − F_c)/d ln v", ylim=(0.5, 2.5))
    show(figure, path)


def main(path: Path | None = None) -> dict[str, NetworkChoice]:
    """Print and draw the choice for a series and for a mixed damper."""
    rng = np.random.default_rng(3)
    choices = {n: choose_network(static_points([run(v, truth, rng) for v in SPEEDS])) for n, truth in TRUTHS.items()}
    print(*(f"Truth {truth}. {choice}" for truth, choice in choices.items()), sep="\n\n")
    draw(choices, path)
    return choices


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
