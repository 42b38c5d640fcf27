"""What passivity requires of an input-output model: a storage function of its past, and what its input stage can give.

With x(k) = [y(k−1) … y(k−na), u(k−1) …], the past itself, every model whose coefficients are taken at p(k) is

    y = h(p)ᵀ [x; u],     x⁺ = S [x; u] + e₁ y,     u = [v, w],   w = tanh(v/v₀(p))

with a constant shift S. The stage obeys w v ≥ v₀(p) w² (0 ≤ tanh(z)² ≤ z tanh(z)), so that for any λ(p) ≥ 0

    M(p, p⁺) = [P(p) 0; 0 0] + He(½ e_v hᵀ) − λ He(½ e_w e_vᵀ) + λ v₀ e_w e_wᵀ − [A B]ᵀ P(p⁺) [A B] ≻ 0,   P ≻ 0

proves xᵀP x|_{k+1} − xᵀP x|_k ≤ y(k) v(k) along every motion of p (dissipation inequality of Willems 1972 with the
S-procedure; P(p⁺) as Daafouz & Bernussou 2001).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError
from lpvid.lmi.certificate import diagonal
from lpvid.lmi.driven import Driven
from lpvid.lmi.inequality import LyapunovInequality, Pieces
from lpvid.lmi.storage import Storage
from lpvid.model.input_stage import TanhStage
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.scheduling import Polynomial, Stacked

PRELOAD = 1e-9
"""share of the affine coefficients' size within which they count as those of a constant preload: rounding."""


def obstacle(model: object) -> str:
    """Why no statement on the passivity of a model can be made; empty if one can.

    Parameters
    ----------
    model : object
        Any model.

    Returns
    -------
    str
        The first of: kind of model, number of signals, input stage, time at which coefficients are taken.
    """
    if not isinstance(model, LPVTransferFunction):
        return f"passivity is stated of transfer functions, not of a {type(model).__name__}"
    if model.n_outputs != 1 or len(model.inputs) != 1:
        return f"passivity needs one input and one output, not {len(model.inputs)} and {model.n_outputs}"
    if not (model.input_stage is None or isinstance(model.input_stage, TanhStage)):
        return "passivity behind an input stage is stated of the tanh stage only"
    if model.lagged:
        return "passivity is stated of coefficients taken at p(k), not at p(k-i)"
    return ""


def preload(model: LPVTransferFunction) -> float | None:
    """The constant F₀ that the affine terms add to the output whatever p does, or None where they add anything else.

    c(p) = F₀ (1 + Σ a_i(p)) leaves y − F₀ a model without affine terms. Any other affine term is a force at rest that
    depends on p, which does work when p moves: no storage function of the past covers it.

    Parameters
    ----------
    model : LPVTransferFunction
        With one input and one output.

    Returns
    -------
    float or None
        [unit of the output]; 0 without affine terms.
    """
    assert model.c is not None
    if not model.c.any():
        return 0.0
    unity = model.basis.unity
    if unity is None:
        return None
    whole = model.c[:, 0].sum(axis=0)
    late = model.c[1:, 0] - np.outer(model.c[1:, 0] @ unity / (unity @ unity), unity)
    below = unity + model.a[:, 0, 0].sum(axis=0)
    force = float(whole @ below / (below @ below))
    size = max(float(np.abs(whole).max()), 1e-300)
    fits = np.abs(whole - force * below).max() <= PRELOAD * size and np.abs(late).max(initial=0.0) <= PRELOAD * size
    return force if fits else None


def slack(model: LPVTransferFunction, points: np.ndarray) -> np.ndarray:
    """(N,) v₀(p), a lower bound of the tanh stage's scale; zeros without a stage.

    The stage keeps its scale above a floor, max(v₀ + slope p, floor) ≥ v₀ + slope p, so that the sector holds with the
    straight line also where the floor is reached.

    Parameters
    ----------
    model : LPVTransferFunction
        With a tanh stage or none.
    points : (N, variables) array
        Scheduling values, one column for each variable of the model's box.

    Returns
    -------
    (N,) array
        [unit of the input]; negative where the straight line is.
    """
    stage = model.input_stage
    if not isinstance(stage, TanhStage):
        return np.zeros(len(points))
    moving = points[:, stage.variable] if points.shape[1] else 0.0
    return stage.v0 + stage.slope * moving + np.zeros(len(points))


def sector_basis(model: LPVTransferFunction) -> Polynomial:
    """Basis of the multiplier λ(p): affine in the variables that the model depends on.

    Parameters
    ----------
    model : LPVTransferFunction
        Its basis and its stage.

    Returns
    -------
    Polynomial
        The constant 1 where nothing depends on p.
    """
    names = [r.name for r in model.basis.readings() if r.degree or r.frequency]
    stage = model.input_stage
    if isinstance(stage, TanhStage) and stage.slope and model.box.names:
        names.append(model.box.names[stage.variable])
    names = tuple(dict.fromkeys(names))
    return Polynomial(names, 1 if names else 0).bound(model.box)


