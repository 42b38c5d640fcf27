"""Reliability of the probabilities: short blind cases of both rigs by the evidence engine.

    python tests/benchmarks/diagnosis_calibration.py OUT --foreign 100 --own 100 --seed 3
    python tests/benchmarks/diagnosis_calibration.py OUT --table [--picture FILE.png] [--csv FILE.csv]

A pair is a component that the diagnosis gives at least `LISTED`, its probability, and whether it is there. What a
record truly has besides (the chain's filters; friction and springs of the law itself) is neither right nor wrong and is
left out, and so are names that nothing in these data keeps apart from what is hidden (own rig, `near`). Cases with even
numbers fit the map, those with odd numbers judge it. Foreign cases are sized as in `foreign_rig.truth`, without the
comparison with every other cause, which takes longer than the diagnosis.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from foreign_scoreboard import read
from helpers.foreign_rig import cases, truth
from helpers.hidden_score import imitators
from real_answers import parts_of

LISTED = 0.05
EDGES = np.array([0.05, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.99, 1.0 + 1e-9])
CLIP = 1e-4
"""probabilities are read to within this of 0 and 1, so that their logits are finite"""
Row = dict
Pair = tuple[float, bool, int]


# -- cases --------------------------------------------------------------------------------------------------------
def foreign_case(seed: int) -> Row:
    """One case of the foreign rig, at half its rate, 10 s: plain data."""
    import lpvid as lpv

    plan = cases.draw(seed, duration=10.0)
    world = cases.world(plan)
    bench = truth.bench(world)
    found = [bench.sized(name, plan.share) for name in plan.causes]
    hidden = tuple((name, size) for name, (size, _) in zip(plan.causes, found, strict=True))
    visible = [float(np.sqrt(np.mean(c**2))) for _, c in found]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "record.csv"
        cases.written(world, cases.measured(world, world.run(hidden)), path)
        record = lpv.read(str(path))
    begun = time.process_time()
    answer = lpv.diagnose(record, plan.baseline, engine="evidence", sample_rate=cases.RATE / 2)
    assert answer.weights is not None
    return plan.to_dict() | {
        "rig": "foreign", "visible": visible, "law_error": truth.law_error(world) if world.device.error else 0.0,
        "verdict": answer.verdict, "named": [c.name for c in answer.causes],
        "rivals": [list(r.names) for r in answer.rivals], "posterior": dict(answer.weights.causes),
        "changes": {c.name: c.contribution for c in answer.causes},
        "families": dict(answer.weights.families), "before": answer.before.esr_held_out,
        "after": answer.after.esr_held_out, "cpu": round(time.process_time() - begun, 2)}


def own_case(seed: int) -> Row:
    """One case of the own rig as the scoreboard has it."""
    from helpers import hidden_score

    from quartercar.effects import CATALOGUE

    return hidden_score.case(seed, CATALOGUE, "evidence") | {"rig": "own"}


def run(options: argparse.Namespace) -> None:
    """The cases that no file of the folder holds."""
    done = {r["id"] for r in read(options.folder)}
    wanted = [(f"{rig}-{options.seed}-{n}", make, options.seed * 100_000 + n)
              for rig, make, count in (("foreign", foreign_case, options.foreign), ("own", own_case, options.own))
              for n in range(count)]
    for name, make, seed in wanted:
        if name in done:
            continue
        try:
            row = make(seed)
        except Exception as error:
            row = {"error": f"{type(error).__name__}: {error}"}
        print(name, row.get("kind"), row.get("law"), row.get("causes"), "->", row.get("verdict"), row.get("named"),
              row.get("rivals"), row.get("cpu"), row.get("error", ""), flush=True)
        with (options.folder / "calibration.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps(row | {"id": name}) + "\n")


# -- pairs --------------------------------------------------------------------------------------------------------
def pairs(rows: list[Row]) -> list[Pair]:
    """(probability, whether it is there, number of the case) of every component that is listed."""
    out = []
    for number, row in enumerate(r for r in rows if r.get("posterior") is not None and "error" not in r):
        there = set(row["causes"])
        if "visible" in row:
            besides = cases.OWN[row["law"]] | cases.CHAIN | {"force-offset", "gas-preload"}
        else:
            besides = {"shared-filter"} if row["chain"] == "full" else set()
            besides |= imitators(row) if row["kind"] == "outside" or not row["separable"] else set()
        for name, p in row["posterior"].items():
            if p >= LISTED and (name in there or name not in besides):
                out.append((float(p), name in there or any(c in parts_of(name) for c in there), number))
    return out


def reliability(found: list[Pair]) -> tuple[list[tuple[float, float, int]], float]:
    """Per bin mean probability, share that is there and count; and the expected calibration error."""
    p, there = np.array([f[0] for f in found]), np.array([f[1] for f in found], dtype=float)
    bins = np.digitize(p, EDGES)
    rows = [(float(p[bins == k].mean()), float(there[bins == k].mean()), int(np.sum(bins == k)))
            for k in np.unique(bins)]
    return rows, float(sum(n * abs(a - b) for a, b, n in rows) / max(p.size, 1))


def logit(p: np.ndarray) -> np.ndarray:
    """ln p/(1 − p), p clipped."""
    q = np.clip(p, CLIP, 1 - CLIP)
    return np.log(q / (1 - q))


def mapped(p: np.ndarray, slope: float, offset: float) -> np.ndarray:
    """Probabilities by the map: the logit straight, a slope of at least 0 (Platt 1999)."""
    return 1 / (1 + np.exp(-(slope * logit(p) + offset)))


def fitted(found: list[Pair]) -> tuple[float, float]:
    """Slope and offset of most likelihood, with Platt's targets (N₊+1)/(N₊+2), 1/(N₋+2)."""
    from scipy.optimize import minimize

    x, there = logit(np.array([f[0] for f in found])), np.array([f[1] for f in found])
    target = np.where(there, (there.sum() + 1) / (there.sum() + 2), 1 / (np.sum(~there) + 2))

    def loss(theta: np.ndarray) -> float:
        z = theta[0] * x + theta[1]
        return float(np.sum(np.logaddexp(0.0, z) - target * z))

    best = minimize(loss, np.array([1.0, 0.0]), bounds=[(0.0, None), (None, None)])
    return float(best.x[0]), float(best.x[1])


