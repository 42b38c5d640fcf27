"""Sentences of the demo's page that its figures must carry."""

from __future__ import annotations

import numpy as np

from lpvid.record import Record
from quartercar.demo.page import worst_currents
from quartercar.demo.run import ExperimentFigures


def held(name: str, current: float) -> Record:
    return Record({"current": np.full(10, current), "force": np.arange(10.0)}, sample_time=0.01, name=name)


def test_the_worst_constant_current_is_that_of_the_record_of_largest_error() -> None:
    figures = (ExperimentFigures("test-1", "road", 0.9, 1.0, (0.9,), None, None),
               ExperimentFigures("test-7", "multisine", 0.1, 1.0, (0.05, 0.2, 0.1), None, None),
               ExperimentFigures("test-8", "triangle", None, None, (0.05, None), None, None))
    records = [held("test-1-r0", 0.1), held("test-7-r0", 0.0), held("test-7-r1", 2.5), held("test-7-r2", 1.25),
               held("test-8-r0", 0.0), held("test-8-r1", 2.5)]
    assert worst_currents(figures, records) == (
        "The worst records by test, of constant currents: test-7 at 2.5 A (ESR 0.2).")
    assert worst_currents(figures[:1], records) == ""
