"""The report of `quartercar design`: what was asked, what the closed loop was shown to do, how it rides a bump."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.export.exportable import has_step
from lpvid.report import OUT, Mark, NextStep, Notes, Page, PageFigure, PageTable, Paragraph, Section, Traces, number
from lpvid.report.courses import signal_traces
from lpvid.report.formatting import percent
from lpvid.report.synthesis import gains_item, limit_items
from quartercar.design import plot
from quartercar.design.identified import IdentifiedDesign
from quartercar.design.nominal import Design
from quartercar.plot.rides import signal_panels
from quartercar.report.fit import Drawn
from quartercar.rides.simulation import Ride


def design_figures(found: Design | IdentifiedDesign, rides: tuple[Ride, Ride] | None) -> tuple[Drawn, ...]:
    """The figures of a design; without a controller its weights alone.

    Parameters
    ----------
    found : Design or IdentifiedDesign
        Solved or not.
    rides : (Ride, Ride) or None
        As `Design.bump` gives them; None without a controller.

    Returns
    -------
    tuple of Drawn
        Weights, and with rides gains, sensitivity, use of the actuator and the bump.
    """
    drawn = [Drawn("weights", plot.weights(found), "The weights: a signal counts as one where its amplitude times this "
                   "gain is one.")]
    if rides is not None:
        drawn += [Drawn("gains", plot.gains(found), f"From the road's elevation to the car. {found.shares}"),
                  Drawn("sensitivity", plot.sensitivity(found), "Sensitivity: gain from the road with control over "
                        "that of the car without; below one control helps, above one it costs."),
                  Drawn("actuator", plot.actuator_use(found, rides[0]), "Use of the actuator over the bump: the "
                        "damper's force within what its lowest and highest command give at constant velocity, and how "
                        "long each current is held; dashed, the limits of the command."),
                  Drawn("bump", plot.bump(rides), f"The nonlinear car over {rides[0].road}, with sensors, observer, "
                        "inverse damper model and coil in the loop.")]
    return tuple(drawn)


def design_page(found: Design | IdentifiedDesign, figures: Sequence[Drawn], rides: tuple[Ride, Ride] | None) -> Page:
    """A page about a design.

    Parameters
    ----------
    found : Design or IdentifiedDesign
    figures : sequence of Drawn
        As `design_figures` gives them.
    rides : (Ride, Ride) or None
        As `Design.bump` gives them; None without a controller.

    Returns
    -------
    Page
    """
    drawn = {f.name: PageFigure.of(f.figure, f.caption) for f in figures}
    s, law = found.synthesis, found.law
    asked = PageTable(("weight", "value", "unit", "meaning"),
                  tuple((p.name, number(law.values[p.name]), p.unit or "1", p.description) for p in law.parameters),
                  "Each level counts as much as 1 m/s² of the body's acceleration in the comfort band.", (1,))
    sections = [Section("What was requested", (asked, drawn["weights"]))]
    if found.plant_rows:
        sections.append(
            Section(
                "The plant",
                (
                    PageTable(
                        ("", ""),
                        found.plant_rows,
                        "The identified damper in the car: one "
                        "filter about a frozen current, and the force that the current "
                        "adds as control. Replays in free run, against the nonlinear car, "
                        "as shares of the rms of the worst state.",
                    ),
                ),
            )
        )
    shown = (("verdict", s.verdict), ("promised by the inequalities", number(s.gamma)),
             ("verified for the closed loop", number(s.gamma_verified)), ("reached at some frozen scheduling",
                                                                         number(s.gamma_lower)),
             ("holds", "on the whole box" if s.between_grid else "at grid points only"), ("found by", s.solver),
             ("method", s.method))
    described = (Paragraph(found.verdict, strong=True), PageTable(("", ""), tuple((a, b) for a, b in shown)),
            *((Notes(s.notes),) if s.notes else ()))
    curves = [drawn[n] for n in ("gains", "sensitivity") if n in drawn]
    sections.append(Section("What the closed loop does", (*described, *curves)))
    if s.closed_loop is not None and s.controller is not None:
        sections += [Section("What limits the design", tuple(limit_items(s))),
                     Section("The controller", (gains_item(s.controller),))]
    if rides is not None:
        rows = tuple((name, number(r.figures.comfort), number(r.figures.tyre_load),
                      number(1e3 * r.figures.largest_stroke, 3)) for name, r in
                     zip(("controlled", "passive"), rides, strict=True))
        table = PageTable(
            ("car", "comfort [m/s²]", "tyre load [N]", "largest stroke [mm]"),
            rows,
            "One ride, one seed: `quartercar ride` compares laws with intervals.",
            (1, 2, 3),
        )
        sections.append(Section("Over a bump", (table, _bump(rides))))
        sections.append(Section("Use of the actuator", (_use(rides[0]), drawn["actuator"])))
    mark: Mark = "good" if s.solved else "bad"
    return Page("Suspension controller", found.verdict, mark, found.facts, found.caveats, tuple(sections),
                _steps(found))


def _bump(rides: tuple[Ride, Ride]) -> Traces:
    """The whole ride over the bump, controlled and passive."""
    runs = {"controlled": rides[0].run, "passive, lowest current": rides[1].run}
    return signal_traces(rides[0].run.time, signal_panels(runs),
                         f"The nonlinear car over {rides[0].road}, with sensors, observer, inverse damper model and "
                         "coil in the loop.", roles=("other-2", "measured"))


def _use(ride: Ride) -> PageTable:
    current, unit = ride.run["current"], ride.run.units["current"]
    rows = (("current, mean", number(float(current.mean()), 4, unit)),
            ("current, rms", number(float(np.sqrt(np.mean(current**2))), 4, unit)),
            ("command at a limit", percent(ride.at_limits)),
            ("demand that the damper could not meet", percent(ride.out_of_reach)),
            ("damper force, largest", number(float(np.abs(ride.run["damper_force"]).max()), 4, "N")),
            ("energy taken by the damper", number(ride.passivity.dissipated, 4, "J")))
    return PageTable((), rows, "Shares are of the samples of the ride over the bump.")


def _steps(found: Design | IdentifiedDesign) -> tuple[NextStep, ...]:
    if not found.synthesis.solved:
        return (
            (NextStep(f"{found.synthesis.mend[:1].upper()}{found.synthesis.mend[1:]}."),)
            if found.synthesis.mend
            else ()
        )
    leaving = (NextStep("Take the loop law to a control unit.", f"quartercar export --controller {OUT}/controller.json "
                    "--to c --out exported"),) if has_step(found.controller) else ()
    return (NextStep("Compare it with other laws on rough roads, with intervals.", f"quartercar ride --controller "
                 f"passive,skyhook,{OUT}/controller.json --seeds 8 --out ride"),
            NextStep("Tune the weights on rides.", "quartercar design --tune 40 --out tuned"),
            NextStep("Let anyone check the certificate without a solver.",
                 f"lpvid verify {OUT}/certificate.json {OUT}/closed_loop.json"), *leaving)

