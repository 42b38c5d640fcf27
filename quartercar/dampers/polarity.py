"""Polarity of records: whether the measured force takes or gives energy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.auditing.force import BLOCKS, dissipation
from lpvid.auditing.view import View, view
from lpvid.errors import InputError
from lpvid.record import Record

SURE = 4.0
"""standard errors from zero at which the mean power decides."""
LIKENESS = 0.05
"""least correlation of force and velocity that decides."""


@dataclass(frozen=True)
class Polarity:
    """The sense in which one record's force is measured.

    Attributes
    ----------
    name : str
        Record.
    sign : {1, −1, 0}
        1 passive, −1 reversed, 0 undecided.
    power : float
        Mean of (F − F̄)(v − v̄) [W].
    standard_error : float
        Of `power`, from block means [W].
    """

    name: str
    sign: int
    power: float
    standard_error: float

    def __str__(self) -> str:
        verdict = {1: "passive", -1: "reversed", 0: "undecided"}[self.sign]
        return f"record '{self.name}': {verdict}, mean F·v = {self.power:.4g} ± {self.standard_error:.2g} W"


def polarity_of(record: Record) -> Polarity:
    """Passive where mean F·v is positive by four standard errors, reversed where it is negative by as much.

    The mean is over whole strokes, from the first to the last reversal of the motion; with less than two of them, about
    a cycle, nothing is decided: a spring then gives or takes more than the damping.

    Parameters
    ----------
    record : Record
        With force, and displacement or velocity.

    Returns
    -------
    Polarity
        Undecided, with power 0, where the record is too short to decide.

    Examples
    --------
    >>> import numpy as np
    >>> v = np.sin(np.arange(2000) * 0.1)
    >>> record = Record({"velocity": v, "force": -100 * v}, sample_time=0.01, units={"velocity": "m/s", "force": "N"})
    >>> polarity_of(record).sign
    -1
    """
    found = dissipation(_bare(record))
    if found is None:
        return Polarity(record.name, 0, 0.0, 0.0)
    likeness, power, sure = found
    decided = sure > SURE and abs(likeness) > LIKENESS
    return Polarity(record.name, int(power > 0) - int(power < 0) if decided else 0, power,
                    abs(power) / sure if sure > 0 else 0.0)


def _bare(record: Record) -> View:
    """Force and motion of a record, and nothing else."""
    channels = {"force": record.channel("force"),
                **{role: record.channel(role) for role in ("displacement", "velocity") if record.has(role)}}
    return view(Record(channels, sample_time=record.sample_time, time=None if record.is_uniform else record.times), ())


def common_polarity(records: Sequence[Record]) -> int:
    """1, −1, or 0 where neither a record nor all of them together decide.

    Parameters
    ----------
    records : sequence of Record
        With force, and displacement or velocity.

    Returns
    -------
    {1, −1, 0}
        1 passive, −1 reversed; records that do not decide do not count. Where none decides, as of many short pieces
        between missing samples, by the damping of all of them.

    Raises
    ------
    InputError
        Records of both senses.
    """
    found = [polarity_of(r) for r in records]
    passive, turned = (list(dict.fromkeys(p.name for p in found if p.sign == s)) for s in (1, -1))
    if passive and turned:
        fewer, kind = (turned, "reversed") if len(turned) <= len(passive) else (passive, "not reversed")
        shown = ", ".join(f"'{n}'" for n in fewer[:4]) + (f" and {len(fewer) - 4} more" if len(fewer) > 4 else "")
        raise InputError("records disagree in the sense of the force", got=f"{len(turned)} reversed (mean F·v < 0), "
                         f"{len(passive)} not; {kind}: {shown}", mend="--flip force for those, or fit the groups apart")
    return 1 if passive else -1 if turned else _pooled(records)


def _pooled(records: Sequence[Record]) -> int:
    """Sign of c in F = F_i + k x + c v, of one k and c for all records, where it is four standard errors from zero.

    A piece of less than a cycle holds energy of a spring, which k takes. The standard error is that of the jackknife
    over the records, of which there must be as many as a single record is cut into blocks.
    """
    strokes = [found for r in records if (found := _bare(r).stroke) is not None]
    if len(strokes) < BLOCKS:
        return 0
    parts = []
    for stroke in strokes:
        x, v, force = (signal - signal.mean() for signal in stroke)
        parts.append((np.array([[x @ x, x @ v], [x @ v, v @ v]]), np.array([x @ force, v @ force])))
    whole = [np.sum([part[k] for part in parts], axis=0) for k in (0, 1)]

    def damping(a: np.ndarray, b: np.ndarray) -> float:
        return float(np.linalg.lstsq(a, b, rcond=None)[0][1])

    left_out = np.array([damping(whole[0] - a, whole[1] - b) for a, b in parts])
    error = float(np.sqrt((len(parts) - 1) * left_out.var()))
    found = damping(*whole)
    return int(np.sign(found)) if abs(found) > SURE * error else 0
