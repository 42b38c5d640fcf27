"""`quartercar design` says what it does, and Ctrl-C writes down the best controller so far."""

from __future__ import annotations

import json
from collections.abc import Iterator

from typer.testing import CliRunner

from lpvid.lmi.program import Program, SolverAnswer
from lpvid.synthesis import progress
from quartercar.cli.app import app
from quartercar.controllers.designed.suspension_design import synthesized


def test_ctrl_c_keeps_the_best_controller(tmp_path, monkeypatch):
    """Once the least levels are known, while the tamest matrices are looked for, as a signal would come."""
    programs: list[Program] = []

    def solve(self: Program, *values, **options) -> Iterator[SolverAnswer]:
        programs.append(self)
        if len(programs) == 2:
            raise KeyboardInterrupt
        yield from inner(self, *values, **options)

    synthesized.cache_clear()  # another test may have solved the same task
    inner = Program.solve
    monkeypatch.setattr(Program, "solve", solve)
    done = CliRunner().invoke(app, ["design", "--plant", "nominal", "--out", str(tmp_path / "d")])
    assert done.exit_code == 130, done.output
    kept = json.loads((tmp_path / "d" / "synthesis.json").read_text())
    assert kept["notes"][0].startswith(progress.INTERRUPTED) and kept["gamma_lower"] <= kept["gamma_verified"]
    assert (tmp_path / "d" / "controller.json").exists()
    monkeypatch.setattr(Program, "solve", inner)
    again = CliRunner().invoke(app, ["design", "--plant", "nominal", "--out", str(tmp_path / "again")])
    assert again.exit_code == 0, again.output  # the next call solves it to the end


def test_a_follower_has_the_stages_of_a_synthesis_within():
    stated: list[str] = []
    with progress.followed(stated.append), progress.watched(None):
        progress.stage("a round")
    with progress.watched(None):
        progress.stage("nobody follows")
    assert stated == ["a round"]
