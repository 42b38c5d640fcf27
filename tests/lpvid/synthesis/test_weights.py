"""Weights: against their transfer functions in python-control, and attached to a plant against its interconnect."""

from __future__ import annotations

import control
import numpy as np
import pytest

from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial, Scheduling
from lpvid.synthesis import weights as w
from lpvid.synthesis.attach_weights import weigh
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.joining import series

FREQUENCIES = np.array([0.0, 0.01, 0.7, 3.0, 20.0, 300.0, 1e5]) * 1j
RHO = Scheduling(("rho",), (0.1,), (0.99,), (2.0,), ("rad/s",))


def agrees(block: LPVStateSpace, numerator, denominator, at=()) -> None:
    ours, theirs = block.to_control(list(at)), control.tf(numerator, denominator)
    for s in FREQUENCIES:
        np.testing.assert_allclose(ours(s), theirs(s), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("block", "numerator", "denominator"), [
    (w.lead_lag(0.4, 0.45, 150.0), [0.4 / 0.45, 0.4], [1 / 150, 1]),  # comfort target of the robust-control demo
    (w.lead_lag(-0.08, 50.0, 500.0), [-0.08 / 50, -0.08], [1 / 500, 1]),
    (w.lowpass(1.0, 60.0), [1], [1 / 60, 1]),
    (w.performance(10.0, 2.0, 1e-3), [0.5, 10.0], [1, 0.01]),  # (s/M + ω)/(s + ωε)
    (w.control_effort(1000.0, 100.0, 0.01), [1, 10.0], [0.01, 1000.0]),  # (s + ω/M)/(ε₁ s + ω)
    (w.bandpass(3.0, 20.0, 0.4), [3 * 2 * 0.4 * 20, 0], [1, 2 * 0.4 * 20, 400]),
    (w.second_order(2.0, (8.0, 0.7), (12.0, 0.3)), [2, 2 * 2 * 0.7 * 8, 2 * 64], [1, 2 * 0.3 * 12, 144]),
])
def test_a_weight_is_its_transfer_function(block, numerator, denominator):
    agrees(block, numerator, denominator)


@pytest.mark.parametrize(("dc", "crossover", "high"), [(100.0, 2.0, 0.5), (0.4, (15.0, 0.9), 3.0), (-50.0, 1.0, 0.1)])
def test_a_first_order_weight_has_the_three_gains_asked_for(dc, crossover, high):
    frequency, gain = crossover if isinstance(crossover, tuple) else (crossover, 1.0)
    response = w.first_order(dc, crossover, high).to_control([])
    np.testing.assert_allclose([response(0.0).real, abs(response(1j * frequency)), response(1e12j).real],
                               [dc, gain, high], rtol=1e-9)


def test_the_scheduled_weight_is_the_frozen_one_at_every_bandwidth():
    block = w.scheduled_performance("rho", RHO, 2.0, 1e-3)
    for rho in (0.1, 0.5, 0.99):
        agrees(block, [0.5, rho], [1, rho * 1e-3], [rho])
    assert block.box == RHO


def test_a_gain_that_moves_multiplies_a_filter():
    block = series(w.scheduled_gain("rho", RHO, [0.0, 1.0]), w.lowpass(1.0, 1000.0))  # ρ/(s/1000 + 1)
    for rho in (0.1, 0.8):
        agrees(block, [rho], [1e-3, 1], [rho])


def test_a_high_order_weight_of_python_control_arrives_balanced():
    """The missile autopilot's W2, whose companion form has entries from 1 to 1e10."""
    numerator, denominator = [9.6785, 0.029035, 0, 0], [1, 12064, 1.136e7, 1.0661e10]
    block = w.from_lti(control.tf(numerator, denominator), outputs=["effort"])
    agrees(block, numerator, denominator)
    entries = np.abs(np.concatenate([block.A.ravel(), block.B.ravel(), block.C.ravel()]))
    assert entries.max() < 2e4 and [s.name for s in block.outputs] == ["effort"]
    unstable = w.from_lti(control.tf([1], [1, -1]))
    agrees(unstable, [1], [1, -1])
    sampled = w.from_lti(control.tf([0.1], [1, -0.9], 0.01))
    assert sampled.sample_time == 0.01 and sampled.to_control([])(1.0).real == pytest.approx(1.0)


