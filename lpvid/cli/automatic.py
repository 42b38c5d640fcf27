"""`identify --auto`: the structure chosen on training data, and what its noise leaves possible."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lpvid.errors import InputError
from lpvid.record import Record

if TYPE_CHECKING:
    from lpvid.cli.structures import Request
    from lpvid.identification import Identification
    from lpvid.identification.selection import Ceiling, Selection
    from lpvid.identification.structure import Structure

SHOWN = 8
"""Rows of the ranking that are printed."""


@dataclass(frozen=True, eq=False)
class Choice:
    """A selection with the noise ceiling beside its fit.

    Attributes
    ----------
    selection : Selection
    ceiling : Ceiling or None
        None where it cannot be determined.
    held_out_percent : float or None
        The ceiling [%] on the held-out data.
    why_not : str
        Why there is no ceiling.
    """

    selection: Selection
    ceiling: Ceiling | None
    held_out_percent: float | None
    why_not: str = ""

    def to_dict(self) -> dict:
        """selection.json.

        Returns
        -------
        dict
            The ranking of the selection, with the ceiling, in per cent of fit, or None.
        """
        return {**self.selection.to_dict(), "ceiling": None if self.ceiling is None else {
            **self.ceiling.to_dict(), "held_out_fit_percent": self.held_out_percent}}

    @property
    def description(self) -> str:
        """The ceiling beside the fit, in one sentence."""
        from lpvid.identification.selection.competing import NEAR

        if self.ceiling is None:
            return f"No noise ceiling: {self.why_not}."
        fitted = self.selection.identification
        judged = None if fitted is None else fitted.held_out or fitted.training
        if judged is None or judged.overall.free_run.fit_percent is None:
            return f"Noise {self.ceiling}."
        percent = self.held_out_percent if self.held_out_percent is not None else self.ceiling.fit_percent
        fit = judged.overall.free_run.fit_percent
        beyond = ""
        if fit > percent + NEAR:
            beyond = ", which this model surpasses: ARX models are too poor to estimate it here"
        elif fit < percent - NEAR:
            beyond = f": the fit stays {percent - fit:.1f} points below"
        return (f"Free-run fit {fit:.1f} % on {judged.label} data; what the noise leaves possible there is about "
                f"{percent:.1f} %{beyond}. On training data: {self.ceiling}.")

    def __str__(self) -> str:
        rows = self.selection.table
        lines = [f"chosen from {self.selection.comparison}"]
        if not self.selection.complete:
            lines[0] = "INTERRUPTED, the ranking is not complete: " + lines[0]
        lines += [f"  {i:2d}. {row}" for i, row in enumerate(rows[:SHOWN], start=1)]
        if len(rows) > SHOWN:
            lines.append(f"      and {len(rows) - SHOWN} more: see selection.json")
        return "\n".join([*lines, *(f"  note: {n}" for n in self.selection.notes), f"  {self.description}"])


def choose(request: Request, training: Sequence[Record], held_out: Sequence[Record],
           report_progress: Callable[[str], None], budget: float | None = None,
           begun: float | None = None) -> tuple[Choice, Identification]:
    """Choose a structure on the training data alone.

    Parameters
    ----------
    request : Request
    training, held_out : sequence of Record
        The held-out records are not used in it: only their figures are reported.
    report_progress : callable
        Receives what is being done, with the best so far.
    budget : float, optional
        Processor time of search and refit [s].
    begun : float, optional
        Processor time of the process from which it counts [s]; left out, now.

    Returns
    -------
    Choice, Identification

    Raises
    ------
    KeyboardInterrupt
        Interrupted before there was a model.
    """
    import sys

    from lpvid.identification.selection import auto
    from lpvid.identification.selection.search import ROUND_DONE

    def progress(done: int, total: int, text: str) -> None:
        if text.startswith(ROUND_DONE):
            print(f"{text.removeprefix(ROUND_DONE)} ({done} cross-validated)", file=sys.stderr)
        else:
            report_progress(f"{text} ({done} done)")

    found = auto(training, request.input, request.output, request.schedule, sample_rate=request.sample_rate,
                 held_out=held_out or None, progress=progress, budget=budget, begun=begun)
    if found.identification is None:
        raise KeyboardInterrupt
    if not found.complete:
        print("interrupted: what was ranked so far is kept; the result is marked incomplete", file=sys.stderr)
    report_progress("estimating the noise")
    try:
        ceiling, percent = _ceiling(request, found, training, held_out)
    except InputError as error:
        return Choice(found, None, None, error.what), found.identification
    return Choice(found, ceiling, percent), found.identification


def _plain(found: Selection) -> Structure:
    """The choice, or the best of the structures in the ranking whose orders an ARX has."""
    from lpvid.identification.arx import ARX
    from lpvid.identification.prediction_error import PredictionError

    listed = [found.best, *(row.structure for row in found.table)]
    return next((s for s in listed if isinstance(s, ARX | PredictionError)), found.best)


def _ceiling(request: Request, found: Selection, training: Sequence[Record],
             held_out: Sequence[Record]) -> tuple[Ceiling, float | None]:
    from lpvid.condition import segments, with_derived
    from lpvid.identification.selection import noise_ceiling

    assert found.identification is not None
    ceiling = noise_ceiling(training, _plain(found), sample_rate=request.sample_rate)
    if not held_out:
        return ceiling, None
    channels, model = _plain(found).channels, found.identification.model
    kept = with_derived(held_out, channels)
    pieces = segments(kept, channels, sample_rate=1 / model.sample_time if request.sample_rate else None,
                      minimum=model.start + 2)
    return ceiling, ceiling.on(pieces)
