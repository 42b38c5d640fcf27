"""What the uncertainty of an identified model means for its poles: band of the locus, probability of stability."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from lpvid import _checks
from lpvid.analysis.frozen import (
    CAVEAT,
    FrozenFamily,
    FrozenMatrix,
    Line,
    Model,
    basis_values,
    family,
    lines,
    stability_margin,
)
from lpvid.analysis.guardian import candidates, pieces, polish
from lpvid.analysis.pole_locus import grid_along, one_line
from lpvid.codec import Encoded
from lpvid.errors import InputError
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Scheduling

CHUNK = 200_000


@dataclass(frozen=True, eq=False)
class PoleBand(Encoded):
    """Spread of the frozen poles over models drawn from a parameter covariance.

    ``low``, ``median``, ``high`` are pointwise quantiles, over the draws, of the largest |z| (continuous time: of the
    largest Re s [1/s]); ``cloud`` holds the poles of some draws, (n_draws, n, n_poles), for plots.

    Attributes
    ----------
    variable, unit : str
        What `p` measures.
    p : (n,) array
        Values of the scheduling variable.
    low, median, high : (n,) array
        1 (continuous time: 0) is the boundary of stability.
    level : float
        Coverage of the band, between 0 and 1.
    share_stable : (n,) array
        Of the draws, at each value by itself.
    cloud : (n_draws, n, n_poles) complex array
        z, or s [1/s].
    draws : int
        Models behind the quantiles.
    is_discrete : bool
        Discrete time.
    """

    JSON = ("variable", "unit", "p", "low", "median", "high", "level", "share_stable", "draws")

    variable: str
    unit: str
    p: np.ndarray
    low: np.ndarray
    median: np.ndarray
    high: np.ndarray
    level: float
    share_stable: np.ndarray
    cloud: np.ndarray
    draws: int
    is_discrete: bool

    def __str__(self) -> str:
        worst = int(np.argmax(self.high))
        what = "largest pole modulus" if self.is_discrete else "largest real part"
        least = int(np.argmin(self.share_stable))
        return "\n".join([
            f"{what} over {self.variable} {self.p[0]:.6g} … {self.p[-1]:.6g} {self.unit}".rstrip()
            + f": at most {self.median.max():.6g} (median), {self.high.max():.6g} at the {self.level:.0%} band's top, "
              f"at {self.p[worst]:.6g} {self.unit}".rstrip(),
            f"  {self.draws} draws, band pointwise; fewest stable: {self.share_stable[least]:.1%} "
            f"at {self.p[least]:.6g} {self.unit}".rstrip(), CAVEAT])

    __repr__ = __str__


@dataclass(frozen=True)
class StabilityProbability(Encoded):
    """Share of drawn models that are frozen-stable over the whole range, with its Wilson interval.

    Attributes
    ----------
    probability : float
        Share of the draws.
    standard_error : float
        Of the share; of none or all of the draws, half the interval's width over the normal quantile.
    interval : (float, float)
        Within 0 and 1.
    level : float
        Coverage of the interval.
    draws : int
        Models behind it.
    exact : bool
        Every draw was decided between grid points too.
    """

    probability: float
    standard_error: float
    interval: tuple[float, float]
    level: float
    draws: int
    exact: bool

    def __str__(self) -> str:
        how = "decided exactly" if self.exact else "decided on a grid"
        return (f"frozen-stable over the whole range with probability {self.probability:.3f} "
                f"({self.level:.0%} interval {self.interval[0]:.3f} … {self.interval[1]:.3f}, {self.draws} draws, "
                f"{how})"
                f"\n{CAVEAT}")

    __repr__ = __str__


def pole_band(models: Iterable[Model], variable: str | None = None, points: int = 101,
              at: Mapping[str, float] | Sequence[float] | None = None,
              range: tuple[float, float] | None = None, level: float = 0.95,
              cloud: int = 100) -> PoleBand:
    """Pointwise quantiles of the largest pole modulus over drawn models, and a cloud of their poles.

    Parameters
    ----------
    models : iterable of LPVTransferFunction or of LPVStateSpace
        Draws of one model's parameters: alike in structure, basis and box.
    variable, at, range
        As in `pole_locus`.
    points : int
        Number of values of the variable.
    level : float
        Coverage of the band, between 0 and 1.
    cloud : int
        Number of draws whose poles are kept.

    Returns
    -------
    PoleBand

    Raises
    ------
    InputError
        No model, models that differ in structure, a level outside of (0, 1), or a line or range that `pole_locus`
        refuses.

    Examples
    --------
    >>> from lpvid.model.transfer_function import LPVTransferFunction
    >>> from lpvid.scheduling import Polynomial
    >>> draws = [LPVTransferFunction.siso(a=[[-0.5 - d, 0.25]], b=[[0, 0], [1, 0]], sample_time=0.1,
    ...                                   basis=Polynomial("current", degree=1)) for d in (-0.1, 0.0, 0.1)]
    >>> pole_band(draws, points=3).median
    array([0.75, 0.5 , 0.25])
    """
    drawn = _listed(models)
    if not 0 < _checks.real(level, "level") < 1:
        raise InputError("the level of a band must lie between 0 and 1", got=level)
    line = one_line(drawn[0], variable, at, None)
    p = grid_along(line, points, range)
    poles = _all_poles(drawn, line.points(p))
    discrete = family(drawn[0]).discrete
    margin = stability_margin(poles, discrete).max(axis=2, initial=-np.inf if not discrete else -1.0)
    tail = 50 * (1 - level)
    low, median, high = np.percentile(margin + (1.0 if discrete else 0.0), [tail, 50, 100 - tail], axis=0)
    return PoleBand(line.label, line.unit, p, low, median, high, level, (margin < 0).mean(axis=0),
                    poles[: _checks.count(cloud, "cloud")], len(drawn), discrete)


def stability_probability(models: Iterable[Model], box: Scheduling | None = None, level: float = 0.95,
                          points: int = 65) -> StabilityProbability:
    """Share of drawn models whose frozen poles decay over the whole box.

    With one scheduling variable each draw that is stable on the grid is decided exactly, by the guardian maps of
    `critical_scheduling`; with several, the grid decides (and ``exact`` is False).

    Parameters
    ----------
    models : iterable of LPVTransferFunction or of LPVStateSpace
        Draws of one model's parameters, for example of `Identification.draw`.
    box : Scheduling, optional
        The range to judge; the models' own by default.
    level : float
        Coverage of the Wilson interval.
    points : int
        Grid points along the variable; with several variables fewer, so that 500 draws take seconds.

    Returns
    -------
    StabilityProbability

    Raises
    ------
    InputError
        No model, models that differ in structure, a level outside of (0, 1), or a box with other variables.

    Examples
    --------
    >>> from lpvid.model.transfer_function import LPVTransferFunction
    >>> from lpvid.scheduling import Polynomial
    >>> draws = [LPVTransferFunction.siso(a=[[-0.5 - d, 0.25]], b=[[0, 0], [1, 0]], sample_time=0.1,
    ...                                   basis=Polynomial("current", degree=1)) for d in (0.0, 0.2, 0.3, 0.1)]
    >>> stability_probability(draws).probability
    0.75
    """
    drawn = _listed(models)
    if not 0 < _checks.real(level, "level") < 1:
        raise InputError("the level of an interval must lie between 0 and 1", got=level)
    box = box or drawn[0].box
    if box.names != drawn[0].box.names:
        raise InputError("the range and the models name different variables", got=f"{box.names}, {drawn[0].box.names}")
    count = len(box.names)
    _checks.count(points, "points", at_least=2)
    budget = max(400_000 / len(drawn), 200.0)
    grid = box.grid(points if count < 2 else int(np.clip(budget ** (1 / count), 2, points)))
    poles = _all_poles(drawn, grid)
    discrete = family(drawn[0]).discrete
    stable = (stability_margin(poles, discrete) < 0).all(axis=(1, 2))
    exact = count <= 1
    hits = 0
    for i in np.nonzero(stable)[0]:
        decided: bool | None = True
        if count == 1:
            model = replace(drawn[i], scheduling=box)
            decided = _stable_between(model, lines(model)[0])
            exact = exact and decided is not None
        hits += decided is not False
    return share_of(int(hits), len(drawn), level, exact)


def _listed(models: Iterable[Model]) -> list[Model]:
    drawn = list(models)
    if not drawn:
        raise InputError("no model was drawn", mend="give at least one model")
    shapes = {(type(m), _structure(m), m.box.names) for m in drawn}
    if len(shapes) > 1:
        raise InputError("the drawn models differ in structure", got=f"{len(shapes)} different ones")
    return drawn


def _structure(model: Model) -> tuple[int, int, bool]:
    """(number of poles, number of basis functions, discrete): what draws of one model share."""
    order = model.na * model.n_outputs if isinstance(model, LPVTransferFunction) else model.order
    return order, model.basis.size, model.sample_time is not None


def _all_poles(drawn: list[Model], p: np.ndarray) -> np.ndarray:
    """(draws, n, n_poles) poles of all models at all points, in stacks that fit in memory."""
    if any(m.basis != drawn[0].basis for m in drawn):
        return np.stack([family(m).poles(p) for m in drawn])
    families: list[FrozenFamily] = [family(m) for m in drawn]
    first = families[0]
    phi = basis_values(first.basis, p)
    size = max(1, CHUNK // max(len(p), 1))
    parts = []
    for k in np.arange(0, len(families), size):
        stack = FrozenMatrix(first.matrix.constant, np.stack([f.matrix.tensor for f in families[k:k + size]]))
        parts.append(np.linalg.eigvals(stack.at(phi)).astype(complex))
    return np.concatenate(parts)


def _stable_between(model: Model, line: Line) -> bool | None:
    """Whether a model that is stable on a grid stays so in between: no pole on the boundary inside the box.

    None where the guardian maps cannot decide.
    """
    models = family(model)
    listed = pieces(models, model.box.names, line)
    if listed is None:
        return None
    for piece in listed:
        if piece.high < line.low or piece.low > line.high:
            continue
        if piece.always:
            return False
        solved = candidates(piece)
        if solved is None:
            return None
        for kind, t in solved:
            if not line.low - 1e-3 * piece.half <= piece.centre + piece.half * t <= line.high + 1e-3 * piece.half:
                continue
            found = polish(piece, kind, t, models.discrete)
            if found is not None and line.low <= piece.centre + piece.half * found[0] <= line.high:
                return False
    return True


def share_of(hits: int, n: int, level: float, exact: bool) -> StabilityProbability:
    """Wilson 1927: interval of a share, sensible at 0 and 1 too.

    Parameters
    ----------
    hits : int
        Draws that count.
    n : int
        All draws, at least 1.
    level : float
        Coverage of the interval, between 0 and 1.
    exact : bool
        Kept with the result.

    Returns
    -------
    StabilityProbability
        Interval from 0 for no hit, and to 1 where all are.
    """
    z = NormalDist().inv_cdf(0.5 + level / 2)
    share = hits / n
    centre = (share + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * float(np.sqrt(share * (1 - share) / n + z * z / (4 * n * n)))
    error = float(np.sqrt(share * (1 - share) / n)) if 0 < hits < n else half / z
    low = 0.0 if hits == 0 else centre - half
    high = 1.0 if hits == n else centre + half
    return StabilityProbability(share, error, (max(low, 0.0), min(high, 1.0)), level, n, exact)
