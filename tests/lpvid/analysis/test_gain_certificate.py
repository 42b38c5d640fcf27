"""Gain certificates: hard to forge, bound to one model, and equal to what arrays say point by point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.gain_systems import random_stable, time_invariant, vanishing

import lpvid as lpv
from lpvid.analysis.gain import l2_gain
from lpvid.errors import InputError
from lpvid.lmi.certificate import Recheck
from lpvid.lmi.driven import driven
from lpvid.lmi.gain_certificate import GainCertificate, certify_gain, recheck_gain
from lpvid.lmi.storage import Storage
from lpvid.scheduling import Polynomial, Product, Scheduling, Shifted, Spline, Stacked


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


@pytest.mark.seconds
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


@pytest.mark.seconds
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


HATS = Spline("p", 2, 1, (0.0, 0.5, 1.0))
KINKED = {"stacked": Stacked((HATS, Polynomial("p", 2))), "product": Product(HATS, HATS),
          "product with a polynomial": Product(HATS, Polynomial("p", 1)),
          "double knot": Spline("p", 3, 2, (0.0, 0.5, 0.5, 1.0)),
          "nearly double knot": Spline("p", 3, 2, (0.0, 0.5, 0.5 + 1e-14, 1.0))}
NARROW = {"narrow": Spline("p", 2, 3, (0.2, 0.5, 0.8)), "narrow at one end": Spline("p", 2, 2, (0.0, 0.5, 0.8)),
          "triple knot": Spline("p", 4, 3, (0.0, 0.5, 0.5, 0.5, 1.0))}
SMOOTH = {"cubic": Spline("p", 2, 3, (0.0, 0.5, 1.0)), "quadratic": Spline("p", 3, 2), "one piece": Spline("p", 1, 1),
          "double knot of a cubic": Spline("p", 3, 3, (0.0, 0.5, 0.5, 1.0)),
          "wider than the box": Spline("p", 2, 3, (-1.0, 0.4, 2.0))}


def leaning(rate: float) -> lpv.LPVStateSpace:
    """ẋ = −x + w, z = x, with p in [0, 1]."""
    one = np.ones((1, 1, 1))
    box = Scheduling(("p",), (0.0,), (1.0,), (rate,))
    return lpv.LPVStateSpace(-one, one, one, 0 * one, Polynomial("p", 0), None, box)


def carried(basis, rate: float, values) -> Storage:
    """The function P of p over a basis, on [0, 1]."""
    box, p = Scheduling(("p",), (0.0,), (1.0,), (rate,)), np.linspace(0, 1, 401)
    bound = basis.bound(box)
    found = np.linalg.lstsq(bound.evaluate(p[:, None]), values(p), rcond=None)[0]
    assert np.allclose(bound.evaluate(p[:, None]) @ found, values(p), atol=1e-9)
    return Storage(found.reshape(-1, 1, 1), bound, box, None)


@pytest.mark.parametrize("basis", KINKED.values(), ids=KINKED)
def test_a_slope_that_jumps_proves_nothing_between_points(basis):
    """P = 1 + 2p², less 2p − 1 beyond ½: left of the knot its slope is 2, at it 0 is read, and 2P − 1.6 P' = −0.2."""
    system = driven(leaning(1.6), ("p",))
    storage = carried(basis, 1.6, lambda p: 1 + 2 * p**2 - 2 * np.maximum(p - 0.5, 0))
    assert not recheck_gain(system, storage, 100.0).between_grid
    claimed = GainCertificate.of(system, storage, 100.0, Recheck(True, True, 0.01, ""))
    outcome = lpv.verify(GainCertificate.from_dict(claimed.to_dict()), leaning(1.6))
    assert not outcome.holds and not outcome.between_grid


@pytest.mark.parametrize("basis", [*KINKED.values(), *NARROW.values()], ids=[*KINKED, *NARROW])
def test_a_kinked_storage_function_is_shown_on_a_grid_at_most(basis):
    system = driven(leaning(0.1), ("p",))
    found = recheck_gain(system, carried(basis, 0.1, np.ones_like), 2.0)
    assert found.holds and not found.between_grid
    with pytest.raises(InputError, match="slope that jumps"):
        l2_gain(leaning(0.1), basis=basis, trajectories=False)


@pytest.mark.parametrize("basis", KINKED.values(), ids=KINKED)
def test_kinks_count_only_where_the_variable_moves(basis):
    found = recheck_gain(driven(leaning(0.0), ("p",)), carried(basis, 0.0, lambda p: 1 + p), 100.0)
    assert found.holds and found.between_grid


@pytest.mark.parametrize("basis", SMOOTH.values(), ids=SMOOTH)
def test_smooth_splines_still_prove_the_whole_box(basis):
    found = recheck_gain(driven(leaning(0.1), ("p",)), carried(basis, 0.1, lambda p: 1 + 0.5 * p), 2.0)
    assert found.holds and found.between_grid


def test_a_storage_function_reads_no_delay():
    late = Shifted(Polynomial("p", 1), 1)
    with pytest.raises(InputError, match="at a delay"):
        l2_gain(leaning(0.1), basis=late.bound(leaning(0.1).box), trajectories=False)
    system = driven(leaning(0.1), ("p",))
    storage = Storage(np.array([[[1.0]], [[0.0]]]), late.bound(leaning(0.1).box), leaning(0.1).box, None)
    claimed = GainCertificate.of(system, storage, 2.0, Recheck(True, True, 0.01, ""))
    assert "delay" in lpv.verify(claimed, leaning(0.1)).why
