"""Springs, play and air in series: closed forms, a stiff solver, the rig, and the engine's name for them."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from helpers.effect_signals import road_like
from helpers.static_rig import named_or_listed, recorded, static_law
from scipy.integrate import solve_ivp

from lpvid.baselines.signals import Around, Core, Signals
from lpvid.diagnosis.estimates import estimates
from lpvid.diagnosis.evidence.priors import shape_prior
from lpvid.effects.composition import Composition
from lpvid.effects.effect import Effect
from lpvid.effects.extended import ExtendedModel
from lpvid.effects.extended_baseline import ExtendedBaseline
from lpvid.effects.scaling import Scales
from lpvid.errors import InputError
from quartercar import dampers
from quartercar.baselines.damper import DamperBaseline
from quartercar.dampers.laws.bouc_wen import BoucWen
from quartercar.effects import CATALOGUE, _series_kernels
from quartercar.effects.compliance import Backlash, EntrainedAir, SeriesCompliance, SeriesElement
from quartercar.effects.friction_gas import CoulombFriction
from quartercar.effects.series import BoucWenInSeries, InSeries, in_series
from quartercar.effects.series_march import Elements

ELEMENTS = (SeriesCompliance(), Backlash(), EntrainedAir())
RATE = 1024.0


def baseline(name: str = "guo") -> DamperBaseline:
    """Any damper stands for its kind: with or without memory."""
    return DamperBaseline(dampers.model_class(name)())


def sine(amplitude: float, frequency: float, cycles: int = 6, rate: float = RATE) -> Signals:
    t = np.arange(round(cycles / frequency * rate)) / rate
    w = 2 * math.pi * frequency
    x, v = amplitude * np.sin(w * t), amplitude * w * np.cos(w * t)
    return Signals(1 / rate, {"displacement": x, "velocity": v, "current": 0 * x}, 0 * x)


def law(s: Signals) -> np.ndarray:
    """A tanh damper with position dependence, through (1200 + 300 i) v + (100 + 500 i) tanh((v + 2 x)/0.02)."""
    i, v, x = s["current"], s["velocity"], s["displacement"]
    return (1200 + 300 * i) * v + (100 + 500 * i) * np.tanh((v + 2 * x) / 0.02)


def run(element: SeriesElement, values: list[float], core: Core, s: Signals, name: str = "guo") -> np.ndarray:
    return element.compose(core, np.array(values), baseline(name))(s)


# -- what acts beside ------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("element", "values"), [(Backlash(), [4e-4, 5.0]), (EntrainedAir(), [3e-4, 300.0]),
                                                 (SeriesCompliance(), [4e-7])], ids=str)
def test_a_gas_preload_takes_up_no_play(element: SeriesElement, values: list[float]) -> None:
    """The force at rest acts beside the element: with a preload of 250 N all is as without, and 250 N."""
    s = sine(0.004, 3.0)
    alone = run(element, values, law, s)
    loaded = run(element, values, lambda q: law(q) - 250.0, s)
    assert np.sqrt(np.mean((loaded + 250.0 - alone) ** 2)) < 1e-3 * np.ptp(alone)
    assert np.abs(alone - law(s)).max() > 0.02 * np.ptp(alone), "and the element does something"


@pytest.mark.seconds
@pytest.mark.parametrize(("element", "values"), [(Backlash(), [4e-4, 5.0]), (EntrainedAir(), [3e-4, 300.0])], ids=str)
def test_the_derivative_in_the_preload_is_that_of_whole_runs(element: SeriesElement, values: list[float]) -> None:
    s = sine(0.004, 3.0)
    own, other = (element.compose(lambda q, p=p: law(q) - p, np.array(values), baseline()) for p in (250.0, 251.0))
    near, = own.near([other])  # type: ignore[attr-defined]
    assert np.sqrt(np.mean((near(s) - other(s)) ** 2)) < 1e-3


# -- nestedness ----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("element", ELEMENTS, ids=lambda e: e.name)
@pytest.mark.parametrize("name", ["guo", "bouc-wen"])
def test_at_zero_nothing_changes_and_near_zero_almost_nothing(element: SeriesElement, name: str) -> None:
    s = sine(0.01, 2.0, rate=256.0)
    core = law if name == "guo" else (lambda s: law(s) + 30 * np.sin(np.cumsum(s["velocity"])))
    values = element.neutral
    assert np.array_equal(run(element, list(values), core, s, name), core(s))
    values[0] = 1e-9 * element.parameters[0].grid[-1]
    assert np.abs(run(element, list(values), core, s, name) - core(s)).max() < 1e-4


# -- closed forms of equation sheet 9.1 ------------------------------------------------------------------------------
def test_a_dashpot_behind_a_spring_is_a_maxwell_element() -> None:
    c, k, x, f = 2000.0, 2e5, 0.01, 3.0
    s, w = sine(x, f, 8), 2 * math.pi * f
    force = run(SeriesCompliance(), [1 / k], lambda s: c * s["velocity"], s)
    tau, t = c / k, s.times
    steady = c * w * x / (1 + (w * tau) ** 2) * (np.cos(w * t) + w * tau * np.sin(w * t))
    late = t > 10 * tau + 0.5
    assert np.abs(force - steady)[late].max() < 5e-5 * steady.max()  # straight lines between samples: (wh)^2/12


def test_a_yield_force_behind_a_spring_is_a_jenkins_element() -> None:
    force_y, k, x, f = 1000.0, 1e6, 0.005, 1.0
    s = sine(x, f, 4)
    force = run(SeriesCompliance(), [1 / k], lambda s: force_y * np.tanh(s["velocity"] / 1e-4), s)
    last = s.times > 2 / f
    work = np.trapezoid((force * s["velocity"])[last], dx=s.sample_time) / 2
    assert work == pytest.approx(4 * force_y * (x - force_y / k), rel=2e-3)


def test_play_takes_its_width_after_every_reversal() -> None:
    """A dashpot's force is missing while the play is crossed: over half a stroke from rest v is integrated to δ."""
    play, x, f = 1e-3, 0.01, 1.0
    s = sine(x, f, 3)
    force = run(Backlash(), [play, 5.0], lambda s: 5e5 * s["velocity"], s)
    falling = (s.times > 1.25) & (s.times < 1.75)
    caught = np.flatnonzero(falling & (force < -100.0))[0]
    assert x - s["displacement"][caught] == pytest.approx(play, abs=2e-5)
    rigid = 5e5 * s["velocity"]
    engaged = falling & (s["displacement"] < x - 1.2 * play)
    assert np.abs(force - rigid)[engaged].max() < 2e-3 * np.abs(rigid).max()


