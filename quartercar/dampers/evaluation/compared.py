"""What a comparison of damper models holds: a row for each model, a table, plain data for JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from lpvid.caveat import Caveat
from lpvid.codec import encode
from lpvid.errors import InputError
from lpvid.remark import Cost
from lpvid.toolkit import Shown
from quartercar.dampers.contract import Damper
from quartercar.dampers.evaluation.passivity import Passivity
from quartercar.dampers.evaluation.sampled_passivity import certificate_for, margin_of
from quartercar.dampers.evaluation.scoring import Score
from quartercar.dampers.fitting import DamperFit
from quartercar.dampers.preparing import Prepared

SCHEMA = "quartercar/comparison/1"
FLAGS: Mapping[str, str] = {
    "diverged": "the free run diverged",
    "not-passive": "the fitted law gives energy somewhere in its range",
    "at-bounds": "a parameter ended at a physical bound",
    "undetermined": "the data leave a combination of parameters open",
    "reversed-polarity": "the records measure the force against the velocity",
    "extrapolates": "held-out currents lie outside those of the fit",
    "fitted-before": "it was fitted to rows of these held-out data, which for it are training data",
}
"""What each flag means."""
HEADED = "reversed-polarity"
"""Flag that stands above the table, not in each of its rows."""
FITTED_BEFORE = "fitted-before"
"""Flag of a model whose held-out figure is in truth one on training data."""


@dataclass(frozen=True, eq=False)
class Compared:
    """One model of a comparison.

    Attributes
    ----------
    damper : Damper
    fit : DamperFit or None
        None for a model compared as it was given.
    training, held_out : Score
        On the same samples for all models.
    time_per_simulated_second : float
        Compiled and warm [1].
    passivity : Passivity
    flags : tuple of str
        Keys of `FLAGS`.
    """

    damper: Damper
    fit: DamperFit | None
    training: Score
    held_out: Score
    time_per_simulated_second: float
    passivity: Passivity
    flags: tuple[str, ...]

    @property
    def name(self) -> str:
        """As on the command line; a model compared as given states so."""
        return self.damper.name + self._given

    @property
    def title(self) -> str:
        """As in a table."""
        return self.damper.title + self._given

    @property
    def _given(self) -> str:
        """What separates a model compared as given from a fitted one; a label that repeats its name does not."""
        label = self.damper.metadata.get("label", "as given")
        return "" if self.fit is not None else f" ({'as given' if label == self.damper.name else label})"

    @property
    def parameters(self) -> list[dict[str, Any]]:
        """Name, value, standard error and unit of each; no value where it is not identifiable from the data."""
        spread, lost = ({}, ()) if self.fit is None else (self.fit.std, self.fit.unidentified)
        return [{"name": p.name, "value": None if p.name in lost else self.damper.values[p.name],
                 "std": spread.get(p.name), "unit": p.unit} for p in self.damper.parameters]

    def to_dict(self, rank: int) -> dict:
        """Plain data for JSON.

        Parameters
        ----------
        rank : int
            Place in the comparison, counted from 1.

        Returns
        -------
        dict
            Plain values by name.
        """
        found = self.fit
        return {"name": self.name, "title": self.title, "source": self.damper.source, "rank": rank,
                "fitted": found is not None, "held_out": self.held_out.to_dict(), "training": self.training.to_dict(),
                "energy_error": self.held_out.energy_error, "extrapolation_share": self.held_out.extrapolation_share,
                "n_parameters": len(self.damper.parameters),
                "time_per_simulated_second": self.time_per_simulated_second, "parameters": self.parameters,
                "settings": encode(self.damper.settings), "flags": list(self.flags),
                "passivity": self.passivity.to_dict(), "at_bounds": [] if found is None else list(found.at_bounds),
                "undetermined": [] if found is None else list(found.undetermined),
                "unidentified": [] if found is None else list(found.unidentified),
                "notes": [] if found is None else list(found.notes),
                "fit_seconds": None if found is None else found.seconds,
                "fit_samples": None if found is None else found.n_samples}


@dataclass(frozen=True, eq=False)
class Comparison(Shown):
    """Damper models ranked by held-out free-run ESR.

    Attributes
    ----------
    rows : tuple of Compared
        Best first; those that diverged last.
    not_fitted : tuple of (str, str)
        Name and reason.
    data : Prepared
        The records as every model saw them.
    first : int
        Samples at the head of every record that count for no model, because one of them starts from them.
    notes : tuple of str
    complete : bool
        False when it was interrupted.
    """

    DRAWN_BY: ClassVar[str] = "quartercar.plot.drawings"

    rows: tuple[Compared, ...]
    not_fitted: tuple[tuple[str, str], ...]
    data: Prepared
    first: int
    notes: tuple[str, ...]
    complete: bool = True

    @property
    def best(self) -> Compared:
        """The first row."""
        return self.rows[0]

    def __getitem__(self, name: str) -> Compared:
        for row in self.rows:
            if row.name == name:
                return row
        raise InputError(f"no compared model '{name}'", got=", ".join(r.name for r in self.rows))

    def with_notes(self, notes: Sequence[str]) -> Comparison:
        """The same with further notes.

        Parameters
        ----------
        notes : sequence of str
            Put after its own.

        Returns
        -------
        Comparison
            A copy.
        """
        return replace(self, notes=(*self.notes, *notes))

    @property
    def fails(self) -> bool:
        """Whether no fitted model simulates the data that it was fitted to better than their mean does."""
        errors = [row.training.total.esr for row in self.rows if row.fit is not None]
        return bool(errors) and all(e is None or e >= 1 for e in errors)

    @property
    def verdict(self) -> str:
        """One sentence, or two where no fitted model can be used."""
        best, run = self.best, self.best.held_out.total
        if run.esr is None:
            return "No model simulates the held-out data: every free run diverges, or the force does not move."
        place = f" is best of {len(self.rows)} models" if len(self.rows) > 1 else ""
        seen = ", some of which it was fitted to" if FITTED_BEFORE in best.flags else ""
        stated = (f"{best.title}{place}: free-run ESR {run.esr:.4g} on held-out data{seen} (fit "
                f"{run.fit_percent:.1f} %, rmse {run.rmse:.4g} N)")
        if len(self.rows) > 1 and (second := self.rows[1].held_out.total.esr) is not None:
            stated += f", before {self.rows[1].title} with {second:.4g}"
        if self.fails:
            stated += ". No fitted model simulates the data that it was fitted to better than their mean"
        return f"{stated}{'' if self.complete else '. INTERRUPTED: not all models were fitted'}."

    def to_dict(self) -> dict:
        """comparison.json.

        Returns
        -------
        dict
            Plain values by name.
        """
        data = self.data
        return {"schema": SCHEMA, "verdict": self.verdict, "complete": self.complete,
                "best": self.best.name if self.best.held_out.total.esr is not None else None,
                "models": [row.to_dict(i) for i, row in enumerate(self.rows, start=1)],
                "not_fitted": [{"name": name, "why": why} for name, why in self.not_fitted],
                "data": {"training": [{"name": r.name, "n_samples": r.n_samples} for r in data.training],
                         "held_out": [{"name": r.name, "n_samples": r.n_samples} for r in data.held_out],
                         "sample_rate": data.sample_rate, "polarity": data.polarity, "first_sample": self.first,
                         "current_unit": data.training[0].unit("current") if data.training[0].has("current") else None},
                "notes": list(self.notes)}

    def __str__(self) -> str:
        total, count = self.best.held_out.total.n_samples, len(self.data.held_out)
        caveats = [n for n in self.notes if isinstance(n, Caveat)]
        lines = [*(n[0].upper() + n[1:] + "." for n in caveats), self.verdict, "",
                 f"  {'free run, held-out':<28}{'ESR':>9}{'fit %':>7}{'√SSE N':>11}{'rmse N':>9}{'energy':>11}"
                 f"{'training':>10}{'par.':>5}{'ms/s':>8}  flags"]
        lines += [f"{i:2d} {_row(row)}" for i, row in enumerate(self.rows, start=1)]
        lines.append(f"  N = {total:,} samples in {count} record{'s' * (count > 1)} at {self.data.sample_rate:.6g} Hz; "
                     "'training' is the ESR on training data, ms/s the time to simulate a second")
        lines += [f"  {line}" for row in self.rows for line in (*energy_lines(row.damper), *_costs(row))]
        lines += [f"  not fitted: {', '.join(names)}: {why}" for why, names in self._refusals().items()]
        lines += [f"  note: {n}" for n in self.notes if n not in caveats]
        return "\n".join(lines)

    def _refusals(self) -> dict[str, list[str]]:
        """Models by the reason why they were not fitted."""
        groups: dict[str, list[str]] = {}
        for name, why in self.not_fitted:
            groups.setdefault(why, []).append(name)
        return groups

    __repr__ = __str__


def energy_lines(damper: Damper) -> list[str]:
    """Where an identified damper gives energy, or what certifies that it gives none.

    Parameters
    ----------
    damper : Damper
        Of any kind.

    Returns
    -------
    list of str
        One line, or none: no transfer function from velocity to force inside, or neither energy given nor a
        certificate.
    """
    margin = margin_of(damper)
    if margin is None:
        return []
    if margin.active:
        return [f"{damper.name} is NOT passive: {margin.statement()}: --passive"]
    certificate = certificate_for(damper)
    return [] if certificate is None else [f"{damper.name} {certificate.verdict}: {certificate.claim}"]


def _costs(row: Compared) -> list[str]:
    """What a constraint costs a fitted model."""
    return [f"{row.name}, {n}" for n in (() if row.fit is None else row.fit.notes) if isinstance(n, Cost)]


def _row(row: Compared) -> str:
    run = row.held_out.total

    def shown(value: float | None, pattern: str) -> str:
        return "–" if value is None else format(value, pattern)

    share = row.held_out.energy_error
    energy = "–" if share is None else f"{100 * share:.3g} %"
    return (f"{row.name:<28}{shown(run.esr, '.4g'):>9}{shown(run.fit_percent, '.1f'):>7}"
            f"{shown(run.sqrt_sse, '.4g'):>11}{shown(run.rmse, '.4g'):>9}{energy:>11}"
            f"{shown(row.training.total.esr, '.4g'):>10}{len(row.damper.parameters):>5}"
            f"{1e3 * row.time_per_simulated_second:>8.2g}  {', '.join(f for f in row.flags if f != HEADED)}".rstrip())
