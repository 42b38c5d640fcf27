"""`quartercar design` says what it does, and Ctrl-C writes down the best controller so far."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import lru_cache

import pytest
from typer.testing import CliRunner

from lpvid.lmi.program import Program, SolverAnswer
from lpvid.synthesis import progress
from lpvid.synthesis.result import Synthesis
from quartercar.cli.app import app
from quartercar.controllers.designed.suspension_design import synthesized, to_the_end


@pytest.mark.slow
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


def test_the_next_call_solves_an_interrupted_task_to_the_end():
    notes = iter([f"{progress.INTERRUPTED} 2 s", "all of it"])
    solve = lru_cache(lambda task: Synthesis("infeasible", notes=(next(notes),)))
    built = lru_cache(lambda task: solve(task).notes)
    assert progress.was_interrupted(to_the_end(solve, "task", built)) and progress.was_interrupted(solve("task"))
    built("task")
    assert to_the_end(solve, "task", built).notes == ("all of it",) == built("task")
    assert to_the_end(solve, "task", built).notes == ("all of it",)


def test_a_follower_has_the_stages_of_a_synthesis_within():
    stated: list[str] = []
    with progress.followed(stated.append), progress.watched(None):
        progress.stage("a round")
    with progress.watched(None):
        progress.stage("nobody follows")
    assert stated == ["a round"]
