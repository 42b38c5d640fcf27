"""Where the time goes: each hot path against its limit, and how it grows, in one run.

    python tests/benchmarks/limits.py [--quick] [--only NAME,…] [--rounds 3] [--no-curves] [--samples 1e6]

Processor time, the least of several rounds, on one BLAS thread. A ratio is that of our time and the limit's in the same
run: what a bare kernel of the same work takes, named in the line. Curves give measured exponents (least squares of
log time over log size, over the upper half of the sizes) beside theory's.

Expected, written down before the run: regression at most 1.3 times the chunked dgeqrf of prebuilt chunks, the free run
at most 1.3 times the hand-compiled loop; exponents in N at most 1.05.
"""

from __future__ import annotations

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import argparse  # noqa: E402
import subprocess  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable  # noqa: E402
from dataclasses import replace  # noqa: E402

import numpy as np  # noqa: E402
from scipy.linalg import lapack  # noqa: E402

import lpvid as lpv  # noqa: E402

Timed = Callable[[], object]
ROUNDS = [3]


def cpu(function: Timed) -> float:
    """Least processor time of some rounds, after one that compiles [s]."""
    function()
    found = []
    for _ in range(ROUNDS[0]):
        begun = time.process_time()
        function()
        found.append(time.process_time() - begun)
    return min(found)


def process(words: list[str]) -> tuple[float, float]:
    """Processor and wall time of a process of its own, the least of some rounds [s]."""
    found = []
    for _ in range(ROUNDS[0]):
        before, begun = os.times(), time.perf_counter()
        subprocess.run(words, check=True, capture_output=True)
        after = os.times()
        spent = after.children_user + after.children_system - before.children_user - before.children_system
        found.append((spent, time.perf_counter() - begun))
    return min(found)


# -- ratios ------------------------------------------------------------------------------------------------------------
def regression(n: int) -> tuple[float, float, str]:
    """LPV-ARX with its building, over the QR of chunks that are built already."""
    from test_speed import STRUCTURE, bare_qr, build

    record = speed_record(n)
    chunks = build(record)
    return cpu(lambda: STRUCTURE.estimate([record])), cpu(lambda: bare_qr(chunks)), "chunked dgeqrf of prebuilt chunks"


def free_run(n: int) -> tuple[float, float, str]:
    """The free run of a 24-parameter model, over the recursion written out by hand."""
    from test_speed import STRUCTURE, hand_loop

    record = speed_record(n)
    model = STRUCTURE.estimate([record]).model
    a, b = np.ascontiguousarray(model.a[:, 0, 0]), np.ascontiguousarray(model.b[1:, 0, 0])
    centre, half, y = float(model.box.centre[0]), float(model.box.half_width[0]), record["y"].copy()
    return (cpu(lambda: lpv.simulate(model, record)),
            cpu(lambda: hand_loop(a, b, record["u"], record["p"], centre, half, y)), "the loop compiled by hand")


def output_error(n: int) -> tuple[float, float, str]:
    """One Gauss-Newton step: run, 24 sensitivities, QR; over its 24 banded solves."""
    from test_prediction_error_speed import banded, problem_of, system

    problem, point = problem_of(system(min(n, 100_000)))
    band, right = banded(problem, point)

    def step() -> None:
        residuals = problem.residuals(point)
        assert residuals is not None
        problem.factors(point, residuals)

    return cpu(step), cpu(lambda: lapack.dtbtrs(band, right, uplo="L", trans="N", diag="U")), "24 solves by dtbtrs"


def bouc_wen(n: int) -> tuple[float, float, str]:
    """Response of the Bouc-Wen damper, over its bare kernel."""
    import test_damper_speed as speed

    from quartercar.dampers.laws._bouc_wen_kernels import spencer_run
    from quartercar.dampers.laws.stepping import motion_steps

    drive = speed.drive.__wrapped__() if hasattr(speed.drive, "__wrapped__") else speed.drive.__pytest_wrapped__.obj()
    model = speed.BoucWen(scheduled=False, free_exponent=True, values={"yield_force": 900.0})
    theta, _ = model.coefficients(model.vector)
    still, state = np.zeros(speed.SAMPLES), np.array([drive.displacement[0], 0.0, 0.0])
    steps = motion_steps(drive)
    return (cpu(lambda: model.response(drive, model.vector)),
            cpu(lambda: spencer_run(drive.displacement, drive.velocity, still, 1 / 512, steps, theta, state)),
            "the bare kernel")


