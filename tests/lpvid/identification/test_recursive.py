"""Recursive least squares against its textbook recursion and batch least squares; identification from streams."""

from __future__ import annotations

import itertools
import json
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lpvid.errors import InputError
from lpvid.files import read
from lpvid.files.streaming import read_chunks
from lpvid.identification import identify
from lpvid.identification.arx import ARX
from lpvid.identification.recursive import CovarianceReset, Recursive, RecursiveEstimator, VariableForgetting
from lpvid.identification.streaming import identify_stream
from lpvid.model.input_stage import TanhStage
from lpvid.model.scheduling_stage import SchedulingLag
from lpvid.record import Record
from lpvid.scheduling import Polynomial, Product, Scheduling, Shifted

TS = 0.01
PLAIN = ARX(2, 2, 1, "u", "y", Polynomial("p", 1))
RICH = ARX(2, 2, (0, 1), ("u", "w"), ("y", "z"), Polynomial("p", 2), affine=2, lagged=True)


def noise_record(rng: np.random.Generator, n: int, name: str = "r") -> Record:
    channels = {k: rng.normal(size=n) for k in ("u", "w", "y", "z")}
    return Record({**channels, "p": rng.uniform(1, 3, n), "weight": rng.uniform(0.1, 2, n)}, sample_time=TS, name=name)


def system(rng: np.random.Generator, n: int, jump: int | None = None, noise: float = 0.05) -> Record:
    """y(k) = (g + 0.2 p) y(k−1) + u(k−1), with g from 0.5 to −0.3 at the jump."""
    u, p, y, e = rng.normal(size=n), rng.uniform(-1, 1, n), np.zeros(n), noise * rng.normal(size=n)
    for k in range(1, n):
        g = 0.5 if jump is None or k < jump else -0.3
        y[k] = (g + 0.2 * p[k]) * y[k - 1] + u[k - 1] + e[k]
    return Record({"u": u, "p": p, "y": y}, sample_time=TS)


FIRST = ARX(1, 1, 1, "u", "y", Polynomial("p", 1))
BOX = Scheduling(("p",), (-1.0,), (1.0,))


def rows_of_first(data: Record) -> tuple[np.ndarray, np.ndarray]:
    """Regressor of `FIRST` over a box of −1 … 1, and the output."""
    y, u, p = data["y"], data["u"], data["p"][1:]
    return np.column_stack([-y[:-1], -y[:-1] * p, u[:-1], u[:-1] * p]), y[1:]


