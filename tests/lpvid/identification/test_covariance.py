"""Covariance of estimates: the sandwich against closed forms for coloured noise, inverses against numpy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

import lpvid as lpv
from lpvid.identification.covariance import (
    bartlett,
    blocks,
    clusters,
    estimate_covariance,
    inverse_gram,
    normal_inverse,
    residual_memory,
    vague_inverse,
)

SECOND_ORDER: dict = {"na": 2, "nb": 2, "nk": 1, "input": "u", "output": "y"}


def fir_record(rng: np.random.Generator, n: int = 12_000, pole: float = 0.9) -> lpv.Record:
    """y = u(k-1) + 0.5 u(k-2) + v with slow u and AR(1) v: least squares is unbiased, its white covariance wrong."""
    u = lfilter([1.0], [1, -0.9], rng.normal(size=n))
    y = np.convolve(u, [0, 1.0, 0.5])[:n] + lfilter([1.0], [1, -pole], rng.normal(size=n))
    return lpv.Record({"u": u, "y": y}, sample_time=0.01)


@pytest.mark.slow
def test_standard_errors_match_the_spread_where_the_white_form_does_not() -> None:
    rng = np.random.default_rng(11)
    structure = lpv.ARX(na=0, nb=2, input="u", output="y")
    found = [lpv.identify(fir_record(rng), structure) for _ in range(60)]
    assert all(any("sandwich" in note for note in f.notes) for f in found)
    spread = np.std([f.parameters.sum() for f in found])
    ones = np.ones(2)
    sandwich = np.mean([np.sqrt(ones @ f.covariance @ ones) for f in found])
    white = np.mean([np.sqrt(ones @ f.structure.regress([fir_record(rng)], f.model.box).covariance @ ones)
                     for f in found[:20]])
    assert 0.72 < sandwich / spread < 1.25
    assert white / spread < 0.6
    assert np.allclose(found[0].model.metadata["parameters"]["covariance"], found[0].covariance)


def test_white_residuals_keep_the_plain_covariance(rng: np.random.Generator) -> None:
    u = rng.normal(size=3000)
    y = np.convolve(u, [0, 1.0])[:3000] + rng.normal(size=3000)
    found = lpv.identify(lpv.Record({"u": u, "y": y}, sample_time=0.01), lpv.ARX(na=0, nb=1, input="u", output="y"))
    assert not any("sandwich" in note for note in found.notes)


def test_memory_of_an_autoregression(rng: np.random.Generator) -> None:
    assert residual_memory([rng.normal(size=20_000)]) <= 12
    slow = residual_memory([lfilter([1.0], [1, -0.9], rng.normal(size=20_000))])
    assert 20 <= slow <= 80
    assert residual_memory([np.zeros(100)]) == 1


def test_inverses_agree_where_all_is_seen_and_treat_blind_columns_as_stated(rng: np.random.Generator) -> None:
    units = np.array([1e-6, 1.0, 1e5])
    j = rng.normal(size=(50, 3)) * units
    exact = np.linalg.inv((j / units).T @ (j / units)) / np.outer(units, units)
    factor = np.asarray(np.linalg.qr(j, mode="r"))
    for found in (inverse_gram(j), inverse_gram(factor), normal_inverse(j.T @ j), vague_inverse(j)):
        np.testing.assert_allclose(found, exact, rtol=1e-9)
    blind = np.column_stack([j, np.zeros(50)])
    assert not inverse_gram(blind)[3].any()
    np.testing.assert_allclose(inverse_gram(blind)[:3, :3], exact, rtol=1e-9)
    twin = np.column_stack([j, j[:, 0]])  # two parameters that only act together
    assert vague_inverse(twin)[3, 3] > 1e12 * exact[0, 0] and inverse_gram(twin)[3, 3] < exact[0, 0]


def test_middles_are_the_long_run_covariance_of_the_scores(rng: np.random.Generator) -> None:
    """Scores AR(1) with pole 0.8 have the long-run variance 1/(1 − 0.8)² = 25 times that of the innovations."""
    scores = np.asarray(lfilter([1.0], [1, -0.8], rng.normal(size=(200_000, 2)), axis=0))
    halves = [scores[:100_000], scores[100_000:]]
    for middle in (blocks(halves, 200), bartlett(halves, 200), clusters(scores, np.arange(200_000) // 200)):
        np.testing.assert_allclose(middle / 200_000, 25 * np.eye(2), atol=2.5)
    np.testing.assert_allclose(clusters(scores[:100], np.arange(100)), scores[:100].T @ scores[:100])
    np.testing.assert_allclose(bartlett([scores[:100]], 0), scores[:100].T @ scores[:100])


def test_estimate_covariance_is_the_textbook_one_for_white_errors(rng: np.random.Generator) -> None:
    j, e = rng.normal(size=(4000, 3)), 0.3 * rng.normal(size=4000)
    free = np.array([True, True, False])
    found = estimate_covariance(j, e, (2000, 2000), free)
    assert not found.notes and np.isnan(found.covariance[2]).all()
    np.testing.assert_allclose(found.covariance[:2, :2], e @ e / 3998 * np.linalg.inv(j[:, :2].T @ j[:, :2]), rtol=1e-9)
    j[:, 1] = 0.0
    assert estimate_covariance(j, e, (2000, 2000), free).covariance[1, 1] == np.inf


@pytest.mark.parametrize("part", [65_536, 8])
def test_bartlett_is_the_sum_of_weighted_lagged_products(part: int, rng: np.random.Generator,
                                                         monkeypatch: pytest.MonkeyPatch) -> None:
    """Whole, and in parts shorter than a window."""
    monkeypatch.setattr("lpvid.identification.covariance.PART", part)
    pieces = [rng.normal(size=(n, 3)) for n in (40, 7, 2)]
    expected = np.zeros((3, 3))
    for s in pieces:
        for t in range(len(s)):
            for u in range(len(s)):
                expected += max(1 - abs(t - u) / 10, 0.0) * np.outer(s[t], s[u])
    np.testing.assert_allclose(bartlett(pieces, 9), expected, atol=1e-12)


def static_gain(seed: int) -> tuple[float, float, bool]:
    """b of y = b·u by least squares of 1500 samples, its standard error, and whether the fit says sandwich."""
    found = lpv.identify(coloured_gain(seed), lpv.ARX(na=0, nb=1, nk=0, input="u", output="y"))
    return float(found.parameters[0]), float(found.standard_errors[0]), "sandwich" in found.covariance_kind


def coloured_gain(seed: int) -> lpv.Record:
    rng = np.random.default_rng(seed)
    u, e = (lfilter([1.0], [1, -0.95], rng.normal(size=1500)) for _ in range(2))
    return lpv.Record({"u": u, "y": 2 * u + e}, sample_time=0.01)


@pytest.mark.seconds
def test_a_short_record_with_a_coloured_residual_has_no_white_standard_errors() -> None:
    """Too short for a hundred blocks: white ones are (1 + .95²)/(1 − .95²) = 20 times too small in variance."""
    found = np.array([static_gain(seed) for seed in range(40)])
    assert found[:, 2].all()
    assert 0.5 < found[:, 1].mean() / found[:, 0].std() < 1.5


@pytest.mark.slow
@pytest.mark.parametrize(("structure", "noise"), [
    pytest.param(lpv.BoxJenkins(nc=0, nd=1, starts=1, **SECOND_ORDER), ([1.0], [1, -1.6, 0.8]), id="box-jenkins"),
    pytest.param(lpv.ARMAX(nc=1, starts=1, **SECOND_ORDER), ([1.0], [1.0]), id="armax"),
    pytest.param(lpv.RefinedIV(noise="box-jenkins", nc=0, nd=1, **SECOND_ORDER), ([1.0], [1, -1.6, 0.8]), id="refined"),
])
def test_standard_errors_match_the_spread_where_the_noise_model_is_too_small(structure, noise) -> None:
    """Noise of two poles beside a model of one, output noise beside one lag: white ones are off by 30 %."""
    found = [lpv.identify(second_order(np.random.default_rng(seed), *noise), structure) for seed in range(200)]
    assert all("coloured" in f.covariance_kind or "correlated" in f.covariance_kind for f in found)
    spread = np.std([f.parameters for f in found], axis=0, ddof=1)
    ratio = np.median([f.standard_errors for f in found], axis=0) / spread
    assert ratio.min() > 0.85, ratio  # the spread of 200 runs is known to 5 %
    assert ratio.max() < 1.15, ratio


def second_order(rng: np.random.Generator, numerator: list, denominator: list, n: int = 2000) -> lpv.Record:
    """y = B/A u + C/D e with slow u, A of two complex poles."""
    u = lfilter([1.0], [1, -0.9], rng.normal(size=n))
    y = lfilter([0, 1.0, 0.5], [1, -1.2, 0.5], u) + lfilter(numerator, denominator, 0.3 * rng.normal(size=n))
    return lpv.Record({"u": u, "y": y}, sample_time=1.0)


def test_noise_models_that_suffice_keep_the_covariance_of_white_innovations(rng: np.random.Generator) -> None:
    record = second_order(rng, [1.0], [1, -1.6, 0.8])
    kind = lpv.identify(record, lpv.BoxJenkins(nc=0, nd=2, starts=1, **SECOND_ORDER)).covariance_kind
    assert kind == "Gauss-Newton, white innovations"
