"""Every cause of the catalogue around every kind of baseline: at strength zero the baseline, or refused in words."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.lpv_baseline import LpvBaseline
from lpvid.baselines.signals import Signals, in_turn
from lpvid.effects.composition import Composition
from lpvid.effects.effect import STAGES, Effect, by_name
from lpvid.effects.extended import ExtendedModel
from lpvid.effects.extended_baseline import ExtendedBaseline
from lpvid.model.compliance import ComplianceModel, Element
from lpvid.model.quasi import QuasiLPVModel
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Channel, Record
from lpvid.scheduling import Polynomial, Scheduling, Spline
from quartercar.baselines.damper import DamperBaseline
from quartercar.baselines.quarter_car import QuarterCarBaseline
from quartercar.dampers import model_class
from quartercar.effects import CATALOGUE

PERIOD, SAMPLES = 1 / 512, 600
UNITS = {"velocity": "m/s", "displacement": "m", "acceleration": "m/s^2", "current": "A", "temperature": "K",
         "force": "N", "road": "m", "sprung": "m", "unsprung": "m", "actuator": "N"}
LAWS = ("guo", "bouc-wen", "kwok", "power-law-friction-gas", "linear", "relief-valve", "wang-kamath")
LPV = ("transfer-function", "state-space", "quasi-lpv", "compliance")
NAMES = (*LAWS, *LPV, "extended", "quarter-car")


@cache
def record() -> Record:
    """A rig's and a car's channels in one; the current steps, the force lies on a grid."""
    rng = np.random.default_rng(0)
    t = PERIOD * np.arange(SAMPLES)
    x = 0.01 * np.sin(9 * t) + 0.002 * np.sin(60 * t)
    v = 0.09 * np.cos(9 * t) + 0.12 * np.cos(60 * t)
    columns = {"velocity": v, "displacement": x, "acceleration": np.gradient(v, PERIOD), "temperature": 300 + 5 * t,
               "current": np.repeat(rng.uniform(0.1, 2, SAMPLES // 50), 50), "road": 0.5 * x, "sprung": 0.3 * x,
               "unsprung": 0.4 * x, "actuator": np.sign(np.sin(5 * t)),
               "force": 25 * np.round((900 * v + 150 * np.tanh(v / 0.03)) / 25)}
    return Record({n: Channel(c, UNITS[n]) for n, c in columns.items()}, PERIOD)


def lpv(name: str) -> LpvBaseline:
    v, f = (Signal("velocity", "m/s"),), (Signal("force", "N"),)
    basis, box = Polynomial("current", 1), Scheduling(("current",), (0.0,), (2.0,), units=("A",))
    if name == "transfer-function":
        model = LPVTransferFunction.siso([[-0.7, 0.05]], [[150.0, 50.0], [60.0, 10.0]], basis, PERIOD, c=[[3.0, 0.5]],
                                         scheduling=box, inputs=v, outputs=f)
    elif name == "state-space":
        model = LPVStateSpace([[[0.6]], [[0.05]]], [[[1.0]], [[0.1]]], [[[200.0]], [[10.0]]], [[[50.0]], [[5.0]]],
                              basis, PERIOD, box, inputs=v, outputs=f)
    elif name == "quasi-lpv":
        model = QuasiLPVModel([[[0.7, 600.0, 2.0]], [[0.5, 450.0, 2.0]]], Spline("force", 1, 1, (-500.0, 500.0)), 1,
                              (1,), (0,), PERIOD, v, f)
    else:
        model = ComplianceModel((Element([[-200.0, 0.0, 200.0]], 2e5),), [-0.2, 0.0, 0.2], [5.0], [], 3.0, PERIOD, v, f)
    return LpvBaseline(model, name)


@cache
def baseline(name: str) -> Baseline:
    if name in LPV:
        return lpv(name)
    if name == "quarter-car":
        return QuarterCarBaseline()
    if name == "extended":
        effects = by_name(CATALOGUE)
        composition = Composition(baseline("guo"), (effects["series-compliance"], effects["coil-lag"]))
        vector = composition.neutral
        vector[-2:] = [0.005, 1e-7] if composition.effects[-1].name == "series-compliance" else [1e-7, 0.005]
        return ExtendedBaseline(ExtendedModel(composition, vector, np.full((vector.size, vector.size), np.nan)))
    from quartercar.dampers.facts import Facts

    return DamperBaseline(model_class(name).suited(Facts.of([record()], 1)))


@cache
def prepared(name: str) -> tuple[Signals, np.ndarray]:
    signals = in_turn([baseline(name).signals(record())])[0]
    return signals, baseline(name).core(baseline(name).vector)(signals)


@pytest.mark.thinned(3)
@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda e: e.name)
@pytest.mark.parametrize("name", NAMES)
def test_at_strength_zero_it_is_the_baseline_whatever_its_shape(name, effect):
    base, (signals, plain) = baseline(name), prepared(name)
    assert np.isfinite(plain).all() and np.ptp(plain) > 0
    refused = effect.applies(base, (signals,))
    if refused is not None:
        assert len(refused.split()) >= 3 and refused[-1] != "." and "\n" not in refused
        return
    composition = Composition(base, (effect,))
    strengths = slice(base.vector.size, base.vector.size + effect.strengths)
    shaped = [composition.neutral, *(np.concatenate([base.vector, p]) for p in effect.points((signals,))[:3])]
    for vector in shaped:
        vector[strengths] = effect.neutral[: effect.strengths]
        np.testing.assert_allclose(composition.predict(signals, vector), plain, rtol=1e-12,
                                   atol=1e-12 * np.abs(plain).max())


@pytest.mark.thinned(3)
@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda e: e.name)
@pytest.mark.parametrize("name", NAMES)
def test_away_from_zero_it_runs_and_does_something(name, effect):
    base, (signals, plain) = baseline(name), prepared(name)
    if effect.applies(base, (signals,)) is not None:
        return
    composition = Composition(base, (effect,))
    moved = []
    for point in effect.points((signals,)):
        out = composition.predict(signals, np.concatenate([base.vector, point]))
        assert out.shape == plain.shape and np.isfinite(out).all()
        moved.append(float(np.abs(out - plain).max()))
    assert max(moved, default=1.0) > 0


def test_only_what_makes_sense_is_refused():
    """A law without current knows no coil, a car no gas; every rig effect can stand around every law of a damper."""
    def refused(name: str) -> set[str]:
        return {e.name for e in CATALOGUE if e.applies(baseline(name), (prepared(name)[0],)) is not None}

    electrical = {"coil-lag", "command-delay", "rise-fall-lag", "current-saturation", "remanence", "scheduling-degree"}
    car = {"strut-friction", "payload", "tyre-stiffness", "tyre-damping", "actuator-delay"}
    rig = {e.name for e in CATALOGUE} - electrical - car - {"coloured-noise"}
    for name in ("guo", "kwok", "bouc-wen", "transfer-function", "state-space"):
        assert not (electrical | {"coulomb-friction", "series-compliance", "force-delay"}) & refused(name)
        assert car | {"sensor-scale"} <= refused(name)  # its own numbers take up a gain
    for name in ("power-law-friction-gas", "linear"):
        assert electrical <= refused(name)
    assert rig - {"sensor-scale", "channel-sign"} <= refused("quarter-car")
    assert not refused("quarter-car") & (car | {"sensor-scale", "channel-sign"})


def test_the_catalogue_is_in_order():
    names = [e.name for e in CATALOGUE]
    assert len(set(names)) == len(names) and all(e.stage in STAGES for e in CATALOGUE)
    for effect in CATALOGUE:
        check(effect, set(names))


def check(effect: Effect, names: set[str]) -> None:
    """What the table of the catalogue needs of an entry."""
    assert set(effect.partners) <= names
    assert effect.neutral.size == len(effect.parameters) >= effect.strengths >= 1
    assert all((effect.title, effect.equation, effect.reference, effect.experiment, effect.__doc__))
    for p in effect.parameters:
        assert not p.choices or p.bounds == (0.0, len(p.choices) - 1.0)


@pytest.mark.parametrize(("names", "static"), [((), True), (("coulomb-friction",), True),
                                               (("asymmetry", "gas-stiffness"), True), (("coil-lag",), False),
                                               (("coulomb-friction", "series-compliance"), False),
                                               (("valve-dynamics",), False)])
def test_an_extended_model_has_a_memory_where_a_part_has(names: tuple[str, ...], static: bool) -> None:
    table = by_name(CATALOGUE)
    inner = DamperBaseline(model_class("guo")())
    composition = Composition(inner, tuple(table[n] for n in names))
    vector = composition.neutral
    model = ExtendedModel(composition, vector, np.full((vector.size, vector.size), np.nan))
    assert ExtendedBaseline(model).static is static


@pytest.mark.parametrize("effect", [e for e in CATALOGUE if e.memoryless], ids=str)
def test_what_has_no_memory_gives_the_same_in_any_order(effect: Effect) -> None:
    baseline = DamperBaseline(model_class("guo")())
    s = baseline.signals(record())
    if effect.missing((s,)) or effect.applies(baseline, (s,)):
        pytest.skip("it does not apply to a damper on these signals")
    core = effect.compose(baseline.core(baseline.vector), effect.points((s,))[0], baseline)
    order = np.random.default_rng(1).permutation(s.n_samples)
    turned = Signals(s.sample_time, {c: v[order] for c, v in s.channels.items()}, s.output[order])
    assert np.allclose(core(turned), core(s)[order], rtol=1e-12, atol=1e-9)


ELASTIC = {"series-compliance": [2e-6], "entrained-air": [3e-4, 500.0]}


@pytest.mark.parametrize("element", ELASTIC)
@pytest.mark.parametrize("effect", [e for e in CATALOGUE if e.family != "noise" and e.stage not in
                                    ("inside", "series", "measurement")], ids=lambda e: e.name)
def test_a_faint_cause_beside_an_elastic_element_does_little(effect, element):
    """Around a very soft element: none may change the way in which the element is simulated."""
    signals, _ = prepared("guo")
    if effect.missing((signals,)) or effect.applies(baseline("guo"), (signals,)):
        return
    composition = Composition(baseline("guo"), (effect, by_name(CATALOGUE)[element]))
    place, soft = (composition.places[k] for k in np.argsort([e is not effect for e in composition.effects]))
    vector = composition.neutral
    vector[soft] = ELASTIC[element]
    without = composition.predict(signals, vector)
    point = effect.points((signals,))[0]
    changes = []
    for share in (1e-3, 1e-5):
        strength = np.where(np.arange(point.size) < effect.strengths, share, 1.0)
        vector[place] = effect.neutral + strength * (point - effect.neutral)
        changes.append(np.std(composition.predict(signals, vector) - without))
    assert changes[1] <= 0.2 * changes[0] + 1e-6 * np.std(without)
