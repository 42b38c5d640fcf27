"""What cross-validation leaves open: the simplest structure that all training data do not speak against."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

import lpvid as lpv
from lpvid.files import read
from lpvid.identification.selection import select
from lpvid.identification.selection.choosing import (
    Tried,
    close_to_least,
    independent_samples,
    least_unstable,
    simplest_supported,
)
from lpvid.identification.selection.free_run import Trial, _points_of_range, unstable_share_of_range
from lpvid.model.quasi import QuasiLPVModel
from lpvid.record import Record
from lpvid.scheduling import Scheduling


def gain(*taps: float) -> lpv.LPVTransferFunction:
    """A moving average."""
    return lpv.LPVTransferFunction.siso([], [[b] for b in taps], lpv.Polynomial(), 0.01, inputs="u", outputs="y")


def measured(n: int, noise: Any, second: float = 0.05) -> Record:
    u = np.random.default_rng(1).standard_normal(n)
    y = u + second * np.concatenate([[0.0], u[:-1]]) + noise
    channels: Any = {"u": u, "y": y}
    return Record(channels, sample_time=0.01)


def tie(n_parameters: int, model: lpv.LPVTransferFunction, above: float = 0.0) -> Tried:
    """A candidate that five folds see within their standard error of 0.01."""
    return Tried(Trial(0.1 + 1e-4 * above + 1e-3 * above * np.array([-1.0, 1.0, 0.0, -1.0, 1.0])), n_parameters,
                 lambda: model)


@pytest.mark.parametrize("n", [300, 3000])
def test_a_small_gain_is_taken_once_it_is_sure(n):
    """Oracle: N ln(1 + b²σ_u²/σ_e²) of the missing tap against the 2 that AIC asks of one parameter."""
    record = measured(n, np.random.default_rng(2).standard_normal(n))
    full, simple = gain(1.0, 0.05), gain(1.0)
    tried = [tie(2, full), tie(1, simple, 1.0)]
    assert close_to_least([t.trial for t in tried]) == [0, 1]
    e = {1: record["y"][1:] - record["u"][1:]}
    e[2] = e[1] - 0.05 * record["u"][:-1]
    deviance = (n - 1) * np.log((e[1] @ e[1]) / (e[2] @ e[2]))
    assert abs(deviance - 2) > 1  # not a close call
    assert simplest_supported(tried, [record]) == (1 if deviance <= 2 else 0)
    assert (deviance > 2) == (n == 3000)


def test_a_redundant_term_is_left_out():
    record = measured(3000, np.random.default_rng(3).standard_normal(3000), second=0.0)
    assert simplest_supported([tie(2, gain(1.0, 0.001)), tie(1, gain(1.0), 1.0)], [record]) == 1


def test_no_difference_that_the_folds_see_is_given_away():
    record = measured(300, np.random.default_rng(2).standard_normal(300), second=0.0)
    sure = Tried(Trial(0.1 + np.array([0.0020, 0.0021, 0.0019, 0.0020, 0.0020])), 1, lambda: gain(1.0))
    assert simplest_supported([tie(2, gain(1.0, 0.0)), sure], [record]) == 0


@pytest.mark.parametrize("apart, better, taken", [(0.02, True, 1), (0.02, False, 0), (0.002, True, 0)])
def test_fewer_parameters_and_less_error_on_all_data_outweigh_what_folds_cannot_tell(apart, better, taken):
    """The second is 10 % above the least in cross-validation: within its standard error of about `apart`, or not."""
    record = measured(3000, np.random.default_rng(2).standard_normal(3000))
    models = gain(0.5, 0.0, 0.0), gain(1.0, 0.05)
    tried = [Tried(Trial(np.full(5, 0.1)), 3, lambda: models[not better]),
             Tried(Trial(0.11 + apart * np.array([-2.0, 2.0, 0.0, -2.0, 2.0])), 2, lambda: models[better])]
    assert close_to_least([t.trial for t in tried]) == [0]
    assert simplest_supported(tried, [record]) == taken


def scheduled(a: list[list[float]], lower: tuple[float, ...], upper: tuple[float, ...]) -> lpv.LPVTransferFunction:
    """Poles that move with p1 and p2; gain 1."""
    names = ("p1", "p2")[:len(lower)]
    basis = lpv.Polynomial(names, degree=1)
    box = Scheduling(names, lower, upper)
    gains = [[1.0] + [0.0] * len(names)]
    return lpv.LPVTransferFunction.siso(a, gains, basis, 0.01, scheduling=box, inputs="u", outputs="y")


def test_the_share_of_the_range_with_poles_outside_is_its_volume():
    """Oracle: the pole is p1 + p2, outside above the diagonal of the unit square; 0.5 + p1 from p1 = 1/2."""
    half = unstable_share_of_range(scheduled([[0.0, -1.0, -1.0]], (0.0, 0.0), (1.0, 1.0)))
    assert half == pytest.approx(0.5, abs=0.02)
    assert unstable_share_of_range(scheduled([[-0.5, -1.0]], (0.0,), (1.0,))) == pytest.approx(0.5, abs=1e-3)
    assert unstable_share_of_range(scheduled([[-0.5, -0.4]], (0.0,), (1.0,))) == 0.0
    assert unstable_share_of_range(gain(1.0)) == 0.0


def test_of_a_tie_the_one_that_is_stable_over_the_whole_range_is_taken():
    """p1 and p2 are never large together in the data, so that no error on them sees where the poles go there."""
    rng = np.random.default_rng(5)
    p1 = np.where(np.arange(600) % 100 < 50, 1.0, 0.0)
    channels: Any = {"u": rng.standard_normal(600), "p1": p1, "p2": 1.0 - p1}
    record = Record({**channels, "y": channels["u"] + 0.3 * rng.standard_normal(600)}, sample_time=0.01)
    along = scheduled([[0.0, -0.9, -0.9]], (0.0, 0.0), (1.0, 1.0))  # pole 0.9 at every sample, 1.8 where both are large
    inside = scheduled([[0.0, -0.45, -0.45]], (0.0, 0.0), (1.0, 1.0))
    share = unstable_share_of_range(along)
    assert share is not None and share > 0.3
    assert simplest_supported([tie(1, along), tie(2, inside, 1.0)], [record]) == 1
    assert simplest_supported([tie(1, inside), tie(2, along, 1.0)], [record]) == 0
    sure = Tried(Trial(0.1 + np.array([0.0020, 0.0021, 0.0019, 0.0020, 0.0020])), 2, lambda: inside)
    assert simplest_supported([tie(1, along), sure], [record]) == 0  # no tie


def test_the_share_of_a_continuous_model_is_where_the_real_part_is_not_negative():
    """Oracle: the pole is p − 0.25 on 0 to 1, unstable on three quarters; without scheduling it is all or nothing."""
    box = Scheduling(("p",), (0.0,), (1.0,))
    b, c, d = (np.array([[[v]], [[0.0]]]) for v in (1.0, 1.0, 0.0))
    moving = lpv.LPVStateSpace(np.array([[[-0.25]], [[1.0]]]), b, c, d, lpv.Polynomial(("p",), degree=1), None, box)
    assert unstable_share_of_range(moving) == pytest.approx(0.75, abs=1e-3)
    for pole, share in ((-0.1, 0.0), (0.1, 1.0)):
        still = lpv.LPVStateSpace(np.array([[[pole]]]), b[:1], c[:1], d[:1], lpv.Polynomial(), None)
        assert unstable_share_of_range(still) == share


def test_the_share_of_a_model_that_schedules_itself_is_not_known():
    """It neither throws out a structure with a known share nor falls out itself."""
    stop = QuasiLPVModel(np.array([[[0.0, -1.0]], [[0.0, 1.0]]]), lpv.Spline("y", 1, 1, (-1.0, 1.0)), 0, (1,), (0,),
                         0.01, (lpv.Signal("u"),), (lpv.Signal("y"),), "trial", np.ones(1))
    assert unstable_share_of_range(stop) is None
    rng = np.random.default_rng(5)
    channels: Any = {"u": rng.standard_normal(600), "p1": np.ones(600), "p2": np.zeros(600)}
    record = Record({**channels, "y": channels["u"] + 0.3 * rng.standard_normal(600)}, sample_time=0.01)
    half = scheduled([[0.0, -0.9, -0.9]], (0.0, 0.0), (1.0, 1.0))
    own = Tried(Trial(0.1 + 1e-4 + 1e-3 * np.array([-1.0, 1.0, 0.0, -1.0, 1.0])), 40, lambda: stop)
    assert simplest_supported([tie(2, half), own], [record]) == 0
    alone = Tried(Trial(np.full(5, 0.1)), 1, lambda: stop)
    assert simplest_supported([alone, tie(2, half, 1.0)], [record]) == 0


@pytest.mark.parametrize("d", [6, 7, 12])
def test_many_variables_share_a_bounded_number_of_points_over_the_whole_box(d):
    """Oracle: the pole is 2 p1 on −1 to 1 of every variable, unstable in half of the box (|p1| >= 1/2)."""
    names = tuple(f"p{i}" for i in range(d))
    box = Scheduling(names, (-1.0,) * d, (1.0,) * d)
    points = _points_of_range(box)
    assert points.shape[0] <= 4096 and np.all(box.contains(points))
    assert np.array_equal(points, _points_of_range(box))
    if d > 6:
        basis = lpv.Polynomial(names, degree=1)
        model = lpv.LPVTransferFunction.siso([[0.0, -2.0] + [0.0] * (d - 1)], [[1.0] + [0.0] * d], basis, 0.01,
                                             scheduling=box, inputs="u", outputs="y")
        assert unstable_share_of_range(model) == pytest.approx(0.5, abs=0.005)
        assert np.mean(np.sum(points, axis=1) > 0) == pytest.approx(0.5, abs=0.03)


def test_one_corner_of_the_range_does_not_cost_a_structure_its_place():
    """1/2025 of the box against none, two parameters against forty: the grid resolves no less than one point."""
    rng = np.random.default_rng(5)
    p1 = np.where(np.arange(600) % 100 < 50, 1.0, 0.0)
    channels: Any = {"u": rng.standard_normal(600), "p1": p1, "p2": 1.0 - p1}
    record = Record({**channels, "y": channels["u"] + 0.3 * rng.standard_normal(600)}, sample_time=0.01)
    corner = scheduled([[0.0, -0.505, -0.505]], (0.0, 0.0), (1.0, 1.0))
    inside = scheduled([[0.0, -0.4, -0.4]], (0.0, 0.0), (1.0, 1.0))
    assert unstable_share_of_range(corner) == pytest.approx(1 / 2025)
    assert simplest_supported([tie(2, corner), tie(40, inside, 1.0)], [record]) == 0


@pytest.mark.parametrize(("percent", "compete"), [
    ((1.4, 4.8, 0.9), [2]),
    ((0.5, 1.4, 4.8, 5.2, 0.0, 8.2, 0.9), [4]),  # 8.2 %: 91.96 % of fit on later data against 95.1
    ((0.0, 0.0, 2.6, 0.0, 0.0), [0, 1, 3, 4]),  # 2.6 %: diverges on later data
    ((0.0, 0.05, 0.1), [0, 1]),
    ((0.9, 1.1, 1.15), [0, 1]),  # standard error 0.21
    ((None, 4.8, 0.9, None), [0, 2, 3]),
    ((None, None), [0, 1]),
])
def test_shares_compete_that_the_points_cannot_tell_from_the_least(percent, compete):
    """The first three are the gyroscope's of docs/benchmarks.md ("Poles over the range")."""
    assert least_unstable([None if s is None else s / 100 for s in percent]) == compete


