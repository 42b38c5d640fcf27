"""Free run, one-step and k-step prediction of LPV models, divergence reported."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from shlex import quote
from typing import Any

import numpy as np

from lpvid import _checks
from lpvid.condition.repeated_stamps import one_row_per_stamp, refuse_contradictions
from lpvid.condition.segmentation import RATE_TOLERANCE
from lpvid.condition.tables import as_records
from lpvid.errors import InputError
from lpvid.initial_state import estimate_state
from lpvid.least_squares import FunctionResiduals, Shares, StopRule, minimise_dense
from lpvid.model.adaptable import Adaptable, acting, checked_model
from lpvid.model.designed import warn_outside
from lpvid.model.lft import LFTModel
from lpvid.model.quasi import SelfScheduled
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record

Model = LPVTransferFunction | LPVStateSpace | SelfScheduled
SPAN = 16_384
"""samples for which the basis is evaluated at once."""
DIVERGED = 1e9
"""a run whose output exceeds this many times the scale of the data, or of what drives it, is reported as diverged."""
FIT_SAMPLES = 200
"""samples, or 20 per order if that is more, to which an estimated initial condition is fitted."""


@dataclass(frozen=True, eq=False)
class Simulation:
    """Output of a model along a record.

    Attributes
    ----------
    output : (n, n_outputs) array
        Model output, SI. The first `start` rows are the measured samples it started from; from `diverged_at` on NaN.
    start : int
        Samples taken from the data as the start, not predicted: leave them out of every figure.
    horizon : int or None
        Steps ahead, or None for a free run.
    diverged_at : int or None
        First sample at which the run left all bounds, or None.
    initial : str
        What the run started from.
    names, units : tuple of str
        Outputs.
    sample_time : float
        Period [s].
    """

    output: np.ndarray
    start: int
    horizon: int | None
    diverged_at: int | None
    initial: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    sample_time: float

    @property
    def kind(self) -> str:
        """"free-run", "one-step" or "k-step"."""
        return "free-run" if self.horizon is None else "one-step" if self.horizon == 1 else f"{self.horizon}-step"

    def __repr__(self) -> str:
        end = "" if self.diverged_at is None else f", DIVERGED at sample {self.diverged_at}"
        return f"Simulation ({self.kind}, from {self.initial}): {self.output.shape[0]} samples of {self.names}{end}"


def simulate(model: Model | Adaptable, record: Record, initial: str | np.ndarray = "measured") -> Simulation:
    """Run a model freely along a record: its own past outputs, the record's inputs and scheduling.

    Parameters
    ----------
    model : LPVTransferFunction, LPVStateSpace, SelfScheduled or Adaptable
        Discrete-time model, or what acts as one at the record's rate. A continuous state space (such as a closed loop)
        runs along any uniform record, with inputs and scheduling linear between its samples
        (`lpvid.model.continuous_run`), from rest or from a given state.
    record : Record, mapping, data frame or structured array
        Uniform record at the model's rate with the model's inputs and scheduling (and outputs for "measured").
    initial : {"measured", "zero", "estimate"} or array
        Where to start. "measured": a transfer function from its first ``model.start`` measured samples, a state space
        from the state that fits the measured output best over the record's beginning, weighed against what its state
        can be (`lpvid.initial_state`). "zero": zero past and state.
        "estimate": the past or state that fits the measured output best (least squares over the record's beginning,
        in which the free run is linear). An array gives the past outputs (start, n_outputs), or the state (n,).

    Returns
    -------
    Simulation

    Raises
    ------
    InputError
        Missing or non-finite channels, another sampling rate.

    Warns
    -----
    ExtrapolationWarning
        A designed controller or closed loop along scheduling outside the box that it was designed for.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> model = LPVTransferFunction.siso([[-0.5, 0.0]], [[0, 0], [1.0, 0.5]], Polynomial("p", degree=1), 0.1)
    >>> record = Record({"u1": [1.0, 1, 1], "p": [0.0, 1, 1]}, sample_time=0.1)
    >>> simulate(model, record, "zero").output.ravel()
    array([0.  , 1.5 , 2.25])
    """
    needs_output = isinstance(initial, str) and initial != "zero"
    model, record = _acting(model, one_record(record, "simulate"), needs_output)
    if isinstance(model, LPVStateSpace) and model.sample_time is None:
        return _simulate_continuous(model, record, initial)
    u, p = _signals(model, record)
    warn_outside(model, p, record.name)
    y = _outputs(model, record) if needs_output else np.zeros((record.n_samples, model.n_outputs))
    if isinstance(model, LPVTransferFunction):
        return _simulate_io(model, u, p, y, initial)
    if isinstance(model, SelfScheduled):
        return _simulate_self(model, u, p, y, initial)
    return _simulate_ss(model, u, p, y, initial)


def _simulate_continuous(model: LPVStateSpace, record: Record, initial: str | np.ndarray) -> Simulation:
    from lpvid.model.continuous_run import continuous_run

    if record.sample_time is None:
        raise InputError(f"record '{record.name}' is not uniformly sampled", mend="resample it first")
    if model.scheduling_stage is not None:
        raise InputError("a continuous model with a scheduling stage does not run along a record",
                         mend="discretise the model first")
    measured = _columns(record, model.inputs)
    p = _columns(record, [Signal(n, u) for n, u in zip(model.box.names, model.box.units, strict=True)])
    u = measured if model.input_stage is None else model.input_stage.apply(measured, p)
    warn_outside(model, p, record.name)
    at_rest = isinstance(initial, str)
    x = np.zeros(model.order) if at_rest else np.asarray(initial, dtype=float)
    x = _checks.shaped(x, (model.order,), "initial")
    output = continuous_run(model, u, p, record.sample_time, x)
    beyond, origin = _first_beyond(output, _limit(model, u, 1.0)), "rest" if at_rest else "given state"
    return Simulation(output, 0, None, beyond, origin, tuple(s.name for s in model.outputs),
                      tuple(s.unit for s in model.outputs), record.sample_time)


def predict(model: Model | Adaptable, record: Record, horizon: int = 1) -> Simulation:
    """Predict every sample `horizon` steps ahead from the measured past.

    A transfer function predicts by its equation from measured outputs up to k−horizon, with the innovations of its
    noise model up to there and none after (Ljung 1999 (3.20), (3.31)); with output noise that is the free run. A state
    space with an observer gain runs it as its observer; one without a gain has no noise model, and its predictor is the
    free run at any horizon. A self-scheduled model starts afresh from the measured output at k−horizon; one with
    output noise runs freely.

    Parameters
    ----------
    model : LPVTransferFunction, LPVStateSpace, SelfScheduled or Adaptable
    record : Record
        As for `simulate`; the outputs must be measured.
    horizon : int
        Steps ahead, at least 1.

    Returns
    -------
    Simulation

    Raises
    ------
    InputError
        A horizon below one, a missing or unsuitable channel, another rate than the model's.
    """
    from lpvid import _kernels

    horizon = _checks.count(horizon, "horizon", at_least=1)
    model, record = _acting(model, one_record(record, "predict"), True)
    u, p = _signals(model, record)
    y = _outputs(model, record)
    if len(y) <= model.start:
        raise _too_short(model, len(y))
    if isinstance(model, SelfScheduled) and model.noise.kind == "output":
        free = _simulate_self(model, u, p, y, "measured")
        return _finish(model, free.output, free.start, horizon, free.diverged_at, free.initial)
    if isinstance(model, SelfScheduled):
        ahead = model.predict(u, p, y[:, 0], horizon)[:, None]
        beyond = _first_beyond(ahead, _limit(model, u, _scale(y)))
        return _finish(model, ahead, model.start, horizon, beyond, "measured past")
    if isinstance(model, LPVTransferFunction) and model.noise.kind != "equation":
        return _predict_coloured(model, u, p, y, horizon)
    if isinstance(model, LPVTransferFunction):
        out = _predict_equation(model, u, p, y, horizon)
        return _finish(model, out, model.start, horizon, _first_beyond(out, _limit(model, u, _scale(y))),
                       "measured past")
    phi = np.ascontiguousarray(model.basis.evaluate(p))
    out = y.copy()
    if model.observer_gain is None:
        free = _simulate_ss(model, u, p, y, "measured")
        return _finish(model, free.output, free.start, horizon, free.diverged_at, "measured (no noise model)")
    x0 = estimate_state(model, phi, u, y, model.start, _limit(model, u, _scale(y)), weighed=False)
    _kernels.predict_ss(model.A, model.B, model.C, model.D, model.state_offset, model.output_offset,
                        model.observer_gain, phi, _checks.read_only(u), x0, _checks.read_only(y), horizon, out)
    return _finish(model, out, model.start, horizon, _first_beyond(out, _limit(model, u, _scale(y))), "observer")


def _predict_equation(model: LPVTransferFunction, u: np.ndarray, p: np.ndarray, y: np.ndarray,
                      horizon: int) -> np.ndarray:
    """k-step prediction by the equation, span by span, so that the basis of the whole record is never held."""
    from lpvid import _kernels

    u, y = _checks.read_only(u), _checks.read_only(y)
    if horizon == 1:
        return _one_step(model, u, p, y)
    out, n, start = y.copy(), len(y), model.start
    local = model.basis.lags == (0, 0)
    span = SPAN if local else n
    for first in range(start, n, span):
        last = min(first + span, n)
        low = max(first - start - (horizon - 1), 0) if local else 0
        phi = np.ascontiguousarray(model.basis.evaluate(p[low:last]))
        piece = y[low:last].copy()
        _kernels.predict_io(model.a, model.b, model.c, _first_lag(model), model.lagged, phi, u[low:last], y[low:last],
                            start, horizon, piece)
        out[first:last] = piece[first - low:]
    return out


def _one_step(model: LPVTransferFunction, u: np.ndarray, p: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The equation's right-hand side: a model without output lags whose inputs are the measured outputs and the inputs.

    It runs through the kernel of the free run, which takes a block of samples at a time.
    """
    ny, na, nb = model.n_outputs, model.na, model.n_lags
    b = np.zeros((max(na + 1, nb), ny, ny + model.b.shape[2], model.b.shape[3]))
    b[1: na + 1, :, :ny] = -model.a
    b[:nb, :, ny:] = model.b
    b.setflags(write=False)
    out = y.copy()
    stop = _spans(model, model.a[:0], b, min(1, _first_lag(model)), p,
                  np.ascontiguousarray(np.vstack([y.T, u.T])), out, model.start, np.inf)
    if stop is not None:
        out[stop:] = np.nan
    return out


