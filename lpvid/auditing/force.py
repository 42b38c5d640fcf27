"""Checks of force against velocity: polarity, offset, drift, signs that differ between records."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from lpvid.auditing.findings import Finding
from lpvid.auditing.view import View

BLOCKS = 20
"""means from which the standard error of the mean power is estimated"""


def dissipation(view: View) -> tuple[float, float, float] | None:
    """(correlation of force and velocity, mean (F − F̄)(v − v̄) [W], how far from zero that is in standard errors).

    The error comes from the means of `BLOCKS` blocks. In a record whose tests become faster and faster, these have the
    sign of one another and differ by orders of magnitude, so that their scatter is no error of the sign: the distance
    is at least that of a normal deviate as improbable as the blocks' signs and ranks (Wilcoxon 1945).

    From the first to the last reversal of the motion, where a spring holds about the same energy; None where the motion
    turns less than twice: within less than a cycle, energy that is stored looks like energy that is taken or given.

    Parameters
    ----------
    view : View
        One record.

    Returns
    -------
    (float, float, float) or None
        None also without force and velocity, or where one of them is constant.
    """
    if view.stroke is None:
        return None
    _, velocity, force = view.stroke
    turns = _turns(velocity)
    if turns.size < 2 or turns[-1] - turns[0] < 2 * BLOCKS:
        return None
    velocity, force = velocity[turns[0] + 1: turns[-1] + 1], force[turns[0] + 1: turns[-1] + 1]
    if not (np.ptp(force) > 0 and np.ptp(velocity) > 0):
        return None
    product = (force - force.mean()) * (velocity - velocity.mean())
    mean = float(product.mean())
    blocks = np.array([b.mean() for b in np.array_split(product, BLOCKS)])
    error = float(blocks.std(ddof=1) / np.sqrt(blocks.size))
    likeness = mean / float(force.std() * velocity.std())
    return likeness, mean, max(abs(mean) / max(error, 1e-12 * abs(mean), 1e-300), _by_ranks(blocks, mean))


def _by_ranks(blocks: np.ndarray, mean: float) -> float:
    """Normal deviate of the signed-rank test that the blocks lie symmetrically about zero; 0 against their mean's sign.
    """
    from scipy.stats import norm, wilcoxon

    if not np.sign(mean) * np.median(blocks) > 0:
        return 0.0
    return float(norm.isf(0.5 * float(np.asarray(wilcoxon(blocks[blocks != 0], method="exact"))[1])))


def polarity(view: View) -> Iterator[Finding]:
    """A force that drives the motion on average: its sign, or the motion's, is the other convention.

    Parameters
    ----------
    view : View
        One record.

    Yields
    ------
    Finding
        ``reversed-polarity``, a warning, or ``polarity-unclear``, a note; the value is the mean of F·v [W].
    """
    found = dissipation(view)
    if found is None or view.force is None:
        return
    likeness, power, sure = found
    source = f"'{view.velocity}'" if view.velocity else f"the derivative of '{view.displacement}'"
    if sure > 4 and likeness < -0.05:
        yield Finding("reversed-polarity", view.name, view.force, "warning",
                      f"mean F·v = {power:.4g} W with {source} (correlation {likeness:.2f}, {sure:.0f} standard errors "
                      "below zero): the signs of force and velocity differ, those of a passive damper agree",
                      f"--flip {view.force}", power)
    elif sure <= 4:
        yield Finding("polarity-unclear", view.name, view.force, "note",
                      f"mean F·v = {power:.4g} W with {source} is {sure:.1f} standard errors from zero",
                      "a record in which the damper is worked harder", power)


def turned_apart(findings: Sequence[Finding]) -> list[Finding]:
    """The findings, with a mend of its own for each reversed record where the records of a data set disagree.

    Parameters
    ----------
    findings : sequence of Finding
        Of whole records.

    Returns
    -------
    list of Finding
        As they are where no ``mixed-polarity`` is among them: one --flip turns all records then.
    """
    if not any(f.name == "mixed-polarity" for f in findings):
        return list(findings)
    return [replace(f, mend=f"--flip {shlex.quote(f'{f.channel}@{f.record}')}") if f.name == "reversed-polarity" else f
            for f in findings]


def mixed_polarity(views: Sequence[View]) -> Iterator[Finding]:
    """Records of one data set whose force has different signs.

    Parameters
    ----------
    views : sequence of View
        Records whose mean F·v is not clearly different from zero are left out.

    Yields
    ------
    Finding
        ``mixed-polarity``, a warning; its value counts the records with negative mean F·v.
    """
    signs = [(view, found[0]) for view in views if (found := dissipation(view)) and found[2] > 4]
    minus = [v for v, likeness in signs if likeness < -0.05]
    plus = [v for v, likeness in signs if likeness > 0.05]
    if minus and plus:
        shown = ", ".join(f"'{v.name}'" for v in minus[:3]) + (f" and {len(minus) - 3} more" if len(minus) > 3 else "")
        yield Finding("mixed-polarity", "", str(signs[0][0].force), "warning",
                      f"mean F·v is negative in {len(minus)} and positive in {len(plus)} records (negative: {shown})",
                      f"turn the negative ones before using them together: --flip {minus[0].force}@RECORD for each",
                      float(len(minus)))


def _turns(velocity: np.ndarray) -> np.ndarray:
    """Last sample before every reversal of the motion.

    A reversal leads from beyond 20 % of the largest speed one way to beyond it the other way, so that noise about a
    standstill counts for nothing.
    """
    crossings = np.flatnonzero(np.signbit(velocity[:-1]) != np.signbit(velocity[1:]))
    fast = np.flatnonzero(np.abs(velocity) > 0.2 * np.percentile(np.abs(velocity), 99))
    turned = fast[1:][np.signbit(velocity[fast[1:]]) != np.signbit(velocity[fast[:-1]])]
    if not crossings.size or not turned.size:
        return np.zeros(0, int)
    return crossings[np.maximum(np.searchsorted(crossings, turned) - 1, 0)]


def _at_rest(view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """(sample, force, direction) at every reversal of the motion, by linear interpolation of the zero crossing."""
    if view.stroke is None:
        return None
    _, velocity, force = view.stroke
    before = _turns(velocity)
    if not before.size:
        return None
    gap = velocity[before] - velocity[before + 1]
    share = np.divide(velocity[before], gap, out=np.full(gap.size, 0.5), where=gap != 0)  # a rounded velocity may rest
    rising = velocity[before + 1] > velocity[before]
    return before + share, force[before] + share * (force[before + 1] - force[before]), rising


def _offset(view: View) -> tuple[float, float, float] | None:
    """(mean force at rest [N], its standard error, half of what the directions differ by).

    Reversals of either direction count alike: friction cancels. What oil and mounts hold elastically does not where
    rebound and compression differ: of the third number any part can be in the first.
    """
    found = _at_rest(view)
    if found is None:
        return None
    _, level, rising = found
    up, down = level[rising], level[~rising]
    if min(up.size, down.size) < 3:
        return None
    error = 0.5 * np.hypot(up.std(ddof=1) / np.sqrt(up.size), down.std(ddof=1) / np.sqrt(down.size))
    return float(0.5 * (up.mean() + down.mean())), float(error), float(0.5 * abs(up.mean() - down.mean()))


def offset(view: View) -> Iterator[Finding]:
    """Mean force at zero velocity.

    Parameters
    ----------
    view : View
        One record.

    Yields
    ------
    Finding
        ``force-offset`` above 5 % of the rms and four standard errors, a note; its value is the force [N].
    """
    found = _offset(view)
    if found is None or view.stroke is None or view.force is None:
        return
    level, error, width = found
    rms = float(view.stroke[2].std())
    if abs(level) > max(0.05 * rms, 4 * error):
        causes = "gas preload, weight or a zero error"
        if abs(level) < width + 4 * error:
            causes = f"gas preload, weight, a zero error, or what unequal rebound and compression of an elastic " \
                     f"damper leave there ({width:.3g} N at most)"
        yield Finding("force-offset", view.name, view.force, "note",
                      f"mean force at zero velocity {level:.4g} ± {error:.2g} N, {100 * abs(level) / rms:.3g} % of the "
                      f"force's rms: {causes}", "a static reading of the load cell shows which", level)


def drift(view: View) -> Iterator[Finding]:
    """Zero-velocity force that wanders in the course of the record.

    Parameters
    ----------
    view : View
        One record.

    Yields
    ------
    Finding
        ``force-drift`` above 5 % of the rms and six standard errors, a warning, or a note where what an elastic
        damper with unequal directions leaves at rest (`offset_between`) makes it up from the first third of the
        record to the last; its value is the change over the record [N].
    """
    found = _at_rest(view)
    if found is None or view.stroke is None or view.force is None or view.period is None:
        return
    at, level, rising = found
    if min(rising.sum(), (~rising).sum()) < 6:
        return
    change, width = _elastic_change(at, level, rising)
    of = view.stroke[0].size * view.period
    level = level - np.where(rising, level[rising].mean(), level[~rising].mean())
    along = at - at.mean()
    slope = float(along @ level / (along @ along))
    error = float(np.std(level - slope * along) / np.sqrt(along @ along))
    moved, rms = slope * view.stroke[2].size, float(view.stroke[2].std())
    if abs(moved) > 0.05 * rms and abs(slope) > 6 * error:
        elastic = change < width
        yield Finding("force-drift", view.name, view.force, "note" if elastic else "warning",
                      f"the force at zero velocity moves by {moved:+.4g} N ({100 * abs(moved) / rms:.3g} % of the rms) "
                      f"in {of:.4g} s" + (f"; from the first third of the reversals to the last by {change:.3g} N, of "
                                          "which unequal rebound and compression of an elastic damper leave "
                                          f"{width:.3g} N at most" if elastic else ""),
                      "compare the load cell's reading at rest before and after the run" if elastic else
                      "zero the load cell before each run; watch the temperature", moved)


def _elastic_change(at: np.ndarray, level: np.ndarray, rising: np.ndarray) -> tuple[float, float]:
    """(change of the mean force at rest, the most of it that an elastic damper with unequal directions leaves) [N].

    From the first third of the reversals to the last. Of the loop's half width w the damper leaves a share a, |a| ≤ 1:
    a(w₂ − w₁) where strokes last as long in both thirds, within four standard errors; else a may differ, max(w₁, w₂).
    """
    third = at.size // 3
    ends = [slice(0, third), slice(at.size - third, at.size)]
    if any(min(rising[e].sum(), (~rising[e]).sum()) < 1 for e in ends) or third < 3:
        return 0.0, 0.0
    up, down = (np.array([float(level[e][way[e]].mean()) for e in ends]) for way in (rising, ~rising))
    first, last = 0.5 * np.abs(up - down)
    change = 0.5 * abs(float((up + down)[1] - (up + down)[0]))
    early, late = np.diff(at[ends[0]]), np.diff(at[ends[1]])
    error = float(np.hypot(early.std(ddof=1) / np.sqrt(early.size), late.std(ddof=1) / np.sqrt(late.size)))
    alike = abs(float(early.mean() - late.mean())) <= max(4 * error, 1.0)
    return change, float(abs(first - last) if alike else max(first, last))


def offset_between(views: Sequence[View]) -> Iterator[Finding]:
    """Zero-velocity force that differs between records.

    An elastic damper with unequal directions leaves a share a, |a| ≤ 1, of the loop's half width w at rest: between
    runs of like motion a(w₂ − w₁), |w₂ − w₁| at most; where the busiest frequencies differ, a does too: max(w₁, w₂).

    Parameters
    ----------
    views : sequence of View
        The data set.

    Yields
    ------
    Finding
        ``force-offset-varies`` above 10 % of the rms and four standard errors, a warning, or a note where the
        elastic part and four standard errors make up the difference; its value is the largest difference [N].
    """
    found = [(view.name, *level, float(view.stroke[2].std()), *_busiest(view)) for view in views
             if view.stroke is not None and (level := _offset(view)) is not None]
    if len(found) < 2:
        return
    low, high = min(found, key=lambda f: f[1]), max(found, key=lambda f: f[1])
    rms = float(np.median([f[4] for f in found]))
    alike = abs(low[5] - high[5]) <= max(low[6], high[6])
    width = abs(low[3] - high[3]) if alike else max(low[3], high[3])
    spread = high[1] - low[1]
    unsure = 4 * float(np.hypot(low[2], high[2]))
    if spread > max(0.1 * rms, unsure):
        elastic = spread < width + unsure
        yield Finding("force-offset-varies", "", "", "note" if elastic else "warning",
                      f"the force at zero velocity runs from {low[1]:.4g} N ('{low[0]}') to {high[1]:.4g} N "
                      f"('{high[0]}'), {100 * spread / rms:.3g} % of the rms; the two directions differ by "
                      f"±{low[3]:.3g} and ±{high[3]:.3g} N there, of which unequal rebound and compression of an "
                      f"elastic damper leave {width:.3g} N at most",
                      "compare the load cell's reading at rest between the runs" if elastic else
                      "zero the load cell before each run; give the model a constant term for each record", spread)


def _busiest(view: View) -> tuple[float, float]:
    """(busiest frequency of the motion, its resolution: one cycle in the run), both [Hz]."""
    assert view.stroke is not None and view.period is not None
    velocity = view.stroke[1]
    spacing = 1 / (velocity.size * view.period)
    return spacing * int(np.argmax(np.abs(np.fft.rfft(velocity - velocity.mean())))), spacing
