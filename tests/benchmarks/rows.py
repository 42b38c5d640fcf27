"""Rows of plain data in a folder of files, a line of JSON each."""

from __future__ import annotations

import json
from pathlib import Path


def append(path: Path, row: dict) -> None:
    """One row more at the end of a file."""
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")


def with_all_rules(row: dict) -> dict:
    """A row of `rule_ablation` as one of `diagnosis_calibration`: the answer with all rules among its own keys."""
    return row | row.get("variants", {}).get("all rules", {})


def read(folder: Path) -> list[dict]:
    """All rows of a folder; a line cut short by an interruption is left out."""
    found = []
    for path in sorted(folder.glob("*.jsonl")):
        for text in path.read_text(encoding="utf-8").splitlines():
            try:
                found.append(json.loads(text))
            except json.JSONDecodeError:
                continue
    return found
