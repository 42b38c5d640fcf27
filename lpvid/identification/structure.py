"""What every structure offers to `identify`: its channels, how much data it needs, and its estimate."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from lpvid.identification.result import Identification
from lpvid.record import Record


class Structure(ABC):
    """A model structure with its estimator's settings; subclasses are frozen dataclasses."""

    @property
    @abstractmethod
    def channels(self) -> tuple[str, ...]:
        """Inputs, outputs and scheduling variables that the estimate reads."""

    @property
    @abstractmethod
    def start(self) -> int:
        """Samples at the head of every record that only serve as a past."""

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
