"""Certificates of a gain that holds for every uncertainty of given kinds, re-checked with numpy alone.

With the filters Ψ of all blocks, ξ = (x, ψ) the states of system and filters, r = C_r ξ + D_rp p + D_rw w:

    P(p) ≻ 0    [He(PA) + Ṗ  PB_p  PB_w]
                [⋆           0     0   ] + [C_r D_rp D_rw]ᵀ M [C_r D_rp D_rw] + γ⁻¹[C_z D_zp D_zw]ᵀ[C_z D_zp D_zw] ≺ 0
                [⋆           ⋆     −γI ]

(AᵀP⁺A − P and so on in discrete time) proves ‖z‖ ≤ γ‖w‖ from rest, for every Δ whose constraints hold over every
horizon: integrate it along a trajectory (Pfifer & Seiler 2016, theorem 2).
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from lpvid import _checks
from lpvid.analysis.uncertain_blocks import PSD, Block, block_from_dict, diagonal
from lpvid.errors import InputError
from lpvid.lmi.affine import Affine
from lpvid.lmi.certificate import Recheck
from lpvid.lmi.certificate_common import certificate_kind, describe_box
from lpvid.lmi.driven import Driven, driven
from lpvid.lmi.inequality import LyapunovInequality, Pieces, recheck_inequality
from lpvid.lmi.readings import box_of
from lpvid.lmi.storage import Storage
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Scheduling, basis_from_dict

SCHEMA = "lpvid/robust-certificate/1"


@dataclass(frozen=True, eq=False)
class Uncertain:
    """A system with its blocks and their filters: inputs (p, w), outputs (r, z).

    Parameters
    ----------
    base : Driven
        The system by itself.
    blocks : tuple of Block
    poles : tuple of float
        Of the filters [1/s].
    whole : Driven
        With the filters' states behind the system's.
    """

    base: Driven
    blocks: tuple[Block, ...]
    poles: tuple[float, ...]
    whole: Driven

    @property
    def uncertain(self) -> int:
        """Number of signals p."""
        return sum(len(b.inputs) for b in self.blocks)

    @property
    def filtered(self) -> int:
        """Number of signals r."""
        return len(self.whole.outputs) - len(self.outputs)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of w."""
        return self.whole.inputs[self.uncertain:]

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of z."""
        seen = {n for b in self.blocks for n in b.outputs}
        return tuple(n for n in self.base.outputs if n not in seen)

    def multiplier(self, parts: Sequence[Sequence[np.ndarray]]) -> np.ndarray:
        """(r, r) M of given matrices.

        Parameters
        ----------
        parts : sequence of sequences of (k, k) arrays
            For each block the matrices that its `unknowns` name.

        Returns
        -------
        (r, r) array
            Block diagonal over the blocks.
        """
        return diagonal(*(b.multiplier([given(x) for x in own], self.poles).constant
                            for b, own in zip(self.blocks, parts, strict=True)))


def given(matrix: np.ndarray) -> Affine:
    """A known matrix where an unknown one could stand.

    Parameters
    ----------
    matrix : (m, n) array
        Known values.

    Returns
    -------
    Affine
        The matrix, without unknowns.
    """
    return Affine(np.asarray(matrix, dtype=float), sparse.csr_array((np.size(matrix), 0)))


def uncertain(model: LPVStateSpace, blocks: Sequence[Block], poles: Sequence[float], also: tuple[str, ...] = ()
              ) -> Uncertain:
    """The system joined to the filters of its blocks.

    Parameters
    ----------
    model : LPVStateSpace
        With the channels p, w → q, z.
    blocks : sequence of Block
        Which inputs each drives from which outputs.
    poles : sequence of float
        Poles of the multipliers' filters, as `Block.filter` takes them.
    also : tuple of str
        Further scheduling variables to keep, which the storage function depends on.

    Returns
    -------
    Uncertain
        System, filters and multipliers in one.

    Raises
    ------
    InputError
        Unknown signals, signals in two blocks, nothing left of w or z.
    """
    base, blocks = driven(model, also), tuple(blocks)
    for own, field in ((base.inputs, "inputs"), (base.outputs, "outputs")):
        used = [n for b in blocks for n in getattr(b, field)]
        for n in used:
            _checks.known_name(n, own, field[:-1])
        if field == "inputs" and len(set(used)) != len(used):
            raise InputError("two blocks of uncertainty drive one input", got=", ".join(used))
        if not set(own) - set(used):
            raise InputError(f"no {field} of the system are left for a gain", got=", ".join(own))
    p = [base.inputs.index(n) for b in blocks for n in b.inputs]
    w = [i for i in range(len(base.inputs)) if i not in p]
    q = [base.outputs.index(n) for b in blocks for n in b.outputs]
    z = [i for i in range(len(base.outputs)) if i not in q]
    filters = [b.filter(poles, base.sample_time) for b in blocks]
    fa, fc = (diagonal(*(f[i] for f in filters)) for i in (0, 2))
    order, rows = sum(len(f[1]) for f in filters), sum(len(f[3]) for f in filters)
    fb, fd = (diagonal(*(f[i][:, : len(b.outputs)] for f, b in zip(filters, blocks, strict=True))) for i in (1, 3))
    gb, gd = (diagonal(*(f[i][:, len(b.outputs):] for f, b in zip(filters, blocks, strict=True))) for i in (1, 3))
    n = base.order
    pw = [n + i for i in (*p, *w)]
    found = np.zeros((len(base.coefficients), n + order + rows + len(z), n + order + len(pw)))
    for m, s in enumerate(base.coefficients):
        seen = s[[n + i for i in q]]
        found[m, :n, :n], found[m, :n, n + order :] = s[:n, :n], s[:n, pw]
        for top, into in ((slice(n, n + order), fb), (slice(n + order, n + order + rows), fd)):
            found[m, top, :n], found[m, top, n + order :] = into @ seen[:, :n], into @ seen[:, pw]
        out = s[[n + i for i in z]]
        found[m, n + order + rows :, :n], found[m, n + order + rows :, n + order :] = out[:, :n], out[:, pw]
    found[-1, n : n + order, n : n + order] += fa
    found[-1, n : n + order, n + order : n + order + len(p)] += gb
    found[-1, n + order : n + order + rows, n : n + order] += fc
    found[-1, n + order : n + order + rows, n + order : n + order + len(p)] += gd
    text = json.dumps([base.digest, [b.to_dict() for b in blocks], [float(x) for x in poles]], sort_keys=True)
    names = tuple(base.inputs[i] for i in (*p, *w))
    outs = (*(f"r{i + 1}" for i in range(rows)), *(base.outputs[i] for i in z))
    whole = Driven(found, n + order, base.basis, base.readings, base.sample_time,
                   hashlib.sha256(text.encode()).hexdigest(), names, outs)
    return Uncertain(base, blocks, tuple(float(x) for x in poles), whole)


@dataclass(frozen=True, eq=False)
class RobustBound(LyapunovInequality):
    """The inequality of this module for a storage function, multipliers and γ > 0.

    Parameters
    ----------
    system : Driven
        The system with the filters of its blocks; inputs (p, w), outputs (r, z).
    storage : Storage
        Its P(p).
    weight : (r + z, r + z) array
        diag(M, γ⁻¹I).
    uncertain : int
        Number of signals p.
    gamma : float
        The gain bound, positive.
    """

    system: Driven
    storage: Storage
    weight: np.ndarray
    """(p + w + …) diag(M, γ⁻¹I) over (r, z)."""
    uncertain: int
    gamma: float

    @property
    def power(self) -> int:  # type: ignore[override]
        """Degree in the system's matrices."""
        return 2

    def matrix(self, pieces: Pieces) -> np.ndarray:
        q, s = pieces, pieces.sign
        weight = self.weight if s < 0 else np.abs(self.weight)
        both = np.concatenate([q.A, q.B], axis=3)
        n, total = q.A.shape[3], both.shape[3]
        if self.system.sample_time is None:
            state = q.P @ both
            flow = np.zeros((*q.later.shape[:2], total, total))
            flow[:, :, :n] += state
            flow[:, :, :, :n] += state.swapaxes(2, 3)
            flow[:, :, :n, :n] += q.later
        else:
            flow = both.swapaxes(2, 3) @ q.later @ both
            flow[:, :, :n, :n] = flow[:, :, :n, :n] + s * q.P
        out = np.concatenate([q.C, q.D], axis=3)
        supply = np.diag(np.r_[np.zeros(n + self.uncertain), np.full(total - n - self.uncertain, self.gamma)])
        return s * (flow + out.swapaxes(2, 3) @ weight @ out) + supply

    def congruence(self, root: np.ndarray) -> np.ndarray:
        n, size = len(root), len(root) + len(self.system.inputs)
        at = self.storage.box.centre[None, :]
        still = np.full((1, at.shape[1]), 0.5)
        scale = np.eye(size)
        scale[:n, :n] = root
        value = self.evaluate(at, still, scale)[0][0, 0]
        return scale / np.sqrt(np.maximum(np.abs(np.diag(value)), 1e-12 * np.abs(value).max()))[:, None]


