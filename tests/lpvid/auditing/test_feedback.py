"""Feedback, found in what does not repeat; all else that can join an input and an output is not taken for it."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from lpvid import BoxJenkins, OutputError, identify
from lpvid.auditing import audit
from lpvid.auditing.feedback import FALSE_ALARM, Repeated, fed_back, feedback, input_follows, repeated
from lpvid.auditing.view import view
from lpvid.errors import InputError
from lpvid.files import read
from lpvid.identification.structure import Structure
from lpvid.record import Record
from lpvid.simulation import simulate

PERIOD, PERIODS, DRAWS = 256, 8, 200


def excitation(rng: np.random.Generator, size: int = PERIOD) -> np.ndarray:
    """A multisine of random phases up to half of the Nyquist frequency."""
    lines = np.arange(1, size // 4)
    x = np.cos(2 * np.pi * np.outer(np.arange(size), lines) / size + rng.uniform(0, 2 * np.pi, lines.size)).sum(1)
    return x / x.std()


def bench(rng: np.random.Generator, draws: int, *, gain: float = 0.0, cubic: bool = False, moved: float = 0.0,
          shared: float = 0.0, read_noise: float = 0.02, leading: bool = False, periods: int = PERIODS
          ) -> tuple[np.ndarray, np.ndarray]:
    """(u, y) as measured, (samples, draws): a lag behind a characteristic, a disturbance and a digital control."""
    n = PERIOD * (periods + 1)
    r = np.tile(excitation(rng), periods + 1)[:, None]
    coloured = [lfilter([1], [1, -pole], rng.standard_normal((n, draws)), axis=0) for pole in (0.8, 0.9, 0.95)]
    disturbance, own, hum = 0.3 * coloured[0], moved * coloured[1], shared * coloured[2]
    u, x, y = (np.zeros((n, draws)) for _ in range(3))
    for k in range(1, n):
        u[k] = r[k] + own[k] - gain * y[k - 1]
        force = np.tanh(2 * u[k - 1]) + 0.2 * np.abs(u[k - 1]) * u[k - 1] - 0.1 * x[k - 1]**3 if cubic else u[k - 1]
        x[k] = 0.8 * x[k - 1] + 0.4 * force
        y[k] = x[k] + disturbance[k]
    if leading:  # a spring and a damper read against displacement
        y = u + 5 * np.gradient(u, axis=0) + disturbance
    noise = read_noise * rng.standard_normal((2, n, draws))
    return (u + noise[0] + hum)[PERIOD:], (y + 0.02 / max(read_noise, 1e-9) * noise[1] + 0.7 * hum)[PERIOD:]


def alarms(u: np.ndarray, y: np.ndarray) -> float:
    """Share of the draws in which feedback is found."""
    return float(np.mean([fed_back([Repeated(a.reshape(-1, PERIOD), b.reshape(-1, PERIOD), 0.01)]) is not None
                          for a, b in zip(u.T, y.T, strict=True)]))


OPEN = {
    "linear": {}, "strongly nonlinear": {"cubic": True}, "two periods": {"periods": 2},
    "one interference on both sensors": {"shared": 0.3},
    "nonlinear, interference": {"cubic": True, "shared": 0.3},
    "input that moves by itself": {"moved": 0.2}, "nonlinear, moves by itself": {"moved": 0.2, "cubic": True},
    "moves by itself, noisy sensor": {"moved": 0.2, "read_noise": 0.4},
    "moves by itself, interference": {"moved": 0.2, "shared": 0.3},
    "output leads": {"moved": 0.2, "leading": True},
    "output leads, noisy sensor": {"moved": 0.2, "leading": True, "read_noise": 0.4},
    "output leads, interference": {"moved": 0.2, "leading": True, "shared": 0.3},
}


@pytest.mark.thinned(2, "seconds")
@pytest.mark.parametrize("how", OPEN.values(), ids=OPEN.keys())
def test_no_feedback_no_alarm(how):
    """Two hundred draws each, of which twice α = 1 % may alarm: the bound is Hoeffding's, and leaves room."""
    assert alarms(*bench(np.random.default_rng(1), DRAWS, **how)) <= 2 * FALSE_ALARM


@pytest.mark.parametrize("how", [{"gain": g, "cubic": c} for g in (0.05, 0.1, 0.3, 1.0) for c in (False, True)] + [
    {"gain": 0.3, "periods": 4}], ids=str)
def test_feedback_is_found(how):
    assert alarms(*bench(np.random.default_rng(2), 20, **how)) >= 0.95


def record(gain: float, seed: int = 3, name: str = "run", **how) -> Record:
    u, y = bench(np.random.default_rng(seed), 1, gain=gain, **how)
    return Record({"u": u[:, 0], "y": y[:, 0]}, 0.01, name=name)