@pytest.mark.parametrize("size", [0.01, 30.0])
def test_play_in_a_damper_of_another_size(size: float) -> None:
    """The force over which it is taken up is a number of the effect, which a search sets by the force of the data."""
    def screened(size: float) -> list[np.ndarray]:
        s = sine(0.01, 1.0, 3)
        s = Signals(s.sample_time, s.channels, size * law(s))
        return [run(Backlash(), list(values), lambda q: size * law(q), s)
                for values in Backlash().spread_points((s,), Scales.of([s]).size) if values[0] > 0]

    here, there = screened(1.0), screened(size)
    assert len(here) == len(there) > 2
    for one, other in zip(here, there, strict=True):
        assert np.abs(other - size * one).max() < 1e-6 * size * np.abs(one).max()


@pytest.mark.parametrize("name", ["kwok", "guo"])
def test_play_in_a_slow_motion_adds_no_force(name: str) -> None:
    """A law of the position too returns across the play faster than its table reaches; the play then counted as taken
    up, at 3e5 N."""
    s, damper = sine(5e-4, 0.05, 3, rate=50.0), baseline(name)
    rigid = damper.core(damper.vector)(s)
    force = run(Backlash(), [2e-3, 5.0], damper.core(damper.vector), s, name)
    assert np.abs(force).max() <= np.abs(rigid).max()


