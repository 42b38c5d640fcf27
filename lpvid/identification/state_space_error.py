"""LPV state space by prediction error: every matrix free and affine in the basis, coordinates chosen by the data."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.identification.arx import ARX, scheduling_box
from lpvid.identification.result import Identification
from lpvid.identification.state_space_layout import StateSpaceLayout, stacks
from lpvid.identification.state_space_result import (
    StateSpaceStructure,
    empty_model,
    number_of_parameters,
    package,
    refuse_poor_data,
)
from lpvid.identification.state_space_search import (
    SearchData,
    StateSpaceSearchEnd,
    bounded,
    evaluate,
    frozen_radius,
    refine,
)
from lpvid.identification.subspace import Subspace
from lpvid.least_squares import CONVERGED
from lpvid.model.state_space import LPVStateSpace
from lpvid.realization import realize
from lpvid.record import Record
from lpvid.scheduling import Basis, Polynomial, Scheduling

if TYPE_CHECKING:
    from lpvid.model.transfer_function import LPVTransferFunction

NOISE = ("output", "innovation")
NEARLY = 1.05
"""mean square error, relative to the least, up to which an end stays in the choice."""
HEAD = 0.7
"""share of every record on which ends of nearly the same error are fitted again, to be judged on the rest."""
PROBED = 12
"""steps after which a search without the limit must have got ahead of the one with it."""
TOUCHING = 1 - 1e-5
"""frozen radius beyond which the limit at 1 may have held a search back."""


@dataclass(frozen=True)
class StateSpaceError(StateSpaceStructure):
    """LPV state space, fully parametrised, by prediction error.

    ::

        x(k+1) = A(p) x + B(p) u [+ f(p)] [+ K(p) e]
        y(k)   = C(p) x [+ D(p) u] [+ g(p)] + e

    Full matrices leave the state coordinates open; each Gauss-Newton step moves only along what the data see, the
    tangent of the coordinate changes being projected out (Lee & Poolla 1999; McKelvey, Helmersson & Ribarits 2004).
    The Jacobian comes from the sensitivity recursions, exactly, and is folded into a triangular factor chunk by chunk;
    every record's initial state is estimated with it. A search first keeps the frozen poles along the training
    trajectory in the unit circle; one that is free to leave it is taken up only where it lowers the mean square error
    by more than 5 %, since such models may diverge on the next record. Ends of nearly the same error from different
    starts are separated by refitting on the head of every record and running freely over the rest.

    Parameters
    ----------
    order : int or None
        States; None takes the order that `Subspace` finds by its free run out of fold.
    input, output : str or sequence of str
        Channel (or role) names; any number of each.
    basis : Basis
        Dependence on p(k), the same for all matrices.
    direct : bool
        Whether u(k) acts on y(k) directly (D).
    affine : bool
        Offsets f(p) and g(p).
    noise : {"output", "innovation"}
        White error on the output (the free run is fitted), or an innovation form whose K(p) is estimated too (the
        one-step prediction is fitted).
    start_from : None, Subspace or LPVStateSpace
        Where to begin. None tries `Subspace` and, where the order is a multiple of the number of outputs, least
        squares on the shifted form, which is an exact state-space model.
    iterations : int
        Linearisations at most.

    Examples
    --------
    >>> StateSpaceError(order=2, input="u", output="y", basis=Polynomial("p", degree=1)).channels
    ('u', 'y', 'p')
    """

    order: int | None = None
    input: str | tuple[str, ...] = "velocity"
    output: str | tuple[str, ...] = "force"
    basis: Basis = field(default_factory=Polynomial)
    direct: bool = False
    affine: bool = False
    noise: str = "output"
    start_from: Subspace | LPVStateSpace | None = None
    iterations: int = 60

    def __post_init__(self) -> None:
        inputs, outputs = self._check_signals()
        if self.order is not None:
            _checks.count(self.order, "order", at_least=1)
        _checks.count(self.iterations, "iterations")
        _checks.one_of(self.noise, NOISE, "noise")
        given = self.start_from
        if isinstance(given, LPVStateSpace):
            if tuple(s.name for s in given.inputs) != inputs or tuple(s.name for s in given.outputs) != outputs:
                raise InputError("the start has other inputs or outputs than the structure", got=repr(given))
            if self.order not in (None, given.order):
                raise InputError("the start has another order than the structure", got=f"{given.order} states")

    @property
    def start(self) -> int:
        if isinstance(self.start_from, LPVStateSpace):
            return 2 * self.start_from.order
        return self._subspace().start

    def estimate(self, records: Sequence[Record]) -> Identification:
        box = scheduling_box(records, self.basis)
        bound = replace(self, basis=self.basis.bound(box))
        given = self.start_from.order if isinstance(self.start_from, LPVStateSpace) else 1
        refuse_poor_data(records, tuple(self.input), tuple(self.output), 0, number_of_parameters(
            self.basis.size, self.order or given, len(self.input), len(self.output), direct=self.direct,
            affine=self.affine))
        ends = bound._ends(records, box)
        chosen = bound._preferred(ends, records, box)
        stated, best = chosen.stated, chosen.search
        layout = StateSpaceLayout.full(best.model, bound._free)
        note = (f"prediction error ({self.noise}) from {stated}, one of {len(ends)} searches: {best.iterations} "
                f"Levenberg-Marquardt steps; stopped because {best.why}")
        return package(replace(bound, order=best.model.order), best, layout, records, [note])

    def _ends(self, records: Sequence[Record], box: Scheduling) -> list[_End]:
        return [end for start, model in self._starts(records, box)
                for end in _ends(start, model, records, self._free, self.iterations)]

    def _preferred(self, ends: Sequence[_End], records: Sequence[Record], box: Scheduling) -> _End:
        """The end of least error; among nearly equal ones stable poles decide, then a free run not fitted to."""
        least = min(_log_error(end.search) for end in ends)
        near = [end for end in ends if _log_error(end.search) <= least + np.log(NEARLY)]
        near = [end for end in near if end.radius <= 1] or near
        heads, tails = _halves(records)
        order = near[0].search.model.order
        size = number_of_parameters(self.basis.size, order, len(self.input), len(self.output), direct=self.direct,
                                    affine=self.affine)
        short = min(r.n_samples for r in tails) < 20 * order or sum(r.n_samples for r in heads) < 4 * size
        if len(near) == 1 or short or not self.iterations:
            return min(near, key=lambda end: (max(end.radius, 1.0), _log_error(end.search)))
        errors: dict[tuple[str, bool], float] = {}
        for end in replace(self, order=order)._ends(heads, box):
            run = evaluate(end.search.model, SearchData.of(tails, end.search.model))
            errors[end.key] = _log_error(replace(end.search, evaluation=run))
        return min(near, key=lambda end: (errors.get(end.key, np.inf), _log_error(end.search)))

    @property
    def _free(self) -> tuple[str, ...]:
        named = ["A", "B", "C"]
        named += ["D"] if self.direct else []
        named += ["state_offset", "output_offset"] if self.affine else []
        named += ["observer_gain"] if self.noise == "innovation" else []
        return tuple(named)

    # -- where to begin -----------------------------------------------------------------------------------------
    def _subspace(self) -> Subspace:
        if isinstance(self.start_from, Subspace):
            return replace(self.start_from, order=self.order or self.start_from.order, input=self.input,
                           output=self.output, basis=self.basis, direct=self.direct, affine=self.affine)
        return Subspace(order=self.order, input=self.input, output=self.output, basis=self.basis, direct=self.direct,
                        affine=self.affine)

    def _starts(self, records: Sequence[Record], box: Scheduling) -> Iterator[tuple[str, LPVStateSpace]]:
        if isinstance(self.start_from, LPVStateSpace):
            yield "the model given", self._own(self.start_from, records, box)
            return
        first = self._subspace().estimate(records).model
        assert isinstance(first, LPVStateSpace)
        yield "the subspace estimate", self._own(first, records, box)
        if self.start_from is None and first.order % len(self.output) == 0:
            for ridge in (0.0, 1e-5):
                try:
                    yield "least squares on the shifted form", self._own(
                        self._shifted(records, first.order // len(self.output), ridge), records, box)
                except InputError:
                    continue  # these data cannot separate its parameters: penalise, or go without
                return

    def _shifted(self, records: Sequence[Record], lags: int, ridge: float) -> LPVStateSpace:
        structure = ARX(na=lags, nb=lags + 1 if self.direct else lags, nk=0 if self.direct else 1, input=self.input,
                        output=self.output, basis=self.basis, affine=lags + 1 if self.affine else 0, lagged=True,
                        ridge=ridge)
        model: LPVTransferFunction = structure.estimate(records).model  # type: ignore[assignment]
        return realize(model, "shifted").model

    def _own(self, model: LPVStateSpace, records: Sequence[Record], box: Scheduling) -> LPVStateSpace:
        """The model over this structure's basis, without what the structure leaves out."""
        p = np.vstack([r.matrix(box.names) for r in records])
        p = p[:: max(1, len(p) // 5000)]
        names = model.box.names
        columns = [box.names.index(_checks.known_name(n, box.names, "scheduling variable of the start")) for n in names]
        old, new = model.basis.evaluate(p[:, columns]), self.basis.evaluate(p)
        change = np.linalg.lstsq(new, old, rcond=1e-10)[0]
        fields = ("A", "B", "C", "D", "state_offset", "output_offset", "observer_gain")
        arrays = dict(zip(fields, (np.tensordot(change, x, axes=1) for x in stacks(model)), strict=True))
        for name in ("state_offset", "output_offset"):
            arrays[name] = arrays[name][:, :, 0]
        for name in fields:
            if name not in self._free:
                arrays[name] = np.zeros_like(arrays[name])
        if self.noise == "output":
            del arrays["observer_gain"]
        empty = empty_model(records[0], box, self.basis, self.input, self.output, model.order)
        return empty.replace(**arrays)

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Plain values by name.
        """
        given = self.start_from
        start = given.to_dict() if isinstance(given, Subspace) else None if given is None else "model"
        return {"kind": "state-space-error", "order": self.order, "input": list(self.input),
                "output": list(self.output), "basis": self.basis.to_dict(), "direct": self.direct,
                "affine": self.affine, "noise": self.noise, "start": start, "iterations": self.iterations}


@dataclass(frozen=True, eq=False)
class _End:
    """Where one search ended: from which start, and whether frozen poles were held in the unit circle."""

    start: str
    stable: bool
    stated: str
    search: StateSpaceSearchEnd

    @property
    def key(self) -> tuple[str, bool]:
        return self.start, self.stable

    @property
    def radius(self) -> float:
        return frozen_radius(self.search.model, self.search.data)


def _ends(start: str, model: LPVStateSpace, records: Sequence[Record], free: tuple[str, ...],
          iterations: int) -> list[_End]:
    """Where searches from one start end: frozen poles held in the unit circle; and free, where that is much better."""
    data, layout = SearchData.of(records, model), StateSpaceLayout.full(model, free)
    safe, shrunk = bounded(model, data)
    safe = _sized(safe, data)
    described = start if shrunk == 1 else f"{start} (its state matrix shrunk by {shrunk} to be bounded)"
    radius = frozen_radius(safe, data)
    inside = safe if radius <= 1 else bounded(safe.replace(A=0.999 / radius * safe.A), data)[0]
    held = refine(inside, layout, data, iterations=iterations, stable=True)
    ends = [_End(start, True, f"{described}, frozen poles kept stable", held)]
    if held.why != CONVERGED or frozen_radius(held.model, data) > TOUCHING:
        probe = refine(safe if radius > 1 else held.model, layout, data, iterations=min(PROBED, iterations))
        if _log_error(probe) < _log_error(held) - np.log(NEARLY):
            free_end = refine(probe.model, layout, data, iterations=iterations)
            ends.append(_End(start, False, described, free_end))
    return ends


def _log_error(search: StateSpaceSearchEnd) -> float:
    """Mean logarithm of the outputs' mean square errors; infinite where the run diverged."""
    if not np.isfinite(search.evaluation.cost):
        return np.inf
    mean_squares = np.mean(np.vstack(search.evaluation.errors) ** 2, axis=0)
    return float(np.log(np.maximum(mean_squares, 1e-300)).mean())


def _halves(records: Sequence[Record]) -> tuple[list[Record], list[Record]]:
    """The head and the tail of every record."""
    cuts = [int(HEAD * r.n_samples) for r in records]
    return ([r.slice(0, cut) for r, cut in zip(records, cuts, strict=True)],
            [r.slice(cut, r.n_samples) for r, cut in zip(records, cuts, strict=True)])


def _sized(model: LPVStateSpace, data: SearchData) -> LPVStateSpace:
    """The model in coordinates in which the states have unit covariance along the data."""
    from lpvid._state_space_kernels import states_run

    matrices = stacks(model)
    a, b, c, _, f, _, k = matrices
    n, total, count = model.order, np.zeros((model.order, model.order)), 0
    for phi, u, _ in data.pieces:
        states = np.zeros((len(u), n))
        states_run(matrices, phi, _checks.read_only(u), np.zeros(n), states)
        total += states.T @ states
        count += len(u)
    if not np.isfinite(total).all():
        return model
    values, vectors = np.linalg.eigh(total / count)
    if not values.max(initial=0.0) > 0:
        return model
    root = np.sqrt(np.maximum(values, 1e-8 * values.max(initial=0.0)))
    if not root.min(initial=np.inf) > 0:
        return model
    there, back = (vectors / root).T, vectors * root
    gain = None if model.observer_gain is None else there @ k
    return model.replace(A=there @ a @ back, B=there @ b, C=c @ back, state_offset=(there @ f)[:, :, 0],
                         observer_gain=gain)
