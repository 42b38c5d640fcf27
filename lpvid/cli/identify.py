"""`lpvid identify`: an LPV model from measured data, by any of the estimators."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

import typer

from lpvid.cli import options
from lpvid.cli.running import INTERRUPTED, SHORTFALL, Results, command, conclude, working
from lpvid.errors import InputError, TooFewSamples

On = Literal["output", "trial", "input"]
Shape = Literal["none", "tanh", "three-zone"]
Filter = Literal["none", "lag", "rise-fall", "lag-delay", "rise-fall-delay"]
BasisKind = Literal["polynomial", "spline"]
Form = Literal["controllable", "observable", "shifted", "augmented"]


@command
def identify(
    data: options.Data,
    input: options.Inputs = None,
    output: options.Outputs = None,
    schedule: options.Schedule = None,
    structure: Annotated[str, typer.Option("--structure", metavar="NAME", help="arx, oe, bj, armax, riv (transfer "
                                           "functions); subspace, pem-ss, coprime (state space); quasi, compliance "
                                           "(scheduled on their own output); recursive; or the name that an "
                                           "installed package gives.")] = "arx",
    auto: Annotated[bool, typer.Option("--auto", help="Choose the structure by its free run in cross-validation on the "
                                       "training data.")] = False,
    budget: Annotated[float | None, typer.Option("--budget", min=1.0, metavar="SECONDS", help="Processor time of "
                                                 "--auto (300) up to the model: reading, audit, search and the fit of "
                                                 "its choice. Forms and report come on top; both times are printed "
                                                 "last.")] = None,
    na: Annotated[int | None, typer.Option("--na", min=0, help="Output lags (4; quasi: 0).")] = None,
    nb: Annotated[str | None, typer.Option("--nb", metavar="N[,N…]", help="Input lags, one number or one per input "
                                           "(4).")] = None,
    nk: Annotated[str | None, typer.Option("--nk", metavar="N[,N…]", help="First input lag; left out, 0, 1 and 2 are "
                                           "tried and the best free run on training data decides.")] = None,
    nc: Annotated[int | None, typer.Option("--nc", min=0, help="Order of the noise's numerator (bj, armax: 2; "
                                           "riv: 0).")] = None,
    nd: Annotated[int | None, typer.Option("--nd", min=0, help="Order of the noise's denominator (bj: 2; "
                                           "riv: 0).")] = None,
    order: Annotated[int | None, typer.Option("--order", min=1, help="States (subspace, pem-ss: from the singular "
                                              "values).")] = None,
    past: Annotated[int | None, typer.Option("--past", min=1, help="Samples that the subspace estimate's state is read "
                                             "from.")] = None,
    innovation: Annotated[bool, typer.Option("--innovation", help="pem-ss: estimate an observer gain too, fit one-step "
                                             "predictions.")] = False,
    on: Annotated[On | None, typer.Option("--on", help="quasi: what the coefficients depend on (trial).")] = None,
    trial: Annotated[int | None, typer.Option("--trial", min=1, help="quasi: input lags in the trial force (1).")] =
        None,
    odd: Annotated[float | None, typer.Option("--odd", min=0.0, metavar="N", help="quasi: weight of the symmetry "
                                              "y(−u) = −y(u), as a number of samples (0).")] = None,
    states: Annotated[int | None, typer.Option("--states", min=1, max=2, help="compliance: parallel branches, each "
                                               "with a spring in series (1).")] = None,
    side: Annotated[list[str] | None, typer.Option("--side", metavar="NAME", help="compliance: channels that act in "
                                                   "parallel, e.g. displacement.")] = None,
    forgetting: Annotated[float | None, typer.Option("--forgetting", help="recursive: forgetting factor (0.995).")] =
        None,
    degree: Annotated[int | None, typer.Option("--degree", min=0, help="Degree in the scheduling variables (1).")] =
        None,
    basis: Annotated[BasisKind | None, typer.Option("--basis", help="How coefficients depend on them (polynomial; "
                                                    "quasi, on its own output: spline).")] = None,
    segments: Annotated[int | None, typer.Option("--segments", min=1, help="Pieces of a spline basis (3; quasi: 10; "
                                                 "compliance, in the current: 2).")] = None,
    shape: Annotated[Shape, typer.Option("--shape", help="Static input stage, fitted to the data.")] = "none",
    schedule_filter: Annotated[Filter, typer.Option("--schedule-filter", help="Filter between the logged scheduling "
                                                    "and the coefficients, fitted to the data.")] = "none",
    schedule_lag: Annotated[bool, typer.Option("--schedule-lag", help="The same as --schedule-filter "
                                               "rise-fall.")] = False,
    no_constant: Annotated[bool, typer.Option("--no-constant", help="No constant term c_0(p) in the model. Without "
                                              "this option there is one, which removes the mean error.")] = False,
    affine: Annotated[bool, typer.Option("--affine", help="Further terms, beside that constant, that depend on the "
                                         "scheduling only.")] = False,
    affine_terms: Annotated[int | None, typer.Option("--affine-terms", min=1, metavar="N", help="Number of them, "
                                                     "lags 0 … N−1; with --affine alone na + 1, or 1 where no record's "
                                                     "scheduling moves.")] = None,
    lagged: Annotated[bool, typer.Option("--lagged", help="Evaluate the coefficients of lag i at p(k−i): the "
                                         "observer form is then exact and causal.")] = False,
    passive: Annotated[bool, typer.Option("--passive", help="arx, oe: the best model that never gives energy (velocity "
                                          "in, force out), certified; nk is 0.")] = False,
    balanced: Annotated[bool, typer.Option("--balanced", help="With --passive: divide each record's squared "
                                           "error by its variance, so that records of small and of large force "
                                           "weigh alike.")] = False,
    ridge: Annotated[float | None, typer.Option("--ridge", min=0.0, help="Penalty on the parameters (0).")] = None,
    hold_out: Annotated[str | None, typer.Option("--hold-out", metavar="SHARE", help="Keep the last part of every "
                                                 "record out of the fit: 1/3, 0.25, last-third.")] = None,
    held_out: Annotated[list[str] | None, typer.Option("--held-out", metavar="DATA", help="Files the fit does not see; "
                                                       "repeat for several.")] = None,
    refit: Annotated[bool, typer.Option("--refit", help="Report the held-out figures, then fit the same structure to "
                                        "all data: model.json is that fit.")] = False,
    form: Annotated[Form | None, typer.Option("--form", help="Also write state_space.json in this form.")] = None,
    refit_form: Annotated[bool, typer.Option("--refit-form", help="Re-estimate the entries of that form by "
                                             "simulation error (controllable or observable).")] = False,
    beside: options.Beside = None,
    role: options.Role = None,
    flip: options.Flip = None,
    sample_rate: options.SampleRateOrRaw = None,
    chunk: options.Chunk = None,
    fleet: Annotated[bool, typer.Option("--fleet", help="One model of all files, each read by another process (extra "
                                        "scale); --out keeps the state, from which a run that was cut short goes "
                                        "on.")] = False,
    scheduler: Annotated[str | None, typer.Option("--scheduler", metavar="ADDRESS", help="With --fleet: a running Dask "
                                                  "scheduler; left out, a cluster on this machine.")] = None,
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
    from lpvid.cli.data import asked_rate, numbers, read_parts, split_names, with_cause, working_rate
    from lpvid.cli.data import hold_out as part
    from lpvid.cli.modelling import fit
    from lpvid.cli.parts import refuse_still_output
    from lpvid.cli.structures import Request
    from lpvid.training_fingerprint import unstated_units

    results = Results(out, "model.json", "identification.json", "report.html")
    rate, raw = asked_rate(sample_rate)
    written = {"na": na, "nb": None if nb is None else numbers(nb, "--nb"),
               "nk": None if nk is None else numbers(nk, "--nk"), "nc": nc, "nd": nd, "order": order, "past": past,
               "innovation": innovation or None, "on": on, "trial": trial, "odd": odd, "states": states,
               "side": split_names(side) or None, "forgetting": forgetting, "degree": degree,
               "basis": basis, "segments": segments,
               "shape": None if shape == "none" else shape,
               "schedule-filter": None if schedule_filter == "none" else schedule_filter,
               "schedule-lag": schedule_lag or None, "no-constant": no_constant or None, "affine": affine or None,
               "affine-terms": affine_terms, "lagged": lagged or None, "ridge": ridge, "passive": passive or None,
               "balanced": balanced or None}
    begun = processor_time()
    request = Request(split_names(input) or ("velocity",), split_names(output) or ("force",), split_names(schedule),
                      structure, {n: v for n, v in written.items() if v is not None}, rate, auto,
                      form, refit, refit_form, budget, begun)
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
            joint = identify_fleet(request, data, role, {**whole, **other}, scheduler, results, report_progress)
            conclude(results, joint.to_dict(), str(joint), json)
            if joint.failed or joint.diverging or joint.median_esr >= 1:
                raise typer.Exit(SHORTFALL)
            return
        if chunk is not None:
            from lpvid.cli.streamed import fit_parts
            from lpvid.cli.streamed import parts as read_in_parts

            chunks, apart = (None if paths is None else read_in_parts(paths, chunk, roles=role, flip=flip,
                                                                      sample_rate=rate) for paths in (data, held_out))
            assert chunks is not None
            streamed = fit_parts(request, chunks, apart, whole, out, report_progress)
            streamed.deliver(results, report_progress)
            conclude(results, streamed.to_dict(), str(streamed), json)
            if streamed.fails:
                raise typer.Exit(SHORTFALL)
            return
        records, kept = read_parts(data, held_out, roles=role, flip=flip, sample_rate=rate)
        working_at, notes = working_rate([*records, *kept], rate, raw)
        training, tail = part(records, hold_out)
        apart = [*tail, *kept]
        refuse_still_output(apart, request.output)
        try:
            found = fit(replace(request, sample_rate=working_at), training, apart, [*records, *kept], report_progress)
        except TooFewSamples as error:
            raise with_cause(error, records, training, hold_out, rate) from None
        reached = processor_time()
        found = found.with_notes((*notes, *unstated_units([*records, *kept], request.channels)))
        label = "held-out" if apart else "training"
        beside_it = compared((name, found.found.model), others, apart or training, label, working_at, {})
        found = replace(found, beside=beside_it)
        found.deliver(results, report_progress)
    conclude(results, found.to_dict(), str(found), json)
    if budget is not None:
        typer.echo(f"--budget {budget:g}: {reached - begun:.1f} s of processor time up to the model and its forms, "
                   f"{processor_time() - reached:.1f} s for the report", err=True)
    if found.choice is not None and not found.choice.selection.complete:
        raise typer.Exit(INTERRUPTED)
    if found.fails or (passive and not found.certified):
        raise typer.Exit(SHORTFALL)
