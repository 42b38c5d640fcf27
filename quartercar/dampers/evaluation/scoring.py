"""How well a damper model simulates records it is run along: ESR, rmse, energy, quadrants, speed."""

from __future__ import annotations

import re
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.codec import Encoded
from lpvid.record import Record
from lpvid.validation.figures import Figures
from quartercar.dampers.contract import Damper, ExtrapolationWarning

TIMED_SECONDS = 5.0
"""length of record [s] along which the speed is measured, at most"""
REPEATS = 3
QUADRANTS = (("v>0,x>0", 1, 1), ("v>0,x<=0", 1, -1), ("v<=0,x>0", -1, 1), ("v<=0,x<=0", -1, -1))
HALVES = (("v>0", 1, 0), ("v<=0", -1, 0))


@dataclass(frozen=True)
class FreeRunScore:
    """Free-run error over some samples, pooled over records.

    Attributes
    ----------
    error, power : float
        Σ(F−F̂)² and Σ(F−F̄)², each record about its own mean [N²]; infinite error after divergence.
    n_samples : int
        N, which √SSE cannot be read without.
    diverged_at : int or None
        Sample of the first record that diverged.
    """

    error: float
    power: float
    n_samples: int
    diverged_at: int | None = None

    @property
    def esr(self) -> float | None:
        """Σ(F−F̂)²/Σ(F−F̄)²; None after divergence or where the force does not move."""
        return self.error / self.power if self.diverged_at is None and self.power > 0 else None

    @property
    def fit_percent(self) -> float | None:
        """100 (1 − √ESR)."""
        return None if self.esr is None else 100 * (1 - float(np.sqrt(self.esr)))

    @property
    def rmse(self) -> float | None:
        """[N]"""
        return None if self.sqrt_sse is None or not self.n_samples else self.sqrt_sse / float(np.sqrt(self.n_samples))

    @property
    def sqrt_sse(self) -> float | None:
        """√Σ(F−F̂)² [N]; grows with √N, so that it compares models on the same samples only."""
        return None if self.diverged_at is not None else float(np.sqrt(self.error))

    @property
    def figures(self) -> Figures:
        """As lpvid shows it."""
        return Figures("free-run", self.esr, self.fit_percent, self.rmse, "N", self.n_samples, self.diverged_at)

    @classmethod
    def pooled(cls, runs: Sequence[FreeRunScore]) -> FreeRunScore:
        """Numerators and denominators summed.

        Parameters
        ----------
        runs : sequence of FreeRunScore
            Of several records.

        Returns
        -------
        FreeRunScore
            With the first divergence, where there is one.
        """
        return cls(sum(r.error for r in runs), sum(r.power for r in runs), sum(r.n_samples for r in runs),
                   next((r.diverged_at for r in runs if r.diverged_at is not None), None))

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Plain values by name.
        """
        data = {"esr": self.esr, "fit_percent": self.fit_percent, "rmse": self.rmse, "rmse_unit": "N",
                "sqrt_sse": self.sqrt_sse, "n_samples": self.n_samples}
        return data if self.diverged_at is None else {**data, "diverged_at": self.diverged_at}


@dataclass(frozen=True)
class Quadrant(Encoded):
    """rmse of the samples of one quadrant of velocity and displacement.

    Attributes
    ----------
    where : str
        Signs of velocity and displacement, e.g. ``"v>0,x<=0"``; of the velocity alone where no displacement is known.
    rmse : float or None
        [N]; None without samples or after divergence.
    n_samples : int
        Samples in it, of all records.
    """

    where: str
    rmse: float | None
    n_samples: int


@dataclass(frozen=True)
class Score:
    """A model along records.

    Attributes
    ----------
    total : FreeRunScore
    records : tuple of (str, FreeRunScore)
    energy_error : float or None
        |∮F̂ dx / ∮F dx − 1| over all records.
    quadrants : tuple of Quadrant
        About the model's centre; halves by velocity where there is no displacement.
    extrapolation_share : float
        Share of the samples whose current lies outside the fitted range.
    """

    total: FreeRunScore
    records: tuple[tuple[str, FreeRunScore], ...]
    energy_error: float | None
    quadrants: tuple[Quadrant, ...]
    extrapolation_share: float

    @property
    def experiments(self) -> tuple[tuple[str, FreeRunScore], ...]:
        """Replicates and pieces of records pooled, in order of appearance."""
        groups: dict[str, list[FreeRunScore]] = {}
        for name, run in self.records:
            groups.setdefault(experiment(name), []).append(run)
        return tuple((name, FreeRunScore.pooled(runs)) for name, runs in groups.items())

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Plain values by name.
        """
        listed = [{"name": name, "free_run": run.to_dict()} for name, run in self.records]
        grouped = [{"name": name, "free_run": run.to_dict()} for name, run in self.experiments]
        return {"free_run": self.total.to_dict(), "energy_error": self.energy_error,
                "quadrants": [q.to_dict() for q in self.quadrants], "extrapolation_share": self.extrapolation_share,
                "experiments": grouped, "records": listed}