def plant(sample_time=None) -> GeneralizedPlant:
    rng = np.random.default_rng(0)
    basis = Polynomial("p", 1)
    system = LPVStateSpace(rng.normal(size=(2, 3, 3)), rng.normal(size=(2, 3, 2)), rng.normal(size=(2, 2, 3)),
                           rng.normal(size=(2, 2, 2)), basis, sample_time,
                           inputs=(Signal("road", "m"), Signal("force", "N")),
                           outputs=(Signal("comfort", "m/s^2"), Signal("sensor", "m/s")))
    return GeneralizedPlant(system, ("force",), ("sensor",))


def test_a_weighed_plant_is_python_controls_interconnection():
    bare = plant()
    road, actuator, comfort = w.first_order(2.0, 3.0, 0.1), w.lowpass(1.0, 60.0), w.bandpass(5.0, 10.0)
    effort, sensor = w.control_effort(100.0), w.lowpass(1.0, 200.0)
    weighed = weigh(bare, {"road": road, "force": actuator},
                    {"comfort": comfort, "effort": ("force", effort), "sensor": sensor, "raw": ("sensor", 2.0)})
    assert weighed.controls == ("force",) and weighed.measurements == ("sensor",)
    assert weighed.performance == ("comfort", "effort", "raw") and weighed.disturbances == ("road",)
    assert [s.unit for s in weighed.system.inputs] == ["", "N"] and weighed.system.outputs[1] == Signal("sensor", "m/s")
    p = [0.3]
    got = weighed.system.to_control(p)

    def named(block, source, name):
        return control.ss(block.to_control([]), inputs=source, outputs=name)

    parts = [control.ss(bare.system.to_control(p), inputs=["r", "f"], outputs=["c", "s"]), named(road, "road", "r"),
             named(actuator, "force", "f"), named(comfort, "c", "comfort"), named(effort, "f", "effort"),
             named(sensor, "s", "sensor"), control.ss([], [], [], [[2.0]], inputs=["s"], outputs=["raw"])]
    expected = control.interconnect(parts, inputs=["road", "force"], outputs=["comfort", "sensor", "effort", "raw"])
    for s in (0.1, 2j, 40j):
        np.testing.assert_allclose(got(s), expected(s), rtol=1e-8)


@pytest.mark.parametrize(("call", "message"), [
    (lambda: weigh(plant(), {"rode": 1.0}), "did you mean 'road'"),
    (lambda: weigh(plant(), outputs={"effort": 1.0}), r"no output of the plant 'effort'.*\(signal, weight\)"),
    (lambda: weigh(plant(), outputs={"comfort": ("force", 1.0)}), "already has a signal 'comfort'"),
    (lambda: weigh(plant(), outputs={"effort": ("valve", 1.0)}), "no signal of the plant 'valve'"),
    (lambda: weigh(plant(), {"road": plant().system}), "one input and one output"),
    (lambda: weigh(plant(0.01), {"road": w.lowpass(1.0, 5.0)}), "different sampling periods"),
    (lambda: w.first_order(2.0, 1.0, 3.0), "must lie between"),
    (lambda: w.scheduled_performance("rho", Scheduling(("rho",), (0.0,), (1.0,))), "must stay positive"),
    (lambda: w.scheduled_gain("q", RHO, [1.0, 2.0]), "no scheduling variable 'q'"),
    (lambda: w.bandpass(1.0, -3.0), "must be positive"),
])
def test_bad_weights_are_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()