def supplied(model: LPVTransferFunction, multiplier: np.ndarray) -> Driven:
    """The model from u = [v, w] to [y, λ w, λ v₀ w]: the last two rows carry the multiplier's functions of p.

    Parameters
    ----------
    model : LPVTransferFunction
    multiplier : (K,) array
        λ over `sector_basis`; empty without a stage.

    Returns
    -------
    Driven
        With the past as its state.

    Raises
    ------
    InputError
        A model of which nothing can be stated.
    """
    fault = obstacle(model)
    if fault:
        raise InputError("no statement on passivity", why=fault)
    na, nu, past = model.na, model.n_filter_inputs, max(model.n_lags - 1, 0)
    n, m = na + past * nu, model.basis.size
    affine = sector_basis(model)
    squared = Polynomial(affine.names, 2 * affine.degree).bound(model.box)
    rows = 1 + 2 * (nu - 1)
    total = np.zeros((m + squared.size + 1, n + rows, n + nu))
    y = np.concatenate([-model.a[:, 0, 0].T, model.b[1:, 0].transpose(2, 0, 1).reshape(m, past * nu),
                        model.b[0, 0].T if model.n_lags else np.zeros((m, nu))], axis=1)
    total[:m, n] = y
    if na:
        total[:m, 0] = y
    total[-1, :n] += shift(na, nu, past)
    if nu > 1:
        total[m : m + affine.size, n + 1, n + 1] = multiplier
        total[m : m + squared.size, n + 2, n + 1] = _product(model, multiplier, affine, squared)
    basis = Stacked((model.basis, squared))
    found = tuple(r for r in basis.readings() if r.degree or r.frequency)
    stage = "" if model.input_stage is None else repr(sorted(model.input_stage.to_dict().items()))
    text = repr((model.basis.to_dict(), model.sample_time, total.shape, stage))
    digest = hashlib.sha256(text.encode() + np.ascontiguousarray(total[:m], dtype="<f8").tobytes()).hexdigest()
    outputs = (model.outputs[0].name, *(("λw", "λv₀w") if nu > 1 else ()))
    return Driven(total, n, basis, found, model.sample_time, digest,
                  tuple(s.name for s in model.filter_inputs), outputs)


def shift(na: int, nu: int, past: int) -> np.ndarray:
    """(n, n + nu) what moves the past one sample on, the new output left out.

    Parameters
    ----------
    na : int
        Outputs in the past.
    nu : int
        Inputs, that behind the stage included.
    past : int
        Samples of the inputs in the past.

    Returns
    -------
    (n, n + nu) array
        n = na + past·nu; ones and zeros.
    """
    n = na + past * nu
    out = np.zeros((n, n + nu))
    out[np.arange(1, na), np.arange(na - 1)] = 1.0
    if past:
        out[np.arange(na, na + nu), np.arange(n, n + nu)] = 1.0
        out[np.arange(na + nu, n), np.arange(na, n - nu)] = 1.0
    return out


def _product(model: LPVTransferFunction, multiplier: np.ndarray, affine: Polynomial, squared: Polynomial) -> np.ndarray:
    """Coefficients of λ(p) v₀(p) over the squared basis, which holds it exactly."""
    box = model.box
    columns = [box.names.index(n) for n in affine.names]
    points = box.grid(5) if box.names else np.zeros((1, 0))
    values = (affine.evaluate(points[:, columns]) @ multiplier) * slack(model, points)
    phi = squared.evaluate(points[:, columns])
    return np.linalg.lstsq(phi, values, rcond=None)[0]


@dataclass(frozen=True, eq=False)
class Dissipation(LyapunovInequality):
    """M(p, p⁺) ≻ 0 for what `supplied` builds.

    Parameters
    ----------
    system : Driven
        As `supplied` builds it: the model with its multiplier.
    storage : Storage
        xᵀP(p)x of the past.
    """

    system: Driven
    storage: Storage
    power: int = 2

    def matrix(self, pieces: Pieces) -> np.ndarray:
        q, n, nu = pieces, self.system.order, len(self.system.inputs)
        both = np.concatenate([q.A, q.B], axis=3)
        value = q.sign * (both.swapaxes(2, 3) @ q.later @ both)
        value[:, :, :n, :n] += q.P
        output = np.concatenate([q.C, q.D], axis=3)
        value[:, :, n, :] += 0.5 * output[:, :, 0]
        value[:, :, :, n] += 0.5 * output[:, :, 0]
        if nu > 1:
            value[:, :, n, n + 1] += q.sign * 0.5 * q.D[:, :, 1, 1]
            value[:, :, n + 1, n] += q.sign * 0.5 * q.D[:, :, 1, 1]
            value[:, :, n + 1, n + 1] += q.D[:, :, 2, 1]
        return value

    def congruence(self, root: np.ndarray) -> np.ndarray:
        """P(centre) to the identity, and the inputs' own entries of M(centre) to one."""
        n, nu = len(root), len(self.system.inputs)
        scale = diagonal(root, np.eye(nu))
        moves = np.full((1, len(self.storage.box.names)), 0.5)
        value, _ = self.evaluate(self.storage.box.centre[None, :], moves, scale)
        own = np.diag(value[0, 0])[n:]
        scale[n:, n:] = np.diag(1 / np.sqrt(np.where(own > 0, own, 1.0)))
        return scale