@pytest.mark.seconds
def test_air_is_soft_at_first_and_gone_when_compressed() -> None:
    stroke, pressure, c, f, x = 1e-3, 400.0, 2e5, 1.0, 0.01
    s = sine(x, f, 3, 4096.0)
    force = run(EntrainedAir(), [stroke, pressure], lambda s: c * s["velocity"], s)

    def rate(t: float, y: np.ndarray) -> list[float]:
        v = x * 2 * math.pi * math.cos(2 * math.pi * t)
        soft = stroke / (1.3 * pressure) * (1 + abs(y[0]) / pressure) ** (-1 / 1.3 - 1)
        return [(v - y[0] / c) / soft]

    exact = solve_ivp(rate, (0, s.times[-1]), [force[0]], "Radau", s.times, rtol=1e-9, atol=1e-6).y[0]
    assert np.sum((force - exact) ** 2) < 1e-7 * np.sum(exact**2)


# -- the number that is held -----------------------------------------------------------------------------------------
def test_the_force_of_the_take_up_is_never_fitted() -> None:
    """It has no column, no prior and no standard error, also inside a baseline that was diagnosed; a file keeps it."""
    s, law = sine(0.004, 3.0, 2), baseline()
    composition = Composition(law, (Backlash(),))
    vector = np.append(law.vector, [3e-4, 2.0])
    assert composition.chosen.tolist() == [False] * (vector.size - 1) + [True]
    assert not composition.sensitivities(s, vector)[:, -1].any()
    assert shape_prior(Backlash().parameters[1], 0.1, [2.0]) == (0.0, 0.0)
    assert estimates(Backlash(), vector[-2:], np.array([1e-6, np.nan]))[1].held
    model = ExtendedModel(composition, vector, np.eye(vector.size), ("velocity", "current"), {}, {})
    again = ExtendedModel.from_dict(json.loads(json.dumps(model.to_dict())))
    np.testing.assert_array_equal(again.vector, vector)
    around = Composition(ExtendedBaseline(model), (CoulombFriction(),))
    assert around.chosen[vector.size - 1] and around.chosen.sum() == 1


def test_a_file_from_before_the_take_up_has_five_newtons() -> None:
    law = baseline()
    model = ExtendedModel(Composition(law, (Backlash(),)), np.append(law.vector, [3e-4, 2.0]),
                          np.eye(law.vector.size + 2), ("velocity", "current"), {}, {})

    def older(data: dict) -> dict:
        effect, = data["effects"]
        return data | {"effects": [effect | {"parameters": effect["parameters"][:1]}],
                       "covariance": [row[:-1] for row in data["covariance"][:-1]]}

    found = ExtendedModel.from_dict(older(model.to_dict()))
    assert found.vector[-2:].tolist() == [3e-4, 5.0] and np.isnan(found.covariance[-1]).all()
    around = ExtendedModel(Composition(ExtendedBaseline(model), (CoulombFriction(),)),
                           np.append(model.vector, CoulombFriction().neutral), np.eye(model.vector.size + 3),
                           ("velocity", "current"), {}, {}).to_dict()
    nested = around["baseline"]
    nested["data"] = nested["data"] | {"model": older(nested["data"]["model"])}
    nested["vector"] = nested["vector"][:-1]
    with pytest.raises(InputError, match="diagnose its records again"):
        ExtendedModel.from_dict(around)


# -- a stiff solver --------------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_a_law_of_speed_position_and_current_in_series_follows_the_exact_solution() -> None:
    """ESR below 1e-5 at k = 1.5 MN/m, where the slope at rest is 48,000 N·s/m, on motion and current without jumps."""
    k, rate = 1.5e6, 512.0
    t = np.arange(round(1.5 * rate)) / rate
    waves = [(0.004, 3.0, 0.3), (0.001, 11.0, 1.0)]

    def motion(t: np.ndarray | float) -> tuple:
        return (sum(a * np.sin(2 * math.pi * f * t + p) for a, f, p in waves),
                sum(a * 2 * math.pi * f * np.cos(2 * math.pi * f * t + p) for a, f, p in waves),
                0.8 + 0.8 * np.sin(2 * math.pi * 1.7 * t))

    x, v, i = motion(t)
    s = Signals(1 / rate, {"displacement": x, "velocity": v, "current": i}, 0 * x)
    force = run(SeriesCompliance(), [1 / k], law, s)

    def speed(f: float, y: float, i: float) -> float:
        low, high = -20.0, 20.0
        for _ in range(60):
            w = 0.5 * (low + high)
            if (1200 + 300 * i) * w + (100 + 500 * i) * math.tanh((w + 2 * y) / 0.02) < f:
                low = w
            else:
                high = w
        return 0.5 * (low + high)

    def slope(time: float, state: np.ndarray) -> list[float]:
        x, v, i = motion(time)
        return [k * (v - speed(state[0], x - state[0] / k, i))]

    exact = solve_ivp(slope, (0, t[-1]), [force[0]], "Radau", t, rtol=1e-7, atol=1e-3).y[0]
    rigid = law(s)
    assert np.sum((rigid - exact) ** 2) > 0.1 * np.sum(exact**2)
    assert np.sum((force - exact) ** 2) < 1e-5 * np.sum(exact**2)


