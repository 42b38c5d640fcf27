"""Models that are no damper, and dampers that a car is not given, each with what the refusal states."""

from __future__ import annotations

import numpy as np

import lpvid as lpv
from lpvid.model.signals import Signal
from lpvid.scheduling import Polynomial, Scheduling


def linear(**changes) -> lpv.LPVTransferFunction:
    """F(k) = 0.5 F(k−1) + (400 + 100 i) v."""
    given = {"inputs": (Signal("velocity", "m/s"),), "outputs": (Signal("force", "N"),),
             "scheduling": Scheduling(("current",), (0.0,), (2.0,), units=("A",)), "a": [[-0.5, 0.0]],
             "b": [[400.0, 100.0]], "sample_time": 0.002, "metadata": {}, **changes}
    a, b, period = (given.pop(k) for k in ("a", "b", "sample_time"))
    names = given["scheduling"].names
    return lpv.LPVTransferFunction.siso(a, b, Polynomial(names, 1), period, **given)


def two_outputs() -> lpv.LPVTransferFunction:
    b = np.zeros((1, 2, 1, 1))
    b[0, :, 0, 0] = 400.0, 1.0
    return lpv.LPVTransferFunction(np.zeros((0, 2, 2, 1)), b, Polynomial(), 0.002,
                                   inputs=(Signal("velocity", "m/s"),),
                                   outputs=(Signal("force", "N"), Signal("temperature", "K")))


def two_variables() -> lpv.LPVTransferFunction:
    box = Scheduling(("current", "temperature"), (0.0, 280.0), (2.0, 360.0), units=("A", "K"))
    return linear(scheduling=box, a=[[-0.5, 0.0, 0.0]], b=[[400.0, 100.0, 0.0]])


NO_DAMPERS = {
    "several outputs": (two_outputs, "has 2 outputs"),
    "no force": (lambda: linear(outputs=(Signal("acceleration", "m/s^2"),)), "gives no force"),
    "no motion": (lambda: linear(inputs=(Signal("pressure", "Pa"),)), "reads 'pressure'"),
    "wrong unit": (lambda: linear(inputs=(Signal("velocity", "m"),)), "is in m; m/s expected"),
    "two variables": (two_variables, "scheduled by 2 variables"),
    "scheduled by heat": (lambda: linear(scheduling=Scheduling(("temperature",), (0.0,), (2.0,), units=("K",))),
                          "scheduled by 'temperature'"),
    "continuous": (lambda: lpv.LPVStateSpace([[[-1.0]]], [[[1.0]]], [[[1.0]]], [[[0.0]]], Polynomial(), None),
                   "continuous in time"),
}

CAR_REFUSES = {
    "reversed": (lambda: linear(metadata={"polarity": "reversed"}, b=[[-400.0, -100.0]]), "reversed polarity"),
    "along the motion": (lambda: linear(b=[[-400.0, -100.0]]), "points along the motion"),
    "unstable": (lambda: linear(a=[[-0.5, -0.4]]), r"unstable: got a pole of modulus 1\.3 at current 2 A"),
}
