"""Realisations against plain loops over the input-output equation, and against published numbers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lpvid.errors import InputError
from lpvid.model.input_stage import TanhStage
from lpvid.model.scheduling_stage import SchedulingLag
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization import realize
from lpvid.realization.varying import Varying as Array
from lpvid.realization.varying import assemble, constant_part, product, unity
from lpvid.record import Record
from lpvid.scheduling import Polynomial, Product, Scheduling, Shifted, Spline, Stacked
from lpvid.simulation import predict, simulate

FORMS = ("controllable", "observable", "shifted", "augmented")


# -- oracles: nothing but the defining equations ---------------------------------------------------------------------
def io_loop(model: LPVTransferFunction, u: np.ndarray, p: np.ndarray, *, held: bool = False) -> np.ndarray:
    """y from zero past; affine terms start with the first sample, or act before it with the scheduling `held`."""
    phi = model.basis.evaluate(p)
    y = np.zeros((len(u), model.n_outputs))
    for k in range(len(u)):
        for i in range(1, model.na + 1):
            if k >= i:
                y[k] -= (model.a[i - 1] @ phi[k - i if model.lagged else k]) @ y[k - i]
        for j in range(model.n_lags):
            if k >= j:
                y[k] += (model.b[j] @ phi[k - j if model.lagged else k]) @ u[k - j]
        for j in range(model.n_affine):
            if k >= j or held:
                y[k] += model.c[j] @ phi[max(k - j, 0)]
    return y


def ss_loop(model: LPVStateSpace, u: np.ndarray, p: np.ndarray, x: np.ndarray | None = None) -> np.ndarray:
    phi = model.basis.evaluate(p)
    x = np.zeros(model.order) if x is None else x
    y = np.zeros((len(u), model.n_outputs))
    for k, f in enumerate(phi):
        a, b, c, d, offset, level = (np.einsum("m,m...->...", f, m) for m in (
            model.A, model.B, model.C, model.D, model.state_offset, model.output_offset))
        y[k] = c @ x + d @ u[k] + level
        x = a @ x + b @ u[k] + offset
    return y


def relative(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.max(np.abs(a - b)) / max(np.max(np.abs(b)), 1e-12))


def random_model(seed: int, *, na: int, lags: int, affine: int, degree: int, ny: int, nu: int, lagged: bool,
                 variables: int = 1, basis=None) -> LPVTransferFunction:
    rng = np.random.default_rng(seed)
    names = ("p", "q")[:variables]
    box = Scheduling(names, (-1.0,) * variables, (1.0,) * variables)
    basis = (basis or Polynomial(names, degree)).bound(box)
    if not basis.names:
        box = None
    m = basis.size
    a = rng.uniform(-1, 1, (na, ny, ny, m)) * 0.7 / max(na * ny * m, 1)
    return LPVTransferFunction(a, rng.normal(size=(lags, ny, nu, m)), basis, 0.1, box, rng.normal(size=(affine, ny, m)),
                               lagged)


shapes = st.fixed_dictionaries({
    "seed": st.integers(0, 2**31), "na": st.integers(0, 4), "lags": st.integers(1, 5), "affine": st.integers(0, 3),
    "degree": st.integers(0, 3), "ny": st.integers(1, 2), "nu": st.integers(1, 2), "lagged": st.booleans(),
    "variables": st.integers(1, 2)})


def drive(model: LPVTransferFunction, seed: int, n: int = 40) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed + 1)
    return rng.normal(size=(n, model.n_filter_inputs)), rng.uniform(-1, 1, (n, len(model.box.names)))


# -- published numbers -----------------------------------------------------------------------------------------------
GOLDEN_P = np.array([0, 1, 0, -1, 0.5, -0.5, 1, 0])[:, None]
GOLDEN_U = np.array([1.0, 0, 0, 1, 1, 0, 0, 0])[:, None]
GOLDEN_A = [[-1.2, 0.3], [0.5, -0.2]]
GOLDEN_B = [[0, 0], [0.4, 0.1], [0.1, -0.3]]
GOLDEN_IO = [0, 0.5, 0.7, 0.7, 0.905, 1.40175, 0.790075, 0.247215]
GOLDEN_CANONICAL = [0, 0.5, 0.46, 0.534, 0.529, 1.0345, 0.61125, 0.69483]
GOLDEN_STATIC = [0, 0.4, 0.46, 0.432, 0.718, 1.3015, 1.419825, 0.4969425]
GOLDEN_DIRECT = [0.2, 0.68, 0.816, 0.848, 1.264, 1.7976, 1.03864, 0.347568]


def golden(b=GOLDEN_B, lagged=False) -> LPVTransferFunction:
    return LPVTransferFunction.siso(GOLDEN_A, b, Polynomial("p", degree=1), 1.0, lagged=lagged)


@pytest.mark.parametrize(("form", "lagged", "expected"), [
    ("shifted", False, GOLDEN_IO), ("augmented", False, GOLDEN_IO), ("controllable", False, GOLDEN_CANONICAL),
    ("observable", False, GOLDEN_STATIC), ("observable", True, GOLDEN_STATIC), ("shifted", True, GOLDEN_STATIC),
    ("augmented", True, GOLDEN_STATIC)])
def test_golden_rows(form, lagged, expected):
    model = realize(golden(lagged=lagged), form).model
    np.testing.assert_allclose(ss_loop(model, GOLDEN_U, GOLDEN_P).ravel(), expected, atol=1e-9)
    record = Record({"u1": GOLDEN_U.ravel(), "p": GOLDEN_P.ravel()}, sample_time=1.0)
    np.testing.assert_allclose(simulate(model, record, "zero").output.ravel(), expected, atol=1e-9)


@pytest.mark.parametrize("form", ["shifted", "augmented"])
def test_golden_row_with_a_direct_term(form):
    source = golden(b=[[0.2, 0.1], *GOLDEN_B[1:]])
    np.testing.assert_allclose(io_loop(source, GOLDEN_U, GOLDEN_P).ravel(), GOLDEN_DIRECT, atol=1e-9)
    np.testing.assert_allclose(ss_loop(realize(source, form).model, GOLDEN_U, GOLDEN_P).ravel(), GOLDEN_DIRECT,
                               atol=1e-9)


def test_the_thesis_matrices():
    source = golden(b=[[0.2, 0.1], *GOLDEN_B[1:]])
    a, b, c, d = realize(source, "controllable").model.frozen([2.0])
    a1, a2, b0, b1, b2 = -0.6, 0.1, 0.4, 0.6, -0.5  # at p = 2
    np.testing.assert_allclose(a, [[0, 1], [-a2, -a1]], atol=1e-15)
    np.testing.assert_allclose(b.ravel(), [0, 1])
    np.testing.assert_allclose(c.ravel(), [b2 - a2 * b0, b1 - a1 * b0], atol=1e-15)
    np.testing.assert_allclose(d, [[b0]], atol=1e-15)


# -- what exact means ------------------------------------------------------------------------------------------------
@pytest.mark.seconds
@settings(max_examples=40, deadline=None)
@given(shape=shapes)
def test_exact_forms_reproduce_the_equation_for_moving_scheduling(shape):
    source = random_model(**shape)
    u, p = drive(source, shape["seed"])
    for form in FORMS:
        if form == "controllable" and source.n_outputs > 1:
            continue
        made = realize(source, form)
        if made.exact:
            expected = io_loop(source, u, p, held=form == "augmented")  # its affine terms read held past scheduling
            assert relative(ss_loop(made.model, u, p), expected) < 1e-10, form
        assert made.causal == (made.model.basis.lags[0] >= 0)
    assert realize(source, "augmented").exact
    assert realize(source, "augmented").causal
    assert realize(source, "shifted").exact
    if source.lagged:
        assert realize(source, "observable").exact
        assert realize(source, "shifted").causal


@pytest.mark.seconds
@settings(max_examples=25, deadline=None)
@given(shape=shapes, point=st.floats(-1, 1))
def test_all_forms_agree_for_frozen_scheduling(shape, point):
    source = random_model(**shape)
    u, p = drive(source, shape["seed"], 400)
    p[:] = point
    expected = io_loop(source, u, p)
    for form in FORMS:
        if form == "controllable" and source.n_outputs > 1:
            continue
        got = ss_loop(realize(source, form).model, u, p)
        assert relative(got[200:], expected[200:]) < 1e-8, form  # the start of the affine terms has died away


@pytest.mark.parametrize("form", ["observable", "shifted", "augmented"])
@pytest.mark.parametrize("basis", [Spline("p", segments=2, order=2), Product(Polynomial("p", 1), Polynomial("q", 2)),
                                   Shifted(Polynomial("p", 1), 2), Polynomial((), 0),
                                   Stacked((Polynomial("p", 1), Shifted(Polynomial("p", 1), 1)))],
                         ids=["spline", "product", "shifted", "constant", "stacked"])
@pytest.mark.parametrize("lagged", [False, True])
def test_other_bases(form, basis, lagged, rng):
    source = random_model(3, na=3, lags=4, affine=0, degree=0, ny=2, nu=1, lagged=lagged, basis=basis,
                          variables=len(basis.names))
    u, p = rng.normal(size=(40, 1)), rng.uniform(-1, 1, (40, len(basis.names)))
    made = realize(source, form)
    if made.exact:
        assert relative(ss_loop(made.model, u, p), io_loop(source, u, p)) < 1e-10
    else:
        assert form == "observable"
        assert relative(ss_loop(made.model, u, p), io_loop(source, u, p)) > 1e-6


def test_what_does_not_move_is_exact_in_every_form(rng):
    box = Polynomial("p", degree=1)
    source = LPVTransferFunction.siso([[-0.9, 0], [0.3, 0]], [[0.1, 0], [1, 0], [2, 0]], box, 0.1)
    u, p = rng.normal(size=(50, 1)), rng.uniform(-1, 1, (50, 1))
    for form in FORMS:
        made = realize(source, form)
        assert made.exact
        assert made.causal
        assert relative(ss_loop(made.model, u, p), io_loop(source, u, p)) < 1e-12


def test_a_varying_finite_impulse_response_is_exact_as_a_companion(rng):
    source = LPVTransferFunction.siso([], [[1, 0.5], [0.2, -1], [0.3, 2]], Polynomial("p", degree=1), 0.1)
    u, p = rng.normal(size=(50, 1)), rng.uniform(-1, 1, (50, 1))
    assert realize(source, "controllable").exact
    assert not realize(source, "observable").exact
    assert relative(ss_loop(realize(source, "controllable").model, u, p), io_loop(source, u, p)) < 1e-12


# -- innovation form -------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("form", ["observable", "shifted", "augmented"])
@pytest.mark.parametrize("lagged", [False, True])
def test_one_step_prediction_is_that_of_the_equation(form, lagged, rng):
    source = random_model(5, na=3, lags=3, affine=2, degree=2, ny=2, nu=2, lagged=lagged)
    u, p = rng.normal(size=(80, 2)), rng.uniform(-1, 1, (80, 1))
    y = rng.normal(size=(80, 2))  # anything: the predictor must use it as the equation does
    record = Record({"u1": u[:, 0], "u2": u[:, 1], "y1": y[:, 0], "y2": y[:, 1], "p": p[:, 0]}, sample_time=0.1)
    expected = predict(source, record).output
    made = realize(source, form)
    model, phi = made.model, made.model.basis.evaluate(p)
    x, got = np.zeros(model.order), np.zeros_like(y)
    for k, f in enumerate(phi):
        a, b, c, d, off, lev, gain = (np.einsum("m,m...->...", f, m) for m in (
            model.A, model.B, model.C, model.D, model.state_offset, model.output_offset, model.observer_gain))
        got[k] = c @ x + d @ u[k] + lev
        x = a @ x + b @ u[k] + off + gain @ (y[k] - got[k])
    if made.exact:
        assert relative(got[source.start:], expected[source.start:]) < 1e-10
    else:
        assert relative(got[source.start:], expected[source.start:]) > 1e-3


def test_the_controllable_form_claims_no_observer():
    assert realize(golden(), "controllable").model.observer_gain is None


# -- initial state ---------------------------------------------------------------------------------------------------
@pytest.mark.seconds
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31), na=st.integers(1, 4), lags=st.integers(1, 5), affine=st.integers(0, 3),
       ny=st.integers(1, 2), lagged=st.booleans())
def test_initial_state_continues_the_measured_start(seed, na, lags, affine, ny, lagged):
    source = random_model(seed, na=na, lags=lags, affine=affine, degree=2, ny=ny, nu=1, lagged=lagged)
    last = np.zeros_like(source.a)
    last[-1, ..., 0] = 0.6 * np.eye(ny)  # the last lag stays away from zero
    source = source.replace(a=source.a + last)
    u, p = drive(source, seed, 60)
    y = np.random.default_rng(seed + 2).normal(size=(60, ny))
    record = Record({"u1": u[:, 0], "p": p[:, 0], **{f"y{i + 1}": y[:, i] for i in range(ny)}}, sample_time=0.1)
    expected = simulate(source, record, "measured").output
    for form in ("observable", "shifted", "augmented"):
        made = realize(source, form)
        if made.exact:
            got = simulate(made.model, record, made.initial_state(record)).output
            assert relative(got[source.start:], expected[source.start:]) < 1e-10, form


def test_initial_state_of_the_controllable_form_matches_frozen_data(rng):
    source = golden()
    u = rng.normal(size=50)
    p = np.full((50, 1), 0.3)
    y = io_loop(source, u[:, None], p)[:, 0]
    record = Record({"u1": u[10:], "p": p[10:, 0], "y1": y[10:]}, sample_time=1.0)
    made = realize(source, "controllable")
    got = simulate(made.model, record, made.initial_state(record)).output[:, 0]
    np.testing.assert_allclose(got, y[10:], atol=1e-10)


def test_initial_state_needs_enough_samples():
    record = Record({"u1": [1.0], "p": [0.0], "y1": [0.0]}, sample_time=1.0)
    with pytest.raises(InputError, match="2 measured samples"):
        realize(golden(), "observable").initial_state(record)


# -- the gap ---------------------------------------------------------------------------------------------------------
def fourth_order() -> LPVTransferFunction:
    """Two resonances whose place moves with p; 24 parameters."""
    basis = Polynomial("p", degree=2)
    z = np.linspace(-0.9, 0.9, 7)
    rows = [np.poly([r * np.exp(1j * w), r * np.exp(-1j * w), s * np.exp(1j * v), s * np.exp(-1j * v)]).real[1:]
            for r, w, s, v in zip(0.9 - 0.05 * z, 0.5 + 0.12 * z, 0.8 + 0.05 * z**2, 1.2 - 0.12 * z, strict=True)]
    a = np.linalg.lstsq(basis.evaluate(z[:, None]), np.array(rows), rcond=None)[0].T
    b = [[0, 0, 0], [0.5, 0.2, 0.1], [0.3, -0.2, 0], [-0.2, 0.1, 0.1], [0.1, 0.1, 0]]
    return LPVTransferFunction.siso(a, b, basis, 1.0, scheduling=Scheduling(("p",), (-0.9,), (0.9,)))


def run(period: float | None, rng: np.random.Generator, name: str = "run") -> Record:
    n = 4000
    p = rng.uniform(-0.9, 0.9, n) if period is None else 0.9 * np.sin(2 * np.pi * np.arange(n) / period)
    return Record({"u1": rng.normal(size=n), "p": p}, sample_time=1.0, name=name)


@pytest.mark.parametrize("form", ["controllable", "observable"])
def test_the_gap_grows_as_the_scheduling_gets_faster(form, rng):
    made = realize(fourth_order(), form)
    fits = [made.gap(run(period, rng)).fit_percent[0] for period in (2000, 50, 20, None)]
    assert fits == sorted(fits, reverse=True)
    assert fits[0] > 99
    assert 85 < fits[1] < 99.5
    assert fits[3] < 90


@pytest.mark.seconds
def test_the_gap_is_the_difference_of_two_plain_loops(rng):
    made = realize(fourth_order(), "controllable")
    record = run(20, rng)
    u, p = record["u1"][:, None], record["p"][:, None]
    expected, got = io_loop(made.source, u, p), ss_loop(made.model, u, p)
    esr = np.sum((got - expected) ** 2) / np.sum((expected - expected.mean()) ** 2)
    gap = made.gap(record)
    assert gap.esr[0] == pytest.approx(esr, rel=1e-9)
    assert gap.largest_step[0] == pytest.approx(np.max(np.abs(np.diff(p[:, 0]))) / 1.8, rel=1e-12)


def test_exact_forms_make_no_gap_affine_terms_and_records_of_unequal_length_included(rng):
    source = random_model(8, na=3, lags=3, affine=3, degree=1, ny=2, nu=1, lagged=False)
    records = [Record({"u1": rng.normal(size=n), "p": rng.uniform(-1, 1, n)}, sample_time=0.1, name=f"run {n}")
               for n in (50, 200)]
    for form in ("shifted", "augmented"):
        gap = realize(source, form).gap(records)
        assert max(gap.esr) < 1e-20
        assert "exact" in gap.advice
        assert [r.name for r in gap.records] == ["run 50", "run 200"]


def test_a_start_at_rest_is_no_gap_even_with_affine_terms(rng):
    source = LPVTransferFunction.siso([[-0.95, 0.0]], [[0, 0], [1, 0.1]], Polynomial("p", degree=1), 1.0,
                                      c=[[3.0, 1.0], [2.0, 0.5]])
    record = Record({"u1": rng.normal(size=200), "p": np.full(200, 0.4)}, sample_time=1.0)
    for form in FORMS:
        assert max(realize(source, form).gap(record).esr) < 1e-20


def test_stages_in_front_of_an_exact_form_make_no_gap(rng):
    source = LPVTransferFunction(
        np.full((2, 1, 1, 2), 0.1), rng.normal(size=(3, 1, 2, 2)), Polynomial("current", 1), 0.002,
        inputs=("velocity",), outputs=("force",), input_stage=TanhStage(v0=0.1),
        scheduling_stage=SchedulingLag(0.01, 0.003), c=rng.normal(size=(2, 1, 2)))
    current = np.repeat(rng.uniform(0, 1, 20), 10)
    record = Record({"velocity": rng.normal(size=200), "current": current}, sample_time=0.002)
    gap = realize(source, "augmented").gap(record)
    assert gap.esr[0] < 1e-20
    assert gap.largest_step[0] < 0.5 * np.max(np.abs(np.diff(current)))  # what the coefficients see is filtered
    assert realize(source, "controllable").gap(record).esr[0] > 1e-6


@pytest.mark.seconds
def test_pooled_gap_sums_numerators_and_denominators(rng):
    made = realize(fourth_order(), "observable")
    records = [run(50, rng, "slow"), run(None, rng, "white")]
    gap = made.gap(records)
    u_p = [(r["u1"][:, None], r["p"][:, None]) for r in records]
    pairs = [(io_loop(made.source, u, p), ss_loop(made.model, u, p)) for u, p in u_p]
    top = sum(np.sum((s - y) ** 2) for y, s in pairs)
    bottom = sum(np.sum((y - y.mean()) ** 2) for y, _ in pairs)
    assert gap.esr[0] == pytest.approx(top / bottom, rel=1e-9)
    text = str(gap)
    assert "augmented" in text
    assert "white: worst fit" in text


def test_advice_follows_speed_and_measured_gap(rng):
    made = realize(fourth_order(), "controllable")
    assert "negligible" in made.gap(run(100000, rng)).advice
    assert "per sample: use form 'augmented'" in made.gap(run(20, rng)).advice
    assert "future scheduling" in realize(fourth_order(), "shifted").gap(run(20, rng)).advice


def test_an_unstable_model_is_reported_and_its_figures_stay_finite(rng):
    source = LPVTransferFunction.siso([[-1.5, 0.3]], [[0, 0], [1, 0]], Polynomial("p", degree=1), 1.0)
    record = Record({"u1": rng.normal(size=300), "p": rng.uniform(-1, 1, 300)}, sample_time=1.0)
    gap = realize(source, "controllable").gap(record)
    assert gap.records[0].diverged == "both"
    assert gap.records[0].diverged_at is not None
    assert np.isfinite(gap.esr[0])
    assert "diverged at sample" in str(gap)


# -- the rest --------------------------------------------------------------------------------------------------------
def test_everything_else_is_carried_over(rng):
    box = Scheduling(("current",), (0.0,), (2.5,), rate=(100.0,), units=("A",))
    source = LPVTransferFunction(
        np.full((1, 1, 1, 2), 0.1), rng.normal(size=(2, 1, 2, 2)), Polynomial("current", 1).bound(box), 0.002, box,
        inputs=("velocity",), outputs=("force",), input_stage=TanhStage(v0=0.1),
        scheduling_stage=SchedulingLag(tau_rise=0.01, symmetric=True), noise_covariance=[[4.0]],
        metadata={"polarity": "passive"})
    for form in FORMS:
        made = realize(source, form)
        model = made.model
        assert model.box is box
        assert model.input_stage == source.input_stage
        assert model.scheduling_stage == source.scheduling_stage
        assert [s.name for s in model.inputs] == ["velocity"]
        assert [s.name for s in model.outputs] == ["force"]
        assert model.noise_covariance[0, 0] == 4.0
        assert model.metadata["polarity"] == "passive"
        assert model.metadata["realization"] == {"form": form, "exact": made.exact, "causal": made.causal}
        assert model.sample_time == 0.002


def test_bad_input_is_named():
    two = random_model(1, na=1, lags=1, affine=0, degree=1, ny=2, nu=1, lagged=False)
    with pytest.raises(InputError, match=r"single output.*Mend: use form 'observable'"):
        realize(two, "controllable")
    with pytest.raises(InputError, match="did you mean 'observable'"):
        realize(golden(), "observible")
    with pytest.raises(InputError, match="only an input-output model"):
        realize(realize(golden(), "augmented").model)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="at least one record"):
        realize(golden(), "augmented").gap([])
    with pytest.raises(InputError, match="two samples"):
        realize(golden(), "augmented").gap(Record({"u1": [1.0], "p": [0.0]}, sample_time=1.0))


def test_a_realisation_says_what_it_is():
    assert "exact for any scheduling" in repr(realize(golden(), "augmented"))
    assert "NOT causal: it reads the scheduling 2 sample(s) ahead" in repr(realize(golden(), "shifted"))
    assert "frozen scheduling only" in repr(realize(golden(), "controllable"))


def test_products_of_terms_are_products_of_functions(rng):
    p = rng.uniform(-1, 1, (20, 2))
    first = Polynomial(("p", "q"), 2)
    for second in (Polynomial(("p", "q"), 1), Spline("p", 2, 1, (-1.0, 0.0, 1.0)), Shifted(first, 1)):
        x, y = rng.normal(size=(2, 3, first.size)), rng.normal(size=(3, 2, second.size))
        basis, z = product((first, x), (second, y))
        columns = p[:, [("p", "q").index(n) for n in second.names]]
        expected = np.einsum("ijm,nm,jkl,nl->nik", x, first.evaluate(p), y, second.evaluate(columns))
        np.testing.assert_allclose(np.einsum("ikm,nm->nik", z, basis.evaluate(p)), expected, atol=1e-13)


def test_polynomials_of_one_time_share_a_basis():
    narrow, wide = Polynomial("p", 1), Polynomial("p", 3)
    array = Array(1)
    array.add(0, (narrow, np.array([1.0, 2.0])))
    array.add(0, (wide, np.array([0.0, 0.0, 5.0, 7.0])))
    basis, made = assemble(narrow, {"x": array})
    assert basis == wide
    np.testing.assert_array_equal(made["x"].ravel(), [1, 2, 5, 7])


@pytest.mark.parametrize("basis", [Polynomial(("p", "q"), 2), Spline("p", 3, 3, (0.0, 1.0, 2.0, 3.0)),
                                   Product(Spline("p", 2, 1, (0.0, 1.0, 2.0)), Polynomial("q", 1)),
                                   Stacked((Polynomial("p", 1), Polynomial("q", 1))), Shifted(Polynomial("p", 1), 2)])
def test_the_constant_is_found_in_every_basis(basis, rng):
    p = rng.uniform(0, 2, (10, len(basis.names)))
    np.testing.assert_allclose(basis.evaluate(p) @ unity(basis), 1.0, atol=1e-14)
    assert constant_part((basis, 3.0 * unity(basis))) == 3.0
    assert constant_part((basis, rng.normal(size=basis.size))) is None
