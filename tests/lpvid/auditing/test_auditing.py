"""The audit: every check on data with the fault put in, and on the clean twin."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import butter, lfilter, sosfilt

from lpvid.auditing import Audit, audit, record_remarks, reversed_polarity
from lpvid.auditing.coherence import input_coherence
from lpvid.auditing.spectrum import follows
from lpvid.auditing.view import view
from lpvid.condition import low_pass, segments
from lpvid.errors import InputError
from lpvid.files import read
from lpvid.record import Channel, Record

NAN = np.nan
PERIOD = 0.005
N = 4000


def clean(seed: int = 5, n: int = N, name: str = "clean", period: float = PERIOD) -> Record:
    """A damper on a rig: 14 tones up to 18 Hz, a wandering current, dissipative force, 0.3 % noise."""
    rng = np.random.default_rng(seed)
    t = period * np.arange(n)
    displacement, velocity, current = np.zeros(n), np.zeros(n), np.full(n, 1.2)
    for f in rng.uniform(0.3, 18, 14):
        phase, amplitude = rng.uniform(0, 6.28), 0.01 / f
        displacement += amplitude * np.sin(2 * np.pi * f * t + phase)
        velocity += 2 * np.pi * f * amplitude * np.cos(2 * np.pi * f * t + phase)
    for f in rng.uniform(0.2, 6, 5):
        current += 0.2 * np.sin(2 * np.pi * f * t + rng.uniform(0, 6.28))
    force = 200 * (1 + current) * np.tanh(velocity / 0.1) + 800 * velocity
    noisy = {
        "displacement": Channel(displacement + 2e-6 * rng.normal(size=n), "m", "m"),
        "velocity": Channel(velocity + 1e-3 * rng.normal(size=n), "m/s", "m/s"),
        "current": Channel(current, "A", "A"),
        "force": Channel(force + 2.0 * rng.normal(size=n), "N", "N"),
    }
    return Record(noisy, sample_time=period, name=name)


def change(record: Record, channel: str, fault: Callable[[np.ndarray], np.ndarray]) -> Record:
    """The record with one channel replaced by a function of itself."""
    return record.with_channel(channel, fault(record[channel].copy()), record.unit(channel))


def restamped(time: np.ndarray) -> Record:
    record = clean(n=time.size)
    return Record(record.channels, time=time, name="stamped")


def only(found: Audit, name: str) -> tuple[str, str]:
    """(severity, channel) of the one finding of this name."""
    (finding,) = found.of(name)
    assert finding.evidence
    return finding.severity, finding.channel


def set_at(rows: slice | int, value: float) -> Callable[[np.ndarray], np.ndarray]:
    def fault(x: np.ndarray) -> np.ndarray:
        x[rows] = value
        return x

    return fault


@pytest.mark.parametrize("seed", range(5))
def test_a_clean_record_is_clean(seed: int) -> None:
    found = audit(clean(seed))
    assert found.clean, str(found)
    assert "nothing against" in found.verdict


def test_clean_excitations_of_other_shapes_are_clean(rng: np.random.Generator) -> None:
    t = PERIOD * np.arange(N)
    two_levels = np.repeat(rng.integers(0, 2, 100), 40).astype(float) * 2.0
    for phase in (np.sin(2 * np.pi * 1.7 * t), 2 / np.pi * np.arcsin(np.sin(2 * np.pi * 0.7 * t))):
        velocity = np.gradient(0.02 * phase, PERIOD)
        force = 900 * np.tanh(velocity / 0.05) * (1 + two_levels) + rng.normal(size=N)
        found = audit(Record({"displacement": 0.02 * phase, "current": two_levels, "force": force},
                             sample_time=PERIOD, units={"displacement": "m", "current": "A", "force": "N"}))
        assert found.clean, str(found)


# -- clock ------------------------------------------------------------------------------------------------------
def test_clock_faults() -> None:
    grid = PERIOD * np.arange(N)
    rng = np.random.default_rng(2)
    assert only(audit(restamped(grid + rng.uniform(-0.1, 0.1, N) * PERIOD)), "jitter") == ("fault", "")
    gap = audit(restamped(np.where(np.arange(N) < 2000, grid, grid + 0.5)))
    assert only(gap, "time-gaps") == ("warning", "")
    assert gap.of("time-gaps")[0].value == pytest.approx(0.5)
    repeated, backward, invalid = grid.copy(), grid.copy(), grid.copy()
    repeated[1000], backward[1000], invalid[1000] = grid[999], grid[990], NAN
    for stamps, name in ((repeated, "duplicate-time"), (backward, "backward-time"), (invalid, "invalid-time")):
        found = audit(restamped(stamps))
        assert only(found, name) == ("fault", "")
        assert "row 1001" in found.of(name)[0].evidence


def test_what_resampling_mends_is_a_note_and_the_rest_is_found_on_a_uniform_clock() -> None:
    jittered = PERIOD * np.arange(N) + np.random.default_rng(2).uniform(-0.1, 0.1, N) * PERIOD
    jittered[2000:] += 0.5
    record = restamped(jittered)
    turned = change(record, "force", lambda force: -force)
    assert not audit(turned).of("reversed-polarity")
    found = audit(turned, sample_rate=100.0)
    assert only(found, "jitter")[0] == "note"
    assert found.of("jitter")[0].mend == "mended: a uniform clock by --sample-rate 100"
    assert only(found, "time-gaps")[0] == "warning"
    assert only(found, "reversed-polarity") == ("warning", "force")
    assert not [f for f in audit(record, sample_rate=100.0).findings if f.severity == "fault"]
    assert len(found.findings) == len(set(found.findings))
    with pytest.raises(InputError, match="sample_rate"):
        audit(record, sample_rate=-1.0)


def test_a_jittered_record_of_reversed_polarity_is_marked() -> None:
    jittered = PERIOD * np.arange(N) + np.random.default_rng(2).uniform(-0.1, 0.1, N) * PERIOD
    record = restamped(jittered)
    assert not reversed_polarity([record])
    assert reversed_polarity([change(record, "force", lambda force: -force)])


@pytest.mark.seconds
def test_oversampled_is_mended_by_a_rate_as_low_as_it_asks_for() -> None:
    fast = clean(period=1 / 3000, n=15000)
    plain, = audit(fast).of("oversampled")
    wanted = float(plain.mend.removeprefix("--sample-rate "))
    for rate, is_mended in ((wanted, True), (0.8 * wanted, True), (2 * wanted, False)):
        found, = audit(fast, sample_rate=rate).of("oversampled")
        assert found.mend.startswith("mended") is is_mended


def test_a_clock_that_cannot_be_told_yields_no_figures() -> None:
    """Time all backward has no period; unsteady time has no rate at which the scheduling moves."""
    grid = PERIOD * np.arange(N)
    rng = np.random.default_rng(2)
    for stamps in (grid[::-1].copy(), grid + rng.uniform(-0.4, 0.4, N) * PERIOD):
        found = audit(restamped(stamps))
        shown = str(found)
        assert "nan" not in shown
        (moving,) = found.of("scheduling-excitation")
        assert "no steady stretch" in moving.evidence
        assert "up to" not in moving.evidence


def test_rounded_stamps_are_a_note_and_no_jitter() -> None:
    record = clean(period=1 / 3004.8)
    found = audit(Record(record.channels, time=np.round(np.arange(N) / 3004.8, 4)))
    assert only(found, "rounded-stamps") == ("note", "")
    assert not found.of("jitter")


@pytest.mark.seconds
def test_rates_that_differ() -> None:
    found = audit([clean(name="a"), clean(seed=6, period=0.01, name="b")])
    assert only(found, "mixed-rates")[0] == "warning"
    assert found.of("mixed-rates")[0].mend == "--sample-rate 100"


# -- single channels --------------------------------------------------------------------------------------------
@pytest.mark.thinned(3, "slow", "seconds")
@pytest.mark.parametrize(
    ("fault", "name", "severity"),
    [
        (set_at(slice(100, 110), NAN), "missing-samples", "note"),
        (set_at(slice(100, 300), NAN), "missing-samples", "warning"),
        (set_at(17, np.inf), "infinite-samples", "fault"),
        (lambda x: np.clip(x, -0.7 * np.abs(x).max(), None), "clipped", "warning"),
        (lambda x: np.clip(x, None, np.percentile(x, 97)), "clipped", "warning"),
        (lambda x: np.round(x / (0.2 * x.std())) * 0.2 * x.std(), "quantised", "warning"),
        (lambda x: np.round(x / (0.02 * x.std())) * 0.02 * x.std(), "quantised", "note"),
        (lambda x: np.full_like(x, 3.0), "constant-channel", "warning"),
        (lambda x: x + 0.5 * x.std() * np.random.default_rng(1).normal(size=x.size), "noise-level", "warning"),
    ],
)
def test_a_fault_of_one_channel_is_found_there(fault: Callable, name: str, severity: str) -> None:
    assert not [f for f in audit(clean()).of(name) if f.severity == severity and f.channel == "force"]
    found = audit(change(clean(), "force", fault))
    assert [(f.severity, f.channel) for f in found.of(name) if f.channel == "force"] == [(severity, "force")]


def test_noise_is_measured() -> None:
    (finding,) = [f for f in audit(clean(period=PERIOD / 10, n=20000)).of("noise-level") if f.channel == "force"]
    assert finding.severity == "note"
    assert finding.value == pytest.approx(2.0, rel=0.1)


def test_the_lattice_step_is_measured() -> None:
    (finding,) = audit(change(clean(), "force", lambda x: np.round(x / 7.0) * 7.0)).of("quantised")
    assert finding.value == pytest.approx(7.0, rel=1e-3)


@pytest.mark.thinned(2, "seconds")
@pytest.mark.parametrize("levels", [2, 3])
def test_a_force_on_few_levels_is_quantised_and_a_command_is_not(levels: int) -> None:
    """Three levels of a lattice of 1000 N rest most of the time, as a command does; a force is measured."""
    step, most = (1000.0, 1000.0) if levels == 3 else (2000.0, 1000.0)
    record = change(clean(), "force", lambda x: np.clip(step * np.round(x / x.std() + 0.5 * (levels == 2))
                                                        - 0.5 * step * (levels == 2), -most, most))
    assert np.unique(record["force"]).size == levels
    (finding,) = audit(record).of("quantised")
    assert (finding.severity, finding.channel) == ("warning", "force")
    assert finding.value == pytest.approx(step)
    command = record.with_channel("demand", np.sign(np.sin(np.arange(N) / 50)), "V")
    assert not [f for f in audit(command).of("quantised") if f.channel == "demand"]


def test_text_and_units() -> None:
    channels = dict(clean().channels)
    channels["note"] = Channel(np.where(np.arange(N) == 4, NAN, 1.0), "", None, True, "text 'abc' in row 5")
    channels["odd"] = Channel(clean()["force"] ** 2, "", "raw", False)
    channels["bare"] = Channel(np.cos(np.arange(N) ** 1.1), "", None, True)
    found = audit(Record(channels, sample_time=PERIOD))
    assert only(found, "text-in-numbers") == ("fault", "note")
    assert only(found, "unknown-unit") == ("warning", "odd")
    assert ("note", "bare") in [(f.severity, f.channel) for f in found.of("missing-unit")]
    assert "1 fault to mend" in found.verdict


def test_one_signal_under_two_names() -> None:
    record = clean()
    found = audit(record.with_channel("copy", -3 * record["velocity"], "mm"))
    assert only(found, "same-channel-twice") == ("warning", "copy")


# -- motion -----------------------------------------------------------------------------------------------------
def test_velocity_of_wrong_scale_sign_or_origin() -> None:
    scaled = audit(change(clean(), "velocity", lambda v: 1.2 * v)).of("velocity-scale")
    assert scaled[0].value == pytest.approx(1.2, rel=0.01)
    turned = audit(change(clean(), "velocity", np.negative))
    assert only(turned, "velocity-sign") == ("warning", "velocity")
    other = clean(seed=99)["velocity"]
    assert only(audit(change(clean(), "velocity", lambda v: other)), "velocity-mismatch")[0] == "warning"


@pytest.mark.parametrize("late", [2, -3])
def test_a_late_velocity_is_found_with_its_sign(late: int) -> None:
    (finding,) = audit(change(clean(), "velocity", lambda v: np.roll(v, late))).of("velocity-delay")
    assert finding.value == pytest.approx(late * PERIOD, abs=2e-4)
    assert finding.severity == "warning"


def test_a_backward_difference_is_recognised() -> None:
    record = clean()
    x = record["displacement"]
    smooth = low_pass(record, 25.0)["displacement"]
    slope = np.diff(smooth, prepend=smooth[0]) / PERIOD
    found = audit(record.with_channel("displacement", smooth, "m").with_channel("velocity", slope, "m/s"))
    (finding,) = found.of("one-sided-difference")
    assert finding.value == pytest.approx(PERIOD / 2, rel=0.03)
    assert "backward" in finding.evidence
    assert x.size == smooth.size


@pytest.mark.thinned(3, "slow", "seconds")
@pytest.mark.parametrize("channel", ["velocity", "displacement"])
def test_a_causal_filter_on_one_motion_channel_is_found_and_one_on_all_is_not(channel: str) -> None:
    record = clean(n=12000)
    for order in (1, 2):
        found = audit(low_pass(record, 15.0, order=order, zero_phase=False, channels=[channel]))
        (finding,) = found.of("one-sided-filter")
        assert finding.channel == channel
        assert finding.value == pytest.approx(15.0, rel=0.15)
        assert f"order {order}" in finding.evidence
    assert not audit(low_pass(record, 15.0, order=1, zero_phase=False)).of("one-sided-filter")
    assert not audit(low_pass(record, 15.0, order=1, channels=[channel])).of("one-sided-filter")


# -- force ------------------------------------------------------------------------------------------------------
def test_polarity_is_found_with_and_without_a_velocity_channel() -> None:
    record = change(clean(), "force", np.negative)
    found = audit(record)
    assert only(found, "reversed-polarity") == ("warning", "force")
    assert found.of("reversed-polarity")[0].mend == "--flip force"
    product = np.cov(record["force"], record["velocity"])[0, 1]
    assert found.of("reversed-polarity")[0].value == pytest.approx(product, rel=1e-3)
    bare = Record({k: c for k, c in record.channels.items() if k != "velocity"}, sample_time=PERIOD)
    assert only(audit(bare), "reversed-polarity")[0] == "warning"
    assert not audit(record.flip("force")).of("reversed-polarity")


def test_a_spring_has_no_polarity_to_complain_of() -> None:
    record = clean()
    found = audit(record.with_channel("force", 5e4 * record["displacement"], "N"))
    assert not found.of("reversed-polarity")
    assert found.of("polarity-unclear")


def test_signs_that_differ_between_records() -> None:
    found = audit([clean(1, name="a"), change(clean(2, name="b"), "force", np.negative), clean(3, name="c")])
    assert "'b'" in found.of("mixed-polarity")[0].evidence
    assert [f.record for f in found.of("reversed-polarity")] == ["b"]


def test_force_offset_and_drift() -> None:
    (offset,) = audit(change(clean(), "force", lambda f: f + 80.0)).of("force-offset")
    assert offset.value == pytest.approx(80.0, rel=0.15)
    (drift,) = audit(change(clean(), "force", lambda f: f + np.linspace(-40, 60, N))).of("force-drift")
    assert drift.value == pytest.approx(100.0, rel=0.25)
    varies = audit([clean(1, name="a"), change(clean(2, name="b"), "force", lambda f: f + 120)])
    assert varies.of("force-offset-varies")[0].value == pytest.approx(120.0, rel=0.25)


# -- excitation -------------------------------------------------------------------------------------------------
def test_scheduling_excitation() -> None:
    steps = np.repeat(np.random.default_rng(4).integers(0, 2, N // 50), 50) * 1.5
    noisy = steps + 0.01 * np.random.default_rng(5).normal(size=N)
    for command in (steps, noisy):
        (finding,) = audit(change(clean(), "current", lambda c, x=command: x)).of("scheduling-excitation")
        assert "2 levels" in finding.evidence
    assert "continuous" in audit(clean()).of("scheduling-excitation")[0].evidence
    held = change(clean(), "current", lambda c: np.full_like(c, 0.5))
    assert only(audit(held), "constant-scheduling") == ("warning", "current")
    both = audit([held, change(clean(6, name="x"), "current", np.ones_like)])
    assert only(both, "scheduling-constant-within-records") == ("note", "current")
    assert not both.of("constant-scheduling")
    with pytest.raises(InputError, match="record 'clean' has no channel 'speed'"):
        audit(clean(), scheduling=["speed"])


def test_repetition_is_a_note_with_its_period() -> None:
    one = clean(n=1000)
    twice = Record({k: Channel(np.tile(c.values, 4), c.unit, c.unit) for k, c in one.channels.items()},
                   sample_time=PERIOD)
    (finding,) = audit(twice).of("repeated-segments")
    assert finding.value == pytest.approx(5.0, abs=0.01)
    same = audit([clean(name="a"), clean(name="b")])
    assert {f.channel for f in same.of("same-in-two-records")} == {"displacement", "velocity", "current", "force"}


@pytest.mark.seconds
def test_too_fast_a_rate_and_moving_averages() -> None:
    (finding,) = audit(clean(period=PERIOD / 10, n=40000)).of("oversampled")
    assert 15 < finding.value < 40
    record = clean(n=12000)
    averaged = change(record, "displacement", lambda x: np.convolve(x, np.full(20, 1 / 20), mode="same"))
    assert [(f.channel, f.value) for f in audit(averaged).of("moving-average")] == [("displacement", 20.0)]
    assert not audit(record).of("moving-average")


def strut(rng: np.random.Generator, fast: float, noise: float = 2.0) -> Record:
    """A slow motion of 0.4 and 0.93 Hz with a little up to 20 Hz, which the force of a spring and a damper follows."""
    rate, n = 500.0, 20000
    t = np.arange(n) / rate
    drive = sosfilt(butter(2, 20.0, fs=rate, output="sos"), rng.normal(size=n))
    v = 0.3 * np.sin(2 * np.pi * 0.4 * t) + 0.3 * np.sin(2 * np.pi * 0.93 * t) + fast * drive / drive.std()
    force = 2e4 * np.cumsum(v) / rate + 1500 * v + noise * rng.normal(size=n)
    return Record({"velocity": v + 1e-4 * rng.normal(size=n), "force": force}, sample_time=1 / rate,
                  units={"velocity": "m/s", "force": "N"})


def test_the_rate_keeps_the_band_in_which_the_motion_excites_the_force(rng: np.random.Generator) -> None:
    """99 % of the power lies below 1.1 Hz: the mend was 5.88 Hz, which would lose what excites the damper."""
    assert not audit(strut(rng, 0.02)).of("oversampled")
    (slow,) = audit(strut(rng, 0.0)).of("oversampled")
    assert slow.value < 5  # tones at 0.4 and 0.93 Hz, with the lobes of a window of 2 s


@pytest.mark.parametrize("noise", [0.0, 1e-3])
@pytest.mark.parametrize(("line", "n", "most"), [(1.0, 40000, 1.5), (10.0, 40000, 10.8), (10.0, 2000, 16.1)])
def test_a_line_is_followed_up_to_itself_not_as_far_as_its_window_leaks(line: float, n: int, most: float, noise: float,
                                                                        rng: np.random.Generator) -> None:
    """Side lobes are coherent in velocity and force: without noise a sine of 1 Hz was "followed up to 1000 Hz"."""
    v = 0.3 * np.sin(2 * np.pi * line * np.arange(n) / 2000)
    sine = Record({"velocity": v + noise * rng.normal(size=n), "force": 1500 * v + 5e3 * noise * rng.normal(size=n)},
                  sample_time=1 / 2000, units={"velocity": "m/s", "force": "N"})
    assert follows(view(sine, None)) <= line
    (finding,) = audit(sine).of("oversampled")
    assert finding.value < most


@pytest.mark.parametrize("n", [64, 100, 300])
def test_a_short_sine_gets_an_advice(n: int, rng: np.random.Generator) -> None:
    """At 100 samples it "followed up to 375 Hz", which silenced the finding."""
    v = np.sin(2 * np.pi * 10 * np.arange(n) / 2000) + 1e-3 * rng.normal(size=n)
    sine = Record({"velocity": v, "force": 1500 * v + 5 * rng.normal(size=n)}, sample_time=1 / 2000,
                  units={"velocity": "m/s", "force": "N"})
    assert follows(view(sine, None)) < 2000 / 16


def test_the_band_that_follows_needs_three_segments(rng: np.random.Generator) -> None:
    """Two signals of one segment are coherent whatever they are."""
    few = SimpleNamespace(period=0.01, stroke=(np.zeros(23), *rng.normal(size=(2, 23))))
    assert follows(few) == 0.0  # type: ignore[arg-type]


@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_a_fast_part_beside_strong_lines_is_followed_to_its_end(noise: float, rng: np.random.Generator) -> None:
    """2 % of a slow motion, up to 20 Hz (a filter of second order, so a little beyond): not what the lines leak."""
    assert follows(view(strut(rng, 0.02, noise), None)) > 18


@pytest.mark.seconds
def test_unrelated_noise_has_no_band_that_follows(rng: np.random.Generator) -> None:
    """40 pairs: with a chance of 1 % each, three or more have one of 0.7 %."""
    pairs = [Record({"velocity": rng.normal(size=4000), "force": lfilter([1.0], [1.0, -0.9], rng.normal(size=4000))},
                    sample_time=0.01, units={"velocity": "m/s", "force": "N"}) for _ in range(40)]
    assert sum(follows(view(pair, None)) > 0 for pair in pairs) <= 2


def test_a_name_that_promises_another_amplitude() -> None:
    t = PERIOD * np.arange(N)
    channels = {"displacement": Channel(1.6e-3 * np.sin(2 * np.pi * 5 * t), "m"), "current": Channel(np.ones(N), "A")}
    assert not audit(Record(channels, sample_time=PERIOD, name="1.6mm5Hz1A")).findings[0].name.startswith("nominal")
    found = audit(Record(channels, sample_time=PERIOD, name="2mm4Hz0p25A"))
    for name in ("SD_1_6mm_5_0Hz", "run 3,5Hz", "2-5Hz"):  # decimals, or a number beside one
        assert not [f for f in audit(Record(channels, sample_time=PERIOD, name=name)).findings
                    if f.name.startswith("nominal")], name
    values = {f.name: f.value for f in found.findings if f.name.startswith("nominal")}
    assert values == {"nominal-amplitude": pytest.approx(1.6, rel=0.01), "nominal-current": 1.0,
                      "nominal-frequency": pytest.approx(5.0, rel=0.01)}


# -- the audit itself -------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_it_prints_and_serialises_the_same_every_time() -> None:
    records = [change(clean(name="b"), "force", np.negative), clean(2, name="a")]
    one, two = audit(records), audit(records)
    assert str(one) == str(two)
    assert len(str(one).splitlines()) <= 12
    assert "warning" in str(one).splitlines()[0]
    written = json.loads(json.dumps(one.to_dict(), allow_nan=False))
    assert written["schema"] == "lpvid/audit/1"
    assert set(written["findings"][0]) >= {"name", "record", "channel", "severity", "evidence", "mend"}
    ranks = [("fault", "warning", "note").index(f["severity"]) for f in written["findings"]]
    assert ranks == sorted(ranks)


def test_anything_that_parses_can_be_audited(rng: np.random.Generator) -> None:
    audit(Record({"x": [1.0]}, sample_time=1.0))
    audit(Record({"x": [1.0], "force": [2.0]}, time=np.array([0.0])))
    audit(Record({"x": [NAN] * 100, "velocity": rng.normal(size=100)}, sample_time=1.0))
    audit(Record({"force": [NAN] * 100, "velocity": [np.inf] * 100}, time=np.full(100, NAN)))
    audit(Record({"force": rng.normal(size=100), "velocity": np.zeros(100)}, time=rng.normal(size=100)))
    audit(Record({"displacement": rng.normal(size=70), "velocity": rng.normal(size=70), "force": rng.normal(size=70)},
                 sample_time=0.1))
    with pytest.raises(InputError):
        audit([])


@pytest.mark.seconds
def test_a_long_record_is_audited_in_seconds() -> None:
    record = clean(n=36_000)
    begin = time.process_time()
    audit(record)
    assert time.process_time() - begin < 4


@pytest.mark.seconds
@pytest.mark.parametrize("factor", [1e-3, 1e4])
def test_the_size_of_the_numbers_changes_nothing(factor: float) -> None:
    faulty = change(change(clean(), "force", lambda f: np.minimum(-f, np.percentile(-f, 97)) + 80.0), "velocity",
                    lambda v: np.roll(v, 2))
    scaled = change(faulty, "force", lambda f: f * factor)
    for channel in ("displacement", "velocity"):
        scaled = change(scaled, channel, lambda x: x * factor)
    assert [(f.name, f.severity) for f in audit(scaled).findings] == [
        (f.name, f.severity) for f in audit(faulty).findings]
    assert {"clipped", "reversed-polarity", "velocity-delay", "force-offset"} <= {
        f.name for f in audit(faulty).findings}


# -- real measurements: what the people who made them say of them ------------------------------------------------
def _names(found: Audit, *severities: str) -> set[str]:
    return {f.name for f in found.findings if f.severity in severities}


@pytest.mark.seconds
def test_random_mr_damper(shared_data: Path) -> None:
    records = read(shared_data / "mr_damper_random" / "estimation.csv")
    found = audit(records)
    assert only(found, "unknown-unit") == ("warning", "acceleration")
    assert only(found, "rounded-stamps")[0] == "note"
    rate = float(found.of("oversampled")[0].mend.removeprefix("--sample-rate "))
    assert 400 < rate < 650
    assert "2 levels" in found.of("scheduling-excitation")[0].evidence
    assert not found.of("reversed-polarity")
    assert _names(found, "fault", "warning") == {"unknown-unit"}
    assert segments(records, ["velocity", "voltage", "force"], sample_rate=500.8)[0].n_samples == 6010


def test_fixed_voltage_mr_damper(shared_data: Path) -> None:
    found = audit(read(shared_data / "mr_damper_fixed_voltage" / "estimation.csv"))
    assert only(found, "reversed-polarity") == ("warning", "force")
    assert only(found, "no-scheduling")[0] == "note"
    assert _names(found, "fault", "warning") == {"reversed-polarity"}


@pytest.mark.slow
def test_mr_damper_sines(shared_data: Path) -> None:
    found = audit(read(shared_data / "mr_damper_sines"))
    assert {f.record[:6] for f in found.of("nominal-amplitude")} == {"2mm5Hz"}
    assert all(f.value == pytest.approx(1.62, abs=0.02) for f in found.of("nominal-amplitude"))
    assert len(found.of("nominal-amplitude")) == 4
    assert "0, 0.25, 0.75, 1 A" in found.of("scheduling-constant-within-records")[0].evidence
    averaged = {f.record: f.value for f in found.of("moving-average") if f.channel == "displacement"}
    assert len(averaged) == 20
    assert {averaged["10mm1Hz0A"], averaged["25mm0p5Hz1A"], averaged["25mm0p25Hz0A"]} == {100.0, 40.0, 80.0}
    assert len(found.of("one-sided-difference")) == 24
    assert not found.of("nominal-current")
    assert not found.of("nominal-frequency")
    assert not found.of("reversed-polarity")
    assert found.of("mixed-rates")
    assert found.count("fault") == 0


@pytest.mark.seconds
def test_race_damper(shared_data: Path) -> None:
    found = audit(read(shared_data / "race_damper_dyno"))
    assert {f.record for f in found.of("reversed-polarity")} == {"t1_1_1_18_18_s1_n10_100psi",
                                                                  "t1_1_1_18_18_s5_n10_150psi"}
    assert found.of("mixed-polarity")
    assert found.of("force-offset-varies")
    assert "297.4 … 342.9 K" in found.of("scheduling-excitation")[0].evidence
    assert found.count("fault") == 0


@pytest.mark.seconds
def test_quarter_car_rig_road_and_gyroscope(shared_data: Path) -> None:
    rig = audit(read(shared_data / "quarter_car_rig"))
    assert rig.clean, str(rig)
    assert {f.channel for f in rig.of("same-in-two-records")} == {"actuator force"}
    road = audit(read(shared_data / "belgian_block_road", sample_rate=100.0))
    assert road.clean, str(road)
    gyroscope = audit(read(shared_data / "gyroscope"))
    assert gyroscope.clean, str(gyroscope)
    # the noise of this simulation is published: 0.0137 rad/s
    assert gyroscope.of("noise-level")[0].value == pytest.approx(0.0137, rel=0.03)
    assert {"p1", "p2", "p3"} <= {f.channel for f in gyroscope.of("scheduling-excitation")}


class TestCoherentInputs:
    """Two inputs of one model: independent ones pass, a filtered copy is found, and a second record lifts it."""

    @staticmethod
    def record(rng: np.random.Generator, coupled: bool, name: str = "run") -> Record:
        road, own = rng.standard_normal((2, 8000))
        force = np.convolve(road, [3.0, -1.0, 0.5])[:8000] if coupled else own
        return Record({"force": force, "road": road, "y": road + force}, 0.01, name=name)

    def test_independent_inputs_pass(self):
        rng = np.random.default_rng(1)
        assert audit(self.record(rng, False), inputs=("force", "road")).of("coherent-inputs") == ()

    def test_a_filtered_copy_is_found_with_its_ratio(self):
        found = audit(self.record(np.random.default_rng(2), True), inputs=("force", "road")).of("coherent-inputs")
        assert len(found) == 1 and found[0].severity == "warning" and found[0].value > 100
        seen = input_coherence([view(self.record(np.random.default_rng(2), True), None)], ("force", "road"))
        z = np.exp(-2j * np.pi * seen.strongest * 0.01)
        assert seen.ratio == pytest.approx(1 / (3 - z + 0.5 * z**2), rel=0.05)

    @pytest.mark.parametrize("seed", range(5))
    def test_a_short_record_is_looked_at_too(self, seed):
        """Three hundred samples: a warning was left out below 528."""
        rng = np.random.default_rng(seed)
        road, own, force = rng.standard_normal(300), rng.standard_normal(300), np.zeros(300)
        for k in range(1, 300):
            force[k] = 0.5 * force[k - 1] + road[k]
        for second, found in ((force, 1), (own, 0)):
            record = Record({"force": second, "road": road, "y": road + own}, 0.01)
            assert len(audit(record, inputs=("force", "road")).of("coherent-inputs")) == found

    def test_a_record_with_independent_inputs_lifts_it(self):
        rng = np.random.default_rng(3)
        pooled = [self.record(rng, True, "a"), self.record(rng, False, "b")]
        assert audit(pooled, inputs=("force", "road")).of("coherent-inputs") == ()

    def test_the_share_of_a_noisy_copy_is_that_of_the_noise(self):
        rng = np.random.default_rng(4)
        road, noise = rng.standard_normal((2, 40_000))
        r = Record({"a": road, "b": road + 0.5 * noise}, 0.01)
        seen = input_coherence([view(r, None)], ("a", "b"))
        np.testing.assert_allclose(seen.share, [0.2, 0.2], rtol=0.15)  # 1 - 1/(1 + 0.25), less the bias of averaging


@pytest.mark.seconds
def test_a_sample_that_outweighs_all_others_is_a_spike() -> None:
    record = clean()
    assert not [f for f in audit(record).findings if f.name == "spike"]
    force = record["force"].copy()
    force[777] = 1e6
    spiked = Record({n: force if n == "force" else record[n] for n in record.channels}, sample_time=record.sample_time,
                    units={n: record.unit(n) for n in record.channels})
    found, = (f for f in audit(spiked).findings if f.name == "spike")
    assert found.channel == "force" and found.severity == "warning" and "row 778" in found.evidence


def test_a_clock_without_a_unit_is_a_note(tmp_path) -> None:
    from lpvid.files import read

    for header, expected in (("time", ["time"]), ("time [ms]", [])):
        file = tmp_path / "run.csv"
        file.write_text(f"{header},force [N]\n" + "\n".join(f"{k},{np.sin(k)}" for k in range(100)) + "\n")
        findings = audit(read(file)).findings
        assert [f.channel for f in findings if f.name == "missing-unit"] == expected


@pytest.mark.parametrize("factor, frequency, name", [(1.0, 1.0, "displacement-range"),
                                                     (1e3, 1.0, "displacement-range"),
                                                     (1e3, 4.0, "displacement-unit")])
def test_the_size_of_a_motion_is_put_as_a_question_where_no_velocity_confirms_it(factor, frequency, name):
    """25 mm read as metres: at 4 Hz the rod would be faster than sound, at 1 Hz only the reader can tell."""
    t = np.arange(2000) * PERIOD
    x = 0.025 * factor * np.sin(2 * np.pi * frequency * t)
    v = 2 * np.pi * frequency * 0.025 * factor * np.cos(2 * np.pi * frequency * t)
    bare = Record({"displacement": x, "force": 900 * v / factor + 3 * x / factor}, sample_time=PERIOD,
                  units={"displacement": "m", "force": "N"})
    found = [f for f in audit(bare).findings if f.name.startswith("displacement-")]
    assert [f.name for f in found] == [name]
    assert found[0].value == pytest.approx(0.05 * factor, rel=3e-3)
    assert found[0].severity == ("warning" if name == "displacement-unit" else "note")
    assert f"over {found[0].value:.3g} m" in found[0].evidence
    beside = audit(bare.with_channel("velocity", v, "m/s"))
    assert not [f for f in beside.findings if f.name.startswith("displacement-")]


@pytest.mark.parametrize(("stiffness", "slow", "fast"), [(3e3, 0.05, 8.0), (5e3, 0.1, 10.0), (2e4, 0.5, 12.0)])
def test_a_fast_motion_beside_a_slow_one_against_a_spring_is_no_interference(stiffness, slow, fast, rng) -> None:
    """Of the slow one the force over the velocity is K/ω, beside which the damper's 1500 N·s/m are little."""
    t, w = np.arange(15000) / 500, 2 * np.pi * np.array([slow, fast])
    x = (0.05 / w) @ np.sin(np.outer(w, t))
    v = 0.05 * np.cos(np.outer(w, t)).sum(axis=0)
    force = -(1500 * v + stiffness * x) + 3 * rng.standard_normal(t.size)
    record = Record({"displacement": x + 1e-5 * rng.standard_normal(t.size), "force": force}, sample_time=1 / 500,
                    units={"displacement": "m", "force": "N"})
    assert "interference" not in {f.name for f in audit(record).findings}


