"""How sure a model is: bands of its frozen responses and of its free run, from the parameters' covariance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from lpvid import plot
from lpvid._threads import single_thread
from lpvid.analysis.bands import free_run_band
from lpvid.errors import InputError
from lpvid.identification.layout import ParameterCloud
from lpvid.identification.result import Identification
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.plot import Comparison
from lpvid.report.page import Item, PageFigure, Paragraph, Section
from lpvid.report.responses import DRAWS, drawn_from, frozen_figures, overlaid_figures, scheduling_places
from lpvid.validation.trust import LEVEL

LINEAR = (LPVTransferFunction, LPVStateSpace)

RUN = 4000
"""Samples of the free run whose band is worked out, at most."""


def response_section(found: Identification, shown: Sequence[Comparison],
                     others: Mapping[str, object] | None = None) -> tuple[Section, ...]:
    """Bode plots and step responses at scheduling values that occur; none for a model that schedules itself.

    Parameters
    ----------
    found : Identification
    shown : sequence of Comparison
        The scheduling values are taken from them.
    others : mapping of str to model, optional
        Further models of the same plant, laid over this one at the middle value.

    Returns
    -------
    tuple of Section
    """
    model = found.model
    if not shown or not isinstance(model, LINEAR):
        return ()
    drawn = drawn_from(_cloud(found))
    places, stated = scheduling_places(model.box, shown)
    longest = max(c.record.n_samples for c in shown)
    items = frozen_figures(model, drawn, places, stated, longest)
    same = {n: m for n, m in (others or {}).items() if isinstance(m, LINEAR) and m.box.names == model.box.names
            and m.sample_time == model.sample_time}
    if same:
        middle = places[len(places) // 2]
        models = {"this model": model, **same}
        held = f" at {stated[len(places) // 2]}" if model.box.names else ""
        items += overlaid_figures(models, dict.fromkeys(models, middle), f"several models{held}", longest)
    return (Section("Frequency and step response", tuple(items)),)


def sureness(found: Identification, shown: Sequence[Comparison]) -> tuple[Section, ...]:
    """A section with 95 % bands, or none where the parameters' covariance is not known.

    Parameters
    ----------
    found : Identification
    shown : sequence of Comparison
        The first one's free run is drawn with its band; the scheduling values are taken from all.

    Returns
    -------
    tuple of Section
    """
    if not shown:
        return ()
    with single_thread():
        drawn = drawn_from(_cloud(found))
        if not drawn:
            return ()
        items: list[Item] = [Paragraph(f"Bands of {DRAWS} models drawn from the covariance of the parameters "
                                       f"({_kind(found)}); pointwise. They show the uncertainty of the parameters "
                                       "within this structure, not errors of the structure.")]
        items.append(_free_run(drawn, shown[0]))
    return (Section("How sure the model is", tuple(items)),)


def _cloud(found: Identification) -> ParameterCloud:
    return ParameterCloud(found.model, found.layout, found.covariance)


def _kind(found: Identification) -> str:
    coloured = any("sandwich" in n for n in found.notes) and "sandwich" not in found.covariance_kind
    return "sandwich form for a coloured residual" if coloured else found.covariance_kind


def _free_run(drawn: list, shown: Comparison) -> Item:
    record = shown.record if shown.record.n_samples <= RUN else shown.record.slice(0, RUN)
    try:
        band = free_run_band(drawn, record, LEVEL)
    except InputError:
        return Paragraph("Every model drawn from the covariance diverges in free run: the estimate is too uncertain "
                         "for a band.", strong=True)
    lost = f" {band.diverged} of {len(drawn)} drawn models diverge and are left out." if band.diverged else ""
    return PageFigure.of(plot.free_run_band(shown, band),
                     f"Free run of {shown.record.name}, {shown.label}, where its {LEVEL:.0%} band is widest.{lost}")
