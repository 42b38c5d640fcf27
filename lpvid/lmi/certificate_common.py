"""What all certificates have in common: a claim, the matrices that prove it, and a re-check with numpy alone."""

from __future__ import annotations

import dataclasses
import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np

from lpvid import _checks
from lpvid.codec import Coded
from lpvid.errors import InputError
from lpvid.lmi.certificate import Recheck
from lpvid.lmi.driven import Driven, driven
from lpvid.lmi.storage import Storage
from lpvid.scheduling import Basis, Scheduling


def verdict_of(between_grid: bool, verified: bool = True) -> str:
    """How far a claim is proven, in the words of every verdict.

    Parameters
    ----------
    between_grid : bool
        Proven on the whole box, not only on the points of a grid.
    verified : bool
        Proven at all.

    Returns
    -------
    str
        "certified", "certified on a grid only" or "not certified".
    """
    if not verified:
        return "not certified"
    return "certified" if between_grid else "certified on a grid only"


class Certificate(Coded):
    """A claim about a model that anyone can re-check from the numbers stored with it.

    What a certificate is about differs in four places: `claim` in words, `subject` (the matrices it is about), `fault`
    (why it cannot be right) and `recheck` (what numpy finds). Everything else stands here.

    Attributes
    ----------
    SCHEMA : str
        Of its file.
    kind : str
        Of the function that proves it.
    margin : float
        Smallest eigenvalue of its inequality, less a bound of the rounding errors.
    between_grid : bool
        Proven on the whole box, not only on the points of a grid.
    """

    SCHEMA: ClassVar[str]
    JSON = (("schema", "SCHEMA"), "claim", ...)
    FUNCTION: ClassVar[str] = "storage function"

    kind: str
    margin: float
    between_grid: bool
    model_hash: str
    sample_time: float | None

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                object.__setattr__(self, field.name, _checks.frozen_array(value, field.name, ndim=value.ndim))

    @property
    @abstractmethod
    def claim(self) -> str:
        """What the certificate states, in words."""

    @abstractmethod
    def subject(self, model: Any) -> Any:
        """The part of a model that the certificate is about.

        Parameters
        ----------
        model : model
            For which it is re-checked.

        Returns
        -------
        Driven or another with ``digest`` and ``sample_time``
        """

    @abstractmethod
    def recheck(self, model: Any, subject: Any) -> Recheck:
        """What numpy finds about the claim.

        Parameters
        ----------
        model : model
        subject : Driven or another
            What `subject` returned.

        Returns
        -------
        Recheck
        """

    def fault(self, model: Any, subject: Any) -> str:
        """Why the certificate cannot be one for a model.

        Parameters
        ----------
        model : model
        subject : Driven or another
            What `subject` returned.

        Returns
        -------
        str
            Empty if it can.
        """
        if self.model_hash != subject.digest or self.sample_time != subject.sample_time:
            return "the certificate was made for another model"
        return ""

    def check(self, model: Any) -> Recheck:
        """Recompute the claim for a model; it holds only if every number in it can be reproduced.

        Parameters
        ----------
        model : model
            What the certificate is about.

        Returns
        -------
        Recheck
            Whether the claim holds, its margin, and why where it does not.
        """
        subject = self.subject(model)
        fault = self.fault(model, subject)
        if fault:
            return Recheck(False, False, math.nan, fault)
        return self._reproduced(self.recheck(model, subject))

    def _reproduced(self, found: Recheck) -> Recheck:
        """The re-check, as long as it is no weaker than what the certificate states of itself."""
        if not found.holds:
            return found
        if self.between_grid and not found.between_grid:
            return Recheck(False, False, found.margin, "the claim between grid points cannot be reproduced")
        if not self.margin <= found.margin * (1 + 1e-6) + 1e-12:
            return Recheck(False, found.between_grid, found.margin, f"a margin of {self.margin:.3g} is claimed")
        return found

    @property
    def order(self) -> int:
        """States of the function; an empty list in a file does not show them."""
        return self._arrays[0].shape[-1]

    @property
    def _arrays(self) -> tuple[np.ndarray, ...]:
        return tuple(v for f in dataclasses.fields(self)  # type: ignore[arg-type]
                     if isinstance(v := getattr(self, f.name), np.ndarray))

    @property
    def where(self) -> str:
        """A reservation, in words, where it is shown on a grid only."""
        return "" if self.between_grid else "; shown at the points of a grid only, not proven between them"

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """Inverse of `to_dict`.

        Parameters
        ----------
        data : mapping
            What `to_dict` returned.

        Returns
        -------
        Certificate
            With the same values; nothing in it is checked again.

        Raises
        ------
        InputError
            Another schema, a missing key, a value of the wrong type.
        """
        if data.get("schema") != cls.SCHEMA:
            raise InputError(f"not {cls.NOUN} of this version", got=data.get("schema"))
        return super().from_dict(data)

    def __repr__(self) -> str:
        kind = f"{self.kind} {self.FUNCTION}; " if self.FUNCTION else ""
        return (f"certified{'' if self.between_grid else ' on a grid only'}: {self.claim}\n"
                f"  {kind}margin {self.margin:.3g}, re-checked with numpy")


