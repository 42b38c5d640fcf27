"""Validation: the figures of a model on a data set, and how they print."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid._shown import Shown
from lpvid.validation.figures import FigurePair, Figures, RecordFigures
from lpvid.validation.regimes import Regime
from lpvid.validation.residuals import ResidualTest
from lpvid.validation.trust import held_out_doubt


@dataclass(frozen=True, eq=False)
class Validation(Shown):
    """Figures of a model on a data set; `label` states whether the model has seen these data.

    Attributes
    ----------
    label : str
        "training", "held-out", "partly training" or "held-out or training" (not known).
    overall : FigurePair
        Pooled free-run and one-step figures.
    records : tuple of RecordFigures
    residual_tests : tuple of ResidualTest
        On one-step residuals.
    extrapolation_share : float
        Share of samples whose scheduling lies outside the training box, or outside the convex hull of the training
        scheduling where the model has one.
    regimes : tuple of Regime
        Where the free run is wrong.
    k_steps : tuple of Figures
        Pooled figures of the prediction horizons requested.
    notes : tuple of str
    independent_samples : float or None
        That determine the free-run error of the first output as well as these do; None where not determined.
    from_estimated_past : Figures or None
        Free run of the same samples from an estimated past, where that of `overall`, from measured samples, shows its
        start more than the model (`lpvid.validation.starting`).
    """

    label: str
    overall: FigurePair
    records: tuple[RecordFigures, ...]
    residual_tests: tuple[ResidualTest, ...]
    extrapolation_share: float
    notes: tuple[str, ...] = ()
    regimes: tuple[Regime, ...] = ()
    k_steps: tuple[Figures, ...] = ()
    independent_samples: float | None = None
    from_estimated_past: Figures | None = None

    @property
    def judged(self) -> tuple[RecordFigures, ...]:
        """The records whose free run has a figure or diverges; the others' output does not move."""
        return tuple(r for r in self.records if r.free_run.esr is not None or r.free_run.diverged_at is not None)

    @property
    def worst(self) -> RecordFigures | None:
        """The record whose free run is worst: one that diverges, else the largest ESR; None for a single record."""
        if len(self.judged) < 2:
            return None
        return max(self.judged, key=lambda r: np.inf if r.free_run.esr is None else r.free_run.esr)

    @property
    def doubt(self) -> str | None:
        """Why the free-run fit cannot be trusted (`held_out_doubt`), or None."""
        return held_out_doubt(self.overall.free_run, self.independent_samples)

    def summary(self) -> str:
        """One line of figures.

        Returns
        -------
        str
        """
        return "; ".join(map(str, (self.overall.free_run, self.overall.one_step, *self.k_steps)))

    def to_dict(self) -> dict:
        """validation.json.

        Returns
        -------
        dict
            Plain values by name.
        """
        return {"schema": "lpvid/validation/1", "data": self.label,
                "overall": {**self.overall.to_dict(),
                            **{f.kind.replace("-", "_"): f.to_dict() for f in self.k_steps}},
                "records": [r.to_dict() for r in self.records],
                "residual_tests": [t.to_dict() for t in self.residual_tests],
                "regimes": [r.to_dict() for r in self.regimes],
                "extrapolation_share": self.extrapolation_share, "independent_samples": self.independent_samples,
                "from_estimated_past": None if self.from_estimated_past is None else self.from_estimated_past.to_dict(),
                "doubt": self.doubt, "notes": list(self.notes)}

    def __repr__(self) -> str:
        doubt = "" if self.doubt is None else f"; {self.doubt}"
        lines = [f"Validation ({self.label}{doubt}): {self.summary()}"]
        lines += [f"  {r.name}: {r.free_run}" for r in self.records[:8]]
        if len(self.records) > 8 and self.worst is not None:
            lines.append(f"  worst of {len(self.records)} records, {self.worst.name}: {self.worst.free_run}")
        if self.extrapolation_share >= 5e-4:
            lines.append(f"  {100 * self.extrapolation_share:.1f} % of samples outside the training range of the "
                         "scheduling: the model extrapolates there")
        wrong = sorted((r for r in self.regimes if r.esr is not None), key=lambda r: r.error_share - r.share)
        if wrong and wrong[-1].error_share > 1.3 * wrong[-1].share:
            worst = wrong[-1]
            data = "measured power" if " Hz" in worst.where else "data"
            lines.append(f"  worst where {worst.where}: {100 * worst.error_share:.2g} % of the free-run error in "
                         f"{100 * worst.share:.2g} % of the {data} (ESR there {worst.esr:.3g})")
        lines += [f"  {t.name}: {t.description}" for t in self.residual_tests
                  if t.name in ("whiteness", "independence") or not (t.passed or "whiteness" in t.name)]
        return "\n".join(lines + [f"  note: {n}" for n in self.notes])
