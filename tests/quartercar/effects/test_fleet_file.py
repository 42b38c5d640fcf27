"""A fleet's law as a file: the same run, the same bounds, and its causes in another strength are candidates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import lpvid as lpv
from lpvid.diagnosis.task import prepare_task
from lpvid.effects.composition import Composition
from lpvid.effects.extended import ExtendedModel
from lpvid.effects.fleet_law import FleetEffect, FleetLaw
from quartercar.effects import CATALOGUE
from quartercar.rig import EXPERIMENTS, Rig


def test_it_is_the_same_after_its_file(tmp_path: Path) -> None:
    record = Rig().run(replace(EXPERIMENTS["test-1"], duration=4.0), seed=0)
    guo = prepare_task(record, "guo").baseline
    shared = {"series-compliance": [2.5e-7], "coil-lag": [0.007]}
    composition = Composition(guo, tuple(e for e in CATALOGUE if e.name in shared))
    vector = composition.neutral
    for effect, place in zip(composition.effects, composition.places, strict=True):
        vector[place][:1] = shared[effect.name]
    size = vector.size
    found = ExtendedModel(composition, vector, np.full((size, size), np.nan)).remembering([record])
    law = FleetLaw.of(found, [vector * (1 + 0.01 * k) for k in range(-4, 5)])
    again = lpv.load(lpv.save(law, tmp_path / "law.json"))
    assert isinstance(again, FleetLaw) and again.name == law.name
    for name in ("lower", "upper", "vector"):
        np.testing.assert_array_equal(getattr(again, name), getattr(law, name))
    free = FleetLaw.free(found)
    assert np.isinf(free.upper).any()
    np.testing.assert_array_equal(lpv.load(lpv.save(free, tmp_path / "free.json")).upper, free.upper)
    task = prepare_task(record, tmp_path / "law.json")
    s = again.signals(task.prepared.training[0])
    np.testing.assert_array_equal(again.core(again.vector)(s), law.core(law.vector)(s))
    shifted = {e.name: e for e in task.catalogue if isinstance(e, FleetEffect)}
    assert shifted.keys() == shared.keys()
    assert [shifted[n].neutral[0] for n in shared] == [v[0] for v in shared.values()]
    # a spring that is softer in one file lies where the fleet's is, and is exact there: one spring of another stiffness
    softer = Composition(again, (shifted["series-compliance"],))
    at = np.append(again.vector, 9e-7)
    other = vector.copy()
    other[composition.places[[e.name for e in composition.effects].index("series-compliance")]] = 9e-7
    np.testing.assert_array_equal(softer.predict(s, at), composition.predict(s, other))
    stored = ExtendedModel(softer, at, np.full((at.size, at.size), np.nan), found.reads, found.units)
    back = lpv.load(lpv.save(stored, tmp_path / "extended.json"))
    np.testing.assert_array_equal(back.predict(record), stored.predict(record))
