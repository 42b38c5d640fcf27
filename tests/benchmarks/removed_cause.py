"""The true cause removed from the catalogue: single causes of the foreign rig, diagnosed without them.

    python tests/benchmarks/removed_cause.py OUT --cases 24 --seed 141

A case is at half the rig's rate, 10 s; the entry and the other forms of its component are left out. A row, a line of
JSON in OUT/removed.jsonl, is not computed twice. Refused: no cause named that is not present; family: all causes named
are of the family of the true one; misnamed: anything else.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from pathlib import Path

from diagnosis_calibration import KINDS  # first: it puts the helpers on the path
from foreign_scoreboard import stated
from helpers.foreign_rig import cases, truth
from rows import append, read

from quartercar.effects import CATALOGUE

FAMILY = {e.name: e.family for e in CATALOGUE}


def case(seed: int) -> dict:
    """One case: plain data."""
    import lpvid as lpv

    plan = cases.draw(seed, duration=10.0, kind="single")
    world = cases.world(plan)
    (cause,) = plan.causes
    size, change = truth.bench(world).sized(cause, plan.share)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "record.csv"
        cases.written(world, cases.measured(world, world.run(((cause, size),))), path)
        record = lpv.read(str(path))
    others = [e for e in CATALOGUE if KINDS[e.name] != KINDS.get(cause, cause)]
    found = lpv.diagnose(record, plan.baseline, others, sample_rate=cases.RATE / 2)
    row = plan.to_dict() | {"visible": float((change**2).mean() ** 0.5), "verdict": found.verdict,
                            "named": [c.name for c in found.causes]}
    names = [n for n in stated(row) if n not in cases.BESIDES.get(cause, set())]
    alike = all(FAMILY[n] == FAMILY.get(cause) for n in names)
    return row | {"mark": "refused" if not names else "family" if alike else "misnamed"}


def main() -> None:
    """Run what is missing, then count."""
    parser = argparse.ArgumentParser(description="The true cause removed from the catalogue.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=24)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    done = {r["id"] for r in read(options.folder)}
    for number in range(options.cases):
        name = f"{options.seed}-{number}"
        if name not in done:
            row = case(options.seed * 100_000 + number) | {"id": name}
            print(name, row["law"], *row["causes"], f"{row['visible']:.1%}", row["verdict"], row["named"], row["mark"],
                  flush=True)
            append(options.folder / "removed.jsonl", row)
    print(dict(Counter(r["mark"] for r in read(options.folder))))


if __name__ == "__main__":
    main()
