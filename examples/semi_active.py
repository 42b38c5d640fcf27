"""Which model follows a semi-active damper at each duty, and which 1 ms step is stable? Seed 002, virtual device."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import lpvid as lpv
from lpvid.plot import show
from lpvid.plot.style import label, look, panels
from quartercar.dampers import ExtendedBoucWen, ForceMap, identify_stepwise
from quartercar.dampers.bench.semi_active_study import fixed_steps, measured, paper_plan, virtual_device

NODES = (0.1, 0.2, 0.3, 0.4, 0.5)
KNOTS = (-0.12, -0.08, -0.04, -0.015, -0.004, 0.0, 0.004, 0.015, 0.04, 0.08, 0.12)    # m/s


def draw(esr: dict[str, list[float]], run: lpv.Record, path: Path | None) -> None:
    """Held-out errors over the duty, and the force that two fixed steps give."""
    with look():
        figure, (axes,) = panels(1, 2, height=2.8)
        for title, errors in esr.items():
            axes[0].semilogy(NODES, errors, "o-", label=title)
        axes[0].set(xlabel=label("duty u", "1"), ylabel="held-out free-run ESR")
        shown = slice(0, 400)
        for name, style in (("reference", "k-"), ("stepped", "--"), ("runge-kutta", ":")):
            axes[1].plot(run.times[shown], run[name][shown], style, label=name)
        limit = 1.5 * np.abs(run["reference"]).max()
        axes[1].set(xlabel=label("time", "s"), ylabel=label("force, 1 ms steps", "N"), ylim=(-limit, limit))
        for ax in axes:
            ax.legend()
        show(figure, path)


def main(figure: Path | None = None) -> tuple[dict[str, list[float]], float, float]:
    """Held-out free-run ESR of both models at each duty; step errors as ESR at 1 ms."""
    rng, device = np.random.default_rng(0), virtual_device()
    training = paper_plan(device, NODES, rng)
    held_out = [measured(device, f"held-out {u:.0%}", u, "sine", 0.015, 0.11, 3.0, rng) for u in NODES]
    esr = {}
    for model in (ForceMap(nodes=NODES, knots=KNOTS, current_unit="1"), ExtendedBoucWen(nodes=NODES, current_unit="1")):
        print(found := identify_stepwise(model, training))
        esr[model.name] = [lpv.validate(found.damper, [r]).overall.free_run.esr for r in held_out]
    print("held-out ESR at u ", *(f"{u:8.0%}" for u in NODES))
    for name, errors in esr.items():
        print(f"{name:18s}", *(f"{e:8.4f}" for e in errors))
    assert isinstance(found.damper, ExtendedBoucWen)
    run, ours, explicit = fixed_steps(found.damper, held_out[-1])
    print(f"1 ms steps at u = 50 %: ESR {ours:.1e}, Runge-Kutta {explicit:.1e}; fastest rate "
          f"{found.damper.fastest_rate(0.11, 0.5):.0f} 1/s, Runge-Kutta's limit {2785:d} 1/s")
    draw(esr, run, figure)
    return esr, ours, explicit


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
