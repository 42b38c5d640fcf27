"""Step-by-step identification of a semi-active damper: gas from slow runs, rows at constant currents, then the lag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.toolkit import single_thread
from quartercar.dampers.drive import Drive, joined
from quartercar.dampers.fitting.front import prepared
from quartercar.dampers.fitting.problem import DamperFitProblem, MovingFit
from quartercar.dampers.fitting.searching import at_size
from quartercar.dampers.fitting.settings import FitSettings
from quartercar.dampers.fitting.solver import search_law
from quartercar.dampers.laws.semi_active import SemiActiveDamper
from quartercar.dampers.polarity import common_polarity
from quartercar.dampers.sizes import Sizes

FOLLOWED = 3
"""starts followed for a few steps, the cheapest first"""

D = TypeVar("D", bound=SemiActiveDamper)


def best_of(starts: Sequence[D], drives: Sequence[Drive], free: Sequence[str],
            settings: FitSettings) -> tuple[D, float]:
    """The best fit that a few starts lead to when `free` moves, and its ESR.

    Parameters
    ----------
    starts : sequence of SemiActiveDamper
        Of one structure.
    drives : sequence of Drive
        With forces.
    free : sequence of str
        Parameters that move.
    settings : FitSettings
        Its evaluations and tolerance.

    Returns
    -------
    damper : SemiActiveDamper
        The start that led there, with the parameters found.
    esr : float
        Of the free run on `drives`, each about its own mean.

    Raises
    ------
    InputError
        The free run diverges from every start.
    """
    parts = [MovingFit(DamperFitProblem(s, tuple(drives)), free) for s in starts]
    begun = [(part, trial) for part in parts if (trial := part.trial(part.start(part.base))) is not None]
    if not begun:
        raise InputError(f"{starts[0].name}: the free run diverges from every start", got=f"{len(starts)} starts")
    begun.sort(key=lambda pair: pair[1].cost)
    tried = []
    for part, trial in begun[:FOLLOWED] if len(begun) > 1 else []:
        found = search_law(part, trial.point, settings.short_evaluations, 1e-4)
        tried.append((part, trial if found is None else found.trial))
    part, trial = min(tried or begun[:1], key=lambda pair: pair[1].cost)
    found = search_law(part, trial.point, settings.evaluations, settings.tolerance)
    end = trial if found is None else found.trial
    measured = part.problem.measured
    power = sum(float(np.sum((m - m.mean()) ** 2)) for m in np.split(measured, np.cumsum(part.problem.lengths)[:-1]))
    return part.problem.damper.with_vector(end.theta), end.cost / max(power, 1e-300)


def unseen(damper: SemiActiveDamper, drives: Sequence[Drive], free: Sequence[str]) -> tuple[str, ...]:
    """Those of some parameters on which the force along these drives does not depend.

    Parameters
    ----------
    damper : SemiActiveDamper
        At the parameters to look from.
    drives : sequence of Drive
        With forces.
    free : sequence of str
        Names of parameters to look at.

    Returns
    -------
    tuple of str
        Empty too where the run diverges.
    """
    part = MovingFit(DamperFitProblem(damper, tuple(drives)), free)
    now = part.trial(part.start(part.base))
    if now is None or not free:
        return ()
    size = np.abs(part.jacobian(now)).max(axis=0)
    return tuple(n for n, s in zip(free, size, strict=True) if s == 0.0)


SLOW = 0.1
"""a record whose speed stays below this share of the largest one is a slow run"""
STEADY = 0.02
"""a current that moves by less than this share of the nodes' range is constant"""
NEAR = 0.25
"""a constant current belongs to a node within this share of the distance to the next one"""
LAGS = tuple((t, d) for t in (3.0, 10.0, 30.0) for d in (1.0, 4.0, 12.0))
"""time constants and delays from which the search for the lag starts, in samples"""


