"""The storage function of a synthesised loop as a certificate for others to check, between grid points too."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lpvid.lmi.autonomous import box_of
from lpvid.lmi.driven import driven
from lpvid.lmi.gain_certificate import GainCertificate, kind_of, recheck_gain
from lpvid.lmi.storage import Storage
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Basis, Fourier, Polynomial, Scheduling
from lpvid.synthesis.controller_formula import ControllerFormula
from lpvid.synthesis.controller_table import dense
from lpvid.synthesis.design_grid import columns

SHARES = (1e-6, 1e-4, 2e-3)
"""by which the certified bound may lie above the one found at points."""
CELLS = {1: 96, 2: 14, 3: 6}
"""of the grid on which P(p) is sampled, by the number of its variables."""


def certificate_of(formula: ControllerFormula, loop: LPVStateSpace, bound: float) -> GainCertificate | None:
    """The loop's storage function, re-checked; None where its rounding errors, or its approximation, cost the proof.

    With X(p), Y(p) the storage function holds X⁻¹, which is no finite sum: it is fitted in a richer basis. A controller
    that reads the rates is not covered: in its certificate p and ṗ would be independent.
    """
    if formula.variations.rated:
        return None
    system = driven(loop)
    box = box_of(system.readings, loop.box)
    best: GainCertificate | None = None
    for basis, matrices in _proposals(formula, box):
        storage = Storage(matrices, basis, box, system.sample_time)
        for share in SHARES:
            gamma = bound * (1 + share)
            if best is not None and gamma >= best.gamma and best.between_grid:
                return best
            found = recheck_gain(system, storage, gamma)
            if found.holds and (best is None or found.between_grid > best.between_grid):
                best = GainCertificate(kind_of(storage), gamma, matrices, basis, box, system.sample_time, system.digest,
                                       system.inputs, system.outputs, found.margin, found.between_grid)
            if found.holds:
                break
        if best is not None and best.between_grid:
            return best
    return best


def _proposals(formula: ControllerFormula, box: Scheduling) -> Iterator[tuple[Basis, np.ndarray]]:
    own, plant = formula.variations.basis, formula.plant.plant
    if own is None or not set(own.names) <= set(box.names):
        yield Polynomial((), 0), formula.storage(plant.box.centre[None, :]).matrices()
        return
    points = dense(plant.box, CELLS.get(len(plant.box.names), 4))
    values = formula.storage(points).matrices()
    for basis in _richer(own, plant.box):
        matrices = np.tensordot(np.linalg.pinv(columns(plant.box, basis, points)), values, axes=1)
        yield basis, 0.5 * (matrices + matrices.swapaxes(1, 2))


def _richer(basis: Basis, box: Scheduling) -> Iterator[Basis]:
    if isinstance(basis, Fourier):
        for factor in (2, 4):
            yield Fourier(basis.name, factor * basis.harmonics, basis.period, basis.origin)
        return
    for degree in (2, 4, 6):
        yield Polynomial(basis.names, degree).bound(box)
