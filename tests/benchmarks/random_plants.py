"""Random plants in bad units: how near each verified gain is to the least bound of any route, none below the loop's.

    python tests/benchmarks/random_plants.py --out FOLDER [--first 0] [--plants 200] [--limit 60] [--shard 0/1]

Orders 3 to 10; states, controls and measurements up to 10⁶ apart; time-invariant, affine, or tables of sqrt(p), sin(p)
and 1/p; near-integrators, weak penalties and weak noise among them. Resumable: a plant whose line is in FOLDER is not
done again, but for the rivals that a pass --without-rivals left out. Rivals for the least bound: the inequalities
without the Riccati start, the same by SDPA, and the change of variables; no bound counts that lies below the largest
frozen optimum (Riccati equations).

A synthesis has `--limit` seconds of processor time; a plant that is out of time counts as one that was not solved. Each
rival has the same, and one that is out of time has no bound.
"""

from __future__ import annotations

import argparse
import json
import math
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest import mock

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers.badly_scaled_plants import random_case
from helpers.promise import frozen_peak, moving_peak

import lpvid as lpv
from lpvid.synthesis import multiobjective, projected_search
from lpvid.synthesis.balanced_plant import BalancedPlant
from lpvid.synthesis.controller_formula import Variations
from lpvid.synthesis.output_feedback_search import FeedbackProblem
from lpvid.synthesis.riccati import least_gain

NEAR = 1.12
LATE = "out of time"


class OutOfTimeError(BaseException):
    """The limit of processor time is reached; no handler of the library's own takes it for a failure of a solver."""


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """A block with so much processor time; the exception comes when the native solver at work returns."""

    def stop(*_: object) -> None:
        raise OutOfTimeError

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds if math.isfinite(seconds) else 0.0)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def bounds(case: lpv.GeneralizedPlant, design: lpv.OutputFeedback, verified: float | None, rivals: bool,
           limit: float = math.inf) -> dict[str, float]:
    """The largest frozen optimum, and with `rivals` the least bound by each other route.

    No route comes below the largest frozen optimum: where the verified gain is near that, there is nothing to ask.
    """
    grid = design._grid(case)
    points = grid.points
    variations = Variations(None if design.lyapunov is None else design.lyapunov.bound(case.box), design.varying,
                            case.box)
    problem = FeedbackProblem(BalancedPlant.of(case, points), variations, grid.axes, grid.corners, False, points[:0])
    plant = problem.projected.plant
    found = {"frozen_optimum": max(least_gain(plant, k) for k in range(len(plant.A)))}

    if not rivals or (verified is not None and verified <= NEAR * found["frozen_optimum"]):
        return found

    def inequalities(solver: str) -> float:
        with mock.patch.object(projected_search, "_starts", lambda of: iter([projected_search.initial(of)])):
            pair = projected_search.least_bound(problem.projected, solvers=(solver,))
        return np.inf if pair is None or pair.status != "optimal" else pair.gamma

    def variables() -> float:
        with mock.patch.object(multiobjective, "_by_output_feedback", lambda *_: None):
            other = lpv.synthesize(case, lpv.MultiObjective(lpv.HInfinity(), back_off=1.01))
        return other.gamma_verified or np.inf

    routes: dict[str, Callable[[], float]] = {"without_start": lambda: inequalities("CLARABEL"),
                                              "sdpa": lambda: inequalities("SDPA")}
    if design.lyapunov is None:
        routes["variables"] = variables
    for name, route in routes.items():
        try:
            with limited(limit):
                found[name] = route()
        except OutOfTimeError:
            found[name] = np.inf
    return found