def series_elements(n: int) -> tuple[float, float, str]:
    """A law in series with a spring, over the same law without."""
    from helpers.effect_signals import guo, road_like  # type: ignore[import-not-found]

    from quartercar.effects import CATALOGUE

    signals, baseline = road_like(0, 15360), guo()
    core = baseline.core(baseline.vector)
    effect = next(e for e in CATALOGUE if str(getattr(e, "name", e)) == "series-compliance")
    run = effect.compose(core, effect.points((signals,))[-1], baseline)
    return cpu(lambda: run(signals)), cpu(lambda: core(signals)), "the law alone"


def inequalities(n: int) -> tuple[float, float, str]:
    """Output feedback for Scherer's plant, verification included, over the time inside the solver."""
    from helpers.synthesis_plants import scherer  # type: ignore[import-not-found]

    from lpvid.lmi.native import Conic

    solve, inside = Conic.solve, [0.0]

    def timed(self: Conic, *args: object) -> object:
        begun = time.process_time()
        answer = solve(self, *args)
        inside[0] += time.process_time() - begun
        return answer

    Conic.solve = timed  # type: ignore[method-assign]
    try:
        found = []
        plant = scherer()
        for _ in range(1 + ROUNDS[0]):
            inside[0], begun = 0.0, time.process_time()
            lpv.synthesize(plant, lpv.OutputFeedback())
            found.append((time.process_time() - begun, inside[0]))
    finally:
        Conic.solve = solve  # type: ignore[method-assign]
    return *min(found[1:]), "the solver"


def critical(n: int) -> tuple[float, float, str]:
    """Critical scheduling values of a fourth-order model, over 200 eigenvalue problems of its size."""
    from test_speed import STRUCTURE

    model = STRUCTURE.estimate([speed_record(20_000)]).model
    companion = np.random.default_rng(0).normal(size=(200, 4, 4))
    return cpu(lambda: lpv.critical_scheduling(model)), cpu(lambda: np.linalg.eigvals(companion)), \
        "200 eigenvalue problems of that size"


def diagnosis(n: int) -> tuple[float, float, str]:
    """The whole catalogue on 30 s at 512 Hz with a hidden coil lag, over one fit of the baseline."""
    from diagnosis_times import hiding

    from quartercar.effects import CATALOGUE
    from quartercar.rig import EXPERIMENTS

    record = hiding("coil-lag").run(replace(EXPERIMENTS["test-1"], duration=30.0), 0)
    import quartercar as qc

    kept, ROUNDS[0] = ROUNDS[0], 1
    try:
        return (cpu(lambda: lpv.diagnose(record, "guo", CATALOGUE)), cpu(lambda: qc.fit(qc.dampers.Guo(), [record])),
                "a fit of the baseline")
    finally:
        ROUNDS[0] = kept


def ride(n: int) -> tuple[float, float, str]:
    """A ride of 10 s with the sky-hook law, over ten seconds: the share of real time."""
    import quartercar as qc
    from quartercar.rides.default_damper import identified_damper
    from quartercar.roads.ride_roads import IsoRoad
    from quartercar.vehicle.nonlinear import Coil

    seconds = 10.0
    car = qc.QuarterCar(qc.parameters.MEGANE, identified_damper(), coil=Coil(highest=2.5))
    road = IsoRoad("C", 20.0, seconds)
    return cpu(lambda: qc.ride(car, road, qc.controllers.SkyhookAccelerationDriven())), seconds, "real time"


