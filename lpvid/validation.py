"""How good a model is: free run and one step, training or held-out, and what is left in its residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.condition import segments, with_velocity
from lpvid.errors import InputError
from lpvid.familiar import familiar
from lpvid.record import Record
from lpvid.simulation import RATE_TOLERANCE, Model, Simulation, predict, simulate


@dataclass(frozen=True)
class Figures:
    """Error of one kind of run over some samples.

    Attributes
    ----------
    kind : str
        "free-run", "one-step" or "k-step".
    esr : float or None
        Σ(y−ŷ)²/Σ(y−ȳ)², each record about its own mean, averaged over outputs; None after divergence.
    fit_percent : float or None
        100 (1 − √ESR), also called BFR.
    rmse : float or None
        Root mean square error in `rmse_unit` (first output).
    n_samples : int
        Samples in the figure: those the run started from are left out.
    diverged_at : int or None
        Sample of the first record that diverged.
    """

    kind: str
    esr: float | None
    fit_percent: float | None
    rmse: float | None
    rmse_unit: str
    n_samples: int
    diverged_at: int | None = None

    def to_dict(self) -> dict:
        """Plain data for JSON."""
        data = {"esr": self.esr, "fit_percent": self.fit_percent, "rmse": self.rmse, "rmse_unit": self.rmse_unit,
                "n_samples": self.n_samples}
        return data if self.diverged_at is None else {**data, "diverged_at": self.diverged_at}

    def __str__(self) -> str:
        if self.diverged_at is not None:
            return f"{self.kind} diverged at sample {self.diverged_at}"
        if self.esr is None:
            return f"{self.kind} without figures: the output does not move"
        return f"{self.kind} ESR {self.esr:.4g} (fit {self.fit_percent:.1f} %, rmse {self.rmse:.4g} {self.rmse_unit})"


@dataclass(frozen=True)
class Pair:
    """Free-run and one-step figures of the same samples."""

    free_run: Figures
    one_step: Figures

    def to_dict(self) -> dict:
        """Plain data for JSON."""
        return {"free_run": self.free_run.to_dict(), "one_step": self.one_step.to_dict()}


@dataclass(frozen=True)
class RecordFigures:
    """Figures of one record."""

    name: str
    n_samples: int
    free_run: Figures
    one_step: Figures
    extrapolation_share: float

    def to_dict(self) -> dict:
        """Plain data for JSON."""
        return {"name": self.name, "n_samples": self.n_samples, "free_run": self.free_run.to_dict(),
                "one_step": self.one_step.to_dict(), "extrapolation_share": self.extrapolation_share}


@dataclass(frozen=True)
class ResidualTest:
    """A test on the one-step residuals.

    A small p-value says that the residual still holds something the model could have used.
    """

    name: str
    statistic: float
    p_value: float
    passed: bool
    says: str

    def to_dict(self) -> dict:
        """Plain data for JSON."""
        return {"name": self.name, "statistic": self.statistic, "p_value": self.p_value, "passed": self.passed,
                "says": self.says}


@dataclass(frozen=True, eq=False)
class Validation:
    """Figures of a model on a data set; `label` says whether the model has seen these data."""

    label: str
    overall: Pair
    records: tuple[RecordFigures, ...]
    residual_tests: tuple[ResidualTest, ...]
    extrapolation_share: float
    notes: tuple[str, ...] = ()

    def summary(self) -> str:
        """One line of figures."""
        return f"{self.overall.free_run}; {self.overall.one_step}"

    def to_dict(self) -> dict:
        """validation.json."""
        return {"schema": "lpvid/validation/1", "data": self.label, "overall": self.overall.to_dict(),
                "records": [r.to_dict() for r in self.records],
                "residual_tests": [t.to_dict() for t in self.residual_tests],
                "extrapolation_share": self.extrapolation_share, "notes": list(self.notes)}

    def __repr__(self) -> str:
        lines = [f"Validation ({self.label}): {self.summary()}"]
        lines += [f"  {r.name}: {r.free_run}" for r in self.records[:8]]
        if self.extrapolation_share > 0:
            lines.append(f"  {100 * self.extrapolation_share:.1f} % of samples outside the training range of p")
        lines += [f"  {t.name}: {t.says}" for t in self.residual_tests]
        return "\n".join(lines + [f"  note: {n}" for n in self.notes])


def validate(model: Model, records: Record | Sequence[Record], *, sample_rate: float | None = None,
             label: str = "held-out") -> Validation:
    """Figures of a model on measured records, free-run and one-step.

    Raw data of another rate are resampled (anti-aliased) to the model's rate, and a note says so.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
    records : Record or sequence of Record
        With the model's inputs, outputs and scheduling; cut at gaps and NaN.
    sample_rate : float, optional
        Rate [Hz] to which jittered records are resampled; the model's rate when left out.
    label : str
        "held-out" or "training": what these data are to the model. Data that begin like a training record are
        labelled as what they are, whatever is said here.

    Returns
    -------
    Validation

    Raises
    ------
    InputError
        Missing channels, no stretch long enough.
    """
    listed = [records] if isinstance(records, Record) else list(records)
    if model.sample_time is None:
        raise InputError("this model is continuous in time", why="records are sampled",
                         mend="discretise the model first")
    rate = 1.0 / model.sample_time
    foreign = [r for r in listed if not r.time_base.steady or abs(r.time_base.period * rate - 1) > RATE_TOLERANCE]
    channels = tuple(dict.fromkeys((*(s.name for s in (*model.inputs, *model.outputs)), *model.box.names)))
    if "velocity" in channels:
        listed = [with_velocity(r) for r in listed]
    pieces = segments(listed, channels, sample_rate=rate if foreign else sample_rate,
                      minimum=model.start + 2)
    notes = tuple(dict.fromkeys(n for r in listed for n in r.notes if "velocity" in n))
    if foreign:
        notes += (f"{len(foreign)} record(s) resampled to the model's {rate:.6g} Hz",)
    seen = familiar(model.metadata, pieces, model.outputs[0].name)
    if seen and label == "held-out":
        label = "training" if len(seen) == len(pieces) else "partly training"
        notes += (f"not held-out: {', '.join(seen[:4])} begins with samples that the model was fitted to",)
    return figures(model, pieces, label, notes)


def figures(model: Model, pieces: Sequence[Record], label: str, notes: tuple[str, ...] = ()) -> Validation:
    """As `validate`, for uniform finite records at the model's rate."""
    rows, free, one, residuals, inputs = [], _Pool(), _Pool(), [], []
    for piece in pieces:
        y = piece.matrix([s.name for s in model.outputs])
        run, step = simulate(model, piece), predict(model, piece, 1)
        p = piece.matrix(list(model.box.names))
        outside = float(np.mean(~model.box.contains(p))) if p.shape[1] else 0.0
        rows.append(RecordFigures(piece.name, piece.n_samples, free.add(y, run), one.add(y, step), outside))
        if step.diverged_at is None:
            residuals.append(_residual(y[step.start:, 0], step.output[step.start:, 0]))
            inputs.append(piece[model.inputs[0].name][step.start:] if model.inputs else None)
    total = sum(r.n_samples for r in rows)
    share = sum(r.extrapolation_share * r.n_samples for r in rows) / total
    overall = Pair(free.total("free-run"), one.total("one-step"))
    tests = residual_tests(residuals, inputs) if residuals else ()
    return Validation(label, overall, tuple(rows), tests, share, notes)