@pytest.mark.parametrize("follows", [False, True])
def test_hum_of_a_displacement_is_interference_where_the_force_does_not_follow(follows: bool, rng) -> None:
    """40 µm at 50 Hz beside 18 mm at .2 Hz: half of the motion's velocity, if it is motion."""
    t = np.arange(9000) / 300
    slow, fast = 0.018 * np.sin(2 * np.pi * 0.2 * t), 4e-5 * np.sin(2 * np.pi * 50 * t)
    speed = 2 * np.pi * (0.2 * 0.018 * np.cos(2 * np.pi * 0.2 * t) + follows * 50 * 4e-5 * np.cos(2 * np.pi * 50 * t))
    record = Record({"displacement": slow + fast + 1e-6 * rng.standard_normal(t.size),
                     "force": 2000 * speed + 0.5 * rng.standard_normal(t.size)}, sample_time=1 / 300,
                    units={"displacement": "m", "force": "N"})
    found = [f for f in audit(record).findings if f.name == "interference"]
    assert len(found) == (0 if follows else 1)
    if found:
        assert found[0].value == pytest.approx(50 * 4e-5 / (0.2 * 0.018), rel=0.1)
        assert "about 50 Hz" in found[0].evidence


# -- what a test engineer's dampers showed --------------------------------------------------------------------------
def triangles(speeds: tuple[float, ...], rate: float, cycles: int = 6) -> np.ndarray:
    """(n,) displacement of triangles of rising speed, ±4 mm up to 20 mm/s and ±40 mm beyond, from mid stroke [m]."""
    parts = []
    for speed in speeds:
        half = 0.004 if speed <= 0.02 else 0.04
        phase = np.mod(np.arange(0, cycles, speed / (4 * half * rate)), 1.0)
        parts.append(half * np.where(phase < 0.25, 4 * phase, np.where(phase < 0.75, 2 - 4 * phase, 4 * phase - 4)))
    return np.concatenate(parts)


