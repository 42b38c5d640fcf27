"""A canonical state-space form of a transfer function, estimated by simulation error in that form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid._threads import single_thread
from lpvid.errors import InputError, TooFewSamples
from lpvid.identification.form_layout import bounded_start, form_layout
from lpvid.identification.result import Identification
from lpvid.identification.staged_search import StagedData, StagedLayout
from lpvid.identification.state_space_layout import ARRAYS, StateSpaceLayout
from lpvid.identification.state_space_result import package
from lpvid.identification.state_space_search import SearchData, StateSpaceSearchEnd, refine
from lpvid.identification.structure import Structure
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization import Realization, realize
from lpvid.record import Record

LINEAR = 2
"""steps for the entries in which the free run is linear: the first one solves, the second confirms."""


@dataclass(frozen=True, eq=False)
class CanonicalForm(Structure):
    """A state-space form whose own entries are estimated, by simulation error, from a transfer function on.

    ::

        min over θ, ψ   Σ_k (y(k) − ŷ(k; θ, ψ))²      ŷ the free run of the form, its initial states estimated
        θ   entries of A(p), B(p), C(p), D(p) and offsets that the form leaves free (`form_layout`)
        ψ   parameters of the input stage and of the scheduling filter

    A form that is not exact is another system than its transfer function as soon as p moves, so coefficients that suit
    the one need not suit the other (equation sheet 5.6 (a)). Here the error of the form that is used is minimised, by
    Levenberg-Marquardt with exact sensitivities. θ is fitted first with the stages held, then θ and ψ together: the
    stages of the transfer function were chosen for its order of filters and scheduling, which the form reverses.

    Parameters
    ----------
    source : LPVTransferFunction
        Single output; where the search begins.
    form : {"controllable", "observable"}
    stages : bool
        Whether ψ joins the search.
    iterations : int
        Linearisations at most, in each of the two searches.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> model = LPVTransferFunction.siso([[-1.2, 0.3], [0.5, -0.2]], [[0, 0], [0.4, 0.1], [0.1, -0.3]],
    ...                                  Polynomial("p", degree=1), 1.0)
    >>> CanonicalForm(model).channels
    ('u1', 'y1', 'p')
    """

    source: LPVTransferFunction
    form: str = "controllable"
    stages: bool = True
    iterations: int = 60

    def __post_init__(self) -> None:
        if not isinstance(self.source, LPVTransferFunction):
            raise InputError("a form is estimated from a transfer function on", got=type(self.source).__name__,
                             mend="give an LPVTransferFunction, such as the model of an ARX estimate")
        _checks.count(self.iterations, "iterations")
        form_layout(self._realized)

    @property
    def _realized(self) -> Realization:
        return realize(self.source, self.form)

    @property
    def channels(self) -> tuple[str, ...]:
        signals = (*self.source.inputs, *self.source.outputs)
        return tuple(dict.fromkeys((*(s.name for s in signals), *self.source.box.names)))

    @property
    def start(self) -> int:
        return self._realized.model.start

    def estimate(self, records: Sequence[Record]) -> Identification:
        with single_thread():
            return self._estimate(records)

    def _estimate(self, records: Sequence[Record]) -> Identification:
        realized = self._realized
        layout = form_layout(realized)
        free = realized.model.replace(observer_gain=None)  # the free run is fitted, not the observer's prediction
        plain = SearchData.of(records, free)
        if plain.rows <= layout.size:
            raise TooFewSamples(f"{plain.rows} equations cannot determine {layout.size} parameters",
                                mend="give longer records, or lower the orders or the degree")
        begun = bounded_start(free, layout, plain, self.source.na)
        ends = [begun, refine(begun.model, _without_poles(layout), plain, iterations=LINEAR, free_coordinates=False)]
        held = min((refine(s.model, layout, plain, iterations=self.iterations, free_coordinates=False) for s in ends),
                   key=lambda s: s.evaluation.cost)
        notes = [f"simulation error in the {self.form} form: {held.iterations} Levenberg-Marquardt steps; stopped "
                 f"because {held.why}"]
        staged = StagedLayout.of(layout, held.model)
        if not self.stages or staged.size == layout.size:
            return self._packaged(held, layout, records, notes)
        data = StagedData.following(records, held.model, staged)
        found = refine(held.model, staged, data, iterations=self.iterations, free_coordinates=False)
        left = 100 * found.evaluation.cost / held.evaluation.cost
        notes.append(f"its stages with it: {found.iterations} further steps, mean square error {left:.3g} % of that "
                     f"with the stages held; stopped because {found.why}")
        return self._packaged(found, staged, records, notes)

    def _packaged(self, search: StateSpaceSearchEnd, layout: StateSpaceLayout, records: Sequence[Record],
                  notes: Sequence[str]) -> Identification:
        found = package(self, search, layout, records, notes, free_coordinates=False)
        stated = {"form": self.form, "refitted": True, "causal": True}
        return found.replace(model=found.model.replace(
            metadata={**found.model.metadata, **_kept(self.source), "realization": stated}))

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Plain values by name.
        """
        return {"kind": "canonical-form", "form": self.form, "stages": self.stages, "iterations": self.iterations,
                "source": self.source.metadata.get("structure")}


def _without_poles(layout: StateSpaceLayout) -> StateSpaceLayout:
    """The entries outside A: with A held the free run is linear in them, in either form."""
    rows = layout.table[layout.table[:, 1] != ARRAYS.index("A")]
    kept, place = np.unique(rows[:, 0], return_inverse=True)
    return StateSpaceLayout(np.column_stack([place, rows[:, 1:]]), tuple(layout.labels[i] for i in kept))


def _kept(source: LPVTransferFunction) -> dict:
    """What the form's file takes over from the transfer function's: not its parameters, nor its figures."""
    return {k: v for k, v in source.metadata.items() if k not in ("parameters", "structure", "training", "realization",
                                                                  "standard_errors", "hull")}
