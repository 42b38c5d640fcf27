"""The inverse damper model as steps: from a demanded force to the current that comes nearest to it."""

from __future__ import annotations

import numpy as np

from lpvid.errors import InputError
from lpvid.export.basis_steps import basis_values, staged
from lpvid.export.expression import Array, ByPrecision, Expr, Symbol, call, clipped, select
from lpvid.export.step_builder import StepBuilder
from lpvid.export.transfer_function_steps import LinearPartInput, equation
from lpvid.model.transfer_function import LPVTransferFunction
from quartercar.controllers.contract import Setting
from quartercar.controllers.loop.forces import FilterForces, StaticForces, TabulatedForces, ViscousForces
from quartercar.controllers.loop.inverse import ALIKE, Inverse, InverseSettings
from quartercar.dampers.families import StaticDamper
from quartercar.vehicle.filter_bank import filter_of
from quartercar.vehicle.nonlinear import Coil

FAR = ByPrecision(1e300, 1e30)
"""distance that any found current undercuts"""


class InverseSteps:
    """`quartercar.controllers.loop.inverse.Inverse` as statements, for one car.

    Attributes
    ----------
    current, before, attained : Symbol
        Current that the coil is thought to carry [A]; the model's force at the last sample, and the one that it expects
        after the last command [N].
    force, lowest, highest : Symbol
        Set by `look` [N].
    """

    def __init__(self, b: StepBuilder, setting: Setting, coil: Coil, settings: InverseSettings) -> None:
        self._b, self._settings, self._setting = b, settings, setting
        self._inverse = Inverse(setting, coil, settings)
        low, high = setting.currents
        self._grid = b.table("grid", np.linspace(low, high, settings.points), "A", "currents that are tried")
        self._size = settings.points
        self._model = _forces(b, self._inverse, setting, self._grid, settings)
        own = self._inverse.model.lag
        self.current = b.state("current", "A", "current that the coil is thought to carry", low)
        self._felt = b.state("current_felt", "A", "current behind the lag of the damper's model", low)
        self._wanted = b.state("current_wanted", "A", "current that was wanted last", low)
        self.before = b.state("force_before", "N", "force of the damper's model at the last sample")
        self.attained = b.state("force_expected", "N", "force that the model expects after the last command")
        self._rows: Array | None = None
        self._coil, self._own = _decays(b, "coil", coil), _decays(b, "model", own)
        both = Coil(coil.rise_time + own.rise_time, coil.fall_time + own.fall_time)
        self._both = _decays(b, "both", both) if settings.lag_compensated else None

    def look(self, z: Expr, v: Expr) -> None:
        """The motion at this sample.

        Parameters
        ----------
        z, v : Expr
            Deflection [m] and velocity [m/s] of the suspension, positive in extension.
        """
        b = self._b
        self._rows = b.array("candidates", self._size)
        self.force = self._model(z, v, self._felt, self._rows)
        self.lowest, self.highest = b.let("lowest", self._rows[0]), b.let("highest", self._rows[0])
        with b.loop("place", self._size, 1) as i:
            b.set(self.lowest, call("fmin", self.lowest, self._rows[i]))
            b.set(self.highest, call("fmax", self.highest, self._rows[i]))
        self._still = call("fabs", v) < self._settings.deadband

    def choose(self, demand: Expr) -> Expr:
        """The command for a demanded force.

        Parameters
        ----------
        demand : Expr
            About the static equilibrium, positive in extension [N]. `look` comes first.

        Returns
        -------
        Expr
            Command within the limits [A]; while |v| lies in the deadband, that of the current wanted before.
        """
        b = self._b
        with b.when(~self._still):
            b.set(self._wanted, self._nearest(demand))
        command = self._wanted
        if self._both is not None:
            share = 1.0 - select(self._wanted > self._felt, *self._both)
            command = b.let("leading", clipped(self._felt + (self._wanted - self._felt) / share, self._grid[0],
                                               self._grid[self._size - 1]))
        self._hold(command)
        return command

    def take(self, current: Expr) -> Expr:
        """The command for a demanded current.

        Parameters
        ----------
        current : Expr
            Demanded [A]. `look` comes first.

        Returns
        -------
        Expr
            Within the limits, without lead [A].
        """
        command = self._b.let("held_command", clipped(current, self._grid[0], self._grid[self._size - 1]))
        self._hold(command)
        return command

    def _nearest(self, demand: Expr) -> Expr:
        """Of the currents that have the force the one nearest to the lagged one, else the one of the nearest force."""
        b, rows, grid = self._b, self._rows, self._grid
        assert rows is not None
        found, far = b.let("found", grid[0]), b.let("far", FAR)
        outside, short = b.let("outside", grid[0]), b.let("short", call("fabs", rows[0] - demand))
        with b.loop("place", self._size - 1) as i:
            before, after = b.let("gap_before", rows[i] - demand), b.let("gap_after", rows[i + 1] - demand)
            with b.when(call("fabs", after) < short):
                b.set(short, call("fabs", after))
                b.set(outside, grid[i + 1])
            with b.when(before * after <= 0.0):
                share = b.let("share", 0.5)
                with b.when((before - after > 0.0) | (before - after < 0.0)):
                    b.set(share, before / (before - after))
                at = b.let("at", grid[i] + share * (grid[i + 1] - grid[i]))
                away = b.let("away", call("fabs", at - self._felt))
                with b.when(away < far):
                    b.set(far, away)
                    b.set(found, at)
        chosen = b.let("chosen", select(far < FAR, found, outside))
        return select(self.highest - self.lowest < ALIKE, self._felt, chosen)

    def _hold(self, command: Expr) -> None:
        b = self._b
        _follow(b, self.current, command, self._coil)
        _follow(b, self._felt, self.current, self._own)
        assert self._rows is not None
        b.set(self.attained, along(b, self._rows, self._grid, self._felt, self._size))


