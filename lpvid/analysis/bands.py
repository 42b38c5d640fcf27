"""What the uncertainty of an identified model means for its frequency response and its free run."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.lpv_model import LPVModel
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.simulation import Model, one_record, simulate


@dataclass(frozen=True, eq=False)
class Band:
    """Pointwise quantiles over drawn models.

    Attributes
    ----------
    axis : (n,) array
        Frequency [Hz] or time [s].
    low, median, high : arrays with n rows
        Quantiles: magnitude (n, n_outputs, n_inputs) of a frequency response, or output (n, n_outputs) of a free run.
    level : float
        Coverage of the band, between 0 and 1.
    draws : int
        Models behind it.
    diverged : int
        Draws left out because their free run diverged.
    kind : str
        "frequency response magnitude, frozen" or "free-run output".
    """

    axis: np.ndarray
    low: np.ndarray
    median: np.ndarray
    high: np.ndarray
    level: float
    draws: int
    diverged: int
    kind: str

    def contains(self, values: np.ndarray) -> np.ndarray:
        """Which of `values` (shaped as `low`) lie inside the band.

        Parameters
        ----------
        values : array
            In the unit of the band.

        Returns
        -------
        array of bool
            Ends included; False for NaN.
        """
        return (values >= self.low) & (values <= self.high)

    def __str__(self) -> str:
        width = float(np.nanmax(self.high - self.low))
        lost = f", {self.diverged} more diverged" if self.diverged else ""
        return f"{self.level:.0%} band of the {self.kind}: widest {width:.4g}, {self.draws} draws{lost}, pointwise"

    __repr__ = __str__


def frequency_band(models: Iterable[Model], at: Sequence[float] | np.ndarray, frequencies: np.ndarray,
                   level: float = 0.95) -> Band:
    """Pointwise band of the frozen frequency response's magnitude over drawn models.

    Discrete: |N(z, p)/D(z, p)| at z = exp(j 2π f T_s); continuous at s = j 2π f. It is the response of the linear part,
    after any input stage, with the scheduling held at `at`.

    Parameters
    ----------
    models : iterable of LPVTransferFunction or LPVStateSpace
        Draws of one model, for example of ``Identification.draw(rng, 500)``.
    at : (n_scheduling,) array
        Frozen scheduling, in physical units.
    frequencies : (n,) array
        Frequencies [Hz].
    level : float
        Coverage, between 0 and 1.

    Returns
    -------
    Band
    """
    drawn = _drawn(models, level)
    hertz = _checks.finite(_checks.frozen_array(frequencies, "frequencies", ndim=1), "frequencies")
    magnitude = np.abs([frequency_response(m, at, hertz) for m in drawn])
    low, median, high = _quantiles(magnitude, level)
    return Band(hertz, low, median, high, level, len(drawn), 0, "frequency response magnitude, frozen")


def free_run_band(models: Iterable[Model], record: Record, level: float = 0.95,
                  noise: bool = False, rng: np.random.Generator | int | None = None) -> Band:
    """Pointwise band of the free-run output over drawn models.

    It shows what the parameters' uncertainty does; with ``noise=True`` white output noise of each model's own
    noise covariance is added, for output-error models, so that the band covers measurements.

    Parameters
    ----------
    models : iterable of LPVTransferFunction or LPVStateSpace
    record : Record
        Uniform, at the models' rate.
    level : float
    noise : bool
    rng : numpy.random.Generator or int, optional
        Needed with ``noise=True``.

    Returns
    -------
    Band

    Raises
    ------
    InputError
        Fewer than two models, a level outside of (0, 1), a band with noise without a generator, or models that all
        diverge on the record.
    """
    drawn, record = _drawn(models, level), one_record(record, "free_run_band")
    runs = [simulate(m, record) for m in drawn]
    kept = [r for r in runs if r.diverged_at is None]
    if not kept:
        raise InputError("every drawn model diverges on this record", got=f"{len(runs)} draws",
                         mend="see stability_probability; the estimate is too uncertain for a band")
    outputs = np.array([r.output for r in kept])
    if noise:
        if rng is None:
            raise InputError("a band with noise needs a random generator", mend="pass rng=0")
        rng = _checks.generator(rng)
        outputs += np.array([rng.standard_normal(outputs[0].shape) @ _noise_root(m).T
                             for m, r in zip(drawn, runs, strict=True) if r.diverged_at is None])
    low, median, high = _quantiles(outputs, level)
    return Band(record.times, low, median, high, level, len(kept), len(runs) - len(kept), "free-run output")


def frequency_response(model: Model, at: Sequence[float] | np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """(n, n_outputs, n_filter_inputs) complex frozen frequency response at frequencies [Hz].

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        Its linear part counts, behind any input stage.
    at : (n_scheduling,) array
        Held scheduling, in physical units.
    frequencies : (n,) array
        [Hz]

    Returns
    -------
    (n, n_outputs, n_filter_inputs) complex array
        In units of output per input.
    """
    hertz = np.asarray(frequencies, dtype=float)
    if isinstance(model, LPVTransferFunction):
        a, b, _ = model.coefficients(at)
        z = np.exp(2j * np.pi * hertz * model.sample_time)
        backward = z[:, None] ** -np.arange(1, model.na + 1)[None, :]
        left = np.eye(model.n_outputs) + np.einsum("fi,ioq->foq", backward, a)
        right = np.einsum("fj,jou->fou", z[:, None] ** -np.arange(model.n_lags)[None, :], b)
        return np.linalg.solve(left, right)
    assert isinstance(model, LPVStateSpace)
    A, B, C, D = model.frozen(at)
    s = 2j * np.pi * hertz if model.sample_time is None else np.exp(2j * np.pi * hertz * model.sample_time)
    resolvent = np.linalg.solve(s[:, None, None] * np.eye(model.order) - A, np.broadcast_to(B, (s.size, *B.shape)))
    return C @ resolvent + D


def _noise_root(model: Model) -> np.ndarray:
    """Square root of the noise covariance that a model carries; zero where it carries none."""
    if not isinstance(model, LPVModel) or model.noise_covariance is None:
        return np.zeros((model.n_outputs, model.n_outputs))
    values, vectors = np.linalg.eigh(model.noise_covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _drawn(models: Iterable[Model], level: float) -> list[Model]:
    if not 0 < _checks.real(level, "level") < 1:
        raise InputError("the level of a band must lie between 0 and 1", got=level)
    _checks.instance(models, Iterable, "a band needs drawn models",
                     "found.draw(np.random.default_rng(0), 500) of an Identification")
    drawn = list(models)
    if len(drawn) < 2:
        raise InputError("a band needs at least two drawn models", got=len(drawn))
    return drawn


def _quantiles(values: np.ndarray, level: float) -> np.ndarray:
    tail = 50 * (1 - level)
    return np.percentile(values, [tail, 50, 100 - tail], axis=0)
