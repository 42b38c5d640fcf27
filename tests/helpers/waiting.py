"""Waiting for what another process does."""

from __future__ import annotations

import time
from pathlib import Path

PATIENCE = 60.0
"""seconds: a loaded machine may be slow"""


def gone(pid: int) -> bool:
    """Whether a process (Linux) ends within `PATIENCE`; one that has ended and waits to be collected is gone."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
        except FileNotFoundError:
            return True
        if state == "Z":
            return True
        time.sleep(0.05)
    return False
