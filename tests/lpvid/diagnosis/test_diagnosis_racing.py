"""A race of starts against a refit from each, and a refit that is only compared with another one."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.toy_diagnosis import TRUE, problem_of, record

from lpvid.diagnosis.composition import Composition
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.racing import race
from lpvid.diagnosis.refitting import refit


def test_a_race_ends_where_a_refit_from_its_best_start_does() -> None:
    problem, composition = problem_of(record(np.random.default_rng(60)))
    begun = [np.array(start) for start in ([-20.0, 1.0, 0.1], [2.5, 2.0, 1.0], [30.0, -9.0, 4.0], [0.0, 0.0, 0.0])]
    found = race(problem, composition, [(start, None) for start in begun])
    alone = min((refit(problem, composition, start, rough=True) for start in begun), key=lambda f: f.cost)
    assert found.cost == pytest.approx(alone.cost, rel=1e-3)
    assert found.vector == pytest.approx(TRUE, rel=0.1)


def test_the_same_start_runs_once(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, composition = problem_of(record(np.random.default_rng(61)))
    runs, errors = [], DiagnosisProblem.errors

    def counted(self: DiagnosisProblem, composition: Composition, vector: np.ndarray) -> list[np.ndarray]:
        runs.append(vector)
        return errors(self, composition, vector)

    monkeypatch.setattr(DiagnosisProblem, "errors", counted)
    race(problem, composition, [(np.array([2.5, 2.0, 1.0]), None)])
    once = len(runs)
    race(problem, composition, 3 * [(np.array([2.5, 2.0, 1.0]), None)])
    assert len(runs) == 2 * once


def test_a_refit_far_from_its_target_ends_early_and_near_it_does_not() -> None:
    problem, composition = problem_of(record(np.random.default_rng(62)))
    start = np.array([2.5, 2.0, 1.0])
    best = refit(problem, composition, start)
    assert refit(problem, composition, start, target=best.cost).cost == pytest.approx(best.cost, rel=1e-6)
    far = refit(problem, composition, start, target=-1e9)
    assert np.array_equal(far.vector, start)
