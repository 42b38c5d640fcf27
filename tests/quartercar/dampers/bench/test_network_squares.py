"""The least squares of source 003: exact on their own networks, wrong offset and all."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.errors import InputError
from quartercar.dampers import fit_network_squares


def test_they_recover_their_own_networks():
    speed = np.linspace(0.0, 1.0, 23)
    series = fit_network_squares(speed, 5.0 + 2.0 * speed + 3.0 * speed**2, "series")
    assert np.allclose(series.coefficients, (2.0, 3.0)) and series.offset == 5.0 and series.esr < 1e-20
    force = np.linspace(0.0, 4.0, 23)
    parallel = fit_network_squares(0.1 * force + 0.3 * np.sqrt(force), force, "parallel")
    assert np.allclose(parallel.coefficients, (0.1, 0.3)) and parallel.esr < 1e-20
    assert np.allclose(parallel.force(0.1 * force + 0.3 * np.sqrt(force)), force)


def test_the_least_force_takes_viscous_force_with_it():
    """E3.7: from a slowest speed above zero the offset is too large, by c_L v of that point at least."""
    speed = np.geomspace(0.01, 1.0, 23)
    found = fit_network_squares(speed, 5.0 + 2.0 * speed + 3.0 * speed**2, "series")
    assert found.offset == pytest.approx(5.0 + 0.02 + 3e-4)


@pytest.mark.parametrize("truth", ["series", "parallel"])
def test_the_smaller_esr_names_the_network(truth):
    speed = np.geomspace(1e-2, 2.0, 23)
    root = np.sqrt(0.3**2 + 4 * 0.2 * speed)
    force = 10 + (2 * speed + 5 * speed**2 if truth == "series" else ((root - 0.3) / 0.4) ** 2)
    esr = {form: fit_network_squares(speed, force, form).esr for form in ("series", "parallel")}
    assert min(esr, key=lambda form: esr[form]) == truth


def test_points_out_of_order_are_refused():
    with pytest.raises(InputError, match="rising"):
        fit_network_squares(np.array([1.0, 0.5, 2.0]), np.ones(3), "series")
