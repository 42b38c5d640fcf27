"""Free run, one-step and k-step prediction against plain loops, a banded solve, and an explicit observer."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_banded

from lpvid.errors import InputError
from lpvid.model.input_stage import TanhStage
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Channel, Record
from lpvid.scheduling import Polynomial, Shifted, Stacked
from lpvid.simulation import predict, simulate

TS = 0.01
QUADRATIC = Polynomial("p", degree=2)
TWO = Polynomial(("p", "q"), degree=1)
DYNAMIC = Stacked((Polynomial("p", degree=1), Shifted(Polynomial("p", degree=1), 2)))


# -- oracles ----------------------------------------------------------------------------------------------------
def phi_at(basis, p: np.ndarray, k: int) -> np.ndarray:
    """Basis functions at sample k, one shift at a time; p holds its ends."""
    if isinstance(basis, Stacked):
        return np.concatenate([phi_at(f, p, k) for f in basis.factors])
    if isinstance(basis, Shifted):
        return phi_at(basis.basis, p, k - basis.lag)
    values = p[min(max(k, 0), len(p) - 1)]
    return np.array([np.prod(values**e) for e in basis.exponents])


def equation(
    model: LPVTransferFunction, u: np.ndarray, p: np.ndarray, past: dict[int, np.ndarray], k: int
) -> np.ndarray:
    """Right-hand side of the defining equation at sample k, with `past` outputs by sample number."""
    total = np.zeros(model.n_outputs)
    assert model.c is not None
    for i in range(1, model.na + 1):
        total -= (model.a[i - 1] @ phi_at(model.basis, p, k - i if model.lagged else k)) @ past[k - i]
    for j in range(model.n_lags):
        total += (model.b[j] @ phi_at(model.basis, p, k - j if model.lagged else k)) @ u[k - j]
    for j in range(model.n_affine):
        total += model.c[j] @ phi_at(model.basis, p, k - j)
    return total


def naive(model: LPVTransferFunction, u, p, y, horizon: int | None) -> np.ndarray:
    """`horizon` steps ahead of every sample, or the free run, in nested plain loops."""
    out = np.array(y, dtype=float)
    if horizon is None:
        past = {t: np.array(y[t]) for t in range(model.start)}
        for k in range(model.start, len(y)):
            past[k] = out[k] = equation(model, u, p, past, k)
        return out
    for k in range(model.start, len(y)):
        first = max(k - horizon + 1, model.start)
        past = {t: np.array(y[t]) for t in range(first)}
        for t in range(first, k + 1):
            past[t] = equation(model, u, p, past, t)
        out[k] = past[k]
    return out


def naive_states(model: LPVStateSpace, u, p, x0, y=None) -> np.ndarray:
    """The state-space run, or, given y, the observer's one-step prediction."""
    x, out = np.array(x0, dtype=float), []
    for k in range(len(u)):
        phi = phi_at(model.basis, p, k)
        a, b, c, d, f, g = (
            np.tensordot(phi, z, axes=1)
            for z in (model.A, model.B, model.C, model.D, model.state_offset, model.output_offset)
        )
        out.append(c @ x + d @ u[k] + g)
        x = a @ x + b @ u[k] + f
        if y is not None:
            x = x + np.tensordot(phi, model.observer_gain, axes=1) @ (y[k] - out[-1])
    return np.array(out)


# -- cases ------------------------------------------------------------------------------------------------------
def io_model(rng, basis=QUADRATIC, na=3, lags=4, ny=1, nu=1, affine=0, lagged=False, gain=0.12) -> LPVTransferFunction:
    m = basis.size
    b = rng.normal(size=(lags, ny, nu, m))
    b[0] = 0.0 if lags > 2 else b[0]  # a structural delay where there is room for one
    return LPVTransferFunction(
        gain * rng.uniform(-1, 1, (na, ny, ny, m)),
        b,
        basis,
        TS,
        c=rng.normal(size=(affine, ny, m)),
        lagged=lagged,
        inputs=tuple(f"u{i}" for i in range(nu)),
        outputs=tuple(f"y{i}" for i in range(ny)),
    )