def table(rows: list[Row]) -> str:
    """Reliability of all pairs, raw; the map of the even cases, judged on the odd ones."""
    found = pairs(rows)
    even, odd = ([f for f in found if f[2] % 2 == k] for k in (0, 1))
    lines = [f"{len([r for r in rows if 'error' not in r])} cases, {len(found)} pairs"]
    for label, part in (("raw, all", found), ("raw, odd", odd)):
        bins, error = reliability(part)
        lines += [f"{label}: expected calibration error {error:.3f}",
                  *(f"  {a:.3f} given, {b:.3f} there, {n}" for a, b, n in bins)]
    slope, offset = fitted(even)
    values = mapped(np.array([f[0] for f in odd]), slope, offset)
    bins, error = reliability([(float(v), f[1], f[2]) for v, f in zip(values, odd, strict=True)])
    lines += [f"map of the even cases: slope {slope:.3f}, offset {offset:.3f}; odd cases by it: {error:.3f}",
              *(f"  {a:.3f} given, {b:.3f} there, {n}" for a, b, n in bins)]
    return "\n".join(lines)


def picture(rows: list[Row], path: Path) -> None:
    """Reliability diagram, raw and by the map, on the odd cases."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    found = pairs(rows)
    even, odd = ([f for f in found if f[2] % 2 == k] for k in (0, 1))
    values = mapped(np.array([f[0] for f in odd]), *fitted(even))
    figure, axes = plt.subplots(figsize=(5, 4.5), layout="constrained")
    axes.plot([0, 1], [0, 1], color="0.7", lw=1)
    for label, part, mark in (("as computed", odd, "o"),
                              ("by the map", [(float(v), f[1], f[2]) for v, f in zip(values, odd, strict=True)], "s")):
        bins, error = reliability(part)
        axes.plot([b[0] for b in bins], [b[1] for b in bins], mark + "-", label=f"{label}, error {error:.3f}")
    axes.set(xlabel="probability given", ylabel="share that is there", xlim=(0, 1.02), ylim=(0, 1.02),
             title=f"Odd-numbered cases, {len(odd)} causes")
    axes.legend(loc="upper left")
    figure.savefig(path, dpi=110)


def main() -> None:
    """Run what is missing, then print the table."""
    parser = argparse.ArgumentParser(description="Reliability of the probabilities of a diagnosis.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--foreign", type=int, default=0)
    parser.add_argument("--own", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--picture", type=Path, default=None)
    parser.add_argument("--csv", type=Path, default=None)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    if not options.table:
        run(options)
    rows = read(options.folder)
    print(table(rows))
    if options.picture:
        picture(rows, options.picture)
    if options.csv:
        with options.csv.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([("probability", "there", "case"), *((f"{p:.4f}", int(t), n)
                                                                          for p, t, n in pairs(rows))])


if __name__ == "__main__":
    main()
