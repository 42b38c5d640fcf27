"""Selection: what `select` found, ranked, with the reason for every place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid._shown import Shown
from lpvid.identification.result import Identification
from lpvid.identification.structure import Structure


def describe(structure: Structure) -> str:
    """A structure in a few words: its `summary`.

    Parameters
    ----------
    structure : Structure

    Returns
    -------
    str
    """
    return structure.summary


@dataclass(frozen=True, eq=False)
class CandidateRow:
    """One candidate's figures; what was not computed is None.

    Attributes
    ----------
    structure : Structure
    n_parameters : int or None
    bic, aicc : float or None
        Of the one-step residual on the training data.
    one_step : float or None
        Training one-step fit [%].
    outside : float or None
        Share of training samples with a frozen pole outside the unit circle.
    esr, esr_error : float or None
        Cross-validated free-run ESR and its standard error over the folds.
    esr_folds : tuple of float
        ESR of every fold, of which `esr` is the mean; empty where it was not cross-validated.
    reason : str
        Why it stands where it stands.
    """

    structure: Structure
    n_parameters: int | None = None
    bic: float | None = None
    aicc: float | None = None
    one_step: float | None = None
    outside: float | None = None
    esr: float | None = None
    esr_error: float | None = None
    esr_folds: tuple[float, ...] = ()
    reason: str = ""

    @property
    def fit_percent(self) -> float | None:
        """Cross-validated free-run fit [%]."""
        return None if self.esr is None else float(100 * (1 - np.sqrt(self.esr)))

    @property
    def diverges(self) -> bool:
        """Whether its cross-validated free run is no better than the mean of the output: a fit of 0 % or less."""
        return self.esr is not None and self.esr >= 1.0

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Plain values by name.
        """
        return {"structure": self.structure.summary, "n_parameters": self.n_parameters,
                "bic_one_step_training": self.bic, "aicc_one_step_training": self.aicc,
                "one_step_fit_percent_training": self.one_step, "frozen_outside_share_training": self.outside,
                "free_run_esr_cross_validated": self.esr, "free_run_esr_standard_error": self.esr_error,
                "free_run_esr_by_fold": list(self.esr_folds),
                "free_run_fit_percent_cross_validated": self.fit_percent, "reason": self.reason}

    def __str__(self) -> str:
        size = "" if self.n_parameters is None else f" ({self.n_parameters} parameters)"
        figure = ""
        if self.esr is not None:
            figure = f": free-run CV ESR {self.esr:.4g} ± {self.esr_error:.1g} (fit {self.fit_percent:.1f} %)"
        elif self.one_step is not None:
            figure = f": one-step training fit {self.one_step:.1f} %"
        return f"{self.structure.summary}{size}{figure}; {self.reason}"


@dataclass(frozen=True, eq=False)
class Selection(Shown):
    """The structure chosen, the ranking behind it, and the estimate on all training data.

    Attributes
    ----------
    best : Structure
        As it was among the candidates: stages by name where they were requested by name.
    table : tuple of CandidateRow
        Cross-validated candidates by free-run error, then the others by BIC, then those refused.
    identification : Identification or None
        Refit on all training records; None when the search was interrupted before it.
    complete : bool
        False after an interruption: the ranking holds what was done until then.
    folds : int
        Blocks of the cross-validation; a note states where one more fold held out the furthest stretches.
    notes : tuple of str
    left_out : tuple of str
        What the budget did not allow, in the order of the search; empty where it went through.
    """

    best: Structure
    table: tuple[CandidateRow, ...]
    identification: Identification | None
    complete: bool = True
    folds: int = 5
    notes: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def comparison(self) -> str:
        """How many were compared, and by what."""
        tested = [r for r in self.table if r.esr is not None]
        folds = len(tested[0].esr_folds) if tested else self.folds
        return (f"{len(self.table)} candidates, {len(tested)} cross-validated in free run over {folds} folds of the "
                "training data, the others left earlier for the reasons beside them")

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Plain values by name.
        """
        return {"schema": "lpvid/selection/1", "best": self.best.summary, "complete": self.complete,
                "folds": self.folds, "candidates": len(self.table), "table": [r.to_dict() for r in self.table],
                "identification": None if self.identification is None else self.identification.to_dict(),
                "notes": list(self.notes), "left_out": list(self.left_out)}

    def __repr__(self) -> str:
        head = f"Selection: {self.best.summary}"
        lines = [head if self.complete else head + " (INTERRUPTED: the ranking is not complete)",
                 f"  {self.comparison}"]
        if self.identification is not None:
            fitted = self.identification
            lines += [f"  {v.label}: {v.summary()}" for v in (fitted.training, fitted.held_out) if v is not None]
        lines += [f"  {i}. {row}" for i, row in enumerate(self.table[:5], start=1)]
        return "\n".join([*lines, *(f"  note: {n}" for n in self.notes[:2])])
