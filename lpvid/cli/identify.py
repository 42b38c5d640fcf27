"""`lpvid identify`: a polynomial-scheduled transfer function from measured data."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from lpvid.cli import options
from lpvid.cli.running import Results, command, conclude, working


class Shape(StrEnum):
    """Static input stages by name."""

    NONE = "none"
    TANH = "tanh"
    THREE_ZONE = "three-zone"


class Filter(StrEnum):
    """Scheduling filters by name."""

    NONE = "none"
    LAG = "lag"
    RISE_FALL = "rise-fall"
    LAG_DELAY = "lag-delay"
    RISE_FALL_DELAY = "rise-fall-delay"


class BasisKind(StrEnum):
    """Bases by name."""

    POLYNOMIAL = "polynomial"
    SPLINE = "spline"


class Form(StrEnum):
    """State-space forms by name."""

    CONTROLLABLE = "controllable"
    OBSERVABLE = "observable"
    SHIFTED = "shifted"
    AUGMENTED = "augmented"


@command
def identify(
    data: options.Data,
    input: options.Inputs = None,
    output: options.Outputs = None,
    schedule: options.Schedule = None,
    structure: Annotated[str, typer.Option("--structure", help="Model structure; this version has arx.")] = "arx",
    na: Annotated[int, typer.Option("--na", min=0, help="Output lags.")] = 4,
    nb: Annotated[str, typer.Option("--nb", metavar="N[,N…]", help="Input lags, one number or one per input.")] = "4",
    nk: Annotated[str | None, typer.Option("--nk", metavar="N[,N…]", help="First input lag; left out, 0, 1 and 2 are "
                                           "tried and the best free run on training data decides.")] = None,
    degree: Annotated[int, typer.Option("--degree", min=0, help="Degree in the scheduling variables.")] = 1,
    basis: Annotated[BasisKind, typer.Option("--basis", help="How coefficients depend on them.")] =
        BasisKind.POLYNOMIAL,
    segments: Annotated[int, typer.Option("--segments", min=1, help="Pieces of a spline basis.")] = 3,
    shape: Annotated[Shape, typer.Option("--shape", help="Static input stage, fitted to the data.")] = Shape.NONE,
    schedule_filter: Annotated[Filter, typer.Option("--schedule-filter", help="Filter between the logged scheduling "
                                                    "and the coefficients, fitted to the data.")] = Filter.NONE,
    schedule_lag: Annotated[bool, typer.Option("--schedule-lag", help="The same as --schedule-filter "
                                               "rise-fall.")] = False,
    affine: Annotated[bool, typer.Option("--affine", help="Add terms that depend on the scheduling alone.")] = False,
    affine_terms: Annotated[int | None, typer.Option("--affine-terms", min=1, metavar="N", help="How many of them, "
                                                     "lags 0 … N−1; with --affine alone na + 1.")] = None,
    lagged: Annotated[bool, typer.Option("--lagged", help="Coefficients of lag i at p(k−i): exact and causal in "
                                         "observer form.")] = False,
    ridge: Annotated[float, typer.Option("--ridge", min=0.0, help="Penalty on the parameters, 0 for none.")] = 0.0,
    hold_out: Annotated[str | None, typer.Option("--hold-out", metavar="SHARE", help="Keep the last part of every "
                                                 "record out of the fit: 1/3, 0.25, last-third.")] = None,
    held_out: Annotated[list[str] | None, typer.Option("--held-out", metavar="DATA", help="Files the fit does not see; "
                                                       "repeat for several.")] = None,
    form: Annotated[Form | None, typer.Option("--form", help="Also write state_space.json in this form.")] = None,
    role: options.Role = None,
    flip: options.Flip = None,
    sample_rate: options.SampleRate = None,
    out: options.Out = None,
    json: options.Json = False,
) -> None:
    """Fit a polynomial-scheduled LPV transfer function; writes model.json, identification.json and report.html.

    Without --schedule the model is time-invariant. A velocity that was not measured is derived from displacement.
    Every figure says whether it is free-run or one-step, on training or on held-out data.
    """
    from lpvid.cli.data import hold_out as part
    from lpvid.cli.data import no_shared_files, numbers, read_records, split_names
    from lpvid.cli.modelling import Request, fit

    results = Results(out)
    terms = affine_terms if affine_terms is not None else na + 1 if affine else 0
    lag = Filter.RISE_FALL if schedule_lag and schedule_filter is Filter.NONE else schedule_filter
    request = Request(split_names(input) or ("velocity",), split_names(output) or ("force",), split_names(schedule),
                      structure, na, numbers(nb, "--nb"), None if nk is None else numbers(nk, "--nk"), degree,
                      basis.value, segments, None if shape is Shape.NONE else shape.value,
                      None if lag is Filter.NONE else lag.value, terms, lagged, ridge, sample_rate)
    with working("reading") as say:
        request.check()
        if held_out:
            no_shared_files(data, held_out)
        records = read_records(data, roles=role, flip=flip, sample_rate=sample_rate)
        kept = read_records(held_out, roles=role, flip=flip, sample_rate=sample_rate) if held_out else []
        training, tail = part(records, hold_out)
        found = fit(request, training, [*tail, *kept], [*records, *kept], say)
        found.deliver(results, None if form is None else form.value, say)
    conclude(results, found.to_dict(), str(found), json)
