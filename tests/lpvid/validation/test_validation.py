"""Figures by hand, pooling, and residual tests whose error rates are what they say."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.signal import butter, lfilter
from scipy.stats import kstest

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.identification import identify
from lpvid.identification.arx import ARX
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.scheduling import Polynomial, Scheduling
from lpvid.simulation import predict, simulate
from lpvid.validation import LAGS, residual_tests, validate
from lpvid.validation.regimes import FreeRunStretch, regimes

TS = 0.01
GAIN = LPVTransferFunction.siso([], [[2.0]], Polynomial(), TS, inputs=("u",), outputs=("y",))
"""y = 2u: the model's output is known without running it."""


def a_record(u, y, name: str = "a", **more) -> Record:
    return Record({"u": u, "y": y, **more}, sample_time=TS, name=name, units={"y": "N"})


# -- figures ----------------------------------------------------------------------------------------------------
def test_figures_by_hand() -> None:
    u, y = [0.0, 1.0, 2.0, 3.0], [1.0, 2.0, 3.0, 6.0]  # errors 1, 0, −1, 0; y about its mean 3: −2, −1, 0, 3
    found = validate(GAIN, a_record(u, y))
    figures = found.overall.free_run
    assert figures.esr == pytest.approx(2 / 14)
    assert figures.fit_percent == pytest.approx(100 * (1 - np.sqrt(2 / 14)))
    assert figures.rmse == pytest.approx(np.sqrt(2 / 4))
    assert (figures.kind, figures.n_samples, figures.diverged_at) == ("free-run", 4, None)
    assert found.overall.one_step.esr == pytest.approx(2 / 14)
    assert found.label == "held-out"


def test_a_turned_sensor_is_named_and_a_useless_model_is_not(rng: np.random.Generator) -> None:
    """y = −2u + noise of a tenth: the turned fit is that of the noise; against noise alone no sign helps."""
    u = rng.normal(size=2000)
    noise = 0.2 * rng.normal(size=2000)
    notes = validate(GAIN, a_record(u, -2 * u + noise)).notes
    expected = 100 * (1 - np.linalg.norm(noise) / np.linalg.norm(2 * u - noise - np.mean(2 * u - noise)))
    stated = next(n for n in notes if "--flip y" in n)
    assert float(stated.split("would be ")[1].split(" %")[0]) == pytest.approx(expected, abs=0.051)
    assert not any("--flip" in n for n in validate(GAIN, a_record(u, 2 * u + noise)).notes)
    assert not any("--flip" in n for n in validate(GAIN, a_record(u, rng.normal(size=2000))).notes)


def test_samples_that_the_run_starts_from_are_left_out(rng: np.random.Generator) -> None:
    model = LPVTransferFunction.siso(
        [[-0.5]], [[0.0], [0.0], [0.0], [1.0]], Polynomial(), TS, inputs=("u",), outputs=("y",)
    )
    record = a_record(rng.normal(size=50), rng.normal(size=50))
    y, run = record["y"][3:], simulate(model, record).output[3:, 0]
    figures = validate(model, record).overall.free_run
    assert figures.n_samples == 47
    assert figures.esr == pytest.approx(np.sum((y - run) ** 2) / np.sum((y - y.mean()) ** 2))
    step = predict(model, record).output[3:, 0]
    assert validate(model, record).overall.one_step.esr == pytest.approx(
        np.sum((y - step) ** 2) / np.sum((y - y.mean()) ** 2)
    )


def test_pooled_figures_sum_over_records_each_about_its_own_mean(rng: np.random.Generator) -> None:
    records = [
        a_record(rng.normal(size=n), offset + rng.normal(size=n), f"r{n}") for n, offset in ((30, 0.0), (200, 500.0))
    ]
    found = validate(GAIN, records)
    errors = [np.sum((r["y"] - 2 * r["u"]) ** 2) for r in records]
    powers = [np.sum((r["y"] - r["y"].mean()) ** 2) for r in records]
    assert found.overall.free_run.esr == pytest.approx(sum(errors) / sum(powers))
    assert found.overall.free_run.rmse == pytest.approx(np.sqrt(sum(errors) / 230))
    for row, error, power in zip(found.records, errors, powers, strict=True):
        assert row.free_run.esr == pytest.approx(error / power)
    assert [r.name for r in found.records] == ["r30", "r200"]