# -- transfer function -----------------------------------------------------------------------------------------------
def _simulate_io(model: LPVTransferFunction, u: np.ndarray, p: np.ndarray, y: np.ndarray,
                 initial: str | np.ndarray) -> Simulation:
    start = model.start
    if isinstance(initial, str):
        _checks.one_of(initial, ("measured", "zero", "estimate"), "initial")
    if not isinstance(initial, str):
        given = _checks.frozen_array(initial, "initial", ndim=2)
        past = _checks.finite(_checks.shaped(given, (start, model.n_outputs), "initial past outputs"), "initial")
        if len(y) < start:
            raise _too_short(model, len(y))
        out = np.empty_like(y)
        out[:start] = past
        diverged = _run_io(model, p, u, out, start, np.abs(past).max(initial=0.0))
        return _finish(model, out, start, None, diverged, "given past")
    if initial == "measured":
        if len(y) <= start:
            raise _too_short(model, len(y))
        out = np.empty_like(y)
        out[:start] = y[:start]
        diverged = _run_io(model, p, u, out, start, _scale(y))
        return _finish(model, out, start, None, diverged, "measured samples")
    padded_u, padded_p = _pad(u, start), _pad(p, start, hold=True)
    out = np.zeros((len(y) + start, model.n_outputs))
    if initial == "zero":
        diverged = _run_io(model, padded_p, padded_u, out, start, 0.0)
        return _finish(model, out[start:], 0, None, _earlier(diverged, start), "zero")
    past = _estimate_past(model, padded_p, padded_u, y, start)
    out[:start] = past
    diverged = _run_io(model, padded_p, padded_u, out, start, _scale(y))
    return _finish(model, out[start:], 0, None, _earlier(diverged, start), "estimated past")


