"""IdentifiedDesign: a suspension controller on the plant with the damper's own dynamics, and what it was shown to."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from quartercar.controllers.contract import Setting
from quartercar.controllers.designed.damper_design import DamperTask, feasible, gain_vector, synthesized_gain
from quartercar.controllers.designed.lpv_hinf_identified import LpvHinfIdentified
from quartercar.controllers.designed.suspension_design import nominal_damping, to_the_end
from quartercar.design.figures import FREQUENCIES, SHOWN, SuspensionDesign, names_of
from quartercar.lpv_models.identified_study import BAND, EmbeddedDamper
from quartercar.vehicle.nonlinear import QuarterCar

SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""of the demand that are given, in the figure of gains"""
SPEED = 0.2
"""at which ρ_v is frozen there: an rms velocity of a suspension on an ISO C road [m/s]"""


@dataclass(frozen=True, eq=False)
class IdentifiedDesign(SuspensionDesign):
    """A designed controller on the identified plant, or why there is none.

    Attributes
    ----------
    car : QuarterCar
    law : LpvHinfIdentified
        With the weights.
    task : DamperTask
    synthesis : Synthesis
    setting : Setting
    """

    law: LpvHinfIdentified
    task: DamperTask

    baseline = "nothing given"
    shares = "Share of the demand frozen at values from 0 to 1, the secant of the shaped velocity at 0.2 m/s; " \
             "dashed: the frozen damper alone."

    @property
    def plant(self) -> EmbeddedDamper:
        """The damper in the car, with what reduction, conversion and embedding cost."""
        return self.task.embedded

    @cached_property
    def gains(self) -> tuple[tuple[float, dict[str, np.ndarray]], ...]:
        """(share, gains from the road's elevation to `SHOWN` at `FREQUENCIES`), the scheduling frozen."""
        gain = gain_vector(self.task)
        return tuple((share, self._frozen(share * gain)) for share in SHARES)

    @property
    def passive_gains(self) -> dict[str, np.ndarray]:
        """The same without control."""
        return self._frozen(np.zeros(self.task.plant().order))

    def _frozen(self, gain: np.ndarray) -> dict[str, np.ndarray]:
        plant, embedding = self.task.plant(), self.task.embedding
        point = embedding.frozen.secant(np.array([SPEED]))[:len(plant.box.names)]
        at = plant.at(np.clip(point, plant.box.lower, plant.box.upper)[None]).point(0)
        system = embedding.system
        _, _, c, d = system.frozen(np.clip(point, system.box.lower, system.box.upper))
        rows = [[s.name for s in system.outputs].index(n) for n in SHOWN]
        wide = np.zeros((len(rows), plant.order))
        wide[:, :system.order] = c[rows]
        s = 2j * np.pi * FREQUENCIES[:, None, None]
        flow = at.A + at.B2 @ gain[None]
        found = wide @ np.linalg.solve(s * np.eye(len(flow)) - flow, at.B1 / self.task.weights.road + 0j)
        found = np.abs(s * (found + d[rows][:, :1]))[:, :, 0]
        return dict(zip(SHOWN, found.T, strict=True))

    @property
    def promise(self) -> str:
        s = self.synthesis
        slow = f", velocities above {self.plant.slowest(self.task.slow):.3g} m/s" if self.task.slow else ""
        return (f"{self.law.title}: weighted gain from {names_of(s, 'inputs')} to {names_of(s, 'outputs')} at most "
                f"{s.gamma_verified:.4g} whatever share of the demand is given, verified {self.verified_where}. The "
                f"plant holds the damper about {self.plant.centre:.3g} A with {self.plant.order} of its "
                f"{self.plant.full_order} states{slow}.")

    @property
    def facts(self) -> tuple[tuple[str, str], ...]:
        """Name and value, for the head of a report."""
        return (("law", self.law.title), ("plant", "identified"), ("damper about", f"{self.plant.centre:.3g} A"),
                ("loop", f"{1 / self.setting.sample_time:.6g} Hz"))

    @property
    def caveats(self) -> tuple[str, ...]:
        """What the verdict does not cover."""
        lines = [] if not self.synthesis.solved or self.synthesis.between_grid else [
            "The gain is verified at points of a grid of the scheduling only."]
        if self.task.slow:
            v = self.plant.slowest(self.task.slow)
            lines.append(f"The bound covers suspension velocities above {v:.3g} m/s; {self.plant.slower(v):.0%} of the "
                         "samples on the runs are slower, and no storage function was found that covers them.")
        lines.append("The gain is that of the loop with the car's own states; the observer is not in it, and the coil "
                     f"is a lag of {1e3 * self.task.lag:.3g} ms.")
        return tuple(lines)

    @property
    def plant_rows(self) -> tuple[tuple[str, str], ...]:
        """What was embedded and what it costs, for a table."""
        p = self.plant
        own = "unknown" if p.fit_error is None else f"{p.fit_error:.3g} N"
        limits = self.task.embedding.limits
        box = "none" if limits is None else f"{limits[0]:.3g} to {limits[1]:.3g} s/m"
        replays = tuple((f"free-run replay of the nonlinear car, {n}", f"{e:.2%}") for n, e in p.replay_error.items())
        return (("damper frozen at", f"{p.centre:.3g} A"), ("states, identified", str(p.full_order)),
                ("states, in the plant", str(p.order)),
                ("rms error of the reduction on runs of the car", f"{p.reduction_error:.3g} N"),
                ("rms error of the identified model in training", own),
                (f"error of the conversion to continuous time up to {BAND:g} Hz", f"{p.conversion_error:.2%}"),
                ("largest error of the plant's outputs along the runs", f"{p.output_error:.2%}"), *replays,
                ("scheduling ρ_v", box), ("force per current r on the runs",
                                          f"{p.authority[0]:.4g} to {p.authority[1]:.4g} N/A"))

    def plant_facts(self) -> dict[str, Any]:
        plant = {**self.plant.to_dict(), "designed_secant": self.task.embedding.limits,
                 "slow_share_left_out": self.task.slow}
        return {"plant": plant, "sample_time": self.setting.sample_time, "measured": "observed", "criterion": "hinf"}

    def __str__(self) -> str:
        return f"{self.verdict}\n{self.plant}\n{self.synthesis!r}\n{self.law!r}"


def design_identified(car: QuarterCar, law: LpvHinfIdentified, setting: Setting) -> IdentifiedDesign:
    """Design a controller on the identified plant; a synthesis that fails comes back with its verdict.

    Parameters
    ----------
    car : QuarterCar
        The car that is driven.
    law : LpvHinfIdentified
        With the weights.
    setting : Setting
        The design model of the car, with a damper model; period and limits of the current.

    Returns
    -------
    IdentifiedDesign
        For the largest box of ρ_v that admits a controller.

    Raises
    ------
    InputError
        A damper that cannot be embedded (`quartercar.lpv_models.identified_study.study`), or one whose settled force
        gives energy on the whole, with the currents and speeds at which it does.
    """
    assert setting.damper is not None
    nominal_damping(setting.damper, setting.currents)
    task = feasible(law.task(law.values, setting))
    return IdentifiedDesign(car, law, task, to_the_end(synthesized_gain, task, feasible), setting)
