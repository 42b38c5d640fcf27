"""Fit the static input stage and the scheduling filter of an LPV model to its free run."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from lpvid._forks import in_forks
from lpvid._threads import single_thread
from lpvid.condition.constancy import at_rest
from lpvid.errors import InputError
from lpvid.identification.result import Identification
from lpvid.model.input_stage import NARROWEST, STAGES, InputStage
from lpvid.model.scheduling_stage import FITTED, SchedulingStage
from lpvid.record import Record
from lpvid.scheduling import Scheduling
from lpvid.simulation import simulate

if TYPE_CHECKING:
    from lpvid.model.transfer_function import LPVTransferFunction

SAMPLES = 40_000
"""samples on which the stages are searched; the final regression uses all."""
DIVERGED_COST = 1e3
"""cost of a stage whose model diverges in free run."""
REFINED = 2
"""starts that are refined after all have been tried."""


class StagedStructure(Protocol):
    """A dataclass of which the linear part is a regression once its stages are known: `ARX` is one.

    Attributes
    ----------
    input, output : str or tuple of str
        Names of the channels.
    stage : InputStage, str or None
        By name where it is to be fitted.
    schedule_filter : SchedulingStage, str or None
        As `stage`.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def input(self) -> str | tuple[str, ...]:
        """Names of the channels that drive it."""
        ...

    @property
    def output(self) -> str | tuple[str, ...]:
        """Names of the channels that it explains."""
        ...

    @property
    def stage(self) -> InputStage | str | None:
        """Of the input; by name where it is to be fitted."""
        ...

    @property
    def schedule_filter(self) -> SchedulingStage | str | None:
        """Of the scheduling; by name where it is to be fitted."""
        ...

    @property
    def start(self) -> int:
        """Samples at the head of every record that a regression only reads."""
        ...

    def regress(self, records: Sequence[Record], box: Scheduling) -> Identification:
        """Coefficients with the stages held as they are.

        Parameters
        ----------
        records : sequence of Record
            Uniform and finite.
        box : Scheduling

        Returns
        -------
        Identification
        """
        ...


def fit_stages(records: Sequence[Record], structure: StagedStructure, box: Scheduling) -> Identification:
    """Search the stages' few parameters for the least free-run error; the linear part is a regression each time.

    The separation (variable projection) keeps the search in one to nine dimensions. Several starts from the data's own
    spread are tried, and the best are refined by Nelder & Mead 1965.

    Parameters
    ----------
    records : sequence of Record
        Uniform and finite.
    structure : StagedStructure
        With a bound basis and at least one of stage and schedule_filter given by name.
    box : Scheduling

    Returns
    -------
    Identification
        With the fitted stages in its model and structure.
    """
    with single_thread():
        return _search(records, structure, box)


def _search(records: Sequence[Record], structure: StagedStructure, box: Scheduling) -> Identification:
    sample = shorten(records, SAMPLES, structure.start + 50)
    starts = _starts(sample, structure, box)
    costs = in_forks(lambda s: free_run_cost(sample, s.of(structure), box), starts)
    order = np.argsort(costs, kind="stable")[:REFINED]
    found = in_forks(lambda i: _refine(sample, structure, box, starts[i]), order.tolist())
    best = min(found, key=lambda pair: pair[0])[1]
    result = best.of(structure).regress(records, box)
    stated = " and ".join(fitted_stages(result.model, structure))
    return result.replace(notes=(*result.notes, *unresolved(result.model, structure, records),
                                 f"fitted to the free run on training data: {stated}; the covariance holds it fixed"))


def require_motion(records: Sequence[Record], structure: object) -> None:
    """Refuse to fit a scheduling filter to records within which the scheduling is constant.

    Parameters
    ----------
    records : sequence of Record
    structure : object
        Any structure; one without a filter to be fitted, or with one that is given, needs no motion.

    Raises
    ------
    InputError
        A filter is asked for by name, and no record shows it.
    """
    wanted = getattr(structure, "schedule_filter", None)
    if not isinstance(wanted, str):
        return
    names = next((tuple(b.names) for n in ("external", "basis") if (b := getattr(structure, n, None)) is not None),
                 ()) or tuple(filter(None, (getattr(structure, "current", None),)))
    if at_rest(records, names):
        raise InputError(f"no scheduling filter can be fitted: {', '.join(names)} is constant within every record",
                         got=f"the filter '{wanted}'", why="a filter shows only where its input moves",
                         mend="leave the filter out, or add records in which the scheduling steps")


