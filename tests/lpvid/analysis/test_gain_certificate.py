"""Gain certificates: hard to forge, bound to one model, and equal to what arrays say point by point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.gain_systems import random_stable, time_invariant, vanishing

import lpvid as lpv
from lpvid.analysis.gain import l2_gain
from lpvid.errors import InputError
from lpvid.lmi.gain_certificate import GainCertificate, certify_gain
from lpvid.scheduling import Polynomial


@pytest.fixture(scope="module")
def certificate() -> GainCertificate:
    return l2_gain(vanishing(), rate=1.0, trajectories=False).certificate


def forged(certificate: GainCertificate) -> dict[str, GainCertificate]:
    bent = certificate.matrices.copy()
    bent[0] *= 0.5
    box = certificate.box
    return {"smaller gain": replace(certificate, gamma=0.9 * certificate.gamma),
            "faster": replace(certificate, box=replace(box, rate=(3.0,))),
            "any speed": replace(certificate, box=replace(box, rate=(None,))),
            "wider": replace(certificate, box=replace(box, lower=(-2.0,), upper=(2.0,))),
            "margin": replace(certificate, margin=10 * certificate.margin),
            "matrices": replace(certificate, matrices=bent),
            "not finite": replace(certificate, matrices=np.nan * bent),
            "sign": replace(certificate, matrices=-certificate.matrices),
            "kind": replace(certificate, kind="quadratic"),
            "signals": replace(certificate, inputs=("road",)),
            "model": replace(certificate, model_hash="0" * 64)}


def test_a_certificate_holds_for_its_model(certificate):
    outcome = lpv.verify(certificate, vanishing())
    assert outcome.holds and outcome.between_grid and outcome.margin == pytest.approx(certificate.margin)


@pytest.mark.parametrize("how", ["smaller gain", "faster", "any speed", "wider", "margin", "matrices", "not finite",
                                 "sign", "kind", "signals", "model"])
def test_a_forged_certificate_does_not_hold(certificate, how):
    outcome = lpv.verify(forged(certificate)[how], vanishing())
    assert not outcome.holds and outcome.why


def test_a_certificate_for_one_model_says_nothing_of_another(certificate):
    other = replace(vanishing(), B=1.001 * vanishing().B)
    assert "another model" in lpv.verify(certificate, other).why


def test_saved_and_loaded_bit_for_bit(certificate, tmp_path):
    again = lpv.load(lpv.save(certificate, tmp_path / "gain.json"))
    assert np.array_equal(again.matrices, certificate.matrices) and again.to_dict() == certificate.to_dict()
    stability = lpv.certify_stability(vanishing())
    assert lpv.verify(lpv.load(lpv.save(stability, tmp_path / "stability.json")), vanishing()).holds


def test_what_is_no_certificate_is_refused():
    with pytest.raises(InputError, match="no certificate"):
        lpv.verify("gain", vanishing())  # type: ignore[arg-type]


@pytest.mark.parametrize("discrete", [False, True])
def test_arrays_give_the_same_verdict_as_the_certificate(discrete, rng):
    model = random_stable(rng, 3, 1, discrete)
    found = l2_gain(model, basis=Polynomial("p0", degree=2), trajectories=False).certificate
    points = np.linspace(-1, 1, 41)[:, None]
    phi, psi = model.basis.evaluate(points), found.basis.evaluate(points)
    system = tuple(np.tensordot(phi, x, axes=1) for x in (model.A, model.B, model.C, model.D))
    p = np.tensordot(psi, found.matrices, axes=1)
    if discrete:
        ahead = np.clip(points[:, None, 0] + 0.05 * np.linspace(-1, 1, 3), -1, 1)
        extra = {"later": np.tensordot(found.basis.evaluate(ahead.reshape(-1, 1)), found.matrices,
                                       axes=1).reshape(41, 3, 3, 3)}
    else:
        slope = np.tensordot(found.basis.derivative(points, "p0"), found.matrices, axes=1)
        extra = {"slopes": slope[:, None], "rate": 0.5}
    fine = certify_gain(system, p, found.gamma, **extra)
    assert fine.holds and not fine.between_grid and fine.margin > 0
    assert not certify_gain(system, p, 0.98 * found.gamma, **extra).holds


def test_arrays_need_a_rate_where_p_changes():
    lag = tuple(np.array([[[x]]]) for x in (-2.0, 1.0, 1.0, 0.0))
    with pytest.raises(InputError, match="bound"):
        certify_gain(lag, np.array([[[1.0]]]), 1.0, slopes=np.ones((1, 1, 1, 1)))
    assert not certify_gain(lag, np.array([[[-1.0]]]), 1.0).holds
    assert not certify_gain(lag, np.array([[[np.inf]]]), 1.0).holds


def test_rounding_is_part_of_the_margin():
    """P = 1 proves exactly 1/2 for the lag 1/(s + 2); a bound that is met with equality is not certified."""
    model = time_invariant([[-2.0]], [[1.0]], [[1.0]], [[0.0]])
    found = l2_gain(model).certificate
    exact = replace(found, matrices=np.array([[[1.0]]]), gamma=0.5, margin=0.0)
    assert not exact.check(model).holds
    assert replace(exact, gamma=0.5 * (1 + 1e-9), margin=0.0).check(model).holds
