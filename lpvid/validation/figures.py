"""Error figures: ESR, fit and rmse of one kind of run, per record and pooled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lpvid.codec import Encoded
from lpvid.simulation import Simulation


def gain_percent(before: float, after: float) -> float:
    """Reduction of a squared error [%].

    Parameters
    ----------
    before, after : float
        In one unit; `before` above zero.

    Returns
    -------
    float
        Negative where the error is larger.
    """
    return 100.0 * (1.0 - after / before)


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
    mean_error : float or None
        Mean of measured less model in `rmse_unit` (first output): what a constant in the model would take away.
    """

    kind: str
    esr: float | None
    fit_percent: float | None
    rmse: float | None
    rmse_unit: str
    n_samples: int
    diverged_at: int | None = None
    mean_error: float | None = None

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Plain values by name.
        """
        data = {"esr": self.esr, "fit_percent": self.fit_percent, "rmse": self.rmse, "rmse_unit": self.rmse_unit,
                "mean_error": self.mean_error, "n_samples": self.n_samples}
        return data if self.diverged_at is None else {**data, "diverged_at": self.diverged_at}

    def __str__(self) -> str:
        if self.diverged_at is not None:
            return f"{self.kind} diverged at sample {self.diverged_at}"
        if self.esr is None:
            return f"{self.kind} without figures: the output does not move"
        unit = f" {self.rmse_unit}" if self.rmse_unit else ""
        mean = "" if self.mean_error is None else f", mean error {self.mean_error:.4g}{unit}"
        return f"{self.kind} ESR {self.esr:.4g} (fit {self.fit_percent:.1f} %, rmse {self.rmse:.4g}{unit}{mean})"


@dataclass(frozen=True)
class FigurePair(Encoded):
    """Free-run and one-step figures of the same samples.

    Attributes
    ----------
    free_run, one_step : Figures
    """

    free_run: Figures
    one_step: Figures


@dataclass(frozen=True)
class RecordFigures(Encoded):
    """Figures of one record.

    Attributes
    ----------
    name : str
        Of the record.
    n_samples : int
        Of the whole record.
    free_run, one_step : Figures
    extrapolation_share : float
        Share of the samples whose scheduling lies outside the training range, as in `Validation`.
    """

    name: str
    n_samples: int
    free_run: Figures
    one_step: Figures
    extrapolation_share: float


class Pool:
    """Sums of squares over records: pooled ESR sums numerators and denominators."""

    def __init__(self) -> None:
        self.error = np.zeros(0)
        self.power = np.zeros(0)
        self.count, self.unit, self.sum = 0, "", 0.0
        self.diverged: int | None = None

    def add(self, y: np.ndarray, run: Simulation) -> Figures:
        """Add the run of one record to the sums.

        Parameters
        ----------
        y : (n, n_outputs) array
            Measured outputs of the whole record.
        run : Simulation
            Its first `start` samples are left out.

        Returns
        -------
        Figures
            Of this record.
        """
        measured, model = y[run.start:], run.output[run.start:]
        power = np.sum((measured - measured.mean(axis=0)) ** 2, axis=0)
        power[np.ptp(measured, axis=0) == 0] = 0.0  # the mean of a constant may miss it by a rounding
        error = np.sum((measured - model) ** 2, axis=0)
        self.error = self.error + error if self.error.size else error
        self.power = self.power + power if self.power.size else power
        self.count += len(measured)
        total = float(np.sum(measured[:, 0] - model[:, 0]))
        self.sum += total
        self.unit = run.units[0]
        if self.diverged is None:
            self.diverged = run.diverged_at
        return figures_of(run.kind, (error, power, total), len(measured), self.unit, run.diverged_at)

    def total(self, kind: str) -> Figures:
        """Pooled figures of all records that were added.

        Parameters
        ----------
        kind : {"free-run", "one-step", "k-step"}
            What the runs were.

        Returns
        -------
        Figures
            Without figures where one of the runs diverged.
        """
        return figures_of(kind, (self.error, self.power, self.sum), self.count, self.unit, self.diverged)


def figures_of(kind: str, sums: tuple[np.ndarray, np.ndarray, float], count: int, unit: str,
               diverged: int | None) -> Figures:
    """Figures from squared error and squared deviation per output, and the sum of the first output's errors.

    Parameters
    ----------
    kind : {"free-run", "one-step", "k-step"}
        What the run was.
    sums : ((n_outputs,) array, (n_outputs,) array, float)
        Squared error, squared deviation of the measured output about each record's mean, and sum of measured less
        model.
    count : int
        Samples behind the sums.
    unit : str
        Of the first output.
    diverged : int or None
        Sample at which a run diverged.

    Returns
    -------
    Figures
        Without any after divergence or without samples; without ESR where an output does not move.
    """
    error, power, total = sums
    if diverged is not None or count == 0:
        return Figures(kind, None, None, None, unit, count, diverged)
    rmse, mean = float(np.sqrt(error[0] / count)), total / count
    if abs(mean) < np.sqrt(np.finfo(float).eps) * rmse:
        mean = 0.0  # that of a least-squares residual is zero but for rounding
    if not np.all(power > 0):
        return Figures(kind, None, None, rmse, unit, count, mean_error=mean)
    esr = float(np.mean(error / power))
    return Figures(kind, esr, float(100 * (1 - np.sqrt(esr))), rmse, unit, count, mean_error=mean)
