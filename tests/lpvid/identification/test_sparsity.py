"""Sparsity: true supports recovered, the path against coordinate descent, groups, several outputs."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.errors import InputError
from lpvid.identification import identify
from lpvid.identification._support import homotopy, variables_of
from lpvid.identification.arx import ARX
from lpvid.identification.sparsity import SparseARX, dependence, sparsify
from lpvid.record import Record
from lpvid.scheduling import Polynomial, Scheduling, Spline

FULL = ARX(na=3, nb=3, nk=1, input="u", output="y", basis=Polynomial(("p", "q"), degree=1))


def sparse_system(rng: np.random.Generator, n: int = 3000) -> tuple[Record, set[str]]:
    """A random stable system of order 2 with some of its 18 possible parameters, at 20 dB; the names of those."""
    pole = rng.uniform(0.3, 0.8) * np.exp(1j * rng.uniform(0.4, 2.0))
    a = np.zeros((3, 3))
    a[0, 0], a[1, 0] = -2 * pole.real, abs(pole) ** 2
    b = np.zeros((3, 3))
    b[0, 0] = 1.0
    b[1, 0] = rng.choice([0.0, rng.uniform(0.4, 0.8)])
    for table, size in ((a, 0.12), (b, 0.5)):
        for _ in range(2):
            table[rng.integers(2), rng.integers(1, 3)] = size * rng.choice([-1, 1]) * rng.uniform(0.7, 1.0)
    u, p, q = rng.normal(size=n), rng.uniform(-1, 1, n), rng.uniform(-1, 1, n)
    phi = np.column_stack([np.ones(n), p, q])

    def run(noise: np.ndarray) -> np.ndarray:
        y = np.zeros(n)
        for k in range(3, n):
            y[k] = noise[k] - sum((a[i] @ phi[k]) * y[k - 1 - i] for i in range(2))
            y[k] += sum((b[j] @ phi[k]) * u[k - 1 - j] for j in range(2))
        return y

    clean, e = run(np.zeros(n)), rng.normal(size=n)
    level = 0.1 * clean.std() / (run(e) - clean).std()
    record = Record({"u": u, "p": p, "q": q, "y": run(level * e)}, sample_time=0.01)
    names = {f"{part}{i + 1}[{label}]" for part, table in (("a", a), ("b", b)) for i in range(3)
             for label, value in zip(("1", "p", "q"), table[i], strict=True) if value}
    return record, names


def f1(found: set[str], true: set[str]) -> float:
    return 2 * len(found & true) / (len(found) + len(true))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["garrote", pytest.param("adaptive-lasso", marks=pytest.mark.slow)])
def test_recovers_the_support_of_random_systems(method):
    scores = []
    for seed in range(20):
        record, true = sparse_system(np.random.default_rng(seed))
        scores.append(f1(set(sparsify(record, FULL, method).parameter_names), true))
    assert np.mean(scores) >= 0.95


def test_cross_validation_finds_nearly_the_same(rng):
    record, true = sparse_system(rng)
    found = sparsify(record, FULL, criterion="cv")
    assert f1(set(found.parameter_names), true) > 0.8


def test_refit_is_least_squares_on_the_kept_columns(rng):
    """Oracle: numpy.lstsq on the columns that were kept, and the usual covariance."""
    record, _ = sparse_system(rng)
    found = sparsify(record, FULL)
    y, u, n = record["y"], record["u"], record.n_samples
    phi = FULL.basis.bound(found.model.box).evaluate(record.matrix(["p", "q"]))[3:]
    columns = []
    for part, lag, _, _, function in found.layout.table:
        signal = -y[3 - lag - 1: n - lag - 1] if part == 0 else u[3 - lag: n - lag]
        columns.append(signal * phi[:, function])
    x = np.column_stack(columns)
    theta, rss, *_ = np.linalg.lstsq(x, y[3:], rcond=None)
    np.testing.assert_allclose(found.parameters, theta, rtol=1e-9, atol=1e-12)
    expected = rss[0] / (len(x) - x.shape[1]) * np.linalg.inv(x.T @ x)
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-7, atol=1e-15)
    assert np.count_nonzero(found.model.a) + np.count_nonzero(found.model.b) == found.layout.size
    assert found.training.overall.one_step.fit_percent > 50
    assert "kept" in "".join(found.notes)


@pytest.mark.thinned(2, "slow", "seconds")
@pytest.mark.parametrize("positive", [True, False])
def test_path_solves_its_problem(rng, positive):
    """Oracle: coordinate descent, run to the end, at strengths all along the path."""
    z = rng.normal(size=(40, 8)) + 0.7 * rng.normal(size=(40, 1))
    y = z @ np.array([2.0, -1.0, 0, 0, 0.5, 0, 0, 0.2]) + 0.3 * rng.normal(size=40)
    path = homotopy(z, y, positive)
    top = np.abs(z.T @ y).max()
    for mu in top * np.logspace(-0.05, -3, 12):
        c = np.zeros(8)
        for _ in range(1500):
            before = c.copy()
            for j in range(8):
                rest = z[:, j] @ (y - z @ c + z[:, j] * c[j])
                c[j] = (max(rest - mu, 0.0) if positive else np.sign(rest) * max(abs(rest) - mu, 0.0))
                c[j] /= z[:, j] @ z[:, j]
            if np.array_equal(c, before):  # to the last digit: no further sweep moves anything
                break
        assert tuple(np.flatnonzero(c).tolist()) in path
    if not positive:
        assert path[-1] == tuple(range(8))


def test_a_variable_without_influence_drops_out_whole(rng):
    n = 1500
    u, p, q = rng.normal(size=n), rng.uniform(-1, 1, n), rng.uniform(2, 3, n)
    y = np.zeros(n)
    for k in range(1, n):
        y[k] = (0.5 + 0.2 * p[k]) * y[k - 1] + (1 + 0.6 * p[k]) * u[k - 1] + 0.05 * rng.normal()
    record = Record({"u": u, "p": p, "q": q, "y": y}, sample_time=0.01)
    arx = ARX(na=1, nb=1, input="u", output="y", basis=Polynomial(("p", "q"), degree=2))
    found = sparsify(record, arx, group="variable")
    assert all("q" not in v for v in dependence(found).values())
    assert "no coefficient depends on 'q'" in found.notes
    one = sparsify(record.with_channel("y", np.convolve(u, [0, 1.0])[:n] * (1 + p) + 0.4 * np.roll(u, 2)), arx,
                   group="coefficient")
    assert dependence(one)["b1"] == ("p",)


def test_outputs_keep_parameters_of_their_own(rng):
    n = 1500
    u, p = rng.normal(size=n), rng.uniform(-1, 1, n)
    y, z = np.zeros(n), np.zeros(n)
    for k in range(1, n):
        y[k] = 0.5 * y[k - 1] + (1 + p[k]) * u[k - 1] + 0.02 * rng.normal()
        z[k] = 0.3 * y[k - 1] - 0.6 * z[k - 1] + u[k - 1] + 0.02 * rng.normal()
    record = Record({"u": u, "p": p, "y": y, "z": z}, sample_time=0.01)
    found = sparsify(record, ARX(na=1, nb=1, input="u", output=("y", "z"), basis=Polynomial("p", degree=1)))
    assert set(found.parameter_names) == {"y:a1{y}[1]", "y:b1[1]", "y:b1[p]", "z:a1{y}[1]", "z:a1{z}[1]", "z:b1[1]"}
    truth = dict(zip(found.parameter_names, found.parameters, strict=True))
    assert truth["z:a1{y}[1]"] == pytest.approx(-0.3, abs=0.01)
    assert found.covariance.shape == (6, 6) and np.all(np.linalg.eigvalsh(found.covariance) > 0)


def test_standard_errors_allow_for_colour(rng):
    """With nothing to drop, the sandwich is that of the full ARX on the same columns."""
    n = 8000
    u, e, y = rng.normal(size=n), rng.normal(size=n), np.zeros(n)
    for k in range(1, n):
        y[k] = 0.6 * y[k - 1] + u[k - 1] + 0.5 * (e[k] + 0.9 * e[k - 1])
    record = Record({"u": u, "y": y}, sample_time=0.01)
    arx = ARX(na=1, nb=1, input="u", output="y")
    full, sparse = identify(record, arx), sparsify(record, arx)
    assert sparse.layout.size == full.layout.size
    assert any("sandwich" in note for note in sparse.notes)
    np.testing.assert_allclose(sparse.covariance, full.covariance, rtol=1e-6)


def test_which_function_depends_on_what():
    box = Scheduling(("p", "q"), (0.0, -1.0), (2.0, 1.0))
    listed = variables_of(Polynomial(("p", "q"), degree=2).bound(box), box)
    assert [set(v) for v in listed] == [set(), {"p"}, {"q"}, {"p"}, {"p", "q"}, {"q"}]


def test_mistakes(rng):
    record, _ = sparse_system(rng, 300)
    with pytest.raises(InputError, match="method must be one of"):
        sparsify(record, FULL, "lasso")
    with pytest.raises(InputError, match="groups are chosen by the garrote"):
        sparsify(record, FULL, "adaptive-lasso", group="variable")
    with pytest.raises(InputError, match="constant function"):
        SparseARX(ARX(basis=Spline("p")), group="variable")
    with pytest.raises(InputError, match="ridge"):
        SparseARX(ARX(ridge=0.1))
    assert identify(record, SparseARX(FULL)).structure.to_dict()["kind"] == "sparse-arx"
