"""What `identify` does between reading and writing: structure, fit, forms, audit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.record import Record

if TYPE_CHECKING:
    from lpvid.auditing import Audit
    from lpvid.cli.running import Results
    from lpvid.identification import Identification
    from lpvid.identification.arx import ARX
    from lpvid.report.forms import FormGap
    from lpvid.scheduling import Basis

STRUCTURES = ("arx",)
LATER = ("oe", "bj", "armax", "riv", "subspace")
LEAK_SAMPLES = 200_000
"""Training samples up to which held-out stretches are sought among them."""


@dataclass(frozen=True)
class Request:
    """The command line's wish for a model."""

    input: tuple[str, ...]
    output: tuple[str, ...]
    schedule: tuple[str, ...]
    structure: str
    na: int
    nb: int | tuple[int, ...]
    nk: int | tuple[int, ...] | None
    degree: int
    basis: str
    segments: int
    shape: str | None
    schedule_filter: str | None
    affine: int
    lagged: bool
    ridge: float
    sample_rate: float | None

    def check(self) -> None:
        """Refuse what this version does not have, before any data are read."""
        if self.structure in LATER:
            raise InputError(f"--structure {self.structure} is not part of this version", mend="use --structure arx")
        _checks.one_of(self.structure, STRUCTURES, "--structure")
        self.arx()

    def arx(self) -> ARX:
        """The structure asked for; nk 1 where it was left open."""
        from lpvid.identification.arx import ARX

        return ARX(na=self.na, nb=self.nb, nk=1 if self.nk is None else self.nk, input=self.input, output=self.output,
                   basis=self._basis(), affine=self.affine, lagged=self.lagged, stage=self.shape,
                   schedule_filter=self.schedule_filter, ridge=self.ridge)

    def _basis(self) -> Basis:
        from lpvid.scheduling import Polynomial, Product, Spline

        if self.basis == "polynomial" or not self.schedule:
            return Polynomial(self.schedule, degree=self.degree)
        basis: Basis = Spline(self.schedule[0], segments=self.segments, order=max(self.degree, 1))
        for name in self.schedule[1:]:
            basis = Product(basis, Spline(name, segments=self.segments, order=max(self.degree, 1)))
        return basis


@dataclass(frozen=True, eq=False)
class Outcome:
    """An identification with what the report says about it."""

    found: Identification
    gaps: tuple[FormGap, ...]
    audit: Audit
    training: tuple[Record, ...]
    held_out: tuple[Record, ...]

    def to_dict(self) -> dict:
        """identification.json."""
        findings = [{"name": f.name, "record": f.record, "channel": f.channel, "severity": f.severity}
                    for f in self.audit.findings]
        return {**self.found.to_dict(), "model": "model.json", "realizations": [g.to_dict() for g in self.gaps],
                "audit": {"verdict": self.audit.verdict, "findings": findings}}

    def __str__(self) -> str:
        forms = "; ".join(str(g) for g in self.gaps)
        grave = [f for f in self.audit.findings if f.severity != "note"]
        lines = [repr(self.found), f"  state space: {forms}", f"  audit: {self.audit.verdict}"]
        lines += [f"    {f}" for f in grave[:3]]
        if len(grave) > 3:
            lines.append(f"    and {len(grave) - 3} more: see lpvid inspect")
        return "\n".join(lines)

    def deliver(self, results: Results, form: str | None, say: Callable[[str], None]) -> None:
        """Queue the files."""
        if form is not None:
            from lpvid.realization import realize

            realized = realize(self.found.model, form=form)
        if not results.kept:
            return
        from lpvid.export.serialise import save
        from lpvid.report.figures import comparisons
        from lpvid.report.identification import identification_page

        say("drawing")
        shown = comparisons(self.found.model, self.held_out or self.training,
                            "held-out" if self.held_out else "training")
        results.add("model.json", lambda path: save(self.found.model, path))
        results.json("identification.json", self.to_dict())
        if form is not None:
            results.add("state_space.json", lambda path: save(realized, path))
        results.report(identification_page(self.found, shown, self.gaps, self.audit))


def fit(request: Request, training: Sequence[Record], held_out: Sequence[Record], everything: Sequence[Record],
        say: Callable[[str], None] = lambda text: None) -> Outcome:
    """Audit, choose the delay if it was left open, fit, validate, and realise in every form.

    Parameters
    ----------
    request : Request
    training, held_out : sequence of Record
        What the fit sees, and what it does not.
    everything : sequence of Record
        The raw records, for the audit.
    say : callable
        Told what is being done.

    Returns
    -------
    Outcome
    """
    from lpvid.auditing import audit
    from lpvid.condition import segments, with_velocity
    from lpvid.identification import identify
    from lpvid.identification.delay import choose_delay
    from lpvid.report.forms import form_gaps

    structure, notes = request.arx(), ()
    if request.nk is None:
        say("choosing the first input lag")
        structure, note = choose_delay(training, structure, sample_rate=request.sample_rate)
        notes = (note,)
    say("fitting")
    found = identify(training, structure, sample_rate=request.sample_rate, held_out=held_out or None)
    say("auditing the data")
    heard = audit(everything, scheduling=request.schedule or None)
    say("state-space forms")
    derived = [with_velocity(r) for r in training] if "velocity" in structure.channels else list(training)
    pieces = segments(derived, structure.channels, sample_rate=1 / found.model.sample_time if request.sample_rate
                      else None, minimum=found.model.start + 2)
    gaps = tuple(form_gaps(found.model, pieces))
    notes += _leak_note(pieces, held_out, found)
    polarity = _polarity(heard)
    model = found.model.replace(metadata={**found.model.metadata, **polarity})
    return Outcome(found.replace(model=model, notes=(*notes, *found.notes)), gaps, heard, tuple(training),
                   tuple(held_out))


def _polarity(heard: Audit) -> Mapping[str, str]:
    return {"polarity": "reversed"} if heard.of("reversed-polarity") else {}


def _leak_note(pieces: Sequence[Record], held_out: Sequence[Record], found: Identification) -> tuple[str, ...]:
    """Whether the held-out excitation already occurred in the training data."""
    from lpvid.condition import leaks
    from lpvid.report.figures import comparisons
    from lpvid.report.identification import LEAK

    if not held_out or sum(r.n_samples for r in pieces) > LEAK_SAMPLES:
        return ()
    kept = [c.record for c in comparisons(found.model, held_out, "held-out")]
    name = found.model.inputs[0].name
    part = leaks(pieces, kept, name)
    if part is None or part < 0.05:
        return ()
    return (f"{100 * part:.0f} % of the held-out {name} also occurs in the training data: {LEAK}",)
