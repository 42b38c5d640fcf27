"""Models as C99: every part against this package's simulation, by Python, by gcc and clang, with sanitizers."""

from __future__ import annotations

import re
import shutil
import subprocess

import numpy as np
import pytest
from helpers.exported_models import (
    BASES,
    BOX,
    LAGS,
    STAGES,
    compliance,
    needs_compiler,
    quasi,
    state_space,
    transfer_function,
)

import lpvid as lpv
from lpvid import Polynomial, Scheduling, Shifted
from lpvid.errors import InputError, NumericalError
from lpvid.export.c_build import run_self_test
from lpvid.export.c_source import c_files
from lpvid.export.exportable import Options, exportable
from lpvid.export.exporting import export_c
from lpvid.export.python_printer import run
from lpvid.export.step_program import LoopStatement, walk
from lpvid.model.designed import designed
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization import realize
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.saturated import saturate

STRICT = ("-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Wstrict-prototypes", "-Wmissing-prototypes")


def error(found, samples=120) -> float:
    u, y = found.trial(samples)
    return float(np.abs(run(found.program, u) - y).max() / np.abs(y).max())


@pytest.mark.thinned(3)
@pytest.mark.parametrize("lagged", [False, True], ids=["at k", "at k-i"])
@pytest.mark.parametrize("basis", BASES)
def test_every_basis_of_a_transfer_function(basis, lagged, rng):
    for stage in STAGES:
        for lag in LAGS:
            assert error(exportable(transfer_function(rng, basis, stage, lag, lagged)), 60) < 1e-13, (stage, lag)


@pytest.mark.parametrize("basis", BASES)
def test_every_basis_of_a_state_space(basis, rng):
    model = state_space(rng, basis)
    assert error(exportable(model)) < 1e-13
    assert error(exportable(model, Options(clamp=True))) < 1e-13


@pytest.mark.parametrize("form", ["controllable", "observable", "augmented"])
def test_realisations(form, rng):
    model = LPVTransferFunction.siso([[-0.9, 0.1], [0.3, 0.05]], [[0, 0], [0.1, 0.2]], BASES["grid"].__class__(
        "current", 1, 1).bound(BOX), 0.002, scheduling=BOX, lagged=form == "observable")
    assert error(exportable(realize(model, form))) < 1e-12


@pytest.mark.parametrize("on", ["output", "trial", "input"])
@pytest.mark.parametrize("polynomial", [False, True], ids=["hats", "powers"])
def test_quasi_lpv(on, polynomial, rng):
    assert error(exportable(quasi(rng, on, polynomial))) < 1e-13


@pytest.mark.parametrize("elements", [1, 2])
def test_a_law_in_series_with_a_spring(elements):
    assert error(exportable(compliance(elements))) < 1e-13


def test_limits_and_anti_windup_act_and_agree(rng):
    law = saturate(designed(state_space(rng, state_offset=None), "controller"), {"y1": 0.8, "y2": (-0.3, 5.0)},
                   0.1 * rng.normal(size=(3, 2)))
    found = exportable(law)
    u, y = found.trial()
    assert error(found) < 1e-13
    assert np.mean(np.abs(y[:, 0]) == 0.8) > 0.1  # the limit is reached
    assert np.any((u[:, -1] > 2.5) | (u[:, -1] < 0.0))  # so is an end of the box, beyond which p is held


def test_a_designed_controller_is_clamped_and_a_model_is_not(rng):
    model = state_space(rng)
    assert exportable(designed(model, "controller")).program.notes == ("The scheduling is held inside its box.",)
    assert exportable(model).program.notes == ()


def test_loops_have_constant_bounds(rng):
    program = exportable(transfer_function(rng, "cubic", "tanh", "late")).program
    assert all(
        isinstance(s.first, int) and isinstance(s.last, int) for s in walk(program.body) if isinstance(s, LoopStatement)
    )
    assert 100 < program.operations() < 400


CASES = {"transfer function": lambda rng: transfer_function(rng, "cubic", "zones", "late", True),
         "state space": lambda rng: state_space(rng, "fourier"), "quasi": quasi, "compliance": lambda rng: compliance(),
         "limited": lambda rng: saturate(state_space(rng, "grid", state_offset=None), {"y1": 0.8},
                                         0.1 * rng.normal(size=(3, 2)))}


