"""Causes that the rig can be given by name: each sets numbers of the damper or of the chain, and nothing else.

`CAUSES` is the one table. A cause of strength 0 leaves the rig exactly as it was; strength 1 is the size that its
parameters give. Section numbers in `source` are those of the project's equation sheet.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple

from lpvid.errors import InputError
from lpvid.toolkit import ReadOnlyState, checks
from quartercar.rig.setup import Setup

CHANNELS = ("displacement", "velocity", "current", "force")
CAR_CAUSES = ("strut-friction", "payload", "tyre-stiffness", "tyre-damping", "actuator-delay")
"""Causes that need a car around the damper."""


class CauseParameter(NamedTuple):
    """One parameter of a cause.

    Attributes
    ----------
    name : str
        As in a PLAN file and as a keyword of `effect`.
    default : float or str
        In SI; a word for ``channel`` alone.
    unit : str
        SI; empty for a pure number or a word.
    description : str
        What it is, with its symbol in the cause's `equation`.
    """

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
    numbers : tuple of CauseParameter
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
class RigEffect(ReadOnlyState):
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
        """The setup with this effect; untouched when the strength is 0.

        Parameters
        ----------
        setup : Setup
            Numbers of damper and chain so far, those of other effects included.

        Returns
        -------
        Setup
            A copy with the numbers that this cause moves.
        """
        if self.strength == 0:
            return setup
        return find_cause(self.name).apply(setup, self.parameters, float(self.strength))  # type: ignore[arg-type]


Effect = RigEffect
"""the former name; `lpvid.effects.effect.Effect` is another class"""
_SIGNED = {"offset", "gain", "square", "cube"}
_DIVISORS = {"stiffness", "limit", "period", "frequency", "capacity", "speed", "smoothing", "laminar", "turbulent"}


def effect(name: str, strength: float = 1.0, **parameters: float | str) -> RigEffect:
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
    RigEffect

    Raises
    ------
    InputError
        An unknown cause or parameter, a value out of range, a cause that needs a car.

    Examples
    --------
    >>> effect("coil-lag", tau=0.03).parameters["tau"]
    0.03
    """
    return RigEffect(name, strength, parameters)


def find_cause(name: str) -> Cause:
    """Cause by its id.

    Parameters
    ----------
    name : str
        Id, e.g. ``"coil-lag"``.

    Returns
    -------
    Cause
        Entry of `CAUSES`.

    Raises
    ------
    InputError
        An unknown id, or a cause that needs a car around the damper.
    """
    if name in CAR_CAUSES:
        raise InputError(f"'{name}' cannot be switched on here", got="a rig that holds the damper alone",
                         why="this cause belongs to the quarter-car rig, which is not part of this version")
    table = {cause.name: cause for cause in CAUSES}
    return table[checks.known_name(name, list(table), "cause")]


Applied = Callable[[Setup, Mapping[str, float], float], Setup]


def _moves(adds: Mapping[str, str] = MappingProxyType({}), sets: Mapping[str, str] = MappingProxyType({}),
           share: str = "") -> Applied:
    """A cause that moves numbers of the setup, by name: strength times a parameter more, a parameter, the strength.

    Parameters
    ----------
    adds, sets : mapping of str to str
        Number of the setup to parameter of the cause.
    share : str
        Number that becomes the strength, at most 1.

    Returns
    -------
    callable
        As `Cause.apply`.
    """
    def apply(setup: Setup, p: Mapping[str, float], k: float) -> Setup:
        changes = {name: setup.number(name) + k * p[given] for name, given in adds.items()}
        changes |= {name: p[given] for name, given in sets.items()}
        return setup.changed(**changes, **({share: min(k, 1.0)} if share else {}))

    return apply


