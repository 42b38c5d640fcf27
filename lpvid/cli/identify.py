"""`lpvid identify`: an LPV model from measured data, by any of the estimators."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import typer

from lpvid.cli import identify_options as own
from lpvid.cli import options
from lpvid.cli.running import INTERRUPTED, SHORTFALL, Results, command, conclude, working
from lpvid.errors import InputError, TooFewSamples

if TYPE_CHECKING:
    from lpvid.cli.modelling import ReportedIdentification
    from lpvid.cli.structures import Request
    from lpvid.record import Record


@command
def identify(
    data: options.Data,
    input: options.Inputs = None,
    output: options.Outputs = None,
    schedule: options.Schedule = None,
    structure: own.Structure = "arx",
    auto: own.Auto = False,
    budget: own.Budget = None,
    na: own.Na = None,
    nb: own.Nb = None,
    nk: own.Nk = None,
    nc: own.Nc = None,
    nd: own.Nd = None,
    order: own.Order = None,
    past: own.Past = None,
    innovation: own.Innovation = False,
    on: own.On = None,
    trial: own.Trial = None,
    odd: own.Odd = None,
    states: own.States = None,
    side: own.Side = None,
    forgetting: own.Forgetting = None,
    degree: own.Degree = None,
    basis: own.Basis = None,
    segments: own.Segments = None,
    shape: own.Shape = "none",
    schedule_filter: own.ScheduleFilter = "none",
    schedule_lag: own.ScheduleLag = False,
    no_constant: own.NoConstant = False,
    affine: own.Affine = False,
    affine_terms: own.AffineTerms = None,
    lagged: own.Lagged = False,
    passive: own.Passive = False,
    balanced: own.Balanced = False,
    ridge: own.Ridge = None,
    hold_out: own.HoldOut = None,
    held_out: own.HeldOut = None,
    refit: own.Refit = False,
    form: own.Form = None,
    refit_form: own.RefitForm = False,
    beside: options.Beside = None,
    role: options.Role = None,
    flip: options.Flip = None,
    sample_rate: options.SampleRateOrRaw = None,
    chunk: options.Chunk = None,
    fleet: own.Fleet = False,
    scheduler: own.Scheduler = None,
    out: options.Out = None,
    json: options.Json = False,
) -> None:
    """Fit an LPV model; writes model.json, identification.json and report.html, with --auto selection.json too.

    --form adds state_space.json, --refit-form writes the re-estimated form there, and its figures to form.json.

    Without --schedule the model is time-invariant. A velocity that was not measured is derived from displacement.
    Every figure states whether it is free-run or one-step, on training or on held-out data. With --chunk the data are
    read in parts (arx, recursive); an interrupted run continues after its last part where --out names the same folder.
    Exits with 3 where the free run of the model on its training data diverges (with --fleet along one of the files) or
    is no better than their mean, or with --passive where there is no certificate; the files are written all the same.
    """
    from lpvid._forks import processor_time
    from lpvid.cli.beside import compared, load_beside
    from lpvid.cli.data import asked_rate, numbers, split_names
    from lpvid.cli.structures import Request

    results = Results(out, "model.json", "identification.json", "report.html")
    rate, raw = asked_rate(sample_rate)
    written = {"na": na, "nb": None if nb is None else numbers(nb, "--nb"),
               "nk": None if nk is None else numbers(nk, "--nk"), "nc": nc, "nd": nd, "order": order, "past": past,
               "innovation": innovation, "on": on, "trial": trial, "odd": odd, "states": states,
               "side": split_names(side) or None, "forgetting": forgetting, "degree": degree, "basis": basis,
               "segments": segments, "shape": shape, "schedule-filter": schedule_filter, "schedule-lag": schedule_lag,
               "no-constant": no_constant, "affine": affine, "affine-terms": affine_terms, "lagged": lagged,
               "ridge": ridge, "passive": passive, "balanced": balanced}
    begun = reached = processor_time()
    request = Request(split_names(input) or ("velocity",), split_names(output) or ("force",), split_names(schedule),
                      structure, {n: v for n, v in written.items() if v is not None and v is not False and v != "none"},
                      rate, auto, form, refit, refit_form, budget, begun)
    complete = True
    with working("reading") as report_progress:
        request.check()
        name, others = load_beside(beside, f"{out or 'this'}/model.json")
        whole = {"--auto": auto, "--hold-out": hold_out, "--refit": refit, "--refit-form": refit_form}
        if others and (fleet or chunk is not None):
            raise InputError("--beside needs whole records", got="--fleet" if fleet else "--chunk",
                             mend="lpvid compare afterwards")
        if scheduler is not None and not fleet:
            raise InputError("--scheduler names the cluster of --fleet", mend="add --fleet, or leave it out")
        if fleet:
            from lpvid.cli.fleet import identify_fleet

            other = {"--chunk": chunk, "--held-out": held_out, "--flip": flip, "--sample-rate": rate, "--form": form}
            found = identify_fleet(request, data, role, {**whole, **other}, scheduler, results, report_progress)
            fails = bool(found.failed or found.diverging or found.median_esr >= 1)
        elif chunk is not None:
            from lpvid.cli.streamed import fit_parts
            from lpvid.cli.streamed import parts as read_in_parts

            chunks, apart = (None if paths is None else read_in_parts(paths, chunk, roles=role, flip=flip,
                                                                      sample_rate=rate) for paths in (data, held_out))
            assert chunks is not None
            found = fit_parts(request, chunks, apart, whole, out, report_progress)
            found.deliver(results, report_progress)
            fails = found.fails
        else:
            found, judged = _fit_records(request, data, held_out, hold_out, role, flip, raw, report_progress)
            reached = processor_time()
            found = replace(found, beside=compared((name, found.found.model), others, *judged, {}))
            found.deliver(results, report_progress)
            fails = found.fails or (passive and not found.certified)
            complete = found.choice is None or found.choice.selection.complete
    conclude(results, found.to_dict(), str(found), json)
    if budget is not None:
        typer.echo(f"--budget {budget:g}: {reached - begun:.1f} s of processor time up to the model and its forms, "
                   f"{processor_time() - reached:.1f} s for the report", err=True)
    if not complete:
        raise typer.Exit(INTERRUPTED)
    if fails:
        raise typer.Exit(SHORTFALL)


def _fit_records(request: Request, data: Sequence[str], held_out: Sequence[str] | None, hold_out: str | None,
                 role: Sequence[str] | None, flip: Sequence[str] | None, raw: bool,
                 report_progress: Callable[[str], None]
                 ) -> tuple[ReportedIdentification, tuple[list[Record], str, float | None]]:
    """The model of whole records; and the records on which it is judged, what they are, and their sample rate [Hz]."""
    from lpvid.cli.data import hold_out as part
    from lpvid.cli.data import read_parts, with_cause, working_rate
    from lpvid.cli.modelling import fit
    from lpvid.cli.parts import refuse_still_output
    from lpvid.condition.segmentation import refuse_text
    from lpvid.training_fingerprint import unstated_units

    rate = request.sample_rate
    records, kept = read_parts(data, held_out, roles=role, flip=flip, sample_rate=rate)
    working_at, notes = working_rate([*records, *kept], rate, raw)
    refuse_text([*records, *kept], request.channels)
    training, tail = part(records, hold_out)
    apart = [*tail, *kept]
    refuse_still_output(apart, request.output)
    try:
        found = fit(replace(request, sample_rate=working_at), training, apart, [*records, *kept], report_progress)
    except TooFewSamples as error:
        raise with_cause(error, records, training, hold_out, rate) from None
    found = found.with_notes((*notes, *unstated_units([*records, *kept], request.channels)))
    return found, (apart or training, "held-out" if apart else "training", working_at)
