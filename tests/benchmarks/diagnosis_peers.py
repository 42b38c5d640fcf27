"""What simpler methods answer on the cases of the foreign scoreboard, from the same baselines and records.

    python tests/benchmarks/diagnosis_peers.py OUT [--calibration]

OUT holds rows of `foreign_scoreboard`; what is separable comes from them. Every peer starts from the fitted baseline's
residual r and a library of signatures, each the change of the simulated force by a small cause of the catalogue,
written here anew (d of a spring in series is -dL/dv dF/dt / k, and so on):

- bic: forward selection by the white-noise BIC, as long as it falls;
- likelihood ratio: forward selection as long as a chi-square test at 5 %, Bonferroni over the library, passes;
- sparse: sequentially thresholded least squares on the residual (as SINDy does), threshold 2 % of the force;
- tests: whiteness (Ljung-Box, 40 lags) and correlation with the inputs; they name nothing, and tell only whether
  something is there.

The first two project out the baseline's own sensitivities; all errors are white to them, which is what is judged.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import foreign_scoreboard
import numpy as np
from helpers.foreign_rig import cases
from rows import read
from scipy.signal import lfilter
from scipy.stats import chi2

import lpvid as lpv
from lpvid.baselines.baseline import Baseline
from lpvid.baselines.signals import Signals
from lpvid.diagnosis.task import prepare_task

LIMIT = 6
"""causes after which a forward selection stops: nobody hides more than two"""
THRESHOLD = 0.02
HEAD = 128


@dataclasses.dataclass(frozen=True, eq=False)
class Bench:
    """Residual, its baseline's sensitivities, and the library: columns (n, m) with their names."""

    residual: np.ndarray
    sensitivities: np.ndarray
    columns: np.ndarray
    names: tuple[str, ...]
    inputs: np.ndarray
    size: float


def bench_of(baseline: Baseline, signals: Signals) -> Bench:
    """Everything that the peers read."""
    vector = baseline.vector
    force = baseline.core(vector)(signals)
    steps = 1e-4 * np.maximum(np.abs(vector), 1e-3)
    sensitivities = np.column_stack([
        (baseline.core(vector + h * np.eye(vector.size)[k])(signals) - force) / h for k, h in enumerate(steps)])
    sensitivities = sensitivities[:, np.all(np.isfinite(sensitivities), axis=0)]  # a number may be at its end
    library = signatures(lambda **channels: baseline.core(vector)(
        Signals(signals.sample_time, {**signals.channels, **channels}, signals.output)), signals, force)
    kept = {n: c[HEAD:] for n, c in library.items() if np.all(np.isfinite(c)) and np.std(c) > 0}
    inputs = np.column_stack([signals.channels[c] for c in baseline.channels if c != baseline.output])
    return Bench((signals.output - force)[HEAD:], sensitivities[HEAD:], np.column_stack(list(kept.values())),
                 tuple(kept), inputs[HEAD:], float(np.sqrt(np.mean(signals.output**2))))


