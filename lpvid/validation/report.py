"""`validate`: how good a model is, free run first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from lpvid import _checks
from lpvid.condition import segments, with_derived
from lpvid.condition.band_limited import IN_BAND, with_quiet_velocity
from lpvid.condition.derivation import derived
from lpvid.condition.segmentation import RATE_TOLERANCE
from lpvid.condition.tables import as_records
from lpvid.errors import InputError
from lpvid.files.streaming import Chunks
from lpvid.model.adaptable import Adaptable, acting, checked_model
from lpvid.model.hull import outside_share
from lpvid.model.lpv_model import LPVModel
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.remark import Cut, Derivation, ReadAs, of_records
from lpvid.simulation import Model, predict, simulate
from lpvid.training_fingerprint import beyond_training, recalled, unit_doubt, with_sources
from lpvid.training_rows import compared_rows
from lpvid.validation.coherent import independence_remark
from lpvid.validation.figures import FigurePair, Pool, RecordFigures
from lpvid.validation.opposite import opposite_remark
from lpvid.validation.regimes import FreeRunStretch, regimes
from lpvid.validation.residuals import OTHER_LAGS, Instrument, residual_of, residual_tests
from lpvid.validation.result import Validation
from lpvid.validation.starting import from_estimated_past, start_remark
from lpvid.validation.streamed import validate_stream
from lpvid.validation.trust import independent_samples

__all__ = ["Validation", "acting_model", "along", "figures", "validate"]


def acting_model(model: Model | Adaptable, records: Sequence[Record], sample_rate: float | None = None) -> Model:
    """What stands for a model on these records: itself, or what an `Adaptable` gives for its own or the data's rate.

    Parameters
    ----------
    model : model or Adaptable
    records : sequence of Record
        The first one's mean rate counts where nothing else is known.
    sample_rate : float, optional
        [Hz], for an `Adaptable` without a rate of its own.

    Returns
    -------
    model

    Raises
    ------
    InputError
        Something that does not run along records, such as a controller or a certificate.
    """
    checked_model(model, "only a model or a damper runs along records")
    given = None if sample_rate is None else 1.0 / _checks.positive(sample_rate, "sample_rate", "Hz")
    own = model.period if isinstance(model, Adaptable) else None
    return acting(model, own or given or records[0].time_base.period)


def _cuts(pieces: Sequence[Record]) -> tuple[str, ...]:
    """How files were read, what records lost, or that they were left out; each once, by the record's own name."""
    return of_records(((p.name.rpartition("#")[0] or p.name, p.notes) for p in pieces), (Cut, ReadAs))


def along(model: Model | Adaptable, records: Record | Sequence[Record], sample_rate: float | None = None, *,
          measured: bool = True) -> tuple[Model, list[Record], tuple[str, ...]]:
    """What acts for a model, and the records as it can run along them: its roles, its rate, without gaps.

    Parameters
    ----------
    model : LPVTransferFunction, LPVStateSpace, SelfScheduled or Adaptable
    records : Record or sequence of Record
        As read. Where a channel has another name than the model's, the roles of its training data are tried.
    sample_rate : float, optional
        Only the model's own rate [Hz] is accepted.
    measured : bool
        Whether the outputs are needed.

    Returns
    -------
    model, pieces, notes

    Raises
    ------
    InputError
        As `validate`.
    """
    listed = as_records(records)
    if not listed:
        raise InputError("no records given")
    model = acting_model(model, listed, sample_rate)
    if model.sample_time is None:
        raise InputError("this model is continuous in time", why="records are sampled",
                         mend="discretise the model first")
    rate = 1.0 / model.sample_time
    if sample_rate is not None and abs(sample_rate / rate - 1) > RATE_TOLERANCE:
        raise InputError("a model runs at its own rate", got=f"{sample_rate:.6g} Hz against {rate:.6g} Hz",
                         mend=f"--sample-rate {rate:.6g}, or leave it out")
    foreign = [r for r in listed if not r.time_base.steady or abs(r.time_base.period * rate - 1) > RATE_TOLERANCE]
    outputs = model.outputs if measured else ()
    channels = tuple(dict.fromkeys((*(s.name for s in (*model.inputs, *outputs)), *model.box.names)))
    listed = recalled(listed, model.metadata)
    listed = derived(with_derived(listed, channels), channels)
    in_band = IN_BAND.items() <= model.metadata.items() and all(r.has("displacement") for r in listed)
    kept = tuple(dict.fromkeys((*channels, "displacement"))) if in_band else channels
    pieces = segments(listed, kept, sample_rate=rate if foreign else None, minimum=model.start + 2)
    pieces = [with_quiet_velocity(r) for r in pieces] if in_band else pieces
    made = dict.fromkeys(n for r in (pieces or listed) for n in r.notes if isinstance(n, Derivation))
    notes = (*made, *_cuts(pieces))
    if foreign:
        count = "1 record" if len(foreign) == 1 else f"{len(foreign)} records"
        notes += (f"{count} resampled to the model's {rate:.6g} Hz",)
    notes += beyond_training(pieces, model.metadata, [s.name for s in model.inputs])
    notes += unit_doubt(pieces, model.metadata, channels)
    return model, pieces, notes


