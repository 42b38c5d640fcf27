"""Control laws as step programs: the scheduled LPV controller, and the laws of a variable damping."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from lpvid.errors import InputError
from lpvid.export.basis_steps import basis_values
from lpvid.export.contract import Exportable, Options, within
from lpvid.export.expression import Expr, RealConstant, call, clipped, select
from lpvid.export.state_space_steps import mixed
from lpvid.export.step_builder import StepBuilder
from lpvid.export.transfer_function_steps import vector
from quartercar.controllers.contract import DEADBAND, DEMANDS, SIGNALS, Controller, Setting
from quartercar.controllers.designed.lpv_hinf import LpvHinf
from quartercar.controllers.designed.lpv_hinf_clipped import LpvHinfClipped
from quartercar.controllers.designed.scheduled import ScheduledController
from quartercar.controllers.laws.clipped_optimal import STATES, ClippedOptimal, optimal_gain
from quartercar.controllers.laws.damping import HIGH, LOW
from quartercar.controllers.laws.horizon import comfort_filter
from quartercar.controllers.laws.preview_model import LAG, LinearPreview
from quartercar.parameters import MEGANE

Seen = Mapping[str, Expr]
REACH = {"suspension_deflection": 0.05, "suspension_velocity": 0.8, "body_acceleration": 5.0, "body_velocity": 0.5,
         "wheel_acceleration": 40.0, "wheel_velocity": 1.0, "tyre_deflection": 0.01, "current": 2.0,
         "lowest_force": 500.0, "road_ahead": 0.02, "highest_force": 2000.0, "attained": 1000.0}
"""What the random trajectory of a self-test reaches, in the signal's unit."""
AHEAD = "road_ahead"
"""signal of the register, whose samples are inputs `ahead_name`"""
PERIOD = 1e-3
"""period of a law that runs at any [s]"""


def prepare_controller(controller: Controller, options: Options) -> Exportable:
    """A control law as a step program.

    Its last demand is kept inside; what was attained of it is an input.

    Parameters
    ----------
    controller : Controller
        With its parameters as they are.
    options : Options
        A name, and the period of a law that runs at any; that of a scheduled controller is its own.

    Returns
    -------
    Exportable
        From the signals in `reads`, but the last demand, to the demand; compared with `Controller.start`.

    Raises
    ------
    InputError
        A law that needs its car's parameters, or is to be designed first, with what can be exported instead.
    """
    refuse_searching_ahead(controller)
    if isinstance(controller, (LpvHinf, LpvHinfClipped)):
        raise InputError(f"'{controller.name}' is a design to be made for a car, not yet a controller",
                         mend="export the controller.json of quartercar design, or law.designed(setting)")
    if isinstance(controller, ClippedOptimal | LinearPreview) or controller.name == "pdd":
        raise InputError(f"'{controller.name}' needs the masses and springs of its car",
                         mend="export quartercar.export.loop_steps.LoopLaw(controller, setting, coil)")
    if options.clamp is False and isinstance(controller, ScheduledController) and controller.schedule:
        raise InputError("a scheduled controller always holds its scheduling inside the box that it was designed for",
                         mend="leave clamp out")
    period = options.sample_time or PERIOD
    if isinstance(controller, ScheduledController):
        assert controller.model.sample_time is not None
        period = controller.model.sample_time
        if options.sample_time is not None and not np.isclose(options.sample_time, period, rtol=1e-9):
            raise InputError("this controller was designed for one rate",
                             got=f"{1 / options.sample_time:.6g} Hz against {1 / period:.6g} Hz",
                             mend="leave the sample rate out, or design it anew")
    b = StepBuilder(options.name or "controller", f"control law '{controller.title}' ({controller.source})", period)
    names = [n for n in controller.reads if n != "demanded"]
    unit = DEMANDS[controller.demands]
    seen: dict[str, Expr] = {
        n: b.input(n, SIGNALS[n] or (unit if n == "attained" else ""), _description(n)) for n in names
    }
    asked = b.state("demand_before", unit, "demand of the last sample") if "demanded" in controller.reads else None
    if asked is not None:
        seen["demanded"] = asked
    demand = b.let("demand", demanded(b, controller, seen, None))
    if asked is not None:
        b.set(asked, demand)
    b.output("demand", demand, unit, f"demanded {controller.demands}")
    setting = Setting(period, 1, MEGANE)
    return Exportable(b.program(), lambda u: _reference(controller, names, setting, u),
                      lambda n, rng: within(n, *_reach(names), rng), controller)


