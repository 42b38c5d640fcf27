"""What a column of time stamps says about the clock."""

from __future__ import annotations

import time as wall

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lpvid.condition.tables import as_records
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.timebase import analyse_time, calendar_seconds


def to_digits(values: np.ndarray, significant: int) -> np.ndarray:
    return np.array([float(f"{v:.{significant}g}") for v in values])


@pytest.mark.parametrize("period", [0.01, 1 / 3, 1 / 3004.8, 1e-6, 3600.0])
def test_an_exact_clock_is_uniform(period: float) -> None:
    base = analyse_time(5.0 + period * np.arange(1000))
    assert base.uniform
    assert base.period == pytest.approx(period, rel=1e-9)
    assert base.jitter_rms < 1e-6


@pytest.mark.seconds
@settings(deadline=None)
@given(period=st.floats(1e-3, 10.0), decimals=st.integers(3, 9), start=st.floats(0.0, 100.0))
def test_rounded_print_of_a_uniform_clock_is_uniform(period: float, decimals: int, start: float) -> None:
    stamps = np.round(start + period * np.arange(300), decimals)
    base = analyse_time(stamps)
    assert base.uniform
    assert base.period == pytest.approx(period, abs=0.6 * 10.0**-decimals / 10 + 1e-9 * period)


def test_six_significant_digits_coarsen_with_time_and_stay_uniform() -> None:
    stamps = to_digits(np.arange(40_000) / 300.0, 6)
    base = analyse_time(stamps)
    assert base.uniform
    assert base.rounded
    assert base.period == pytest.approx(1 / 300, rel=1e-6)
    assert base.jitter_rms > 0.01  # without the rounding test this clock would have looked unsteady


def test_stamps_stored_in_single_precision_are_uniform() -> None:
    stamps = (np.arange(300_000) * 0.01).astype(np.float32).astype(float)
    base = analyse_time(stamps)
    assert base.uniform
    assert base.period == pytest.approx(0.01, rel=1e-6)


@pytest.mark.parametrize("jitter", [0.03, 0.1, 0.3])
def test_real_jitter_is_not_taken_for_rounding(jitter: float, rng: np.random.Generator) -> None:
    exact = 0.01 * np.arange(2000)
    deviation = 0.01 * jitter * rng.standard_normal(2000)
    base = analyse_time(np.round(np.sort(exact + deviation), 6))
    assert not base.rounded
    assert not base.uniform
    steps = np.diff(np.sort(exact + deviation)) / 0.01  # oracle: rms about 1 of all steps: nothing is missing
    assert base.jitter_rms == pytest.approx(np.sqrt(np.mean((steps - 1) ** 2)), rel=0.02)
    assert not base.gaps


@pytest.mark.parametrize("period, jitter", [(1 / 250, 0.2), (1e-3, 0.2), (0.01, 0.25)])
@pytest.mark.parametrize("missing", [(), (100,), (333, 700, 1200)])
def test_jitter_and_missing_rows_are_kept_apart(period: float, jitter: float, missing: tuple[int, ...],
                                          rng: np.random.Generator) -> None:
    """A long interval is a gap where the stamps behind it stay late; the period is that of the clock."""
    kept = np.delete(np.arange(1500), missing)
    base = analyse_time(np.sort(period * (7 + kept + jitter * rng.standard_normal(kept.size))))
    assert base.gaps == tuple(row - i for i, row in enumerate(missing))
    assert base.period == pytest.approx(period, rel=4 * jitter * np.sqrt(2) / 1500)


def test_one_late_stamp_is_no_gap_and_does_not_move_the_period() -> None:
    stamps = 0.01 * np.arange(500)
    stamps[200] += 0.007
    base = analyse_time(stamps)
    assert not base.gaps and base.period == pytest.approx(0.01, rel=1e-9)


@pytest.mark.parametrize("every", [5, 10, 20])
def test_rows_missing_again_and_again_are_gaps(every: int) -> None:
    kept = np.arange(1000)[np.arange(1000) % every != every - 1]
    base = analyse_time(kept / 300.1)
    assert len(base.gaps) == 1000 // every - 1 and base.period == pytest.approx(1 / 300.1)


def test_intervals_that_vary_by_themselves_are_not_called_late_stamps(rng: np.random.Generator) -> None:
    """Their jitter adds up: an interval above 1.5 periods is not taken back behind it, and stays a gap."""
    steps = rng.uniform(0.4, 1.6, 2000)
    base = analyse_time(0.01 * np.cumsum(steps))
    assert len(base.gaps) == np.count_nonzero(steps[1:] > 1.5 * np.median(steps[1:]))


def test_small_jitter_is_within_the_limit() -> None:
    rng = np.random.default_rng(3)
    base = analyse_time(0.01 * (np.arange(2000) + 0.004 * rng.standard_normal(2000)))
    assert base.uniform
    assert 0 < base.jitter_rms < 0.01


