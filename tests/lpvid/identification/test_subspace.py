"""The subspace estimate: words against kernels, known states, orders and predictions."""

from __future__ import annotations

import json
import tracemalloc

import numpy as np
import pytest
from helpers.state_space_systems import StateSpaceSystem

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.identification.subspace import Subspace, _thinned
from lpvid.identification.subspace_words import SPAN, KernelWords, Trace, WrittenWords, _kernel, number_of_words


def traces(rng: np.random.Generator, lengths: tuple[int, ...]) -> list[Trace]:
    out = []
    for n in lengths:
        phi = np.column_stack([np.ones(n), rng.uniform(-1, 1, (n, 1))])
        z = rng.normal(size=(n, 2))
        y = np.zeros((n, 1))
        for k in range(2, n):
            y[k] = 0.5 * z[k - 1, 0] + 0.3 * phi[k - 1, 1] * z[k - 2, 1] + 0.1 * rng.normal()
        out.append(Trace(phi, z, np.ones((n, 1)), y))
    return out


# -- words -----------------------------------------------------------------------------------------------------------
def test_kernel_is_the_sum_over_words(rng: np.random.Generator) -> None:
    """Inner product of all words, written out by loops over every combination of letters."""
    trace, past = traces(rng, (12,))[0], 3
    total = 0.0
    i, j = 7, 10
    for length in range(1, past + 1):
        for letters in np.ndindex(*(2,) * length):
            first = np.prod([trace.phi[i - 1 - t, letter] for t, letter in enumerate(letters)]) * trace.z[i - length]
            second = np.prod([trace.phi[j - 1 - t, letter] for t, letter in enumerate(letters)]) * trace.z[j - length]
            total += float(first @ second)
    assert _kernel(trace, np.array([i]), trace, np.array([j]), past)[0, 0] == pytest.approx(total, rel=1e-12)
    assert number_of_words(2, 2, 1, past) == 2 * (2 * (2 + 4 + 8) + 1)


def test_written_words_and_kernel_are_one_estimate(rng: np.random.Generator) -> None:
    data = traces(rng, (120, 90))
    letter = np.array([1.0, 0.1])
    written, kernel = WrittenWords.fit(data, 3), KernelWords.fit(data, 3, limit=10_000)
    assert kernel.penalty == pytest.approx(written.penalty, rel=1e-6)
    for trace in data:
        expected = written.rows(trace, letter, 3)
        np.testing.assert_allclose(kernel.rows(trace, letter, 3), expected, atol=1e-6 * np.abs(expected).max())
    assert expected.shape == (87, 3 * 2 * 1)


def test_words_of_a_long_record_are_written_in_parts(rng: np.random.Generator) -> None:
    """Ten minutes at 512 Hz took 1.4 GB: all words of all samples at once, which are the rows here."""
    long, = traces(rng, (20_000,))
    words = WrittenWords.fit(traces(rng, (300,)), 4)
    tracemalloc.start()
    rows = words.rows(long, np.array([1.0, 0.1]), 3)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < rows.nbytes + 0.5 * 8 * words.n_words * len(long.y)
    cut = 3 * SPAN // 2  # a part of the record gives the same rows
    part = Trace(*(a[:cut] for a in (long.phi, long.z, long.now, long.y)))
    np.testing.assert_array_equal(words.rows(part, np.array([1.0, 0.1]), 3), rows[: cut - 4])


def test_thinned_kernel_rows_spread_over_all_records(rng: np.random.Generator) -> None:
    kernel = KernelWords.fit(traces(rng, (300, 100)), 3, limit=80)
    sizes = [k.size for _, k in kernel.chosen]
    assert sum(sizes) <= 80 and sizes[0] > 2 * sizes[1]
    assert all(k[0] == 3 and k[-1] == len(t.y) - 1 for t, k in kernel.chosen)


# -- states and matrices ---------------------------------------------------------------------------------------------
@pytest.mark.thinned(2, "slow", "seconds")
@pytest.mark.parametrize("kernel", [False, True])
def test_noise_free_order_and_poles(kernel: bool) -> None:
    rng = np.random.default_rng(11)
    system = StateSpaceSystem(rng, 2, 1, 2, 2, radius=0.6)  # two outputs: past outputs give the state exactly
    record = system.record(rng, 1200, None)
    found = lpv.identify(record, Subspace(None, past=5, **system.settings, kernel=kernel))
    assert found.model.order == 2
    assert found.fit is not None and found.fit > 97
    for p in (-0.5, 0.0, 0.5):
        exact = np.linalg.eigvals(system.a[0] + p * system.a[1])
        np.testing.assert_allclose(np.sort_complex(found.model.frozen_poles([p])), np.sort_complex(exact), atol=0.03)


@pytest.mark.seconds
def test_two_by_two_close_to_the_system(rng: np.random.Generator) -> None:
    rng = np.random.default_rng(3)
    system = StateSpaceSystem(rng, 3, 2, 2, 3)
    training, fresh = system.record(rng, 3000, 20.0), system.record(rng, 1000, 20.0)
    found = lpv.identify(training, Subspace(None, **system.settings), held_out=[fresh])
    assert found.model.order == 3 and found.held_out is not None
    fit = found.held_out.overall.one_step.fit_percent
    assert fit is not None and fit > system.best_fit(fresh) - 3
    assert any("singular values" in note and "by its free run out of 4 folds" in note for note in found.notes)


