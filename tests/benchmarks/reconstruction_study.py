"""What the inverse of N = Y − X⁻¹ costs a controller, against the descriptor form that never inverts it.

    python tests/benchmarks/reconstruction_study.py [--first 1000] [--plants 20] [--limit 60]

For the controller of least verified gain that a synthesis wrote down (published plants, then random ones in bad units),
at every design point: the condition of N; the controller with N inverted (as it is built), the descriptor form
N ẋ_K = A_E x_K + B_E y from the same X, Y, and the same formula in 40 decimal digits, N inverted there. Printed are the
largest relative error of either form's frequency response against that of 40 digits, and the largest frozen gain of the
loop with each, beside the gain that was verified. The descriptor form is evaluated by C (jωN − A_E)⁻¹ B_E.
"""

from __future__ import annotations

import argparse
import decimal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest import mock

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers.badly_scaled_plants import random_case
from helpers.published_plants import near_integrators, quarter_car, two_disks
from helpers.synthesis_plants import missile, sb10fd, scherer, wu
from random_plants import OutOfTimeError, limited

import lpvid as lpv
from lpvid.synthesis import output_feedback_search
from lpvid.synthesis.controller_formula import ControllerFormula, FeedbackLaw
from lpvid.synthesis.generalized_plant import PlantMatrices
from lpvid.synthesis.output_feedback_search import FeedbackProblem
from lpvid.synthesis.reconstruction import LyapunovPair, closed_through, controller_at, dual, feedthrough

DIGITS = 40
FREQUENCIES = 600
FIELDS = ("A", "B1", "B2", "C1", "D11", "D12", "C2", "D21", "D22")
Form = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""(E, A, B, C, D) of E ẋ = A x + B y, u = C x + D y"""
Solver = Callable[[np.ndarray, np.ndarray], np.ndarray]


def solved(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a⁻¹ b by elimination with pivots, in the arithmetic of the entries."""
    a, b, n = a.copy(), b.copy(), len(a)
    for k in range(n):
        best = max(range(k, n), key=lambda i: abs(a[i, k]))
        a[[k, best]], b[[k, best]] = a[[best, k]], b[[best, k]]
        for i in range(k + 1, n):
            share = a[i, k] / a[k, k]
            a[i], b[i] = a[i] - share * a[k], b[i] - share * b[k]
    for k in range(n - 1, -1, -1):
        b[k] = (b[k] - a[k, k + 1:] @ b[k + 1:]) / a[k, k]
    return b


def exact(m: np.ndarray) -> np.ndarray:
    """The same numbers with `DIGITS` digits."""
    return np.array([decimal.Decimal(float(v)) for v in np.ravel(m)], dtype=object).reshape(np.shape(m))


def best(d21: np.ndarray, d: np.ndarray, gamma: object, noise: np.ndarray, right: list, solve: Solver) -> np.ndarray:
    """As `reconstruction._best` at one point."""
    beside = np.concatenate([d21, np.full((len(d21), len(d)), 0 * gamma)], axis=1)
    left = np.block([[noise / gamma, beside], [beside.T, -supply(d, gamma)]])
    return solve(left, -np.concatenate(right))[: len(d21)]


def supply(d: np.ndarray, gamma: object) -> np.ndarray:
    """[γI −Dᵀ; −D γI]."""
    w, z = (np.array([[gamma if i == j else 0 * gamma for j in range(m)] for i in range(m)]) for m in d.shape[::-1])
    return np.block([[w, -d.T], [-d, z]])