@dataclass(frozen=True)
class SubProblem:
    """One sub-problem.

    Attributes
    ----------
    name : str
    records : tuple of str
        What it was fitted to.
    parameters : tuple of str
        What it fitted, as the whole damper names it.
    esr : float
        Free-run error-to-signal ratio on these records, source 002, equation (7).
    """

    name: str
    records: tuple[str, ...]
    parameters: tuple[str, ...]
    esr: float


@dataclass(frozen=True, eq=False)
class Stepwise:
    """What the step-by-step identification found.

    Attributes
    ----------
    damper : SemiActiveDamper
    steps : tuple of SubProblem
    notes : tuple of str
        Kinds of records that were missing, and what was done instead.
    """

    damper: SemiActiveDamper
    steps: tuple[SubProblem, ...]
    notes: tuple[str, ...]

    def __str__(self) -> str:
        lines = [f"{self.damper.title}: {len(self.damper.parameters)} parameters in {len(self.steps)} steps"]
        lines += [f"  {s.name}: {len(s.parameters)} parameters from {len(s.records)} record(s), training ESR "
                  f"{s.esr:.4g}" for s in self.steps]
        return "\n".join([*lines, *(f"  note: {n}" for n in self.notes)])


@dataclass(frozen=True)
class Sorted:
    """Records by what they are good for.

    Attributes
    ----------
    slow : tuple of int
        Constant current and very low speed: gas.
    constant : mapping of int to tuple of int
        By node: constant current near it.
    switching : tuple of int
        The current moves: lag.
    between : tuple of int
        Constant current far from every node.
    """

    slow: tuple[int, ...] = ()
    constant: dict[int, tuple[int, ...]] = field(default_factory=dict)
    switching: tuple[int, ...] = ()
    between: tuple[int, ...] = ()


def identify_stepwise(damper: SemiActiveDamper, records: Sequence[Record],
                      settings: FitSettings | None = None) -> Stepwise:
    """Identify a semi-active damper in small steps, each warm-started by the one before.

    1. Gas spring from slow runs: F = k_1 x + F_0 + a sign v + b v, a and b being friction that is thrown away.
    2. The row of each current node from records at that constant current, from the lowest node on.
    3. Delays and time constants from records in which the current moves.

    A kind of record that is missing is made up for by a joint fit: gas with the first row, rows without a record of
    their own together with the lag; `notes` states so. The result is a good start for `fit`, which moves everything.

    Parameters
    ----------
    damper : ForceMap or ExtendedBoucWen
        Structure; its values start the search.
    records : sequence of Record
        Mixed; they are sorted here.
    settings : FitSettings, optional
        ``evaluations`` and ``tolerance`` of each step, 60 and 1e-6 where left out; ``sample_rate``.

    Returns
    -------
    Stepwise

    Raises
    ------
    InputError
        Missing channels, records of different polarity, nothing to fit to.

    References
    ----------
    Source 002 (doi 10.3384/ECP14096283), equations (11) to (13).
    """
    settings = settings or FitSettings(evaluations=60, tolerance=1e-6)
    training = prepared(records, tuple(dict.fromkeys((*damper.reads, "force"))), damper.start, settings.sample_rate)
    if not training:
        raise InputError("no records to fit to")
    if common_polarity(training) < 0:
        damper = damper.replace(polarity=-1)
    drives = [damper.drive(r, force=True) for r in training]
    if damper.nodes:
        u = np.concatenate([d.current for d in drives])
        damper = damper.replace(current_range=(float(u.min()), float(u.max())),
                                current_unit=training[0].unit("current") or damper.current_unit)
    with single_thread():
        return _identify(damper, drives, [r.name for r in training], settings)


def stepwise_start(damper: SemiActiveDamper, drives: Sequence[Drive]) -> SemiActiveDamper:
    """A quick step-by-step identification as a start for `fit`.

    Parameters
    ----------
    damper : SemiActiveDamper
        Structure; its values start the search.
    drives : sequence of Drive
        With forces.

    Returns
    -------
    SemiActiveDamper
        Found by short searches.
    """
    quick = FitSettings(evaluations=15, short_evaluations=6, tolerance=1e-4)
    return _identify(damper, drives, [""] * len(drives), quick).damper


