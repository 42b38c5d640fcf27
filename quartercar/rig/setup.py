"""What integrator and measurement chain are set to: plain numbers, neutral unless a damper or a cause sets them."""

from __future__ import annotations

from typing import NamedTuple


class Physics(NamedTuple):
    """Numbers of the damper between the rig's two ends; all floats, and every default means "not there".

    With w the speed of the fluid, i the effective current, s = 1 in compression and `asymmetry` in rebound::

        x ──[ C F + air + backlash ]── hydraulics and yield: F = s·(f_h(w) + F_y(i) tanh(w/v_k)) ──┬── F_measured
          ──[ friction(v) | gas(x) | end stop(x) | valve and mode dynamics | m a ]─────────────────┘
    """

    # hydraulics
    viscous: float = 0.0  # N·s/m at zero current
    viscous_per_current: float = 0.0  # N·s/(m·A)
    exponent: float = 1.0  # of the viscous share, about `exponent_speed`
    exponent_speed: float = 0.1  # m/s
    quadratic: float = 0.0  # N·s²/m²
    parallel_share: float = 0.0  # 0 … 1 of the viscous share replaced by a network of parallel losses
    parallel_viscous: float = 3000.0  # N·s/m
    parallel_quadratic: float = 12000.0  # N·s²/m²
    relief_force: float = 1.0  # N
    relief_slope: float = 1.0  # slope beyond the relief force over slope before it
    orifice: float = 0.0  # N·s²/m² beyond `orifice_speed`
    orifice_speed: float = 0.1  # m/s
    asymmetry: float = 1.0  # rebound over compression
    cavitation_force: float = 1e300  # N, compression force at which the fluid column breaks
    valve_share: float = 0.0  # of the hydraulic force that follows the valve's own motion
    valve_frequency: float = 80.0  # Hz
    valve_damping: float = 0.15
    # yield and its scheduling
    yield_base: float = 0.0  # N at zero current
    yield_per_current: float = 0.0  # N/A
    yield_saturation: float = 0.0  # 1/A, reciprocal of the current scale of the tanh
    yield_speed: float = 0.01  # m/s, knee of the tanh
    yield_square: float = 0.0  # N, times ı² − ı with ı = i/`current_range`
    yield_cube: float = 0.0  # N, times ı³ − ı
    current_range: float = 2.5  # A
    # series elements
    compliance: float = 0.0  # m/N
    air_stroke: float = 0.0  # m, deflection that compresses all the air
    air_force: float = 400.0  # N, gas pressure times piston area
    backlash: float = 0.0  # m
    # parallel elements
    friction: float = 0.0  # N
    stiction: float = 0.0  # N above `friction`
    stiction_speed: float = 0.01  # m/s
    friction_speed: float = 0.002  # m/s, smoothing of the sign
    gas_preload: float = 0.0  # N
    gas_stiffness: float = 0.0  # N/m
    stop_stiffness: float = 0.0  # N/m
    stop_position: float = 1.0  # m
    mode_share: float = 0.0
    mode_frequency: float = 40.0  # Hz
    mode_damping: float = 0.1
    # electrical and magnetic
    rise_time: float = 0.0  # s
    fall_time: float = 0.0  # s
    coil_time: float = 0.0  # s
    extra_rise_time: float = 0.0  # s
    extra_fall_time: float = 0.0  # s
    remanence: float = 0.0  # A, half width of the play between current and flux
    current_limit: float = 0.0  # 1/A, reciprocal of the current at which the flux saturates
    # thermal and hidden
    heat_capacity: float = 2000.0  # J/K
    heat_loss: float = 5.0  # W/K
    thermal_fade: float = 0.0  # 1/K, of all hydraulic and yield force
    viscous_fade: float = 0.0  # 1/K, exponential, of the viscous share
    hidden_gain: float = 0.0  # force modulation by an unlogged quantity
    hidden_period: float = 20.0  # s


class MeasurementChain(NamedTuple):
    """Numbers of the command path, the fixture and the measurement chain; every default means "not there"."""

    command_delay: float = 0.0  # s
    motion_delay: float = 0.0  # s, displacement and velocity
    force_delay: float = 0.0  # s
    filter_share: float = 0.0  # of a second-order low-pass on displacement and velocity only
    filter_frequency: float = 20.0  # Hz
    filter_damping: float = 0.7071067811865476
    fixture_mass: float = 0.0  # kg between load cell and damper
    resonance_share: float = 0.0
    resonance_frequency: float = 60.0  # Hz
    resonance_damping: float = 0.05
    force_offset: float = 0.0  # N
    clip_share: float = 0.0
    clip_force: float = 1000.0  # N
    displacement_step: float = 0.0  # m
    velocity_step: float = 0.0  # m/s
    force_step: float = 0.0  # N
    current_step: float = 0.0  # A
    displacement_gain: float = 1.0
    velocity_gain: float = 1.0
    current_gain: float = 1.0
    force_gain: float = 1.0
    colour_std: float = 0.0  # N
    colour_pole: float = 0.98  # of the AR(1) at the output rate
    colour_share: float = 0.0  # of |force|


class Setup(NamedTuple):
    """Damper and chain together: what a cause changes."""

    physics: Physics
    chain: MeasurementChain

    def number(self, name: str) -> float:
        """A number of the damper or of the chain.

        Parameters
        ----------
        name : str
            A field of `Physics` or `MeasurementChain`.

        Returns
        -------
        float
            In the unit of the field.
        """
        return getattr(self.physics if name in Physics._fields else self.chain, name)

    def changed(self, **changes: float) -> Setup:
        """The same setup with some numbers of the damper or of the chain replaced.

        Parameters
        ----------
        **changes : float
            New values by field of `Physics` or `MeasurementChain`.

        Returns
        -------
        Setup
            A copy.
        """
        of_damper = {name: value for name, value in changes.items() if name in Physics._fields}
        of_chain = {name: value for name, value in changes.items() if name not in of_damper}
        return self._replace(physics=self.physics._replace(**of_damper), chain=self.chain._replace(**of_chain))
