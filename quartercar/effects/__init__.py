"""Causes that a diagnosis can name: one family per file, one ordered catalogue."""

from __future__ import annotations

from lpvid.effects.effect import Effect
from quartercar.effects.car import ActuatorDelay, Payload, StrutFriction, TyreDamping, TyreStiffness
from quartercar.effects.compliance import Backlash, EntrainedAir, SeriesCompliance
from quartercar.effects.controlled_force import CurrentDependence
from quartercar.effects.electrical import CoilLag, CommandDelay, CurrentSaturation, Remanence, RiseFallLag
from quartercar.effects.friction_gas import (
    CoulombFriction,
    GasPreload,
    GasStiffness,
    InnerFriction,
    StribeckFriction,
)
from quartercar.effects.hydraulics import (
    Asymmetry,
    Cavitation,
    InputNonlinearity,
    NetworkTopology,
    QuadraticLoss,
    ReliefValve,
    SeriesOrifice,
    ValveDynamics,
)
from quartercar.effects.hysteresis import BoucWenHysteresis
from quartercar.effects.laws import CubicSpring, ForceDeadZone, SaturatingDamping
from quartercar.effects.measurement import DisplacementDelay, ForceClipping, ForceDelay, ForceOffset, OneSidedFilter
from quartercar.effects.model_structure import ColouredNoise, MissingScheduling, ModelOrder, SchedulingDegree
from quartercar.effects.quantisation import Quantisation
from quartercar.effects.sensors import ChannelSign, SensorScale
from quartercar.effects.shared_filter import SharedFilter
from quartercar.effects.structure import EndStop, FixtureInertia, FixtureResonance
from quartercar.effects.thermal import ThermalFade, ViscousFade

CATALOGUE: tuple[Effect, ...] = (
    CoulombFriction(), StribeckFriction(), GasPreload(), GasStiffness(),
    SeriesCompliance(), Backlash(), EntrainedAir(),
    QuadraticLoss(), ReliefValve(), SeriesOrifice(), Asymmetry(), Cavitation(), ValveDynamics(), NetworkTopology(),
    InputNonlinearity(),
    CoilLag(), CommandDelay(), RiseFallLag(), CurrentSaturation(), Remanence(),
    CurrentDependence(),
    DisplacementDelay(), ForceDelay(), OneSidedFilter(), SharedFilter(), ForceOffset(), ForceClipping(), Quantisation(),
    ThermalFade(), ViscousFade(), EndStop(), FixtureInertia(), FixtureResonance(),
    SchedulingDegree(), MissingScheduling(), ModelOrder(),
    InnerFriction(), BoucWenHysteresis(), CubicSpring(), SaturatingDamping(), ForceDeadZone(),
    StrutFriction(), Payload(), TyreStiffness(), TyreDamping(), ActuatorDelay(), SensorScale(), ChannelSign(),
    ColouredNoise(),
)
"""Every cause, in the order in which they are listed."""

__all__ = ["CATALOGUE"]
