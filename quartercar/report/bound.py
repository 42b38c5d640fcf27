"""The part of a ride report about the clairvoyant bound: what the damper could have reached, and each law's share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.report import Item, PageTable, Paragraph, number
from lpvid.report.formatting import percent
from quartercar.criteria import comfort_classes
from quartercar.rides.bound import MEASURES, Bound, floor_text, obtained, share_text
from quartercar.rides.comparison import Interval

AIM_NAMES = {"objective": "least objective", "comfort": "least comfort at the reference's tyre load",
             "tyre_load": "least tyre load at the reference's comfort"}


def bound_items(bounds: Sequence[Bound]) -> tuple[Item, ...]:
    """Tables of bounds and shares.

    Parameters
    ----------
    bounds : sequence of Bound
        By road and car; at least one, all of one objective.

    Returns
    -------
    tuple of Item
        Paragraphs and two tables: the bounds, and the share of them that each law reaches.
    """
    first = bounds[0]
    items: list[Item] = [
        Paragraph(
            f"{obtained(first)[0].upper()}{obtained(first)[1:]}. Objective: "
            f"{first.objective.description}; its reference is the passive car at the lowest "
            "current."
        )
    ]
    rows = tuple((b.road, b.car, AIM_NAMES[aim], *(_mean(b, aim, m) for m in MEASURES), *(_gap(b, aim, m) for m in
                                                                                         MEASURES[1:]),
                  number(float(np.mean([x.passivity.negative_energy for x in b.best[aim]])), 3))
                 for b in bounds for aim in b.best)
    items.append(PageTable(("road", "car", "what is made least", "objective", "comfort [m/s²]", "tyre load [N]",
                        f"comfort to {first.reference}", f"tyre load to {first.reference}", "energy given [J]"), rows,
                       "Means over the seeds of the bound. Linear: without bump stops and lift-off.",
                       tuple(range(3, 9))))
    items += [Paragraph(f"{b.road}, linear car: {floor_text(b)}.") for b in bounds if b.floor]
    shares = tuple((b.road, law, *(share_text(b.share(law, m)) for m in MEASURES)) for b in bounds for law in b.laws)
    items.append(PageTable(("road", "law", *(m.replace("_", " ") for m in MEASURES)), shares,
                       "How far a law comes from the car at the lowest current (0 %) to the bound at the least "
                       "objective (100 %), nonlinear car, same roads, ± half of the 95 % interval. Above 100 %: the "
                       "law is worse in the other criterion.", (2, 3, 4)))
    return tuple(items)


def bound_row(bound: Bound) -> tuple[str, ...]:
    """The least objective as a row of the table of laws: all columns of it.

    Parameters
    ----------
    bound : Bound
        On the road of the table.

    Returns
    -------
    tuple of str
        Means over the seeds of the bound; a dash where a column does not apply.
    """
    def mean(name: str, scale: float, digits: int) -> str:
        return number(scale * float(np.mean([getattr(f, name) for f in bound.at()])), digits)

    count = "1 seed" if len(bound.seeds) == 1 else f"{len(bound.seeds)} seeds"
    return (f"clairvoyant bound, {bound.car} car ({count})", mean("comfort", 1, 4),
            mean("tyre_load", 1, 4), mean("stroke", 1e3, 3), mean("largest_stroke", 1e3, 3), mean("transient", 1, 4),
            percent(float(np.mean([f.off_road for f in bound.at()]))), "–", "–",
            ", ".join(comfort_classes(float(np.mean([f.comfort for f in bound.at()])))))


def _mean(bound: Bound, aim: str, measure: str) -> str:
    return number(Interval.of(bound.values(bound.at(aim), measure)).mean, 4)


def _gap(bound: Bound, aim: str, measure: str) -> str:
    gap = bound.against_reference(aim, measure)
    return "–" if gap is None else f"{100 * gap.mean:+.1f} %"
