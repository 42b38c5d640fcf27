"""Every effect of the catalogue: described, nested in the baseline, deterministic, and finite on awkward records."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.effect_signals import PERIOD, guo, power_law, road_like

from lpvid import units
from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Signals
from lpvid.effects.effect import MOST_POINTS, STAGES, Effect, by_name
from quartercar.effects import CATALOGUE

NAMES = """
coulomb-friction stribeck-friction gas-preload gas-stiffness series-compliance backlash quadratic-loss relief-valve
series-orifice asymmetry cavitation valve-dynamics entrained-air network-topology coil-lag command-delay rise-fall-lag
current-saturation remanence thermal-fade viscous-fade end-stop fixture-inertia fixture-resonance displacement-delay
force-delay one-sided-filter shared-filter force-offset force-clipping quantisation scheduling-degree missing-scheduling
model-order input-nonlinearity strut-friction payload tyre-stiffness tyre-damping actuator-delay sensor-scale
channel-sign coloured-noise inner-friction hysteresis cubic-spring saturating-damping force-dead-zone current-dependence
"""
IDS = NAMES.split()
FAMILIES = {"friction", "elastic", "hydraulics", "electrical", "thermal", "structure", "measurement",
            "model", "car", "noise"}
BASELINES = {"guo": guo, "power-law": power_law}


LAGS = {"fixture-resonance", "actuator-delay", "model-order", "shared-filter", "displacement-delay", "force-delay",
        "one-sided-filter", "command-delay"}
"""entries whose strength is a time: below a part of a sample it is a matter of how signals are held between samples"""


def coarse(s: Signals) -> Signals:
    """The same signals in coarse steps, with a force large enough to be clipped."""
    return Signals(s.sample_time, {k: np.round(c / step) * step for (k, c), step in
                                   zip(s.channels.items(), (1e-4, 5e-3, 0.02), strict=True)},
                   20 * np.round(10 * s.output / 20), span=s.span)


def on(effect: Effect, baseline: Baseline, s: Signals) -> Signals:
    """Signals to which the effect applies; skips where there are none."""
    for signals in (s, coarse(s)):
        if not effect.missing((signals,)) and effect.applies(baseline, (signals,)) is None:
            return signals
    pytest.skip("the effect does not apply to a damper on these signals")


def test_the_catalogue_is_the_list_of_names() -> None:
    assert sorted(by_name(CATALOGUE)) == sorted(IDS)
    assert len(IDS) == len(set(IDS)) == 49


@pytest.mark.parametrize("effect", CATALOGUE, ids=str)
class TestDescription:
    def test_is_complete(self, effect: Effect) -> None:
        assert effect.stage in STAGES and effect.family in FAMILIES
        for text in (effect.title, effect.equation, effect.reference, effect.experiment):
            assert len(text) > 5 and text == text.strip()
        assert any(c.isdigit() for c in effect.reference), "a reference says where"
        assert type(effect).__doc__ and effect.describe()["parameters"]

    def test_parameters_hold_together(self, effect: Effect) -> None:
        names = [p.name for p in effect.parameters]
        assert len(set(names)) == len(names) and 1 <= effect.strengths <= len(names)
        for k, p in enumerate(effect.parameters):
            assert p.description and units.to_si(np.ones(1), p.unit).known
            assert p.bounds[0] < p.bounds[1] and np.isfinite(p.bounds).all()
            if k < effect.strengths:
                assert all(g != p.neutral for g in p.grid) or k > 0 or p.grid == (0.0,)

    def test_names_others_that_are_there(self, effect: Effect) -> None:
        assert set(effect.partners) <= set(IDS) - {effect.name}
        assert {n for v in (0.5, 2.0) for n in effect.stands_for(np.full(effect.neutral.size, v), (road_like(),))} <= {
            *IDS} - {effect.name}

    def test_points_lie_inside(self, effect: Effect) -> None:
        s = road_like()
        points = effect.points((coarse(s),))
        assert len(points) <= MOST_POINTS
        for point in points:
            assert point.shape == effect.neutral.shape
            assert np.any(point[:effect.strengths] != effect.neutral[:effect.strengths])
            for value, p in zip(point, effect.parameters, strict=True):
                assert p.bounds[0] <= value <= p.bounds[1]


@pytest.mark.parametrize("base", BASELINES)
@pytest.mark.parametrize("effect", CATALOGUE, ids=str)
class TestComposition:
    def test_neutral_is_the_baseline(self, effect: Effect, base: str) -> None:
        """Whatever the shapes; and towards it without a jump, where the output is smooth in the strength."""
        baseline = BASELINES[base]()
        s = on(effect, baseline, road_like())
        core = baseline.core(baseline.vector)
        force = core(s)
        for point in effect.points((s,)):
            values = np.array(point)
            values[:effect.strengths] = effect.neutral[:effect.strengths]
            np.testing.assert_allclose(effect.compose(core, values, baseline)(s), force, rtol=0,
                                       atol=1e-12 * np.abs(force).max())
        if effect.smooth and effect.name not in LAGS:
            values = np.array(effect.points((s,))[0])
            k = effect.strengths
            small = effect.neutral[:k] + 1e-6 * (values[:k] - effect.neutral[:k])
            change = effect.compose(core, np.concatenate([small, values[k:]]), baseline)(s) - force
            full = effect.compose(core, values, baseline)(s) - force
            assert np.abs(change).max() < 1e-3 * max(np.abs(full).max(), np.abs(force).max())

    def test_repeats_and_leaves_its_signals(self, effect: Effect, base: str) -> None:
        baseline = BASELINES[base]()
        s = on(effect, baseline, road_like(1))
        before = {k: c.copy() for k, c in s.channels.items()}
        output = s.output.copy()
        core = baseline.core(baseline.vector)
        for point in effect.points((s,))[:3]:
            run = effect.compose(core, point, baseline)
            first, fresh = run(s), Signals(s.sample_time, before, output, span=s.span)
            assert first.shape == (s.n_samples,) and np.isfinite(first).all()
            np.testing.assert_array_equal(run(s), first)
            np.testing.assert_array_equal(effect.compose(core, point, baseline)(fresh), first)
        for k, c in before.items():
            np.testing.assert_array_equal(s[k], c)
        np.testing.assert_array_equal(s.output, output)

    def test_awkward_records_stay_finite(self, effect: Effect, base: str) -> None:
        baseline = BASELINES[base]()
        s = on(effect, baseline, road_like(2, 1024))
        still = np.zeros(s.n_samples)
        records = {"constant current": s.replace(current=np.full(s.n_samples, 1.0)),
                   "no motion": s.replace(velocity=still, displacement=still),
                   "nothing at all": s.replace(velocity=still, displacement=still, current=still),
                   "three samples": Signals(PERIOD, {k: c[:3] for k, c in s.channels.items()}, s.output[:3],
                                            span=(0.0, 1.0))}
        core = baseline.core(baseline.vector)
        points = effect.points((s,))
        for name, record in records.items():
            for point in (points[0], points[-1]):
                force = effect.compose(core, point, baseline)(record)
                assert force.shape == (record.n_samples,) and np.isfinite(force).all(), name


@pytest.mark.parametrize("effect", CATALOGUE, ids=str)
def test_it_does_something(effect: Effect) -> None:
    """At some point of its scan the force changes by more than rounding."""
    baseline = guo()
    s = road_like(3)
    loud = Signals(PERIOD, s.channels, baseline.core(baseline.vector)(s), span=(0.0, 1.0))
    s = on(effect, baseline, loud)
    core = baseline.core(baseline.vector)
    force = core(s)
    largest = max(np.abs(effect.compose(core, p, baseline)(s) - force).max() for p in effect.points((s,)))
    assert largest > 1e-8 * np.abs(force).max()