def experiment(name: str) -> str:
    """The experiment that a record belongs to: its name without replicate and piece.

    Parameters
    ----------
    name : str
        Of a record, e.g. ``"test-1-r0#2"``.

    Returns
    -------
    str
        `name` without ``-rN`` and ``#N`` at its end.

    Examples
    --------
    >>> experiment("test-1-r0#2"), experiment("run7")
    ('test-1', 'run7')
    """
    return re.sub(r"-r\d+$", "", re.sub(r"#\d+$", "", name))


def score(damper: Damper, records: Sequence[Record], first: int | None = None) -> Score:
    """Run a damper along records and sum up how far it is from the measured force.

    Parameters
    ----------
    damper : Damper
    records : sequence of Record
        Uniform, with velocity, the other roles that it reads, and force, in the damper's polarity.
    first : int, optional
        First sample that counts: the same for all models that are compared; left out, the first that a run simulates.

    Returns
    -------
    Score
    """
    runs, outside, samples = [], 0.0, 0
    work, taken = [], []
    squares = {where: [0.0, 0] for where, _, _ in (QUADRANTS if _placed(records) else HALVES)}
    for record in records:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ExtrapolationWarning)  # reported as a share
            run = damper.simulate(record)
        begin = run.start if first is None else first
        force, velocity, model = record["force"][begin:], record["velocity"][begin:], run.output[begin:, 0]
        error = model - force
        power = float(np.sum((force - force.mean()) ** 2)) if np.ptp(force) > 0 else 0.0
        diverged = run.diverged_at
        total = float(np.sum(error**2)) if diverged is None else float("inf")
        runs.append((record.name, FreeRunScore(total, power, force.size, diverged)))
        outside, samples = outside + run.extrapolation_share * record.n_samples, samples + record.n_samples
        period = record.sample_time or 0.0
        work.append(float(np.trapezoid(model * velocity, dx=period)))
        taken.append(float(np.trapezoid(force * velocity, dx=period)))
        for where, inside in _quadrants(record, begin, damper.centre, list(squares)):
            squares[where][0] += float(np.sum(error[inside] ** 2))
            squares[where][1] += int(inside.sum())
    ratio = sum(work) / sum(taken) if sum(taken) else float("nan")
    quadrants = tuple(Quadrant(where, float(np.sqrt(s / n)) if n and np.isfinite(s) else None, int(n))
                      for where, (s, n) in squares.items())
    return Score(FreeRunScore.pooled([r for _, r in runs]), tuple(runs), abs(ratio - 1) if np.isfinite(ratio) else None,
                 quadrants, outside / max(samples, 1))


def _placed(records: Sequence[Record]) -> bool:
    return all(r.has("displacement") for r in records)


def _quadrants(record: Record, first: int, centre: float, names: Sequence[str]) -> list[tuple[str, np.ndarray]]:
    forward = record["velocity"][first:] > 0
    ahead = record["displacement"][first:] > centre if record.has("displacement") else forward
    return [(name, (forward == (v > 0)) & ((ahead == (x > 0)) | (x == 0))) for name, v, x in (*QUADRANTS, *HALVES)
            if name in names]


def time_per_simulated_second(damper: Damper, records: Sequence[Record]) -> float:
    """Wall-clock seconds that one second of record takes to simulate, compiled and warm: the best of three.

    Parameters
    ----------
    damper : Damper
    records : sequence of Record
        The longest one is used, its first 5 s.

    Returns
    -------
    float
        [1]
    """
    record = max(records, key=lambda r: r.n_samples)
    assert record.sample_time is not None
    drive = damper.drive(record).head(max(round(TIMED_SECONDS / record.sample_time), damper.start + 2))
    vector, best = damper.vector, float("inf")
    with np.errstate(all="ignore"):
        damper.response(drive, vector)
        for _ in range(REPEATS):
            begun = time.perf_counter()
            damper.response(drive, vector)
            best = min(best, time.perf_counter() - begun)
    return best / (drive.n_samples * drive.sample_time)


def stretches(records: Sequence[Record], samples: int, length: int) -> list[Record]:
    """About `samples` samples as stretches of `length`, spread evenly over all records; nothing is decimated.

    Parameters
    ----------
    records : sequence of Record
        Uniform.
    samples, length : int

    Returns
    -------
    list of Record
        The records themselves where they hold no more than that.

    Examples
    --------
    >>> run = Record({"x": np.arange(100.0)}, sample_time=0.1, name="run")
    >>> [r["x"][[0, -1]].tolist() for r in stretches([run], 40, 10)]
    [[0.0, 9.0], [30.0, 39.0], [60.0, 69.0], [90.0, 99.0]]
    """
    total = sum(r.n_samples for r in records)
    if total <= samples:
        return list(records)
    cut: list[Record] = []
    for record in records:
        count = max(1, round(samples / total * record.n_samples / length))
        size = min(length, record.n_samples)
        starts = np.linspace(0, record.n_samples - size, count).round().astype(int) if count > 1 else [0]
        cut += [replace(record.slice(a, a + size), time=None, name=f"{record.name}@{a}") for a in map(int, starts)]
    return cut
