"""The report of `quartercar design`: what was asked, what the closed loop was shown to do, how it rides a bump."""

from __future__ import annotations

from collections.abc import Sequence

from lpvid.report import Figure, Mark, Notes, Page, Paragraph, Section, Table, number
from quartercar.designing import Design
from quartercar.designing_identified import IdentifiedDesign
from quartercar.plot import designing as plot
from quartercar.report_fit import Drawn
from quartercar.riding import Ride


def design_figures(found: Design | IdentifiedDesign, rides: tuple[Ride, Ride] | None) -> tuple[Drawn, ...]:
    """The figures of a design; without a controller its weights alone."""
    drawn = [Drawn("weights", plot.weights(found), "The weights: a signal counts as one where its amplitude times this "
                   "gain is one.")]
    if rides is not None:
        drawn += [Drawn("gains", plot.gains(found), f"From the road's elevation to the car. {found.shares}"),
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
    drawn = {f.name: Figure.of(f.figure, f.caption) for f in figures}
    s, law = found.synthesis, found.law
    asked = Table(("weight", "value", "unit", "meaning"),
                  tuple((p.name, number(law.values[p.name]), p.unit or "1", p.says) for p in law.parameters),
                  "Each level counts as much as 1 m/s² of the body's acceleration in the comfort band.", (1,))
    sections = [Section("What was asked for", (asked, drawn["weights"]))]
    if found.plant_rows:
        sections.append(Section("The plant", (Table(("", ""), found.plant_rows, "The identified damper in the car: one "
                                                    "filter about a frozen current, and the force that the current "
                                                    "adds as control. Replays in free run, against the nonlinear car, "
                                                    "as shares of the rms of the worst state."),)))
    shown = (("verdict", s.verdict), ("promised by the inequalities", number(s.gamma)),
             ("verified of the closed loop", number(s.gamma_verified)), ("reached at some frozen scheduling",
                                                                         number(s.gamma_lower)),
             ("holds", "on the whole box" if s.between_grid else "at grid points only"), ("found by", s.solver),
             ("method", s.method))
    told = (Paragraph(found.verdict, strong=True), Table(("", ""), tuple((a, b) for a, b in shown)),
            *((Notes(s.notes),) if s.notes else ()))
    sections.append(Section("What the closed loop does", (*told, *((drawn["gains"],) if "gains" in drawn else ()))))
    if rides is not None:
        rows = tuple((name, number(r.figures.comfort), number(r.figures.tyre_load),
                      number(1e3 * r.figures.largest_stroke, 3)) for name, r in
                     zip(("controlled", "passive"), rides, strict=True))
        table = Table(("car", "comfort [m/s²]", "tyre load [N]", "largest stroke [mm]"), rows, "One ride, one seed: "
                      "`quartercar ride` compares laws with intervals.", (1, 2, 3))
        sections.append(Section("Over a bump", (table, drawn["bump"])))
    mark: Mark = "good" if s.solved else "bad"
    return Page("Suspension controller", found.verdict, mark, found.facts, found.caveats, tuple(sections))

