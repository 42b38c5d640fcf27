"""LPV-ARX against numpy.linalg.lstsq on a regressor that a plain loop builds from the equation."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from lpvid.errors import InputError
from lpvid.identification import identify
from lpvid.identification.arx import ARX
from lpvid.model.input_stage import TanhStage
from lpvid.record import Record
from lpvid.scheduling import Polynomial, Product, Shifted, Spline, Stacked

TS = 0.01
EPS = np.finfo(float).eps
DYNAMIC = Stacked((Polynomial("p", degree=1), Shifted(Spline("p", segments=2, order=1), 2)))


# -- oracle -----------------------------------------------------------------------------------------------------
def regressor(structure: ARX, basis, record: Record) -> tuple[np.ndarray, np.ndarray]:
    """X and Y of one record, column by column from the structure's equation; `basis` is bound."""
    y, u = record.matrix(structure.output), record.matrix(structure.input)
    phi = basis.evaluate(record.matrix(basis.names))
    n, start = len(y), structure.start
    rows = np.arange(start, n)
    columns = []
    for i in range(1, structure.na + 1):
        for q in range(y.shape[1]):
            for m in range(basis.size):
                columns.append(-y[rows - i, q] * phi[rows - (i if structure.lagged else 0), m])
    for q in range(u.shape[1]):
        nk, nb = structure.nk[q], structure.nb[q]  # type: ignore[index]
        for j in range(nk, nk + nb):
            for m in range(basis.size):
                columns.append(u[rows - j, q] * phi[rows - (j if structure.lagged else 0), m])
    for j in range(structure.affine):
        for m in range(basis.size):
            if j and m == basis.redundant:
                continue
            columns.append(phi[rows - j, m])
    return np.column_stack(columns), y[rows]


def stacked(structure: ARX, basis, records) -> tuple[np.ndarray, np.ndarray]:
    parts = [regressor(structure, basis, r) for r in records]
    return np.vstack([x for x, _ in parts]), np.vstack([y for _, y in parts])


def noise_records(rng, lengths, n_in=1, n_out=1, scale=1.0) -> list[Record]:
    """Random channels: least squares does not care whether they are one system's."""
    records = []
    for n in lengths:
        channels = {f"u{i}": scale * rng.normal(size=n) for i in range(n_in)}
        channels |= {f"y{i}": rng.normal(size=n) for i in range(n_out)}
        channels |= {"p": rng.uniform(0, 3, n), "q": rng.uniform(-5, 1, n), "w": rng.uniform(0.1, 4, n)}
        records.append(Record(channels, sample_time=TS, name=f"r{len(records)}"))
    return records


def assert_least_squares(records, structure: ARX, found) -> None:
    """Parameters, noise, and covariance as lstsq and the textbook formulas give them."""
    x, y = stacked(structure, found.model.basis, records)
    assert found.n_samples == len(x)
    assert found.layout.size == x.shape[1] * y.shape[1]
    theta = np.linalg.lstsq(x, y, rcond=None)[0]
    mine = found.parameters.reshape(y.shape[1], -1).T
    condition = np.linalg.cond(x)
    bound = max(1e-9, 50 * EPS * condition)
    assert np.linalg.norm(mine - theta) <= bound * np.linalg.norm(theta)
    residual = y - x @ theta
    noise = residual.T @ residual / (len(x) - x.shape[1])
    np.testing.assert_allclose(found.model.noise_covariance, noise, rtol=1e-7, atol=1e-12)
    covariance = np.kron(noise, np.linalg.inv(x.T @ x))
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-5, atol=1e-6 * np.abs(covariance).max())
    np.testing.assert_allclose(found.standard_errors, np.sqrt(np.diag(covariance)), rtol=1e-5)
    assert found.condition == pytest.approx(condition, rel=1e-6)
    assert found.scaled_condition == pytest.approx(np.linalg.cond(x / np.linalg.norm(x, axis=0)), rel=1e-6)


