"""The study of source 000: its table of work per cycle, and what that table contradicts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.condition import with_velocity
from lpvid.record import Channel, Record
from lpvid.toolkit import checks
from quartercar.dampers.bench.sine_work import SWIFT_2012, sine_work
from quartercar.dampers.laws.power_law import PowerLawDamper, PowerLawFrictionGas

RIG_SPEED = 0.7
"""Velocity limit for which the seed planned its tests [m/s]."""
PRINTED = (
    (10, 10, 0.05, 1.9828, 0.0878, "as printed"),
    (10, 10, 8.0, 25.500, 5.7240, "as printed"),
    (30, 30, 0.5, 15.037, 1.2220, "as printed"),
    (63, 30, 3.5, 127.01, 13.800, "the 63 belongs to the next row: figure 17 shows 30 mm at 3.5 Hz"),
    (63, 63, 1.0, 128.62, 1.8200, "as printed"),
    (63, 63, 1.5, 243.57, -5.6700, "as printed"),
)
"""Table IV: amplitude as printed and as read [mm], frequency [Hz], measured work, second column [J], our reading."""


@dataclass(frozen=True)
class WorkRow:
    """One row of Table IV.

    Attributes
    ----------
    amplitude, printed_amplitude : float
        As read and as printed [m].
    frequency : float
        [Hz]
    measured : float
        Work per cycle from the measured force [J].
    printed : float
        The column headed "modelled force" [J].
    recomputed : float
        Work per cycle of the law, in closed form [J].
    reading : str
        How the row is read, and why.
    """

    amplitude: float
    printed_amplitude: float
    frequency: float
    measured: float
    printed: float
    recomputed: float
    reading: str

    @property
    def deviation(self) -> float:
        """(recomputed − measured)/measured."""
        return self.recomputed / self.measured - 1

    @property
    def printed_share(self) -> float:
        """The second column as a share of the measured work."""
        return self.printed / self.measured

    @property
    def peak_speed(self) -> float:
        """2πfX as read [m/s]."""
        return 2 * math.pi * self.frequency * self.amplitude

    @property
    def printed_peak_speed(self) -> float:
        """2πfX with the amplitude as printed [m/s]."""
        return 2 * math.pi * self.frequency * self.printed_amplitude


@dataclass(frozen=True, eq=False)
class WorkTable:
    """Table IV of source 000 beside the work that its identified constants give.

    Attributes
    ----------
    law : PowerLawDamper
        The law that was recomputed.
    rows : tuple of WorkRow
    """

    law: PowerLawDamper
    rows: tuple[WorkRow, ...]

    @property
    def mean_printed_share(self) -> float:
        """Mean size of the second column as a share of the measured work."""
        return float(np.mean([abs(r.printed_share) for r in self.rows]))

    @property
    def worst_deviation(self) -> float:
        """Largest deviation of the recomputed work, by size."""
        return max((r.deviation for r in self.rows), key=abs)

    def refitted(self, relative: bool = False) -> float:
        """C_n of extension by least squares of the six measured works, all else as identified [N/(mm/s)^n].

        The work is linear in C_n, so that this has a closed form. `relative` weighs every row by its own work.

        Parameters
        ----------
        relative : bool
            Whether relative deviations are least instead of deviations in joules.

        Returns
        -------
        float
            C_n of extension [N/(mm/s)^n]; never below zero.
        """
        unit = self.law.with_values(power_force_extension=1.0)
        none = self.law.with_values(power_force_extension=0.0)
        base = np.array([sine_work(none, r.amplitude, r.frequency) for r in self.rows])
        per_newton = np.array([sine_work(unit, r.amplitude, r.frequency) for r in self.rows]) - base
        measured = np.array([r.measured for r in self.rows])
        weight = 1 / measured if relative else np.ones(measured.size)
        force = float((weight * per_newton) @ (weight * (measured - base)) / np.sum((weight * per_newton) ** 2))
        return self.law.with_values(power_force_extension=max(force, 0.0)).printed("mm")["extension"].power

    def contradictions(self) -> tuple[str, ...]:
        """What the printed table contradicts and how it is read here, in sentences with their numbers.

        Returns
        -------
        tuple of str
            One sentence or two for each.
        """
        rows, slipped = self.rows, [r for r in self.rows if r.amplitude != r.printed_amplitude]
        shares = [abs(r.printed_share) for r in rows]
        worst_row = max(rows, key=lambda r: abs(r.printed_share))
        metre = _deviations(_reading("SI"), rows)
        other = _deviations(_other_columns(), rows)
        lines = [
            f"As modelled work the second column is {min(shares):.1%} to {max(shares):.1%} of the measured work, not "
            f"the 90 % that the text claims; {min(r.printed for r in rows):g} J would be a passive damper that gives "
            "energy.",
            f"Read as the difference of the two works it fits the claim: {self.mean_printed_share:.1%} of the measured "
            f"work on average. The constants of Table III give works that deviate by "
            f"{', '.join(f'{r.deviation:+.1%}' for r in rows)}. So it is never used as model output.",
            f"Even so \"less than 10 %\" fails at {1e3 * worst_row.amplitude:g} mm, {worst_row.frequency:g} Hz: "
            f"{abs(worst_row.printed_share):.1%} printed, {worst_row.deviation:+.1%} recomputed.",
            *(f"{1e3 * r.printed_amplitude:g} mm at {r.frequency:g} Hz would be {r.printed_peak_speed:.2f} m/s on a "
              f"rig limited to {RIG_SPEED:g} m/s; read as {1e3 * r.amplitude:g} mm ({r.peak_speed:.2f} m/s)."
              for r in slipped),
            f"Table I lists 3,5 Hz for 30 mm: 5 Hz would be {2 * math.pi * 5.0 * 0.03:.2f} m/s; read as 3.5 Hz, as in "
            "the figures.",
            f"The constants are in N and mm/s: in N and m/s the works deviate by {min(metre):+.0%} to "
            f"{max(metre):+.0%}, which is friction alone.",
            f"Table III is read by columns (compression linear, extension linear and power 2.5). Read by rows "
            f"(compression 0.61 v^1.16) the work deviates by {other[2]:+.0%} at 30 mm, 0.5 Hz, where this reading "
            f"deviates by {rows[2].deviation:+.0%}.",
            f"C_n = 0.0002 has one digit (±25 %). The measured works want {self.refitted():.3g}, by relative deviation "
            f"{self.refitted(relative=True):.3g} N/(mm/s)^n: refit rather than copy.",
            "Work per cycle is insensitive to gas force, gas stiffness and the shape of hysteresis, which do none: it "
            "cannot show that hysteresis alone is missing. Force errors at every instant can.",
        ]
        return tuple(lines)

    def __repr__(self) -> str:
        head = "Work per cycle, source 000 Table IV [J]\n     X        f   measured  2nd column  recomputed  deviation"
        body = [f"{1e3 * r.amplitude:4.0f} mm {r.frequency:5.2f} Hz {r.measured:9.3f} {r.printed:11.4f} "
                f"{r.recomputed:11.3f} {r.deviation:+10.1%}{'' if r.reading == 'as printed' else '  *'}"
                for r in self.rows]
        notes = [f"  * {r.reading}" for r in self.rows if r.reading != "as printed"]
        return "\n".join([head, *body, *notes])


def work_table(law: PowerLawDamper = SWIFT_2012) -> WorkTable:
    """Table IV of source 000 beside the closed-form work of a law.

    Parameters
    ----------
    law : PowerLawDamper
        Law whose work is computed; by default the identified constants of the source.

    Returns
    -------
    WorkTable
        One row for each of `PRINTED`.

    Examples
    --------
    >>> table = work_table()
    >>> [round(row.recomputed, 2) for row in table.rows]
    [1.97, 29.94, 14.15, 144.05, 130.03, 250.42]
    """
    return WorkTable(law, tuple(WorkRow(read / 1e3, printed / 1e3, f, measured, second,
                                        sine_work(law, read / 1e3, f), reading)
                                for printed, read, f, measured, second, reading in PRINTED))


def _reading(unit: str) -> PowerLawFrictionGas:
    return PowerLawFrictionGas.from_printed((1.1602, 0.0002, 2.4993), (0.61, 0.0, 1.0), unit=unit, friction=47.0)


def _other_columns() -> PowerLawFrictionGas:
    """Table III read by rows (E0.4)."""
    return PowerLawFrictionGas.from_printed((0.0002, 0.0002, 2.4993), (0.0, 0.61, 1.1602), unit="mm", friction=47.0)


def _deviations(law: PowerLawDamper, rows: Sequence[WorkRow]) -> list[float]:
    return [sine_work(law, r.amplitude, r.frequency) / r.measured - 1 for r in rows]


def measured(displacement: np.ndarray, rate: float, rng: np.random.Generator | int, name: str = "run",
             law: PowerLawFrictionGas | None = None, stiffness: float = 5e5, noise: float = 5.0) -> Record:
    """A synthetic run of the seed's damper on a rig: the law behind a spring, and noise of the load cell.

    Parameters
    ----------
    displacement : (n,) array
        [m]
    rate : float
        [Hz]
    rng : numpy.random.Generator or int
    name : str
    law : PowerLawFrictionGas, optional
        `SWIFT_2012` with all but sharp friction if left out.
    stiffness : float
        Of oil and mounts, as `behind_spring` takes it; infinite for the law itself [N/m].
    noise : float
        Standard deviation [N].

    Returns
    -------
    Record
        Displacement [m], velocity [m/s] derived from it, and force [N].
    """
    record = with_velocity(Record({"displacement": Channel(displacement, "m")}, sample_time=1 / rate, name=name))
    law = law or SWIFT_2012.replace(friction_speed=1e-4)
    rigid = math.isinf(stiffness)
    force = law.simulate(record).output[:, 0] if rigid else behind_spring(law, record, stiffness)
    return record.with_channel("force", force + checks.generator(rng).normal(scale=noise, size=force.size), "N")


def behind_spring(law: PowerLawFrictionGas, record: Record, stiffness: float, steps: int = 8) -> np.ndarray:
    """(n,) force of a damper whose law acts behind a spring, the compliance that the static law leaves out [N].

    ::

        x ──[ k ]── x_i ──[ F(x_i, ẋ_i) ]── ground        k (x − x_i) = F_d(ẋ_i) + F_f(ẋ_i) − F_gst + K_gas x_i

    The paper's cause of the hysteresis (oil compressibility, "all type of damper compliance"), as the truth of
    synthetic tests. Implicit Euler: F_d(w) + F_f(w) + (k + K) h w rises with w, so that one table inverts it for every
    step. It starts settled at rest.

    Parameters
    ----------
    law : PowerLawFrictionGas
    record : Record
        Uniform, with ``displacement`` [m].
    stiffness : float
        k [N/m].
    steps : int
        Steps per sample, the displacement linear in between.

    Returns
    -------
    (n,) array
        At the samples of the record [N].
    """
    checks.positive(stiffness, "stiffness", "N/m")
    x, h = record["displacement"], float(record.sample_time or 0.0) / checks.count(steps, "steps", at_least=1)
    gas, preload = law.values.get("gas_stiffness", 0.0), law.values["gas_preload"]
    half = np.geomspace(1e-8, 10 * RIG_SPEED, 6000)
    speeds = np.concatenate([-half[::-1], [0.0], half])
    viscous = law.law(np.zeros(speeds.size), speeds, np.zeros(speeds.size), law.vector) + preload
    rising = viscous + (stiffness + gas) * h * speeds
    inner = (stiffness * x[0] + preload) / (stiffness + gas)
    force = np.empty(x.size)
    force[0] = stiffness * (x[0] - inner)
    for k in range(1, x.size):
        for part in range(1, steps + 1):
            place = x[k - 1] + (x[k] - x[k - 1]) * part / steps
            inner += h * float(np.interp(stiffness * (place - inner) - gas * inner + preload, rising, speeds))
        force[k] = stiffness * (x[k] - inner)
    return force
