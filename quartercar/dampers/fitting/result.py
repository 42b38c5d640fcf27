"""DamperFit: a fitted damper, how well it runs freely, and what the data determine of its parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lpvid.codec import encode
from lpvid.toolkit import Shown
from lpvid.validation.figures import Figures
from quartercar.dampers.contract import Damper
from quartercar.dampers.evaluation.passivity import Passivity
from quartercar.dampers.evaluation.scoring import Score
from quartercar.dampers.fitting.estimate import Estimate


@dataclass(frozen=True, eq=False)
class DamperFit(Shown):
    """Result of `fit`.

    Attributes
    ----------
    estimate : Estimate
    training_score : Score
    held_out_score : Score or None
    passivity : Passivity
        Of the damper itself, whatever the polarity of the records.
    flags : tuple of str
        What must be known before the fit is used.
    notes : tuple of str
    seconds : float
        Time that the fit took [s].
    """

    DRAWN_BY: ClassVar[str] = "quartercar.plot.drawings"

    estimate: Estimate[Damper]
    training_score: Score
    held_out_score: Score | None
    passivity: Passivity
    flags: tuple[str, ...]
    notes: tuple[str, ...]
    seconds: float

    @property
    def damper(self) -> Damper:
        """With the fitted values."""
        return self.estimate.damper

    @property
    def training(self) -> Figures:
        """Free-run figures on the training data."""
        return self.training_score.total.figures

    @property
    def held_out(self) -> Figures | None:
        """Free-run figures on the held-out data."""
        return None if self.held_out_score is None else self.held_out_score.total.figures

    @property
    def covariance(self) -> np.ndarray | None:
        """(P, P) of the parameters; NaN where they were held at a bound."""
        return self.estimate.covariance

    @property
    def std(self) -> dict[str, float | None]:
        """Standard error by parameter, SI; None where it was held at a bound or nothing is known of it."""
        names = self.damper.names
        if self.covariance is None:
            return dict.fromkeys(names)
        with np.errstate(invalid="ignore"):
            spread = np.sqrt(np.diag(self.covariance))
        return {n: float(s) if np.isfinite(s) and n not in self.unidentified else None
                for n, s in zip(names, spread, strict=True)}

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Parameters held at a bound."""
        return self.estimate.at_bounds

    @property
    def undetermined(self) -> tuple[str, ...]:
        """A sentence for each combination that the data leave open."""
        return self.estimate.undetermined

    @property
    def unidentified(self) -> tuple[str, ...]:
        """Parameters not identifiable from the data; their values only serve to run the model."""
        return self.estimate.unidentified

    @property
    def n_samples(self) -> int:
        """Samples in the training figures."""
        return self.training.n_samples

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Plain values by name.
        """
        starts = self.estimate.starts
        return {"schema": "quartercar/fit/1", "damper": encode(self.damper.to_dict()),
                "training": self.training_score.to_dict(),
                "held_out": None if self.held_out_score is None else self.held_out_score.to_dict(),
                "standard_errors": self.std, "covariance": encode(self.covariance), "at_bounds": list(self.at_bounds),
                "undetermined": list(self.undetermined), "unidentified": list(self.unidentified),
                "condition": encode(self.estimate.condition),
                "starts": None if starts is None else {"searched": starts.searched, "polished": starts.polished,
                                                       "agreed": starts.agreed},
                "passivity": self.passivity.to_dict(), "flags": list(self.flags), "notes": list(self.notes),
                "seconds": self.seconds}

    def __repr__(self) -> str:
        lines = [f"DamperFit of {self.damper.title}, {len(self.damper.names)} parameters: "
                 f"{_line('training', self.training_score)}"]
        if self.held_out_score is not None:
            lines.append(f"  {_line('held-out', self.held_out_score)}")
        return "\n".join(lines + _parameters(self) + _caveats(self))


def _line(label: str, score: Score) -> str:
    run = score.total
    root = "" if run.sqrt_sse is None else f", √SSE {run.sqrt_sse:.4g} N with N = {run.n_samples}"
    energy = "" if score.energy_error is None else f", energy error {100 * score.energy_error:.2g} %"
    beyond = (f", {100 * score.extrapolation_share:.0f} % of its currents outside the fitted range"
              if score.extrapolation_share else "")
    return f"{label} {run.figures}{root}{energy}{beyond}"


def _parameters(found: DamperFit) -> list[str]:
    spread, out = found.std, []
    for p in found.damper.parameters:
        if p.name in found.unidentified:
            out.append(f"{p.name} [{p.unit or '1'}] not identifiable")
            continue
        error = spread[p.name]
        held = " (at its bound)" if p.name in found.at_bounds else ""
        known = "" if error is None else f" ± {error:.2g}"
        out.append(f"{p.name} {found.damper.values[p.name]:.4g}{known} {p.unit}".rstrip() + held)
    return [f"  {', '.join(out[:6])}" + (f", … {len(out)} in all" if len(out) > 6 else "")]


def _caveats(found: DamperFit) -> list[str]:
    starts = [] if found.estimate.starts is None else [f"  {found.estimate.starts}"]
    return [*starts, f"  {found.passivity}", *(f"  FLAG: {f}" for f in found.flags[:2]),
            *(f"  undetermined: {u}" for u in found.undetermined[:2]), *(f"  note: {n}" for n in found.notes[:1])]
