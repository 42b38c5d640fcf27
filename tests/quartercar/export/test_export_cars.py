"""Dampers, control laws and loop laws as step programs: against their own simulation, in Python and in C."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from lpvid.errors import InputError
from lpvid.export.c_build import find_compiler, run_self_test
from lpvid.export.c_source import c_files
from lpvid.export.exportable import Options
from lpvid.export.expression import call
from lpvid.export.matlab import find_octave
from lpvid.export.python_printer import run
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial, Product, Scheduling, Spline
from quartercar.controllers import LAWS, law_class
from quartercar.controllers.contract import Setting
from quartercar.controllers.designed.schedule_rules import Excess, GivenShare, Measured, Rule, SaturationRatio, Yield
from quartercar.controllers.designed.scheduled import ScheduledController
from quartercar.controllers.loop.chain import ChainSettings
from quartercar.controllers.loop.inverse import InverseSettings
from quartercar.controllers.loop.sensing import SETS
from quartercar.dampers import (
    BoucWen,
    ExtendedBoucWen,
    ForceMap,
    Guo,
    Guo5,
    Guo6,
    Guo7,
    Guo15,
    Kwok,
    Linear,
    LpvArx,
    PowerLaw,
    PowerLawFrictionGas,
    ReliefValve,
    WangKamath,
)
from quartercar.export import EXPORTER
from quartercar.export.loop_steps import LoopLaw
from quartercar.parameters import MEGANE
from quartercar.rides.default_damper import identified_damper
from quartercar.vehicle.nonlinear import Coil

RANGE = {"current_range": (0.0, 2.0)}
DAMPERS = {
    "guo": Guo(), "guo, quadratic, reversed": Guo(degree=2, hysteresis=False, polarity=-1, **RANGE),
    "guo-5": Guo5(**RANGE), "guo-6": Guo6(centre=0.004, **RANGE), "guo-7": Guo7(offset=True, **RANGE),
    "guo-15": Guo15(**RANGE), "kwok": Kwok(), "kwok, affine": Kwok(degree=1, **RANGE), "power-law": PowerLaw(),
    "power-law-friction-gas": PowerLawFrictionGas(), "linear": Linear(), "force-map": ForceMap(),
    "force-map, edges": ForceMap(nodes=(0.0, 1.0, 2.0), lag="edges", **RANGE),
    "force-map, no lag": ForceMap(nodes=(0.0, 2.0), lag="none", **RANGE), "extended-bouc-wen": ExtendedBoucWen(),
    "extended-bouc-wen, full": ExtendedBoucWen(nodes=(0.1, 0.5, 1.6), **RANGE),
    "extended-bouc-wen, reversed": ExtendedBoucWen(nodes=(0.1, 0.5), exponent=1.4, polarity=-1, centre=0.01,
                                                   lag="shared", **RANGE),
}
needs_compiler = pytest.mark.skipif(find_compiler() is None, reason="no C compiler")


def export(noun, **options):
    assert EXPORTER.accepts(noun)
    return EXPORTER.prepare(noun, Options(**options))


def error(found, samples=150) -> float:
    u, y = found.trial(samples)
    scale = np.abs(y).max(axis=0)
    return float((np.abs(run(found.program, u) - y).max(axis=0) / np.where(scale > 0, scale, 1.0)).max())


@pytest.mark.parametrize("case", DAMPERS)
def test_a_damper_agrees_with_its_free_run(case):
    assert error(export(DAMPERS[case], sample_time=1e-3)) < 1e-13
    assert error(export(DAMPERS[case], sample_time=2.5e-3), 60) < 1e-13  # three sub-steps of extended Bouc-Wen


def test_a_stiff_extended_bouc_wen_agrees():
    law = ExtendedBoucWen(values={"sharpness_rebound": 1e6, "sharpness_compression": 2e4})
    assert error(export(law, sample_time=1e-3)) < 1e-12


def test_the_identified_damper_agrees_and_keeps_its_rate():
    assert error(export(identified_damper())) < 1e-12
    with pytest.raises(InputError, match="rate of its training data"):
        export(identified_damper(), sample_time=1e-3)


def test_a_clamped_current_stays_in_the_fitted_range():
    found = export(DAMPERS["kwok, affine"], clamp=True)
    u, _ = found.trial()
    assert u[:, -1].max() > 2.0 and error(found) < 1e-13


@pytest.mark.seconds
@needs_compiler
@pytest.mark.parametrize("case", ["guo-15", "kwok, affine", "force-map, edges", "extended-bouc-wen, full"])
def test_compiled_dampers_agree(case):
    found = export(DAMPERS[case])
    assert run_self_test(c_files(found)).passed
    single = run_self_test(c_files(found, "float"))
    assert single.passed and single.error < 1e-5


@pytest.mark.thinned(3, "slow", "seconds")
@needs_compiler
@pytest.mark.parametrize("damper", [BoucWen(**RANGE), BoucWen(scheduled=False, springs=False, free_exponent=True),
                                    BoucWen(centre=0.01, polarity=-1, **RANGE), WangKamath(),
                                    WangKamath(growing=True, **RANGE), WangKamath(degree=2, **RANGE)],
                         ids=["scheduled", "plain", "reversed", "one law", "growing", "quadratic"])
def test_dampers_without_a_step_go_to_model_exchange(damper):
    pytest.importorskip("fmpy", reason="the extra 'fmu' is not installed")
    from lpvid.export.fmu import flow_content

    flow = EXPORTER.flow(damper, Options())
    made = flow_content(flow, 2)
    assert made.passed, made.checks
    assert EXPORTER.flow(Guo(), Options()) is None


@pytest.mark.seconds
def test_rates_of_a_flow_move_its_states():
    """The trajectory along which rates are compared is no rest."""
    _, states = EXPORTER.flow(BoucWen(**RANGE), Options()).trial()
    assert np.ptp(states[:, 1]) > 1.5 and np.ptp(states[:, 2]) > 0.5


def scheduled(rng, **more) -> ScheduledController:
    basis = Product(Product(Spline("a", 2, 1, (0.0, 0.5, 1.0)), Polynomial(("c", "d"), 1)), Polynomial(("e", "f"), 1))
    box = Scheduling(("a", "c", "d", "e", "f"), (0.0, -1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 10.0, 1.0, 1.5))
    m = basis.size
    model = LPVStateSpace(0.02 * rng.normal(size=(m, 3, 3)) / m, rng.normal(size=(m, 3, 2)),
                          5 * rng.normal(size=(m, 1, 3)), 5 * rng.normal(size=(m, 1, 2)), basis, 0.002, box,
                          inputs=("suspension_velocity", "body_velocity"), outputs=("u",))
    rules = (SaturationRatio(0.1), Yield(3.0, 10.0), Excess(3000.0, smoothing=0.01), GivenShare(1500.0, 0.2),
             Yield(2.0, 1.0, ratio=True))
    return ScheduledController(model=model, schedule=rules, nominal_damping=1500.0, around=10.0,
                               anti_windup=1e-3 * rng.normal(size=3), values={"gain": 0.7}, **more)


def test_a_scheduled_controller_agrees_with_every_rule(rng):
    found = export(scheduled(rng))
    assert error(found) < 1e-12
    with pytest.raises(InputError, match="always holds"):
        export(scheduled(rng), clamp=False)
    with pytest.raises(InputError, match="designed for one rate"):
        export(scheduled(rng), sample_time=0.001)


def test_a_controller_without_a_schedule_or_states(rng):
    gain = LPVStateSpace(np.zeros((1, 0, 0)), np.zeros((1, 0, 1)), np.zeros((1, 1, 0)), [[[300.0]]], Polynomial(),
                         0.002, inputs=("body_velocity",), outputs=("u",))
    assert error(export(ScheduledController(model=gain))) < 1e-14
    follow = LPVStateSpace(np.zeros((2, 0, 0)), np.zeros((2, 0, 1)), np.zeros((2, 1, 0)), [[[300.0]], [[40.0]]],
                           Polynomial("v", 1), 0.002, Scheduling(("v",), (-0.2,), (0.2,)), inputs=("body_velocity",),
                           outputs=("u",))
    assert error(export(ScheduledController(model=follow, schedule=(Measured("suspension_velocity"),)))) < 1e-14


class Blind(Rule):
    """ρ = |v_d|, by a package that wrote no expression for it."""

    kind = "blind"
    reads = ("suspension_velocity",)

    def start(self, setting):
        return lambda seen: np.abs(seen["suspension_velocity"])


class Written(Blind):
    """The same with its expression."""

    kind = "written"

    def expression(self, b, seen):
        return call("fabs", seen["suspension_velocity"])


def test_a_rule_of_another_package_is_exported_by_its_own_expression():
    gain = LPVStateSpace(np.zeros((2, 0, 0)), np.zeros((2, 0, 1)), np.zeros((2, 1, 0)), [[[300.0]], [[40.0]]],
                         Polynomial("v", 1), 0.002, Scheduling(("v",), (0.0,), (0.5,)), inputs=("body_velocity",),
                         outputs=("u",))
    assert error(export(ScheduledController(model=gain, schedule=(Written(),)))) < 1e-14
    with pytest.raises(InputError, match="no exported step"):
        export(ScheduledController(model=gain, schedule=(Blind(),)))


@pytest.mark.parametrize("name", [n for n, _, _ in LAWS if n not in
                                  ("clipped-optimal", "pdd", "preview-lqr", "preview-lpv", "mpc", "lpv-hinf",
                                   "lpv-hinf-clipped", "scheduled", "lpv-hinf-identified", "identified-plant")])
def test_a_law_agrees(name):
    assert error(export(law_class(name)())) < 1e-14


@pytest.mark.parametrize("name,mend", [("clipped-optimal", "LoopLaw"), ("pdd", "LoopLaw"),
                                       ("mpc", "road ahead"), ("preview-lqr", "LoopLaw"),
                                       ("preview-lpv", "LoopLaw"),
                                       ("lpv-hinf", "quartercar design"),
                                       ("lpv-hinf-identified", "--plant nominal")])
def test_a_law_that_needs_its_car_says_so(name, mend):
    with pytest.raises(InputError, match=mend):
        export(law_class(name)())


def ahead(law, preview, damper="guo", sensors="stroke-body"):
    return LoopLaw(law_class(law)(), Setting(0.002, 1, MEGANE, INVERSES[damper], (0.0, 2.0), preview=preview),
                   Coil(0.005, 0.01, 0.0, 2.0), ChainSettings(SETS[sensors]))


def test_a_loop_that_searches_ahead_says_so():
    with pytest.raises(InputError, match=r"searches over the road ahead.*preview-lpv"):
        export(ahead("mpc", 12))


@pytest.mark.parametrize("sensors", ["stroke-body", "ideal"])
@pytest.mark.parametrize("preview", [0, 1, 23])
@pytest.mark.parametrize("law", ["preview-lqr", "preview-lpv"])
def test_a_law_with_a_register_of_the_road_agrees_with_the_chain_of_a_ride(law, preview, sensors):
    """Every sample of the register is an input; the observer's step has the rate that it had for the sample passed."""
    found = export(ahead(law, preview, sensors=sensors))
    names = [q.label for q in found.program.inputs]
    assert sum(n.startswith("road_ahead_") for n in names) == preview
    assert error(found) < 1e-9  # of gains over states with nine digits between them


