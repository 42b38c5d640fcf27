"""study: an identified damper embedded for design; centre, order and limits chosen, and what each step costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from lpvid.errors import InputError, NumericalError
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial
from lpvid.synthesis.reduction import reduce_order
from quartercar import roads
from quartercar.dampers.contract import Damper
from quartercar.lpv_models.embedding import output_gap, replay
from quartercar.lpv_models.frozen_damper import FrozenDamper, Matrices, filtered, response
from quartercar.lpv_models.identified_continuous import ContinuousDamper
from quartercar.parameters import CarParameters
from quartercar.vehicle.batch import Log, start_fleet
from quartercar.vehicle.nonlinear import Coil, QuarterCar
from quartercar.vehicle.result import CarRun

BAND = 25.0
"""up to which a car's body and wheel move [Hz]; beyond, its signals are below a tenth of those at the wheel's mode"""
CENTRES = 26
"""currents that are tried as i_0, over the coil's range"""
REDUCED = 0.3
"""largest error of a reduced filter as a share of the model's own: the two together are then 4 % above it"""
DURATION = 4.0
"""of each run [s]"""
STEPS = 0.05
"""for which a random current is held [s]"""


@dataclass(frozen=True, eq=False)
class EmbeddedDamper:
    """An identified damper in a car, ready for a design, and how far it is from the nonlinear car.

    Attributes
    ----------
    plant : ContinuousDamper
        Without a lag.
    currents : (float, float)
        Of the coil.
    full_order, order : int
        States of the frozen damper as identified, and in the plant.
    singular_values : (full_order,) array
        Of the frozen filter, its inputs in units of their rms on the runs [N].
    fit_error : float or None
        rms of the model's residuals in training [N].
    reduction_error : float
        Largest rms error over the runs that the reduction makes in the force [N].
    conversion_error : float
        Largest |G(jω) − G(e^{jωT})| over the inputs, up to `BAND`, relative to the largest |G(e^{jωT})| of each.
    replay_error : mapping of run to float
        Largest of the four states' rms errors of a replay in the LPV plant, relative to the rms of each, in free run.
    output_error : float
        Largest error of C(p)x + D(p)u along the runs, as a share of each signal's largest value.
    authority : (float, float)
        Least and largest f per ampere beside i_0 on the runs, g r of E9 [N/A].
    rate : float
        Largest |dρ_v/dt| on the runs, in widths of the range of ρ_v per second.
    velocities : (n,) array
        |v| of all runs, rising [m/s].
    """

    plant: ContinuousDamper
    currents: tuple[float, float]
    full_order: int
    order: int
    singular_values: np.ndarray
    fit_error: float | None
    reduction_error: float
    conversion_error: float
    replay_error: dict[str, float]
    output_error: float
    authority: tuple[float, float]
    rate: float
    velocities: np.ndarray

    @property
    def centre(self) -> float:
        """i_0 [A]."""
        return self.plant.frozen.current

    def without_slow(self, share: float) -> ContinuousDamper:
        """The plant for ρ_v of velocities above the one below which the runs have this share of their mean square.

        Near zero velocity the shaped force holds the suspension as friction does, by ρ_v up to 1/v_0 in this plant; the
        force itself stays below its yield there, so that what the plant leaves out is bounded.

        Parameters
        ----------
        share : float
            Between 0 and 1; 0 leaves the plant as it is.

        Returns
        -------
        ContinuousDamper
            With a lower upper limit of ρ_v; the plant itself where the velocity is not shaped.
        """
        if not share or self.plant.limits is None:
            return self.plant
        low, high = self.plant.limits
        secant = float(self.plant.frozen.secant(np.array(self.slowest(share))))
        return replace(self.plant, limits=(low, min(high, secant)))

    def slowest(self, share: float) -> float:
        """Velocity below which the runs have a share of their mean square [m/s].

        Parameters
        ----------
        share : float
            Of the mean square of all velocities, between 0 and 1.

        Returns
        -------
        float
            [m/s].
        """
        energy = np.cumsum(self.velocities**2)
        return float(self.velocities[np.searchsorted(energy, share * energy[-1])])

    def slower(self, velocity: float) -> float:
        """Share of the runs' samples below a velocity [m/s].

        Parameters
        ----------
        velocity : float
            |v_d| [m/s].

        Returns
        -------
        float
            Between 0 and 1.
        """
        return float(np.searchsorted(self.velocities, velocity) / len(self.velocities))

    def to_dict(self) -> dict:
        """Part of synthesis.json.

        Returns
        -------
        dict
            Plain values by name; arrays as lists.
        """
        return {"kind": "identified", "centre_current": self.centre, "currents": list(self.currents),
                "damper_order": self.order, "identified_order": self.full_order,
                "singular_values": self.singular_values.tolist(), "fit_error": self.fit_error,
                "reduction_error": self.reduction_error, "conversion_error": self.conversion_error,
                "band": BAND, "replay_error": self.replay_error, "output_error": self.output_error,
                "secant": None if self.plant.limits is None else list(self.plant.limits),
                "force_per_current": list(self.authority),
                "secant_rate": self.rate}

    def __str__(self) -> str:
        own = "" if self.fit_error is None else f" (the model's own in training: {self.fit_error:.3g} N)"
        box = "" if self.plant.limits is None else (
            f"rho_v {self.plant.limits[0]:.3g} to {self.plant.limits[1]:.3g} s/m, ")
        worst = max(self.replay_error, key=self.replay_error.__getitem__)
        states = f"{self.order} states as identified" if self.order == self.full_order else (
            f"{self.full_order} -> {self.order} states, rms error of the reduction {self.reduction_error:.3g} N{own}")
        return (f"plant identified: damper about {self.centre:.3g} A, {states}; error of the conversion to continuous "
                f"time {self.conversion_error:.2%} up to {BAND:g} Hz\n"
                f"scheduling {box}any share of a demand; on the runs r is {self.authority[0]:.4g} to "
                f"{self.authority[1]:.4g} N/A\n"
                f"free-run replay of the nonlinear car: worst state off by {self.replay_error[worst]:.1%} of its rms "
                f"({worst})")