@pytest.mark.thinned(3, "slow", "seconds")
@needs_compiler
@pytest.mark.parametrize("case", CASES)
def test_compiled_as_asked_it_agrees(case, rng):
    found = exportable(CASES[case](rng))
    double = run_self_test(c_files(found), STRICT)
    single = run_self_test(c_files(found, "float"), STRICT)
    assert double.passed and double.error < 1e-12
    assert single.passed and 1e-9 < single.error < 1e-5  # single precision indeed
    assert single.state_bytes < double.state_bytes


@pytest.mark.seconds
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_sanitizers_and_both_compilers_have_nothing_to_say(compiler, rng):
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler}")
    for precision in ("double", "float"):
        files = c_files(exportable(transfer_function(rng, "quintic", "tanh", "late")), precision)
        assert run_self_test(files, (*STRICT, "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover"),
                             compiler).passed


def misra(files: dict[str, str], folder) -> set[str]:
    """Rules of MISRA C:2012 that cppcheck finds broken in a header and its source."""
    names = [n for n in files if not n.endswith("_test.c")]
    for name in names:
        (folder / name).write_text(files[name], encoding="utf-8")
    source = next(n for n in names if n.endswith(".c"))
    done = subprocess.run(["cppcheck", "--addon=misra", "--std=c99", "--enable=style", "--template={id}", source],
                          cwd=folder, capture_output=True, text=True, check=True)
    assert "misra-c2012" in done.stderr, done.stderr  # the addon was there
    return set(re.findall(r"misra-c2012-([\d.]+)", done.stderr))


@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="no cppcheck")
@pytest.mark.parametrize("case", CASES)
def test_of_misra_only_an_advisory_rule_is_broken(case, rng, tmp_path):
    """2.5: the macro of the period is there for the caller."""
    for precision in ("double", "float"):
        assert misra(c_files(exportable(CASES[case](rng)), precision), tmp_path) == {"2.5"}


@needs_compiler
def test_the_self_test_notices_a_wrong_coefficient(rng):
    files = c_files(exportable(state_space(rng)))
    broken = files["lpv_model.c"].replace("y->y1 = sum[0]", "y->y1 = sum[0] * 1.000001")
    assert broken != files["lpv_model.c"]
    found = run_self_test({**files, "lpv_model.c": broken})
    assert not found.passed and found.error == pytest.approx(1e-6, rel=0.5)


@needs_compiler
def test_two_instances_share_nothing(rng, tmp_path):
    """One header included twice from two translation units, two states interleaved: the same outputs."""
    found = exportable(transfer_function(rng, "square", "tanh", "lag"))
    main = """#include <stdio.h>
#include "lpv_model.h"
int main(void)
{
    lpv_model_states a, b;
    lpv_model_inputs u = {0.1, 1.0};
    lpv_model_outputs y, z;
    lpv_model_init(&a);
    lpv_model_init(&b);
    int same = 1;
    for (int k = 0; k < 20; k++) {
        u.velocity = 0.01 * (double)k;
        lpv_model_step(&lpv_model_defaults, &a, &u, &y);
        lpv_model_step(&lpv_model_defaults, &b, &u, &z);
        same = same && !(y.y1 < z.y1) && !(y.y1 > z.y1);
    }
    printf("relative error %d, limit 0, states 0 bytes, parameters 0 bytes\\n", 1 - same);
    return same ? 0 : 1;
}
"""
    assert run_self_test({**c_files(found), "lpv_model_test.c": main}).passed


@pytest.mark.seconds
def test_files_are_written_whole(rng, tmp_path):
    made = export_c(state_space(rng), tmp_path / "out", name="my_filter", precision="float")
    assert [p.name for p in made.files] == ["my_filter.h", "my_filter.c", "my_filter_test.c"]
    assert all(p.is_file() for p in made.files) and len(list((tmp_path / "out").iterdir())) == 3
    text = made.files[0].read_text()
    assert "typedef float my_filter_real;" in text and "[A]" in text and "MY_FILTER_SAMPLE_TIME (0.01f)" in text
    with pytest.raises(InputError, match="is a file"):
        export_c(state_space(rng), made.files[0])
    with pytest.raises(InputError, match="my_filter"):
        export_c(state_space(rng), tmp_path / "other", name="my filter")
    assert not (tmp_path / "other").exists()


