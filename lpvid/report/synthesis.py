"""The synthesis report: what was promised, what the closed loop does, and the controller."""

from __future__ import annotations

from lpvid.plot.synthesis import frozen_gains, step_responses
from lpvid.report.page import Figure, Item, Mark, Notes, Page, Paragraph, Section, Table, number
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.result import Synthesis


def synthesis_page(result: Synthesis, plant: GeneralizedPlant, name: str) -> Page:
    """A page about a design.

    Parameters
    ----------
    result : Synthesis
    plant : GeneralizedPlant
        With its weights.
    name : str
        What to call the plant.
    """
    facts = [("verdict", result.verdict), ("verified gain", number(result.gamma_verified, 5)),
             ("promised by the inequalities", number(result.gamma, 5)),
             ("reached by the loop", number(result.gamma_lower, 5)), ("time", number(result.seconds, 3, "s"))]
    caveats = [] if result.between_grid or not result.solved else [
        "The bound is shown at the points of a grid only, not between them."]
    sections = [Section("The design", tuple(_design(result, plant)))]
    if result.closed_loop is not None and result.controller is not None:
        sections = [Section("Closed loop", tuple(_figures(result))), *sections,
                    Section("The controller", tuple(_controller(result)))]
    verdict = f"{result.verdict}: {result.why or result.method}."
    if result.mend:
        verdict += f" What to do: {result.mend}."
    return Page(f"Controller for {name}", verdict, _mark(result), tuple(facts), tuple(caveats), tuple(sections))


def _mark(result: Synthesis) -> Mark:
    if not result.solved:
        return "bad"
    return "good" if result.verdict == "solved" and result.between_grid else "warn"


def _figures(result: Synthesis) -> list[Item]:
    loop = result.closed_loop
    assert loop is not None
    across = "" if not loop.box.names else " One curve for each scheduling point across the range."
    items: list[Item] = [
        Figure.of(frozen_gains(loop, result.gamma_verified), "Gain from the disturbances to the performance signals, "
                  "with the scheduling held still: no frozen curve may exceed the verified bound." + across,
                  "Closed-loop gain over frequency"),
        Figure.of(step_responses(loop), "Responses to a unit step in each disturbance, with the scheduling held still."
                  + across, "Step responses of the closed loop")]
    if result.certificate is not None:
        items.append(Paragraph(str(getattr(result.certificate, "claim", result.certificate)) + ". `lpvid verify "
                               "certificate.json closed_loop.json` re-checks it without a solver."))
    return items


def _design(result: Synthesis, plant: GeneralizedPlant) -> list[Item]:
    box = plant.box
    rows = [("method", result.method or "–"), ("disturbances", ", ".join(plant.disturbances)),
            ("performance signals", ", ".join(plant.performance)), ("controls", ", ".join(plant.controls)),
            ("measurements", ", ".join(plant.measurements)), ("states of plant and weights", str(plant.order)),
            ("time", "continuous" if plant.sample_time is None else f"discrete, {plant.sample_time:g} s")]
    for n, low, high, rate, unit in zip(box.names, box.lower, box.upper, box.rate, box.units, strict=True):
        speed = "arbitrarily fast" if rate is None else f"at most {number(rate, 4, (unit or '1') + '/s')}"
        rows.append((f"scheduling: {n}", f"{number(low)} … {number(high, 4, unit)}, {speed}"))
    items: list[Item] = [Table((), tuple(rows), "")]
    return [*items, Notes(result.notes)] if result.notes else items


def _controller(result: Synthesis) -> list[Item]:
    k = result.controller
    assert k is not None
    points = k.box.grid(2)[:4]
    rows = []
    for p in points:
        poles = k.frozen_poles(p)
        where = ", ".join(f"{n} = {v:.4g}" for n, v in zip(k.box.names, p, strict=True)) or "–"
        listed = ", ".join(f"{x.real:.4g}{x.imag:+.4g}j" if abs(x.imag) > 1e-9 else f"{x.real:.4g}" for x in poles[:8])
        rows.append((where, listed or "no states"))
    return [Paragraph(repr(k)), Table(("at", "frozen poles"), tuple(rows), "Poles of the controller itself.")]