def importing(n: int) -> tuple[float, float, str]:
    """`import lpvid` in a process of its own, over a bare interpreter with numpy."""
    ours, _ = process([sys.executable, "-c", "import lpvid"])
    bare, _ = process([sys.executable, "-c", "import numpy"])
    return ours, bare, "import numpy"


def command_line(n: int) -> tuple[float, float, str]:
    """`lpvid --help`, over a bare interpreter with numpy."""
    ours, _ = process([sys.executable, "-m", "lpvid", "--help"])
    bare, _ = process([sys.executable, "-c", "import numpy"])
    return ours, bare, "import numpy"


RATIOS: dict[str, Callable[[int], tuple[float, float, str]]] = {
    "regression": regression, "free run": free_run, "output-error step": output_error, "Bouc-Wen": bouc_wen,
    "series elements": series_elements, "LMI assembly": inequalities, "critical values": critical,
    "diagnosis": diagnosis, "ride": ride, "import": importing, "command line": command_line}


# -- curves ------------------------------------------------------------------------------------------------------------
def speed_record(n: int) -> lpv.Record:
    """A stable fourth-order LPV system, as in test_speed."""
    rng = np.random.default_rng(3)
    p = np.clip(np.cumsum(rng.normal(scale=0.05, size=n)), -1, 1)
    model = lpv.LPVTransferFunction.siso(
        [[-1.8, 0.10, 0.02], [1.3, -0.1, 0.0], [-0.5, 0.05, 0.01], [0.08, 0, 0]],
        [[0, 0, 0], [0.4, 0.1, 0.0], [0.1, -0.3, 0.05], [0.05, 0, 0], [0.02, 0.01, 0]], lpv.Polynomial("p", degree=2),
        1 / 512)
    clean = lpv.Record({"u1": rng.normal(size=n), "p": p}, sample_time=1 / 512)
    y = lpv.simulate(model, clean, "zero").output[:, 0] + 0.01 * rng.normal(size=n)
    return lpv.Record({"u": clean["u1"], "p": p, "y": y}, sample_time=1 / 512)


