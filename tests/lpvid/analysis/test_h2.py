"""H2 norms: Lyapunov equations, published numbers of the quarter car, simulated noise."""

from __future__ import annotations

from dataclasses import replace

import control
import numpy as np
import pytest
from helpers.gain_systems import random_stable, time_invariant, vanishing

import lpvid as lpv
from lpvid.analysis import h2
from lpvid.analysis.h2 import h2_norm
from lpvid.scheduling import Polynomial
from quartercar.parameters import MEGANE
from quartercar.vehicle.linear import LinearCar

CAR = {"body_acceleration": 51.0168, "suspension_deflection": 0.342783, "tyre_deflection": 0.126520}
"""From white road velocity (synthesis sheet, section 1), to 1e-4."""


@pytest.mark.parametrize(("output", "norm"), CAR.items())
def test_the_quarter_car_on_white_road_velocity(output, norm):
    car = LinearCar(MEGANE.replace(tyre_stiffness=208e3)).relative().select(("road_velocity",), (output,))
    found = h2_norm(time_invariant(car.A, car.B, car.C, car.D))
    assert found.verdict == "certified" and found.between_grid
    assert found.upper == pytest.approx(norm, rel=1e-4) and found.lower == pytest.approx(norm, rel=1e-4)
    assert found.lower <= found.upper


@pytest.mark.parametrize("discrete", [False, True])
def test_time_invariant_systems_agree_with_python_control(discrete, rng):
    a = rng.normal(size=(4, 4))
    poles = np.linalg.eigvals(a)
    a = 0.8 * a / np.abs(poles).max() if discrete else a - (1 + poles.real.max()) * np.eye(4)
    b, c, d = rng.normal(size=(4, 2)), rng.normal(size=(3, 4)), float(discrete) * rng.normal(size=(3, 2))
    norm = control.norm(control.StateSpace(a, b, c, d, 0.1 if discrete else 0), p=2)
    found = h2_norm(time_invariant(a, b, c, d, 0.1 if discrete else None))
    assert found.lower == pytest.approx(norm, rel=1e-9) and found.upper == pytest.approx(norm, rel=1e-4)
    assert lpv.verify(found.certificate, time_invariant(a, b, c, d, 0.1 if discrete else None)).holds


@pytest.mark.seconds
def test_a_moving_system_stays_below_its_bound_in_simulation(rng):
    model = random_stable(rng, 3, 1, discrete=True)
    found = h2_norm(model, basis=Polynomial("p0", degree=1))
    x, power, n = np.zeros(3), 0.0, 20_000
    p = 0.999 * np.clip(2 * np.sin(2 * np.pi * np.arange(n) * 0.1 * 0.5 / (2 * 2 * np.pi)), -1, 1)
    assert np.abs(np.diff(p)).max() <= 0.5 * 0.1
    a, b, c, d = (x[0] + p[:, None, None] * x[1] for x in (model.A, model.B, model.C, model.D))
    for k in range(n):
        w = rng.normal(size=2)
        power += float(np.sum((c[k] @ x + d[k] @ w) ** 2))
        x = a[k] @ x + b[k] @ w
    assert np.sqrt(power / n) < 1.02 * found.upper  # 2 %: five standard errors of the mean of 20 000 squares
    assert found.lower <= found.upper


@pytest.mark.seconds
@pytest.mark.parametrize("discrete", [False, True])
def test_too_rich_a_storage_function_is_left_out_once_there_is_a_bound(discrete, monkeypatch):
    model = random_stable(np.random.default_rng(4), 3, 1, discrete=discrete)
    model = replace(model, D=np.zeros_like(model.D))
    still, full = h2_norm(model, basis=Polynomial((), 0)), h2_norm(model)
    monkeypatch.setattr(h2, "MOST_EFFORT", 0)
    short = h2_norm(model)
    assert short.certificate.basis.size == 1 and short.upper == pytest.approx(still.upper, rel=1e-9)
    assert full.certificate.basis.size > 1
    assert full.lower <= full.upper < short.upper
    for found in (full, short):
        assert found.between_grid and lpv.verify(found.certificate, model).holds


def test_what_has_no_h2_norm_says_so():
    assert "feedthrough" in h2_norm(time_invariant([[-1.0]], [[1.0]], [[1.0]], [[0.1]])).why
    assert h2_norm(time_invariant([[1.0]], [[1.0]], [[1.0]], [[0.0]])).verdict == "unstable"


def test_a_certificate_for_a_smaller_norm_does_not_hold():
    found = h2_norm(vanishing(), rate=1.0)
    assert lpv.verify(found.certificate, vanishing()).holds
    assert not lpv.verify(replace(found.certificate, level=0.97 * found.lower), vanishing()).holds
    assert not lpv.verify(replace(found.certificate, quantity="decay-rate"), vanishing()).holds