class TestAudit:
    """What the audit says, and where it says nothing."""

    def test_it_says_what_it_means_and_what_to_run(self):
        found, = audit(record(0.3), inputs=("u",), outputs=("y",)).of("feedback")
        assert found.severity == "warning" and found.channel == "u" and found.value > np.sqrt(-2 * np.log(FALSE_ALARM))
        assert "after 0.01 s" in found.evidence and "biased" in found.evidence and "8 periods" in found.evidence
        assert "mean over the periods" in found.mend and "bj" in found.mend and "reference" in found.mend

    def test_an_open_loop_and_unnamed_channels_pass(self):
        assert not audit(record(0.0), inputs=("u",), outputs=("y",)).of("feedback")
        assert not audit(record(0.3)).of("feedback")

    def test_what_does_not_repeat_is_not_judged(self):
        u, y = (record(0.3)[n] for n in "uy")
        cut = Record({"u": u[:PERIOD], "y": y[:PERIOD]}, 0.01)
        assert repeated([view(cut, None)], "u", "y") == []
        assert not audit(cut, inputs=("u",), outputs=("y",)).of("feedback")

    @pytest.mark.parametrize("gain", [0.0, 0.3])
    def test_the_same_excitation_in_several_records(self, gain):
        whole = record(gain)
        runs = [whole.slice(k * PERIOD, (k + 1) * PERIOD) for k in range(PERIODS)]
        assert [r.input.shape for r in repeated([view(r, None) for r in runs], "u", "y")] == [(PERIODS, PERIOD)]
        assert len(audit(runs, inputs=("u",), outputs=("y",)).of("feedback")) == (gain > 0)

    def test_a_sine_that_fits_no_whole_samples_is_no_repetition(self):
        t = np.arange(4000)
        r = Record({"u": np.sin(2 * np.pi * t / 100.3), "y": np.sin(2 * np.pi * t / 100.3 - 1)}, 0.01)
        assert repeated([view(r, None)], "u", "y") == []

    def test_an_input_without_noise_cannot_follow(self):
        r = record(0.0, read_noise=0.0)
        one, = repeated([view(r, None)], "u", "y")
        assert input_follows([one]) is None

    def test_one_jolt_that_reaches_the_input_later_is_no_loop(self):
        """Its phase is smooth over the frequencies, so that the signs there are not independent."""
        r = record(0.0)
        u, y = r["u"].copy(), r["y"].copy()
        at = 2 * PERIOD + PERIOD // 3
        y[at] += 8 * y.std()
        u[at + 5] += 8 * u.std()
        jolted = Record({"u": u, "y": y}, 0.01)
        one, = repeated([view(jolted, None)], "u", "y")
        assert input_follows([one]).found and fed_back([one]) is None
        assert not audit(jolted, inputs=("u",), outputs=("y",)).of("feedback")

    def test_one_period_says_nothing(self):
        one, = repeated([view(record(0.3), None)], "u", "y")
        assert input_follows([Repeated(one.input[:1], one.output[:1], one.sample_time)]) is None

    def test_records_of_two_rates_are_no_repetition(self):
        whole = record(0.3)
        runs = [Record({n: whole[n][k * PERIOD:(k + 1) * PERIOD] for n in "uy"}, t) for k, t in ((1, 0.01), (2, 0.02))]
        assert repeated([view(r, None) for r in runs], "u", "y") == []

    def test_a_name_that_no_record_has_is_an_error(self):
        with pytest.raises(InputError, match="no channel 'w'"):
            audit(record(0.3), inputs=("u",), outputs=("w",))
        assert audit(record(0.3), inputs=("velocity",), outputs=("y",))  # of a displacement, a command derives it

    def test_units_do_not_matter(self):
        one, = repeated([view(record(0.3), None)], "u", "y")
        scaled = Repeated(1e-6 * one.input, 1e5 * one.output, one.sample_time)
        assert input_follows([scaled]).score == pytest.approx(input_follows([one]).score)


def static_gain(records: Record, structure: Structure) -> float:
    model = identify(records, structure).model
    still, step = (Record({"u": np.full(400, level), "y": np.zeros(400)}, 0.01) for level in (0.0, 1.0))
    return float((simulate(model, step, "zero").output - simulate(model, still, "zero").output)[-1, 0])


@pytest.mark.seconds
def test_what_to_run_is_less_biased():
    """The plant's static gain is 0.4/(1 − 0.8) = 2, in a loop of gain 1; the mean of six draws."""
    common = {"input": ("u",), "output": "y", "na": 1, "nb": 1, "nk": 1}
    found: dict[str, list[float]] = {"oe": [], "bj": [], "mean": []}
    for seed in range(6):
        one = record(1.0, seed)
        mean = Record({n: np.tile(one[n].reshape(PERIODS, PERIOD).mean(axis=0), 2) for n in "uy"}, 0.01)
        found["oe"].append(static_gain(one, OutputError(**common)))
        found["bj"].append(static_gain(one, BoxJenkins(**common, nc=1, nd=1)))
        found["mean"].append(static_gain(mean, OutputError(**common)))
    gains = {name: float(np.mean(values)) for name, values in found.items()}
    assert gains["oe"] < 1.5
    assert gains["bj"] == pytest.approx(2, rel=0.05)
    assert gains["mean"] == pytest.approx(2, rel=0.1)


@pytest.mark.seconds
def test_measured_records(shared_data: Path):
    """Every pair of channels of every measured record. One system is under control, the positioning one; it alarms with
    the motion as input and the motor's force, which the controller makes of it, as output."""
    alarming = []
    for folder in sorted(p for p in shared_data.iterdir() if p.is_dir() and p.name != "belgian_block_road"):
        for one in read(folder):
            seen = [view(one, None)]
            moving = [n for n in seen[0].usable if seen[0].moves(n)]
            alarming += [(folder.name, source, answer) for source, answer in permutations(moving, 2)
                     if list(feedback(seen, (source,), (answer,)))]
    assert alarming == [("emps", "displacement", "force")]
