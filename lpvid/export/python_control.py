"""To and from python-control: frozen `StateSpace`, varying `NonlinearIOSystem`, grids of `StateSpace`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.export.control_io_system import labels, nonlinear_io_system
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction, block_companion
from lpvid.realization import Realization, realize
from lpvid.scheduling import Basis, Polynomial, Product, Scheduling, Spline
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.saturated import SaturatedController

if TYPE_CHECKING:
    import control

Model = LPVTransferFunction | LPVStateSpace
UNITS = "lpvid_units"
"""attribute of a python-control system with the units of its signals and of the scheduling, by name."""
__all__ = ["from_control", "frozen_state_space", "nonlinear_io_system", "to_grid"]


# -- frozen ----------------------------------------------------------------------------------------------------------
def frozen_state_space(model: Model, at: Sequence[float] | np.ndarray) -> control.StateSpace:
    """The model with its scheduling frozen, as a python-control `StateSpace`.

    It is the linear part: after an input stage, without affine terms (which only move the operating point). A transfer
    function gives its observer form with order × outputs states.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
    at : (n_scheduling,) array
        Scheduling, SI.

    Returns
    -------
    control.StateSpace
        Discrete with the model's period, or continuous for a continuous model. python-control has no units: they are in
        its attribute `lpvid_units`, where `from_control` finds them again.

    Examples
    --------
    >>> model = LPVTransferFunction.siso([[-0.9, 0.1]], [[0, 0], [0.1, 0]], Polynomial("p", degree=1), 0.01)
    >>> frozen_state_space(model, [1.0]).poles().real.round(6)
    array([0.8])
    """
    import control

    a, b, c, d = model.frozen(at) if isinstance(model, LPVStateSpace) else _frozen_observer(model, at)
    inputs, outputs = labels(model.filter_inputs), labels(model.outputs)
    frozen = control.StateSpace(a, b, c, d, model.sample_time or 0.0, inputs=inputs, outputs=outputs)
    units = dict(zip(model.box.names, model.box.units, strict=False))
    units |= {n: s.unit for n, s in zip((*inputs, *outputs), (*model.filter_inputs, *model.outputs), strict=True)}
    setattr(frozen, UNITS, units)
    return frozen


def to_grid(model: Model, points: Sequence | np.ndarray) -> list[control.StateSpace]:
    """The frozen models at several scheduling points.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
    points : (k,) or (k, n_scheduling) array
        Scheduling points, SI; one-dimensional for a single scheduling variable.

    Returns
    -------
    list of control.StateSpace
    """
    return [frozen_state_space(model, point) for point in _points(points, len(model.box.names))]


def _frozen_observer(model: LPVTransferFunction, at: Sequence[float] | np.ndarray) -> tuple[np.ndarray, ...]:
    a, b, _ = model.coefficients(at)
    ny, nu, n = model.n_outputs, model.n_filter_inputs, model.order
    a = np.concatenate([a, np.zeros((n - len(a), ny, ny))])
    b = np.concatenate([b, np.zeros((n + 1 - len(b), ny, nu))])
    first = np.eye(ny, n * ny)
    return block_companion(a), (b[1:] - a @ b[0]).reshape(n * ny, nu), first, b[0]


# -- back ------------------------------------------------------------------------------------------------------------
def from_control(systems: Sequence[control.StateSpace], at: Sequence | np.ndarray, basis: Basis | None = None, *,
                 names: Sequence[str] | str | None = None, box: Scheduling | None = None,
                 units: Mapping[str, str] | None = None) -> LPVStateSpace:
    """An LPV model from frozen models on a grid of scheduling points.

    The states of all systems must mean the same (as they do in `to_grid`): matrices are fitted entry by entry. Without
    a basis the model is gridded: linear between neighbouring points (multilinear over several variables, whose points
    must then form a full grid) and exact at them. A given basis is fitted by least squares, and
    ``metadata["from_control"]`` holds the largest misfit of any entry.

    Parameters
    ----------
    systems : sequence of control.StateSpace
    at : (k,) or (k, n_scheduling) array
        Scheduling point of each system.
    basis : Basis, optional
    names : sequence of str, optional
        Scheduling variables; left out, those of the basis or p (p1, p2 … for several).
    box : Scheduling, optional
        Left out, the smallest box around the points.
    units : mapping of str to str, optional
        SI units of inputs, outputs and scheduling variables by name; left out, those that `to_control` and `to_grid`
        left with the system.

    Returns
    -------
    LPVStateSpace

    Raises
    ------
    InputError
        Systems of unequal size or period, repeated or too few points.

    Examples
    --------
    >>> import control
    >>> grid = [control.StateSpace([[0.9 - 0.1 * p]], [[1.0]], [[1.0]], [[0.0]], 0.1) for p in (0, 1, 2)]
    >>> float(from_control(grid, [0, 1, 2], names="current").frozen([0.5])[0][0, 0].round(12))
    0.85
    """
    _checks.instance(systems, (Sequence, np.ndarray), "from_control takes a list of systems, one for each point")
    if not systems:
        raise InputError("a grid needs at least one system", got="none")
    period = _common(systems)
    width = None if basis is None else max(len(basis.names), 1)
    points = _points(at, width)
    if len(points) != len(systems):
        raise InputError("every system needs its scheduling point", got=f"{len(systems)} systems, {len(points)} points")
    if len(np.unique(points, axis=0)) < len(points):
        raise InputError("a scheduling point occurs twice", got=points.tolist())
    names = _variable_names(names, basis, box, points.shape[1])
    if basis is None:
        basis = _interpolating(names, points)
    known = {**getattr(systems[0], UNITS, {}), **(units or {})}
    for name in units or {}:
        _checks.known_name(name, (*systems[0].input_labels, *systems[0].output_labels, *names), "signal")
    box = box or Scheduling.of(names, points, units=tuple(known.get(n, "") for n in names))
    basis = basis.bound(box)
    columns = points[:, [names.index(n) for n in basis.names]]
    phi = basis.evaluate(columns)
    if np.linalg.matrix_rank(phi) < basis.size:
        raise InputError(f"{len(points)} scheduling points cannot fix {basis.size} functions of the scheduling",
                         mend="give more points, or a smaller basis")
    matrices, misfit = {}, 0.0
    for name in "ABCD":
        values = np.array([np.asarray(getattr(s, name), dtype=float) for s in systems])
        fitted = np.linalg.lstsq(phi, values.reshape(len(points), -1), rcond=None)[0]
        misfit = max(misfit, float(np.abs(phi @ fitted - values.reshape(len(points), -1)).max(initial=0.0)))
        matrices[name] = fitted.reshape(basis.size, *values.shape[1:])
    kept = Scheduling(*([tuple(getattr(box, f)[box.names.index(n)] for n in basis.names)
                         for f in ("names", "lower", "upper", "rate", "units")]))
    return LPVStateSpace(**matrices, basis=basis, sample_time=period, scheduling=kept,
                         inputs=tuple(Signal(n, known.get(n, "")) for n in systems[0].input_labels),
                         outputs=tuple(Signal(n, known.get(n, "")) for n in systems[0].output_labels),
                         metadata={"from_control": {"points": points.tolist(), "largest_misfit": misfit}})


def _common(systems: Sequence[control.StateSpace]) -> float | None:
    """The period that all systems share (None: continuous), once their sizes agree."""
    sizes = [(s.nstates, s.ninputs, s.noutputs) for s in systems]
    if len(set(sizes)) > 1:
        raise InputError("the systems of a grid differ in states, inputs or outputs", got=sorted(set(sizes)),
                         mend="bring them to common states first")
    periods = {s.dt if s.dt else 0.0 for s in systems}
    if True in [s.dt is True for s in systems]:
        raise InputError("a discrete system without a sampling period", got="dt=True", mend="give it its dt in seconds")
    if len(periods) > 1:
        raise InputError("the systems of a grid differ in their sampling period", got=sorted(periods),
                         mend="sample them alike")
    return float(periods.pop()) or None


def _points(at: Sequence | np.ndarray, width: int | None) -> np.ndarray:
    points = np.asarray(at, dtype=float)
    if points.ndim == 1:
        points = points[:, None] if width != 0 else points.reshape(len(points), 0)
    return _checks.finite(_checks.shaped(points, (None, width), "scheduling points"), "scheduling points")


def _variable_names(names: Sequence[str] | str | None, basis: Basis | None, box: Scheduling | None,
                    count: int) -> tuple[str, ...]:
    if names is not None:
        listed = _checks.names(names, "the scheduling")
    elif box is not None:
        listed = tuple(box.names)
    elif basis is not None and basis.names:
        listed = tuple(basis.names)
    else:
        listed = ("p",) if count == 1 else tuple(f"p{i + 1}" for i in range(count))
    if len(listed) != count:
        raise InputError("scheduling names do not match the points", got=f"{', '.join(listed)} for {count} column(s)")
    if box is not None and tuple(box.names) != listed:
        raise InputError("the box names other variables", got=f"{', '.join(box.names)} against {', '.join(listed)}")
    for name in basis.names if basis is not None else ():
        _checks.known_name(name, listed, "scheduling variable")
    return listed


def _interpolating(names: tuple[str, ...], points: np.ndarray) -> Basis:
    """The basis that is linear between neighbouring grid points of every variable."""
    levels = [np.unique(column) for column in points.T]
    if len(points) != np.prod([len(x) for x in levels]):
        raise InputError(f"the points of {', '.join(names)} form no full grid", got=f"{len(points)} points",
                         mend="give a basis to fit")
    factors: list[Basis] = [Spline(n, len(x) - 1, 1, tuple(x.tolist()))
                            for n, x in zip(names, levels, strict=True) if len(x) > 1]
    if not factors:
        return Polynomial((), 0)
    basis = factors[0]
    for factor in factors[1:]:
        basis = Product(basis, factor)
    return basis


MOST = 500
"""grid points at most; fewer per variable where there are many variables"""
ALONG = 11
"""grid points along one scheduling variable"""


@dataclass(frozen=True, eq=False)
class FrozenGrid:
    """Matrices of a model at points of its scheduling.

    Attributes
    ----------
    names : tuple of str
        Scheduling variables.
    points : (k, variables) array
    a, b, c, d : (rows, columns, k) arrays
    inputs, outputs : tuple of Signal
    """

    names: tuple[str, ...]
    points: np.ndarray
    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    d: np.ndarray
    inputs: tuple
    outputs: tuple


def linear_model(model: Any) -> LPVTransferFunction | LPVStateSpace | None:
    """The LPV model in a noun, where there is one with frozen matrices.

    Parameters
    ----------
    model : object
        A model, a realisation, a synthesis, or a controller that holds a model as its `model`.

    Returns
    -------
    LPVTransferFunction, LPVStateSpace or None
        None for self-scheduled models, dampers and the like.
    """
    if isinstance(model, Synthesis):
        return model.controller
    if isinstance(model, SaturatedController):
        return model.controller
    if isinstance(model, Realization):
        return model.model
    if isinstance(model, (LPVTransferFunction, LPVStateSpace)):
        return model
    inner = getattr(model, "model", None)  # a controller that holds one
    return inner if isinstance(inner, (LPVTransferFunction, LPVStateSpace)) else None


def frozen_grid(model: LPVTransferFunction | LPVStateSpace) -> FrozenGrid:
    """Matrices on an even grid of the box: of the linear part, behind any input stage and scheduling filter.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        A model without scheduling has one point.

    Returns
    -------
    FrozenGrid
        `ALONG` points along one scheduling variable; fewer along each of several, about `MOST` in all.
    """
    count = len(model.box.names)
    along = ALONG if count <= 1 else max(2, int(MOST ** (1 / count)))
    points = model.box.grid(along)
    systems = [frozen_state_space(model, p) for p in points]
    a, b, c, d = (np.stack([np.asarray(getattr(s, m)) for s in systems], axis=2) for m in ("A", "B", "C", "D"))
    return FrozenGrid(model.box.names, points, a, b, c, d, model.filter_inputs, model.outputs)


def varying_state_space(model: LPVTransferFunction | LPVStateSpace) -> LPVStateSpace | None:
    """A state space of the same free run whose matrices need the present scheduling alone; None where there is none.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        Coefficients at p(k−i) are realised in the observable form, others in the augmented one.

    Returns
    -------
    LPVStateSpace or None
        None where the realisation is refused, or where its basis reads p at other samples.
    """
    if isinstance(model, LPVStateSpace):
        found = model
    else:
        try:
            found = realize(model, "observable" if model.lagged else "augmented").model
        except InputError:
            return None
    return found if found.basis.lags == (0, 0) else None
