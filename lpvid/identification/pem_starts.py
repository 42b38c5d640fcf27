"""Where prediction-error searches begin: least squares under several filters, iterated, shrunk, perturbed."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from lpvid.identification.pem_problem import PredictionErrorProblem
from lpvid.identification.pem_sweep import CHUNK
from lpvid.model.noise_model import NoiseModel
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record

PREFILTERS = (0.5, 0.8, 0.95)
"""double poles of the low-pass filters under which least squares is repeated."""
ITERATIONS = 8
"""rounds of Steiglitz & McBride, and of extended least squares."""
KNEE_ITERATIONS = 5
"""rounds of Steiglitz & McBride at each knee of a stage: from three a search ends at a training fit of 89.9 %, from
five at 94.3 % (seventh order of a measured circuit), and eight do no better."""
SHRINKING = (1.0, 0.98, 0.95, 0.9, 0.8, 0.6, 0.3, 0.0)
LONG_AR = 30
Start = tuple[str, LPVTransferFunction]


def output_starts(problem: PredictionErrorProblem, first: LPVTransferFunction) -> list[Start]:
    """Starts of an output-error search.

    Least squares itself; least squares of equations filtered by 1/(1 − ρ q⁻¹)², which lets low frequencies count more;
    and Steiglitz & McBride 1965, least squares of equations filtered by one over the mean of the last A, which for a
    time-invariant system weighs its errors as output errors.

    Parameters
    ----------
    problem : PredictionErrorProblem
        Of output error.
    first : LPVTransferFunction
        The least-squares model.

    Returns
    -------
    list of (label, model)
        Each drawn in to a bounded free run; those that this changed follow as found.
    """
    found: list[Start] = [("least squares", first)]
    roots = [("least squares", first)]
    for rho in PREFILTERS:
        roots.append((f"least squares under a low-pass at {rho:g}",
                      _filtered_regression(problem, first, np.poly([rho, rho]))))
    found += roots[1:]
    for label, model in (roots[0], roots[2]):
        for round_ in range(ITERATIONS):
            model = _filtered_regression(problem, model, _mean_denominator(problem, model))
            found.append((f"{label}, then Steiglitz-McBride {round_ + 1}", model))
    drawn = [(label, stabilised(problem, model)) for label, model in found]
    return [*drawn, *(pair for pair, other in zip(found, drawn, strict=True) if pair[1] is not other[1])]


def knee_starts(records: Sequence[Record], problem: PredictionErrorProblem, first: LPVTransferFunction) -> list[Start]:
    """Starts of an output-error search at each knee from which a stage's own search begins, where a knee is all it has.

    The free-run error has several minima over the knee, and a descent ends in the one in which it begins. Least squares
    fits the knee to its own coefficients, which the noise biases: on a measured positioning system it began at 0.05 m/s
    and ended at a training fit of 92.2 % (na=2, nb=3), from the knees here at 95.9 % and 0.1 mm/s. A stage that has
    slopes too can follow noise with them: with its starts the best figure of the search over the folds of a measured
    race damper fell from 99.1 to 98.7 %.

    Parameters
    ----------
    records : sequence of Record
        Those of the problem.
    problem : PredictionErrorProblem
        Of output error.
    first : LPVTransferFunction
        The least-squares model, with the stage that it has fitted.

    Returns
    -------
    list of (label, model)
        Least squares at each knee, then `KNEE_ITERATIONS` rounds of Steiglitz & McBride, all drawn in to a bounded free
        run. Empty where the stage is given or has other free parameters.
    """
    stage = first.input_stage
    if stage is None or not problem.free_stages[0] or np.count_nonzero(stage.scales(0.0)) > 1:
        return []
    u = np.vstack([r.matrix([s.name for s in first.inputs]) for r in records])
    p = np.vstack([r.matrix(first.box.names) for r in records])
    found: list[Start] = []
    for begin in stage.starts(u, p):
        label = f"least squares at a knee of {begin.first_knee:.3g}"
        model = _filtered_regression(problem, first.replace(input_stage=begin), np.ones(1))
        found.append((label, model))
        for round_ in range(KNEE_ITERATIONS):
            model = _filtered_regression(problem, model, _mean_denominator(problem, model))
            found.append((f"{label}, then Steiglitz-McBride {round_ + 1}", model))
    return [(label, stabilised(problem, model)) for label, model in found]


def equation_start(records: Sequence[Record], problem: PredictionErrorProblem, first: LPVTransferFunction,
                   iterations: int) -> list[Start]:
    """A and B of an ARMAX model whose C is as rich as A, as found and drawn in.

    With C = A that is the output-error model, but its prediction error stays bounded where free runs diverge: start for
    systems whose frozen poles leave the circle for a while.

    Parameters
    ----------
    records : sequence of Record
        Those of the problem.
    problem : PredictionErrorProblem
        Whose structure, layout, weights and free stages are taken over.
    first : LPVTransferFunction
        The least-squares model.
    iterations : int
        Of each ARMAX search at most.

    Returns
    -------
    list of (label, model)
        Empty where every ARMAX search diverges.
    """
    from lpvid.identification.levenberg_marquardt import minimise

    noise = NoiseModel("armax", np.zeros((first.na, first.n_outputs, first.basis.size)))
    plain = PredictionErrorProblem(
        records, problem.structure, problem.model, problem.layout, noise, problem.free_stages
    )
    plain.weights = problem.weights
    k = sum(plain.sizes)
    found = []
    for _, model in armax_starts(plain, first):
        search = minimise(plain, plain.point(model), max_iterations=iterations, tolerance=1e-4,
                          bounds=(np.full(k, -np.inf), np.full(k, np.inf)))
        if search is not None:
            found.append((search.cost, plain.model_at(search.trial.point.shared)))
    if not found:
        return []
    best = min(found, key=lambda row: row[0])[1].replace(noise=problem.noise)
    return [("ARMAX", best), ("ARMAX, poles drawn in", stabilised(problem, best))]


def perturbed(model: LPVTransferFunction, layout, covariance: np.ndarray, rng: np.random.Generator,
              count: int) -> list[Start]:
    """`count` models drawn from three times the standard errors around least squares.

    Parameters
    ----------
    model : LPVTransferFunction
        Least squares.
    layout : ParameterLayout
        Of its k parameters.
    covariance : (k, k) array
        Of least squares.
    rng : numpy.random.Generator
    count : int
        Number of models.

    Returns
    -------
    list of (label, model)
    """
    theta = layout.read(model)
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    root = 3.0 * vectors * np.sqrt(np.maximum(values, 0.0))
    return [(f"random start {i + 1}", layout.fill(model, theta + root @ rng.standard_normal(theta.size)))
            for i in range(count)]


def stabilised(problem: PredictionErrorProblem, model: LPVTransferFunction) -> LPVTransferFunction:
    """The model with its poles drawn in, a_i ← γ^i a_i, as little as keeps its free run bounded and frozen-stable.

    Parameters
    ----------
    problem : PredictionErrorProblem
        On whose data the free run must be bounded.
    model : LPVTransferFunction
        Any.

    Returns
    -------
    LPVTransferFunction
        `model` itself where nothing needs to be drawn in; all a_i zero where no factor of `SHRINKING` suffices.
    """
    from lpvid.identification.levenberg_marquardt import frozen_inside

    for gamma in SHRINKING:
        power = gamma ** np.arange(1, model.na + 1)
        trial = model.replace(a=model.a * power[:, None, None, None])
        point = problem.point(trial)
        if frozen_inside(problem, point, 1.0) and problem.residuals(point) is not None:
            return model if gamma == 1 else trial
    return model.replace(a=0.0 * model.a)


def _mean_denominator(problem: PredictionErrorProblem, model: LPVTransferFunction) -> np.ndarray:
    """Stable polynomial 1 + f_1 q⁻¹ + … of A at the mean of the basis along the data; roots outside are reflected."""
    mean = np.mean([phi.mean(axis=1) for _, phi in problem.drive(model)], axis=0)
    a = model.a @ mean
    if not len(a):
        return np.ones(1)
    ny = model.n_outputs
    companion = np.zeros((len(a) * ny, len(a) * ny))
    companion[:, :ny] = -a.reshape(-1, ny)
    companion[: (len(a) - 1) * ny, ny:] = np.eye((len(a) - 1) * ny)
    return stable_polynomial(np.linalg.eigvals(companion))


def stable_polynomial(roots: np.ndarray, limit: float = 0.99) -> np.ndarray:
    """Polynomial with these roots, those outside the circle reflected into it.

    Parameters
    ----------
    roots : (m,) array
        Complex, in conjugate pairs.
    limit : float
        Largest modulus that a root keeps.

    Returns
    -------
    (m + 1,) array
        Coefficients, the leading 1 first.
    """
    size = np.abs(roots)
    size = np.where(size > 1, 1 / np.maximum(size, 1e-300), size)
    angle = np.angle(roots)
    return np.real(np.poly(np.minimum(size, limit) * np.exp(1j * angle)))


def _filtered_regression(
    problem: PredictionErrorProblem, model: LPVTransferFunction, denominator: np.ndarray
) -> LPVTransferFunction:
    """Least squares of the equation A y = B u + e with both sides filtered by one over `denominator`."""
    from lpvid import _sensitivity
    from lpvid._kernels import ChunkedQR, fill_regressor

    c, lags = problem.columns, denominator.size - 1
    history, everything = max(lags, 4), np.arange(problem.columns.size + problem.n_outputs)
    qr = ChunkedQR(everything.size, CHUNK)
    for y, (u, phi) in zip(problem._y, problem.drive(model), strict=True):
        signals = np.vstack([y.T, u, np.ones(len(y))])
        z = np.zeros((everything.size, history + CHUNK))
        for first in range(problem.start, len(y), CHUNK):
            rows = min(CHUNK, len(y) - first)
            fill_regressor(z[: c.size], history, first, rows, signals, phi, c.source, c.sign, c.lag, c.function,
                           c.phi_lag)
            z[c.size:, history: history + rows] = y[first: first + rows].T
            if lags:
                _sensitivity.recur(np.repeat(denominator[1:, None], rows, axis=1), z, history, rows)
            _sensitivity.copy_columns(qr.block, z, history, rows, everything, 1.0)
            qr.absorb(rows)
            z[:, :history] = z[:, rows: rows + history].copy()
    r = qr.r
    return problem.layout.fill(model, _solve(r[:, : c.size], r[:, c.size:]).T.ravel())


def _solve(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    scale = np.maximum(np.linalg.norm(x, axis=0), 1e-300)
    return np.linalg.lstsq(x / scale, y, rcond=1e-12)[0] / (scale[:, None] if y.ndim == 2 else scale)


# -- noise models ------------------------------------------------------------------------------------------------------
def armax_starts(problem: PredictionErrorProblem, first: LPVTransferFunction) -> list[Start]:
    """Least squares, and extended least squares: past innovations as regressors, recomputed each round.

    Parameters
    ----------
    problem : PredictionErrorProblem
        Of an ARMAX model.
    first : LPVTransferFunction
        The least-squares model.

    Returns
    -------
    list of (label, model)
        Up to `ITERATIONS` rounds, fewer where a run diverges.
    """
    model = first.replace(noise=problem.noise)
    found: list[Start] = [("least squares", model)]
    for round_ in range(ITERATIONS):
        residuals = problem.residuals(problem.point(model))
        if residuals is None:
            break
        model = _invertible(problem, _extended_regression(problem, model, residuals.errors))
        found.append((f"extended least squares {round_ + 1}", model))
    return found


def _extended_regression(problem: PredictionErrorProblem, model: LPVTransferFunction, errors: Sequence[np.ndarray]
                         ) -> LPVTransferFunction:
    from lpvid._kernels import ChunkedQR

    assert problem.noise.c is not None
    nc, ny, functions = problem.noise.c.shape
    size, more = problem.columns.size, nc * functions
    factors = [ChunkedQR(size + more + 1, CHUNK) for _ in range(ny)]
    for y, e, (u, phi) in zip(problem._y, errors, problem.drive(model), strict=True):
        signals = np.vstack([y.T, u, np.ones(len(y))])
        for first in range(max(problem.start, nc), len(y), CHUNK):
            rows = min(CHUNK, len(y) - first)
            shared = problem._regressor(signals, phi, first, rows)
            for o, qr in enumerate(factors):
                block = qr.block[:, :rows]
                block[:size], block[-1] = shared, y[first: first + rows, o]
                for i in range(nc):
                    low = first - (i + 1 if model.lagged else 0)
                    weight = phi[:, low: low + rows] if functions > 1 else np.ones((1, rows))
                    past = e[first - i - 1: first - i - 1 + rows, o]
                    block[size + i * functions: size + (i + 1) * functions] = past * weight
                qr.absorb(rows)
    solved = [_solve(qr.r[:, :-1], qr.r[:, -1]) for qr in factors]
    noise = problem.noise.with_vector(np.concatenate([s[size:] for s in solved]))
    return problem.layout.fill(model, np.concatenate([s[:size] for s in solved])).replace(noise=noise)


def _invertible(problem: PredictionErrorProblem, model: LPVTransferFunction) -> LPVTransferFunction:
    """C with its roots drawn in until its frozen roots lie inside the circle and the innovations stay bounded."""
    from lpvid.identification.levenberg_marquardt import frozen_inside

    assert model.noise.c is not None
    for gamma in SHRINKING:
        power = gamma ** np.arange(1, model.noise.nc + 1)
        trial = model.replace(noise=NoiseModel(model.noise.kind, model.noise.c * power[:, None, None]))
        point = problem.point(trial)
        if frozen_inside(problem, point, 1.0) and problem.residuals(point) is not None:
            return trial
    return model.replace(noise=problem.noise)


def box_jenkins_starts(
    problem: PredictionErrorProblem, plant: LPVTransferFunction, output_errors: Callable
) -> list[Start]:
    """Noise models behind a plant: none, and an ARMA process fitted to its output error (Hannan & Rissanen 1982).

    Parameters
    ----------
    problem : PredictionErrorProblem
        Of a Box-Jenkins model.
    plant : LPVTransferFunction
        Output-error model.
    output_errors : callable
        ``output_errors(plant)`` gives (n, n_outputs) errors per record, or None where the free run diverges.

    Returns
    -------
    list of (label, model)
        The second only where there are errors and orders to fit.
    """
    noise = problem.noise
    white = plant.replace(noise=noise)
    found: list[Start] = [("output error, white noise", white)]
    errors = output_errors(plant)
    if errors is not None and noise.nc + noise.nd:
        pairs = [arma([e[problem.start:, o] for e in errors], noise.nc, noise.nd) for o in range(problem.n_outputs)]
        c, d = np.array([p[0] for p in pairs]).T, np.array([p[1] for p in pairs]).T
        coloured = NoiseModel("box-jenkins", c[:, :, None] if noise.nc else None, d if noise.nd else None)
        found.append(("output error, then ARMA noise", plant.replace(noise=coloured)))
    return found


def arma(series: Sequence[np.ndarray], nc: int, nd: int) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients c (nc,), d (nd,) of D v = C e by a long autoregression and one regression on its innovations.

    Parameters
    ----------
    series : sequence of (n,) arrays
        v of every record.
    nc, nd : int
        Orders.

    Returns
    -------
    (nc,) array, (nd,) array
        With roots inside the unit circle; zeros where every series is too short.
    """
    rows, target = [], []
    order = min(LONG_AR, max(1, min(len(v) for v in series) // 10))
    long = autoregression(series, order)[0]
    for v in series:
        e = np.convolve(v, long)[: len(v)]
        start = order + max(nc, nd)
        if len(v) <= start:
            continue
        columns = [-v[start - i: len(v) - i] for i in range(1, nd + 1)]
        columns += [e[start - i: len(v) - i] for i in range(1, nc + 1)]
        rows.append(np.column_stack(columns))
        target.append(v[start:])
    if not rows:
        return np.zeros(nc), np.zeros(nd)
    solution = np.linalg.lstsq(np.vstack(rows), np.concatenate(target), rcond=1e-10)[0]
    d, c = solution[:nd], solution[nd:]
    return (stable_polynomial(np.roots(np.r_[1, c]), 0.95)[1:] if nc else c,
            stable_polynomial(np.roots(np.r_[1, d]), 0.98)[1:] if nd else d)


def autoregression(series: Sequence[np.ndarray], order: int) -> tuple[np.ndarray, float]:
    """Polynomial 1 + f_1 q⁻¹ + … and innovation variance by Yule-Walker; always stable.

    Parameters
    ----------
    series : sequence of (n,) arrays
        Of one process, about zero.
    order : int

    Returns
    -------
    (order + 1,) array, float
        Fewer coefficients where the series are predicted exactly.
    """
    n = sum(len(v) for v in series)
    r = np.array([sum(float(v[: len(v) - k] @ v[k:]) for v in series) / n for k in range(order + 1)])
    polynomial, variance = np.ones(1), max(float(r[0]), 1e-300)
    for k in range(1, order + 1):
        reflection = -float(polynomial @ r[k:0:-1]) / variance
        polynomial = np.r_[polynomial, 0.0] + reflection * np.r_[0.0, polynomial[::-1]]
        variance *= 1 - reflection**2
        if variance <= 0:
            break
    return polynomial, max(variance, 1e-300)
