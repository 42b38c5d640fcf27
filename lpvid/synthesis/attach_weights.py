"""Weights attached to a generalised plant, signal by signal."""

from __future__ import annotations

from collections.abc import Mapping

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.interconnection import connect
from lpvid.synthesis.joining import gain

Weight = LPVStateSpace | float
"""A system of one input and one output, or a plain factor."""


def weigh(plant: GeneralizedPlant, inputs: Mapping[str, Weight] | None = None,
          outputs: Mapping[str, Weight | tuple[str, Weight]] | None = None) -> GeneralizedPlant:
    """The plant with weights in front of inputs and behind outputs; every signal keeps its name.

    Weighed disturbances and performance signals are pure numbers, weighed controls and measurements keep their unit.

    ::

               ┌────┐   ┌───────┐   ┌────┐
        road ─>│ Wr │──>│ plant │──>│ Wz │─> comfort         outputs={"comfort": Wz}
               └────┘   │       │   └────┘
       force ──────┬───>│       │──> sensor
                   │    └───────┘   ┌────┐
                   └───────────────>│ Wu │─> effort          outputs={"effort": ("force", Wu)}: a new signal
                                    └────┘

    Parameters
    ----------
    plant : GeneralizedPlant
    inputs : mapping of name to weight, optional
        In front of disturbances, and of controls (a prefilter or an actuator: the controller then drives the weight).
    outputs : mapping of name to weight, or to (signal, weight), optional
        Behind performance signals and measurements; with a pair, a further performance signal made from any input (as
        it enters the plant) or output (before its weight).

    Returns
    -------
    GeneralizedPlant

    Raises
    ------
    InputError
        Unknown signals, weights of more than one input or output, unequal clocks.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> from lpvid.synthesis.weights import lowpass
    >>> system = LPVStateSpace([[[-1.0]]], [[[1.0, 1.0]]], [[[1.0], [1.0]]], [[[0.0, 1.0], [1.0, 0.0]]],
    ...                        Polynomial((), 0), None, inputs=("road", "force"), outputs=("comfort", "sensor"))
    >>> plant = GeneralizedPlant(system, ("force",), ("sensor",))
    >>> weighed = weigh(plant, {"road": 0.07}, {"comfort": lowpass(2.0, 10.0), "effort": ("force", 0.01)})
    >>> weighed.performance, weighed.order
    (('comfort', 'effort'), 2)
    """
    inputs, outputs = dict(inputs or {}), dict(outputs or {})
    system = plant.system
    names_in, names_out = [s.name for s in system.inputs], [s.name for s in system.outputs]
    for name in inputs:
        _checks.known_name(name, names_in, "input of the plant")
    blocks, wires = [], {}
    for name, weight in inputs.items():
        unit = system.inputs[names_in.index(name)].unit
        blocks.append(_named(weight, Signal(name, unit if name in plant.controls else ""), Signal(_inner(name), unit)))
    for name, entry in outputs.items():
        source, weight = entry if isinstance(entry, tuple) else (name, entry)
        if isinstance(entry, tuple):
            _checks.known_name(source, [*names_in, *names_out], "signal of the plant")
            if name in (*names_in, *names_out):
                raise InputError(f"the plant already has a signal '{name}'", mend="name the new signal otherwise")
        else:
            _checks.known_name(name, names_out, "output of the plant",
                               "give (signal, weight) to make a new performance signal")
        inside = source in inputs or (source in outputs and not isinstance(outputs[source], tuple))
        unit = system.outputs[names_out.index(name)].unit if name in plant.measurements else ""
        blocks.append(_named(weight, Signal(f"{name}.in"), Signal(name, unit)))
        wires[f"{name}.in"] = {_inner(source) if inside else source: 1.0}
    plain = [n for n, e in outputs.items() if not isinstance(e, tuple)]
    core = system.replace(inputs=tuple(_renamed(s, inputs) for s in system.inputs),
                          outputs=tuple(_renamed(s, plain) for s in system.outputs))
    whole = connect([core, *blocks], names_in, [*names_out, *(n for n in outputs if n not in names_out)], wires)
    return GeneralizedPlant(whole, plant.controls, plant.measurements)


def _inner(name: str) -> str:
    return f"{name}.plant"


def _renamed(signal: Signal, weighed) -> Signal:
    return Signal(_inner(signal.name), signal.unit) if signal.name in weighed else signal


def _named(weight: Weight, source: Signal, output: Signal) -> LPVStateSpace:
    """The weight between two signals."""
    name = source.name
    if not isinstance(weight, LPVStateSpace):
        return gain([[_checks.real(weight, f"the weight of '{name}'")]], [source], [output])
    if len(weight.inputs) != 1 or len(weight.outputs) != 1:
        raise InputError(f"the weight of '{name}' must have one input and one output",
                         got=f"{len(weight.inputs)} and {len(weight.outputs)}", mend="weigh every signal on its own")
    return weight.replace(inputs=(source,), outputs=(output,))
