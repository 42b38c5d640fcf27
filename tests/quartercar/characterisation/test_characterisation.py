"""What a characterisation reads off the rig's records, against the rig's own law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lpvid as lpv
import quartercar as qc
from lpvid.errors import InputError
from lpvid.report import render
from quartercar.characterisation import CharacteriseSettings, Tolerance
from quartercar.characterisation.cycles import blocks_of, noise_of, series_of
from quartercar.characterisation.figures import _apart
from quartercar.characterisation.forces import propose_sine
from quartercar.characterisation.local_fit import local_fit
from quartercar.characterisation.page import characterisation_page
from quartercar.characterisation.runs import runs_of
from quartercar.rig import (
    Constant,
    Creep,
    Experiment,
    Prbs,
    Rig,
    RigDamper,
    Road,
    Sensors,
    Sine,
    Triangle,
    effect,
)

DAMPER = RigDamper()


def law(velocity: float, current: float, damper: RigDamper = DAMPER) -> float:
    """Steady force of the rig's damper at mid stroke [N]: its docstring's equation with w = v."""
    side = damper.asymmetry if velocity > 0 else 1.0
    yielding = damper.yield_base + damper.yield_per_current * damper.yield_current * np.tanh(
        current / damper.yield_current)
    hydraulic = (damper.viscous + damper.viscous_per_current * current) * velocity
    return (side * (hydraulic + yielding * np.tanh(velocity / damper.yield_speed)) - damper.gas_preload
            + damper.friction * np.tanh(velocity / 0.002))


def sine(speed: float, currents: tuple[float, ...], duration: float = 8.0, amplitude: float = 0.03) -> Experiment:
    return Experiment(f"sine-{speed:g}", Sine(amplitude, speed / (2 * np.pi * amplitude)), Constant(currents), duration,
                      len(currents))


@pytest.fixture(scope="module")
def dyno() -> qc.characterisation.Characterisation:
    """Sines at four speeds and two currents, creep, all with noise."""
    rig = Rig(sensors=Sensors(force_noise=0.003), sample_rate=1024.0, oversampling=8)
    records = [r for v in (0.1, 0.13, 0.3, 0.6) for r in rig.run_all(sine(v, (0.0, 1.2)), 1)]
    records += rig.run_all(Experiment("creep", Creep(0.002, 0.002), Constant((0.0,)), 16.0), 1)
    return qc.characterise(records, CharacteriseSettings(speeds=(0.05, 0.1, 0.13, 0.26, 0.3, 0.52, 0.6, 1.05)))


@pytest.mark.seconds
def test_forces_at_the_speed_of_a_test_are_those_of_the_law_within_one_newton(dyno):
    rows = [f for f in dyno.given if f.speed in (0.1, 0.13, 0.3, 0.6)]
    assert len(rows) == 16
    for f in rows:
        assert f.force == pytest.approx(law(f.direction * f.speed, f.current), abs=1.0), f
    scaled = [(f.force - law(f.direction * f.speed, f.current)) / f.std for f in rows]
    assert np.sqrt(np.mean(np.square(scaled))) < 2.0  # the standard errors are of the right size


def test_a_speed_between_tests_is_read_from_the_next_faster_cycle(dyno):
    for f in dyno.given:
        if f.speed in (0.26, 0.52):
            assert {0.26: "sine-0.3", 0.52: "sine-0.6"}[f.speed] in f.source
            assert f.force == pytest.approx(law(f.direction * f.speed, f.current), abs=3.0), f


def test_what_no_test_reaches_is_missing_with_the_test_to_run(dyno):
    assert not [f for f in dyno.given if f.speed == 1.05]
    missing = next(m for m in dyno.missing if "1.05" in m.what)
    assert "reaches 0.6 m/s" in missing.why
    assert "±50 mm at 3.4 Hz" in missing.run


def test_peak_velocity_points(dyno):
    for p in dyno.peaks:
        if p.block.kind == "sine":
            wanted = law(p.direction * p.speed, p.block.run.level)
            assert p.force == pytest.approx(wanted, abs=max(1.5, 4 * p.std)), p


def test_half_the_unequal_damping_of_a_fast_run_is_not_printed_as_gas_force():
    """Rebound three times compression at 50 mm/s: the mean of the directions is 180 N less half the difference."""
    t = np.arange(0, 12.0, 2e-3)
    x, v = 0.02 * np.sin(2.5 * t), 0.05 * np.cos(2.5 * t)
    force = np.where(v > 0, 1800.0, 600.0) * v - 180.0 + np.random.default_rng(1).normal(0.0, 0.1, t.size)
    found = qc.characterise([lpv.Record({"displacement": x, "force": force}, sample_time=2e-3,
                                        units={"displacement": "m", "force": "N"})])
    (slow,) = found.static
    speed = 0.05 * (np.arcsin(0.8) + 0.8 * 0.6) / 1.6  # mean of √(1 − u²) over the inner 80 % of the stroke
    assert slow.gas == pytest.approx(180.0 - 0.5 * (1800.0 - 600.0) * speed, abs=0.2)
    stated = next(line for line in str(found).splitlines() if "50 mm/s, no creep" in line)
    assert f"mean of both directions {-slow.gas:+.4g} N (the gas, which pushes outwards, and half the diff" in stated
    assert f"friction at most {slow.friction:.4g} N" in stated
    assert not any(line.strip().startswith("gas ") for line in str(found).splitlines())


@pytest.mark.seconds
def test_slow_tests_state_their_sign_and_the_level_of_the_command():
    """Compression is damped less than rebound: the mean of both directions is +0.5·(c_r − c_c)·v, in newtons."""
    t, rng, records = np.arange(0, 12.0, 2e-3), np.random.default_rng(1), []
    for volts in (0.0, 2.0):
        x, v = 0.02 * np.sin(2.5 * t), 0.05 * np.cos(2.5 * t)
        force = (1 + volts) * np.where(v > 0, 1800.0, 600.0) * v + rng.normal(0.0, 0.1, t.size)
        records.append(lpv.Record({"displacement": x, "force": force, "voltage": np.full(t.size, volts)},
                                  sample_time=2e-3, name=f"{volts:g} V", roles={"current": "voltage"},
                                  units={"displacement": "m", "force": "N", "voltage": "V"}))
    for rebound, sign in (("positive", 1), ("negative", -1)):
        found = qc.characterise(records, CharacteriseSettings(rebound=rebound))
        lines = [line.strip() for line in str(found).splitlines() if "no creep" in line]
        assert [line.split(",")[0] for line in lines] == ["at 50 mm/s and 0 V", "at 50 mm/s and 2 V"]
        for line, slow in zip(lines, found.static, strict=True):
            assert slow.gas < 0 and f"mean of both directions {-sign * slow.gas:+.4g} N" in line


def test_a_model_of_another_rate_is_drawn_at_its_own(tmp_path):
    """F = 1500 v, identified at 200 Hz, along records at 500 Hz: 1500 v at their samples."""
    t = np.arange(0, 8.0, 2e-3)
    v = 0.05 * np.cos(2.5 * t) + 0.02 * np.cos(31 * t)
    record = lpv.Record({"velocity": v, "displacement": 0.02 * np.sin(2.5 * t) + 0.02 / 31 * np.sin(31 * t),
                         "force": 1500 * v}, sample_time=2e-3, name="a",
                        units={"velocity": "m/s", "displacement": "m", "force": "N"})
    model = lpv.identify(record, lpv.ARX(na=0, nb=1, nk=0, input="velocity", output="force"), sample_rate=200.0).model
    lpv.save(model, tmp_path / "model.json")
    damper = qc.dampers.load_damper(tmp_path / "model.json")
    found = qc.characterise([record], damper=damper)
    (force,) = found.models.values()
    assert force.size == record.n_samples
    np.testing.assert_allclose(force[50:-50], 1500 * v[50:-50], atol=1.5)
    assert any("runs at its own 200 Hz along records at 500 Hz" in n for n in found.notes)
    with pytest.raises(InputError, match="runs along none of these records") as refused:
        qc.characterise([record.with_channel("force", record["force"], "N")], damper=qc.dampers.LpvArx())
    assert "give the channels" not in str(refused.value)


@pytest.mark.seconds
def test_forces_that_the_gas_turns_have_no_ratio_and_a_passive_damper_no_column_of_currents():
    t = np.arange(0, 12.0, 2e-3)
    rng = np.random.default_rng(2)
    records = []
    for speed in (0.05, 0.3):
        x, v = 0.02 * np.sin(speed / 0.02 * t), speed * np.cos(speed / 0.02 * t)
        force = np.where(v > 0, 1800.0, 600.0) * v - 180.0 + rng.normal(0.0, 0.1, t.size)
        records.append(lpv.Record({"displacement": x, "force": force}, sample_time=2e-3, name=f"{speed:g}",
                                  units={"displacement": "m", "force": "N"}))
    found = qc.characterise(records)
    assert {r.speed: r.pushed for r in found.ratios}[0.05] and not {r.speed: r.pushed for r in found.ratios}[0.3]
    shown = render(characterisation_page(found, ()))
    assert "A dash: the gas pushes more" in shown and "both as magnitudes" in shown
    assert shown.count(">current<") == 1  # of the records as used


def test_gas_and_friction_of_the_creep_run(dyno):
    found = next(s for s in dyno.static if s.creep)
    assert found.speed == pytest.approx(0.002, rel=0.05)
    middle = -0.5 * (law(found.speed, 0.0) + law(-found.speed, 0.0))
    half = 0.5 * (law(found.speed, 0.0) - law(-found.speed, 0.0))
    assert found.gas == pytest.approx(middle, abs=0.5) and found.friction == pytest.approx(half, abs=0.5)
    assert found.rate == pytest.approx(DAMPER.gas_stiffness, rel=0.05)
    assert not any("creep" in m.what for m in dyno.missing)


def test_ratio_spread_and_what_gas_takes_away(dyno):
    ratio = next(r for r in dyno.ratios if r.speed == 0.6 and r.current > 1)
    out, back = law(0.6, 1.2), law(-0.6, 1.2)
    assert ratio.ratio == pytest.approx(-out / back, rel=2e-3)
    gas = next(s for s in dyno.static if s.creep).gas
    assert ratio.without_gas == pytest.approx((out + gas) / -(back + gas), rel=2e-3)
    ends = {round(s.current, 1): s for s in dyno.spreads if (s.direction, s.speed) == (1, 0.6)}
    assert ends[0.0].share == 0 and ends[1.2].share == 1


@pytest.mark.seconds
def test_the_place_of_a_middle_current():
    rig = Rig(sensors=Sensors.perfect(), sample_rate=512.0, oversampling=8)
    found = qc.characterise(rig.run_all(sine(0.3, (0.0, 0.6, 1.2), 4.0)), CharacteriseSettings(speeds=(0.3,)))
    middle = next(s for s in found.spreads if s.direction == 1 and 0 < s.share < 1)
    soft, half, hard = (law(0.3, i) for i in (0.0, 0.6, 1.2))
    assert middle.share == pytest.approx((half - soft) / (hard - soft), abs=2e-3)
    assert middle.off_line == pytest.approx(middle.share - 0.5, abs=1e-3)


@pytest.mark.seconds
def test_loops_of_a_viscous_damper_and_of_a_maxwell_element():
    """∮F dx = π c ω X²; K* = i c ω k/(k + i c ω) for a dashpot in series with a spring."""
    c, k, amplitude, frequency = 1500.0, 4e5, 0.01, 4.0
    test = Experiment("maxwell", Sine(amplitude, frequency), Constant((0.0,)), 4.0)
    omega = 2 * np.pi * frequency
    for stiffness in (np.inf, k):
        rig = Rig(RigDamper.viscous_only(c, stiffness), Sensors.perfect(), sample_rate=1024.0, oversampling=16)
        (loop,) = qc.characterise(rig.run(test)).loops
        wanted = 1j * c * omega if stiffness == np.inf else 1j * c * omega * k / (k + 1j * c * omega)
        assert loop.dynamic_stiffness == pytest.approx(abs(wanted), rel=2e-3)
        assert loop.loss_angle == pytest.approx(np.angle(wanted), abs=2e-3)
        assert loop.elastic_stiffness == pytest.approx(wanted.real, abs=2e-3 * abs(wanted))
        assert loop.damping == pytest.approx(wanted.imag / omega, rel=2e-3)
        assert loop.energy == pytest.approx(np.pi * amplitude**2 * wanted.imag, rel=2e-3)
        assert loop.velocity_area == pytest.approx(np.pi * omega * amplitude**2 * wanted.real,
                                                   abs=2e-3 * omega * amplitude**2 * abs(wanted))


def switching_truth(damper: RigDamper, low: float, high: float, velocity: float) -> float:
    """t(F = F_0 + 0.9 (F_1 − F_0)) of a damper without compliance whose current follows with one time constant [s]."""
    tau = damper.rise_time if high > low else damper.fall_time
    t = np.linspace(0.0, 0.1, 100_001)
    force = np.array([law(velocity, i, damper) for i in high + (low - high) * np.exp(-t / tau)])
    share = (force - law(velocity, low, damper)) / (law(velocity, high, damper) - law(velocity, low, damper))
    return float(np.interp(0.9, share, t))


@pytest.fixture(scope="module")
def stepped() -> list[lpv.Record]:
    """Steps of the current every 0.12 s while the piston moves at 100 mm/s; a damper without series spring."""
    rig = Rig(replace(DAMPER, series_stiffness=np.inf), Sensors(), sample_rate=10_000.0, oversampling=2)
    return [rig.run(Experiment("switch", Triangle(0.03, 0.1 / 0.12, 40.0), Prbs(0.12, 0.0, 2.0, 7), 6.0), 3)]


@pytest.mark.seconds
def test_switching_time_within_a_fifth_of_a_millisecond(stepped):
    found = qc.characterise(stepped)
    assert len(found.switching) == 4
    for s in found.switching:
        wanted = switching_truth(found_damper(), s.low, s.high, s.direction * s.speed)
        assert s.time == pytest.approx(wanted, abs=2e-4), s
        assert s.events >= 2 and s.speed == pytest.approx(0.1, rel=0.01)
        assert s.dip == 0 and s.overshoot < 0.02
        tau = 0.005 if s.high > s.low else 0.01
        assert tau < s.settling < 6 * tau


def found_damper() -> RigDamper:
    return replace(DAMPER, series_stiffness=np.inf)


def test_a_known_delay_of_the_force_is_taken_off(stepped):
    late = [r.with_channel("force", np.interp(r.times - 2e-3, r.times, r["force"]), "N") for r in stepped]
    plain, mended = qc.characterise(late), qc.characterise(late, CharacteriseSettings(delays={"force": 2e-3}))
    for a, b in zip(plain.switching, mended.switching, strict=True):
        assert a.time - b.time == pytest.approx(2e-3, abs=1e-4)


def test_steps_in_a_moving_speed_are_refused_with_the_reason():
    rig = Rig(sample_rate=1024.0, oversampling=4)
    record = rig.run(Experiment("road", Road(), Prbs(0.12, 0.0, 2.0, 7), 6.0), 3)
    found = qc.characterise(record)
    assert not found.switching
    assert "speed is not constant" in next(m for m in found.missing if m.what == "switching time").why
    assert found.histograms and not found.forces


@pytest.mark.seconds
def test_temperature_coefficient_of_a_fading_damper():
    """Viscous fade exp(−k ΔT): d ln F/dT = −k."""
    rig = Rig(RigDamper.viscous_only(3000.0), Sensors.perfect(), (effect("viscous-fade", rate=0.02),),
              sample_rate=256.0, oversampling=8)
    record = rig.run(Experiment("warm", Sine(0.03, 2.0), Constant((0.0,)), 30.0), truth=True)
    record = record.with_channel("temperature", 293.15 + record["temperature_true"], "K")
    found = qc.characterise(record)
    for d in found.drifts:
        assert d.warmest - d.coolest > 0.5
        assert d.per_kelvin == pytest.approx(-0.02, rel=0.05)  # a line through exp(−k ΔT), by its mean
        assert d.change == pytest.approx(-0.02 * (d.warmest - d.coolest), rel=0.05)


def test_histogram_is_that_of_numpy():
    record = Rig(sample_rate=256.0, oversampling=4).run(Experiment("road", Road(), Constant((0.6,)), 20.0))
    (h,) = qc.characterise(record).histograms
    assert h.share.sum() + h.below + h.above == pytest.approx(1.0)
    v = record["velocity"]
    assert h.share[25] == pytest.approx(np.mean((v >= 0) & (v < 0.01)), abs=1e-12)
    assert h.rms == pytest.approx(np.sqrt(np.mean(v**2))) and h.power == pytest.approx(np.mean(v * record["force"]))


def test_random_motion_at_one_current_gives_forces_too():
    record = Rig(sample_rate=512.0, oversampling=8).run(Experiment("road", Road(), Constant((0.0,)), 30.0))
    found = qc.characterise(record, CharacteriseSettings(speeds=(0.05, 0.1)))
    for f in found.given:
        assert f.method == "random"
        assert f.force == pytest.approx(law(f.direction * f.speed, 0.0), abs=max(4.0, 4 * f.std))
    assert len(found.given) == 4


def test_triangles_count_at_their_own_speed_only():
    rig = Rig(sensors=Sensors(force_noise=0.002), sample_rate=512.0, oversampling=8)
    record = rig.run(Experiment("ramp", Triangle(0.012, 0.1 / 0.048, 40.0), Constant((0.0,)), 6.0))
    found = qc.characterise(record, CharacteriseSettings(speeds=(0.05, 0.1)))
    assert found.blocks[0].kind == "triangle" and {f.speed for f in found.given} == {0.1}
    for f in found.given:
        assert f.force == pytest.approx(law(f.direction * 0.1, 0.0), abs=max(1.0, 3 * f.std))
        assert f.force == pytest.approx(law(f.direction * found.blocks[0].peak, 0.0), abs=1.0)


# -- tolerance and specimens ---------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def three_specimens() -> list[lpv.Record]:
    records = []
    for n, share in enumerate((0.95, 1.0, 1.08)):
        rig = Rig(RigDamper.viscous_only(2000.0 * share), Sensors(0.002), sample_rate=256.0, oversampling=4)
        records.append(replace(rig.run(sine(0.3, (0.0,), 4.0), n), name=f"S{n}_sine"))
    return records


@pytest.mark.seconds
def test_specimens_spread_and_bands(three_specimens):
    settings = CharacteriseSettings(speeds=(0.3,), specimen=r"(S\d+)_")
    found = qc.characterise(three_specimens, settings, tolerance=Tolerance.parse("6.2%+1N"))
    assert found.data.specimens == ("S0", "S1", "S2")
    for s in found.specimens:
        wanted = 2000.0 * 0.3 * np.array([0.95, 1.0, 1.08])
        assert abs(s.mean) == pytest.approx(wanted.mean(), rel=3e-3)
        assert s.std == pytest.approx(wanted.std(ddof=1), rel=0.03)
        assert (s.lowest[0], s.highest[0]) == ("S0", "S2")
    verdicts = {c.force.specimen: c.inside for c in found.checks}
    assert verdicts == {"S0": True, "S1": True, "S2": False}  # −5.9, −1.0 and +6.9 % of the mean, band ±6.4 %
    assert "outside the tolerance band" in found.verdict


@pytest.mark.seconds
def test_the_sign_of_rebound_changes_tables_and_bands_alike(three_specimens, tmp_path):
    from quartercar.characterisation.tables import forces_csv, write_tables

    up = qc.characterise(three_specimens[0], CharacteriseSettings(speeds=(0.3,)))
    down = qc.characterise(three_specimens[0], CharacteriseSettings(speeds=(0.3,), rebound="negative"))
    column = [line.split(",")[4] for line in forces_csv(up).splitlines()[1:]]
    assert [float(c) for c in column] == [-float(line.split(",")[4]) for line in forces_csv(down).splitlines()[1:]]
    written = write_tables(down, tmp_path)
    again = qc.characterise(three_specimens[0], CharacteriseSettings(speeds=(0.3,), rebound="negative"),
                            tolerance=Tolerance.parse("1%", written[0]))
    assert all(c.inside for c in again.checks) and len(again.checks) == 2


# -- pieces --------------------------------------------------------------------------------------------------------
@pytest.mark.seconds
def test_units_of_the_input_change_nothing():
    rig = Rig(sample_rate=256.0, oversampling=4)
    record = rig.run(sine(0.3, (0.0,), 4.0))
    columns = {"time [ms]": 1e3 * record.times, "displacement [mm]": 1e3 * record["displacement"],
               "velocity [mm/s]": 1e3 * record["velocity"], "current [mA]": 1e3 * record["current"],
               "force [kN]": 1e-3 * record["force"]}
    a, b = qc.characterise(record), qc.characterise(columns)
    assert len(a.given) == len(b.given) == 10
    assert [f.force for f in b.given] == pytest.approx([f.force for f in a.given], rel=1e-6)


@pytest.mark.seconds
def test_velocity_alone_will_do_and_reversed_polarity_is_stated():
    record = Rig(sample_rate=512.0, oversampling=4).run(sine(0.3, (0.0,), 6.0))
    bare = lpv.Record({n: record.channels[n] for n in ("velocity", "force")}, sample_time=record.sample_time)
    settings = CharacteriseSettings(speeds=(0.3,))
    whole, found, turned = (qc.characterise(r, settings) for r in (record, bare, record.flip("force")))
    for a, b, c in zip(whole.forces, found.forces, turned.forces, strict=True):
        assert b.force == pytest.approx(a.force, abs=3.0) and c.force == pytest.approx(a.force, abs=1e-9)
    assert any("integral of the velocity" in c for c in found.data.caveats)
    assert any("opposes the velocity" in c for c in turned.data.caveats)


def test_cycles_are_found_under_noise_drift_and_start(rng):
    t = np.arange(6000) / 500
    x = 0.01 * np.sin(2 * np.pi * 1.3 * t) * np.clip(t / 2, 0, 1) + 0.003 * np.exp(-t / 3)
    record = lpv.Record({"displacement": x + 2e-5 * rng.standard_normal(t.size), "force": 50 * np.gradient(x, 0.002)},
                        sample_time=0.002)
    (run,) = runs_of([record], CharacteriseSettings()).runs
    blocks = blocks_of(run)
    best = max(blocks, key=lambda b: len(b.cycles))
    assert best.kind == "sine" and len(best.cycles) >= 11
    assert best.frequency == pytest.approx(1.3, rel=1e-3) and best.amplitude == pytest.approx(0.01, rel=0.01)
    assert best.peak == pytest.approx(0.01 * 2 * np.pi * 1.3, rel=0.01)


def test_random_motion_has_no_cycles():
    record = Rig(sample_rate=256.0, oversampling=2).run(Experiment("road", Road(), Constant((0.6,)), 30.0), 4)
    (run,) = runs_of([record], CharacteriseSettings()).runs
    assert blocks_of(run) == ()


def test_series_and_noise_of_known_signals(rng):
    t = np.arange(500) / 500
    x = 1.0 + 2.0 * np.cos(2 * np.pi * 2 * t) - 0.5 * np.sin(4 * np.pi * 2 * t) + 0.3 * t
    c, value, slope = series_of(x, 1 / 500, 0.5, 3)
    assert c == pytest.approx(np.array([2.0, 0.5j, 0.0]), abs=1e-9) and value == pytest.approx(x)
    exact = -4 * np.pi * 2 * np.sin(4 * np.pi * t) - 0.5 * 8 * np.pi * np.cos(8 * np.pi * t) + 0.3
    assert slope == pytest.approx(exact, abs=1e-8)
    assert noise_of(x + 0.05 * rng.standard_normal(500)) == pytest.approx(0.05, rel=0.15)


@pytest.mark.seconds
def test_local_fit_against_its_own_scatter():
    u = np.linspace(-1, 1, 400)
    group = np.arange(400) % 8
    values, errors = [], []
    for seed in range(60):
        y = np.tanh(8 * (u + 0.05)) + 0.1 * np.random.default_rng(seed).standard_normal(400)
        found = local_fit(u, y, group, 1.0)
        values.append(found.value)
        errors.append(found.std)
    assert np.mean(values) == pytest.approx(np.tanh(0.4), abs=0.03)
    assert np.std(values) == pytest.approx(np.mean(errors), rel=0.6)


@pytest.mark.seconds
def test_a_tolerance_that_has_nothing_to_check_says_why(three_specimens, tmp_path):
    settings = CharacteriseSettings(speeds=(0.3,))
    band = Tolerance.parse("5%")
    alone = qc.characterise(three_specimens[0], settings, tolerance=band)
    assert not alone.checks and alone.missing[0].what == "tolerance band" and "--specimen" in alone.missing[0].run
    assert characterisation_page(alone).steps[0].text.startswith("Run the tests")
    (tmp_path / "nominal.csv").write_text("speed [m/s],direction,force [N]\n0.9,rebound,100\n")
    other = qc.characterise(three_specimens[0], settings, tolerance=Tolerance.parse("5%", tmp_path / "nominal.csv"))
    assert not other.checks and "nominal forces holds none" in other.missing[0].why
    fine = CharacteriseSettings(speeds=(0.3,), specimen=r"(S\d+)_")
    assert not any(m.what == "tolerance band" for m in qc.characterise(three_specimens, fine, tolerance=band).missing)


@pytest.mark.parametrize("start", [0.0, 0.25, 0.5, 0.75])
def test_three_creeping_cycles_from_any_place_of_the_stroke_give_gas_and_friction(start):
    """The test that the page asks for. From mid stroke to mid stroke one cycle alone lies between two crossings."""
    amplitude, speed, rate = 2e-3, 1e-3, 200.0
    phase = start + np.arange(0.0, 3.0, speed / (4 * amplitude * rate))
    out = np.mod(phase, 1.0)
    x = amplitude * np.where(out < 0.25, 4 * out, np.where(out < 0.75, 2 - 4 * out, 4 * out - 4))
    way = np.where((out < 0.25) | (out >= 0.75), 1.0, -1.0)
    noise = np.random.default_rng(0).normal(size=(2, x.size))
    found = qc.characterise(lpv.Record({"displacement": x + 2e-6 * noise[0],
                                    "force": 40.0 * way - 150.0 + 3000.0 * x + 0.5 * noise[1]}, 1.0 / rate,
                                   units={"displacement": "m", "force": "N"}))
    slow, = found.static
    assert slow.creep
    assert slow.gas == pytest.approx(150.0, abs=0.3)
    assert slow.friction == pytest.approx(40.0, abs=0.3)
    assert slow.rate == pytest.approx(3000.0, rel=0.02)


@pytest.mark.seconds
def test_the_text_says_what_a_fast_test_leaves_in_gas_and_friction():
    """A damping of 1200 N·s/m outwards and 720 inwards: 240 N·s/m of mean speed over the inner 80 % of the stroke."""
    t = np.arange(0.0, 6.0, 1e-3)
    x, v = 0.0125 * np.sin(8 * t), 0.1 * np.cos(8 * t)
    found = qc.characterise(lpv.Record({"displacement": x, "force": np.where(v > 0, 1200 * v, 720 * v)}, 1e-3,
                                   units={"displacement": "m", "force": "N"}))
    slow, = found.static
    mean = 0.1 * (0.8 * 0.6 + np.arcsin(0.8)) / 1.6  # of 0.1 sqrt(1 - u^2) over |u| < 0.8
    assert slow.gas == pytest.approx(-240.0 * mean, abs=0.1)
    assert "half the difference of their damping" in str(found)


def test_labels_of_frequencies_stand_apart_and_none_is_lost_for_nothing():
    """A chain of close frequencies was thinned by its neighbours, kept or not: of 1 to 2 Hz only the first was left."""
    assert _apart([2.0, 1.0, 1.2, 1.4, 1.6, 1.8, 1.8]) == [1.0, 1.4, 1.8]
    assert _apart([0.5, 5.0, 5.1]) == [0.5, 5.0]


def test_the_proposed_sines_reach_their_speed():
    for speed in (0.05, 0.1, 0.13, 0.26, 0.3, 0.52, 0.6, 1.05, 0.0007):
        words = propose_sine(speed).removeprefix("run a sine of ±").split()
        assert 2 * np.pi * float(words[3]) * 1e-3 * float(words[0]) >= speed * (1 - 1e-9), words


def record(t, x, force, name="run"):
    return lpv.Record({"displacement": x, "force": force}, sample_time=float(t[1]), name=name,
                      units={"displacement": "m", "force": "N"})


@pytest.mark.seconds
def test_the_elastic_stiffness_is_not_that_of_the_noise_and_its_error_is_of_the_right_size():
    """Dashpot, dry friction and a spring of 1500 N/m at 4 Hz: K' is 2 % of |K*|; a slope fitted in a cycle took it."""
    t = np.arange(0, 4.0, 1e-3)
    x, v = 0.02 * np.sin(8 * np.pi * t), 0.16 * np.pi * np.cos(8 * np.pi * t)
    clean = 3000 * v + 60 * np.tanh(v / 0.005) + 1500 * x
    one = CharacteriseSettings(speeds=(0.3,))
    found = [qc.characterise([record(t, x, clean + np.random.default_rng(seed).normal(0, 8, t.size))], one).loops[0]
             for seed in range(12)]
    values = np.array([loop.elastic_stiffness for loop in found])
    assert values.mean() == pytest.approx(1500, abs=20)
    assert values.std() < 40  # 8 N over 1 s in quadrature to 0.02 m: 8·√2/√(14·250)/0.02 = 10 N/m; it was 150
    assert np.mean([loop.stiffness_std for loop in found]) == pytest.approx(values.std(), rel=0.6)
    drifting = qc.characterise([record(t, x, clean + 30 * t)], one).loops[0]  # 7.5 N in a cycle, 120 N/m if counted
    assert drifting.elastic_stiffness == pytest.approx(1500, abs=5)