@dataclass(frozen=True, eq=False)
class RobustCertificate:
    """A storage function and multipliers that bound a gain for every uncertainty of given kinds.

    Parameters
    ----------
    gamma : float
        Bound of ‖z‖/‖w‖.
    matrices : (K, n, n) array
        P(p) over the states of system and filters.
    multipliers : tuple of tuples of arrays
        For each block the matrices of its M.
    blocks : tuple of Block
    poles : tuple of float
        [1/s]
    basis, box, sample_time, model_hash, inputs, outputs, margin, between_grid, solver
        As in `GainCertificate`.
    """

    gamma: float
    matrices: np.ndarray
    multipliers: tuple[tuple[np.ndarray, ...], ...]
    blocks: tuple[Block, ...]
    poles: tuple[float, ...]
    basis: Basis
    box: Scheduling
    sample_time: float | None
    model_hash: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    margin: float
    between_grid: bool
    solver: str = ""

    @cached_property
    def kind(self) -> str:
        """Sort of storage function."""
        return certificate_kind(Storage(self.matrices, self.basis, self.box, self.sample_time))

    @property
    def claim(self) -> str:
        """What the certificate states, in words."""
        kinds = ", ".join(f"{type(b).__name__} {'/'.join(b.inputs)}" for b in self.blocks)
        text = (f"gain from {', '.join(self.inputs)} to {', '.join(self.outputs)} at most {self.gamma:.6g} for every "
                f"{kinds}")
        text += describe_box(self.box, self.kind)
        return text + ("" if self.between_grid else "; shown at the points of a grid only, not proven between them")

    def check(self, model: LPVStateSpace) -> Recheck:
        """Recompute the claim for a model; it holds only if every number in it can be reproduced.

        Parameters
        ----------
        model : LPVStateSpace
            The system that the certificate is about.

        Returns
        -------
        Recheck
            Whether the claim holds, its margin, and why where it does not. For another model it does not hold.
        """
        also = tuple(n for n in self.basis.names if n in model.box.names)
        system = uncertain(model, self.blocks, self.poles, also)
        if system.whole.digest != self.model_hash or system.base.sample_time != self.sample_time:
            return Recheck(False, False, math.nan, "the certificate was made for another model")
        if (self.inputs, self.outputs) != (system.inputs, system.outputs):
            return Recheck(False, False, math.nan, "the certificate names other signals than the model has")
        if self.box.names != box_of(system.whole.readings, model.box).names:
            return Recheck(False, False, math.nan, "the certificate names other scheduling variables than the model")
        found = recheck_robust(system, Storage(self.matrices, self.basis, self.box, self.sample_time),
                               self.multipliers, self.gamma)
        if found.holds and self.between_grid and not found.between_grid:
            return Recheck(False, False, found.margin, "the claim between grid points cannot be reproduced")
        if found.holds and not self.margin <= found.margin * (1 + 1e-6) + 1e-12:
            return Recheck(False, found.between_grid, found.margin, f"a margin of {self.margin:.3g} is claimed")
        return found

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            The certificate under its schema; arrays as lists.
        """
        return {"schema": SCHEMA, "claim": self.claim, "gamma": self.gamma, "matrices": self.matrices.tolist(),
                "multipliers": [[m.tolist() for m in own] for own in self.multipliers],
                "blocks": [b.to_dict() for b in self.blocks], "poles": list(self.poles), "basis": self.basis.to_dict(),
                "box": self.box.to_dict(), "sample_time": self.sample_time, "model_hash": self.model_hash,
                "inputs": list(self.inputs), "outputs": list(self.outputs), "margin": self.margin,
                "between_grid": self.between_grid, "solver": self.solver}

    @classmethod
    def from_dict(cls, data: Mapping) -> RobustCertificate:
        """Inverse of `to_dict`.

        Parameters
        ----------
        data : mapping
            What `to_dict` returned.

        Returns
        -------
        RobustCertificate
            The same certificate; nothing in it is checked again.

        Raises
        ------
        InputError
            Another schema.
        """
        if data.get("schema") != SCHEMA:
            raise InputError("not a robust certificate of this version", got=data.get("schema"))
        multipliers = tuple(tuple(np.array(m, dtype=float) for m in own) for own in data["multipliers"])
        return cls(data["gamma"], np.array(data["matrices"], dtype=float), multipliers,
                   tuple(block_from_dict(b) for b in data["blocks"]), tuple(data["poles"]),
                   basis_from_dict(data["basis"]), Scheduling.from_dict(data["box"]), data["sample_time"],
                   data["model_hash"], tuple(data["inputs"]), tuple(data["outputs"]), data["margin"],
                   data["between_grid"], data["solver"])

    def __repr__(self) -> str:
        return (f"certified{'' if self.between_grid else ' on a grid only'}: {self.claim}\n"
                f"  margin {self.margin:.3g}, re-checked with numpy")


def recheck_robust(system: Uncertain, storage: Storage, parts: Sequence[Sequence[np.ndarray]], gamma: float, *,
                   budget: int | None = None) -> Recheck:
    """Check that multipliers are admissible and that with a storage function they prove a gain.

    Parameters
    ----------
    system : Uncertain
        System, filters and blocks.
    storage : Storage
        P(p) over the states of system and filters.
    parts : sequence of sequences of (k, k) arrays
        For each block the matrices that its `unknowns` name.
    gamma : float
        The gain from w to z that is claimed.
    budget : int, optional
        How many cells the check between grid points may look at; as for `recheck_inequality`.

    Returns
    -------
    Recheck
        Whether the claim holds, and why where it does not.
    """
    if not 0 < gamma < math.inf:
        return Recheck(False, False, math.nan, "a gain bound is positive and finite")
    for b, own in zip(system.blocks, parts, strict=True):
        wanted = b.unknowns(system.poles)
        if len(own) != len(wanted) or any(x.shape != (k, k) for x, (_, k) in zip(own, wanted, strict=True)):
            return Recheck(False, False, math.nan, "the multipliers do not fit the blocks")
        for matrix, (kind, _) in zip(own, wanted, strict=True):
            sign = 1.0 if kind == PSD else -1.0
            if not np.all(np.isfinite(matrix)) or not np.array_equal(matrix, sign * matrix.T):
                return Recheck(False, False, math.nan, f"a multiplier is not {kind}")
            rounding = 50 * len(matrix) * np.finfo(float).eps * np.abs(matrix).max(initial=0.0)
            if kind == PSD and np.linalg.eigvalsh(matrix)[0] < (rounding if len(matrix) > 1 else 0.0):
                return Recheck(False, False, math.nan, "a multiplier is not positive semidefinite")
    weight = diagonal(system.multiplier(parts), np.eye(len(system.outputs)) / gamma)
    return recheck_inequality(RobustBound(system.whole, storage, weight, system.uncertain, gamma), budget=budget)
