"""What every structure offers to `identify`: its channels, how much data it needs, and its estimate."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, TypeVar

import numpy as np

from lpvid.codec import Encoded
from lpvid.identification.result import Identification
from lpvid.named_classes import NamedClasses
from lpvid.record import Record

S = TypeVar("S")


class Structure(Encoded, ABC):
    """A model structure with its estimator's settings; subclasses are frozen dataclasses.

    One that `register_structure` or the entry-point group ``lpvid.structures`` makes known by its ``name`` is offered
    by ``lpvid identify --structure``; its options are those of its fields that have one.

    Attributes
    ----------
    KIND : str
        What files call it where it has no ``name``.
    """

    KIND: ClassVar[str] = ""

    @property
    @abstractmethod
    def channels(self) -> tuple[str, ...]:
        """Inputs, outputs and scheduling variables that the estimate reads."""

    @property
    @abstractmethod
    def start(self) -> int:
        """Samples at the head of every record that only serve as a past."""

    @property
    def summary(self) -> str:
        """The structure in a few words, for tables of many."""
        text = repr(self)
        return text if len(text) < 100 else text[:97] + "..."

    @abstractmethod
    def estimate(self, records: Sequence[Record]) -> Identification:
        """Fit to uniform, finite records of one rate (what `condition.segments` returns).

        Parameters
        ----------
        records : sequence of Record
            Training records with the channels that `channels` names.

        Returns
        -------
        Identification
            Model, parameter covariance and what the fit reports.
        """

    def coloured_covariance(self, records: Sequence[Record], found: Identification, memory: int) -> np.ndarray | None:
        """Covariance of the estimate when its residual is correlated over `memory` samples.

        None where the estimator has no such form, has used it already, or the data are too short for it.

        Parameters
        ----------
        records : sequence of Record
            The records of the fit.
        found : Identification
            The fit.
        memory : int
            Length of the residual's correlation [samples].

        Returns
        -------
        (P, P) array or None
            Covariance of the parameters.
        """
        return None

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON: the name as ``kind``, then every field.

        Returns
        -------
        dict
            Plain values by name.
        """
        return {"kind": getattr(self, "name", self.KIND or type(self).__name__), **super().to_dict()}


NAMED: tuple[tuple[str, str, str], ...] = ()
"""Structures of this package whose options on the command line are their fields: name, module, class. A new structure
adds its line here; the older ones have options of their own in `lpvid.cli.structures.TAKES`."""
STRUCTURES = NamedClasses("structure", "lpvid.structures", NAMED, "lpvid.identification.structure:Structure")
"""`NAMED`, those of other packages (entry points ``lpvid.structures``), and those that `register_structure` adds."""


def register_structure(cls: type[S]) -> type[S]:
    """Make a structure of the running program known by its name; serves as a decorator.

    Parameters
    ----------
    cls : type
        A frozen dataclass derived from `Structure`, or from a structure of this package, with a ``name``.

    Returns
    -------
    type
        `cls` itself.

    Raises
    ------
    InputError
        Methods that it lacks, or a name that is taken.
    """
    return STRUCTURES.register(cls)
