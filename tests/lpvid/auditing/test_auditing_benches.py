"""What an audit must not say of benches whose truth is known: seismic, strut, stage with hum, sensors in volt."""

import numpy as np
import pytest

from lpvid import Record, audit
from lpvid.auditing.view import view


def drive(rng, seconds, rate, low, high, rms):
    """(displacement, velocity) of a random motion between two frequencies [Hz]."""
    n = int(seconds * rate)
    frequency = np.fft.rfftfreq(n, 1 / rate)
    lines = (frequency >= low) & (frequency <= high)
    spectrum = np.zeros(frequency.size, complex)
    spectrum[lines] = (rng.normal(size=lines.sum()) + 1j * rng.normal(size=lines.sum())) / frequency[lines] ** 1.5
    moved, fast = np.fft.irfft(spectrum, n), np.fft.irfft(2j * np.pi * frequency * spectrum, n)
    return rms * moved / moved.std(), rms * fast / moved.std()


def record(displacement, force, rate, unit="m", **kwargs):
    """A record without a velocity."""
    return Record({"displacement": displacement, "force": force}, sample_time=1 / rate,
                  units={"displacement": unit, "force": "N"}, **kwargs)


def test_overtones_folded_back_are_no_noise(rng):
    """15 kN by |v|^0.3 at 20 Hz: the floor of its force is a hundred times what its load cell adds."""
    x, v = drive(rng, 60, 20, 0.2, 2.0, 0.05)
    force = 15e3 * np.abs(v / 0.5) ** 0.3 * np.sign(v) + 10 * rng.normal(size=x.size)
    (noise,) = [f for f in audit(record(x, force, 20)).of("noise-level") if f.channel == "force"]
    assert noise.value > 500
    assert noise.severity == "note" and "record faster" in noise.mend
    assert noise.evidence.startswith("noise at most")


def test_noise_that_overtones_could_be_is_called_either(rng):
    """White noise below the overtones of a square wave: the rate cannot tell them apart, nor does the mend."""
    x, v = drive(rng, 60, 20, 0.2, 2.0, 0.05)
    noisy = record(x, 2e3 * v + 0.15 * 2e3 * v.std() * rng.normal(size=x.size), 20)
    (noise,) = [f for f in audit(noisy).of("noise-level") if f.channel == "force"]
    assert noise.severity == "note"
    assert noise.evidence.startswith("noise at most")
    assert "to decide" in noise.mend and "may as well be noise" in noise.mend


def test_noise_of_a_slow_force_is_still_a_warning(rng):
    """At 500 Hz hardly any overtone of 2 Hz is folded: what lies 17 dB below the force is noise."""
    x, v = drive(rng, 20, 500, 0.2, 2.0, 0.05)
    law = 15e3 * np.abs(v / 0.5) ** 0.3 * np.sign(v)
    (noise,) = [f for f in audit(record(x, law + 0.15 * law.std() * rng.normal(size=x.size), 500)).of("noise-level")
                if f.channel == "force"]
    assert noise.severity == "warning"
    assert noise.value == pytest.approx(0.15 * law.std(), rel=0.1)


def test_hum_is_a_warning_and_no_part_of_the_velocity_that_checks_derive(rng):
    x, v = drive(rng, 40, 500, 0.05, 2.0, 0.01)
    hum = 20e-6 * np.sin(2 * np.pi * 50 * np.arange(x.size) / 500)
    bench = record(x + hum + 1e-7 * rng.normal(size=x.size), 2e3 * v + 3e3 * x + 0.5 * rng.normal(size=x.size), 500)
    (found,) = audit(bench).of("interference")
    assert found.severity == "warning"
    assert "identify does not" in found.mend
    stroke = view(bench, None).stroke
    assert stroke is not None
    assert hum.std() * 2 * np.pi * 50 > 0.2 * v.std()
    assert np.std(stroke[1] - v[:stroke[1].size]) < 0.05 * v.std()


