"""What a stability certificate holds, states and stores."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from lpvid.analysis.divergence import Divergence
from lpvid.codec import UNWRITTEN, null
from lpvid.lmi.bounds import recheck_decrease, recheck_decrease_at
from lpvid.lmi.certificate import Recheck
from lpvid.lmi.certificate_common import StorageCertificate, describe_set, polytope_fault, verdict_of
from lpvid.lmi.driven import Driven, Model, autonomous
from lpvid.scheduling import Polynomial, Scheduling


@dataclass(frozen=True, eq=False)
class StabilityCertificate(StorageCertificate):
    """A Lyapunov function V = xᵀP(p)x that decreases along every admissible trajectory, or the lack of one.

    The state x is [y(k−1) … y(k−na)] for a transfer function with coefficients at p(k), the observer state for one
    with coefficients at p(k−i), and the model's own state for a state space. Inputs and affine terms are zero.

    Parameters
    ----------
    kind : str
        "quadratic" (one P), "poly-quadratic" (P(p), arbitrary jumps), "parameter-dependent" (P(p), bounded rate),
        or "none".
    matrices : (K, n, n) array
        P(p) = Σ_k matrices[k] ψ_k(p), with ψ_k the functions of `basis`.
    basis : Polynomial
    box : Scheduling
        Range and rate bounds [units per second] requested; a variable read at several times has an entry for each.
    sample_time : float or None
    model_hash : str
        sha256 of the coefficients, the basis and the sampling time it was made for.
    verified : bool
        The inequality was re-checked with numpy and holds.
    margin : float
        Smallest eigenvalue of the inequality after the congruence that makes P at the centre the identity, less a
        bound of the rounding errors (a pure number; 1/s in continuous time). Not a number where there is no P.
    between_grid : bool
        Proven on the whole box, not only on the points of a grid.
    decay_rate : float
        α [1/s]: sqrt(V) decreases at least as exp(−αt); 0 where nothing is known.
    divergence : Divergence or None
        Not certified: a trajectory along which the model grows, if one was found.
    solver : str
        What proposed the matrices.
    vertices : (V, len(box.names)) array or None
        Of a polytope in which the scheduling stays, in place of the box (which then encloses it): one P that serves at
        its vertices, of a system that is affine in its readings, serves at all their mixtures.
    """

    kind: str
    matrices: np.ndarray
    basis: Polynomial
    box: Scheduling
    sample_time: float | None
    model_hash: str
    verified: bool
    margin: float = field(metadata=null(math.nan))
    between_grid: bool
    decay_rate: float
    divergence: Divergence | None = None
    solver: str = ""
    vertices: np.ndarray | None = field(default=None, metadata=UNWRITTEN)

    SCHEMA = "lpvid/stability-certificate/1"
    NOUN = "a stability certificate"
    JSON = (("schema", "SCHEMA"), "verdict", "claim", ..., "order", "rate_bound", ("decay_per_sample", "decay"),
            "time_constant")
    inputs = outputs = ()

    @property
    def rate_bound(self) -> dict[str, float | None]:
        """Rate bounds of the box by variable."""
        return dict(zip(self.box.names, self.box.rate, strict=True))

    @property
    def decay(self) -> float | None:
        """Factor per sample by which sqrt(V) decreases at least; None in continuous time or where nothing is known."""
        known = self.sample_time is not None and self.decay_rate > 0
        return math.exp(-self.decay_rate * self.sample_time) if known and self.sample_time else None

    @property
    def time_constant(self) -> float | None:
        """1/α [s], or None where nothing is known."""
        return 1 / self.decay_rate if self.decay_rate > 0 else None

    @property
    def verdict(self) -> str:
        """"certified", "certified on a grid only" or "not certified"."""
        return verdict_of(self.between_grid, self.verified)

    @property
    def claim(self) -> str:
        """What the certificate states, in words."""
        if not self.verified:
            return "no statement about a moving scheduling variable"
        covered = describe_set(self.box, self.vertices, self.kind)
        return (f"with zero input the state decays{covered}" if covered else "the state decays") + self.where

    def subject(self, model: Model) -> Driven:
        return autonomous(model)

    def fault(self, model: Model, subject: Driven) -> str:
        if not self.verified or self.kind == "none":
            return "the certificate makes no claim"
        fault = super().fault(model, subject)
        fault = fault or polytope_fault(self.vertices, self.storage, subject)
        return fault or ("" if self.decay_rate >= 0 else "the certificate holds a negative rate")

    def decrease(self, subject: Driven, exponent: float = 0.0, *, budget: int | None = None) -> Recheck:
        """What numpy finds about the decrease at least as exp(−αt), on the box or on the polytope.

        Parameters
        ----------
        subject : Driven
        exponent : float
            α [1/s].
        budget : int, optional
            Matrices that subdivision may examine.

        Returns
        -------
        Recheck
        """
        if self.vertices is None:
            return recheck_decrease(subject, self.storage, exponent, budget=budget)
        if not self.basis.names and not subject.affine:
            return Recheck(False, False, math.nan, "the model is not affine in its scheduling: vertices do not decide")
        return recheck_decrease_at(subject, self.storage, self.vertices, exponent, budget=budget)

    def recheck(self, model: Model, subject: Driven) -> Recheck:
        found = self.decrease(subject)
        if found.holds and self.decay_rate:
            pace = self.decrease(subject, self.decay_rate)
            if not pace.holds or pace.between_grid < self.between_grid:
                return replace(found, holds=False, why="the claimed decay cannot be reproduced")
        return found

    def __repr__(self) -> str:
        lines = [f"{self.verdict}: {self.claim}"]
        if self.verified:
            pace = f", {self.decay:.6g} per sample" if self.decay else ""
            if self.time_constant:
                lines.append(f"  at least as exp(-t/{self.time_constant:.4g} s){pace}")
            degree = f", P of degree {self.basis.degree}" if self.basis.degree else ""
            lines.append(f"  {self.kind} Lyapunov function{degree}; margin {self.margin:.3g}, re-checked with numpy")
        elif self.divergence is not None:
            lines.append(f"  the model {self.divergence}")
        else:
            lines.append("  no trajectory that grows was found either: stability is open here")
        return "\n".join(lines)


@dataclass(frozen=True)
class Verification:
    """Outcome of `verify`.

    Parameters
    ----------
    holds : bool
        The certificate is for this model and every number in it can be reproduced.
    margin : float
        Recomputed, as in `StabilityCertificate.margin`.
    between_grid : bool
        Proven on the whole box.
    why : str
        What failed, or how it was shown.
    """

    holds: bool
    margin: float
    between_grid: bool
    why: str

    def __str__(self) -> str:
        margin = f" (margin {self.margin:.3g})" if np.isfinite(self.margin) else ""
        return f"{'holds' if self.holds else 'does not hold'}: {self.why}{margin}"