def test_an_observer_alone_takes_one_sample_of_the_road():
    found = export(ahead("skyhook", 23))
    assert [q.label for q in found.program.inputs][-1] == "road_ahead_1"
    assert error(found) < 1e-12


@pytest.mark.seconds
@needs_compiler
def test_a_compiled_law_with_a_register_agrees():
    assert run_self_test(c_files(export(ahead("preview-lpv", 69)))).error < 1e-9


@pytest.mark.seconds
def test_the_command_exports_a_law_with_a_register(tmp_path):
    from typer.testing import CliRunner

    from quartercar.cli.app import app

    def run(law, *more):
        return CliRunner().invoke(app, ["export", "--controller", law, "--to", "csv", *more, "--out",
                                        str(tmp_path / "loop"), "--json"])

    done = run("preview-lpv")
    assert done.exit_code == 2 and "--road-ahead 69" in done.output and not (tmp_path / "loop").exists()
    assert run("skyhook", "--road-ahead", "3").exit_code == 2 and not (tmp_path / "loop").exists()
    assert run("preview-lpv", "--road-ahead", "69").exit_code == 0
    header = (tmp_path / "loop" / "loop_trajectory.csv").read_text().splitlines()[0]
    assert "road_ahead_69" in header


@pytest.mark.parametrize("damper,nearest", [(BoucWen(), "extended-bouc-wen"), (WangKamath(), "extended-bouc-wen"),
                                            (ReliefValve(), "force-map"), (LpvArx(), "fit it"),
                                            (Linear(values={"mass": 3.0}), "mass=0")])