def _run_io(model: LPVTransferFunction, p: np.ndarray, u: np.ndarray, out: np.ndarray, start: int,
            scale: float) -> int | None:
    """Fill `out` from `start` on, span by span, so that the basis stays in the cache; the diverging sample or None."""
    return _spans(model, model.a, model.b, _first_lag(model), p, np.ascontiguousarray(u.T), out, start,
                  _limit(model, u, scale))


def _spans(model: LPVTransferFunction, a: np.ndarray, b: np.ndarray, first_lag: int, p: np.ndarray, driven: np.ndarray,
           out: np.ndarray, start: int, limit: float) -> int | None:
    """The recursion with these coefficients over spans of samples; the diverging one or None."""
    run = _recursion(out.shape[1], len(out) - start)
    driven = driven.view()
    driven.setflags(write=False)  # one kind of array, one compilation
    n, local = len(out), model.basis.lags == (0, 0)
    span = SPAN if local else n
    for first in range(start, n, span):
        last = min(first + span, n)
        low = first - start if local else 0
        phi = np.ascontiguousarray(model.basis.evaluate(p[low:last] if local else p).T)
        code = run(a, b, model.c, first_lag, model.lagged, phi, low, driven, out, first, last, limit)
        if code >= 0:
            return int(code)
    return None


