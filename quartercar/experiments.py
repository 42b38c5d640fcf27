"""Experiments that separate causes, as plans that the virtual rig (or a real one) can run.

The table holds for every cause which motion and which current make it visible and separate it from its usual rivals.
Neither the rig nor the effects depend on it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from lpvid.diagnosis.diagnosis import Diagnosis
from lpvid.diagnosis.experiments import ExperimentProposal, open_questions

MOST_PARTS = 8
"""experiments in one plan"""


@dataclass(frozen=True)
class PlannedExperiment:
    """One experiment of a plan.

    Attributes
    ----------
    name, description : str
    displacement, current : str
        Inline TOML tables, as in `quartercar rig --template`.
    duration : float
        [s].
    replicates : int
        Runs; with a constant current one for each level.
    redraw : bool
        Whether each run draws a motion of its own.
    """

    name: str
    description: str
    displacement: str
    current: str
    duration: float = 30.0
    replicates: int = 1
    redraw: bool = True

    def toml(self, causes: tuple[str, ...]) -> str:
        """Its lines in a plan.

        Parameters
        ----------
        causes : tuple of str
            What the experiment is for; written into the comment above it.

        Returns
        -------
        str
            A comment and an ``[[experiments]]`` table, without a line break at the end.
        """
        lines = [f"# {self.description}: {', '.join(causes)}", "[[experiments]]", f'name = "{self.name}"',
                 f"displacement = {{ {self.displacement} }}", f"current = {{ {self.current} }}",
                 f"duration = {self.duration:g}", f"replicates = {self.replicates}"]
        if not self.redraw:
            lines.append("redraw = false")
        return "\n".join(lines)


_ROAD = 'kind = "road"'
_TRIANGLE = 'kind = "triangle", amplitude = "12 mm", frequency = "3.7 Hz"'
_MULTISINE = 'kind = "multisine", rms = "3 mm"'
_RANDOM = 'kind = "aprbs", clock = 0.03'
_OFF = 'kind = "constant", levels = [0.0]'
_LEVELS = 'kind = "constant", levels = [0.0, 0.6, 1.2, 1.8, 2.5]'
_THREE = 'kind = "constant", levels = [0.0, 1.2, 2.5]'

CREEP = PlannedExperiment(
    "creep",
    "slow triangle, only friction and gas are left",
    'kind = "creep", amplitude = "10 mm", speed = "2 mm/s"',
    _OFF,
    60.0,
)
SPEEDS = PlannedExperiment(
    "speeds",
    "a sweep of small strokes through all speeds",
    'kind = "chirp", f_start = 0.1, f_end = 4.0, amplitude = "12 mm", peak_velocity = 0.25',
    _OFF,
    60.0,
)
FAST = PlannedExperiment("fast", "large strokes at high speed, no current", 'kind = "sine", amplitude = "35 mm", '
            'frequency = "4 Hz"', _OFF, 20.0)
STEPS = PlannedExperiment(
    "steps", "current steps of many heights, up and down, while the piston moves", _TRIANGLE, _RANDOM, 40.0
)
RANDOM = PlannedExperiment("random", "road with a random current", _ROAD, _RANDOM, 40.0)
FULL_RANGE = PlannedExperiment(
    "levels", "the same motion at five currents over the full range", _MULTISINE, _LEVELS, 15.0, 5
)
SWEEP = PlannedExperiment(
    "sweep",
    "frequency sweep of small amplitude at three currents",
    'kind = "chirp", f_start = 0.5, f_end = 40.0, amplitude = "3 mm", peak_velocity = 0.15',
    _THREE,
    20.0,
    3,
)
LARGE_SWEEP = PlannedExperiment(
    "large-sweep",
    "frequency sweep of large amplitude at three currents",
    'kind = "chirp", f_start = 0.5, f_end = 15.0, amplitude = "20 mm", peak_velocity = 0.5',
    _THREE,
    20.0,
    3,
)
HEATING = PlannedExperiment("heating", "one motion repeated for minutes, so that the damper heats up", 'kind = "sine", '
               'amplitude = "20 mm", frequency = "3 Hz"', 'kind = "stepped", levels = [1.5, 0.2, 1.5, 0.2, 1.5]', 150.0)
REPEATED = PlannedExperiment(
    "repeated",
    "one motion with one current three times: what does not come back is noise",
    _ROAD,
    _RANDOM,
    20.0,
    3,
    redraw=False,
)

WITHOUT_CURRENT: Mapping[PlannedExperiment, PlannedExperiment | None] = {
    STEPS: None, FULL_RANGE: SPEEDS,
    FAST: replace(FAST, description="large strokes at high speed"),
    RANDOM: replace(RANDOM, description="road", current=_OFF),
    SWEEP: replace(SWEEP, description="frequency sweep of small amplitude", current=_OFF, replicates=1),
    LARGE_SWEEP: replace(LARGE_SWEEP, description="frequency sweep of large amplitude", current=_OFF, replicates=1),
    HEATING: replace(HEATING, current=_OFF),
    REPEATED: replace(REPEATED, description="one motion three times: what does not come back is noise", current=_OFF),
}
"""What takes an experiment's place where no current was measured, as of a passive damper; the others have none. Of
steps of the current nothing is left."""

PLANS: Mapping[str, tuple[PlannedExperiment, ...]] = {
    "coulomb-friction": (CREEP,), "stribeck-friction": (CREEP, SPEEDS), "gas-preload": (CREEP,),
    "gas-stiffness": (CREEP, SWEEP),
    "series-compliance": (SWEEP, LARGE_SWEEP), "backlash": (CREEP, SWEEP),
    "quadratic-loss": (SPEEDS, FAST), "relief-valve": (SPEEDS, FAST), "series-orifice": (SPEEDS, FAST),
    "network-topology": (SPEEDS, FAST), "asymmetry": (FULL_RANGE,), "cavitation": (FAST, SPEEDS),
    "valve-dynamics": (SWEEP,), "entrained-air": (SWEEP, LARGE_SWEEP),
    "coil-lag": (STEPS,), "command-delay": (STEPS,), "rise-fall-lag": (STEPS,),
    "current-saturation": (FULL_RANGE, STEPS), "remanence": (STEPS, FULL_RANGE),
    "thermal-fade": (HEATING,), "viscous-fade": (HEATING, SPEEDS),
    "end-stop": (FAST,), "fixture-inertia": (SWEEP,), "fixture-resonance": (SWEEP,),
    "displacement-delay": (RANDOM, SWEEP), "force-delay": (RANDOM, SWEEP), "one-sided-filter": (SWEEP, RANDOM),
    "force-clipping": (FAST,), "quantisation": (CREEP,),
    "scheduling-degree": (FULL_RANGE,), "current-dependence": (FULL_RANGE,), "model-order": (SWEEP,),
    "input-nonlinearity": (SPEEDS, FAST),
    "inner-friction": (CREEP, SWEEP), "hysteresis": (CREEP, SWEEP), "cubic-spring": (CREEP,),
    "saturating-damping": (SPEEDS, FAST), "force-dead-zone": (CREEP,),
    "force-offset": (CREEP,), "missing-scheduling": (HEATING, REPEATED), "coloured-noise": (REPEATED,),
}
"""What makes a cause visible."""

ON_THE_CAR: Mapping[str, str] = {
    "strut-friction": "move the road in slow, small steps; the body stays where friction leaves it",
    "payload": "weigh the body, or drive the same road with a known further mass",
    "tyre-stiffness": "sweep the road through the wheel hop, or load the tyre statically",
    "tyre-damping": "sweep the road through the wheel hop at small amplitude",
    "actuator-delay": "step the actuator on a level road",
}
"""Causes in a car, which a rig that holds the damper alone cannot show, and what shows them on the car."""

NO_PLAN: Mapping[str, str] = {
    "sensor-scale": "no motion and no current separate the scale of a sensor from the size of what it drives: "
                    "calibrate the channel against a known displacement or current",
    "shared-filter": "every motion passes the same filters: record one run again with their corner frequency raised",
    "channel-sign": "a sensor turned round and a law turned round are one: move the rod by hand and read the sign, "
                    "pass a known current",
    **{name: f"a rig that holds the damper alone has no wheel and no body. On the car: {what}"
       for name, what in ON_THE_CAR.items()},
}
"""Causes that no experiment on the rig of a damper reveals, and what does."""

PAIRS: Mapping[frozenset[str], tuple[PlannedExperiment, ...] | str] = {frozenset(names): what for names, what in (
    (("coil-lag", "command-delay"), (STEPS,)), (("coil-lag", "force-delay"), (STEPS,)),
    (("command-delay", "force-delay"), (STEPS, RANDOM)), (("rise-fall-lag", "coil-lag"), (STEPS,)),
    (("rise-fall-lag", "current-saturation"), (STEPS,)),
    (("hysteresis", "series-compliance"), (SWEEP, LARGE_SWEEP)), (("hysteresis", "coulomb-friction"), (CREEP, SWEEP)),
    (("displacement-delay", "force-delay"), (RANDOM,)), (("displacement-delay", "coil-lag"), (RANDOM,)),
    (("displacement-delay", "series-compliance"), (SWEEP, LARGE_SWEEP)),
    (("force-delay", "series-compliance"), (SWEEP, LARGE_SWEEP)),
    (("gas-stiffness", "fixture-inertia"), (SWEEP,)), (("gas-stiffness", "displacement-delay"), (SWEEP,)),
    (("thermal-fade", "viscous-fade"), (HEATING, SPEEDS)), (("thermal-fade", "missing-scheduling"), (HEATING,)),
    (("thermal-fade", "scheduling-degree"), (HEATING, FULL_RANGE)),
    (("thermal-fade", "current-saturation"), (HEATING, FULL_RANGE)),
    (("viscous-fade", "scheduling-degree"), (HEATING, FULL_RANGE)),
    (("coulomb-friction", "quadratic-loss"), (CREEP, SPEEDS)), (("coulomb-friction", "gas-preload"), (CREEP,)),
    (("coulomb-friction", "force-offset"), (CREEP,)), (("coulomb-friction", "gas-stiffness"), (CREEP, SPEEDS)),
    (("gas-preload", "quadratic-loss"), (CREEP, SPEEDS)), (("asymmetry", "gas-preload"), (SPEEDS, FULL_RANGE)),
    (("asymmetry", "force-offset"), (SPEEDS, FULL_RANGE)),
    (("current-saturation", "scheduling-degree"), (FULL_RANGE,)),
    (("gas-preload", "force-offset"),
     "at one gas pressure and one temperature no motion separates them: read the load cell with the rod "
     "disconnected, or repeat the run warm or at another gas pressure; the offset stays"),
    (("series-compliance", "entrained-air"), (SWEEP, LARGE_SWEEP)),
)}
"""What separates two causes, or why no experiment on the rig can."""

NOT_BY_FORCE: Mapping[str, str] = {
    "series-compliance": "whether it is the oil or a bush cannot be decided from force and displacement at the ends: a "
                         "second displacement across the bush, or a run at another gas pressure, would",
    "entrained-air": "whether it is air in the oil or a soft mount cannot be decided from force and displacement at "
                     "the ends: a run at another gas pressure, or after bleeding, would",
}
"""What remains open about a cause that is found, and the measurement that is missing."""


def plan_for(found: Diagnosis) -> ExperimentProposal | None:
    """A plan for what a diagnosis left open: its rivals if it has some, else the candidates that it could not reveal.

    Parameters
    ----------
    found : Diagnosis
        Its rivals, its baseline and its open questions count. Where no current was measured the plan has none.

    Returns
    -------
    ExperimentProposal or None
        At most `MOST_PARTS` experiments; without any where there is only advice; None where nothing is left open.

    Examples
    --------
    >>> sorted(PLANS["coil-lag"][0].toml(("coil-lag",)).splitlines())[0]
    '# current steps of many heights, up and down, while the piston moves: coil-lag'
    """
    groups = [tuple(r.names) for r in found.rivals]
    car = found.baseline.get("name") == "quarter-car"
    absent = {c.name: c.unmeasured for c in found.cannot_tell if c.unmeasured}
    no_current = [n for n, channels in absent.items() if channels == "current"]
    asked = [n for n in open_questions(found) if (car or n not in ON_THE_CAR) and n not in no_current]
    by_part, advice = _of_rivals(groups) if groups else _of_candidates(asked)
    if no_current:
        by_part = _without_current(by_part)
        if not groups:
            advice.append(f"{', '.join(no_current)}: no current was measured; where the device has one, record it")
    advice += [NOT_BY_FORCE[c.name] for c in found.causes if c.name in NOT_BY_FORCE]
    parts = list(by_part)[:MOST_PARTS]
    if not parts:
        return ExperimentProposal("", "", (), tuple(dict.fromkeys(advice))) if advice else None
    served = tuple(dict.fromkeys(n for p in parts for n in by_part[p]))
    described = [g for g in groups if set(g) & set(served)]
    purpose = (f"distinguish {'; '.join(' from '.join(g) for g in described)}" if described
               else f"reveal {', '.join(served)}")
    head = [f"# To {purpose}.", "# Run on the virtual rig by `quartercar rig experiment.toml --out DIR`; on a real rig "
            "impose the same motion and current.", *(f"# {a}" for a in dict.fromkeys(advice)), "seed = 1", ""]
    text = "\n".join(head) + "\n\n".join(p.toml(tuple(by_part[p])) for p in parts) + "\n"
    return ExperimentProposal(
        text, "; ".join(p.description for p in parts) + f": to {purpose}", served, tuple(dict.fromkeys(advice))
    )


def _of_rivals(groups: list[tuple[str, ...]]) -> tuple[dict[PlannedExperiment, list[str]], list[str]]:
    """Parts that separate the members of each group, and what no part can.

    The first of a group is the chosen one, from which each of the others is to be separated.
    """
    by_part: dict[PlannedExperiment, list[str]] = {}
    advice: list[str] = []
    for first, *others in groups:
        for other in others:
            known = PAIRS.get(frozenset((first, other)))
            if isinstance(known, str):
                advice.append(f"{first} or {other}: {known}")
                continue
            parts = known or tuple(dict.fromkeys(p for n in (first, other) for p in PLANS.get(n, ())))
            for part in parts:
                by_part.setdefault(part, []).extend(n for n in (first, other) if n not in by_part.get(part, ()))
            advice += [f"{n}: {NO_PLAN[n]}" for n in (first, other) if n in NO_PLAN]
    return by_part, advice


def _without_current(by_part: Mapping[PlannedExperiment, list[str]]) -> dict[PlannedExperiment, list[str]]:
    """The same parts without a current; those that are nothing without one are left out."""
    found: dict[PlannedExperiment, list[str]] = {}
    for part, names in by_part.items():
        other = WITHOUT_CURRENT.get(part, part)
        if other is not None:
            found.setdefault(other, []).extend(n for n in names if n not in found.get(other, ()))
    return found


def _of_candidates(names: Sequence[str]) -> tuple[dict[PlannedExperiment, list[str]], list[str]]:
    """Parts that make causes visible; what no part can."""
    by_part: dict[PlannedExperiment, list[str]] = {}
    for name in names:
        for part in PLANS.get(name, ()):
            by_part.setdefault(part, []).append(name)
    return by_part, [f"{n}: {NO_PLAN[n]}" for n in names if n in NO_PLAN]
