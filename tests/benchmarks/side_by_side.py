"""Accuracy and time beside other packages: same data, same split, same figure, every fit in a process of its own.

Run ``python tests/benchmarks/side_by_side.py --peers /path/to/python`` where that interpreter has what installs of
``pip install sysidentpy jax-sysid sippy_unipi``; what it lacks is reported as not installed. The gyroscope's folder is
given by ``--gyroscope`` (or ``LPVID_DATA``). Prints Markdown tables. Times are CPU seconds of the fit, all threads
counted, so that what else runs on the machine matters little; the first fit includes whatever is compiled for it.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.metadata
import importlib.util
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

HEAD, BEGINNING = 10, 200
"""held-out samples outside the figure (lags reach back to them), and samples that an initial state may be read from."""
ONCE = 60.0
"""seconds of a first fit beyond which it is not timed again."""


def bfr(y: np.ndarray, found: np.ndarray) -> float:
    """100 (1 − ‖y − ŷ‖/‖y − ȳ‖) after the head; −inf where the free run diverges."""
    y, found = y[HEAD:], np.asarray(found, dtype=float)[HEAD:]
    if not np.isfinite(found).all():
        return -np.inf
    with np.errstate(over="ignore"):
        return float(100 * (1 - np.linalg.norm(y - found) / np.linalg.norm(y - y.mean())))


class Data:
    """Input u, scheduling p and output y; the first two thirds train."""

    def __init__(self, path: str) -> None:
        with np.load(path) as held:
            self.u, self.p, self.y, self.sample_time = held["u"], held["p"], held["y"], float(held["sample_time"])
        self.cut = 2 * len(self.y) // 3

    @property
    def plain(self) -> np.ndarray:
        """[u p], the inputs of packages that do not know scheduling."""
        return np.column_stack([self.u, self.p])

    def normalised(self) -> tuple[np.ndarray, np.ndarray, Callable]:
        """[u p] and y scaled by the training part (p to its box), and the way back for y."""
        raw, head, y = self.plain, self.plain[: self.cut], self.y[: self.cut]
        centre = np.r_[head[:, 0].mean(), 0.5 * (head[:, 1:].max(0) + head[:, 1:].min(0))]
        scale = np.r_[head[:, 0].std(), 0.5 * np.ptp(head[:, 1:], axis=0)]
        return (raw - centre) / scale, (self.y - y.mean()) / y.std(), lambda z: y.mean() + y.std() * np.asarray(z)

    def record(self, first: int, last: int):
        from lpvid.record import Record

        scheduling = {f"p{i + 1}": column for i, column in enumerate(self.p[first:last].T)}
        return Record({"u": self.u[first:last], **scheduling, "y": self.y[first:last]}, sample_time=self.sample_time)


# -- ours ------------------------------------------------------------------------------------------------------------
def ours(name: str) -> Callable:
    def fit(data: Data, orders: dict) -> tuple[Callable, str]:
        import lpvid as lpv
        from lpvid.identification.selection import auto

        training, held = data.record(0, data.cut), data.record(data.cut, len(data.y))
        names = tuple(f"p{i + 1}" for i in range(data.p.shape[1]))
        signals = {"input": "u", "output": "y", "basis": lpv.Polynomial(names, degree=1)}
        lags = {**signals, "na": orders["na"], "nb": orders["na"], "nk": 1, "affine": orders["affine"], "lagged": True}
        states = {**signals, "order": orders["na"], "affine": bool(orders["affine"])}
        if name == "auto":
            chosen = auto(training, "u", "y", names)
            found, described = chosen.identification, chosen.best.summary
        else:
            kind = getattr(lpv, name)
            found = lpv.identify(training, kind(**(states if name in ("Subspace", "StateSpaceError") else lags)))
            described = f"{found.n_parameters} parameters"
        start = "estimate" if isinstance(found.model, lpv.LPVStateSpace) else "measured"
        return lambda: lpv.simulate(found.model, held, start).output[:, 0], described

    return fit


# -- peers -----------------------------------------------------------------------------------------------------------
def sysidentpy(data: Data, orders: dict) -> tuple[Callable, str]:
    """Polynomial NARX by FROLS, degree 2, all lags up to 3, which holds every product p·y and p·u of the LPV model."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    x, y = data.plain, data.y[:, None]
    model = FROLS(ylag=3, xlag=[[1, 2, 3]] * x.shape[1], order_selection=False, n_terms=orders["terms"],
                  estimator=LeastSquares(), basis_function=Polynomial(degree=2), model_type="NARMAX")
    model.fit(X=x[: data.cut], y=y[: data.cut])
    return lambda: model.predict(X=x[data.cut:], y=y[data.cut:])[:, 0], f"{orders['terms']} terms"


