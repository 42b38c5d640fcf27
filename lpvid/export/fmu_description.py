"""modelDescription.xml of an exported step, for FMI 2.0 and 3.0."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import numpy as np

from lpvid.export.step_program import Quantity, StepProgram
from lpvid.units import base_exponents

BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
"""Base units of FMI."""
STRUCTURED = 500
"""Variables up to which their names are declared structured: FMPy 0.3.32 parses each such name for some 10 ms."""

IDENTIFIER = re.compile(r"(der\()?[A-Za-z_]\w*(\.[A-Za-z_]\w*)*(\[\d+(,\d+)*\])?\)?", re.ASCII)
"""a structured name of FMI 2.0 (2.2.9) without quotes"""


@dataclass(frozen=True)
class Variable:
    """A scalar variable of an FMU.

    Attributes
    ----------
    name, description, unit : str
    kind : {"input", "output", "state", "parameter", "rate"}
    start : float
    lower, upper : float
    member : str
        Its place in the C instance.
    """

    name: str
    description: str
    unit: str
    kind: str
    start: float
    lower: float
    upper: float
    member: str


def variables(program: StepProgram) -> tuple[Variable, ...]:
    """Inputs, outputs, states, parameters and (of a continuous model) derivatives; entries are ``name[1,2]``.

    Parameters
    ----------
    program : StepProgram
        A period of 0 stands for a continuous model.

    Returns
    -------
    tuple of Variable
        One per entry, in this order of kinds, under distinct names; indices in names count from 1, those in `member`
        from 0.
    """
    groups = (("input", "u", program.inputs), ("output", "y", program.outputs), ("state", "s", program.states),
              ("parameter", "p", program.parameters))
    used: set[str] = {"time"}
    found = tuple(v for kind, member, quantities in groups for q in quantities for v in _scalars(q, kind, member, used))
    if program.sample_time:
        return found
    return found + tuple(_rate(v) for v in found if v.kind == "state")


def _rate(state: Variable) -> Variable:
    """The derivative of a continuous state."""
    unit = f"{state.unit}/s" if state.unit and "/" not in state.unit else ""
    return Variable(f"der({state.name})", f"derivative of: {state.description}", unit, "rate", 0.0, -np.inf, np.inf,
                    "dx" + state.member[1:])


def _scalars(q: Quantity, kind: str, member: str, used: set[str]) -> Iterator[Variable]:
    base = q.label or q.name
    base = base if kind in ("input", "output") or base not in used else q.name
    base = f"{base}_{kind}" if base in used else base
    used.add(base)
    for place in np.ndindex(q.shape):
        name = base + (f"[{','.join(str(i + 1) for i in place)}]" if place else "")
        yield Variable(name, q.description, q.unit, kind, float(q.start[place]), q.lower, q.upper,
                       f"{member}.{q.name}{''.join(f'[{i}]' for i in place)}")


def model_description(program: StepProgram, listed: tuple[Variable, ...], version: int, token: str,
                      step: float = 0.0) -> str:
    """The description, with units, starts and ranges.

    Parameters
    ----------
    program : StepProgram
    listed : tuple of Variable
    version : {2, 3}
    token : str
        What the library compares on instantiation.
    step : float
        Communication step of the default experiment of a continuous model [s].

    Returns
    -------
    str
        Text of modelDescription.xml.
    """
    return _second(program, listed, token, step) if version == 2 else _third(program, listed, token, step)


def _second(program: StepProgram, listed: tuple[Variable, ...], token: str, step: float) -> str:
    from lpvid.export.serialise import package_version

    sampled = bool(program.sample_time)
    kind, step = ("CoSimulation", program.sample_time) if sampled else ("ModelExchange", step)
    fixed = 'canHandleVariableCommunicationStepSize="false" ' if sampled else 'providesDirectionalDerivative="true" '
    a = quoteattr
    out = ['<?xml version="1.0" encoding="UTF-8"?>',
           f'<fmiModelDescription fmiVersion="2.0" modelName={a(program.name)} guid={a(token)} '
           f'description={a(program.description)} generationTool={a("lpvid " + package_version())} '
           f'variableNamingConvention="{_convention(listed)}" numberOfEventIndicators="0">',
           f'  <{kind} modelIdentifier={a(program.name)} {fixed}'
           'canGetAndSetFMUstate="true" canSerializeFMUstate="false" canBeInstantiatedOnlyOncePerProcess="false">',
           "    <SourceFiles>", f'      <File name="{program.name}.c"/>', f'      <File name="{program.name}_fmi2.c"/>',
           "    </SourceFiles>", f"  </{kind}>", *_units(listed),
           f'  <DefaultExperiment startTime="0" stopTime="{_real(1000 * step)}" stepSize="{_real(step)}"/>',
           "  <ModelVariables>"]
    causality, of = _causality(sampled), _derivatives(listed, 1)
    for i, v in enumerate(listed):
        out += [f'    <ScalarVariable name={a(v.name)} valueReference="{i}" description={a(v.description)} '
                f"{causality[v.kind]}>", f"      <Real{_attributes(v)}{of.get(i, '')}/>", "    </ScalarVariable>"]
    outputs = [i + 1 for i, v in enumerate(listed) if v.kind == "output"]
    inputs = " ".join(str(i + 1) for i, v in enumerate(listed) if v.kind == "input")
    needs = f' dependencies="{inputs}"' if inputs and sampled else ""
    unknown = [f'      <Unknown index="{i}"{needs}/>' for i in outputs]
    rates = [f'      <Unknown index="{i + 1}"/>' for i, v in enumerate(listed) if v.kind == "rate"]
    first = [*(f'      <Unknown index="{i}"/>' for i in outputs), *rates]
    rates = ["    <Derivatives>", *rates, "    </Derivatives>"] if rates else []
    out += ["  </ModelVariables>", "  <ModelStructure>", "    <Outputs>", *unknown, "    </Outputs>",
            *rates, "    <InitialUnknowns>", *first, "    </InitialUnknowns>", "  </ModelStructure>",
            "</fmiModelDescription>", ""]
    return "\n".join(out)


def _third(program: StepProgram, listed: tuple[Variable, ...], token: str, step: float) -> str:
    from lpvid.export.serialise import package_version

    sampled = bool(program.sample_time)
    kind, step = ("CoSimulation", program.sample_time) if sampled else ("ModelExchange", step)
    fixed = ('canHandleVariableCommunicationStepSize="false" ' f'fixedInternalStepSize="{_real(step)}" ' if sampled
             else 'providesDirectionalDerivatives="true" ')
    a = quoteattr
    out = ['<?xml version="1.0" encoding="UTF-8"?>',
           f'<fmiModelDescription fmiVersion="3.0" modelName={a(program.name)} instantiationToken={a(token)} '
           f'description={a(program.description)} generationTool={a("lpvid " + package_version())} '
           f'variableNamingConvention="{_convention(listed)}">',
           f'  <{kind} modelIdentifier={a(program.name)} {fixed}canGetAndSetFMUState="true"/>', *_units(listed),
           f'  <DefaultExperiment startTime="0" stopTime="{_real(1000 * step)}" stepSize="{_real(step)}"/>',
           "  <ModelVariables>",
           f'    <Float64 name="time" valueReference="{len(listed)}" causality="independent" '
           'variability="continuous"/>']
    causality, of = _causality(sampled), _derivatives(listed, 0)
    out += [f'    <Float64 name={a(v.name)} valueReference="{i}" description={a(v.description)} {causality[v.kind]}'
            f"{_attributes(v)}{of.get(i, '')}/>" for i, v in enumerate(listed)]
    outputs = [i for i, v in enumerate(listed) if v.kind == "output"]
    inputs = " ".join(str(i) for i, v in enumerate(listed) if v.kind == "input")
    needs = f' dependencies="{inputs}"' if inputs and sampled else ""
    out += ["  </ModelVariables>", "  <ModelStructure>",
            *(f'    <Output valueReference="{i}"{needs}/>' for i in outputs),
            *(f'    <ContinuousStateDerivative valueReference="{i}"/>' for i in of),
            *(f'    <InitialUnknown valueReference="{i}"/>' for i in (*outputs, *of)), "  </ModelStructure>",
            "</fmiModelDescription>", ""]
    return "\n".join(out)


def _causality(sampled: bool) -> dict[str, str]:
    """What a variable of each kind is to an importer."""
    moves, tunable = ("discrete", "tunable") if sampled else ("continuous", "fixed")
    return {"input": 'causality="input" variability="continuous"',
            "output": f'causality="output" variability="{moves}" initial="calculated"',
            "state": f'causality="local" variability="{moves}" initial="exact"',
            "rate": 'causality="local" variability="continuous" initial="calculated"',
            "parameter": f'causality="parameter" variability="{tunable}" initial="exact"'}


def _derivatives(listed: tuple[Variable, ...], first: int) -> dict[int, str]:
    """For the place of every derivative, the attribute that names its state; places count from `first` there."""
    states = [i for i, v in enumerate(listed) if v.kind == "state"]
    rates = [i for i, v in enumerate(listed) if v.kind == "rate"]
    return {r: f' derivative="{s + first}"' for r, s in zip(rates, states if rates else (), strict=True)}


def build_description(program: StepProgram) -> str:
    """buildDescription.xml of the sources in an FMU of FMI 3.0.

    Parameters
    ----------
    program : StepProgram
        Its name is that of the model and of its C files.

    Returns
    -------
    str
        Text of the XML file.
    """
    name = program.name
    return "\n".join(['<?xml version="1.0" encoding="UTF-8"?>', '<fmiBuildDescription fmiVersion="3.0">',
                      f'  <BuildConfiguration modelIdentifier="{name}">', '    <SourceFileSet language="C99">',
                      f'      <SourceFile name="{name}.c"/>', f'      <SourceFile name="{name}_fmi3.c"/>',
                      "    </SourceFileSet>", "  </BuildConfiguration>", "</fmiBuildDescription>", ""])


def _convention(listed: tuple[Variable, ...]) -> str:
    """Structured names let a tool show arrays as such; many are flat, since importers parse each (see `STRUCTURED`).

    So are names of channels that are no identifiers (`motor current`): flat names may be any text.
    """
    plain = all(IDENTIFIER.fullmatch(v.name) for v in listed)
    return "structured" if plain and len(listed) <= STRUCTURED else "flat"


def _attributes(v: Variable) -> str:
    out = f" unit={quoteattr(v.unit)}" if si_base(v.unit) is not None else ""
    if v.kind == "input" and np.isfinite(v.lower) and np.isfinite(v.upper):
        out += f' min="{_real(min(v.lower, v.start))}" max="{_real(max(v.upper, v.start))}"'
    return out if v.kind in ("output", "rate") else f'{out} start="{_real(v.start)}"'


def _units(listed: tuple[Variable, ...]) -> list[str]:
    named = {v.unit: si_base(v.unit) for v in listed}
    known = {unit: base for unit, base in named.items() if base is not None}
    if not known:
        return []
    rows = [f"    <Unit name={quoteattr(unit)}><BaseUnit"
            + "".join(f' {n}="{int(e)}"' for n, e in base.items()) + "/></Unit>" for unit, base in known.items()]
    return ["  <UnitDefinitions>", *rows, "  </UnitDefinitions>"]


def si_base(unit: str) -> dict[str, float] | None:
    """Exponents where FMI can express the unit; None for a pure number and for names that are no SI unit.

    Parameters
    ----------
    unit : str

    Returns
    -------
    dict of str to float, or None
    """
    base = base_exponents(unit) if unit else {}
    return base if base and all(n in BASE and float(e).is_integer() for n, e in base.items()) else None


def _real(value: float) -> str:
    return repr(float(value))
