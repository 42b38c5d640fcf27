"""Settings of a diagnosis."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DiagnosisSettings:
    """How to diagnose.

    Attributes
    ----------
    seed : int
        Of the sign patterns.
    fit_baseline : bool
        Whether the baseline is fitted first; False for one whose parameters are given.
    """

    seed: int = 0
    fit_baseline: bool = True
