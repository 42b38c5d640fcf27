"""LPV systems from a function p → system, or from systems at points, with the error of what lies in between.

The system is linear between the knots of a grid, which is refined where it misses the function: at the middle, and at a
second place, of every cell. `finer` holds the function's own values at four times as many points; a synthesis looks at
its closed loop there too (`lpvid.synthesis.carried_error`), so that the error does not hide in its promise.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Scheduling
from lpvid.synthesis.design_grid import interpolating, tensor
from lpvid.synthesis.weights import as_it_stands

if TYPE_CHECKING:
    import control

    System = control.StateSpace | control.TransferFunction | LPVStateSpace | tuple

LOOKED_AT = (0.5, 0.30901699437494745)
"""where in a cell the function is compared with the table: the middle, where a smooth one is missed most, and a place
that no period of the grid's own fits"""
DENSER = 4
"""times as many points in `finer`: the error of linear interpolation falls with the square, to a sixteenth"""
MOST = 400
"""knots above which the grid is refined no further; inequalities are imposed at every one of them"""


def from_function(function: Callable[..., System], box: Scheduling | Mapping[str, tuple[float, float]], *,
                  tolerance: float = 1e-3, points: int = 3, inputs: Sequence[str] = (), outputs: Sequence[str] = ()
                  ) -> LPVStateSpace:
    """The LPV system of a function that gives a time-invariant system for every value of the scheduling.

    Parameters
    ----------
    function : callable
        p (a number; for several variables an array in the order of the box) → python-control system, constant
        `LPVStateSpace` or (A, B, C, D). Its states must mean the same at every p.
    box : Scheduling or mapping of name to (lower, upper)
    tolerance : float
        Error of an entry between knots, as a share of its largest size in the box, at which the grid is fine enough.
    points : int
        Knots per variable to begin with.
    inputs, outputs : sequence of str, optional
        Names; left out, those of the systems.

    Returns
    -------
    LPVStateSpace
        ``metadata["interpolation"]`` has the largest ``error`` found, the ``knots``, and ``finer``, the same system
        with more of the function's own values.

    Raises
    ------
    InputError
        Systems of unequal size or period, values that are not finite.

    Examples
    --------
    >>> system = from_function(lambda p: ([[-1 / p]], [[1.0]], [[1.0]], [[0.0]]), {"p": (0.2, 2.0)})
    >>> system.metadata["interpolation"]["error"] < 1e-3, len(system.metadata["interpolation"]["knots"]["p"]) > 20
    (True, True)
    >>> bool(abs(system.frozen([0.33])[0][0, 0] + 1 / 0.33) < 1e-3 * 5)
    True
    """
    box = box if isinstance(box, Scheduling) else _box(box)
    _checks.positive(tolerance, "the tolerance of the interpolation")
    asked = _Asked(function, len(box.names))
    axes = [np.linspace(low, high, _checks.count(points, "points of a grid", at_least=2)) if high > low
            else np.array([low]) for low, high in zip(box.lower, box.upper, strict=True)]
    axes, error = _refined(asked, axes, tolerance)
    return _assembled(asked, box, axes, error, inputs, outputs)


