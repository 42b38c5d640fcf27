"""Directional derivatives of exported continuous models: the matrices of the model, and differences, as oracles."""

from __future__ import annotations

import zipfile

import numpy as np
import pytest
from helpers.exported_models import needs_compiler

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.export import python_printer
from lpvid.export.exportable import flow_of
from lpvid.export.expression import call, select
from lpvid.export.fmu import flow_content
from lpvid.export.step_builder import StepBuilder
from lpvid.export.step_program import Declare, walk
from lpvid.export.tangent import tangent

BOX = lpv.Scheduling(("rho",), (0.0,), (1.0,))
BASES = {"affine": lpv.Polynomial("rho", 1), "cubic": lpv.Polynomial("rho", 3), "spline": lpv.Spline("rho", 4, 3),
         "doubled knot": lpv.Spline("rho", 5, 2, (0.0, 0.3, 0.3, 0.5, 0.9, 1.0)),
         "fourier": lpv.Fourier("rho", 2)}


def continuous(basis, rng, **more):
    basis = basis.bound(BOX) if hasattr(basis, "bound") else basis
    m = basis.size
    return lpv.LPVStateSpace(rng.normal(size=(m, 2, 2)), rng.normal(size=(m, 2, 1)), rng.normal(size=(m, 1, 2)),
                             rng.normal(size=(m, 1, 1)), basis, None, BOX, rng.normal(size=(m, 2)),
                             inputs=("velocity",), **more)


@needs_compiler
@pytest.mark.parametrize("version", [pytest.param(2, marks=pytest.mark.seconds),
                                     pytest.param(3, marks=pytest.mark.slow)])
def test_directional_derivatives_are_the_matrices_of_the_model(version, tmp_path, rng):
    """∂ẋ/∂x = A(ρ), ∂ẋ/∂u = B(ρ), ∂y/∂x = C(ρ), ∂y/∂u = D(ρ), through FMPy."""
    fmpy = pytest.importorskip("fmpy", reason="the extra 'fmu' is not installed")
    from fmpy.fmi2 import FMU2Model
    from fmpy.fmi3 import FMU3Model

    model = continuous(BASES["spline"], rng)
    path = str(lpv.export_fmu(model, tmp_path, version=version).files[0])
    described = fmpy.read_model_description(path)
    with zipfile.ZipFile(path) as archive:  # FMPy does not read this attribute of FMI 3
        text = archive.read("modelDescription.xml").decode()
    assert f'providesDirectionalDerivative{"" if version == 2 else "s"}="true"' in text
    named = {v.name: v.valueReference for v in described.modelVariables}
    home = fmpy.extract(path)
    fmu = (FMU2Model if version == 2 else FMU3Model)(guid=described.guid, unzipDirectory=home, instanceName="m",
                                                     modelIdentifier=described.modelExchange.modelIdentifier)
    fmu.instantiate()
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    write = fmu.setReal if version == 2 else fmu.setFloat64
    write([named["velocity"], named["rho"], named["x[1]"], named["x[2]"]], [0.4, 0.37, -1.0, 2.0])
    unknown = [named["der(x[1])"], named["der(x[2])"], named["y1"]]
    columns = [fmu.getDirectionalDerivative(unknown, [named[n]], [1.0]) for n in ("x[1]", "x[2]", "velocity")]
    a, b, c, d = model.frozen([0.37])
    assert np.allclose(np.array(columns).T, np.block([[a, b], [c, d]]), rtol=1e-12, atol=1e-14)
    both = fmu.getDirectionalDerivative(unknown, [named["x[1]"], named["velocity"]], [2.0, -3.0])
    assert np.allclose(both, 2 * np.array(columns[0]) - 3 * np.array(columns[2]), rtol=1e-12)
    with pytest.raises(Exception, match=r"(?i)derivative|failed|error"):
        fmu.getDirectionalDerivative(unknown, [named["A[1,1,1]"]], [1.0])
    fmu.terminate()
    fmu.freeInstance()


@pytest.mark.thinned(4, "seconds")
@needs_compiler
@pytest.mark.parametrize("name", BASES)
def test_derivatives_with_respect_to_the_scheduling_agree_with_differences(name, rng):
    pytest.importorskip("fmpy", reason="the extra 'fmu' is not installed")
    made = flow_content(flow_of(continuous(BASES[name], rng)), 2)
    assert made.passed and float(made.checks[1].split()[-1]) < 1e-7, made.checks


@pytest.mark.parametrize("value, slope", [
    (lambda x: call("tanh", 2.0 * x), lambda x: 2 / np.cosh(2 * x) ** 2),
    (lambda x: call("exp", x) / (x + 3.0), lambda x: np.exp(x) / (x + 3) - np.exp(x) / (x + 3) ** 2),
    (lambda x: call("log", 4.0 - x), lambda x: -1 / (4 - x)),
    (lambda x: call("atan", 2.0 * x), lambda x: 2 / (1 + 4 * x * x)),
    (lambda x: call("sqrt", 4.0 - x), lambda x: -0.5 / np.sqrt(4 - x)),
    (lambda x: call("sin", x) * call("cos", x), lambda x: np.cos(2 * x)),
    (lambda x: call("pow", call("fabs", x), 1.5), lambda x: 1.5 * np.sqrt(abs(x)) * np.sign(x)),
    (lambda x: call("fmin", x, 0.2) - call("fmax", x, 0.1), lambda x: float(x <= 0.2) - float(x >= 0.1)),
    (lambda x: select(x > 0.0, x * x, -x), lambda x: 2 * x if x > 0 else -1.0),
    (lambda x: 5.0 - (-x) * call("floor", x), lambda x: np.floor(x)),
])
@pytest.mark.parametrize("at", [-0.7, 0.15, 1.3])
def test_every_rule_of_differentiation(value, slope, at, monkeypatch):
    monkeypatch.setitem(python_printer.HOMES, "state_tangent", "u")  # read from the dictionary of the inputs here,
    monkeypatch.setitem(python_printer.HOMES, "output_tangent", "p")  # and written to that of the parameters
    b = StepBuilder("rule", "a rule", 0.0)
    x = b.state("x1")
    b.output("y1", value(x))
    found: dict = {}
    y: dict = {}
    python_printer.python_step(tangent(b.program()))(found, {"x1": at}, {"x1": 1.0}, y)
    assert found["y1"] == pytest.approx(slope(at), rel=1e-12, abs=1e-14)


def test_a_power_whose_exponent_moves_is_refused_and_a_constant_one_is_not():
    b = StepBuilder("rule", "a rule", 0.0)
    x, n = b.state("x1"), b.parameter("n1", 2.0)
    b.output("y1", call("pow", x, b.let("held", n)))
    tangent(b.program())
    b.output("y2", call("pow", 2.0, b.let("moving", x)))
    with pytest.raises(InputError, match="exponent moves"):
        tangent(b.program())


def test_what_nothing_reads_is_left_out():
    b = StepBuilder("rule", "a rule", 0.0)
    x = b.state("x1")
    step = b.let("step", call("floor", x))
    b.output("y1", x + step)
    names = [s.symbol.name for s in walk(tangent(b.program()).body) if isinstance(s, Declare)]
    assert names == ["step"]
