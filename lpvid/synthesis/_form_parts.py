"""What every conversion between forms needs: the system matrix, the comparison, the system built anew."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError, NumericalError
from lpvid.lmi.certificate import tensor
from lpvid.model.designed import KEY, role_of
from lpvid.model.lft import LFTModel
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Polynomial, Product, Scheduling, Spline
from lpvid.scheduling.algebra import common
from lpvid.synthesis.matrix_function import MatrixFunction

Model = LPVStateSpace | LFTModel
CHECKED = 2000
"""About how many points of the box a conversion is compared at."""


@dataclass(frozen=True, eq=False)
class Conversion:
    """A system in another form, and how far it is from the one it came from.

    Parameters
    ----------
    model : LPVStateSpace or LFTModel
    form : str
        "polynomial", "gridded", "polytopic", "linear-fractional" or "lifted".
    exact : bool
        True where the algebra is exact; `error` is then 0.
    error : float
        max_p ‖S'(p) − S(p)‖₂ / max_p ‖S(p)‖₂ with S = [A B f; C D g], measured at `points` points of the box.
    worst : tuple of float
        Scheduling where that was.
    points : int
    """

    model: Model
    form: str
    exact: bool
    error: float
    worst: tuple[float, ...]
    points: int

    def __str__(self) -> str:
        at = ", ".join(f"{n} = {v:.4g}" for n, v in zip(self.model.box.names, self.worst, strict=False))
        return (f"{self.form}, exact" if self.exact else
                f"{self.form}, off by {self.error:.2e} of the largest system matrix (at {at}; of {self.points} points)")

    __repr__ = __str__


def stated(old: Model, new: Model, form: str, *, exact: bool = False) -> Conversion:
    """The conversion with its error as measured over the box of the old system."""
    points = checking_points(old.box, knots(new))
    before, after = values(old, points), values(new, points)
    gaps = np.linalg.norm(after - before, axis=(1, 2), ord=2) if before[0].size else np.zeros(len(points))
    size = float(np.linalg.norm(before, axis=(1, 2), ord=2).max(initial=0.0)) if before[0].size else 0.0
    error = float(gaps.max(initial=0.0)) / (size or 1.0)
    if exact and error > 1e-8:
        raise NumericalError(f"the exact conversion to the {form} form lost its digits: off by {error:.2e}")
    worst = tuple(points[int(np.argmax(gaps))].tolist())
    return Conversion(new, form, exact, 0.0 if exact else error, worst, len(points))


def checking_points(box: Scheduling, knots: Mapping[str, np.ndarray] | None = None) -> np.ndarray:
    """(N, n) points over the box, with those midway between the knots of a grid."""
    count = len(box.names)
    if not count:
        return np.empty((1, 0))
    each = max(3, round(CHECKED ** (1 / count)))
    axes = []
    for name, low, high in zip(box.names, box.lower, box.upper, strict=True):
        k = (knots or {}).get(name, np.empty(0))
        middle = (k[:-1] + k[1:]) / 2 if len(k) and count <= 2 else np.empty(0)
        axes.append(np.unique(np.concatenate([np.linspace(low, high, each), middle])))
    return tensor(axes)


def knots(model: Model) -> dict[str, np.ndarray]:
    """Breakpoints of every variable of a gridded system."""
    def of(basis: Basis) -> dict[str, np.ndarray]:
        if isinstance(basis, Spline):
            return {basis.name: np.array(basis.knots)}
        return {**of(basis.first), **of(basis.second)} if isinstance(basis, Product) else {}

    return of(model.basis) if isinstance(model, LPVStateSpace) else {}


def values(model: Model, points: np.ndarray) -> np.ndarray:
    """(N, n + n_y, n + n_u + 1) system matrices [A B f; C D g]."""
    if isinstance(model, LPVStateSpace):
        return matrix(model).at(points[:, [model.box.names.index(n) for n in model.basis.names]])
    a, b, c, d = model.at(points)
    return np.block([[a, b, np.zeros((*a.shape[:2], 1))], [c, d, np.zeros((*c.shape[:2], 1))]])


def matrix(system: LPVStateSpace) -> MatrixFunction:
    """[A B f; C D g] over the basis of the system."""
    if system.basis.lags != (0, 0):
        raise InputError("a system that reads its scheduling at several times has no other form",
                         got=", ".join(system.basis.labels), mend="make the delayed variables signals of their own")
    assert system.state_offset is not None and system.output_offset is not None
    return MatrixFunction(system.basis, np.block([[system.A, system.B, system.state_offset[:, :, None]],
                                                  [system.C, system.D, system.output_offset[:, :, None]]]))


def rebuilt(function: MatrixFunction, model: Model) -> LPVStateSpace:
    """The system of a matrix [A B f; C D g], with signals, clock and box of another one."""
    n, x = model.order, function.coefficients
    return LPVStateSpace.of(x[:, :, :-1], n, function.basis, model.sample_time, model.box.part(function.basis.names),
                            state_offset=x[:, :n, -1], output_offset=x[:, n:, -1], inputs=model.inputs,
                            outputs=model.outputs, metadata={KEY: role} if (role := role_of(model)) else {})


def as_polynomial(system: LPVStateSpace) -> MatrixFunction | None:
    """The system matrix over monomials normalised to the box; None for a basis that is no polynomial."""
    function = matrix(system)
    wide, _, into = common(Polynomial(system.box.names, 1).bound(system.box), system.basis)
    if not isinstance(wide, Polynomial):
        return None
    return MatrixFunction(wide, np.tensordot(into.T, function.coefficients, axes=1)).trimmed()