def signatures(simulate: Callable[..., np.ndarray], signals: Signals, force: np.ndarray) -> dict[str, np.ndarray]:
    """(n,) change of the force by a small cause, per name of the catalogue."""
    h = signals.sample_time
    v, x = signals.channels["velocity"], signals.channels.get("displacement")
    speed, size = float(np.sqrt(np.mean(v**2))), float(np.sqrt(np.mean(force**2)))
    a, rate = np.gradient(v, h), np.gradient(force, h)
    slope = (simulate(velocity=v + 1e-3 * speed) - force) / (1e-3 * speed)
    heat = np.cumsum(force * v) * h
    dry = np.tanh(v / (0.02 * speed))
    found = {
        "coulomb-friction": dry, "stribeck-friction": dry * np.exp(-((v / (0.2 * speed)) ** 2)),
        "force-offset": np.ones_like(v), "quadratic-loss": v * np.abs(v), "asymmetry": force * (v > 0),
        "input-nonlinearity": v * np.log(np.abs(v) / speed + 1e-3),
        "series-compliance": -slope * rate, "backlash": -slope * np.gradient(np.tanh(force / (0.05 * size)), h),
        "entrained-air": -slope * rate / (1 + np.abs(force) / size) ** 2,
        "relief-valve": -np.maximum(np.abs(force) - 0.7 * size, 0) * np.sign(v),
        "series-orifice": np.maximum(np.abs(v) - speed, 0) ** 2 * np.sign(v), "force-delay": -rate,
        "fixture-inertia": a, "fixture-resonance": -np.gradient(rate, h), "thermal-fade": -force * heat,
        "viscous-fade": -v * heat, "one-sided-filter": np.gradient(slope * a, h)}
    moved = {"velocity": np.interp(np.arange(v.size) + 1.0, np.arange(v.size), v)}
    if x is not None:
        reach = float(np.abs(x).max())
        found |= {"gas-stiffness": x, "end-stop": np.maximum(np.abs(x) - 0.7 * reach, 0) * np.sign(x)}
        moved["displacement"] = np.interp(np.arange(v.size) + 1.0, np.arange(v.size), x)
    found["displacement-delay"] = simulate(**moved) - force
    current = signals.channels.get("current")
    if current is not None and np.ptp(current) > 0:
        found |= {name: simulate(current=i) - force for name, i in _currents(current, h).items()}
    return found


def _currents(i: np.ndarray, h: float) -> dict[str, np.ndarray]:
    """What each electrical cause makes of the current; a lag and a delay of 10 ms."""
    decay = np.exp(-h / 0.01)
    lag = np.asarray(lfilter([1 - decay], [1, -decay], i - i[0])) + i[0]
    top = float(np.abs(i).max())
    play = np.empty_like(i)
    y = i[0]
    for k, value in enumerate(i):
        y = min(max(y, value - 0.1 * top), value + 0.1 * top)
        play[k] = y
    return {"coil-lag": lag, "rise-fall-lag": np.where(i > lag, i, lag), "remanence": play,
            "command-delay": np.interp(np.arange(i.size) - 0.01 / h, np.arange(i.size), i),
            "current-saturation": i - 0.2 * i**2 / top}


# -- peers --------------------------------------------------------------------------------------------------------
def _squared(bench: Bench, chosen: Sequence[int]) -> float:
    """Sum of squares that the sensitivities and the chosen signatures leave."""
    block = np.column_stack([bench.sensitivities, bench.columns[:, list(chosen)]])
    block = block / np.maximum(np.sqrt(np.mean(block**2, axis=0)), 1e-300)
    left = bench.residual - block @ np.linalg.lstsq(block, bench.residual, rcond=1e-10)[0]
    return float(left @ left)


def _forward(bench: Bench, passes: Callable[[float, float, int], bool]) -> list[str]:
    """Names chosen one after the other, the best first, as long as (before, after, samples) passes."""
    chosen: list[int] = []
    now = _squared(bench, chosen)
    while len(chosen) < LIMIT:
        rest = [k for k in range(len(bench.names)) if k not in chosen]
        found = min((_squared(bench, [*chosen, k]), k) for k in rest)
        if not passes(now, found[0], bench.residual.size):
            break
        now, chosen = found[0], [*chosen, found[1]]
    return [bench.names[k] for k in chosen]


def by_bic(bench: Bench) -> list[str]:
    """White-noise BIC: n log S + k log n falls."""
    return _forward(bench, lambda before, after, n: n * np.log(before / after) > np.log(n))


def by_likelihood_ratio(bench: Bench) -> list[str]:
    """n log(S/S') beyond the chi-square quantile of 5 % over the library's size."""
    bound = float(chi2.isf(0.05 / len(bench.names), 1))
    return _forward(bench, lambda before, after, n: n * np.log(before / after) > bound)


def by_sparse_regression(bench: Bench) -> list[str]:
    """Sequentially thresholded least squares; a term stays while it changes at least 2 % of the force."""
    size = np.sqrt(np.mean(bench.columns**2, axis=0))
    block = bench.columns / size
    kept = np.arange(block.shape[1])
    weights = np.zeros(0)
    for _ in range(10):
        weights = np.linalg.lstsq(block[:, kept], bench.residual, rcond=1e-8)[0]
        stays = np.abs(weights) >= THRESHOLD * bench.size
        if stays.all():
            break
        kept, weights = kept[stays], weights[stays]
        if not kept.size:
            return []
    return [bench.names[k] for k in kept[np.argsort(-np.abs(weights))]]


