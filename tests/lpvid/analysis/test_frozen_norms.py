"""H-infinity norms by our own bisection, against python-control and closed forms."""

from __future__ import annotations

import control
import numpy as np
import pytest
from helpers.gain_systems import random_stable, vanishing
from helpers.responses import largest_gain
from helpers.synthesis_plants import missile

import lpvid as lpv
from lpvid.analysis.frozen_norms import h_infinity_norm, largest_frozen_norm
from lpvid.lmi.driven import driven
from lpvid.lmi.readings import box_of


@pytest.mark.parametrize("discrete", [False, True])
def test_random_systems_agree_with_python_control(discrete, rng):
    for n in (1, 2, 5, 8):
        a = rng.normal(size=(n, n))
        poles = np.linalg.eigvals(a)
        a = 0.95 * a / np.abs(poles).max() if discrete else a - (0.05 + poles.real.max()) * np.eye(n)
        b, c, d = rng.normal(size=(n, 2)), rng.normal(size=(2, n)), rng.normal(size=(2, 2))  # square: see below
        norm, frequency = h_infinity_norm((a, b, c, d), discrete)
        assert norm == pytest.approx(control.norm(control.StateSpace(a, b, c, d, 1.0 if discrete else 0), p="inf",
                                                  tol=1e-9), rel=1e-6)
        point = np.exp(1j * frequency) if discrete else 1j * frequency
        if np.isfinite(point):
            response = c @ np.linalg.solve(point * np.eye(n) - a, b) + d
            assert np.linalg.norm(response, 2) == pytest.approx(norm, rel=1e-8)


@pytest.mark.parametrize("damping", [0.3, 1e-2, 1e-4])
def test_a_resonance_however_sharp(damping):
    """1/(s² + 2ζs + 1): peak 1/(2ζ√(1 − ζ²)) at √(1 − 2ζ²)."""
    system = tuple(np.array(x) for x in ([[0, 1], [-1, -2 * damping]], [[0.0], [1]], [[1.0, 0]], [[0.0]]))
    norm, frequency = h_infinity_norm(system)
    assert norm == pytest.approx(1 / (2 * damping * np.sqrt(1 - damping**2)), rel=1e-8)
    assert frequency == pytest.approx(np.sqrt(1 - 2 * damping**2), rel=1e-4)


def test_degenerate_systems():
    none = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.array([[-3.0]])
    assert h_infinity_norm(none)[0] == 3.0
    silent = np.array([[-1.0]]), np.array([[1.0]]), np.array([[0.0]]), np.array([[0.0]])
    assert h_infinity_norm(silent)[0] == 0.0


@pytest.mark.seconds
def test_the_worst_held_value_lies_between_grid_points_too(rng):
    """Square systems: python-control's own norm (0.10.2, without slycot) is wrong for others."""
    model = random_stable(rng, 3, 1, discrete=False)
    model = model.replace(B=model.B[:, :, :1], D=model.D[:, :, :1], inputs=model.inputs[:1])
    plant = driven(model)
    norm, point, _ = largest_frozen_norm(plant, box_of(plant.readings, model.box))
    fine = max(control.norm(model.to_control([p]), p="inf", tol=1e-8) for p in np.linspace(-1, 1, 101))
    assert norm >= fine * (1 - 1e-4)
    assert norm == pytest.approx(control.norm(model.to_control(point), p="inf", tol=1e-8), rel=1e-6)


def test_a_system_that_vanishes_when_held():
    plant = driven(vanishing())
    assert largest_frozen_norm(plant, box_of(plant.readings, vanishing().box))[0] < 1e-12


def _with_hidden_paths(rng, size):
    """A random system, and the same with two fast paths of a gain `size` times as large that cancel, states mixed."""
    n, fast = 5, np.diag(-10 ** rng.uniform(1, 4, 3))
    a = rng.standard_normal((n, n))
    a -= (np.linalg.eigvals(a).real.max() + rng.uniform(0.02, 0.5)) * np.eye(n)
    b, c = rng.standard_normal((n, 1)), rng.standard_normal((1, n))
    push, seen = size * rng.standard_normal((3, 1)), rng.standard_normal((1, 3))
    turn = np.linalg.qr(rng.standard_normal((n + 6, n + 6)))[0]
    whole = np.zeros((n + 6, n + 6))
    whole[:n, :n], whole[n: n + 3, n: n + 3], whole[n + 3:, n + 3:] = a, fast, fast
    return (a, b, c, np.zeros((1, 1))), (turn @ whole @ turn.T, turn @ np.vstack([b, push, push]),
                                         np.hstack([c, seen, -seen]) @ turn.T, np.zeros((1, 1)))


@pytest.mark.parametrize("size", [1e3, 1e5, 1e7])
def test_paths_that_cancel_hide_no_maximum(rng, size):
    """The Hamiltonian matrix of the larger system loses its imaginary eigenvalues: the maximum was up to 10 % too low.

    The oracle is a dense grid of the small system, refined around its maximum.
    """
    for _ in range(30):
        small, large = _with_hidden_paths(rng, size)
        a, b, c, _ = small

        def gains(omega, a=a, b=b, c=c):
            return np.abs(c @ np.linalg.solve(1j * omega[:, None, None] * np.eye(len(a)) - a, b))[:, 0, 0]

        grid = np.concatenate([[0.0], np.geomspace(1e-3, 1e3, 600)])
        k = int(gains(grid).argmax())
        peak = gains(np.linspace(grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)], 200)).max()
        assert h_infinity_norm(large)[0] == pytest.approx(peak, rel=1e-4)


@pytest.mark.seconds
def test_raw_autopilot_loop_at_every_corner():
    """Hankel singular values of 3e6 beside a gain of 0.15: 1.9 % were missed. Against a dense grid."""
    loop = lpv.synthesize(missile(), lpv.OutputFeedback()).closed_loop
    for p in loop.box.grid(2):
        a, b, c, d = loop.frozen(p)
        poles = np.abs(np.linalg.eigvals(a))
        grid = 1j * np.concatenate([[0.0], np.geomspace(poles.min() / 100, 100 * poles.max(), 3000)])
        dense = largest_gain((a, b, c, d), grid)
        norm, _ = h_infinity_norm((a, b, c, d))
        assert dense * (1 - 1e-9) <= norm <= dense * (1 + 1e-3)
