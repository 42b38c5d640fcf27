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
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from lpvid import _checks
from lpvid.analysis.uncertain_blocks import PSD, Block, block_from_dict
from lpvid.errors import InputError
from lpvid.lmi.affine import given
from lpvid.lmi.certificate import Recheck, diagonal
from lpvid.lmi.certificate_common import StorageCertificate, certificate_kind, describe_box
from lpvid.lmi.driven import Driven, driven
from lpvid.lmi.inequality import LyapunovInequality, Pieces, recheck_inequality
from lpvid.lmi.readings import box_of
from lpvid.lmi.storage import Storage
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Scheduling


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


def places(base: Driven, blocks: Sequence[Block]) -> tuple[list[int], list[int], list[int], list[int]]:
    """Which inputs and outputs of a system belong to its blocks.

    Parameters
    ----------
    base : Driven
        The system.
    blocks : sequence of Block
        Its blocks.

    Returns
    -------
    tuple of lists
        Places of p and w among the inputs, of q and z among the outputs.
    """
    p = [base.inputs.index(n) for b in blocks for n in b.inputs]
    q = [base.outputs.index(n) for b in blocks for n in b.outputs]
    return (p, [i for i in range(len(base.inputs)) if i not in p],
            q, [i for i in range(len(base.outputs)) if i not in q])


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
    for own, side in ((base.inputs, "inputs"), (base.outputs, "outputs")):
        used = [n for b in blocks for n in getattr(b, side)]
        for n in used:
            _checks.known_name(n, own, side[:-1])
        if side == "inputs" and len(set(used)) != len(used):
            raise InputError("two blocks of uncertainty drive one input", got=", ".join(used))
        if not set(own) - set(used):
            raise InputError(f"no {side} of the system are left for a gain", got=", ".join(own))
    p, w, q, z = places(base, blocks)
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
    power: int = 2

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
        at = self.storage.box.centre[None, :]
        still = np.full((1, at.shape[1]), 0.5)
        scale = diagonal(root, np.eye(len(self.system.inputs)))
        value = self.evaluate(at, still, scale)[0][0, 0]
        return scale / np.sqrt(np.maximum(np.abs(np.diag(value)), 1e-12 * np.abs(value).max()))[:, None]


@dataclass(frozen=True, eq=False, repr=False)
class RobustCertificate(StorageCertificate):
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
    blocks: tuple[Block, ...] = field(metadata={"read": lambda data, _: tuple(block_from_dict(b) for b in data)})
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

    SCHEMA = "lpvid/robust-certificate/1"
    NOUN = "a robust certificate"
    JSON = (("schema", "SCHEMA"), "claim", ...)

    @cached_property
    def kind(self) -> str:  # type: ignore[override]
        """Sort of storage function."""
        return certificate_kind(self.storage)

    @property
    def claim(self) -> str:
        """What the certificate states, in words."""
        kinds = ", ".join(f"{type(b).__name__} {'/'.join(b.inputs)}" for b in self.blocks)
        return (f"gain from {self.signals} at most {self.gamma:.6g} for every {kinds}"
                f"{describe_box(self.box, self.kind)}{self.where}")

    def subject(self, model: LPVStateSpace) -> Uncertain:
        also = tuple(n for n in self.basis.names if n in model.box.names)
        return uncertain(model, self.blocks, self.poles, also)

    def fault(self, model: LPVStateSpace, subject: Uncertain) -> str:
        if subject.whole.digest != self.model_hash or subject.base.sample_time != self.sample_time:
            return "the certificate was made for another model"
        if (self.inputs, self.outputs) != (subject.inputs, subject.outputs):
            return "the certificate names other signals than the model has"
        if self.box.names != box_of(subject.whole.readings, model.box).names:
            return "the certificate names other scheduling variables than the model"
        return ""

    def recheck(self, model: LPVStateSpace, subject: Uncertain) -> Recheck:
        return recheck_robust(subject, self.storage, self.multipliers, self.gamma)


def recheck_robust(system: Uncertain, storage: Storage, parts: Sequence[Sequence[np.ndarray]],
                   gamma: float) -> Recheck:
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
    return recheck_inequality(RobustBound(system.whole, storage, weight, system.uncertain, gamma))
