"""The filter that all channels pass, against independent filters at a finer clock: bent laws, edges of a current."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.effect_signals import PERIOD, composed, guo, motion
from scipy.signal import bilinear, lfilter, lti

from lpvid.baselines.signals import Signals
from lpvid.effects.composition import Composition
from quartercar.effects.current_edges import current_before, edges_of, find_edges
from quartercar.effects.electrical import held
from quartercar.effects.measurement import OneSidedFilter
from quartercar.effects.second_order import step_response
from quartercar.effects.shared_filter import SharedFilter

FINE = 16
INSIDE = slice(256, -256)


def test_a_filter_of_the_motion_beside_it_raises_no_noise(rng: np.random.Generator) -> None:
    """On the finer clock there is nothing beyond the band that was recorded, by which noise could be told."""
    effects = OneSidedFilter(), SharedFilter()
    composition = Composition(guo(), effects)
    x, v = motion(PERIOD * np.arange(4096))
    s = Signals(PERIOD, {"displacement": x, "velocity": v + 1e-3 * rng.standard_normal(v.size),
                         "current": np.ones(v.size)}, np.zeros(v.size))
    vector = composition.neutral
    vector[composition.places[0]] = 0.01, 0.7071, 0.0
    alone = composition.predict(s, vector)
    vector[composition.places[1]] = 2e-4, 0.7071
    assert np.std((composition.predict(s, vector) - alone)[INSIDE]) < 0.02 * np.std(alone)


def held_current(rng: np.random.Generator, samples: int, steady: int = 20) -> np.ndarray:
    """(samples FINE,) current that jumps anywhere between two samples and rests for `steady` samples or more."""
    current, at = np.empty(samples * FINE), 0
    while at < current.size:
        until = at + int(rng.integers(steady * FINE, 4 * steady * FINE))
        current[at:until] = rng.uniform(0.0, 2.0)
        at = until
    return current


def law(s: Signals) -> np.ndarray:
    """A bent one, whose yield the current sets."""
    return (0.2 + s["current"]) * np.tanh(s["velocity"] / 0.02)


def behind(period: float, fine: np.ndarray) -> np.ndarray:
    """(n,) samples of a signal on the finer clock behind a Butterworth filter of order two."""
    b, a = bilinear([1.0], [period**2, 1.4142 * period, 1.0], FINE / PERIOD)
    return (lfilter(b, a, fine - fine[0]) + fine[0])[::FINE]


def through(period: float, current: np.ndarray) -> tuple[Signals, np.ndarray]:
    """Channels and force of the law behind the same filter."""
    t = PERIOD / FINE * np.arange(current.size)
    x, v = motion(t)
    force = law(Signals(PERIOD, {"velocity": v, "current": current}, np.zeros(t.size)))
    x, v, i, force = (behind(period, c) for c in (x, v, current, force))
    return Signals(PERIOD, {"displacement": x, "velocity": v, "current": i}, np.zeros(x.size)), force


@pytest.mark.parametrize("corner", [60.0, 80.0, 160.0])
def test_a_bent_law_of_a_filtered_motion_is_not_the_filtered_law(corner: float) -> None:
    period = 1 / (2 * np.pi * corner)
    s, force = through(period, np.ones(4096 * FINE))
    before = np.std((force - law(s))[INSIDE])
    after = np.std((force - composed(SharedFilter(), [period, 0.7071], s, law))[INSIDE])
    assert after < 0.1 * before


@pytest.mark.parametrize(("corner", "left"), [(60.0, 0.2), (120.0, 0.25), (160.0, 0.4)])
def test_edges_of_a_current_are_put_back(corner: float, left: float, rng: np.random.Generator) -> None:
    """Filtered current times filtered motion is not the filtered product: around each edge the error is large."""
    period = 1 / (2 * np.pi * corner)
    s, force = through(period, held_current(rng, 4096))
    assert not held(s)
    before = np.std((force - law(s))[INSIDE])
    after = np.std((force - composed(SharedFilter(), [period, 0.7071], s, law))[INSIDE])
    assert after < left * before


def test_edges_are_found_where_they_began(rng: np.random.Generator) -> None:
    current = held_current(rng, 2048)
    true = FINE * (np.flatnonzero(np.diff(current)) + 1) / FINE**2  # in samples
    s = Signals(PERIOD, {"current": behind(1e-3, current)}, np.zeros(2048))
    edges = find_edges(s["current"], PERIOD)
    assert edges.known.all() and edges.first.size > 0.9 * true.size, "some levels differ by next to nothing"
    fine = current_before(s, edges, 1e-3, 0.7071, 8)
    halves = np.array([np.interp(0.5, *sorted_part(fine, a, b)) for a, b in zip(edges.first, edges.until, strict=True)])
    assert np.abs(halves[:, None] - true).min(axis=1).max() < 0.1


def sorted_part(fine: np.ndarray, first: int, until: int) -> tuple[np.ndarray, np.ndarray]:
    """Share of the way of an edge, rising, and the place in samples at which it is reached."""
    part = fine[8 * first: 8 * until]
    share = (part - part[0]) / (part[-1] - part[0])
    return share, (8 * first + np.arange(part.size)) / 8


def test_around_an_edge_between_levels_that_do_not_last_nothing_is_changed() -> None:
    period = 1e-3
    current = np.repeat(np.concatenate([np.zeros(200), [1.0, 0.3, 1.4, 0.1, 0.9], np.full(195, 2.0)]), FINE)
    s, _ = through(period, current)
    edges = find_edges(s["current"], PERIOD)
    assert not edges.known.any()
    got = composed(SharedFilter(), [period, 0.7071], s, law)
    np.testing.assert_array_equal(got[200:206], law(s)[200:206])
    assert np.any(got != law(s))


def test_a_current_without_edges_has_none() -> None:
    def some(current: np.ndarray) -> bool:
        return edges_of(Signals(PERIOD, {"current": current}, np.zeros(current.size))) is not None

    assert some(np.repeat([0.0, 1.0, 0.5], 50)) and not some(np.full(100, 0.7))
    assert not some(np.sin(np.arange(200) / 20))
    assert not some(0.7 + 1e-4 * (-1.0) ** np.arange(100)), "a sensor's last digit is no current"
    assert find_edges(np.full(100, 0.7), PERIOD).first.size == 0


@pytest.mark.parametrize("noise", [0.004, 0.02, 0.04, 0.1])
@pytest.mark.parametrize("held_for", [64, 250])
def test_edges_are_found_under_the_noise_of_a_sensor(rng: np.random.Generator, noise: float, held_for: int) -> None:
    """Of a current between 0 and 2 A: noise fills the samples between the jumps, however long they are."""
    levels = np.repeat(rng.uniform(0.0, 2.0, 40), held_for)
    s = Signals(PERIOD, {"current": levels + noise * rng.standard_normal(levels.size)}, np.zeros(levels.size))
    edges, jump = edges_of(s), np.flatnonzero(np.abs(np.diff(levels)) > 10 * noise)
    assert edges is not None and np.isin(jump, edges.first[:, None] + np.arange(3)).all()


def test_ramps_and_sweeps_are_no_edges() -> None:
    """A ramp that takes longer than a filter's response; a sweep, most of whose steps are small beside the largest."""
    steps = np.repeat(np.random.default_rng(0).uniform(0, 2, 20), 200)
    octaves = np.log(40.0) * np.arange(4000) / 4000
    sweep = np.sin(2 * np.pi * 0.5 * np.expm1(octaves) / np.log(40.0) * 4000 * PERIOD)
    for current in (np.convolve(steps, np.full(24, 1 / 24), "valid"), 1 + sweep):
        assert edges_of(Signals(PERIOD, {"current": current}, np.zeros(current.size))) is None