@pytest.mark.seconds
def test_the_work_of_a_coarsely_sampled_sine_is_not_that_of_the_polygon_in_it():
    t = np.arange(0, 2.0, 0.005)  # 25 samples in a cycle: the inscribed polygon has sin(2π/25)/(2π/25), 1 % less
    x, v = 0.02 * np.sin(16 * np.pi * t), 0.32 * np.pi * np.cos(16 * np.pi * t)
    (loop,) = qc.characterise([record(t, x, 1000 * v)], CharacteriseSettings(raw=True)).loops
    assert loop.energy == pytest.approx(np.pi * 1000 * 16 * np.pi * 0.02**2, rel=1e-3)


@pytest.mark.seconds
def test_a_speed_beyond_the_slow_test_is_read_from_the_faster_one():
    """The slow sine reaches 0.1257 m/s; read from it, 0.13 m/s was off by 40 N in 1700 and its branches by 1800 N."""
    rng, records = np.random.default_rng(1), []
    for frequency in (0.5, 1.5):
        t = np.arange(0, 8 / frequency, 5e-4)
        x, v = 0.04 * np.sin(2 * np.pi * frequency * t), 0.08 * np.pi * frequency * np.cos(2 * np.pi * frequency * t)
        force = 10 * (np.where(v > 0, 2000, 1000) * v + 60 * np.tanh(v / 0.01) + 750 * x - 150)
        records.append(record(t, x, force + rng.normal(0, 5, t.size), f"sine-{frequency:g}"))
    found = qc.characterise(records, CharacteriseSettings(speeds=(0.1257, 0.13)))
    rows = {(f.speed, f.direction): f for f in found.forces}
    assert rows[0.13, 1].force == pytest.approx(1700, abs=5) and "sine-1.5" in rows[0.13, 1].source
    assert rows[0.13, -1].force == pytest.approx(-3400, abs=5) and rows[0.13, 1].std < 3
    assert "sine-0.5" in rows[0.1257, 1].source  # its own speed is still read from the slow test