P1 = Polynomial("p", degree=1)
CASES = [
    ({"na": 2, "nb": 2}, 1, 1),
    ({"na": 0, "nb": 3, "nk": 0}, 1, 1),
    ({"na": 3, "nb": 1, "nk": 0}, 1, 1),
    ({"na": 1, "nb": 2, "nk": 5}, 1, 1),
    ({"na": 2, "nb": 2, "affine": 3}, 1, 1),
    ({"na": 2, "nb": 2, "affine": 6, "lagged": True}, 1, 1),
    ({"na": 2, "nb": (1, 3), "nk": (2, 0)}, 2, 1),
    ({"na": 2, "nb": (2, 1, 2), "nk": (0, 1, 1), "affine": 2}, 3, 2),
    ({"na": 2, "nb": 1, "lagged": True}, 2, 3),
    ({"na": 1, "nb": 1, "basis": Polynomial()}, 1, 1),
    ({"na": 2, "nb": 2, "basis": Polynomial(("p", "q"), degree=2)}, 1, 1),
    ({"na": 1, "nb": 2, "basis": Spline("p", segments=4, order=3), "affine": 3}, 1, 1),
    ({"na": 1, "nb": 1, "basis": Product(P1, Spline("q", segments=2, order=1)), "affine": 2}, 1, 1),
    ({"na": 2, "nb": 2, "basis": Shifted(P1, 2), "lagged": True, "affine": 2}, 1, 1),
    ({"na": 2, "nb": 2, "basis": Shifted(P1, -2)}, 1, 1),
    ({"na": 1, "nb": 1, "basis": Stacked((P1, Polynomial("q", 0)))}, 1, 1),
]


def a_structure(settings: dict, n_in: int, n_out: int) -> ARX:
    return ARX(
        **({"basis": P1} | settings),
        input=tuple(f"u{i}" for i in range(n_in)),
        output=tuple(f"y{i}" for i in range(n_out)),
    )


@pytest.mark.parametrize(("settings", "n_in", "n_out"), CASES[:-1], ids=str)
def test_the_estimate_is_least_squares(settings: dict, n_in: int, n_out: int, rng: np.random.Generator) -> None:
    structure = a_structure(settings, n_in, n_out)
    records = noise_records(rng, (400, 61, 230), n_in, n_out)
    assert_least_squares(records, structure, identify(records, structure))


def test_a_basis_that_names_the_constant_twice_is_refused(rng: np.random.Generator) -> None:
    structure = a_structure(*CASES[-1])
    with pytest.raises(InputError, match="cannot be identified from these data"):
        identify(noise_records(rng, (300,)), structure)


@pytest.mark.parametrize("n", [1024, 1025, 32768 + 3, 32768 + 4, 32769 + 4, 70_001])
def test_chunk_borders_leave_no_trace(n: int, rng: np.random.Generator) -> None:
    structure = ARX(na=3, nb=2, input="u0", output="y0", basis=Polynomial("p", degree=2), affine=2)
    records = noise_records(rng, (n, 2000))
    assert_least_squares(records, structure, identify(records, structure))


@pytest.mark.parametrize("basis", [Shifted(P1, 2), Shifted(P1, -2)], ids=["past", "future"])
def test_chunk_borders_leave_no_trace_with_shifted_scheduling(basis, rng: np.random.Generator) -> None:
    structure = ARX(na=2, nb=2, input="u0", output="y0", basis=basis, lagged=True, affine=2)
    records = noise_records(rng, (40_000,))
    assert_least_squares(records, structure, identify(records, structure))


def test_ill_conditioned_regressors_agree_within_their_condition(rng: np.random.Generator) -> None:
    """Slow motion sampled fast: neighbouring lags are nearly equal."""
    t = TS * np.arange(5000)
    u = np.sin(0.7 * t) + 0.5 * np.sin(2.3 * t)
    p = 1 + np.sin(0.31 * t)
    y = np.convolve(u, np.exp(-t[:300] / 0.5), "full")[:5000] * (1 + 0.1 * p) + 1e-4 * rng.normal(size=5000)
    record = Record({"u0": u, "y0": y, "p": p}, sample_time=TS)
    structure = ARX(na=2, nb=3, input="u0", output="y0", basis=P1)
    found = identify(record, structure)
    assert found.condition > 1e5
    x, target = stacked(structure, found.model.basis, [record])
    theta = np.linalg.lstsq(x, target, rcond=None)[0].ravel()
    assert np.linalg.norm(found.parameters - theta) <= max(1e-9, 50 * EPS * found.condition) * np.linalg.norm(theta)