@lru_cache(maxsize=16)
def study(parameters: CarParameters, damper: Damper, currents: tuple[float, float], centre: float | None = None,
          order: int | None = None) -> EmbeddedDamper:
    """Embed an identified damper in a car for the design of a controller.

    Parameters
    ----------
    parameters : CarParameters
    damper : Damper
        With an identified transfer function from velocity to force inside.
    currents : (float, float)
        Limits of the command [A].
    centre : float, optional
        i_0 [A]; the lowest current at which the car with the frozen damper is stable, where left out.
    order : int, optional
        Of the damper in the plant; the least whose reduction error is below `REDUCED` of the model's own error.

    Returns
    -------
    EmbeddedDamper
        Shared by equal arguments.

    Raises
    ------
    InputError
        A damper that cannot be embedded; no current at which the car with the frozen damper is stable; a car that
        leaves all bounds at some current; an order above that of the model.
    """
    runs = driven(parameters, damper, currents)
    listed = list(runs.values())
    plant = _centred(parameters, damper, currents, centre).around(listed)
    drives = [plant.damper_inputs(run) for run in listed]
    fit = _fit_error(plant.frozen)
    reduced, values, error = _reduced(plant, drives, fit, order)
    plant = replace(plant, filter=reduced)
    rate = max(float(np.abs(np.diff(plant.frozen.secant(r["suspension_velocity"]))).max()) / r.sample_time
               for r in listed)
    width = np.ptp(plant.limits) if plant.limits is not None else 1.0
    replays = {n: replay_error(plant, r) for n, r in runs.items() if "random" in n}
    return EmbeddedDamper(plant, currents, plant.frozen.order, len(reduced[0]), values, fit, error,
                          conversion_error(plant.frozen), replays,
                          max(output_gap(plant, run) for run in listed), _force_per_current(plant, listed),
                          rate / float(width),
                          np.sort(np.abs(np.concatenate([r["suspension_velocity"] for r in listed]))))