def sort_records(damper: SemiActiveDamper, drives: Sequence[Drive]) -> Sorted:
    """Separate slow runs, constant currents by node, and moving currents.

    Parameters
    ----------
    damper : SemiActiveDamper
        Gives the current nodes; without nodes no current counts.
    drives : sequence of Drive
        One for each record.

    Returns
    -------
    Sorted
        Places in `drives`.
    """
    fastest = max(float(np.abs(d.velocity).max()) for d in drives)
    nodes = np.array(damper.nodes or (0.0,))
    gap = np.diff(nodes).min() if nodes.size > 1 else np.inf
    slow, constant, switching, between = [], {}, [], []
    for i, d in enumerate(drives):
        u = float(np.median(d.current)) if damper.nodes else 0.0
        node = int(np.argmin(np.abs(nodes - u)))
        if damper.nodes and np.ptp(d.current) > STEADY * np.ptp(nodes):
            switching.append(i)
        elif np.quantile(np.abs(d.velocity), 0.99) < SLOW * fastest:
            slow.append(i)
        elif abs(nodes[node] - u) <= NEAR * gap:
            constant.setdefault(node, []).append(i)
        else:
            between.append(i)
    return Sorted(tuple(slow), {j: tuple(constant[j]) for j in sorted(constant)}, tuple(switching), tuple(between))


def _identify(damper: SemiActiveDamper, drives: Sequence[Drive], names: Sequence[str],
              settings: FitSettings) -> Stepwise:
    damper = at_size(damper, Sizes.of(drives))
    kinds, steps, notes = sort_records(damper, drives), [], []

    def step(name: str, used: Sequence[int], found: tuple[str, ...], esr: float) -> None:
        steps.append(SubProblem(name, tuple(names[i] for i in used), found, esr))

    gas = tuple(damper.gas_values)
    known = gas_from_slow(damper, [drives[i] for i in kinds.slow])
    if known is not None:
        damper = damper.with_values(**known[0])
        step("gas", kinds.slow, gas, known[1])
    else:
        notes.append("no slow run in both directions: the gas spring is fitted together with the first row")
    joint = () if known is not None else gas
    fitted, warm = [], None
    for j, used in kinds.constant.items():
        part = [drives[i] for i in used]
        row = damper.row(j)
        own = tuple(p.name for p in row.row_parameters)
        starts = row.row_starts(part, known is not None) if warm is None else [warm]
        warm, esr = best_of([s if joint else s.with_values(**row.gas_values) for s in starts], part, (*own, *joint),
                          settings)
        damper = damper.with_row(j, warm)
        mark = f"_{j + 1}" if damper.nodes else ""
        label = f"row at {damper.at(j)}" if damper.nodes else "row"
        step(label, used, (*(f"{n}{mark}" for n in own), *joint), esr)
        joint = ()
        fitted.append(j)
    missing = [j for j in range(damper.rows) if j not in fitted]
    rest = [*kinds.switching, *kinds.between]
    damper = _filled(damper, fitted, [drives[i] for i in rest], settings)
    if missing:
        notes.append(f"no constant current near {', '.join(damper.at(j) for j in missing)}: these rows are "
                     f"{'fitted jointly with the lag' if rest else 'taken from their neighbours'}")
    if damper.current_lag.parameters and not kinds.switching:
        notes.append("no record in which the current moves: delays and time constants stay as they were")
    if rest:
        damper, found, esr = _joint(damper, [drives[i] for i in rest], missing, joint, bool(kinds.switching), settings)
        step("lag" if not missing else "lag and rows", rest, found, esr)
        undetermined = unseen(damper, [drives[i] for i in rest], found)
        if undetermined:
            notes.append(f"{', '.join(undetermined)} not identifiable from these records: kept as before")
    return Stepwise(damper, tuple(steps), tuple(notes))


