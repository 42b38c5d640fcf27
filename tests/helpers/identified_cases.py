"""Records of a known damper, and every kind of model that `lpvid identify` writes from them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

import lpvid as lpv
from lpvid.identification.compliance import Compliance
from lpvid.identification.coprime import RightCoprime
from lpvid.identification.quasi_lpv import QuasiLPV
from lpvid.identification.state_space_error import StateSpaceError
from lpvid.identification.subspace import Subspace
from lpvid.record import Record
from lpvid.scheduling import Polynomial, Spline

RATE = 500.0
VOLTS = (0.2, 1.8)
CURRENT = Polynomial("current", degree=1)
ORDERS = {"na": 2, "nb": 2, "nk": 0}


@cache
def run(seed: int = 0, n: int = 3000, mean: float = 0.0) -> Record:
    """F(k) = a(U) F(k−1) + b(U) v(k) − 60 N, driven by a multisine and steps of a voltage; x = ∫v about `mean`."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / RATE
    f, phase = rng.uniform(0.5, 14, 25), rng.uniform(0, 2 * np.pi, 25)
    angle = 2 * np.pi * np.outer(t, f) + phase
    v = 0.06 * np.cos(angle).sum(axis=1)
    x = mean + (0.06 * np.sin(angle) / (2 * np.pi * f)).sum(axis=1)
    volts = np.repeat(rng.uniform(*VOLTS, n // 60 + 1), 60)[:n]
    force = np.zeros(n)
    for k in range(1, n):
        force[k] = (0.5 + 0.1 * volts[k]) * force[k - 1] + (300 + 500 * volts[k]) * v[k]
    force += -60 + 0.01 * force.std() * rng.standard_normal(n)
    return Record({"velocity": v, "displacement": x, "voltage": volts, "force": force}, 1 / RATE, name=f"run{seed}",
                  units={"velocity": "m/s", "displacement": "m", "voltage": "V", "force": "N"},
                  roles={"current": "voltage"})


def arx(**changes):
    return lpv.ARX(**{**ORDERS, "input": "velocity", "output": "force", "basis": CURRENT, "affine": 1, **changes})


def fitted(structure, *records: Record):
    return lpv.identify(list(records) or run(), structure).model


def form(name: str):
    return lambda: lpv.realize(fitted(arx()), form=name).model


MODELS: dict[str, Callable] = {
    "arx": lambda: fitted(arx()),
    "arx-unscheduled": lambda: fitted(arx(basis=Polynomial())),
    "arx-spline": lambda: fitted(arx(basis=Spline("current", 2, 1))),
    "arx-lagged": lambda: fitted(arx(lagged=True)),
    "arx-tanh": lambda: fitted(arx(stage="tanh")),
    "arx-three-zone": lambda: fitted(arx(stage="three-zone")),
    "arx-displacement": lambda: fitted(arx(input="displacement", nb=3), run(0, mean=0.3)),
    "arx-both": lambda: fitted(arx(input=("velocity", "displacement"), nb=(2, 1), nk=(0, 0)), run(0, mean=0.3)),
    "controllable": form("controllable"),
    "observable": form("observable"),
    "augmented": form("augmented"),
    "coprime": lambda: fitted(RightCoprime(na=2, nb=2, input="velocity", output="force", basis=CURRENT, affine=1)),
    "subspace": lambda: fitted(Subspace(order=2, input="velocity", output="force", basis=CURRENT, direct=True,
                                        affine=True)),
    "pem-ss": lambda: fitted(StateSpaceError(order=1, input="velocity", output="force", basis=CURRENT, direct=True,
                                             affine=True)),
    "subspace-displacement": lambda: fitted(Subspace(order=2, input=("velocity", "displacement"), output="force",
                                                     basis=CURRENT, direct=True, affine=True), run(0, mean=0.3)),
    "quasi": lambda: fitted(QuasiLPV(nb=3, nk=0, input="velocity", output="force", basis=Spline("force", 4, 1),
                                     on="trial", trial=1, external=CURRENT, max_iterations=4)),
    "compliance": lambda: fitted(Compliance("velocity", "force", "current", levels=1, side=("displacement",),
                                            max_iterations=4), run(0, mean=0.3)),
}
"""Name to a function that identifies it."""


@cache
def model(name: str):
    """One of `MODELS`, identified once."""
    return MODELS[name]()