class StorageCertificate(Certificate):
    """A certificate of a storage function xᵀP(p)x over a box.

    Attributes
    ----------
    matrices : (K, n, n) array
        P(p) = Σ_k matrices[k] ψ_k(p), with ψ_k the functions of `basis`.
    basis : Basis
    box : Scheduling
        Range and rate bounds [units per second]; a variable read at several times has an entry for each.
    inputs, outputs : tuple of str
        Signals that the claim is about.
    """

    JSON = (("schema", "SCHEMA"), "claim", ..., "order")

    matrices: np.ndarray
    basis: Basis
    box: Scheduling
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    @property
    def storage(self) -> Storage:
        """xᵀP(p)x."""
        return Storage(self.matrices, self.basis, self.box, self.sample_time)

    @property
    def signals(self) -> str:
        """From which inputs to which outputs, in words."""
        return f"{', '.join(self.inputs)} to {', '.join(self.outputs)}"

    def subject(self, model: Any) -> Driven:
        return driven(model, tuple(n for n in self.basis.names if n in model.box.names))

    def fault(self, model: Any, subject: Driven) -> str:
        fault = super().fault(model, subject)
        if not fault and (self.inputs, self.outputs) != (subject.inputs, subject.outputs):
            fault = "the certificate names other signals than the model has"
        return fault or malformed(self.storage, subject)

    @property
    def proven_kind(self) -> str:
        """What `kind` must be, by basis and box."""
        return certificate_kind(self.storage)

    def _reproduced(self, found: Recheck) -> Recheck:
        if found.holds and self.kind != self.proven_kind:
            return Recheck(False, found.between_grid, found.margin, f"this is no {self.kind} certificate")
        return super()._reproduced(found)

    @classmethod
    def array_shapes(cls, values: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
        matrices, n = values["matrices"], values.get("order")
        return {"matrices": (len(matrices), *((n, n) if n is not None else matrices.shape[1:]))}


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
    if any(basis.lags):
        return "the certificate's storage function reads a variable at a delay"
    if matrices.shape != (basis.size, system.order, system.order):
        return "matrices and basis of the certificate do not fit the model"
    if not np.all(np.isfinite(matrices)) or not np.array_equal(matrices, matrices.swapaxes(1, 2)):
        return "the certificate's matrices are not finite and symmetric"
    if any(r is not None and not r >= 0 for r in box.rate):
        return "the certificate holds a negative rate"
    return ""


def polytope_fault(vertices: np.ndarray | None, storage: Storage, subject: Driven) -> str:
    """Why a claim on a polytope cannot be one by its vertices; empty if it can, and for a claim on the box.

    Parameters
    ----------
    vertices : (V, readings) array or None
        None for the box.
    storage : Storage
    subject : Driven

    Returns
    -------
    str
    """
    if vertices is None:
        return ""
    if not storage.basis.names and not subject.affine:
        return "the certificate is on a polytope, and the model is not affine in its scheduling"
    return vertices_fault(vertices, storage.box)


def vertices_fault(vertices: np.ndarray, box: Scheduling) -> str:
    """Why vertices are none of a polytope within a certificate's box; empty if they are.

    Parameters
    ----------
    vertices : (V, readings) array
    box : Scheduling

    Returns
    -------
    str
    """
    if vertices.ndim != 2 or vertices.shape[1] != len(box.names):
        return "the certificate's polytope is over other variables than the model reads"
    if not len(vertices) or not np.isfinite(vertices).all():
        return "the certificate's polytope has no vertices, or one that is not finite"
    width = np.array(box.upper) - np.array(box.lower)
    off = np.maximum(np.array(box.lower) - vertices, vertices - np.array(box.upper)).max(axis=0, initial=0.0)
    return "the certificate's polytope leaves its box" if (off > 1e-9 * width).any() else ""


def describe_set(box: Scheduling, vertices: np.ndarray | None, kind: str) -> str:
    """As `describe_box`, of a polytope where there is one.

    Parameters
    ----------
    box : Scheduling
    vertices : (V, readings) array or None
        None for the box.
    kind : str
        Of the storage function.

    Returns
    -------
    str
    """
    if vertices is None:
        return describe_box(box, kind)
    motion = f" with {speeds(box)}" if kind == "parameter-dependent" else ", however fast it moves"
    return f" for every trajectory of {within(box.names, vertices, box.units)}{motion}"


def within(names: tuple[str, ...], vertices: np.ndarray, units: tuple[str, ...] = ()) -> str:
    """A polytope in words: how many vertices, and how far they reach; a smaller one would prove less.

    Parameters
    ----------
    names : tuple of str
    vertices : (V, len(names)) array
    units : tuple of str
        One for each name; none where they are not known.

    Returns
    -------
    str

    Examples
    --------
    >>> within(("p", "q"), np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 2.0]]))
    'p in [0, 1], q in [0, 2] in a polytope of 3 vertices'
    """
    count = f"in a polytope of {len(vertices)} vertices"
    if not len(vertices):
        return f"{', '.join(names)} {count}"
    ends = zip(names, vertices.min(axis=0), vertices.max(axis=0), units or ("",) * len(names), strict=True)
    return ", ".join(f"{n} in [{a:.6g}, {b:.6g}] {u}".rstrip() for n, a, b, u in ends) + f" {count}"


def describe_box(box: Scheduling, kind: str) -> str:
    """Range and rates that a certificate covers, in words; empty without scheduling variables.

    Parameters
    ----------
    box : Scheduling
        Ranges and rates.
    kind : str
        Of the storage function: rates are named for a parameter-dependent one only.

    Returns
    -------
    str
        Begins with a space, to follow a claim.
    """
    where = ", ".join(f"{n} in [{a:.6g}, {b:.6g}] {u}".rstrip() for n, a, b, u in
                      zip(box.names, box.lower, box.upper, box.units, strict=True))
    if not where or kind != "parameter-dependent":
        return f" for every trajectory of {where}, however fast it moves" if where else ""
    return f" for every trajectory of {where} with {speeds(box)}"


def speeds(box: Scheduling) -> str:
    """Rate bounds, in words.

    Parameters
    ----------
    box : Scheduling

    Returns
    -------
    str
    """
    return ", ".join(f"|d {n}/dt| <= {r:.6g} {u or '1'}/s" if r is not None else f"{n} arbitrarily fast"
                     for n, r, u in zip(box.names, box.rate, box.units, strict=True))


def certificate_kind(storage: Storage) -> str:
    """Sort of a storage function.

    Parameters
    ----------
    storage : Storage
        xᵀP(p)x.

    Returns
    -------
    str
        "quadratic" (one P), "poly-quadratic" (P(p), no rate bound) or "parameter-dependent" (P(p), a rate bound).
    """
    if not storage.readings:
        return "quadratic"
    bounded = any(storage.box.rate[i] is not None for i in storage.readings)
    return "parameter-dependent" if bounded else "poly-quadratic"
