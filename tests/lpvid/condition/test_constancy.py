"""One criterion for a scheduling that does not move, here and for dampers."""

from __future__ import annotations

import numpy as np
import pytest

import lpvid as lpv
from lpvid.condition.constancy import DISTINCT, at_rest, constant
from quartercar.dampers.facts import Facts


@pytest.mark.parametrize(("share", "still"), [(0.99 * DISTINCT, True), (1.01 * DISTINCT, False)])
@pytest.mark.parametrize("size", [1e-3, 0.8, -2.0])
def test_identify_and_a_damper_fit_agree_on_a_current(share, still, size, rng):
    n = 400
    v = rng.normal(size=n)
    current = size * (1 - share * np.linspace(0, 1, n))
    record = lpv.Record({"velocity": v, "current": current, "force": 100 * v + rng.normal(size=n)}, 0.01,
                        units={"velocity": "m/s", "current": "A", "force": "N"})
    assert constant(current.min(), current.max(), "A") is still
    assert Facts.of([record]).current_varies is not still
    structure = lpv.ARX(na=1, nb=1, input="velocity", output="force", basis=lpv.Polynomial("current", degree=1))
    if still:
        with pytest.raises(lpv.InputError, match="'current' is constant over the whole data set"):
            lpv.identify(record, structure)
    else:
        assert lpv.identify(record, structure).n_samples
    assert bool(lpv.audit(record).of("constant-scheduling")) is still


def test_a_share_means_nothing_where_zero_is_a_convention():
    assert not constant(99.0, 100.0, "") and not constant(293.0, 298.0, "K") and constant(293.0, 293.0, "K")


def test_rest_is_within_each_record_up_to_the_sensor_of_a_command():
    """Held currents with a noise of 0.3 % rest, and so does the one at zero beside them; one step does not."""
    rng = np.random.default_rng(0)
    levels = [i + rng.uniform(-0.003, 0.003, 200) for i in (0.0, 0.5, 1.0)]

    def of(values, unit="A"):
        return lpv.Record({"current": values}, sample_time=0.01, units={"current": unit})

    assert at_rest([of(v) for v in levels], ["current"])
    assert not at_rest([of(v, "K") for v in levels], ["current"])
    stepped = np.where(np.arange(200) < 100, 0.0, 1.0)
    assert not at_rest([*(of(v) for v in levels), of(stepped)], ["current"])
    assert not at_rest([of(levels[0])], [])
