"""No false promise: random plants through output feedback, and each closed loop looked at by other means.

    python tests/benchmarks/synthesis_study.py --out FOLDER [--plants 200] [--shard 0/1]

Times are of the processor. Resumable: a plant whose line is in FOLDER is not done again; shards share a folder. Rivals
for the bound: the same inequalities solved by SDPA without the coordinates of the search, and the change of variables
(`MultiObjective`).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers import synthesis_plants
from helpers.promise import frozen_peak, moving_peak
from helpers.random_plants import RandomPlant, random_plant

import lpvid as lpv
from lpvid.synthesis import projected_search
from lpvid.synthesis.balanced_plant import BalancedPlant
from lpvid.synthesis.controller_formula import Variations
from lpvid.synthesis.output_feedback_search import FeedbackProblem

PATHS = 100
NEAR = 1.05


def reference() -> list[RandomPlant]:
    """The published plants."""
    made: list[tuple[str, lpv.GeneralizedPlant, lpv.OutputFeedback]] = [
        (name, getattr(synthesis_plants, name)(), lpv.OutputFeedback())
        for name in ("scherer", "sb10fd", "ill_conditioned", "trivial", "missile")]
    basis = lpv.Fourier("rho", 1)
    made += [(f"wu-{varying}", synthesis_plants.wu(5.0), lpv.OutputFeedback(basis, varying=varying))
             for varying in ("both", "controls")]
    return [RandomPlant(-1 - i, plant, design, (name,), True) for i, (name, plant, design) in enumerate(made)]


def by_sdpa(case: RandomPlant) -> float:
    """The bound of the same inequalities by another solver, in the plant's balanced units only."""
    grid = case.design._grid(case.plant)
    lyapunov = case.design.lyapunov
    variations = Variations(None if lyapunov is None else lyapunov.bound(case.plant.box), case.design.varying,
                            case.plant.box)
    points = grid.points
    problem = FeedbackProblem(BalancedPlant.of(case.plant, points), variations, grid.axes, grid.corners, False,
                              points[:0])
    rounds = projected_search.ROUNDS
    try:
        projected_search.ROUNDS = 1
        pair = projected_search.least_bound(problem.projected, solvers=("SDPA",))
    finally:
        projected_search.ROUNDS = rounds
    return np.inf if pair is None or pair.status != "optimal" else pair.gamma


def by_variables(case: RandomPlant) -> float:
    """The verified bound of the change of variables, where X and Y are constants."""
    if case.design.lyapunov is not None:
        return np.inf
    found = lpv.synthesize(case.plant, lpv.MultiObjective(lpv.HInfinity(), back_off=1.01))
    return np.inf if found.gamma_verified is None else found.gamma_verified


def attempted(route: Callable[[RandomPlant], float], case: RandomPlant) -> float:
    """A rival's bound; infinite where it gives up."""
    try:
        value = float(route(case))
    except (lpv.LpvError, ArithmeticError, ValueError, np.linalg.LinAlgError):
        return np.inf
    return value if value > 0 else np.inf


def examined(case: RandomPlant, rivals: bool = True) -> dict:
    """One line of the study."""
    rng = np.random.default_rng([case.seed + 1000, 7])
    started = time.process_time()
    found = lpv.synthesize(case.plant, case.design)
    line = {"seed": case.seed, "traits": case.traits, "reachable": case.reachable, "verdict": found.verdict,
            "seconds": time.process_time() - started, "infimum": found.infimum, "gamma": found.gamma,
            "verified": found.gamma_verified, "between_grid": found.between_grid, "why": found.why, "mend": found.mend,
            "certificate": found.certificate is not None}
    if found.controller is not None:
        frozen, frequency = frozen_peak(case.plant, found.controller, rng)
        moving = moving_peak(case.plant, found.controller, frequency, PATHS, rng)
        for finer in (4.0, 16.0):  # where it breaks the promise: the loop, or the integration?
            if moving > min(found.gamma, found.gamma_verified):
                moving = moving_peak(case.plant, found.controller, finer * frequency, PATHS, rng)
        line |= {"frozen": frozen, "moving": moving, "lower": found.gamma_lower}
    if rivals:
        line |= {"sdpa": attempted(by_sdpa, case), "variables": attempted(by_variables, case)}
    return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in line.items()}


def broken(line: dict) -> bool:
    """A promise below what the loop does."""
    if line["verified"] is None:
        return False
    promise = min(line["gamma"], line["verified"]) * (1 + 1e-6)
    return any(line[k] is None or line[k] > promise for k in ("frozen", "moving"))


def summary(lines: list[dict]) -> str:
    """The table."""
    feasible = [x for x in lines if any(x.get(k) is not None for k in ("verified", "sdpa", "variables"))]
    solved = [x for x in feasible if x["verdict"] == "solved"]
    bounds = {x["seed"]: min(v for k in ("verified", "infimum", "sdpa", "variables") if (v := x.get(k)) is not None)
              for x in feasible}
    close = [x for x in feasible if x["verified"] is not None and x["verified"] <= max(NEAR * bounds[x["seed"]], 1e-3)]
    rows = ["| verdict | plants | median time, s | longest, s |", "|---|---|---|---|"]
    for verdict in dict.fromkeys(x["verdict"] for x in lines):
        seconds = [x["seconds"] for x in lines if x["verdict"] == verdict]
        rows.append(f"| {verdict} | {len(seconds)} | {np.median(seconds):.2f} | {max(seconds):.1f} |")
    bad = [x["seed"] for x in lines if broken(x)]
    short = [x["seed"] for x in feasible if x not in close]
    rows += [f"\n{len(lines)} plants; false promises: {len(bad)} {bad or ''}",
             f"feasible {len(feasible)}; solved {len(solved)} ({100 * len(solved) / max(len(feasible), 1):.1f} %)",
             f"within 5 % of any route's best bound {len(close)} ({100 * len(close) / max(len(feasible), 1):.1f} %)",
             f"short of that: {short}",
             f"proven between grid points: {sum(bool(x['between_grid']) for x in solved)} of {len(solved)}"]
    return "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--plants", type=int, default=200)
    parser.add_argument("--shard", default="0/1")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    mine, shards = (int(x) for x in options.shard.split("/"))
    cases = [*reference(), *range(options.plants)]
    for i, case in enumerate(cases):
        case_of = case if isinstance(case, RandomPlant) else None
        seed = case_of.seed if case_of else case
        path = options.out / f"{seed}.json"
        if i % shards != mine or path.exists():
            continue
        line = examined(case_of or random_plant(seed))
        path.write_text(json.dumps(line))
        print(seed, line["verdict"], line["verified"], line.get("moving"), f"{line['seconds']:.1f} s", flush=True)
    done = sorted(options.out.glob("*.json"))
    print(summary([json.loads(p.read_text()) for p in done]))


if __name__ == "__main__":
    main()