def gas_from_slow(damper: SemiActiveDamper, drives: Sequence[Drive]) -> tuple[dict[str, float], float] | None:
    """Gas parameters halfway between slow extension and slow compression, and the ESR; None where that fails.

    F = k_1 x + F_0 + a sign v + b v by least squares: without b v, what grows with the speed of a motion counts in part
    as spring. At one speed only a + b|v| can be determined, which leaves k_1 and F_0 unchanged. Friction that
    differs between the directions cannot be separated from preload here: half the difference goes there.

    Parameters
    ----------
    damper : SemiActiveDamper
        Which gas parameters it has.
    drives : sequence of Drive
        Slow runs at constant current, with forces.

    Returns
    -------
    (dict of str to float, float) or None
        Values by name, SI, and the ESR of the line with friction. None without drives, where one direction is
        less than a tenth of the moving samples, or where a spring is wanted and nothing moves.
    """
    if not drives:
        return None
    x, v, f = joined(drives, "displacement", "velocity", "force")
    moving = np.abs(v) > 0.3 * np.quantile(np.abs(v), 0.9)
    x, v, f, side = x[moving], v[moving], f[moving], np.sign(v[moving])
    spring = "gas_stiffness" in damper.gas_values
    if min(np.mean(side > 0), np.mean(side < 0)) < 0.1 or (spring and np.ptp(x) == 0):
        return None
    columns = np.column_stack([*([x] if spring else []), np.ones(x.size), side, v])
    found = np.linalg.lstsq(columns, f, rcond=None)[0]
    if spring and found[0] < 0:
        found = np.concatenate([[0.0], np.linalg.lstsq(columns[:, 1:], f, rcond=None)[0]])
    esr = float(np.sum((columns @ found - f) ** 2) / max(np.sum((f - f.mean()) ** 2), 1e-300))
    return dict(zip(damper.gas_values, map(float, found), strict=False)), esr


def _filled(damper: D, fitted: Sequence[int], rest: Sequence[Drive], settings: FitSettings) -> D:
    """Rows without records of their own: between their neighbours, or one row fitted to everything that is left."""
    if len(fitted) == damper.rows:
        return damper
    if not fitted:
        row, _ = best_of(damper.row(0).row_starts(rest, False), rest, damper.row(0).names,
                       replace(settings, evaluations=min(settings.evaluations, 25)))
        for j in range(damper.rows):
            damper = damper.with_row(j, row)
        return damper
    nodes = np.array(damper.nodes)
    known = np.array([[damper.row(j).values[p.name] for p in damper.row_parameters] for j in fitted])
    for j in set(range(damper.rows)) - set(fitted):
        values = [float(np.interp(nodes[j], nodes[list(fitted)], column)) for column in known.T]
        row = damper.row(j).with_values(**dict(zip((p.name for p in damper.row_parameters), values, strict=True)))
        damper = damper.with_row(j, row)
    return damper


def _joint(damper: D, drives: Sequence[Drive], missing: Sequence[int], gas: tuple[str, ...], moves: bool,
           settings: FitSettings) -> tuple[D, tuple[str, ...], float]:
    """Lag from records in which the current moves, then with it the rows that have no records of their own."""
    lag = damper.current_lag
    names = tuple(p.name for p in lag.parameters) if moves else ()
    starts = [damper]
    if names:
        starts += [damper.with_values(**{n: drives[0].sample_time * (t if "time" in n else d) for n in names})
                   for t, d in LAGS]
    found, esr = best_of(starts, drives, names, settings)
    rows = tuple(f"{p.name}_{j + 1}" for j in missing for p in damper.row_parameters)
    if rows or gas:
        found, esr = best_of([found], drives, (*names, *rows, *gas), settings)
    return found, (*names, *rows, *gas), esr
