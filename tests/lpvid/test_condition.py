"""Conditioning: cut, resample, filter, differentiate, align, split."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.condition import resample, segments
from lpvid.errors import InputError
from lpvid.record import Channel, Record

NAN = np.nan


# -- segments ---------------------------------------------------------------------------------------------------
def test_a_clean_record_passes_whole() -> None:
    record = Record({"u": np.arange(5.0), "y": np.arange(5.0)}, sample_time=0.5, name="run")
    (piece,) = segments(record, ["u", "y"])
    assert piece.name == "run"
    assert piece.notes == ()
    assert piece.sample_time == 0.5
    np.testing.assert_array_equal(piece["u"], record["u"])


def test_nan_in_a_channel_in_use_splits_and_elsewhere_does_not() -> None:
    record = Record({"u": [1, 2, NAN, 4, 5, 6], "idle": [NAN] * 6}, sample_time=0.1, name="run")
    first, second = segments(record, "u")
    assert (first.name, second.name) == ("run#1", "run#2")
    assert second["u"].tolist() == [4, 5, 6]
    assert second.start == pytest.approx(0.3)
    assert np.isnan(second["idle"]).all()
    (longer,) = segments(record, "u", minimum=3)
    assert longer["u"].tolist() == [4, 5, 6]
    assert any("2 samples from 0 s" in note for note in longer.notes)


def test_a_time_gap_splits_and_both_pieces_keep_the_clock() -> None:
    time = np.concatenate((np.arange(10), np.arange(20, 26))) * 0.01
    pieces = segments(Record({"u": np.arange(16.0)}, time=time, name="g"), "u")
    assert [p.n_samples for p in pieces] == [10, 6]
    assert [p.start for p in pieces] == pytest.approx([0.0, 0.2])
    assert all(p.sample_time == pytest.approx(0.01) for p in pieces)


def test_a_role_names_a_channel() -> None:
    record = Record({"F_cell": [1.0, NAN, 3.0, 4.0]}, sample_time=0.1, roles={"force": "F_cell"})
    assert [p.n_samples for p in segments(record, "force", minimum=1)] == [1, 2]


@pytest.mark.parametrize(
    ("channel", "words"),
    [
        (Channel(np.array([1.0, np.inf, 2.0]), "N"), ["row 2", "inf", "'bad'"]),
        (Channel(np.array([1.0, NAN, 2.0]), "N", fault="text 'abc' in row 2"), ["abc", "'bad'"]),
        (Channel(np.array([1.0, 2.0, 3.0]), "", source_unit="raw", unit_known=False), ["unknown unit", "raw"]),
    ],
)
def test_a_fault_ends_only_where_the_channel_is_in_use(channel: Channel, words: list[str]) -> None:
    record = Record({"good": np.arange(3.0), "bad": channel}, sample_time=0.1, name="run7")
    with pytest.raises(InputError) as caught:
        segments(record, ["good", "bad"])
    for word in [*words, "run7"]:
        assert word in str(caught.value)
    assert segments(record, "good")[0].n_samples == 3


@pytest.mark.parametrize(
    ("time", "words"),
    [
        ([0, 0.1, 0.2, 0.15, 0.3], ["backward", "row 4"]),
        ([0, 0.1, 0.2, 0.2, 0.3], ["repeats", "row 4"]),
        ([0, 0.1, NAN, 0.3, 0.4], ["not a finite number", "row 3"]),
    ],
)
def test_disorderly_time_is_refused_by_row(time: list[float], words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        segments(Record({"u": np.arange(5.0)}, time=np.array(time), name="r"), "u")
    for word in words:
        assert word in str(caught.value)


def test_jitter_needs_a_rate_and_gets_one(rng: np.random.Generator) -> None:
    time = np.arange(2000) / 200 + rng.uniform(-0.1, 0.1, 2000) / 200
    record = Record({"x": np.sin(2 * np.pi * 3 * time)}, time=time)
    with pytest.raises(InputError, match="--sample-rate 200"):
        segments(record, "x")
    (piece,) = segments(record, "x", sample_rate=100.0)
    assert piece.sample_time == 0.01
    inner = slice(30, -30)
    np.testing.assert_allclose(piece["x"][inner], np.sin(2 * np.pi * 3 * piece.times[inner]), atol=1e-3)


def test_records_of_different_rates_need_one() -> None:
    fast = Record({"u": np.ones(400)}, sample_time=0.01, name="fast")
    slow = Record({"u": np.ones(200)}, sample_time=0.02, name="slow")
    with pytest.raises(InputError, match="100 Hz in 'fast', 50 Hz in 'slow'"):
        segments([fast, slow], "u")
    assert [p.n_samples for p in segments([fast, slow], "u", sample_rate=50.0)] == [200, 200]
    near = Record({"u": np.ones(300)}, sample_time=0.010005, name="near")
    periods = {p.sample_time for p in segments([fast, near], "u")}
    assert len(periods) == 1
    assert 0.01 < periods.pop() < 0.010005


def test_nothing_left_says_how_long_the_longest_was() -> None:
    record = Record({"u": [1, 2, NAN, 4, 5, 6, NAN]}, sample_time=0.1)
    with pytest.raises(InputError, match=r"longest has 3 samples; 10 are needed"):
        segments(record, "u", minimum=10)
    with pytest.raises(InputError, match="too few rows"):
        segments(Record({"u": [1.0]}, sample_time=0.1), "u")


# -- resample ---------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("rate", [100.0, 137.0, 600.0])
@pytest.mark.parametrize("share", [0.05, 0.2, 0.4])
def test_tones_in_the_passband_are_kept(rate: float, share: float) -> None:
    tone = share * min(rate, 300.0)
    x = np.sin(2 * np.pi * tone * np.arange(3000) / 300 + 0.3)
    slow = resample(Record({"x": x}, sample_time=1 / 300), rate)
    expected = np.sin(2 * np.pi * tone * slow.times + 0.3)
    inner = slice(100, -100)
    assert np.abs(slow["x"] - expected)[inner].max() < 1e-3
    assert slow.times[-1] <= 2999 / 300 + 1e-9


@pytest.mark.parametrize("rate", [100.0, 137.0])
@pytest.mark.parametrize("share", [0.5, 0.6, 0.9])
def test_tones_above_the_new_nyquist_frequency_do_not_fold(rate: float, share: float) -> None:
    x = np.sin(2 * np.pi * share * rate * np.arange(3000) / 300 + 0.3)
    slow = resample(Record({"x": x}, sample_time=1 / 300), rate)
    assert np.abs(slow["x"][100:-100]).max() < 0.01


@pytest.mark.parametrize("rate", [50.0, 77.7, 300.0, 1000.0])
def test_a_constant_and_a_ramp_stay_what_they_are(rate: float) -> None:
    ramp = np.linspace(-1, 2, 900)
    new = resample(Record({"one": np.ones(900), "ramp": ramp}, sample_time=1 / 300), rate)
    np.testing.assert_allclose(new["one"], 1.0, atol=1e-12)
    np.testing.assert_allclose(new["ramp"], np.interp(new.times, np.arange(900) / 300, ramp), atol=1e-4)


def test_a_whole_ratio_keeps_the_grid_and_missing_samples_stay_missing() -> None:
    x = np.ones(60)
    x[30:33] = NAN
    slow = resample(Record({"x": x}, sample_time=1 / 60), 20.0)
    assert slow.n_samples == 20
    assert np.flatnonzero(np.isnan(slow["x"])).tolist() == [10]
    assert any("60 Hz to 20 Hz" in note for note in slow.notes)
