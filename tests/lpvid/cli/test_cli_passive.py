"""identify --passive, and what identify says unasked of a model that gives energy."""

from __future__ import annotations

import json

import numpy as np
import pytest
from helpers.passive_models import STEP, late, motion, record, yielding
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.cli.app import app

pytestmark = pytest.mark.usefixtures("undrawn")


def run(*arguments: object, code: int = 0):
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    assert result.exit_code == code, result.output
    return result


def written(path, model, sign: float = 1.0, samples: int = 1500):
    rng = np.random.default_rng(0)
    v, i = motion(rng, samples)
    force = sign * lpv.simulate(model, record(v, i), "zero").output[:, 0] + 2.0 * rng.normal(size=samples)
    np.savetxt(path, np.column_stack([STEP * np.arange(samples), v, i, force]), delimiter=",", comments="",
               header="time [s],velocity [m/s],current [A],force [N]", fmt="%.17g")
    return path


def test_passive_is_certified_stored_and_priced(tmp_path):
    data, out = written(tmp_path / "run.csv", yielding()), tmp_path / "m"
    described = run("identify", data, "--schedule", "current", "--na", 1, "--nb", 1, "--shape", "tanh", "--affine",
               "--hold-out", "1/3", "--passive", "--out", out).output
    assert "certified: passive" in described and "what it costs: held-out free-run ESR" in described
    model = lpv.load(out / "model.json")
    certificate = lpv.PassivityCertificate.from_dict(model.metadata["passive"])
    assert lpv.verify(certificate, model).holds
    data = json.loads((out / "identification.json").read_text())
    assert data["passivity"]["active"] is False and data["structure"]["passive"] is True
    assert "passive one its free run)" in described  # of a one-step estimate beside
    judged = run("stability", out / "model.json", "--draws", 20).output
    assert "with probability" not in judged and "leaves out the constraint of passivity" in judged
    assert "no models are drawn" in judged
    page = (out / "report.html").read_text()
    assert "Free-run ESR with and without the constraint" in page and "least favourable amplitude" in page


@pytest.mark.seconds
def test_an_active_model_says_so_unasked(tmp_path):
    data = written(tmp_path / "run.csv", late(delay=2))
    described = run("identify", data, "--na", 0, "--nb", 3, "--nk", 0, "--out", tmp_path / "m").output
    (line,) = [x for x in described.splitlines() if "NOT passive" in x]
    assert "gives energy at 63.2 to 187 Hz" in line and "beyond 25 Hz" in line and line.endswith("--passive")
    assert json.loads((tmp_path / "m" / "identification.json").read_text())["passivity"]["active"] is True


@pytest.mark.seconds
def test_energy_of_reversed_polarity_is_stated_of_the_force_turned(tmp_path):
    """--passive alone would refuse these records, so the line names --flip along with it."""
    data = written(tmp_path / "run.csv", late(own=300.0, delay=2))
    described = run("identify", data, "--na", 0, "--nb", 3, "--nk", 0).output
    (line,) = [x for x in described.splitlines() if "NOT passive" in x]
    turned = written(tmp_path / "turned.csv", late(own=-300.0, damping=-500.0, delay=2))
    described = run("identify", turned, "--na", 0, "--nb", 3, "--nk", 0, "--out", tmp_path / "m").output
    (other,) = [x for x in described.splitlines() if "NOT passive" in x]
    assert "with its force turned" in other and other.endswith("--flip force --passive")
    assert other.split("polarity: ")[1].split("(")[0] == line.split("NOT passive: ")[1].split("(")[0]
    assert "with its force turned" in (tmp_path / "m" / "report.html").read_text()


@pytest.mark.seconds
def test_a_passive_model_says_nothing(tmp_path):
    data = written(tmp_path / "run.csv", yielding())
    assert "passive" not in run("identify", data, "--schedule", "current", "--na", 0, "--nb", 1, "--nk", 0,
                                "--shape", "tanh").output


@pytest.mark.parametrize(("options", "stated"), [
    (("--structure", "bj"), "--passive does not apply to --structure bj"),
    (("--nk", 1), "--nk 0"),
    (("--lagged", "--schedule", "current"), "--lagged"),
    (("--shape", "three-zone"), "--shape tanh"),
    (("--flip", "force"), "--flip force"),
])
def test_what_does_not_go_with_it_is_refused_in_one_line(tmp_path, options, stated):
    data = written(tmp_path / "run.csv", yielding(), samples=400)
    described = run("identify", data, "--passive", *options, code=2).output
    assert stated in described and len(described.strip().splitlines()) == 1
