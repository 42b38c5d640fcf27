"""Checks of single channels: missing, infinite, text, units, constant, clipped, quantised, twice the same."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lpvid.auditing.findings import Finding
from lpvid.auditing.view import View
from lpvid.condition.resampling import true_runs
from lpvid.units import contradiction_mend, contradicts, in_doubt


def missing(view: View) -> Iterator[Finding]:
    """NaN samples.

    Parameters
    ----------
    view : View
        One record.

    Yields
    ------
    Finding
        ``missing-samples`` by channel: a note, above 1 % a warning, for an empty channel a fault; its value is the
        share of the samples.
    """
    for name, channel in view.record.channels.items():
        share = float(np.mean(np.isnan(channel.values)))
        if share > 0 and not channel.fault:
            runs = len(true_runs(np.isnan(channel.values)))
            if share == 1.0:
                yield Finding("missing-samples", view.name, name, "fault", "it holds no number at all",
                              "export the data again, or leave that file out where the channel is in use", share)
                continue
            yield Finding("missing-samples", view.name, name, "warning" if share > 0.01 else "note",
                          f"{100 * share:.3g} % missing, in {runs} stretch{'es' if runs > 1 else ''}",
                          "nothing: the record is cut there when the channel is in use", share)


def unusable(view: View) -> Iterator[Finding]:
    """Text and infinite samples.

    Parameters
    ----------
    view : View
        One record.

    Yields
    ------
    Finding
        ``text-in-numbers`` and ``infinite-samples``, both faults; the value of the second counts the samples.
    """
    for name, channel in view.record.channels.items():
        if channel.fault:
            yield Finding("text-in-numbers", view.name, name, "fault", channel.fault,
                          "leave the field empty or write nan where a sample is missing")
        rows = np.flatnonzero(np.isinf(channel.values))
        if rows.size:
            yield Finding("infinite-samples", view.name, name, "fault",
                          f"{rows.size} infinite sample(s), the first in row {rows[0] + 1}",
                          "write nan where a sample is missing", float(rows.size))


def units(view: View) -> Iterator[Finding]:
    """Units not understood or not given.

    Parameters
    ----------
    view : View
        One record.

    Yields
    ------
    Finding
        ``unknown-unit``, a warning, ``unit-contradicts-name``, a fault, or ``missing-unit``, a note.
    """
    for name, channel in view.record.channels.items():
        if not channel.unit_known:
            yield Finding("unknown-unit", view.name, name, "warning",
                          f"unit '{channel.source_unit}' is not known; the channel is a pure number",
                          "correct the unit in the header; the channel cannot be used until then")
        elif expected := contradicts(name, channel.unit, channel.source_unit):
            source = channel.source_unit or channel.unit
            doubt = source.strip() if in_doubt(name, source) else ""
            stated = "states neither mass nor acceleration" if doubt else f"calls for {expected[0]}"
            yield Finding("unit-contradicts-name", view.name, name, "fault",
                          f"the unit is '{source}', '{name}' {stated}",
                          contradiction_mend(channel.unit, expected, name, doubt=doubt))
        elif channel.source_unit is None and not channel.unit:
            yield Finding("missing-unit", view.name, name, "note", "the header gives no unit; taken as SI",
                          f"write the header as 'name [unit]', or --role '{name}={name} [UNIT]'")


def constant(view: View) -> Iterator[Finding]:
    """Channels that never move; scheduling candidates are judged over the whole data set.

    Parameters
    ----------
    view : View
        One record.

    Yields
    ------
    Finding
        ``constant-channel``, a warning; its value is that of the channel.
    """
    for name in view.record.channels:
        values = view.finite(name)
        if name not in view.scheduling and values.size > 1 and np.ptp(values) == 0:
            unit = view.record.unit(name)
            yield Finding("constant-channel", view.name, name, "warning",
                          f"always {values[0]:.6g} {unit}".rstrip(), "check the wiring or leave the channel out",
                          float(values[0]))


def spiked(view: View) -> Iterator[Finding]:
    """A single sample that outweighs all others: more than half of the channel's power about its median.

    Least squares then fit that sample before anything else. Of a signal that moves twice to the same height, no sample
    holds more than half.

    Parameters
    ----------
    view : View

    Yields
    ------
    Finding
    """
    for name in view.usable:
        values, finite = view.record[name], view.finite(name)
        if finite.size < 64:
            continue
        squares = np.where(np.isfinite(values), values - np.median(finite), 0.0) ** 2
        total, row = float(squares.sum()), int(np.argmax(squares))
        if squares[row] > 0.5 * total:
            yield Finding("spike", view.name, name, "warning",
                          f"row {row + 1} holds {100 * squares[row] / total:.4g} % of the power: {values[row]:.4g} "
                          f"{view.record.unit(name)}".rstrip(),
                          "write nan there where it is no measurement: the record is cut at it",
                          float(squares[row] / total))


def clipped(view: View) -> Iterator[Finding]:
    """Flat tops: far more samples on the extreme value than just inside it, several in a row.

    Parameters
    ----------
    view : View
        One record; scheduling candidates and commands on few levels are left out.

    Yields
    ------
    Finding
        ``clipped``, a warning, for either side; its value is the share of the samples.
    """
    for name in view.usable:
        values = view.finite(name)
        if name in view.scheduling or values.size < 64 or not np.ptp(values) > 0 or view.few_levels(name):
            continue
        for sign, side in ((1.0, "top"), (-1.0, "bottom")):
            found = plateau(sign * values)
            if found:
                on_top, level = found
                yield Finding("clipped", view.name, name, "warning",
                              f"{on_top} samples ({100 * on_top / values.size:.3g} %) rest on the {side} value "
                              f"{sign * level:.5g} {view.record.unit(name)}".rstrip(),
                              "widen the measuring range, or leave those samples out", on_top / values.size)


def plateau(x: np.ndarray) -> tuple[int, float] | None:
    """(samples on the maximum, maximum) if the signal is cut off there.

    A signal that rests on values between its ends too is one of steps, not cut off.

    Parameters
    ----------
    x : (n,) array
        Finite, of any unit; turned for a plateau on its minimum.

    Returns
    -------
    (int, float) or None
        The maximum in the unit of x; None where it is no end of a range.

    Examples
    --------
    >>> x = np.sin(0.01 * np.arange(2000))
    >>> plateau(np.minimum(x, 0.9))
    (274, 0.9)
    >>> plateau(x) is None
    True
    """
    top, span = float(x.max()), float(np.ptp(x))
    on_top = x >= top - 1e-9 * span
    count = int(on_top.sum())
    if count < 5:
        return None
    runs = [b - a for a, b in true_runs(on_top)]
    below = x[~on_top]
    between = below[below > float(x.min()) + 1e-9 * span]
    if between.size < 2 or not np.median(np.abs(np.diff(between))) > 1e-9 * span:
        return None
    step = top - float(below.max())  # one level of a quantised signal
    near = int(np.sum(below >= top - max(1.05 * step, 1e-3 * span)))
    flat = max(runs) >= 3 and sum(r >= 3 for r in runs) >= (1 if max(runs) >= 5 else 2)
    # a quantised parabola rests on its top level 2.4 times as long as on the next
    return (count, top) if flat and count > 4 * max(near, 1) else None


def quantised(view: View) -> Iterator[Finding]:
    """Values on a lattice that is coarse against the signal.

    Parameters
    ----------
    view : View
        One record; commands on few levels are left out. Force and displacement are measured, no commands: theirs
        count, if there are two.

    Yields
    ------
    Finding
        ``quantised`` for steps above 1/200 of the rms, from 1/20 on a warning; its value is the step in the unit of
        the channel.
    """
    for name in view.usable:
        values = view.finite(name)
        measured = name in (view.force, view.displacement)
        if values.size < 64 or not np.ptp(values) > 0 or (not measured and view.few_levels(name)):
            continue
        step = _lattice(values, 2 if measured else 4)
        rms = float(values.std())
        if step is not None and step > rms / 200:
            bits = np.log2(np.ptp(values) / step + 1)
            unit = view.record.unit(name)
            share = f"1/{rms / step:.0f} of" if rms > 1.5 * step else f"{step / rms:.2g} times"
            yield Finding("quantised", view.name, name, "warning" if step > rms / 20 else "note",
                          f"steps of {step:.4g} {unit}, {share} the rms; {bits:.1f} bits in use",
                          "a finer range or converter; noise below a step cannot be judged", step)


def _lattice(values: np.ndarray, fewest: int) -> float | None:
    """Step of the lattice on which the values lie within a tenth; None too for less than `fewest` levels."""
    levels = np.unique(values[:20_000])
    if levels.size < fewest:
        return None
    span = float(levels[-1] - levels[0])
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-9 * span]
    if gaps.size < fewest - 1:
        return None
    step = float(np.median(gaps[gaps < 1.5 * gaps.min()]))
    centre = int(np.searchsorted(levels, np.median(values)))
    reach = 8
    while True:
        near = levels[max(centre - reach, 0):centre + reach + 1]
        index = np.round((near - near[0]) / step)
        if index[-1] < 1:
            return None
        step, origin = (float(c) for c in np.polyfit(index, near, 1))
        if np.sqrt(np.mean((near - origin - step * index) ** 2)) > 0.1 * step or step <= 0:
            return None
        if reach > levels.size:
            return step
        reach *= 2


def duplicates(view: View) -> Iterator[Finding]:
    """Two channels that are one signal, up to a factor.

    Parameters
    ----------
    view : View
        One record; its first 40 moving channels are compared.

    Yields
    ------
    Finding
        ``same-channel-twice``, a warning; its value is the correlation.
    """
    names = [n for n in view.usable if view.moves(n)][:40]
    standard = {}
    for name in names:
        values = view.record.channels[name].values
        centred = np.where(np.isfinite(values), values, 0.0)
        centred = centred - centred.mean()
        standard[name] = centred / max(float(np.sqrt(centred @ centred)), 1e-300)
    for i, one in enumerate(names):
        for other in names[i + 1:]:
            like = float(standard[one] @ standard[other])
            if abs(like) > 1 - 1e-10:
                sign = "the same" if like > 0 else "the negative"
                yield Finding("same-channel-twice", view.name, other, "warning",
                              f"is {sign} signal as '{one}' (correlation {like:.6f})",
                              "use one of them; check the wiring", like)
