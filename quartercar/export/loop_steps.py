"""The loop law of a quarter car as one step program: observer, control law and inverse damper, readings to current."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from lpvid.errors import InputError
from lpvid.export.contract import Exportable, Options, within
from lpvid.export.expression import Expr
from lpvid.export.step_builder import StepBuilder
from lpvid.toolkit import checks
from quartercar.controllers.contract import DEMANDS, SIGNALS, Controller, Setting
from quartercar.controllers.designed.lpv_hinf import LpvHinf
from quartercar.controllers.designed.lpv_hinf_clipped import LpvHinfClipped
from quartercar.controllers.loop.chain import ChainSettings, ControllerChain
from quartercar.controllers.loop.observer import KalmanObserver
from quartercar.export.controller_steps import AHEAD, REACH, ahead_name, demanded, refuse_searching_ahead
from quartercar.export.inverse_steps import InverseSteps
from quartercar.vehicle.nonlinear import Coil


@dataclass(frozen=True, eq=False)
class LoopLaw:
    """What stands between a car's sensors and its coil: observer, control law, inverse damper model.

    Attributes
    ----------
    controller : Controller
    setting : Setting
        Of one car: period, car, damper model behind the inverse, limits of the current; with so many samples of the
        road ahead (`preview`), each an input.
    coil : Coil
    settings : ChainSettings
        Its sensors state which readings there are; their bandwidth, noise and resolution only set the observer.
    """

    controller: Controller
    setting: Setting
    coil: Coil = field(default_factory=Coil)
    settings: ChainSettings = field(default_factory=ChainSettings)

    def __post_init__(self) -> None:
        if self.setting.cars != 1:
            raise InputError("a loop law belongs to one car", got=self.setting.cars)
        checks.positive(self.setting.sample_time, "sample_time", "s")

    def chain(self, samples: int) -> ControllerChain:
        """The same as it runs in `quartercar ride`; its `react` takes readings.

        Parameters
        ----------
        samples : int
            How many there will be at most.

        Returns
        -------
        ControllerChain
            Of one car, at rest.
        """
        return ControllerChain(
            [self.designed], self.setting, self.coil, self.settings, [np.random.default_rng(0)], samples
        )

    @property
    def designed(self) -> Controller:
        """The controller, designed where that was still to be done."""
        law = self.controller
        return law.designed(self.setting) if isinstance(law, (LpvHinf, LpvHinfClipped)) else law


def prepare_loop(loop: LoopLaw, options: Options) -> Exportable:
    """Readings at a sample to the command for the coming one, as `controllers.loop.chain.ControllerChain` has it.

    Parameters
    ----------
    loop : LoopLaw
        Its controller is designed first where that was still to be done.
    options : Options
        A name; the period is that of the setting.

    Returns
    -------
    Exportable
        From the sensors' readings, SI, to the command [A] and the law's demand; compared with `LoopLaw.chain`.

    Raises
    ------
    InputError
        Another period than that of the setting; a law that searches over the road ahead, or reads what the
        sensors do not show.
    """
    setting, sensors, law = loop.setting, loop.settings.sensors, loop.designed
    refuse_searching_ahead(law)
    if options.sample_time is not None and not np.isclose(options.sample_time, setting.sample_time, rtol=1e-9):
        raise InputError("a loop law runs at the period of its setting", got=f"{options.sample_time:g} s")
    loop.chain(1)  # refuses a law that reads what these sensors do not show
    b = StepBuilder(options.name or "loop", f"loop law '{law.title}' behind sensors '{sensors.name}'",
                    setting.sample_time)
    seen: dict[str, Expr] = {n: b.input(n, SIGNALS[n], f"reading of {n.replace('_', ' ')}") for n in sensors.signals}
    coming = _register(law, setting, sensors.ideal)
    seen |= {n: b.input(n, "m", f"elevation of the road at coming sample {k + 1}, less the present one")
             for k, n in enumerate(coming)}
    inverse = InverseSteps(b, setting, loop.coil, loop.settings.inverse)
    if not sensors.ideal:
        observer = KalmanObserver(setting, sensors, loop.settings.observer)
        seen |= _observer_steps(b, observer, seen, inverse, 1 / setting.sample_time)
    z, v = seen["suspension_deflection"], seen["suspension_velocity"]
    inverse.look(z, v)
    unit = DEMANDS[law.demands]
    asked, had = (b.state(n, unit, description) for n, description in (("demand_before", "demand of the last sample"),
                                                       ("attained_before", "what was attained of it")))
    seen |= {"current": inverse.current, "lowest_force": inverse.lowest, "highest_force": inverse.highest,
             "demanded": asked, "attained": had}
    demand = b.let("demand", demanded(b, law, seen, setting))
    by_force = law.demands == "force"
    command = inverse.choose(demand) if by_force else inverse.take(demand)
    b.set(inverse.before, inverse.force)
    b.set(asked, demand)
    b.set(had, inverse.attained if by_force else command)
    b.output("command", command, "A", "current to command from here to the coming sample")
    b.output("demand", demand, unit, f"demanded {law.demands}")
    names = list(sensors.signals)
    reach = np.array([*(REACH[n] for n in names), *(REACH[AHEAD] for _ in coming)])
    return Exportable(b.program(), lambda u: _reference(loop, names, u),
                      lambda n, rng: within(n, -reach, reach, rng), replace(loop, controller=law))


def _register(law: Controller, setting: Setting, ideal: bool) -> list[str]:
    """Inputs of the road ahead: the whole register for a law that reads it, the coming sample for an observer alone."""
    count = setting.preview if AHEAD in law.reads else min(setting.preview, 0 if ideal else 1)
    return [ahead_name(k + 1) for k in range(count)]


def _observer_steps(b: StepBuilder, observer: KalmanObserver, read: dict[str, Expr], inverse: InverseSteps, pace: float
                    ) -> dict[str, Expr]:
    """x ← S x + d F + e w, then x ← x + G (y − C x − D F_now): the steady Kalman filter of `KalmanObserver`.

    w is the road's rate that the register had for this sample, where there is one.
    """
    m = observer.matrices
    n, r = m.gain.shape
    tables = {name: b.table(f"observer_{name}", value, "", description) for name, value, description in
              (("step", m.step, "transition of the observer"), ("drive", m.drive, "force to states"),
               ("output", m.output, "states to readings"), ("through", m.through, "force to readings"),
               ("gain", m.gain, "Kalman gain"))}
    x = b.states("estimate", np.zeros(n), "", "suspension deflection [m], body velocity [m/s], tyre deflection [m], "
                 "wheel velocity [m/s], error of the damper model [N], sensors")
    expected = inverse.attained
    held = b.let("force_held", 0.5 * (inverse.before + expected))
    ahead, gap = b.array("ahead", n), b.array("gap", r)
    rate: Expr | None = None
    if ahead_name(1) in read:
        tables["road"] = b.table("observer_road", m.road, "", "road's rate to states")
        before = b.state("road_before", "m", "elevation of this sample as it was known one before, less that one's")
        rate = b.let("road_rate", before * pace)
        b.set(before, read[ahead_name(1)])
    with b.loop("row", n) as i:
        total = b.sum("total")
        with b.loop("column", n) as j:
            b.add(total, tables["step"][i, j] * x[j])
        b.set(ahead[i], total + held * tables["drive"][i] + (0.0 if rate is None else rate * tables["road"][i]))
    for k, name in enumerate(m.names):
        total = b.sum("total")
        with b.loop("column", n) as j:
            b.add(total, tables["output"][k, j] * ahead[j])
        b.set(gap[k], read[name] - total - expected * tables["through"][k])
    with b.loop("row", n) as i:
        total = b.sum("total")
        with b.loop("column", r) as j:
            b.add(total, tables["gain"][i, j] * gap[j])
        b.set(x[i], ahead[i] + total)
    return {"suspension_deflection": x[0], "body_velocity": x[1], "tyre_deflection": x[2], "wheel_velocity": x[3],
            "suspension_velocity": b.let("suspension_speed", x[1] - x[3])}


def _reference(loop: LoopLaw, names: list[str], u: np.ndarray) -> np.ndarray:
    chain, out = loop.chain(len(u)), []
    for row in u:
        coming = row[None, len(names):] if len(row) > len(names) else None
        command = chain.react({n: row[i : i + 1] for i, n in enumerate(names)}, coming)
        out.append([command[0], chain.demand[0]])
    return np.array(out)