def _recursion(outputs: int, samples: int) -> Callable[..., int]:
    """What runs a recursion: compiled, but for one output over few samples, which need not wait for a compiler."""
    from lpvid._banded_run import SHORT, free_run_banded

    if outputs == 1 and samples <= SHORT:
        return free_run_banded
    from lpvid._kernels import free_run_io

    return free_run_io


def _estimate_past(model: LPVTransferFunction, p: np.ndarray, u: np.ndarray, y: np.ndarray, start: int) -> np.ndarray:
    """Past outputs that fit the first samples best: the free run is affine in them."""
    length = min(len(y), max(20 * model.order, FIT_SAMPLES))
    rows = slice(0, length + start)
    unknown = start * model.n_outputs
    if not unknown:
        return np.zeros((start, model.n_outputs))

    def response(past: np.ndarray) -> np.ndarray:
        out = np.zeros((length + start, model.n_outputs))
        out[:start] = past.reshape(start, model.n_outputs)
        _run_io(model, p[rows], u[rows], out, start, _scale(y))
        return out[start:].ravel()

    forced = response(np.zeros(unknown))
    scale = _scale(y) or 1.0
    influence = np.column_stack([response(scale * e) - forced for e in np.eye(unknown)])
    solution = np.linalg.lstsq(influence, y[:length].ravel() - forced, rcond=1e-10)[0]
    return (scale * solution).reshape(start, model.n_outputs)


def _first_lag(model: LPVTransferFunction) -> int:
    """First input lag with a non-zero coefficient: the kernel skips the structural zeros before it."""
    used = np.flatnonzero(np.any(model.b != 0, axis=(1, 2, 3)))
    return int(used[0]) if used.size else model.n_lags