@pytest.mark.parametrize("ridge", [1e-10, 1e-3, 1.0, 50.0])
def test_ridge_is_its_formula(ridge: float, rng: np.random.Generator) -> None:
    records = noise_records(rng, (300, 200), scale=1e-4)
    structure = ARX(na=2, nb=2, input="u0", output="y0", basis=P1, ridge=ridge)
    found = identify(records, structure)
    x, y = stacked(structure, found.model.basis, records)
    energy = np.linalg.norm(x, axis=0)  # oracle: augmented least squares in unit columns
    unit = np.vstack([x / energy, np.sqrt(ridge) * np.eye(x.shape[1])])
    theta = np.linalg.lstsq(unit, np.vstack([y, np.zeros((x.shape[1], 1))]), rcond=None)[0].ravel() / energy
    np.testing.assert_allclose(found.parameters, theta, rtol=1e-9)
    residual = y.ravel() - x @ theta
    noise = residual @ residual / (len(x) - x.shape[1])
    inverse = np.linalg.inv((x / energy).T @ (x / energy) + ridge * np.eye(x.shape[1]))
    sandwich = noise * inverse @ ((x / energy).T @ (x / energy)) @ inverse / np.outer(energy, energy)
    np.testing.assert_allclose(found.covariance, sandwich, rtol=1e-7, atol=1e-10 * np.abs(sandwich).max())


def test_ridge_serves_where_least_squares_cannot(rng: np.random.Generator) -> None:
    (record,) = noise_records(rng, (200,))  # of longer ones the fit finds that the inputs are one, and regularises
    twin = record.with_channel("u1", record["u0"])
    structure = ARX(na=1, nb=1, input="u0,u1", output="y0", basis=P1)
    with pytest.raises(InputError, match="add ridge"):
        identify(twin, structure)
    b = identify(twin, replace(structure, ridge=1e-6)).model.b[1, 0]
    np.testing.assert_allclose(b[0], b[1], rtol=1e-6)  # the least norm shares equally


def test_weights_are_weighted_least_squares(rng: np.random.Generator) -> None:
    records = noise_records(rng, (1500, 70), 2, 2)
    structure = ARX(na=1, nb=2, input="u0,u1", output="y0,y1", basis=P1, weight="w")
    found = identify(records, structure)
    x, y = stacked(structure, found.model.basis, records)
    root = np.sqrt(np.concatenate([r["w"][structure.start :] for r in records]))[:, None]
    theta = np.linalg.lstsq(root * x, root * y, rcond=None)[0]
    np.testing.assert_allclose(found.parameters, theta.T.ravel(), rtol=1e-9, atol=1e-12)
    bad = records[0].with_channel("w", -records[0]["w"])
    with pytest.raises(InputError, match="weights in channel 'w' must not be negative"):
        identify(bad, structure)


def test_zero_weights_leave_samples_out(rng: np.random.Generator) -> None:
    (record,) = noise_records(rng, (500,))
    spoilt = record["y0"].copy()
    spoilt[400:] = 1e6 * rng.normal(size=100)
    heavy = record.with_channel("y0", spoilt).with_channel("w", (np.arange(500) < 400).astype(float))
    structure = ARX(na=2, nb=2, input="u0", output="y0", basis=P1)
    whole = identify(heavy, replace(structure, weight="w"))
    x, y = regressor(structure, whole.model.basis, record.slice(0, 400))
    np.testing.assert_allclose(whole.parameters, np.linalg.lstsq(x, y, rcond=None)[0].ravel(), rtol=1e-8)


# -- true systems -----------------------------------------------------------------------------------------------
def a_true_system(rng, n: int, noise: float = 0.0, lagged: bool = False) -> Record:
    """y = −(a1)y(k−1) − a2 y(k−2) + b1 u(k−1) + c0 with known coefficients in p ∈ [0, 2]."""
    u, p, e = rng.normal(size=n), rng.uniform(0, 2, n), noise * rng.normal(size=n)
    p[:2] = 0.0, 2.0  # the box, so that normalisation is known
    y = np.zeros(n)
    for k in range(2, n):
        p1, p2 = (p[k - 1], p[k - 2]) if lagged else (p[k], p[k])
        y[k] = (
            (1.1 - 0.2 * p1) * y[k - 1]
            - (0.5 + 0.1 * p2) * y[k - 2]
            + (1 + 0.5 * p1) * u[k - 1]
            + 0.3
            - 0.1 * p[k]
            + e[k]
        )
    return Record({"u": u, "p": p, "y": y}, sample_time=TS)


#: a1, a2, b1, c0 over z = p − 1, by hand: c + d·p = (c + d) + d·z
TRUTH = np.array([-0.9, 0.2, 0.6, 0.1, 1.5, 0.5, 0.2, -0.1])
TRUE_STRUCTURE = ARX(na=2, nb=1, input="u", output="y", basis=P1, affine=1)