def ss_model(rng, basis=QUADRATIC, n=3, ny=2, nu=2, gain=True) -> LPVStateSpace:
    m = basis.size
    return LPVStateSpace(
        0.15 * rng.uniform(-1, 1, (m, n, n)),
        rng.normal(size=(m, n, nu)),
        rng.normal(size=(m, ny, n)),
        rng.normal(size=(m, ny, nu)),
        basis,
        TS,
        state_offset=rng.normal(size=(m, n)),
        output_offset=rng.normal(size=(m, ny)),
        inputs=tuple(f"u{i}" for i in range(nu)),
        outputs=tuple(f"y{i}" for i in range(ny)),
        observer_gain=0.05 * rng.normal(size=(m, n, ny)) if gain else None,
    )


def data(rng, model, n=60):
    names = model.box.names
    u = rng.normal(size=(n, len(model.inputs)))
    p = rng.uniform(-1, 1, (n, len(names)))
    y = rng.normal(size=(n, model.n_outputs))
    channels = {s.name: u[:, i] for i, s in enumerate(model.inputs)}
    channels |= {v: p[:, i] for i, v in enumerate(names)} | {s.name: y[:, i] for i, s in enumerate(model.outputs)}
    return Record(channels, sample_time=TS, name="run"), u, p, y


def with_outputs(record: Record, model, y: np.ndarray) -> Record:
    for i, s in enumerate(model.outputs):
        record = record.with_channel(s.name, y[:, i])
    return record


CASES = [
    {},
    {"lagged": True},
    {"affine": 3},
    {"affine": 6, "lagged": True},
    {"na": 0},
    {"na": 1, "lags": 1},
    {"na": 6},
    {"na": 5, "lags": 2, "affine": 1},
    {"ny": 2, "nu": 3},
    {"ny": 3, "nu": 2, "lagged": True, "affine": 2},
    {"basis": TWO},
    {"basis": TWO, "ny": 2, "lagged": True},
    {"basis": DYNAMIC},
    {"basis": DYNAMIC, "lagged": True},
    {"basis": Shifted(QUADRATIC, -1)},
    {"basis": Polynomial()},
    {"basis": Polynomial("p", degree=4), "nu": 2},
]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_the_free_run_is_the_equation_in_plain_loops(case: dict, rng: np.random.Generator) -> None:
    model = io_model(rng, **case)
    record, u, p, y = data(rng, model)
    run = simulate(model, record)
    assert (run.start, run.horizon, run.diverged_at, run.kind) == (model.start, None, None, "free-run")
    np.testing.assert_allclose(run.output, naive(model, u, p, y, None), rtol=1e-10, atol=1e-12)
    assert np.array_equal(run.output[: run.start], y[: run.start])


@pytest.mark.parametrize("case", CASES, ids=str)
@pytest.mark.parametrize("horizon", [1, 2, 5])
def test_predictions_are_the_equation_in_plain_loops(case: dict, horizon: int, rng: np.random.Generator) -> None:
    model = io_model(rng, **case)
    record, u, p, y = data(rng, model, 40)
    ahead = predict(model, record, horizon)
    assert ahead.kind == ("one-step" if horizon == 1 else f"{horizon}-step")
    np.testing.assert_allclose(ahead.output, naive(model, u, p, y, horizon), rtol=1e-10, atol=1e-12)


def test_one_step_is_the_equation_on_measured_data(rng: np.random.Generator) -> None:
    model = io_model(rng, ny=2, nu=2, affine=2)
    record, u, p, y = data(rng, model)
    measured = dict(enumerate(y))
    expected = [equation(model, u, p, measured, k) for k in range(model.start, len(y))]
    np.testing.assert_allclose(predict(model, record).output[model.start :], expected, rtol=1e-11)


@pytest.mark.parametrize("case", CASES[:6], ids=str)
def test_a_horizon_beyond_the_record_is_the_free_run(case: dict, rng: np.random.Generator) -> None:
    model = io_model(rng, **case)
    record, *_ = data(rng, model)
    np.testing.assert_allclose(predict(model, record, 1000).output, simulate(model, record).output, rtol=1e-11)