# -- state space -----------------------------------------------------------------------------------------------------
def _simulate_ss(model: LPVStateSpace, u: np.ndarray, p: np.ndarray, y: np.ndarray,
                 initial: str | np.ndarray) -> Simulation:
    phi = np.ascontiguousarray(model.basis.evaluate(p))
    measured = isinstance(initial, str) and initial == "measured"
    if not isinstance(initial, str):
        given = _checks.frozen_array(initial, "initial", ndim=1)
        x0 = _checks.finite(_checks.shaped(given, (model.order,), "the initial state"), "the initial state")
        stated = "given state"
    elif _checks.one_of(initial, ("measured", "zero", "estimate"), "initial") == "zero":
        x0, stated = np.zeros(model.order), "zero state"
    elif measured and len(y) <= model.start:
        raise _too_short(model, len(y))
    else:
        length = model.start if measured else max(20 * model.order, FIT_SAMPLES)
        x0, stated = estimate_state(model, phi, u, y, length, _limit(model, u, _scale(y))), "estimated state"
    out = np.zeros((len(u), model.n_outputs))
    diverged = _run_ss(model, phi, u, x0, out, _scale(y))
    return _finish(model, out, model.start if measured else 0, None, diverged, stated)


def _run_ss(model: LPVStateSpace, phi: np.ndarray, u: np.ndarray, x0: np.ndarray, out: np.ndarray,
            scale: float) -> int | None:
    from lpvid import _kernels

    x0 = _checks.read_only(np.ascontiguousarray(x0))
    code = _kernels.free_run_ss(model.A, model.B, model.C, model.D, model.state_offset, model.output_offset, phi,
                                _checks.read_only(u), x0, out, _limit(model, u, scale, x0))
    return None if code < 0 else int(code)


# -- noise models ----------------------------------------------------------------------------------------------------
def _predict_coloured(model: LPVTransferFunction, u: np.ndarray, p: np.ndarray, y: np.ndarray,
                      horizon: int) -> Simulation:
    from lpvid import _kernels, _noise

    u, y = _checks.read_only(u), _checks.read_only(y)
    noise, start = model.noise, model.start
    assert noise.c is not None and noise.d is not None
    limit = _limit(model, u, _scale(y))
    if noise.kind == "output":
        free = _simulate_io(model, u, p, y, "measured")
        return _finish(model, free.output, start, horizon, free.diverged_at, "measured samples")
    functions = np.ascontiguousarray(model.basis.evaluate(p))
    phi, v, e, out = np.ascontiguousarray(functions.T), np.zeros_like(y), np.zeros_like(y), y.copy()
    if noise.kind == "box-jenkins":
        plant = _simulate_io(model, u, p, y, "measured")
        if plant.diverged_at is not None:
            return _finish(model, plant.output, start, horizon, plant.diverged_at, "measured samples")
        v[start:] = (y - plant.output)[start:]
        code = _noise.innovations(v, noise.c, noise.d, phi, model.lagged, start, limit, e)
        ahead = np.zeros_like(y)
        _noise.predict_coloured(v, e, noise.c, noise.d, start, horizon, ahead)
        out[start:] = (plant.output + ahead)[start:]
    else:
        first, step = _first_lag(model), np.zeros_like(y)
        _kernels.predict_io(model.a, model.b, model.c, first, model.lagged, functions, u, y, start, 1, step)
        v[start:] = (y - step)[start:]
        code = _noise.innovations(v, noise.c, noise.d, phi, model.lagged, start, limit, e)
        forced = np.zeros_like(y)
        _kernels.predict_io(model.a[:0], model.b, model.c, first, model.lagged, functions, u, y, start, 1, forced)
        _noise.predict_armax(forced, model.a, noise.c, y, e, phi, model.lagged, start, horizon, out)
    diverged = int(code) if code >= 0 else _first_beyond(out, limit)
    return _finish(model, out, start, horizon, diverged, "measured past")