def test_noise_of_a_long_record_has_no_edges() -> None:
    """Of n normal steps the largest is about σ √(2 ln n): more than six times the median one where n is large."""
    noise = np.random.default_rng(0).standard_normal(50_000)
    assert find_edges(noise, PERIOD).first.size == 0


def test_a_current_whose_edges_take_no_time_has_passed_no_filter(rng: np.random.Generator) -> None:
    current = held_current(rng, 2048)
    _, v = motion(PERIOD * np.arange(2048))
    force = np.zeros(2048)
    sharp = Signals(PERIOD, {"velocity": v, "current": current[::FINE]}, force)
    dull = Signals(PERIOD, {"velocity": v, "current": behind(1e-3, current)}, force)
    refused = SharedFilter().applies(guo(), (sharp,))
    assert refused is not None and "unfiltered" in refused
    assert SharedFilter().applies(guo(), (dull,)) is None


@pytest.mark.parametrize("zeta", [0.4, 0.7071, 1.0, 1.2])
def test_step_response(zeta: float) -> None:
    t = 1e-3
    times = np.linspace(0.0, 0.01, 60)
    expected = lti([1.0], [t**2, 2 * zeta * t, 1.0]).step(T=times)[1]
    np.testing.assert_allclose(step_response(times, t, zeta), expected, atol=1e-6)
    assert step_response(np.array([-1.0]), t, zeta)[0] == pytest.approx(0.0, abs=1e-12)
