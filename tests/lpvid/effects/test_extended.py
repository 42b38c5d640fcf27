"""Extended models: in files, as models of every other command, and without any diagnosis."""

from __future__ import annotations

import json
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.toy_viscous import DRY, FRICTION, RATE, SLOPE, Viscous, by_hand, measured, pretend_installed

import lpvid as lpv
from lpvid.effects.composition import Composition
from lpvid.effects.extended import ExtendedModel, ExtendedRun
from lpvid.errors import InputError


@pytest.fixture
def installed(monkeypatch):
    return pretend_installed(monkeypatch)


def fitted() -> ExtendedModel:
    composition = Composition(Viscous(SLOPE), (DRY,))
    covariance = np.array([[0.04, -0.01], [-0.01, 0.09]])
    return ExtendedModel(composition, np.array([SLOPE, FRICTION]), covariance).remembering([measured()])


def test_an_extended_model_is_the_same_after_its_file(installed, tmp_path):
    model = fitted()
    path = lpv.save(model, tmp_path / "extended_model.json")
    assert json.loads(path.read_text())["schema"] == "lpvid/extended/1"
    again, other = lpv.load(path), measured(3)
    assert np.array_equal(again.predict(other), model.predict(other))
    assert np.array_equal(lpv.simulate(again, other).output[:, 0], again.predict(other))
    assert np.array_equal(again.covariance, model.covariance) and again.effects == ("dry",)
    assert again.reads == ("velocity",) and again.period == pytest.approx(1 / RATE)
    values = dict(zip(again.composition.names, again.vector, strict=True))
    figures = lpv.validate(again, other)
    assert figures.label == "held-out" and lpv.validate(again, measured()).label == "training"
    assert figures.overall.free_run.esr == pytest.approx(by_hand(values["slope"], values["dry.size"], other), rel=1e-9)


@pytest.mark.parametrize(("change", "stated"), [
    (lambda d: d["effects"][0].update(name="gone"), "no installed catalogue has the effect 'gone'"),
    (lambda d: d["baseline"].update(name="gone"), "no baseline 'gone'"),
    (lambda d: d["effects"][0]["parameters"][0].update(name="other"), "other parameters here than in the file"),
    (lambda d: d["effects"][0]["parameters"][0].update(value="x"), "size of dry"),
    (lambda d: d["covariance"].pop(), "not a consistent extended file"),
    (lambda d: d["baseline"].update(vector=[1.0, 2.0]), "not a consistent extended file"),
    (lambda d: d.pop("reads"), "lacks 'reads'"),
    (lambda d: d.update(schema="lpvid/extended/2"), "newer format"),
])
def test_a_file_that_is_not_what_it_claims_is_refused_in_one_line(installed, tmp_path, change, stated):
    path = lpv.save(fitted(), tmp_path / "m.json")
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))
    with pytest.raises(InputError) as error:
        lpv.load(path)
    assert stated in str(error.value) and "\n" not in str(error.value) and "m.json" in str(error.value)


def test_the_channels_that_it_reads_are_found_along_a_part_of_the_first_record() -> None:
    short = fitted().remembering([measured()], samples=50)
    assert short.reads == fitted().reads == ("velocity",)
    assert short.metadata["training"]["n_samples"] == measured().n_samples


@pytest.mark.seconds
def test_it_is_read_and_simulated_without_a_diagnosis(tmp_path) -> None:
    """In a fresh process, from the file alone, with the effects and the baseline of quartercar."""
    from quartercar.baselines.damper import DamperBaseline
    from quartercar.dampers import Guo
    from quartercar.effects.friction_gas import CoulombFriction

    composition = Composition(DamperBaseline(Guo()), (CoulombFriction(),))
    vector = composition.neutral
    model = ExtendedModel(composition, vector, np.full((vector.size, vector.size), np.nan)).remembering([measured()])
    path = lpv.save(model, tmp_path / "m.json")
    probe = (f"import sys, numpy as np, lpvid as lpv; model = lpv.load({str(path)!r}); t = np.arange(200) / 200; "
             "record = lpv.Record({'displacement': np.sin(t), 'velocity': np.cos(t), 'force': np.cos(t)}, 0.005, "
             "units={'displacement': 'm', 'velocity': 'm/s', 'force': 'N'}); lpv.simulate(model, record); "
             "print([m for m in sys.modules if m.startswith('lpvid.diagnosis')])")
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e3])
@pytest.mark.parametrize(("low", "high", "slack"), [(0.0, 0.0, 0.0), (0.0, 2.0, 0.02), (-5.0, -4.0, 0.05)])
def test_the_box_of_a_run_is_wider_by_a_share_in_any_unit(scale: float, low: float, high: float, slack: float) -> None:
    """Where a scheduling variable was always zero in training there is no share: any other value is outside."""
    run = SimpleNamespace(scheduled=("current",), model=SimpleNamespace(
        ranges={"current": (scale * low, scale * high)}, units={}))
    box = ExtendedRun.box.fget(run)  # type: ignore[attr-defined]
    assert [*box.lower, *box.upper] == pytest.approx([scale * (low - slack), scale * (high + slack)], rel=1e-12, abs=0)