def refuse_searching_ahead(controller: Controller) -> None:
    """Refuse a law that searches over the road ahead: only linear gains over its register have a step.

    Parameters
    ----------
    controller : Controller
        Any law.

    Raises
    ------
    InputError
        Such a law, with what can be exported instead.
    """
    if AHEAD in controller.reads and not isinstance(controller, LinearPreview):
        raise InputError(f"the law '{controller.name}' has no exported step",
                         why="it searches over the road ahead, and only linear gains over a register have a step",
                         mend="export 'preview-lpv' or 'clipped-optimal' in a LoopLaw, or 'sh-add'")


def ahead_name(sample: int) -> str:
    """The input of the road's elevation so many samples ahead, less the present one.

    Parameters
    ----------
    sample : int
        1 for the coming one.

    Returns
    -------
    str
    """
    return f"{AHEAD}_{sample}"


def _description(name: str) -> str:
    return "what was attained of the last demand" if name == "attained" else name.replace("_", " ")


def _reach(names: list[str]) -> tuple[np.ndarray, np.ndarray]:
    high = np.array([REACH[n] for n in names])
    return np.where([n == "current" for n in names], 0.0, -high), high


def _reference(controller: Controller, names: list[str], setting: Setting, u: np.ndarray) -> np.ndarray:
    law, asked, out = controller.start(setting), np.zeros(1), []
    for row in u:
        asked = np.broadcast_to(law.step({**{n: row[i : i + 1] for i, n in enumerate(names)}, "demanded": asked}), (1,))
        out.append(asked[0])
    return np.array(out)[:, None]


# -- demands ---------------------------------------------------------------------------------------------------------
def demanded(b: StepBuilder, controller: Controller, seen: Seen, setting: Setting | None) -> Expr:
    """The demand of a law at this sample.

    Parameters
    ----------
    b : StepBuilder
        Receives the statements, parameters and states of the law.
    controller : Controller
        With its parameters as they are.
    seen : mapping of str to Expr
        Signals by the names of `contract.SIGNALS`, SI.
    setting : Setting or None
        For its car, whose parameters some laws need; None for a law by itself.

    Returns
    -------
    Expr
        In the unit of what the law demands.

    Raises
    ------
    InputError
        A law without an exported step, or one that needs its car's parameters where there is no setting.
    """
    if isinstance(controller, ScheduledController):
        return _scheduled(b, controller, seen)
    if isinstance(controller, LinearPreview) and setting is not None:
        return _previewing(b, controller, seen, setting)
    named = {
        p.name: b.parameter(p.name, controller.values[p.name], p.unit, p.description) for p in controller.parameters
    }
    if controller.name in SWITCHING:
        return _switching(b, named, seen, SWITCHING[controller.name](named, seen))
    if controller.name in DIRECT:
        return DIRECT[controller.name](b, named, seen)
    if controller.name == "pdd" and setting is not None:
        return _power_driven(b, named, seen, setting)
    if isinstance(controller, ClippedOptimal) and setting is not None:
        gain = optimal_gain(setting.parameters, controller.values["tyre_weight"], controller.values["stroke_weight"])
        table = b.table("optimal_gain", np.array(gain), "", f"K of F = -K x, x = {', '.join(STATES)}")
        wanted: Expr = RealConstant(0.0)
        for k, name in enumerate(STATES):
            wanted = wanted + table[k] * seen[name]
        return _between(b, -wanted, named, seen["suspension_velocity"])
    own = controller.expression(b, named, seen)
    if own is not None:
        return own
    raise InputError(f"the law '{controller.name}' has no exported step",
                     mend="design with --plant nominal, export a 'scheduled' controller, or write its method "
                          "`expression` (docs/extending.md)")


