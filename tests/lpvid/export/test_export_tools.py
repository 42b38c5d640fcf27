"""FMU, MATLAB, python-control and tables: against this package's simulation, by the tools themselves where they are."""

from __future__ import annotations

import csv
import ctypes
import io
import json
import re
import subprocess
import sys
import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest
from helpers.exported_models import (
    BOX,
    CASES,
    STAGES,
    continuous,
    needs_compiler,
    quasi,
    state_space,
    transfer_function,
)
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.cli.app import app
from lpvid.errors import InputError
from lpvid.export.c_build import compile_c
from lpvid.export.control_file import control_content
from lpvid.export.csv_tables import csv_content
from lpvid.export.exportable import Options, exportable
from lpvid.export.exporting import FORMS, content
from lpvid.export.matlab import find_octave, matlab_content

needs_octave = pytest.mark.skipif(find_octave() is None, reason="GNU Octave is not installed")


# -- FMU -------------------------------------------------------------------------------------------------------------
@pytest.fixture
def fmpy():
    return pytest.importorskip("fmpy", reason="the extra 'fmu' is not installed")


@pytest.mark.thinned(2)
@needs_compiler
@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("case", ["square, tanh", "limited"])
def test_an_fmu_is_valid_and_agrees(case, version, fmpy, rng):
    made = content(CASES[case](rng), f"fmu{version}")
    assert made.passed and "valid; " in made.checks[0]


@pytest.mark.seconds
@needs_compiler
@pytest.mark.parametrize("of", [state_space, continuous])
def test_a_library_of_fmi_3_has_every_function_of_the_standard(of, fmpy, tmp_path, rng):
    made = lpv.export_fmu(of(rng), tmp_path, version=3, name="plant")
    with zipfile.ZipFile(made.files[0]) as archive:
        library = ctypes.CDLL(archive.extract("binaries/x86_64-linux/plant.so", tmp_path))
        types = archive.read("sources/fmi3FunctionTypes.h").decode()
    functions = re.findall(r"(fmi3\w+)TYPE", types)
    assert len(functions) > 70 and not [f for f in functions if not hasattr(library, f)]
    library.fmi3GetBinary.restype = ctypes.c_int
    assert library.fmi3GetBinary(None, None, 0, None, None, 0) == 3  # fmi3Error


@pytest.mark.thinned(2, "slow", "seconds")
@needs_compiler
@pytest.mark.parametrize("version", [2, 3])
def test_an_fmu_has_units_starts_and_sources_that_compile(version, fmpy, tmp_path, rng):
    model = transfer_function(rng, "square", "tanh", "lag", outputs=("force", "torque"))
    made = lpv.export_fmu(model, tmp_path, version=version, name="damper")
    described = fmpy.read_model_description(str(made.files[0]))
    named = {v.name: v for v in described.modelVariables}
    assert named["current"].unit == "A" and named["current"].causality == "input"
    assert float(named["knee"].start) == STAGES["tanh"].v0 and named["knee"].variability == "tunable"
    assert float(named["a[2,1,2,3]"].start) == model.a[1, 0, 1, 2]
    assert named["force"].causality == "output" and named["started"].causality == "local"
    assert float(described.defaultExperiment.stepSize) == model.sample_time
    with zipfile.ZipFile(made.files[0]) as archive:
        archive.extractall(tmp_path)
        tree = ElementTree.fromstring(archive.read("modelDescription.xml"))
        assert [u.get("name") for u in tree.iter("Unit")] == ["A"]
        assert b"2-Clause BSD" in archive.read(f"sources/fmi{version}Functions.h")
    compile_c(sorted((tmp_path / "sources").glob("*.c")), tmp_path / "again.so", ("-shared", "-fPIC"))


@pytest.mark.seconds
@needs_compiler
@pytest.mark.parametrize("version", [2, 3])
def test_parameters_can_be_set_and_a_step_must_fit_the_period(version, fmpy, tmp_path, rng):
    model = state_space(rng, "square")
    made = lpv.export_fmu(model, tmp_path, version=version)
    path, t = str(made.files[0]), model.sample_time

    def last(**more):
        run = fmpy.simulate_fmu(path, stop_time=20 * t, fmi_type="CoSimulation", output=["y1"], **more)
        return float(run["y1"][-1])

    plain = last(step_size=t, output_interval=t, start_values={"u1": 1.0})
    doubled = last(step_size=t, output_interval=t, start_values={"u1": 1.0, "C[1,1,1]": 2 * model.C[0, 0, 0]})
    assert plain != doubled
    assert last(step_size=5 * t, output_interval=5 * t, start_values={"u1": 1.0}) == pytest.approx(plain, rel=1e-12)
    with pytest.raises(Exception, match=r"(?i)step"):
        last(step_size=1.5 * t, output_interval=1.5 * t)


