"""Other packages beside this one on long records: processor time of the fit and free run on the last third.

    python tests/benchmarks/peers_scale.py [--samples 1e5,1e6] [--only ours,SIPPY] [--limit SECONDS]

Needs ``pip install sysidentpy pysindy jax-sysid sippy_unipi``; what is not installed is listed so. The system is a
fourth-order LPV one (synthetic, output noise of 0.01); each package gets the structure nearest to it. Every fit runs in
a process of its own, after one on 1500 samples that compiles what there is to compile, and is stopped after the limit:
what it had taken by then is a lower bound.

Expected, written down before the run: LPV-ARX at least ten times as fast as each at an equal or better free run.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from side_by_side import Data, bfr, jax_sysid, ours, sippy, sysidentpy
from stream_study import A, B

ORDERS = {"na": 4, "affine": 0, "terms": 24}
RATE = 512.0


def system(path: Path, samples: int) -> None:
    """Input, scheduling and output of the benchmark's system."""
    import lpvid as lpv

    rng = np.random.default_rng(3)
    t = np.arange(samples) / RATE
    u, p, e = rng.normal(size=samples), np.sin(0.7 * t) * np.sin(0.13 * t), 0.01 * rng.normal(size=samples)
    basis = lpv.Polynomial("p", degree=2)
    model = lpv.LPVTransferFunction.siso(A, B, basis, 1 / RATE)
    y = lpv.simulate(model, lpv.Record({"u1": u, "p": p}, sample_time=1 / RATE), "zero").output[:, 0] + e
    np.savez(path, u=u, p=p[:, None], y=y, sample_time=1 / RATE)


def lpv_arx(data: Data, orders: dict) -> tuple[Callable, str]:
    """LPV-ARX of the system's orders, degree 2 in p."""
    import lpvid as lpv

    training, held = data.record(0, data.cut), data.record(data.cut, len(data.y))
    found = lpv.identify(training, lpv.ARX(4, 4, 1, "u", "y", lpv.Polynomial("p1", degree=2)))
    return lambda: lpv.simulate(found.model, held).output[:, 0], f"{found.n_parameters} parameters"


def pysindy(data: Data, orders: dict) -> tuple[Callable, str]:
    """Discrete SINDy on delays of y and u and on p, polynomials of degree 2."""
    import pysindy as ps

    def delays(y: np.ndarray, u: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        n = len(y)
        return (np.column_stack([y[3 - i: n - i] for i in range(4)]),
                np.column_stack([*(u[3 - i: n - i] for i in range(4)), p[3:]]))

    x, driven = delays(data.y[: data.cut], data.u[: data.cut], data.p[: data.cut, 0])
    model = ps.DiscreteSINDy(optimizer=ps.STLSQ(threshold=1e-4), feature_library=ps.PolynomialLibrary(degree=2))
    model.fit(x, u=driven, t=1)

    def free_run() -> np.ndarray:
        held, w = delays(data.y[data.cut:], data.u[data.cut:], data.p[data.cut:, 0])
        run = model.simulate(held[0], len(held), u=w)
        return np.concatenate([data.y[data.cut: data.cut + 3], run[:, 0]])[: len(data.y) - data.cut]

    return free_run, "SINDy, degree 2"


FITS = {"lpvid ARX": (lpv_arx, "lpvid"), "lpvid OutputError": (ours("OutputError"), "lpvid"),
        "SysIdentPy": (sysidentpy, "sysidentpy"), "pysindy": (pysindy, "pysindy"),
        "jax-sysid": (jax_sysid, "jax_sysid"), "SIPPY": (sippy, "sippy_unipi")}


def child(name: str, path: str, warm: str) -> None:
    """Fit once to compile, once for the clock; one line of JSON."""
    fit = FITS[name][0]
    if name != "jax-sysid":
        fit(Data(warm), ORDERS)
    data, begun = Data(path), time.process_time()
    print(json.dumps({"begun": begun}), flush=True)
    run, described = fit(data, ORDERS)
    spent = time.process_time() - begun
    print("\n" + json.dumps({"seconds": spent, "fit": bfr(data.y[data.cut:], run()), "told": described}))


def processor_of_children() -> float:
    """Processor time [s] of the processes that have ended."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--samples", default="1e5,1e6")
    parser.add_argument("--only", default=",".join(FITS))
    parser.add_argument("--limit", type=float, default=1800.0)
    parser.add_argument("--child", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        child(*given.child)
        return
    with tempfile.TemporaryDirectory() as folder:
        warm = Path(folder) / "warm.npz"
        system(warm, 1500)
        for samples in (int(float(s)) for s in given.samples.split(",")):
            path, reference = Path(folder) / "data.npz", None
            system(path, samples)
            for name in given.only.split(","):
                if importlib.util.find_spec(FITS[name][1]) is None:
                    print(f"{samples:>9,} {name:<18} not installed", flush=True)
                    continue
                words = [sys.executable, __file__, "--child", name, str(path), str(warm)]
                before = processor_of_children()
                try:
                    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=given.limit)
                    found = json.loads(done.stdout.strip().splitlines()[-1])
                except subprocess.TimeoutExpired as stop:
                    lines = [x for x in (stop.stdout or b"").decode().splitlines() if x.startswith('{"begun"')]
                    spent = processor_of_children() - before - json.loads(lines[0])["begun"] if lines else 0.0
                    print(f"{samples:>9,} {name:<18} stopped after {given.limit:g} s by the clock, {spent:.1f} s of "
                          f"processor in its fit: more than {spent / (reference or np.inf):.0f} times the first",
                          flush=True)
                    continue
                except subprocess.CalledProcessError as error:
                    print(f"{samples:>9,} {name:<18} failed: {error.stderr.strip().splitlines()[-1][:90]}", flush=True)
                    continue
                reference = reference or found["seconds"]
                print(f"{samples:>9,} {name:<18} {found['seconds']:9.2f} s of processor, "
                      f"{found['seconds'] / reference:8.1f} times the first; free run, last third: fit "
                      f"{found['fit']:.2f} %  ({found['told']})", flush=True)


if __name__ == "__main__":
    main()
