"""What does each state-space form cost when the current moves fast, and when it moves slowly?"""

from __future__ import annotations

import sys

import numpy as np

import lpvid as lpv
from lpvid.plot import show
from lpvid.plot.style import look, panels

MODEL = lpv.LPVTransferFunction.siso(
    a=[[-1.9, 0.10, 0.02], [1.5, -0.12, 0.0], [-0.6, 0.05, 0.02], [0.11, 0.0, 0.0]],
    b=[[0, 0, 0], [0.4, 0.2, 0.0], [0.1, -0.3, 0.1], [0.05, 0.1, 0.0], [0.02, 0.01, 0.0]],
    basis=lpv.Polynomial("p", degree=2), sample_time=1 / 512,
    scheduling=lpv.Scheduling(("p",), (-0.9,), (0.9,)))
FORMS = ("controllable", "observable", "shifted", "augmented")


def main(figure: str | None = None) -> dict[tuple[str, str], float]:
    """Fit in percent of each form's output against the transfer function's, by period of p."""
    rng = np.random.default_rng(0)
    n, fits = 4000, {}
    trajectories = {f"period {k}": 0.9 * np.sin(2 * np.pi * np.arange(n) / k) for k in (2000, 200, 20)}
    trajectories["white"] = rng.uniform(-0.9, 0.9, n)
    print("fit to the transfer function in %".ljust(36) + "".join(f"{form:>14}" for form in FORMS))
    for name, p in trajectories.items():
        record = lpv.Record({"u1": rng.normal(size=n), "p": p}, sample_time=1 / 512, name=name)
        for form in FORMS:
            fits[name, form] = lpv.realize(MODEL, form=form).gap([record]).fit_percent[0]
        print(name.ljust(36) + "".join(f"{fits[name, form]:14.2f}" for form in FORMS))
    with look():
        canvas, ((axes,),) = panels(1, 1, height=3.0)
        for k, form in enumerate(FORMS):
            shares = [100 - fits[name, form] for name in trajectories]
            axes.bar(np.arange(len(shares)) + 0.2 * k, np.maximum(shares, 1e-13), 0.18, label=form)
        axes.set_xticks(np.arange(len(trajectories)) + 0.3, list(trajectories))
        axes.set(yscale="log", xlabel="scheduling (period in samples)", ylabel="misfit to the transfer function [%]")
        axes.legend(title="simulated, no noise", ncols=2)
        show(canvas, figure)
    return fits


if __name__ == "__main__":
    main(*sys.argv[1:])
