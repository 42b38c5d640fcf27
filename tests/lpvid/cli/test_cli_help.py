"""Help, one-line errors, configuration files and progress of every command of both applications."""

from __future__ import annotations

import itertools
import json
import shlex
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from lpvid.cli.app import app as lpvid_app
from lpvid.cli.helping import OTHER, examples_of, panel_of, read_options, template_of
from lpvid.cli.running import StageLines
from lpvid.errors import InputError
from quartercar.cli.app import app as quartercar_app

GROUPS: dict[str, Any] = {"lpvid": typer.main.get_command(lpvid_app),
                          "quartercar": typer.main.get_command(quartercar_app)}
COMMANDS = [(group, name) for group, found in GROUPS.items() for name in found.commands]


def command_of(group: str, name: str):
    return GROUPS[group].commands[name]


def help_of(group: str, name: str, columns: int) -> str:
    app = {"lpvid": lpvid_app, "quartercar": quartercar_app}[group]
    result = CliRunner(env={"COLUMNS": str(columns)}).invoke(app, [name, "-h"])
    assert result.exit_code == 0, result.output
    return result.stdout


# -- help --------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("group", "name"), COMMANDS)
def test_every_option_has_a_panel_and_an_explanation(group: str, name: str) -> None:
    for param in command_of(group, name).params:
        assert panel_of(param.name) != OTHER, f"{name} --{param.name}: no panel"
        assert param.help, f"{name} --{param.name}: no help"


@pytest.mark.parametrize(("group", "name"), COMMANDS)
def test_every_example_is_a_command_line_that_parses(group: str, name: str) -> None:
    command = command_of(group, name)
    found = examples_of(command.epilog)
    assert found
    for comment, line in found:
        first, second, *rest = shlex.split(line)
        assert comment and (first, second) == (group, name)
        if "--config" in rest:  # names a file that the reader writes first
            continue
        if "--template" in rest:
            assert any("--template" in p.opts for p in command.params)
            continue
        command.make_context(name, rest).close()


@pytest.mark.parametrize(("group", "name"), COMMANDS)
@pytest.mark.parametrize("columns", [60, 100])
def test_no_word_of_the_help_is_broken_and_no_flag_has_a_type(group: str, name: str, columns: int) -> None:
    shown = help_of(group, name, columns)
    assert "<bool>" not in shown and "<int" not in shown
    words = set(shown.split())
    for param in command_of(group, name).params:
        assert set(" ".join(str(param.help).split()).split()) <= words
        assert any(o in words or f"{o}," in words for o in param.opts) or param.param_type_name == "argument"
    long = [line for line in shown.splitlines() if len(line) > columns]
    assert all(len(line.split()) == 1 or line.startswith(("Usage", "  --")) for line in long), long


def test_the_help_of_export_names_both_kinds_of_fmu() -> None:
    shown = " ".join(help_of("lpvid", "export", 100).split())
    assert "an FMU of the same C" in shown and "model exchange where it is continuous" in shown


def test_groups_list_their_commands_and_versions() -> None:
    for app, group in ((lpvid_app, "lpvid"), (quartercar_app, "quartercar")):
        shown = CliRunner().invoke(app, ["-h"]).stdout
        assert all(f"  {name}" in shown for name in GROUPS[group].commands)
        assert CliRunner().invoke(app, ["-v"]).stdout == CliRunner().invoke(app, ["--version"]).stdout
        assert "Usage" in CliRunner().invoke(app, []).stdout


@pytest.mark.seconds
def test_completion_is_offered() -> None:
    done = subprocess.run([sys.executable, "-c", "from lpvid.cli import main; main()"], capture_output=True, text=True,
                          env={"_LPVID_COMPLETE": "complete_bash", "COMP_WORDS": "lpvid ident", "COMP_CWORD": "1",
                               "PATH": "/usr/bin:/bin", "PYTHONPATH": str(Path(__file__).parents[3])}, check=False)
    assert done.stdout.split() == ["identify"], done.stderr


# -- wrong command lines -----------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("line", "part"), [
    ("identfy", "did you mean 'identify'?"),
    ("identify --na foo a.csv", "--na takes one integer; '"),
    ("identify --na -1 a.csv", "--na"),
    ("identify --nono a.csv", "no such option: --nono"),
    ("identify", "missing argument 'DATA'"),
    ("identify a.csv --shape round", "--shape"),
    ("identify a.csv --nb", "identify -h' lists the options"),
    ("--nono", "no such option"),
    ("validate model.json", "missing argument 'DATA'"),
])
def test_a_wrong_command_line_is_one_line(line: str, part: str) -> None:
    result = CliRunner().invoke(lpvid_app, line.split())
    assert result.exit_code == 2 and result.stdout == ""
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1 and part in result.stderr