def from_grid(systems: Mapping[Any, System] | str | Path, box: Scheduling | None = None, *,
              names: Sequence[str] | str = (), tolerance: float = 1e-3, inputs: Sequence[str] = (),
              outputs: Sequence[str] = ()) -> LPVStateSpace:
    """The LPV system through systems that are known at points of a full grid, with an estimate of what lies between.

    Between four points or more the entries follow monotone cubics (Fritsch & Carlson 1980), which the table is refined
    to within `tolerance`. What the cubics themselves miss cannot be known from the points; leaving out every second
    point shows what they would have missed there, and a quarter of that (h² rule) is the stated error.

    Parameters
    ----------
    systems : mapping of point to system, or path of a MAT file
        A point is a number, or a tuple over several variables; systems as for `from_function`. A MAT file (version 5)
        holds A, B, C, D with the grid's axes last, a vector for each scheduling variable, and Ts where it is discrete.
    box : Scheduling, optional
        With rate bounds and units; left out, the range of the points.
    names : sequence of str, optional
        Scheduling variables; left out, those of the box or the file, or p (p1, p2 …).
    tolerance, inputs, outputs
        As for `from_function`.

    Returns
    -------
    LPVStateSpace
        As `from_function` gives it.

    Raises
    ------
    InputError
        Points that form no full grid, systems of unequal size or period, a file without the matrices.

    Examples
    --------
    >>> points = np.linspace(0.5, 2.0, 9)
    >>> system = from_grid({p: ([[-1 / p]], [[1.0]], [[1.0]], [[0.0]]) for p in points}, names="speed")
    >>> system.box.names, bool(1e-4 < system.metadata["interpolation"]["error"] < 0.05)
    (('speed',), True)
    """
    if isinstance(systems, str | Path):
        from lpvid.synthesis.mat_grid import read_mat_grid

        own, systems = read_mat_grid(Path(systems))
        names = names or (box.names if box is not None else own)
    points = np.array([np.atleast_1d(np.asarray(p, dtype=float)) for p in systems])
    if points.ndim != 2 or not len(points):
        raise InputError("a grid needs systems at points of equally many variables", got=list(systems))
    names = _names(names, box, points.shape[1])
    axes = [np.unique(column) for column in points.T]
    if len(points) != np.prod([len(a) for a in axes]):
        raise InputError(f"the points of {', '.join(names)} form no full grid", got=f"{len(points)} points",
                         mend="give a system for every combination of the values")
    order = np.lexsort(points.T[::-1])
    listed = list(systems.values())
    known = _Asked(lambda p: listed[int(order[_place(axes, np.atleast_1d(p))])], len(names))
    table = known.at(tensor(tuple(axes))).reshape(*(len(a) for a in axes), -1)
    between, missed = _between(axes, table), _left_out(axes, table)
    box = box or Scheduling(names, tuple(a[0] for a in axes), tuple(a[-1] for a in axes))
    if any(a[0] > low or a[-1] < high for a, low, high in zip(axes, box.lower, box.upper, strict=True)):
        raise InputError("the grid does not reach the ends of the box", got=[(float(a[0]), float(a[-1])) for a in axes],
                         mend="narrow the box, or add systems at its ends")
    shaped = _Asked(None, len(names), known, between)
    inside = [a if low == high else np.unique(np.concatenate([[low, high], a[(a > low) & (a < high)]]))
              for a, low, high in zip(axes, box.lower, box.upper, strict=True)]
    inside = [a[:1] if low == high else a for a, low, high in zip(inside, box.lower, box.upper, strict=True)]
    inside, error = _refined(shaped, inside, tolerance)
    return _assembled(shaped, box, inside, error + missed, inputs, outputs)


