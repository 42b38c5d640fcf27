"""What all certificates with a storage function have in common: what they cover, and when they cannot be right."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from lpvid.lmi.certificate import Recheck
from lpvid.lmi.driven import Driven
from lpvid.lmi.storage import Storage
from lpvid.scheduling import Basis, Scheduling


class _Claimed(Protocol):
    """What every re-check is compared with."""

    @property
    def kind(self) -> str: ...
    @property
    def margin(self) -> float: ...
    @property
    def between_grid(self) -> bool: ...


class Stored(_Claimed, Protocol):
    """What certificates of a system with signals hold besides."""

    @property
    def matrices(self) -> np.ndarray: ...
    @property
    def basis(self) -> Basis: ...
    @property
    def box(self) -> Scheduling: ...
    @property
    def sample_time(self) -> float | None: ...
    @property
    def model_hash(self) -> str: ...
    @property
    def inputs(self) -> tuple[str, ...]: ...
    @property
    def outputs(self) -> tuple[str, ...]: ...


def misfit(certificate: Stored, system: Driven) -> str:
    """Why a certificate cannot be one for a model; empty if it can."""
    if certificate.model_hash != system.digest or certificate.sample_time != system.sample_time:
        return "the certificate was made for another model"
    if certificate.inputs != system.inputs or certificate.outputs != system.outputs:
        return "the certificate names other signals than the model has"
    return malformed(Storage(certificate.matrices, certificate.basis, certificate.box, certificate.sample_time), system)


def malformed(storage: Storage, system: Driven) -> str:
    """Why a storage function cannot be one of a system; empty if it can.

    Parameters
    ----------
    storage : Storage
        As a file gives it.
    system : Driven

    Returns
    -------
    str
    """
    box, basis, matrices = storage.box, storage.basis, storage.matrices
    if box.names != tuple(r.label for r in system.readings) or not set(basis.names) <= set(box.names):
        return "the certificate names other scheduling variables than the model reads"
    if matrices.shape != (basis.size, system.order, system.order):
        return "matrices and basis of the certificate do not fit the model"
    if not np.all(np.isfinite(matrices)) or not np.array_equal(matrices, matrices.swapaxes(1, 2)):
        return "the certificate's matrices are not finite and symmetric"
    if any(r is not None and not r >= 0 for r in box.rate):
        return "the certificate holds a negative rate"
    return ""


def reproduced(certificate: _Claimed, kind: str, found: Recheck) -> Recheck:
    """The re-check, as long as it is no weaker than what the certificate states of itself."""
    if not found.holds:
        return found
    if certificate.kind != kind:
        return Recheck(False, found.between_grid, found.margin, f"this is no {certificate.kind} certificate")
    if certificate.between_grid and not found.between_grid:
        return Recheck(False, False, found.margin, "the claim between grid points cannot be reproduced")
    if not certificate.margin <= found.margin * (1 + 1e-6) + 1e-12:
        return Recheck(False, found.between_grid, found.margin, f"a margin of {certificate.margin:.3g} is claimed")
    return found


def describe_box(box: Scheduling, kind: str) -> str:
    """Range and rates that a certificate covers, in words; empty without scheduling variables."""
    where = ", ".join(f"{n} in [{a:.6g}, {b:.6g}] {u}".rstrip() for n, a, b, u in
                      zip(box.names, box.lower, box.upper, box.units, strict=True))
    if not where or kind != "parameter-dependent":
        return f" for every trajectory of {where}, however fast it moves" if where else ""
    speeds = ", ".join(f"|d {n}/dt| <= {r:.6g} {u or '1'}/s" if r is not None else f"{n} arbitrarily fast"
                       for n, r, u in zip(box.names, box.rate, box.units, strict=True))
    return f" for every trajectory of {where} with {speeds}"


def certificate_kind(storage: Storage) -> str:
    """Sort of a storage function."""
    if not storage.readings:
        return "quadratic"
    bounded = any(storage.box.rate[i] is not None for i in storage.readings)
    return "parameter-dependent" if bounded else "poly-quadratic"
