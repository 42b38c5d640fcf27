"""Checks of channels that stand still where the others move, and of a force whose peaks are flat within a hair."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lpvid.auditing.findings import Finding
from lpvid.auditing.view import View
from lpvid.condition.resampling import true_runs

LONGER = 4.0
"""times the longest run on any other value that a run on one value must last: a parabola that is rounded to a lattice
rests on its outermost level 1/(√2 − 1) = 2.4 times as long as on the next"""
SHORTEST = 8
"""samples of a run that counts as rest"""
SHARE = 0.01
"""of the record, below which rest is of no account"""
HAIRS = (1e-4, 3e-4, 1e-3)
"""widths below the largest value, as shares of the range, within which a clipped force lies, for noise of any size"""
FLAT = 0.75
"""share of the samples within four such widths that lie within one: ½ under a parabola, 1 on a flat top; between"""
ENOUGH = 32
"""samples within four widths from which the two differ: ½ has a standard error of .09"""
PASSED = 1 / 3
"""share of the noise elsewhere that a flat top may hold: an amplifier at its end passes none, a force that has levelled
off by itself has all of it"""


def rests(view: View) -> Iterator[Finding]:
    """A displacement that rests on exactly one value for long, as it does nowhere else.

    Parameters
    ----------
    view : View
        One record.

    Yields
    ------
    Finding
        ``displacement-rests``, a warning where the force moves meanwhile, else a note; its value is the share of
        the samples.
    """
    name = view.displacement
    if name is None or view.period is None or not view.moves(name) or view.few_levels(name):
        return
    names = [name] if view.force is None else [name, view.force]
    found = view.run(*names)
    if found is None:
        return
    at, length, other = _longest_rest(found[0])
    if length < max(SHORTEST, SHARE * found[0].size) or length <= LONGER * other:
        return
    first, share = at * view.period, length / found[0].size
    where = "from the start" if at == 0 else "to the end" if at + length == found[0].size else f"from {first:.4g} s on"
    evidence = (f"{length} samples in a row ({100 * share:.3g} %, {length * view.period:.3g} s {where}) rest on "
                f"exactly {found[0][at] + 0.0:.5g} {view.record.unit(name)}")
    moved = None if view.force is None else _moved(found[1], at, length)
    if moved is not None and moved[0] > moved[1]:
        yield Finding("displacement-rests", view.name, name, "warning",
                      f"{evidence}, while the force moves by {moved[0]:.3g} {view.record.unit(str(view.force))}: the "
                      "end of the sensor's scale", "leave these samples out, or shift the sensor's zero", share)
        return
    still = "" if moved is None else f", and the force moves by {moved[0]:.3g} {view.record.unit(str(view.force))} only"
    yield Finding("displacement-rests", view.name, name, "note",
                  f"{evidence}{still}: the motion stands still", "leave these samples out: they hold no motion", share)


def _longest_rest(x: np.ndarray) -> tuple[int, int, int]:
    """(first sample, length) of the longest run of one value, and the length of the longest on any other value."""
    edges = np.flatnonzero(np.diff(x) != 0) + 1
    starts = np.concatenate([[0], edges])
    lengths = np.diff(np.append(starts, x.size))
    k = int(np.argmax(lengths))
    others = lengths[x[starts] != x[starts[k]]]
    return int(starts[k]), int(lengths[k]), int(others.max(initial=0))


def _moved(force: np.ndarray, at: int, length: int) -> tuple[float, float]:
    """By how much the force moves during a rest, and by how much noise and what dies away would move it.

    That is what a record moves by in a hundredth of its range, and six times its change from sample to sample at rest.
    """
    part = force[at: at + length]
    steps = float(np.median(np.abs(np.diff(part))))
    return float(np.ptp(part)), max(0.1 * float(np.ptp(force)), 6 * 1.5 * steps)


def flat_peaks(view: View) -> Iterator[Finding]:
    """A force of which many samples lie within a hair of its largest value, without the noise that it has elsewhere.

    Parameters
    ----------
    view : View
        One record.

    Yields
    ------
    Finding
        ``force-clipped``, a warning, for either side; its value is the share of the samples.
    """
    name = view.force
    if name is None or not view.moves(name) or view.few_levels(name):
        return
    values = view.finite(name)
    for sign, side in ((1.0, "largest"), (-1.0, "smallest")):
        found = _flat(sign * values)
        if found is None:
            continue
        count, more, hair = found
        unit = view.record.unit(name)
        yield Finding("force-clipped", view.name, name, "warning",
                      f"{count} samples ({100 * count / values.size:.3g} %) lie within {hair:.2g} {unit} of the {side} "
                      f"force {sign * float((sign * values).max()):.5g} {unit}, and {more} more within {4 * hair:.2g} "
                      f"{unit}; a smooth peak would have {count} more: an amplifier at its end, or nothing but dry "
                      "friction", "widen the amplifier's range, or leave those samples out", count / values.size)


def _flat(x: np.ndarray) -> tuple[int, int, float] | None:
    """(samples within a hair of the maximum, more within four, the hair) if that is far from a parabola's share."""
    top, span = float(x.max()), float(np.ptp(x))
    below = top - x
    if sum(b - a >= 3 for a, b in true_runs(below <= 1e-9 * span)) >= 1:
        return None  # exactly on one value: `values.clipped`
    for share in HAIRS:
        near, wide = int(np.sum(below <= share * span)), int(np.sum(below <= 4 * share * span))
        if wide >= ENOUGH and near > FLAT * wide and _quiet(x, below <= share * span):
            return near, wide - near, share * span
    return None


def _quiet(x: np.ndarray, inside: np.ndarray) -> bool:
    """Whether second differences within marked stretches are small beside those outside of them."""
    rough = np.abs(np.diff(x, 2))
    within = inside[2:] & inside[1:-1] & inside[:-2]
    outside = ~(inside[2:] | inside[1:-1] | inside[:-2])
    return bool(within.any() and outside.any()
                and np.median(rough[within]) < PASSED * float(np.median(rough[outside])))
