"""Identification under the constraint of passivity: free where the truth is passive, certified where it is not."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.passive_models import BASIS, STEP, late, maxwell, motion, record, yielding
from scipy.signal import lfilter

import lpvid as lpv
from lpvid.errors import InputError


def _measured(model, rng, samples=3000, noise=0.0, offset=0.0):
    v, i = motion(rng, samples)
    force = lpv.simulate(model, record(v, i), "zero").output[:, 0] + offset
    return record(v, i, force + noise * rng.normal(size=samples))


@pytest.mark.seconds
def test_a_passive_network_is_found_unchanged():
    truth = maxwell()
    data = _measured(truth, np.random.default_rng(0))
    found = lpv.identify(data, lpv.Passive(lpv.ARX(1, 2, 0, "velocity", "force")))
    assert found.model.a.ravel() == pytest.approx(truth.a.ravel(), abs=2e-3)
    assert found.training.overall.free_run.esr < 1e-5
    certificate = lpv.PassivityCertificate.from_dict(found.model.metadata["passive"])
    assert lpv.verify(certificate, found.model).holds and certificate.between_grid


@pytest.mark.seconds
def test_a_yielding_damper_keeps_its_knee_and_preload():
    truth = yielding()
    data = _measured(truth, np.random.default_rng(1), noise=2.0, offset=-80.0)
    found = lpv.identify(data, lpv.Passive(lpv.ARX(0, 1, 0, "velocity", "force", BASIS, affine=1, stage="tanh")))
    assert found.model.input_stage.v0 == pytest.approx(0.03, rel=0.03)
    certificate = lpv.PassivityCertificate.from_dict(found.model.metadata["passive"])
    assert certificate.preload == pytest.approx(-80.0, abs=1.0)
    noise = 2.0**2 * data.n_samples / np.sum((data["force"] - data["force"].mean()) ** 2)
    assert found.training.overall.free_run.esr < 1.05 * noise


def test_an_active_truth_becomes_the_nearest_passive_model():
    """For own·v + d·v(k−1) with white v the nearest passive pair is known: own' ≥ d' and own + d shared."""
    truth = late(delay=1, damping=500.0, own=300.0)
    rng = np.random.default_rng(2)
    v = rng.normal(size=8000)
    force = lpv.simulate(truth, record(v, np.ones_like(v)), "zero").output[:, 0]
    found = lpv.identify(record(v, np.ones_like(v), force), lpv.Passive(lpv.ARX(0, 2, 0, "velocity", "force")))
    own, behind = found.model.b.ravel()
    assert own == pytest.approx(400.0, rel=0.02) and behind == pytest.approx(400.0, rel=0.02)
    assert found.unconstrained.b.ravel() == pytest.approx([300.0, 500.0])
    assert found.training.overall.free_run.esr > found.unconstrained_figures[0].overall.free_run.esr
    assert lpv.passivity_margin(found.unconstrained).active and not lpv.passivity_margin(found.model).active


@pytest.mark.seconds
def test_no_random_motion_and_current_take_more_than_is_stored():
    truth = yielding(lag=0.7)
    data = _measured(truth, np.random.default_rng(4), noise=5.0)
    found = lpv.identify(data, lpv.Passive(lpv.ARX(2, 2, 0, "velocity", "force", BASIS, stage="tanh")))
    model = found.model
    certificate = lpv.PassivityCertificate.from_dict(model.metadata["passive"])
    assert certificate.verified
    rng = np.random.default_rng(5)
    for _ in range(30):
        v, i = motion(rng, 500, speed=float(rng.choice([0.003, 0.03, 0.3, 3.0])))
        v[:2] = 0.0
        i = np.clip(i, *[x[0] for x in (model.box.lower, model.box.upper)])
        force = lpv.simulate(model, record(v, i), "zero").output[:, 0]
        assert np.cumsum(force * v).min() >= -1e-9 * np.abs(force * v).sum()


@pytest.mark.seconds
@pytest.mark.parametrize("basis", [lpv.Spline("current", segments=2, order=1), lpv.Polynomial("current", degree=2)])
def test_other_dependences_on_the_current_are_certified_between_grid_points(basis):
    data = _measured(yielding(), np.random.default_rng(7), noise=2.0)
    found = lpv.identify(data, lpv.Passive(lpv.ARX(1, 1, 0, "velocity", "force", basis, stage="tanh")))
    certificate = lpv.PassivityCertificate.from_dict(found.model.metadata["passive"])
    assert certificate.between_grid and lpv.verify(certificate, found.model).holds
    assert found.training.overall.free_run.esr < 0.01
    assert np.isfinite(found.condition)


@pytest.mark.parametrize(("structure", "stated"), [
    (lpv.ARX(2, 2, 1, "velocity", "force"), "nk=0"),
    (lpv.ARX(2, 2, 0, "velocity", "force", lagged=True), "lagged"),
    (lpv.ARX(2, 2, 0, "velocity", "force", BASIS, stage="three-zone"), "--shape tanh"),
    (lpv.ARX(2, 2, 0, ("velocity", "displacement"), "force"), "one input"),
    (lpv.ARMAX(2, 2, 0, "velocity", "force"), "--structure arx or oe"),
])
def test_structures_without_a_passive_model_are_refused(structure, stated):
    with pytest.raises(InputError, match=stated):
        lpv.Passive(structure)


def test_records_of_reversed_polarity_are_refused():
    data = _measured(maxwell(), np.random.default_rng(0))
    with pytest.raises(InputError, match="--flip force"):
        lpv.identify(record(data["velocity"], data["current"], -data["force"]),
                     lpv.Passive(lpv.ARX(1, 2, 0, "velocity", "force")))


@pytest.mark.seconds
def test_output_error_and_held_out_data_go_with_it():
    truth, rng = maxwell(), np.random.default_rng(6)
    found = lpv.identify(_measured(truth, rng, noise=3.0), lpv.Passive(lpv.OutputError(1, 2, 0, "velocity", "force")),
                         held_out=_measured(truth, rng))
    assert [v.label for v in found.unconstrained_figures] == ["training", "held-out"]
    assert found.held_out.overall.free_run.esr < 1e-3
    assert found.to_dict()["structure"]["passive"] is True
    assert found.model.sample_time == STEP


@pytest.mark.seconds
def test_standard_errors_allow_for_the_colour_of_the_error():
    """F = 500 v + slow error: white standard errors are (1 + .9²)/(1 − .9²) = 9.5 times too small in variance."""
    found = []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        v, e = (lfilter([1.0], [1, -0.9], rng.normal(size=1200)) for _ in range(2))
        run = lpv.Record({"velocity": 0.1 * v, "force": 50.0 * v + 20.0 * e}, sample_time=0.005,
                         units={"velocity": "m/s", "force": "N"})
        fit = lpv.identify(run, lpv.Passive(lpv.ARX(0, 1, 0, "velocity", "force", affine=1)))
        found.append((fit.parameters[0], fit.standard_errors[0]))
        assert "sandwich" in fit.covariance_kind and "constraint left out" in fit.covariance_kind
    values, errors = np.array(found).T
    assert 0.6 < errors.mean() / values.std() < 1.6
