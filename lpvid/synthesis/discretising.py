"""Continuous LPV systems sampled, and discrete ones made continuous, each with the error that was made."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.lmi.certificate import tensor
from lpvid.model.lft import run_along
from lpvid.model.state_space import LPVStateSpace, Matrices
from lpvid.scheduling import Basis, Polynomial, Scheduling
from lpvid.scheduling.algebra import common
from lpvid.synthesis._form_parts import checking_points, matrix, rebuilt
from lpvid.synthesis.design_grid import ROUNDING
from lpvid.synthesis.matrix_function import MatrixFunction, block
from lpvid.synthesis.sampling_rules import Moving, SamplingRule, ZeroOrderHold, remainder

SAMPLES = 400
"""Length of the comparison run."""
FITTED = 700
"""About how many points of the box a basis is fitted at."""


@dataclass(frozen=True, eq=False)
class Discretisation:
    """A system in the other kind of time, with three figures of error.

    Parameters
    ----------
    model : LPVStateSpace
    rule : SamplingRule
    sample_time : float
        [s]
    misfit : float
        How far the basis is from the rule: largest ‖S_fit(p) − S_rule(p)‖₂ over the box, relative to the largest
        ‖S_rule‖₂, S = [A B; C D]. 0 where the rule was carried out over the basis.
    error : float
        Relative rms distance of the outputs of the discrete and the continuous system over `SAMPLES` samples, the
        continuous one integrated exactly with p and u held over each sample; p sweeps the box and u is a sum of sines
        below a tenth of the Nyquist frequency. Infinite if a run diverges.
    local_error : float
        Largest ‖A_d(p) − exp(A(p) T)‖₂ over the box, in states scaled to like size: what one sample adds.
    bound : float or None
        A priori bound on that for the rule (without the misfit), from the largest ‖A T‖.
    """

    model: LPVStateSpace
    rule: SamplingRule
    sample_time: float
    misfit: float
    error: float
    local_error: float
    bound: float | None

    def __str__(self) -> str:
        order = "exact for held u and p" if self.rule.accuracy is None else f"O(T^{self.rule.accuracy}) per sample"
        bound = f", bound {self.bound:.2e}" if self.bound else ""
        return (f"{self.rule.label} at {1 / self.sample_time:.6g} Hz ({order}): output off by {self.error:.2e}\n"
                f"one sample off by {self.local_error:.2e}{bound}; basis off by {self.misfit:.2e} "
                f"({len(self.model.basis.labels)} functions)")

    __repr__ = __str__


def discretise(
    system: LPVStateSpace,
    sample_time: float,
    rule: SamplingRule | None = None,
    *,
    basis: Basis | None = None,
    tolerance: float = 1e-8,
    highest: int = 4,
) -> Discretisation:
    """A continuous LPV system sampled with period T, input and scheduling held over the sample.

    `Taylor` and `Euler` stay inside the products of the basis and are carried out exactly. `ZeroOrderHold` and `Tustin`
    give matrices that no finite basis holds: they are fitted over rising powers of the basis until the misfit is small.

    Parameters
    ----------
    system : LPVStateSpace
        Continuous.
    sample_time : float
        T [s].
    rule : SamplingRule, optional
        `ZeroOrderHold()` if left out.
    basis : Basis, optional
        For the fit, instead of powers of the system's own.
    tolerance : float
        Misfit at which no higher power is tried.
    highest : int
        Highest power.

    Returns
    -------
    Discretisation
        The sampled system with its errors.

    Raises
    ------
    InputError
        A discrete system, one that reads p at several times, or no state space.

    Examples
    --------
    >>> system = LPVStateSpace([[[-1.0]], [[-0.5]]], [[[1.0]], [[0.0]]], [[[1.0]], [[0.0]]], np.zeros((2, 1, 1)),
    ...                        Polynomial("p", 1), None)
    >>> sampled = discretise(system, 0.1)
    >>> sampled.model.sample_time, sampled.misfit < 1e-6, sampled.error < 1e-6
    (0.1, True, True)
    >>> float(sampled.model.frozen([1.0])[0][0, 0].round(6)), round(math.exp(-0.15), 6)
    (0.860708, 0.860708)
    """
    if not isinstance(system, LPVStateSpace):
        raise InputError("a state space is sampled", got=type(system).__name__,
                         mend="of a generalised plant sample the system: GeneralizedPlant(discretise(plant.system, "
                              "T).model, plant.controls, plant.measurements)")
    if system.sample_time is not None:
        raise InputError("only a continuous system is sampled", got=f"a period of {system.sample_time:g} s")
    period = _checks.positive(sample_time, "sample_time", "s")
    rule = rule or ZeroOrderHold()
    exact = rule.sample_exactly(_moving(system), period)
    if exact is not None:
        model, misfit = _built(exact, system, period), 0.0
    else:
        model, misfit = _fitted(system, lambda x: rule.sample(x, period), period, basis, tolerance, highest)
    return _stated(system, model, rule, period, model, misfit)


def to_continuous(system: LPVStateSpace, rule: SamplingRule | None = None, *, basis: Basis | None = None,
                  tolerance: float = 1e-8, highest: int = 4) -> Discretisation:
    """The continuous LPV system whose samples, by the same rule, are the discrete one.

    Parameters
    ----------
    system : LPVStateSpace
        Discrete.
    rule : SamplingRule, optional
        `ZeroOrderHold()` if left out.
    basis : Basis, optional
        For the fit, instead of powers of the system's own.
    tolerance : float
        Misfit at which no higher power is tried.
    highest : int
        Highest power.

    Returns
    -------
    Discretisation
        The continuous system with its errors.

    Raises
    ------
    InputError
        A continuous system, or a pole without a continuous counterpart (negative real for the zero-order hold).

    Examples
    --------
    >>> system = LPVStateSpace([[[-1.0]], [[-0.5]]], [[[1.0]], [[0.0]]], [[[1.0]], [[0.0]]], np.zeros((2, 1, 1)),
    ...                        Polynomial("p", 1), None)
    >>> back = to_continuous(discretise(system, 0.1).model)
    >>> float(back.model.frozen([1.0])[0][0, 0].round(5))
    -1.5
    """
    if system.sample_time is None:
        raise InputError("only a discrete system is made continuous", got="a continuous system")
    period, rule = system.sample_time, rule or ZeroOrderHold()
    exact = rule.restore_exactly(_moving(system), period)
    if exact is not None:
        model, misfit = _built(exact, system, None), 0.0
    else:
        model, misfit = _fitted(system, lambda x: rule.restore(x, period), None, basis, tolerance, highest)
    return _stated(model, system, rule, period, model, misfit)


# -- over the basis --------------------------------------------------------------------------------------------------
def _moving(system: LPVStateSpace) -> Moving:
    """A, [B f], C, [D g]: the affine terms ride along as an input that is always 1."""
    whole, n = matrix(system), system.order
    states, rest = slice(0, n), slice(n, None)
    return whole[states, states], whole[states, rest], whole[rest, states], whole[rest, rest]


def _frozen(system: LPVStateSpace, points: np.ndarray) -> Matrices:
    whole, n = matrix(system).at(points), system.order
    return whole[:, :n, :n], whole[:, :n, n:], whole[:, n:, :n], whole[:, n:, n:]


def _whole(x: Matrices) -> np.ndarray:
    return np.block([[x[0], x[1]], [x[2], x[3]]])


def _built(parts: Moving, system: LPVStateSpace, period: float | None) -> LPVStateSpace:
    a, b, c, d = parts
    return rebuilt(block([[a, b], [c, d]]).trimmed(), system).replace(sample_time=period)


def _fitted(system: LPVStateSpace, rule, period: float | None, basis: Basis | None, tolerance: float, highest: int
            ) -> tuple[LPVStateSpace, float]:
    """The first power of the basis (or the given one) over which the rule's matrices are met; the best if none is."""
    box = system.box
    each = max(5, round(FITTED ** (1 / max(len(box.names), 1))))
    nodes = -np.cos(np.pi * (np.arange(each) + 0.5) / each)
    points = tensor([nodes] * len(box.names)) * box.half_width + box.centre
    wanted = _whole(rule(_frozen(system, points)))
    check = checking_points(box)
    truth = _whole(rule(_frozen(system, check)))
    size = max(float(np.linalg.norm(truth, 2, axis=(1, 2)).max(initial=0.0)), 1e-300)
    still = (np.ptp(wanted, axis=0) <= ROUNDING * np.abs(wanted).max(axis=0)).ravel()  # a fit leaves rounding errors
    best: tuple[MatrixFunction, float] | None = None
    for candidate in [basis.bound(box)] if basis is not None else _powers(system.basis, box, highest):
        columns = [box.names.index(n) for n in candidate.names]
        phi = candidate.evaluate(points[:, columns])
        fit = np.linalg.lstsq(phi, wanted.reshape(len(points), -1), rcond=None)[0]
        if candidate.unity is not None:
            fit[:, still] = candidate.unity[:, None] * wanted.reshape(len(points), -1)[0, still]
        function = MatrixFunction(candidate, fit.reshape(candidate.size, *wanted.shape[1:]))
        misfit = float(np.linalg.norm(function.at(check[:, columns]) - truth, 2, axis=(1, 2)).max(initial=0.0)) / size
        if best is None or misfit < best[1]:
            best = function, misfit
        if misfit <= tolerance:
            break
    assert best is not None
    return rebuilt(best[0], system).replace(sample_time=period), best[1]


