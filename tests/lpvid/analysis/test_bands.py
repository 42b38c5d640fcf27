"""Bands of frequency response and free run: closed forms, and coverage by Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest

import lpvid as lpv
from lpvid.analysis.bands import Band, free_run_band, frequency_band, frequency_response
from lpvid.plot import bands as plot
from lpvid.plot.comparison import Comparison

TRUTH = lpv.LPVTransferFunction.siso([[-1.3, 0.1], [0.55, -0.05]], [[0, 0], [0.5, 0.1], [0.2, -0.1]],
                                     lpv.Polynomial("p", degree=1), 0.01,
                                     scheduling=lpv.Scheduling(("p",), (-1,), (1,)))


def record(rng: np.random.Generator, n: int = 600, noise: float = 0.05) -> lpv.Record:
    u, p = rng.normal(size=n), rng.uniform(-1, 1, n)
    y = np.zeros(n)
    e = noise * rng.normal(size=n)
    for k in range(2, n):
        a1, a2 = -1.3 + 0.1 * p[k], 0.55 - 0.05 * p[k]
        y[k] = -a1 * y[k - 1] - a2 * y[k - 2] + (0.5 + 0.1 * p[k]) * u[k - 1] + (0.2 - 0.1 * p[k]) * u[k - 2] + e[k]
    return lpv.Record({"u": u, "p": p, "y": y}, sample_time=0.01)


def test_frequency_response_is_the_quotient_of_polynomials() -> None:
    f = np.array([0.0, 3.0, 20.0, 50.0])
    z = np.exp(2j * np.pi * f * 0.01)
    expected = (0.55 / z + 0.15 / z**2) / (1 - 1.25 / z + 0.525 / z**2)
    np.testing.assert_allclose(frequency_response(TRUTH, [0.5], f)[:, 0, 0], expected, rtol=1e-12)


def test_both_model_types_have_one_frequency_response() -> None:
    f = np.linspace(0, 50, 7)
    state_space = lpv.realize(TRUTH, form="observable").model
    np.testing.assert_allclose(frequency_response(state_space, [-0.3], f), frequency_response(TRUTH, [-0.3], f),
                               rtol=1e-10)


@pytest.mark.slow
def test_bands_cover_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(5)
    f = np.array([1.0, 5.0, 12.0, 30.0])
    truth = np.abs(frequency_response(TRUTH, [0.5], f))
    fresh = record(rng, 200)
    run = lpv.simulate(TRUTH.replace(inputs=("u",), outputs=("y",)), fresh)
    frequency_hits, run_hits = [], []
    for _ in range(60):
        found = lpv.identify(record(rng), lpv.ARX(na=2, nb=2, input="u", output="y",
                                                  basis=lpv.Polynomial("p", degree=1)))
        draws = found.draw(rng, 150)
        frequency_hits.append(frequency_band(draws, [0.5], f).contains(truth).mean())
        run_hits.append(free_run_band(draws, fresh).contains(run.output)[10:].mean())
    assert 0.90 <= np.mean(frequency_hits) <= 0.985
    assert 0.90 <= np.mean(run_hits) <= 0.985


def test_too_few_draws_and_a_bad_level_are_refused() -> None:
    with pytest.raises(lpv.InputError, match="two drawn models"):
        frequency_band([TRUTH], [0.0], np.array([1.0]))
    with pytest.raises(lpv.InputError, match="between 0 and 1"):
        frequency_band([TRUTH, TRUTH], [0.0], np.array([1.0]), level=95)


def test_the_figure_shows_the_curves_where_a_few_draws_widen_the_band_by_orders_of_magnitude() -> None:
    data = record(np.random.default_rng(0)).with_roles({"u1": "u", "y1": "y"})
    n = data.n_samples
    run = lpv.simulate(TRUTH, data)
    shown = Comparison(data, "held-out", run, run, "y", "")
    wide = np.zeros((n, 1))
    wide[50] = 1e7
    band = Band(np.arange(n) * 0.01, run.output - wide, run.output, run.output + wide, 0.95, 100, 0, "free-run output")
    low, high = plot.free_run_band(shown, band)[0].get_ylim()
    span = np.ptp(np.concatenate([data["y"][:400], run.output[:400, 0]]))
    assert low <= run.output[:400].min() and high >= run.output[:400].max() and high - low < 3.5 * span
    narrow = Band(band.axis, run.output - 0.01, run.output, run.output + 0.01, 0.95, 100, 0, "free-run output")
    low, high = plot.free_run_band(shown, narrow)[0].get_ylim()
    assert high - low < 1.3 * span
