"""What a candidate does in free run on blocks it was not fitted to, and whether its frozen poles stay inside."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from lpvid._threads import single_thread
from lpvid.analysis.frozen import family, stability_margin
from lpvid.condition import folds, leaks, repetition_period
from lpvid.condition.splitting import EmptyFold
from lpvid.errors import InputError, NumericalError
from lpvid.identification.arx import ARX, scheduling_box
from lpvid.identification.levenberg_marquardt import STEP_DOWN_POINTS
from lpvid.identification.prediction_error import PredictionError
from lpvid.identification.quasi_lpv import QuasiLPV
from lpvid.identification.result import Identification
from lpvid.identification.selection.excursions import furthest
from lpvid.identification.structure import Structure
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.scheduling import Scheduling, Spline
from lpvid.simulation import Model, simulate

GAP = 4
"""gap between training and held-out samples, in times the longest past of any candidate."""
RANGE_POINTS = 2000
"""about how many points frozen poles are looked at over the range of the scheduling."""
TIME_UP = "the time was up"
"""how the reason of a candidate begins that a search's budget left unfinished."""
LEFT = "left"
"""how the reason of a candidate begins that was left because it could not win any more."""

Fold = tuple[list[Record], list[Record]]
AnyStructure = TypeVar("AnyStructure", bound=Structure)


@dataclass(frozen=True, eq=False)
class Trial:
    """Blocked cross-validation of one structure.

    Attributes
    ----------
    esr : (k,) array
        Squared free-run error of every fold over the mean power of a fold, so that their mean is the pooled ESR.
    failure : str
        Why there are no figures; empty when there are.
    n_parameters : int or None
        Of the last fold's estimate.
    outside : float or None
        Share of all training samples with a frozen pole outside, where it was looked at.
    power : float
        Mean power of a fold, the unit of `esr`; 0 after a failure, whose `esr` are squared errors.
    measured : float
        ESR of the estimate on all training data from measured samples, on the average over starts
        (`fit_from_measured_samples`); 0 where it was not evaluated.
    """

    esr: np.ndarray
    failure: str = ""
    n_parameters: int | None = None
    outside: float | None = None
    power: float = 0.0
    measured: float = 0.0

    @property
    def counted(self) -> float:
        """The worse of `mean` and `measured`, with which a structure would be taken."""
        return max(self.mean, self.measured)

    @property
    def mean(self) -> float:
        """Pooled ESR; inf after a failure."""
        return float(np.mean(self.esr)) if not self.failure else float("inf")

    @property
    def error(self) -> float:
        """Standard error of `mean` over the folds."""
        return spread(self.esr)


def spread(values: np.ndarray) -> float:
    """Standard error of a mean over folds.

    Parameters
    ----------
    values : (k,) array
        One figure per fold.

    Returns
    -------
    float
        0 for a single fold.
    """
    return float(np.std(values, ddof=1) / np.sqrt(values.size)) if values.size > 1 else 0.0


def _too_short(records: Sequence[Record], count: int, start: int) -> InputError:
    return InputError(
        "the records are too short to compare structures by cross-validation",
        got=f"{sum(r.n_samples for r in records)} samples for {count} folds, {GAP * start} samples apart from what is "
            "fitted",
        mend="longer records, smaller orders, or one structure by name instead of a choice (--structure arx --na 2)")


def make_folds(records: Sequence[Record], count: int, start: int,
               channels: Sequence[str]) -> tuple[list[Fold], list[str]]:
    """Blocks for cross-validation, and notes on them.

    Where the excitation repeats and a stretch of its pattern is long enough to run on, folds hold out stretches of the
    pattern; otherwise consecutive blocks. One more holds out the stretches that go furthest (`furthest`), where the
    records are long enough for it.

    Parameters
    ----------
    records : sequence of Record
        Uniform and finite.
    count : int
        Number of blocks.
    start : int
        Longest past of any candidate, in samples.
    channels : sequence of str
        Inputs and scheduling variables; the first is searched for a repetition.

    Returns
    -------
    list of (list of Record, list of Record), list of str

    Raises
    ------
    InputError
        The records are too short, or fewer than two blocks.
    """
    notes: list[str] = []
    channel, sample_time = channels[0], records[0].sample_time
    length = (2 * GAP + 10) * start
    assert sample_time is not None
    found = [repetition_period(r[channel], sample_time) for r in records]
    period = None
    known = [f for f in found if f is not None]
    if known and len(known) == len(found):
        longest = max(f.seconds for f in known)
        same = all(abs(f.seconds / longest - 1) < 1e-3 for f in known)
        if same and longest / count >= length * sample_time:
            period = longest
            notes.append(f"the excitation repeats every {period:.4g} s: folds hold out stretches of the pattern")
    try:
        made = folds(records, count, GAP * start * sample_time, period=period)
    except EmptyFold as error:  # other faults of the call keep their own words
        raise _too_short(records, count, start) from error
    far = furthest(records, channels, count, length)
    usable = [([r for r in training if r.n_samples > start + 2], [r for r in held if r.n_samples > 2 * start + 10])
              for training, held in made + ([] if far is None else [far])]
    if far is not None and not all(usable[-1]):
        usable.pop()
    if len(usable) > count:
        notes.append(f"one more fold holds out 1/{count} of the training data: the stretches in which "
                     f"{' or '.join(channels)} goes furthest")
    if not all(training and held for training, held in usable):
        raise _too_short(records, count, start)
    share = leaks(*usable[0], channel)
    if share is not None and share > 0.01:
        notes.append(f"{100 * share:.0f} % of the first held-out block's '{channel}' also occurs in its training "
                     "part: cross-validation underestimates every candidate's error")
    return usable, notes


