"""The rig with its damper without memory and one cause: what it records, and what is found in that."""

from __future__ import annotations

import numpy as np

from lpvid.baselines.signals import Signals
from lpvid.diagnosis.diagnosis import Diagnosis, Estimated
from lpvid.diagnosis.evidence.engine import diagnose
from lpvid.record import Record
from quartercar import dampers
from quartercar.baselines.damper import DamperBaseline
from quartercar.dampers.facts import Facts
from quartercar.effects import CATALOGUE
from quartercar.rig import EXPERIMENTS, Rig, RigDamper, Sensors, effect


def static_force(velocity: np.ndarray, current: np.ndarray) -> np.ndarray:
    """(n,) force of `RigDamper.static`, as its docstring states it."""
    return (900 + 300 * current) * velocity + (60 + 580 * current) * np.tanh(velocity / 0.025)


def static_law(s: Signals) -> np.ndarray:
    """(n,) the same along signals."""
    return static_force(s["velocity"], s["current"])


def recorded(cause: str, experiment: str) -> Signals:
    """What perfect sensors record of that damper with one cause."""
    record = Rig(damper=RigDamper.static(), effects=(effect(cause, 1.0),), sensors=Sensors.perfect()).run(
        EXPERIMENTS[experiment], seed=0)
    return Signals(record.sample_time, {c: record[c] for c in ("displacement", "velocity", "current")}, record["force"])


def diagnosed(record: Record, damper: str, **changes: object) -> Diagnosis:
    """What the whole catalogue finds beside a damper's law."""
    made = dampers.model_class(damper).suited(Facts.of([record])).replace(values={}, **changes)
    return diagnose([record], DamperBaseline(made), CATALOGUE)


def named_or_listed(cause: str) -> dict[str, tuple[Estimated, ...]]:
    """Parameters of a cause of test 3 and of the rivals that are listed; nothing else may be named."""
    record = Rig(damper=RigDamper.static(), effects=(effect(cause, 1.0),)).run(EXPERIMENTS["test-3"], seed=0)
    found = diagnosed(record, "guo", offset=False)
    estimated = {c.name: c.parameters for c in found.causes}
    assert estimated.keys() <= {cause}
    for group in found.rivals:
        estimated |= group.parameters
    return estimated