def test_several_outputs_are_averaged(rng: np.random.Generator) -> None:
    model = LPVTransferFunction(
        np.zeros((0, 2, 2, 1)), np.array([[[[1.0]], [[3.0]]]]), Polynomial(), TS, inputs=("u",), outputs=("y", "z")
    )
    u, y, z = rng.normal(size=(3, 80))
    found = validate(model, a_record(u, 1e4 * y, z=z))
    each = [np.sum((m - g * u) ** 2) / np.sum((m - m.mean()) ** 2) for m, g in ((1e4 * y, 1.0), (z, 3.0))]
    assert found.overall.free_run.esr == pytest.approx(np.mean(each))


def test_a_constant_output_has_no_error_ratio() -> None:
    found = validate(GAIN, a_record([0.0, 1.0, 2.0], [0.1, 0.1, 0.1]))
    assert found.overall.free_run.esr is None
    assert found.overall.free_run.rmse == pytest.approx(np.sqrt(np.mean((0.1 - np.array([0.0, 2, 4])) ** 2)))
    assert "does not move" in found.summary()


def test_a_run_away_has_no_figures_but_says_where() -> None:
    model = LPVTransferFunction.siso([[-2.0]], [[0.0], [1.0]], Polynomial(), TS, inputs=("u",), outputs=("y",))
    rng = np.random.default_rng(0)
    fine, bad = (a_record(rng.normal(size=n), rng.normal(size=n), str(n)) for n in (10, 400))
    found = validate(model, [fine, bad])
    assert found.overall.free_run.esr is None
    assert found.overall.free_run.diverged_at is not None
    assert found.records[0].free_run.esr is not None
    assert found.overall.one_step.esr is not None
    data = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert data["overall"]["free_run"]["esr"] is None
    assert data["overall"]["free_run"]["diverged_at"] == found.records[1].free_run.diverged_at
    assert "diverged at sample" in repr(found)


def test_extrapolation_is_the_share_of_samples_outside_the_box(rng: np.random.Generator) -> None:
    box = Scheduling(("p",), (0.0,), (1.0,))
    model = LPVTransferFunction.siso(
        [], [[2.0, 0.0]], Polynomial("p"), TS, scheduling=box, inputs=("u",), outputs=("y",)
    )
    inside, half = np.linspace(0, 1, 300), np.linspace(0.5, 1.5, 100)
    records = [a_record(rng.normal(size=len(p)), rng.normal(size=len(p)), p=p) for p in (inside, half)]
    found = validate(model, records)
    assert [r.extrapolation_share for r in found.records] == [0.0, 0.5]
    assert found.extrapolation_share == pytest.approx(50 / 400)
    assert validate(GAIN, records).extrapolation_share == 0.0


def test_other_rates_are_resampled_and_said(rng: np.random.Generator) -> None:
    slow = np.convolve(rng.normal(size=4000), np.hanning(80) / 40, "same")
    fast = Record({"u": slow, "y": 2 * slow}, sample_time=TS / 2)
    found = validate(GAIN, fast)
    assert found.overall.free_run.n_samples == 2000
    assert found.overall.free_run.esr < 1e-5
    assert found.notes == ("1 record resampled to the model's 100 Hz",)


def test_velocity_is_derived_where_it_was_not_measured() -> None:
    t = TS * np.arange(600)
    model = GAIN.replace(inputs=("velocity",))
    record = Record(
        {"displacement": np.sin(3 * t), "y": 6 * np.cos(3 * t)}, sample_time=TS, units={"displacement": "m"}
    )
    assert validate(model, record).overall.free_run.esr < 1e-4


