"""Static laws of one tanh as LPV models: affine in velocity and displacement for a given current and given secants."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lpvid.model.signals import Signal
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Polynomial, Product, Scheduling

if TYPE_CHECKING:
    from quartercar.dampers.contract import Damper


def secant_model(damper: Damper, sample_time: float, secants: tuple[str, ...], currents: tuple[float, float],
                 speed: np.ndarray, stroke: np.ndarray, constant: np.ndarray) -> LPVTransferFunction:
    """F = Σ_jk i^j ρ_k (s_jk v + d_jk x + c_jk) with ρ_0 = 1 as a model along records as measured.

    Parameters
    ----------
    damper : Damper
        Its polarity and zero of the displacement.
    sample_time : float
        Period of the model [s].
    secants : tuple of str
        Channels of ρ_1, ρ_2 …, each between 0 and 1.
    currents : (float, float)
        Box of the current.
    speed, stroke, constant : (powers of the current, 1 + secants) array
        s, d and c, SI.

    Returns
    -------
    LPVTransferFunction
        Without memory.
    """
    degree, linear = len(speed) - 1, Polynomial(secants, degree=1)
    basis = Product(Polynomial(("current",), degree=degree), linear) if degree else linear
    b = damper.polarity * np.stack([speed.ravel(), stroke.ravel()])[None, None]
    c = damper.polarity * (constant.ravel() - damper.centre * stroke.ravel())[None, None]
    return LPVTransferFunction(np.zeros((0, 1, 1, basis.size)), b, basis, sample_time,
                               box(damper, degree, currents, secants), c,
                               inputs=(Signal("velocity", "m/s"), Signal("displacement", "m")),
                               outputs=(Signal("force", "N"),), metadata=origin(damper))


def box(damper: Damper, degree: int, currents: tuple[float, float], secants: tuple[str, ...] = ()) -> Scheduling:
    """Ranges of the current, where a model depends on it, and of secants.

    Parameters
    ----------
    damper : Damper
        Its unit of the current.
    degree : int
        In the current; 0 for a model that does not depend on it.
    currents : (float, float)
    secants : tuple of str

    Returns
    -------
    Scheduling
    """
    rows = [("current", *currents, damper.current_unit)] if degree else []
    rows += [(name, 0.0, 1.0, "") for name in secants]
    names, lower, upper, units = zip(*rows, strict=True) if rows else ((), (), (), ())
    return Scheduling(names, lower, upper, units=units)


def origin(damper: Damper) -> dict[str, str | int]:
    """Metadata of a damper's LPV form.

    Parameters
    ----------
    damper : Damper

    Returns
    -------
    dict
    """
    return {"damper": damper.name, "polarity": damper.polarity}
