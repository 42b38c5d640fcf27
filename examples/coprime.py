"""Scheduling moves fast: identify a canonical state-space model through a transfer function, or directly?"""

from __future__ import annotations

import sys

import numpy as np

import lpvid as lpv
from lpvid.identification.coprime import RightCoprime
from lpvid.plot import show
from lpvid.plot.style import look, panels

BASIS = lpv.Polynomial("p", degree=1)


def record(seed: int, period: int, noise: float) -> lpv.Record:
    """A second-order system in controllable canonical form; p takes a new random value every `period` samples."""
    rng = np.random.default_rng(seed)
    n = 3000
    u, p = rng.normal(size=n), np.repeat(rng.uniform(-1, 1, n), period)[:n]
    w, y = np.zeros(n), np.zeros(n)
    for k in range(2, n):
        w[k] = u[k - 1] - (-1.0 + 0.4 * p[k - 1]) * w[k - 1] - (0.5 - 0.3 * p[k - 1]) * w[k - 2]
        y[k] = (1 + 0.5 * p[k]) * w[k] + (0.3 - 0.4 * p[k]) * w[k - 1]
    return lpv.Record({"u": u, "p": p, "y": y + noise * rng.normal(size=n)}, sample_time=0.01)


def main(figure: str | None = None) -> dict[tuple[str, int], float]:
    """Free-run fit in percent on fresh data without noise, by route and by samples between the steps of p."""
    fits: dict[tuple[str, int], float] = {}
    print("samples between steps of p      ARX, then controllable      RightCoprime")
    periods = (1, 10, 100, 1000)
    for period in periods:
        training, fresh = record(0, period, noise=0.1), record(1, period, noise=0.0)
        arx = lpv.identify(training, lpv.ARX(2, 2, 1, "u", "y", BASIS))
        models = {"routed": lpv.realize(arx.model, "controllable").model,
                  "direct": lpv.identify(training, RightCoprime(2, 2, "u", "y", BASIS)).model}
        for route, model in models.items():
            fit = lpv.validate(model, [fresh]).overall.free_run.fit_percent
            assert fit is not None
            fits[route, period] = fit
        print(f"{period:26d}{fits['routed', period]:24.2f} %{fits['direct', period]:16.2f} %")
    with look():
        canvas, ((axes,),) = panels(1, 1, height=3.2)
        for route, title in (("routed", "ARX, then its controllable form"), ("direct", "RightCoprime")):
            axes.semilogx(periods, [fits[route, period] for period in periods], "o-", label=title)
        axes.set(xlabel="samples between steps of the scheduling", ylabel="free-run fit, held-out [%]")
        axes.legend(title="simulated data")
        show(canvas, figure)
    return fits


if __name__ == "__main__":
    main(*sys.argv[1:])
