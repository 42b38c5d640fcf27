"""Models of every kind that can be exported, small and with every part in use."""

from __future__ import annotations

import numpy as np
import pytest

import lpvid as lpv
from lpvid import Fourier, Polynomial, Product, Scheduling, Shifted, Spline, Stacked, TanhStage, ThreeZoneStage
from lpvid.export.c_build import find_compiler
from lpvid.model.compliance import ComplianceModel, Element
from lpvid.model.quasi import QuasiLPVModel
from lpvid.model.scheduling_stage import SchedulingLag
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.synthesis.saturated import saturate

BOX = Scheduling(("current",), (0.0,), (2.5,), units=("A",))
BASES = {"none": Polynomial(), "square": Polynomial("current", 2).bound(BOX),
         "grid": Spline("current", 3, 1).bound(BOX),
         "cubic": Spline("current", 4, 3).bound(BOX), "quintic": Spline("current", 2, 5).bound(BOX),
         "doubled knots": Spline("current", 5, 3, (0.0, 0.8, 0.8, 0.8, 1.7, 2.5)),
         "fourier": Fourier("current", 2, period=3.0, origin=0.2),
         "dynamic": Stacked((Polynomial("current", 1), Shifted(Polynomial("current", 1), 2))),
         "product": Product(Polynomial("current", 1), Spline("current", 2, 2).bound(BOX))}
STAGES = {"plain": None, "tanh": TanhStage(0.1, 0.02), "zones": ThreeZoneStage(0.05, 0.01, 0.2, 0.01, 0.1, 0.03)}
LAGS = {"now": None, "lag": SchedulingLag(0.005, 0.01), "late": SchedulingLag(0.005, 0.0, 0.0035),
        "whole": SchedulingLag(0.0, 0.004, 0.004)}
needs_compiler = pytest.mark.skipif(find_compiler() is None, reason="no C compiler")


def transfer_function(rng, basis="square", stage="plain", lag="now", lagged=False, **more) -> LPVTransferFunction:
    chosen, shape = BASES[basis], STAGES[stage]
    width, m = 2 if stage == "tanh" else 1, chosen.size
    box = BOX if chosen.names else None
    return LPVTransferFunction(0.3 * rng.normal(size=(2, 2, 2, m)) / m, rng.normal(size=(3, 2, width, m)), chosen,
                               0.002, box, rng.normal(size=(2, 2, m)), lagged, inputs=("velocity",), input_stage=shape,
                               scheduling_stage=LAGS[lag] if chosen.names else None, **more)


def state_space(rng, basis="square", **more) -> LPVStateSpace:
    chosen = BASES[basis]
    m = chosen.size
    more = {"state_offset": rng.normal(size=(m, 3)), **more}
    return LPVStateSpace(0.3 * rng.normal(size=(m, 3, 3)) / m, rng.normal(size=(m, 3, 2)), rng.normal(size=(m, 2, 3)),
                         rng.normal(size=(m, 2, 2)), chosen, 0.01, BOX if chosen.names else None,
                         **more)


def quasi(rng, on="trial", polynomial=False) -> QuasiLPVModel:
    own = Polynomial("y", 2, (0.0,), (2.0,)) if polynomial else Spline("y", 3, 1, (-1.0, -0.2, 0.5, 1.0))
    external = Polynomial("current", 1).bound(BOX)
    theta = 0.2 * rng.normal(size=(own.size, 2, 2 + 3 + 2 + 1))
    return QuasiLPVModel(theta, own, 2, (3, 2), (1, 0), 0.002, (Signal("velocity", "m/s"), Signal("displacement", "m")),
                         (Signal("force", "N"),), on, rng.normal(size=2) if on == "trial" else (), external, BOX,
                         LAGS["lag"])


def compliance(elements=2) -> ComplianceModel:
    knots = np.array([-1.0, -0.2, 0.0, 0.3, 1.0])
    laws = [np.array([[-300.0, -120.0, 0.0, 90.0, 350.0], [-900.0, -500.0, 0.0, 400.0, 800.0]]) * (1 + e)
            for e in range(elements)]
    return ComplianceModel(tuple(Element(law, 4e4 * (1 + e)) for e, law in enumerate(laws)), knots, [50.0, -20.0],
                           [300.0], -12.0, 0.002, (Signal("velocity", "m/s"), Signal("displacement", "m")),
                           (Signal("force", "N"),), Spline("current", 1, 1).bound(BOX), BOX, LAGS["late"])


def continuous(rng, **more):
    box = lpv.Scheduling(("rho",), (0.0,), (1.0,))
    a = np.array([[[-1.0, 2.0], [-2.0, -3.0]], [[0.0, 1.0], [-1.0, -1.0]]])
    return lpv.LPVStateSpace(a, rng.normal(size=(2, 2, 1)), rng.normal(size=(2, 1, 2)), rng.normal(size=(2, 1, 1)),
                             lpv.Polynomial("rho", 1), None, box, rng.normal(size=(2, 2)), inputs=("velocity",), **more)


CASES = {"transfer function": lambda rng: transfer_function(rng, "cubic", "zones", "late", True),
         "square, tanh": lambda rng: transfer_function(rng, "square", "tanh", "lag"),
         "dynamic": lambda rng: transfer_function(rng, "dynamic"),
         "state space": lambda rng: state_space(rng, "fourier"),
         "product": lambda rng: state_space(rng, "product"), "constant": lambda rng: state_space(rng, "none"),
         "quasi": quasi, "compliance": lambda rng: compliance(),
         "limited": lambda rng: saturate(state_space(rng, "grid", state_offset=None), {"y1": 0.8},
                                         0.1 * rng.normal(size=(3, 2)))}
