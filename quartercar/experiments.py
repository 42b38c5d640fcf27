"""Experiments that tell causes apart, as plans that the virtual rig (or a real one) can run.

The table says of every cause which motion and which current make it visible and set it apart from its usual rivals.
Neither the rig nor the effects know of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lpvid.diagnosis.diagnosis import Diagnosis
from lpvid.diagnosis.experiments import Proposal, open_questions

MOST_PARTS = 8
"""experiments in one plan"""


@dataclass(frozen=True)
class Part:
    """One experiment of a plan.

    Attributes
    ----------
    name, says : str
    displacement, current : str
        Inline TOML tables, as in `quartercar rig --template`.
    duration : float
        [s].
    replicates : int
        Runs; with a constant current one for each level.
    """

    name: str
    says: str
    displacement: str
    current: str
    duration: float = 30.0
    replicates: int = 1

    def toml(self, causes: tuple[str, ...]) -> str:
        """Its lines in a plan."""
        lines = [f"# {self.says}: {', '.join(causes)}", "[[experiments]]", f'name = "{self.name}"',
                 f"displacement = {{ {self.displacement} }}", f"current = {{ {self.current} }}",
                 f"duration = {self.duration:g}", f"replicates = {self.replicates}"]
        return "\n".join(lines)


_ROAD = 'kind = "road"'
_TRIANGLE = 'kind = "triangle", amplitude = "12 mm", frequency = "3.7 Hz"'
_MULTISINE = 'kind = "multisine", rms = "3 mm"'
_RANDOM = 'kind = "aprbs", clock = 0.03'
_OFF = 'kind = "constant", levels = [0.0]'
_LEVELS = 'kind = "constant", levels = [0.0, 0.6, 1.2, 1.8, 2.5]'
_THREE = 'kind = "constant", levels = [0.0, 1.2, 2.5]'

CREEP = Part("creep", "slow triangle, only friction and gas are left", 'kind = "creep", amplitude = "10 mm", '
             'speed = "2 mm/s"', _OFF, 60.0)
SPEEDS = Part("speeds", "a sweep of small strokes through all speeds", 'kind = "chirp", f_start = 0.1, f_end = 4.0, '
              'amplitude = "12 mm", peak_velocity = 0.25', _OFF, 60.0)
FAST = Part("fast", "large strokes at high speed, no current", 'kind = "sine", amplitude = "35 mm", '
            'frequency = "4 Hz"', _OFF, 20.0)
STEPS = Part("steps", "current steps of many heights, up and down, while the piston moves", _TRIANGLE, _RANDOM, 40.0)
RANDOM = Part("random", "road with a random current", _ROAD, _RANDOM, 40.0)
FULL_RANGE = Part("levels", "the same motion at five currents over the full range", _MULTISINE, _LEVELS, 15.0, 5)
SWEEP = Part("sweep", "frequency sweep of small amplitude at three currents", 'kind = "chirp", f_start = 0.5, '
             'f_end = 40.0, amplitude = "3 mm", peak_velocity = 0.15', _THREE, 20.0, 3)
LARGE_SWEEP = Part("large-sweep", "frequency sweep of large amplitude at three currents", 'kind = "chirp", '
                   'f_start = 0.5, f_end = 15.0, amplitude = "20 mm", peak_velocity = 0.5', _THREE, 20.0, 3)
HEATING = Part("heating", "one motion repeated for minutes, so that the damper heats up", 'kind = "sine", '
               'amplitude = "20 mm", frequency = "3 Hz"', 'kind = "stepped", levels = [1.5, 0.2, 1.5, 0.2, 1.5]', 150.0)

PLANS: Mapping[str, tuple[Part, ...]] = {
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
    "scheduling-degree": (FULL_RANGE,), "model-order": (SWEEP,), "input-nonlinearity": (SPEEDS, FAST),
}
"""What makes a cause visible. A constant offset of the load cell is the same as a gas preload in every run: for those
two, for what was not logged and for a car there is no plan here."""


def plan_for(found: Diagnosis) -> Proposal | None:
    """A plan for what a diagnosis left open: its rivals if it has some, else the candidates that it could not reveal.

    Examples
    --------
    >>> sorted(PLANS["coil-lag"][0].toml(("coil-lag",)).splitlines())[0]
    '# current steps of many heights, up and down, while the piston moves: coil-lag'
    """
    rivals = tuple(dict.fromkeys(n for r in found.rivals for n in r.names))
    wanted = [n for n in (rivals or open_questions(found)) if n in PLANS]
    by_part: dict[Part, list[str]] = {}
    for name in wanted:
        for part in PLANS[name]:
            by_part.setdefault(part, []).append(name)
    parts = list(by_part)[:MOST_PARTS]
    if not parts:
        return None
    served = tuple(dict.fromkeys(n for p in parts for n in by_part[p]))
    purpose = f"tell {' from '.join(rivals)}" if len(rivals) > 1 else f"reveal {', '.join(served)}"
    head = [f"# To {purpose}.", "# Run on the virtual rig by `quartercar rig experiment.toml --out DIR`; on a real rig "
            "impose the same motion and current.", "seed = 1", ""]
    text = "\n".join(head) + "\n\n".join(p.toml(tuple(by_part[p])) for p in parts) + "\n"
    return Proposal(text, "; ".join(p.says for p in parts) + f": to {purpose}", served)
