"""The page of a diagnosis: what it advises."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.toy_diagnosis import Bent, Dry, record

from lpvid.diagnosis.evidence.engine import diagnose
from lpvid.diagnosis.facade import DiagnosisTask
from lpvid.diagnosis.preparing import PreparedRecords
from lpvid.plot.diagnosis import BeforeAfter
from lpvid.record import Record
from lpvid.report.diagnosis import _before_after_traces, diagnosis_page


@pytest.mark.parametrize(("level", "again", "mark"), [(0.05, False, "good"), (0.6, False, "warn"), (0.6, True, "good")])
def test_much_that_is_taken_for_noise_is_no_good_news_unless_a_repeat_shows_it(level, again, mark):
    rng = np.random.default_rng(4)
    first = record(rng, "ar1", level=level)
    records: list[Record] = [first, record(rng, "ar1", level=level, u=first["u"])] if again else [first]
    found = diagnose(records, Bent(), [Dry()])
    assert found.verdict == "nothing-to-explain" and (found.noise_floor is not None) is again
    prepared = PreparedRecords(tuple(records), (), ())
    page = diagnosis_page(found, DiagnosisTask(prepared, Bent(), True, (Dry(),), tuple(records)))
    assert page.mark == mark
    assert ("Repeat the run" in str(page.sections[0])) is (mark == "warn")


def test_the_time_traces_have_the_unit_of_the_channel():
    """A voltage that stands for the current is in V."""
    t = np.arange(400) / 500.0
    v, current = np.sin(9 * t), 1.0 + np.sin(t)
    units = {"velocity": "m/s", "current": "V"}
    channels = {"velocity": v, "current": current}
    shown = BeforeAfter("run", "held-out", 0.002, channels, 900 * v, 800 * v, 890 * v, "force", "N", units)
    drawn = str(_before_after_traces([shown]))
    assert "current [V]" in drawn and "current [A]" not in drawn
    assert "current [A]" in str(_before_after_traces([replace(shown, units={})]))
