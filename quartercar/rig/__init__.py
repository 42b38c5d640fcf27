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
from quartercar.rig.plan import Plan, iterate_plan, load_plan, parse_plan, plan_schema, plan_template, run_plan
from quartercar.rig.sensors import Sensors
from quartercar.rig.storing import write_csv
from quartercar.rig.virtual import Rig, default_records

__all__ = [
    "CAUSES", "EXPERIMENTS", "Aprbs", "Cause", "Chirp", "Constant", "Creep", "Effect", "Experiment", "Icps", "Motion",
    "Multisine", "Plan", "Prbs", "Response", "Rig", "RigDamper", "Road", "Sensors", "Sine", "Stepped", "Triangle",
    "default_records", "effect", "iterate_plan", "load_plan", "parse_plan", "plan_schema", "plan_template", "respond",
    "run_plan", "write_csv",
]
