"""Bouc-Wen's law inside effects: its columns from one run of its tangents, against differences of whole runs."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
import pytest

from lpvid.baselines.signals import Signals
from lpvid.effects.composition import Composition
from lpvid.effects.effect import by_name
from quartercar.baselines.damper import DamperBaseline
from quartercar.dampers.laws.bouc_wen import BoucWen
from quartercar.effects import CATALOGUE

PERIOD = 0.004


def signals(n: int = 600) -> Signals:
    t = PERIOD * np.arange(n)
    x = 0.01 * np.sin(9 * t) + 0.002 * np.sin(31 * t)
    v = 0.09 * np.cos(9 * t) + 0.062 * np.cos(31 * t)
    current = np.repeat(np.random.default_rng(3).uniform(0, 2, n // 60), 60)
    return Signals(PERIOD, {"velocity": v, "displacement": x, "current": current}, 1500 * v, span=(0.0, n * PERIOD))


@pytest.mark.parametrize(("names", "values", "runs"), [
    (("coulomb-friction",), [20.0, 0.0, 2e-3], 0), (("coil-lag",), [0.004], 0),
    (("displacement-delay", "gas-stiffness"), [500.0, 3.0, 0.004, 0.2], None),
    (("series-compliance",), [1e-6], None), (("backlash",), [2e-4, 5.0], None)])
def test_columns_inside_effects(names: tuple[str, ...], values: list[float], runs: int | None) -> None:
    """They agree, and where the effect leaves the signals alone or its own are kept, no run of the law is needed."""
    causes = by_name(CATALOGUE)
    law = BoucWen(scheduled=True, springs=True).all_free()
    baseline = DamperBaseline(law.with_values(gas_force=50.0))
    composition = Composition(baseline, tuple(causes[n] for n in names))
    vector, s = np.concatenate([baseline.vector, values]), signals()
    own = range(composition.own)
    here = composition.predict(s, vector)
    with patch.object(BoucWen, "response", autospec=True, side_effect=BoucWen.response) as response:
        found = composition.sensitivities(s, vector, list(own), here)
    assert runs is None or response.call_count == runs
    for j in own:
        step = 1e-5 * composition.scales[j]
        up, down = vector.copy(), vector.copy()
        up[j], down[j] = up[j] + step, down[j] - step
        exact = (composition.predict(s, up) - composition.predict(s, down)) / (2 * step)
        assert np.linalg.norm(found[:, j] - exact) <= 1e-3 * float(np.linalg.norm(exact)), composition.names[j]


def test_of_a_law_that_diverges_no_number_is_made_up_and_nothing_is_raised() -> None:
    """Warnings are errors here."""
    baseline = DamperBaseline(BoucWen(scheduled=True, springs=True).all_free())
    composition = Composition(baseline, (by_name(CATALOGUE)["series-compliance"],))
    vector = np.append(baseline.vector, 1e-6)
    vector[composition.names.index("gas_stiffness")] *= 1e300
    found = composition.sensitivities(signals(), vector)
    assert not np.any(np.isfinite(found) & (found != 0))
    vector = baseline.vector.copy()
    vector[composition.names.index("yield_displacement")] *= 1e-300  # divided by zero in the kernel
    assert Composition(baseline, ()).sensitivities(signals(), vector).shape == (600, vector.size)
