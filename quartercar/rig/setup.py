"""What integrator and measurement chain are set to: plain numbers, neutral unless a damper or a cause sets them."""

from __future__ import annotations

from typing import NamedTuple


class Physics(NamedTuple):
    """Numbers of the damper between the rig's two ends; all floats, and every default means "not there".

    With w the speed of the fluid, i the effective current, s = 1 in compression and `asymmetry` in rebound::

        x ──[ C F + air + backlash ]── hydraulics and yield: F = s·(f_h(w) + F_y(i) tanh(w/v_k)) ──┬── F_measured
          ──[ friction(v) | gas(x) | end stop(x) | valve and mode dynamics | m a ]─────────────────┘

    Attributes
    ----------
    viscous, viscous_per_current : float
        Viscous damping at zero current [N·s/m] and its growth [N·s/(m·A)].
    exponent, exponent_speed : float
        Exponent of the viscous share, and the fluid speed about which it turns [m/s].
    quadratic : float
        Turbulent loss [N·s²/m²].
    parallel_share : float
        0 … 1, of the viscous share replaced by a network of parallel losses.
    parallel_viscous, parallel_quadratic : float
        The two losses of that network [N·s/m], [N·s²/m²].
    relief_force, relief_slope : float
        Force at which a valve opens [N], and slope beyond it over slope before it.
    orifice, orifice_speed : float
        Loss of a series orifice [N·s²/m²] and the fluid speed beyond which it acts [m/s].
    asymmetry : float
        Rebound over compression.
    cavitation_force : float
        Compression force at which the fluid column breaks [N].
    valve_share : float
        Of the hydraulic force that follows the valve's own motion.
    valve_frequency, valve_damping : float
        Natural frequency [Hz] and damping ratio of the valve.
    yield_base, yield_per_current : float
        Yield force at zero current [N] and its growth [N/A].
    yield_saturation : float
        Reciprocal of the current scale of the tanh [1/A]; 0 for a growth without end.
    yield_speed : float
        Fluid speed of the knee of the tanh [m/s].
    yield_square, yield_cube : float
        Times ı² − ı and ı³ − ı with ı = i/`current_range` [N].
    current_range : float
        [A].
    compliance : float
        Of the series spring [m/N].
    air_stroke, air_force : float
        Deflection that compresses all the air [m]; gas pressure times piston area [N].
    backlash : float
        Total play in series [m].
    friction, friction_speed : float
        Seal friction [N] and the speed that smooths its sign [m/s].
    stiction, stiction_speed : float
        Breakaway force above `friction` [N] and Stribeck speed [m/s].
    gas_preload, gas_stiffness : float
        Gas force [N] and rate [N/m] at mid stroke.
    stop_stiffness, stop_position : float
        Rate of the end stops [N/m] and their distance from mid stroke [m].
    mode_share : float
        Of the series force that passes a further mode.
    mode_frequency, mode_damping : float
        Natural frequency [Hz] and damping ratio of that mode.
    rise_time, fall_time : float
        Time constants of the current of a rising and of a falling command [s].
    coil_time : float
        Time constant of a further lag, the same both ways [s].
    extra_rise_time, extra_fall_time : float
        Time constants of a third lag of the current [s].
    remanence : float
        Half width of the play between current and flux [A].
    current_limit : float
        Reciprocal of the current at which the flux saturates [1/A].
    heat_capacity, heat_loss : float
        Of the fluid [J/K]; to the surroundings [W/K].
    thermal_fade : float
        Of all hydraulic and yield force [1/K].
    viscous_fade : float
        Of the viscous share, exponential [1/K].
    hidden_gain, hidden_period : float
        Force modulation by an unlogged quantity, and its period [s].
    """

    # hydraulics
    viscous: float = 0.0
    viscous_per_current: float = 0.0
    exponent: float = 1.0
    exponent_speed: float = 0.1
    quadratic: float = 0.0
    parallel_share: float = 0.0
    parallel_viscous: float = 3000.0
    parallel_quadratic: float = 12000.0
    relief_force: float = 1.0
    relief_slope: float = 1.0
    orifice: float = 0.0
    orifice_speed: float = 0.1
    asymmetry: float = 1.0
    cavitation_force: float = 1e300
    valve_share: float = 0.0
    valve_frequency: float = 80.0
    valve_damping: float = 0.15
    # yield and its scheduling
    yield_base: float = 0.0
    yield_per_current: float = 0.0
    yield_saturation: float = 0.0
    yield_speed: float = 0.01
    yield_square: float = 0.0
    yield_cube: float = 0.0
    current_range: float = 2.5
    # series elements
    compliance: float = 0.0
    air_stroke: float = 0.0
    air_force: float = 400.0
    backlash: float = 0.0
    # parallel elements
    friction: float = 0.0
    stiction: float = 0.0
    stiction_speed: float = 0.01
    friction_speed: float = 0.002
    gas_preload: float = 0.0
    gas_stiffness: float = 0.0
    stop_stiffness: float = 0.0
    stop_position: float = 1.0
    mode_share: float = 0.0
    mode_frequency: float = 40.0
    mode_damping: float = 0.1
    # electrical and magnetic
    rise_time: float = 0.0
    fall_time: float = 0.0
    coil_time: float = 0.0
    extra_rise_time: float = 0.0
    extra_fall_time: float = 0.0
    remanence: float = 0.0
    current_limit: float = 0.0
    # thermal and hidden
    heat_capacity: float = 2000.0
    heat_loss: float = 5.0
    thermal_fade: float = 0.0
    viscous_fade: float = 0.0
    hidden_gain: float = 0.0
    hidden_period: float = 20.0