@pytest.mark.parametrize("rho", [0.0, 0.6, 0.9])
def test_a_coloured_residual_counts_as_fewer_samples(rho):
    """Oracle: of a first-order residual Σ ρ^(2|j|) = (1 + ρ²)/(1 − ρ²)."""
    n = 40_000
    noise = lfilter([1.0], [1.0, -rho], np.random.default_rng(4).standard_normal(n))
    found = independent_samples(gain(1.0, 0.05), [measured(n, noise)])
    assert found == pytest.approx(n * (1 - rho**2) / (1 + rho**2), rel=0.08)


@pytest.mark.seconds
def test_poles_of_a_fold_refuse_nothing_but_those_of_all_data_do(monkeypatch):
    """Frozen poles are looked at once for a candidate, of its estimate on all records."""
    from lpvid.identification.selection import search

    rng = np.random.default_rng(0)
    u = rng.standard_normal(600)
    channels: Any = {"u": u, "y": lfilter([0, 0.1], [1.0, -0.9], u) + 0.02 * rng.standard_normal(600)}
    record = Record(channels, 0.01)
    structure, asked = lpv.OutputError(na=1, nb=1, nk=1, input="u", output="y"), []
    for share in (0.0, 0.004):
        asked.clear()

        def unstable(model, records, share=share):
            asked.append(sum(r.n_samples for r in records))
            return share

        monkeypatch.setattr(search, "unstable_share", unstable)
        if share:
            with pytest.raises(lpv.InputError, match=r"frozen pole outside at 0\.4 % of training samples"):
                select(record, [structure])
        else:
            found = select(record, [structure])
            assert found.best == structure and found.table[0].outside == 0.0
            assert len(found.table[0].esr_folds) == 6  # five blocks, and the stretches that go furthest
            assert np.mean(found.table[0].esr_folds) == pytest.approx(found.table[0].esr)
        assert asked == [600]


@pytest.mark.seconds
def test_the_better_family_is_taken_where_the_folds_cannot_tell(shared_data: Path):
    """A third of a measured damper's record: the ARX leads in the folds, quasi-LPV of fewer parameters on all of it.

    Before, the ARX was taken, whose free run on the rest of the record fits 80 %, that of the other 91 %."""
    record, = read(shared_data / "mr_damper_fixed_voltage" / "estimation.csv")
    common: dict[str, Any] = {"input": ("velocity",), "output": "force"}
    arx = lpv.ARX(**common, na=6, nb=7, nk=0, basis=lpv.Spline("velocity", 6, 1), lagged=True)
    quasi = lpv.QuasiLPV(**common, nb=4, basis=lpv.Spline("force", 10, 1), on="trial", trial=3, oddness=900.0)
    found = select([record.slice(1333, 2000)], [arx, quasi])
    by_folds = min((row for row in found.table if row.esr is not None), key=lambda row: row.esr)
    assert isinstance(by_folds.structure, lpv.ARX)
    assert isinstance(found.best, lpv.QuasiLPV)
