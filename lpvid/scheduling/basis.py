"""Basis: what every family of functions of the scheduling can do."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping
from typing import Any, ClassVar

import numpy as np

from lpvid import _checks
from lpvid.codec import Coded
from lpvid.errors import InputError
from lpvid.scheduling.reading import Reading
from lpvid.scheduling.variables import Scheduling


class Basis(Coded, ABC):
    """Functions φ_1(p) … φ_M(p) of the scheduling variables, in physical units outside, normalised inside.

    A basis is bound to a box by `bound`; unbound it takes p as it is.

    Attributes
    ----------
    kind : str
        Its name in files; left out, the class with its module.
    """

    NOUN = "basis"
    JSON = ("kind", ...)

    kind: ClassVar[str]
    names: tuple[str, ...]

    product: ClassVar[Callable[[Basis, Basis], Basis]]
    stack: ClassVar[Callable[[Basis, Basis], Basis]]
    delayed: ClassVar[Callable[[Basis, int], Basis]]
    """bases made of bases, which `lpvid.scheduling` sets: they are subclasses, and stand above"""

    def __init_subclass__(cls, *, abstract: bool = False, **others: Any) -> None:
        super().__init_subclass__(**others)
        if not abstract and "kind" not in vars(cls):
            cls.kind = f"{cls.__module__}.{cls.__qualname__}"

    @property
    @abstractmethod
    def size(self) -> int:
        """Number M of functions."""

    @property
    @abstractmethod
    def labels(self) -> tuple[str, ...]:
        """A short name of every function."""

    @property
    @abstractmethod
    def degree(self) -> int | None:
        """Polynomial degree in p along any straight line, or None for a basis that is not polynomial."""

    @property
    @abstractmethod
    def lags(self) -> tuple[int, int]:
        """Smallest and largest delay, in samples, at which p is read; (0, 0) for p(k) alone."""

    @abstractmethod
    def evaluate(self, p: np.ndarray) -> np.ndarray:
        """(n, M) values along a trajectory `p` of shape (n, len(names)); beyond its ends the end values hold.

        Parameters
        ----------
        p : (n, len(names)) array
            Scheduling variables, in their units.

        Returns
        -------
        (n, M) array
            One column for each function.
        """

    @abstractmethod
    def derivative(self, p: np.ndarray, name: str) -> np.ndarray:
        """(n, M) partial derivatives with respect to one variable, per physical unit.

        Parameters
        ----------
        p : (n, len(names)) array
            Scheduling variables, in their units.
        name : str
            The variable.

        Returns
        -------
        (n, M) array
            One column for each function, per unit of the variable.
        """

    @abstractmethod
    def bound(self, box: Scheduling) -> Basis:
        """The same basis, normalised to a box that names its variables.

        Parameters
        ----------
        box : Scheduling
            Range of every variable.

        Returns
        -------
        Basis
            With centres and half widths of the box.
        """

    @property
    def summary(self) -> str:
        """The functions in a few words: their labels where they are few."""
        stated = ", ".join(self.labels) if self.size <= 5 else f"{self.size} functions in {', '.join(self.names)}"
        return f"{{{stated}}}"

    @property
    def redundant(self) -> int | None:
        """Index of a function to drop where a second copy of the constant would make regressors dependent."""
        return 0

    @property
    def unity(self) -> np.ndarray | None:
        """(M,) coefficients with which the functions add up to the constant 1; None where they do not."""
        return None

    def __mul__(self, other: Basis) -> Basis:
        """A basis that spans all products of the two; `lpvid.scheduling.algebra.products` has the coefficients."""
        return Basis.product(self, other)

    def __or__(self, other: Basis) -> Basis:
        """A basis that spans both; `lpvid.scheduling.algebra.common` has the coefficients."""
        return Basis.stack(self, other)

    # -- what an analysis asks; a basis of another package may leave it out -------------------------------------
    def readings(self, shift: int = 0) -> tuple[Reading, ...]:
        """What is read: each variable at each delay, with its degree or frequency and the ends of its pieces.

        Parameters
        ----------
        shift : int
            Further delay [samples].

        Returns
        -------
        tuple of Reading

        Raises
        ------
        InputError
            A basis that is neither piecewise polynomial nor a Fourier basis.
        """
        raise InputError("a stability certificate needs a basis of polynomials, splines or sines",
                         got=type(self).__name__, why="its pieces carry the statement between grid points",
                         mend="turn the state space (lpvid.realize for a transfer function) into one by "
                              "lpvid.to_gridded")

    def ranges(self, limits: Mapping[str, tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of every function over intervals of the variables: exact for monomials, safe for the others.

        Parameters
        ----------
        limits : mapping of str to (float, float)
            Interval of each variable, in its unit.

        Returns
        -------
        lower, upper : (M,) array

        Raises
        ------
        InputError
            A basis whose values have no known bounds.
        """
        raise InputError("the values of this basis have no known bounds", got=type(self).__name__)

    def penalty(self, order: int) -> np.ndarray:
        """Quadratic form of what varies in a combination of the functions.

        Parameters
        ----------
        order : int
            1 for slopes, 2 for curvature.

        Returns
        -------
        (M, M) array
            Zero for the constant.
        """
        return np.diag([0.0 if label == "1" else 1.0 for label in self.labels])

    def trimmed(self, c: np.ndarray) -> tuple[Basis, np.ndarray]:
        """Without what has zero coefficients: high degrees, also inside products, and parts of a stack.

        Parameters
        ----------
        c : (M, …) array
            Coefficients.

        Returns
        -------
        Basis, (M', …) array
            The same function.
        """
        return self, c

    def shifted(self, lag: int) -> Basis:
        """Read at p(k − lag), in one shift at each leaf: nested shifts would hold the end values twice.

        Parameters
        ----------
        lag : int
            Delay [samples].

        Returns
        -------
        Basis
        """
        return Basis.delayed(self, lag) if lag else self

    def still(self) -> Basis:
        """The same functions without delays: with p held still p(k−i) is p.

        Returns
        -------
        Basis
            With lags (0, 0).
        """
        return self

    def piece_degree(self, moving: Collection[str]) -> int | None:
        """Highest polynomial degree along a line between the ends of pieces, or None where there is none.

        Parameters
        ----------
        moving : collection of str
            Variables that change along the line.

        Returns
        -------
        int or None
        """
        return self.degree

    @property
    def knots_of(self) -> Mapping[str, tuple[float, ...]]:
        """Rising values of each variable at which a piece ends."""
        return {}


def checked_basis(basis: object) -> None:
    """Refuse what is no basis, a variable's name for instance.

    Parameters
    ----------
    basis : object

    Raises
    ------
    InputError
        Anything but a `Basis`.
    """
    mend = f'lpv.Polynomial("{basis}", degree=1)' if isinstance(basis, str) else 'lpv.Polynomial("current", degree=1)'
    _checks.instance(basis, Basis, "coefficients depend on the scheduling by a basis", mend)