def test_a_damper_without_a_step_names_the_nearest(damper, nearest):
    with pytest.raises(InputError, match=nearest) as stated:
        export(damper)
    assert "\n" not in str(stated.value)


INVERSES = {None: None, "guo": Guo(degree=1, span=(0.0, 2.0)), "extended-bouc-wen": ExtendedBoucWen(nodes=(0.0, 2.0)),
            "identified": identified_damper()}
LOOPS = {"skyhook, led": ("skyhook", "stroke-body", InverseSettings(lag_compensated=True)),
         "clipped-optimal": ("clipped-optimal", "stroke-body-wheel", InverseSettings()),
         "pdd, ideal": ("pdd", "ideal", InverseSettings(points=7)),
         "passive": ("passive", "stroke-body", InverseSettings())}


def loop(damper, case) -> LoopLaw:
    law, sensors, inverse = LOOPS[case]
    known = INVERSES[damper]
    period = 1 / 512 if damper == "identified" else 0.002
    return LoopLaw(law_class(law)(), Setting(period, 1, MEGANE, known, (0.0, 2.0)), Coil(0.005, 0.01, 0.0, 2.0),
                   ChainSettings(SETS[sensors], inverse=inverse))


@pytest.mark.thinned(3)
@pytest.mark.parametrize("case", LOOPS)
@pytest.mark.parametrize("damper", INVERSES)
def test_a_loop_law_agrees_with_the_chain_of_a_ride(damper, case):
    """Observer, law and inverse damper, from readings to current."""
    assert error(export(loop(damper, case))) < 1e-12


