"""Checks of what the scheduling variables and the motion were made to do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from lpvid.auditing.findings import Finding
from lpvid.auditing.view import View, resting_levels
from lpvid.condition import repetition_period
from lpvid.condition.constancy import constant

_MOTION = 0.05
"""span [s] over which the movement of a scheduling variable is judged."""


def scheduling(views: Sequence[View]) -> Iterator[Finding]:
    """Range, levels, rate of change and time in motion of each scheduling candidate over the whole data set.

    Parameters
    ----------
    views : sequence of View
        The data set.

    Yields
    ------
    Finding
        ``no-scheduling``, and for each candidate one of ``constant-scheduling``,
        ``scheduling-constant-within-records`` or what its motion covers.
    """
    names = list(dict.fromkeys(n for view in views for n in view.scheduling))
    lone = views[0].name if len(views) == 1 else ""
    if not names:
        yield Finding("no-scheduling", lone, "", "note", "no channel in A, V or K and no pure number: nothing to "
                      "schedule a model by", "record the current or temperature, or schedule by a channel named")
    for name in names:
        having = [v for v in views if name in v.record.channels and v.finite(name).size]
        if not having:
            continue
        unit = having[0].record.unit(name)
        low = min(float(v.finite(name).min()) for v in having)
        high = max(float(v.finite(name).max()) for v in having)
        if constant(low, high, unit):
            moves = f"{low:.6g}" if low == high else f"{low:.6g} to {high:.6g}"
            yield Finding("constant-scheduling", lone, name, "warning",
                          f"always {moves} {unit}".rstrip() + " in the whole data set: what a model does with it "
                          "cannot be identified", "vary it, or leave it out of the model", low)
        elif not any(v.moves(name) for v in having):
            levels = sorted({float(v.finite(name)[0]) for v in having})
            shown = ", ".join(f"{x:.4g}" for x in levels[:8])
            yield Finding("scheduling-constant-within-records", lone, name, "note",
                          f"constant in every record, {len(levels)} level(s) over the data set: {shown} {unit}".rstrip()
                          + "; the response to its motion cannot be identified",
                          "add a record in which it moves", float(len(levels)))
        else:
            yield _moving(having, name, unit, low, high, lone)


def _moving(having: Sequence[View], name: str, unit: str, low: float, high: float, lone: str) -> Finding:
    values = np.concatenate([v.finite(name) for v in having])
    levels = resting_levels(values, low, high)
    rates, moving, total = [0.0], 0, 0
    for view in having:
        found = view.run(name)
        if found is not None and view.period is not None:
            lag = min(max(round(_MOTION / view.period), 1), found[0].size // 2)
            rates.append(float(np.percentile(np.abs(np.diff(found[0])), 99.9)) / view.period)
            moved = np.abs(found[0][lag:] - found[0][:-lag])
            moving += int(np.sum(moved > 0.02 * (high - low)))
            total += moved.size
    kind = f"{levels} levels" if levels else "continuous"
    share = 100 * moving / max(total, 1)
    evidence = f"{low:.4g} … {high:.4g} {unit}".rstrip() + f", {kind}"
    evidence += (f", up to {max(rates):.3g} {unit}/s with its noise, moves by over 2 % of its range within "
                 f"{1e3 * _MOTION:g} ms for {share:.0f} % of the time" if total else
                 "; no steady stretch long enough to measure how fast it moves")
    mend = "two levels carry no more than a first-degree polynomial" if levels == 2 else ""
    return Finding("scheduling-excitation", lone, name, "note", evidence, mend, high - low)


def repeated(view: View) -> Iterator[Finding]:
    """A motion that repeats itself within the record: time blocks of it are not independent.

    Parameters
    ----------
    view : View
        One record; its displacement is looked at, or its velocity where there is none.

    Yields
    ------
    Finding
        ``repeated-segments``, a note; its value is the time after which the motion repeats [s].
    """
    name = view.displacement or view.velocity
    if name is None or view.period is None:
        return
    found = view.run(name)
    repetition = repetition_period(found[0], view.period) if found is not None else None
    if repetition is not None:
        how = "with opposite sign " if repetition.sign < 0 else ""
        yield Finding("repeated-segments", view.name, name, "note",
                      f"repeats {how}every {repetition.seconds:.5g} s within {100 * repetition.residual:.2g} % rms: "
                      "a held-out part of this record has been seen in training",
                      "hold out other records, or split by the pattern: folds(..., period=...)", repetition.seconds)


def same_excitation(views: Sequence[View]) -> Iterator[Finding]:
    """A moving channel that is the same, sample by sample, in two records.

    Parameters
    ----------
    views : sequence of View
        The data set.

    Yields
    ------
    Finding
        ``same-in-two-records`` for each such channel, a note; its value counts the pairs.
    """
    seen: dict[tuple[str, int, float], str] = {}
    shared: dict[str, list[tuple[str, str]]] = {}
    for view in views:
        for name in view.usable:
            values = view.record.channels[name].values
            if not view.moves(name) or values.size < 64:
                continue
            key = (name, values.size, hash(values.tobytes()))
            if key in seen:
                shared.setdefault(name, []).append((seen[key], view.name))
            else:
                seen[key] = view.name
    for name, pairs in shared.items():
        yield Finding("same-in-two-records", "", name, "note",
                      f"identical in '{pairs[0][0]}' and '{pairs[0][1]}'"
                      + (f" and {len(pairs) - 1} more pair(s)" if len(pairs) > 1 else ""),
                      "one of them is no independent test of a model fitted to the other", float(len(pairs)))
