"""Refits where the cost is a valley: one that is bent, and one along whose floor a damped step promises nothing."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.toy_diagnosis import TRUE, Added, Bent, Dry, problem_of, record

from lpvid._bounded_steps import bounded_minimiser, geodesic_correction
from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Core
from lpvid.diagnosis import refitting
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import descend, refit, settled_start
from lpvid.effects.composition import Composition
from lpvid.effects.effect import EffectParameter


class Valley(Added):
    """y += a sin 9u + 20 (b − a²) sin 5u: Rosenbrock's valley b = a²."""

    name, title = "valley", "two parameters on a parabola"

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        return tuple(EffectParameter(n, "", n, 0.0, (-10.0, 10.0), (-100.0, 100.0), (0.1,)) for n in "ab")

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        a, b = (float(v) for v in values)
        return lambda s: core(s) + a * np.sin(9 * s["u"]) + 20 * (b - a**2) * np.sin(5 * s["u"])


class Alike(Added):
    """y += a sin 9u + b (sin 9u + sin 5u/2000): nearly the same twice."""

    name, title = "alike", "two columns that hardly differ"
    parameters = Valley.parameters

    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        a, b = (float(v) for v in values)
        return lambda s: core(s) + (a + b) * np.sin(9 * s["u"]) + b / 2000 * np.sin(5 * s["u"])


@pytest.fixture
def hidden_wave() -> tuple[DiagnosisProblem, Composition, np.ndarray]:
    """At a = b = 1 of the valley, from its floor at a = 0.1."""
    problem, _ = problem_of(record(np.random.default_rng(70), hidden=lambda u: np.sin(9 * u)))
    return problem, Composition(Bent(), (Valley(),)), np.array([*TRUE, 0.1, 0.01])


class TestBentValley:
    def test_it_is_followed(self, hidden_wave: tuple) -> None:
        problem, composition, start = hidden_wave
        assert descend(problem, composition, start, iterations=10).vector[3:] == pytest.approx([1.0, 1.0], abs=0.05)

    def test_by_straight_steps_it_is_not_in_as_many(self, hidden_wave: tuple, monkeypatch: pytest.MonkeyPatch) -> None:
        problem, composition, start = hidden_wave
        monkeypatch.setattr(refitting, "geodesic_correction", lambda *_: None)
        assert descend(problem, composition, start, iterations=10).vector[3] < 0.5

    def test_no_correction_where_the_change_is_not_finite(self, hidden_wave: tuple) -> None:
        problem, composition, start = hidden_wave
        fit = descend(problem, composition, start, iterations=0)
        low, high = composition.bounds
        missed, weights = np.full(problem.n_samples, np.inf), np.ones(problem.n_samples)
        step = np.array([0.0, 0.0, 0.0, 0.1, 0.1])
        assert geodesic_correction(fit.jacobian, missed, step, weights, start, 1e-3, low, high) is None


@pytest.mark.parametrize("rough", [False, True])
def test_a_damped_step_of_little_predicted_decrease_is_not_the_end(rough: bool) -> None:
    """The truth lies 60 of either parameter away; of such a step the first damping leaves a ten-thousandth."""
    problem, _ = problem_of(record(np.random.default_rng(71), hidden=lambda u: 0.03 * np.sin(5 * u)))
    composition = Composition(Bent(), (Alike(),))
    start = np.array([*TRUE, 0.0, 0.0])
    found = descend(problem, composition, start, rough=rough)
    best = descend(problem, composition, np.array([*TRUE, -60.0, 60.0]))
    assert descend(problem, composition, start, iterations=0).cost - best.cost > 5 * best.variance
    assert found.cost == pytest.approx(best.cost, abs=0.1 * best.variance)


def test_a_start_is_settled_at_the_least_squares_of_the_parameters_in_common(rng: np.random.Generator) -> None:
    """Dry friction of 1 V hidden, started at 4 V: a bend of the law makes room for it."""
    problem, _ = problem_of(record(rng, hidden=lambda u: np.sign(u)))
    root, composition = refit(problem, Composition(Bent()), TRUE), Composition(Bent(), (Dry(),))
    start = np.array([*root.vector, 4.0])
    errors = problem.stacked_errors(composition, start)
    found = settled_start(problem, composition, start, root)
    step = np.linalg.lstsq(root.jacobian, errors, rcond=None)[0]
    assert found[3] == 4.0 and found[:3] - start[:3] == pytest.approx(step, rel=0.05)
    assert np.sum(problem.stacked_errors(composition, found) ** 2) < 0.5 * np.sum(errors**2)
    assert settled_start(problem, root.composition, root.vector, root) == pytest.approx(root.vector, rel=0.01)


def test_a_start_is_left_alone_where_the_step_is_worse(hidden_wave: tuple) -> None:
    """The law is bent, and a step over its whole range ends at another cost than to first order."""
    problem, composition, start = hidden_wave
    near = descend(problem, Composition(Bent()), TRUE, iterations=0)
    far = start.copy()
    far[2], far[3] = 40.0, 5.0
    assert np.array_equal(settled_start(problem, composition, far, near), far)


@pytest.mark.parametrize("room", [(-1.0, 0.25), (-np.inf, np.inf), (0.0, 0.0)])
def test_a_step_between_bounds_is_the_best_one_also_where_two_columns_are_one(room: tuple[float, float]) -> None:
    """xᵀMx/2 − bᵀx over a grid of both parameters; without bounds any pair of the same sum is as good."""
    matrix, right = np.ones((2, 2)), np.array([1.0, 1.0])
    low, high = np.full(2, room[0]), np.full(2, room[1])
    found = bounded_minimiser(matrix, right, low, high)
    x = np.clip(np.linspace(-2.0, 2.0, 161), *room)
    cost = (x[:, None] + x) ** 2 / 2 - (x[:, None] + x)
    assert (found >= low).all() and (found <= high).all()
    assert found @ matrix @ found / 2 - right @ found <= cost.min() + 1e-9


def test_a_single_record_is_stacked_where_it_is(rng: np.random.Generator) -> None:
    """Oracle: the rows picked by numpy, of blocks with gaps between them."""
    number = np.repeat(np.array([-1, 0, 1, -1, 2, -1]), [5, 4000, 3000, 700, 6000, 9])
    for count in (1, 2):
        problem = DiagnosisProblem((), SimpleNamespace(number=[number] * count))  # type: ignore[arg-type]
        values = [rng.normal(size=(number.size, 3)) for _ in range(count)]
        wanted = np.concatenate([v[number >= 0] for v in values])
        found = problem.stack(iter(values), overwriting=True)
        np.testing.assert_array_equal(found, wanted)
        assert np.shares_memory(found, values[0]) == (count == 1) and found.flags.c_contiguous
