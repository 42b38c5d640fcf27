"""Quarter-car parameters, with the sets that the literature uses and where they come from."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace

from lpvid.errors import InputError
from lpvid.tables import si
from lpvid.toolkit import checks


@dataclass(frozen=True)
class CarParameters:
    """Masses, springs and dampers of a quarter car, SI.

    Attributes
    ----------
    sprung_mass, unsprung_mass : float
        m_s, m_us [kg].
    spring_stiffness : float
        k_s [N/m].
    damping : float
        c, of the passive damper [N·s/m].
    tyre_stiffness, tyre_damping : float
        k_t [N/m], c_t [N·s/m].
    source : str
        Where the numbers come from.

    Examples
    --------
    >>> round(MEGANE.sprung_mass + MEGANE.unsprung_mass, 1)
    352.5
    """

    sprung_mass: float = field(metadata=si("kg"))
    unsprung_mass: float = field(metadata=si("kg"))
    spring_stiffness: float = field(metadata=si("N/m"))
    damping: float = field(metadata=si("N*s/m"))
    tyre_stiffness: float = field(metadata=si("N/m"))
    tyre_damping: float = field(default=0.0, metadata=si("N*s/m"))
    source: str = ""

    def __post_init__(self) -> None:
        for own in fields(self):
            if own.name == "source":
                continue
            value = checks.real(getattr(self, own.name), own.name)
            if value < 0 or (value == 0 and own.name in ("sprung_mass", "unsprung_mass", "tyre_stiffness")):
                raise InputError(f"{own.name} must be positive", got=value)
            object.__setattr__(self, own.name, value)

    @property
    def body_bounce(self) -> float:
        """√(k_s/m_s)/2π [Hz]: the body on its spring, the wheel held."""
        return math.sqrt(self.spring_stiffness / self.sprung_mass) / (2 * math.pi)

    @property
    def wheel_hop(self) -> float:
        """√((k_s + k_t)/m_us)/2π [Hz]: the wheel between its springs, the body held."""
        return math.sqrt((self.spring_stiffness + self.tyre_stiffness) / self.unsprung_mass) / (2 * math.pi)

    def replace(self, **changes: float) -> CarParameters:
        """The same car with some numbers changed.

        Parameters
        ----------
        **changes : float
            New values by field, SI.

        Returns
        -------
        CarParameters
            A copy.
        """
        return replace(self, **changes)


MEGANE = CarParameters(315.0, 37.5, 29500.0, 1500.0, 210000.0, source="Renault Megane Coupe, GIPSA (Sename, Do, "
                       "Poussot-Vassal); 208000 N/m in some of their papers")
SAVARESI = CarParameters(400.0, 50.0, 30000.0, 1500.0, 200000.0, source="Savaresi et al. 2010, passenger car")
SH_ADD = CarParameters(400.0, 50.0, 20000.0, 1500.0, 250000.0, source="Savaresi & Spelta 2007")
MOTORCYCLE = CarParameters(117.0, 30.0, 26000.0, 2000.0, 200000.0, source="Savaresi et al. 2010, motorcycle")
INOVE = CarParameters(2.27, 0.25, 1396.0, 68.83, 12270.0, source="INOVE test bench, scale 1/5, GIPSA")
DEMO = CarParameters(300.0, 60.0, 16000.0, 1000.0, 190000.0, source="robust-control suspension demonstration")
BENCH = CarParameters(2.45, 1.0, 900.0, 7.5, 2500.0, 5.0, source="active-suspension bench plant, nominal values")
SETS = {"megane": MEGANE, "savaresi": SAVARESI, "sh-add": SH_ADD, "motorcycle": MOTORCYCLE, "inove": INOVE,
        "demo": DEMO, "bench": BENCH}
"""Parameter sets by name."""
