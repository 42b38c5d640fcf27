"""Dampers in files and in lpvid's hands: saved, loaded, hashed, validated by the command line, refused in one line."""

from __future__ import annotations

import importlib.metadata
import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.cli.app import app
from lpvid.errors import InputError
from lpvid.export.serialise import Kind, known_kinds, model_hash
from lpvid.record import Record
from quartercar.dampers import MODELS, Linear, model_class
from quartercar.dampers.blackbox.compliance import Compliance, QuasiLpv
from quartercar.dampers.blackbox.lpv import LpvArx
from quartercar.dampers.blackbox.narx import Narx2, Narx3
from quartercar.dampers.contract import Damper
from quartercar.dampers.families import LawDamper
from quartercar.dampers.fitting import FitSettings, fit

RATE = 256.0
UNITS = {"displacement": "m", "velocity": "m/s", "current": "A", "force": "N"}
LAWS = [name for name, _, _ in MODELS if issubclass(model_class(name), LawDamper)]
SAMPLED: dict[str, Damper] = {
    "narx-2": Narx2(degree=1, constant=True), "narx-3": Narx3(method="recursive", displacement=False),
    "lpv-arx": LpvArx(order=2), "lpv-arx three-zone": LpvArx(order=2, shape="three-zone"),
    "compliance": Compliance(lags=1, levels=1, current=True), "quasi-lpv": QuasiLpv(lags=2, trial=1, segments=4),
}


