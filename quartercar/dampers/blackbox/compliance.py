"""Quasi-LPV dampers beyond the source documents: a law in series with a spring, and a yielding mixture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from lpvid.condition import folds
from lpvid.errors import InputError, NumericalError
from lpvid.record import Record
from lpvid.scheduling import Polynomial, Spline
from lpvid.simulation import simulate
from lpvid.toolkit import checks
from quartercar.dampers.blackbox.lpv import current_moves
from quartercar.dampers.blackbox.sampled import SampledDamper, boolean
from quartercar.dampers.facts import Facts

if TYPE_CHECKING:
    from lpvid.identification import Identification
    from lpvid.identification.compliance import Compliance as Structure
    from lpvid.identification.quasi_lpv import QuasiLPV as QuasiStructure
    from lpvid.identification.structure import Structure as AnyStructure

FOLDS = 2
"""blocks of the training data on which settings are compared."""
SAMPLES = 3_000
"""training samples on which settings are compared at most."""
SHORT = 12
"""iterations of a fit that is only to be compared."""
WORTH = 0.97
"""a larger setting must bring the cross-validated ESR below this share of the smaller one's."""
LAGS = (1, 3, 5, 8)
"""linear velocity lags that a compliance damper is tried with."""
LEVELS = (1, 2, 3)
"""segments in the current that it is tried with."""
WIDTHS = ((4, 1), (4, 3), (10, 1), (10, 3))
"""velocity lags, and lags in the trial force, that a quasi-LPV damper is tried with."""
ODDNESS = (900.0, 1.0)
"""samples for which an asymmetry of a quasi-LPV damper must be bought, as tried (examples/fixed_voltage.py: 900)."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Compliance(SampledDamper):
    """Ḟ/k_h = v − g(F, i) with linear terms in parallel: a rising law in series with a spring (equation sheet 9.3).

    First-order LPV in its own force, stable for every course of current and force; the law is piecewise linear and
    rising by construction. What is left open is chosen by cross-validation on the training data.

    Attributes
    ----------
    lags : int or None
        Linear terms in v(k), v(k−1), …: viscous, fixture's mass, timing of the sensors.
    levels : int or None
        Segments of the law in the current.
    current : bool
        Whether the law depends on the current; without, it is a static law in series with a spring.
    displacement : bool
        Whether a spring to ground (gas) is part of it.
    """

    name: ClassVar[str] = "compliance"
    title: ClassVar[str] = "Law in series with a spring"
    source: ClassVar[str] = "equation sheet 9.3"

    lags: int | None = None
    levels: int | None = None
    current: bool = False
    displacement: bool = True

    def check_orders(self) -> None:
        for name in ("lags", "levels"):
            if getattr(self, name) is not None:
                checks.count(getattr(self, name), name, at_least=1)
        for name in ("current", "displacement"):
            boolean(getattr(self, name), name)

    @property
    def wanted(self) -> tuple[str, ...]:
        return ("velocity", *(("displacement",) if self.displacement else ()), *(("current",) if self.current else ()))

    @property
    def past(self) -> int:
        return self.lags or max(LAGS)

    @classmethod
    def suited(cls, facts: Facts) -> Compliance:
        return cls(current=facts.current_varies, displacement=facts.has_displacement, **facts.common)

    def structure(self, lags: int, levels: int, moving: bool, iterations: int = 80) -> Structure:
        """The structure in lpvid's words; `moving` states whether the current ever moves within a record.

        Parameters
        ----------
        lags : int
            Linear terms in v(k), v(k−1), …
        levels : int
            Segments of the law in the current; not read without current.
        moving : bool
            Whether the current moves within a record, so that a lag of rise and fall and a delay are fitted too.
        iterations : int
            Most steps of the search.

        Returns
        -------
        lpvid.identification.compliance.Compliance
            For `lpvid.identify`.
        """
        from lpvid.identification.compliance import Compliance as Structure

        lag = "rise-fall-delay" if self.current and moving else None
        return Structure(current="current" if self.current else None, levels=levels, lags=lags, schedule_filter=lag,
                         side="displacement" if self.displacement else (), max_iterations=iterations)

    def identified(self, records: Sequence[Record]) -> tuple[Self, Identification, tuple[str, ...]]:
        from lpvid.identification import identify

        moving = self.current and current_moves(records)
        levels = (self.levels,) if self.levels else _levels(records) if self.current else (1,)
        lags = (self.lags,) if self.lags else LAGS
        widest, more = _chosen(records, lags, lambda n: self.structure(n, levels[0], moving, SHORT))
        finest, stated = _chosen(records, levels, lambda n: self.structure(widest, n, moving, SHORT))
        found = identify(records, self.structure(widest, finest, moving))
        chosen = self.replace(lags=widest, levels=finest)
        notes = (*(f"velocity lags, {m}" for m in more), *(f"segments in the current, {m}" for m in stated))
        return chosen, found, notes

    def to_lpv(self, sample_time: float) -> Any:
        raise InputError("no LPV form of 'compliance' of free scheduling",
                         why="its several implicit steps per sample are rational in 1/(F'(w) + k_h h)",
                         mend="to_model gives the quasi-LPV model, which is stable for every course of its force")


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class QuasiLpv(SampledDamper):
    """F(k) = Σ_m φ_m(ρ(k)) [Σ_j b_jm v(k−j) + c_m], ρ = F(k−1) + Σ_j κ_j v(k−j): a yielding element by hat functions.

    ρ is the force that would be if nothing yielded. A convex mixture of linear functions of recent velocities: bounded
    for every bounded velocity. What is left open is chosen by cross-validation on the training data.

    Attributes
    ----------
    lags : int or None
        Velocity lags.
    trial : int or None
        Velocity lags in ρ.
    segments : int
        Of the hat functions in ρ.
    oddness : float or None
        Samples for which an asymmetry must be bought.
    degree : int
        Degree of all coefficients in the current; 0 without current.
    """

    name: ClassVar[str] = "quasi-lpv"
    title: ClassVar[str] = "Quasi-LPV, scheduled on its trial force"
    source: ClassVar[str] = "lpvid.model.quasi"

    lags: int | None = None
    trial: int | None = None
    segments: int = 10
    oddness: float | None = None
    degree: int = 0

    def check_orders(self) -> None:
        for name in ("lags", "trial"):
            if getattr(self, name) is not None:
                checks.count(getattr(self, name), name, at_least=1)
        checks.count(self.segments, "segments", at_least=2)
        if self.oddness is not None and not checks.real(self.oddness, "oddness") >= 0:
            raise InputError("oddness must not be negative", got=self.oddness)
        checks.count(self.degree, "degree")

    @property
    def wanted(self) -> tuple[str, ...]:
        return ("velocity", "current") if self.degree else ("velocity",)

    @property
    def past(self) -> int:
        return self.lags or max(n for n, _ in WIDTHS)

    @classmethod
    def suited(cls, facts: Facts) -> QuasiLpv:
        return cls(degree=1 if facts.current_varies else 0, **facts.common)

    def structure(self, lags: int, trial: int, oddness: float, moving: bool, iterations: int = 80) -> QuasiStructure:
        """The structure in lpvid's words; `moving` states whether the current ever moves within a record.

        Parameters
        ----------
        lags : int
            Velocity lags.
        trial : int
            Velocity lags in ρ.
        oddness : float
            Samples for which an asymmetry must be bought.
        moving : bool
            Whether the current moves within a record, so that a lag of rise and fall is fitted too.
        iterations : int
            Most steps of the search.

        Returns
        -------
        lpvid.identification.quasi_lpv.QuasiLPV
            For `lpvid.identify`.
        """
        from lpvid.identification.quasi_lpv import QuasiLPV as QuasiStructure

        external = Polynomial(("current",), self.degree) if self.degree else Polynomial()
        return QuasiStructure(nb=lags, basis=Spline("force", self.segments, order=1), on="trial", trial=trial,
                              external=external, schedule_filter="rise-fall" if self.degree and moving else None,
                              oddness=oddness, max_iterations=iterations)

    def identified(self, records: Sequence[Record]) -> tuple[Self, Identification, tuple[str, ...]]:
        from lpvid.identification import identify

        moving = bool(self.degree) and current_moves(records)
        open_ = [(n, t) for n, t in WIDTHS if self.lags in (None, n) and self.trial in (None, t)]
        widths = open_ or [(self.lags or 4, self.trial or 1)]
        prices = ODDNESS if self.oddness is None else (self.oddness,)
        (lags, trial), stated = _chosen(records, widths, lambda w: self.structure(w[0], w[1], prices[0], moving, SHORT))
        oddness, more = _chosen(records, prices, lambda o: self.structure(lags, trial, o, moving, SHORT))
        found = identify(records, self.structure(lags, trial, oddness, moving))
        notes = (*(f"lags of velocity and of trial force, {m}" for m in stated),
                 *(f"weight of the symmetry in samples, {m}" for m in more))
        return self.replace(lags=lags, trial=trial, oddness=oddness), found, notes

    def to_lpv(self, sample_time: float) -> Any:
        """The LPV model whose scheduling variable ``rho`` moves freely: every run of this one is one of it."""
        from lpvid.model.quasi import QuasiLPVModel

        model = self.at_clock(sample_time)
        assert isinstance(model, QuasiLPVModel)
        return model.embedding()


def _chosen(records: Sequence[Record], candidates: Sequence[Any],
            structure: Callable[[Any], AnyStructure]) -> tuple[Any, tuple[str, ...]]:
    """The candidate of least cross-validated free-run ESR on the training data; a later one must be worth it."""
    if len(candidates) == 1:
        return candidates[0], ()
    blocks = folds(_few(records), FOLDS)
    tried: list[tuple[float, Any]] = [(_cross_validated(blocks, structure(c)), c) for c in candidates]
    best = tried[0]
    for candidate in tried[1:]:
        if candidate[0] < WORTH * best[0]:
            best = candidate
    if not np.isfinite(best[0]):
        raise InputError("no setting of this model runs on these data", why="every cross-validated fit fails",
                         mend="give longer records")
    described = ", ".join(f"{c}: {esr:.4g}" for esr, c in tried)
    return best[1], (f"cross-validated ESR on the training data {described}",)


def _few(records: Sequence[Record]) -> list[Record]:
    from lpvid.identification.stage_fit import shorten

    return shorten(records, SAMPLES, 200)


def _cross_validated(blocks: Sequence[tuple[list[Record], list[Record]]], structure: AnyStructure) -> float:
    error = power = 0.0
    for training, held_out in blocks:
        long = [r for r in training if r.n_samples > structure.start + 20]
        try:
            model = structure.estimate(long).model
        except (InputError, NumericalError):
            return np.inf
        for block in held_out:
            if block.n_samples <= model.start + 1:
                continue
            run, force = simulate(model, block), block["force"][model.start:]
            error += float(np.sum((force - run.output[run.start:, 0]) ** 2))
            power += float(np.sum((force - force.mean()) ** 2))
    return error / power if power > 0 and np.isfinite(error) else np.inf


def _levels(records: Sequence[Record]) -> tuple[int, ...]:
    """Numbers of segments that the currents which occur can carry."""
    from quartercar.dampers.facts import Facts

    found = Facts.of(records).levels
    return tuple(n for n in LEVELS if not found or n < len(found)) or (1,)