def _powers(basis: Basis, box: Scheduling, highest: int):
    normal, _, _ = common(Polynomial(box.names, 1).bound(box), basis)
    start = normal if isinstance(normal, Polynomial) else basis
    power = start
    for k in range(highest):
        yield power
        if k < highest - 1:
            power = power * start


# -- how far apart ---------------------------------------------------------------------------------------------------
def _stated(
    continuous: LPVStateSpace,
    discrete: LPVStateSpace,
    rule: SamplingRule,
    period: float,
    result: LPVStateSpace,
    misfit: float,
) -> Discretisation:
    from scipy.linalg import matrix_balance

    points = checking_points(continuous.box)
    a, ad = _frozen(continuous, points)[0], _frozen(discrete, points)[0]
    n = continuous.order
    local, size = 0.0, 0.0
    if n:
        exact = ZeroOrderHold().sample((a, np.zeros((*a.shape[:2], 0)), a, a), period)[0]
        _, (scale, _) = matrix_balance(np.abs(a).max(axis=0), permute=False, separate=True)
        local = float(np.linalg.norm((ad - exact) * scale / scale[:, None], 2, axis=(1, 2)).max())
        size = float(np.linalg.norm(a * scale / scale[:, None], 2, axis=(1, 2)).max()) * period
    return Discretisation(result, rule, period, misfit, _run_error(continuous, discrete, period), local,
                          remainder(rule, size))


