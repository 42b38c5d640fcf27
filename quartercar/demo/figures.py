"""What the demo draws of its model: whole records of every experiment, loops by current, residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lpvid.report import Item, PageFigure, Section

if TYPE_CHECKING:
    from lpvid.model.transfer_function import LPVTransferFunction
    from lpvid.plot import Comparison
    from lpvid.record import Record
    from quartercar.demo.diagnosis import HiddenCause


@dataclass(frozen=True, eq=False)
class Drawn:
    """What can be drawn before the ride is done.

    Attributes
    ----------
    shown : tuple of Comparison
        The model's runs along the held-out records.
    runs : tuple of Item
        Their figures.
    hidden : Section
        Of the hidden cause.
    """

    shown: tuple[Comparison, ...]
    runs: tuple[Item, ...]
    hidden: Section

    @classmethod
    def of(cls, model: LPVTransferFunction, held_out: Sequence[Record], experiments: Mapping[str, str],
           hidden: HiddenCause) -> Drawn:
        """Run the model along the records, and draw.

        Parameters
        ----------
        model : LPVTransferFunction
        held_out : sequence of Record
        experiments : mapping of str to str
            What moves, by name.
        hidden : HiddenCause

        Returns
        -------
        Drawn
        """
        from lpvid.report.figures import comparisons

        shown = tuple(comparisons(model, held_out, "held-out"))
        return cls(shown, tuple(run_figures(shown, experiments)), hidden.section)


def run_figures(shown: Sequence[Comparison], experiments: Mapping[str, str]) -> list[Item]:
    """A whole held-out record of every experiment, the worst one, then loops and residuals.

    Parameters
    ----------
    shown : sequence of Comparison
    experiments : mapping of str to str
        What moves, by name.

    Returns
    -------
    list of Item
        Figures that the records do not allow are left out.
    """
    from lpvid import plot
    from lpvid.report.courses import free_run_traces
    from quartercar import plot as damper_plot

    items: list[Item] = []
    for name, description in experiments.items():
        of_test = [c for c in shown if c.record.name.startswith(f"{name}-")]
        if of_test:
            worst = max(of_test, key=_run_esr)
            which = ("its only held-out record, free-run ESR" if len(of_test) == 1 else
                     f"the one of {len(of_test)} held-out records with the largest free-run ESR")
            items.append(free_run_traces(worst, ("current", "velocity"), f"{name} ({description}): the whole of "
                                         f"{worst.record.name}, {which}, {_run_esr(worst):.4f}. Shaded: the stretch "
                                         "with the largest error."))
    for prefix, description in (("test-7-", "multisine"), ("test-8-", "triangle")):
        chosen = [c for c in shown if c.record.name.startswith(prefix)]
        loops = damper_plot.loops_by_current(chosen)
        if loops is not None:
            items.append(
                PageFigure.of(
                    loops,
                    f"Force-velocity loops of the {description} at four constant currents, held-out. " + _width(chosen),
                )
            )
    driven = [c for c in shown if c.record.name.startswith(("test-1-", "test-2-", "test-3-"))]
    for drawn, description in (
        (plot.loops(driven, ("velocity", "displacement")), "Force over velocity and displacement"),
        (plot.residuals(driven, inputs=("velocity",)), "One-step residuals"),
    ):
        if drawn is not None:
            items.append(PageFigure.of(drawn, f"{description}, held-out roads with moving current."))
    return items


def _run_esr(c: Comparison) -> float:
    """Free-run ESR of one record; infinite where the run diverged."""
    error = c.error[c.free_run.start:]
    if not np.isfinite(error).all():
        return float("inf")
    return float(np.sum(error**2) / np.sum((c.measured[c.free_run.start:] - c.measured[c.free_run.start:].mean())**2))


def _width(shown: Sequence[Comparison]) -> str:
    """What an ESR looks like in a loop: the rms error as a share of the force's own spread."""
    known = [(np.sum(e**2), np.sum((y - y.mean())**2), e.size) for c in shown
             if np.isfinite(e := c.error[c.free_run.start:]).all() and (y := c.measured[c.free_run.start:]).size]
    if not known:
        return ""
    error, power, count = (float(sum(k[i] for k in known)) for i in range(3))
    return (f"Their pooled ESR is {error / power:.4f}: an rms error of √{error / power:.4f} = "
            f"{100 * np.sqrt(error / power):.0f} % of the force's standard deviation, {np.sqrt(error / count):.0f} N. "
            "That is the gap between the loops: the virtual loop has its width from the spring in series, the model's "
            "from a lag.")
