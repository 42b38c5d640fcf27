"""What roles stated of the training data is not to be stated again: the clock's column, the units of bare headers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.cli.app import app
from lpvid.errors import InputError
from lpvid.files.streaming import read_chunks

pytestmark = pytest.mark.usefixtures("undrawn")
RATE = 200.0
ROLES = ("--role", "time=Zeit [ms]", "--role", "velocity=v [mm/s]")


def run(*arguments: object, code: int = 0) -> str:
    result = CliRunner().invoke(app, [*map(str, arguments)], catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result.output


def write(path: Path, seed: int, header: str = "Zeit,v,force [N]", time: float = 1e3, speed: float = 1e3) -> Path:
    rng = np.random.default_rng(seed)
    v = np.convolve(rng.standard_normal(620), np.ones(20) / 60, "valid")[:600]
    force = np.zeros(600)
    for k in range(1, 600):
        force[k] = 0.4 * force[k - 1] + 400 * v[k]
    columns = [time * np.arange(600) / RATE, speed * v, force + rng.standard_normal(600)]
    columns += [np.floor(np.arange(600) / 7)] * (header.count(",") - 2)
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9g")
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("reading")
    for seed in (0, 1):
        write(path / f"run{seed}.csv", seed)
    run("identify", path / "run0.csv", *ROLES, "--na", 1, "--nb", 1, "--nk", 0, "--out", path / "m")
    return path


@pytest.mark.seconds
def test_a_model_remembers_its_clock_and_the_units_that_roles_stated(folder):
    model = lpv.load(folder / "m" / "model.json")
    assert model.metadata["reading"] == {"time": "Zeit [ms]", "velocity": "v [mm/s]"}
    record, = lpv.read(folder / "run1.csv", like=model)
    assert record.sample_time == pytest.approx(1 / RATE)
    assert record.unit("v") == "m/s"
    assert np.abs(record["v"]).max() < 1.0
    assert record.reading == model.metadata["reading"]


@pytest.mark.parametrize("command", [["validate"], ["simulate"], ["compare"], ["validate", "--chunk", "150"]])
def test_no_command_needs_the_roles_again(folder, command):
    printed = run(command[0], folder / "m" / "model.json", folder / "run1.csv", *command[1:])
    stated = run(command[0], folder / "m" / "model.json", folder / "run1.csv", *command[1:], *ROLES)
    first = [line for line in stated.splitlines() if "ESR" in line]
    assert first
    assert [line for line in printed.splitlines() if "ESR" in line] == first
    assert "column 'v' is read in mm/s, as that of the model's training data" in printed


@pytest.mark.seconds
def test_a_baseline_in_a_file_and_a_model_beside_read_alike(folder):
    bare = write(folder / "bare.csv", 4, "time [s],velocity [m/s],force [N]", 1.0, 1.0)
    run("identify", bare, "--na", 1, "--nb", 1, "--nk", 0, "--out", folder / "other")
    printed = run("validate", folder / "other" / "model.json", folder / "run1.csv", "--role", "velocity=v",
                  "--beside", folder / "m" / "model.json")
    assert "column 'Zeit' is read in ms" in printed


def test_what_the_header_or_an_option_states_wins(folder, tmp_path):
    model = lpv.load(folder / "m" / "model.json")
    in_seconds = write(tmp_path / "s.csv", 1, "Zeit [s],v [m/s],force [N]", 1.0, 1.0)
    record, = lpv.read(in_seconds, like=model)
    assert record.sample_time == pytest.approx(1 / RATE)
    assert np.abs(record["v"]).max() < 1.0
    record, = lpv.read(folder / "run1.csv", like=model, roles={"velocity": "v [cm/s]"})
    assert record.channels["v"].source_unit == "cm/s"
    record, = lpv.read(write(tmp_path / "two.csv", 1, "uhr [ms],v,force [N],Zeit"), like=model, roles={"time": "uhr"})
    assert record.sample_time == pytest.approx(1 / RATE)


def test_the_remembered_clock_comes_before_a_column_called_time(folder, tmp_path):
    model = lpv.load(folder / "m" / "model.json")
    record, = lpv.read(write(tmp_path / "both.csv", 1, "Zeit,v,force [N],time [s]"), like=model)
    assert record.sample_time == pytest.approx(1 / RATE)
    assert any("'Zeit', not 'time', is the clock" in n for n in record.notes)


def test_a_file_without_that_column_gets_one_line(folder, tmp_path):
    other = write(tmp_path / "other.csv", 1, "uhr,v,force [N]")
    line = run("validate", folder / "m" / "model.json", other, code=2)
    assert line.count("\n") <= 2
    assert "no time column: got uhr, v, force; the clock of the model's training data, 'Zeit', is not there" in line
    own = write(tmp_path / "own.csv", 1, "time [s],velocity [mm/s],force [N]", 1.0)
    printed = run("validate", folder / "m" / "model.json", own)
    assert "'own': column 'time' is the clock: 'Zeit', that of the model's training data, is not there" in printed


def test_a_model_of_parts_remembers_as_well(folder):
    chunks = read_chunks(folder / "run0.csv", 150, roles={"time": "Zeit [ms]", "velocity": "v [mm/s]"})
    found = lpv.identify_stream(chunks, lpv.ARX(na=1, nb=1, nk=0, input="velocity", output="force"))
    assert found.model.metadata["reading"] == {"time": "Zeit [ms]", "velocity": "v [mm/s]"}
    figures = lpv.validate(found.model, read_chunks(folder / "run1.csv", 150, like=found.model))
    assert figures.overall.free_run.fit_percent > 90


def test_models_that_disagree_are_refused_only_where_the_file_leaves_it_open(folder, tmp_path):
    both = write(tmp_path / "both.csv", 1, "Zeit,v,force [N],uhr")
    model = lpv.load(folder / "m" / "model.json")
    other = model.replace(metadata={**model.metadata, "reading": {"time": "uhr", "velocity": "v [cm/s]"}})
    with pytest.raises(InputError, match="column 'v' in different units"):
        lpv.read(both, like=[model, other])
    with pytest.raises(InputError, match="different clocks: got Zeit, uhr"):
        lpv.read(both, like=[model, other], roles={"velocity": "v [mm/s]"})
    lpv.read(both, like=[model, other], roles={"velocity": "v [mm/s]", "time": "Zeit [ms]"})


def test_a_model_of_files_with_different_clocks_remembers_each(folder, tmp_path):
    other = write(tmp_path / "other.csv", 1, "uhr,w,force [N]", 1.0, 100.0)
    given = [lpv.read(folder / "run0.csv", roles={"time": "Zeit [ms]", "velocity": "v [mm/s]"})[0],
             lpv.read(other, roles={"time": "uhr [s]", "velocity": "w [cm/s]"})[0]]
    model = lpv.identify(given, lpv.ARX(na=1, nb=1, nk=0, input="velocity", output="force")).model
    kept = [{"time": "Zeit [ms]", "velocity": "v [mm/s]"}, {"time": "uhr [s]", "velocity": "w [cm/s]"}]
    assert model.metadata["reading"] == kept
    lpv.save(model, tmp_path / "m.json")
    again = lpv.load(tmp_path / "m.json")
    assert again.metadata["reading"] == kept
    for path, column in ((folder / "run1.csv", "v"), (other, "w")):
        record, = lpv.read(path, like=again)
        assert record.sample_time == pytest.approx(1 / RATE)
        assert np.abs(record[column]).max() < 1.0
