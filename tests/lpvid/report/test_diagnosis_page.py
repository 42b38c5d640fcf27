"""The page of a diagnosis: what it advises."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.toy_diagnosis import Bent, Dry, Zero, drive, record

from lpvid.diagnosis.evidence.engine import diagnose
from lpvid.diagnosis.task import DiagnosisTask
from lpvid.effects.preparing import PreparedRecords
from lpvid.plot.diagnosis import BeforeAfter, close_up, error_maps, error_shapes
from lpvid.plot.style import figure_of
from lpvid.record import Record
from lpvid.report.diagnosis import _before_after_traces, _parts, _steps, diagnosis_page


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
    assert ("Repeat the run" in page.steps[0].text) is (mark == "warn")
    assert "record what else" not in page.steps[0].text


@pytest.mark.seconds
def test_an_error_that_repeats_asks_for_a_channel_that_was_not_recorded():
    rng = np.random.default_rng(4)
    u, load = drive(3000, rng), 0.35 * drive(3000, rng)
    records = [record(rng, "ar1", 0.4, u=u, hidden=lambda _: load) for _ in range(2)]
    found = diagnose(records, Bent(), [Zero()])
    page = diagnosis_page(found, DiagnosisTask(PreparedRecords(tuple(records), (), ()), Bent(), True, (Zero(),),
                                               tuple(records)))
    low, high = found.noise["repeating"]
    assert page.mark == "bad" and "record what else is the same in every run" in page.steps[0].text
    assert f"an error of {low:.3g} to {high:.3g} V repeats" in str(page)


def test_the_time_traces_have_the_unit_of_the_channel():
    """A voltage that stands for the current is in V."""
    t = np.arange(400) / 500.0
    v, current = np.sin(9 * t), 1.0 + np.sin(t)
    units = {"velocity": "m/s", "current": "V"}
    channels = {"velocity": v, "current": current}
    shown = BeforeAfter("run", "held-out", 0.002, channels, 900 * v, 800 * v, 890 * v, "force", "N", units)
    drawn = str(_before_after_traces([shown]))
    assert "voltage [V]" in drawn and "current" not in drawn
    for axes in (error_maps([shown], True), error_shapes([shown], True), close_up([shown], True)):
        words = [text for ax in figure_of(axes).axes for text in (ax.get_xlabel(), ax.get_ylabel())]
        assert "voltage [V]" in words and not any("current" in text for text in words)
    assert "current [A]" in str(_before_after_traces([replace(shown, units={})]))


def test_a_diagnosis_ends_in_commands_that_can_be_run():
    """The planned experiment on the virtual rig, the extended model on other records; what no run settles in words."""
    steps = _steps(SimpleNamespace(rivals=()), "Use it.", ("experiment.toml holds the plan: a sweep", "read the cell."),
                   True)
    assert [(s.text, s.command) for s in steps] == [
        ("Use it.", ""),
        ("experiment.toml holds the plan: a sweep.", "quartercar rig OUT/experiment.toml --out records"),
        ("read the cell.", ""), ("Judge the extended model on records that this diagnosis has not seen.",
                                 "lpvid validate OUT/extended_model.json NEW.csv --out checked")]
    rivals = (SimpleNamespace(names=("coil-lag", "command-delay"), experiment="steps of the current"),)
    assert [s.text for s in _steps(SimpleNamespace(rivals=rivals), "Wait.", (), False)] == [
        "Wait.", "coil-lag or command-delay: steps of the current."]


def test_captions_of_a_diagnosis_state_the_data():
    shown = [SimpleNamespace(label=label) for label in ("training", "training", "held-out")]
    assert _parts(shown) == ", training and held-out data,"
