"""Certificates that an earlier version wrote load, hold for their models, and are written again as they were."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import lpvid as lpv

STORED = json.loads((Path(__file__).parent / "stored_certificates.json").read_text())
"""By kind: a certificate as `lpv.save` wrote it, and its model."""


@pytest.mark.parametrize("kind", STORED)
def test_a_stored_certificate_holds_for_its_model_and_for_no_other(kind: str, tmp_path: Path) -> None:
    for name in ("certificate", "model"):
        (tmp_path / f"{name}.json").write_text(json.dumps(STORED[kind][name]))
    certificate, model = (lpv.load(tmp_path / f"{name}.json") for name in ("certificate", "model"))
    found = lpv.verify(certificate, model)
    assert found.holds and found.between_grid, str(found)
    assert found.margin == pytest.approx(STORED[kind]["certificate"]["margin"], rel=1e-9)
    lpv.save(certificate, tmp_path / "again.json")
    assert json.loads((tmp_path / "again.json").read_text()) == STORED[kind]["certificate"]
    moved = 1.001 * STORED[kind]["certificate"]["margin"] + 1e-9
    (tmp_path / "claims_more.json").write_text(json.dumps({**STORED[kind]["certificate"], "margin": moved}))
    assert not lpv.verify(lpv.load(tmp_path / "claims_more.json"), model).holds
    (tmp_path / "other.json").write_text(json.dumps({**STORED[kind]["certificate"], "model_hash": "0" * 64}))
    assert "another model" in lpv.verify(lpv.load(tmp_path / "other.json"), model).why