@pytest.mark.seconds
def test_observer_gain_predicts_coloured_noise(rng: np.random.Generator) -> None:
    system = StateSpaceSystem(rng, 2, 1, 1, 2)
    system.k = 0.4 * np.linalg.pinv(system.c[0])
    training = system.record(rng, 4000, 10.0, innovation=True)
    fresh = system.record(rng, 2000, 10.0, innovation=True)
    found = lpv.identify(training, Subspace(2, **system.settings), held_out=[fresh])
    assert found.held_out is not None
    one, free = found.held_out.overall.one_step.rmse, found.held_out.overall.free_run.rmse
    innovation = 10 ** (-10 / 20) * fresh["y1 clean"].std()
    assert one is not None and free is not None
    assert one < 1.15 * innovation and one < free


def test_units_change_nothing(rng: np.random.Generator) -> None:
    system = StateSpaceSystem(rng, 2, 1, 1, 2)
    record = system.record(rng, 600, 25.0)
    scaled = record.with_channel("u1", 1e-3 * record["u1"]).with_channel("y1", 1e4 * record["y1"])
    settings = Subspace(2, past=4, **system.settings)
    first, second = lpv.identify(record, settings), lpv.identify(scaled, settings)
    np.testing.assert_allclose(1e4 * lpv.simulate(first.model, record).output,
                               lpv.simulate(second.model, scaled).output, rtol=1e-5, atol=1e-2)


def test_offsets_direct_term_and_several_records(rng: np.random.Generator) -> None:
    records = []
    for n in (900, 500):
        u, p = rng.normal(size=n), np.repeat(rng.uniform(-1, 1, n // 5), 5)
        x, y = 0.0, np.zeros(n)
        for k in range(n):
            y[k] = (1 + 0.5 * p[k]) * x + (0.7 - 0.2 * p[k]) * u[k] + 3 + p[k]
            x = (0.5 + 0.3 * p[k]) * x + u[k] + 0.5 * p[k]
        records.append(lpv.Record({"u": u, "p": p, "y": y + 0.01 * rng.normal(size=n)}, sample_time=1.0))
    found = lpv.identify(records, Subspace(1, input="u", output="y", basis=lpv.Polynomial("p", degree=1), direct=True,
                                           affine=True))
    assert found.fit is not None and found.fit > 97
    a, _, _, d = found.model.frozen([0.5])
    assert a[0, 0] == pytest.approx(0.65, abs=0.02) and d[0, 0] == pytest.approx(0.6, abs=0.02)


def test_a_spline_basis_without_an_explicit_constant(rng: np.random.Generator) -> None:
    n = 1500
    u, p = rng.normal(size=n), np.repeat(rng.uniform(0, 2, n // 5), 5)
    x, y = 0.0, np.zeros(n)
    for k in range(n):
        y[k] = x
        x = (0.2 + 0.6 * abs(p[k] - 1)) * x + u[k]
    record = lpv.Record({"u": u, "p": p, "y": y + 0.02 * rng.normal(size=n)}, sample_time=1.0)
    found = lpv.identify(record, Subspace(1, input="u", output="y", basis=lpv.Spline("p", segments=2, order=1)))
    assert found.fit is not None and found.fit > 90


def test_long_records_are_thinned_evenly() -> None:
    record = lpv.Record({"y": np.zeros(150_000)}, sample_time=1.0)
    used, notes = _thinned([record], past=6)
    assert sum(r.n_samples for r in used) <= 60_000 and "150000" in notes[0]
    assert used[0].start == 0 and used[-1].start + used[-1].n_samples == 150_000
    assert _thinned([record.slice(0, 1000)], past=6)[1] == []


def test_never_nan_on_hopeless_data(rng: np.random.Generator) -> None:
    n = 300
    record = lpv.Record({"u": rng.normal(size=n), "p": rng.uniform(-1, 1, n), "y": np.cumsum(rng.normal(size=n))},
                        sample_time=1.0)
    found = lpv.identify(record, Subspace(4, input="u", output="y", basis=lpv.Polynomial("p", degree=1)))
    assert np.isfinite(found.parameters).all() and np.isfinite(found.covariance).all()
    json.dumps(found.to_dict())


def test_says_what_it_cannot_do() -> None:
    basis = lpv.Polynomial("p", degree=1)
    with pytest.raises(InputError, match="order must lie between 1 and"):
        Subspace(40, input="u", output="y", basis=basis)
    with pytest.raises(InputError, match="p\\(k\\) alone"):
        Subspace(2, input="u", output="y", basis=lpv.Shifted(basis, 1))
    with pytest.raises(InputError, match="input and output at once"):
        Subspace(2, input="y", output="y", basis=basis)
    with pytest.raises(InputError, match="past"):
        Subspace(2, past=0, input="u", output="y", basis=basis)