@pytest.mark.parametrize("n", [37, 511, 512, 513, 5000, 20_000])
@pytest.mark.parametrize("na", [1, 4, 5])
def test_a_banded_triangular_solve_agrees(n: int, na: int, rng: np.random.Generator) -> None:
    model = io_model(rng, na=na, lags=3)
    record, u, p, _ = data(rng, model, n)
    phi = p ** np.arange(3)
    bands = np.vstack([np.ones(n), np.zeros((na, n))])
    for i in range(1, na + 1):
        bands[i, : n - i] = (phi @ model.a[i - 1, 0, 0])[i:]  # row k, column k−i, stored by column
    forced = np.zeros(n)
    for j in range(3):
        forced[j:] += (phi @ model.b[j, 0, 0])[j:] * u[: n - j, 0]
    np.testing.assert_allclose(
        simulate(model, record, "zero").output[:, 0], solve_banded((na, 0), bands, forced), rtol=1e-9, atol=1e-11
    )


def test_published_second_order_case() -> None:
    model = LPVTransferFunction.siso(
        [[-1.2, 0.3], [0.5, -0.2]], [[0, 0], [0.4, 0.1], [0.1, -0.3]], Polynomial("p"), 1.0
    )
    record = Record({"u1": [1.0, 0, 0, 1, 1, 0, 0, 0], "p": [0, 1, 0, -1, 0.5, -0.5, 1, 0]}, sample_time=1.0)
    expected = [0, 0.5, 0.7, 0.7, 0.905, 1.40175, 0.790075, 0.247215]
    np.testing.assert_allclose(simulate(model, record, "zero").output.ravel(), expected, atol=1e-14)
    at_input = [0, 0.4, 0.46, 0.432, 0.718, 1.3015, 1.419825, 0.4969425]
    np.testing.assert_allclose(
        simulate(model.replace(lagged=True), record, "zero").output.ravel(), at_input, atol=1e-14
    )
    direct = LPVTransferFunction.siso(
        [[-1.2, 0.3], [0.5, -0.2]], [[0.2, 0.1], [0.4, 0.1], [0.1, -0.3]], Polynomial("p"), 1.0
    )
    with_b0 = [0.2, 0.68, 0.816, 0.848, 1.264, 1.7976, 1.03864, 0.347568]
    np.testing.assert_allclose(simulate(direct, record, "zero").output.ravel(), with_b0, atol=1e-14)


@pytest.mark.parametrize("basis", [QUADRATIC, TWO, DYNAMIC, Polynomial()], ids=lambda b: f"M={b.size}")
def test_state_space_runs_are_plain_loops(basis, rng: np.random.Generator) -> None:
    model = ss_model(rng, basis)
    record, u, p, _ = data(rng, model)
    x0 = rng.normal(size=3)
    np.testing.assert_allclose(simulate(model, record, x0).output, naive_states(model, u, p, x0), rtol=1e-10)
    np.testing.assert_allclose(
        simulate(model, record, "zero").output, naive_states(model, u, p, np.zeros(3)), rtol=1e-10
    )


def test_an_observer_predicts_one_step(rng: np.random.Generator) -> None:
    model = ss_model(rng)
    record, u, p, _ = data(rng, model, 200)
    x0 = rng.normal(size=3)
    clean = naive_states(model, u, p, x0)
    exact = with_outputs(record, model, clean)  # noise-free, so that the estimated start is x0 itself
    np.testing.assert_allclose(predict(model, exact).output, clean, atol=1e-8)
    noisy = clean.copy()
    noisy[model.start :] += rng.normal(size=clean[model.start :].shape)  # after the start: x0 is still exact
    step = predict(model, with_outputs(record, model, noisy))
    np.testing.assert_allclose(step.output, naive_states(model, u, p, x0, noisy), atol=1e-7)
    far = predict(model, with_outputs(record, model, noisy), 1000)
    np.testing.assert_allclose(far.output, clean, atol=1e-7)


