"""Parameters of a state-space model together with those of its static input stage and of its scheduling filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.identification.state_space_layout import StateSpaceLayout
from lpvid.identification.state_space_search import SearchData
from lpvid.model.input_stage import InputStage
from lpvid.model.scheduling_stage import SchedulingStage
from lpvid.model.state_space import LPVStateSpace
from lpvid.record import Record
from lpvid.simulation import _columns

NUDGE = 1e-6
"""central difference of a scheduling filter's parameter, in units of its search scale: the cube root of the rounding
error, where truncation and rounding of a central difference meet."""


@dataclass(frozen=True, eq=False)
class StagedLayout(StateSpaceLayout):
    """A layout of matrix entries, followed by ψ: what is free of the input stage, then of the scheduling filter.

    Attributes
    ----------
    stage, lag : tuple of int
        Free places in the vectors of the input stage and of the scheduling filter.
    """

    stage: tuple[int, ...] = ()
    lag: tuple[int, ...] = ()

    @classmethod
    def of(cls, layout: StateSpaceLayout, model: LPVStateSpace) -> StagedLayout:
        """The layout with every parameter of the model's stages that a search may move.

        Parameters
        ----------
        layout : StateSpaceLayout
            Of the matrix entries.
        model : LPVStateSpace
            Whose stages are searched.

        Returns
        -------
        StagedLayout
        """
        reach = float(model.box.half_width[0]) if model.box.names else 0.0
        scales = [np.zeros(0) if s is None else s.scales(reach) if isinstance(s, InputStage) else s.scales()
                  for s in (model.input_stage, model.scheduling_stage)]
        return cls(layout.table, layout.labels, *(tuple(np.flatnonzero(s > 0).tolist()) for s in scales))

    @property
    def linear(self) -> StateSpaceLayout:
        """The matrix entries alone."""
        return StateSpaceLayout(self.table, self.labels)

    @property
    def size(self) -> int:
        """Number of parameters, ψ included."""
        return self.linear.size + len(self.stage) + len(self.lag)

    def fill(self, model: LPVStateSpace, theta: np.ndarray) -> LPVStateSpace:
        """The model with these parameters; those of the stages are brought into their admissible range.

        Parameters
        ----------
        model : LPVStateSpace
            Gives everything but the parameters.
        theta : (k,) array
            Matrix entries, then ψ.

        Returns
        -------
        LPVStateSpace
        """
        cut = self.linear.size
        filled, stage, lag = self.linear.fill(model, theta[:cut]), model.input_stage, model.scheduling_stage
        if stage is not None and self.stage:
            filled = filled.replace(input_stage=stage.with_vector(_placed(
                stage.vector, self.stage, theta[cut: cut + len(self.stage)])))
        if lag is not None and self.lag:
            filled = filled.replace(scheduling_stage=lag.with_vector(_placed(
                lag.vector, self.lag, theta[cut + len(self.stage):])))
        return filled

    def read(self, model: LPVStateSpace) -> np.ndarray:
        """(k,) parameters of a model of this layout.

        Parameters
        ----------
        model : LPVStateSpace
            Of this layout.

        Returns
        -------
        (k,) array
            Matrix entries, then ψ.
        """
        stages = ((model.input_stage, self.stage), (model.scheduling_stage, self.lag))
        own = [s.vector[list(places)] for s, places in stages if s is not None and places]
        return np.concatenate([self.linear.read(model), *own])


@dataclass(frozen=True, eq=False)
class StagedData(SearchData):
    """Search data whose basis values and filter inputs follow the model's stages.

    Attributes
    ----------
    measured : tuple of (u (n, n_inputs), p (n, n_scheduling))
        As logged, before any stage.
    layout : StagedLayout
        Which parameters of the stages move.
    """

    measured: tuple[tuple[np.ndarray, np.ndarray], ...] = ()
    layout: StagedLayout | None = None

    @classmethod
    def following(cls, records: Sequence[Record], model: LPVStateSpace, layout: StagedLayout) -> StagedData:
        """The records, and what is needed to pass them through other stages.

        Parameters
        ----------
        records : sequence of Record
            Uniform and finite.
        model : LPVStateSpace
            Where the search starts.
        layout : StagedLayout
            Which parameters of the stages move.

        Returns
        -------
        StagedData
        """
        plain = SearchData.of(records, model)
        measured = tuple((_columns(r, model.inputs), r.matrix(model.box.names)) for r in records)
        return cls(plain.pieces, plain.weight, plain.limit, measured, layout)

    def at(self, model: LPVStateSpace) -> SearchData:
        """The data as this model's stages see them.

        Parameters
        ----------
        model : LPVStateSpace
            At the present parameters.

        Returns
        -------
        SearchData
        """
        pieces = []
        for (u, p), (_, _, y) in zip(self.measured, self.pieces, strict=True):
            phi, driven = _driven(model, model.input_stage, model.scheduling_stage, u, p)
            pieces.append((np.ascontiguousarray(phi), np.ascontiguousarray(driven), y))
        return SearchData(tuple(pieces), self.weight, self.limit)

    def tangents(self, model: LPVStateSpace) -> list[tuple[np.ndarray, np.ndarray]]:
        """Per record ∂φ/∂ψ (n, M, s) and ∂u/∂ψ (n, nu, s).

        The input stage's are exact. Those of a scheduling filter are central differences of its trajectory (not of the
        model's run), which for a first-order lag are exact to about 1e-9.

        Parameters
        ----------
        model : LPVStateSpace
            At the present parameters.

        Returns
        -------
        list of ((n, M, s) array, (n, nu, s) array)
            s the number of free stage parameters; zero where the filter's range leaves no room for a difference.
        """
        assert self.layout is not None
        out = []
        for u, p in self.measured:
            phi, driven = _driven(model, model.input_stage, model.scheduling_stage, u, p)
            free = len(self.layout.stage) + len(self.layout.lag)
            d_phi, d_u = np.zeros((*phi.shape, free)), np.zeros((*driven.shape, free))
            if model.input_stage is not None and self.layout.stage:
                moved = p if model.scheduling_stage is None else model.scheduling_stage.apply(p, _period(model))
                d_u[:, :, : len(self.layout.stage)] = model.input_stage.slopes(u, moved)[:, :, list(self.layout.stage)]
            for q, place in enumerate(self.layout.lag, start=len(self.layout.stage)):
                lag = model.scheduling_stage
                assert lag is not None
                ends = []
                for sign in (1.0, -1.0):
                    vector = lag.vector
                    vector[place] += sign * NUDGE * lag.scales()[place]
                    other = lag.with_vector(vector)
                    ends.append((other.vector[place], *_driven(model, model.input_stage, other, u, p)))
                (high, phi_up, u_up), (low, phi_down, u_down) = ends
                if high > low:
                    d_phi[:, :, q], d_u[:, :, q] = (phi_up - phi_down) / (high - low), (u_up - u_down) / (high - low)
            out.append((d_phi, d_u))
        return out


def _driven(model: LPVStateSpace, stage: InputStage | None, lag: SchedulingStage | None, u: np.ndarray,
            p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Basis values and filter inputs that stages make of measured signals."""
    moved = p if lag is None else lag.apply(p, _period(model))
    return model.basis.evaluate(moved), u if stage is None else stage.apply(u, moved)


def _period(model: LPVStateSpace) -> float:
    assert model.sample_time is not None
    return model.sample_time


def _placed(vector: np.ndarray, places: tuple[int, ...], values: np.ndarray) -> np.ndarray:
    out = np.array(vector, dtype=float)
    out[list(places)] = values
    return out
