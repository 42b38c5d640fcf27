"""`auto`: structures compete in rounds; what is left early could not win; the time is bounded; the gap is reported."""

from __future__ import annotations

from time import process_time

import numpy as np
import pytest
from scipy.signal import lfilter

import lpvid as lpv
from lpvid import _threads
from lpvid._forks import in_forks, processor_time
from lpvid.condition import folds
from lpvid.identification.selection import auto
from lpvid.identification.selection import search as search_module
from lpvid.identification.selection.every_kind import every_kind
from lpvid.identification.selection.free_run import Trial, cross_validate, make_folds
from lpvid.identification.selection.hasty import hasty, in_full
from lpvid.identification.selection.rounds import output_error
from lpvid.identification.selection.search import StructureSearch, _above
from lpvid.identification.subspace_order import FOLDS, GAP, free_run_errors
from lpvid.record import Record

A = [1.0, -1.86, 0.92]
"""a slow, lightly damped mode."""


def lightly_damped(seed: int, n: int = 1000, noise: float = 0.1, hidden: float = 0.0) -> Record:
    """Output noise, as a sensor makes it: least squares of one step is badly biased. `hidden` is a sine not logged."""
    rng = np.random.default_rng(seed)
    u = rng.normal(size=n)
    x = lfilter([0, 0.4, 0.2], A, u)
    y = x + noise * x.std() * rng.normal(size=n) + hidden * x.std() * np.sin(0.05 * np.arange(n))
    return Record({"u": u, "y": y}, sample_time=0.01, name=f"run {seed}")


def fit_of_the_truth(record: Record) -> float:
    """Free-run fit [%] of the true equation from two measured samples."""
    y, x = record["y"], record["y"].copy()
    for k in range(2, len(x)):
        x[k] = -A[1] * x[k - 1] - A[2] * x[k - 2] + 0.4 * record["u"][k - 1] + 0.2 * record["u"][k - 2]
    return float(100 * (1 - np.linalg.norm(y[2:] - x[2:]) / np.linalg.norm(y[2:] - y[2:].mean())))


@pytest.fixture(scope="module")
def chosen() -> lpv.Selection:
    return auto(lightly_damped(0), "u", "y", held_out=lightly_damped(1))


@pytest.mark.slow
def test_output_error_wins_where_the_noise_is_on_the_output(chosen) -> None:
    """Oracle: the true equation, run from the same measured samples, whose noise a slow mode carries on."""
    assert chosen.identification.held_out.overall.free_run.fit_percent > fit_of_the_truth(lightly_damped(1)) - 0.1
    kinds = {type(row.structure).__name__ for row in chosen.table if row.esr is not None or "left after" in row.reason}
    assert {"ARX", "OutputError", "Subspace", "StateSpaceError", "RefinedIV"} <= kinds
    best_arx = max(r.fit_percent for r in chosen.table if isinstance(r.structure, lpv.ARX) and r.esr is not None)
    assert chosen.table[0].fit_percent > best_arx
    assert not any("points below" in n for n in chosen.notes)


@pytest.mark.slow
def test_what_the_noise_leaves_is_asked_before_looking_further(chosen) -> None:
    """This close to the ceiling no quasi-LPV structure is tried beyond the first."""
    assert sum(isinstance(row.structure, lpv.QuasiLPV) for row in chosen.table) == 1


@pytest.mark.slow
def test_staying_below_the_ceiling_is_reported() -> None:
    """A sine that is not logged can be predicted a step ahead from the output, but not run freely."""
    found = auto(lightly_damped(2, hidden=0.5), "u", "y", budget=60.0)
    assert any(isinstance(row.structure, lpv.QuasiLPV) for row in found.table)
    note = next(n for n in found.notes if "points below what the noise leaves possible" in n)
    assert float(note.split("stays ")[1].split(" ")[0]) > 10