def test_without_a_noise_model_every_horizon_is_the_free_run(rng: np.random.Generator) -> None:
    model = ss_model(rng, gain=False)
    record, *_ = data(rng, model)
    free = simulate(model, record)
    for horizon in (1, 7):
        ahead = predict(model, record, horizon)
        assert np.array_equal(ahead.output, free.output)
        assert ahead.initial == "measured (no noise model)"


# -- initial conditions -----------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "case",
    [
        {"lagged": True},
        {"affine": 3},
        {"basis": DYNAMIC, "lagged": True, "affine": 2},
        {"basis": Shifted(QUADRATIC, -1)},
    ],
    ids=str,
)
def test_before_a_run_from_rest_input_and_output_are_zero_and_the_scheduling_holds(
    case: dict, rng: np.random.Generator
) -> None:
    model = io_model(rng, **case)
    record, u, p, y = data(rng, model)
    s = model.start
    long_u, long_p = np.vstack([np.zeros((s, u.shape[1])), u]), np.vstack([np.repeat(p[:1], s, axis=0), p])
    expected = naive(model, long_u, long_p, np.zeros((s + len(y), model.n_outputs)), None)[s:]
    np.testing.assert_allclose(simulate(model, record, "zero").output, expected, rtol=1e-10, atol=1e-12)


def test_the_given_past_is_where_the_run_starts(rng: np.random.Generator) -> None:
    model = io_model(rng, ny=2, nu=2)
    record, u, p, y = data(rng, model)
    past = rng.normal(size=(model.start, 2))
    mixed = np.vstack([past, y[model.start :]])
    np.testing.assert_allclose(simulate(model, record, past).output, naive(model, u, p, mixed, None), rtol=1e-10)


@pytest.mark.parametrize(
    "case",
    [
        {"na": 3, "lags": 3},
        {"na": 2, "lags": 2, "ny": 2, "nu": 2},
        {"na": 3, "affine": 2},
        {"na": 0, "lags": 1},
        {"na": 2, "lags": 1, "lagged": True},
    ],
    ids=str,
)
def test_an_estimated_past_is_exact_without_noise(case: dict, rng: np.random.Generator) -> None:
    """The record starts in the middle of a motion; before it, the input was at rest."""
    model = io_model(rng, gain=0.3, **case)
    record, u, p, _ = data(rng, model, 300)
    s = model.start
    past = 5 * rng.normal(size=(s, model.n_outputs))
    long_u, long_p = np.vstack([np.zeros((s, u.shape[1])), u]), np.vstack([np.repeat(p[:1], s, axis=0), p])
    y = naive(model, long_u, long_p, np.vstack([past, np.zeros((300, model.n_outputs))]), None)[s:]
    run = simulate(model, with_outputs(record, model, y), "estimate")
    assert (run.start, run.initial) == (0, "estimated past")
    np.testing.assert_allclose(run.output, y, atol=1e-8 * np.abs(y).max())


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_an_estimated_state_is_exact_without_noise(scale: float, rng: np.random.Generator) -> None:
    model = ss_model(rng)
    model = model.replace(state_offset=scale * model.state_offset, output_offset=scale * model.output_offset)  # type: ignore[operator]
    record, u, p, _ = data(rng, model, 300)
    record = Record(
        {k: scale * c.values if k.startswith("u") else c.values for k, c in record.channels.items()}, sample_time=TS
    )
    y = naive_states(model, scale * u, p, scale * rng.normal(size=3))
    for initial, start in (("estimate", 0), ("measured", 6)):
        run = simulate(model, with_outputs(record, model, y), initial)
        assert run.start == start
        np.testing.assert_allclose(run.output, y, atol=1e-8 * np.abs(y).max())