def jax_sysid(data: Data, orders: dict) -> tuple[Callable, str]:
    """LPV state space affine in p, started from its LTI fit, Adam then L-BFGS; best of three seeds on training data."""
    from jax_sysid.models import qLPVModel

    x, y, back = data.normalised()
    n_p = data.p.shape[1]
    best: tuple = (-np.inf, None)
    for seed in range(3):
        model = qLPVModel(orders["na"], 1, 1 + n_p, n_p, lambda state, u, params: u[1:], [], seed=seed)
        model.loss(rho_x0=1e-4, rho_th=1e-4)
        model.optimization(adam_eta=0.001, adam_epochs=1000, lbfgs_epochs=1000, iprint=-1)
        model.fit(y[: data.cut, None], x[: data.cut])
        score = bfr(y[: data.cut], model.predict(model.x0, x[: data.cut])[0][:, 0])
        if np.isfinite(score) and score > best[0]:
            best = score, model

    def free_run() -> np.ndarray:
        held, measured = x[data.cut:], y[data.cut:, None]
        start = best[1].learn_x0(held[:BEGINNING], measured[:BEGINNING], verbosity=False)
        return back(best[1].predict(start, held)[0][:, 0])

    return free_run, "best of 3 seeds"


def sippy(data: Data, orders: dict) -> tuple[Callable, str]:
    """LTI ARX with the scheduling variables as further inputs."""
    from sippy_unipi import system_identification

    x, y, back = data.normalised()
    n, width = orders["na"], x.shape[1]
    found = system_identification(y[None, : data.cut], x[: data.cut].T, "ARX",
                                  ARX_orders=[[n], [[n] * width], [[0] * width]])
    a, b = np.asarray(found.DENOMINATOR[0][0])[1: n + 1], np.array([row[:n] for row in found.NUMERATOR[0]])

    def free_run() -> np.ndarray:
        held, out = x[data.cut:], y[data.cut:].copy()
        for k in range(n, len(out)):
            out[k] = np.sum(b * held[k - n: k][::-1].T) - a @ out[k - n: k][::-1]
        return back(out)

    return free_run, f"LTI, {a.size + b.size} parameters"


OURS = {name: ours(name) for name in ("ARX", "RefinedIV", "OutputError", "Subspace", "StateSpaceError", "auto")}
PEERS = {"SysIdentPy": (sysidentpy, "sysidentpy", "FROLS, polynomial NARX of degree 2, lags to 3"),
         "jax-sysid": (jax_sysid, "jax_sysid", "qLPV state space affine in p"),
         "SIPPY": (sippy, "sippy_unipi", "ARX, p as further inputs")}


def work(name: str, path: str, orders: dict) -> dict:
    """Fit in this process; figures as a dictionary."""
    if name in PEERS and importlib.util.find_spec(PEERS[name][1]) is None:
        return {"missing": True}
    fit, data = OURS[name] if name in OURS else PEERS[name][0], Data(path)
    with contextlib.redirect_stdout(sys.stderr):
        importlib.import_module(PEERS[name][1] if name in PEERS else "lpvid.identification.selection")
        start = time.process_time()
        free_run, described = fit(data, orders)
        first = time.process_time() - start
        score, again = bfr(data.y[data.cut:], free_run()), None
        if first < ONCE:
            start = time.process_time()
            fit(data, orders)
            again = time.process_time() - start
    versions = {PEERS[name][1]: importlib.metadata.version(PEERS[name][1])} if name in PEERS else {}
    return {"fit": score, "first": first, "again": again, "told": described, "versions": versions}


# -- data ------------------------------------------------------------------------------------------------------------
def gyroscope(folder: Path) -> dict:
    raw = np.genfromtxt(folder / "estimation.csv", delimiter=",", skip_header=1)
    return {"u": raw[:, 1], "p": raw[:, 2:5], "y": raw[:, 5], "sample_time": 0.01}