@pytest.mark.seconds
def test_a_set_of_triangles_of_rising_speed_decides_the_polarity():
    """Power rises with the square of the speed: its scatter over the record is no doubt about its sign."""
    rate = 500.0
    x = triangles((0.004, 0.05, 0.13, 0.26, 0.52), rate, 4)
    v = np.gradient(x, 1 / rate)
    record = Record({"displacement": x, "velocity": v, "force": 1500.0 * v}, sample_time=1 / rate,
                    units={"displacement": "m", "velocity": "m/s", "force": "N"})
    assert not audit(record).of("polarity-unclear")
    assert audit(change(record, "force", np.negative)).of("reversed-polarity")


def test_even_overtones_that_a_symmetric_force_lacks_are_no_moving_average():
    rate, f = 200.0, 2.55
    t = np.arange(0, 92, 1 / rate)
    v = 0.4 * np.cos(2 * np.pi * f * t)
    force = 1000.0 * np.tanh(v / 0.02) + 800.0 * v + np.random.default_rng(0).normal(size=t.size)
    units = {"displacement": "m", "velocity": "m/s", "force": "N"}
    record = Record({"displacement": 0.025 * np.sin(2 * np.pi * f * t), "velocity": v, "force": force},
                    sample_time=1 / rate, units=units)
    assert not audit(record).of("moving-average")


