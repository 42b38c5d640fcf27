"""Options of `lpvid identify`, beside those that it shares with other commands (`lpvid.cli.options`)."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

OnChoice = Literal["output", "trial", "input"]
ShapeChoice = Literal["none", "tanh", "three-zone"]
FilterChoice = Literal["none", "lag", "rise-fall", "lag-delay", "rise-fall-delay"]
BasisChoice = Literal["polynomial", "spline"]
FormChoice = Literal["controllable", "observable", "shifted", "augmented"]

# -- structure and its orders -----------------------------------------------------------------------------------------
Structure = Annotated[str, typer.Option("--structure", metavar="NAME",
    help="arx, oe, bj, armax, riv (transfer functions); subspace, pem-ss, coprime (state space); quasi, compliance "
         "(scheduled on their own output); recursive; or the name that an installed package gives.")]
Auto = Annotated[bool, typer.Option("--auto",
    help="Choose the structure by its free run in cross-validation on the training data.")]
Budget = Annotated[float | None, typer.Option("--budget", min=1.0, metavar="SECONDS",
    help="Processor time of --auto (300) up to the model: reading, audit, search and the fit of its choice. Forms "
         "and report come on top; both times are printed last.")]
Na = Annotated[int | None, typer.Option("--na", min=0, help="Output lags (4; quasi: 0).")]
Nb = Annotated[str | None, typer.Option("--nb", metavar="N[,N…]", help="Input lags, one number or one per input (4).")]
Nk = Annotated[str | None, typer.Option("--nk", metavar="N[,N…]",
    help="First input lag; left out, 0, 1 and 2 are tried and the best free run on training data decides.")]
Nc = Annotated[int | None, typer.Option("--nc", min=0, help="Order of the noise's numerator (bj, armax: 2; riv: 0).")]
Nd = Annotated[int | None, typer.Option("--nd", min=0, help="Order of the noise's denominator (bj: 2; riv: 0).")]
Order = Annotated[int | None, typer.Option("--order", min=1,
    help="States (subspace, pem-ss: from the singular values).")]
Past = Annotated[int | None, typer.Option("--past", min=1,
    help="Samples that the subspace estimate's state is read from.")]
Innovation = Annotated[bool, typer.Option("--innovation",
    help="pem-ss: estimate an observer gain too, fit one-step predictions.")]
On = Annotated[OnChoice | None, typer.Option("--on", help="quasi: what the coefficients depend on (trial).")]
Trial = Annotated[int | None, typer.Option("--trial", min=1, help="quasi: input lags in the trial force (1).")]
Odd = Annotated[float | None, typer.Option("--odd", min=0.0, metavar="N",
    help="quasi: weight of the symmetry y(−u) = −y(u), as a number of samples (0).")]
States = Annotated[int | None, typer.Option("--states", min=1, max=2,
    help="compliance: parallel branches, each with a spring in series (1).")]
Side = Annotated[list[str] | None, typer.Option("--side", metavar="NAME",
    help="compliance: channels that act in parallel, e.g. displacement.")]
Forgetting = Annotated[float | None, typer.Option("--forgetting", help="recursive: forgetting factor (0.995).")]

# -- how the model depends on the scheduling ---------------------------------------------------------------------------
Degree = Annotated[int | None, typer.Option("--degree", min=0, help="Degree in the scheduling variables (1).")]
Basis = Annotated[BasisChoice | None, typer.Option("--basis",
    help="How coefficients depend on them (polynomial; quasi, on its own output: spline).")]
Segments = Annotated[int | None, typer.Option("--segments", min=1,
    help="Pieces of a spline basis (3; quasi: 10; compliance, in the current: 2).")]
Shape = Annotated[ShapeChoice, typer.Option("--shape", help="Static input stage, fitted to the data.")]
ScheduleFilter = Annotated[FilterChoice, typer.Option("--schedule-filter",
    help="Filter between the logged scheduling and the coefficients, fitted to the data.")]
ScheduleLag = Annotated[bool, typer.Option("--schedule-lag", help="The same as --schedule-filter rise-fall.")]
NoConstant = Annotated[bool, typer.Option("--no-constant",
    help="No constant term c_0(p) in the model. Without this option there is one, which removes the mean error.")]
Affine = Annotated[bool, typer.Option("--affine",
    help="Further terms, beside that constant, that depend on the scheduling only.")]
AffineTerms = Annotated[int | None, typer.Option("--affine-terms", min=1, metavar="N",
    help="Number of them, lags 0 … N−1; with --affine alone na + 1, or 1 where no record's scheduling moves.")]
Lagged = Annotated[bool, typer.Option("--lagged",
    help="Evaluate the coefficients of lag i at p(k−i): the observer form is then exact and causal.")]

# -- what bounds the estimate ------------------------------------------------------------------------------------------
Passive = Annotated[bool, typer.Option("--passive",
    help="arx, oe: the best model that never gives energy (velocity in, force out), certified; nk is 0.")]
Balanced = Annotated[bool, typer.Option("--balanced",
    help="With --passive: divide each record's squared error by its variance, so that records of small and of large "
         "force weigh alike.")]
Ridge = Annotated[float | None, typer.Option("--ridge", min=0.0, help="Penalty on the parameters (0).")]

# -- records held out --------------------------------------------------------------------------------------------------
HoldOut = Annotated[str | None, typer.Option("--hold-out", metavar="SHARE",
    help="Keep the last part of every record out of the fit: 1/3, 0.25, last-third.")]
HeldOut = Annotated[list[str] | None, typer.Option("--held-out", metavar="DATA",
    help="Files the fit does not see; repeat for several.")]
Refit = Annotated[bool, typer.Option("--refit",
    help="Report the held-out figures, then fit the same structure to all data: model.json is that fit.")]

# -- state-space form --------------------------------------------------------------------------------------------------
Form = Annotated[FormChoice | None, typer.Option("--form", help="Also write state_space.json in this form.")]
RefitForm = Annotated[bool, typer.Option("--refit-form",
    help="Re-estimate the entries of that form by simulation error (controllable or observable).")]

# -- many files --------------------------------------------------------------------------------------------------------
Fleet = Annotated[bool, typer.Option("--fleet",
    help="One model of all files, each read by another process (extra scale); --out keeps the state, from which a "
         "run that was cut short goes on.")]
Scheduler = Annotated[str | None, typer.Option("--scheduler", metavar="ADDRESS",
    help="With --fleet: a running Dask scheduler; left out, a cluster on this machine.")]
