"""PLAN files: the template loads, the schema agrees with the reader, and every mistake is one line that names it."""

from __future__ import annotations

import json
import tomllib

import numpy as np
import pytest

from lpvid.errors import InputError
from lpvid.record import Record
from quartercar.rig import Plan, Rig, load_plan, parse_plan, plan_schema, plan_template, run_plan, write_csv

RUN = '[[experiments]]\npreset = "test-1"\nduration = "1 s"\nreplicates = 1\n'


def test_template_loads_and_is_the_default_rig(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(plan_template(), encoding="utf-8")
    plan = load_plan(path)
    assert plan.rig == Rig() and plan.seed == 0
    assert [(e.name, e.duration, e.replicates) for e in plan.experiments] == [("test-1", 30.0, 1), ("sine", 4.0, 3)]


def test_every_commented_effect_of_the_template_loads():
    lines = plan_template().splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("# [[effects]]"))
    last = next(k for k, line in enumerate(lines) if line.startswith("# The eight"))
    text = "\n".join(line.removeprefix("#").strip() for line in lines[first:last]) + "\n" + RUN
    plan = parse_plan(text)
    assert len(plan.rig.effects) == 37
    assert plan.rig.effects[0].parameters["level"] == 60.0


def test_every_kind_of_the_template_loads():
    kinds = [line.removeprefix("#").strip() for line in plan_template().splitlines() if line.startswith("#   {")]
    assert len(kinds) == 11
    for kind in kinds:
        current = tomllib.loads(f"k = {kind}")["k"]["kind"] in ("icps", "prbs", "aprbs", "constant", "stepped")
        motion, drive = ('{ kind = "sine" }', kind) if current else (kind, '{ kind = "icps" }')
        parse_plan(f"[[experiments]]\ndisplacement = {motion}\ncurrent = {drive}\n")


def test_units_become_si():
    plan = parse_plan("""
seed = 3
sample_rate = "0.256 kHz"
[damper]
series_stiffness = "2 kN/mm"
rise_time = "6 ms"
yield_current = inf
[[effects]]
name = "coil-lag"
strength = 0.5
tau = "20 ms"
[[effects]]
name = "sensor-scale"
channel = "velocity"
gain = "5 %"
[[experiments]]
name = "slow"
duration = "2 min"
displacement = { kind = "sine", amplitude = "5 mm", frequency = "2 Hz" }
current = { kind = "stepped", levels = ["500 mA", 1.0] }
""")
    assert plan.rig.damper.series_stiffness == pytest.approx(2e6)
    assert plan.rig.damper.rise_time == pytest.approx(0.006)
    assert plan.rig.sample_rate == pytest.approx(256.0)
    lag, scale = plan.rig.effects
    assert (lag.strength, lag.parameters["tau"]) == (0.5, pytest.approx(0.02))
    assert (scale.parameters["channel"], scale.parameters["gain"]) == ("velocity", pytest.approx(0.05))
    experiment = plan.experiments[0]
    assert experiment.duration == 120.0 and experiment.displacement.amplitude == pytest.approx(0.005)
    assert experiment.current.levels == pytest.approx((0.5, 1.0))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[dampr]\n" + RUN, "no key of the plan 'dampr'.*did you mean 'damper'"),
        ("[damper]\nviscos = 1\n" + RUN, "no key of damper 'viscos'.*did you mean 'viscous'"),
        ('[damper]\nviscous = "3 mm"\n' + RUN, "damper.viscous has the wrong unit.*N"),
        ('[damper]\nviscous = "3 mx"\n' + RUN, "damper.viscous: unknown unit"),
        ("[damper]\nviscous = true\n" + RUN, "damper.viscous must be a number"),
        ("[damper]\nviscous = nan\n" + RUN, "damper.viscous must be a number"),
        ("[damper]\nviscous = -1\n" + RUN, "damper viscous must not be negative"),
        ("damper = 3\n" + RUN, "damper must be a table"),
        ("seed = 1.5\n" + RUN, "seed must be a whole number"),
        ("seed = -1\n" + RUN, "seed must be a whole number"),
        ("truth = 1\n" + RUN, "truth must be true or false"),
        ("sample_rate = 0\n" + RUN, "sample_rate must be positive"),
        ('[[effects]]\nname = "coil-lagg"\n' + RUN, "did you mean 'coil-lag'"),
        ('[[effects]]\nname = "payload"\n' + RUN, "quarter-car rig"),
        ('[[effects]]\nname = "coil-lag"\ntua = 1\n' + RUN, "did you mean 'tau'"),
        ('[[effects]]\nname = "coil-lag"\ntau = "1 m"\n' + RUN, "wrong unit"),
        ('[[effects]]\nname = "sensor-scale"\nchannel = "forc"\n' + RUN, "did you mean 'force'"),
        ("[[effects]]\ntau = 1\n" + RUN, "needs a name"),
        ("effects = 3\n" + RUN, r"write \[\[effects\]\]"),
        ("seed = 1\n", "at least one experiment"),
        (RUN + RUN, "two experiments of the plan are called 'test-1'"),
        ('[[experiments]]\npreset = "test-9"\n', "did you mean 'test-"),
        ('[[experiments]]\nname = "x"\n', "lacks displacement and current"),
        ('[[experiments]]\npreset = "test-1"\nname = "../x"\n', "becomes the name of a file"),
        ('[[experiments]]\npreset = "test-1"\nduration = "5 mm"\n', "duration has the wrong unit"),
        ('[[experiments]]\npreset = "test-1"\nreplicates = 0\n', "at least 1"),
        ('[[experiments]]\npreset = "test-1"\nreplicates = 1000000\n', "too much data"),
        ('[[experiments]]\npreset = "test-1"\ncurrent = { kind = "icsp" }\n', "did you mean 'icps'"),
        ('[[experiments]]\npreset = "test-1"\ncurrent = { hold = 1 }\n', "needs a kind"),
        ('[[experiments]]\npreset = "test-1"\ndisplacement = { kind = "road", surface = "mud" }\n', "must be one of"),
        ('[[experiments]]\npreset = "test-1"\ndisplacement = { kind = "sine", amplitude = inf }\n', "finite"),
        ('[[experiments]]\npreset = "test-1"\ncurrent = { kind = "stepped", levels = 3 }\n', "list of numbers"),
        ("[damper\n", "is not TOML"),
    ],
)
def test_mistakes_are_named(text, words):
    with pytest.raises(InputError, match=words) as caught:
        parse_plan(text, "my.toml")
    assert str(caught.value).startswith("my.toml") and "\n" not in str(caught.value)


