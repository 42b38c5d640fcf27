"""Physical damper laws as step programs: static ones, and those with a closed step of fixed length."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from lpvid.errors import ExtrapolationWarning
from lpvid.export.contract import Exportable, Options, smooth_noise
from lpvid.export.expression import Expr, RealConstant, clipped
from lpvid.export.step_builder import StepBuilder
from lpvid.record import Record
from quartercar.dampers.contract import Damper
from quartercar.dampers.drive import UNITS

PERIOD = 1e-3
"""period of a law that runs at any, where none is given and none is known of its data [s]"""
STROKE, SPEED = 0.03, 0.5
"""displacement [m] and velocity [m/s] that the random trajectory of a self-test reaches"""


def prepare_damper(damper: Damper, options: Options) -> Exportable:
    """A damper with physical parameters as a step program.

    Parameters
    ----------
    damper : Damper
        With its parameters as they are.
    options : Options
        A name, the period [s] (that of the damper's data by default) and whether the current is held in the fitted
        range.

    Returns
    -------
    Exportable
        From the inputs in `reads` to the force [N], with the sign of the records; compared with `Damper.simulate`.

    Raises
    ------
    InputError
        One without a closed step, with the nearest that has one.
    """
    period = options.sample_time or damper.period or PERIOD
    b = StepBuilder(options.name or damper.name, f"damper '{damper.title}' ({damper.source}): {', '.join(damper.reads)}"
                    " -> force", period)
    description = {"velocity": "velocity, positive in extension", "displacement": "displacement",
                   "current": "coil current"}
    x, v, i = motion(b, damper, description, bool(options.clamp))
    force = damper.expression(b)(x, v, i)
    if damper.polarity < 0:
        b.note("The force has the sign of the records, which is against the motion.")
    b.output("force", -force if damper.polarity < 0 else force, "N", "damper force")
    return Exportable(b.program(), lambda u: _reference(damper, u, period, bool(options.clamp)),
                      lambda n, rng: excite(damper, n, rng, period, bool(options.clamp)), damper)


def motion(b: StepBuilder, damper: Damper, description: Mapping[str, str], clamp: bool = False
           ) -> tuple[Expr, Expr, Expr]:
    """Inputs of a damper: displacement from its centre, velocity and current, zero where it does not read them.

    Parameters
    ----------
    b : StepBuilder
        Gets the inputs, in the order in which the damper reads them.
    damper : Damper
    description : mapping of str to str
        Of each input, by name.
    clamp : bool
        Hold the current inside the fitted range.

    Returns
    -------
    x, v, i : Expr
    """
    low, high = damper.current_range or (0.0, 1.0)
    given: dict[str, Expr] = {}
    for name in damper.reads:
        unit = damper.current_unit if name == "current" else UNITS[name]
        ends = (low, high) if name == "current" and damper.current_range else (-np.inf, np.inf)
        given[name] = b.input(name, "" if unit == "1" else unit, description.get(name, name), *ends)
    x, v, i = (given.get(n, RealConstant(0.0)) for n in ("displacement", "velocity", "current"))
    if clamp and "current" in given and damper.current_range:
        i = b.let("held_current", clipped(i, low, high))
        b.note("The current is held inside the fitted range.")
    if damper.centre and "displacement" in given:
        x = b.let("from_centre", x - b.parameter("centre", damper.centre, "m", "displacement that counts as zero"))
    return x, v, i


def _reference(damper: Damper, u: np.ndarray, period: float, clamp: bool) -> np.ndarray:
    columns: dict[str, Any] = dict(zip(damper.reads, u.T, strict=True))
    if clamp and "current" in columns and damper.current_range:
        columns["current"] = np.clip(columns["current"], *damper.current_range)
    unit = "" if damper.current_unit == "1" else damper.current_unit
    record = Record(columns, period, units={n: unit if n == "current" else UNITS[n] for n in columns})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExtrapolationWarning)
        return damper.simulate(record).output


def excite(damper: Damper, n: int, rng: np.random.Generator, period: float, clamp: bool) -> np.ndarray:
    """(n, inputs) random motion whose displacement and velocity belong together, and a current that steps and drifts.

    With `clamp` the current leaves the fitted range by a tenth at both ends.

    Parameters
    ----------
    damper : Damper
        For its inputs, its centre and its range of current; 0 to 1 where that is not known.
    n : int
        Samples.
    rng : numpy.random.Generator
        Draws the motion and the current.
    period : float
        [s].
    clamp : bool
        Whether the current leaves the fitted range.

    Returns
    -------
    (n, inputs) array
        Columns in the order of `reads`: velocity [m/s], displacement [m], current.
    """
    noise = smooth_noise(n, 3, rng)
    v = SPEED * noise[:, 0]
    x = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * period)])
    x = x - x.mean() if np.abs(x).max() < STROKE else STROKE * x / np.abs(x).max()
    low, high = damper.current_range or (0.0, 1.0)
    steps = np.repeat(np.append(rng.permutation([0.0, 0.4, 0.7, 1.0]), rng.uniform(0.0, 1.0, n // 25 + 1)), 25)[:n]
    beyond = 0.1 if clamp else 0.0
    share = np.clip(steps + 0.1 * noise[:, 2], 0.0, 1.0) * (1 + 2 * beyond) - beyond
    columns = {"velocity": v, "displacement": x + damper.centre, "current": low + (high - low) * share}
    return np.column_stack([columns[name] for name in damper.reads])