class _Asked:
    """A function's systems as rows of one length, each requested once."""

    def __init__(self, function: Callable[..., Any] | None, variables: int, model: _Asked | None = None,
                 rows: Callable[[np.ndarray], np.ndarray] | None = None) -> None:
        self.function, self.variables, self.rows = function, variables, rows
        self.found: dict[tuple[float, ...], np.ndarray] = {}
        self.shape: tuple[int, int, int] | None = None if model is None else model.shape
        self.period: float | None = None if model is None else model.period
        self.labels: tuple[tuple[Signal, ...], tuple[Signal, ...]] = ((), ()) if model is None else model.labels

    def at(self, points: np.ndarray) -> np.ndarray:
        """(N, entries) of [A B; C D] at points."""
        if self.rows is not None:
            return self.rows(points)
        return np.array([self._one(tuple(map(float, p))) for p in points])

    def _one(self, point: tuple[float, ...]) -> np.ndarray:
        if point not in self.found:
            assert self.function is not None
            value = point[0] if self.variables == 1 else np.array(point)
            try:
                system = self.function(value)
            except ArithmeticError as error:
                raise InputError("the function has no value", got=f"{error} at {point}",
                                 mend="narrow the box to where the function is defined") from error
            (a, b, c, d), period, labels = _plain(system)
            shape = (len(a), d.shape[1], d.shape[0])
            if self.shape is None:
                self.shape, self.period, self.labels = shape, period, labels
            if shape != self.shape or period != self.period:
                raise InputError("the systems differ in states, inputs, outputs or sampling period",
                                 got=f"{shape} at {point}, {self.shape} elsewhere", mend="bring them to common states")
            whole = np.block([[a, b], [c, d]]) if a.size or d.size else np.zeros((0, 0))
            if not np.all(np.isfinite(whole)):
                raise InputError("a system has entries that are not finite", got=f"at {point}",
                                 mend="narrow the box to where the function is defined")
            self.found[point] = whole.ravel()
        return self.found[point]

    def system(self, box: Scheduling, axes: Sequence[np.ndarray], metadata: dict) -> LPVStateSpace:
        """The table over some knots."""
        rows = self.at(tensor(tuple(axes)))
        assert self.shape is not None
        n, nu, ny = self.shape
        whole = rows.reshape(len(rows), n + ny, n + nu)
        basis = interpolating(box, tuple(axes))
        return LPVStateSpace.of(whole, n, basis, self.period, box.part(basis.names), inputs=self.labels[0],
                                outputs=self.labels[1], metadata=metadata)


def _plain(system: Any) -> tuple[tuple[np.ndarray, ...], float | None, tuple[tuple[Signal, ...], tuple[Signal, ...]]]:
    """A, B, C, D, the sampling period and the signals of one system."""
    if isinstance(system, tuple | list):
        if len(system) != 4:
            raise InputError("a system is four matrices A, B, C, D", got=f"{len(system)} parts")
        d = np.atleast_2d(np.asarray(system[3], dtype=float))
        n = len(np.atleast_2d(np.asarray(system[0], dtype=float))) if np.size(system[0]) else 0
        a, b, c = (np.asarray(m, dtype=float).reshape(s) for m, s in
                   zip(system[:3], ((n, n), (n, d.shape[1]), (d.shape[0], n)), strict=True))
        return (a, b, c, d), None, ((), ())
    if isinstance(system, LPVStateSpace):
        if system.box.names:
            raise InputError("the function must give a system without scheduling", got=repr(system),
                             mend="freeze it: system.frozen(p)")
        return system.frozen([]), system.sample_time, (system.inputs, system.outputs)
    import control

    if not isinstance(system, control.StateSpace | control.TransferFunction):
        raise InputError("the function must give a python-control system or (A, B, C, D)", got=type(system).__name__)
    return _plain(as_it_stands(system))


def _refined(asked: _Asked, axes: list[np.ndarray], tolerance: float) -> tuple[list[np.ndarray], float]:
    """Knots between which the table misses the function by less than a tolerance, and the largest share missed."""
    while True:
        more: list[list[float]] = [[] for _ in axes]
        error = 0.0
        table = asked.at(tensor(tuple(axes)))
        size = np.abs(table).max(axis=0, initial=0.0)
        for i, axis in enumerate(axes):
            for low, high in itertools.pairwise(axis):
                for share in LOOKED_AT:
                    inner = [*axes[:i], np.array([low + share * (high - low)]), *axes[i + 1 :]]
                    ends = [asked.at(tensor((*axes[:i], np.array([end]), *axes[i + 1 :]))) for end in (low, high)]
                    truth = asked.at(tensor(tuple(inner)))
                    off = np.abs(truth - (1 - share) * ends[0] - share * ends[1]).max(axis=0)
                    scale = np.maximum(size, np.abs(truth).max(axis=0))
                    missed = float((off / np.where(scale > 0, scale, 1.0)).max(initial=0.0))
                    error = max(error, missed)
                    if missed > tolerance:
                        more[i].append(0.5 * (low + high))
        finer = [np.unique(np.concatenate([a, m])) for a, m in zip(axes, more, strict=True)]
        if not any(more) or np.prod([len(a) for a in finer]) > MOST:
            return axes, error
        axes = finer