@pytest.mark.seconds
def test_an_estimated_state_averages_the_noise_out(rng: np.random.Generator) -> None:
    """Slow poles: a state from a handful of noisy samples is far off, one from 200 is not."""
    a = np.array([[[0.995, 0.05], [0.0, 0.99]]])
    model = LPVStateSpace(a, np.zeros((1, 2, 1)), [[[1.0, 0.0]]], np.zeros((1, 1, 1)), Polynomial(), TS)
    x0 = np.array([2.0, -1.0])
    errors = []
    for _ in range(20):
        y = naive_states(model, np.zeros((400, 1)), np.empty((400, 0)), x0) + 0.05 * rng.standard_normal((400, 1))
        record = Record({"u1": np.zeros(400), "y1": y[:, 0]}, sample_time=TS)
        best = np.linalg.lstsq(np.vstack([np.linalg.matrix_power(a[0], k)[0] for k in range(200)]), y[:200, 0])[0]
        expected = naive_states(model, np.zeros((400, 1)), np.empty((400, 0)), best)
        np.testing.assert_allclose(simulate(model, record, "estimate").output, expected, atol=1e-8)
        errors.append(np.linalg.norm(best - x0))
    assert np.mean(errors) < 0.1


# -- divergence -------------------------------------------------------------------------------------------------
@pytest.mark.seconds
@settings(deadline=None, max_examples=40)
@given(scale=st.sampled_from([1e-12, 1e-3, 1.0, 1e6, 1e12]), pole=st.sampled_from([1.3, -1.3, 1.05, 40.0]))
def test_an_unstable_run_says_where_it_left_and_units_do_not_matter(scale: float, pole: float) -> None:
    n = 600  # 1.05 reaches 1e9 in 430
    model = LPVTransferFunction.siso([[-pole]], [[1.0]], Polynomial(), TS)
    record = Record({"u1": scale * np.ones(n), "y1": scale * np.ones(n)}, sample_time=TS)
    for run in (
        simulate(model, record, "measured"),
        simulate(model, record, "zero"),
        simulate(model, record, "estimate"),
        predict(model, record, n),
    ):
        assert run.diverged_at is not None
        assert np.isnan(run.output[run.diverged_at :]).all()
        assert np.isfinite(run.output[: run.diverged_at]).all()
        reached = np.abs(run.output[run.diverged_at - 1, 0]) / scale
        assert 1e9 / abs(pole) / 60 < reached < 1e10
        assert "DIVERGED" in repr(run)


def test_an_unstable_state_space_run_says_where_it_left() -> None:
    model = LPVStateSpace([[[1.5]]], [[[1.0]]], [[[1.0]]], [[[0.0]]], Polynomial(), TS, observer_gain=[[[0.0]]])
    record = Record({"u1": np.ones(3000), "y1": np.ones(3000)}, sample_time=TS)
    free, step = simulate(model, record), predict(model, record, 1)
    assert free.diverged_at is not None
    assert 40 < free.diverged_at < 80
    assert np.isnan(free.output[free.diverged_at :]).all()
    assert np.isfinite(free.output[: free.diverged_at]).all()
    assert step.diverged_at is not None  # an observer without gain runs away as well


def test_a_model_that_is_unstable_only_frozen_may_stay_bounded() -> None:
    model = LPVTransferFunction.siso([[-1.1, -1.0]], [[1.0, 0.0]], Polynomial("p"), TS)
    p = np.where(np.arange(500) % 2, 0.5, -1.0)  # poles 1.6 and 0.1 in turn
    record = Record({"u1": np.ones(500), "p": p, "y1": np.zeros(500)}, sample_time=TS)
    assert simulate(model, record).diverged_at is None