def stepped_current(rate: float = 5000.0) -> Record:
    """Triangles of 0.1 m/s, a current that steps every quarter of a second, a force that follows it by 9 ms."""
    rng = np.random.default_rng(1)
    x = triangles((0.1,), rate, 8)
    v, t = np.gradient(x, 1 / rate), np.arange(x.size) / rate
    current = np.array([0, 1.0, 0, 0.5, 0, 1.5])[(t // 0.25).astype(int) % 6]
    share = 1 - np.exp(-1 / (rate * 0.009))
    behind = lfilter([share], [1, share - 1], current)
    force = (100 + 900 * behind) * np.tanh(v / 0.01) + 800 * v + rng.normal(size=t.size)
    return Record({"displacement": x + 2e-5 * rng.normal(size=t.size), "current": current, "force": force},
                  sample_time=1 / rate, units={"displacement": "m", "current": "A", "force": "N"})


@pytest.mark.seconds
def test_where_the_current_steps_no_rate_is_named_at_which_its_lag_is_lost():
    (finding,) = audit(stepped_current()).of("oversampled")
    assert float(finding.mend.removeprefix("--sample-rate ")) >= 500.0 and "steps of the current" in finding.evidence
    assert not audit(stepped_current(1000.0)).of("oversampled")


def maxwell(x: np.ndarray, rate: float, spring: float, rebound: float, compression: float) -> np.ndarray:
    """(n,) force of a dashpot with a coefficient for each direction behind a spring, exact for a constant speed [N]."""
    force, v = np.zeros(x.size), np.gradient(x, 1 / rate)
    for k in range(1, x.size):
        c = rebound if force[k - 1] > 0 else compression
        left = np.exp(-spring / (c * rate))
        force[k] = left * force[k - 1] + (1 - left) * c * v[k]
    return force


@pytest.mark.parametrize(("zero", "severity"), [(0.0, "note"), (400.0, "warning")])
def test_what_a_sweep_leaves_at_rest_of_an_elastic_damper_is_no_drift_of_the_load_cell(zero, severity):
    rate, rng = 500.0, np.random.default_rng(2)
    t = np.arange(0, 30, 1 / rate)
    if severity == "note":  # a sweep from 0.5 to 20 Hz: the directions part as it grows faster
        k = (20 / 0.5) ** (1 / 30)
        phase = 2 * np.pi * 0.5 * (k**t - 1) / np.log(k)
    else:
        phase = 2 * np.pi * 2.0 * t
    x = 0.004 * np.sin(phase)
    force = maxwell(x, rate, 8e4, 2500.0, 400.0) + rng.normal(size=t.size) + zero * t / t[-1]
    record = Record({"displacement": x, "force": force}, sample_time=1 / rate,
                    units={"displacement": "m", "force": "N"})
    found = audit(record)
    assert {f.severity for f in found.of("force-drift")} == {severity}
    if severity == "note":
        assert "elastic damper" in found.of("force-offset")[0].evidence


def test_a_fit_is_told_of_a_force_that_was_cut_off():
    cut = change(clean(), "force", lambda f: np.clip(f, -600.0, 600.0))
    assert not record_remarks([clean()])
    assert any("rest on the top value 600 N" in r for r in record_remarks([cut]))
