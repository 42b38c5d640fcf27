"""Leave one gate out: what each gate of the diagnosis is worth, on the same blind cases with and without it.

    python tests/benchmarks/diagnosis_ablation.py OUT --cases 40 --seed 3 [--gate UNSTEADY ...] [--shard 0/2]
    python tests/benchmarks/diagnosis_ablation.py OUT --table

A gate is a constant set to the value at which it lets everything pass. The cases are those of `foreign_scoreboard`, and
so are the marks; OUT/full holds the unchanged diagnosis, OUT/GATE each ablated one. A gate's worth is the points of
right and of wrong names that it changes, with the number of cases whose mark changed at all (McNemar's exact test of
the pairs that became right against those that ceased to be). A gate worth less than half a point goes.
"""

from __future__ import annotations

import argparse
from argparse import Namespace
from pathlib import Path

import foreign_scoreboard
from foreign_scoreboard import mark, wrong
from scipy.stats import binomtest

INFINITE = 1e300
_D, _S, _R, _V = (f"lpvid.diagnosis.{m}" for m in ("deciding", "selection", "rivals", "verdicts"))
GATES: dict[str, dict[str, float]] = {
    "SIGNIFICANT": {f"{_S}.SIGNIFICANT": 1.0}, "BIC_GAIN": {f"{_S}.BIC_GAIN": 0.0},
    "BLOCKS_BETTER": {f"{_D}.BLOCKS_BETTER": 0.0, f"{_D}.MAJORITY": 0.0},
    "LARGEST_BLOCK": {f"{_D}.LARGEST_BLOCK": 1.0}, "EXPLAINED": {f"{_D}.EXPLAINED": 0.0},
    "SHADOW": {f"{_D}.SHADOW": 0.0, f"{_D}.DEEP_SHADOW": 0.0}, "KIN": {f"{_D}.KIN": 0.0},
    "DWARFED": {f"{_D}.DWARFED": 0.0}, "OF_MOTION": {f"{_D}.OF_MOTION": 0.0},
    "UNSTEADY": {f"{_D}.UNSTEADY": INFINITE}, "PARTLY": {f"{_V}.PARTLY": 0.0},
    "LEAST": {f"{_V}.LEAST": 0.0, f"{_V}.FORMS": 0.0}, "LEFT": {f"{_V}.LEFT": INFINITE},
    "FOLLOWS": {f"{_V}.FOLLOWS": INFINITE}, "LOUD": {f"{_V}.LOUD": INFINITE},
    "BEYOND": {"lpvid.diagnosis.effect.BEYOND": 1e6}, "NAMELESS": {"lpvid.diagnosis.nameless.WITHIN": -1.0},
    "SEPARATED": {f"{_R}.SEPARATED": 0.0}, "SMALL_PRINT": {f"{_R}.SMALL_PRINT": 0.0},
    "DOUBTFUL": {f"{_R}.DOUBTFUL": 0.0, f"{_R}.DOUBTFUL_SHARE": 0.0},
    "GENERAL": {f"{_R}.GENERAL": 0.0, f"{_R}.GENERAL_LEAST": 0.0}}
"""Gates of the engine, and the values at which they let everything pass."""


def table(full: list[dict], ablated: dict[str, list[dict]]) -> str:
    """Markdown: a line per gate over the cases that both hold."""
    lines = ["| gate left out | cases | right | wrong name | marks changed | p |", "|---|---|---|---|---|---|"]
    with_all = {r["id"]: r for r in full if "outcome" in r}
    for gate, rows in ablated.items():
        pairs = [(with_all[r["id"]], r) for r in rows if "outcome" in r and r["id"] in with_all]
        if not pairs:
            continue
        right = [(mark(a) == "right", mark(b) == "right") for a, b in pairs]
        false = [(_is_wrong(a), _is_wrong(b)) for a, b in pairs]
        gained, lost = sum(b and not a for a, b in right), sum(a and not b for a, b in right)
        p = binomtest(gained, gained + lost).pvalue if gained + lost else 1.0
        changes = [100 * sum(b - a for a, b in some) / len(pairs) for some in (right, false)]
        lines.append(f"| {gate} | {len(pairs)} | {changes[0]:+.1f} | {changes[1]:+.1f} | "
                     f"{sum(mark(a) != mark(b) for a, b in pairs)} | {p:.2g} |")
    return "\n".join(lines)


def _is_wrong(row: dict) -> bool:
    return row["outcome"] == "answered" and bool(wrong(row))


def main() -> None:
    """Run what is missing, then print the table."""
    parser = argparse.ArgumentParser(description="What each gate of the diagnosis is worth.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--shard", default="0/1")
    parser.add_argument("--gate", nargs="*", default=list(GATES), choices=list(GATES))
    parser.add_argument("--limit", type=float, default=180.0, help="seconds per case")
    parser.add_argument("--table", action="store_true", help="print the table of what is there")
    options = parser.parse_args()
    for gate in () if options.table else ("full", *options.gate):
        folder = options.folder / gate
        folder.mkdir(parents=True, exist_ok=True)
        foreign_scoreboard.run(Namespace(**vars(options) | {"folder": folder, "only": "", "engine": "gates",
                                                            "patches": GATES.get(gate)}))
    print(table(foreign_scoreboard.read(options.folder / "full"),
                {g: foreign_scoreboard.read(options.folder / g) for g in GATES}))


if __name__ == "__main__":
    main()