def test_half_a_stroke_is_no_random_motion():
    """The spring's part of one stroke does not average out: 191.6 ± 0.4 N was printed for 170 N."""
    t = np.arange(0, 0.3, 1e-3)
    x, v = 0.02 * np.sin(3 * np.pi * t), 0.06 * np.pi * np.cos(3 * np.pi * t)
    found = qc.characterise([record(t, x, 1500 * v + 1500 * x - 100)], CharacteriseSettings(speeds=(0.1, 0.13)))
    assert not found.given
    assert "1 stroke reaches 0.13 m/s" in next(m.why for m in found.missing if "0.13" in m.what)


def test_signs_that_are_both_turned_are_named_where_the_force_pulls_in_both_directions():
    t = np.arange(0, 30.0, 2e-3)
    x = 0.01 * np.abs(np.mod(t / 5, 2) - 1) - 0.005
    force = 800 * np.gradient(x, t) + 20 * np.sign(np.gradient(x, t)) - 150
    right, turned = qc.characterise([record(t, x, force)]), qc.characterise([record(t, -x, -force)])
    assert not right.data.caveats
    (caveat,) = turned.data.caveats
    assert "pulls in both directions" in caveat and "--flip displacement --flip force" in caveat
    assert caveat in str(turned) and caveat in turned.to_dict()["caveats"]


