"""Zones regressed level by level: a known law comes back, and the stage says what the lines say."""

from __future__ import annotations

import numpy as np
import pytest

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.identification.zone_regression import regress_zones
from lpvid.model.input_stage import InputStage
from lpvid.model.zone_lines import ZoneLines

LEVELS = (0.0, 0.5, 1.0, 1.7, 2.5)


def law(v: np.ndarray, i: float) -> np.ndarray:
    high = 0.03 + 0.02 * i
    return (9000 + 200 * i) * np.clip(v, -high, high) + (500 + 150 * i) * v


def runs(noise: float = 0.0, levels=LEVELS) -> list[lpv.Record]:
    rng = np.random.default_rng(0)
    out = []
    for i in levels:
        v = 0.3 * np.sin(2 * np.pi * 1.7 * np.arange(3000) / 512) * np.linspace(0.2, 1, 3000)
        out.append(lpv.Record({"velocity": v, "current": np.full(v.size, i),
                               "force": law(v, i) + noise * rng.normal(size=v.size)}, sample_time=1 / 512))
    return out


@pytest.mark.parametrize("noise", [0.0, 20.0])
def test_a_known_law_comes_back(noise):
    found = regress_zones(runs(noise), degree=2)
    grid = np.linspace(-0.3, 0.3, 41)[:, None]
    for i in (0.2, 1.3, 2.4):
        m2 = 9000 + 200 * i + 500 + 150 * i
        shaped = found.stage.apply(grid, np.full((41, 1), i))[:, 0]
        np.testing.assert_allclose(shaped, law(grid[:, 0], i) / m2, atol=1e-4 if not noise else 2e-3)
    np.testing.assert_allclose(found.stage.limit, [0.03, 0.02], atol=1e-4 if not noise else 5e-3)
    assert found.levels == pytest.approx(LEVELS) and len(str(found).splitlines()) == 6


def test_slopes_are_derivatives_and_the_file_brings_the_stage_back():
    stage = regress_zones(runs(), degree=1).stage
    rng = np.random.default_rng(1)
    u, p = 0.3 * rng.normal(size=(300, 1)), rng.uniform(0, 2.5, (300, 1))
    free = np.flatnonzero(stage.scales(1.25) > 0)
    step = 1e-6 * np.abs(stage.vector).max()
    for place in free:
        d = step * np.eye(stage.vector.size)[place]
        numeric = (stage.with_vector(stage.vector + d).apply(u, p)
                   - stage.with_vector(stage.vector - d).apply(u, p)) / (2 * step)
        np.testing.assert_allclose(stage.slopes(u, p)[:, :, place], numeric, atol=1e-8, rtol=1e-5)
    assert InputStage.from_dict(stage.to_dict()) == stage
    # the level of m_2 only scales the filter behind it, and v_high is where u may jump: neither is searched
    assert 0 not in free and 1 not in free and stage.vector.size - free.size == 3


@pytest.mark.seconds
def test_it_serves_as_the_stage_of_a_model():
    stage = regress_zones(runs()).stage
    found = lpv.identify(runs(20.0), lpv.ARX(1, 1, 0, "velocity", "force", lpv.Polynomial("current", 1), stage=stage))
    assert found.training.overall.free_run.esr < 0.01
    again = lpv.LPVTransferFunction.from_dict(found.model.to_dict())
    assert isinstance(again.input_stage, ZoneLines)


def test_bad_input_is_named():
    with pytest.raises(InputError, match="2 levels"):
        regress_zones(runs(levels=(1.0,)))
    slow = [lpv.Record({"velocity": np.full(100, 0.1), "force": np.zeros(100), "current": np.full(100, i)},
                       sample_time=0.01) for i in (0.0, 1.0)]
    with pytest.raises(InputError, match="no samples"):
        regress_zones(slow)
    with pytest.raises(InputError, match="needs a coefficient"):
        ZoneLines((), (1.0,), (1.0,), (1.0,), (0.0,), (0.0,))