def _scheduled(b: StepBuilder, c: ScheduledController, seen: Seen) -> Expr:
    """x⁺ = A(ρ)x + B(ρ)y + L (attained − demanded), demand = u_0 + c_nom v_d + gain·(C(ρ)x + D(ρ)y)."""
    model = c.model
    assert model.state_offset is not None and model.output_offset is not None
    held: dict[str, Expr] = {}
    for name, rule, low, high in zip(model.box.names, c.schedule, model.box.lower, model.box.upper, strict=True):
        held[name] = b.let(f"rho_{name}", clipped(rule.expression(b, seen), low, high))
    phi = vector(b, "basis", basis_values(b, model.basis, {n: (lambda i, at=at: at) for n, at in held.items()}))
    u = vector(b, "measured", [seen[s.name] for s in model.inputs])
    x = b.states("x", np.zeros(model.order), "", "states of the controller") if model.order else None
    y = mixed(b, phi, x, u, ("C", model.C), ("D", model.D), ("g", model.output_offset), 1)
    if x is not None:
        ahead = mixed(b, phi, x, u, ("A", model.A), ("B", model.B), ("f", model.state_offset), model.order)
        if c.anti_windup is not None:
            back = b.table("anti_windup", c.anti_windup, "", "from what was not attained to the states")
            with b.loop("row", model.order) as i:
                b.add(ahead[i], (seen["attained"] - seen["demanded"]) * back[i])
        with b.loop("row", model.order) as i:
            b.set(x[i], ahead[i])
    out = b.parameter("around", c.around, DEMANDS[c.asks], "demand that is added") \
        + b.parameter("gain", c.values["gain"], "", "of the controller's output") * y[0]
    if c.nominal_damping:
        out = out + b.parameter("nominal_damping", c.nominal_damping, "N*s/m", "c_nom") * seen["suspension_velocity"]
    return out


def _switching(b: StepBuilder, named: Seen, seen: Seen, hard: Expr) -> Expr:
    v = seen["suspension_velocity"]
    on = b.state("on", "", "1 while the damping is high")
    with b.when(call("fabs", v) > DEADBAND):
        b.set(on, select(hard, 1.0, 0.0))
    low = named["low_damping"]
    return select(on > 0.5, call("fmax", low, named["high_damping"]), low) * v


def _sh_add(n: Seen, s: Seen) -> Expr:
    a, v, alpha = s["body_acceleration"], s["body_velocity"], n["crossover"]
    slow = a * a <= (alpha * v) * (alpha * v)
    return select(slow, v, a) * s["suspension_velocity"] > 0.0


SWITCHING: Mapping[str, Callable[[Seen, Seen], Expr]] = {
    "skyhook": lambda n, s: s["body_velocity"] * s["suspension_velocity"] > 0.0,
    "groundhook": lambda n, s: s["wheel_velocity"] * s["suspension_velocity"] < 0.0,
    "add": lambda n, s: s["body_acceleration"] * s["suspension_velocity"] > 0.0,
    "sh-add": _sh_add,
    "sh-add-1s": lambda n, s: s["body_acceleration"] * s["body_acceleration"] <= (
        n["crossover"] * s["suspension_velocity"]) * (n["crossover"] * s["suspension_velocity"]),
}
"""Conditions of high damping, by law."""


def _between(b: StepBuilder, force: Expr, named: Seen, v: Expr) -> Expr:
    """A force within what dampings from c_min to c_max do."""
    low = named["low_damping"]
    soft, hard = b.let("soft", low * v), b.let("hard", call("fmax", low, named["high_damping"]) * v)
    return clipped(force, call("fmin", soft, hard), call("fmax", soft, hard))


def _linear_skyhook(b: StepBuilder, n: Seen, s: Seen) -> Expr:
    share, v = n["passive_share"], s["suspension_velocity"]
    return _between(b, n["high_damping"] * (share * v + (1.0 - share) * s["body_velocity"]), n, v)


def _hybrid(b: StepBuilder, n: Seen, s: Seen) -> Expr:
    sky = n["sky_share"] * n["sky_damping"]
    ground = (1.0 - n["sky_share"]) * n["ground_damping"]
    return _between(b, sky * s["body_velocity"] - ground * s["wheel_velocity"], n, s["suspension_velocity"])


