"""H-infinity norms by our own bisection, against python-control and closed forms."""

from __future__ import annotations

import control
import numpy as np
import pytest
from helpers.gain_systems import random_stable, vanishing

from lpvid.analysis.frozen_norms import h_infinity_norm, largest_frozen_norm
from lpvid.lmi.autonomous import box_of
from lpvid.lmi.driven import driven


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
