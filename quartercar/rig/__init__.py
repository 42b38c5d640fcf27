"""Virtual test rig: a physical damper with current, sensors and noise, and causes that can be switched on by name."""

from quartercar.rig.causes import CAUSES, Cause, Effect, effect
from quartercar.rig.damper import Motion, Response, RigDamper, respond
from quartercar.rig.patterns import (
    EXPERIMENTS,
    Aprbs,
    Chirp,
    Constant,
    Creep,
    Experiment,
    Icps,
    Multisine,
    Prbs,
    Road,
    Sine,
    Stepped,
    Triangle,
)
from quartercar.rig.sensors import Sensors
from quartercar.rig.virtual import Rig, default_records

__all__ = [
    "CAUSES", "EXPERIMENTS", "Aprbs", "Cause", "Chirp", "Constant", "Creep", "Effect", "Experiment", "Icps", "Motion",
    "Multisine", "Prbs", "Response", "Rig", "RigDamper", "Road", "Sensors", "Sine", "Stepped", "Triangle",
    "default_records", "effect", "respond",
]
