"""Screening: changes of the output by single effects, their detectability, and their p-values in the residual."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid._projection import projector, without
from lpvid.diagnosis.budgets import SIGN_PATTERNS
from lpvid.diagnosis.problem import DiagnosisProblem
from lpvid.diagnosis.refitting import Refit
from lpvid.effects.composition import Composition
from lpvid.effects.effect import Effect
from lpvid.rounding import EPS, STEP, TINY

DETECTABLE_RATIO = 10.0
"""log-likelihood ratio, beyond ln n, at which a strength counts as detectable"""


@dataclass(frozen=True, eq=False)
class Direction:
    """Change of the output by an effect at one grid point, the sensitivities of a fit projected out.

    Attributes
    ----------
    effect : Effect
    values : (k,) array
        Parameters of the effect at this grid point.
    change : (N,) array
        P (f(values) − f(neutral)).
    norm, raw_norm : float
        Of `change`, and of f(values) − f(neutral) before the projection.
    size : float
        Root mean square of f(values) − f(neutral) in the output's unit.
    gain : float
        Reduction of the squared error when scaled, in its own sense: (change·e)₊²/‖change‖².
    share : float
        Factor on the change of the largest reduction: (change·e)₊/‖change‖².
    """

    effect: Effect
    values: np.ndarray
    change: np.ndarray
    norm: float
    raw_norm: float
    size: float
    gain: float
    share: float

    @property
    def unscaled_gain(self) -> float:
        """Reduction of the squared error without scaling: 2 change·e − ‖change‖², which may be negative."""
        return (2 * self.share - 1) * self.norm**2

    @property
    def strength(self) -> float:
        """Largest distance of a strength from neutral."""
        k = self.effect.strengths
        return float(np.abs(self.values[:k] - self.effect.neutral[:k]).max())

    @property
    def visible(self) -> bool:
        """Whether it is no combination of the sensitivities of the fit, as exact as differences of `STEP` are."""
        return self.norm > STEP * max(self.raw_norm, TINY) and self.norm > 0


@dataclass(frozen=True, eq=False)
class ScreeningResult:
    """Result of the screening for one effect.

    Attributes
    ----------
    effect : Effect
    likelihood_ratio : float
        (sᵀPr)²/(σ²‖Ps‖²) at the best grid point.
    p_value : float
        Share of sign patterns whose largest statistic over all effects is as large.
    best : Direction or None
        The grid point; None where no point is visible.
    smallest_detectable : float or None
        Strength at which the likelihood ratio would reach 10 + ln n; None where nothing would.
    """

    effect: Effect
    likelihood_ratio: float
    p_value: float
    best: Direction | None
    smallest_detectable: float | None


@dataclass(frozen=True, eq=False)
class CandidateChange:
    """Change of the simulation by an effect at one grid point, record by record.

    Attributes
    ----------
    effect : Effect
    values : (k,) array
    change : tuple of (n,) arrays
        f(values) − f(neutral) in the output's unit.
    """

    effect: Effect
    values: np.ndarray
    change: tuple[np.ndarray, ...]


def candidate_change(problem: DiagnosisProblem, fit: Refit, effect: Effect, values: np.ndarray,
                     simulated: Sequence[np.ndarray] | None = None) -> CandidateChange | None:
    """Change of the simulation of a fit by one effect at given values; None where it is not finite.

    Parameters
    ----------
    problem : DiagnosisProblem
    fit : Refit
        Without the effect.
    effect : Effect
    values : (k,) array
        Its parameters.
    simulated : sequence of (n,) arrays, optional
        The simulation of the fit, if known: one for each record, in the output's unit.

    Returns
    -------
    CandidateChange or None
    """
    simulated = [fit.composition.predict(s, fit.vector) for s in problem.signals] if simulated is None else simulated
    larger = Composition(fit.composition.baseline, (*fit.composition.effects, effect))
    vector = start_vector(larger, fit, {effect.name: values})
    with np.errstate(all="ignore"):
        change = tuple(larger.predict(s, vector) - f for s, f in zip(problem.signals, simulated, strict=True))
    if not all(np.isfinite(c).all() for c in change):
        return None
    rounding = EPS * max(f.size * float(np.abs(f).max()) for f in simulated)  # of as many operations in turn
    return CandidateChange(effect, values, tuple(np.where(np.abs(c) > rounding, c, 0.0) for c in change))


def directions(problem: DiagnosisProblem, fit: Refit, changes: Sequence[CandidateChange],
               basis: np.ndarray | None = None) -> list[Direction]:
    """Changes with the sensitivities of a fit projected out.

    Parameters
    ----------
    problem : DiagnosisProblem
    fit : Refit
        With whose errors they are compared.
    changes : sequence of CandidateChange
    basis : (N, r) array, optional
        Orthonormal, of the sensitivities, if known.

    Returns
    -------
    list of Direction
        One for each change, in their order.
    """
    if not changes:
        return []
    basis = projector(fit.free_jacobian) if basis is None else basis
    plain = np.array([problem.stack(m.change) for m in changes])
    raw = problem.weighed(plain.T).T
    beyond = without(basis, raw.T).T
    norms, raw_norms = np.linalg.norm(beyond, axis=1), np.linalg.norm(raw, axis=1)
    shares = np.maximum(beyond @ fit.errors, 0.0) / np.where(norms > 0, norms, np.inf) ** 2
    out = []
    for m, in_time, change, norm, raw_norm, share in zip(changes, plain, beyond, norms.tolist(), raw_norms.tolist(),
                                                         shares.tolist(), strict=True):
        out.append(Direction(m.effect, m.values, change, norm, raw_norm, float(np.sqrt(np.mean(in_time**2))),
                             share**2 * norm**2, share))
    return out


def start_vector(composition: Composition, fit: Refit, given: dict[str, np.ndarray]) -> np.ndarray:
    """(P,) start of a larger composition: a fit's parameters where it has them, `given` for the new effects.

    Parameters
    ----------
    composition : Composition
    fit : Refit
        Beside the same baseline.
    given : dict of str to (k,) array
        Parameters by the name of the effect, in place of the fit's.

    Returns
    -------
    (P,) array
        Neutral for any other effect.
    """
    known = fit.composition.by_effect(fit.vector) | given
    vector = composition.neutral
    size = composition.baseline.vector.size
    vector[:size] = fit.vector[:size]
    for effect, place in zip(composition.effects, composition.places, strict=True):
        if effect.name in known:
            vector[place] = known[effect.name]
    return vector


def screen(
    problem: DiagnosisProblem, fit: Refit, found: Sequence[Direction], rng: np.random.Generator
) -> list[ScreeningResult]:
    """Likelihood ratios of all candidates and block p-values of the largest statistic, strongest first.

    Under the null hypothesis the block sums u_b have random signs whatever the noise's size and, within a block, its
    colour, so that flipping whole blocks gives the distribution of the maximum over all candidates and grid points.

    Parameters
    ----------
    problem : DiagnosisProblem
    fit : Refit
        Whose sensitivities were projected out of the directions.
    found : sequence of Direction
    rng : Generator

    Returns
    -------
    list of ScreeningResult
        One for each effect that has a direction.
    """
    residual = without(projector(fit.free_jacobian), fit.errors)
    variance = max(float(residual @ residual) / max(residual.size - fit.vector.size, 1), TINY)
    visible = [d for d in found if d.visible]
    out = []
    if visible:
        unit = np.column_stack([d.change / d.norm for d in visible])
        sums = problem.block_sums(unit * residual[:, None])
        score = np.maximum(sums.sum(axis=0), 0.0)  # a change counts in its own sense: friction is never negative
        ratio = score**2 / variance
        power = np.maximum((sums**2).sum(axis=0), TINY)
        statistic = score**2 / power
        signs = rng.choice([-1.0, 1.0], size=(SIGN_PATTERNS, problem.blocks.count))
        squares = np.maximum(signs @ sums, 0.0) ** 2
        null = np.column_stack([(squares / power).max(axis=1), squares.max(axis=1)])
        p_values = _p_values(null, np.column_stack([statistic, score**2]))
    for effect in dict.fromkeys(d.effect for d in found):
        own = [k for k, d in enumerate(visible) if d.effect is effect]
        if not own:
            out.append(ScreeningResult(effect, 0.0, 1.0, None, None))
            continue
        best = max(own, key=lambda k: ratio[k])
        smallest = _smallest(effect, [visible[k] for k in own], variance, problem.n_samples)
        out.append(ScreeningResult(effect, float(ratio[best]), float(p_values[own].min()), visible[best], smallest))
    return sorted(out, key=lambda e: -e.likelihood_ratio)


def _p_values(null: np.ndarray, observed: np.ndarray) -> np.ndarray:
    """(k,) p-values of k candidates by the better of two statistics, (flips, 2) under the null and (k, 2) observed.

    The share of sign patterns in which the largest value of either statistic ranks as high among all patterns: as cheap
    and as exact as a single statistic. The studentised statistic detects what acts everywhere, whatever the
    distribution of the noise over the blocks; the likelihood ratio what acts in few blocks only.
    """
    def ranks(values: np.ndarray) -> np.ndarray:
        """The better of the ranks of either statistic among all patterns, 1 for the largest."""
        columns = zip(np.sort(null, axis=0).T, values.T, strict=True)
        return np.min([len(null) - np.searchsorted(ordered, v, side="left") for ordered, v in columns], axis=0)

    return (1 + np.searchsorted(np.sort(ranks(null)), ranks(observed), side="right")) / (1 + len(null))


def _smallest(effect: Effect, visible: Sequence[Direction], variance: float, n: int) -> float | None:
    """Smallest strength with a likelihood ratio of 10 + ln n at some shape: in proportion, or of the grid points."""
    wanted = np.sqrt(variance * (DETECTABLE_RATIO + np.log(n)))
    if effect.smooth:
        return float(min(d.strength * wanted / d.norm for d in visible))
    detectable = [d.strength for d in visible if d.norm >= wanted]
    return float(min(detectable)) if detectable else None