# -- refusals ---------------------------------------------------------------------------------------------------
def small() -> tuple[LPVTransferFunction, Record]:
    model = LPVTransferFunction.siso(
        [[-0.5, 0.1]], [[0, 0], [1, 0]], Polynomial("p"), TS, inputs=("u",), outputs=("y",)
    )
    return model, Record({"u": np.ones(9), "p": np.zeros(9), "y": np.zeros(9)}, sample_time=TS, name="run3")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda r: Record(dict(r.channels), sample_time=1.002 * TS, name="run3"),
            r"record 'run3' has another rate .*resample",
        ),
        (
            lambda r: Record(dict(r.channels), time=[0, 1, 2, 3, 9, 10, 11, 12, 13], name="run3"),
            "'run3' is not uniformly",
        ),
        (
            lambda r: r.with_channel("u", np.array([1, 1, np.nan, 1, 1, 1, 1, 1, 1])),
            r"'run3', channel 'u', sample 2 .*segments",
        ),
        (lambda r: r.with_channel("p", np.full(9, np.inf)), "channel 'p', sample 0 is not finite"),
        (lambda r: r.with_channel("y", np.full(9, np.nan)), "channel 'y', sample 0 is not finite"),
        (lambda r: Record({"u": r["u"], "p": r["p"]}, sample_time=TS, name="run3"),
         r"'run3' has no channel 'y'.*--role y="),
        (
            lambda r: Record({**r.channels, "u": Channel(r["u"], "", "furlong/s", False)}, sample_time=TS, name="run3"),
            "channel 'u': unknown unit: got 'furlong/s'",
        ),
        (lambda r: r.slice(0, 1), "starts from 1 measured samples: got 1 samples"),
    ],
)
def test_records_that_do_not_fit_are_refused(change, words: str) -> None:
    model, record = small()
    for run in (simulate, predict):
        with pytest.raises(InputError, match=words):
            run(model, change(record))


def test_a_rate_within_a_thousandth_is_the_same_rate() -> None:
    model, record = small()
    assert simulate(model, Record(dict(record.channels), sample_time=1.0005 * TS)).output.shape == (9, 1)


def test_outputs_are_not_needed_from_rest_and_nan_elsewhere_does_not_matter() -> None:
    model, record = small()
    bare = Record({"u": record["u"], "p": record["p"], "idle": np.full(9, np.nan)}, sample_time=TS)
    assert simulate(model, bare, "zero").output[-1, 0] == pytest.approx((1 - 0.5**8) / 0.5)


@pytest.mark.parametrize(
    ("initial", "words"),
    [
        ("warm", "initial must be one of measured, zero, estimate"),
        (np.zeros((2, 1)), "initial past outputs must have shape"),
        (np.zeros(1), "initial must have 2 dimension"),
        (np.array([[np.nan]]), "initial must be finite"),
    ],
)
def test_wrong_initial_conditions_are_refused(initial, words: str) -> None:
    model, record = small()
    with pytest.raises(InputError, match=words):
        simulate(model, record, initial)


def test_other_refusals(rng: np.random.Generator) -> None:
    model, record = small()
    with pytest.raises(InputError, match="horizon must be a whole number of at least 1"):
        predict(model, record, 0)
    states = ss_model(rng)
    with pytest.raises(InputError, match="initial state must have shape"):
        simulate(states, data(rng, states)[0], np.zeros(2))
    with pytest.raises(InputError, match="continuous in time"):
        predict(states.replace(sample_time=None), data(rng, states)[0])
    with pytest.raises(InputError, match="starts from 6 measured samples"):
        simulate(states, data(rng, states, 6)[0])


def test_the_input_stage_acts_before_the_filter(rng: np.random.Generator) -> None:
    model = LPVTransferFunction.siso([[-0.5, 0.1]], [[0, 0], [0, 0]], Polynomial("p"), TS, inputs=("v",)).replace(
        b=rng.normal(size=(2, 1, 2, 2)), input_stage=TanhStage(0.3, 0.1)
    )
    v, p = rng.normal(size=40), rng.uniform(-1, 1, 40)
    record = Record({"v": v, "p": p, "y1": rng.normal(size=40)}, sample_time=TS)
    shaped = np.column_stack([v, np.tanh(v / (0.3 + 0.1 * p))])
    plain = model.replace(input_stage=None, inputs=("a", "b"))
    np.testing.assert_allclose(
        simulate(model, record).output, naive(plain, shaped, p[:, None], record["y1"][:, None], None), rtol=1e-10
    )


def test_a_channel_in_another_unit_is_refused() -> None:
    from lpvid.model.signals import Signal

    model = LPVTransferFunction.siso([[-0.5]], [[0.0], [1.0]], Polynomial(), 0.01, inputs=(Signal("velocity", "m/s"),))
    record = Record({"velocity": np.ones(5)}, sample_time=0.01, units={"velocity": "m"})
    with pytest.raises(InputError, match=r"m against m/s"):
        simulate(model, record, "zero")