@pytest.mark.parametrize("elements", [{"compliance": 1e-7}, {"compliance": 2e-6}, {"play": 2e-4},
                                      {"air_stroke": 3e-4, "air_force": 500.0}, {"limit": 600.0}], ids=str)
@pytest.mark.parametrize("current", ["held", "swinging"])
def test_a_step_for_each_sample_is_as_good_as_many(elements: dict[str, float], current: str,
                                                   monkeypatch: pytest.MonkeyPatch) -> None:
    s = road_like(3, 4096)
    if current == "swinging":
        s = s.replace(current=1.2 + np.sin(9 * s.times))
    made = InSeries(law, Elements(**elements))
    force = made(s)
    marched = _series_kernels.march

    def finely(*given: object) -> None:
        *first, parts, ends, out = given
        marched(*first, np.full_like(parts, 60), ends, out)

    monkeypatch.setattr(_series_kernels, "march", finely)
    fine = made(s)
    assert np.sum((law(s) - fine) ** 2) > 3e-3 * np.sum(fine**2)
    assert np.sum((force - fine) ** 2) < 1e-4 * np.sum(fine**2)


def test_a_force_that_is_no_number_leads_to_none_and_not_beyond_a_table() -> None:
    """A search tries laws that explode; int(nan) as an index once ended the process."""
    soft = Elements(play=2e-4, air_stroke=3e-4, air_force=500.0).numbers(0.0)
    trace, out = np.zeros((4, 5)), np.zeros(4)
    trace[:, 2] = np.nan, np.inf, -np.inf, 1e300
    _series_kernels.softer(trace, soft, Elements(compliance=1e-6).numbers(0.0), out)
    assert np.isnan(out[0])
    assert np.isfinite(_series_kernels._play_and_air(-1e12, soft)).all()


def test_elements_in_one_series_are_one_element() -> None:
    play = Backlash().compose(SeriesCompliance().compose(law, np.array([4e-7]), baseline()), np.array([1e-4, 5.0]),
                              baseline())
    turned = SeriesCompliance().compose(Backlash().compose(law, np.array([1e-4, 5.0]), baseline()), np.array([4e-7]),
                                        baseline())
    assert isinstance(play, InSeries) and isinstance(turned, InSeries)
    assert play.elements == turned.elements


def test_a_core_with_memory_is_followed_through_its_local_slope() -> None:
    """A lagging dashpot with a spring: at low frequency the phases of both lags add."""
    c, k, f = 2000.0, 4e5, 1.0
    s = sine(0.01, f, 6)
    held_back = 0.003

    def lagging(s: Signals) -> np.ndarray:
        n = np.arange(s.n_samples)
        return c * np.interp(n - held_back / s.sample_time, n, s["velocity"])

    force = run(SeriesCompliance(), [1 / k], lagging, s, "bouc-wen")
    late = s.times > 2
    turn = np.exp(-2j * math.pi * f * s.times[late])
    lag = np.angle(np.sum(s["velocity"][late] * turn) / np.sum(force[late] * turn)) / (2 * math.pi * f)
    assert lag == pytest.approx(held_back + c / k, rel=0.01)


@pytest.mark.seconds
@pytest.mark.parametrize(("soft", "stroke", "current"), [(2.5e-6, 0.0, "none"), (3e-5, 0.0, "none"),
                                                         (2e-6, 3e-4, "none"), (2.5e-6, 0.0, "square")])