def driven(parameters: CarParameters, damper: Damper, currents: tuple[float, float]) -> dict[str, CarRun]:
    """Runs of the nonlinear car over an ISO C and D road and a bump, at the lowest and highest current and random ones.

    Parameters
    ----------
    parameters : CarParameters
        Of the car, whose tyre stays on the road in every run.
    damper : Damper
        With a rate of its own, which is that of the runs.
    currents : (float, float)
        Limits of the command [A].

    Returns
    -------
    dict of str to CarRun
        Nine runs of 4 s, by road and current, as "ISO C, 20 m/s, random current". The random numbers are the same at
        every call.

    Raises
    ------
    InputError
        A car that leaves all bounds.

    Warns
    -----
    ExtrapolationWarning
        Currents outside the range of the damper's fit.
    """
    clock = damper.clock
    if clock is None:
        raise InputError("the plant with the damper's dynamics needs an identified damper", got=f"'{damper.name}'",
                         mend="lpv-arx, or plant = \"nominal\"")
    n, rng = round(DURATION / clock), np.random.default_rng(9)
    car = QuarterCar(parameters, damper, coil=Coil(lowest=currents[0], highest=currents[1]), lift_off=False)
    t = clock * np.arange(n)
    bump = np.where((t > 1) & (t < 1.25), 0.025 * (1 - np.cos(8 * np.pi * (t - 1))), 0.0)
    elevations = {f"ISO {c}, 20 m/s": roads.iso8608(n, 1 / clock, c, speed=20.0, rng=rng) for c in "CD"}
    elevations = {name: (z - z[0]) * np.minimum(t, 1.0) for name, z in elevations.items()} | {"bump, 50 mm": bump}
    held = max(1, round(STEPS / clock))
    random = np.repeat(rng.uniform(*currents, n // held + 1), held)[:n]
    commands = {"lowest": np.full(n, currents[0]), "highest": np.full(n, currents[1]), "random": random}
    for current in currents:
        car.start(clock, 0.0, current)  # which warns of currents outside the damper's fit
    pairs = [(road, label) for road in elevations for label in commands]
    runs = _together(car, clock, np.column_stack([elevations[road] for road, _ in pairs]),
                     np.column_stack([commands[label] for _, label in pairs]), pairs)
    return {f"{road}, {label} current": run for (road, label), run in zip(pairs, runs, strict=True)}


def _together(car: QuarterCar, clock: float, roads: np.ndarray, commands: np.ndarray,
              pairs: Sequence[tuple[str, str]]) -> list[CarRun]:
    """All runs sample by sample side by side: (n, cars) elevations and commands, with the names of each."""
    fleet = start_fleet(car, clock, roads[0], commands[0])
    log = Log(fleet, roads)
    log.note(commands[0])
    try:
        for k in range(1, len(roads)):
            fleet.advance(roads[k], commands[k - 1])
            log.note(commands[k])
    except NumericalError:
        size = np.abs(fleet.motion).max(axis=1)
        road, label = pairs[int(np.argmax(np.where(np.isnan(size), np.inf, size)))]
        raise InputError(f"the car with this damper leaves all bounds on {road}", got=f"{label} current",
                         why="the identified model gives energy there",
                         mend="fit a passive model (--passive), or records that reach these speeds") from None
    return [log.run(i) for i in range(len(pairs))]


def _centred(parameters: CarParameters, damper: Damper, currents: tuple[float, float],
             centre: float | None) -> ContinuousDamper:
    """About the given current, or the lowest at which the car with the frozen damper is stable for every ρ_v."""
    if centre is not None:
        if not currents[0] <= centre <= currents[1]:
            raise InputError("the centre of the plant lies within the coil's currents",
                             got=f"{centre:g} A outside {currents[0]:g} to {currents[1]:g} A")
        tried = ContinuousDamper(parameters, FrozenDamper.of(damper, centre))
        if not frozen_stable(tried):
            raise InputError(f"the car with the damper frozen at {centre:g} A is not stable",
                             why="the identified model gives energy there, and where the velocity is zero no current "
                             "can take it back", mend="another centre, or a passive model (--passive)")
        return tried
    for current in np.linspace(*currents, CENTRES):
        tried = ContinuousDamper(parameters, FrozenDamper.of(damper, float(current)))
        if frozen_stable(tried):
            return tried
    raise InputError("at no current is the car with this damper frozen stable", got=f"'{damper.name}', "
                     f"{currents[0]:g} to {currents[1]:g} A", why="the identified model gives energy, and where the "
                     "velocity is zero no current can take it back",
                     mend="fit a passive model (--passive), or plant = \"nominal\"")


def frozen_stable(plant: ContinuousDamper) -> bool:
    """Whether the car is stable without control for ρ_v from 0 to 1/v_0, frozen, and the damper alone as well.

    Parameters
    ----------
    plant : ContinuousDamper
        Its `limits` do not count.

    Returns
    -------
    bool
        From the poles at 17 values of ρ_v; False where the damper alone is unstable.
    """
    if not plant.frozen.stable:
        return False
    tried = replace(plant, limits=(0.0, 1 / plant.frozen.knee)) if plant.frozen.shaped else plant
    box = tried.system.box
    poles = np.linalg.eigvals(np.tensordot(tried.system.basis.evaluate(box.grid(17)), tried.system.A, axes=1))
    return bool(poles.real.max() < 0)


def _reduced(plant: ContinuousDamper, drives: Sequence[np.ndarray], fit: float | None,
             order: int | None) -> tuple[Matrices, np.ndarray, float]:
    """The filter of the order wanted, or of the least that is good enough; its singular values; its worst rms error."""
    frozen, period = plant.frozen, plant.frozen.model.sample_time
    a, b, c, d = frozen.continuous
    if not frozen.order:
        return frozen.continuous, np.empty(0), 0.0
    if order is not None and not 1 <= order <= frozen.order:
        raise InputError("the damper's order in the plant", got=order, why=f"the model has {frozen.order} states",
                         mend=f"1 to {frozen.order}")
    levels = np.sqrt(np.mean([np.mean(u**2, axis=0) for u in drives], axis=0))
    levels = np.where(levels > 0, levels, 1.0)
    scaled = LPVStateSpace(a[None], (b * levels)[None], c[None], (d * levels)[None], Polynomial(), None)
    exact = [filtered(frozen.continuous, u, period)[1][:, 0] for u in drives]
    size = max(float(np.std(y)) for y in exact)
    allowed = REDUCED * (fit if fit is not None else 0.01 * size)
    values, last = np.empty(0), None
    for n in range(1, frozen.order + 1) if order is None else (order,):
        found = reduce_order(scaled, n, certified=False)
        m = found.model
        part = m.A[0], m.B[0] / levels, m.C[0], m.D[0] / levels
        values = found.singular_values
        error = max(float(np.sqrt(np.mean((filtered(part, u, period)[1][:, 0] - y) ** 2)))
                    for u, y in zip(drives, exact, strict=True))
        last = part, values, error
        if order is None and error <= allowed and frozen_stable(replace(plant, filter=part)):
            break
    assert last is not None
    if not frozen_stable(replace(plant, filter=last[0])):
        raise InputError(f"the car with the damper reduced to {len(last[0][0])} states is not stable",
                         mend="a higher order")
    return last


def _fit_error(frozen: FrozenDamper) -> float | None:
    noise = frozen.model.noise_covariance
    return None if noise is None else float(np.sqrt(noise[0, 0]))


def conversion_error(frozen: FrozenDamper, band: float = BAND) -> float:
    """Largest error of the bilinear map over the inputs, up to a frequency [Hz], relative to each one's largest gain.

    Parameters
    ----------
    frozen : FrozenDamper
        Its discrete and its continuous filter are compared.
    band : float
        Highest frequency [Hz].

    Returns
    -------
    float
        Dimensionless; not weighted by how large each input is.

    Examples
    --------
    >>> from quartercar.rides.default_damper import identified_damper
    >>> frozen = FrozenDamper.of(identified_damper(), 0.0)
    >>> conversion_error(frozen, 5.0) < conversion_error(frozen, 25.0) < 0.02
    True
    """
    f = np.linspace(0.0, band, 200)
    wanted = response(frozen.discrete, np.exp(2j * np.pi * f * frozen.model.sample_time))[:, 0]
    found = response(frozen.continuous, 2j * np.pi * f)[:, 0]
    return float((np.abs(found - wanted).max(axis=0) / np.abs(wanted).max(axis=0)).max())


def replay_error(plant: ContinuousDamper, run: CarRun) -> float:
    """Largest rms error of the car's four states in a free-run replay, relative to the rms of each.

    Parameters
    ----------
    plant : ContinuousDamper
        The filter embedded in it counts, so that a reduced one shows its error.
    run : CarRun
        At the damper's rate.

    Returns
    -------
    float
        Of the worst of the four states, dimensionless.
    """
    states = plant.along(run).states[:, :4]
    gap = replay(plant, run)[:, :4] - states
    return float((np.sqrt(np.mean(gap**2, axis=0)) / np.sqrt(np.mean(states**2, axis=0))).max())


def _force_per_current(plant: ContinuousDamper, runs: Sequence[CarRun]) -> tuple[float, float]:
    """Least and largest f/(i − i_0) over samples whose current differs from i_0 by a tenth of the coil's range."""
    found = []
    for run in runs:
        stage, period = plant.frozen.model.scheduling_stage, run.sample_time
        current = np.asarray(run["current"])
        current = current if stage is None else stage.apply(current[:, None], period)[:, 0]
        away = current - plant.frozen.current
        inside = np.abs(away) > 0.1 * max(float(np.abs(away).max()), 1e-9)
        if inside.any():
            f = plant.frozen.added(run["suspension_velocity"], run["damper_force"])
            found.append(f[inside] / away[inside])
    every = np.concatenate(found) if found else np.zeros(1)
    return float(every.min()), float(every.max())