def validate(model: Model | Adaptable, records: Record | Sequence[Record] | Chunks, *, sample_rate: float | None = None,
             label: str | None = None, horizons: Sequence[int] = ()) -> Validation:
    """Figures of a model on measured records, free-run, one-step and at any further prediction horizons.

    Raw data of another rate are resampled (anti-aliased) to the model's rate, and a note states so.

    Parameters
    ----------
    model : LPVTransferFunction, LPVStateSpace, SelfScheduled or Adaptable
        An `Adaptable` runs at the rate of the data it was fitted to, or where that is not known at `sample_rate`, or
        at the data's.
    records : Record, sequence of Record, or Chunks
        With the model's inputs, outputs and scheduling; cut at gaps and NaN. `Chunks` of files larger than memory are
        read part by part (`lpvid.validation.streamed.validate_stream`).
    sample_rate : float, optional
        Only the model's own rate [Hz] is accepted; it is used in any case.
    label : str, optional
        "held-out" or "training": what these data are to the model. By default that is found by comparison with the
        rows that the model keeps of its training data, and "held-out or training" where a record is too short for
        that. Data that hold training rows are labelled as what they are, where "held-out" is given too.
    horizons : sequence of int
        Further prediction horizons [samples].

    Returns
    -------
    Validation

    Raises
    ------
    InputError
        Missing channels, another unit than the model's, no stretch long enough.
    """
    _checks.instance(horizons, (Sequence, np.ndarray), "prediction horizons are a sequence of whole numbers",
                     f"horizons=({horizons},)")
    if isinstance(records, Chunks):
        if len(horizons) or sample_rate is not None:
            raise InputError("a stream is validated by free run and one step, at its own rate",
                             mend="read the records whole: lpv.read(...)")
        acts = acting_model(model, [next(iter(records))])
        used = with_sources([*(s.name for s in (*acts.inputs, *acts.outputs)), *acts.box.names], acts.metadata)
        return validate_stream(acts, records.only(used), label=label)
    model, pieces, notes = along(model, records, sample_rate)
    label, stated = compared_rows(model.metadata, recalled(as_records(records), model.metadata), pieces,
                                  model.outputs[0].name).labelled(label)
    notes += stated
    stated = independence_remark(model, pieces, label) if label != "training" else None
    found = figures(model, pieces, label, notes if stated is None else (*notes, stated), horizons)
    run = found.overall.free_run
    turned = opposite_remark(model, pieces, run)
    late = from_estimated_past(model, pieces, run, found.independent_samples) if turned is None else None
    stated = turned if late is None else start_remark(run, late)
    return found if stated is None else replace(found, notes=(*found.notes, stated), from_estimated_past=late)


