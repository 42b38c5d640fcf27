"""How far a fit can be trusted: against simulation, and in the lines that commands print."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm
from typer.testing import CliRunner

import lpvid as lpv
import quartercar
from lpvid.cli.app import app
from lpvid.record import Record
from lpvid.report.figures import grade, verdict_grade
from lpvid.report.validation import verdict
from lpvid.validation.trust import LEVEL, QUANTILE, esr_interval, independent_samples, training_doubt


def linear(n: int, seed: int = 0) -> Record:
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(n)
    y = np.zeros(n)
    for k in range(1, n):
        y[k] = 0.7 * y[k - 1] + u[k - 1] + 0.3 * rng.standard_normal()
    return Record({"u": u, "y": y}, sample_time=0.01)


@pytest.mark.seconds
def test_error_on_other_data_is_as_the_parameters_make_it():
    """Regression on n samples with k regressors: the mean square elsewhere is (n + k)/(n − k) times that of the fit."""
    rng, n, k, ratios = np.random.default_rng(1), 27, 9, []
    for _ in range(4000):
        x = rng.standard_normal((n, k))
        y, other = rng.standard_normal(n), rng.standard_normal(n)
        theta = np.linalg.lstsq(x, y, rcond=None)[0]
        ratios.append((np.sum((y - x @ theta) ** 2), np.sum((other - x @ theta) ** 2)))
    fitted, elsewhere = np.mean(ratios, axis=0)
    assert elsewhere / fitted == pytest.approx((n + k) / (n - k), rel=0.02)
    assert training_doubt(n, k) is None
    assert training_doubt(n - 1, k) is not None
    assert "as many parameters as equations" in (training_doubt(9, 9) or "")


@pytest.mark.parametrize("pole", [0.0, 0.5, 0.9])
def test_independent_samples_are_those_of_an_autoregression(pole):
    """Σ ρ_j² of a first-order autoregression is (1 + a²)/(1 − a²)."""
    from scipy.signal import lfilter

    rng, n = np.random.default_rng(2), 4000
    found = independent_samples([lfilter([1], [1, -pole], rng.standard_normal(n)) for _ in range(3)])
    assert found == pytest.approx(3 * n * (1 - pole**2) / (1 + pole**2), rel=0.15)
    assert independent_samples([np.zeros(7)]) == 7


def test_interval_of_the_esr_covers_as_often_as_stated():
    rng, count = np.random.default_rng(3), 6
    found = [esr_interval(float(np.mean(e**2)), count) for e in rng.standard_normal((4000, count))]
    assert np.mean([low < 1 < high for low, high in found]) == pytest.approx(0.95, abs=0.012)


def test_identification_states_it_in_its_first_line():
    structure = lpv.ARX(na=4, nb=4, nk=1, input="u", output="y", affine=1)
    short, long = (lpv.identify(linear(n), structure) for n in (20, 400))
    assert repr(short).splitlines()[0].startswith(
        "Identification (training fit cannot be trusted: 16 equations for 9 parameters, 3.6 times that error")
    assert short.to_dict()["doubt"] == short.doubt
    assert long.doubt is None
    assert repr(long).startswith("Identification: ")
    assert lpv.identify(linear(20), structure, held_out=linear(400, 1)).doubt is None  # another figure decides


def test_validation_of_a_handful_of_samples_states_it():
    model = lpv.identify(linear(400), lpv.ARX(na=1, nb=1, nk=1, input="u", output="y")).model
    few = lpv.validate(model, linear(400, 5).slice(40, 45), label="held-out")
    assert few.doubt is not None
    assert repr(few).startswith("Validation (held-out; fit cannot be trusted: 4 samples are worth")
    assert few.to_dict()["independent_samples"] == few.independent_samples
    assert lpv.validate(model, linear(400, 5)).doubt is None


def test_auto_on_a_short_record_names_what_helps(tmp_path: Path):
    t = np.arange(60) / 100
    rows = "\n".join(f"{a:.2f},{np.sin(9 * a):.6f},{90 * np.sin(9 * a + 0.1):.6f}" for a in t)
    (tmp_path / "short.csv").write_text(f"time [s],velocity [m/s],force [N]\n{rows}\n", encoding="utf-8")
    ran = CliRunner().invoke(app, ["identify", str(tmp_path / "short.csv"), "--auto"])
    assert ran.exit_code == 2
    line = ran.stderr.strip().splitlines()[-1]
    assert "too short to compare structures" in line
    assert "--structure" in line


def test_the_report_of_such_a_fit_is_not_green():
    structure = lpv.ARX(na=4, nb=4, nk=1, input="u", output="y", affine=1)
    found = lpv.identify(linear(20), structure)
    assert grade(found.training.overall.free_run.esr) == "good"
    assert verdict_grade(found.training, found.doubt) == "warn"
    assert "Training fit cannot be trusted" in verdict(found.training, found.doubt)
    few = lpv.validate(lpv.identify(linear(400), structure).model, linear(400, 5).slice(40, 50))
    assert few.doubt is not None and verdict_grade(few) != "good"
    assert "cannot be trusted" in verdict(few)


def test_a_free_run_no_better_than_the_mean_stands_in_the_first_line():
    """An intercept has ESR 1: a model of the wrong sign is far beyond, and says so before its figures."""
    model = lpv.identify(linear(400), lpv.ARX(na=1, nb=1, nk=1, input="u", output="y")).model
    wrong = lpv.validate(model.replace(b=-model.b), linear(400, 5))
    assert wrong.overall.free_run.esr > 1
    assert repr(wrong).startswith("Validation (held-out; free run no better than the mean")
    assert verdict(wrong).count("better than the mean") == 0 and "explains nothing of the output" in verdict(wrong)
    fitted = lpv.identify(linear(400), lpv.ARX(na=1, nb=1, nk=1, input="u", output="y"), held_out=linear(400, 5))
    poor = fitted.replace(training=lpv.validate(model.replace(b=-model.b), linear(400)))
    assert fitted.doubt is None
    assert repr(fitted.replace(held_out=wrong)).startswith("Identification (held-out free run no better than the mean")
    assert repr(poor).startswith("Identification (the model cannot simulate the data that it was fitted to")


def test_the_quantile_of_intervals_is_that_of_their_level_and_stands_in_one_place():
    assert round(float(norm.ppf((1 + LEVEL) / 2)), 2) == QUANTILE
    packages = [Path(p.__file__).parent for p in (lpv, quartercar)]
    places = [f.name for p in packages for f in p.rglob("*.py") if "= 1.96" in f.read_text(encoding="utf8")]
    assert places == ["trust.py"]
