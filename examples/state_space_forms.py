"""What does each state-space form cost when the current moves fast, and when it moves slowly?"""

from __future__ import annotations

import numpy as np

import lpvid as lpv

MODEL = lpv.LPVTransferFunction.siso(
    a=[[-1.9, 0.10, 0.02], [1.5, -0.12, 0.0], [-0.6, 0.05, 0.02], [0.11, 0.0, 0.0]],
    b=[[0, 0, 0], [0.4, 0.2, 0.0], [0.1, -0.3, 0.1], [0.05, 0.1, 0.0], [0.02, 0.01, 0.0]],
    basis=lpv.Polynomial("p", degree=2), sample_time=1 / 512,
    scheduling=lpv.Scheduling(("p",), (-0.9,), (0.9,)))
FORMS = ("controllable", "observable", "shifted", "augmented")


def main() -> dict[tuple[str, str], float]:
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
    return fits


if __name__ == "__main__":
    main()