def test_a_bouc_wen_damper_in_series_follows_the_exact_solution(soft: float, stroke: float, current: str) -> None:
    """Oracle: differential equations of y, z, the lagged current and F by scipy, behind a spring and air."""
    waves = [(0.004, 1.3, 0.3), (0.002, 3.1, 1.0), (0.0005, 7.7, 2.0)]

    def motion(t: np.ndarray | float) -> tuple:
        return (sum(a * np.sin(2 * math.pi * f * t + p) for a, f, p in waves),
                sum(a * 2 * math.pi * f * np.cos(2 * math.pi * f * t + p) for a, f, p in waves))

    t = np.arange(800) / 256.0
    x, v = motion(t)
    command = np.where(np.sin(9 * t) > 0, 1.5, 0.2) if current == "square" else np.ones(t.size)
    s = Signals(t[1], {"displacement": x, "velocity": v, "current": command}, 0 * x, span=(0.0, 800 / 256.0))
    damper = BoucWen(scheduled=current == "square", springs=True).all_free()
    law = DamperBaseline(damper.with_values(gas_force=80.0))
    made = in_series(law.core(law.vector), law, compliance=soft, air_stroke=stroke, air_force=300.0)
    assert isinstance(made, BoucWenInSeries)
    theta, (k1, gas) = law.damper.coefficients(law.vector)
    c0a, c0b, k0, c1a, c1b, aa, ab, beta, gamma, delta, n, eta = theta

    def deflection(over: float) -> float:
        size = abs(over)
        return math.copysign(soft * size + stroke * (1 - (1 + size / 300.0) ** (-1 / 1.3)), over)

    def parts(time: float, y: float, z: float, u: float, force: float) -> tuple[float, float, float]:
        """Speed behind the elements, rate of the node, and the softness there."""
        c0, c1, alpha, over = c0a + c0b * u, c1a + c1b * u, aa + ab * u, force - gas
        inner = motion(time)[0] - deflection(over)
        w = ((force - k1 * inner - gas) * (c0 + c1) / c1 - alpha * z - k0 * (inner - y)) / c0
        softness = soft + stroke / (1.3 * 300.0) * (1 + abs(over) / 300.0) ** (-1 / 1.3 - 1)
        return w, (alpha * z + c0 * w + k0 * (inner - y)) / (c0 + c1), softness

    def rate(time: float, state: np.ndarray) -> list[float]:
        y, z, u, force = state
        w, node, softness = parts(time, y, z, u, force)
        lag = eta * (np.interp(time, t, command) - u)
        slip = w - node
        bent = gamma * abs(slip) * z * abs(z) ** (n - 1) + beta * slip * abs(z) ** n
        return [node, delta * slip - bent, lag, (motion(time)[1] - w) / softness]

    force = made(s)
    y, z, u = damper.initial_state(law.drive(s), law.vector)
    begun = [y - deflection(force[0] - gas), z, u, force[0]]
    exact = solve_ivp(rate, (0, t[-1]), begun, "LSODA", t, rtol=1e-8, atol=[1e-10, 1e-8, 1e-8, 1e-5],
                      max_step=t[1]).y[3]
    rigid = law.core(law.vector)(s)
    assert np.std(rigid - exact) > 0.2 * np.std(exact)
    assert np.std(force - exact) < 3e-3 * np.std(exact)


BESIDE = [e for e in CATALOGUE if e.stage == "core" or e.name in ("cavitation", "inner-friction")]


@pytest.mark.parametrize("effect", BESIDE, ids=lambda e: e.name)
def test_what_acts_behind_a_spring_vanishes_with_its_size(effect: Effect) -> None:
    """Beside a Bouc-Wen damper, whose own part is exact: at 1e-7 of a size that matters nothing jumps."""
    s, law = sine(0.004, 3.0, 2), DamperBaseline(BoucWen(scheduled=True, springs=True))
    s = s.replace(current=np.full(s.n_samples, 0.8))
    if effect.applies(law, (s,)):
        pytest.skip("not beside this law")
    alone, beside = (Composition(law, tuple(found)) for found in ((SeriesCompliance(),), (SeriesCompliance(), effect)))
    exact = alone.predict(s, np.append(law.vector, 2e-6))
    vector = beside.neutral
    spring, place = (p for n in ("series-compliance", effect.name)
                     for e, p in zip(beside.effects, beside.places, strict=True) if e.name == n)
    vector[spring] = 2e-6
    np.testing.assert_array_equal(beside.predict(s, vector), exact)
    strength = effect.parameters[0]
    vector[place.start] = strength.neutral + 1e-7 * (strength.grid[-1] - strength.neutral)
    assert np.abs(beside.predict(s, vector) - exact).max() < 1e-4 * np.abs(exact).max()


