"""Audit of what a record is, whatever its law: rest, clipping, motion channels that differ, gains between files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lpvid.auditing import Audit, audit
from lpvid.files import read
from lpvid.record import Record

PERIOD, N = 0.005, 4000
NAMES = {"displacement-rests", "force-clipped", "velocity-mismatch", "motion-gain-varies", "force-gain-varies"}
UNITS = {"displacement": "m", "velocity": "m/s", "force": "N"}


def motion(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(displacement, velocity) of ten tones up to 12 Hz."""
    rng, t = np.random.default_rng(seed), PERIOD * np.arange(N)
    x, v = np.zeros(N), np.zeros(N)
    for f in rng.uniform(0.4, 12, 10):
        phase = rng.uniform(0, 6.28)
        x += 0.01 / f * np.sin(2 * np.pi * f * t + phase)
        v += 2 * np.pi * 0.01 * np.cos(2 * np.pi * f * t + phase)
    return x, v


def record(x: np.ndarray, v: np.ndarray, force: np.ndarray, name: str = "run", seed: int = 0) -> Record:
    """With the noise of a displacement sensor of 1 µm and of a load cell of 1 N."""
    rng = np.random.default_rng(seed)
    channels = {"displacement": x + 1e-6 * rng.normal(size=x.size), "velocity": v,
                "force": force + rng.normal(size=x.size)}
    return Record(channels, sample_time=PERIOD, units=UNITS, name=name)


def damper(v: np.ndarray) -> np.ndarray:
    """Friction that has levelled off, and damping."""
    return 300 * np.tanh(v / 0.02) + 900 * v


def facts(found: Audit) -> set[str]:
    return {f.name for f in found.findings} & NAMES


@pytest.mark.parametrize("seed", range(4))
def test_a_clean_record_has_none_of_them(seed: int) -> None:
    x, v = motion(seed)
    assert facts(audit(record(x, v, damper(v)))) == set()
    assert facts(audit(record(x, v, 800 * np.tanh(v / 0.01)))) == set(), "a law that levels off is not clipped"


