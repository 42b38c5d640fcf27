"""Certificates of an H2 norm, a decay rate or a region of the frozen poles, re-checked with numpy alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.lmi.bounds import DecayBound, H2Bound, RegionBound
from lpvid.lmi.certificate import Recheck
from lpvid.lmi.certificate_common import certificate_kind, describe_box, misfit, reproduced
from lpvid.lmi.driven import Driven, driven
from lpvid.lmi.inequality import LyapunovInequality, recheck_inequality
from lpvid.lmi.storage import Storage
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Scheduling, basis_from_dict

SCHEMA = "lpvid/bound-certificate/1"
QUANTITIES = ("h2-norm", "decay-rate", "pole-region")


@dataclass(frozen=True, eq=False)
class BoundCertificate:
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

    def __post_init__(self) -> None:
        _checks.one_of(self.quantity, QUANTITIES, "what a certificate bounds")
        object.__setattr__(self, "matrices", _checks.frozen_array(self.matrices, "matrices", ndim=3))
        if self.region is not None:
            fixed, varying = (_checks.frozen_array(x, "a region", ndim=2) for x in self.region)
            object.__setattr__(self, "region", (fixed, varying))

    @property
    def claim(self) -> str:
        """What the certificate states, in words."""
        where, signals = describe_box(self.box, self.kind), f"{', '.join(self.inputs)} to {', '.join(self.outputs)}"
        if self.quantity == "h2-norm":
            text = f"H2 norm from {signals} at most {self.level:.6g}{where}"
        elif self.quantity == "decay-rate":
            text = f"the state decays at least as exp(-{self.level:.6g} t){where}"
        else:
            held = describe_box(self.box, "").replace("trajectory", "held value").replace(", however fast it moves", "")
            text = f"all poles lie in the region{held}"
        return text + ("" if self.between_grid else "; shown at the points of a grid only, not proven between them")

    def check(self, model: LPVStateSpace) -> Recheck:
        """Recompute the claim for a model; it holds only if every number in it can be reproduced."""
        system = driven(model, tuple(n for n in self.basis.names if n in model.box.names))
        fault = misfit(self, system)
        if not fault and not math.isfinite(self.level):
            fault = "the certificate holds a bound that is not finite"
        if not fault and self.quantity == "h2-norm" and not (self.level > 0 and has_h2_norm(system)):
            fault = "the model has no H2 norm"
        if fault:
            return Recheck(False, False, math.nan, fault)
        storage = Storage(self.matrices, self.basis, self.box, self.sample_time)
        problem = inequality_of(self.quantity, self.level, self.region)(system, storage)
        return reproduced(self, certificate_kind(storage), recheck_inequality(problem))

    def to_dict(self) -> dict:
        """Plain data for JSON; `lpvid.verify` needs nothing else but the model.

        Returns
        -------
        dict
            What `from_dict` reads; arrays as lists.
        """
        region = None if self.region is None else [x.tolist() for x in self.region]
        return {"schema": SCHEMA, "kind": self.kind, "quantity": self.quantity, "claim": self.claim,
                "level": self.level, "region": region, "matrices": self.matrices.tolist(),
                "order": self.matrices.shape[1], "basis": self.basis.to_dict(), "box": self.box.to_dict(),
                "sample_time": self.sample_time, "model_hash": self.model_hash, "inputs": list(self.inputs),
                "outputs": list(self.outputs), "margin": self.margin, "between_grid": self.between_grid,
                "solver": self.solver}

    @classmethod
    def from_dict(cls, data: Mapping) -> BoundCertificate:
        """Inverse of `to_dict`.

        Parameters
        ----------
        data : mapping
            What `to_dict` returned.

        Returns
        -------
        BoundCertificate
            With the same values.

        Raises
        ------
        InputError
            Another schema.
        """
        if data.get("schema") != SCHEMA:
            raise InputError("not a bound certificate of this version", got=data.get("schema"))
        n, matrices, region = data["order"], np.asarray(data["matrices"], dtype=float), data["region"]
        return cls(data["quantity"], data["level"], None if region is None else (np.array(region[0], dtype=float),
                                                                                 np.array(region[1], dtype=float)),
                   data["kind"], matrices.reshape(len(data["matrices"]), n, n), basis_from_dict(data["basis"]),
                   Scheduling.from_dict(data["box"]), data["sample_time"], data["model_hash"], tuple(data["inputs"]),
                   tuple(data["outputs"]), data["margin"], data["between_grid"], data["solver"])

    def __repr__(self) -> str:
        return (f"certified{'' if self.between_grid else ' on a grid only'}: {self.claim}\n"
                f"  {self.kind} storage function; margin {self.margin:.3g}, re-checked with numpy")


def inequality_of(quantity: str, level: float, region: tuple[np.ndarray, np.ndarray] | None
                  ) -> Callable[[Driven, Storage], LyapunovInequality]:
    """What has to be positive definite."""
    if quantity == "h2-norm":
        return lambda system, storage: H2Bound(system, storage, level)
    if quantity == "decay-rate":
        return lambda system, storage: DecayBound(system, storage, level)
    if region is None:
        raise InputError("a certificate of a pole region needs the region", got="none")
    return lambda system, storage: RegionBound(system, storage, *region)


def has_h2_norm(system: Driven) -> bool:
    """Discrete, or without feedthrough."""
    n = system.order
    return system.sample_time is not None or not system.coefficients[:, n:, n:].any()