@pytest.mark.parametrize("lagged", [False, True])
def test_a_noise_free_system_is_found_exactly(lagged: bool, rng: np.random.Generator) -> None:
    found = identify(a_true_system(rng, 400, lagged=lagged), replace(TRUE_STRUCTURE, lagged=lagged))
    np.testing.assert_allclose(found.parameters, TRUTH, atol=1e-10)
    assert found.parameter_names == ("a1[1]", "a1[p]", "a2[1]", "a2[p]", "b1[1]", "b1[p]", "c0[1]", "c0[p]")
    poles = np.sort_complex(np.roots([1, -(1.1 - 0.2 * 0.7), 0.5 + 0.1 * 0.7]))
    np.testing.assert_allclose(np.sort_complex(found.model.frozen_poles([0.7])), poles, atol=1e-9)
    assert found.training.overall.free_run.esr < 1e-18
    assert found.training.overall.one_step.esr < 1e-18


@pytest.mark.seconds
def test_standard_errors_are_calibrated() -> None:
    rng = np.random.default_rng(5)
    scores = []
    for _ in range(200):
        found = TRUE_STRUCTURE.estimate([a_true_system(rng, 500, noise=0.3)])
        error = found.parameters - TRUTH
        scores.append(error @ np.linalg.solve(found.covariance, error))
        assert found.standard_errors == pytest.approx(np.sqrt(np.diag(found.covariance)))
    assert chi2.sf(np.sum(scores), 200 * 8) > 1e-3
    assert chi2.cdf(np.sum(scores), 200 * 8) > 1e-3


def test_noise_level_is_found(rng: np.random.Generator) -> None:
    found = identify(a_true_system(rng, 20_000, noise=0.3), TRUE_STRUCTURE)
    assert np.sqrt(found.model.noise_covariance[0, 0]) == pytest.approx(0.3, rel=0.02)


# -- invariances ------------------------------------------------------------------------------------------------
@pytest.mark.seconds
@settings(deadline=None, max_examples=25)
@given(u_unit=st.floats(-9, 9), y_unit=st.floats(-9, 9), p_unit=st.floats(-9, 9), shift=st.floats(-100, 100))
def test_units_change_neither_error_nor_poles(u_unit: float, y_unit: float, p_unit: float, shift: float) -> None:
    record = a_true_system(np.random.default_rng(1), 300, noise=0.2)
    ku, ky, kp = 10.0**u_unit, 10.0**y_unit, 10.0**p_unit
    scaled = Record({"u": ku * record["u"], "y": ky * record["y"], "p": kp * (record["p"] + shift)}, sample_time=TS)
    structure = replace(TRUE_STRUCTURE, basis=Polynomial("p", degree=2), affine=2)
    plain, other = identify(record, structure), identify(scaled, structure)
    for kind in ("free_run", "one_step"):
        mine, theirs = (getattr(f.training.overall, kind).esr for f in (plain, other))
        assert theirs == pytest.approx(mine, rel=1e-6)
    poles = [np.sort_complex(f.model.frozen_poles([at])) for f, at in ((plain, 0.4), (other, kp * (0.4 + shift)))]
    np.testing.assert_allclose(poles[1], poles[0], rtol=1e-7)
    assert other.training.overall.free_run.rmse == pytest.approx(ky * plain.training.overall.free_run.rmse, rel=1e-6)


def test_order_of_records_does_not_matter(rng: np.random.Generator) -> None:
    records = [a_true_system(rng, n, noise=0.1) for n in (150, 3000, 77)]
    one, other = (identify(listed, TRUE_STRUCTURE) for listed in (records, records[::-1]))
    np.testing.assert_allclose(other.parameters, one.parameters, rtol=1e-10)
    np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-8)


def test_a_record_cut_in_two_loses_only_the_start_of_the_second(rng: np.random.Generator) -> None:
    record = a_true_system(rng, 1000, noise=0.1)
    halves = [record.slice(0, 500), record.slice(500 - TRUE_STRUCTURE.start, 1000)]  # the overlap only serves as past
    whole, cut = identify(record, TRUE_STRUCTURE), identify(halves, TRUE_STRUCTURE)
    assert cut.n_samples == whole.n_samples
    np.testing.assert_allclose(cut.parameters, whole.parameters, rtol=1e-10)