def _decays(b: StepBuilder, name: str, coil: Coil) -> tuple[Expr, Expr]:
    """exp(−T/τ) for a rise and a fall, 0 for a current that follows at once."""
    found = []
    for edge, tau in (("rise", coil.rise_time), ("fall", coil.fall_time)):
        decay = float(np.exp(-b.sample_time / tau)) if tau > 0 else 0.0
        found.append(b.parameter(f"{name}_{edge}_decay", decay, "", f"exp(-T/tau) of a {edge}, {name}"))
    return found[0], found[1]


def _follow(b: StepBuilder, state: Symbol, command: Expr, decays: tuple[Expr, Expr]) -> None:
    b.set(state, command + (state - command) * select(command > state, *decays))


def along(b: StepBuilder, rows: Array, grid: Array, at: Expr, size: int) -> Expr:
    """Values on a rising grid, linear in between and held beyond its ends.

    Parameters
    ----------
    b : StepBuilder
        Receives the statements.
    rows : Array
        (size,) values on the grid.
    grid : Array
        (size,) points, rising.
    at : Expr
        Where the value is wanted, in the unit of the grid.
    size : int
        Number of points, at least two.

    Returns
    -------
    Expr
        In the unit of `rows`.
    """
    j = b.index("segment")
    with b.loop("place", size - 1, 1) as i, b.when(at > grid[i]):
        b.set_index(j, i)
    share = b.let("share", clipped((at - grid[j]) / (grid[j + 1] - grid[j]), 0.0, 1.0))
    return b.let("value", rows[j] * (1.0 - share) + rows[j + 1] * share)


