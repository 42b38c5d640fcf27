"""The verdict on models without scheduling, and what is stated where their covariance is of no use."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lpvid as lpv
from lpvid.identification.layout import ParameterCloud
from lpvid.report.stability import fits_free_run, stability_page, study_stability

PLAIN = lpv.LPVTransferFunction.siso([[-0.5]], [[0.0], [1.0]], lpv.Polynomial(), 0.1)


def carrying(model: lpv.LPVTransferFunction, covariance: np.ndarray) -> lpv.LPVTransferFunction:
    """With a covariance of a_1 and b_1."""
    parameters = {"layout": [[0, 0, 0, 0, 0], [1, 1, 0, 0, 0]], "covariance": covariance.tolist()}
    return model.replace(metadata={"parameters": parameters})


@pytest.mark.parametrize(("pole", "stable"), [(0.998, True), (1.002, False)])
def test_the_poles_decide_without_scheduling_whether_or_not_a_proof_was_found(pole, stable):
    model = PLAIN.replace(a=np.full_like(PLAIN.a, -pole))
    study = study_stability(model)
    unproven = replace(study, certificate=replace(study.certificate, verified=False, kind="none"))
    for found in (study, unproven):
        assert found.certified is stable and found.mark == ("good" if stable else "bad")
        assert found.verdict.startswith("Stable" if stable else "NOT stable")
        assert "--rate" not in " ".join(step.command for step in stability_page(found, "m.json").steps)


def test_a_modulus_that_rounds_to_one_shows_its_side():
    model = PLAIN.replace(a=np.full_like(PLAIN.a, -(1 - 3e-9)))
    assert "largest pole modulus 1 − 3e-09" in str(study_stability(model))


def test_a_covariance_that_is_none_gives_no_probability_and_says_so():
    study = study_stability(carrying(PLAIN, np.array([[1e-4, 2e-4], [2e-4, 1e-4]])))  # correlation 2
    assert study.probability is None
    assert "no probability of stability: the covariance of the parameters is not positive semidefinite" in str(study)
    assert any("positive semidefinite" in n for n in study.to_dict()["notes"])


@pytest.mark.parametrize("covariance", [np.diag([1e-4, 1e-4]), np.array([[1e-4, 1e-7], [1e-7, 1e-10]]),
                                        np.zeros((2, 2))])
def test_a_covariance_may_be_singular(covariance):
    assert ParameterCloud.of(carrying(PLAIN, covariance)).fault == ""


def test_a_stable_estimate_whose_draws_are_mostly_unstable_is_called_uncertain():
    wide = study_stability(carrying(PLAIN, np.diag([100.0, 1e-4])))  # |a_1| < 1 for 8 % of N(−0.5, 10²)
    assert wide.probability is not None and wide.probability.probability < 0.2
    assert "the estimate itself is stable, but its parameters are so uncertain" in str(wide)
    assert "uncertain" not in str(study_stability(carrying(PLAIN, np.diag([1e-4, 1e-4]))))


def test_the_verdict_of_a_stable_estimate_is_followed_by_the_share_of_draws_against_it():
    near = PLAIN.replace(a=np.full_like(PLAIN.a, -0.95))
    sure, unsure = (study_stability(carrying(near, np.diag([width, 1e-4]))) for width in (1e-8, 0.01))
    assert sure.frozen.stable and not any("drawn" in line for line in stability_page(sure, "m").caveats)
    share = 1 - unsure.probability.probability  # |a_1| > 1 for 31 % of N(−0.95, 0.1²)
    assert share == pytest.approx(0.31, abs=0.1)
    assert any("beyond the limit" in line and f"{100 * share:.3g} %" in line
               for line in stability_page(unsure, "m").caveats)


def test_advice_follows_the_structure_that_was_used():
    unstable = PLAIN.replace(a=np.full_like(PLAIN.a, -1.1))
    for structure, advised in (({"kind": "oe"}, False), ({"kind": "arx"}, True),
                               ({"kind": "arx", "passive": True}, False), ({"kind": "quasi-lpv"}, False),
                               ({"kind": "compliance"}, False), ({"kind": "right-coprime"}, False),
                               ({"kind": "state-space-error", "noise": "innovation"}, True)):
        model = unstable.replace(metadata={"structure": structure})
        assert fits_free_run(model) is not advised
        steps = " ".join(step.text for step in stability_page(study_stability(model), "m.json").steps)
        assert ("--structure oe" in steps) is advised
