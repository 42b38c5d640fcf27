"""Basis: what every family of functions of the scheduling can do."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from lpvid.codec import Coded
from lpvid.scheduling.variables import Scheduling


class Basis(Coded, ABC):
    """Functions φ_1(p) … φ_M(p) of the scheduling variables, in physical units outside, normalised inside.

    A basis is bound to a box by `bound`; unbound it takes p as it is.
    """

    NOUN = "basis"
    JSON = ("kind", ...)

    names: tuple[str, ...]

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
    def redundant(self) -> int | None:
        """Index of a function to drop where a second copy of the constant would make regressors dependent."""
        return 0

    @property
    def unity(self) -> np.ndarray | None:
        """(M,) coefficients with which the functions add up to the constant 1; None where they do not."""
        return None

    def __mul__(self, other: Basis) -> Basis:
        """A basis that spans all products of the two; `lpvid.scheduling.algebra.products` has the coefficients."""
        from lpvid.scheduling.algebra import products

        return products(self, other)[0]

    def __or__(self, other: Basis) -> Basis:
        """A basis that spans both; `lpvid.scheduling.algebra.common` has the coefficients."""
        from lpvid.scheduling.algebra import common

        return common(self, other)[0]