def _residual(y: np.ndarray, output: np.ndarray) -> np.ndarray:
    """One-step residual; zero where it is no more than the rounding of an exact model."""
    e = y - output
    return e if np.linalg.norm(e) > EXACT * np.linalg.norm(y) else np.zeros_like(e)


class _Pool:
    """Sums of squares over records: pooled ESR sums numerators and denominators."""

    def __init__(self) -> None:
        self.error = np.zeros(0)
        self.power = np.zeros(0)
        self.count, self.unit = 0, ""
        self.diverged: int | None = None

    def add(self, y: np.ndarray, run: Simulation) -> Figures:
        measured, model = y[run.start:], run.output[run.start:]
        power = np.sum((measured - measured.mean(axis=0)) ** 2, axis=0)
        power[np.ptp(measured, axis=0) == 0] = 0.0  # the mean of a constant may miss it by a rounding
        error = np.sum((measured - model) ** 2, axis=0)
        self.error = self.error + error if self.error.size else error
        self.power = self.power + power if self.power.size else power
        self.count += len(measured)
        self.unit = run.units[0]
        if self.diverged is None:
            self.diverged = run.diverged_at
        return _figures(run.kind, error, power, len(measured), self.unit, run.diverged_at)

    def total(self, kind: str) -> Figures:
        return _figures(kind, self.error, self.power, self.count, self.unit, self.diverged)


def _figures(kind: str, error: np.ndarray, power: np.ndarray, count: int, unit: str, diverged: int | None) -> Figures:
    if diverged is not None or count == 0:
        return Figures(kind, None, None, None, unit, count, diverged)
    rmse = float(np.sqrt(error[0] / count))
    if not np.all(power > 0):
        return Figures(kind, None, None, rmse, unit, count)
    esr = float(np.mean(error / power))
    return Figures(kind, esr, float(100 * (1 - np.sqrt(esr))), rmse, unit, count)


