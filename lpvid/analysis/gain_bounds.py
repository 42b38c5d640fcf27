"""Upper bounds of an induced gain: proposals of the solver, certified or thrown away."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from lpvid.analysis.frozen import pole_margins
from lpvid.errors import InputError
from lpvid.lmi.certificate import Recheck, grid
from lpvid.lmi.driven import Driven
from lpvid.lmi.frame import Frame, frame_of
from lpvid.lmi.gain_certificate import BoundedReal, GainCertificate, recheck_gain
from lpvid.lmi.polytope_positivity import CUBES, decidable
from lpvid.lmi.storage import Storage
from lpvid.lmi.storage_search import ROUGHLY, StorageProposal, StorageSearch
from lpvid.scheduling import Basis, Fourier, Polynomial, Scheduling

BACK_OFF = (1e-6, 1e-5, 1e-4, 5e-4, 2e-3, 5e-3)
RELAXED = (1e-2, 6e-2, 0.2)
BLENDS = (0.1, 0.25, 0.5, 0.75, 1.0)
"""Shares of the way from the least bound's storage function to one with room to spare: the inequality is linear in P
and γ together, so that all of them are candidates and cost no solver."""
HIGHEST = {1: 3, 2: 2}
"""Degree of the richest storage function tried, by the number of variables it depends on; 1 for more."""
ATTEMPT = 15_000
"""Matrices that the re-check of a proposal may look at; `lpvid.verify` allows more."""
DENSITIES = (2.0, 5.0)
ENOUGH = 0.005
"""A richer storage function must improve the bound by this share, or one of the next degree."""
STALLS = 2
"""degrees in a row that improve nothing, after which the search ends: by a symmetry of the system in the scheduling
only odd powers, or only even ones, may be of use"""


@dataclass(eq=False)
class GainBounds:
    """Certified bounds for one system over one box, for any rates of its variables.

    Searches are kept, so that a sweep over rates compiles each program once.

    Parameters
    ----------
    system : Driven
        Frozen-stable on the box.
    box : Scheduling
        Of the readings.
    basis : Basis or None
        Of the storage function; None tries polynomials of rising degree.
    floor : float
        A gain that is known to be reached.
    vertices : (V, readings) array, optional
        Of a polytope in place of the box, which encloses it: P moves with variables of bounded rate.
    """

    system: Driven
    box: Scheduling
    basis: Basis | None = None
    floor: float = 0.0
    vertices: np.ndarray | None = None
    _searches: dict[tuple, StorageSearch] = field(default_factory=dict)
    _frame: Frame | None = None

    def prepare(self, rate: tuple[float | None, ...]) -> None:
        """State and compile ahead whatever a sweep over rates may ask for.

        Parameters
        ----------
        rate : tuple of float or None
            [units per second] of each variable; in continuous time only which of them are None counts.
        """
        box = Scheduling(self.box.names, self.box.lower, self.box.upper, rate, self.box.units)
        for basis in self._bases(box):
            search = self._search(basis, box, DENSITIES[0])
            if search.affordable:
                search.prepare(box)

    def certify(self, rate: tuple[float | None, ...]) -> GainCertificate | None:
        """The least bound that passes the re-check for these rates; one between grid points goes before one on it.

        Parameters
        ----------
        rate : tuple of float or None
            [units per second] of each variable; None for any motion.

        Returns
        -------
        GainCertificate or None
            None where nothing passes.
        """
        box = Scheduling(self.box.names, self.box.lower, self.box.upper, rate, self.box.units)
        best: GainCertificate | None = None
        bases, stalls = list(self._bases(box)), 0
        for basis in bases if self.basis is None else reversed(bases):  # a given one first: it may be all that it takes
            found = self._with(basis, box)
            if found is None:
                continue
            stalled = best is not None and basis.degree != 1 and found.gamma > (1 - ENOUGH) * best.gamma
            stalls = stalls + 1 if stalled else 0
            best = stronger(best, found)
            reached = best.gamma <= (1 + ENOUGH) * self.floor
            if best.between_grid and (reached or (stalls >= STALLS and self.basis is None)):
                break
        return best

    def _bases(self, box: Scheduling) -> Iterator[Basis]:
        """As `storage_bases`; on a polytope those of which its simplices decide."""
        for basis in storage_bases(self.system, box, self.basis):
            moves = basis.names or not self.system.affine  # one P for an affine system is a matter of `hull_gain`
            bounded = all(box.rate[box.names.index(n)] is not None for n in basis.names)
            if self.vertices is None or (moves and bounded and not decidable(self.system, basis)):
                yield basis

    @property
    def frame(self) -> Frame:
        """Coordinates in which programs are stated."""
        if self._frame is None:
            points = (grid(self.box, {0: 1, 1: 9, 2: 4}.get(len(self.box.names), 2)) if self.vertices is None
                      else self.vertices)
            self._frame = frame_of(self.system, points, self.floor)
        return self._frame

    def _with(self, basis: Basis, box: Scheduling) -> GainCertificate | None:
        """The best over several samplings: a bound far above the solver's own is one that failed between its points."""
        best: GainCertificate | None = None
        tried: int | None = None
        for density in DENSITIES:
            search = self._search(basis, box, density)
            if not search.affordable or search.effort == tried:  # a lattice as fine as is affordable is no finer
                return best
            tried = search.effort if self.vertices is not None else None
            seen = False
            for storage, gamma, outcome, solver, level in self._attempts(search, box):
                seen = True
                best = stronger(best, GainCertificate.of(
                    self.system, storage, gamma, outcome, solver, vertices=self.vertices))
                if outcome.between_grid:
                    if gamma <= (1 + ENOUGH) * level:
                        return best
                    break
            if not seen or not box.names:
                return best
        return best

    def _search(self, basis: Basis, box: Scheduling, density: float) -> StorageSearch:
        pattern = tuple(r is None for r in box.rate)
        key = (str(basis.to_dict()), pattern, density)
        if key not in self._searches:
            self._searches[key] = StorageSearch(
                self.system, box, basis, self.frame, lambda gamma: partial(BoundedReal, gamma=gamma), density,
                self.vertices)
        return self._searches[key]

    def _attempts(self, search: StorageSearch, box: Scheduling
                  ) -> Iterator[tuple[Storage, float, Recheck, str, float]]:
        """Everything that passes the re-check, as strongly as possible first, with the bound that the solver has."""
        for proposal in search.least(box):
            if not 0 < proposal.level < 1e9:
                continue
            level = proposal.level * self.frame.gain
            yield from ((*found, level) for found in self._relaxed(search, box, proposal, BACK_OFF))
            for share in RELAXED:
                inner = next(search.roomiest(proposal.level * (1 + share), box, settings=ROUGHLY), None)
                if inner is not None:
                    for between in blended(proposal, inner):
                        yield from ((*found, level) for found in self._relaxed(search, box, between, (0.0,)))
            return

    def _relaxed(self, search: StorageSearch, box: Scheduling, proposal: StorageProposal, shares: tuple[float, ...]
                 ) -> Iterator[tuple[Storage, float, Recheck, str]]:
        storage = Storage(proposal.matrices, search.basis, box, self.system.sample_time)
        for share in shares:
            gamma = max(proposal.level * (1 + share), 1e-12) * self.frame.gain
            outcome = recheck_gain(self.system, storage, gamma, vertices=self.vertices,
                                   budget=ATTEMPT if self.vertices is None else CUBES * ATTEMPT)
            if outcome.holds:
                yield storage, gamma, outcome, proposal.solver


