"""Facts: what a set of records offers to a damper model, so that each kind can state whether and how it fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.condition.constancy import DISTINCT, constant
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.toolkit import checks

TURNING = 0.01
"""share of the largest speed over which a force turns with the velocity: on a sine a three-hundredth of its period"""
MOST_LEVELS = 12
"""with more levels than this a current counts as continuous."""


@dataclass(frozen=True)
class Facts:
    """What the training records hold.

    Attributes
    ----------
    has_displacement, has_current : bool
    current_varies : bool
        Over the whole set; a model can depend on the current only if it does.
    current_unit : str
        ``"A"``, ``"V"``, ``"1"``.
    current_range : (float, float) or None
    levels : tuple of float
        Distinct constant currents, where there are few; empty where the current is continuous.
    centre : float
        Displacement to call zero: 0 where the motion crosses 0, else its middle [m].
    stroke, speed, force : float
        Half range of the displacement [m], largest speed [m/s], spread of the force [N].
    sample_time : float
        [s]
    n_samples : int
    polarity : {1, −1}
    switches : bool
        Whether the current changes within a record: only then does its lag show.
    """

    has_displacement: bool
    has_current: bool
    current_varies: bool
    current_unit: str
    current_range: tuple[float, float] | None
    levels: tuple[float, ...]
    centre: float
    stroke: float
    speed: float
    force: float
    sample_time: float
    n_samples: int
    polarity: int
    switches: bool = True

    @property
    def turning_speed(self) -> float:
        """Speed over which friction, or the side of a law, turns with the velocity [m/s]."""
        return TURNING * (self.speed or 0.1)

    @property
    def common(self) -> dict:
        """Fields of every damper that the data settle."""
        return {"current_range": self.current_range, "current_unit": self.current_unit, "centre": self.centre,
                "polarity": self.polarity}

    def need_displacement(self, model: str) -> None:
        """Refuse data without displacement.

        Parameters
        ----------
        model : str
            What asks, as the error names it.

        Raises
        ------
        InputError
            Records without displacement.
        """
        if not self.has_displacement:
            raise InputError(f"{model} reads the displacement, which these records do not have",
                             mend=f"measure it, or {checks.role_mend('displacement')}")

    def need_current(self, model: str) -> None:
        """Refuse data whose current does not vary.

        Parameters
        ----------
        model : str
            What asks, as the error names it.

        Raises
        ------
        InputError
            Records without current, or with a constant one.
        """
        if not self.has_current:
            raise InputError(f"{model} depends on the current, which these records do not have",
                             mend=checks.role_mend("current"))
        if not self.current_varies:
            low = self.current_range[0] if self.current_range else 0.0
            raise InputError(f"{model} depends on the current, which is constant in these records",
                             got=f"{low:g} {self.current_unit}", mend="records at other currents")

    @classmethod
    def of(cls, records: Sequence[Record], polarity: int = 1) -> Facts:
        """Look at training records: uniform, with velocity and force, the other roles where there are any.

        Parameters
        ----------
        records : sequence of Record
            Training records.
        polarity : {1, −1}
            Sense in which the records' force is measured.

        Returns
        -------
        Facts
            What the records contain.

        Raises
        ------
        InputError
            No records, or one without velocity or force.
        """
        if not records:
            raise InputError("no records to fit to")
        has_x = all(r.has("displacement") for r in records)
        has_i = all(r.has("current") for r in records)
        x = np.concatenate([r["displacement"] for r in records]) if has_x else np.zeros(1)
        i = np.concatenate([r["current"] for r in records]) if has_i else np.zeros(1)
        v, f = (np.concatenate([r[n] for r in records]) for n in ("velocity", "force"))
        period = records[0].sample_time
        assert period is not None
        low, high = float(i.min()), float(i.max())
        varies = has_i and not constant(low, high, "A")
        least = DISTINCT * max(abs(low), abs(high))
        switches = has_i and any(np.ptp(r["current"]) > least for r in records)
        crossing = x.min() < 0 < x.max()
        return cls(has_x, has_i, varies, (records[0].unit("current") or "1") if has_i else "A",
                   (low, high) if has_i else None, _levels(i) if has_i else (),
                   0.0 if crossing else float(0.5 * (x.min() + x.max())),
                   float(0.5 * np.ptp(x)), float(np.abs(v).max()), float(f.std()), period, v.size, polarity, switches)


def _levels(current: np.ndarray) -> tuple[float, ...]:
    """Distinct levels of a current, rising; empty where there are more than `MOST_LEVELS`."""
    values = np.sort(current)
    gaps = np.flatnonzero(np.diff(values) > DISTINCT * max(abs(values[0]), abs(values[-1]), 1e-12))
    groups = np.split(values, gaps + 1)
    wide = len(groups) > 1 and any(np.ptp(g) > 0.2 * max(np.ptp(values), 1e-12) for g in groups)
    if len(groups) > MOST_LEVELS or wide:
        return ()
    return tuple(float(np.median(g)) for g in groups)
