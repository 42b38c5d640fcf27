"""`fit`: the one door by which every damper model is fitted to records."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from lpvid.condition import segments, with_derived
from lpvid.condition.band_limited import with_quiet_velocity
from lpvid.condition.segmentation import RATE_TOLERANCE
from lpvid.condition.tables import as_records
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.toolkit import checks
from lpvid.training_fingerprint import of_files, ranges, usual_range
from lpvid.training_rows import PARTLY, TRAINING, TrainingRows, compared_rows
from quartercar.dampers.contract import Damper
from quartercar.dampers.evaluation.passivity import check_passivity
from quartercar.dampers.evaluation.scoring import Score, score
from quartercar.dampers.fitting.result import DamperFit
from quartercar.dampers.fitting.settings import FitSettings
from quartercar.dampers.polarity import common_polarity

FEWEST = 20
"""shortest stretch worth keeping [samples]."""
CONSTANT = 0.1
"""share of the squared error from which a constant force is reported."""


def fit(damper: Damper, records: Record | Sequence[Record], held_out: Record | Sequence[Record] = (),
        settings: FitSettings | None = None, *, units: Mapping[str, str] | None = None) -> DamperFit:
    """Fit a damper model to the free run along records: least Σ(F̂ − F)², the model seeing motion and current alone.

    Parameters
    ----------
    damper : Damper
        Structure and starting values, e.g. ``Linear()`` or ``Guo.suited(facts)``.
    records : Record or sequence of Record
        Training data with the channels in `damper.reads` and a force; cut at gaps and NaN, never interpolated; velocity
        is derived from displacement where it was not measured.
    held_out : Record or sequence of Record
        Data that the fit does not see.
    settings : FitSettings, optional
    units : mapping of str to str, optional
        Of columns whose name states none, where the data are no Records; of a plain array, its columns in order.

    Returns
    -------
    DamperFit

    Raises
    ------
    InputError
        Missing or unusable channels, records of different polarity or rate, too few samples.
    NumericalError
        The free run diverges from every start.

    Examples
    --------
    >>> from quartercar.dampers.laws.linear import Linear
    >>> t = np.arange(2000) / 500
    >>> x = 0.01 * np.sin(12 * t) + 0.004 * np.sin(31 * t)
    >>> record = Record({"displacement": x}, sample_time=1 / 500, units={"displacement": "m"})
    >>> record, = with_derived([record], ["velocity"])
    >>> record = record.with_channel("force", 1500 * record["velocity"] + 4000 * x - 120, "N")
    >>> found = fit(Linear(), record)
    >>> {name: round(value) for name, value in found.damper.values.items() if name != "mass"}
    {'damping': 1500, 'stiffness': 4000, 'offset': -120}
    """
    began = time.perf_counter()
    if not isinstance(damper, Damper):
        raise InputError("fit takes a damper", got=repr(damper), mend="quartercar.dampers.Guo(), or any other")
    settings = settings or FitSettings()
    channels = tuple(dict.fromkeys(("velocity", *damper.reads, "force")))  # velocity for the energy in the figures
    raw = as_records(records, units=units)
    _refuse_lacking(damper, with_derived(raw, channels))
    training = prepared(raw, channels, damper.start, settings.sample_rate)
    if not training:
        raise InputError("no records to fit to")
    apart = as_records(held_out, "held-out", units)
    kept = prepared(apart, channels, damper.start, settings.sample_rate)
    _one_rate(training, kept)
    damper, stated, polarity_note = _placed(damper, training, kept, settings.polarity)
    found = damper.estimate(training, settings)
    found = replace(found, damper=remembering(found.damper, training, raw))
    inside = score(found.damper, training)
    outside = score(found.damper, kept) if kept else None
    passivity = check_passivity(found.damper)
    giving = () if passivity.passive else (f"not passive: {passivity.description}",)
    flags = (*stated, *giving, *_beyond(found.damper, outside), *_seen(found.damper, apart, kept))
    notes = (*polarity_note, *_constant(found.damper, training), *(n for r in (*training, *kept) for n in r.notes),
             *found.notes)
    return DamperFit(found, inside, outside, passivity, flags, tuple(dict.fromkeys(notes)),
                     time.perf_counter() - began)


def _refuse_lacking(damper: Damper, records: Sequence[Record]) -> None:
    """Refuse records without a channel that the damper reads; states which part reads it, where one can do without."""
    for record, role in ((r, n) for r in records for n in damper.reads if not r.has(n)):
        kind = type(damper).__name__
        for name, value in damper.settings.items():
            without = type(damper)(**{**damper.settings, name: False}) if value is True else damper
            if role not in without.reads:
                parts = ", ".join(n for n in damper.names if n not in without.names)
                raise InputError(f"{kind}: record '{record.name}' has no {role}, which its {parts} reads",
                                 mend=f"{kind}({name}=False) is without; or {checks.role_mend(role)}")
        raise InputError(f"{kind} reads the {role}, which record '{record.name}' does not have",
                         got=", ".join(record.channels), mend=checks.role_mend(role))


def _constant(damper: Damper, records: Sequence[Record]) -> tuple[str, ...]:
    """A note where a constant force, which the law could have, would take much of what is left."""
    if damper.settings.get("offset", True):
        return ()
    left = np.concatenate([damper.polarity * (r["force"] - damper.simulate(r).output[:, 0]) for r in records])
    mean, square = float(left.mean()), float(np.mean(left**2))
    if not mean**2 > CONSTANT * square:
        return ()
    return (f"the force left over has a mean of {mean:.3g} N, {mean**2 / square:.0%} of the squared error: no constant "
            "in the printed law; offset=True adds one",)


def _beyond(damper: Damper, outside: Score | None) -> tuple[str, ...]:
    """A flag where held-out currents lie outside the fitted range."""
    if outside is None or not outside.extrapolation_share or damper.current_range is None:
        return ()
    low, high = damper.current_range
    return (f"extrapolation: {100 * outside.extrapolation_share:.2g} % of the held-out currents lie outside the fitted "
            f"{low:.4g} to {high:.4g} {damper.current_unit}",)


def _seen(damper: Damper, raw: Sequence[Record], kept: Sequence[Record]) -> tuple[str, ...]:
    """A flag where held-out data, as read and as prepared, hold rows that the damper was fitted to."""
    if not kept or compared_rows(damper.metadata, raw, kept, "force").label not in (TRAINING, PARTLY):
        return ()
    return ("fitted-before: the held-out data hold rows that the fit has seen",)


def prepared(records: Record | Sequence[Record], channels: Sequence[str], start: int,
             sample_rate: float | None) -> list[Record]:
    """Uniform, finite, gap-free pieces at one rate that hold `channels`.

    Parameters
    ----------
    records : Record or sequence of Record
        As read; a velocity that is missing is derived from the displacement.
    channels : sequence of str
        Roles that every piece must have.
    start : int
        Samples from which a run of the model starts; shorter pieces than these and two more are left out.
    sample_rate : float or None
        Resample to this rate [Hz]; None keeps the records' own.

    Returns
    -------
    list of Record
        Empty where no records are given.
    """
    listed = as_records(records)
    if not listed:
        return []
    derived = with_derived(listed, channels)
    kept = tuple(dict.fromkeys((*channels, *("displacement",) * (derived != listed))))
    pieces = segments(derived, kept, sample_rate=sample_rate, minimum=max(FEWEST, start + 2))
    return [with_quiet_velocity(r) for r in pieces]


def _one_rate(training: Sequence[Record], kept: Sequence[Record]) -> None:
    """Refuse held-out data at another rate, where a sampled model would be another model."""
    rates = [1.0 / r.sample_time for r in (*training[:1], *kept[:1]) if r.sample_time]
    if abs(rates[-1] / rates[0] - 1) > RATE_TOLERANCE:
        raise InputError("held-out records have another rate", got=f"{rates[-1]:.6g} Hz against {rates[0]:.6g} Hz",
                         mend=f"--sample-rate {min(rates):.6g}")


def _placed(damper: Damper, training: Sequence[Record], kept: Sequence[Record],
            known: int | None) -> tuple[Damper, tuple[str, ...], tuple[str, ...]]:
    """The damper with the polarity and currents of the records, and the flags and notes that this calls for."""
    flags, notes = (), ()
    sense = common_polarity([*training, *kept]) if known is None else known
    if sense < 0:
        damper = damper.replace(polarity=-1)
        flags = ("reversed polarity: as measured the records are not passive; the verdict is on the damper itself",)
        notes = ("force is measured against the velocity (mean F·v < 0): the parameters are the damper's own, and its "
                 "simulation gives the force as measured; --flip force turns the records",)
    elif sense > 0 and damper.polarity < 0:
        flags = ("polarity -1 was requested, but mean F·v of the records is positive",)
    elif sense == 0:
        notes = (f"the records do not decide the polarity of the force; {damper.polarity:+d} is assumed",)
    if "current" in damper.reads:
        currents = np.concatenate([r["current"] for r in training])
        unit = training[0].unit("current") or damper.current_unit
        damper = damper.replace(current_range=(float(currents.min()), float(currents.max())), current_unit=unit)
    return damper, flags, notes


D = TypeVar("D", bound=Damper)


def recognising(found: DamperFit, raw: Sequence[Record]) -> DamperFit:
    """The fit with prints of the rows of its training records as read: it was given resampled ones, or stretches.

    Parameters
    ----------
    found : DamperFit
    raw : sequence of Record

    Returns
    -------
    DamperFit
        A copy; `found` where a record has no force.
    """
    if not all(r.has("force") for r in raw):
        return found
    known = found.damper.metadata
    training = {**known["training"], "rows": TrainingRows.of(raw, "force").to_dict()}
    damper = found.damper.replace(metadata={**known, "training": training})
    return replace(found, estimate=replace(found.estimate, damper=damper))


def remembering(damper: D, records: Sequence[Record], raw: Sequence[Record]) -> D:
    """The damper with names, size, rate, ranges, roles and prints of rows of its training records in its metadata.

    Parameters
    ----------
    damper : Damper
    records : sequence of Record
        Uniform, as fitted: cut and resampled, forces as measured.
    raw : sequence of Record
        The same as they were given.

    Returns
    -------
    Damper
        A copy.
    """
    training = {"records": [r.name for r in records], "n_samples": sum(r.n_samples for r in records),
                "sample_time": records[0].sample_time, "rows": TrainingRows.of(raw, "force").to_dict()}
    seen = [n for n in (*dict.fromkeys(("velocity", *damper.reads)), "force") if all(r.has(n) for r in records)]
    training["ranges"] = ranges(records, seen)
    if "current" in damper.reads:
        training["usual_currents"] = usual_range([r["current"] for r in records])
    return damper.replace(metadata={**damper.metadata, "training": training, **of_files(records, seen)})
