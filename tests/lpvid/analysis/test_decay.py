"""Decay rates: slowest poles, and the exact rate of a rotating system."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.gain_systems import rotating, time_invariant, vanishing

import lpvid as lpv
from lpvid.analysis.decay import decay_rate
from lpvid.scheduling import Fourier


@pytest.mark.parametrize("sample_time", [None, 0.05])
def test_a_time_invariant_system_decays_like_its_slowest_mode(sample_time):
    a = np.array([[-3.0, 40.0, 0], [-40.0, -3.0, 0], [0, 5.0, -2.5]])
    if sample_time:
        from scipy.linalg import expm

        a = expm(sample_time * a)
    found = decay_rate(time_invariant(a, np.ones((3, 1)), np.ones((1, 3)), [[0.0]], sample_time))
    assert found.between_grid and found.upper == pytest.approx(2.5)
    assert 0.98 * 2.5 <= found.lower < 2.5


@pytest.mark.slow
def test_a_rotating_system_decays_at_its_exact_rate():
    """In rotating coordinates A₀ + ωJ: the slowest decay over |ω| ≤ 0.3 is 1.25 − √(1.25² − (1.5 − ω(2 − ω)))."""
    model = rotating(np.array([[-1.0, 2.0], [0.0, -1.5]]), rate=0.3)
    exact = 1.25 - np.sqrt(1.25**2 - (1.5 - 0.3 * 1.7))
    found = decay_rate(model, basis=Fourier("q", 2))
    assert found.upper == pytest.approx(1.0, rel=1e-6)
    assert 0.97 * exact < found.lower < exact
    again = lpv.verify(found.certificate, model)
    assert again.holds and again.between_grid
    assert not lpv.verify(replace(found.certificate, level=1.01 * exact), model).holds


def test_a_certificate_is_saved_and_bound_to_its_rate(tmp_path):
    found = decay_rate(vanishing(), rate=0.5)
    again = lpv.load(lpv.save(found.certificate, tmp_path / "decay.json"))
    assert str(again) == str(found.certificate) and lpv.verify(again, vanishing()).holds
    assert "exp(-" in str(found)


def test_an_unstable_system_does_not_decay():
    found = decay_rate(time_invariant([[0.5]], [[1.0]], [[1.0]], [[0.0]]))
    assert found.verdict == "unstable" and found.certificate is None and found.upper == pytest.approx(-0.5)
