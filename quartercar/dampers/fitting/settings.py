"""FitSettings: how long and how widely a fit searches."""

from __future__ import annotations

from dataclasses import dataclass

from lpvid.errors import InputError
from lpvid.toolkit import checks


@dataclass(frozen=True)
class FitSettings:
    """Settings of `fit`.

    Attributes
    ----------
    starts : int
        Starting points searched from on shortened data.
    polished : int
        Of those, how many are followed on all data.
    seed : int
        Of the starting points; the same seed gives the same fit.
    evaluations : int
        Simulations of one polish, at most.
    short_evaluations, short_samples : int
        Simulations of one search on shortened data, and its samples, at most.
    tolerance : float
        Least predicted decrease of the cost by a step, relative.
    sample_rate : float or None
        Resample to this rate [Hz] first; needed for jittered or mixed clocks.
    polarity : {1, −1} or None
        Sense of the force where longer records have shown it; None to look for it in the records of the fit, which part
        of a slow cycle can mislead: a spring gives and takes.

    Examples
    --------
    >>> FitSettings(starts=0)
    Traceback (most recent call last):
    ...
    lpvid.errors.InputError: starts must be a whole number of at least 1: got 0.
    """

    starts: int = 20
    polished: int = 3
    seed: int = 0
    evaluations: int = 200
    short_evaluations: int = 15
    short_samples: int = 3000
    tolerance: float = 1e-9
    sample_rate: float | None = None
    polarity: int | None = None

    def __post_init__(self) -> None:
        for name in ("starts", "polished", "evaluations", "short_evaluations", "short_samples"):
            checks.count(getattr(self, name), name, at_least=1)
        checks.count(self.seed, "seed")
        checks.positive(self.tolerance, "tolerance")
        if self.polarity not in (1, -1, None):
            raise InputError("polarity is 1, -1 or None", got=self.polarity)