class MeasurementChain(NamedTuple):
    """Numbers of the command path, the fixture and the measurement chain; every default means "not there".

    Attributes
    ----------
    command_delay : float
        Of the driver's current [s].
    motion_delay, force_delay : float
        Of displacement and velocity, and of the force [s].
    filter_share : float
        Of a second-order low-pass on displacement and velocity only.
    filter_frequency, filter_damping : float
        Natural frequency [Hz] and damping ratio of that low-pass.
    fixture_mass : float
        Between load cell and damper [kg].
    resonance_share : float
        Of the force that passes the resonance of the fixture.
    resonance_frequency, resonance_damping : float
        Natural frequency [Hz] and damping ratio of that resonance.
    force_offset : float
        Added to the measured force [N].
    clip_share, clip_force : float
        Of the force that is clipped, and the size at which it is [N].
    displacement_step, velocity_step, force_step, current_step : float
        Rounding of each channel [m], [m/s], [N], [A]; 0 for none.
    displacement_gain, velocity_gain, current_gain, force_gain : float
        Factor of each channel, −1 for a turned sign.
    colour_std : float
        Standard deviation of coloured noise on the force [N].
    colour_pole : float
        Of its AR(1) at the output rate.
    colour_share : float
        Of |force|, added to `colour_std`.
    """

    command_delay: float = 0.0
    motion_delay: float = 0.0
    force_delay: float = 0.0
    filter_share: float = 0.0
    filter_frequency: float = 20.0
    filter_damping: float = 0.7071067811865476
    fixture_mass: float = 0.0
    resonance_share: float = 0.0
    resonance_frequency: float = 60.0
    resonance_damping: float = 0.05
    force_offset: float = 0.0
    clip_share: float = 0.0
    clip_force: float = 1000.0
    displacement_step: float = 0.0
    velocity_step: float = 0.0
    force_step: float = 0.0
    current_step: float = 0.0
    displacement_gain: float = 1.0
    velocity_gain: float = 1.0
    current_gain: float = 1.0
    force_gain: float = 1.0
    colour_std: float = 0.0
    colour_pole: float = 0.98
    colour_share: float = 0.0


class Setup(NamedTuple):
    """Damper and chain together: what a cause changes.

    Attributes
    ----------
    physics : Physics
        Numbers of the damper.
    chain : MeasurementChain
        Numbers of command path, fixture and sensors.
    """

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
