"""What a certificate of passivity holds, states and stores."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lpvid.codec import ADDED, null
from lpvid.lmi.certificate import Recheck, grid
from lpvid.lmi.certificate_common import StorageCertificate, describe_box, malformed, verdict_of
from lpvid.lmi.driven import Driven
from lpvid.lmi.inequality import recheck_inequality
from lpvid.lmi.passive_form import Dissipation, obstacle, preload, sector_basis, supplied
from lpvid.lmi.readings import box_of
from lpvid.lmi.storage import Storage
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Basis, Scheduling


@dataclass(frozen=True, eq=False)
class PassivityCertificate(StorageCertificate):
    """A storage function that no motion of input and scheduling can overdraw, or the lack of one.

    With the past x(k) = [y(k−1) − F₀ …, v(k−1), w(k−1) …] of the model and its constant preload F₀,

        V(k+1) − V(k) ≤ (y(k) − F₀) v(k),     V = x'P(p)x ≥ 0

    so that the energy given back never exceeds what is stored: Σ (y − F₀) v T ≥ −T V(0). F₀ is the force of a
    potential in the displacement, and does no net work on a closed path.

    Parameters
    ----------
    kind : str
        "quadratic" (one P), "poly-quadratic" (P(p), arbitrary jumps), "parameter-dependent" (P(p), bounded rate), or
        "none".
    matrices : (K, n, n) array
        P(p) = Σ_k matrices[k] ψ_k(p), in units of output times input.
    basis : Basis
    multiplier : (L,) array
        λ(p) ≥ 0 of the input stage's sector, affine in the scheduling [unit of the output]; empty without a stage.
    preload : float
        F₀ [unit of the output].
    box : Scheduling
        Range and rate bounds [units per second].
    sample_time : float
    model_hash : str
        sha256 of the coefficients, the basis, the stage and the sampling time it was made for.
    verified : bool
        The inequality was re-checked with numpy and holds.
    margin : float
        Smallest eigenvalue of the inequality after the congruence that makes P, and the inputs' own entries, at the
        centre of the box the identity, less a bound of the rounding errors.
    between_grid : bool
        Proven on the whole box, not only on the points of a grid.
    why : str
        What stands in the way where nothing is certified.
    solver : str
        What proposed the matrices.
    unit : str
        Of the preload, the output's.
    """

    kind: str
    matrices: np.ndarray
    basis: Basis
    multiplier: np.ndarray
    preload: float
    box: Scheduling
    sample_time: float
    model_hash: str
    verified: bool
    margin: float = field(metadata=null(math.nan))
    between_grid: bool
    why: str = ""
    solver: str = ""
    unit: str = field(default="", metadata=ADDED)

    SCHEMA = "lpvid/passivity-certificate/1"
    NOUN = "a passivity certificate"
    JSON = (("schema", "SCHEMA"), "verdict", "claim", ..., "order")
    inputs = outputs = ()

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON.

        Returns
        -------
        dict
            Without the unit where there is none: a file of before is written again as it was.
        """
        plain = super().to_dict()
        return plain if self.unit else {k: v for k, v in plain.items() if k != "unit"}

    @property
    def verdict(self) -> str:
        """"certified", "certified on a grid only" or "not certified"."""
        return verdict_of(self.between_grid, self.verified)

    @property
    def claim(self) -> str:
        """What the certificate states, in words."""
        if not self.verified:
            return "no statement on the energy that the model can give"
        text = "passive: it gives back no more energy than is stored in it" + describe_box(self.box, self.kind)
        text += f", apart from the constant output of {self.preload:.4g} {self.unit}".rstrip() if self.preload else ""
        return text + self.where

    def storage_at(self, p: np.ndarray) -> np.ndarray:
        """(N, n, n) P at scheduling values of shape (N, variables of the box).

        Parameters
        ----------
        p : (N, variables) array
            One column for each variable of the box.

        Returns
        -------
        (N, n, n) array
            In units of output times input.
        """
        return self.storage.values(np.asarray(p, dtype=float))

    def stored(self, past: np.ndarray, p: np.ndarray) -> np.ndarray:
        """(N,) energy T·V [J for m/s and N] in pasts (N, n), in order y(k−1) − F₀ …, v(k−1), w(k−1) …, at p(k).

        Parameters
        ----------
        past : (N, n) array
            Outputs less preload, then inputs with what the stage gives, the latest first.
        p : (N, variables) array
            p(k), one column for each variable of the box.

        Returns
        -------
        (N,) array
            Not negative where the certificate holds.
        """
        return self.sample_time * np.einsum("ni,nij,nj->n", past, self.storage_at(p), past)

    def subject(self, model: LPVTransferFunction) -> Driven | None:
        """The model with the multiplier in its supply; None where the certificate cannot be one for the model."""
        count = sector_basis(model).size if model.n_filter_inputs > 1 else 0
        fits = self.multiplier.shape == (count,) and bool(np.all(np.isfinite(self.multiplier)))
        return None if obstacle(model) or not fits else supplied(model, self.multiplier)

    def fault(self, model: LPVTransferFunction, subject: Driven | None) -> str:
        if not self.verified or self.kind == "none":
            return "the certificate makes no claim"
        if subject is None:
            return obstacle(model) or "the certificate's multiplier does not fit the model"
        force = preload(model)
        if force is None or abs(force - self.preload) > 1e-9 * max(abs(force), 1.0):
            return "the model's constant force is not the certificate's"
        if subject.digest != self.model_hash or model.sample_time != self.sample_time:
            return "the certificate was made for another model"
        return malformed(self.storage, subject)

    def recheck(self, model: LPVTransferFunction, subject: Driven) -> Recheck:
        return recheck_passivity(model, self.storage, self.multiplier)

    def __repr__(self) -> str:
        lines = [f"{self.verdict}: {self.claim}"]
        if self.verified:
            lines.append(f"  {self.kind} storage function; margin {self.margin:.3g}, re-checked with numpy")
        elif self.why:
            lines.append(f"  {self.why}")
        return "\n".join(lines)


def recheck_passivity(model: LPVTransferFunction, storage: Storage, multiplier: np.ndarray) -> Recheck:
    """Check with numpy alone that P(p) and λ(p) prove a model passive, between grid points where that can be decided.

    Parameters
    ----------
    model : LPVTransferFunction
    storage : Storage
        P over the box of what `supplied` reads.
    multiplier : (L,) array
        λ over `sector_basis`, affine: its sign at the corners of the box is its sign in it.

    Returns
    -------
    Recheck
        Fails, with a margin of NaN, where the multiplier is negative at a corner.
    """
    system, basis, box = supplied(model, multiplier), sector_basis(model), storage.box
    if multiplier.size:
        corners = grid(box, 2)[:, [box.names.index(n) for n in basis.names]]
        if not np.all(basis.evaluate(corners) @ multiplier >= 0):
            return Recheck(False, False, math.nan, "the multiplier of the input stage is negative somewhere in the box")
    return recheck_inequality(Dissipation(system, storage))


def reading_box(model: LPVTransferFunction, scheduling: Scheduling) -> Scheduling:
    """Box of what the inequality reads, with the rates of the scheduling.

    Parameters
    ----------
    model : LPVTransferFunction
        One of which passivity can be stated.
    scheduling : Scheduling
        The model's variables.

    Returns
    -------
    Scheduling
        One entry for each reading, the tanh stage's variable included.
    """
    return box_of(supplied(model, np.zeros(sector_basis(model).size)).readings, scheduling)