def test_a_bouc_wen_damper_in_series_with_little_is_itself_and_with_more_is_the_same_in_either_order() -> None:
    s, law = sine(0.004, 3.0), DamperBaseline(BoucWen(springs=True))
    core = law.core(law.vector)
    rigid = core(s)
    for more in ({"compliance": 1e-15}, {"play": 1e-12}, {"air_stroke": 1e-12}):
        assert np.abs(in_series(core, law, **more)(s) - rigid).max() < 1e-6 * np.abs(rigid).max()
    spring_first = in_series(in_series(core, law, compliance=1e-6), law, play=2e-4)
    play_first = in_series(in_series(core, law, play=2e-4), law, compliance=1e-6)
    np.testing.assert_array_equal(spring_first(s), play_first(s))
    assert np.abs(spring_first(s) - rigid).max() > 0.05 * np.abs(rigid).max()
    assert isinstance(in_series(DamperBaseline(dampers.model_class("kwok")()).core, law, play=1e-4), InSeries)


def test_a_bouc_wen_damper_behind_a_spring_cavitates_at_the_limit_and_not_before() -> None:
    s, law = sine(0.004, 3.0), DamperBaseline(BoucWen(springs=True))
    core = law.core(law.vector)
    exact = in_series(core, law, compliance=3e-6)(s)
    for limit in (1.01 * -exact.min(), 0.5 * -exact.min()):
        for made in (in_series(in_series(core, law, compliance=3e-6), law, limit=limit),
                     in_series(Around(lambda q: core(q) + 0.0, core), law, compliance=3e-6, limit=limit)):
            np.testing.assert_allclose(made(s), np.maximum(exact, -limit), atol=1e-9 * np.abs(exact).max())
    assert in_series(core, law, limit=1e9)(s) == pytest.approx(core(s), abs=1e-3 * np.abs(exact).max())


def test_a_bouc_wen_damper_inside_a_diagnosed_baseline_is_found() -> None:
    s, law = sine(0.004, 3.0), DamperBaseline(BoucWen(springs=True))
    inner = Composition(law, (Backlash(),))
    model = ExtendedModel(inner, inner.neutral, np.eye(inner.neutral.size), ("velocity", "displacement"), {}, {})
    around = Composition(ExtendedBaseline(model), (SeriesCompliance(),))
    found = around.predict(s, np.append(inner.neutral, 3e-6))
    np.testing.assert_array_equal(found, in_series(law.core(law.vector), law, compliance=3e-6)(s))


@pytest.mark.parametrize("values", [
    {"series-compliance": [2e-6]}, {"backlash": [3e-4, 3.0]}, {"entrained-air": [3e-4, 300.0]},
    {"coil-lag": [0.004], "series-compliance": [2e-6]}], ids=" ".join)
def test_derivatives_of_a_bouc_wen_damper_in_series_are_those_of_whole_runs(values: dict[str, list[float]]) -> None:
    """Along one run, by central differences of others: its own numbers, those of the elements and of a lag around."""
    t = np.arange(400) / 256.0
    x = 0.004 * np.sin(18.8 * t) + 0.002 * np.sin(4.1 * t)
    v = 0.004 * 18.8 * np.cos(18.8 * t) + 0.002 * 4.1 * np.cos(4.1 * t)
    s = Signals(t[1], {"displacement": x, "velocity": v, "current": np.where(np.sin(9 * t) > 0, 1.5, 0.2)}, 2000 * v,
                span=(0.0, 400 / 256.0))
    law = DamperBaseline(BoucWen(scheduled=True, springs=True).all_free().with_values(gas_force=80.0))
    composition = Composition(law, tuple(e for e in CATALOGUE if e.name in values))
    vector = composition.neutral
    for effect, place in zip(composition.effects, composition.places, strict=True):
        vector[place] = values[effect.name]
    found = composition.sensitivities(s, vector)
    for j in np.flatnonzero(~composition.chosen):
        step = 1e-5 * composition.scales[j] * (np.arange(vector.size) == j)
        wanted = (composition.predict(s, vector + step) - composition.predict(s, vector - step)) / (2 * step[j])
        assert np.linalg.norm(found[:, j] - wanted) < 1e-3 * np.linalg.norm(wanted), composition.names[j]



