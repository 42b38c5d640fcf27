"""Characterisation: the verb, and everything that it reads off the records as one result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lpvid.errors import InputError
from quartercar.characterisation import tables, wording
from quartercar.characterisation.currents import ratios_of, spreads_of
from quartercar.characterisation.cycles import Block, blocks_of
from quartercar.characterisation.drift import drift_of
from quartercar.characterisation.forces import standard_forces
from quartercar.characterisation.gas import pulling, slowest, static_force
from quartercar.characterisation.held import with_held_levels
from quartercar.characterisation.histogram import histograms_of
from quartercar.characterisation.loops import loop_of
from quartercar.characterisation.missing import missing_of, unchecked_band
from quartercar.characterisation.points import DIRECTIONS, disagreeing, peak_point
from quartercar.characterisation.readings import Readings
from quartercar.characterisation.runs import RecordPiece, RecordPieces, runs_of
from quartercar.characterisation.settings import CharacteriseSettings
from quartercar.characterisation.switching import SwitchingSteps, switching_of
from quartercar.characterisation.tolerance import Tolerance, checks_of, specimen_spreads

if TYPE_CHECKING:
    from lpvid.record import Record
    from quartercar.dampers.contract import Damper


@dataclass(frozen=True, eq=False)
class Characterisation(Readings):
    """What a damper dynamometer's page holds: the readings, in words, as plain data and as a report."""

    @property
    def verdict(self) -> str:
        """The page's first sentence."""
        return wording.verdict(self)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON, SI; forces positive in tension.

        Returns
        -------
        dict
            Plain values by name.
        """
        return tables.to_dict(self)

    def page(self) -> Any:
        """The report, as a `lpvid.report.Page`.

        Returns
        -------
        lpvid.report.Page
        """
        from quartercar.characterisation.page import characterisation_page

        return characterisation_page(self)

    def __repr__(self) -> str:
        return wording.summary(self)


def characterise(records: Any, settings: CharacteriseSettings | None = None, *, damper: Damper | None = None,
                 tolerance: Tolerance | None = None,
                 report_progress: Callable[[str], None] | None = None) -> Characterisation:
    """Read off records what a damper dynamometer shows; no model is fitted.

    Parameters
    ----------
    records : Record, mapping, data frame, or sequence of these
        With displacement or velocity, and force; current (or voltage) and temperature where they were measured. Any
        mixture of sines, triangles, steps of the current and random motion, each at its own rate.
    settings : CharacteriseSettings, optional
    damper : Damper, optional
        A model to draw beside the measurement: its free run goes through the same estimators.
    tolerance : Tolerance, optional
    report_progress : callable, optional
        Is given what is being done.

    Returns
    -------
    Characterisation

    Raises
    ------
    InputError
        No motion, no force, wrong units, nothing that moves, pieces too short, force of different polarity.

    Examples
    --------
    >>> import quartercar as qc
    >>> from quartercar.rig import Constant, Experiment, Rig, Sine
    >>> test = Experiment("sine", Sine(0.02, 2.0), Constant((1.0,)), duration=4.0)
    >>> found = qc.characterise(Rig().run_all(test))
    >>> [(f.speed, round(f.force, -2)) for f in found.given if f.direction == 1][2:4]
    [(0.13, 1300.0), (0.26, 1500.0)]
    """
    from lpvid.condition.tables import as_records

    settings = settings or CharacteriseSettings()
    report_progress = report_progress or (lambda text: None)
    report_progress("cutting cycles")
    data = runs_of(as_records(records), settings)
    data, blocks = with_held_levels(data, [b for run in data.runs for b in blocks_of(run)])
    models, notes = _simulated(data, damper)
    _check_delays(settings, blocks)
    with_force = tuple(b for b in blocks if b.run.has_force)
    steady = tuple(b for b in with_force if b.run.current != "varies")
    report_progress("reading forces")
    peaks = tuple(p for b in steady for d in DIRECTIONS if (p := peak_point(b, d)) is not None)
    forces = standard_forces(data.runs, steady, settings.speeds, models)
    every = [s for b in steady if (s := static_force(b)) is not None]
    static = tuple(slowest(every))
    data = replace(data, caveats=(*data.caveats, *pulling(every), *disagreeing(peaks)))
    switching, refused = _switching(data.runs)
    softest_last = sorted((s for s in static if s.creep), key=lambda s: s.friction, reverse=True)
    known = {s.specimen: s.gas for s in softest_last}
    drifts = tuple(d for b in steady for way in DIRECTIONS if (d := drift_of(b, way)) is not None)
    found = Characterisation(
        settings, data, blocks, peaks, forces, static, tuple(loop_of(b) for b in steady), ratios_of(forces, known),
        spreads_of(forces), tuple(switching), drifts, histograms_of(data.runs, {id(b.run) for b in blocks}),
        checks_of(forces, tolerance, settings.sign) if tolerance else (), specimen_spreads(forces), (), notes, models,
        "" if damper is None else str(damper.metadata.get("label", damper.name)))
    unchecked = unchecked_band(forces, tolerance) if tolerance and not found.checks else ()
    return replace(found, missing=(*unchecked, *missing_of(found, refused)))


def _check_delays(settings: CharacteriseSettings, blocks: Sequence[Block]) -> None:
    """A sensor that is late by a stroke shows the other direction: no delay of a sensor, but another unit."""
    shortest = min(blocks, key=lambda b: 1 / b.frequency, default=None)
    for name, delay in settings.delays.items():
        if shortest is not None and delay >= 0.5 / shortest.frequency:
            raise InputError(f"the delay of '{name}' is as long as a stroke of '{shortest.run.name}' or longer",
                             got=f"{delay:.4g} s, a stroke takes {0.5 / shortest.frequency:.3g} s",
                             mend=f"state the unit: --delay {name}={delay:.4g}ms")


def _switching(runs: Sequence[RecordPiece]) -> tuple[list[SwitchingSteps], tuple[str, ...]]:
    rows: list[SwitchingSteps] = []
    reasons: list[str] = []
    for run in runs:
        if run.current == "varies":
            found, why = switching_of(run)
            rows += found
            reasons += [f"{run.name}: {why}"] if why else []
    return rows, tuple(reasons)


def _simulated(data: RecordPieces, damper: Damper | None) -> tuple[dict[int, np.ndarray], tuple[str, ...]]:
    """The model's free run along every run it can follow, in tension positive, and notes on it."""
    if damper is None:
        return {}, ()
    import warnings

    models: dict[int, np.ndarray] = {}
    notes: list[str] = []
    mends: list[str] = []
    along: dict[int, np.ndarray] = {}
    for run in data.runs:
        if id(run.record) in along:  # another level of the same record
            models[id(run)] = along[id(run.record)]
            continue
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                force, note = _run_along(damper, run.record)
        except InputError as error:
            notes.append(f"{damper.name} does not run along '{run.name}': {error.what}")
            mends += [error.mend] if error.mend else []
            continue
        notes += [*note, *(str(w.message) for w in caught)]
        if np.isfinite(force).all():
            models[id(run)] = along[id(run.record)] = damper.polarity * force
        else:
            notes.append(f"{damper.name} diverges along '{run.name}'")
    if not models:
        raise InputError(f"the model '{damper.name}' runs along none of these records", why="; ".join(notes[:2]),
                         mend=mends[0] if mends else None)
    return models, tuple(dict.fromkeys(notes))


def _run_along(damper: Damper, record: Record) -> tuple[np.ndarray, tuple[str, ...]]:
    """(n,) force of the free run at the samples of a record [N], and a note where the model has another rate.

    It runs at its own rate along the resampled record; a cubic spline through its samples gives the force in between,
    the last of them what lies behind it.
    """
    from lpvid.condition.resampling import resample
    from lpvid.condition.segmentation import RATE_TOLERANCE

    assert record.sample_time is not None
    clock = damper.clock
    if clock is None or abs(record.sample_time / clock - 1) <= RATE_TOLERANCE:
        return np.array(damper.simulate(record).output[:, 0]), ()
    from scipy.interpolate import CubicSpline

    own = resample(record, 1 / clock)
    force = damper.simulate(own).output[:, 0]
    if not np.isfinite(force).all() or own.n_samples < 2:
        return np.full(record.n_samples, np.nan), ()
    at = np.clip(record.times, own.times[0], own.times[-1])
    return np.asarray(CubicSpline(own.times, force)(at)), (
        f"{damper.name} runs at its own {1 / clock:.6g} Hz along records at {1 / record.sample_time:.6g} Hz",)
