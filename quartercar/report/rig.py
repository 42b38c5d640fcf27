"""The report of `quartercar rig`: what was run and what was on, then the audit of the records."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

from lpvid.auditing import Audit
from lpvid.record import Record
from lpvid.report import OUT, Item, NextStep, Page, PageTable, Paragraph, Section, number
from lpvid.report.inspection import inspection_page
from quartercar.rig.causes import find_cause
from quartercar.rig.plan import Plan


def rig_page(plan: Plan, audit: Audit, records: Sequence[Record]) -> Page:
    """A page about virtual measurements.

    Parameters
    ----------
    plan : Plan
    audit : Audit
        Of the records.
    records : sequence of Record

    Returns
    -------
    Page
    """
    page = inspection_page(audit, records)
    on = [e for e in plan.rig.effects if e.strength > 0]
    effects = ", ".join(e.name for e in on) or "none"
    verdict = (f"{len(records)} virtual records of {len(plan.experiments)} experiments at {plan.rig.sample_rate:g} Hz, "
               f"seed {plan.seed}; effects that are on: {effects}. Audit: {audit.verdict}.")
    sections = (Section("The plan", (_experiments(plan),)), Section("Effects that are on", tuple(_effects(plan))),
                Section("Damper and sensors", (_numbers(plan),)), *page.sections)
    return replace(page, title="Virtual rig", verdict=verdict, sections=sections, steps=_steps(bool(on)),
                   facts=(*page.facts, ("effects on", str(len(on))), ("seed", str(plan.seed))),
                   caveats=("These records are simulated: they test methods, not a real damper.",
                            *page.caveats))


def _steps(effects: bool) -> tuple[NextStep, ...]:
    asked = "the effects that are on" if effects else "nothing, as no effect is on"
    return (NextStep("Fit damper models and rank them.", f"quartercar fit {OUT} --out fit"),
            NextStep("Identify an LPV model.", f"lpvid identify {OUT} --input velocity --output force --schedule "
                     "current --hold-out 1/3 --out model"),
            NextStep(f"See whether the diagnosis finds {asked}.",
                     f"lpvid diagnose {OUT} --baseline auto --out diagnosis"))


def _experiments(plan: Plan) -> PageTable:
    rows = tuple((e.name, _signal(e.displacement), _signal(e.current), number(e.duration, 4),
                  str(e.replicates), f"{round(e.duration * plan.rig.sample_rate):,}") for e in plan.experiments)
    return PageTable(("experiment", "displacement", "current", "duration [s]", "replicates", "samples of each"), rows,
                 f"At {plan.rig.sample_rate:g} Hz; seed {plan.seed}"
                 + (", with the channels that no sensor sees (_true)." if plan.truth else "."), (3, 4, 5))


def _signal(pattern: Any) -> str:
    """What a signal is, with its numbers."""
    settings = []
    for f in fields(pattern):
        value, unit = getattr(pattern, f.name), f.metadata.get("unit", "")
        values = value if isinstance(value, tuple) else (value,)
        shown = ", ".join(number(v, 4) if isinstance(v, float) else ("no", "yes")[v] if isinstance(v, bool) else str(v)
                          for v in values)
        settings.append(f"{f.name.replace('_', ' ')} {shown} {unit}".rstrip())
    return f"{pattern.kind}: {'; '.join(settings)}" if settings else str(pattern.kind)


def _effects(plan: Plan) -> list[Item]:
    if not plan.rig.effects:
        return [Paragraph("None: the damper and its sensors as they stand below.")]
    rows = []
    for effect in plan.rig.effects:
        cause = find_cause(effect.name)
        units = {n.name: n.unit for n in cause.numbers}
        given = ", ".join(f"{n} {v if isinstance(v, str) else number(v, 4, units.get(n, ''))}"
                          for n, v in effect.parameters.items())
        rows.append((effect.name, number(effect.strength, 4), given or "–", cause.equation))
    return [
        PageTable(
            ("effect", "strength", "parameters", "what it does"),
            tuple(rows),
            "Strength 0 is off, 1 the size "
            "that the parameters give. A diagnosis has to find these from the records alone.",
            (1,),
        )
    ]


def _numbers(plan: Plan) -> PageTable:
    rows = []
    for what, part in (("damper", plan.rig.damper), ("sensors", plan.rig.sensors)):
        for f in fields(part):
            value = getattr(part, f.name)
            shown = ("yes" if value else "no") if isinstance(value, bool) else number(value, 5) if isinstance(
                value, (int, float)) else str(value)
            rows.append((what, f.name.replace("_", " "), shown))
    return PageTable(("part", "number", "value"), tuple(rows), "In SI units; noise of the force as a share of its rms.",
                 (2,), folded="All numbers of the damper and of the sensors")