@pytest.mark.seconds
def test_an_elastic_strut_with_unequal_directions_has_one_gas_force(rng):
    """Gas −180 N in every run, rebound three times compression, a mount of 2 MN/m: no load cell to be zeroed."""
    records = []
    for peak in (0.05, 0.26, 1.05):
        t = np.arange(0, 6 * 2 * np.pi * 0.05 / peak, 1e-3)
        x, v = 0.05 * np.sin(peak / 0.05 * t), peak * np.cos(peak / 0.05 * t)
        held = np.where(v > 0, 1800.0, 600.0) * v
        for k in range(1, t.size):  # a Maxwell element of 2 MN/m, 20 ms
            c = 1800.0 if held[k - 1] > 0 else 600.0
            held[k] = held[k - 1] + 1e-3 / 0.02 * (c * v[k] - held[k - 1])
        records.append(record(x + 1e-5 * rng.normal(size=t.size), held - 180 + 3 * rng.normal(size=t.size), 1000,
                              name=f"{peak:g}"))
    found = audit(records).of("force-offset-varies")
    assert [f.severity for f in found] == ["note"]
    assert "zero the load cell" not in found[0].mend
    moved = [r.with_channel("force", r["force"] + 400 * k, "N") for k, r in enumerate(records)]
    assert [f.severity for f in audit(moved).of("force-offset-varies")] == ["warning"]


def test_a_shift_between_runs_of_like_motion_is_not_elastic(rng):
    """The same loops twice, ±136 N at rest: what they hold cancels, 35 % of the rms is the load cell's."""
    t, w = np.arange(20000) / 500, 2 * np.pi * 5
    force = 300 * np.cos(w * (t - 0.015))
    records = [Record({"velocity": 0.2 * np.cos(w * t), "force": force + shift + 2 * rng.normal(size=t.size)},
                      sample_time=1 / 500, units={"velocity": "m/s", "force": "N"}, name=name)
               for name, shift in (("a", 0.0), ("b", 0.35 * force.std()))]
    (found,) = audit(records).of("force-offset-varies")
    assert found.severity == "warning"
    assert found.value == pytest.approx(0.35 * force.std(), rel=0.05)


def test_a_displacement_in_volt_has_no_metres(rng):
    x, v = drive(rng, 10, 500, 0.5, 12, 4.0)
    found = audit(record(x, 900 * v, 500, unit="V"))
    assert found.of("unit-contradicts-name")
    assert not found.of("displacement-range")


def test_a_clock_in_milliseconds_without_a_unit_is_named_beside_the_velocity(tmp_path, rng):
    import lpvid as lpv

    x, v = drive(rng, 10, 500, 0.5, 12, 0.008)
    path = tmp_path / "run.csv"
    table = np.column_stack((2.0 * np.arange(x.size), x, v, 900 * v))
    np.savetxt(path, table, delimiter=",", header="time,displacement [m],velocity [m/s],force [N]", comments="")
    (scale,) = audit(lpv.read(path)).of("velocity-scale")
    assert "time column states no unit" in scale.evidence
    assert "time [ms]" in scale.mend


@pytest.mark.seconds
def test_records_that_disagree_in_sign_are_turned_one_by_one(rng):
    x, v = drive(rng, 10, 500, 0.5, 12, 0.008)
    good, bad = record(x, 900 * v, 500, name="run 1"), record(x[::-1], 900 * v[::-1], 500, name="run 2")
    found = audit([good, bad])
    (turned,), (mixed,) = found.of("reversed-polarity"), found.of("mixed-polarity")
    assert turned.record == "run 2"
    assert turned.mend == "--flip 'force@run 2'"
    assert "force@RECORD" in mixed.mend
    both = audit([good.flip("force"), bad])
    assert {f.mend for f in both.of("reversed-polarity")} == {"--flip force"}
