"""Frozen responses of models as figures: Bode plots with phase and bands, step responses, several models overlaid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lpvid import plot
from lpvid._threads import single_thread
from lpvid.analysis.bands import frequency_response
from lpvid.analysis.frozen_responses import settling_samples, step_response
from lpvid.identification.layout import ParameterCloud
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.plot import Comparison
from lpvid.plot.responses import FrozenResponse
from lpvid.report.formatting import number
from lpvid.report.page import Item, PageFigure
from lpvid.scheduling import Scheduling
from lpvid.units import quotient
from lpvid.validation.trust import LEVEL

Linear = LPVTransferFunction | LPVStateSpace
DRAWS = 100
"""Models drawn."""
POINTS = 120
"""Frequencies."""
SHARES = (0.05, 0.5, 0.95)
"""Where in the data's scheduling responses are shown: quantiles of the first variable."""
INPUTS = 3
"""Inputs with a column of their own, at most."""


def frozen_figures(model: Linear, drawn: Sequence[Linear], places: Sequence[np.ndarray], stated: Sequence[str],
                   longest: int) -> list[Item]:
    """Bode plot and step response of one model at several scheduling values, with bands.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        Discrete in time.
    drawn : sequence of models
        From the covariance of its parameters; empty where that is not known.
    places : sequence of (n_scheduling,) arrays
    stated : sequence of str
        The places in words.
    longest : int
        Samples of the longest record: below its frequency nothing is drawn.

    Returns
    -------
    list of Item
    """
    several = [(words, model, list(drawn), at) for words, at in zip(stated, places, strict=True)]
    band = f" with {LEVEL:.0%} bands of {len(drawn)} drawn models" if drawn else ""
    held = ", the scheduling held at values that occur in the data" if model.box.names else ""
    apart = "" if not model.metadata.get("coherent_inputs") else (
        " The inputs move together in the training data: the band holds what these leave open of each.")
    return _figures(several, longest, f"{band}{held}.{apart}")


def overlaid_figures(models: Mapping[str, Linear], at: Mapping[str, np.ndarray], stated: str,
                     longest: int) -> list[Item]:
    """Bode plot and step response of models over each other, each at its own scheduling value; `stated`: whose.

    Parameters
    ----------
    models : mapping of str to LPVTransferFunction or LPVStateSpace
        Discrete, by name; signals are those of the first.
    at : mapping of str to (n_scheduling,) array
        Scheduling value of each model, in its units.
    stated : str
        Whose responses these are, for the captions.
    longest : int
        Samples of the longest record: below its frequency nothing is drawn.

    Returns
    -------
    list of Item
        Bode plot and step response, up to the Nyquist frequency of the fastest model.
    """
    shown = [(name, model, [], at[name]) for name, model in models.items()]
    return _figures(shown, longest, f" of {stated}.")


def _figures(several: Sequence[tuple[str, Linear, list[Linear], np.ndarray]], longest: int, words: str) -> list[Item]:
    first = several[0][1]
    period = min(float(m.sample_time or 0.0) for _, m, _, _ in several)
    rate = 1 / period
    hertz = np.geomspace(max(rate / longest, rate / 2000), 0.5 * rate, POINTS)
    signals = first.filter_inputs[:INPUTS]
    names, columns, output = [s.name for s in signals], len(signals), first.outputs[0]
    units = [quotient(output.unit, s.unit) for s in signals]
    samples = max(round(settling_samples(m, [at]) * float(m.sample_time or 0.0) / period) for _, m, _, at in several)
    time = period * np.arange(samples)

    def swept(model: Linear, at: np.ndarray) -> np.ndarray:
        return frequency_response(model, at, hertz)[:, 0, :columns]

    def stepped(model: Linear, at: np.ndarray) -> np.ndarray:
        own = float(model.sample_time or 0.0)
        found = step_response(model, at, int(np.ceil(samples * period / own)) + 1)[:, 0, :columns]
        return found[np.minimum((time / own + 1e-9).astype(int), len(found) - 1)]

    figures = []
    with single_thread(), np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for compute in (swept, stepped):
            figures.append([FrozenResponse(name, compute(model, at), np.array([compute(d, at) for d in draws]) if draws
                                     else None) for name, model, draws, at in several])
    stage = " It is that of the linear part, behind the input stage." if first.input_stage is not None else ""
    narrow = (" The lowest row is half the width of the band over the magnitude: a band narrower than its line is seen "
              "there." if several[0][2] else "")
    return [PageFigure.of(plot.bode(hertz, figures[0], names, units, output.name, LEVEL),
                      f"Frequency response{words}{narrow}{stage}", f"Bode plot of {output.name}"),
            PageFigure.of(plot.steps(time, figures[1], names, units, output.name, LEVEL),
                      f"Step response{words}{stage}", f"Step response of {output.name}")]


def drawn_models(model: Linear) -> list[Linear]:
    """Models drawn from the covariance that a model carries; none where it carries none that is of use.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        With or without a covariance in its metadata.

    Returns
    -------
    list of LPVTransferFunction or LPVStateSpace
        Empty where the covariance is missing, zero, not finite, or cannot be drawn from.
    """
    return drawn_from(ParameterCloud.of(model))


def drawn_from(cloud: ParameterCloud | None) -> list:
    """Models drawn from a normal law of their parameters.

    Parameters
    ----------
    cloud : ParameterCloud, optional

    Returns
    -------
    list
        Empty where the covariance is missing, zero or none (`ParameterCloud.fault`), or where some draws are no models
        of this kind, so that a normal law does not describe the parameters.
    """
    from lpvid.errors import InputError

    if cloud is None or cloud.fault or not np.any(cloud.covariance):
        return []
    try:
        return list(cloud.draw(np.random.default_rng(0), DRAWS))
    except InputError:
        return []


def scheduling_places(box: Scheduling, shown: Sequence[Comparison]) -> tuple[list[np.ndarray], list[str]]:
    """Three scheduling values that occur: at quantiles of the first variable, with the others as they were then.

    Parameters
    ----------
    box : Scheduling
        Scheduling variables of the model.
    shown : sequence of Comparison
        Runs whose records hold these variables.

    Returns
    -------
    list of (n_scheduling,) arrays
        At the quantiles `SHARES`, each once; one empty array where nothing schedules the model.
    list of str
        The same in words, with units.
    """
    if not box.names:
        return [np.zeros(0)], ["time-invariant"]
    p = np.vstack([c.record.matrix(list(box.names)) for c in shown])
    order = np.argsort(p[:, 0], kind="stable")
    rows = [p[order[round(share * (len(p) - 1))]] for share in SHARES]
    distinct = [r for i, r in enumerate(rows) if not any(np.array_equal(r, other) for other in rows[:i])]
    return distinct, [", ".join(f"{n} = {number(v, 3)} {u}".rstrip() for n, v, u in
                                zip(box.names, row, box.units, strict=True)) for row in distinct]