def fitted_stages(model: LPVTransferFunction, structure: StagedStructure) -> list[str]:
    """Parameters, with units, of every stage of the model that the structure only names.

    Parameters
    ----------
    model : LPVTransferFunction
        Fitted.
    structure : StagedStructure
        As requested.

    Returns
    -------
    list of str
        One entry for each stage.
    """
    found, stage, lag = [], model.input_stage, model.scheduling_stage
    if stage is not None and isinstance(structure.stage, str):
        unit = model.box.units[stage.variable] if model.box.names else ""
        values = stage.stated(model.inputs[stage.channel].unit, unit)
        found.append(f"input stage {structure.stage} ({values})")
    if lag is not None and isinstance(structure.schedule_filter, str):
        found.append(f"scheduling filter {structure.schedule_filter} ({lag.stated()})")
    return found


def unresolved(model: LPVTransferFunction, structure: StagedStructure, records: Sequence[Record]) -> tuple[str, ...]:
    """Whether the bend of a fitted stage is not identifiable, or one of its parameters at the search's bound.

    Parameters
    ----------
    model : LPVTransferFunction
        With the fitted stage.
    structure : StagedStructure
        As given: a stage that is an object was not fitted, and gives no remark.
    records : sequence of Record
        Of the fit.

    Returns
    -------
    tuple of str
        One remark, or none.
    """
    return knee_remarks(model, records) if isinstance(structure.stage, str) else ()


def knee_remarks(model: LPVTransferFunction, records: Sequence[Record]) -> tuple[str, ...]:
    """Whether the knee of a model's input stage is not identifiable, or at the search's bound.

    It is not identifiable where fewer samples lie inside the knee than the stage has free parameters, or where no
    sample leaves the part of it that is straight.

    Parameters
    ----------
    model : LPVTransferFunction
        Fitted.
    records : sequence of Record
        Of the fit.

    Returns
    -------
    tuple of str
        One remark, or none.
    """
    stage = model.input_stage
    if stage is None:
        return ()
    free = int(np.count_nonzero(stage.scales(1.0)))
    u = np.concatenate([np.abs(r[model.inputs[stage.channel].name]) for r in records])
    knee = stage.knee(np.vstack([r.matrix(model.box.names) for r in records]))
    inside = int(np.count_nonzero((u > 0) & (u < knee)))
    unit, name = model.inputs[stage.channel].unit, model.inputs[stage.channel].name
    if inside < free:
        return (f"not identifiable: the knee of the input stage, {float(knee.max()):.2g} {unit}, has collapsed: "
                f"{inside} samples of {name} lie inside it, so that the stage acts as sign({name})",)
    reach = float(np.max(u / knee))
    if stage.beyond_data or reach <= stage.STRAIGHT:
        return (f"not identifiable: the knee of the input stage, {float(knee.min()):.2g} {unit}, is beyond the data: "
                f"{name} reaches {float(u.max()):.2g} {unit}, {reach:.2g} of the knee, where the stage is a straight "
                "line but for a cubic term; extrapolate to no faster motion",)
    if not stage.at_bound:
        return ()
    (width, slope), variable = stage.KNEE, model.box.names[stage.variable]
    return (f"at its bound: {width} of the input stage, {NARROWEST:g} {unit}: where {variable} is 0 "
            f"the stage acts as sign({name}), and its width elsewhere is that of {slope} alone",)


