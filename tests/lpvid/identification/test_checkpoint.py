"""The state of a long estimate: of the same data, settings and format, or none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lpvid.identification import checkpoint
from lpvid.identification.checkpoint import Checkpoint


def test_a_state_of_other_data_or_of_another_format_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that an earlier version kept lacks what this one restores: it ended with a traceback."""
    path = tmp_path / "state.npz"
    Checkpoint(path, {"na": 2}).save({"place": 3}, {"r": np.eye(2)})
    found = Checkpoint(path, {"na": 2}).load()
    assert found is not None and found[0] == {"place": 3}
    assert Checkpoint(path, {"na": 3}).load() is None
    monkeypatch.setattr(checkpoint, "FORMAT", checkpoint.FORMAT + 1)
    assert Checkpoint(path, {"na": 2}).load() is None