def test_unreadable_files_are_named(tmp_path):
    with pytest.raises(InputError, match=r"no\.toml.*No such file"):
        load_plan(tmp_path / "no.toml")
    (tmp_path / "bad.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"bad\.toml.*not UTF-8"):
        load_plan(tmp_path / "bad.toml")


def test_schema_describes_what_the_reader_takes():
    schema = plan_schema()
    assert json.loads(json.dumps(schema, allow_nan=False)) == schema
    plan = parse_plan(plan_template())
    assert set(schema["properties"]["damper"]["properties"]) == set(vars(plan.rig.damper))
    names = {entry["properties"]["name"]["const"] for entry in schema["properties"]["effects"]["items"]["oneOf"]}
    assert len(names) == 37 and "coil-lag" in names
    kinds = {e["properties"]["kind"]["const"]
             for key in ("displacement", "current")
             for e in schema["properties"]["experiments"]["items"]["properties"][key]["oneOf"]}
    assert {"road", "icps", "constant", "triangle"} <= kinds


def test_run_plan_runs_every_replicate():
    plan = parse_plan('seed = 4\ntruth = true\n' + RUN.replace("replicates = 1", "replicates = 2"))
    assert isinstance(plan, Plan)
    records = run_plan(plan)
    assert [r.name for r in records] == ["test-1-r0", "test-1-r1"]
    assert "force_true" in records[0].channels and records[0].n_samples == 512


def test_csv_reads_back_to_the_same_bits(tmp_path, rng):
    record = Record({"force": rng.standard_normal(300) * 1e3, "a,b": rng.standard_normal(300)}, sample_time=1 / 512,
                    units={"force": "N"}, start=0.5)
    path = write_csv(record, tmp_path / "run.csv")
    header, *rows = path.read_text(encoding="utf-8").splitlines()
    assert header == 'time [s],force [N],"a,b"'
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    np.testing.assert_array_equal(table[:, 0], record.times)
    np.testing.assert_array_equal(table[:, 1], record["force"])
    assert [p.name for p in tmp_path.iterdir()] == ["run.csv"]
    with pytest.raises(InputError, match="cannot write"):
        write_csv(record, tmp_path / "no" / "run.csv")


def test_csv_failure_leaves_nothing(tmp_path, monkeypatch, rng):
    record = Record({"force": rng.standard_normal(10)}, sample_time=0.1)

    def full(*_args, **_kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("quartercar.rig.storing.np.column_stack", full)
    with pytest.raises(InputError, match="No space left"):
        write_csv(record, tmp_path / "run.csv")
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_not_toml_is_named_once(tmp_path):
    (tmp_path / "plan.toml").write_text("[damper\n")
    with pytest.raises(InputError) as found:
        load_plan(tmp_path / "plan.toml")
    assert str(found.value).startswith("plan.toml is not TOML") and str(found.value).count("plan.toml") == 1