class TestRest:
    def test_at_the_end_of_the_scale_the_force_goes_on(self) -> None:
        """A sensor whose scale ends 3 mm above the lowest position, for a quarter of a second at a time."""
        t = PERIOD * np.arange(N)
        x, v = 0.01 * np.sin(2 * np.pi * 0.4 * t), 0.01 * 2 * np.pi * 0.4 * np.cos(2 * np.pi * 0.4 * t)
        seen = record(x, v, damper(v) + 2e4 * x)
        held = np.maximum(seen["displacement"], -0.007)
        found = audit(seen.with_channel("displacement", held, "m"))
        assert "clipped" in {f.name for f in found.findings}, "the end is the lowest value: a flat bottom"

    def test_of_a_value_inside_the_range(self) -> None:
        """The first second stands on zero, below which the sensor goes later on; the force moves all the same."""
        x, v = motion(3)
        seen = record(x, v, damper(v))
        stuck = seen["displacement"].copy()
        stuck[:200] = 0.0
        (finding,) = audit(seen.with_channel("displacement", stuck, "m")).of("displacement-rests")
        assert finding.severity == "warning" and finding.value == pytest.approx(0.05, abs=1e-3)
        assert "200 samples" in finding.evidence and "the end of the sensor's scale" in finding.evidence
        assert finding.mend

    def test_a_motion_that_has_not_begun_is_a_note(self) -> None:
        x, v = motion(3)
        x, v = x - x[0], v.copy()
        x[:200], v[:200] = 0.0, 0.0
        seen = record(x, v, damper(v))
        stuck = seen["displacement"].copy()
        stuck[:200] = 0.0
        (finding,) = audit(seen.with_channel("displacement", stuck, "m")).of("displacement-rests")
        assert finding.severity == "note" and "stands still" in finding.evidence

    def test_dwells_at_several_positions_are_meant(self) -> None:
        steps = np.repeat([0.0, 0.01, -0.01, 0.02], N // 4)
        x = np.convolve(steps, np.ones(400) / 400, mode="same")
        assert not audit(record(x, np.gradient(x, PERIOD), damper(np.gradient(x, PERIOD))).with_channel(
            "displacement", x, "m")).of("displacement-rests")


class TestClipping:
    @pytest.mark.parametrize("converter", [0.0, 0.05])
    def test_of_an_amplifier_before_the_converter(self, converter: float) -> None:
        """Whether the converter adds a little noise behind the amplifier's end or not: one finding or the other."""
        x, v = motion(1)
        seen = record(x, v, damper(v))
        top = float(np.quantile(seen["force"], 0.93))
        rng = np.random.default_rng(2)
        force = np.minimum(seen["force"], top) + converter * rng.normal(size=N)
        found = audit(seen.with_channel("force", force, "N"))
        (finding,) = found.of("force-clipped" if converter else "clipped")
        assert finding.severity == "warning" and finding.channel == "force" and finding.mend
        assert finding.value == pytest.approx(0.07, abs=0.01)


class TestMotion:
    def test_by_how_much_with_gain_and_lag(self) -> None:
        """A velocity of gain 1.02, 10 ms late, a tenth of which is another motion."""
        x, v = motion(2)
        other = motion(9)[1]
        late = np.interp(np.arange(N) - 2, np.arange(N), v)
        seen = record(x, 1.02 * late + 0.1 * other / other.std() * v.std(), damper(v))
        (finding,) = audit(seen).of("velocity-mismatch")
        assert finding.severity == "note" and finding.value == pytest.approx(0.1, abs=0.03)
        assert "at the best gain 1.02 and lag +9.96 ms" in finding.evidence

    def test_of_another_motion(self) -> None:
        x, _ = motion(2)
        v = motion(5)[1]
        (finding,) = audit(record(x, v, damper(v))).of("velocity-mismatch")
        assert finding.severity == "warning" and finding.value > 0.5


class TestGains:
    @pytest.mark.seconds
    def test_of_a_motion_channel_in_one_file(self) -> None:
        files = [record(x, g * v, damper(v), f"run{k}") for k, g in enumerate((1.0, 1.0, 1.04))
                 for x, v in [motion(k)]]
        (finding,) = audit(files).of("motion-gain-varies")
        assert "1.04 ('run2')" in finding.evidence and finding.value == pytest.approx(0.04, abs=0.004)

    @pytest.mark.seconds
    def test_of_the_force_under_one_motion(self) -> None:
        x, v = motion(4)
        files = [record(x, v, g * damper(v), f"run{k}", k) for k, g in enumerate((1.0, 1.3, 1.02))]
        (finding,) = audit(files).of("force-gain-varies")
        assert finding.value == pytest.approx(1.3, rel=0.02) or finding.value == pytest.approx(1.02 / 1.3, rel=0.02)

    def test_of_a_thousand(self) -> None:
        """Kilonewtons labelled newtons under another motion; no soft beside a hard one, no slow beside a fast run."""
        (x, v), (other, w) = motion(4), motion(5)
        first = record(x, v, damper(v), "a")

        def beside(*channels: np.ndarray) -> list:
            return audit([first, record(*channels, "b")]).of("force-scale-varies")

        (finding,) = beside(other, w, 1e-3 * damper(w))
        assert 100 < finding.value < 10_000 and "'b'" in finding.evidence
        assert not beside(other, w, 0.05 * damper(w))
        assert not beside(0.02 * other, 0.02 * w, 0.02 * damper(w))

    @pytest.mark.seconds
    def test_of_sines_that_begin_anywhere(self) -> None:
        """One sine in both files, from another phase on and for another time: compared by harmonics."""
        def file(phase: float, count: int, gain: float, name: str) -> Record:
            angle = 2 * np.pi * 1.3 * PERIOD * np.arange(count) + phase
            x, v = 0.02 * np.sin(angle), 0.02 * 2 * np.pi * 1.3 * np.cos(angle)
            return record(x, v, gain * damper(v), name)

        (finding,) = audit([file(0.0, 3000, 1.0, "a"), file(1.0, 2500, 0.5, "b")]).of("force-gain-varies")
        assert finding.value == pytest.approx(0.5, rel=0.02)
        assert not audit([file(0.0, 3000, 1.0, "a"), file(1.0, 2500, 1.0, "b")]).of("force-gain-varies")

    @pytest.mark.seconds
    def test_another_law_is_no_gain(self) -> None:
        x, v = motion(4)
        files = [record(x, v, damper(v), "a"), record(x, v, 2500 * v, "b", 1)]
        assert not audit(files).of("force-gain-varies")


MEASURED = {"bouc_wen": {}, "emps": {}, "gyroscope": {}, "mr_damper_fixed_voltage": {}, "mr_damper_random": {},
            "mr_damper_sines": {}, "quarter_car_rig": {}, "race_damper_dyno": {}, "silverbox": {},
            "labcontrol_0V": {"ensaio1.1": 0.0276, "ensaio2.1": 0.0665, "ensaio4.1": 0.0558, "ensaio7.1": 0.0552},
            "labcontrol_0.87V": {"ensaio3.2.2": 0.151, "ensaio8.2.2": 0.0814},
            "labcontrol_1.98V": {"ensaio.B.8": 0.0571}}
"""Share of the samples at rest, by record, of every group; none of the other facts is in any of them."""


@pytest.mark.parametrize("group", [
    pytest.param(g, marks=pytest.mark.slow) if g == "mr_damper_sines" else g for g in MEASURED])
def test_of_measured_records(shared_data: Path, group: str) -> None:
    """Only records of the shaking table rest: on exactly 0 mm before the table moves."""
    found = audit(read(shared_data / group))
    assert facts(found) <= {"displacement-rests"}
    assert {f.record: f.value for f in found.of("displacement-rests")} == {
        name: pytest.approx(share, rel=0.02) for name, share in MEASURED[group].items()}
