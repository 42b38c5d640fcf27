"""DamperLaw: gains over car, damper and added force on their way, with the identified damper run beside the car."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.condition.segmentation import RATE_TOLERANCE
from lpvid.errors import InputError
from quartercar.controllers.contract import DEADBAND, Law, Setting, Signals
from quartercar.controllers.loop.inverse import nearest
from quartercar.dampers.contract import Damper
from quartercar.lpv_models.frozen_damper import FrozenDamper, Matrices, trapezoidal
from quartercar.lpv_models.weighted import banded
from quartercar.vehicle.batch import lag_coil
from quartercar.vehicle.filter_bank import FilterBank

CURRENTS = 11
"""at which the model's addition is evaluated; linear in between"""
SMALL = 1.0
"""demand below which it counts as met [N]"""
READS = ("suspension_deflection", "body_velocity", "tyre_deflection", "wheel_velocity", "suspension_velocity",
         "current")
Band = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class DamperGain:
    """A designed gain with all that its states are made of.

    Attributes
    ----------
    damper : Damper
        With an identified transfer function inside.
    centre : float
        i_0 [A].
    filter : (A, B, C, D)
        The damper in the plant, continuous.
    bands : (Band, Band)
        Of the weights on body acceleration and tyre force: gain in the middle, corners [Hz].
    limits : (2,) array
        Of ρ_v [s/m].
    gain : (n,) array
        Over z_d, ż_s, z_t, ż_us, the damper's states, the added force, the weights' states.
    """

    damper: Damper
    centre: float
    filter: Matrices
    bands: tuple[Band, Band]
    limits: np.ndarray
    gain: np.ndarray