CAUSES: tuple[Cause, ...] = (
    # -- friction and gas ---------------------------------------------------------------------------------------------
    Cause("coulomb-friction", "F += F_c tanh(v/ε)", "3.1",
          (CauseParameter("level", 60.0, "N", "friction force F_c"),
           CauseParameter("smoothing", 0.002, "m/s", "ε, shared with seals")),
          _moves({"friction": "level"}, {"friction_speed": "smoothing"})),
    Cause("stribeck-friction", "F += F_s exp(−(v/v_S)²) tanh(v/ε)", "3.2",
          (CauseParameter("level", 80.0, "N", "breakaway force above the sliding friction"),
           CauseParameter("speed", 0.01, "m/s", "Stribeck speed v_S")),
          _moves({"stiction": "level"}, {"stiction_speed": "speed"})),
    Cause("gas-preload", "F −= P (1 + Kx/(nP))^(−n)", "3.3",
          (CauseParameter("preload", 200.0, "N", "gas force added at mid stroke"),),
          _moves({"gas_preload": "preload"})),
    Cause("gas-stiffness", "dF/dx += K at mid stroke", "3.4",
          (CauseParameter("stiffness", 8000.0, "N/m", "gas spring rate added"),),
          _moves({"gas_stiffness": "stiffness"})),
    # -- compliance ---------------------------------------------------------------------------------------------------
    Cause("series-compliance", "1/k_total = 1/k + 1/k_m", "3.5, 3.6, 9.3",
          (CauseParameter("stiffness", 1.5e6, "N/m", "further spring in series"),),
          lambda s, p, k: s.changed(compliance=s.physics.compliance + k / p["stiffness"])),
    Cause("backlash", "series deflection += (δ/2) tanh(F/5 N)", "3.7",
          (CauseParameter("play", 5e-4, "m", "total play δ"),), _moves({"backlash": "play"})),
    Cause("entrained-air", "series deflection += d (1 − (1 + |F|/F_p)^(−1/1.3)) sign F", "3.5",
          (CauseParameter("stroke", 4e-4, "m", "deflection d that compresses all the air"),
           CauseParameter("pressure_force", 400.0, "N", "gas pressure times piston area F_p")),
          lambda s, p, k: s.changed(air_stroke=s.physics.air_stroke + k * p["stroke"],
                                    air_force=max(p["pressure_force"], 1.0))),
    # -- hydraulics ---------------------------------------------------------------------------------------------------
    Cause("quadratic-loss", "f_h += c_Q w²", "3.8",
          (CauseParameter("coefficient", 8000.0, "N*s^2/m^2", "turbulent loss c_Q"),),
          _moves({"quadratic": "coefficient"})),
    Cause("relief-valve", "f_h = F_b + r (f_h − F_b) beyond F_b", "3.9",
          (CauseParameter("force", 80.0, "N", "blow-off force F_b"),
           CauseParameter("slope", 0.25, "", "slope ratio r beyond it")),
          lambda s, p, k: s.changed(relief_force=p["force"], relief_slope=max(1.0 - k * (1.0 - p["slope"]), 0.0))),
    Cause("series-orifice", "f_h += c_o (|w| − w_o)² beyond w_o", "3.9",
          (CauseParameter("coefficient", 3e4, "N*s^2/m^2", "loss of the orifice c_o"),
           CauseParameter("onset", 0.06, "m/s", "fluid speed w_o from which flow passes it")),
          _moves({"orifice": "coefficient"}, {"orifice_speed": "onset"})),
    Cause("asymmetry", "rebound side × (1 + g)", "3.11",
          (CauseParameter("gain", 0.5, "", "growth g of the rebound force over the damper's own"),),
          lambda s, p, k: s.changed(asymmetry=s.physics.asymmetry * (1.0 + k * p["gain"]))),
    Cause("cavitation", "F ≥ −F_cav; the void must refill before force returns", "3.17",
          (CauseParameter("limit", 1200.0, "N", "gas pressure times piston area F_cav"),),
          lambda s, p, k: s.changed(cavitation_force=min(s.physics.cavitation_force, p["limit"] / k))),
    Cause("valve-dynamics", "f_h passes ω²/(s² + 2ζωs + ω²)", "3.10",
          (CauseParameter("frequency", 30.0, "Hz", "natural frequency of the valve"),
           CauseParameter("damping", 0.15, "", "ζ")),
          _moves(sets={"valve_frequency": "frequency", "valve_damping": "damping"}, share="valve_share")),
    Cause("network-topology", "w = F/c_L + √(F/c_Q) instead of f_h = c w", "3.8, 1.3",
          (CauseParameter("laminar", 3000.0, "N*s/m", "laminar branch c_L"),
           CauseParameter("turbulent", 12000.0, "N*s^2/m^2", "turbulent branch c_Q beside it")),
          _moves(sets={"parallel_viscous": "laminar", "parallel_quadratic": "turbulent"}, share="parallel_share")),
    Cause("input-nonlinearity", "f_h = c w (|w|/w_0)^(n−1)", "9.1",
          (CauseParameter("exponent", 1.6, "", "n, 1 for a linear viscous share"),
           CauseParameter("speed", 0.1, "m/s", "speed w_0 at which the force is unchanged")),
          lambda s, p, k: s.changed(exponent=1.0 + k * (p["exponent"] - 1.0), exponent_speed=p["speed"])),
    # -- electrical and magnetic --------------------------------------------------------------------------------------
    Cause("coil-lag", "τ di/dt = i_driver − i", "3.12",
          (CauseParameter("tau", 0.02, "s", "time constant added to the current path"),), _moves({"coil_time": "tau"})),
    Cause("command-delay", "i(t − T)", "3.13", (CauseParameter("delay", 0.008, "s", "dead time T of the driver"),),
          _moves({"command_delay": "delay"})),
    Cause("rise-fall-lag", "τ di/dt = i_driver − i with τ_rise or τ_fall", "3.14",
          (CauseParameter("rise", 0.008, "s", "time constant added upward"),
           CauseParameter("fall", 0.025, "s", "and downward")),
          _moves({"extra_rise_time": "rise", "extra_fall_time": "fall"})),
    Cause("current-saturation", "i_eff = i_s tanh(i/i_s)", "3.15",
          (CauseParameter("limit", 1.2, "A", "current i_s at which the flux saturates"),),
          lambda s, p, k: s.changed(current_limit=s.physics.current_limit + k / p["limit"])),
    Cause("remanence", "i_eff = play of i with half width h", "3.15",
          (CauseParameter("width", 0.15, "A", "half width h"),), _moves({"remanence": "width"})),
    Cause("scheduling-degree", "F_y += S (ı² − ı) + C (ı³ − ı), ı = i/2.5 A", "1.4.5",
          (CauseParameter("square", -1200.0, "N", "S"), CauseParameter("cube", 0.0, "N", "C")),
          _moves({"yield_square": "square", "yield_cube": "cube"})),
    # -- thermal and hidden -------------------------------------------------------------------------------------------
    Cause("thermal-fade", "F_s × (1 − αΔT), C dT/dt = F v − hA ΔT", "3.16",
          (CauseParameter("rate", 0.005, "1/K", "fade α"), CauseParameter("capacity", 150.0, "J/K", "C of the fluid"),
           CauseParameter("loss", 5.0, "W/K", "hA")),
          _moves({"thermal_fade": "rate"}, {"heat_capacity": "capacity", "heat_loss": "loss"})),
    Cause("viscous-fade", "c × exp(−βΔT), C dT/dt = F v − hA ΔT", "3.16",
          (CauseParameter("rate", 0.03, "1/K", "β"), CauseParameter("capacity", 150.0, "J/K", "C of the fluid"),
           CauseParameter("loss", 5.0, "W/K", "hA")),
          _moves({"viscous_fade": "rate"}, {"heat_capacity": "capacity", "heat_loss": "loss"})),
    Cause("missing-scheduling", "F_s × (1 + g sin(2πt/T)), its cause not logged", "1.4.5",
          (CauseParameter("gain", 0.15, "", "g"), CauseParameter("period", 20.0, "s", "T")),
          _moves({"hidden_gain": "gain"}, {"hidden_period": "period"})),
    # -- structure ----------------------------------------------------------------------------------------------------
    Cause("end-stop", "F += k (|x| − x_s)₊ sign x", "3.18",
          (CauseParameter("position", 0.006, "m", "x_s from mid stroke"), CauseParameter("stiffness", 1e5, "N/m", "k")),
          _moves({"stop_stiffness": "stiffness"}, {"stop_position": "position"})),
    Cause("fixture-inertia", "F_measured = F + m a", "3.19", (CauseParameter("mass", 6.0, "kg", "m"),),
          _moves({"fixture_mass": "mass"})),
    Cause("fixture-resonance", "F_measured passes ω²/(s² + 2ζωs + ω²)", "3.10, 3.19",
          (CauseParameter("frequency", 60.0, "Hz", "natural frequency"), CauseParameter("damping", 0.05, "", "ζ")),
          _moves(sets={"resonance_frequency": "frequency", "resonance_damping": "damping"}, share="resonance_share")),
    Cause("model-order", "F += g (q − F_s), q̈ + 2ζωq̇ + ω²q = ω²F_s", "7.1",
          (CauseParameter("share", 0.4, "", "g"), CauseParameter("frequency", 25.0, "Hz", "of the further mode"),
           CauseParameter("damping", 0.2, "", "ζ")),
          _moves({"mode_share": "share"}, {"mode_frequency": "frequency", "mode_damping": "damping"})),
    # -- measurement chain --------------------------------------------------------------------------------------------
    Cause("displacement-delay", "x(t − T), v(t − T)", "3.20", (CauseParameter("delay", 0.006, "s", "T"),),
          _moves({"motion_delay": "delay"})),
    Cause("force-delay", "F(t − T)", "3.20", (CauseParameter("delay", 0.006, "s", "T"),),
          _moves({"force_delay": "delay"})),
    Cause("one-sided-filter", "x, v pass ω²/(s² + 2ζωs + ω²); F does not", "1.4.10",
          (CauseParameter("frequency", 20.0, "Hz", "corner"), CauseParameter("damping", 0.7071067811865476, "", "ζ")),
          _moves(sets={"filter_frequency": "frequency", "filter_damping": "damping"}, share="filter_share")),
    Cause("force-offset", "F + F_0", "3.20", (CauseParameter("offset", 120.0, "N", "F_0"),),
          _moves({"force_offset": "offset"})),
    Cause("force-clipping", "|F| ≤ F_max", "3.20", (CauseParameter("limit", 900.0, "N", "F_max"),),
          _moves(sets={"clip_force": "limit"}, share="clip_share")),
    Cause("quantisation", "each channel rounded to a step", "3.20",
          (CauseParameter("displacement", 1e-4, "m", "step"), CauseParameter("velocity", 5e-3, "m/s", "step"),
           CauseParameter("force", 40.0, "N", "step"), CauseParameter("current", 0.02, "A", "step")),
          lambda s, p, k: s.changed(**{f"{c}_step": k * p[c] for c in CHANNELS})),
    Cause("sensor-scale", "channel × (1 + g)", "3.20",
          (CauseParameter("gain", 0.1, "", "g"), CauseParameter("channel", "force", "", "channel")),
          lambda s, p, k: _scaled(s, str(p["channel"]), 1.0 + k * p["gain"])),
    Cause("channel-sign", "channel × (−1)", "0", (CauseParameter("channel", "force", "", "channel"),),
          lambda s, p, k: _scaled(s, str(p["channel"]), -1.0)),
    Cause("coloured-noise", "F + (σ + r|F|) ν(k), ν(k) = a ν(k−1) + √(1−a²) e(k)", "3.20",
          (CauseParameter("std", 40.0, "N", "σ"), CauseParameter("pole", 0.98, "", "a at the output rate"),
           CauseParameter("proportional", 0.0, "", "r")),
          lambda s, p, k: s.changed(colour_std=k * p["std"], colour_pole=p["pole"],
                                    colour_share=k * p["proportional"])),
)
"""Every cause that this rig can simulate."""


def _scaled(setup: Setup, channel: str, factor: float) -> Setup:
    name = f"{channel}_gain"
    return setup.changed(**{name: setup.number(name) * factor})