def examined(seed: int, rivals: bool, limit: float = math.inf) -> dict:
    """One line of the study, with the processor time of the synthesis [s]."""
    case, design, traits = random_case(seed)
    started = time.process_time()
    try:
        with limited(limit):
            found = lpv.synthesize(case, design)
    except OutOfTimeError:
        return {"seed": seed, "traits": traits, "verdict": LATE, "seconds": time.process_time() - started,
                "infimum": None, "verified": None, "lower": None, "why": f"{limit:g} s of processor time"}
    line = {"seed": seed, "traits": traits, "verdict": found.verdict, "seconds": time.process_time() - started,
            "infimum": found.infimum, "verified": found.gamma_verified, "lower": found.gamma_lower, "why": found.why,
            "solver": found.solver, "method": found.method}
    if found.controller is not None:
        rng = np.random.default_rng([seed, 28])
        frozen, frequency = frozen_peak(case, found.controller, rng)
        moving = moving_peak(case, found.controller, frequency, 20, rng)
        for finer in (4.0, 16.0):
            if moving > found.gamma_verified:
                moving = moving_peak(case, found.controller, finer * frequency, 20, rng)
        line |= {"frozen": frozen, "moving": moving}
    line |= bounds(case, design, found.gamma_verified, rivals, limit)
    return _plain(line)


def _plain(line: dict) -> dict:
    return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in line.items()}


def undecided(line: dict) -> bool:
    """Some rival could have a bound so much lower that the plant counts as farther, and none was asked."""
    frozen = line.get("frozen_optimum")
    near = frozen is not None and line["verified"] is not None and line["verified"] <= NEAR * frozen
    return line["verdict"] != LATE and "sdpa" not in line and not near


def least(line: dict) -> float:
    """The least bound that any route found, none below the largest frozen optimum."""
    names = ("infimum", "verified", "without_start", "sdpa", "variables")
    routes = [v for k in names if (v := line.get(k)) is not None]
    return max(min(routes, default=np.inf), (line.get("frozen_optimum") or 0.0) * (1 - 1e-3))


def broken(line: dict) -> bool:
    """A promise below what the loop does."""
    return line["verified"] is not None and any(
        line[k] is None or line[k] > line["verified"] * (1 + 1e-6) for k in ("frozen", "moving"))


def summary(lines: list[dict]) -> str:
    """The table."""
    possible = [x for x in lines if np.isfinite(least(x)) or x["verdict"] == LATE]
    near = [x for x in possible if x["verified"] is not None and x["verified"] <= NEAR * least(x)]
    rows = ["| verdict | plants | median time, s | longest, s |", "|---|---|---|---|"]
    for verdict in dict.fromkeys(x["verdict"] for x in lines):
        seconds = [x["seconds"] for x in lines if x["verdict"] == verdict]
        rows.append(f"| {verdict} | {len(seconds)} | {np.median(seconds):.2f} | {max(seconds):.1f} |")
    seconds = [x["seconds"] for x in lines]
    rows.append(f"| all | {len(seconds)} | {np.median(seconds):.2f} | {max(seconds):.1f} |")
    short = {x["seed"]: round((x["verified"] or np.inf) / least(x), 3) for x in possible if x not in near}
    rows += [f"\n{len(lines)} plants, {len(possible)} for which some route found a bound or time ran out",
             f"within {100 * NEAR - 100:.0f} % of it: {len(near)} ({100 * len(near) / max(len(possible), 1):.1f} %); "
             f"farther, as factors by seed: {short}",
             f"promises below what the loop does: {[x['seed'] for x in lines if broken(x)]}"]
    return "\n".join(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--plants", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--shard", default="0/1")
    parser.add_argument("--limit", type=float, default=math.inf, help="processor time of a synthesis, and a rival [s]")
    parser.add_argument("--without-rivals", action="store_true", help="judge by own bounds and frozen optima alone")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    mine, shards = (int(x) for x in options.shard.split("/"))
    for seed in range(options.first, options.first + options.plants):
        path = options.out / f"{seed}.json"
        line = json.loads(path.read_text()) if path.exists() else None
        if seed % shards != mine or (line is not None and (options.without_rivals or not undecided(line))):
            continue
        if line is None:
            line = examined(seed, not options.without_rivals, options.limit)
        else:
            case, design, _ = random_case(seed)
            line |= _plain(bounds(case, design, line["verified"], True, options.limit))
        path.write_text(json.dumps(line))
        print(seed, *line["traits"], line["verdict"], line["verified"], line.get("infimum"), line.get("moving"),
              f"{line['seconds']:.1f} s", flush=True)
    print(summary([json.loads(p.read_text()) for p in sorted(options.out.glob("*.json"))]))


if __name__ == "__main__":
    main()
