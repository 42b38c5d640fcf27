"""Causes that the rig can be given by name: each sets numbers of the damper or of the chain, and nothing else.

`CAUSES` is the one table. A cause of strength 0 leaves the rig exactly as it was; strength 1 is the size that its
parameters say. Section numbers in `source` are those of the project's equation sheet.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple

from lpvid.errors import InputError
from lpvid.toolkit import checks
from quartercar.rig.setup import Setup

CHANNELS = ("displacement", "velocity", "current", "force")
CAR_CAUSES = ("strut-friction", "payload", "tyre-stiffness", "tyre-damping", "actuator-delay")
"""Causes that need a car around the damper."""


class CauseParameter(NamedTuple):
    """One parameter of a cause."""

    name: str
    default: float | str
    unit: str
    description: str


@dataclass(frozen=True)
class Cause:
    """What a cause does and the numbers it takes.

    Attributes
    ----------
    name : str
        Its id, as in diagnosis files.
    equation : str
        One line.
    source : str
        Section of the equation sheet.
    numbers : tuple of Number
        Parameters with default, unit and meaning.
    apply : callable
        (setup, parameters, strength) to setup.
    """

    name: str
    equation: str
    source: str
    numbers: tuple[CauseParameter, ...]
    apply: Callable[[Setup, Mapping[str, float], float], Setup]


@dataclass(frozen=True)
class Effect:
    """A cause switched on: `effect` makes one.

    Attributes
    ----------
    name : str
        Id of the cause.
    strength : float
        0 is off, 1 the size given by the parameters.
    parameters : mapping of str to float
        All parameters of the cause, in SI.
    """

    name: str
    strength: float = 1.0
    parameters: Mapping[str, float | str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        cause = find_cause(self.name)
        if not checks.real(self.strength, f"strength of '{self.name}'") >= 0:
            raise InputError(f"strength of '{self.name}' must not be negative", got=self.strength)
        if self.name == "channel-sign" and self.strength not in (0, 1):
            raise InputError("strength of 'channel-sign' must be 0 or 1", got=self.strength)
        values = {n.name: n.default for n in cause.numbers}
        for key, value in self.parameters.items():
            checks.known_name(key, list(values), f"parameter of '{self.name}':")
            if key == "channel":
                values[key] = checks.one_of(str(value), CHANNELS, f"channel of '{self.name}'")
                continue
            values[key] = number = checks.real(value, f"{key} of '{self.name}'")
            if number < 0 and key not in _SIGNED:
                raise InputError(f"{key} of '{self.name}' must not be negative", got=value)
            if number == 0 and key in _DIVISORS:
                raise InputError(f"{key} of '{self.name}' must be positive", got=value)
        if values.get("pole", 0.0) >= 1:  # type: ignore[operator]
            raise InputError(f"pole of '{self.name}' must be below 1", got=values["pole"])
        object.__setattr__(self, "parameters", MappingProxyType(values))

    def apply(self, setup: Setup) -> Setup:
        """The setup with this effect; untouched when the strength is 0."""
        if self.strength == 0:
            return setup
        return find_cause(self.name).apply(setup, self.parameters, float(self.strength))  # type: ignore[arg-type]


_SIGNED = {"offset", "gain", "square", "cube"}
_DIVISORS = {"stiffness", "limit", "period", "frequency", "capacity", "speed", "smoothing", "laminar", "turbulent"}


def effect(name: str, strength: float = 1.0, **parameters: float | str) -> Effect:
    """Switch a cause on.

    Parameters
    ----------
    name : str
        Id of the cause, e.g. ``"coil-lag"``; `CAUSES` lists them.
    strength : float
        0 is off, 1 the size given by the parameters.
    **parameters : float
        Parameters that differ from their defaults, in SI.

    Returns
    -------
    Effect

    Raises
    ------
    InputError
        An unknown cause or parameter, a value out of range, a cause that needs a car.

    Examples
    --------
    >>> effect("coil-lag", tau=0.03).parameters["tau"]
    0.03
    """
    return Effect(name, strength, parameters)


def find_cause(name: str) -> Cause:
    """Cause by its id."""
    if name in CAR_CAUSES:
        raise InputError(f"'{name}' cannot be switched on here", got="a rig that holds the damper alone",
                         why="this cause belongs to the quarter-car rig, which is not part of this version")
    table = {cause.name: cause for cause in CAUSES}
    return table[checks.known_name(name, list(table), "cause")]


# -- friction and gas ---------------------------------------------------------------------------------------------
_FRICTION = (
    Cause(
        "coulomb-friction",
        "F += F_c tanh(v/ε)",
        "3.1",
        (
            CauseParameter("level", 60.0, "N", "friction force F_c"),
            CauseParameter("smoothing", 0.002, "m/s", "ε, shared with seals"),
        ),
        lambda s, p, k: s.with_physics(friction=s.physics.friction + k * p["level"], friction_speed=p["smoothing"]),
    ),
    Cause(
        "stribeck-friction",
        "F += F_s exp(−(v/v_S)²) tanh(v/ε)",
        "3.2",
        (
            CauseParameter("level", 80.0, "N", "breakaway force above the sliding friction"),
            CauseParameter("speed", 0.01, "m/s", "Stribeck speed v_S"),
        ),
        lambda s, p, k: s.with_physics(stiction=s.physics.stiction + k * p["level"], stiction_speed=p["speed"]),
    ),
    Cause(
        "gas-preload",
        "F −= P (1 + Kx/(nP))^(−n)",
        "3.3",
        (CauseParameter("preload", 200.0, "N", "gas force added at mid stroke"),),
        lambda s, p, k: s.with_physics(gas_preload=s.physics.gas_preload + k * p["preload"]),
    ),
    Cause(
        "gas-stiffness",
        "dF/dx += K at mid stroke",
        "3.4",
        (CauseParameter("stiffness", 8000.0, "N/m", "gas spring rate added"),),
        lambda s, p, k: s.with_physics(gas_stiffness=s.physics.gas_stiffness + k * p["stiffness"]),
    ),
)

# -- compliance ---------------------------------------------------------------------------------------------------
_COMPLIANCE = (
    Cause("series-compliance", "1/k_total = 1/k + 1/k_m", "3.5, 3.6, 9.3",
          (CauseParameter("stiffness", 1.5e6, "N/m", "further spring in series"),),
          lambda s, p, k: s.with_physics(compliance=s.physics.compliance + k / p["stiffness"])),
    Cause("backlash", "series deflection += (δ/2) tanh(F/5 N)", "3.7",
          (CauseParameter("play", 5e-4, "m", "total play δ"),),
          lambda s, p, k: s.with_physics(backlash=s.physics.backlash + k * p["play"])),
    Cause("entrained-air", "series deflection += d (1 − (1 + |F|/F_p)^(−1/1.3)) sign F", "3.5",
          (CauseParameter("stroke", 4e-4, "m", "deflection d that compresses all the air"),
           CauseParameter("pressure_force", 400.0, "N", "gas pressure times piston area F_p")),
          lambda s, p, k: s.with_physics(air_stroke=s.physics.air_stroke + k * p["stroke"],
                                         air_force=max(p["pressure_force"], 1.0))),
)

# -- hydraulics ---------------------------------------------------------------------------------------------------
_HYDRAULICS = (
    Cause(
        "quadratic-loss",
        "f_h += c_Q w²",
        "3.8",
        (CauseParameter("coefficient", 8000.0, "N*s^2/m^2", "turbulent loss c_Q"),),
        lambda s, p, k: s.with_physics(quadratic=s.physics.quadratic + k * p["coefficient"]),
    ),
    Cause(
        "relief-valve",
        "f_h = F_b + r (f_h − F_b) beyond F_b",
        "3.9",
        (
            CauseParameter("force", 80.0, "N", "blow-off force F_b"),
            CauseParameter("slope", 0.25, "", "slope ratio r beyond it"),
        ),
        lambda s, p, k: s.with_physics(relief_force=p["force"], relief_slope=max(1.0 - k * (1.0 - p["slope"]), 0.0)),
    ),
    Cause(
        "series-orifice",
        "f_h += c_o (|w| − w_o)² beyond w_o",
        "3.9",
        (
            CauseParameter("coefficient", 3e4, "N*s^2/m^2", "loss of the orifice c_o"),
            CauseParameter("onset", 0.06, "m/s", "fluid speed w_o from which flow passes it"),
        ),
        lambda s, p, k: s.with_physics(orifice=s.physics.orifice + k * p["coefficient"], orifice_speed=p["onset"]),
    ),
    Cause(
        "asymmetry",
        "rebound side × (1 + g)",
        "3.11",
        (CauseParameter("gain", 0.5, "", "growth g of the rebound force over the damper's own"),),
        lambda s, p, k: s.with_physics(asymmetry=s.physics.asymmetry * (1.0 + k * p["gain"])),
    ),
    Cause(
        "cavitation",
        "F ≥ −F_cav; the void must refill before force returns",
        "3.17",
        (CauseParameter("limit", 1200.0, "N", "gas pressure times piston area F_cav"),),
        lambda s, p, k: s.with_physics(cavitation_force=min(s.physics.cavitation_force, p["limit"] / k)),
    ),
    Cause(
        "valve-dynamics",
        "f_h passes ω²/(s² + 2ζωs + ω²)",
        "3.10",
        (
            CauseParameter("frequency", 30.0, "Hz", "natural frequency of the valve"),
            CauseParameter("damping", 0.15, "", "ζ"),
        ),
        lambda s, p, k: s.with_physics(
            valve_share=min(k, 1.0), valve_frequency=p["frequency"], valve_damping=p["damping"]
        ),
    ),
    Cause(
        "network-topology",
        "w = F/c_L + √(F/c_Q) instead of f_h = c w",
        "3.8, 1.3",
        (
            CauseParameter("laminar", 3000.0, "N*s/m", "laminar branch c_L"),
            CauseParameter("turbulent", 12000.0, "N*s^2/m^2", "turbulent branch c_Q beside it"),
        ),
        lambda s, p, k: s.with_physics(
            parallel_share=min(k, 1.0), parallel_viscous=p["laminar"], parallel_quadratic=p["turbulent"]
        ),
    ),
    Cause(
        "input-nonlinearity",
        "f_h = c w (|w|/w_0)^(n−1)",
        "9.1",
        (
            CauseParameter("exponent", 1.6, "", "n, 1 for a linear viscous share"),
            CauseParameter("speed", 0.1, "m/s", "speed w_0 at which the force is unchanged"),
        ),
        lambda s, p, k: s.with_physics(exponent=1.0 + k * (p["exponent"] - 1.0), exponent_speed=p["speed"]),
    ),
)

# -- electrical and magnetic --------------------------------------------------------------------------------------
_ELECTRICAL = (
    Cause(
        "coil-lag",
        "τ di/dt = i_driver − i",
        "3.12",
        (CauseParameter("tau", 0.02, "s", "time constant added to the current path"),),
        lambda s, p, k: s.with_physics(coil_time=s.physics.coil_time + k * p["tau"]),
    ),
    Cause(
        "command-delay",
        "i(t − T)",
        "3.13",
        (CauseParameter("delay", 0.008, "s", "dead time T of the driver"),),
        lambda s, p, k: s.with_chain(command_delay=s.chain.command_delay + k * p["delay"]),
    ),
    Cause(
        "rise-fall-lag",
        "τ di/dt = i_driver − i with τ_rise or τ_fall",
        "3.14",
        (
            CauseParameter("rise", 0.008, "s", "time constant added upward"),
            CauseParameter("fall", 0.025, "s", "and downward"),
        ),
        lambda s, p, k: s.with_physics(
            extra_rise_time=s.physics.extra_rise_time + k * p["rise"],
            extra_fall_time=s.physics.extra_fall_time + k * p["fall"],
        ),
    ),
    Cause(
        "current-saturation",
        "i_eff = i_s tanh(i/i_s)",
        "3.15",
        (CauseParameter("limit", 1.2, "A", "current i_s at which the flux saturates"),),
        lambda s, p, k: s.with_physics(current_limit=s.physics.current_limit + k / p["limit"]),
    ),
    Cause(
        "remanence",
        "i_eff = play of i with half width h",
        "3.15",
        (CauseParameter("width", 0.15, "A", "half width h"),),
        lambda s, p, k: s.with_physics(remanence=s.physics.remanence + k * p["width"]),
    ),
    Cause(
        "scheduling-degree",
        "F_y += S (ı² − ı) + C (ı³ − ı), ı = i/2.5 A",
        "1.4.5",
        (CauseParameter("square", -1200.0, "N", "S"), CauseParameter("cube", 0.0, "N", "C")),
        lambda s, p, k: s.with_physics(
            yield_square=s.physics.yield_square + k * p["square"], yield_cube=s.physics.yield_cube + k * p["cube"]
        ),
    ),
)

# -- thermal and hidden -------------------------------------------------------------------------------------------
_THERMAL = (
    Cause("thermal-fade", "F_s × (1 − αΔT), C dT/dt = F v − hA ΔT", "3.16",
          (CauseParameter("rate", 0.005, "1/K", "fade α"), CauseParameter("capacity", 150.0, "J/K", "C of the fluid"),
           CauseParameter("loss", 5.0, "W/K", "hA")),
          lambda s, p, k: s.with_physics(thermal_fade=s.physics.thermal_fade + k * p["rate"],
                                         heat_capacity=p["capacity"], heat_loss=p["loss"])),
    Cause("viscous-fade", "c × exp(−βΔT), C dT/dt = F v − hA ΔT", "3.16",
          (CauseParameter("rate", 0.03, "1/K", "β"), CauseParameter("capacity", 150.0, "J/K", "C of the fluid"),
           CauseParameter("loss", 5.0, "W/K", "hA")),
          lambda s, p, k: s.with_physics(viscous_fade=s.physics.viscous_fade + k * p["rate"],
                                         heat_capacity=p["capacity"], heat_loss=p["loss"])),
    Cause("missing-scheduling", "F_s × (1 + g sin(2πt/T)), its cause not logged", "1.4.5",
          (CauseParameter("gain", 0.15, "", "g"), CauseParameter("period", 20.0, "s", "T")),
          lambda s, p, k: s.with_physics(hidden_gain=s.physics.hidden_gain + k * p["gain"], hidden_period=p["period"])),
)

# -- structure ----------------------------------------------------------------------------------------------------
_STRUCTURE = (
    Cause("end-stop", "F += k (|x| − x_s)₊ sign x", "3.18",
          (CauseParameter("position", 0.006, "m", "x_s from mid stroke"), CauseParameter("stiffness", 1e5, "N/m", "k")),
          lambda s, p, k: s.with_physics(stop_stiffness=s.physics.stop_stiffness + k * p["stiffness"],
                                         stop_position=p["position"])),
    Cause("fixture-inertia", "F_measured = F + m a", "3.19", (CauseParameter("mass", 6.0, "kg", "m"),),
          lambda s, p, k: s.with_chain(fixture_mass=s.chain.fixture_mass + k * p["mass"])),
    Cause("fixture-resonance", "F_measured passes ω²/(s² + 2ζωs + ω²)", "3.10, 3.19",
          (CauseParameter("frequency", 60.0, "Hz", "natural frequency"), CauseParameter("damping", 0.05, "", "ζ")),
          lambda s, p, k: s.with_chain(resonance_share=min(k, 1.0), resonance_frequency=p["frequency"],
                                       resonance_damping=p["damping"])),
    Cause("model-order", "F += g (q − F_s), q̈ + 2ζωq̇ + ω²q = ω²F_s", "7.1",
          (CauseParameter("share", 0.4, "", "g"), CauseParameter("frequency", 25.0, "Hz", "of the further mode"),
           CauseParameter("damping", 0.2, "", "ζ")),
          lambda s, p, k: s.with_physics(mode_share=s.physics.mode_share + k * p["share"],
                                         mode_frequency=p["frequency"], mode_damping=p["damping"])),
)

# -- measurement chain --------------------------------------------------------------------------------------------
_MEASUREMENT = (
    Cause("displacement-delay", "x(t − T), v(t − T)", "3.20", (CauseParameter("delay", 0.006, "s", "T"),),
          lambda s, p, k: s.with_chain(motion_delay=s.chain.motion_delay + k * p["delay"])),
    Cause("force-delay", "F(t − T)", "3.20", (CauseParameter("delay", 0.006, "s", "T"),),
          lambda s, p, k: s.with_chain(force_delay=s.chain.force_delay + k * p["delay"])),
    Cause("one-sided-filter", "x, v pass ω²/(s² + 2ζωs + ω²); F does not", "1.4.10",
          (CauseParameter("frequency", 20.0, "Hz", "corner"), CauseParameter("damping", 0.7071067811865476, "", "ζ")),
          lambda s, p, k: s.with_chain(filter_share=min(k, 1.0), filter_frequency=p["frequency"],
                                       filter_damping=p["damping"])),
    Cause("force-offset", "F + F_0", "3.20", (CauseParameter("offset", 120.0, "N", "F_0"),),
          lambda s, p, k: s.with_chain(force_offset=s.chain.force_offset + k * p["offset"])),
    Cause("force-clipping", "|F| ≤ F_max", "3.20", (CauseParameter("limit", 900.0, "N", "F_max"),),
          lambda s, p, k: s.with_chain(clip_share=min(k, 1.0), clip_force=p["limit"])),
    Cause("quantisation", "each channel rounded to a step", "3.20",
          (CauseParameter("displacement", 1e-4, "m", "step"), CauseParameter("velocity", 5e-3, "m/s", "step"),
           CauseParameter("force", 40.0, "N", "step"), CauseParameter("current", 0.02, "A", "step")),
          lambda s, p, k: s.with_chain(**{f"{c}_step": k * p[c] for c in CHANNELS})),
    Cause("sensor-scale", "channel × (1 + g)", "3.20",
          (CauseParameter("gain", 0.1, "", "g"), CauseParameter("channel", "force", "", "channel")),
          lambda s, p, k: _scaled(s, str(p["channel"]), 1.0 + k * p["gain"])),
    Cause("channel-sign", "channel × (−1)", "0", (CauseParameter("channel", "force", "", "channel"),),
          lambda s, p, k: _scaled(s, str(p["channel"]), -1.0)),
    Cause("coloured-noise", "F + (σ + r|F|) ν(k), ν(k) = a ν(k−1) + √(1−a²) e(k)", "3.20",
          (CauseParameter("std", 40.0, "N", "σ"), CauseParameter("pole", 0.98, "", "a at the output rate"),
           CauseParameter("proportional", 0.0, "", "r")),
          lambda s, p, k: s.with_chain(colour_std=k * p["std"], colour_pole=p["pole"],
                                       colour_share=k * p["proportional"])),
)

CAUSES: tuple[Cause, ...] = (
    *_FRICTION, *_COMPLIANCE, *_HYDRAULICS, *_ELECTRICAL, *_THERMAL, *_STRUCTURE, *_MEASUREMENT,
)
"""Every cause that this rig knows."""


def _scaled(setup: Setup, channel: str, factor: float) -> Setup:
    name = f"{channel}_gain"
    return setup.with_chain(**{name: getattr(setup.chain, name) * factor})
