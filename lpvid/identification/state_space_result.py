"""Turn the end of a state-space search into an Identification; common parts of the state-space structures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lpvid import _checks
from lpvid._threads import single_thread
from lpvid.condition.constancy import DISTINCT
from lpvid.errors import InputError, TooFewSamples
from lpvid.identification.arx import require_motion_of
from lpvid.identification.covariance import bartlett, block_length, residual_memory
from lpvid.identification.result import COVARIANCE_LIMIT, Identification
from lpvid.identification.staged_search import StagedLayout
from lpvid.identification.state_space_layout import StateSpaceLayout, stacks
from lpvid.identification.state_space_search import LocalProblem, SearchData, StateSpaceSearchEnd, gauge, linearise
from lpvid.identification.structure import Structure
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.record import Record
from lpvid.scheduling import Basis, Scheduling
from lpvid.scheduling.basis import checked_basis
from lpvid.validation import residual_tests

SCORES = 64
"""samples of a stretch whose scores are formed at once; a record's rest behind the last whole one is left out."""


class StateSpaceStructure(Structure):
    """What structures with states share: signals by name, a basis that reads p(k) alone."""

    order: Any
    input: str | tuple[str, ...]
    output: str | tuple[str, ...]
    basis: Basis
    direct: bool
    affine: Any

    def _check_signals(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Inputs and outputs as tuples of names, which the fields hold from then on."""
        named, measured = _checks.names(self.input, "input"), _checks.names(self.output, "output")
        shared = set(named) & set(measured)
        if shared:
            raise InputError("a channel cannot be input and output at once", got=", ".join(sorted(shared)))
        checked_basis(self.basis)
        if self.basis.lags != (0, 0):
            raise InputError("a state-space estimate needs a basis that reads p(k) alone",
                             got=f"lags {self.basis.lags}", mend="give the basis without Shifted")
        object.__setattr__(self, "input", named)
        object.__setattr__(self, "output", measured)
        return named, measured

    @property
    def summary(self) -> str:
        order = "of its own order" if self.order is None else f"order {self.order}"
        parts = (" direct" if self.direct else "") + (" affine" if self.affine else "")
        return f"{type(self).__name__} {order} {self.basis.summary}{parts}"

    @property
    def channels(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((*self.input, *self.output, *self.basis.names)))


def number_of_parameters(letters: int, order: int, inputs: int, outputs: int, *, direct: bool, affine: bool) -> int:
    """Entries of A, B and C, and of D and the offsets where they are requested.

    Parameters
    ----------
    letters : int
        Functions of the basis.
    order : int
        States.
    inputs, outputs : int
    direct : bool
        Whether there is D.
    affine : bool
        Whether there are offsets of state and output.

    Returns
    -------
    int
    """
    linear = order * (order + inputs + outputs) + (inputs * outputs if direct else 0)
    return letters * (linear + (order + outputs if affine else 0))


def refuse_poor_data(records: Sequence[Record], inputs: Sequence[str], outputs: Sequence[str], past: int,
                     parameters: int) -> None:
    """Raise where a channel never moves, or where there are fewer equations than parameters.

    Parameters
    ----------
    records : sequence of Record
        Uniform and finite.
    inputs, outputs : sequence of str
        Channel names.
    past : int
        Samples at the head of every record that give no equation.
    parameters : int
        To be estimated.

    Raises
    ------
    InputError
        Too few equations, or a channel that is constant throughout.
    """
    for names, what in ((inputs, "input"), (outputs, "output")):
        for name in names:
            require_motion_of(records, name, what)
    equations = len(outputs) * sum(max(r.n_samples - past, 0) for r in records)
    if equations <= parameters:
        raise TooFewSamples(f"{equations} equations cannot determine {parameters} parameters",
                            mend="give longer records, or lower the order or the degree")


def empty_model(record: Record, box: Scheduling, basis: Basis, inputs: Sequence[str], outputs: Sequence[str],
                order: int) -> LPVStateSpace:
    """A model of zeros with the record's rate and units.

    Parameters
    ----------
    record : Record
        Gives period and units.
    box : Scheduling
        Of the scheduling variables.
    basis : Basis
        Bound to it.
    inputs, outputs : sequence of str
        Channel names.
    order : int
        States.

    Returns
    -------
    LPVStateSpace
        In discrete time.
    """
    m, nu, ny = basis.size, len(inputs), len(outputs)
    return LPVStateSpace(np.zeros((m, order, order)), np.zeros((m, order, nu)), np.zeros((m, ny, order)),
                         np.zeros((m, ny, nu)), basis, record.sample_time, box,
                         inputs=tuple(Signal(n, record.unit(n)) for n in inputs),
                         outputs=tuple(Signal(n, record.unit(n)) for n in outputs))


def package(structure: Structure, search: StateSpaceSearchEnd, layout: StateSpaceLayout, records: Sequence[Record],
            notes: Sequence[str], *, free_coordinates: bool = True) -> Identification:
    """The Identification of a search's end, with covariance, noise and caveats.

    Parameters
    ----------
    structure : Structure
        That was asked for.
    search : StateSpaceSearchEnd
        End of the search.
    layout : StateSpaceLayout
        Of its parameters.
    records : sequence of Record
        Data of the fit.
    notes : sequence of str
        Remarks that go in front.
    free_coordinates : bool
        Whether the layout leaves the coordinates of the state open, as a full one does and a canonical form does
        not.

    Returns
    -------
    Identification
        The covariance stands in the metadata up to `COVARIANCE_LIMIT` parameters.
    """
    sure = _precision(search, layout, free_coordinates=free_coordinates)
    covariance = sure.covariance
    if isinstance(layout, StagedLayout):  # a model's file holds the law of its matrix entries; ψ is marginalised
        layout = layout.linear
        covariance = covariance[: layout.size, : layout.size]
    metadata: dict = {"structure": structure.to_dict(),  # type: ignore[attr-defined]
                      "training": {"records": [r.name for r in records], "n_samples": search.data.rows}}
    if layout.size <= COVARIANCE_LIMIT:
        metadata["parameters"] = {"layout": layout.to_list(), "labels": list(layout.labels),
                                  "covariance": covariance.tolist()}
    model = search.model.replace(noise_covariance=sure.noise, metadata=metadata)
    stated = list(notes)
    if sure.free < layout.size and free_coordinates:
        stated.append(f"{sure.free} of the {layout.size} entries are free, the others choose the state coordinates; "
                    "standard errors hold the coordinates fixed")
    unstable, resting = _unstable_share(model, search)
    if unstable > 0:
        stated.append(f"{100 * unstable:.2g} % of the training samples have a frozen pole outside the unit circle: "
                    + ("the scheduling is constant there, and a longer run diverges" if resting else
                       "the run is bounded there by the motion of the scheduling, not by the model"))
    return Identification(model, structure, layout, covariance, sure.condition, sure.condition,
                          search.data.rows, notes=tuple(stated), covariance_kind=sure.kind)


def _unstable_share(model: LPVStateSpace, search: StateSpaceSearchEnd) -> tuple[float, bool]:
    """Share of the training samples at which the frozen model is unstable; whether it rests in one of their records."""
    if not model.order:
        return 0.0, False
    unstable, resting = [], False
    for piece in search.data.at(model).pieces:
        phi = piece[0][:: max(1, len(piece[0]) // 2000)]
        outside = np.abs(np.linalg.eigvals(np.tensordot(phi, model.A, axes=1))).max(axis=1) > 1.0
        unstable.append(outside)
        resting = resting or bool(outside.any() and (np.ptp(phi, axis=0) <= DISTINCT).all())
    return float(np.mean(np.concatenate(unstable))), resting


@dataclass(frozen=True, eq=False)
class Precision:
    """Uncertainty of the parameters of a search: covariance, noise, condition number, number of free directions.

    Attributes
    ----------
    covariance : (k, k) array
        Of the parameters.
    noise : (ny, ny) array
        Covariance of the one-step errors [products of the outputs' units].
    condition : float
        Of the projected Jacobian in unit columns.
    free : int
        Directions that the data determine.
    kind : str
        How the covariance was computed, in words.
    """

    covariance: np.ndarray
    noise: np.ndarray
    condition: float
    free: int
    kind: str = "projected Jacobian, white errors"


def _precision(search: StateSpaceSearchEnd, layout: StateSpaceLayout, *, free_coordinates: bool = True) -> Precision:
    """Covariance through the projected Jacobian, zero along a change of coordinates.

    For white errors σ² (JᵀJ)⁺. Where the whiteness test fails, the sandwich (JᵀJ)⁺ S (JᵀJ)⁺ with S from sums of the
    scores over blocks, or of data too short for these from Bartlett weights (`bartlett`), the initial states held.
    """
    model, data = search.model, search.data
    with single_thread():
        factor = linearise(model, layout, data, search.evaluation.starts)
        directions = (gauge(model, layout, data.ones) if free_coordinates else np.zeros((layout.size, 0)))
        local = LocalProblem.of(factor, directions)
        lost = local.singular.size + model.order * len(data.pieces)
        freedom = max(data.rows - lost, 1)
        covariance, free = local.covariance(search.evaluation.cost / freedom)
        kind = Precision.kind
        series = [e[:, o] for e in search.evaluation.errors for o in range(e.shape[1])]
        memory = residual_memory(series)
        length = block_length(memory, data.rows // model.n_outputs, free)
        white = all(t.passed for t in residual_tests(series, [None] * len(series)))
        if not white:
            inverse, _ = local.covariance(1.0)
            starts = search.evaluation.starts
            middle = (bartlett(_scores(model, layout, data, starts), 3 * memory) if length is None else
                      _block_sums(model, layout, data, starts, length)) * (data.rows / freedom)
            covariance, kind = inverse @ middle @ inverse, "projected Jacobian, sandwich over coloured errors"
    errors = np.vstack(search.evaluation.errors)
    noise = errors.T @ errors / max(len(errors) - lost / errors.shape[1], 1.0)
    return Precision(covariance, noise, local.condition, free, kind)


def _block_sums(model: LPVStateSpace, layout: StateSpaceLayout, data: SearchData, starts: Sequence[np.ndarray],
                length: int) -> np.ndarray:
    """(k, k) long-run sum of products of the scores Jᵀe, from sums over blocks of `length` samples."""
    total, used, every = np.zeros((layout.size, layout.size)), 0, 0
    for i, piece in enumerate(data.at(model).pieces):
        every += len(piece[2])
        for products in _products(model, layout, data, starts, i, length):
            score = products.sum(axis=(0, 1))
            total += np.outer(score, score)
            used += length
    return total * (every / max(used, 1))


def _scores(model: LPVStateSpace, layout: StateSpaceLayout, data: SearchData, starts: Sequence[np.ndarray]
            ) -> list[np.ndarray]:
    """(n, k) scores Jᵀe of every sample, record by record."""
    return [np.vstack([p.sum(axis=1) for p in _products(model, layout, data, starts, i, min(SCORES, len(piece[2])))])
            for i, piece in enumerate(data.at(model).pieces)]


def _products(model: LPVStateSpace, layout: StateSpaceLayout, data: SearchData, starts: Sequence[np.ndarray],
              record: int, length: int) -> Iterator[np.ndarray]:
    """(length, outputs, k) products of the Jacobian and the error, stretch by whole stretch of one record."""
    from lpvid._state_space_kernels import sensitivity_rows

    arrays, table = stacks(model), np.array(layout.table)
    nx, ny, k = model.order, model.n_outputs, layout.size
    block = np.zeros((nx + k + 1, length * ny))
    (phi, u, y), (d_phi, d_u) = data.at(model).pieces[record], list(data.tangents(model))[record]
    x, moved = starts[record].copy(), np.hstack([np.eye(nx), np.zeros((nx, k))])
    for first in range(0, len(y) - length + 1, length):
        sensitivity_rows(arrays, phi, u, y, table, data.weight, x, moved, first, first + length, block, d_phi, d_u)
        yield (block[nx: nx + k] * block[nx + k]).T.reshape(length, ny, k)