# -- a file in place of options ----------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng = np.random.default_rng(1)
    u, y = rng.standard_normal(400), np.zeros(400)
    for k in range(2, 400):
        y[k] = 1.2 * y[k - 1] - 0.5 * y[k - 2] + u[k - 1] + 0.01 * rng.standard_normal()
    path = tmp_path_factory.mktemp("config") / "data.csv"
    lines = [f"{k * 0.01:.2f},{u[k]:.6f},{y[k]:.6f}" for k in range(400)]
    path.write_text("time [s],drive [1],answer [1]\n" + "\n".join(lines) + "\n")
    return path


def test_a_file_sets_options_and_the_command_line_counts_before_it(data: Path, tmp_path: Path) -> None:
    config = tmp_path / "identify.toml"
    config.write_text(f'data = ["{data}"]\ninput = "drive"\noutput = ["answer"]\nna = 3\nnb = 2\nnk = "1"\n'
                      "json = true\nno_constant = true\n")
    by_file = CliRunner().invoke(lpvid_app, ["identify", "--config", str(config)])
    assert by_file.exit_code == 0, by_file.stderr
    words = ["--input", "drive", "--output", "answer", "--na", "3", "--nb", "2", "--nk", "1", "--json", "--no-constant"]
    by_line = CliRunner().invoke(lpvid_app, ["identify", str(data), *words])

    def untimed(text: str) -> dict:
        return {k: v for k, v in json.loads(text).items() if k != "seconds"}

    assert untimed(by_file.stdout) == untimed(by_line.stdout)
    over = CliRunner().invoke(lpvid_app, ["identify", "--config", str(config), "--na", "2"])
    assert untimed(over.stdout) != untimed(by_file.stdout)


@pytest.mark.parametrize(("text", "part"), [
    ("nna = 2", "no key 'nna'"), ("na = [1, 2]", "'na' is one value"), ("json = 1", "'json' is true or false"),
    ("na = true", "'na' is not a switch"), ("na = ", "is not TOML"), ("[na]\na = 1", "'na' is one value"),
    ("na = 'two'", "--na takes one integer"),
])
def test_a_wrong_file_is_one_line(text: str, part: str, data: Path, tmp_path: Path) -> None:
    config = tmp_path / "identify.toml"
    config.write_text(text)
    result = CliRunner().invoke(lpvid_app, ["identify", str(data), "--config", str(config)])
    assert result.exit_code == 2 and result.stderr.count("\n") == 1 and part in result.stderr
    assert "cannot read" in CliRunner().invoke(lpvid_app, ["identify", "--config", str(tmp_path / "none")]).stderr


@pytest.mark.parametrize(("group", "name"), COMMANDS)
def test_a_template_is_toml_that_sets_nothing_until_it_is_edited(group: str, name: str, tmp_path: Path) -> None:
    command = command_of(group, name)
    if not any(p.name == "config" and "--config" in p.opts for p in command.params):
        pytest.skip("it has a configuration of its own")
    text = template_of(command, f"{group} {name}")
    assert tomllib.loads(text) == {}
    keys = {max(p.opts, key=len).lstrip("-") for p in command.params}
    edited = "\n".join(line[2:] if line.startswith("# ") and " = " in line and line[2].islower()
                       and line.split(" = ")[0][2:] in keys else line
                       for line in text.splitlines())
    path = tmp_path / "all.toml"
    path.write_text(edited)
    assert set(read_options(path, command)) == {p.name for p in command.params} - {"config", "template"}


def test_an_unknown_key_names_the_nearest(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text("sample_rat = 3")
    with pytest.raises(InputError, match="did you mean 'sample-rate'"):
        read_options(path, command_of("lpvid", "identify"))


# -- progress ----------------------------------------------------------------------------------------------------------
def test_a_pipe_gets_a_line_for_each_stage_of_a_long_command(monkeypatch: pytest.MonkeyPatch,
                                                             capsys: pytest.CaptureFixture[str]) -> None:
    clock = itertools.count(0.0, 2.0)
    monkeypatch.delenv("LPVID_PROGRESS", raising=False)
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    stages = StageLines("reading")
    for text in ("reading a", "fitting 1 of 3", "fitting 2 of 3", "fitting 3 of 3", "judging"):
        stages.enter(text)
    stages.close()
    lines = capsys.readouterr().err.splitlines()
    assert [line.split("] ")[1] for line in lines] == ["fitting 1 of 3", "judging"]


def test_a_short_command_writes_none(capsys: pytest.CaptureFixture[str]) -> None:
    stages = StageLines("reading")
    stages.enter("fitting")
    stages.close()
    assert capsys.readouterr().err == ""
