"""Static input stages: the thesis's zones, their continuity, and the tanh knee."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from lpvid.errors import InputError
from lpvid.model.input_stage import InputStage, TanhStage, ThreeZoneStage
from lpvid.model.signals import Signal

ratios = st.floats(-0.5, 2.0)
slopes = st.floats(-0.3, 0.3)
zones = st.builds(
    ThreeZoneStage,
    limit=st.floats(1e-3, 10.0),
    limit_slope=slopes,
    upper=ratios,
    upper_slope=slopes,
    lower=ratios,
    lower_slope=slopes,
)


def column(values) -> np.ndarray:
    return np.asarray(values, dtype=float)[:, None]


def test_three_zones_give_the_published_forces() -> None:
    m_middle, m_outer, v_high = 12_000.0, 900.0, 0.06
    v = column([-0.3, -0.06, 0.0, 0.03, 0.06, 0.3])
    stage = ThreeZoneStage(limit=v_high, upper=m_outer / m_middle, lower=m_outer / m_middle)
    shaped = stage.apply(v, np.zeros((6, 1))).ravel()
    np.testing.assert_allclose(shaped, [-0.078, -0.06, 0.0, 0.03, 0.06, 0.078], atol=1e-15)
    np.testing.assert_allclose(m_middle * shaped, [-936, -720, 0, 360, 720, 936], atol=1e-9)
    outer = v.ravel()[5] * m_outer + (m_middle - m_outer) * v_high  # F = m_3 v + c_3, c_3 = 666 N
    assert m_middle * shaped[5] == pytest.approx(outer)


@given(stage=zones, v=st.floats(-50, 50), p=st.floats(-2, 2))
def test_three_zones_by_the_thesiss_cases(stage: ThreeZoneStage, v: float, p: float) -> None:
    high = max(stage.limit + stage.limit_slope * p, 0.02 * stage.limit)
    upper, lower = stage.upper + stage.upper_slope * p, stage.lower + stage.lower_slope * p
    if v > high:
        expected = upper * v + (1 - upper) * high
    elif v < -high:
        expected = lower * v - (1 - lower) * high
    else:
        expected = v
    assert stage.apply(column([v]), column([p]))[0, 0] == pytest.approx(expected, abs=1e-9)


@given(stage=zones, p=st.floats(-2, 2), sign=st.sampled_from([-1.0, 1.0]))
def test_three_zones_are_continuous_at_the_knees(stage: ThreeZoneStage, p: float, sign: float) -> None:
    knee = sign * max(stage.limit + stage.limit_slope * p, 0.02 * stage.limit)
    near = column([knee * (1 - 1e-9), knee, knee * (1 + 1e-9)])
    shaped = stage.apply(near, np.full((3, 1), p)).ravel()
    assert np.abs(shaped - knee).max() <= 1e-8 * max(abs(knee), 1.0)


@given(v0=st.floats(1e-3, 10), slope=st.floats(-0.1, 0.1), v=st.floats(-50, 50), p=st.floats(-2, 2))
def test_a_tanh_stage_adds_its_column(v0: float, slope: float, v: float, p: float) -> None:
    out = TanhStage(v0=v0, slope=slope).apply(column([v]), column([p]))
    assert out[0, 0] == v
    assert out[0, 1] == pytest.approx(np.tanh(v / max(v0 + slope * p, 0.05 * v0)))


def test_a_stage_shapes_its_own_channel_with_its_own_variable() -> None:
    u, p = np.array([[1.0, 2.0]]), np.array([[7.0, 3.0]])
    tanh = TanhStage(v0=1.0, slope=0.5, channel=1, variable=1)
    assert tanh.apply(u, p)[0].tolist() == [1.0, 2.0, pytest.approx(np.tanh(2.0 / 2.5))]
    assert [s.name for s in tanh.signals((Signal("a", "m"), Signal("b", "m/s")))] == ["a", "b", "tanh(b)"]
    zone = ThreeZoneStage(limit=0.5, limit_slope=0.1, upper=0.0, lower=0.0, channel=1, variable=1)
    assert zone.apply(u, p)[0].tolist() == [1.0, pytest.approx(0.8)]
    assert [str(s) for s in zone.signals((Signal("a", "m"), Signal("b", "m/s")))] == ["a [m]", "zones(b) [m/s]"]
    assert u.tolist() == [[1.0, 2.0]]


@pytest.mark.parametrize("stage", [TanhStage(0.1, 0.02, 1, 1), ThreeZoneStage(0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 1, 1)])
def test_vectors_and_dicts_hold_a_stage(stage) -> None:
    assert stage.with_vector(stage.vector) == stage
    assert InputStage.from_dict(json.loads(json.dumps(stage.to_dict()))) == stage
    assert stage.with_vector(-np.abs(stage.vector)).vector[0] > 0
    assert stage.scales(2.0).shape == stage.vector.shape
    fixed = stage.scales(0.0) == 0  # without a scheduling range the slopes cannot be found
    assert (
        fixed.tolist() == [name.endswith("slope") for name in ("v0", "slope")]
        if isinstance(stage, TanhStage)
        else fixed.tolist() == [False, True, False, True, False, True]
    )
    starts = stage.starts(np.ones((9, 2)), np.zeros((9, 2)))
    assert len(starts) >= 2
    assert all(s.channel == 1 for s in starts)


def test_starts_follow_the_datas_own_spread() -> None:
    small = TanhStage().starts(1e-6 * np.ones((5, 1)), np.zeros((5, 1)))
    large = TanhStage().starts(1e6 * np.ones((5, 1)), np.zeros((5, 1)))
    np.testing.assert_allclose([s.vector[0] * 1e12 for s in small], [s.vector[0] for s in large])
    assert all(s.vector[0] > 0 for s in TanhStage().starts(np.zeros((5, 1)), np.zeros((5, 1))))


def test_no_stage_and_no_such_stage() -> None:
    with pytest.raises(InputError, match="unknown input stage in a model file: got sine"):
        InputStage.from_dict({"kind": "sine"})
    for bad in (0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="v0 of a tanh stage"):
            TanhStage(v0=bad)
        with pytest.raises(InputError, match="limit of a three-zone stage"):
            ThreeZoneStage(limit=bad)
    with pytest.raises(InputError, match="upper of a three-zone stage must be finite"):
        ThreeZoneStage(upper=np.inf)


def test_gains_by_amplitude_are_those_of_the_published_forms() -> None:
    small, large = TanhStage(v0=0.1, slope=0.01).amplitude_gains(np.array([2.0]))  # tanh(v/(v_0 + s p)) ≈ v/(v_0 + s p)
    np.testing.assert_allclose(small, [1.0, 1 / (0.1 + 0.01 * 2.0)], rtol=1e-9)
    np.testing.assert_array_equal(large, [1.0, 0.0])
    stage = ThreeZoneStage(limit=0.2, upper=0.4, upper_slope=0.1, lower=0.3)
    for p, upper in ((0.0, 0.4), (8.0, 1.2)):
        small, large = stage.amplitude_gains(np.array([p]))
        assert small == pytest.approx([max(1.0, upper)], rel=1e-5)  # σ v + (1 − σ) v_high at a million knees
        assert large == pytest.approx([(upper + 0.3) / 2], rel=1e-5)


@pytest.mark.parametrize("size", [0.15, 3.0])
def test_gains_of_a_motion_of_given_size_are_its_fundamental(size: float) -> None:
    """By an integral for tanh, by the closed form of a saturation for zones; far within the knee that of small ones."""
    p, tanh, zones = np.zeros(0), TanhStage(v0=0.1), ThreeZoneStage(limit=0.1, upper=0.3, lower=0.2)
    fundamental = quad(lambda a: np.sin(a) * np.tanh(size * np.sin(a) / 0.1), 0, np.pi)[0] * 2 / np.pi / size
    np.testing.assert_allclose(tanh.amplitude_gains(p, size)[1], [1.0, fundamental], rtol=1e-5)
    share = 0.1 / size
    clipped = 2 / np.pi * (np.arcsin(share) + share * np.sqrt(1 - share**2))
    np.testing.assert_allclose(zones.amplitude_gains(p, size)[1], [clipped + 0.25 * (1 - clipped)], rtol=1e-4)
    for stage in (tanh, zones):
        small, near = stage.amplitude_gains(p, 1e-6)
        np.testing.assert_allclose(near, small, rtol=1e-6)


def test_a_stage_states_its_first_knee() -> None:
    assert (TanhStage(v0=0.1).first_knee, ThreeZoneStage(limit=0.2).first_knee) == (0.1, 0.2)