class DamperLaw(Law):
    """u = K x and the current whose added force is nearest to u, for many cars with a gain each.

    ::

        x = (z_d', ż_s, z_t, ż_us, x_d, f, x_w)      z_d' about rest at i_0
        f  from the model's own force F(k) along the motion and current   (`FrozenDamper`)
        x_d, x_w by the trapezoidal rule from (v, tanh(v/v_0), f) and from (z̈_s, F_t)

    The car's states are measured or observed; the damper's are those of its model in open loop, exact where the model
    is. Nothing is integrated that the clipped demand could wind up: what drives every state is what was given.

    Parameters
    ----------
    chosen : sequence of DamperGain
        One for each car; they differ in bands and gains alone.
    setting : Setting

    Raises
    ------
    InputError
        A loop at another rate than the damper's.
    """

    def __init__(self, chosen: Sequence[DamperGain], setting: Setting) -> None:
        first, cars, period = chosen[0], len(chosen), setting.sample_time
        clock = first.damper.clock
        if clock is None or abs(period / clock - 1) > RATE_TOLERANCE:
            raise InputError("a law with the damper's dynamics runs at the damper's rate",
                             got=f"{1 / period:.6g} Hz against {'none' if clock is None else f'{1 / clock:.6g} Hz'}",
                             mend="design it for this damper (quartercar design --damper), and leave the rate of "
                                  "the loop to the damper")
        self._frozen = FrozenDamper.of(first.damper, first.centre)
        self._bank = FilterBank(self._frozen.model, cars)
        self._own, self._period = lag_coil(self._frozen.model), period
        self._grid = np.linspace(*setting.currents, CURRENTS)
        self._felt = np.full(cars, setting.currents[0])
        self._bank.begin(self._felt)
        self._car, self._preload = setting.parameters, float(first.damper.conservative_force(np.zeros(1))[0])
        self._inner = trapezoidal(first.filter, period)
        shapes = [_shapes(c.bands, period) for c in chosen]
        self._outer = np.array([m for m, _ in shapes]), np.array([n for _, n in shapes])
        self._limits, self._gain = first.limits, np.array([c.gain for c in chosen])
        frozen, n = self._frozen, len(first.filter[0])
        start = self._bank.force - frozen.rest
        self._past_force = np.repeat(start[:, None], len(frozen.a), axis=1)
        self._past_input = np.zeros((cars, len(frozen.b) - 1, frozen.b.shape[1]))
        self._drive = np.column_stack([np.zeros((cars, frozen.b.shape[1])), start])
        a, b = first.filter[:2]
        self._states = np.einsum("ij,cj->ci", np.linalg.solve(-a, b), self._drive) if n else np.zeros((cars, 0))
        self._shown, self._weights = np.zeros((cars, 2)), np.zeros((cars, 4))
        self._wanted = self._felt.copy()
        self._outside, self._short = np.zeros(cars), np.zeros(cars)

    def step(self, seen: Signals) -> np.ndarray:
        """(cars,) current."""
        z, v = seen["suspension_deflection"], seen["suspension_velocity"]
        force = self._run_damper(z, v, seen["current"])
        strut = self._car.spring_stiffness * z + force - self._preload
        self._run_weights(-strut / self._car.sprung_mass, self._car.tyre_stiffness * seen["tyre_deflection"])
        about = z + (self._frozen.rest - self._preload) / self._car.spring_stiffness
        x = np.column_stack([about, seen["body_velocity"], seen["tyre_deflection"], seen["wheel_velocity"],
                             self._states, self._drive[:, -1], self._weights])
        demand = np.einsum("cn,cn->c", self._gain, x)
        rows = self._added_ahead(z, v)
        wanted = nearest(rows, self._grid, demand, self._felt)
        self._wanted = np.where(np.abs(v) < DEADBAND, self._wanted, wanted)
        self._count(v, rows, demand)
        return self._wanted

    def counted(self) -> dict[str, np.ndarray]:
        """Samples with ρ_v outside its box; with a demand that could not be met in full."""
        return {"scheduling_outside": self._outside, "demand_not_met": self._short}

    # -- states -------------------------------------------------------------------------------------------------------
    def _run_damper(self, z: np.ndarray, v: np.ndarray, current: np.ndarray) -> np.ndarray:
        """(cars,) force of the model at this sample [N]; the added force and the damper's states follow from it."""
        frozen = self._frozen
        self._felt = self._own.follow_all(self._felt, current, self._period)
        self._bank.approach(self._felt)
        self._bank.commit(z, v)
        own, u = self._bank.force - frozen.rest, frozen.inputs(v)
        added = frozen.settled * (own - self._frozen_past() - np.einsum("ci,i->c", u, frozen.b[0]))
        self._past_force = _pushed(self._past_force, own)
        self._past_input = _pushed(self._past_input, u)
        drive = np.column_stack([u, added])
        m, n = self._inner
        self._states = np.einsum("ij,cj->ci", m, self._states) + np.einsum("ij,cj->ci", n, self._drive + drive)
        self._drive = drive
        return self._bank.force

    def _frozen_past(self) -> np.ndarray:
        """(cars,) −Σ a_j F'(k−j) + Σ_{j≥1} b_j u_0(k−j)."""
        return (np.einsum("cji,ji->c", self._past_input, self._frozen.b[1:])
                - np.einsum("cj,j->c", self._past_force, self._frozen.a))

    def _added_ahead(self, z: np.ndarray, v: np.ndarray) -> np.ndarray:
        """(cars, G) what each current would add at the coming sample, were the velocity held [N]."""
        frozen = self._frozen
        force = self._bank.ahead(z, v, self._grid, 1) - frozen.rest
        still = self._frozen_past() + np.einsum("ci,i->c", frozen.inputs(v), frozen.b[0])
        return frozen.settled * (force - still[:, None])

    def _run_weights(self, body: np.ndarray, tyre: np.ndarray) -> None:
        shown = np.column_stack([body, tyre])
        m, n = self._outer
        self._weights = np.einsum("cij,cj->ci", m, self._weights) + np.einsum("cij,cj->ci", n, self._shown + shown)
        self._shown = shown

    def _count(self, v: np.ndarray, rows: np.ndarray, demand: np.ndarray) -> None:
        low, high = self._limits
        rho = self._frozen.secant(v)
        self._outside += (rho < low * (1 - 1e-9)) | (rho > high * (1 + 1e-9))
        short = np.clip(demand, rows.min(axis=1), rows.max(axis=1)) != demand
        self._short += short & (np.abs(demand) > SMALL)


def _shapes(bands: tuple[Band, Band], period: float) -> tuple[np.ndarray, np.ndarray]:
    """M (4, 4) and N (4, 2) of both weights by the trapezoidal rule."""
    m, n = np.zeros((4, 4)), np.zeros((4, 2))
    for k, (band, signal) in enumerate(zip(bands, ("body_acceleration", "tyre_force"), strict=True)):
        block = banded(*band, signal, "shown")
        part = trapezoidal((block.A[0], block.B[0], block.C[0], block.D[0]), period)
        m[2 * k:2 * k + 2, 2 * k:2 * k + 2], n[2 * k:2 * k + 2, k] = part[0], part[1][:, 0]
    return m, n


def _pushed(past: np.ndarray, now: np.ndarray) -> np.ndarray:
    return np.concatenate([now[:, None], past[:, :-1]], axis=1) if past.shape[1] else past