def stronger(best: GainCertificate | None, found: GainCertificate) -> GainCertificate:
    """Of two certificates the one that holds between grid points, else the one of the lower bound.

    Parameters
    ----------
    best : GainCertificate or None
        So far.
    found : GainCertificate

    Returns
    -------
    GainCertificate
        `best` where both are the same.
    """
    if best is None or (found.between_grid, -found.gamma) > (best.between_grid, -best.gamma):
        return found
    return best


def blended(least: StorageProposal, inner: StorageProposal) -> Iterator[StorageProposal]:
    """From one proposal towards another, with the last one's margin: an inequality linear in P and level has them all.

    Parameters
    ----------
    least, inner : StorageProposal
        Of the least level, and with room to spare.

    Yields
    ------
    StorageProposal
        At the shares `BLENDS` of the way.
    """
    for part in BLENDS:
        yield replace(inner, matrices=(1 - part) * least.matrices + part * inner.matrices,
                      level=(1 - part) * least.level + part * inner.level)


def storage_bases(system: Driven, box: Scheduling, basis: Basis | None = None, highest: int | None = None
                  ) -> Iterator[Basis]:
    """Bases of storage functions from poor to rich: a constant, then polynomials in what may not jump.

    Before a given basis come those that it contains: at the points where the inequalities are imposed a richer one does
    at least as well, but it bends more between them and leaves the solver less room, so that what is certified may be
    worse.

    Parameters
    ----------
    system : Driven
        For the kind of time.
    box : Scheduling
        With the rates.
    basis : Basis, optional
        The last one to take instead.
    highest : int, optional
        Degree; left out, by the number of variables.

    Yields
    ------
    Basis
        In discrete time polynomials of degree 1 also in variables that may jump.
    """
    if basis is not None:
        own = usable(basis, box, system.sample_time is not None)
        yield from poorer(own)
        yield own
        return
    yield Polynomial((), 0)
    bounded = [n for n, r in zip(box.names, box.rate, strict=True) if r is not None]
    names = box.names if system.sample_time is not None else tuple(bounded)
    names = tuple(n for n in names if box.upper[box.names.index(n)] > box.lower[box.names.index(n)])
    most = (highest or HIGHEST.get(len(names), 1)) if bounded else 1
    for degree in range(1, most + 1) if names else ():
        yield Polynomial(names, degree).bound(box)