@pytest.mark.seconds
@needs_compiler
def test_a_compiled_loop_law_agrees():
    found = export(loop("guo", "clipped-optimal"))
    assert run_self_test(c_files(found)).error < 1e-12
    assert run_self_test(c_files(found, "float")).passed


def test_a_scheduled_controller_in_the_loop_agrees(rng):
    known = INVERSES["guo"]
    assert error(export(LoopLaw(scheduled(rng), Setting(0.002, 1, MEGANE, known, (0.0, 2.0)), Coil(highest=2.0)))
                 ) < 1e-10


@pytest.mark.seconds
def test_the_command_exports_a_loop_law(tmp_path):
    from typer.testing import CliRunner

    from quartercar.cli.app import app

    done = CliRunner().invoke(app, ["export", "--controller", "pdd", "--to", "csv", "--measurements",
                                    "stroke-body-wheel",
                                    "--out", str(tmp_path / "loop"), "--json"])
    assert done.exit_code == 0 and json.loads(done.stdout)["files"] == ["loop_parameters.csv", "loop_trajectory.csv"]
    for wrong in (["--controller", "nothing"], ["--damper", "no.json"], ["--measurements", "all"], ["no.toml"]):
        done = CliRunner().invoke(app, ["export", *wrong, "--out", str(tmp_path / "none")])
        assert done.exit_code == 2 and not (tmp_path / "none").exists()


