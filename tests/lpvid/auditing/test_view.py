"""The stretch of a record that checks look at: unbroken, finite, the longest one; breaks cost nothing."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import lpvid as lpv
from lpvid.auditing.view import view


def stuck(n: int, since: int, missing: np.ndarray | None = None) -> lpv.Record:
    rng = np.random.default_rng(0)
    time = np.arange(n) / 500
    time[since:] = time[since]
    values = rng.normal(size=n)
    if missing is not None:
        values[missing] = np.nan
    return lpv.Record({"velocity": values, "force": rng.normal(size=n)}, time=time, name="stuck",
                      units={"velocity": "m/s", "force": "N"})


def by_rows(record: lpv.Record, name: str) -> np.ndarray:
    """The longest run, the first of equal ones, one row after the other."""
    base, values = record.time_base, record[name]
    broken = {*base.gaps, *base.duplicates, *base.backward}
    runs, run = [], []
    for k, x in enumerate(values):
        if run and (k in broken or not np.isfinite(x)):
            runs.append(run)
            run = []
        if np.isfinite(x):
            run.append(k)
    return values[max([*runs, run], key=len)]


@pytest.mark.parametrize("seed", range(4))
def test_the_longest_run_is_that_of_a_walk_along_the_rows(seed) -> None:
    rng = np.random.default_rng(seed)
    record = stuck(900, 700, rng.choice(900, 5, replace=False))
    keep = np.sort(np.concatenate([rng.choice(500, 480, replace=False), np.arange(500, 900)]))
    record = lpv.Record({n: record[n][keep] for n in record.channels}, time=record.times[keep], name="stuck")
    found = view(record, None).run("velocity")
    expected = by_rows(record, "velocity")
    if expected.size >= 64:
        np.testing.assert_array_equal(found[0], expected)
    else:
        assert found is None


def test_every_repeated_row_costs_no_look_of_its_own(monkeypatch) -> None:
    """A clock that stuck: .1 ms for each of its rows, in every check."""
    looks = []
    viewing = sys.modules["lpvid.auditing.view"]
    monkeypatch.setattr(viewing, "true_runs", lambda good, own=viewing.true_runs: looks.append(1) or own(good))
    found = lpv.audit([stuck(20_000, 1000)])
    assert found.of("duplicate-time") and len(looks) < 100