def record(seed: int = 0, n: int = 800, turn: float = 1.0) -> Record:
    """An MR damper of the simplest kind: (300 + 200 i) tanh(v/0.05) + 800 v + 2000 x − 100, with noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / RATE
    f, phase = rng.uniform(0.5, 12, 20), rng.uniform(0, 2 * np.pi, 20)
    angle = 2 * np.pi * np.outer(t, f) + phase
    v, x = 0.05 * np.cos(angle).sum(axis=1), (0.05 / (2 * np.pi * f) * np.sin(angle)).sum(axis=1)
    i = np.repeat(rng.uniform(0, 2, n // 32 + 1), 32)[:n]
    force = (300 + 200 * i) * np.tanh(v / 0.05) + 800 * v + 2000 * x - 100
    force = turn * (force + 5 * rng.normal(size=n))
    return Record({"displacement": x, "velocity": v, "current": i, "force": force}, 1 / RATE, units=UNITS,
                  name=f"run{seed}")


def csv(path: Path, data: Record) -> Path:
    names = list(data.channels)
    head = ",".join(["time [s]", *(f"{n} [{UNITS[n]}]" for n in names)])
    rows = np.column_stack([data.times, *(data[n] for n in names)])
    path.write_text("\n".join([head, *(",".join(repr(float(x)) for x in row) for row in rows)]) + "\n")
    return path


def command(*arguments: object, code: int = 0):
    result = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result


class Fitted(dict[str, Damper]):
    """Sampled dampers by name, fitted when a test first asks for one."""

    def __missing__(self, name: str) -> Damper:
        return self.setdefault(name, fit(SAMPLED[name], record()).damper)


@pytest.fixture(scope="module")
def fitted() -> Fitted:
    """Sampled dampers after a fit, which is when they have something to store."""
    return Fitted()


def own_esr(damper: Damper, data: Record) -> float:
    run, force = damper.simulate(data), data["force"]
    error, about = force[run.start:] - run.output[run.start:, 0], force[run.start:] - force[run.start:].mean()
    return float(error @ error / (about @ about))


# -- files -------------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", LAWS)
def test_every_law_comes_back(name: str, tmp_path: Path) -> None:
    damper = model_class(name)(current_range=(0.0, 2.0), centre=0.01, polarity=-1, metadata={"note": "x"})
    path = lpv.save(damper, tmp_path / "damper.json")
    assert json.loads(path.read_text())["schema"] == "quartercar/damper/1"
    again = lpv.load(path)
    assert type(again) is type(damper) and again.to_dict() == damper.to_dict()
    assert model_hash(again) == model_hash(damper)
    assert model_hash(damper.replace(metadata={})) == model_hash(damper)


@pytest.mark.thinned(6, "seconds")
@pytest.mark.parametrize("name", list(SAMPLED))
def test_every_sampled_damper_comes_back(name: str, fitted: dict[str, Damper], tmp_path: Path) -> None:
    damper = fitted[name]
    again = lpv.load(lpv.save(damper, tmp_path / "damper.json"))
    assert type(again) is type(damper) and again.settings == damper.settings
    assert model_hash(again) == model_hash(damper)
    np.testing.assert_array_equal(again.vector, damper.vector)
    other = record(1, 400)
    np.testing.assert_array_equal(again.simulate(other).output, damper.simulate(other).output)
    assert model_hash(again.with_vector(1.01 * again.vector)) != model_hash(damper)


def test_an_unfitted_damper_comes_back_too(tmp_path: Path) -> None:
    again = lpv.load(lpv.save(Narx2(method="recursive"), tmp_path / "n.json"))
    assert again.model is None and again.method == "recursive"
    with pytest.raises(InputError, match="not been fitted"):
        lpv.validate(again, record())


# -- in lpvid's hands --------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", [
    name if name in ("narx-2", "narx-3", "quasi-lpv") else pytest.param(name, marks=pytest.mark.seconds)
    for name in SAMPLED])
@pytest.mark.parametrize("polarity", [1, -1])
def test_sampled_dampers_are_validated_as_they_simulate(name: str, polarity: int, fitted: dict[str, Damper]) -> None:
    damper, other = fitted[name].replace(polarity=polarity), record(1, 600, polarity)
    run = lpv.simulate(damper, other)
    np.testing.assert_allclose(run.output, damper.simulate(other).output, atol=1e-6 * other["force"].std())
    found = lpv.validate(damper, other)
    assert found.label == "held-out"
    assert found.overall.free_run.esr == pytest.approx(own_esr(damper, other), rel=1e-6)
    assert lpv.validate(damper, record(0, turn=polarity)).label == "training"


def test_a_law_is_validated_as_it_simulates_and_predicts_what_it_simulates() -> None:
    damper = fit(Linear(), record()).damper
    other = record(1)
    found = lpv.validate(damper, other, horizons=(5,))
    assert found.label == "held-out" and lpv.validate(damper, record()).label == "training"
    assert found.overall.free_run.esr == pytest.approx(own_esr(damper, other), rel=1e-12)
    assert found.overall.one_step.esr == found.overall.free_run.esr == found.k_steps[0].esr
    for initial in ("zero", "estimate"):
        assert np.isfinite(lpv.simulate(damper, other, initial).output).all()


@pytest.mark.parametrize("name", [n for n in LAWS if model_class(n)().start == 1][:3])
def test_dynamic_laws_start_from_the_measured_force(name: str) -> None:
    damper, other = model_class(name)(current_range=(0.0, 2.0)), record(1, 300)
    run = lpv.simulate(damper, other)
    assert run.start == 1 and run.output[0, 0] == other["force"][0]
    np.testing.assert_allclose(run.output[1:], damper.simulate(other).output[1:], rtol=1e-9)
    estimated = lpv.simulate(damper, other, "estimate")
    assert estimated.start == 0 and np.isfinite(estimated.output).all()


def test_a_fitted_law_keeps_the_rate_of_its_data_and_knows_them_again_at_another() -> None:
    raw = record()
    damper = fit(Linear(), raw, settings=FitSettings(sample_rate=128.0)).damper
    assert damper.period == pytest.approx(1 / 128) and damper.clock is None
    found = lpv.validate(damper, raw)
    assert found.label == "training" and any("resampled to the model's 128 Hz" in n for n in found.notes)
    with pytest.raises(InputError, match="a model runs at its own rate"):
        lpv.validate(damper, raw, sample_rate=64.0)
    published = Linear(values={"damping": 3000.0})
    assert lpv.validate(published, raw).records[0].n_samples == raw.n_samples
    assert lpv.validate(published, raw, sample_rate=64.0).records[0].n_samples < raw.n_samples / 3


def test_a_sampled_damper_refuses_another_rate_in_one_line(fitted: dict[str, Damper]) -> None:
    slow = lpv.condition.resample(record(1), 128.0)
    with pytest.raises(InputError, match=r"another rate.*resample") as caught:
        lpv.simulate(fitted["narx-2"], slow)
    assert len(str(caught.value).splitlines()) == 1
    assert any("resampled" in n for n in lpv.validate(fitted["narx-2"], slow).notes)


def test_currents_beyond_the_fit_count_as_extrapolation(fitted: dict[str, Damper]) -> None:
    other = record(1)
    beyond = other.with_channel("current", other["current"] + 1.5, "A")
    share = float(np.mean(beyond["current"] > record()["current"].max()))
    assert lpv.validate(fitted["narx-2"], beyond).extrapolation_share == pytest.approx(share, abs=0.01)
    with pytest.raises(InputError, match="another unit"):
        lpv.simulate(fitted["narx-2"], other.with_channel("current", other["current"], "V"))


# -- through the command line ------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", [
    "linear", *(pytest.param(n, marks=pytest.mark.slow) for n in ("lpv-arx", "compliance"))])
@pytest.mark.usefixtures("undrawn")
def test_validate_on_the_command_line(name: str, fitted: dict[str, Damper], tmp_path: Path) -> None:
    damper = fit(Linear(), record()).damper if name == "linear" else fitted[name]
    model = lpv.save(damper, tmp_path / "damper.json")
    other = record(1, 600)
    command("validate", model, csv(tmp_path / "other.csv", other), "--out", tmp_path / "out")
    written = json.loads((tmp_path / "out" / "validation.json").read_text())
    assert written["data"] == "held-out"
    assert written["overall"]["free_run"]["esr"] == pytest.approx(own_esr(damper, other), rel=1e-6)
    assert (tmp_path / "out" / "report.html").stat().st_size > 1000
    seen = command("validate", model, csv(tmp_path / "same.csv", record()), "--json")
    assert json.loads(seen.stdout)["data"] == "training"
    renamed = Record({("drive" if k == "current" else k): c for k, c in other.channels.items()}, 1 / RATE)
    path = tmp_path / "renamed.csv"
    path.write_text(csv(tmp_path / "o.csv", other).read_text().replace("current [A]", "drive [A]", 1))
    assert renamed.has("drive")
    if name != "linear":
        again = json.loads(command("validate", model, path, "--schedule", "drive", "--json").stdout)
        assert again["overall"]["free_run"]["esr"] == pytest.approx(written["overall"]["free_run"]["esr"])


def test_stability_of_dampers(fitted: dict[str, Damper], tmp_path: Path) -> None:
    narx = lpv.save(fitted["narx-3"], tmp_path / "narx.json")
    result = CliRunner().invoke(app, ["stability", str(narx), "--json"])
    assert result.exit_code in (0, 3), result.output
    stated = json.loads(result.stdout)
    poles = np.abs(fitted["narx-3"].to_lpv(1 / RATE).frozen_poles([])).max()
    assert stated["frozen"]["max_modulus"] == pytest.approx(poles)
    law = lpv.save(fit(Linear(), record()).damper, tmp_path / "law.json")
    refused = CliRunner().invoke(app, ["stability", str(law)])
    assert refused.exit_code == 2 and "no LPV form of 'linear'" in refused.output


# -- what is not a damper file -----------------------------------------------------------------------------------------
def altered(data: dict, **changes: object) -> dict:
    return {**data, **changes}


BAD = {
    "newer": ({"schema": "quartercar/damper/2"},
              "newer format.*reads up to quartercar/damper/1. Mend: update quartercar"),
    "other noun": ({"schema": "quartercar/car/1"}, "known: lpvid/model/1, .*quartercar/damper/1"),
    "kind": ({"kind": "magic"}, "unknown kind of damper: got 'magic'"),
    "no settings": ({"settings": None}, "not a consistent damper file"),
    "unknown setting": ({"settings": {"colour": "red"}}, "not a consistent damper file"),
    "no parameters": ({"parameters": []}, "parameters of linear are missing.*damping"),
    "parameter text": ({"parameters": [{"name": "damping", "value": "soft", "unit": ""}]}, "damping"),
    "parameter outside": ({"parameters": [{"name": "damping", "value": -5.0, "unit": ""}]}, "physical bounds"),
    "stranger": ({"parameters": [{"name": "wear", "value": 1.0, "unit": ""}]}, "parameter of linear"),
    "polarity": ({"polarity": 2}, "polarity is 1 or -1"),
    "range": ({"current_range": [2.0, 0.0]}, "from low to high"),
    "range text": ({"current_range": ["a", 0.0]}, "not a consistent damper file"),
    "unit": ({"current_unit": 3}, "current_unit is text"),
    "metadata": ({"metadata": []}, "metadata are a mapping"),
    "centre": ({"centre": "middle"}, "centre"),
}


@pytest.mark.parametrize("case", list(BAD))
def test_bad_files_are_refused_in_one_line(case: str, tmp_path: Path) -> None:
    changes, match = BAD[case]
    good = json.loads(lpv.save(Linear(), tmp_path / "good.json").read_text())
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(altered(good, **changes)))
    with pytest.raises(InputError, match=match) as caught:
        lpv.load(path)
    assert "bad.json" in str(caught.value) and len(str(caught.value).splitlines()) == 1
    missing = tmp_path / "missing.json"
    missing.write_text(json.dumps({k: v for k, v in good.items() if k != "centre"}))
    with pytest.raises(InputError, match="lacks 'centre'"):
        lpv.load(missing)


@pytest.mark.parametrize("inner", [5, {}, {"model": 3, "layout": []}, {"model": {"kind": "magic"}, "layout": []}])
def test_a_model_inside_is_checked(inner: object, tmp_path: Path, fitted: dict[str, Damper]) -> None:
    good = json.loads(lpv.save(fitted["narx-2"], tmp_path / "good.json").read_text())
    good["settings"]["stored"] = inner
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(good))
    with pytest.raises(InputError) as caught:
        lpv.load(path)
    assert len(str(caught.value).splitlines()) == 1


def test_a_huge_basis_inside_is_refused_before_it_is_built(tmp_path: Path, fitted: dict[str, Damper]) -> None:
    good = json.loads(lpv.save(fitted["narx-2"], tmp_path / "good.json").read_text())
    good["settings"]["stored"]["model"]["basis"]["degree"] = 10**9
    path = tmp_path / "bad.json"
    path.write_text(json.dumps(good))
    with pytest.raises(InputError, match="basis claims"):
        lpv.load(path)


class Point:
    """An entry point as importlib.metadata gives them."""

    name, value = "strange", "nowhere:KIND"

    def __init__(self, loaded: object) -> None:
        self.loaded = loaded

    def load(self) -> object:
        if isinstance(self.loaded, Exception):
            raise self.loaded
        return self.loaded


def test_another_package_registers_its_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    mine = Kind("thing", 3, (("linear", "quartercar.dampers.laws.linear", "Linear"),), "acme")
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda group: [Point(mine)])
    assert known_kinds()[-1] is mine
    path = lpv.save(Linear(), tmp_path / "thing.json")
    assert json.loads(path.read_text())["schema"] == "acme/thing/3"
    assert isinstance(lpv.load(path), Linear)
    for broken, match in ((ImportError("gone"), "does not load; gone"), ("text", "is no Kind: got str")):
        monkeypatch.setattr(importlib.metadata, "entry_points", lambda group, b=broken: [Point(b)])
        with pytest.raises(InputError, match=match):
            lpv.load(path)