# -- self-scheduled models ---------------------------------------------------------------------------------------------
def _simulate_self(model: SelfScheduled, u: np.ndarray, p: np.ndarray, y: np.ndarray,
                   initial: str | np.ndarray) -> Simulation:
    start, limit = model.start, _limit(model, u, _scale(y))
    if len(y) <= start:
        raise _too_short(model, len(y))
    if not isinstance(initial, str):
        given = _checks.shaped(_checks.frozen_array(initial, "initial", ndim=2), (start, 1), "initial past outputs")
        out, diverged = model.free_run(u, p, _checks.finite(given, "initial")[:, 0], limit)
        return _finish(model, out[:, None], start, None, diverged, "given past")
    if _checks.one_of(initial, ("measured", "zero", "estimate"), "initial") == "measured":
        out, diverged = model.free_run(u, p, y[:start, 0], limit)
        return _finish(model, out[:, None], start, None, diverged, "measured samples")
    u, p = _pad(u, start), _pad(p, start, hold=True)
    past, stated = np.zeros(start), "zero"
    if initial == "estimate":
        past, stated = _estimate_self(model, u, p, y[:, 0], limit), "estimated past"
    out, diverged = model.free_run(u, p, past, limit)
    return _finish(model, out[start:, None], 0, None, _earlier(diverged, start), stated)


def _estimate_self(model: SelfScheduled, u: np.ndarray, p: np.ndarray, y: np.ndarray, limit: float) -> np.ndarray:
    """Past outputs that fit the first samples best, by damped Gauss-Newton steps with difference quotients."""
    start, memory = model.start, model.memory
    if not memory:
        return np.zeros(start)
    length = min(len(y), FIT_SAMPLES)
    scale = _scale(y)

    def error(unknown: np.ndarray) -> np.ndarray:
        past = np.concatenate([np.zeros(start - memory), unknown])
        out, diverged = model.free_run(u[: start + length], p[: start + length], past, limit)
        return np.full(length, scale * DIVERGED) if diverged is not None else out[start:] - y[:length]

    def slopes(past: np.ndarray) -> np.ndarray:
        now, nudge = error(past), 1e-6 * scale
        return np.column_stack([(error(past + nudge * e) - now) / nudge for e in np.eye(memory)])

    found = minimise_dense(FunctionResiduals(error, slopes), np.full(memory, y[0]),
                           StopRule(0.0, iterations=10, least_decrease=0.0, worth=0.0), damping_rule=Shares(0.25, 0.06))
    assert found is not None
    return np.concatenate([np.zeros(start - memory), found.trial.point])


# -- shared ----------------------------------------------------------------------------------------------------------
def one_record(given: Any, verb: str) -> Record:
    """The record, rows of one time stamp as one, or what becomes one: named columns of a dict, an array or a frame.

    Parameters
    ----------
    given : Record, mapping, data frame, structured array, or a list of one of these
    verb : str
        Name of the function that was given it, for the message.

    Returns
    -------
    Record

    Raises
    ------
    InputError
        Several records, or what is none.
    """
    listed = as_records(given)
    if len(listed) != 1:
        raise InputError(f"{verb} takes one record", got=f"{len(listed)}",
                         mend=f"[lpv.{verb}(model, r) for r in records]")
    return listed[0]


def _acting(model: Model | Adaptable, record: Record, needs_output: bool) -> tuple[Model, Record]:
    """What runs along this record, and the record, rows of one time stamp as one as far as the channels in use go."""
    checked_model(model, "only a model or a damper runs along records")
    if isinstance(model, LFTModel):
        raise InputError("a linear fractional form does not run along a record", got=repr(model),
                         mend="use model.simulate(inputs, scheduling), or lpvid.to_gridded(model).model")
    if record.sample_time is None and record.time_base.duplicates:
        runs = acting(model, record.time_base.period)
        measured = runs.outputs if needs_output else ()
        wanted = [*(s.name for s in (*runs.inputs, *measured)), *runs.box.names]
        refuse_contradictions(record, wanted)
        record = one_row_per_stamp(record, wanted)
    if isinstance(model, Adaptable) and record.sample_time is None:
        raise InputError(f"record '{record.name}' is not uniformly sampled", mend="resample it first")
    return acting(model, record.sample_time or 0.0), record


