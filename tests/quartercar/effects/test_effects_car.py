"""Causes hidden in a quarter car by an integrator of its own are named, with their parameter; or it is said why not."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from lpvid._projection import projector, without
from lpvid.diagnosis.diagnosis import Diagnosis
from lpvid.diagnosis.evidence.engine import diagnose
from lpvid.diagnosis.settings import DiagnosisSettings
from lpvid.effects.composition import Composition
from lpvid.effects.effect import Effect
from lpvid.record import Channel, Record
from lpvid.toolkit import njit
from quartercar.baselines.quarter_car import FREE, QuarterCarBaseline
from quartercar.effects.car import ActuatorDelay, Payload, StrutFriction, TyreDamping, TyreStiffness
from quartercar.effects.sensors import SENSORS, ChannelSign, SensorScale
from quartercar.parameters import SAVARESI

CAUSES: tuple[Effect, ...] = (StrutFriction(), Payload(), TyreStiffness(), TyreDamping(), ActuatorDelay(),
                              SensorScale(), ChannelSign())
RATE, FINE, SECONDS = 256, 16, 24.0
CAR = SAVARESI.replace(tyre_damping=100.0)
NOMINAL = QuarterCarBaseline(CAR, free=())


@dataclass(frozen=True)
class Truth:
    """The car that makes the data, and what its sensors do to them."""

    car: tuple[float, ...] = (CAR.sprung_mass, CAR.unsprung_mass, CAR.spring_stiffness, CAR.damping,
                              CAR.tyre_stiffness, CAR.tyre_damping)
    friction: float = 0.0
    delay: float = 0.0
    road_gain: float = 1.0
    force_gain: float = 1.0

    def scaled(self, **factors: float) -> Truth:
        names = ("sprung_mass", "unsprung_mass", "spring_stiffness", "damping", "tyre_stiffness", "tyre_damping")
        return replace(self, car=tuple(v * factors.get(n, 1.0) for n, v in zip(names, self.car, strict=True)))


@njit()
def rk4(car: np.ndarray, friction: float, road: np.ndarray, force: np.ndarray, step: float) -> np.ndarray:
    """(n, 4) classical Runge-Kutta in relative coordinates; road and force at half steps (2n + 1)."""
    n = (road.size - 1) // 2
    out = np.zeros((n + 1, 4))
    k, x = np.zeros((4, 4)), np.empty(4)
    for i in range(n):
        for stage in range(4):
            at = 2 * i + (0 if stage == 0 else 2 if stage == 3 else 1)
            share = 0.0 if stage == 0 else 1.0 if stage == 3 else 0.5
            for m in range(4):
                x[m] = out[i, m] + share * step * k[stage - 1, m]
            slope = (road[2 * i + 2] - road[2 * i]) / step
            rate = x[1] - x[3]
            strut = car[2] * (x[0] - x[2]) + car[3] * rate + friction * np.tanh(rate / 1e-3) - force[at]
            k[stage, 0], k[stage, 2] = x[1], x[3]
            k[stage, 1] = -strut / car[0]
            k[stage, 3] = (strut - car[4] * (x[2] - road[at]) - car[5] * (x[3] - slope)) / car[1]
        for m in range(4):
            out[i + 1, m] = out[i, m] + step / 6 * (k[0, m] + 2 * k[1, m] + 2 * k[2, m] + k[3, m])
    return out


def records(truth: Truth, seed: int, noise: float = 2e-5, actuated: bool = True) -> list[Record]:
    """Twice the same drive, with other noise; positions as measured, road and force through their sensors."""
    rng = np.random.default_rng(seed)
    n, step = round(SECONDS * RATE), 1.0 / RATE / FINE
    fine = np.arange(2 * FINE * (n - 1) + 1) * step / 2
    coarse = np.arange(n) / RATE
    tones, phases = rng.uniform(0.5, 15.0, 40), rng.uniform(0, 6.3, 40)
    road = 2e-3 * np.sum(np.sin(2 * np.pi * tones[:, None] * coarse + phases[:, None]) / tones[:, None] ** 0.7, axis=0)
    road *= np.minimum(coarse / 0.5, 1.0)
    force = 500.0 * rng.choice([-1.0, 1.0], round(SECONDS * 4)).repeat(RATE // 4) if actuated else np.zeros(n)
    held = np.convolve(force, np.ones(8) / 8)[:n]
    acting = np.interp(fine - truth.delay, coarse, held)
    x = rk4(np.array(truth.car), truth.friction, np.interp(fine, coarse, road), acting, step)[::FINE]
    made = []
    for k in range(2):
        noisy = x[:, [0, 2]] + noise * rng.standard_normal((n, 2))
        columns = {"road": Channel(road / truth.road_gain, "m"), "sprung": Channel(noisy[:, 0], "m"),
                   "unsprung": Channel(noisy[:, 1], "m")}
        if actuated:
            columns["actuator"] = Channel(held / truth.force_gain, "N")
        made.append(Record(columns, 1 / RATE, name=f"run-{k}"))
    return made


def described(made: list[Record], baseline: QuarterCarBaseline = NOMINAL) -> Diagnosis:
    return diagnose(made, baseline, CAUSES, settings=DiagnosisSettings(fit_baseline=bool(baseline.free)))


HIDDEN = {
    "strut-friction": (Truth(friction=60.0), 60.0),
    "payload": (Truth().scaled(sprung_mass=1.2), 0.2),
    "tyre-stiffness": (Truth().scaled(tyre_stiffness=0.8), -0.2),
    "tyre-damping": (Truth().scaled(tyre_damping=8.0), 700.0 / np.sqrt(CAR.tyre_stiffness * CAR.unsprung_mass)),
    "actuator-delay": (Truth(delay=0.02), 0.02),
    "sensor-scale": (Truth(force_gain=1.3), 0.3),
    "channel-sign": (Truth(force_gain=-1.0), 1.0),
}


@pytest.mark.parametrize("output", ["sprung", "unsprung"])
@pytest.mark.parametrize("name", HIDDEN)
@pytest.mark.slow
def test_a_hidden_cause_is_named_with_its_parameter(name, output, request):
    if (name, output) == ("tyre-damping", "sprung"):
        request.applymarker(pytest.mark.xfail(reason="it stands in without a name: too little of the body's motion",
                                              strict=True))
    truth, size = HIDDEN[name]
    found = described(records(truth, 3), replace(NOMINAL, output=output))
    assert (found.verdict, [c.name for c in found.causes]) == ("explained", [name]), found
    assert found.causes[0].parameters[0].value == pytest.approx(size, rel=0.1)
    assert found.after.esr_held_out < 0.2 * found.before.esr_held_out


@pytest.mark.parametrize(("truth", "name", "sensor"), [
    (Truth(road_gain=1.15), "sensor-scale", "road"), (Truth(force_gain=0.8), "sensor-scale", "actuator"),
    (Truth(road_gain=-1.0), "channel-sign", "road"), (Truth(force_gain=-1.0), "channel-sign", "actuator")])
@pytest.mark.slow
def test_the_sensor_at_fault_is_named(truth, name, sensor):
    found = described(records(truth, 5))
    assert [c.name for c in found.causes] == [name]
    cause = found.causes[0]
    assert cause.description.endswith(sensor)
    assert cause.parameters[1].choice == sensor and cause.parameters[1].std is None
    assert f"channel {sensor}" in str(found)


@pytest.mark.slow
def test_nothing_is_named_where_nothing_is_hidden():
    assert described(records(Truth(), 7)).verdict == "nothing-to-explain"


@pytest.mark.slow
def test_two_causes_at_once_are_both_named():
    found = described(records(Truth(friction=60.0).scaled(tyre_stiffness=0.8), 9))
    assert {c.name for c in found.causes} == {"strut-friction", "tyre-stiffness"}


@pytest.mark.slow
def test_with_the_other_parameters_free_payload_and_the_actuators_scale_are_one():
    """All six parameters times g and the force divided by g: the same motion, so that nobody can tell."""
    found = described(records(Truth().scaled(sprung_mass=1.1), 11), QuarterCarBaseline(CAR, free=FREE))
    assert found.verdict == "cannot-tell"
    assert set(found.rivals[0].names) == {"payload", "sensor-scale"}


def beyond(effect: Effect, choice: tuple[float, ...], base: QuarterCarBaseline, made: Record
           ) -> tuple[np.ndarray, float]:
    """What a small strength does beyond the baseline's own parameters, and how large it was before."""
    s, c = base.signals(made), Composition(base, (effect,))
    strength = 1e-6
    vector = np.concatenate([base.vector, [strength], choice])
    change = (c.predict(s, vector) - c.predict(s, c.neutral)) / strength
    return without(projector(base.sensitivities(s, base.vector)), change), float(np.linalg.norm(change))


