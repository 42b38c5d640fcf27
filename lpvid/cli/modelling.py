"""What `identify` does between reading and writing: structure, fit, forms, audit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from lpvid.cli.automatic import Choice, choose
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.report.passivity import energy_statement, passivity_lines, passivity_section

if TYPE_CHECKING:
    from lpvid.auditing import Audit
    from lpvid.cli.running import Results
    from lpvid.cli.structures import Request
    from lpvid.identification import Identification, Structure
    from lpvid.identification.form_refit import FormRefit
    from lpvid.model.transfer_function import LPVTransferFunction
    from lpvid.report.forms import FormGap
    from lpvid.simulation import Model
    from lpvid.validation.comparing import ModelComparison

LEAK_SAMPLES = 200_000
"""Training samples up to which held-out stretches are sought among them."""


@dataclass(frozen=True, eq=False)
class ReportedIdentification:
    """An identification with what the report states about it.

    Attributes
    ----------
    found : Identification
        Of the training data, with the held-out figures.
    gaps : tuple of FormGap
        Empty where the model is no transfer function.
    audit : Audit
    training, held_out : tuple of Record
    form : str or None
        State-space form to write as well.
    choice : Choice or None
        How the structure was chosen, with --auto.
    refitted : Identification or None
        The same structure on all data, with --refit: what model.json holds.
    form_refit : FormRefit or None
        The form re-estimated, with --refit-form: what state_space.json holds.
    beside : ModelComparison or None
        With other models on the held-out records, or the training records where none were held out.
    """

    found: Identification
    gaps: tuple[FormGap, ...]
    audit: Audit
    training: tuple[Record, ...]
    held_out: tuple[Record, ...]
    form: str | None = None
    choice: Choice | None = None
    refitted: Identification | None = None
    form_refit: FormRefit | None = None
    beside: ModelComparison | None = None

    def with_notes(self, notes: tuple[str, ...]) -> ReportedIdentification:
        """The same with further remarks first.

        Parameters
        ----------
        notes : tuple of str
            Sentences; empty for no change.

        Returns
        -------
        ReportedIdentification
            A copy, or this one where there are no notes.
        """
        return replace(self, found=self.found.replace(notes=(*notes, *self.found.notes))) if notes else self

    @property
    def model(self) -> Model:
        """What model.json holds."""
        return (self.refitted or self.found).model

    @property
    def fails(self) -> bool:
        """Whether the free run of model.json diverges on its own training data, or is no better than their mean."""
        return (self.refitted or self.found).training_failure is not None

    @property
    def certified(self) -> bool:
        """Whether model.json carries a certificate of passivity that was verified."""
        return bool(self.model.metadata.get("passive", {}).get("verified", False))

    def to_dict(self) -> dict:
        """identification.json.

        Returns
        -------
        dict
            With forms, passivity, audit, selection and refit beside what `Identification.to_dict` has.
        """
        findings = [{"name": f.name, "record": f.record, "channel": f.channel, "severity": f.severity}
                    for f in self.audit.findings]
        again = self.refitted
        own, energy = self.form_refit, energy_statement(self.model)
        return {**self.found.to_dict(), "model": "model.json", "realizations": [g.to_dict() for g in self.gaps],
                "passivity": None if energy is None else energy.to_dict(),
                "form_refit": None if own is None else {"form": own.form, "free_run": own.summary()},
                "beside": None if self.beside is None else self.beside.to_dict(),
                "audit": {"verdict": self.audit.verdict, "findings": findings},
                "selection": None if self.choice is None else
                {k: v for k, v in self.choice.to_dict().items() if k != "identification"},
                "refitted": None if again is None else {
                    "n_samples": again.n_samples, "parameters": again.to_dict()["parameters"],
                    "all_data": None if again.training is None else again.training.to_dict()}}

    def __str__(self) -> str:
        severe = [f for f in self.audit.findings if f.severity != "note"]
        lines = [] if self.choice is None else [str(self.choice)]
        lines.append(repr(self.found))
        if self.refitted is not None and self.refitted.training is not None:
            lines.append(f"  refitted to all data: {self.refitted.training.summary()}; model.json is this fit")
        if self.gaps:
            lines.append(f"  state space: {'; '.join(str(g) for g in self.gaps)}")
        if self.form_refit is not None:
            lines += [f"  {line}" for line in str(self.form_refit).splitlines()]
        if self.beside is not None:
            lines += [f"  {line}" for line in repr(self.beside).splitlines()]
        lines += [f"  {line}" for line in passivity_lines(self.refitted or self.found)]
        lines.append(f"  audit: {self.audit.verdict}")
        lines += [f"    {f}" for f in severe[:3]]
        if len(severe) > 3:
            lines.append(f"    and {len(severe) - 3} more: see lpvid inspect")
        return "\n".join(lines)

    def deliver(self, results: Results, report_progress: Callable[[str], None]) -> None:
        """Queue the files.

        Parameters
        ----------
        results : Results
            Receives model.json, identification.json, the report, and by request selection.json, state_space.json and
            form.json; one that keeps nothing gets none, but a form that cannot be realised is refused all the same.
        report_progress : callable
            Receives what is being done.
        """
        realized = None
        if self.form is not None and self.form_refit is None:
            from lpvid.realization import realize

            realized = realize(_transfer_function(self.model), form=self.form)
        if not results.kept:
            return
        from lpvid.cli.beside import beside_sections
        from lpvid.report.bands import response_section, sureness
        from lpvid.report.figures import comparisons
        from lpvid.report.forms import form_section
        from lpvid.report.identification import identification_page
        from lpvid.report.selection import selection_section

        report_progress("drawing")
        shown = comparisons(self.found.model, self.held_out or self.training,
                            "held-out" if self.held_out else "training")
        results.save("model.json", self.model)
        results.json("identification.json", self.to_dict())
        chosen = () if self.choice is None else (selection_section(self.choice.selection, self.choice.description),)
        if self.choice is not None:
            results.json("selection.json", self.choice.to_dict())
        if realized is not None:
            results.save("state_space.json", realized)
        refit = self.form_refit
        if refit is not None:
            results.save("state_space.json", refit.model)
            results.json("form.json", refit.to_dict())
            chosen = (*chosen, form_section(refit))
        report_progress("bands")
        others = {"unconstrained": self.found.unconstrained, "refitted to all data":
                  None if self.refitted is None else self.refitted.model}
        sure = (*response_section(self.found, shown, others={n: m for n, m in others.items() if m is not None}),
                *sureness(self.found, shown))
        report_progress("drawing")
        more = (*sure, *beside_sections(self.beside, self.held_out or self.training, {}),
                *passivity_section(self.refitted or self.found), *chosen)
        results.report(identification_page(self.found, shown, self.gaps, self.audit, more))


def _transfer_function(model: Model) -> LPVTransferFunction:
    from lpvid.model.transfer_function import LPVTransferFunction

    if not isinstance(model, LPVTransferFunction):
        raise InputError("--form needs a transfer function", got=f"the chosen model is a {type(model).__name__}",
                         mend="leave --form out")
    return model


def fit(request: Request, training: Sequence[Record], held_out: Sequence[Record], everything: Sequence[Record],
        report_progress: Callable[[str], None] = lambda text: None) -> ReportedIdentification:
    """Audit, choose what was left open, fit, validate, and realise in every form.

    Parameters
    ----------
    request : Request
    training, held_out : sequence of Record
        Data of the fit, and data held out.
    everything : sequence of Record
        The raw records, for the audit.
    report_progress : callable
        Receives what is being done.

    Returns
    -------
    ReportedIdentification

    Raises
    ------
    InputError
        A refit without held-out data.
    """
    from lpvid.auditing import audit, reversed_polarity
    from lpvid.cli.structures import BUDGET
    from lpvid.condition import segments, with_derived
    from lpvid.identification import identify
    from lpvid.model.transfer_function import LPVTransferFunction
    from lpvid.report.forms import form_gaps

    if request.refit and not held_out:
        raise InputError("--refit needs held-out data", why="without them the fit uses all data anyway",
                         mend="add --hold-out 1/3, or leave --refit out")
    report_progress("auditing the data")
    audited = audit(everything, scheduling=request.schedule or None, inputs=request.input, outputs=request.output,
                    sample_rate=request.sample_rate)
    choice, notes = None, ()
    if request.automatic:
        choice, found = choose(request, training, held_out, report_progress, request.budget or BUDGET, request.begun)
        structure: Structure = choice.selection.best
    else:
        structure, notes = _settled(request, training, report_progress)
        report_progress("fitting")
        found = identify(training, structure, sample_rate=request.sample_rate, held_out=held_out or None)
    bare = request.without_filter(structure)
    if bare is not None and request.automatic and choice is not None and choice.selection.left_out:
        notes += ("not compared with a fit without its scheduling filter: the search ended at its budget",)
    elif bare is not None:
        report_progress("fitting without the scheduling filter, to compare")
        notes += _compared(identify(training, bare, sample_rate=request.sample_rate, held_out=held_out or None))
    derived = with_derived(training, structure.channels)
    pieces = segments(derived, structure.channels, sample_rate=1 / found.model.sample_time if request.sample_rate
                      else None, minimum=found.model.start + 2)
    report_progress("state-space forms")
    gaps = tuple(form_gaps(found.model, pieces, "training")) if isinstance(found.model, LPVTransferFunction) else ()
    notes += _leak_note(pieces, held_out, found)
    again = None
    if request.refit:
        report_progress("fitting to all data")
        again = marked(identify(everything, structure, sample_rate=request.sample_rate), reversed_polarity(everything))
    found = marked(found.replace(notes=(*notes, *found.notes)), reversed_polarity(training))
    own = (
        _form_refit(request, found, again, training, held_out, everything, report_progress)
        if request.refit_form
        else None
    )
    return ReportedIdentification(
        found, gaps, audited, tuple(training), tuple(held_out), request.form, choice, again, own
    )


def _form_refit(
    request: Request,
    found: Identification,
    again: Identification | None,
    training: Sequence[Record],
    held_out: Sequence[Record],
    everything: Sequence[Record],
    report_progress: Callable[[str], None],
) -> FormRefit:
    """The form re-estimated on the training data; with --refit on all data, its figures still those of the former."""
    from lpvid.identification.form_refit import refit_form

    report_progress("re-estimating the form")
    rate = request.sample_rate
    refit = refit_form(_transfer_function(found.model), training, form=request.form, held_out=held_out or None,
                       sample_rate=rate)
    if again is None:
        return refit
    report_progress("re-estimating the form on all data")
    whole = refit_form(_transfer_function(again.model), everything, form=request.form, sample_rate=rate)
    metadata = {**whole.model.metadata, "free_run": refit.summary()}
    return refit.with_model(whole.model.replace(metadata=metadata))


def _compared(bare: Identification) -> tuple[str, ...]:
    judged = bare.held_out or bare.training
    assert judged is not None
    return (f"the same without the scheduling filter, {judged.label}: {judged.overall.free_run}",)


def _settled(request: Request, training: Sequence[Record],
             report_progress: Callable[[str], None]) -> tuple[Structure, tuple[str, ...]]:
    """The structure with its first input lag and its number of affine terms, and what was decided for them."""
    from lpvid.condition.constancy import at_rest
    from lpvid.identification.delay import choose_delay
    from lpvid.identification.stage_fit import require_motion

    affine, notes = None, ()
    require_motion(training, request.build(0, None))
    if request.affine > 1 and "affine-terms" not in request.given and at_rest(training, request.schedule):
        affine = 1
        notes = (f"{', '.join(request.schedule)} is constant within every record, so that its lags are the same: "
                 "one affine term",)
    delay = request.delay
    if request.searches_delay:
        report_progress("choosing the first input lag")
        plain = request.arx(1) if affine is None else replace(request.arx(1), affine=affine)
        lags = (0, 1) if request.structure in ("subspace", "pem-ss", "coprime") else (0, 1, 2)
        chosen, note = choose_delay(training, plain, candidates=lags, sample_rate=request.sample_rate)
        if request.structure != "arx":
            note += f" (errors of ARX models of these lags; {request.structure} itself was fitted with this one alone)"
        delay, notes = chosen.delay, (*notes, note)
    return request.build(delay, affine), notes



def marked(found: Identification, reversed_: bool) -> Identification:
    """The estimate, its model marked as one of reversed polarity where that is the case.

    Parameters
    ----------
    found : Identification
    reversed_ : bool
        Of the records that it was fitted to; held-out records do not count.

    Returns
    -------
    Identification
    """
    turned = {"polarity": "reversed"} if reversed_ else {}
    return found.replace(model=found.model.replace(metadata={**found.model.metadata, **turned}))


def _leak_note(pieces: Sequence[Record], held_out: Sequence[Record], found: Identification) -> tuple[str, ...]:
    """Whether the held-out excitation already occurred in the training data."""
    from lpvid.caveat import Caveat
    from lpvid.condition import leaks
    from lpvid.report.figures import comparisons

    if not held_out or sum(r.n_samples for r in pieces) > LEAK_SAMPLES:
        return ()
    kept = [c.record for c in comparisons(found.model, held_out, "held-out")]
    name = found.model.inputs[0].name
    part = leaks(pieces, kept, name)
    if part is None or part < 0.05:
        return ()
    return (Caveat(f"{100 * part:.0f} % of the held-out {name} also occurs in the training data: the held-out figures "
                   "test less than they seem to"),)