@pytest.mark.seconds
def test_a_candidate_is_left_only_when_it_cannot_win() -> None:
    record = lightly_damped(3)
    parts, _ = make_folds([record], 5, 8, ["u"])
    good = lpv.OutputError(na=2, nb=2, nk=1, input="u", output="y")
    bar = cross_validate(good, parts, [record])
    assert not bar.failure
    again = cross_validate(good, parts, [record], bar=bar)
    np.testing.assert_allclose(again.esr, bar.esr)
    poor = lpv.OutputError(na=1, nb=1, nk=1, input="u", output="y")
    left = cross_validate(poor, parts, [record], bar=bar)
    assert left.failure.startswith("left after")
    whole = cross_validate(poor, parts, [record])
    assert whole.mean > bar.mean
    assert left.esr.sum() > bar.esr.sum() * bar.power * 0.999  # squared errors of the folds done


@pytest.mark.seconds
def test_a_leader_that_cannot_be_taken_lets_the_others_go_on() -> None:
    """What was left beside it is cross-validated to the end, as if it had never led."""
    record = lightly_damped(3)
    parts, _ = make_folds([record], 5, 8, ["u"])
    good, poor = (lpv.OutputError(na=n, nb=n, nk=1, input="u", output="y") for n in (2, 1))
    search = StructureSearch([record], parts, 0.0, 14, None)
    search.try_others([good, poor])
    assert search.best is not None and search.best[0] == good
    assert search.others[1][1].failure.startswith("left after")
    search.barred.add(good)
    search.resume()
    alone = cross_validate(poor, parts, [record])
    assert search.best is not None and search.best[0] == poor
    np.testing.assert_allclose(search.best[1].esr, alone.esr)


KINDS = {"ARX", "OutputError", "Subspace", "RefinedIV", "QuasiLPV"}


def test_the_first_fit_stays_whatever_the_budget_and_the_rest_is_named() -> None:
    """The budget counts from the beginning: of one of every kind, the cheapest alone is done."""
    found = auto(lightly_damped(4), "u", "y", budget=1e-3)
    assert found.identification is not None and found.complete
    done = [row for row in found.table if row.esr is not None]
    assert [type(row.structure).__name__ for row in done] == ["ARX"] and isinstance(found.best, lpv.ARX)
    assert found.left_out[0] == f"{len(KINDS) - 1} of {len(KINDS)} kinds that come first"
    assert found.left_out[1].endswith("ARX not screened")
    assert "output error at several orders" in found.left_out[2]
    assert found.to_dict()["left_out"] == list(found.left_out)
    assert any("ended at its budget of 0.001 s of processor time and left out" in n for n in found.notes)


@pytest.mark.seconds
def test_a_budget_keeps_what_the_refit_of_the_best_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its seconds are those of the estimate on all records, which counts the whole search of an output error."""
    record = lightly_damped(14)
    search = StructureSearch([record], make_folds([record], 5, 8, ["u"])[0], 0.0, 4, None, budget=1000.0)
    search.try_others([hasty(lpv.OutputError(na=2, nb=2, nk=1, input="u", output="y", frozen_poles="inside"))])
    assert search.best is not None
    taken = search.refit_seconds[search.best[0]]
    assert taken > 0 and not search.late()
    monkeypatch.setattr(StructureSearch, "seconds", 1000.0 - 0.5 * taken)
    assert search.late()


def test_what_comes_before_the_search_counts_where_it_belongs_to_the_budget() -> None:
    record = lightly_damped(14)
    parts = make_folds([record], 5, 8, ["u"])[0]
    search = StructureSearch([record], parts, 0.0, 4, None, 50.0, processor_time() - 60.0)
    assert not search.late()  # nothing could be taken yet
    search.try_first([lpv.ARX(na=2, nb=2, nk=1, input="u", output="y"), lpv.ARX(na=1, nb=1, input="u", output="y")])
    assert search.late() and search.unfinished(search.first) == 1


@pytest.mark.seconds
def test_further_structures_are_built_on_one_that_could_be_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Least in cross-validation, but worse than the mean from measured samples: the whole search's end counts."""
    record = lightly_damped(15)
    search = StructureSearch([record], make_folds([record], 5, 8, ["u"])[0], 0.0, 4, None)
    robust, fragile = (hasty(lpv.OutputError(na=n, nb=n, nk=1, input="u", output="y", frozen_poles="inside"))
                       for n in (1, 2))
    starts = {True: -50.0, False: 100.0}
    monkeypatch.setattr(search_module, "fit_from_measured_samples", lambda model, *_: starts[model.na == 2])
    asked = []
    original = search_module.estimated
    monkeypatch.setattr(search_module, "estimated", lambda s, *rest: asked.append(s) or original(s, *rest))
    search.try_others([robust, fragile])
    assert in_full(fragile) in asked  # what would be taken, not the short search, is run from measured samples
    assert [s for s, _ in search.ranked_among(lpv.OutputError)] == [robust, fragile]
    assert search.others[1][1].mean < search.others[0][1].mean
    assert search.simplest(lpv.OutputError) == robust and search.best is not None and search.best[0] == robust