@pytest.mark.thinned(2, "seconds")
@needs_compiler
@pytest.mark.parametrize("version", [2, 3])
def test_a_channel_whose_name_is_no_identifier_keeps_it_in_a_valid_fmu(version, fmpy, tmp_path, rng):
    model = state_space(rng, "square", inputs=("motor current", "gas (N2)"), outputs=("gimbal speed", "Kraft/Weg"))
    made = lpv.export_fmu(model, tmp_path, version=version)
    assert made.passed, made.checks
    described = fmpy.read_model_description(str(made.files[0]))
    assert {"motor current", "gas (N2)", "gimbal speed", "Kraft/Weg"} <= {v.name for v in described.modelVariables}


@pytest.mark.seconds
@needs_compiler
def test_an_input_and_an_output_of_one_name_are_told_apart(fmpy, rng):
    model = state_space(rng, "square", inputs=("force", "speed"), outputs=("force", "speed"))
    made = content(model, "fmu2")
    assert made.passed


def test_an_fmu_is_of_double_precision_and_of_a_known_version(tmp_path, rng):
    with pytest.raises(InputError, match="double precision"):
        content(state_space(rng), "fmu2", precision="float")
    with pytest.raises(InputError, match="FMI 2 or 3"):
        lpv.export_fmu(state_space(rng), tmp_path, version=1)


# -- continuous models -----------------------------------------------------------------------------------------------


@pytest.mark.thinned(2, "slow", "seconds")
@needs_compiler
@pytest.mark.parametrize("version", [2, 3])
def test_a_continuous_model_goes_to_model_exchange(version, fmpy, tmp_path, rng):
    made = lpv.export_fmu(continuous(rng), tmp_path, name="plant", version=version)
    assert "valid" in made.checks[0] and float(made.checks[0].split()[-1]) < 1e-12
    described = fmpy.read_model_description(str(made.files[0]))
    assert described.coSimulation is None and described.numberOfContinuousStates == 2
    rate = next(v for v in described.modelVariables if v.name == "der(x[2])")
    assert rate.derivative.name == "x[2]"


@pytest.mark.thinned(2, "slow", "seconds")
@needs_compiler
@pytest.mark.parametrize("version", [2, 3])
def test_model_exchange_gives_the_step_response_of_the_frozen_model(version, fmpy, tmp_path, rng):
    """An oracle beside our own derivatives: the matrix exponential, by an importer's integration."""
    from scipy.linalg import expm

    model = continuous(rng).replace(state_offset=np.zeros((2, 2)))
    made = lpv.export_fmu(model, tmp_path, version=version)
    run = fmpy.simulate_fmu(str(made.files[0]), stop_time=2.0, fmi_type="ModelExchange", output=["y1"],
                            start_values={"velocity": 1.0, "rho": 0.5}, relative_tolerance=1e-9, output_interval=0.1)
    a, b, c, d = model.frozen([0.5])
    block = np.block([[a, b], [np.zeros((1, 3))]])
    wanted = [(c @ expm(block * t)[:2, 2:] + d)[0, 0] for t in run["time"]]
    assert np.abs(run["y1"] - wanted).max() < 1e-6 * np.abs(wanted).max()


@pytest.mark.seconds
def test_a_continuous_model_has_no_other_form(rng):
    for form in ("c", "matlab", "control", "csv"):
        with pytest.raises(InputError, match="fmu2"):
            content(continuous(rng), form)
        if form != "matlab":
            assert content(continuous(rng), form, Options(sample_time=0.02)).passed
    with pytest.raises(InputError, match="not held"):
        content(continuous(rng), "fmu2", Options(at={"rho": 0.5}))
    still = continuous(rng)
    gain = lpv.LPVStateSpace(np.zeros((2, 0, 0)), np.zeros((2, 0, 1)), np.zeros((2, 1, 0)), still.D, still.basis, None,
                             still.box)
    with pytest.raises(InputError, match="nothing to integrate"):
        content(gain, "fmu2")


# -- MATLAB ----------------------------------------------------------------------------------------------------------
@needs_octave
@pytest.mark.parametrize("case", ["transfer function", "product", "limited", "compliance"])
def test_octave_agrees_with_the_simulation(case, rng):
    made = matlab_content(exportable(CASES[case](rng)))
    assert made.passed, made.checks
    assert len(made.checks) == (1 if case == "compliance" else 3)


@pytest.mark.slow
@needs_octave
@pytest.mark.parametrize("case", CASES)
def test_octave_agrees_for_every_kind(case, rng):
    assert matlab_content(exportable(CASES[case](rng))).passed


def test_the_mat_file_reads_back(rng, monkeypatch):
    from scipy.io import loadmat

    monkeypatch.setattr("lpvid.export.matlab.find_octave", lambda: None)
    model = state_space(rng, "square", inputs=("velocity", "force"))
    made = matlab_content(exportable(model))
    held = loadmat(io.BytesIO(made.files["lpv_model.mat"]), squeeze_me=True, struct_as_record=False)["lpv_model"]
    assert held.units.inputs[2] == "A" and not len(held.units.inputs[0])
    assert held.names.inputs.tolist() == ["velocity", "force", "current"]
    assert held.sample_time == model.sample_time and held.p.A.shape == model.A.shape
    for k, point in enumerate(held.grid.points):
        for name, wanted in zip("ABCD", model.frozen([point]), strict=True):
            assert np.array_equal(getattr(held.grid, name)[:, :, k], wanted)
    assert "InputName" in made.files["lpv_model_load.m"].decode() and "not run" in made.checks[0]
    dynamic = matlab_content(exportable(transfer_function(rng, "dynamic")))
    assert "lpv_model_data.m" not in dynamic.files and any("No lpvss form" in n for n in dynamic.notes)