def cross_validate(structure: Structure, parts: Sequence[Fold], all_records: Sequence[Record],
                   bar: Trial | None = None, late: Callable[[], bool] = lambda: False,
                   begin: ARX | None = None) -> Trial:
    """Fit on every fold's training part, run freely on its held-out part.

    An ARX without ridge keeps the normalisation and the stages it comes with; every other structure is estimated anew.
    A spline's knots span the range of the fold's own training part (`of_its_range`).
    A fold's estimate fails where its free run diverges. Where its frozen poles lie is no matter: it is not the model
    that will be used, and two of 5000 samples with a pole outside in one fold refused the best structures of two of
    the measured sets, whose estimates on all training data have none.

    Parameters
    ----------
    structure : Structure
    parts : sequence of Fold
    all_records : sequence of Record
        What the folds were made of.
    bar : Trial, optional
        The best trial so far: this one is left as soon as its error in the folds done exceeds what the bar counts with
        in all of them. Squared errors only add up, so that nothing which could win is lost. The folds hardest for the
        bar come first.
    late : callable
        Whether the time is up; evaluated before every fold.
    begin : ARX, optional
        Where the search of a prediction-error structure begins in every fold (`PredictionError.estimate_from`).

    Returns
    -------
    Trial
    """
    error, power = np.zeros(len(parts)), np.zeros(len(parts))
    known = bar is not None and not bar.failure
    sequence = np.argsort(-bar.esr, kind="stable") if bar is not None and known else np.arange(len(parts))
    most = squares(bar) if bar is not None and known else np.inf
    fixed = isinstance(structure, ARX) and not _open(structure)
    size = None
    for done, i in enumerate(sequence.tolist(), start=1):
        training, held = parts[i]
        if late():
            return Trial(error, f"{TIME_UP} before fold {done} of {len(parts)}", size)
        try:
            own = of_its_range(structure, all_records, training)
            if fixed and isinstance(own, ARX):
                seen = all_records if own is structure else training
                found = own.regress(training, scheduling_box(seen, own.basis, check_basis=False))
            else:
                found = estimated(own, training, begin if begin is None or own is structure else
                                  of_its_range(begin, all_records, training))
        except (InputError, NumericalError, np.linalg.LinAlgError) as problem:
            why = problem.what if isinstance(problem, InputError) else str(problem)
            return Trial(error, f"cannot be fitted in fold {i + 1}: {why}")
        size = found.n_parameters
        diverged, error[i], power[i] = _run(found.model, held)
        if diverged:
            return Trial(error, f"diverges in fold {i + 1}", size)
        if error.sum() > most and done < len(parts):
            more = np.sqrt(error.sum() / most)
            why = f"{LEFT} after {done} of {len(parts)} folds, its error there {more:.3g} times that of the best in all"
            return Trial(error, why, size)
    if not power.mean() > 0:
        return Trial(error, "the held-out output does not move")
    return Trial(error / power.mean(), "", size, power=float(power.mean()))


def of_its_range(structure: AnyStructure, all_records: Sequence[Record], training: Sequence[Record]) -> AnyStructure:
    """The structure with a spline on knots over the range of these records, where its knots span that of all.

    Knots from all records would hold out nothing beyond the range of a fold's training part: what the estimate does on
    later data that go further is what the fold of the furthest stretches measures. Knots of a user's own stay.

    Parameters
    ----------
    structure : Structure
    all_records, training : sequence of Record

    Returns
    -------
    Structure
    """
    basis = getattr(structure, "basis", None)
    if not isinstance(basis, Spline) or not basis.knots or isinstance(structure, QuasiLPV):
        return structure
    free = replace(basis, knots=())
    if free.bound(scheduling_box(all_records, free, check_basis=False)) != basis:
        return structure
    box = scheduling_box(training, free, check_basis=False)
    return replace(structure, basis=free.bound(box))  # type: ignore[type-var]


def squares(trial: Trial) -> float:
    """Squared error over all folds that a trial counts with [unit of the output squared].

    Parameters
    ----------
    trial : Trial

    Returns
    -------
    float
        The sum in the folds done after a failure.
    """
    return float(trial.esr.sum()) if trial.failure else trial.counted * trial.esr.size * trial.power


def _open(structure: ARX) -> bool:
    return open_stages(structure) or bool(structure.ridge)


def open_stages(structure: ARX | PredictionError) -> bool:
    """Whether a stage is given by name, to be fitted.

    Parameters
    ----------
    structure : ARX or PredictionError

    Returns
    -------
    bool
    """
    return isinstance(structure.stage, str) or isinstance(structure.schedule_filter, str)