def is_structured(bench: Bench, lags: int = 40) -> bool:
    """Whether whiteness or independence of the inputs is rejected at 5 % (halved between the two)."""
    r = bench.residual - bench.residual.mean()
    n = r.size
    power = float(r @ r)
    own = np.array([r[k:] @ r[:-k] / power for k in range(1, lags + 1)])
    box = n * (n + 2) * float(np.sum(own**2 / (n - np.arange(1, lags + 1))))
    u = bench.inputs - bench.inputs.mean(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        cross = np.nan_to_num(u.T @ r / np.sqrt(power * np.sum(u**2, axis=0)))
    return bool(box > chi2.isf(0.025, lags) or n * np.max(cross**2) > chi2.isf(0.025 / u.shape[1], 1))


PEERS: dict[str, Callable[[Bench], list[str]]] = {
    "naive BIC": by_bic, "likelihood ratio": by_likelihood_ratio, "sparse regression": by_sparse_regression}


# -- running ------------------------------------------------------------------------------------------------------
def answers(row: dict) -> dict[str, dict]:
    """Per peer the row with its names in place of the diagnosis's; the tests' under their own name."""
    plan = cases.Plan(**{f.name: tuple(row[f.name]) if f.name == "causes" else row[f.name]
                         for f in dataclasses.fields(cases.Plan)})
    world = cases.world(plan)
    hidden = tuple(zip(plan.causes, row["sizes"], strict=True))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "record.csv"
        cases.written(world, cases.measured(world, world.run(hidden)), path)
        task = prepare_task(lpv.read(str(path)), plan.baseline)
    record = task.prepared.training[0]
    baseline = task.baseline.fit(list(task.prepared.training))
    bench = bench_of(baseline, baseline.signals(record))
    found = {}
    for name, peer in PEERS.items():
        named = peer(bench)
        found[name] = row | {"outcome": "answered", "named": named, "rivals": [], "seconds": 0.0,
                             "verdict": "explained" if named else "nothing-to-explain"}
    verdict = "unexplained" if is_structured(bench) else "nothing-to-explain"
    found["residual tests"] = row | {"outcome": "answered", "named": [], "rivals": [], "verdict": verdict,
                                     "seconds": 0.0}
    return found


def table(rows: list[dict[str, dict]], own: list[dict]) -> str:
    """Markdown: shares per method."""
    lines = ["| method | nothing hidden: false alarm | one, separable: right first | wrong name | outside: refused |",
             "|---|---|---|---|---|"]
    methods = {name: [r[name] for r in rows] for name in [*PEERS, "residual tests"]} | {"lpvid diagnose": own}
    for name, found in methods.items():
        nothing = [r for r in found if r["kind"] == "nothing"]
        single = [r for r in found if r["kind"] in ("single", "rough") and r["separable"]]
        outside = [r for r in found if r["kind"] == "outside"]
        alarms = [r["verdict"] == "unexplained" if name == "residual tests" else bool(foreign_scoreboard.stated(r))
                  for r in nothing if r["outcome"] == "answered"]
        marks = [foreign_scoreboard.mark(r) for r in single]
        wrong = [bool(foreign_scoreboard.wrong(r)) for r in found if r["outcome"] == "answered"]
        refused = [not foreign_scoreboard.stated(r) for r in outside if r["outcome"] == "answered"]
        cells = [f"{sum(c)} of {len(c)}" for c in (alarms, [m == "right" for m in marks], wrong, refused)]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Ask the peers on every row and print the table."""
    parser = argparse.ArgumentParser(description="What simpler methods answer on the foreign scoreboard's cases.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--calibration", action="store_true", help="its rows are of the calibration or the ablation")
    options = parser.parse_args()
    rows = foreign_scoreboard.judged(options.folder) if options.calibration else read(options.folder)
    own = [r for r in rows if "outcome" in r]
    print(table([answers(r) for r in own], own))


if __name__ == "__main__":
    main()
