"""Realization: a state-space form of a transfer function, and what is known about it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lpvid import _checks
from lpvid.condition.tables import as_records
from lpvid.errors import InputError
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization.augmented import augmented
from lpvid.realization.controllable import controllable
from lpvid.realization.layout import RealizationLayout, build
from lpvid.realization.observable import observable, shifted_observable
from lpvid.record import Record
from lpvid.simulation import _outputs, _signals

if TYPE_CHECKING:
    from lpvid.realization.gap import Gap

FORMS: dict[str, Callable[[LPVTransferFunction], RealizationLayout]] = {
    "controllable": controllable,
    "observable": observable,
    "shifted": shifted_observable,
    "augmented": augmented,
}


@dataclass(frozen=True, eq=False)
class Realization:
    """A state-space model made from an input-output model.

    Attributes
    ----------
    model : LPVStateSpace
        The result; an innovation form (with observer gain) wherever the form has one.
    form : str
        "controllable", "observable", "shifted" or "augmented".
    exact : bool
        True when the form reproduces the input-output model for any scheduling trajectory; every form does so while
        the scheduling is constant.
    causal : bool
        True when the form reads p(k) and earlier only.
    source : LPVTransferFunction
        The model it was made from.
    settling : int
        Outputs from which `initial_state` recovers the state.
    """

    model: LPVStateSpace
    form: str
    exact: bool
    causal: bool
    source: LPVTransferFunction
    settling: int

    def initial_state(self, record: Record) -> np.ndarray:
        """State at the record's first sample with which the free run continues the measured start.

        In an exact form the run then equals the transfer function's, started from its first ``source.start``
        measured samples; in an inexact one the first outputs are matched in the least-squares sense. The state of the
        augmented form is a past that would have led to the measured start, so it needs a_na(p) away from zero.

        Parameters
        ----------
        record : Record
            With the model's inputs, scheduling and outputs.

        Returns
        -------
        (n,) array

        Raises
        ------
        InputError
            A record shorter than the start, or with missing channels.
        """
        model, start = self.model, max(self.source.start, self.settling)
        if record.n_samples < start:
            raise InputError(f"the state of this model is recovered from {start} measured samples",
                             got=f"{record.n_samples} samples", mend="give a longer record")
        if not model.order:
            return np.zeros(0)
        u, p = _signals(model, record)
        y = _outputs(model, record.slice(0, start))
        influence, forced = _affine_response(model, model.basis.evaluate(p)[:start], u)
        rows = slice(start - max(self.settling, 1), start)
        matrix = influence[rows].reshape(-1, model.order)
        return np.linalg.lstsq(matrix, (y - forced)[rows].ravel(), rcond=None)[0]

    def gap(self, records: Record | Sequence[Record], label: str = "") -> Gap:
        """What this form costs on given scheduling trajectories: free runs of both models compared.

        Parameters
        ----------
        records : Record or sequence of Record
            With the model's inputs and scheduling. Where they hold the measured outputs too, ``.verdict`` weighs the
            gap against the model's own error (`Judgement`).
        label : str
            "training" or "held-out", as the figures are labelled.

        Returns
        -------
        Gap
        """
        from lpvid.realization.gap import measure_gap

        return measure_gap(self, as_records(records), label)

    def to_dict(self) -> dict:
        """Plain data for JSON: the state-space model; its metadata state how it was made.

        Returns
        -------
        dict
            Plain values by name.
        """
        return self.model.to_dict()

    def __repr__(self) -> str:
        if self.exact:
            verdict = "exact for any scheduling trajectory"
        else:
            verdict = "equal to the input-output model for frozen scheduling only (measure it with .gap(records))"
        low = self.model.basis.lags[0]
        causal = "causal" if self.causal else f"NOT causal: it reads the scheduling {-low} sample(s) ahead"
        return f"Realization ({self.form}): {verdict}; {causal}\n  {self.model!r}"


def realize(model: LPVTransferFunction, form: str = "augmented") -> Realization:
    """Turn an input-output model into state space.

    ============= ======================= ================== =========================================================
    form          exact for moving p      causal             states
    ============= ======================= ================== =========================================================
    controllable  no                      yes                order per filter input (and per affine part); one output
    observable    coefficients at p(k−i)  yes                order × outputs
    shifted       yes                     coeff. at p(k−i)   order × outputs
    augmented     yes                     yes                na × outputs + past inputs
    ============= ======================= ================== =========================================================

    The observable, shifted and augmented forms are innovation forms: one step ahead they predict as the input-output
    equation does. A model of another noise kind is realised without observer gain. What does not depend on p at all is
    exact in every form.

    Parameters
    ----------
    model : LPVTransferFunction
    form : {"controllable", "observable", "shifted", "augmented"}

    Returns
    -------
    Realization

    Raises
    ------
    InputError
        An unknown form, a model with several outputs in the controllable form.

    References
    ----------
    Díaz Salas 2011 (3.8)-(3.13); Tóth, Abbas & Werner 2012.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> model = LPVTransferFunction.siso([[-1.2, 0.3], [0.5, -0.2]], [[0, 0], [0.4, 0.1], [0.1, -0.3]],
    ...                                  Polynomial("p", degree=1), 1.0)
    >>> realize(model, "observable").exact, realize(model, "shifted").causal, realize(model, "augmented").model.order
    (False, False, 4)
    """
    if not isinstance(model, LPVTransferFunction):
        raise InputError("only an input-output model can be realised", got=type(model).__name__,
                         mend="give an LPVTransferFunction")
    layout = FORMS[_checks.one_of(form, tuple(FORMS), "form")](model)
    if model.noise.kind != "equation":  # those gains belong to equation noise
        layout = replace(layout, arrays={k: v for k, v in layout.arrays.items() if k != "observer_gain"})
    stated = {"form": form, "exact": layout.exact}
    state_space = build(model, layout, {**model.metadata, "realization": stated})
    causal = state_space.basis.lags[0] >= 0
    stated["causal"] = causal
    return Realization(state_space.replace(metadata={**model.metadata, "realization": stated}), form, layout.exact,
                       causal, model, layout.settling)


def _affine_response(model: LPVStateSpace, phi: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Free-run outputs as influence (n, ny, nx) of the first state plus a forced part (n, ny)."""
    assert model.state_offset is not None and model.output_offset is not None
    n, nx = len(phi), model.order
    influence, forced = np.zeros((n, model.n_outputs, nx)), np.zeros((n, model.n_outputs))
    spread, drift = np.eye(nx), np.zeros(nx)
    for k in range(n):
        a, b, c, d, f, g = (np.tensordot(phi[k], x, axes=1) for x in (
            model.A, model.B, model.C, model.D, model.state_offset, model.output_offset))
        influence[k], forced[k] = c @ spread, c @ drift + d @ u[k] + g
        spread, drift = a @ spread, a @ drift + b @ u[k] + f
    return influence, forced
