"""Conditioning: cut, resample, filter, differentiate, align, split."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lpvid.condition import (
    align,
    blocks,
    delay,
    differentiate,
    folds,
    leaks,
    low_pass,
    repetition_period,
    resample,
    segments,
    split_tail,
    with_velocity,
)
from lpvid.errors import InputError
from lpvid.files import read
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
    with pytest.raises(InputError, match=r"got 3 samples in the longest; 10 are needed") as caught:
        segments(record, "u", minimum=10)
    assert "order" not in str(caught.value)
    with pytest.raises(InputError, match="Mend: a longer record, a lower order, or fewer"):
        segments(record, "u", minimum=10, remedy="a lower order")
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


# -- filter -----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("damping", "numerator", "denominator"),
    [  # equation (4.5) of the thesis at 20 Hz, 512 Hz sampling: both damping values worked out by hand
        (np.sqrt(0.5), [0.02678571, 0.02385608], [1, -1.6560927, 0.70673449]),
        (1.0, [0.02561669, 0.02174933], [1, -1.56472526, 0.61209128]),
    ],
)
def test_the_causal_filter_has_the_published_difference_equation(
    damping: float, numerator: list[float], denominator: list[float]
) -> None:
    impulse = np.zeros(60)
    impulse[1] = 1.0
    record = Record({"x": impulse}, sample_time=1 / 512)
    h = low_pass(record, 20.0, damping=damping, zero_phase=False)["x"][1:]
    expected = np.zeros(59)
    for i in range(59):
        expected[i] = sum(b for j, b in enumerate(numerator, start=1) if i == j)
        expected[i] -= sum(denominator[j] * expected[i - j] for j in (1, 2) if i >= j)
    np.testing.assert_allclose(h, expected, atol=1e-6)


def test_butterworth_gain_and_phase() -> None:
    t = np.arange(4096) / 512
    tone = np.sin(2 * np.pi * 20 * t)
    record = Record({"x": tone, "step": np.full(4096, 3.0)}, sample_time=1 / 512)
    both_ways = low_pass(record, 20.0)
    inner = slice(500, -500)
    np.testing.assert_allclose(both_ways["x"][inner], 0.5 * tone[inner], atol=1e-4)
    np.testing.assert_allclose(both_ways["step"], 3.0, rtol=1e-9)
    once = low_pass(record, 20.0, zero_phase=False, channels=["x"])
    assert np.sqrt(2 * np.mean(once["x"][inner] ** 2)) == pytest.approx(np.sqrt(0.5), rel=1e-3)
    assert "on x" in once.notes[-1]
    with pytest.raises(InputError, match="half the sampling rate"):
        low_pass(record, 256.0)


def test_filtering_leaves_missing_samples_missing() -> None:
    x = np.sin(np.arange(200) / 10)
    x[90:95] = NAN
    out = low_pass(Record({"x": x}, sample_time=0.01), 5.0)["x"]
    assert np.flatnonzero(np.isnan(out)).tolist() == [90, 91, 92, 93, 94]


# -- differentiate ----------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("method", "error"), [("savitzky-golay", 1e-9), ("central", 2e-3), ("backward", 0.09)])
def test_derivative_of_a_quartic(method: str, error: float) -> None:
    t = np.arange(100) * 0.01
    slope = differentiate(t**4, 0.01, method=method)
    assert np.abs(slope - 4 * t**3).max() < error


def test_a_backward_difference_lags_half_a_sample() -> None:
    t = np.arange(1000) * 0.01
    slope = differentiate(np.sin(t), 0.01, method="backward")
    np.testing.assert_allclose(slope[1:], np.cos(t - 0.005)[1:], atol=1e-5)


def test_velocity_is_derived_once_and_said_so() -> None:
    t = np.concatenate((np.arange(60), np.arange(80, 120))) * 0.01
    x = np.sin(3 * t)
    x[20] = NAN
    record = with_velocity(Record({"displacement": Channel(x, "m")}, time=t))
    good = np.isfinite(record["velocity"])
    assert np.flatnonzero(~good).tolist() == [20]
    np.testing.assert_allclose(record["velocity"][good], 3 * np.cos(3 * t[good]), atol=3e-5)
    assert record.unit("velocity") == "m/s"
    assert "derived" in record.notes[-1]
    assert with_velocity(record) is record


# -- delay, align -----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("true", [-0.0137, 0.0, 0.004, 0.0321])
@pytest.mark.parametrize("gain", [2.0, -0.5])
def test_delay_is_found_to_a_hundredth_of_a_sample(true: float, gain: float, rng: np.random.Generator) -> None:
    t = np.arange(1500) * 0.01
    tones = [(rng.uniform(0.2, 12), rng.uniform(0, 6)) for _ in range(12)]
    x = sum(np.sin(2 * np.pi * f * t + p) for f, p in tones)
    y = gain * sum(np.sin(2 * np.pi * f * (t - true) + p) for f, p in tones) + 4 + 0.01 * rng.normal(size=t.size)
    assert delay(x, y, 0.01, 0.1) == pytest.approx(true, abs=1e-4)


def test_delay_of_a_few_sine_periods_is_not_biased_by_the_ends() -> None:
    t = np.arange(400) * 0.01
    assert delay(np.sin(2 * np.pi * t), np.sin(2 * np.pi * (t - 0.033)), 0.01, 0.2) == pytest.approx(0.033, abs=1e-5)


def test_align_takes_out_a_fraction_of_a_sample() -> None:
    t = np.arange(800) * 0.01
    record = Record({"a": np.sin(7 * t), "b": np.sin(7 * (t - 0.0264))}, sample_time=0.01)
    mended = align(record, "b", 0.0264)
    assert mended.n_samples == 797
    np.testing.assert_allclose(mended["b"][30:-30], mended["a"][30:-30], atol=1e-4)
    back = align(record, "a", -0.0264)
    np.testing.assert_allclose(back["b"][30:-30], back["a"][30:-30], atol=1e-4)
    assert back.start == pytest.approx(0.03)


# -- split ------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("n", [3, 10, 36057, 36056, 2001])
def test_the_last_third_starts_at_floor_two_thirds(n: int) -> None:
    training, held_out = split_tail(Record({"x": np.arange(float(n))}, sample_time=0.1))
    assert training.n_samples == (2 * n) // 3
    assert training.n_samples + held_out.n_samples == n
    assert held_out["x"][0] == (2 * n) // 3


def test_blocks_stand_apart() -> None:
    parts = blocks(Record({"x": np.arange(100.0)}, sample_time=0.1, name="r"), 2.0, gap=0.5)
    assert [p["x"][0] for p in parts] == [0, 25, 50, 75]
    assert {p.n_samples for p in parts} == {20}
    assert parts[1].start == pytest.approx(2.5)


def test_folds_hold_every_sample_out_once_and_keep_their_distance() -> None:
    record = Record({"x": np.arange(97.0)}, sample_time=0.1)
    held = []
    for training, held_out in folds(record, 4, 0.3):
        kept = np.concatenate([p["x"] for p in training])
        out = np.concatenate([p["x"] for p in held_out])
        assert np.abs(kept[:, None] - out[None, :]).min() == 4
        held.append(out)
    np.testing.assert_array_equal(np.sort(np.concatenate(held)), np.arange(97.0))


def _road(rng: np.random.Generator, noise: float = 0.0) -> Record:
    """A pattern of 5 s that comes back with changed sign: x(t + 5) = -x(t)."""
    spectrum = np.zeros(251, dtype=complex)
    spectrum[1:60] = rng.normal(size=59) + 1j * rng.normal(size=59)
    pattern = np.fft.irfft(spectrum, 500) / 0.05
    x = np.tile(np.concatenate((pattern, -pattern)), 3)
    return Record({"x": x + noise * x.std() * rng.normal(size=x.size)}, sample_time=0.01, name="road")


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_repetition_is_found_with_its_sign(noise: float, rng: np.random.Generator) -> None:
    found = repetition_period(_road(rng, noise)["x"], 0.01)
    assert found is not None
    assert found.sign == -1
    assert found.seconds == pytest.approx(5.0, abs=2e-3)
    assert found.residual == pytest.approx(noise, rel=0.1, abs=1e-6)


def test_noise_and_filtered_noise_do_not_repeat(rng: np.random.Generator) -> None:
    white = rng.normal(size=3000)
    assert repetition_period(white, 0.01) is None
    smooth = np.convolve(white, np.hanning(61), mode="valid")
    assert repetition_period(smooth, 0.01) is None
    assert repetition_period(np.linspace(0, 1, 500), 0.01) is None


def test_a_period_between_two_samples_is_found() -> None:
    t = np.arange(2000) * 0.01
    found = repetition_period(np.sin(2 * np.pi * 1.37 * t), 0.01)
    assert found is not None
    assert found.seconds == pytest.approx(0.5 / 1.37, rel=2e-3)
    assert found.sign == -1


def test_time_blocks_of_a_repeating_road_leak_and_pattern_folds_do_not(rng: np.random.Generator) -> None:
    record = _road(rng)
    training, held_out = split_tail(record)
    share = leaks(training, held_out, "x")
    assert share == pytest.approx(1.0)
    for inside, outside in folds(record, 4, period=5.0):
        assert leaks(inside, outside, "x", window=0.5) is None
    fresh = Record({"x": np.convolve(rng.normal(size=3000), np.hanning(21), mode="same")}, sample_time=0.01)
    assert leaks(*split_tail(fresh), "x") is None


def test_a_rate_that_is_the_record_s_own_changes_no_sample(rng: np.random.Generator) -> None:
    record = Record({"x": rng.normal(size=500)}, sample_time=1 / 3004.81)
    same = resample(record, 3004.8)
    np.testing.assert_array_equal(same["x"], record["x"])
    assert same.sample_time == 1 / 3004.8
    assert same.notes == ()


# -- real measurements ------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_sines_of_two_rates_come_out_at_one(shared_data: Path) -> None:
    records = read(shared_data / "mr_damper_sines")
    with pytest.raises(InputError, match="--sample-rate 200"):
        segments(records, ["velocity", "force"])
    pieces = segments(records, ["velocity", "force"], sample_rate=200.0)
    assert len(pieces) == 24
    assert {p.sample_time for p in pieces} == {0.005}
    fast = next(r for r in records if r.name == "10mm1Hz1A")
    slow = next(p for p in pieces if p.name == "10mm1Hz1A")
    np.testing.assert_allclose(slow["displacement"][10:-10], fast["displacement"][::5][10:-10], atol=2e-6)


def test_random_damper_at_a_sixth_of_its_rate_and_its_unknown_unit(shared_data: Path) -> None:
    records = read(shared_data / "mr_damper_random")
    (piece,) = segments(records, ["velocity", "force"], sample_rate=500.8)
    assert piece.n_samples == 6010
    assert abs(piece["force"].mean() - records[0]["force"].mean()) < 1.0
    with pytest.raises(InputError, match="'acceleration': unknown unit: got 'raw'"):
        segments(records, ["acceleration", "force"])


# -- slips of the hand ----------------------------------------------------------------------------------------------
def test_a_rate_that_is_a_slip_is_refused_before_any_memory_is_taken() -> None:
    record = Record({"x": np.arange(3000.0)}, sample_time=0.002, name="run")
    with pytest.raises(InputError, match=r"'run' cannot be resampled to 1e\+09 Hz: got 6e\+09 samples .*lower rate"):
        resample(record, 1e9)


def test_a_rate_so_low_that_one_sample_is_left_is_quick() -> None:
    """The one sample is the local mean; of a constant it is that constant."""
    left = resample(Record({"x": np.full(3000, 2.5)}, sample_time=0.002), 0.1)
    assert left.n_samples == 1
    assert left["x"][0] == pytest.approx(2.5)


def test_a_split_that_leaves_nothing_names_the_record() -> None:
    with pytest.raises(InputError, match=r"record 'run' cannot be split.*got 0\.9999 of 30 samples.*another share"):
        split_tail(Record({"x": np.arange(30.0)}, sample_time=0.1, name="run"), 0.9999)


def test_the_derivative_of_a_constant_is_exactly_zero():
    """A filter's rounding would count as motion: 0.1 is no binary number."""
    x = np.full(400, 0.1)
    x[100] = np.nan
    for method in ("savitzky-golay", "central", "backward"):
        slope = differentiate(x, 0.002, method=method)
        assert np.flatnonzero(np.isnan(slope)).tolist() == [100] and not np.any(slope[np.isfinite(slope)])


def test_a_rate_above_the_recorded_one_gains_nothing_and_the_note_says_so(rng: np.random.Generator) -> None:
    record = Record({"x": rng.normal(size=400)}, sample_time=0.001)
    faster, slower = resample(record, 20_000.0), resample(record, 500.0)
    assert "nothing was recorded above 500 Hz, 20 samples stand for one that was measured" in faster.notes[-1]
    assert "nothing was recorded" not in slower.notes[-1]


def test_a_cut_names_what_it_was_made_at() -> None:
    time = np.where(np.arange(60) < 30, 0.01 * np.arange(60), 0.01 * np.arange(60) + 1.0)
    whole, holed = np.arange(60.0), np.arange(60.0)
    holed[10] = NAN
    for values, stamps, stated in ((whole, time, "2 pieces at 1 time gap"), (holed, time, "3 pieces at missing samples "
                                   "and 1 time gap"), (holed, 0.01 * np.arange(60), "2 pieces at missing samples")):
        first, *_ = segments(Record({"u": values}, time=stamps), "u")
        assert f"cut into {stated}" in first.notes