# -- equal to least squares ----------------------------------------------------------------------------------------
@pytest.mark.parametrize("structure", [PLAIN, RICH], ids=["SISO", "MIMO, affine, lagged"])
def test_without_forgetting_it_is_least_squares(rng, structure) -> None:
    records = [noise_record(rng, 700, "a"), noise_record(rng, 400, "b")]
    batch, running = identify(records, structure), identify(records, Recursive(structure, forgetting=1.0))
    np.testing.assert_allclose(running.parameters, batch.parameters, rtol=1e-8, atol=1e-11)
    np.testing.assert_allclose(running.covariance, batch.covariance, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(running.model.noise_covariance, batch.model.noise_covariance, rtol=1e-9)
    assert running.n_samples == batch.n_samples
    assert running.condition == pytest.approx(batch.condition, rel=1e-6)
    assert running.scaled_condition == pytest.approx(batch.scaled_condition, rel=1e-6)
    json.dumps(running.to_dict())


def test_badly_conditioned_data_too(rng) -> None:
    """Scheduling in a narrow band, cubic basis before binding, slow input: condition above 1e5."""
    n = 4000
    u = np.cumsum(rng.normal(size=n)) * 1e-2 + 1e-3 * rng.normal(size=n)
    y = np.convolve(u, 0.9 ** np.arange(60))[:n] + 1e-3 * rng.normal(size=n)
    data = Record({"u": u, "p": np.sin(np.arange(n) / 300), "y": y}, sample_time=TS)
    structure = ARX(4, 4, 1, "u", "y", Polynomial("p", 3))
    batch, running = identify(data, structure), identify(data, Recursive(structure, 1.0))
    assert batch.condition > 1e4
    np.testing.assert_allclose(running.parameters, batch.parameters, rtol=1e-8, atol=1e-8)


@given(seed=st.integers(0, 1000), forgetting=st.floats(0.9, 1.0))
@settings(max_examples=15)
def test_forgetting_is_exponential_weighting(seed, forgetting) -> None:
    data = system(np.random.default_rng(seed), 150)
    running = RecursiveEstimator(Recursive(FIRST, forgetting, reset=None), BOX, TS)
    running.follow(data)
    x, y = rows_of_first(data)
    weight = forgetting ** np.arange(len(y) - 1, -1, -1)
    gram = (x * weight[:, None]).T @ x
    want = np.linalg.solve(gram, (x * weight[:, None]).T @ y)
    np.testing.assert_allclose(running.parameters, want, rtol=1e-7, atol=1e-9)
    spread = np.linalg.inv(gram)
    residual = np.sum(weight * (y - x @ want) ** 2) / (weight.sum() - 4 * np.sum(weight**2) / weight.sum())
    np.testing.assert_allclose(running.covariance, residual * spread * np.sum(weight**2) / weight.sum(), rtol=1e-6)


def test_the_recursion_of_the_textbook(rng) -> None:
    """K = Pφ/(λ + φᵀPφ), P ← (P − KφᵀP)/λ from P = 1e5 I, with full matrices."""
    data = system(rng, 300)
    x, y = rows_of_first(data)
    theta, P, errors = np.zeros(4), 1e5 * np.eye(4), []
    for phi, target in zip(x, y, strict=True):
        gain = P @ phi / (0.98 + phi @ P @ phi)
        errors.append(target - phi @ theta)
        theta = theta + gain * errors[-1]
        P = (P - np.outer(gain, phi) @ P) / 0.98
    running = RecursiveEstimator(Recursive(FIRST, 0.98, initial_covariance=1e5), BOX, TS)
    found = running.update(data["y"][:, None], data["u"][:, None], data["p"][:, None])
    np.testing.assert_allclose(running.parameters, theta, rtol=1e-8)
    np.testing.assert_allclose(found.ravel(), errors, rtol=1e-6, atol=1e-9)


# -- tracking ------------------------------------------------------------------------------------------------------
def test_tracks_a_jump_and_keeps_the_history(rng) -> None:
    data = system(rng, 3000, jump=1500)
    found = identify(data, Recursive(FIRST, 0.98, history=10))
    assert found.history is not None
    g, at = -found.history.parameters[:, 0], found.history.equations  # the box is −1 … 1 to three digits
    assert np.abs(g[(at > 1000) & (at < 1490)] - 0.5).max() < 0.1
    assert np.abs(g[at > 1800] + 0.3).max() < 0.1
    np.testing.assert_allclose(found.history.parameters[-1], found.parameters, atol=0.05)
    frozen = identify(data, Recursive(FIRST, 1.0))
    assert 0.0 < -frozen.parameters[0] < 0.4  # an average of both


def test_variable_forgetting_is_quicker_and_quieter(rng) -> None:
    """Against constant forgetting of the same memory: nearer after the jump, no noisier in steady state."""
    data = system(rng, 4000, jump=3000)
    paths = {}
    for name, forgetting in (("variable", VariableForgetting(memory=500, lowest=0.7)), ("constant", 1 - 1 / 500)):
        found = identify(data, Recursive(FIRST, forgetting, history=1))
        assert found.history is not None
        paths[name] = -found.history.parameters[:, 0]
    late = {k: np.abs(v[3040:3100] + 0.3).mean() for k, v in paths.items()}
    steady = {k: np.std(v[2000:2990]) for k, v in paths.items()}
    assert late["variable"] < 0.25 * late["constant"]
    assert steady["variable"] < 2 * steady["constant"]


def test_wind_up_is_stopped_by_a_reset(rng) -> None:
    """A long rest under forgetting blows the covariance up; with a reset it stays, and so do the parameters."""
    n = 6000
    data = system(rng, n, noise=0.01)
    u, y = data["u"].copy(), data["y"].copy()
    u[1000:] = 0.0
    y[1000:] = 1e-3 * rng.normal(size=n - 1000)
    rest = Record({"u": u, "p": data["p"], "y": y}, sample_time=TS)
    free, held = (RecursiveEstimator(Recursive(FIRST, 0.99, reset=r), BOX, TS) for r in (None, CovarianceReset()))
    free.follow(rest)
    held.follow(rest)
    assert held.resets > 0 and free.resets == 0
    assert np.trace(held.covariance) < 1e-3 * np.trace(free.covariance)
    assert np.isfinite(held.parameters).all()


def test_reset_on_demand_wakes_a_sleeping_estimate(rng) -> None:
    first, second = system(rng, 3000), system(rng, 400, jump=0)
    asleep, woken = (RecursiveEstimator(Recursive(FIRST, 1.0), BOX, TS) for _ in range(2))
    for running in (asleep, woken):
        running.follow(first)
    before = woken.parameters
    woken.reset()
    np.testing.assert_array_equal(woken.parameters, before)
    for running in (asleep, woken):
        running.follow(second)
    assert abs(-woken.parameters[0] + 0.3) < 0.03 < abs(-asleep.parameters[0] + 0.3)
    lively = RecursiveEstimator(Recursive(FIRST, 1.0, reset=CovarianceReset(below=0.01, to=1.0)), BOX, TS)
    lively.follow(first)
    lively.follow(second)
    assert lively.resets > 5
    assert abs(-lively.parameters[0] + 0.3) < 0.05


# -- online --------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("structure", [Recursive(RICH, 0.99, history=7), Recursive(RICH, VariableForgetting(300)),
                                       Recursive(RICH, 0.99, initial_covariance=1e4)],
                         ids=["constant", "variable", "prior"])
