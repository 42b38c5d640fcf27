"""The report of `quartercar design`: what was asked, what the closed loop was shown to do, how it rides a bump."""

from __future__ import annotations

from collections.abc import Sequence

from lpvid.report import Figure, Mark, Notes, Page, Paragraph, Section, Table, number
from quartercar.designing import Design
from quartercar.plot import designing as plot
from quartercar.report_fit import Drawn
from quartercar.riding import Ride


def design_figures(found: Design, rides: tuple[Ride, Ride] | None) -> tuple[Drawn, ...]:
    """The figures of a design; without a controller its weights alone."""
    drawn = [Drawn("weights", plot.weights(found), "The weights: a signal counts as one where its amplitude times this "
                   "gain is one.")]
    if rides is not None:
        drawn += [Drawn("gains", plot.gains(found), "From the road's elevation to the car, the share ρ of the demand "
                        "that the damper gives frozen at values over its range; dashed: the nominal damping alone."),
                  Drawn("bump", plot.bump(rides), f"The nonlinear car over {rides[0].road}, with sensors, observer, "
                        "inverse damper model and coil in the loop.")]
    return tuple(drawn)


def design_page(found: Design, figures: Sequence[Drawn], rides: tuple[Ride, Ride] | None) -> Page:
    """A page about a design.

    Parameters
    ----------
    found : Design
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
    facts = (("law", law.title), ("measured", law.measured), ("c_nom", f"{found.task.nominal_damping:.0f} N*s/m"),
             ("loop", f"{1 / found.setting.sample_time:.6g} Hz"))
    return Page("Suspension controller", found.verdict, mark, facts, _caveats(found), tuple(sections))


def _caveats(found: Design) -> tuple[str, ...]:
    lines = []
    if found.synthesis.solved and not found.synthesis.between_grid:
        lines.append("The gain is verified at points of a grid of the scheduling only.")
    if found.law.measured == "observed":
        lines.append("The gain is that of the loop with the car's own states; the observer is not in it.")
    if found.task.least_share is None:
        lines.append("The design knows nothing of the damper's limits; the bound holds while no demand is clipped.")
    elif found.task.least_share > 0:
        lines.append(f"The bound holds while the damper gives at least {found.task.least_share:.0%} of each demand.")
    return tuple(lines)
