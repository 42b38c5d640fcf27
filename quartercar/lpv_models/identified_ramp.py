"""E9 with a force that is linear over each sample: the identified damper in the car, as the nonlinear car has it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from quartercar.dampers.blackbox.sampled import SampledDamper
from quartercar.lpv_models.car_part import SPEED, bare_car, car_plant
from quartercar.lpv_models.embedding import Embedding, Trajectory
from quartercar.lpv_models.identified import IdentifiedDamper
from quartercar.lpv_models.region import Region, limits_around
from quartercar.parameters import CarParameters
from quartercar.vehicle.result import CarRun

NAMES = ("implicit_share", "force_per_current", "missing_per_current")
"""μ, μ r_2 and (μ − 1) r_2."""


@dataclass(frozen=True, eq=False)
class RampedDamper(Embedding):
    """E9 without the gap of a held force: F runs linearly from sample to sample, so that it acts on its own velocity.

    ::

        car⁺ = Φ car + Γ_w ż_r + Γ_0 F + Γ_1 F⁺      ξ = car − Γ_1 F      ξ⁺ = Φ ξ + (Φ Γ_1 + Γ_0) F + Γ_w ż_r
        F = C d + κ v + r_2 δ,   κ = D_1 + D_2 ρ_v,   v = v_ξ + s F,   s = SPEED Γ_1 < 0
        μ = 1/(1 − κ s):    F = μ C d + (μ − 1)/s v_ξ + μ r_2 δ,      v = μ v_ξ + s (μ C d + μ r_2 δ)
        D_2 ρ_v v = κ v − D_1 v,   κ v = (μ − 1)(v_ξ/s + C d + r_2 δ)

    Everything is affine in μ, μ r_2 and (μ − 1) r_2, which with any further r_1 are the scheduling; the rest is as in
    `IdentifiedDamper`. Every step is that of the nonlinear car between its stops. A stiff knee makes the held force of
    E9 unstable where D_2/v_0 exceeds about 2 m_us/T; not so here. A replay from the first state alone stays on the run
    as long as the damper frozen at i_0 is stable in the car: choose i_0 so.

    Attributes
    ----------
    parameters : CarParameters
    damper : SampledDamper
        As for `IdentifiedDamper`, with a shaped velocity.
    centre : float
        i_0 [A].
    form : {"augmented", "observable", "controllable"}
    limits : mapping of str to (float, float)
        Of the scheduling variables; `around` finds them.
    """

    number: ClassVar[str] = "E9"
    control: ClassVar[str] = "current_change"  # type: ignore[misc]

    parameters: CarParameters
    damper: SampledDamper
    centre: float = 1.25
    form: str = "augmented"
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.inner.model.input_stage is None or not self._feedthrough[1]:
            raise InputError("this embedding needs a velocity that is shaped and acts at once",
                             got="a damper without tanh at lag 0", mend="IdentifiedDamper")

    @cached_property
    def inner(self) -> IdentifiedDamper:
        """The damper's own matrices."""
        return IdentifiedDamper(self.parameters, self.damper, self.centre, self.form)

    @cached_property
    def _feedthrough(self) -> np.ndarray:
        """D_1 [N·s/m] and D_2 [N] at i_0."""
        return self.inner._here[3][0]

    @cached_property
    def _car(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Φ, Γ_w, Γ_0, Γ_1."""
        from scipy.linalg import expm

        car, t = bare_car(self.parameters), self.inner.sample_time
        block = np.zeros((7, 7))
        block[:4, :4], block[:4, 4:6], block[5, 6] = car.A, car.B, 1.0
        e = expm(block * t)
        late = e[:4, 6] / t
        return e[:4, :4].copy(), e[:4, 4].copy(), e[:4, 5] - late, late

    @property
    def names(self) -> tuple[str, ...]:
        """μ, μ r_2, (μ − 1) r_2, and one r_1 for each further row that the current moves."""
        return (*NAMES, *(f"state_per_current_{j}" for j in self.inner._rows[1]))

    def around(self, runs: list[CarRun] | CarRun, margin: float = 1.1) -> RampedDamper:
        """The same with a box for the scheduling around runs, widened by a margin about its middle.

        Parameters
        ----------
        runs : list of CarRun or CarRun
            At the damper's rate.
        margin : float
            Factor on the width of every range, 1 for the runs alone.

        Returns
        -------
        RampedDamper
            With `limits` of every scheduling variable.
        """
        p = np.vstack([self.along(run).scheduling for run in (runs if isinstance(runs, list) else [runs])])
        return replace(self, limits=limits_around(self.names, p, margin))

    @cached_property
    def region(self) -> Region:  # type: ignore[override]
        return Region.of_runs(self.names, self.limits)

    @cached_property
    def system(self) -> LPVStateSpace:  # type: ignore[override]
        phi, wind, early, late = self._car
        a, b, c, _, _, _ = self.inner._here
        d1, d2 = self._feedthrough
        s, n, names = float(SPEED @ late), len(a), self.names
        width, m = 4 + n + 2, 1 + len(names)  # rows over (ξ, d, ż_r, δ)
        at, delta = {name: 1 + k for k, name in enumerate(names)}, 4 + n + 1
        mu, given, missed = (at[name] for name in NAMES)
        past = np.zeros(width)
        past[4:4 + n] = c[0]
        speed = np.zeros(width)
        speed[:4] = SPEED
        force, v, kv = np.zeros((m, width)), np.zeros((m, width)), np.zeros((m, width))
        force[0], force[mu] = -speed / s, past + speed / s
        force[given, delta] = 1.0
        v[mu], v[given, delta] = speed + s * past, s
        kv[0], kv[mu] = -(speed / s + past), speed / s + past
        kv[missed, delta] = 1.0
        shaped = (kv - d1 * v) / d2
        inner = b[None, :, :1] * v[:, None] + b[None, :, 1:] * shaped[:, None]
        inner[0, :, 4:4 + n] += a
        echoes, moving = self.inner._rows
        inner[:, echoes] = force[:, None]
        for j in moving:
            inner[at[f"state_per_current_{j}"], j, delta] = 1.0
        car = bare_car(self.parameters)
        sampled = replace(car, A=phi, B=np.column_stack([wind, phi @ late + early]),
                          D=np.column_stack([car.D[:, 0], car.C @ late + car.D[:, 1]]))
        return car_plant(sampled, force, inner, self.region, (Signal(self.control, "A"),),
                         ("", *("N/A",) * (len(names) - 1)), self.inner.sample_time)

    def along(self, run: CarRun) -> Trajectory:
        """As the base class, from runs at the damper's rate.

        Raises
        ------
        InputError
            A run at another rate.
        """
        path, late = self.inner.along(run), self._car[3]
        force = np.asarray(run["damper_force"]) - self.inner._rest[1]
        states = path.states.copy()
        states[:, :4] -= force[:, None] * late
        secant, r = path.scheduling[:, 0], path.scheduling[:, 1]
        d1, d2 = self._feedthrough
        mu = 1 / (1 - (d1 + d2 * secant) * float(SPEED @ late))
        return Trajectory(states, path.inputs, np.column_stack([mu, mu * r, (mu - 1) * r, path.scheduling[:, 2:]]))