# -- the rig and the engine ------------------------------------------------------------------------------------------
PLACES = {"series-compliance": (SeriesCompliance(), [1 / 1.5e6], 2e-4), "backlash": (Backlash(), [5e-4, 5.0], 2e-3),
          "entrained-air": (EntrainedAir(), [4e-4, 400.0], 6e-4)}


@pytest.mark.thinned(3)
@pytest.mark.parametrize("name", PLACES)
def test_the_rig_does_the_same_to_a_damper_without_memory(name: str) -> None:
    element, values, allowed = PLACES[name]
    s = recorded(name, "test-3")
    power = np.sum(s.output**2)
    assert np.sum((static_law(s) - s.output) ** 2) > 0.1 * power
    assert np.sum((run(element, values, static_law, s)[300:] - s.output[300:]) ** 2) < allowed * power


@pytest.mark.slow
@pytest.mark.parametrize(("name", "value"), [
    ("series-compliance", 1 / 1.5e6), ("backlash", 5e-4), ("entrained-air", 4e-4)])
def test_the_engine_names_or_lists_what_the_rig_hides(name: str, value: float) -> None:
    assert named_or_listed(name)[name][0].value == pytest.approx(value, rel=0.1)


@pytest.mark.parametrize("size", [np.inf, np.nan, 1e308])
def test_a_force_beyond_all_bounds_reads_no_foreign_memory(size):
    """The table of the entrained air is entered at its end, where int(nan) would be far outside."""
    from quartercar.effects import _series_kernels as kernels

    element = np.array([0.0, 1e-3, 100.0, 0.0, -np.inf, 0.0, 5.0])
    with np.errstate(all="ignore"):
        d, _ = kernels._play_and_air.py_func(size, element)
        assert d == kernels._play_and_air(size, element)[0]
    assert d == pytest.approx(1e-3, rel=0.05)


# -- records that begin in motion --------------------------------------------------------------------------------------
@pytest.mark.parametrize("shift", [0.0, 0.13, 0.3, 0.45, 0.7])
@pytest.mark.parametrize(("element", "values"), [(SeriesCompliance(), [3e-5]), (EntrainedAir(), [4e-3, 100])], ids=str)
def test_a_record_of_a_sine_begins_in_the_motion_before_it(element: SeriesElement, values: list[float],
                                                           shift: float) -> None:
    """From whatever phase: the spring's deflection there follows from the period before, which the record repeats."""
    composition = Composition(baseline("power-law-friction-gas"), (element,))
    vector = np.concatenate([composition.baseline.vector, values])
    long, period = sine(0.01, 2.0), round(RATE / 2)
    first = period + round(shift * period)
    part = Signals(1 / RATE, {r: c[first:first + 3 * period] for r, c in long.channels.items()}, np.zeros(3 * period))
    settled = composition.predict(long, vector)[first:first + 3 * period]
    found, as_given = composition.free_run(part, vector), composition.predict(part, vector)
    error, before = (float(np.abs(y - settled).max()) for y in (found, as_given))
    assert error < 0.1 * before and error < 3e-3 * np.abs(settled).max()


def test_a_law_alone_begins_as_its_own_simulation_does() -> None:
    law_alone, s = Composition(baseline("bouc-wen")), sine(0.01, 2.0)
    np.testing.assert_array_equal(law_alone.free_run(s, law_alone.baseline.vector),
                                  law_alone.predict(s, law_alone.baseline.vector))