def poorer(basis: Basis) -> Iterator[Basis]:
    """Bases that one contains, of its own kind, the constant first.

    Parameters
    ----------
    basis : Basis
        A polynomial with all lower degrees, a Fourier basis with fewer harmonics; any other with the constant alone.

    Yields
    ------
    Basis
        With fewer functions.

    Examples
    --------
    >>> [b.labels for b in poorer(Polynomial("p", 2))]
    [('1',), ('1', 'p')]
    """
    if basis.size > 1:
        yield Polynomial((), 0)
    if isinstance(basis, Polynomial):
        yield from (replace(basis, degree=degree) for degree in range(1, basis.degree))
    if isinstance(basis, Fourier):
        yield from (replace(basis, harmonics=harmonics) for harmonics in range(1, basis.harmonics))


def usable(basis: Basis, box: Scheduling, discrete: bool) -> Basis:
    """A basis for the storage function, bound to the box.

    Parameters
    ----------
    basis : Basis
        As given by the user.
    box : Scheduling
        One entry for each reading, with the rates.
    discrete : bool
        Discrete time: no condition on rates or slopes.

    Returns
    -------
    Basis
        With the box's ranges.

    Raises
    ------
    InputError
        It reads something else, or at a delay, or, in continuous time, a variable without a rate bound or with a slope
        that jumps inside the box.
    """
    for name in basis.names:
        if name not in box.names:
            raise InputError("the storage function depends on a variable that the model does not read", got=name,
                             mend=f"choose among {', '.join(box.names) or 'none'}")
    if any(basis.lags):
        raise InputError("the storage function reads a variable at a delay", got=basis.labels,
                         mend="let it read p(k), without Shifted")
    bound = basis.bound(box)
    if discrete:
        return bound
    for reading in bound.readings():
        if (reading.degree or reading.frequency) and box.rate[box.names.index(reading.name)] is None:
            raise InputError(f"the storage function depends on '{reading.name}', whose rate has no bound",
                             why="in continuous time it could jump", mend=f"give a rate for '{reading.name}'")
        i = box.names.index(reading.name)
        jumps = reading.jumps(box.lower[i], box.upper[i])
        if jumps:
            raise InputError(f"the storage function has a slope that jumps in '{reading.name}'",
                             got=", ".join(f"{k:.6g}" for k in jumps[:3]),
                             mend="use splines of order 2 or higher, with simple knots over the whole box")
    return bound


def worst_pole(system: Driven, box: Scheduling) -> tuple[float, np.ndarray]:
    """Largest real part, or modulus less 1, of the frozen poles on a grid, and where.

    Parameters
    ----------
    system : Driven
        Its A alone counts.
    box : Scheduling
        One entry for each reading.

    Returns
    -------
    float
        [1/s] in continuous time; −∞ without states. Negative: every frozen model on the grid is stable.
    (readings,) array
        Scheduling where it is.
    """
    points = grid(box, {0: 1, 1: 201, 2: 31, 3: 11}.get(len(box.names), 3))
    if not system.order:
        return -math.inf, points[0]
    level = pole_margins(system.matrices(points)[0], system.sample_time is not None)
    worst = int(level.argmax())
    return float(level[worst]), points[worst]