# -- models behind the inverse ---------------------------------------------------------------------------------------
def _forces(b: StepBuilder, inverse: Inverse, setting: Setting, grid: Array, settings: InverseSettings):
    """A function (z, v, felt, rows) that fills the candidate forces and gives the present one."""
    model, damper = inverse.model, setting.damper
    if isinstance(model, ViscousForces):
        damping = b.parameter("damping", setting.parameters.damping, "N*s/m", "of the viscous damper")
        return lambda z, v, felt, rows: _viscous(b, damping, v, rows)
    if isinstance(model, StaticForces):
        assert isinstance(damper, StaticDamper)
        law, rest = damper.expression(b), b.parameter("rest_force", model.rest, "N", "force at rest")
        return lambda z, v, felt, rows: _static(b, law, rest, z, v, felt, rows, grid)
    if isinstance(model, FilterForces):
        if settings.steps:
            raise InputError("an inverse that looks samples ahead has no exported step", got=f"steps={settings.steps}",
                             mend="InverseSettings(steps=0), which inverts the settled characteristic")
        settled = model.settled
        assert settled is not None
        table = _CharacteristicTable(b, settled, grid)
        return lambda z, v, felt, rows: _filtered(b, model, setting, table, z, v, felt, rows)
    assert isinstance(model, TabulatedForces)
    table = _CharacteristicTable(b, model, grid)

    def tabulated(z: Expr, v: Expr, felt: Expr, rows: Array) -> Expr:
        table.fill(z, v, rows)
        return along(b, rows, grid, felt, rows.shape[0])

    return tabulated


def _viscous(b: StepBuilder, damping: Expr, v: Expr, rows: Array) -> Expr:
    with b.loop("place", rows.shape[0]) as i:
        b.set(rows[i], damping * v)
    return b.let("force_now", damping * v)


def _static(b: StepBuilder, law, rest: Expr, z: Expr, v: Expr, felt: Expr, rows: Array, grid: Array) -> Expr:
    with b.loop("place", rows.shape[0]) as i:
        b.set(rows[i], law(z, v, grid[i]) - rest)
    return b.let("force_now", law(z, v, felt) - rest)


class _CharacteristicTable:
    """The settled characteristic over speeds and currents, with the spring beside it."""

    def __init__(self, b: StepBuilder, model: TabulatedForces, grid: Array) -> None:
        self._b = b
        self._speeds = b.table("speeds", model.speeds, "m/s", "speeds of the characteristic")
        self._forces = b.table("characteristic", model.table, "N", "force: speed, current")
        self._stiffness = b.parameter("spring", model.stiffness, "N/m", "spring beside the damper")
        self._rest = b.parameter("rest_force", model.rest, "N", "force at rest")

    def fill(self, z: Expr, v: Expr, rows: Array) -> None:
        """Candidate forces at a motion; straight on beyond the last speeds."""
        b, speeds, forces = self._b, self._speeds, self._forces
        j = b.index("speed_segment")
        with b.loop("speed", speeds.shape[0] - 1, 1) as i, b.when(v > speeds[i]):
            b.set_index(j, i)
        share = b.let("speed_share", (v - speeds[j]) / (speeds[j + 1] - speeds[j]))
        with b.loop("place", rows.shape[0]) as i:
            b.set(rows[i], forces[j, i] * (1.0 - share) + forces[j + 1, i] * share + self._stiffness * z - self._rest)


def _filtered(
    b: StepBuilder,
    forces: FilterForces,
    setting: Setting,
    table: _CharacteristicTable,
    z: Expr,
    v: Expr,
    felt: Expr,
    rows: Array,
) -> Expr:
    """The identified transfer function along the motion; what each current would do is its settled characteristic."""
    model = filter_of(setting.damper)
    if not isinstance(model, LPVTransferFunction):
        raise InputError("no exported step of an inverse whose damper is a state space", got=type(model).__name__,
                         mend="identify the damper as a transfer function (--structure arx or oe)")
    motion = {"velocity": v, "displacement": z}
    p = [felt] if model.box.names else []
    u = staged(b, model.input_stage, [motion[s.name] for s in model.inputs], p)
    past = {n: (lambda i: felt) for n in model.box.names}
    start = forces.started
    y = equation(b, model, LinearPartInput(u, p, basis_values(b, model.basis, past)), np.full((model.na, 1), start))
    table.fill(z, v, rows)
    return b.let("force_now", y[0] - b.parameter("filter_rest", forces.rest, "N", "force of the filter at rest"))
