"""`lpvid stability` with its further questions: range, rate, draws and gain."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.cli.app import app
from lpvid.model.quasi import QuasiLPVModel

pytestmark = pytest.mark.usefixtures("undrawn")


def run(*arguments: object, code: int = 0):
    result = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result


@pytest.fixture(scope="module")
def identified(tmp_path_factory) -> Path:
    """y = −(−0.8 + 0.1p) y(k−1) + (30 + 20p) u(k−1), with noise; p between 0 and 2 A."""
    rng = np.random.default_rng(4)
    u, p, y = rng.normal(size=1500), np.repeat(rng.uniform(0, 2, 150), 10), np.zeros(1500)
    for k in range(1, 1500):
        y[k] = (0.8 - 0.1 * p[k]) * y[k - 1] + (30 + 20 * p[k]) * u[k - 1]
    record = lpv.Record({"velocity": u, "current": p, "force": y + rng.normal(size=1500)}, sample_time=0.01)
    found = lpv.identify(record, lpv.ARX(na=1, nb=1, nk=1, input="velocity", output="force",
                                         basis=lpv.Polynomial("current", degree=1)))
    return lpv.save(found.model, tmp_path_factory.mktemp("model") / "m.json")


@pytest.mark.seconds
def test_every_question_is_answered_in_the_result_and_the_report(identified, tmp_path):
    shown = run("stability", identified, "--largest-range", "--largest-rate", "--draws", 100, "--gain", "--out",
                tmp_path).stdout
    described = json.loads((tmp_path / "stability.json").read_text())
    model = lpv.load(identified)
    a, slope = (model.companion([p])[0, 0] for p in (0.0, 1.0))
    slope -= a
    low, high = described["largest_range"]["range"]["current"]
    assert abs(a + slope * low) < 1 and abs(a + slope * high) < 1  # one pole: stable exactly where its modulus is < 1
    beyond = 1.05 * (high - 1.0)
    assert max(abs(a + slope * (1.0 - beyond)), abs(a + slope * (1.0 + beyond))) >= 1
    assert described["largest_rate"]["arbitrary"] and described["largest_rate"]["rate"] is None
    assert described["draws"]["draws"] == 100 and described["draws"]["probability"] == 1.0  # far from the unit circle
    gains = [lpv.realize(model).model.to_control([p]).dcgain() for p in (0.0, 2.0)]
    gain = described["l2_gain"]
    assert gain["lower"] <= gain["upper"] and gain["lower"] >= np.max(gains) * (1 - 1e-6)
    assert gain["certificate"]["between_grid"] == gain["between_grid"]
    assert "largest certified range" in shown and "100 drawn models" in shown and "induced gain" in shown
    assert "How far it reaches" in (tmp_path / "report.html").read_text()


@pytest.mark.seconds
def test_nothing_is_answered_that_was_not_asked(identified):
    described = json.loads(run("stability", identified, "--json").stdout)
    assert all(described[key] is None for key in ("largest_range", "largest_rate", "draws", "l2_gain"))


def test_what_cannot_be_answered_is_said(tmp_path):
    plain = lpv.LPVTransferFunction.siso([[-0.5]], [[0.0], [1.0]], lpv.Polynomial(), 0.1)
    file = lpv.save(plain, tmp_path / "m.json")
    shown = run("stability", file, "--largest-range", "--draws", 10, "--gain").stdout
    assert "no largest range" in shown and "covariance" in shown and "at most 2" in shown  # 1/(1 − 0.5)


def test_a_model_that_schedules_itself_is_refused(tmp_path):
    own = lpv.Polynomial(("y",), 1, (0.0,), (1.0,))
    found = QuasiLPVModel([[[-0.6, 0.5, 0.1]], [[0.2, 0.1, 0.0]]], own, 1, (1,), (0,), 0.01, (lpv.Signal("u"),),
                          (lpv.Signal("y"),))
    shown = run("stability", lpv.save(found, tmp_path / "q.json"), "--gain", code=2)
    assert "schedules itself" in shown.output