def test_a_delay_of_an_unknown_channel_or_of_a_stroke_is_refused():
    t = np.arange(0, 4.0, 1e-3)
    wave = [record(t, 0.02 * np.sin(10 * t), 900 * np.cos(10 * t))]
    with pytest.raises(InputError, match="no record has the channel 'load'"):
        qc.characterise(wave, CharacteriseSettings(delays={"load": 1e-3}))
    with pytest.raises(InputError, match="longer than the record 'run'"):
        qc.characterise(wave, CharacteriseSettings(delays={"force": 4.0}))
    with pytest.raises(InputError, match=r"as long as a stroke of 'run' or longer.*--delay force=1.2ms"):
        qc.characterise(wave, CharacteriseSettings(delays={"force": 1.2}))


@pytest.mark.seconds
def test_records_of_two_settings_are_not_one_damper():
    """Two clicker settings at one speed: the forces table took one of them and printed ± 0.3 N."""
    t = np.arange(0, 6.0, 2e-3)
    x, v = 0.02 * np.sin(8 * t), 0.16 * np.cos(8 * t)
    runs = [record(t, x, damping * v, name) for name, damping in (("open", 900.0), ("closed", 1500.0))]
    found = qc.characterise(runs)
    (caveat,) = found.data.caveats
    assert "Tests of one speed disagree" in caveat and "--specimen" in caveat
    assert not qc.characterise(runs, CharacteriseSettings(specimen="file")).data.caveats
    assert not qc.characterise([runs[0], replace(runs[0], name="again")]).data.caveats
    page = render(characterisation_page(found, ()))
    assert "Hz, open" in page.replace("\u00a0", " ") and "Hz, closed" in page.replace("\u00a0", " ")