def _assembled(asked: _Asked, box: Scheduling, axes: list[np.ndarray], error: float, inputs: Sequence[str],
               outputs: Sequence[str]) -> LPVStateSpace:
    """The table with what is known of its error; an exact one needs nothing finer."""
    note: dict[str, Any] = {"error": error, "knots": {n: a.tolist() for n, a in zip(box.names, axes, strict=True)}}
    if error > 1e-12:
        dense = [np.unique(np.concatenate([np.linspace(a, b, DENSER + 1) for a, b in itertools.pairwise(axis)]))
                 if len(axis) > 1 else axis for axis in axes]
        note["finer"] = _named(asked.system(box, dense, {}), inputs, outputs).to_dict()
    return _named(asked.system(box, axes, {"interpolation": note}), inputs, outputs)


def _named(system: LPVStateSpace, inputs: Sequence[str], outputs: Sequence[str]) -> LPVStateSpace:
    changes = {what: tuple(Signal(n) for n in _checks.names(given, what))
               for what, given in (("inputs", inputs), ("outputs", outputs)) if given}
    return system.replace(**changes) if changes else system


def _between(axes: list[np.ndarray], table: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Rows between the points of a grid: monotone cubics where there are four points or more, straight lines else."""
    from scipy.interpolate import PchipInterpolator

    def rows(points: np.ndarray) -> np.ndarray:
        found = []
        for p in points:
            value = table
            for axis, x in zip(axes, p, strict=True):
                if len(axis) == 1:
                    value = value[0]
                elif len(axis) < 4:
                    k = int(np.clip(np.searchsorted(axis, x) - 1, 0, len(axis) - 2))
                    share = (x - axis[k]) / (axis[k + 1] - axis[k])
                    value = (1 - share) * value[k] + share * value[k + 1]
                else:
                    value = PchipInterpolator(axis, value, axis=0)(x)
            found.append(value)
        return np.array(found)

    return rows


def _left_out(axes: list[np.ndarray], table: np.ndarray) -> float:
    """A quarter of what is missed at every second point when it is left out, as a share of each entry's size."""
    worst, size = 0.0, np.abs(table).reshape(-1, table.shape[-1]).max(axis=0, initial=0.0)
    scale = np.where(size > 0, size, 1.0)
    for i, axis in enumerate(axes):
        if len(axis) < 3:
            continue
        kept = np.unique([*range(0, len(axis), 2), len(axis) - 1])
        coarse = [a if j != i else a[kept] for j, a in enumerate(axes)]
        rows = _between(coarse, np.take(table, kept, axis=i))
        truth = table.reshape(-1, table.shape[-1])
        missed = np.abs(rows(tensor(tuple(axes))) - truth).max(axis=0)
        worst = max(worst, float((missed / scale).max(initial=0.0)) / 4)
    return worst


def _place(axes: list[np.ndarray], point: np.ndarray) -> int:
    index = 0
    for axis, x in zip(axes, point, strict=True):
        index = index * len(axis) + int(np.searchsorted(axis, x))
    return index


def _box(ranges: Mapping[str, tuple[float, float]]) -> Scheduling:
    return Scheduling(tuple(ranges), tuple(r[0] for r in ranges.values()), tuple(r[1] for r in ranges.values()))


def _names(names: Sequence[str] | str, box: Scheduling | None, count: int) -> tuple[str, ...]:
    listed = _checks.names(names, "the scheduling") if names else tuple(box.names) if box is not None else (
        ("p",) if count == 1 else tuple(f"p{i + 1}" for i in range(count)))
    if len(listed) != count:
        raise InputError("scheduling names do not match the points", got=f"{', '.join(listed)} for {count} variable(s)")
    if box is not None and tuple(box.names) != listed:
        raise InputError("the box names other variables", got=f"{', '.join(box.names)} against {', '.join(listed)}")
    return listed