# -- python-control and tables ---------------------------------------------------------------------------------------
@pytest.mark.parametrize("case", CASES)
def test_python_control_agrees(case, rng):
    assert control_content(exportable(CASES[case](rng))).passed


@pytest.mark.seconds
def test_the_file_for_python_control_stands_alone(tmp_path, rng):
    made = lpv.export_control(transfer_function(rng, "cubic", "tanh", "late"), tmp_path, name="damper")
    code = ("import sys; sys.path.insert(0, '.'); import damper_control as d; s = d.system(); "
            "assert not any(n.startswith('lpvid') for n in sys.modules); print(s.nstates, s.input_labels)")
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True,
                          env={"PATH": "/usr/bin:/bin"})
    assert made.files[0].name == "damper_control.py" and "['velocity', 'current']" in done.stdout
    system, rest = lpv.control_system(quasi(rng))
    assert system.nstates == rest.size and system.dt == 0.002


def test_tables_come_back_bit_for_bit(rng):
    model = state_space(rng, "square")
    made = csv_content(exportable(model))
    rows = list(csv.DictReader(io.StringIO(made.files["lpv_model_parameters.csv"].decode())))
    values = {(r["name"], r["index"]): float(r["value"]) for r in rows}
    assert values["A", "2 1 3"] == model.A[1, 0, 2] and len(rows) == sum(m.size for m in (
        model.A, model.B, model.C, model.D, model.state_offset))
    frozen = list(csv.DictReader(io.StringIO(made.files["lpv_model_frozen.csv"].decode())))
    top = [r for r in frozen if float(r["current [A]"]) == BOX.upper[0] and r["matrix"] == "A" and r["row"] == "2"]
    assert [float(r["value"]) for r in top] == model.frozen([BOX.upper[0]])[0][1].tolist()
    head = made.files["lpv_model_trajectory.csv"].decode().splitlines()[0]
    assert head == "time [s],u1 [1],u2 [1],current [A],y1 [1],y2 [1]"


@pytest.mark.parametrize("form", sorted(set(FORMS) - {"c"}))
def test_single_precision_is_refused_by_every_form_that_computes_in_double(tmp_path, rng, form):
    model = lpv.save(state_space(rng), tmp_path / "model.json")
    done = run(model, "--to", form, "--precision", "float", "--out", tmp_path / "out")
    assert done.exit_code == 2 and "double precision" in done.stderr and done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


# -- command line ----------------------------------------------------------------------------------------------------
def run(*arguments):
    return CliRunner().invoke(app, ["export", *map(str, arguments)])


def test_the_command_writes_every_form_or_nothing(tmp_path, rng):
    model = lpv.save(state_space(rng), tmp_path / "model.json")
    done = run(model, "--to", "csv", "--out", tmp_path / "csv", "--name", "plant", "--json")
    assert done.exit_code == 0 and json.loads(done.stdout)["schema"] == "lpvid/export/1"
    assert sorted(p.name for p in (tmp_path / "csv").glob("*.csv")) == [
        "plant_frozen.csv", "plant_parameters.csv", "plant_trajectory.csv"]
    done = run(model, "--to", "word", "--out", tmp_path / "word")
    assert done.exit_code == 2 and ", ".join(FORMS) in done.stderr and not (tmp_path / "word").exists()
    done = run(model, "--to", "c", "--precision", "half", "--out", tmp_path / "half")
    assert done.exit_code == 2 and not (tmp_path / "half").exists()
    assert run(model, "--sample-rate", "-1").exit_code == 2


@pytest.mark.seconds
@needs_compiler
def test_limits_from_the_command_line(tmp_path, rng):
    model = lpv.save(state_space(rng, state_offset=None), tmp_path / "model.json")
    done = run(model, "--limit", "y1=0.8", "--limit", "y2=-0.3:5", "--anti-windup", "0.05", "--out", tmp_path / "c")
    assert done.exit_code == 0 and "self-test passed" in done.stdout
    text = (tmp_path / "c" / "controller.h").read_text()
    assert "y2_lowest" in text and "anti-windup gain" in text
    for wrong in (("--anti-windup", "1"), ("--limit", "y1"), ("--limit", "y1=a:b"), ("--limit", "y3=1")):
        assert run(model, *wrong).exit_code == 2


def test_a_model_that_cannot_be_exported_is_one_line(tmp_path, rng):
    model = lpv.save(state_space(rng).replace(sample_time=None), tmp_path / "model.json")
    done = run(model, "--to", "c", "--out", tmp_path / "c")
    assert done.exit_code == 2 and "--sample-rate" in done.stderr and len(done.stderr.splitlines()) == 1