@pytest.mark.seconds
def test_a_damper_of_millimetres_per_second_creeps_in_its_slowest_test_alone():
    """Damping of 1e5 N s/m in rebound and 5e4 in compression: at 0.9 mm/s half the difference is 23 N of 30."""
    records = []
    for name, period in (("slow", 40.0), ("fast", 0.4)):
        t = np.arange(0, 5 * period, period / 400)
        x, v = 6e-5 * np.sin(2 * np.pi * t / period), 12e-5 * np.pi / period * np.cos(2 * np.pi * t / period)
        force = np.where(v > 0, 1e5, 5e4) * v + 3 * np.tanh(v / 1e-6) - 20
        records.append(record(t, x, force + np.random.default_rng(0).normal(0, 0.02, t.size), name))
    found = qc.characterise(records)
    slow, fast = found.static
    assert "--speeds 9.4e-06,0.00094, or run sines" in next(m.run for m in found.missing if "forces at" in m.what)
    assert slow.creep and slow.gas == pytest.approx(20, abs=0.3)
    assert not fast.creep and abs(fast.gas) < 10


def moved(parts: list[np.ndarray], rate: float, law_of, name: str = "run") -> lpv.Record:
    """A record of displacements one after the other, with a force by the velocity and a little noise."""
    rng = np.random.default_rng(3)
    x = np.concatenate(parts)
    x = np.convolve(np.pad(x, 5, mode="edge"), np.hanning(13)[1:-1] / np.hanning(13).sum(), "valid")
    v = np.gradient(x, 1 / rate)
    force = law_of(v) + rng.normal(size=x.size)
    return lpv.Record({"displacement": x + 2e-6 * rng.normal(size=x.size), "force": force},
                      sample_time=1 / rate, units={"displacement": "m", "force": "N"}, name=name)