def _signals(model: Model, record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Filter inputs and scheduling of a record that fits the model."""
    if model.sample_time is None:
        raise InputError("this model is continuous in time", why="a record is sampled",
                         mend="discretise the model first")
    if record.sample_time is None:
        raise InputError(f"record '{record.name}' is not uniformly sampled", mend="resample it first")
    if abs(record.sample_time / model.sample_time - 1) > RATE_TOLERANCE:
        raise InputError(f"record '{record.name}' has another rate than the model",
                         got=f"{1 / record.sample_time:.6g} Hz against {1 / model.sample_time:.6g} Hz",
                         mend="resample the record to the model's rate")
    measured = _columns(record, model.inputs)
    p = _columns(record, [Signal(n, u) for n, u in zip(model.box.names, model.box.units, strict=True)])
    if model.scheduling_stage is not None:
        p = model.scheduling_stage.apply(p, model.sample_time)
    u = measured if model.input_stage is None else model.input_stage.apply(measured, p)
    return np.ascontiguousarray(u), p


def _outputs(model: Model, record: Record) -> np.ndarray:
    return np.ascontiguousarray(_columns(record, model.outputs))


def _columns(record: Record, wanted: Sequence[Signal]) -> np.ndarray:
    names = [s.name for s in wanted]
    for signal in wanted:
        channel = record.channel(signal.name)
        if not channel.unit_known:
            raise InputError(f"record '{record.name}', channel '{signal.name}': unknown unit",
                             got=f"'{channel.source_unit}'",
                             mend="correct the unit in the header, or leave it out if the values are SI")
        if signal.unit and channel.unit and signal.unit != channel.unit:
            raise InputError(f"record '{record.name}', channel '{signal.name}' has another unit than the model's",
                             got=f"{channel.unit} against {signal.unit}", mend="correct the header, or map the channel "
                             f"that is meant with --role {quote(signal.name + '=CHANNEL')}")
    values = record.matrix(names)
    if not np.isfinite(values.sum()) and not np.isfinite(values).all():
        row, column = (int(i) for i in np.argwhere(~np.isfinite(values))[0])
        raise InputError(f"record '{record.name}', channel '{names[column]}', sample {row} is not finite",
                         mend="cut the record with condition.segments")
    return values


def _pad(values: np.ndarray, rows: int, *, hold: bool = False) -> np.ndarray:
    head = np.repeat(values[:1], rows, axis=0) if hold else np.zeros((rows, values.shape[1]))
    return np.ascontiguousarray(np.vstack([head, values]))


def _scale(y: np.ndarray) -> float:
    return max(float(y.max(initial=0.0)), -float(y.min(initial=0.0))) or 1.0


def _limit(model: Model, u: np.ndarray, scale: float, x0: np.ndarray | None = None) -> float:
    """What no sane run exceeds: `DIVERGED` times the scale of the data or of one step's forcing, in any units."""
    reach = max(float(u.max(initial=0.0)), -float(u.min(initial=0.0)))
    return DIVERGED * (max(scale, model.forcing(reach, 0.0 if x0 is None else float(np.abs(x0).sum()))) or 1.0)


def _first_beyond(out: np.ndarray, limit: float) -> int | None:
    sane = np.all(np.abs(out) < limit, axis=1)
    return None if sane.all() else int(np.argmin(sane))


def _too_short(model: Model, length: int) -> InputError:
    return InputError(f"a run of this model starts from {model.start} measured samples", got=f"{length} samples",
                      mend="give a longer record")


def _earlier(diverged: int | None, start: int) -> int | None:
    return None if diverged is None else max(diverged - start, 0)


def _finish(model: Model, out: np.ndarray, start: int, horizon: int | None, diverged: int | None,
            initial: str) -> Simulation:
    if diverged is not None:
        out = out.copy()
        out[diverged:] = np.nan
    out.setflags(write=False)
    assert model.sample_time is not None
    return Simulation(out, start, horizon, diverged, initial, tuple(s.name for s in model.outputs),
                      tuple(s.unit for s in model.outputs), model.sample_time)
