"""Quasi-LPV dampers: a spring in series recovered from an integrated law; real dampers, settings by training only."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import lpvid as lpv
from lpvid.condition import resample, split_tail
from lpvid.errors import InputError
from lpvid.record import Record
from quartercar.dampers.blackbox import rest
from quartercar.dampers.blackbox.compliance import Compliance, QuasiLpv
from quartercar.dampers.facts import Facts
from quartercar.dampers.fitting import FitSettings

RATE = 400.0
SPRING, YIELD, KNEE, VISCOUS, GAS, PRELOAD = 3e5, 600.0, 0.04, 900.0, 5000.0, -150.0


def inverse_law(force: float) -> float:
    """Fluid speed at which 600 tanh(w/0.04) + 900 w carries a force."""
    low, high = -5.0, 5.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if YIELD * np.tanh(middle / KNEE) + VISCOUS * middle < force else (low, middle)
    return 0.5 * (low + high)


TABLE = np.linspace(-3000, 3000, 20001)
SPEEDS = np.array([inverse_law(f) for f in TABLE[::20]])


def measured(seed: int, seconds: float = 5.0, turn: float = 1.0, centre: float = 0.0) -> Record:
    """Ḟ = k (v − g(F)), integrated tightly; a gas spring beside."""
    rng = np.random.default_rng(seed)
    f, phase = rng.uniform(0.5, 12, 12), rng.uniform(0, 2 * np.pi, 12)
    omega = 2 * np.pi * f

    def moved(t: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
        angle = np.multiply.outer(t, omega) + phase
        return 0.08 * np.cos(angle).sum(axis=-1), (0.08 / omega * np.sin(angle)).sum(axis=-1)

    t = np.arange(int(seconds * RATE)) / RATE
    run = solve_ivp(lambda s, y: [SPRING * (moved(s)[0] - np.interp(y[0], TABLE[::20], SPEEDS))], (0, t[-1]), [0.0],
                    "LSODA", t, rtol=1e-7, atol=1e-3)
    v, x = moved(t)
    force = run.y[0] + GAS * x + PRELOAD
    return Record({"velocity": v, "displacement": x + centre, "force": turn * force}, 1 / RATE,
                  units={"velocity": "m/s", "displacement": "m", "force": "N"})


def esr(damper, record: Record) -> float:
    run, force = damper.simulate(record), record["force"]
    error = force[run.start:] - run.output[run.start:, 0]
    return float(np.sum(error**2) / np.sum((force[run.start:] - force[run.start:].mean()) ** 2))


@pytest.mark.seconds
def test_spring_law_and_gas_come_back_from_reversed_data() -> None:
    training, held_out = (measured(s, turn=-1.0, centre=0.3) for s in (0, 1))
    facts = Facts.of([training], polarity=-1)
    assert facts.centre == pytest.approx(0.3, abs=0.05)
    damper = Compliance.suited(facts).replace(lags=1)
    found = damper.estimate([training], FitSettings()).damper
    assert not found.current and found.lags == 1 and found.polarity == -1
    assert esr(found, held_out) < 2e-3
    assert np.exp(found.values["ln k_h"]) == pytest.approx(SPRING, rel=0.15)
    assert found.values["displacement"] == pytest.approx(GAS, rel=0.1)
    w = np.array([-0.3, -0.1, 0.05, 0.2])
    law = YIELD * np.tanh(w / KNEE) + VISCOUS * w
    gas = found.conservative_force(np.zeros(1))
    np.testing.assert_allclose(found.static_force(w) - gas, law, rtol=0.1)
    assert gas[0] == pytest.approx(PRELOAD + GAS * (found.centre - 0.3), abs=30)
    assert found.passivity().passive
    validated = lpv.validate(found, held_out)
    assert validated.overall.free_run.esr == pytest.approx(esr(found, held_out), rel=1e-6)
    assert validated.overall.one_step.esr < validated.overall.free_run.esr


@pytest.mark.seconds
def test_work_of_a_cycle_against_the_law() -> None:
    """At 0.5 Hz the spring hardly matters: W = ∮F_s(v) v dt of the static law."""
    found = Compliance(lags=1).estimate([measured(0)], FitSettings()).damper
    t = np.linspace(0, 2.0, 20001)
    v = 0.05 * np.pi * np.cos(np.pi * t)
    work = float(np.trapezoid((YIELD * np.tanh(v / KNEE) + VISCOUS * v) * v, t))
    assert found.energy_per_cycle(0.05, 0.5) == pytest.approx(work, rel=0.03)


@pytest.mark.slow
def test_real_damper_random_with_settings_from_its_training_part(shared_data: Path) -> None:
    record = resample(lpv.read(str(shared_data / "mr_damper_random" / "estimation.csv"))[0], 500.8)
    record = record.with_roles({"current": "voltage"})
    cut = round(8 * 500.8)
    training, held_out = record.slice(0, cut), record.slice(cut, record.n_samples)
    found = Compliance.suited(Facts.of([training])).estimate([training], FitSettings())
    damper = found.damper
    assert isinstance(damper, Compliance) and damper.lags and damper.levels
    assert esr(damper, held_out) < 0.015
    assert any("cross-validated ESR on the training data" in n for n in found.notes)
    assert {"current_tau_rise", "current_tau_fall", "current_delay"} <= set(damper.names)


@pytest.mark.slow
def test_real_damper_fixed_voltage_as_measured(shared_data: Path) -> None:
    path = next((shared_data / "mr_damper_fixed_voltage").glob("*.csv"))
    training, held_out = split_tail(lpv.read(str(path))[0])
    damper = QuasiLpv.suited(Facts.of([training], polarity=-1))
    found = damper.estimate([training], FitSettings()).damper
    assert 100 * (1 - esr(found, held_out) ** 0.5) > 91.5
    run, force = found.simulate(held_out), held_out["force"]
    assert np.corrcoef(run.output[run.start:, 0], force[run.start:])[0, 1] > 0.99  # in the sense of the record
    assert found.static_force(np.array([0.1]))[0] > 0 > force @ held_out["velocity"]  # in its own
    embedded = found.to_lpv(1 / 200)
    assert embedded.box.names == ("rho",)


def test_refusals() -> None:
    with pytest.raises(InputError, match="lags"):
        Compliance(lags=0)
    with pytest.raises(InputError, match="segments"):
        QuasiLpv(segments=1)
    with pytest.raises(InputError, match="no LPV form of 'compliance'"):
        Compliance().to_lpv(0.01)
    giving = measured(0, 2.0, turn=-1.0)
    with pytest.raises(InputError, match="opposite senses"):
        Compliance(lags=1).estimate([giving], FitSettings())


@pytest.mark.seconds
def test_velocities_held_one_after_the_other_take_little_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Oracle: the same in one run. 800 velocities that settle slowly took 600 MB, whatever the records' length."""
    t = np.arange(800) / 500.8
    v = 0.2 * np.sin(20 * t) + 0.1 * np.sin(43 * t)
    training = Record({"velocity": v, "force": 800 * np.tanh(v / 0.05) + 300 * v}, 1 / 500.8,
                      units={"velocity": "m/s", "force": "N"})
    damper = QuasiLpv(lags=2, trial=1, segments=4).estimate([training], FitSettings()).damper
    v = np.concatenate([-np.linspace(2, 0.01, 40), np.linspace(0.01, 2, 40)])
    monkeypatch.setattr(rest, "SETTLED", -1.0)  # every velocity is held to the end
    tracemalloc.start()
    found = damper.static_force(v)
    parts = tracemalloc.get_traced_memory()[1]
    tracemalloc.reset_peak()
    monkeypatch.setattr(rest, "PART", 1 << 24)
    whole = damper.static_force(v)
    once = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    np.testing.assert_array_equal(found, whole)
    assert parts < 0.4 * once