# -- residual tests --------------------------------------------------------------------------------------------------
LAGS = 25
LEVEL = 0.01
EXACT = 1e-11
"""residual over output below which a model is exact, and its residual nothing but rounding."""
RESOLVED = 1e-2
"""directions of the lagged inputs with less than this share of the largest variance say nothing reliable."""


def residual_tests(residuals: Sequence[np.ndarray], inputs: Sequence[np.ndarray | None],
                   lags: int = LAGS) -> tuple[ResidualTest, ...]:
    """Whiteness of the one-step residual and its independence from present and past inputs.

    Whiteness: Ljung & Box 1978, Q = N(N+2) Σ_τ ρ_ee²(τ)/(N−τ) against χ² with `lags` degrees of freedom. Independence:
    Söderström & Stoica 1989 (11.14), N r_εuᵀ P⁺ r_εu against χ², with P the covariance of the lagged inputs times the
    residual's own autocovariance summed over lags (Bartlett), so that a coloured residual does not fail by itself. Lags
    run from 0 (a missing direct term shows there and nowhere else; under feedback without a delay it shows too).

    Parameters
    ----------
    residuals, inputs : sequences of (n,) arrays, record by record
    lags : int
        Number of lags.
    """
    usable = [(e - e.mean(), u) for e, u in zip(residuals, inputs, strict=True) if len(e) > 4 * lags]
    if not usable:
        return ()
    tests = [_whiteness([e for e, _ in usable], lags)]
    driven = [(e, u - u.mean()) for e, u in usable if u is not None and np.ptp(u) > 0]
    if driven:
        tests.append(_independence(driven, lags))
    return tuple(tests)


def _autocovariance(pieces: Sequence[np.ndarray], lags: int) -> np.ndarray:
    n = sum(len(x) for x in pieces)
    return np.array([sum(float(x[: len(x) - k] @ x[k:]) for x in pieces if len(x) > k) / n for k in range(lags + 1)])


def _whiteness(residuals: Sequence[np.ndarray], lags: int) -> ResidualTest:
    from scipy.stats import chi2

    n = sum(len(e) for e in residuals)
    r = _autocovariance(residuals, lags)
    if not r[0] > 0:
        return ResidualTest("whiteness", 0.0, 1.0, True, "the residual is zero")
    rho = r[1:] / r[0]
    q = float(n * (n + 2) * np.sum(rho**2 / (n - np.arange(1, lags + 1))))
    p = float(chi2.sf(q, lags))
    worst = int(np.argmax(np.abs(rho))) + 1
    says = (f"white at the {100 * LEVEL:.0f} % level" if p >= LEVEL else
            f"not white: correlation {rho[worst - 1]:+.2f} at lag {worst} (p = {p:.1e}); "
            "standard errors are too small, and an output-error estimate may serve better")
    return ResidualTest("whiteness", q, p, p >= LEVEL, says)


def _independence(pairs: Sequence[tuple[np.ndarray, np.ndarray]], lags: int) -> ResidualTest:
    from scipy.stats import chi2

    n = sum(len(e) for e, _ in pairs)
    cross = np.array([sum(float(e[k:] @ u[: len(u) - k]) for e, u in pairs) / n for k in range(lags)])
    reach = 4 * lags
    re = _autocovariance([e for e, _ in pairs], reach)
    ru = _autocovariance([u for _, u in pairs], reach + lags)
    taper = 1 - np.arange(reach + 1) / (reach + 1)
    both = np.concatenate([(re * taper)[:0:-1], re * taper])
    shift = np.arange(-reach, reach + 1)
    difference = np.abs(np.subtract.outer(np.arange(lags), np.arange(lags)))
    covariance = np.array([np.sum(both * ru[np.abs(shift + d)]) for d in range(lags)])[difference]
    values, vectors = np.linalg.eigh(covariance)
    keep = values > max(RESOLVED * values.max(), 0.0)
    if not keep.any():
        return ResidualTest("independence", 0.0, 1.0, True, "the residual is zero")
    projected = vectors[:, keep].T @ cross
    statistic = float(n * np.sum(projected**2 / values[keep]))
    p = float(chi2.sf(statistic, int(keep.sum())))
    says = (f"independent of present and past inputs at the {100 * LEVEL:.0f} % level" if p >= LEVEL else
            f"depends on present or past inputs (p = {p:.1e}): other input lags, a higher degree or a shaped input "
            "may help")
    return ResidualTest("independence", statistic, p, p >= LEVEL, says)
