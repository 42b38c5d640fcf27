"""Can a model of a real MR damper be accurate in free run and bounded for every input? Usage: fixed_voltage.py data.csv

The scheduling variable is the trial force: the model's own last force plus fitted weights on the newest velocities. Hat
functions of it, clamped at both ends, mix linear functions of the last velocities. A mixture never leaves the range of
what it mixes, so the bound printed at the end holds for every velocity of that amplitude.
"""

from __future__ import annotations

import sys

import numpy as np

import lpvid as lpv
from lpvid import plot
from lpvid.condition import folds, split_tail
from lpvid.identification.quasi_lpv import QuasiLPV


def structure(lags: int, trial: int, iterations: int = 80) -> QuasiLPV:
    """Nearly odd: its asymmetry must be bought from the data at the price of 900 samples."""
    return QuasiLPV(nb=lags, basis=lpv.Spline("force", segments=10, order=1), on="trial", trial=trial, oddness=900.0,
                    max_iterations=iterations)


def cross_validated(record: lpv.Record, lags: int, trial: int) -> float:
    """Free-run ESR over three blocks of the training data, each predicted by a model of the others."""
    error = power = 0.0
    for training, held_out in folds(record, 3):
        model = lpv.identify(training, structure(lags, trial, 30)).model
        for block in held_out:
            run, force = lpv.simulate(model, block), block["force"]
            error += float(np.sum((force[run.start:] - run.output[run.start:, 0]) ** 2))
            power += float(np.sum((force[run.start:] - force[run.start:].mean()) ** 2))
    return error / power


def main(path: str, figure: str | None = None) -> float:
    """Choose on the first two thirds, return the free-run fit in percent on the last third."""
    training, held_out = split_tail(lpv.read(path)[0].flip("force"))  # these data count force against the motion
    tried = {(lags, trial): cross_validated(training, lags, trial) for lags in (4, 10) for trial in (1, 3)}
    for (lags, trial), esr in tried.items():
        print(f"{lags:2d} velocity lags, {trial} in the trial force: cross-validated fit {100 * (1 - esr**0.5):.1f} %")
    found = lpv.identify(training, structure(*min(tried, key=lambda c: tried[c])), held_out=held_out)
    print(found)
    print(f"for |velocity| <= 0.15 m/s the force stays within {found.model.output_bound(0.15):.0f} N")
    plot.show(plot.free_run(plot.compare(found.model, held_out, "held-out")), figure)
    assert found.held_out is not None and found.held_out.overall.free_run.fit_percent is not None
    return found.held_out.overall.free_run.fit_percent


if __name__ == "__main__":
    main(*sys.argv[1:])