def test_sample_by_sample_in_blocks_and_after_a_restart(rng, structure) -> None:
    data = noise_record(rng, 300)
    box = Scheduling(("p",), (1.0,), (3.0,))
    y, u, p = data.matrix(("y", "z")), data.matrix(("u", "w")), data.matrix(("p",))
    whole = RecursiveEstimator(structure, box, TS)
    errors = whole.update(y, u, p)
    single, parts = RecursiveEstimator(structure, box, TS), []
    for k in range(300):
        if k in (20, 170):  # in the exact start, and past it
            single = RecursiveEstimator.restore(structure, json.loads(json.dumps(single.state())))
        parts.append(single.update(y[k], u[k], p[k]))
    np.testing.assert_allclose(single.parameters, whole.parameters, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(single.covariance, whole.covariance, rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(single.trail, whole.trail, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(np.vstack(parts), errors, rtol=1e-8, atol=1e-9)
    assert single.equations == 300 - RICH.start == len(errors)


def test_the_online_model_predicts(rng) -> None:
    data = system(rng, 500, noise=0.0)
    running = RecursiveEstimator(Recursive(FIRST, 1.0), BOX, TS)
    assert not running.ready and np.isnan(running.parameters).all()
    with pytest.raises(InputError, match="do not determine the parameters yet"):
        _ = running.model
    errors = running.update(data["y"][:, None], data["u"][:, None], data["p"][:, None])
    assert np.isnan(errors[:9]).all() and np.abs(errors[9:]).max() < 1e-10
    np.testing.assert_allclose(running.model.frozen_poles([0.5]), [0.6], atol=1e-9)


@pytest.mark.parametrize(("make", "stated"), [
    (lambda: Recursive(FIRST, 0.0), "forgetting must lie above 0"),
    (lambda: Recursive(FIRST, 1.5), "forgetting must lie above 0"),
    (lambda: Recursive(ARX(stage="tanh")), "cannot fit a stage"),
    (lambda: Recursive(ARX(ridge=0.1)), "no ridge"),
    (lambda: Recursive(FIRST, VariableForgetting(), initial_covariance=1.0), "exact start"),
    (lambda: Recursive(FIRST, initial_covariance=-1.0), "must be positive"),
    (lambda: CovarianceReset(below=6.0, to=5.0), "below <= to"),
    (lambda: VariableForgetting(memory=0), "must be positive"),
    (lambda: RecursiveEstimator(Recursive(FIRST), BOX, TS).update([1.0], [np.nan], [0.0]), "must be finite"),
    (lambda: RecursiveEstimator(Recursive(FIRST), BOX, TS).update([1.0, 2.0], [1.0], [0.0]), "shape"),
    (lambda: RecursiveEstimator.restore(Recursive(FIRST), {"schema": "?"}), "another structure"),
    (lambda: identify_stream(iter([]), Recursive(FIRST)), "known before the fit"),
    (lambda: identify_stream([], FIRST), "no usable samples"),
])
def test_what_is_refused(make, stated) -> None:
    with pytest.raises(InputError, match=stated):
        make()


def test_undetermined_parameters_are_refused(rng) -> None:
    data = system(rng, 100)
    with pytest.raises(InputError, match="cannot separate some parameters"):
        identify(data.with_channel("v", 2 * data["u"]), Recursive(ARX(1, 1, 1, ("u", "v"), "y", Polynomial("p", 1))))
    with pytest.raises(InputError, match="cannot determine"):
        identify(data.slice(0, 5), Recursive(FIRST))


# -- streams -------------------------------------------------------------------------------------------------------
AHEAD = Product(Shifted(Polynomial("p", 1), 3), Shifted(Polynomial("p", 1), -2))
STREAMED = {
    "plain": PLAIN, "rich": RICH,
    "weights": ARX(2, 2, 1, "u", "y", Polynomial("p", 1), weight="weight"),
    "stages": ARX(2, 2, 1, "u", "y", Polynomial("p", 1), stage=TanhStage(0.8),
                  schedule_filter=SchedulingLag(0.03, 0.05, 0.015)),
    "p ahead and behind": ARX(2, 2, 1, "u", "y", AHEAD),
}


@pytest.mark.parametrize("name", STREAMED)
def test_a_stream_gives_the_batch_result(rng, name) -> None:
    records = [noise_record(rng, 900, "a"), noise_record(rng, 500, "b")]
    y = records[0]["y"].copy()
    y[[300, 301, 555]] = np.nan
    records[0] = records[0].with_channel("y", y)
    edges = [0, 2, 130, 301, 303, 470, 900]  # missing samples at a border, and a chunk shorter than the lags
    chunks = [records[0].slice(a, b) for a, b in itertools.pairwise(edges)]
    chunks += [records[1].slice(0, 250), records[1].slice(250, 500)]
    structure = STREAMED[name]
    batch, stream = identify(records, structure), identify_stream(chunks, structure)
    assert stream.n_samples == batch.n_samples
    np.testing.assert_allclose(stream.parameters, batch.parameters, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(stream.covariance, batch.covariance, rtol=1e-9, atol=1e-14)
    assert stream.model.sample_time == pytest.approx(TS, rel=1e-12)
    assert stream.model.metadata["training"]["records"] == ["a", "b"]
    if name == "plain":
        described = float(stream.notes[-1].split("one-step ESR ")[1])
        assert described == pytest.approx(batch.training.overall.one_step.esr, rel=0.02)


def test_chunks_that_do_not_continue_each_other(rng) -> None:
    """The same samples as two records lose the rows at the border; as generator with a box, in one run."""
    whole = noise_record(rng, 400)
    box = Scheduling(("p",), (1.0,), (3.0,))
    joined = identify_stream((whole.slice(a, a + 100) for a in range(0, 400, 100)), PLAIN, box=box)
    cut = [Record({k: c.values for k, c in whole.slice(a, a + 100).channels.items()}, sample_time=TS, name=f"r{a}")
           for a in range(0, 400, 100)]
    apart = identify_stream(cut, PLAIN, box=box)
    assert (joined.n_samples, apart.n_samples) == (398, 392)
    assert joined.notes[-1].startswith("identified from a stream of 400 samples in 1 record(s)")


def test_recursive_from_a_stream(rng) -> None:
    whole = system(rng, 800)
    chunks = [whole.slice(a, a + 160) for a in range(0, 800, 160)]
    structure = Recursive(FIRST, 0.99)
    stream, batch = identify_stream(chunks, structure), identify(whole, structure)
    np.testing.assert_allclose(stream.parameters, batch.parameters, rtol=1e-9)


def test_stream_refusals(rng) -> None:
    data = noise_record(rng, 100)
    still = data.with_channel("u", np.ones(100))
    with pytest.raises(InputError, match="'u' never moves"):
        identify_stream([still], PLAIN)
    with pytest.raises(InputError, match="constant over the whole data set"):
        identify_stream([data.with_channel("p", np.ones(100))], PLAIN)
    with pytest.raises(InputError, match="changes its sampling rate"):
        identify_stream([data, Record(dict(data.channels), sample_time=0.02)], PLAIN)
    with pytest.raises(InputError, match="cannot fit an input stage"):
        identify_stream([data], ARX(2, 2, 1, "u", "y", Polynomial("p", 1), stage="tanh"))


# -- files larger than memory --------------------------------------------------------------------------------------
def write_csv(path: Path, data: Record, times: np.ndarray) -> Path:
    table = np.column_stack([times, 1e3 * data["u"], data["p"], data["y"]])
    np.savetxt(path, table, fmt="%.17g", delimiter=",", header="time [s],u [mm/s],p [A],y [N]", comments="")
    return path


def test_a_csv_in_parts_is_the_csv(rng, tmp_path) -> None:
    data = noise_record(rng, 1001)
    path = write_csv(tmp_path / "run.csv", data, TS * np.arange(1001))
    whole, parts = read(path)[0], list(read_chunks(path, rows=200))
    assert [c.n_samples for c in parts] == [200, 200, 200, 200, 201]
    for name in ("u", "p", "y"):
        np.testing.assert_array_equal(np.concatenate([c[name] for c in parts]), whole[name])
        assert parts[3].unit(name) == whole.unit(name)
    np.testing.assert_allclose(np.concatenate([c.times for c in parts]), whole.times, atol=1e-12)
    stream, batch = identify_stream(read_chunks(path, rows=200), PLAIN), identify(whole, PLAIN)
    np.testing.assert_allclose(stream.parameters, batch.parameters, rtol=1e-10, atol=1e-12)


def test_missing_samples_text_and_disorder_in_a_csv(tmp_path) -> None:
    head = "time [s];u;y\n"
    lines = [f"{0.5 * k:g};{k};{(k % 3) ** 2}".replace(".", ",") for k in range(12)]
    lines[7] = "3,5;;1"
    path = tmp_path / "a.csv"
    path.write_text(head + "\n".join(lines))
    parts = list(read_chunks(path, rows=5))
    assert np.isnan(parts[1]["u"][2]) and parts[1].start == 2.5
    lines[7] = "3,5;oops;1"
    path.write_text(head + "\n".join(lines))
    assert list(read_chunks(path, rows=5))[1].channel("u").fault == "text 'oops' in row 8 (line 9 of the file)"
    with pytest.raises(InputError, match="not all numbers"):
        identify_stream(read_chunks(path, rows=5), ARX(1, 1, 1, "u", "y"))
    lines[5], lines[7] = "2;5;1", "3,5;7;1"
    path.write_text(head + "\n".join(lines))
    with pytest.raises(InputError, match="time repeats in row 6 with another value of 'u'"):
        identify_stream(read_chunks(path, rows=5), ARX(1, 1, 1, "u", "y"))
    path.write_text("u,y\n1,2\n2,3\n3,4\n5,6\n")
    assert [c.start for c in read_chunks(path, rows=2, sample_rate=10.0)] == pytest.approx([0.0, 0.2])


def test_parquet_in_parts(rng, tmp_path) -> None:
    pa = pytest.importorskip("pyarrow")
    import pyarrow.parquet as pq

    stamps = np.datetime64("2024-05-01T12:00:00", "ms") + (10 * np.arange(501)).astype("timedelta64[ms]")
    table = pa.table({"time": stamps, "u [mm/s]": rng.normal(size=501), "y [N]": rng.normal(size=501)})
    path = tmp_path / "run.parquet"
    pq.write_table(table, path)
    whole, parts = read(path)[0], list(read_chunks(path, rows=100))
    assert sum(c.n_samples for c in parts) == 501 and parts[-1].n_samples > 1
    np.testing.assert_allclose(np.concatenate([c.times for c in parts]), whole.times, atol=1e-12)
    np.testing.assert_array_equal(np.concatenate([c["u"] for c in parts]), whole["u"])


@pytest.mark.seconds
def test_memory_does_not_grow_with_the_file(rng, tmp_path) -> None:
    """200 000 rows in parts of 10 000 need a fraction of what the samples themselves fill."""
    n = 200_000
    data = noise_record(rng, n)
    path = write_csv(tmp_path / "long.csv", data, TS * np.arange(n))
    short = write_csv(tmp_path / "short.csv", data.slice(0, 500), TS * np.arange(500))
    identify_stream(read_chunks(short, rows=100), PLAIN)  # loads and compiles what is not counted
    tracemalloc.start()
    found = identify_stream(read_chunks(path, rows=10_000), PLAIN)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found.n_samples == n - PLAIN.start
    assert peak < 6e6 < n * 4 * 8 < path.stat().st_size


def test_what_cannot_be_read_in_parts(tmp_path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_chunks(tmp_path / "none.csv")
    (tmp_path / "a.mat").write_bytes(b"x")
    with pytest.raises(InputError, match="cannot be read in parts"):
        read_chunks(tmp_path / "a.mat")
    (tmp_path / "b.csv").write_bytes(b"")
    with pytest.raises(InputError, match="empty"):
        list(read_chunks(tmp_path / "b.csv"))
