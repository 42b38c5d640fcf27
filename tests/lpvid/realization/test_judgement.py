"""The verdict on a form: its gap against the model's own error."""

from __future__ import annotations

import numpy as np
import pytest

import lpvid as lpv
from lpvid.realization.judgement import _standard_error

BASIS = lpv.Polynomial("p", degree=1)
TF = lpv.LPVTransferFunction.siso([[-1.0, 0.4], [0.5, -0.3]], [[0, 0], [1.0, 0.5], [0.3, -0.4]], BASIS, 0.01,
                                  scheduling=lpv.Scheduling(("p",), (-1.0,), (1.0,)), inputs=("u",), outputs=("y",))


def measured(period: float, noise: float, seed: int = 0, n: int = 6000) -> lpv.Record:
    rng = np.random.default_rng(seed)
    p = np.sin(2 * np.pi * np.arange(n) / period) if np.isfinite(period) else np.zeros(n)
    run = lpv.Record({"u": rng.normal(size=n), "p": p}, sample_time=0.01)
    y = lpv.simulate(TF, run, "zero").output[:, 0]
    return lpv.Record({"u": run["u"], "p": p, "y": y + noise * y.std() * rng.normal(size=n)}, sample_time=0.01)


@pytest.mark.parametrize(("period", "noise", "verdict"), [(5000, 0.3, "safe"), (20, 0.5, "costs"),
                                                          (5, 0.1, "not safe")])
def test_the_gap_is_weighed_against_the_models_own_error(period, noise, verdict):
    gap = lpv.realize(TF, "controllable").gap(measured(period, noise), "held-out")
    assert gap.verdict == verdict and gap.advice.startswith(verdict)
    judged = gap.judgement
    assert judged.own[0] == pytest.approx(noise**2 / (1 + noise**2), rel=0.1)
    # the error of the model is noise, which no gap knows of: the form's error is the sum of both
    assert judged.form[0] == pytest.approx(judged.own[0] + judged.gap[0], rel=0.1)
    assert "held-out" in gap.advice and gap.to_dict()["verdict"] == verdict


def test_the_same_form_serves_a_coarse_model_and_spoils_a_fine_one():
    verdicts = [lpv.realize(TF, "controllable").gap(measured(20, noise)).verdict for noise in (3.0, 0.5, 0.01)]
    assert verdicts == ["safe", "costs", "not safe"]


@pytest.mark.seconds
def test_the_standard_error_is_that_of_repeated_draws():
    rng = np.random.default_rng(1)
    means, described = [], []
    for _ in range(300):
        z = rng.normal(size=2000)
        for k in range(1, z.size):
            z[k] += 0.8 * z[k - 1]
        means.append(np.mean(z**2))
        described.append(_standard_error([(z**2)[:, None]])[0])
    assert np.mean(described) == pytest.approx(np.std(means), rel=0.2)


def test_without_measured_outputs_or_motion_it_says_so():
    still = lpv.realize(TF, "controllable").gap(measured(np.inf, 0.1))
    assert still.verdict == "safe" and "never moves" in still.advice
    run = measured(5, 0.1)
    silent = lpv.realize(TF, "controllable").gap(lpv.Record({"u": run["u"], "p": run["p"]}, sample_time=0.01))
    assert silent.verdict is None and silent.judgement is None
    assert lpv.realize(TF, "augmented").gap(run).verdict == "safe"
