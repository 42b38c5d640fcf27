"""ReliefValveDesign: a relief-valve damper as its drawing and its fluid have it, and the force-domain numbers of it."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

from lpvid.errors import InputError
from lpvid.toolkit import checks

MAY_BE_ZERO = ("poppet_damping", "holes", "hole_area")


def effective_compressibility(fluid: float, container: float = math.inf, gas: float = math.inf,
                              gas_share: float = 0.0) -> float:
    """β_eff = 1/B_F + 1/B_C + (V_G/V_C)/B_G, (1) [1/Pa].

    Parameters
    ----------
    fluid, container, gas : float
        Bulk moduli [Pa]; B_C ≈ E h_C/d_C of a thin wall, B_G = p isothermal.
    gas_share : float
        V_G/V_C.

    Returns
    -------
    float
        [1/Pa].

    Examples
    --------
    >>> round(1 / effective_compressibility(1.5e9, gas=1e6, gas_share=0.01) / 1e8, 4)  # 1 % of gas: 100 B_G and softer
    0.9375
    """
    return 1 / checks.positive(fluid, "fluid", "Pa") + 1 / container + gas_share / gas


@dataclass(frozen=True, kw_only=True)
class ReliefValveDesign:
    """Geometry, fluid and springs of section 2 of Titurus & Lieven; both valves alike.

    Attributes
    ----------
    piston_area, density, compressibility : float
        A_P [m²], ρ [kg/m³], β_eff [1/Pa]; see `effective_compressibility`.
    volume, volume_ratio : float
        V_1 [m³], ζ = V_2/V_1.
    orifice_discharge, orifice_area : float
        Main orifice C_D,O, A_O [m²].
    seat_diameter, cone_half_angle : float
        d_V [m], α [rad].
    discharge, discharge_rise : float
        C_D,V0 and γ [1/m].
    poppet_mass, poppet_damping, spring_rate, precompression : float
        m_V [kg], b_V [N·s/m], k_V [N/m], X_CRIT [m].
    holes, hole_discharge, hole_area : int, float, float
        N_O, C_D, A_O [m²] of the ring behind each valve; no holes, no loss.

    Examples
    --------
    >>> design = ReliefValveDesign()
    >>> round(design.opening_pressure / 1e6, 3)
    4.584
    """

    piston_area: float = 1.5e-3
    density: float = 960.0
    compressibility: float = 4e-9
    volume: float = 7.5e-5
    volume_ratio: float = 1.0
    orifice_discharge: float = 0.7
    orifice_area: float = 9e-7
    seat_diameter: float = 0.01
    cone_half_angle: float = math.radians(15)
    discharge: float = 0.7
    discharge_rise: float = 2000.0
    poppet_mass: float = 0.05
    poppet_damping: float = 100.0
    spring_rate: float = 8e4
    precompression: float = 4.5e-3
    holes: int = 0
    hole_discharge: float = 0.65
    hole_area: float = 3e-6

    def __post_init__(self) -> None:
        checks.count(self.holes, "holes")
        for f in fields(self):
            value = checks.real(getattr(self, f.name), f.name)
            if value < 0 or (value == 0 and f.name not in MAY_BE_ZERO):
                raise InputError(f"{f.name} must be positive", got=value)

    def flow_coefficient(self, effective_area: float) -> float:
        """K = C_D A √(2/ρ), so that Q = K√Δp (3), (4) [m³/(s·√Pa)].

        Parameters
        ----------
        effective_area : float
            C_D A, discharge coefficient times area [m²].

        Returns
        -------
        float
            K [m³/(s·√Pa)].
        """
        return effective_area * math.sqrt(2 / self.density)

    def valve_flow(self, lift: float) -> float:
        """K_V(x) of the poppet, (4) [m³/(s·√Pa)].

        Parameters
        ----------
        lift : float
            x, not below zero [m].

        Returns
        -------
        float
            [m³/(s·√Pa)]; 0 for a closed poppet.
        """
        discharge = self.discharge * self.discharge_rise * lift / (1 + self.discharge_rise * lift)
        return self.flow_coefficient(discharge * math.pi * self.seat_diameter * lift * math.sin(self.cone_half_angle))

    @property
    def ring_flow(self) -> float:
        """N_O K_O of the holes behind a valve; inf without holes."""
        return self.flow_coefficient(self.holes * self.hole_discharge * self.hole_area) if self.holes else math.inf

    def bypass_flow(self, lift: float) -> float:
        """K*_V(x) = [K_V⁻² + (N_O K_O)⁻²]^{−1/2}, (9).

        Parameters
        ----------
        lift : float
            x, not below zero [m].

        Returns
        -------
        float
            Of poppet and holes in series [m³/(s·√Pa)].
        """
        return self.valve_flow(lift) * math.sqrt(self.valve_share(lift))

    def valve_share(self, lift: float) -> float:
        """Part of Δp that the poppet bears: K_V⁻²/(K_V⁻² + (N_O K_O)⁻²).

        Parameters
        ----------
        lift : float
            x, not below zero [m].

        Returns
        -------
        float
            Between 0 and 1; 1 for a closed poppet, or without holes.
        """
        return 1 / (1 + (self.valve_flow(lift) / self.ring_flow) ** 2)

    @property
    def seat_area(self) -> float:
        """A_s = π d_V²/4 [m²]."""
        return 0.25 * math.pi * self.seat_diameter**2

    @property
    def opening_pressure(self) -> float:
        """P_CRIT = k_V X_CRIT/A_s [Pa]."""
        return self.spring_rate * self.precompression / self.seat_area

    @property
    def values(self) -> dict[str, float]:
        """Parameters of the damper models: everything as force over piston speed."""
        cube = self.piston_area**3
        full = self.flow_coefficient(self.discharge * math.pi * self.seat_diameter * self.precompression
                                     * math.sin(self.cone_half_angle))
        shared = self.volume * self.volume_ratio / (1 + self.volume_ratio)
        found = {"hydraulic_stiffness": self.piston_area**2 / (self.compressibility * shared),
                 "orifice_loss": cube / self.flow_coefficient(self.orifice_discharge * self.orifice_area) ** 2,
                 "opening_force": self.opening_pressure * self.piston_area, "valve_loss": cube / full**2,
                 "valve_frequency": math.sqrt(self.spring_rate / self.poppet_mass) / (2 * math.pi),
                 "valve_damping": self.poppet_damping / (2 * math.sqrt(self.spring_rate * self.poppet_mass))}
        return {**found, "series_loss": cube / self.ring_flow**2} if self.holes else found

    @property
    def settings(self) -> dict[str, Any]:
        """Settings of the damper models."""
        return {n: getattr(self, n) for n in ("piston_area", "precompression", "seat_diameter", "cone_half_angle",
                                              "discharge", "discharge_rise")}