@pytest.mark.slow
def test_geometry_knows_what_free_parameters_and_motion_alone_cannot_show():
    with_force, without_force = records(Truth(), 13)[0], records(Truth(), 13, actuated=False)[0]
    free = QuarterCarBaseline(CAR, free=FREE)
    for effect in (TyreStiffness(), TyreDamping()):
        left, size = beyond(effect, (), free, with_force)
        assert np.linalg.norm(left) < 1e-5 * size
    payload, size = beyond(Payload(), (), free, with_force)
    scale, _ = beyond(SensorScale(), (list(SENSORS).index("actuator"),), free, with_force)
    assert np.linalg.norm(payload) > 1e-3 * size
    assert abs(payload @ scale) > (1 - 1e-6) * np.linalg.norm(payload) * np.linalg.norm(scale)
    left, size = beyond(Payload(), (), QuarterCarBaseline(CAR, free=FREE, actuated=False), without_force)
    assert np.linalg.norm(left) < 1e-5 * size


@pytest.mark.seconds
def test_without_an_actuator_a_payload_is_taken_for_the_car_itself():
    alone = QuarterCarBaseline(CAR, free=FREE, actuated=False)
    found = described(records(Truth().scaled(sprung_mass=1.3), 13, actuated=False), alone)
    assert found.verdict == "nothing-to-explain"
    assert "actuator-delay" in {c.name for c in found.cannot_tell}


@pytest.mark.parametrize("effect", CAUSES, ids=lambda e: e.name)
def test_at_strength_zero_it_is_the_car(effect):
    record = records(Truth(friction=20.0), 1)[0]
    base = QuarterCarBaseline(CAR)
    signals = base.signals(record)
    with_it = Composition(base, (effect,))
    plain = base.core(base.vector)(signals)
    np.testing.assert_allclose(with_it.predict(signals, with_it.neutral), plain, rtol=1e-12, atol=1e-15)
    for sensor in range(len(SENSORS) if len(effect.parameters) > 1 else 0):
        vector = with_it.neutral
        vector[-1] = sensor
        np.testing.assert_allclose(with_it.predict(signals, vector), plain, rtol=1e-12, atol=1e-15)
