"""Scoreboard of the diagnosis: cases with something hidden, one line of JSON each, and the table of what came out.

    python tests/benchmarks/diagnosis_scoreboard.py FOLDER --cases 400 --seed 1 [--shard 0/2] [--only nothing,one]
    python tests/benchmarks/diagnosis_scoreboard.py FOLDER --table

Cases that a folder holds already are not run again, so that it may be stopped and started at will. Those of a slightly
wrong baseline, which take longest, come last. They run in a further process, which is replaced now and then: what the
allocator keeps of many large fits in threads adds up to gigabytes.
"""

from __future__ import annotations

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import argparse  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
import traceback  # noqa: E402
from concurrent.futures import ProcessPoolExecutor  # noqa: E402
from multiprocessing import get_context  # noqa: E402
from pathlib import Path  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers import hidden, hidden_score  # noqa: E402
from rows import append, read  # noqa: E402

from quartercar.effects import CATALOGUE  # noqa: E402

TASKS = 20
"""cases that a process runs before another takes its place"""


def main() -> None:
    """Run what is missing, then print the table."""
    options = _options()
    options.folder.mkdir(parents=True, exist_ok=True)
    if not options.table:
        run(options)
    rows = read(options.folder)
    print(hidden_score.table(rows))


def run(options: argparse.Namespace) -> None:
    """The cases of this shard that no file of the folder holds."""
    part, parts = map(int, options.shard.split("/"))
    done = {row["id"] for row in read(options.folder)}
    kinds = options.only.split(",") if options.only else [None]
    path = options.folder / f"shard-{part}-of-{parts}.jsonl"
    numbers = [n for n in range(options.cases) if n % parts == part]
    if not options.only:
        known = tuple(e.name for e in CATALOGUE)
        numbers.sort(key=lambda n: hidden.draw(options.seed * 100_000 + n, known).kind == "wrong-baseline")
    wanted = [(options.seed * 100_000 + n, f"{options.seed}-{n}-{kind or 'any'}-{fixed.get('colour', '')}", fixed)
              for n in numbers for kind in kinds for fixed in _fixings(kind)]
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=TASKS) as pool:
        for seed, name, fixed in wanted:
            if name not in done:
                append(path, pool.submit(_one, seed, name, fixed).result())


def _fixings(kind: str | None) -> list[dict]:
    """Nothing hidden is asked of every colour; everything else is left to the seed."""
    if kind == "nothing":
        return [{"kind": kind, "colour": colour} for colour in hidden.COLOURS]
    return [{"kind": kind}] if kind else [{}]


def _one(seed: int, name: str, fixed: dict) -> dict:
    begun = time.perf_counter()
    try:
        row = hidden_score.case(seed, CATALOGUE, **fixed)
    except Exception as error:
        row = {"error": f"{type(error).__name__}: {error}", "where": traceback.format_exc()[-800:], "seed": seed}
    row |= {"id": name, "seconds_in_all": round(time.perf_counter() - begun, 2)}
    print(hidden_score.line(row), flush=True)
    return row


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--shard", default="0/1")
    parser.add_argument("--only", default="", help=f"kinds of case, comma-separated: {', '.join(hidden.KINDS)}")
    parser.add_argument("--table", action="store_true", help="print the table of what is there")
    return parser.parse_args()


if __name__ == "__main__":
    main()
