"""What a design proved of its loop is stored so that others can check it, between the grid's points too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.badly_scaled_plants import random_case
from helpers.published_plants import near_integrators, two_disks
from helpers.synthesis_plants import spring

import lpvid as lpv
from lpvid.lmi.driven import driven
from lpvid.lmi.gain_certificate import GainCertificate, certify_gain, recheck_gain
from lpvid.lmi.storage import Storage


def _stored(found: lpv.Synthesis, folder: Path) -> GainCertificate:
    """The certificate as a file gives it back, which a changed one does not pass for."""
    assert isinstance(found.certificate, GainCertificate) and found.closed_loop is not None
    lpv.save(found.certificate, folder / "certificate.json")
    kept = lpv.load(folder / "certificate.json")
    checked = lpv.verify(kept, found.closed_loop)
    assert checked.holds and checked.between_grid and kept.gamma == found.gamma_verified
    assert not lpv.verify(replace(kept, gamma=0.98 * (found.gamma_lower or 0.0)), found.closed_loop).holds
    if kept.states is not None:
        assert not lpv.verify(replace(kept, states=np.eye(kept.order)), found.closed_loop).holds
        assert "do not fit" in lpv.verify(replace(kept, states=np.eye(kept.order + 1)), found.closed_loop).why
        assert "singular" in lpv.verify(replace(kept, states=np.ones((kept.order,) * 2)), found.closed_loop).why
    return kept


@pytest.mark.seconds
@pytest.mark.parametrize("seed", [201, pytest.param(212, marks=pytest.mark.seconds)])
def test_that_of_a_near_integrator(seed: int, tmp_path: Path) -> None:
    """Over the loop's own states rounding exceeds the margin 100 times: the plant's integrator and the controller's all
    but cancel in the storage function."""
    case, design, traits = random_case(seed)
    assert "slow" in traits
    kept = _stored(found := lpv.synthesize(case, design), tmp_path)
    assert kept.states is not None and kept.kind == "quadratic"
    back = np.linalg.inv(kept.states)
    own = kept.matrices.copy()
    own[:] = back.T @ kept.matrices @ back
    own = 0.5 * (own + own.swapaxes(1, 2))
    assert not recheck_gain(driven(found.closed_loop), Storage(own, kept.basis, kept.box, None), kept.gamma).holds


@pytest.mark.seconds
@pytest.mark.parametrize("noise", [pytest.param(0.0, marks=pytest.mark.seconds), 1e-2])
def test_those_of_published_near_integrators(noise: float, tmp_path: Path) -> None:
    """Poles at 2e-7 and 1e-5 rad/s."""
    kept = _stored(lpv.synthesize(near_integrators(noise), lpv.OutputFeedback()), tmp_path)
    assert kept.states is not None


@pytest.mark.seconds
def test_that_of_two_disks(tmp_path: Path) -> None:
    """Weights from 0.04 to 40,000 rad/s."""
    assert _stored(lpv.synthesize(two_disks(), lpv.OutputFeedback()), tmp_path).states is not None


@pytest.mark.seconds
@pytest.mark.parametrize("varying", ["controls", "measurements"])
def test_that_of_a_moving_matrix_has_its_own_functions(varying: str, tmp_path: Path) -> None:
    """X(p), Y(p) over {1, k} make P⁻¹ or P a polynomial of degree one: no fit, on the whole box."""
    found = lpv.synthesize(spring(2.0), lpv.OutputFeedback(lpv.Polynomial("k", 1), varying=varying))
    kept = _stored(found, tmp_path)
    assert kept.kind == "parameter-dependent" and kept.basis.size == 2 and kept.inverse == (varying == "controls")
    assert not lpv.verify(replace(kept, inverse=not kept.inverse), found.closed_loop).holds
    faster = replace(kept.box, rate=(20.0,))
    assert not lpv.verify(replace(kept, box=faster), found.closed_loop).holds


@pytest.mark.seconds
@pytest.mark.parametrize("seed", [210, pytest.param(214, marks=pytest.mark.seconds)])
def test_that_of_a_table(seed: int, tmp_path: Path) -> None:
    """Fits of P(p) lost this proof: margins are some 1e-9."""
    case, design, traits = random_case(seed)
    assert "rated" in traits
    found = lpv.synthesize(case, design)
    assert found.between_grid and _stored(found, tmp_path).kind == "parameter-dependent"


def test_the_inverse_of_a_storage_function_shows_the_gain_of_the_primal() -> None:
    """ẋ = −(1 + p)x + 2w, z = x/2 over p ∈ [0, 1] has the gain 1, by −2P + 1/4 + 4P² = 0 at P = 1/4, Q = 4."""
    p, box = lpv.Polynomial("p", 1), lpv.Scheduling(("p",), (0.0,), (1.0,))
    model = lpv.LPVStateSpace([[[-1.0]], [[-1.0]]], [[[2.0]], [[0.0]]], [[[0.5]], [[0.0]]], np.zeros((2, 1, 1)), p,
                              None, box)
    system = driven(model)
    for value, inverse in ((0.25, False), (4.0, True)):
        storage = Storage(np.full((1, 1, 1), value), lpv.Polynomial((), 0), box, None)
        assert recheck_gain(system, storage, 1.001, inverse=inverse).holds
        assert not recheck_gain(system, storage, 0.999, inverse=inverse).holds
        assert not recheck_gain(system, storage, 1.001, inverse=not inverse).holds


@pytest.mark.seconds
def test_the_inverse_of_a_storage_function_that_moves_in_discrete_time() -> None:
    """Q(p⁺) − AQ(p)Aᵀ and its companions, against the primal inequality of P = 1/Q at dense values and steps."""
    p, box = lpv.Polynomial("p", 1), lpv.Scheduling(("p",), (0.0,), (1.0,), (0.3,))
    model = lpv.LPVStateSpace([[[-0.25]], [[-0.25]]], [[[2.0]], [[0.5]]], [[[0.5]], [[0.2]]], np.zeros((2, 1, 1)), p,
                              1.0, box)
    storage = Storage(np.array([[[5.0]], [[1.5]]]), p, box, 1.0)
    points = np.linspace(0, 1, 201)[:, None]
    now = 1 / storage.values(points)
    later = np.stack([1 / storage.values(np.clip(points + step, 0, 1)) for step in np.linspace(-0.3, 0.3, 13)], axis=1)
    held = []
    for gamma in np.geomspace(1.0, 8.0, 40):
        found, dense = recheck_gain(driven(model), storage, gamma, inverse=True), certify_gain(
            model.at(points), now, gamma, later=later)
        assert found.holds == dense.holds or abs(dense.margin) < 1e-2
        held.append(found.holds)
    assert held[-1] and not held[0] and held == sorted(held)


@pytest.mark.seconds
def test_a_proof_on_the_whole_box_takes_back_the_remark_on_the_grid() -> None:
    """The measured gain moves with k: the design holds on a grid; its loop is proven in between."""
    system = spring().system
    c = system.C.copy()
    c[1, -1, 0] = 0.1
    found = lpv.synthesize(lpv.GeneralizedPlant(system.replace(C=c), ["u1"], ["y1"]), lpv.OutputFeedback())
    assert found.solved and found.between_grid and not any("grid points" in note for note in found.notes)
