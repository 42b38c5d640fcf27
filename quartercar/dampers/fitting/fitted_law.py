"""FittedLaw: what the search for a law's parameters needs of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Protocol

import numpy as np

from quartercar.dampers.drive import Drive
from quartercar.dampers.parameter import Parameter


class FittedLaw(Protocol):
    """A law with physical parameters; `quartercar.dampers.families.LawDamper` is one.

    Attributes
    ----------
    name : str
        Of the model.
    real_runs : bool
        Whether differences of runs take the place of complex steps in linear parameters.
    of_typical_size : bool
        Whether its parameters are carried over from `quartercar.dampers.sizes.TYPICAL` sizes to those of the data.
    """

    name: ClassVar[str]
    real_runs: ClassVar[bool]
    of_typical_size: ClassVar[bool]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """With bounds."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters."""
        ...

    @property
    def linear(self) -> tuple[str, ...]:
        """Parameters in which the force is affine while the others are held."""
        ...

    @property
    def start(self) -> int:
        """Samples from which a run starts."""
        ...

    @property
    def vector(self) -> np.ndarray:
        """Values of the parameters."""
        ...

    def with_vector(self, vector: np.ndarray) -> Any:
        """The damper at other values.

        Parameters
        ----------
        vector : (P,) array

        Returns
        -------
        FittedLaw
        """
        ...

    def response(self, drive: Drive, vector: np.ndarray) -> np.ndarray:
        """Free run.

        Parameters
        ----------
        drive : Drive
        vector : (P,) array

        Returns
        -------
        (n,) array
            [N].
        """
        ...

    def sensitivity(self, drive: Drive, vector: np.ndarray, columns: Sequence[int]) -> np.ndarray:
        """Its derivative in the parameters at these places.

        Parameters
        ----------
        drive : Drive
        vector : (P,) array
        columns : sequence of int

        Returns
        -------
        (n, len(columns)) array
            [N per unit of the parameter]; a new array, which the caller scales in place.
        """
        ...

    def starts(self, drives: Sequence[Drive], count: int, rng: np.random.Generator) -> list[np.ndarray]:
        """Starting vectors, the most promising first.

        Parameters
        ----------
        drives : sequence of Drive
        count : int
            At most so many.
        rng : numpy.random.Generator

        Returns
        -------
        list of (P,) arrays
        """
        ...