def figures(model: Model, pieces: Sequence[Record], label: str, notes: tuple[str, ...] = (),
            horizons: Sequence[int] = ()) -> Validation:
    """As `validate`, for uniform finite records at the model's rate.

    Parameters
    ----------
    model : model
        In discrete time.
    pieces : sequence of Record
        From `segments`.
    label : {"training", "held-out", "partly training", "held-out or training"}
        What these data are to the model.
    notes : tuple of str
        Remarks for the result.
    horizons : sequence of int
        Further prediction horizons [samples], at least 2.

    Returns
    -------
    Validation
    """
    assert model.sample_time is not None
    steps = [_checks.count(h, "a prediction horizon", at_least=2) for h in horizons]
    rows, free, one = [], Pool(), Pool()
    further = [Pool() for _ in steps]
    residuals: list[np.ndarray] = []
    inputs: list[np.ndarray | None] = []
    tested: list[tuple[Record, int]] = []
    stretches: list[FreeRunStretch] = []
    for piece in pieces:
        y = piece.matrix([s.name for s in model.outputs])
        u = piece[model.inputs[0].name] if model.inputs else None
        run, step = simulate(model, piece), predict(model, piece, 1)
        p = piece.matrix(list(model.box.names))
        outside = outside_share(model, p)
        rows.append(RecordFigures(piece.name, piece.n_samples, free.add(y, run), one.add(y, step), outside))
        for pool, horizon in zip(further, steps, strict=True):
            pool.add(y, predict(model, piece, horizon))
        if step.diverged_at is None:
            residuals.append(residual_of(y[step.start:, 0], step.output[step.start:, 0]))
            inputs.append(None if u is None else u[step.start:])
            tested.append((piece, step.start))
        if run.diverged_at is None:
            stretches.append(FreeRunStretch(y[run.start:, 0], run.output[run.start:, 0],
                                     None if u is None else u[run.start:], p[run.start:],
                                     piece.matrix([s.name for s in model.inputs[1:]])[run.start:]))
    total = sum(r.n_samples for r in rows)
    share = sum(r.extrapolation_share * r.n_samples for r in rows) / total
    return Validation(
        label, FigurePair(free.total("free-run"), one.total("one-step")), tuple(rows),
        residual_tests(residuals, inputs, other_lags=OTHER_LAGS, further=_further(model, tested)), share, notes,
        regimes(stretches, model.inputs[0].name if model.inputs else "",
                list(zip(model.box.names, model.box.units, strict=True)), model.sample_time),
        tuple(pool.total(f"{h}-step") for pool, h in zip(further, steps, strict=True)),
        independent_samples([s.measured - s.model for s in stretches]) if stretches else None)


def _further(model: Model, tested: Sequence[tuple[Record, int]]) -> dict[str, Callable[[], list[Instrument]]]:
    """Signals beside the first input that the residual must not depend on.

    The other inputs; and along every scheduling variable the lowest power of the normalised variable that the basis
    does not hold, which shows a degree that is too low: E[e(k) p(k)^m u(k−j)] = 0, or p(k−j)^m for coefficients there.
    """
    found: dict[str, Callable[[], list[Instrument]]] = {}
    for other in model.inputs[1:]:
        found[f"independence of {other.name}"] = lambda n=other.name: [(None, r[n][start:]) for r, start in tested]
    degree = model.basis.degree if isinstance(model, LPVModel) else None
    power = (2 if degree is None else degree) + 1
    lagged = isinstance(model, LPVTransferFunction) and model.lagged
    for column, name in enumerate(model.box.names if model.inputs else ()):
        centre, half = float(model.box.centre[column]), max(float(model.box.half_width[column]), 1e-300)

        def along(name: str = name, centre: float = centre, half: float = half) -> list[Instrument]:
            first, pairs = model.inputs[0].name, []
            for r, start in tested:
                weight, u = ((r[name][start:] - centre) / half) ** power, r[first][start:]
                pairs.append((None, weight * u) if lagged else (weight, u))
            return pairs

        found[f"independence along {name}"] = along
    return found
