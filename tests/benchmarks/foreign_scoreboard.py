"""Scoreboard on the foreign rig: blind cases by the user's command, one line of JSON each, and their table.

    python tests/benchmarks/foreign_scoreboard.py OUT --cases 40 --seed 3 [--shard 0/2] [--only single,pair]
    python tests/benchmarks/foreign_scoreboard.py OUT --cases 40 --seed 3 --baseline linear
    python tests/benchmarks/foreign_scoreboard.py ROWS --calibration
    python tests/benchmarks/foreign_scoreboard.py OUT --table

The third line takes rows of `diagnosis_calibration.py` or `rule_ablation.py`, 10 s at half the rate.
No fitted baseline can be exact: every law of the rig has another form than the project's, and a smooth error of 1 to
3 % of the force (`rough`: 3 to 6 %). Which causes are separable is decided from the truth alone, before the diagnosis
runs (`foreign_rig.truth`). Rows in OUT are not computed again. Rotate the seeds: a seed that was looked at once is a
training seed.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import commanded
import numpy as np
from helpers.foreign_rig import cases, causes, truth
from real_answers import parts_of
from rows import append, read, with_all_rules

Row = dict


def case(seed: int, limit: float, **fixed: object) -> Row:
    """Draw a case, decide whether its cause is separable, then diagnose it: plain data."""
    begun = time.perf_counter()
    plan = cases.draw(seed, **fixed)
    world = cases.world(plan)
    known = truth.truth_of(world)
    row = plan.to_dict() | truths(world, known) | {"truth_seconds": round(time.perf_counter() - begun, 1)}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "record.csv"
        cases.written(world, cases.measured(world, world.run(known.hidden)), path)
        return row | commanded.diagnose([str(path)], plan.baseline, limit=limit)


def truths(world: cases.World, known: truth.Truth) -> Row:
    """What is hidden in a world and whether it is separable: plain data."""
    return {"force": world.device.force, "speed": world.device.speed, "sizes": [s for _, s in known.hidden],
            "visible": list(known.visible), "separable": known.separable, "unknown": known.unknown,
            "near": {n: round(d, 5) for n, d in known.rivals.items() if d < known.unknown}}


# -- marks --------------------------------------------------------------------------------------------------------
def stated(row: Row) -> list[str]:
    """Causes named outright, without those that the law or the measurement chain has by construction."""
    own = cases.own(row["law"], row["baseline"]) | cases.CHAIN
    return [n for n in row.get("named", []) if n not in own or n in row["causes"]]


def wrong(row: Row) -> list[str]:
    """Causes named outright that are neither present nor inseparable from those present."""
    alike = set() if row["separable"] else set(row["near"])
    alike = alike.union(*(cases.BESIDES.get(c, set()) for c in row["causes"]))
    return [n for n in stated(row) if n not in row["causes"] and n not in alike and not _by_part(n, row)]


def _by_part(name: str, row: Row) -> bool:
    """Whether a name has the part of a hidden cause from outside the catalogue."""
    return any(causes.cause(c).outside and c in parts_of(name) for c in row["causes"])


def mark(row: Row) -> str:
    """One word on one case."""
    if row["outcome"] != "answered":
        return row["outcome"]
    if wrong(row):
        return "false alarm" if row["kind"] == "nothing" else "wrong"
    found = [c for c in row["causes"] if c in row["named"] or any(c in parts_of(n) for n in row["named"])]
    if row["kind"] == "nothing":
        return "right"
    if row["kind"] == "outside":
        return "right" if found or row["verdict"] != "explained" else "explained"
    if row["kind"] == "pair":
        return "right" if len(found) == 2 else "one of two" if found else "silent"
    if not row["separable"]:
        return "right"
    return ("right" if stated(row)[0] in row["causes"] else "later") if found else "silent"


def law_found(row: Row) -> list[bool]:
    """Whether the friction of a law is named where the baseline has none, and its current where that varies."""
    names = {*row.get("named", ())} - {*row["causes"]}
    varies = row["current"] in ("steps", "ramps")
    friction = (cases.FRICTION | {"hysteresis"}) & cases.own(row["law"], row["baseline"])
    return [bool(friction & names), *(["current-dependence" in names] if varies else [])]


def line(row: Row) -> str:
    """One case in one line."""
    if "outcome" not in row:
        return f"{row['id']} ERROR {row.get('error')}"
    return (f"{row['id']} {row['kind']} {row['law']}/{row['baseline']} {row['force']:.3g} N {row['motion']} "
            f"{row['current']} {'+'.join(row['causes']) or 'nothing'} visible "
            f"{'/'.join(f'{v:.1%}' for v in row['visible']) or '-'} {'separable' if row['separable'] else '-'} -> "
            f"{mark(row)}: {row.get('verdict', '')} {','.join(row.get('named', [])) or '-'} rivals "
            f"{row.get('rivals', [])} ESR {row.get('before', np.nan):.4f} -> {row.get('after', np.nan):.4f} "
            f"{row.get('seconds', np.nan):.0f} s")


def table(rows: list[Row]) -> str:
    """Markdown: shares by kind of case, with those without an answer in a column of their own."""
    good = [r for r in rows if "outcome" in r]
    lines = ["| cases | n | right | helpful or later | wrong name | silent | timeout, refused, traceback |",
             "|---|---|---|---|---|---|---|"]
    picks: list[tuple[str, Callable[[Row], bool]]] = [
        ("nothing hidden (wrong: false alarm)", lambda r: r["kind"] == "nothing"),
        ("one, separable", lambda r: r["kind"] == "single" and r["separable"]),
        ("one, not separable", lambda r: r["kind"] == "single" and not r["separable"]),
        ("two", lambda r: r["kind"] == "pair"),
        ("outside the catalogue (right: refused or family)", lambda r: r["kind"] == "outside"),
        ("law error 3 to 6 %, separable", lambda r: r["kind"] == "rough" and r["separable"]),
        ("law error 3 to 6 %, not separable", lambda r: r["kind"] == "rough" and not r["separable"]),
        ("all", lambda r: True)]
    for label, pick in picks:
        marks = [mark(r) for r in good if pick(r)]
        groups = (("right",), ("one of two", "later"), ("wrong", "false alarm", "explained"), ("silent",),
                  ("timeout", "refused", "traceback"))
        cells = [str(sum(marks.count(m) for m in g)) for g in groups]
        lines.append(f"| {label} | {len(marks)} | {' | '.join(cells)} |")
    seconds = [r["seconds"] for r in good if r["outcome"] == "answered" and "seconds" in r]
    if seconds:
        median, late = np.quantile(seconds, (0.5, 0.95))
        lines += ["", f"seconds by the clock, or of a processor where from a calibration: median {median:.0f}, "
                  f"95 % {late:.0f}"]
    clean = [r["before"] for r in good if r["kind"] == "nothing" and "before" in r]
    if clean:
        lines.append(f"free-run ESR of the baseline with nothing hidden, held-out: median {np.median(clean):.4f}")
    crude = [law_found(r) for r in good if r["baseline"] == "linear" and r["outcome"] == "answered"]
    if crude:
        lines.append(f"from linear, {len(crude)} cases: the law's friction is named in {sum(f[0] for f in crude)}, its "
                     f"current in {sum(f[1] for f in crude if len(f) > 1)} of {sum(len(f) > 1 for f in crude)}")
    broken = len(rows) - len(good)
    return "\n".join([*lines, *([f"{broken} ended in an error of the rig"] if broken else [])])


# -- running ------------------------------------------------------------------------------------------------------
def run(options: argparse.Namespace) -> None:
    """The cases of this shard that no file of the folder holds."""
    part, parts = map(int, options.shard.split("/"))
    done = {r["id"] for r in read(options.folder)}
    path = options.folder / f"shard-{part}-of-{parts}.jsonl"
    fixings = [{"kind": k} for k in options.only.split(",")] if options.only else [{}]
    chosen = {"baseline": options.baseline} if options.baseline else {}
    for number in range(part, options.cases, parts):
        for fixed in fixings:
            name = "-".join((str(options.seed), str(number), str(fixed.get("kind", "any")), *chosen.values()))
            if name in done:
                continue
            try:
                row = case(options.seed * 100_000 + number, options.limit, **fixed, **chosen)
            except Exception as error:
                row = {"error": f"{type(error).__name__}: {error}"}
            row |= {"id": name}
            print(line(row), flush=True)
            append(path, row)


def judged(folder: Path) -> list[Row]:
    """Rows of the calibration, or of the ablation with all rules, as rows of this board."""
    found = [row for row in read(folder) if row["id"].startswith("foreign-")]
    return [row if "error" in row else with_all_rules(row) | {"outcome": "answered"} | (
        {} if "variants" in row else {"seconds": row["cpu"]}) for row in found]


def main() -> None:
    """Run what is missing, then print the table."""
    parser = argparse.ArgumentParser(description="Scoreboard on the foreign rig.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--shard", default="0/1")
    parser.add_argument("--only", default="", help=f"kinds, comma-separated: {', '.join(cases.KINDS)}")
    parser.add_argument("--baseline", choices=["linear"], help="by default the law that suits the device")
    parser.add_argument("--limit", type=float, default=180.0, help="seconds per case")
    parser.add_argument("--calibration", action="store_true",
                        help="the folder has rows of diagnosis_calibration.py or rule_ablation.py")
    parser.add_argument("--table", action="store_true", help="print the table of the rows computed")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    rows = judged(options.folder) if options.calibration else None
    if rows is None and not options.table:
        run(options)
    for row in rows or ():
        print(line(row))
    print(table(read(options.folder) if rows is None else rows))


if __name__ == "__main__":
    main()