def ceiling(data: dict) -> float:
    """The fit [%] that the output noise leaves on the held-out third, the noise estimated on the training part."""
    from lpvid.identification.arx import ARX
    from lpvid.identification.selection import noise_ceiling
    from lpvid.scheduling import Polynomial

    with tempfile.TemporaryDirectory() as folder:
        np.savez(Path(folder) / "data.npz", **data)
        held = Data(str(Path(folder) / "data.npz"))
    names = tuple(f"p{i + 1}" for i in range(data["p"].shape[1]))
    structure = ARX(4, 4, 1, "u", "y", Polynomial(names, degree=1), affine=5, lagged=True)
    return noise_ceiling(held.record(0, held.cut), structure).on(held.record(held.cut, len(held.y)))


def synthetic(n: int = 9000) -> tuple[dict, float]:
    """Third order, coefficients of lag i affine in p(k−i): within the reach of every LPV and NARX model here.

    White output noise at 20 dB. Also returns the true model's free-run fit on the held-out third.
    """
    rng = np.random.default_rng(11)
    u, p = rng.normal(size=n), np.sin(np.cumsum(rng.uniform(0, 0.2, n)))
    a = np.array([[-1.9, 0.15], [1.35, -0.2], [-0.35, 0.05]])
    b = np.array([[1.0, 0.5], [0.4, -0.4], [0.1, 0.2]])
    x, phi = np.zeros(n), np.column_stack([np.ones(n), p])
    for k in range(3, n):
        for i in range(3):
            x[k] += (b[i] @ phi[k - 1 - i]) * u[k - 1 - i] - (a[i] @ phi[k - 1 - i]) * x[k - 1 - i]
    y = x + 0.1 * x.std() * rng.normal(size=n)
    cut = 2 * n // 3
    return {"u": u, "p": p[:, None], "y": y, "sample_time": 0.01}, bfr(y[cut:], x[cut:])


def table(title: str, data: dict, orders: dict, peers: str, limit: tuple[str, float]) -> None:
    print(f"\n**{title}**\n\n| method | | free-run fit on held-out third, % | first fit, CPU s | again, CPU s |")
    print(f"|---|---|---|---|---|\n| {limit[0]} | | {limit[1]:.2f} | | |")
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    versions: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "data.npz")
        np.savez(path, **data)
        for name in (*OURS, *PEERS):
            python = peers if name in PEERS else sys.executable
            done = subprocess.run([python, __file__, "--work", name, "--data", path, "--orders", json.dumps(orders)],
                                  capture_output=True, text=True, env=environment, check=False)
            label, about = (f"lpvid {name}", "") if name in OURS else (name, PEERS[name][2])
            if done.returncode:
                lines = done.stderr.strip().splitlines()
                print(f"| {label} | failed: {lines[-1] if lines else 'no message'} | | | |")
                continue
            found = json.loads(done.stdout.strip().splitlines()[-1])
            if found.get("missing"):
                print(f"| {label} | not installed | | | |")
                continue
            versions |= found["versions"]
            again = "" if found["again"] is None else f"{found['again']:.2f}"
            described = f"{about}, {found['told']}" if about else found["told"]
            print(f"| {label} | {described} | {found['fit']:.2f} | {found['first']:.2f} | {again} |", flush=True)
    print("\nVersions: " + ", ".join(f"{k} {v}" for k, v in versions.items()) + f"; Python {platform.python_version()}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peers", default=sys.executable, help="Python interpreter that has the other packages")
    parser.add_argument("--gyroscope", default=None, help="folder with the gyroscope's estimation.csv")
    parser.add_argument("--work", help=argparse.SUPPRESS)
    parser.add_argument("--data", help=argparse.SUPPRESS)
    parser.add_argument("--orders", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.work:
        print(json.dumps(work(asked.work, asked.data, json.loads(asked.orders))))
        return
    given = asked.gyroscope or (os.environ.get("LPVID_DATA") and Path(os.environ["LPVID_DATA"]) / "gyroscope")
    if given and (Path(given) / "estimation.csv").is_file():
        data = gyroscope(Path(given))
        table("gyroscope", data, {"na": 4, "affine": 5, "terms": 25}, asked.peers,
              ("ceiling, estimated", ceiling(data)))
    else:
        print("gyroscope: its data are not here (give --gyroscope)")
    data, limit = synthetic()
    table("synthetic LPV-OE, white output noise", data, {"na": 3, "affine": 0, "terms": 12}, asked.peers,
          ("the true model", limit))


if __name__ == "__main__":
    main()