def descriptor(p: dict[str, np.ndarray], v: tuple[np.ndarray, np.ndarray], gamma: object, efforts: tuple, d: np.ndarray,
               solve: Solver) -> Form:
    """`reconstruction.controller_at` at one point, from the left times N; D_K is closed in p."""
    x, y = v
    q = solve(x, np.array([[1 * gamma / gamma if i == j else 0 * gamma for j in range(len(x))] for i in range(len(x))]))
    q = (q + q.T) / 2
    t, n = p["B1"].T @ q, y - q
    f = best(p["D12"].T, p["D11"].T, gamma, efforts[0], [p["B2"].T @ q, p["C1"], t], solve)
    hat = best(p["D21"], p["D11"], gamma, efforts[1], [p["C2"], p["B1"].T @ y, p["C1"]], solve).T
    into = np.concatenate([t, p["C1"] + p["D12"] @ f])
    worst = solve(supply(p["D11"], gamma), into)
    flow = q @ (p["A"] + p["B2"] @ f)
    slack = -(flow + flow.T + into.T @ worst)
    w = worst[: len(t)]
    a = (n @ (p["A"] + p["B2"] @ f + p["B1"] @ w) + hat @ (p["C2"] + p["D21"] @ w)
         - (slack - f.T @ efforts[0] @ f / gamma))
    return n, a, hat, -f, d


def forms(formula: ControllerFormula, points: np.ndarray, k: int) -> tuple[PlantMatrices, dict[str, Form]]:
    """The balanced plant at one point and the controller in its three forms there: inverted, descriptor, digits."""
    plant, v = formula._plant(points), formula._lyapunov(points)
    d = feedthrough(plant, formula.gamma)
    at, efforts = closed_through(plant, d), formula.efforts
    pair, turned = (v.x[k], v.y[k]), not v.by_measurements
    if turned:  # the dual plant's controller, transposed
        at, pair, efforts, d = dual(at), pair[::-1], efforts[::-1], d.swapaxes(1, 2)
    one = {f: getattr(at, f)[k] for f in FIELDS}
    double = descriptor(one, pair, formula.gamma, efforts, d[k], np.linalg.solve)
    many = descriptor({f: exact(m) for f, m in one.items()}, (exact(pair[0]), exact(pair[1])),
                      decimal.Decimal(formula.gamma), tuple(exact(e) for e in efforts), exact(d[k]), solved)
    n, a, b, c, dk = many
    eye = np.eye(len(pair[0]))
    digits = tuple(m.astype(float) for m in (solved(n, a), solved(n, b), c, dk))
    here, own = slice(k, k + 1), PlantMatrices(*(getattr(plant, f)[k:k + 1] for f in FIELDS))
    alone = LyapunovPair(v.x[here], v.y[here], v.x_slope[here], v.y_slope[here], v.by_measurements)
    built = [m[0] for m in controller_at(own, alone, formula.gamma, formula.efforts, feedthrough(own, formula.gamma))]
    back = (lambda e, a, b, c, d: (e.T, a.T, c.T, b.T, d.T)) if turned else (lambda *m: m)
    return PlantMatrices(*(getattr(plant, f)[k] for f in FIELDS)), {
        "inverted": (eye, *built), "descriptor": back(*double), "digits": back(eye, *digits)}


def response(form: Form, s: np.ndarray) -> np.ndarray:
    """(W, n_u, n_y) at complex frequencies."""
    e, a, b, c, d = form
    return c @ np.linalg.solve(s[:, None, None] * e - a, np.broadcast_to(b, (len(s), *b.shape)).astype(complex)) + d


def gain(p: PlantMatrices, form: Form, s: np.ndarray) -> float:
    """Largest gain of the loop of the plant with a controller, over frequencies: by the pencil of both, E not inverted.
    """
    e, a, b, c, d = form
    q = closed_through(PlantMatrices(*(getattr(p, f)[None] for f in FIELDS)), d[None]).point(0)
    n, k = len(q.A), len(a)
    left = np.block([[q.A, q.B2 @ c], [b @ q.C2, a]])
    mass, into = np.block([[np.eye(n), np.zeros((n, k))], [np.zeros((k, n)), e]]), np.vstack([q.B1, b @ q.D21])
    pencil = (mass, left, into, np.hstack([q.C1, q.D12 @ c]), q.D11)
    return float(np.linalg.norm(response(pencil, s), 2, axis=(1, 2)).max())


