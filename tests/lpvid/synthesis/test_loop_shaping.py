"""Loop shaping against its closed form, and reduction of unstable systems by coprime factors."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

import lpvid as lpv
from lpvid.analysis.frozen_norms import h_infinity_norm
from lpvid.synthesis.weights import first_order

ONE = lpv.Polynomial((), 0)


def best_margin(a, b, c):
    """ε = (1 + λmax(XZ))^(−1/2) of a strictly proper plant (Glover & McFarlane, IEEE TAC 34 (1989) 821-830)."""
    x = solve_continuous_are(a, b, c.T @ c, np.eye(b.shape[1]))
    z = solve_continuous_are(a.T, c.T, b @ b.T, np.eye(len(c)))
    return 1 / np.sqrt(1 + np.linalg.eigvals(x @ z).real.max())


def system(a, b, c, names=(("u",), ("y",))):
    a, b, c = (np.array(x, dtype=float) for x in (a, b, c))
    return lpv.LPVStateSpace(a[None], b[None], c[None], np.zeros((1, len(c), b.shape[1])), ONE, None, inputs=names[0],
                             outputs=names[1])


@pytest.mark.seconds
@pytest.mark.parametrize(("a", "b", "c"), [
    ([[0, 1.0], [0, 0]], [[0.0], [1]], [[1.0, 0]]),
    ([[1.0, 0.3], [0.2, -2.0]], [[1.0], [0.5]], [[1.0, 1.0]]),
    ([[0.0, 1, 0], [-4, -0.1, 1], [0, 0, -3]], [[0, 1.0], [1, 0], [0, 1]], [[1.0, 0, 0], [0, 0, 1]])])
def test_margin_is_the_closed_form(a, b, c):
    a, b, c = (np.array(x, dtype=float) for x in (a, b, c))
    names = (("u1", "u2")[: b.shape[1]], ("y1", "y2")[: len(c)])
    found = lpv.loop_shaping(system(a, b, c, names))
    best = best_margin(a, b, c)
    assert 0.97 * best <= found.margin <= best * (1 + 1e-6)


@pytest.mark.seconds
def test_weights_belong_to_the_controller():
    """The loop of G with W_pre K W_post is that of the shaped plant with K: same poles; integral action at rest."""
    plant, w = system([[-1.0]], [[2.0]], [[1.0]]), first_order(1e3, 4.0, 1.0 / 10)
    found = lpv.loop_shaping(plant, {"u": w}, {"y": 0.5})
    assert found.controller.order == found.synthesis.controller.order + 1
    a, b, c, _ = plant.frozen(())
    ka, kb, kc, kd = found.controller.frozen(())
    closed = np.block([[a + b @ kd @ c, b @ kc], [kb @ c, ka]])
    ours = np.sort_complex(np.linalg.eigvals(closed))
    theirs = np.sort_complex(np.linalg.eigvals(found.synthesis.closed_loop.frozen(())[0]))
    np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=1e-6)
    at_rest = (kd - kc @ np.linalg.solve(ka, kb))[0, 0] * (c @ np.linalg.solve(-a, b))[0, 0]
    assert abs(at_rest) > 100


def test_margin_holds_over_the_box():
    """Frozen loops with the plant perturbed by less than ε at its input stay stable."""
    box = lpv.Scheduling(("p",), (0.0,), (1.0,))
    a = np.array([[[0.0, 1], [1, -1]], [[0, 0], [-3, 0]]])
    plant = lpv.LPVStateSpace(a, [[[0.0], [1]], [[0], [0]]], [[[1.0, 0]], [[0, 0]]], np.zeros((2, 1, 1)),
                              lpv.Polynomial("p", 1), None, box, inputs=("u",), outputs=("y",))
    found = lpv.loop_shaping(plant)
    assert found.margin > 0.1 and found.synthesis.between_grid
    k = found.controller
    for p in np.linspace(0, 1, 9):
        a, b, c, _ = plant.frozen([p])
        ka, kb, kc, kd = k.frozen([p])
        for delta in (-0.95 * found.margin, 0.95 * found.margin):     # noise on u of that share of u
            closed = np.block([[a + (1 + delta) * b @ kd @ c, (1 + delta) * b @ kc], [kb @ c, ka]])
            assert np.linalg.eigvals(closed).real.max() < 0


@pytest.mark.slow
def test_design_of_another_structure():
    found = lpv.loop_shaping(system([[0, 1.0], [0, 0]], [[0.0], [1]], [[1.0, 0]]),
                             design=lpv.FixedStructure(lpv.LowOrder(1), starts=3))
    assert found.controller.order == 1
    assert found.margin > 0.85 * best_margin(np.array([[0, 1.0], [0, 0]]), np.array([[0.0], [1]]), np.array([[1.0, 0]]))


def test_unstable_plant_reduced_within_its_bound():
    generator = np.random.default_rng(4)
    a = np.array([np.diag([0.5, -1.0, -20.0, -30.0]) + 0.2 * generator.standard_normal((4, 4)),
                  0.1 * generator.standard_normal((4, 4))])
    b, c = generator.standard_normal((4, 1)), generator.standard_normal((1, 4))
    full = lpv.LPVStateSpace(a, [b, 0 * b], [c, 0 * c], np.zeros((2, 1, 1)), lpv.Polynomial("p", 1), None,
                             inputs=("u",), outputs=("y",))
    found = lpv.reduce_coprime(full, 2)
    assert found.model.order == 2 and found.factors.between_grid
    for p in np.linspace(-1, 1, 11):                              # gap of the factors: numpy, own grid
        fa, fb, fc, _ = full.frozen([p])
        injection = found.injection.at(np.array([[p]]))[0] if found.injection.basis.names else found.injection.still
        la = fa + injection @ fc
        ra, rb, rc, rd = found.factors.model.frozen([p])
        whole = (np.block([[la, np.zeros((4, 2))], [np.zeros((2, 4)), ra]]),
                 np.vstack([np.hstack([fb, injection]), rb]), np.hstack([fc, -rc]), np.array([[0.0, 1.0]]) - rd)
        assert h_infinity_norm(whole)[0] <= found.factors.bound * (1 + 1e-9)
        assert (np.linalg.eigvals(found.model.frozen([p])[0]).real.max() > 0) == (np.linalg.eigvals(fa).real.max() > 0)


@pytest.mark.seconds
def test_controller_for_the_reduced_plant_stabilises_the_full_one():
    a = np.diag([0.5, -2.0, -60.0]) + 0.1 * np.ones((3, 3))
    full = system(a, [[1.0], [0.3], [1.0]], [[1.0, 0.2, 1.0]])
    small = lpv.reduce_coprime(full, 1)
    found = lpv.loop_shaping(small.model)
    assert small.factors.bound < found.margin                     # then the theorem applies
    fa, fb, fc, _ = full.frozen(())
    ka, kb, kc, kd = found.controller.frozen(())
    closed = np.block([[fa + fb @ kd @ fc, fb @ kc], [kb @ fc, ka]])
    assert np.linalg.eigvals(closed).real.max() < 0


def test_bad_input_in_one_line():
    with pytest.raises(lpv.InputError, match="input of the system"):
        lpv.loop_shaping(system([[0.0]], [[1.0]], [[1.0]]), {"nothing": 1.0})
    with pytest.raises(lpv.InputError, match="different names"):
        lpv.loop_shaping(system([[0.0]], [[1.0]], [[1.0]], (("x",), ("x",))))
    with pytest.raises(lpv.InputError, match="no common injection"):
        lpv.reduce_coprime(system([[1.0, 0], [0, 1.0]], [[1.0], [1.0]], [[1.0, 0.0]]))