def test_records_do_not_leak_into_each_other(rng: np.random.Generator) -> None:
    """The second record starts from rest: one row across the seam would spoil an exact fit."""
    first = a_true_system(rng, 200)
    second = a_true_system(rng, 200)
    joined = Record({k: np.concatenate([first[k], second[k]]) for k in ("u", "p", "y")}, sample_time=TS)
    found = identify([first, second], TRUE_STRUCTURE)
    np.testing.assert_allclose(found.parameters, TRUTH, atol=1e-10)
    leaking = identify(joined, TRUE_STRUCTURE)
    assert np.abs(leaking.parameters - TRUTH).max() > 1e-3  # which is what a leak would look like


def test_missing_samples_cut_a_record_and_nothing_is_filled_in(rng: np.random.Generator) -> None:
    record = a_true_system(rng, 600)
    y = record["y"].copy()
    y[300:303] = np.nan
    found = identify(record.with_channel("y", y), TRUE_STRUCTURE)
    np.testing.assert_allclose(found.parameters, TRUTH, atol=1e-10)
    assert found.n_samples == 597 - 2 * TRUE_STRUCTURE.start
    assert any("cut into 2 pieces" in note for note in found.notes)


@pytest.mark.parametrize("dtype", [np.float32, np.int32])
def test_other_number_types_are_as_good_as_their_digits(dtype, rng: np.random.Generator) -> None:
    record = a_true_system(rng, 500, noise=0.1)
    factor = 1000.0 if dtype is np.int32 else 1.0
    coarse = {k: np.round(factor * record[k]).astype(dtype) if factor > 1 else record[k].astype(dtype) for k in "upy"}
    doubles = {k: v.astype(float) for k, v in coarse.items()}
    found = [identify(Record(c, sample_time=TS), TRUE_STRUCTURE).parameters for c in (coarse, doubles)]
    assert np.array_equal(*found)


def test_roles_and_held_out_data(rng: np.random.Generator) -> None:
    record = a_true_system(rng, 400, noise=0.1)
    named = Record(
        {"in1": record["u"], "p": record["p"], "out7": record["y"]}, sample_time=TS, roles={"u": "in1", "y": "out7"}
    )
    found = identify(named, TRUE_STRUCTURE, held_out=named.slice(200, 400))
    np.testing.assert_allclose(found.parameters, identify(record, TRUE_STRUCTURE).parameters, rtol=1e-13)
    assert found.held_out is not None
    assert found.held_out.label == "training"  # a part of the record that was fitted
    first = identify(named.slice(0, 200), TRUE_STRUCTURE, held_out=named.slice(200, 400))
    assert first.held_out is not None and first.held_out.label == "held-out"
    assert found.held_out.records[0].n_samples == 200


@pytest.mark.seconds
def test_draws_follow_the_covariance(rng: np.random.Generator) -> None:
    found = identify(a_true_system(rng, 400, noise=0.3), TRUE_STRUCTURE)
    draws = np.array([found.layout.read(m) for m in found.draw(rng, 4000)])
    spread = np.cov(draws.T)
    np.testing.assert_allclose(np.sqrt(np.diag(spread)), found.standard_errors, rtol=0.06)
    assert np.array_equal(found.layout.read(found.with_parameters(TRUTH)), TRUTH)


# -- refusals ---------------------------------------------------------------------------------------------------
def bad_case(rng, **changes) -> Record:
    record = a_true_system(rng, 200, noise=0.1)
    return Record({**{k: record[k] for k in "upy"}, **changes}, sample_time=TS, name="bench")


