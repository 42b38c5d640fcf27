"""The passive quarter car is certified: with its own damper, and with a damping that moves as fast as it likes."""

from __future__ import annotations

import numpy as np
import pytest

import lpvid as lpv
from quartercar.parameters import MEGANE
from quartercar.vehicle.linear import LinearCar

RANGES = [(900.0, 4300.0), (300.0, 4000.0)]
"""Damping of semi-active cars [N·s/m] (equation sheet, 4.2)."""


def car(low: float, high: float, output: str = "body_acceleration", rate: float | None = None) -> lpv.LPVStateSpace:
    """The Mégane from road velocity to an output, affine in its damping."""
    ends = [LinearCar(MEGANE.replace(damping=c)).relative().select(("road_velocity",), (output,)) for c in (0.0, 1.0)]
    pieces = [np.array([getattr(ends[0], m), getattr(ends[1], m) - getattr(ends[0], m)]) for m in "ABCD"]
    box = lpv.Scheduling(("damping",), (low,), (high,), (rate,), ("N*s/m",))
    return lpv.LPVStateSpace(*pieces, lpv.Polynomial("damping", degree=1), None, box,
                             inputs=(lpv.Signal("road_velocity", "m/s"),), outputs=(lpv.Signal(output),))


def test_the_passive_megane_is_certified():
    model = car(1500.0, 1500.0)
    assert model.frozen_poles([1500.0]) == pytest.approx(LinearCar(MEGANE).relative().to_control().poles(), rel=1e-9)
    certificate = lpv.certify_stability(model)
    assert certificate.verdict == "certified" and lpv.verify(certificate, model).holds
    slowest = -model.frozen_poles([1500.0]).real.max()  # 1.8594 (equation sheet, 6.10)
    assert slowest == pytest.approx(1.8594, abs=2e-4)
    decay = lpv.decay_rate(model)
    assert 0.98 * slowest <= decay.lower <= slowest


@pytest.mark.parametrize(("low", "high"), RANGES)
def test_a_damping_that_jumps_at_will_keeps_the_car_stable(low, high):
    model = car(low, high)
    certificate = lpv.certify_stability(model)
    assert certificate.verdict == "certified" and certificate.between_grid
    assert lpv.verify(certificate, model).holds


@pytest.mark.seconds
def test_the_gain_of_the_varying_car_lies_between_frozen_and_certified():
    model = car(900.0, 4300.0)
    found = lpv.l2_gain(model, basis=lpv.Polynomial((), 0))
    frequency = 2j * np.pi * np.logspace(-1, 2, 400)
    frozen = max(np.abs(LinearCar(MEGANE.replace(damping=c)).relative().select(("road_velocity",),
                                                                              ("body_acceleration",)).to_control()(
        frequency)).max() for c in (900.0, 2000.0, 4300.0))
    assert found.between_grid and lpv.verify(found.certificate, model).holds
    assert frozen * (1 - 1e-6) <= found.lower <= found.upper
    slow = lpv.l2_gain(model, rate=1e3, trajectories=False)
    assert slow.between_grid and frozen * (1 - 1e-6) <= slow.upper <= found.upper * 1.002


def test_no_suspension_gain_is_below_its_invariant():
    """|z_d/z_r| = (m_s + m_us)/m_s at ω² = k_t/(m_s + m_us), whatever the damping does while it is held."""
    model = car(900.0, 4300.0, "suspension_deflection")
    frequency, gain = LinearCar(MEGANE.replace(tyre_damping=0.0)).invariants()["suspension_deflection"]
    found = lpv.l2_gain(model, trajectories=False)
    assert found.upper >= found.lower >= gain / (2 * np.pi * frequency) * (1 - 1e-9)  # from road velocity: z_r = ż_r/ω
