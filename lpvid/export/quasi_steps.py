"""Self-scheduled models as step programs: quasi-LPV, and a law in series with a spring."""

from __future__ import annotations

import numpy as np

from lpvid.export.expression import Array, Expr, Real, Symbol, clipped
from lpvid.export.step_builder import StepBuilder
from lpvid.export.step_program import StepProgram
from lpvid.export.transfer_function_steps import drive, rows, vector
from lpvid.model.compliance import ComplianceModel
from lpvid.model.quasi import QuasiLPVModel
from lpvid.scheduling import Polynomial, Spline


def quasi_program(model: QuasiLPVModel, name: str, clamp: bool = False) -> StepProgram:
    """y(k) = Σ_m φ_m(ρ) Σ_e ψ_e(p) θ_me row(k), ρ from the model's own past; from zero past.

    Parameters
    ----------
    model : QuasiLPVModel
        Single output.
    name : str
        Prefix of files and functions.
    clamp : bool
        Whether the external scheduling is held inside the model's box.

    Returns
    -------
    StepProgram
        One output; the model's own scheduling ρ is no input.
    """
    b = _builder(model, name, "quasi-LPV model")
    at = drive(b, model, clamp, model.external)
    psi = vector(b, "outer", at.phi)
    reach = [n + k - 1 for n, k in zip(model.nb, model.nk, strict=True)]
    lead = model.nk[0] + model.kappa.size - 1 if model.on == "trial" else 1 if model.on == "input" else 0
    u = rows(b, "driving", at.u, max(*reach, lead), "inputs at this and the last samples")
    past = b.states("past_outputs", np.zeros(model.memory), model.outputs[0].unit, "outputs, the newest first")
    row = b.array("row", model.theta.shape[2])
    if model.na:
        with b.loop("lag", model.na) as i:
            b.set(row[i], -past[i])
    place = model.na
    for q, (n, k) in enumerate(zip(model.nb, model.nk, strict=True)):
        for j in range(k, k + n):
            b.set(row[place], u[j, q])
            place += 1
    b.set(row[place], 1.0)
    rho = b.let("rho", u[1, 0] if model.on == "input" else past[0])
    if model.on == "trial":
        kappa = b.table("kappa", model.kappa, "", "trial weights on the first input's lags")
        with b.loop("lag", model.kappa.size) as j:
            b.add(rho, kappa[j] * u[j + model.nk[0], 0])
    own = _own(b, model, rho)
    theta = b.table("theta", model.theta, "", "coefficients: own function, outer function, regressor")
    total = b.sum("total")
    with b.loop("own_function", model.theta.shape[0]) as m:
        part = b.sum("part")
        with b.loop("outer_function", model.theta.shape[1]) as e:
            inner = b.sum("inner")
            with b.loop("regressor", model.theta.shape[2]) as r:
                b.add(inner, theta[m, e, r] * row[r])
            b.add(part, psi[e] * inner)
        b.add(total, own[m] * part)
    if model.memory > 1:
        with b.loop("lag", model.memory, 1, down=True) as i:
            b.set(past[i], past[i - 1])
    b.set(past[0], total)
    b.output(model.outputs[0].name, total, model.outputs[0].unit, f"output {model.outputs[0].name}")
    return b.program()


def _own(b: StepBuilder, model: QuasiLPVModel, rho: Expr) -> Array:
    """Hat functions, or powers of the saturated argument."""
    own = b.array("own", model.own.size)
    if isinstance(model.own, Spline):
        knots = b.table("rho_knots", np.array(model.own.knots), "", "knots of the hat functions")
        last = len(model.own.knots) - 1
        x = b.let("held_rho", clipped(rho, knots[0], knots[last]))
        at = b.index("segment")
        with b.loop("knot", last, 1) as i, b.when(x >= knots[i]):
            b.set_index(at, i)
        part = b.let("share", (x - knots[at]) / (knots[at + 1] - knots[at]))
        b.set(own[at], 1.0 - part)
        b.set(own[at + 1], part)
        return own
    assert isinstance(model.own, Polynomial)
    z = b.let("z_rho", clipped((rho - model.own.centre[0]) / model.own.half_width[0], -1.0, 1.0))
    b.set(own[0], 1.0)
    for j in range(1, model.own.size):
        b.set(own[j], own[j - 1] * z)
    return own