def test_any_name_makes_files(rng):
    for name, wanted in (("end", "end_model"), ("2nd filter", "x2nd_filter"), ("δ", "x")):
        assert f"{wanted}.h" in c_files(exportable(state_space(rng), Options(name)))


def test_what_cannot_be_exported_names_the_nearest(rng):
    model = state_space(rng)
    with pytest.raises(InputError, match="discretised"):
        exportable(model.replace(sample_time=None))
    with pytest.raises(InputError, match="own rate only"):
        exportable(model, Options(sample_time=0.02))
    with pytest.raises(InputError, match="augmented"):
        exportable(LPVTransferFunction.siso([[0.1, 0.1]], [[1, 0]], Shifted(Polynomial("p", 1), -1), 0.1))
    with pytest.raises(InputError, match="affine"):
        exportable(saturate(model, {"y1": 1.0}))
    with pytest.raises(InputError, match="export a model"):
        exportable("nothing")
    with pytest.raises(InputError, match="must be one of double, float"):
        c_files(exportable(model), "half")
    with pytest.raises(InputError, match=r"unstable model.*Mend: identify again"):
        exportable(model.replace(A=50 * model.A)).trial(400)


def test_a_synthesis_exports_its_controller(rng):
    found = exportable(Synthesis("solved", controller=state_space(rng)))
    assert found.program.name == "controller" and error(found) < 1e-13
    with pytest.raises(NumericalError, match="no controller"):
        exportable(Synthesis("infeasible", why="no controller bounds the gain", mend="lower a weight"))


def test_a_held_scheduling_is_a_parameter(rng):
    model = transfer_function(rng, "cubic", "tanh", "late")
    found = exportable(model, Options(at={"current": 1.2}))
    assert [q.name for q in found.program.inputs] == ["velocity"] and found.program.parameters[0].name == "current"
    assert error(found) < 1e-13
    u, y = found.trial(50)
    whole = exportable(model)
    assert np.array_equal(y, whole.reference(np.column_stack([u, np.full(50, 1.2)])))
    for at, stated in (({"current": 9.0}, "outside 0 to 2.5"), ({"curent": 1.0}, "current"),
                     ({"current": 1.0, "velocity": 0.0}, "every input")):
        with pytest.raises(InputError, match=stated):
            exportable(model, Options(at=at))


def test_a_continuous_model_is_discretised_at_a_given_rate(rng):
    a = np.array([[[-1.0, 2.0], [-2.0, -3.0]], [[0.0, 1.0], [-1.0, -1.0]]])
    model = designed(LPVStateSpace(a, rng.normal(size=(2, 2, 1)), rng.normal(size=(2, 1, 2)), np.zeros((2, 1, 1)),
                                   Polynomial("rho", 1), None, Scheduling(("rho",), (0.0,), (1.0,))), "controller")
    found = exportable(model, Options(sample_time=0.01))
    assert found.program.sample_time == 0.01 and error(found) < 1e-13
    held, sampled = found.program.notes  # a controller's scheduling is held inside its box
    assert "held" in held and "output off by" in sampled


def test_the_header_states_no_unit_where_none_is_known(tmp_path):
    """Coefficients from m/s to N and a velocity scale are no pure numbers; a signal without unit is one."""
    model = lpv.LPVTransferFunction.siso([[-0.9, 0.1]], [[0, 0], [0.1, 0]], lpv.Polynomial("valve", degree=1), 0.01,
                                         inputs=(lpv.Signal("velocity", "m/s"),), outputs=(lpv.Signal("force", "N"),))
    lpv.export_c(model, tmp_path, name="unit")
    members = [m for m in (tmp_path / "unit.h").read_text().splitlines() if "unit_real" in m and "/**<" in m]
    coefficients = [m for m in members if "coefficients" in m]
    assert len(coefficients) == 2 and not any(m.endswith("[1] */") for m in coefficients)
    for name, unit in {"velocity": "m/s", "force": "N", "valve": "1"}.items():
        assert any(f"unit_real {name};" in m and m.endswith(f"[{unit}] */") for m in members)