def by_samples(quick: bool) -> tuple[list[float], list[float]]:
    """Streamed regression, 24 parameters, from pieces of a million samples that are made only once."""
    from test_speed import STRUCTURE

    sizes = [1e4, 1e5, 1e6] if quick else [1e4, 1e5, 1e6, 1e7, 1e8]
    whole = speed_record(int(min(max(sizes), 1e6)))
    box = lpv.Scheduling(("p",), (-1.0,), (1.0,))

    def pieces(n: int) -> list[lpv.Record] | object:
        if n <= whole.n_samples:
            return [whole.slice(0, n)]
        return (replace(whole, time=None, start=k * whole.n_samples / 512) for k in range(n // whole.n_samples))

    return sizes, [cpu(lambda n=int(n): lpv.identify_stream(pieces(n), STRUCTURE, box=box)) for n in sizes]  # type: ignore[arg-type]


def by_parameters(quick: bool) -> tuple[list[float], list[float]]:
    """Regression on 2e4 samples with 8 to 400 parameters."""
    record = speed_record(20_000)
    shapes = [(2, 1), (4, 2), (10, 4)] if quick else [(2, 1), (4, 2), (8, 3), (10, 4), (20, 4), (40, 4)]
    fits = [lpv.ARX(n, n, 1, "u", "y", lpv.Polynomial("p", degree=d), ridge=1e-9) for n, d in shapes]
    return [float(f.n_columns) for f in fits], [cpu(lambda f=f: f.estimate([record])) for f in fits]


def by_grid(quick: bool) -> tuple[list[float], list[float]]:
    """Frozen poles of a model on 1 to 200 scheduling values."""
    from test_speed import STRUCTURE

    model = STRUCTURE.estimate([speed_record(20_000)]).model
    sizes = [10.0, 50.0, 200.0] if quick else [1.0, 10.0, 50.0, 100.0, 200.0]
    return sizes, [cpu(lambda n=int(n): [model.frozen_poles([p]) for p in np.linspace(-1, 1, n)]) for n in sizes]


def by_states(quick: bool) -> tuple[list[float], list[float]]:
    """A certificate of stability (one matrix inequality per vertex) with 2 to 30 states."""
    rng = np.random.default_rng(2)
    found, sizes = [], [2, 6, 12] if quick else [2, 6, 12, 20, 30]
    for n in sizes:
        a = rng.normal(size=(2, n, n))
        a[0] -= (1.0 + np.abs(np.linalg.eigvals(a[0])).max()) * np.eye(n)
        model = lpv.LPVStateSpace(a * [[[1.0]], [[0.05]]], rng.normal(size=(2, n, 1)), rng.normal(size=(2, 1, n)),
                                  np.zeros((2, 1, 1)), lpv.Polynomial("p", degree=1), None,
                                  lpv.Scheduling(("p",), (-1.0,), (1.0,)))
        found.append(cpu(lambda model=model: lpv.l2_gain(model, trajectories=False)))
    return [float(n) for n in sizes], found


def by_catalogue(quick: bool) -> tuple[list[float], list[float]]:
    """A diagnosis with 4 to all of the catalogue's effects."""
    from diagnosis_times import hiding

    from quartercar.effects import CATALOGUE
    from quartercar.rig import EXPERIMENTS

    record = hiding("coil-lag").run(replace(EXPERIMENTS["test-1"], duration=4.0 if quick else 30.0), 0)
    sizes = [4, 16] if quick else [4, 8, 16, len(CATALOGUE)]
    kept, ROUNDS[0] = ROUNDS[0], 1
    try:
        return [float(n) for n in sizes], [cpu(lambda n=n: lpv.diagnose(record, "guo", CATALOGUE[:n])) for n in sizes]
    finally:
        ROUNDS[0] = kept


CURVES: dict[str, tuple[Callable[[bool], tuple[list[float], list[float]]], str]] = {
    "samples": (by_samples, "N: 1"), "parameters": (by_parameters, "k: 1 (building) to 2 (QR)"),
    "grid points": (by_grid, "g: 1"), "states": (by_states, "n: 4 to 6 (interior point, dense)"),
    "catalogue": (by_catalogue, "c: 1")}


def exponent(sizes: list[float], times: list[float]) -> float:
    """Slope of log time over log size, over the upper half of the sizes."""
    upper = len(sizes) // 2 if len(sizes) > 3 else len(sizes) - 2
    return float(np.polyfit(np.log(sizes[upper:]), np.log(times[upper:]), 1)[0])


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="a tenth of the samples, the lower sizes of each curve")
    parser.add_argument("--only", default="")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--samples", type=float, default=None)
    parser.add_argument("--no-curves", action="store_true")
    given = parser.parse_args()
    sys.path.insert(0, os.path.join(os.path.dirname(__file__), os.pardir))  # noqa: PTH118, PTH120
    ROUNDS[0] = given.rounds
    n = int(given.samples or (1e5 if given.quick else 1e6))
    wanted = [w for w in given.only.split(",") if w]
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    print(f"load {load:.1f} on {os.cpu_count()} processors; processor time, least of {given.rounds}", flush=True)
    for name, measure in RATIOS.items():
        if not wanted or name in wanted:
            try:
                ours, limit, what = measure(n)
                print(f"{name:<18} {ours:10.4f} s, {ours / limit:8.2f} times {what} ({limit:.4f} s)", flush=True)
            except Exception as error:  # one line fails, the table goes on
                print(f"{name:<18} failed: {type(error).__name__}: {str(error)[:100]}", flush=True)
    for name, (measure, theory) in CURVES.items():
        if not given.no_curves and (not wanted or name in wanted):
            sizes, times = measure(given.quick)
            points = ", ".join(f"{s:g}: {t:.4f} s" for s, t in zip(sizes, times, strict=True))
            print(f"by {name:<15} exponent {exponent(sizes, times):5.2f} (theory {theory}); {points}", flush=True)


if __name__ == "__main__":
    main()