def ramps(half: float, speed: float, cycles: int, rate: float, rest: float = 0.3) -> list[np.ndarray]:
    """A triangle from mid stroke to mid stroke between two rests [m]."""
    phase = np.mod(np.arange(0, cycles, speed / (4 * half * rate)), 1.0)
    still = np.zeros(round(rest * rate))
    out = half * np.where(phase < 0.25, 4 * phase, np.where(phase < 0.75, 2 - 4 * phase, 4 * phase - 4))
    return [still, out, still]


def test_sets_of_four_cycles_from_rest_to_rest_in_one_record_are_tests():
    """From mid stroke to mid stroke four cycles have two whole ones between upward crossings and rests."""
    tests = ((0.004, 0.004), (0.02, 0.02), (0.04, 0.05), (0.04, 0.13), (0.04, 0.26))
    record = moved([p for half, speed in tests for p in ramps(half, speed, 4, 500.0)], 500.0,
                   lambda v: 1500.0 * v + 40.0 * np.tanh(v / 5e-4) - 60.0)
    found = qc.characterise(record, CharacteriseSettings(speeds=(0.05, 0.1, 0.13, 0.26)))
    assert [round(1e3 * b.peak, 0) for b in found.blocks] == [4, 20, 50, 130, 260]
    assert repr(found.blocks[0]) == f"Block('run': {found.blocks[0].label}, 3 cycles)"
    slow = min(found.static, key=lambda s: s.speed)
    assert slow.creep and slow.gas == pytest.approx(60.0, abs=0.5) and slow.friction == pytest.approx(46.0, abs=0.5)
    for f in found.given:
        assert f.method == "triangle" and f.force == pytest.approx(
            f.direction * (1500.0 * f.speed + 40.0) - 60.0, abs=3.0), f
    between = next(m for m in found.missing if m.what == "forces at 0.1 m/s")
    assert "no test is as fast" not in between.why and "one speed each" in between.why
    assert not any("polarity" in c for c in found.data.caveats)


