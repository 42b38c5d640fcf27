"""The synthesis report: what was promised, what the closed loop does, and the controller."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from lpvid.analysis.frozen_norms import largest_frozen_norm
from lpvid.analysis.worst_case import WorstCase, worst_trajectory
from lpvid.lmi.driven import driven
from lpvid.lmi.hull_certificate import HullCertificate
from lpvid.lmi.readings import box_of
from lpvid.model.hull import corners_of, hull_of
from lpvid.model.state_space import LPVStateSpace
from lpvid.plot.controllers import controller_gains
from lpvid.plot.controllers import worst_trajectory as trajectory
from lpvid.plot.synthesis import frozen_gains, step_responses, weighted_channels
from lpvid.report.formatting import number, percent
from lpvid.report.page import OUT, Item, Mark, NextStep, Notes, Page, PageFigure, PageTable, Paragraph, Section
from lpvid.synthesis.design_log import limiting, limits
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.result import Synthesis
from lpvid.units import quotient


def synthesis_page(result: Synthesis, plant: GeneralizedPlant, name: str,
                   weights: Mapping[str, LPVStateSpace | float] | None = None) -> Page:
    """A page about a design.

    Parameters
    ----------
    result : Synthesis
    plant : GeneralizedPlant
        With its weights.
    name : str
        What to call the plant.
    weights : mapping of str to LPVStateSpace or float, optional
        Of the performance signals, where they are known apart from the plant.

    Returns
    -------
    Page
        Without closed loop and controller where the design failed.
    """
    facts = [("verdict", result.verdict), ("verified gain", number(result.gamma_verified, 5)),
             ("promised by the inequalities", number(result.gamma, 5)),
             ("reached by the loop", number(result.gamma_lower, 5)), ("time", number(result.seconds, 3, "s"))]
    caveats = [] if result.between_grid or not result.solved else [
        "The bound is shown at the points of a grid only, not between them."]
    sections = [Section("The design", tuple(_design(result, plant)))]
    if result.closed_loop is not None and result.controller is not None:
        sections = [Section("What limits the design", tuple(limit_items(result))),
                    Section("Closed loop", tuple(_figures(result, weights or {}))), *sections,
                    Section("The controller", tuple(_controller(result)))]
    return Page(f"Controller for {name}", verdict(result, plant), _mark(result), tuple(facts), tuple(caveats),
                tuple(sections), _steps(result))


def verdict(result: Synthesis, plant: GeneralizedPlant) -> str:
    """The verified gain in a sentence, or why there is no controller.

    Parameters
    ----------
    result : Synthesis
        Solved or not.
    plant : GeneralizedPlant
        With the names of its disturbances and performance signals.

    Returns
    -------
    str
        With what to do where the result states it.
    """
    stated = f"{result.verdict.capitalize()}: {result.why or result.method}."
    if result.gamma_verified is not None:
        where = f"on the whole scheduling {result.region}" if result.between_grid else "at the points of a grid only"
        moving = " while the scheduling moves" if plant.box.names else ""
        stated = (f"{result.verdict.capitalize()}: the weighted gain from {', '.join(plant.disturbances)} to "
                f"{', '.join(plant.performance)} is at most {number(result.gamma_verified, 4)}{moving}, "
                f"verified for the closed loop {where}."
                + ("" if result.gamma_lower is None else f" The largest gain found in it is "
                   f"{number(result.gamma_lower, 4)}.")
                + f" Method: {result.method or 'matrix inequalities'}.")
    return stated + (f" What to do: {result.mend}." if result.mend else "")


def _steps(result: Synthesis) -> tuple[NextStep, ...]:
    if not result.solved:
        return (NextStep(f"{result.mend.capitalize()}.") if result.mend else
                NextStep("Relax a weight, or bound the rate of the scheduling, and try again."),)
    return (NextStep("Let anyone check the certificate without a solver.",
                 f"lpvid verify {OUT}/certificate.json {OUT}/closed_loop.json"),
            _taking(result))


def _taking(result: Synthesis) -> NextStep:
    """How the controller leaves: a continuous one at the rate of the control unit."""
    continuous = result.controller is not None and getattr(result.controller, "sample_time", None) is None
    at = " --sample-rate HZ" if continuous else ""
    return NextStep(f"Take the controller to a control unit{', at its rate HZ' if continuous else ''}.",
                f"lpvid export {OUT}/controller.json --to c{at} --out exported")


def _mark(result: Synthesis) -> Mark:
    if not result.solved:
        return "bad"
    return "good" if result.verdict == "solved" and result.between_grid else "warn"


def _figures(result: Synthesis, weights: Mapping[str, LPVStateSpace | float]) -> list[Item]:
    loop = result.closed_loop
    assert loop is not None
    across = "" if not loop.box.names else " One curve for each scheduling point across the range."
    known = [n for n in weights if n in [s.name for s in loop.outputs]]
    items: list[Item] = [
        PageFigure.of(
            frozen_gains(loop, result.gamma_verified),
            "Gain from the disturbances to the performance signals, "
            "with the scheduling held still: no frozen curve may exceed the verified bound." + across,
            "Closed-loop gain over frequency",
        ),
        PageFigure.of(
            step_responses(loop),
            "Responses to a unit step in each disturbance, with the scheduling held still." + across,
            "Step responses of the closed loop",
        ),
    ]
    if known and result.gamma_verified is not None:
        items.insert(
            1,
            PageFigure.of(
                weighted_channels(loop, weights, result.gamma_verified),
                "Gain to each performance "
                "signal before its weight, the scheduling held still; dashed, the inverse of the "
                "weight times the verified bound, which no curve may cross. Where they touch, this "
                f"signal decides the design.{across}",
                "Gains against the inverse weights",
            ),
        )
    if result.certificate is not None:
        claim = str(getattr(result.certificate, "claim", result.certificate))
        items.append(Paragraph(f"{claim[:1].upper()}{claim[1:]}. `lpvid verify certificate.json "
                               "closed_loop.json` re-checks it without a solver."))
    return items


def limit_items(result: Synthesis) -> list[Item]:
    """The design log: which performance signals make up the gain where, and the worst scheduling that was found.

    Parameters
    ----------
    result : Synthesis
        With a closed loop.

    Returns
    -------
    list of Item
        A sentence, a table, and the worst course of the scheduling where one was found.
    """
    loop = result.closed_loop
    assert loop is not None
    found = limits(loop)
    rows = tuple((x.where or "–", number(x.gain, 4), x.speed, _shares(x.signals[:3]), _shares(x.disturbances[:2]))
                 for x in found)
    stated = limiting(found, result.gamma_verified)
    items: list[Item] = [
        Paragraph(stated[:1].upper() + stated[1:] + ".", strong=True),
        PageTable(
            ("scheduling held at", "gain", "at", "made up of", "caused by"),
            rows,
            "Shares of "
            "‖z‖² and ‖w‖² at the frequency of the largest gain: a weight is active where its "
            "signal has a share.",
            (1,),
        ),
    ]
    worst = _worst(loop)
    if worst is None or worst.kind == "frozen":
        return items + ([] if worst is None else [Paragraph(f"No moving scheduling was found that gives a larger "
                                                            f"gain than the worst one held still: "
                                                            f"{number(worst.gain, 4)}, {worst}.")])
    return [
        *items,
        PageFigure.of(
            trajectory(worst),
            f"One period of the scheduling with the largest gain that was found, "
            f"{number(worst.gain, 4)}: {worst}. A search can only underestimate.",
            "Worst trajectory of the scheduling",
        ),
    ]


def _shares(signals: tuple[tuple[str, float], ...]) -> str:
    return ", ".join(f"{n} {percent(share)}" for n, share in signals if share >= 0.01)


def gains_item(controller: LPVStateSpace) -> Item:
    """The controller's gains over frequency and scheduling; a table where neither changes them.

    Parameters
    ----------
    controller : LPVStateSpace
        From measurements to controls.

    Returns
    -------
    PageFigure or PageTable
        With its caption.
    """
    if not controller.order and not controller.box.names:
        d = controller.frozen(())[3]
        heads = tuple(f"{s.name} [{s.unit or '1'}]" for s in controller.outputs)
        rows = tuple((f"{s.name} [{s.unit or '1'}]", *(number(v, 4) for v in d[:, j]))
                     for j, s in enumerate(controller.inputs))
        return PageTable(("from", *heads), rows, "Gains from measurements to controls, constant.",
                         tuple(range(1, 1 + len(heads))))
    return PageFigure.of(controller_gains(controller), "Gains from measurements to controls, the scheduling held still"
                     + ("; right, over the scheduling." if controller.box.names else "."), "Gains of the controller")


def _worst(loop: LPVStateSpace) -> WorstCase | None:
    """Of moving schedulings and held ones; None where nothing moves, or on a hull: the search is over boxes."""
    if not loop.box.half_width.any() or hull_of(loop) is not None:
        return None
    system = driven(loop)
    box = box_of(system.readings, loop.box)
    gain, point, frequency = largest_frozen_norm(system, box)
    return worst_trajectory(system, box, WorstCase.frozen(box, point, frequency, gain))


def _design(result: Synthesis, plant: GeneralizedPlant) -> list[Item]:
    box = plant.box
    rows = [("method", result.method or "–"), ("disturbances", ", ".join(plant.disturbances)),
            ("performance signals", ", ".join(plant.performance)), ("controls", ", ".join(plant.controls)),
            ("measurements", ", ".join(plant.measurements)), ("states of plant and weights", str(plant.order)),
            ("time", "continuous" if plant.sample_time is None else f"discrete, {plant.sample_time:g} s")]
    for n, low, high, rate, unit in zip(box.names, box.lower, box.upper, box.rate, box.units, strict=True):
        speed = "arbitrarily fast" if rate is None else f"at most {number(rate, 4, quotient(unit, 's'))}"
        rows.append((f"scheduling: {n}", f"{number(low)} … {number(high, 4, unit)}, {speed}"))
    if result.region == "polytope":
        held = result.certificate
        named, at = held.names if isinstance(held, HullCertificate) else held.box.names, held.vertices
        rows += [(f"polytope: {n}", f"{number(low)} … {number(high)}, {len(at)} vertices")
                 for n, low, high in zip(named, at.min(axis=0), at.max(axis=0), strict=True)]
    items: list[Item] = [PageTable((), tuple(rows), "")]
    return [*items, Notes(result.notes)] if result.notes else items


def _controller(result: Synthesis) -> list[Item]:
    k = result.controller
    assert k is not None
    rows = []
    for p in corners_of(k, 4):
        where = ", ".join(f"{n} = {v:.4g}" for n, v in zip(k.box.names, p, strict=True)) or "–"
        rows.append((where, "; ".join(modes(k.frozen_poles(p), k.sample_time)) or "no states"))
    return [
        Paragraph(repr(k)),
        gains_item(k),
        PageTable(
            ("at", "frozen poles: frequency and damping ratio"),
            tuple(rows),
            "Poles of the controller itself; a complex pair counts once.",
        ),
    ]


def modes(poles: np.ndarray, sample_time: float | None) -> list[str]:
    """Poles as natural frequency [Hz] and damping ratio, slowest first.

    s = −ζω₀ ± jω₀√(1−ζ²), f = ω₀/2π; poles z of discrete time by s = ln(z)/T.

    Parameters
    ----------
    poles : (n,) complex array
        Conjugate pairs complete; of a pair one is kept.
    sample_time : float or None
        Period [s]; None for poles of continuous time [rad/s].

    Returns
    -------
    list of str
        One per pair or real pole; an unstable one has a negative ζ.

    Examples
    --------
    >>> modes(np.array([-1 + 1j, -1 - 1j, -20 * np.pi]), None)
    ['0.2251 Hz, ζ 0.707', '10 Hz, ζ 1']
    """
    s = np.asarray(poles, dtype=complex)
    if sample_time is not None:
        s = np.log(np.where(np.abs(s) > 1e-12, s, 1e-12)) / sample_time
    s = s[np.imag(s) >= -1e-9 * np.abs(s)]
    listed = []
    for pole in sorted(s, key=abs):
        size = abs(pole)
        ratio = -pole.real / size if size else 1.0
        listed.append(f"{number(size / (2 * np.pi), 4)} Hz, ζ {number(ratio, 3)}")
    return listed
