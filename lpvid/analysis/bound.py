"""What a search for a certified bound returns, and the search itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from lpvid.analysis.gain_bounds import ATTEMPT, worst_pole
from lpvid.codec import Encoded
from lpvid.lmi.bound_certificate import BoundCertificate, inequality_of
from lpvid.lmi.certificate import grid
from lpvid.lmi.certificate_common import Certificate, certificate_kind, verdict_of
from lpvid.lmi.driven import Driven
from lpvid.lmi.frame import Frame, frame_of
from lpvid.lmi.inequality import recheck_inequality
from lpvid.lmi.storage import Storage
from lpvid.lmi.storage_search import StorageSearch
from lpvid.scheduling import Basis, Scheduling

Region = tuple[np.ndarray, np.ndarray]
C = TypeVar("C", bound=Certificate)


@dataclass(frozen=True, eq=False)
class Bound(Encoded):
    """A quantity of an LPV system between a bound that is certified and one that is reached.

    Parameters
    ----------
    quantity : str
        "h2-norm", "decay-rate" or "pole-region".
    verdict : str
        "certified", "certified on a grid only", "not certified" or "unstable".
    lower, upper : float
        H2 norm: `upper` is certified and `lower` reached. Decay rate [1/s]: `lower` is certified, and no rate above
        `upper` is possible. Not used for a region.
    certificate : BoundCertificate or None
        What `lpvid.verify` re-checks.
    why : str
    """

    JSON = ("quantity", "verdict", "lower", "upper", "between_grid", "why", "certificate")

    quantity: str
    verdict: str
    lower: float
    upper: float
    certificate: BoundCertificate | None
    why: str = ""

    @property
    def certified(self) -> bool:
        """There is a certificate."""
        return self.certificate is not None

    @property
    def between_grid(self) -> bool:
        """Proven on the whole scheduling box."""
        return self.certificate is not None and self.certificate.between_grid

    def __repr__(self) -> str:
        if self.certificate is None:
            return f"{self.verdict}: {self.why}"
        lines = [f"{self.verdict}: {self.certificate.claim}"]
        if self.quantity == "h2-norm":
            lines.append(f"  at least {self.lower:.6g}, reached with the scheduling held")
        if self.quantity == "decay-rate" and math.isfinite(self.upper):
            lines.append(f"  no faster than {self.upper:.6g} 1/s, the slowest frozen mode")
        return "\n".join([*lines, *repr(self.certificate).splitlines()[1:]])


def judged(quantity: str, certificate: BoundCertificate | None, lower: float, upper: float, why: str) -> Bound:
    """The outcome of a search.

    Parameters
    ----------
    quantity : str
        "h2-norm", "decay-rate" or "pole-region".
    certificate : BoundCertificate or None
        What the search found.
    lower, upper : float
        As in `Bound`.
    why : str
        Why there is no certificate; not used where there is one.

    Returns
    -------
    Bound
        With the verdict that goes with the certificate.
    """
    if certificate is None:
        return Bound(quantity, "not certified", lower, upper, None, why)
    verdict = verdict_of(certificate.between_grid)
    return Bound(quantity, verdict, lower, upper, certificate)


@dataclass(frozen=True, eq=False)
class BoundSearch:
    """Looks for certificates of one quantity for one system on one box.

    Parameters
    ----------
    system : Driven
    box : Scheduling
    quantity : str
    region : (L, M) or None
    """

    system: Driven
    box: Scheduling
    quantity: str
    region: Region | None = None

    def frame(self) -> Frame:
        """Coordinates for the program, signals as they are; the model's own where a frozen system is unstable.

        Returns
        -------
        Frame
            Of the frozen systems on a grid, with gain 1.
        """
        if worst_pole(self.system, self.box)[0] >= 0 or not self.system.order:
            return Frame(np.eye(self.system.order), 1.0, 1.0)
        points = grid(self.box, {0: 1, 1: 9, 2: 4}.get(len(self.box.names), 2))
        return replace(frame_of(self.system, points), gain=1.0)

    def at(self, level: float, bases: Iterable[Basis]) -> BoundCertificate | None:
        """A certificate of a level, one between grid points before one on the grid.

        Parameters
        ----------
        level : float
            H2 norm, or decay rate [1/s]; not used for a region.
        bases : iterable of Basis
            Of the storage function, in the order in which they are tried.

        Returns
        -------
        BoundCertificate or None
            None where no basis gives one.
        """
        return first_proven(self._proposed(level, bases))

    def _proposed(self, level: float, bases: Iterable[Basis]) -> Iterator[BoundCertificate]:
        frame = self.frame()
        scale = frame.time if self.system.sample_time is None else 1.0
        region = None if self.region is None else (self.region[0] * scale, self.region[1])
        pace = {"decay-rate": scale, "h2-norm": math.sqrt(scale)}.get(self.quantity, 1.0)
        inside = inequality_of(self.quantity, level * pace, region)
        for basis in bases:
            for density in (2.0, 4.0):
                search = StorageSearch(self.system, self.box, basis, frame, lambda _: inside, density)
                if not search.affordable:
                    return
                found = next(search.roomiest(capped=self.quantity != "h2-norm"), None)
                if found is None or not found.margin > 1e-9:
                    break
                certificate = self.checked(found.matrices, basis, level, found.solver)
                if certificate is not None:
                    yield certificate

    def checked(self, matrices: np.ndarray, basis: Basis, level: float, solver: str) -> BoundCertificate | None:
        """The certificate, if numpy agrees.

        Parameters
        ----------
        matrices : (K, n, n) array
            P over the basis, in the model's own coordinates.
        basis : Basis
            The K functions.
        level : float
            H2 norm, or decay rate [1/s]; not used for a region.
        solver : str
            What proposed the matrices.

        Returns
        -------
        BoundCertificate or None
            None where the inequality does not hold.
        """
        storage = Storage(matrices, basis, self.box, self.system.sample_time)
        problem = inequality_of(self.quantity, level, self.region)(self.system, storage)
        outcome = recheck_inequality(problem, budget=ATTEMPT)
        if not outcome.holds:
            return None
        return BoundCertificate(self.quantity, level, self.region, certificate_kind(storage), matrices, basis, self.box,
                                self.system.sample_time, self.system.digest, self.system.inputs, self.system.outputs,
                                outcome.margin, outcome.between_grid, solver)


def first_proven(found: Iterable[C]) -> C | None:
    """The first certificate that holds between grid points, else the first that holds on a grid.

    Parameters
    ----------
    found : iterable of certificates
        In the order of preference; it is left where one between grid points is met.

    Returns
    -------
    certificate or None
        None where there is none.
    """
    on_grid: C | None = None
    for certificate in found:
        if certificate.between_grid:
            return certificate
        on_grid = on_grid or certificate
    return on_grid


def scaled_outputs(system: Driven, factor: float) -> Driven:
    """The system with outputs times a factor.

    Parameters
    ----------
    system : Driven
        w → z.
    factor : float
        Of C and D.

    Returns
    -------
    Driven
        Same states and inputs; its digest stays that of `system`.
    """
    moved = system.coefficients.copy()
    moved[:, system.order :] *= factor
    return replace(system, coefficients=moved)


def largest(holds: Callable[[float], bool], low: float, high: float, steps: int) -> float:
    """The largest value found at which `holds`, by bisection between one where it does and one where it may not.

    Parameters
    ----------
    holds : callable
        From a value to bool; true below some value, false above it.
    low : float
        Where it holds.
    high : float
        Where it may not; never returned.
    steps : int
        Bisections, each of which halves the interval.

    Returns
    -------
    float
        At least `low`.
    """
    for _ in range(steps):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
