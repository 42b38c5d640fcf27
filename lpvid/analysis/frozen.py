"""A model with its scheduling held still: matrices along straight lines through the scheduling space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.hull import Hull, design_hull
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Basis, Scheduling

Model = LPVTransferFunction | LPVStateSpace

CAVEAT = ("Frozen stability holds every scheduling value still: it does not cover a moving scheduling variable, "
          "for which certify_stability is the test.")


@dataclass(frozen=True, eq=False)
class Line:
    """A straight line p(s) = origin + s·direction through the scheduling space.

    Along one variable's axis s is that variable in its own unit, and ``low``…``high`` its box.

    Parameters
    ----------
    label, unit : str
        What s is; along a direction it has no unit.
    origin, direction : (n_scheduling,) array
        In the units of the variables.
    low, high : float
        Values of s inside the box, or the hull of a design; −1 and 1 where the line misses the box.
    """

    label: str
    unit: str
    origin: np.ndarray
    direction: np.ndarray
    low: float
    high: float

    def points(self, s: np.ndarray | float) -> np.ndarray:
        """(n, n_scheduling) points for `s` of shape (n,).

        Parameters
        ----------
        s : float or (n,) array
            Values along the line.

        Returns
        -------
        (n, n_scheduling) array
            One row for a single value.
        """
        return self.origin + np.atleast_1d(np.asarray(s, dtype=float))[:, None] * self.direction

    @property
    def centre(self) -> float:
        """Middle of the range."""
        return 0.5 * (self.low + self.high)

    @property
    def half_width(self) -> float:
        """Half the range; 1 for a range without width."""
        half = 0.5 * (self.high - self.low)
        return half if half > 1e-12 * max(abs(self.low), abs(self.high), 1e-300) else max(abs(self.centre), 1.0)

    def text(self, value: float) -> str:
        """A value of s with its unit.

        Parameters
        ----------
        value : float
            Of s.

        Returns
        -------
        str
            Six digits.
        """
        return f"{value:.6g} {self.unit}".rstrip()


def lines(model: Model, variable: str | Sequence[str] | None = None,
          at: Mapping[str, float] | Sequence[float] | None = None,
          direction: Mapping[str, float] | Sequence[float] | None = None) -> tuple[Line, ...]:
    """The line along `direction` through `at`, or the axis of every variable (or of those named) through `at`.

    `at` is a point or a mapping of names, by default the middle of the box, or of the hull for which a controller or
    loop was designed; variables left out of a mapping stay there.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        Its box names the variables.
    variable : str or sequence of str, optional
        Variables whose axes to follow; all by default.
    at : mapping or (n_scheduling,) sequence, optional
        A point of every line, in the variables' units.
    direction : mapping or (n_scheduling,) sequence, optional
        In the variables' units; what a mapping leaves out is constant.

    Returns
    -------
    tuple of Line
        Empty for a model without scheduling variables.

    Raises
    ------
    InputError
        Both a variable and a direction, a direction of zeros, an unknown name, or a vector of another length.
    """
    box, hull = model.box, design_hull(model)
    origin = _vector(at, box, "at", box.centre if hull is None else hull.middle)
    if direction is not None:
        if variable is not None:
            raise InputError("give either a variable or a direction", got=f"both '{variable}' and {direction}")
        along = _vector(direction, box, "direction", np.zeros(len(box.names)))
        if not np.any(along):
            raise InputError("a direction needs a component other than zero", got=direction)
        terms = [f"{x:+.4g}·{n}" for n, x in zip(box.names, along, strict=True) if x]
        found = Line(f"s (along {' '.join(terms)})", "", origin, along, *_range(box, origin, along))
        return (_inside(hull, found),)
    wanted = box.names if variable is None else _checks.names(variable, "variable")
    return tuple(_inside(hull, _axis(box, _checks.known_name(name, box.names, "scheduling variable"), origin))
                 for name in wanted)


def _inside(hull: Hull | None, line: Line) -> Line:
    """The line with its range inside a hull; unchanged where it misses the hull."""
    span = None if hull is None else hull.span(line.origin, line.direction)
    return line if span is None else replace(line, low=span[0], high=span[1])


def _axis(box: Scheduling, name: str, origin: np.ndarray) -> Line:
    i = box.names.index(name)
    along = np.zeros(len(box.names))
    along[i] = 1.0
    return Line(name, box.units[i], np.where(along > 0, 0.0, origin), along, box.lower[i], box.upper[i])


def _vector(given: Mapping[str, float] | Sequence[float] | None, box: Scheduling, what: str,
            otherwise: np.ndarray) -> np.ndarray:
    if given is None:
        return otherwise
    if isinstance(given, Mapping):
        vector = np.array(otherwise, dtype=float)
        for name, value in given.items():
            vector[box.names.index(_checks.known_name(name, box.names, "scheduling variable"))] = value
        return _checks.finite(vector, what)
    vector = np.atleast_1d(_checks.frozen_array(given, what))
    return _checks.finite(_checks.shaped(vector, (len(box.names),), what), what)


def _range(box: Scheduling, origin: np.ndarray, along: np.ndarray) -> tuple[float, float]:
    """The part of the line inside the box; (−1, 1) where it misses the box."""
    low, high = -np.inf, np.inf
    for start, step, lower, upper in zip(origin, along, box.lower, box.upper, strict=True):
        if step:
            first, last = sorted(((lower - start) / step, (upper - start) / step))
            low, high = max(low, first), min(high, last)
        elif not lower <= start <= upper:
            return -1.0, 1.0
    return (low, high) if low < high else (-1.0, 1.0)


# -- matrices ---------------------------------------------------------------------------------------------------------
@dataclass(frozen=True, eq=False)
class FrozenMatrix:
    """A matrix constant + Σ_m tensor[..., m, :, :] φ_m; leading axes of `tensor` stand for several models.

    Parameters
    ----------
    constant : (N, N) array
        What does not move.
    tensor : (..., M, N, N) array
        One matrix for each basis function φ_m.
    """

    constant: np.ndarray
    tensor: np.ndarray

    def at(self, phi: np.ndarray) -> np.ndarray:
        """(..., n, N, N) matrices for basis values `phi` of shape (n, M).

        Parameters
        ----------
        phi : (n, M) array
            Values of the basis at n points.

        Returns
        -------
        (..., n, N, N) array
            For every model and point.
        """
        return self.constant + np.einsum("pm,...mij->...pij", phi, self.tensor, optimize=True)

    def size_at(self, phi: np.ndarray) -> np.ndarray:
        """(n,) how large the terms are that are added up in `at`: the yardstick of its rounding error.

        Parameters
        ----------
        phi : (n, M) array
            Values of the basis at n points.

        Returns
        -------
        (..., n) array
            Largest absolute row sum of the terms.
        """
        terms = np.abs(self.constant) + np.einsum("pm,...mij->...pij", np.abs(phi), np.abs(self.tensor), optimize=True)
        return terms.sum(axis=-1).max(axis=-1)


@dataclass(frozen=True, eq=False)
class FrozenFamily:
    """The frozen models as a matrix family whose eigenvalues are the poles.

    ``plus`` and ``minus`` are singular exactly where a pole is +1 or −1 (discrete); ``plus`` where a pole is 0
    (continuous). For a transfer function they are D(±1, p) itself, of the size of the output.

    Parameters
    ----------
    basis : Basis
        Of held scheduling values.
    matrix : FrozenMatrix
        (N, N) A, or companion matrix, whose eigenvalues are the poles.
    plus : FrozenMatrix
        Of size N, or of the number of outputs.
    minus : FrozenMatrix or None
        None in continuous time.
    sample_time : float or None
        [s]; None in continuous time.
    """

    basis: Basis
    matrix: FrozenMatrix
    plus: FrozenMatrix
    minus: FrozenMatrix | None
    sample_time: float | None

    @property
    def discrete(self) -> bool:
        """True for discrete time."""
        return self.sample_time is not None

    @property
    def order(self) -> int:
        """Number of poles."""
        return self.matrix.constant.shape[-1]

    def matrices(self, p: np.ndarray) -> np.ndarray:
        """(n, N, N) frozen state matrices at `p` of shape (n, n_scheduling).

        Parameters
        ----------
        p : (n, n_scheduling) array
            Held scheduling values.

        Returns
        -------
        (..., n, N, N) array
            Leading axes stand for several models.
        """
        return self.matrix.at(basis_values(self.basis, p))

    def poles(self, p: np.ndarray) -> np.ndarray:
        """(n, N) frozen poles at `p`.

        Parameters
        ----------
        p : (n, n_scheduling) array
            Held scheduling values.

        Returns
        -------
        (..., n, N) complex array
            z, or s [1/s]; in no order.
        """
        return np.linalg.eigvals(self.matrices(p)).astype(complex)


def family(model: Model) -> FrozenFamily:
    """The frozen family of one model.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        Discrete, or a continuous state space.

    Returns
    -------
    FrozenFamily
        With na·n_outputs poles of a transfer function, one for each state of a state space.
    """
    if isinstance(model, LPVTransferFunction):
        na, ny, m = model.na, model.n_outputs, model.basis.size
        n = na * ny
        tensor = np.zeros((m, n, n))
        tensor[:, :, :ny] = -np.moveaxis(model.a, -1, 0).reshape(m, n, ny)
        shift = np.zeros((n, n))
        shift[: n - ny, ny:] = np.eye(n - ny) if n else 0.0
        ends = []
        for sign in (1.0, -1.0):
            signs = sign ** np.arange(1, na + 1)
            ends.append(FrozenMatrix(np.eye(ny), np.einsum("i,ijkm->mjk", signs, model.a)))
        return FrozenFamily(model.basis.still(), FrozenMatrix(shift, tensor), ends[0], ends[1], model.sample_time)
    eye, zero = np.eye(model.order), np.zeros((model.order, model.order))
    matrix = FrozenMatrix(zero, model.A)
    if not model.is_discrete:
        return FrozenFamily(model.basis.still(), matrix, matrix, None, None)
    return FrozenFamily(
        model.basis.still(), matrix, FrozenMatrix(-eye, model.A), FrozenMatrix(eye, model.A), model.sample_time
    )


def stability_margin(poles: np.ndarray, discrete: bool) -> np.ndarray:
    """|λ| − 1 (discrete) or Re λ (continuous) of every pole: negative where it decays.

    Parameters
    ----------
    poles : complex array
        z, or s [1/s].
    discrete : bool
        Discrete time.

    Returns
    -------
    array
        Of the same shape.
    """
    return np.abs(poles) - 1.0 if discrete else np.real(poles)


def pole_margins(a: np.ndarray, discrete: bool) -> np.ndarray:
    """(N,) largest `stability_margin` of the poles of each matrix: negative where all of them decay.

    Parameters
    ----------
    a : (N, n, n) array
        State matrices.
    discrete : bool
        Discrete time.

    Returns
    -------
    (N,) array
        −∞ without states.
    """
    return stability_margin(np.linalg.eigvals(a), discrete).max(axis=1, initial=-np.inf)


# -- bases ------------------------------------------------------------------------------------------------------------


def basis_values(basis: Basis, p: np.ndarray) -> np.ndarray:
    """(n, M) values at unrelated points `p` (n, n_scheduling), not along a trajectory.

    Parameters
    ----------
    basis : Basis
        M functions.
    p : (n, n_scheduling) array
        Every point is held by itself.

    Returns
    -------
    (n, M) array
        Also of a basis that reads p at several times.
    """
    if basis.lags == (0, 0):
        return basis.evaluate(p)
    return np.vstack([basis.evaluate(point[None, :]) for point in p])


def breakpoints(basis: Basis, names: Sequence[str], line: Line) -> np.ndarray:
    """Rising values of s at which a spline's next piece begins.

    Parameters
    ----------
    basis : Basis
        With its knots.
    names : sequence of str
        All scheduling variables, in the order of the line's points.
    line : Line
        Along which they lie.

    Returns
    -------
    (·,) array
        In the unit of the line; empty for a basis without pieces, and where its variables stand still.
    """
    parts = []
    for name, knots in basis.knots_of.items():
        i = list(names).index(name)
        if line.direction[i]:
            parts.append((np.array(knots) - line.origin[i]) / line.direction[i])
    return np.unique(np.concatenate(parts)) if parts else np.empty(0)