@pytest.mark.seconds
@settings(deadline=None)
@given(
    n=st.integers(20, 400),
    share=st.floats(0.1, 0.9),
    missing=st.integers(1, 5),
    period=st.sampled_from([0.01, 0.002, 1 / 3, 0.0125]),
    decimals=st.sampled_from([3, 4, None]),
)
def test_missing_rows_are_a_gap_wherever_they_are(
    n: int, share: float, missing: int, period: float, decimals: int | None
) -> None:
    stamps = period * np.arange(n + missing)
    stamps = stamps if decimals is None else np.round(stamps, decimals)
    at = max(1, min(int(share * n), n - 1))
    base = analyse_time(np.delete(stamps, np.arange(at, at + missing)))
    assert base.gaps == (at,)
    assert not base.uniform


def test_a_missing_row_in_stamps_printed_to_one_period_is_a_gap() -> None:
    stamps = np.round(0.01 * np.arange(1000), 2)
    base = analyse_time(np.delete(stamps, 500))
    assert base.gaps == (500,)
    assert base.period == pytest.approx(0.01)


def test_a_repeated_row_in_stamps_printed_to_one_period_is_a_duplicate() -> None:
    stamps = np.round(0.01 * np.arange(1000), 2)
    base = analyse_time(np.insert(stamps, 500, stamps[500]))
    assert base.duplicates == (501,)
    assert not base.orderly
    assert base.period == pytest.approx(0.01)


def test_a_slow_clock_printed_to_one_period_is_rounding_not_many_gaps() -> None:
    base = analyse_time(np.round(0.0103 * np.arange(1000), 2))
    assert base.uniform
    assert base.period == pytest.approx(0.0103, rel=1e-4)


def test_a_fast_clock_printed_too_coarsely_is_rounding_not_many_duplicates() -> None:
    base = analyse_time(np.round(0.007 * np.arange(1000), 2))
    assert base.uniform
    assert base.period == pytest.approx(0.007, rel=1e-3)


def test_backward_time_and_duplicates_are_named_by_row() -> None:
    base = analyse_time(np.array([0.0, 0.1, 0.2, 0.2, 0.3, 0.25, 0.35, 0.45]))
    assert base.duplicates == (3,)
    assert base.backward == (5,)
    assert not base.orderly


def test_stamps_that_are_no_numbers_are_named_by_row() -> None:
    base = analyse_time(np.array([0.0, np.nan, 0.2, np.inf]))
    assert base.invalid == (1, 3)
    assert not base.uniform
    assert not base.orderly


@pytest.mark.parametrize("stamps", [[], [1.0], [1.0, 1.0], [2.0, 1.0], [np.nan, np.nan]])
def test_too_little_time_is_no_clock(stamps: list[float]) -> None:
    assert not analyse_time(np.array(stamps, dtype=float)).uniform


@pytest.mark.parametrize("period", [1e-3, 1 / 3000, 1e-4])
def test_epoch_seconds_do_not_hide_a_fast_clock(period: float) -> None:
    base = analyse_time(1.7e9 + period * np.arange(20_000))
    assert base.uniform
    assert base.period == pytest.approx(period, rel=1e-6)
    gapped = np.delete(1.7e9 + period * np.arange(20_000), np.arange(7000, 7010))
    assert analyse_time(gapped).gaps == (7000,)


def test_a_million_stamps_take_no_time() -> None:
    stamps = np.arange(1_000_000) / 3004.8
    began = wall.perf_counter()
    assert analyse_time(stamps).uniform
    assert wall.perf_counter() - began < 2.0


@pytest.mark.seconds
@given(shift=st.floats(-1e4, 1e4), scale=st.floats(1e-3, 1e3))
def test_shift_and_unit_of_time_change_no_verdict(shift: float, scale: float) -> None:
    steps = np.array([1.0] * 10 + [3.0] + [1.0] * 10)
    stamps = np.concatenate([[0.0], np.cumsum(steps)])
    base = analyse_time(shift + scale * stamps)
    assert base.gaps == (11,)
    assert base.period == pytest.approx(scale, rel=1e-5)


@pytest.mark.parametrize("dtype, said", [("datetime64[M]", "months"), ("datetime64[Y]", "years"),
                                         ("timedelta64[M]", "months"), ("timedelta64", "numbers of no unit")])
def test_units_without_a_fixed_length_are_refused(dtype, said):
    time = np.arange(5).astype(dtype)
    for give in (lambda: Record({"x": np.arange(5.0)}, time=time),
                 lambda: as_records({"time": time, "x": np.arange(5)})):
        with pytest.raises(InputError, match=f"unit of fixed length: got {said}") as refused:
            give()
        assert "\n" not in str(refused.value)


def test_weeks_have_a_fixed_length():
    np.testing.assert_array_equal(calendar_seconds(np.arange(3).astype("datetime64[W]")), 604800.0 * np.arange(3))