DIRECT: Mapping[str, Callable[[StepBuilder, Seen, Seen], Expr]] = {
    "passive": lambda b, n, s: n["fixed_current"], "skyhook-linear": _linear_skyhook, "hybrid": _hybrid}
"""Laws without memory, by name."""


def _previewing(b: StepBuilder, law: LinearPreview, seen: Seen, setting: Setting) -> Expr:
    """F = c_nom v_d − K x − Σ_j K_j w(k+j) within c_min and c_max, as `LinearPreviewLaw` has it.

    The sum over rates is written over the elevations r_j of the register, w(k+j) = (r_{j+1} − r_j)/T and r_0 = 0:
    Σ_j r_j (K_{j−1} − K_j)/T with K_P = 0.
    """
    found, car, period = law.preview_gains(
        {n: np.full(1, value) for n, value in law.values.items()}, setting), setting.parameters, setting.sample_time
    shape = comfort_filter(period)
    nf = len(shape) - 1
    limits = {p.name: b.parameter(p.name, law.values[p.name], p.unit, p.description) for p in law.parameters
              if p.name in (LOW.name, HIGH.name)}
    nominal = b.parameter("nominal_damping", float(found.nominal_damping[0]), "N*s/m", "c_nom")
    left = b.parameter("force_left", float(np.exp(-period / law.values[LAG.name])), "",
                       "share of a demand that the damper's force has not followed after a sample")
    gain = b.table("preview_gain", found.gain[0], "", f"K, over {', '.join(STATES)}, lagged force, comfort filter")
    v, z = seen["suspension_velocity"], seen["suspension_deflection"]
    base, force = (b.state(n, "N", d) for n, d in (("base_before", "c_nom v_d of the last sample"),
                                                   ("force_lagged", "force beside c_nom v_d")))
    filtered = b.states("filtered", np.zeros(nf), "", "states of the comfort filter")
    had = b.let("had", seen["attained"] - base)
    b.set(force, had + (force - had) * left)
    b.set(base, nominal * v)
    x = vector(b, "x", [*(seen[n] for n in STATES), force, *(filtered[k] for k in range(nf))])
    wanted = b.sum("wanted")
    with b.loop("column", len(STATES) + 1 + nf) as k:
        b.add(wanted, -(gain[k] * x[k]))
    if setting.preview:
        rows = (found.ahead[0] - np.append(found.ahead[0, 1:], 0.0)) / period
        ahead = b.table("preview_ahead", rows, "N/m", "of the elevation of each coming sample")
        register = vector(b, "register", [seen[ahead_name(j + 1)] for j in range(setting.preview)])
        with b.loop("coming", setting.preview) as k:
            b.add(wanted, -(ahead[k] * register[k]))
    spring = b.parameter("spring_stiffness", car.spring_stiffness, "N/m", "suspension spring")
    mass = b.parameter("sprung_mass", car.sprung_mass, "kg", "")
    body = b.let("body", -(spring * z + base + force) / mass)
    step, into = (b.table(n, m, "", "comfort filter") for n, m in (("comfort_step", shape[:nf, :nf]),
                                                                   ("comfort_into", shape[:nf, nf])))
    coming = b.array("filtered_next", nf)
    with b.loop("row", nf) as i:
        total = b.sum("filter_total")
        with b.loop("column", nf) as k:
            b.add(total, step[i, k] * filtered[k])
        b.set(coming[i], total + body * into[i])
    with b.loop("row", nf) as i:
        b.set(filtered[i], coming[i])
    return _between(b, base + wanted, limits, v)


def _power_driven(b: StepBuilder, n: Seen, s: Seen, setting: Setting) -> Expr:
    z, v, low = s["suspension_deflection"], s["suspension_velocity"], n["low_damping"]
    k = b.parameter("spring_stiffness", setting.parameters.spring_stiffness, "N/m", "suspension spring")
    high = b.let("high", call("fmax", low, n["high_damping"]))
    power = b.let("power", k * z * v)
    hard = select(power + high * (v * v) < 0.0, high * v, -k * z)
    return select(power + low * (v * v) >= 0.0, low * v, hard)