def test_a_damper_scheduled_on_its_own_force_is_tried_at_both_lengths_of_memory_first() -> None:
    rng = np.random.default_rng(0)
    record = Record({"velocity": rng.normal(size=300), "force": rng.normal(size=300)}, sample_time=0.01)
    found = every_kind([record], ("velocity",), ("force",), (), True)
    quasi = [s for s in found if isinstance(s, lpv.QuasiLPV)]
    assert [(s.nb, s.trial) for s in quasi] == [((4,), 1), ((10,), 3)]
    assert sum(isinstance(s, lpv.QuasiLPV) for s in every_kind([record], ("velocity",), ("force",), (), False)) == 1


@pytest.mark.seconds
def test_one_of_every_kind_runs_freely_where_least_squares_does_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: the true equation. White noise on the output makes the poles of least squares far too fast."""
    record, later = lightly_damped(11, noise=0.5), lightly_damped(12, noise=0.5)
    monkeypatch.setattr(StructureSearch, "late", lambda search: len(search.others) >= len(KINDS))
    found = auto(record, "u", "y", held_out=later, budget=1e-3)
    arx = lpv.identify(record, lpv.ARX(na=2, nb=3, nk=0, input="u", output="y", affine=1), held_out=later)
    fit = found.identification.held_out.overall.free_run.fit_percent
    assert fit > fit_of_the_truth(later) - 1
    assert arx.held_out.overall.free_run.fit_percent < fit - 20


@pytest.mark.seconds
def test_where_all_run_worse_than_the_mean_it_is_said() -> None:
    """A random walk that has nothing to do with the input."""
    rng = np.random.default_rng(0)
    found = auto(Record({"u": rng.normal(size=600), "y": np.cumsum(rng.normal(size=600))}, sample_time=0.01), "u", "y",
                 budget=1e-3)
    assert all(row.diverges for row in found.table if row.esr is not None)
    assert sum("every candidate that was cross-validated runs worse than the mean" in n for n in found.notes) == 1


def test_what_runs_worse_than_the_mean_is_taken_only_if_nothing_else_is() -> None:
    """The better one has frozen poles outside once it is fitted to all data; it is still no reason for the other."""
    record = lightly_damped(13)
    parts, _ = make_folds([record], 5, 8, ["u"])
    search = StructureSearch([record], parts, 0.0, 4, None)
    good = lpv.OutputError(na=2, nb=2, nk=1, input="u", output="y")
    bad = lpv.OutputError(na=1, nb=1, nk=1, input="u", output="y")
    search.others = [(bad, Trial(np.full(5, 1.001), "", 2)), (good, Trial(np.full(5, 0.999), "", 4))]
    ranked = [row for _, row in search.ranked()]
    # Within a standard error and simpler: it would be preferred but for the rule.
    assert ranked[0].structure == good
    assert ranked[1].reason == "its free run is worse than the mean of the output"


def test_a_budget_counts_what_forks_do(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stage's starts are shared with forks, more or fewer of them by what else the machine does."""
    monkeypatch.setattr(_threads, "processors", lambda: 2)
    monkeypatch.setattr(_threads, "_crew", _threads._Crew())
    monkeypatch.setattr(_threads, "undisturbed", lambda: True)
    search = StructureSearch([], [], 0.0, 1, None)

    def work(item: int) -> float:
        first = process_time()
        while process_time() - first < 0.1:
            pass
        return process_time() - first

    spent = sum(in_forks(work, range(2)))
    assert search.seconds > 0.9 * spent