def comparison_signals(box: Scheduling, inputs: int) -> tuple[np.ndarray, np.ndarray]:
    """(SAMPLES, n_scheduling) sweeps of the box and (SAMPLES, inputs) sums of sines, for the figure of error.

    Parameters
    ----------
    box : Scheduling
        Ranges that p sweeps.
    inputs : int
        Number of inputs.

    Returns
    -------
    (SAMPLES, n_scheduling) array
        p, two to five turns of each variable.
    (SAMPLES, inputs) array
        u, three sines of amplitude 1 for each input.
    """
    k = np.arange(SAMPLES)[:, None]
    golden = (math.sqrt(5) - 1) / 2
    turns = np.array([2 + 3 * ((i + 1) * golden % 1) for i in range(len(box.names))])
    p = box.centre + box.half_width * np.sin(2 * np.pi * turns * k / SAMPLES + np.arange(len(box.names)))
    waves = np.array([[3 + 2 * i, 11 + 3 * i, 19 + i] for i in range(inputs)]).reshape(-1, 3)
    u = np.sin(2 * np.pi * waves * k[:, :, None] / SAMPLES + np.arange(3)).sum(axis=2)
    return p, u


def _run_error(continuous: LPVStateSpace, discrete: LPVStateSpace, period: float) -> float:
    """Relative rms distance of the outputs, the continuous system integrated exactly with u and p held."""
    p, u = comparison_signals(continuous.box, len(continuous.inputs))
    u = np.hstack([u, np.ones((SAMPLES, 1))])
    rest = np.zeros(continuous.order)
    with np.errstate(over="ignore", invalid="ignore"):
        exact = run_along(ZeroOrderHold().sample(_frozen(continuous, p), period), u, rest)
        got = run_along(_frozen(discrete, p), u, rest)
        size, gap = float(np.sqrt(np.mean(exact**2))), float(np.sqrt(np.mean((got - exact) ** 2)))
    if not math.isfinite(gap) or not math.isfinite(size):
        return math.inf
    return gap / size if size else gap
