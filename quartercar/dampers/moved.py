"""A damper model of lpvid in another sense: its force with the other sign, its displacement from another zero."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lpvid.errors import InputError
from lpvid.model.compliance import ComplianceModel
from lpvid.model.quasi import QuasiLPVModel, SelfScheduled
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Polynomial, Spline

Movable = LPVTransferFunction | LPVStateSpace | SelfScheduled


def moved(model: Movable, polarity: int, zero: float) -> Movable:
    """The model of F' = ±F along x' = x − x_0, exactly; everything else that it reads stays.

    ::

        transfer function   b' = ±b,  c' = ±(c + x_0 Σ_j b_j)                       −Σ a y and ± commute
        state space         f' = f + B x_0,  g' = ±(g + D x_0),  C' = ±C,  D' = ±D,  K' = ±K
        own scheduling      ρ = ±ρ' + x_0 Σ κ: knots (or centre) of its functions move and turn with it

    Parameters
    ----------
    model : LPVTransferFunction, LPVStateSpace, QuasiLPVModel or ComplianceModel
        One output; the displacement is an input of that name.
    polarity : {1, −1}
        Sign of the new force in terms of the old one.
    zero : float
        x_0, value of the old displacement that the new one calls zero [m].

    Returns
    -------
    LPVTransferFunction, LPVStateSpace, QuasiLPVModel or ComplianceModel
        Of the kind of `model`; `model` itself where neither sign nor zero changes.

    Raises
    ------
    InputError
        What has no exact form: a displacement that a static stage or a compliance's law bends, a compliance that gives
        energy.
    """
    offset = np.array([zero if s.name == "displacement" else 0.0 for s in model.inputs])
    if polarity > 0 and not offset.any():
        return model
    stage = model.input_stage
    if stage is not None:
        if offset[stage.channel]:
            raise InputError("the displacement of this model cannot be given another zero",
                             got=f"a static stage that bends '{model.inputs[stage.channel].name}'",
                             mend="subtract the rest position from the channel and identify again")
        offset = np.concatenate([offset, np.zeros(len(stage.signals(model.inputs)) - len(offset))])
    if isinstance(model, LPVTransferFunction):
        return _transfer_function(model, polarity, offset)
    if isinstance(model, LPVStateSpace):
        return _state_space(model, polarity, offset)
    if isinstance(model, QuasiLPVModel):
        return _quasi(model, polarity, offset)
    if isinstance(model, ComplianceModel):
        return _compliance(model, polarity, offset)
    raise InputError("a model of this kind cannot be given another sense", got=type(model).__name__)


def _transfer_function(model: LPVTransferFunction, polarity: int, offset: np.ndarray) -> LPVTransferFunction:
    assert model.c is not None
    c = model.c
    if offset.any():
        gain = np.einsum("jyum,u->jym", model.b, offset).sum(axis=0)
        if model.lagged and model.basis.size > 1:  # coefficients of lag j at p(k − j): so are their constants
            c = np.zeros((max(len(model.b), len(c)), *gain.shape))
            c[: len(model.c)] += model.c
            c[: len(model.b)] += np.einsum("jyum,u->jym", model.b, offset)
        else:
            c = c.copy() if len(c) else np.zeros((1, *gain.shape))
            c[0] += gain
    return model.replace(b=polarity * model.b, c=polarity * c)


def _state_space(model: LPVStateSpace, polarity: int, offset: np.ndarray) -> LPVStateSpace:
    assert model.state_offset is not None and model.output_offset is not None
    gain = model.observer_gain
    return model.replace(state_offset=model.state_offset + model.B @ offset, C=polarity * model.C, D=polarity * model.D,
                         output_offset=polarity * (model.output_offset + model.D @ offset),
                         observer_gain=None if gain is None else polarity * gain)


def _quasi(model: QuasiLPVModel, polarity: int, offset: np.ndarray) -> QuasiLPVModel:
    """ρ of the trial is y(k−1) + Σ κ u: with y = ±y' and u = u' + u_0 it is ±[y'(k−1) ± Σ κ u'] + u_0 Σ κ."""
    sign = 1 if model.on == "input" else polarity
    shift = float(offset[0]) if model.on == "input" else float(offset[0] * model.kappa.sum())
    theta = model.theta.copy()
    column = model.na
    for count, by in zip(model.nb, offset, strict=True):
        theta[:, :, -1] += by * theta[:, :, column: column + count].sum(axis=2)
        column += count
    theta[:, :, model.na:] *= polarity
    own = model.own
    if isinstance(own, Spline):
        knots = sign * (np.array(own.knots) - shift)
        own, theta = replace(own, knots=tuple(knots[::sign])), theta[::sign]
    else:
        assert isinstance(own, Polynomial)
        own = replace(own, centre=(sign * (own.centre[0] - shift),))
        theta = theta * (float(sign) ** np.arange(len(theta)))[:, None, None]
    return model.replace(theta=theta, own=own, kappa=sign * model.kappa)


def _compliance(model: ComplianceModel, polarity: int, offset: np.ndarray) -> ComplianceModel:
    if polarity < 0:
        raise InputError("a compliance model has no reversed form", why="its law rises with the velocity by "
                         "construction", mend="turn the force (--flip force) and identify again")
    if offset[0]:
        raise InputError("a compliance model whose law reads the displacement has one zero only",
                         mend="--input velocity, with --side displacement")
    return model.replace(offset=model.offset + float(model.side @ offset[1:]))