def test_a_rest_between_two_tests_of_one_stroke_belongs_to_neither():
    """A rest of 0.6 s and a half of the faster test last as long together as a half of the slower one."""
    record = moved([p for speed in (0.05, 0.1) for p in ramps(0.03, speed, 4, 400.0)], 400.0, lambda v: 2000.0 * v)
    found = qc.characterise(record, CharacteriseSettings(speeds=(0.05, 0.1)))
    assert len(found.given) == 4
    for f in found.given:
        assert f.force == pytest.approx(f.direction * 2000.0 * f.speed, abs=2.0), f


@pytest.mark.seconds
@pytest.mark.parametrize("periodic", [True, False])
def test_a_force_at_the_end_of_its_range_is_not_given(periodic):
    rate, rng = 500.0, np.random.default_rng(4)
    t = np.arange(0, 30, 1 / rate)
    x = 0.05 * np.sin(2 * np.pi * 1.66 * t)
    if not periodic:
        x = sum(0.02 / f * np.sin(2 * np.pi * f * t + p) for f, p in zip(
            rng.uniform(0.4, 3, 9), rng.uniform(0, 6.28, 9), strict=True))
    record = moved([x], rate, lambda v: 2000.0 * v)
    clipped = record.with_channel("force", np.clip(record["force"], -300.0, 300.0), "N")
    found = qc.characterise(clipped, CharacteriseSettings(speeds=(0.05, 0.1, 0.13, 0.26)))
    assert {f.speed for f in found.given} == {0.05, 0.1, 0.13}
    assert all(abs(f.force) < 300.0 for f in found.given)
    assert any("rests on an end of its range" in c for c in found.data.caveats)
    assert any(m.what == "force at 0.26 m/s" and "end of its range" in m.why for m in found.missing)
    whole = qc.characterise(record, CharacteriseSettings(speeds=(0.26,)))
    assert len(whole.given) == 2 and not whole.data.caveats


