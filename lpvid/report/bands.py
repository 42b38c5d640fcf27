"""How sure a model is: bands of its frequency response and of its free run, from the parameters' covariance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid import plot
from lpvid._threads import single_thread
from lpvid.analysis.bands import free_run_band, frequency_band, frequency_response
from lpvid.errors import InputError
from lpvid.identification.result import Identification
from lpvid.model.quasi import SelfScheduled
from lpvid.plot import Comparison
from lpvid.report.page import Figure, Item, Paragraph, Section, number

DRAWS = 100
"""Models drawn."""
POINTS = 120
"""Frequencies."""
RUN = 4000
"""Samples of the free run whose band is worked out, at most."""
LEVEL = 0.95
SHARES = (0.05, 0.5, 0.95)
"""Where in the data's scheduling the frequency response is shown: quantiles of the first variable."""


def sureness(found: Identification, shown: Sequence[Comparison], seed: int = 0) -> tuple[Section, ...]:
    """A section with 95 % bands, or none where the parameters' covariance is not known.

    Parameters
    ----------
    found : Identification
    shown : sequence of Comparison
        The first one's free run is drawn with its band; the scheduling values are taken from all.
    seed : int
        Of the draws.

    Returns
    -------
    tuple of Section
    """
    spread = found.covariance
    if not shown or not spread.size or not np.all(np.isfinite(spread)) or not np.any(spread):
        return ()
    with single_thread():
        try:
            drawn = found.draw(np.random.default_rng(seed), DRAWS)
        except InputError:
            return ()  # some draws are no models of this kind, so that a normal law does not describe it
        items: list[Item] = [Paragraph(f"Bands of {DRAWS} models drawn from the covariance of the parameters "
                                       f"({_kind(found)}); pointwise. They show how sure the estimate is within its "
                                       "structure, not what the structure lacks.")]
        if not isinstance(found.model, SelfScheduled):
            items += _frequency(found, drawn, shown)
        items.append(_free_run(drawn, shown[0]))
    return (Section("How sure the model is", tuple(items)),)


def _kind(found: Identification) -> str:
    coloured = any("sandwich" in n for n in found.notes) and "sandwich" not in found.covariance_kind
    return "sandwich form for a coloured residual" if coloured else found.covariance_kind


def _frequency(found: Identification, drawn: list, shown: Sequence[Comparison]) -> list[Item]:
    """One figure for every input."""
    model = found.model
    rate = 1 / model.sample_time
    longest = max(c.record.n_samples for c in shown)
    hertz = np.geomspace(max(rate / longest, rate / 2000), 0.5 * rate, POINTS)
    places, said = scheduling_values(found, shown)
    bands = [frequency_band(drawn, at, hertz, LEVEL) for at in places]
    responses = [frequency_response(model, at, hertz) for at in places]
    last = model.outputs[0]
    stage = " It is that of the linear part, behind the input stage." if model.input_stage is not None else ""
    held = ", the scheduling held at values that occur in the data" if model.box.names else ""
    apart = "" if not found.model.metadata.get("coherent_inputs") else (
        " The inputs move together in the training data: the band holds what these leave open of each.")
    items: list[Item] = []
    for i, first in enumerate(model.inputs):
        what = f"|{last.name}/{first.name}| [{last.unit or '1'}/({first.unit or '1'})]"
        items.append(Figure.of(plot.frequency_bands(bands, responses, said, what, i),
                               f"Frequency response to {first.name} with its {LEVEL:.0%} band{held}.{stage}{apart}"))
    return items


def scheduling_values(found: Identification,
                      shown: Sequence[Comparison]) -> tuple[list[np.ndarray], list[str]]:
    """Three scheduling values that occur: at quantiles of the first variable, with the others as they were then."""
    box = found.model.box
    if not box.names:
        return [np.zeros(0)], ["time-invariant"]
    p = np.vstack([c.record.matrix(list(box.names)) for c in shown])
    order = np.argsort(p[:, 0], kind="stable")
    rows = [p[order[round(share * (len(p) - 1))]] for share in SHARES]
    distinct = [r for i, r in enumerate(rows) if not any(np.array_equal(r, other) for other in rows[:i])]
    return distinct, [", ".join(f"{n} = {number(v, 3)} {u}".rstrip() for n, v, u in
                                zip(box.names, row, box.units, strict=True)) for row in distinct]


def _free_run(drawn: list, shown: Comparison) -> Item:
    record = shown.record if shown.record.n_samples <= RUN else shown.record.slice(0, RUN)
    try:
        band = free_run_band(drawn, record, LEVEL)
    except InputError:
        return Paragraph("Every model drawn from the covariance diverges in free run: the estimate is too uncertain "
                         "for a band.", strong=True)
    lost = f" {band.diverged} of {len(drawn)} drawn models diverge and are left out." if band.diverged else ""
    return Figure.of(plot.free_run_band(shown, band),
                     f"Free run of {shown.record.name}, {shown.label}, where its {LEVEL:.0%} band is widest.{lost}")