def test_a_loop_law_refuses_what_its_sensors_do_not_show_and_a_look_ahead():
    with pytest.raises(InputError, match="does not provide"):
        export(LoopLaw(law_class("sh-add")(), Setting(0.002, 1, MEGANE, None, (0.0, 2.0)), Coil(highest=2.0),
                       ChainSettings(_deflection_only())))
    ahead = LoopLaw(law_class("skyhook")(), Setting(1 / 512, 1, MEGANE, identified_damper(), (0.0, 2.0)),
                    Coil(highest=2.0), ChainSettings(inverse=InverseSettings(steps=2)))
    with pytest.raises(InputError, match="steps=0"):
        export(ahead)


def _deflection_only():
    from quartercar.controllers.loop.sensing import MeasurementSet, Sensor

    return MeasurementSet("two", (Sensor("suspension_deflection", 1e-4), Sensor("wheel_acceleration", 0.1)))


def test_the_entry_point_names_this_exporter():
    text = (Path(__file__).resolve().parents[3] / "pyproject.toml").read_text()
    assert re.search(r'\[project\.entry-points\."lpvid\.exports"\]\nquartercar = "quartercar\.export:EXPORTER"', text)


@pytest.mark.seconds
def test_a_damper_file_is_exported_from_the_command_line(tmp_path):
    from typer.testing import CliRunner

    from lpvid.cli.app import app
    from lpvid.export.exportable import exporters
    from lpvid.export.serialise import save

    if len(exporters()) < 2:
        pytest.skip("the installed package does not name its entry points yet")
    path = save(DAMPERS["kwok, affine"], tmp_path / "damper.json")
    done = CliRunner().invoke(app, ["export", str(path), "--out", str(tmp_path / "c"), "--sample-rate", "500",
                                    "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["files"] == ["kwok.h", "kwok.c", "kwok_test.c"]
    assert "(0.002)" in (tmp_path / "c" / "kwok.h").read_text()
    save(BoucWen(), path)
    done = CliRunner().invoke(app, ["export", str(path), "--out", str(tmp_path / "d")])
    assert done.exit_code == 2 and "extended-bouc-wen" in done.stderr and not (tmp_path / "d").exists()


@pytest.mark.thinned(3)
@pytest.mark.parametrize("case", ["guo-7", "kwok, affine", "power-law-friction-gas", "force-map, edges",
                                  "extended-bouc-wen, full"])
def test_dampers_in_modelica_agree(case):
    """Static laws as algebraic models, those with states by their samples; run by another's compiler."""
    pytest.importorskip("rumoca", reason="the extra 'modelica' is not installed")
    from lpvid.export.modelica import modelica_content

    found = export(DAMPERS[case])
    made = modelica_content(found)
    assert made.passed, made.checks
    block = made.files[f"{found.program.name}.mo"].decode().split("model Check")[0]
    assert ("when" in block) == bool(found.program.states)


@pytest.mark.parametrize("damper", [BoucWen(**RANGE), WangKamath()], ids=["bouc-wen", "wang-kamath"])
def test_dampers_with_smooth_rates_in_modelica_agree(damper):
    pytest.importorskip("rumoca", reason="the extra 'modelica' is not installed")
    from lpvid.export.modelica import modelica_flow_content

    assert modelica_flow_content(EXPORTER.flow(damper, Options())).passed


def test_a_loop_law_in_modelica_agrees():
    pytest.importorskip("rumoca", reason="the extra 'modelica' is not installed")
    from lpvid.export.modelica import modelica_content

    assert modelica_content(export(loop("guo", "clipped-optimal"))).passed


@pytest.mark.skipif(find_octave() is None, reason="GNU Octave is not installed")
@pytest.mark.parametrize("case", ["extended-bouc-wen, full", "force-map, edges", "power-law", "guo-15"])
def test_octave_runs_the_dampers(case):
    """A local value named as a function of MATLAB would hide it there."""
    from lpvid.export.matlab import matlab_content

    made = matlab_content(export(DAMPERS[case]))
    assert made.passed, made.checks