@dataclass(frozen=True)
class _Stages:
    """The stages under search: those given as objects stay as they are."""

    stage: InputStage | None
    lag: SchedulingStage | None
    stage_scales: np.ndarray
    lag_scales: np.ndarray

    def of(self, structure: StagedStructure) -> StagedStructure:
        return replace(structure, stage=self.stage, schedule_filter=self.lag)

    @property
    def free(self) -> np.ndarray:
        return np.flatnonzero(np.concatenate([self.stage_scales, self.lag_scales]) > 0)

    def moved(self, z: np.ndarray) -> _Stages:
        step = np.concatenate([self.stage_scales, self.lag_scales])
        step[self.free] *= z
        cut = self.stage_scales.size
        stage = self.stage if self.stage is None or not cut else self.stage.with_vector(self.stage.vector + step[:cut])
        lag = self.lag if self.lag is None or not self.lag_scales.size else (
            self.lag.with_vector(self.lag.vector + step[cut:]))
        return replace(self, stage=stage, lag=lag)


def _starts(records: Sequence[Record], structure: StagedStructure, box: Scheduling) -> list[_Stages]:
    reach = float(box.half_width[0]) if box.names else 0.0
    none = np.zeros(0)
    if isinstance(structure.stage, str):
        u = np.vstack([r.matrix(structure.input) for r in records])
        p = np.vstack([r.matrix(box.names) for r in records])
        stages = [(s, s.scales(reach)) for s in STAGES[structure.stage]().starts(u, p)]
    else:
        stages = [(structure.stage, none)]
    if isinstance(structure.schedule_filter, str):
        assert records[0].sample_time is not None
        lags = [(s, s.scales()) for s in FITTED[structure.schedule_filter].starts(records[0].sample_time)]
    else:
        lags = [(structure.schedule_filter, none)]
    return [_Stages(s, lag, a, b) for (s, a), (lag, b) in itertools.product(stages, lags)]


def _refine(records: Sequence[Record], structure: StagedStructure, box: Scheduling,
            start: _Stages) -> tuple[float, _Stages]:
    from scipy.optimize import minimize

    n = start.free.size
    found = minimize(lambda z: free_run_cost(records, start.moved(z).of(structure), box), np.zeros(n),
                     method="Nelder-Mead",
                     options={"maxfev": 60 + 40 * n, "xatol": 1e-3, "fatol": 1e-6,
                              "initial_simplex": np.vstack([np.zeros(n), 0.6 * np.eye(n)])})
    return float(found.fun), start.moved(found.x)


def free_run_cost(records: Sequence[Record], structure: StagedStructure, box: Scheduling) -> float:
    """Pooled free-run ESR of the regression with fixed stages; large and finite where it diverges.

    Parameters
    ----------
    records : sequence of Record
        Uniform and finite.
    structure : StagedStructure
        With bound basis and stages as objects.
    box : Scheduling
        Of the scheduling variables.

    Returns
    -------
    float
        Mean over the outputs; above `DIVERGED_COST` for a run that diverges, the less the later it does, and twice
        that where there is no regression.
    """
    try:
        model = structure.regress(records, box).model
    except InputError:
        return 2 * DIVERGED_COST
    error = power = 0.0
    for record in records:
        y = record.matrix(structure.output)
        run = simulate(model, record)
        if run.diverged_at is not None:
            return DIVERGED_COST * (1 + 1 / (1 + run.diverged_at))
        measured = y[run.start:]
        error = error + np.sum((measured - run.output[run.start:]) ** 2, axis=0)
        power = power + np.sum((measured - measured.mean(axis=0)) ** 2, axis=0)
    return float(np.mean(error / np.maximum(power, 1e-300)))


def shorten(records: Sequence[Record], samples: int, minimum: int) -> list[Record]:
    """The head of every record, so that together they hold at most `samples` samples.

    Parameters
    ----------
    records : sequence of Record
    samples : int
        All records together.
    minimum : int
        Samples that every record keeps at least, though their sum then exceeds `samples`.

    Returns
    -------
    list of Record
    """
    total = sum(r.n_samples for r in records)
    if total <= samples:
        return list(records)
    return [r.slice(0, max(minimum, int(r.n_samples * samples / total))) for r in records]
