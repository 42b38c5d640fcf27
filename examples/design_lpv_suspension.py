"""Which gain is verified for an LPV H-infinity suspension with the damper's limits, and how does it ride a bump?"""

from __future__ import annotations

import sys

import numpy as np

import quartercar as qc
from lpvid.plot import show
from quartercar.controllers.designed.lpv_hinf import LpvHinf
from quartercar.controllers.designed.lpv_hinf_clipped import LpvHinfClipped
from quartercar.design.nominal import FREQUENCIES, Design, design
from quartercar.design.plot import gains
from quartercar.rides.default_damper import identified_damper
from quartercar.roads.ride_roads import Bump
from quartercar.vehicle.nonlinear import BumpStops, Coil


def main(figure: str | None = None, road: Bump | None = None) -> dict[str, Design]:
    """Design with the limits inside and outside, print the verified gain of each, drive both over a bump."""
    car = qc.QuarterCar(qc.parameters.MEGANE, identified_damper(), BumpStops(), Coil(highest=2.5))
    laws = {"limits inside": LpvHinf(), "clipped outside": LpvHinfClipped()}
    found = {name: design(car, law) for name, law in laws.items()}
    for name, one in found.items():
        print(f"\n{name}\n{one.verdict}")
        # the damper can do nothing about the body at the wheel's own frequency: k_t/m_s, in every design
        f0 = np.sqrt(car.parameters.tyre_stiffness / car.parameters.unsprung_mass) / 2 / np.pi
        share, curves = one.gains[-1]
        at = float(np.interp(f0, FREQUENCIES, curves["body_acceleration"]))
        print(f"at {f0:.2f} Hz and share {share:g}: {at:.0f} 1/s^2 of body per road, k_t/m_s is "
              f"{car.parameters.tyre_stiffness / car.parameters.sprung_mass:.0f}")
        controlled, passive = one.bump(road=road)
        for what, ride in (("controlled", controlled), ("passive", passive)):
            print(f"{what:>11}: comfort {ride.figures.comfort:.3f} m/s^2, tyre load {ride.figures.tyre_load:.0f} N, "
                  f"largest stroke {1e3 * ride.figures.largest_stroke:.1f} mm")
    show(gains(found["limits inside"]), figure)
    return found


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else None)
