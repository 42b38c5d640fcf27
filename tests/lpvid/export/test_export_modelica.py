"""Modelica packages, compiled and run by rumoca, a compiler of others: the check model, and a bench that integrates."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.exported_models import BOX, CASES, continuous, state_space

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.export.exportable import exportable
from lpvid.export.exporting import content
from lpvid.export.modelica import modelica_content
from lpvid.export.modelica_printer import spelled
from lpvid.export.step_builder import StepBuilder


@pytest.fixture
def rumoca():
    return pytest.importorskip("rumoca", reason="the extra 'modelica' is not installed")


@pytest.mark.parametrize("case", ["transfer function", "product", "limited", "quasi", "compliance"])
def test_the_check_model_passes(case, rumoca, rng):
    made = modelica_content(exportable(CASES[case](rng)))
    assert made.passed and float(made.checks[0].split()[-1]) < 1e-12, made.checks


def test_a_wrong_coefficient_fails_the_check(rumoca, rng, monkeypatch):
    """The check can fail: one parameter of the tested model moved by a millionth."""
    from lpvid.export import modelica

    model = state_space(rng, "square")
    wrong = modelica.package

    def moved(*given):
        number = repr(float(model.C[0, 0, 0]))
        text = wrong(*given)
        assert number in text
        return text.replace(number, repr(float(model.C[0, 0, 0]) * (1 + 1e-6)))

    monkeypatch.setattr(modelica, "package", moved)
    assert not modelica_content(exportable(model)).passed


def test_a_continuous_model_is_integrated_to_its_step_response(rumoca, rng):
    """An oracle beside our own derivatives: the matrix exponential, by another tool's solver."""
    from scipy.linalg import expm

    model = continuous(rng).replace(state_offset=np.zeros((2, 2)))
    made = content(model, "modelica")
    assert made.passed
    bench = "model Bench\n  lpv_model.Block plant;\nequation\n  plant.velocity = 1.0;\n  plant.rho = 0.5;\nend Bench;\n"
    text = made.files["lpv_model.mo"].decode() + bench
    run = rumoca.Session().loads(text, model="Bench").simulate(t=2.0, dt=0.1, config=rumoca.SimConfig(rtol=1e-9,
                                                                                                   atol=1e-11))
    a, b, c, d = model.frozen([0.5])
    block = np.block([[a, b], [np.zeros((1, 3))]])
    wanted = np.array([(c @ expm(block * t)[:2, 2:] + d)[0, 0] for t in run.time])
    assert np.abs(np.asarray(run["plant.y1"]) - wanted).max() < 1e-6 * np.abs(wanted).max()


def test_a_continuous_model_stays_continuous_and_a_law_without_states_is_algebraic(rng):
    text = content(continuous(rng), "modelica").files["lpv_model.mo"].decode()
    assert "der(states[k]) = held[k]" in text and "sample(" not in text.split("model Check")[0]
    gain = lpv.LPVStateSpace(np.zeros((2, 0, 0)), np.zeros((2, 0, 2)), np.zeros((2, 1, 0)), rng.normal(size=(2, 1, 2)),
                             lpv.Polynomial("current", 1).bound(BOX), 0.01, BOX)
    block = content(gain, "modelica").files["lpv_model.mo"].decode().split("model Check")[0]
    assert "when" not in block and "der(" not in block and 'input Real current(unit = "A")' in block


def test_words_of_modelica_are_no_names(rumoca):
    b = StepBuilder("flow", "names that Modelica keeps for itself", 0.01)
    u, x = b.input("input", "N*s/m"), b.states("record", np.array([[1.0, 2.0], [3.0, 4.0]]))
    with b.loop("end", 2) as i, b.loop("time", 2) as j:
        b.set(x[i, j], 0.5 * x[i, j] + u)
    b.output("der", x[1, 0], "m/s")
    program = b.program()
    from lpvid.export.exportable import Exportable, within
    from lpvid.export.python_printer import run

    found = Exportable(program, lambda u: run(program, u), lambda n, rng: within(n, [-1.0], [1.0], rng), None)
    made = modelica_content(found)
    assert made.passed, made.checks
    assert spelled("flow") == "flow_" and 'unit = "kg.s-1"' in made.files["flow.mo"].decode()


def test_single_precision_is_refused(rng):
    with pytest.raises(InputError, match="double precision"):
        content(state_space(rng), "modelica", precision="float")