def test_state_space_models_are_validated_from_short_pieces(rng: np.random.Generator) -> None:
    model = LPVStateSpace(
        [0.1 * rng.normal(size=(4, 4))],
        [rng.normal(size=(4, 1))],
        [rng.normal(size=(1, 4))],
        [[[0.0]]],
        Polynomial(),
        TS,
        inputs=("u",),
        outputs=("y",),
    )
    y = rng.normal(size=40)
    y[10] = np.nan  # the first piece is as short as may be
    found = validate(model, a_record(rng.normal(size=40), y))
    assert [r.free_run.n_samples for r in found.records] == [2, 21]
    assert found.overall.free_run.esr is not None
    y[9] = np.nan
    assert len(validate(model, a_record(rng.normal(size=40), y)).records) == 1


def test_continuous_models_are_refused() -> None:
    model = LPVStateSpace(
        [[[-1.0]]], [[[1.0]]], [[[1.0]]], [[[0.0]]], Polynomial(), None, inputs=("u",), outputs=("y",)
    )
    with pytest.raises(InputError, match=r"continuous in time.*discretise"):
        validate(model, a_record(np.ones(5), np.ones(5)))


# -- residual tests ---------------------------------------------------------------------------------------------
def p_values(runs: int, residual, drive, seed: int, n: int = 1500, parts: int = 1) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    listed: dict[str, list[float]] = {"whiteness": [], "independence": []}
    for _ in range(runs):
        es, us = [], []
        for _ in range(parts):
            es.append(residual(rng.normal(size=n // parts)))
            us.append(drive(rng.normal(size=n // parts)))
        for test in residual_tests(es, us):
            listed[test.name].append(test.p_value)
    return {k: np.array(v) for k, v in listed.items()}


def white(e: np.ndarray) -> np.ndarray:
    return e


def coloured(pole: float):
    def colour(e: np.ndarray) -> np.ndarray:
        return lfilter([1.0], [1.0, -pole], e)

    return colour


@pytest.mark.seconds
def test_whiteness_is_calibrated_and_notices_colour() -> None:
    found = p_values(200, white, white, seed=11)
    assert kstest(found["whiteness"], "uniform").pvalue > 1e-3
    pooled = p_values(200, white, white, seed=12, n=3000, parts=3)
    assert kstest(pooled["whiteness"], "uniform").pvalue > 1e-3
    assert (p_values(30, coloured(0.5), white, seed=13)["whiteness"] < 1e-6).all()


def low_pass(e: np.ndarray) -> np.ndarray:
    """Velocity of a rig sampled ten times too fast: 25 lags of it are nearly dependent."""
    return lfilter(*butter(4, 0.1), e)


@pytest.mark.thinned(5, "slow", "seconds")
@pytest.mark.parametrize(
    ("residual", "drive"),
    [(white, white), (white, coloured(0.9)), (coloured(0.8), white), (coloured(0.8), coloured(0.9)), (white, low_pass)],
    ids=["ww", "wc", "cw", "cc", "wl"],
)
def test_independence_is_calibrated_under_colour(residual, drive) -> None:
    """At the 1 % level a calibrated test rejects 3 ± 1.7 of 300, and half of them at the 50 % level."""
    p = p_values(300, residual, drive, seed=21, n=2000)["independence"]
    assert np.sum(p < 0.01) <= 12
    assert 100 <= np.sum(p < 0.5) <= 200


def test_independence_has_power_where_the_input_is_slow() -> None:
    """A missing term of a third of the noise in the input's units is found in 4000 samples."""
    hits = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        u = low_pass(rng.normal(size=4000))
        tests = {t.name: t for t in residual_tests([0.3 * np.roll(u, 2) + rng.normal(size=4000)], [u])}
        hits.append(not tests["independence"].passed)
    assert np.mean(hits) > 0.8


def test_a_missing_lag_is_noticed(rng: np.random.Generator) -> None:
    u = rng.normal(size=4000)
    y = lfilter([0.0, 1.0, 0.4], [1.0, -0.6], u) + 0.05 * rng.normal(size=4000)
    record = a_record(u, y)
    short = identify(record, ARX(na=0, nb=4, input="u", output="y")).training
    assert short is not None
    tests = {t.name: t for t in short.residual_tests}
    assert not tests["independence"].passed
    assert tests["independence"].p_value < 1e-6
    assert "depends on present or past inputs" in tests["independence"].description


def test_a_missing_direct_term_is_noticed(rng: np.random.Generator) -> None:
    u = rng.normal(size=4000)
    y = lfilter([0.5, 1.0], [1.0], u) + 0.05 * rng.normal(size=4000)
    late = identify(a_record(u, y), ARX(na=0, nb=1, nk=1, input="u", output="y")).training
    assert late is not None
    assert late.residual_tests[0].passed  # white all the same
    assert not late.residual_tests[1].passed


def test_an_exact_model_leaves_no_residual_to_test(rng: np.random.Generator) -> None:
    u = rng.normal(size=2000)
    exact = identify(a_record(u, lfilter([0.0, 1.0], [1.0, -0.5], u)), ARX(na=1, nb=1, input="u", output="y")).training
    assert exact is not None
    assert [t.description for t in exact.residual_tests] == ["the residual is zero"] * 4


def test_a_complete_model_passes(rng: np.random.Generator) -> None:
    u, e = rng.normal(size=(2, 4000))
    y = lfilter([0.0, 1.0, 0.4], [1.0, -0.6], u) + lfilter([1.0], [1.0, -0.6], 0.2 * e)
    found = identify(a_record(u, y), ARX(na=1, nb=2, input="u", output="y")).training
    assert found is not None
    assert [t.name for t in found.residual_tests] [:2] == ["whiteness", "independence"]
    assert all(t.passed for t in found.residual_tests)


def test_the_statistics_by_hand(rng: np.random.Generator) -> None:
    e, u = rng.normal(size=(2, 400))
    tests = {t.name: t for t in residual_tests([e], [u])}
    c = e - e.mean()
    rho = np.array([np.sum(c[k:] * c[:-k]) for k in range(1, LAGS + 1)]) / np.sum(c * c)
    assert tests["whiteness"].statistic == pytest.approx(400 * 402 * np.sum(rho**2 / (400 - np.arange(1, LAGS + 1))))


def test_residuals_that_say_nothing() -> None:
    long, short = np.zeros(500), np.zeros(4 * LAGS)
    assert residual_tests([short], [short]) == ()
    (whiteness,) = residual_tests([long], [np.ones(500)])  # an input that never moves is no input
    assert (whiteness.passed, whiteness.p_value) == (True, 1.0)
    tests = residual_tests([long], [np.random.default_rng(0).normal(size=500)])
    assert [t.passed for t in tests] == [True, True]
    assert len(residual_tests([np.random.default_rng(0).normal(size=500)], [None])) == 1


def test_units_change_no_residual_test(rng: np.random.Generator) -> None:
    e, u = rng.normal(size=(2, 600))
    for mine, theirs in zip(residual_tests([e], [u]), residual_tests([1e-9 * e], [1e7 * u + 3e8]), strict=True):
        assert theirs.p_value == pytest.approx(mine.p_value, rel=1e-5)


def test_data_that_the_model_has_seen_are_never_called_held_out() -> None:
    rng = np.random.default_rng(4)
    u = rng.normal(size=900)
    y = np.zeros(900)
    for k in range(1, 900):
        y[k] = 0.8 * y[k - 1] + u[k - 1] + 0.1 * rng.normal()
    whole = lpv.Record({"u": u, "y": y}, sample_time=0.01, name="whole")
    found = lpv.identify(whole.slice(0, 600), lpv.ARX(na=1, nb=1, input="u", output="y"))
    assert lpv.validate(found.model, whole.slice(600, 900)).label == "held-out"
    assert lpv.validate(found.model, whole.slice(0, 600)).label == "training"
    assert lpv.validate(found.model, whole).label == "partly training"
    both = lpv.validate(found.model, [whole, whole.slice(600, 900)])
    assert both.label == "partly training"
    assert any("not held-out" in note for note in both.notes)


def test_regimes_find_the_half_where_the_model_is_wrong() -> None:
    rng = np.random.default_rng(9)
    u, p = rng.normal(size=4000), rng.uniform(0, 1, 4000)
    y = np.zeros(4000)
    for k in range(1, 4000):
        y[k] = 0.5 * y[k - 1] + (1.0 if u[k - 1] > 0 else 2.0) * u[k - 1] + (0.5 * rng.normal() if p[k] > 0.8 else 0)
    model = lpv.LPVTransferFunction.siso([[-0.5, 0.0]], [[0, 0], [1.0, 0.0]], lpv.Polynomial("p", degree=1), 0.01,
                                         scheduling=lpv.Scheduling(("p",), (0,), (1,)), inputs=("u",), outputs=("y",))
    found = lpv.validate(model, lpv.Record({"u": u, "p": p, "y": y}, sample_time=0.01), horizons=(3,))
    parts = {r.where: r for r in found.regimes}
    assert sum(parts[w].error_share for w in ("u < 0", "u >= 0")) == pytest.approx(1.0)
    levels = [r for r in found.regimes if "p" in r.where and "Hz" not in r.where]
    assert sum(r.share for r in levels) == pytest.approx(1.0)
    assert sum(r.error_share for r in found.regimes if "Hz" in r.where) == pytest.approx(1.0)
    assert found.k_steps[0].kind == "3-step"
    assert found.to_dict()["overall"]["3_step"]["esr"] == found.k_steps[0].esr


def test_bands_hold_the_whole_error_however_slow(rng: np.random.Generator) -> None:
    """An error slower than 1024 samples, an offset and noise: their shares by hand, and the ESR of the whole run."""
    n = 8000
    u = rng.normal(size=n)
    slow = 2.0 * np.sin(2 * np.pi * 0.025 * TS * np.arange(n)) + 1.0
    found = validate(GAIN, a_record(u, 2 * u + slow + rng.normal(size=n)))
    bands = [r for r in found.regimes if "Hz" in r.where]
    assert bands[0].where.startswith("0 to 0.3")
    assert bands[0].error_share == pytest.approx(3 / 4, abs=0.02)  # of 2²/2 + 1² of 2²/2 + 1² + 1²
    assert sum(r.error_share for r in bands) == pytest.approx(1.0, rel=1e-12)
    assert sum(r.share for r in bands) == pytest.approx(1.0, rel=1e-12)
    assert sum(r.share * r.esr for r in bands if r.esr is not None) == pytest.approx(found.overall.free_run.esr)


def test_bands_agree_with_a_fourier_transform(rng: np.random.Generator) -> None:
    """Of noise with most power below 1 Hz, over two records of which one is longer than a chunk of the transform."""
    stretches = []
    expected, edges = np.zeros(2), (0.0, 3.472)
    for n in (70_000, 900):
        error = lfilter(*butter(2, 0.02), rng.normal(size=n)) + 0.05 * rng.normal(size=n)
        u = rng.normal(size=n)
        stretches.append(FreeRunStretch(u + error, u, None, np.empty((n, 0))))
        power, at = np.abs(np.fft.fft(error)) ** 2 / n, np.abs(np.fft.fftfreq(n, TS))
        expected += power[at < edges[1]].sum(), power.sum()
    found = regimes(stretches, "u", (), TS)
    below = sum(r.error_share for r in found if float(r.where.split()[2]) < 5)
    assert below == pytest.approx(expected[0] / expected[1], abs=0.01)


def test_another_rate_than_the_model_s_is_refused() -> None:
    model = lpv.LPVTransferFunction.siso([[-0.5]], [[0], [1.0]], lpv.Polynomial(), 0.01, inputs=("u",), outputs=("y",))
    record = lpv.Record({"u": np.ones(50), "y": np.arange(50.0)}, sample_time=0.01)
    with pytest.raises(lpv.InputError, match="its own rate"):
        lpv.validate(model, record, sample_rate=50.0)


@pytest.mark.seconds
def test_a_degree_that_is_too_low_shows_along_the_scheduling() -> None:
    rng = np.random.default_rng(21)
    failed, false_alarms = 0, 0
    for _ in range(20):
        u, p = rng.normal(size=3000), rng.uniform(-1, 1, 3000)
        gain = 1 + 0.3 * p + 0.25 * p**2
        y = np.zeros(3000)
        for k in range(1, 3000):
            y[k] = 0.5 * y[k - 1] + gain[k] * u[k - 1] + 0.1 * rng.normal()
        record = lpv.Record({"u": u, "p": p, "y": y}, sample_time=0.01)
        for degree in (1, 2):
            found = lpv.identify(record, lpv.ARX(na=1, nb=1, input="u", output="y",
                                                 basis=lpv.Polynomial("p", degree=degree)))
            assert found.training is not None
            tests = {t.name: t for t in found.training.residual_tests}
            failed += degree == 1 and not tests["independence along p"].passed
            false_alarms += degree == 2 and not tests["independence along p"].passed
            assert {"whiteness", "whiteness over 5 lags", "whiteness over 100 lags", "independence"} <= set(tests)
    assert failed == 20
    assert false_alarms <= 2


def test_a_mean_error_that_is_only_rounding_is_zero() -> None:
    """Least squares with a constant leaves one-step residuals without a mean."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal(300)
    y = 900.0 + lfilter([0.0, 50.0], [1.0, -0.5], u) + rng.standard_normal(300)
    found = identify(a_record(u, y), ARX(na=1, nb=1, input="u", output="y", affine=1))
    assert found.training.overall.one_step.mean_error == 0.0
    assert abs(found.training.overall.free_run.mean_error) > 1e-9


def test_inputs_beyond_the_training_range_are_stated_with_both_ranges() -> None:
    """Millimetres read as metres: nothing else in the data shows it to a model."""
    rng = np.random.default_rng(1)
    u = rng.uniform(-1.0, 1.0, 400)
    training = a_record(u, 2.0 * u + 0.1 * rng.standard_normal(400))
    found = identify(training, ARX(na=0, nb=1, input="u", output="y", nk=0))
    inside, v = a_record(0.9 * u, u), 1e3 * u
    assert not [n for n in validate(found.model, inside).notes if "range" in n]
    stated = [n for n in validate(found.model, a_record(v, v)).notes if "range of the training data" in n]
    assert len(stated) == 1 and f"{v.min():.4g} to {v.max():.4g}, training {u.min():.4g} to {u.max():.4g}" in stated[0]
    outside = 100 * np.mean((v < u.min()) | (v > u.max()))
    assert stated[0].startswith(f"{outside:.3g} % of 'u' lies outside")


def test_what_gaps_and_missing_samples_cut_away_is_stated(rng):
    """Two records, one with a hole of ten samples and a stretch of two that is too short to run along."""
    from lpvid.validation.free_runs import free_runs

    model = LPVTransferFunction.siso([[-0.5, 0.0]], [[0, 0], [1.0, 0.5]], Polynomial("p", degree=1), 0.1)

    def record(name, holes=()):
        u = rng.normal(size=100)
        for a, b in holes:
            u[a:b] = np.nan
        return Record({"u1": u, "p": rng.uniform(size=100), "y1": rng.normal(size=100)}, sample_time=0.1, name=name)

    found = free_runs(model, [record("whole"), record("holed", [(40, 50), (52, 60)])])
    assert len(found.runs) == 3
    cut, = [n for n in found.notes if "cut into" in n]
    assert cut == "record 'holed': cut into 3 pieces at missing samples"
    dropped, = [n for n in found.notes if "dropped" in n]
    assert dropped.startswith("record 'holed': dropped 1 piece(s) shorter than")


@pytest.mark.parametrize("rate", [200.0, 100.0, 80.0])
def test_a_record_of_unsteady_stamps_is_recognised_by_a_model_of_its_first_part(rate) -> None:
    """The mean clock of a part differs from that of the whole by 1e-5, and every sample brought onto it with it."""
    rng = np.random.default_rng(8)
    t = np.arange(3000) / 200 + rng.uniform(-0.08, 0.08, 3000) / 200
    u = np.sin(5 * t) + 0.4 * np.sin(17 * t + 1)
    whole = lpv.Record({"u": u, "y": 3 * u + 0.2 * u * np.abs(u) + 0.01 * rng.standard_normal(3000)}, time=t, name="w")
    found = lpv.identify(whole.slice(0, 2000), lpv.ARX(na=1, nb=2, input="u", output="y"), sample_rate=rate)
    assert lpv.validate(found.model, whole).label == "partly training"
    assert lpv.validate(found.model, whole.slice(700, 1500)).label == "training"
    assert lpv.validate(found.model, whole.slice(2000, 3000)).label == "held-out"
