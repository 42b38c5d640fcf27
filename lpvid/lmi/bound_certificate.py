"""Certificates of an H2 norm, a decay rate or a region of the frozen poles, re-checked with numpy alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from lpvid import _checks
from lpvid.codec import UNWRITTEN
from lpvid.errors import InputError
from lpvid.lmi.bounds import DecayBound, H2Bound, RegionBound
from lpvid.lmi.certificate import Recheck
from lpvid.lmi.certificate_common import StorageCertificate, describe_box, describe_set, polytope_fault
from lpvid.lmi.driven import Driven
from lpvid.lmi.inequality import LyapunovInequality
from lpvid.lmi.polytope_positivity import recheck_on
from lpvid.lmi.storage import Storage
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Scheduling

QUANTITIES = ("h2-norm", "decay-rate", "pole-region")


@dataclass(frozen=True, eq=False, repr=False)
class BoundCertificate(StorageCertificate):
    """A storage function xᵀP(p)x with what it proves about a model.

    Parameters
    ----------
    quantity : str
        "h2-norm" (at most `level`), "decay-rate" (at least `level` [1/s]) or "pole-region" (all frozen poles inside).
    level : float
        Not used for a region.
    region : (L, M) or None
        The region {s : L + sM + s̄Mᵀ ≺ 0}.
    kind, matrices, basis, box, sample_time, model_hash, inputs, outputs, margin, between_grid, solver
        As in `GainCertificate`.
    vertices : (V, len(box.names)) array or None
        Of a polytope in which the scheduling stays, in place of the box, which then encloses it.
    """

    quantity: str
    level: float
    region: tuple[np.ndarray, np.ndarray] | None
    kind: str
    matrices: np.ndarray
    basis: Basis
    box: Scheduling
    sample_time: float | None
    model_hash: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    margin: float
    between_grid: bool
    solver: str = ""
    vertices: np.ndarray | None = field(default=None, metadata=UNWRITTEN)

    SCHEMA = "lpvid/bound-certificate/1"
    NOUN = "a bound certificate"

    def __post_init__(self) -> None:
        super().__post_init__()
        _checks.one_of(self.quantity, QUANTITIES, "what a certificate bounds")
        if self.region is not None:
            fixed, varying = (_checks.frozen_array(x, "a region", ndim=2) for x in self.region)
            object.__setattr__(self, "region", (fixed, varying))

    @property
    def claim(self) -> str:
        """What the certificate states, in words."""
        covered = describe_set(self.box, self.vertices, self.kind)
        if self.quantity == "h2-norm":
            text = f"H2 norm from {self.signals} at most {self.level:.6g}{covered}"
        elif self.quantity == "decay-rate":
            text = f"the state decays at least as exp(-{self.level:.6g} t){covered}"
        else:
            held = covered if self.vertices is not None else describe_box(self.box, "")
            held = held.replace("trajectory", "held value").replace(", however fast it moves", "")
            text = f"all poles lie in the region{held}"
        return text + self.where

    def fault(self, model: LPVStateSpace, subject: Driven) -> str:
        fault = super().fault(model, subject)
        if not fault and not math.isfinite(self.level):
            fault = "the certificate holds a bound that is not finite"
        if not fault and self.quantity == "h2-norm" and not (self.level > 0 and has_h2_norm(subject)):
            fault = "the model has no H2 norm"
        return fault or polytope_fault(self.vertices, self.storage, subject)

    def recheck(self, model: LPVStateSpace, subject: Driven) -> Recheck:
        problem = inequality_of(self.quantity, self.level, self.region)(subject, self.storage)
        return recheck_on(problem, self.vertices)


def inequality_of(quantity: str, level: float, region: tuple[np.ndarray, np.ndarray] | None
                  ) -> Callable[[Driven, Storage], LyapunovInequality]:
    """What has to be positive definite.

    Parameters
    ----------
    quantity : str
        One of `QUANTITIES`.
    level : float
        ν of an H2 norm, or a decay rate [1/s]; not used for a region.
    region : (L, M) or None
        Of a pole region; not used otherwise.

    Returns
    -------
    callable
        From a system and a storage function to the inequality.

    Raises
    ------
    InputError
        A pole region without its matrices.
    """
    if quantity == "h2-norm":
        return lambda system, storage: H2Bound(system, storage, level)
    if quantity == "decay-rate":
        return lambda system, storage: DecayBound(system, storage, level)
    if region is None:
        raise InputError("a certificate of a pole region needs the region", got="none")
    return lambda system, storage: RegionBound(system, storage, *region)


def has_h2_norm(system: Driven) -> bool:
    """Discrete, or without feedthrough.

    Parameters
    ----------
    system : Driven
        Its D is looked at.

    Returns
    -------
    bool
        False in continuous time with a direct path from white noise to the outputs: the norm is then infinite.
    """
    n = system.order
    return system.sample_time is not None or not system.coefficients[:, n:, n:].any()
