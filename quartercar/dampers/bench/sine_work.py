"""Work of the power-law dampers on sines in closed form, and the damper of source 000 that it was tabulated for."""

from __future__ import annotations

import math
from collections.abc import Mapping

from lpvid.toolkit import checks
from quartercar.dampers.laws.power_law import DIRECTIONS, PowerLawDamper, PowerLawFrictionGas


def power_integral(order: float) -> float:
    """I(q) = ∫_0^π sin^q φ dφ = √π Γ((q+1)/2)/Γ(q/2+1).

    Parameters
    ----------
    order : float
        q > −1.

    Returns
    -------
    float
        [1].

    Examples
    --------
    >>> round(power_integral(2.0), 6), round(power_integral(3.0), 6)
    (1.570796, 1.333333)
    """
    return math.sqrt(math.pi) * math.exp(math.lgamma((order + 1) / 2) - math.lgamma(order / 2 + 1))


def sine_work(law: PowerLawDamper, amplitude: float, frequency: float) -> float:
    """Work per cycle of x = X sin ωt in closed form, V = ωX [J].

    W = Σ_s [C_1 V X I(2) + P (V/v_ref)^n X I(n+1)] + 4 F_c X over both directions s; springs and preload do no work.
    Friction counts as sharp (F_c sign v): the smoothing of `friction_speed` takes less where V is not far above it.

    Parameters
    ----------
    law : PowerLaw or PowerLawFrictionGas
    amplitude : float
        X [m].
    frequency : float
        f [Hz].

    Returns
    -------
    float
        [J], positive where energy is taken from the motion.

    Examples
    --------
    >>> round(sine_work(SWIFT_2012, 0.063, 1.5), 2)
    250.42
    """
    checks.positive(amplitude, "amplitude", "m")
    peak = 2 * math.pi * checks.positive(frequency, "frequency", "Hz") * amplitude
    values: Mapping[str, float] = law.values
    work = 4 * values.get("friction", 0.0) * amplitude
    for side in DIRECTIONS:
        n = values[f"exponent_{side}"]
        work += values[f"damping_{side}"] * peak * amplitude * power_integral(2.0)
        work += values[f"power_force_{side}"] * (peak / law.reference_speed) ** n * amplitude * power_integral(n + 1)
    return work


SWIFT_2012 = PowerLawFrictionGas.from_printed(
    extension=(1.1602, 0.0002, 2.4993), compression=(0.6100, 0.0, 1.0), unit="mm",
    friction=47.0, gas_preload=178.0, gas_stiffness=490.0)
"""Front damper of a Maruti-Suzuki Swift (2012), source 000, Table III, read as N and mm/s.

The printed compression row C_n = 0.0002, n = 0.0002 adds 0.0002 N: purely linear, here C_n = 0, n = 1. That the unit is
the millimetre is proved by the table of work: read in m/s nothing but the work of friction is left, see
`quartercar.dampers.bench.gas_damper_study.work_table`.
"""