def estimated(structure: Structure, records: Sequence[Record], begin: ARX | None) -> Identification:
    """The estimate of a structure, of prediction error from `begin` where that is given.

    Parameters
    ----------
    structure : Structure
    records : sequence of Record
    begin : ARX or None

    Returns
    -------
    Identification
    """
    if begin is not None and isinstance(structure, PredictionError):
        return structure.estimate_from(records, begin)
    return structure.estimate(records)


def _run(model: Model, held: Sequence[Record]) -> tuple[bool, float, float]:
    """Divergence, squared error and power over the held-out pieces, outputs in equal standing.

    A block begins in motion. What ran before it is estimated over its beginning: from its first samples alone, the
    noise in them would be judged beside the model wherever a mode decays slowly. The squared error over n samples of q
    outputs is divided by 1 − d/(n q) for the d initial values that were fitted to it, lest models with a longer past
    gain by it.
    """
    errors, powers = np.zeros(model.n_outputs), np.zeros(model.n_outputs)
    for record in held:
        if record.n_samples <= model.start + 1:
            continue
        run = simulate(model, record, "estimate")
        if run.diverged_at is not None:
            return True, 0.0, 0.0
        y = record.matrix([s.name for s in model.outputs])[model.start:]
        errors += np.sum((y - run.output[model.start:]) ** 2, axis=0) / max(1 - model.memory / y.size, 0.1)
        powers += np.sum((y - y.mean(axis=0)) ** 2, axis=0)
    scale = np.maximum(powers, 1e-300)
    return False, float(np.sum(errors / scale * powers.sum()) / len(powers)), float(powers.sum())


def unstable_share(model: Model, records: Sequence[Record]) -> float:
    """Share of the samples at which a frozen pole lies outside the unit circle (on it counts as outside).

    Parameters
    ----------
    model : model
        Any; only an `LPVTransferFunction` with output lags has frozen poles here.
    records : sequence of Record
        Uniform and finite; looked at on a subsample of about `STEP_DOWN_POINTS`.

    Returns
    -------
    float
        Between 0 and 1; 0 for other models.
    """
    if not isinstance(model, LPVTransferFunction) or not model.na:
        return 0.0
    total = sum(r.n_samples for r in records)
    step = max(1, total // STEP_DOWN_POINTS)
    frozen = family(model)
    unstable = count = 0
    with single_thread():
        for record in records:
            p = record.matrix(list(model.box.names))
            if not p.shape[1]:
                p = np.empty((1, 0))
            elif model.scheduling_stage is not None:
                assert model.sample_time is not None
                p = model.scheduling_stage.apply(p, model.sample_time)
            modulus = np.abs(frozen.poles(p[::step])).max(axis=1)
            unstable += int(np.sum(modulus >= 1.0))
            count += modulus.size
    return unstable / count


def unstable_share_of_range(model: Model) -> float | None:
    """Share of the box of its scheduling in which a frozen pole is unstable: |z| >= 1, or Re s >= 0 in continuous time.

    On about `RANGE_POINTS` points (`_points_of_range`). The training trajectory is a line in that box. On the
    gyroscope, whose later data leave it, 32 output errors of three to six poles without a frozen pole outside along the
    trajectory have them in 0 to 10 % of the box: of the seven with more than 3 % three have less than 95.4 % there
    (least 89.9 %), of the other 25 two (least 95.2 %).

    Parameters
    ----------
    model : model
        Any.

    Returns
    -------
    float or None
        Between 0 and 1. None for a model that schedules itself (quasi-LPV): its scheduling variable moves with its
        output, so that poles with that variable held still are not those of its linearisation.
    """
    if not isinstance(model, LPVTransferFunction | LPVStateSpace):
        return None
    frozen = family(model)
    if not frozen.order:
        return 0.0
    with single_thread():
        margins = stability_margin(frozen.poles(_points_of_range(model.box)), frozen.discrete)
    return float(np.mean(margins.max(axis=1) >= 0.0))


def _points_of_range(box: Scheduling) -> np.ndarray:
    """(n, n_scheduling) points that fill a box, n about `RANGE_POINTS`; one for a box without variables.

    A tensor grid as long as it has more than three values of each variable, up to six variables (2000^(1/7) = 2.96):
    with three most points lie on the faces of the box, and with two 2^d are its corners alone. Of more variables a
    Sobol sequence of 2048 points, moved modulo 1 by a random vector from a fixed seed (Cranley & Patterson 1976, SIAM
    J. Numer. Anal. 13, 904), so that a model has the same share each time.
    """
    d = len(box.names)
    per_axis = RANGE_POINTS ** (1 / max(d, 1))
    if per_axis > 3:
        return box.grid(round(per_axis))
    from scipy.stats import qmc

    unit = qmc.Sobol(d, scramble=False).random_base2(int(np.ceil(np.log2(RANGE_POINTS))))
    unit = (unit + np.random.default_rng(0).random(d)) % 1.0
    lower, upper = np.array(box.lower), np.array(box.upper)
    return lower + (upper - lower) * unit