@pytest.mark.seconds
def test_forces_of_a_strut_are_written_out():
    record = moved([0.04 * np.sin(np.arange(0, 30, 0.01))], 100.0, lambda v: 20e3 * np.tanh(v / 1e-3) - 3e3)
    found = qc.characterise(record, CharacteriseSettings(speeds=(0.04,)))
    assert "rebound 17000 ±" in str(found) and "compression -23000 ±" in str(found) and "e+04" not in str(found)
    assert "e+04" not in render(found.page())


@pytest.mark.seconds
def test_tests_of_one_speed_and_two_frequencies_are_not_called_two_dampers_only():
    """A mass of 12 kg beside a damper: at 0.2 m/s and 2 or 30 Hz the force differs."""
    rate, parts = 2000.0, []
    for f in (2.0, 30.0):
        t = np.arange(0, 20 / f, 1 / rate)
        x = 0.2 / (2 * np.pi * f) * np.sin(2 * np.pi * f * t)
        force = (1500.0 if f < 10 else 900.0) * np.gradient(x, t)
        parts.append(lpv.Record({"displacement": x, "force": force}, 1 / rate, name=f"at{f:g}",
                                units={"displacement": "m", "force": "N"}))
    (caveat,) = qc.characterise(parts).data.caveats
    assert "2 and 30 Hz" in caveat and "elastic or inertial" in caveat


@pytest.mark.parametrize(("damping", "friction", "creeps"), [(3e5, 0.0, False), (1e3, 60.0, True), (2e4, 60.0, False)])
def test_a_slow_test_whose_force_is_damping_does_not_give_friction(damping, friction, creeps):
    """6.3 mm/s: 1900 N of a yaw damper that has no friction were printed as friction at creep."""
    records = []
    for amplitude, frequency in ((1e-3, 1.0), (1e-3, 2.0), (5e-3, 2.0)):
        t = np.arange(0, 5 / frequency, 1 / 500)
        v = 2 * np.pi * frequency * amplitude * np.cos(2 * np.pi * frequency * t)
        force = damping * v + friction * np.tanh(v / 1e-4)
        records.append(record(t, amplitude * np.sin(2 * np.pi * frequency * t), force, f"{amplitude:g}-{frequency:g}"))
    found = qc.characterise(records)
    assert found.static[0].speed == pytest.approx(0.00628, rel=1e-2)
    assert found.static[0].creep is creeps
    lacking = [m for m in found.missing if "friction at creep" in m.what]
    assert bool(lacking) is not creeps
    if lacking:
        assert "damping for the most part" in lacking[0].why and "0.6 mm/s" in lacking[0].run
        assert "friction at most" in str(found)


@pytest.mark.seconds
def test_a_record_with_missing_samples_is_one_record_in_pieces():
    t = np.arange(0, 12.0, 2e-3)
    x = 0.02 * np.sin(2 * np.pi * t)
    force = 1000 * np.gradient(x, t)
    x[::2000] = np.nan
    found = qc.characterise([record(t, x, force)])
    assert found.verdict.startswith("1 record in 3 pieces, ")