def compliance_program(model: ComplianceModel, name: str, clamp: bool = False) -> StepProgram:
    """Implicit Euler steps of each spring in series with its law, and the linear terms in parallel; from rest.

    Parameters
    ----------
    model : ComplianceModel
        Its first input is the velocity [m/s], its output the force [N].
    name : str
        Prefix of files and functions.
    clamp : bool
        Whether the current is held inside the model's box.

    Returns
    -------
    StepProgram
        With one state per spring: the force of its element [N].
    """
    b = _builder(model, name, "law in series with a spring")
    at = drive(b, model, clamp, model.current)
    count = len(at.phi)
    phi = rows(b, "mixture", at.phi, 1, "functions of the current at this and the last sample", fill=True)
    speed = rows(b, "speed", at.u[:1], max(model.direct.size - 1, 1), "velocity at this and the last samples")
    beside = b.sum("beside", b.parameter("offset", model.offset, "N", "constant force"))
    if model.direct.size:
        table = b.table("direct", model.direct, "N*s/m", "linear terms in the velocity, by lag")
        with b.loop("lag", model.direct.size) as j:
            b.add(beside, table[j] * speed[j, 0])
    for value, weight, signal in zip(at.u[1:], model.side, model.inputs[1:], strict=True):
        b.add(beside, b.parameter(f"stiffness_{signal.name}", weight, "", f"force per {signal.name}") * value)
    knots = b.table("knots", model.knots, "m/s", "fluid speeds of the law")
    for place, element in enumerate(model.elements):
        start = -model.offset if place == 0 else 0.0  # the force that stands beside the offset at rest
        force = b.state(f"force_{place + 1}", "N", f"force of element {place + 1}", start)
        law = b.table(f"law_{place + 1}", element.law, "N", f"law of element {place + 1}: current function, knot")
        gain = b.parameter(f"gain_{place + 1}", model.gain(element), "N*s/m", "spring stiffness times the inner step")
        _euler(b, model, force, law, gain, knots, phi, speed, count)
        b.add(beside, force)
    b.output(model.outputs[0].name, beside, model.outputs[0].unit, f"output {model.outputs[0].name}")
    return b.program()


def _euler(b: StepBuilder, model: ComplianceModel, force: Symbol, law: Array, gain: Symbol, knots: Array, phi: Array,
           speed: Array, count: int) -> None:
    """F⁺ + g w⁺ = F + g v with F⁺ = F_s(w⁺): the segment by a scan of all knots, then one division."""
    size = model.knots.size
    with b.loop("substep", model.substeps) as s:
        share = b.let("share", (Real(s) + 1.0) / float(model.substeps))
        nodes = b.array("nodes", size)
        with b.loop("knot", size) as i, b.loop("function", count) as q:
            b.add(nodes[i], (phi[1, q] * (1.0 - share) + phi[0, q] * share) * law[q, i])
        v = b.let("velocity_now", speed[1, 0] * (1.0 - share) + speed[0, 0] * share)
        target = b.let("target", force + gain * v)
        low = b.index("segment")
        with b.loop("knot", size - 1, 1) as i, b.when(target >= nodes[i] + gain * knots[i]):
            b.set_index(low, i)
        rise = b.let("rise", nodes[low + 1] - nodes[low])
        width = b.let("width", knots[low + 1] - knots[low])
        part = b.let("part", (target - nodes[low] - gain * knots[low]) / (rise + gain * width))
        b.set(force, nodes[low] * (1.0 - part) + nodes[low + 1] * part)


def _builder(model: QuasiLPVModel | ComplianceModel, name: str, kind: str) -> StepBuilder:
    return StepBuilder(name, f"{kind} {', '.join(map(str, model.inputs))} -> {', '.join(map(str, model.outputs))}",
                       model.sample_time)