def examined(plant: lpv.GeneralizedPlant, design: lpv.OutputFeedback, limit: float) -> str:
    """A line of the table."""
    kept: list[tuple] = []
    write = output_feedback_search._written

    def noted(problem: FeedbackProblem, formula: FeedbackLaw, target: float | None = None) -> lpv.Synthesis | None:
        found = write(problem, formula, target)
        if found is not None and isinstance(formula, ControllerFormula):
            kept.append((problem, formula, found))
        return found

    try:
        with limited(limit), mock.patch.object(output_feedback_search, "_written", noted):
            found = lpv.synthesize(plant, design)
    except OutOfTimeError:
        return "out of time"
    if not kept:
        return found.verdict
    problem, formula, own = min(kept, key=lambda k: k[2].gamma_verified or np.inf)
    worst = {"condition": 0.0, "coupled": 0.0, "inverted": 0.0, "descriptor": 0.0}
    gains: dict[str, float] = dict.fromkeys(("inverted", "descriptor", "digits"), 0.0)
    for k in range(len(problem.points)):
        at, three = forms(formula, problem.points, k)
        poles = np.abs(np.concatenate([np.linalg.eigvals(three["digits"][1]), np.linalg.eigvals(at.A)]))
        s = 1j * np.geomspace(max(poles.min() / 10, 1e-12 * poles.max()), 10 * poles.max(), FREQUENCIES)
        answers = {name: response(form, s) for name, form in three.items()}
        size = np.linalg.norm(answers["digits"], axis=(1, 2))
        for name in ("inverted", "descriptor"):
            off = np.linalg.norm(answers[name] - answers["digits"], axis=(1, 2)) / size
            worst[name] = max(worst[name], float(off.max()))
        for name, form in three.items():
            gains[name] = max(gains[name], gain(at, form, s))
        worst["condition"] = max(worst["condition"], float(np.linalg.cond(three["descriptor"][0])))
        worst["coupled"] = max(worst["coupled"], float(np.linalg.norm(three["inverted"][1], 2)))
    change = {name: gains[name] / gains["digits"] - 1 for name in ("inverted", "descriptor")}
    return (f"cond N {worst['condition']:9.2e}  |A_K| {worst['coupled']:9.2e}  error {worst['inverted']:9.1e} "
            f"{worst['descriptor']:9.1e}  gain {change['inverted']:+9.1e} {change['descriptor']:+9.1e} of "
            f"{gains['digits']:.5g}, verified {own.gamma_verified:.5g}")


def cases(first: int, plants: int) -> Iterator[tuple[str, lpv.GeneralizedPlant, lpv.OutputFeedback]]:
    """Published plants, then random ones."""
    still = lpv.OutputFeedback()
    for name, plant in (("two disks", two_disks()), ("poles at 2e-7, 1e-5", near_integrators()),
                        ("the same, noise 1e-3", near_integrators(1e-3)),
                        ("the same, noise 1e-1", near_integrators(0.1)),
                        ("quarter car, m N", quarter_car()), ("quarter car, mm kN", quarter_car(1e-3, 1e3)),
                        ("autopilot", missile()), ("Scherer 1997", scherer()), ("SB10FD", sb10fd())):
        yield name, plant, still
    yield "Wu, both move", wu(5.0), lpv.OutputFeedback(lpv.Fourier("rho", 1), varying="both")
    for seed in range(first, first + plants):
        plant, design, _ = random_case(seed)
        yield f"random {seed}", plant, design


def main() -> None:
    """Print the table, a line per plant."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--plants", type=int, default=20)
    parser.add_argument("--limit", type=float, default=60.0)
    options = parser.parse_args()
    decimal.getcontext().prec = DIGITS
    print("condition of N, size of A_K; of inverted and descriptor form: error of the response, change of the gain")
    for name, plant, design in cases(options.first, options.plants):
        started = time.process_time()
        print(f"{name:<22}{examined(plant, design, options.limit)}  {time.process_time() - started:.0f} s", flush=True)


if __name__ == "__main__":
    main()