@pytest.mark.parametrize(
    ("changes", "settings", "words"),
    [
        ({"p": np.full(200, 1.25)}, {}, r"'p' is constant over the whole data set: got 1\.25;.*Mend: use degree 0"),
        ({"p": np.zeros(200)}, {}, r"'p' is constant over the whole data set: got 0;"),
        (
            {"p": np.arange(200) % 2},
            {"basis": Polynomial("p", degree=2)},
            r"'p' takes 2 levels;.*Mend: lower the degree",
        ),
        ({"u": np.zeros(200)}, {}, r"input 'u' never moves: got the constant 0;.*Mend: leave it out"),
        ({"u": np.full(200, 5.0)}, {}, r"input 'u' never moves: got the constant 5;"),
        ({"y": np.full(200, 5.0)}, {}, r"output 'y' never moves"),
        ({}, {"input": "v"}, r"record 'bench' has no channel 'v'; there are u, p, y\. Mend: .*--role v="),
        ({}, {"output": "yy"}, r"record 'bench' has no channel 'yy'; .*did you mean 'y'"),
        ({}, {"basis": Polynomial("current")}, r"channel 'current'"),
        ({}, {"weight": "w"}, r"channel 'w'"),
        ({}, {"na": 60, "nb": 60}, r"140 equations cannot determine 242 parameters per output"),
        (
            {},
            {"na": 150, "nb": 60},
            r"50 equations cannot determine 422 parameters per output\. Mend: give longer records",
        ),
        ({}, {"na": 250}, r"long enough: got 200 samples in the longest; 252 are needed\. Mend: .*lower order"),
        ({"u": np.where(np.arange(200) == 9, np.inf, 1.0)}, {}, r"channel 'u' must be finite: got inf in row 10"),
    ],
)
def test_data_that_cannot_carry_the_structure_are_refused(changes, settings, words, rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match=words) as caught:
        identify(bad_case(rng, **changes), replace(TRUE_STRUCTURE, **settings))
    assert "Mend:" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"input": "u,u"}, r"input names a channel twice: got u, u\. Mend"),
        ({"input": "u,y"}, r"input and output at once: got y\. Mend"),
        ({"input": ""}, "input needs at least one name"),
        ({"na": -1}, "na must be a whole number"),
        ({"nb": 0}, "nb must be a whole number of at least 1"),
        ({"nb": (1, 2)}, r"nb needs one number for each of 1 channel\(s\)"),
        ({"nk": -1}, "nk must be"),
        ({"affine": 1.5}, "affine must be"),
        ({"stage": "relu"}, "stage must be one of tanh, three-zone"),
        ({"ridge": -1.0}, "ridge must not be negative"),
        ({"ridge": np.nan}, "ridge must be finite"),
        ({"stage": TanhStage(channel=1)}, "shapes an input that is not there"),
        ({"stage": TanhStage(variable=3)}, "scheduling variable that is not there"),
    ],
)
def test_structures_that_make_no_sense_are_refused(settings: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        replace(TRUE_STRUCTURE, **settings)


def test_degree_zero_needs_no_moving_scheduling(rng: np.random.Generator) -> None:
    """What the refusal of a constant scheduling variable recommends does work."""
    record = bad_case(rng, p=np.full(200, 1.25))
    found = identify(record, replace(TRUE_STRUCTURE, basis=Polynomial("p", degree=0)))
    still = identify(record, replace(TRUE_STRUCTURE, basis=Polynomial()))
    np.testing.assert_allclose(found.parameters, still.parameters, rtol=1e-12)


def test_no_records_at_all() -> None:
    with pytest.raises(InputError, match="no records"):
        identify([], TRUE_STRUCTURE)


def test_dependent_parameters_are_named(rng: np.random.Generator) -> None:
    record = bad_case(rng)
    twin = record.with_channel("twin", 2.0 * record["u"])
    with pytest.raises(InputError, match=r"dependence among .*(b1\{u\}|b1\{twin\}).*Mend: lower the orders"):
        identify(twin, replace(TRUE_STRUCTURE, input="u,twin", nb=1, nk=1))


def test_columns_are_counted() -> None:
    assert TRUE_STRUCTURE.n_columns == 8
    assert replace(TRUE_STRUCTURE, basis=Polynomial("p", degree=2), affine=4).n_columns == 3 * 3 + 3 + 3 * 2
    assert replace(TRUE_STRUCTURE, stage="tanh").n_columns == 10
    two = ARX(na=1, nb=(4, 1), nk=(0, 3), input="a,b", output="y", stage=TanhStage(channel=0), basis=P1)
    assert two.n_columns == 2 * (1 + 4 + 1 + 4)  # the added input has the lags of the one that is shaped
    assert (two.start, replace(two, nk=(0, 5)).start, replace(two, affine=9).start) == (3, 5, 8)


# -- size -------------------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_memory_does_not_grow_with_the_record(rng: np.random.Generator) -> None:
    n = 1_000_000
    record = Record({"u": rng.normal(size=n), "p": rng.uniform(size=n), "y": rng.normal(size=n)}, sample_time=TS)
    structure = ARX(na=4, nb=4, input="u", output="y", basis=Polynomial("p", degree=2))
    assert structure.n_columns == 24
    structure.estimate([record.slice(0, 3000)])  # compile first
    tracemalloc.start()
    structure.estimate([record])
    estimate = tracemalloc.get_traced_memory()[1]
    tracemalloc.reset_peak()
    identify(record, structure)
    whole = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert estimate < 40e6
    assert whole < 100e6


def test_scheduling_on_the_output_is_refused() -> None:
    with pytest.raises(InputError, match="quasi"):
        ARX(input="u", output="y", basis=Polynomial("y", degree=1))
