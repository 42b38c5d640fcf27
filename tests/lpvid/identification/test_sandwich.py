"""The sandwich covariance against the closed form for a regression whose noise is coloured."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

import lpvid as lpv
from lpvid.identification.sandwich import residual_memory


def fir_record(rng: np.random.Generator, n: int = 12_000, pole: float = 0.9) -> lpv.Record:
    """y = u(k-1) + 0.5 u(k-2) + v with slow u and AR(1) v: least squares is unbiased, its white covariance wrong."""
    u = lfilter([1.0], [1, -0.9], rng.normal(size=n))
    y = np.convolve(u, [0, 1.0, 0.5])[:n] + lfilter([1.0], [1, -pole], rng.normal(size=n))
    return lpv.Record({"u": u, "y": y}, sample_time=0.01)


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