@pytest.mark.slow
def test_the_order_of_the_search_is_that_of_any_budget() -> None:
    """Oracle: the search without a budget. What one that ends sooner has tried is the beginning of it."""
    def tried(budget: float | None) -> tuple[list[str], lpv.Selection]:
        audited: list[str] = []
        found = auto(
            lightly_damped(7, n=400),
            "u",
            "y",
            budget=budget,
            progress=lambda done, total, text: audited.append(text.split(";")[0]),
        )
        return [t for t in audited if t.startswith("cross-validating")], found

    whole, all_done = tried(None)
    part, ended = tried(0.2)
    assert not all_done.left_out and ended.left_out
    begun = [t for t in part if t in whole]
    assert begun == whole[: len(begun)] and len(begun) < len(whole)


@pytest.mark.slow
def test_an_interruption_in_a_round_keeps_the_best() -> None:
    def stop(done: int, total: int, text: str) -> None:
        if "round 'output error at several orders' done" in text:
            raise KeyboardInterrupt

    found = auto(lightly_damped(5), "u", "y", progress=stop)
    assert not found.complete and found.identification is not None
    assert isinstance(found.best, lpv.OutputError | lpv.StateSpaceError)


@pytest.mark.slow
def test_progress_names_the_best_so_far() -> None:
    audited: list[str] = []
    auto(lightly_damped(6, n=900), "u", "y", progress=lambda done, total, text: audited.append(text), budget=20.0)
    assert any("best so far OutputError" in t and "%" in t for t in audited)
    assert any(t.startswith("• round 'output error at several orders' done") for t in audited)


def test_orders_of_an_output_error_are_those_of_the_arx() -> None:
    arx = lpv.ARX(na=3, nb=2, nk=1, input="u", output="y", affine=1)
    assert output_error(arx).arx == arx


# -- order of a subspace estimate ------------------------------------------------------------------------------------
def third_order(seed: int, n: int = 2500) -> Record:
    rng = np.random.default_rng(seed)
    u = rng.normal(size=n)
    x = lfilter([0, 1.0, 0.3], A, u) + lfilter([0, 2.0], [1, 0.7], u)
    return Record({"u": u, "y": x + 0.1 * x.std() * rng.normal(size=n)}, sample_time=0.01)


@pytest.mark.seconds
def test_subspace_errors_by_order_are_those_of_separate_fits() -> None:
    """Oracle: each order fitted on each fold by its own call."""
    record = third_order(0)
    structure = lpv.Subspace(input="u", output="y")
    found = free_run_errors(structure, [record], (1, 2, 3))
    parts = folds([record], FOLDS, GAP * structure.start * 0.01)
    for order in (1, 2, 3):
        error = power = 0.0
        for training, held in parts:
            model = lpv.Subspace(order=order, past=structure.past, input="u", output="y").estimate(
                [r for r in training if r.n_samples > 3 * structure.start]).model
            for r in held:
                error += float(np.sum((r["y"] - lpv.simulate(model, r, "estimate").output[:, 0]) ** 2))
                power += float(np.sum((r["y"] - r["y"].mean()) ** 2))
        assert found[order] == pytest.approx(error / power, rel=1e-6)


@pytest.mark.seconds
@pytest.mark.parametrize("seed", range(3))
def test_subspace_finds_an_order_that_runs_freely(seed: int) -> None:
    found = lpv.identify(third_order(seed), lpv.Subspace(input="u", output="y"), held_out=third_order(seed + 10))
    assert found.model.order == 3
    assert found.held_out.overall.free_run.fit_percent > 88
    assert any("by its free run out of 4 folds" in n for n in found.notes)


def test_subspace_on_a_record_too_short_for_folds_takes_the_gap() -> None:
    found = lpv.identify(third_order(0).slice(0, 60), lpv.Subspace(input="u", output="y", past=6))
    assert any("from the largest gap" in n or "as requested" in n for n in found.notes)


def test_an_error_beside_the_least_is_told_apart_from_it():
    assert _above(2.5) == "2.5 times the least" and _above(1.0004) == "0.04 % above the least"
