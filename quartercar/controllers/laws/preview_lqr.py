"""Linear quadratic control with a register of the road ahead, clipped to what a damper can do."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import ClassVar

import numpy as np

from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial
from quartercar.controllers.contract import Law, Setting, Values
from quartercar.controllers.laws.clipped_optimal import STATES
from quartercar.controllers.laws.damping import HIGH, LOW
from quartercar.controllers.laws.mpc import STROKE, TYRE
from quartercar.controllers.laws.preview_model import LAG, LinearPreview, PreviewGains, PreviewModel
from quartercar.dampers.parameter import Parameter
from quartercar.parameters import CarParameters

EFFORT = Parameter("effort_weight", "", "r, of the demand", 0.3, 1e-2, 10.0, log=True)
"""A demand of little effort is mostly out of a damper's reach; what clipping makes best is found by tuning"""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class PreviewQuadratic(LinearPreview):
    """u = −K x − Σ_j K_j w(k+j), within what dampings from c_min to c_max can do.

    ::

        x(k+1) = A x(k) + B u(k) + E w(k)       x = (z_d, ż_s, z_t, ż_us, F, states of W_k)
        F(k+1) = F(k) + (1 − e^{−T/τ})(u(k) − F(k))
        minimise E[a_w² + ρ_t (F_t/m_s)² + ρ_z (k_s z_d/m_s)² + r (u/m_s)²]
        K   = (r' + Bᵀ P B)⁻¹ (Bᵀ P A + Sᵀ)               P of the discrete Riccati equation
        K_j = (r' + Bᵀ P B)⁻¹ Bᵀ ((A − B K)ᵀ)^j P E,  j = 0 … P − 1   w(k+j) the road's rate over sample k+j

    The gains do not depend on the speed: it gives how many samples ahead the front axle is, and so how many terms the
    sum has. The register is a chain of delays before a stable loop: the loop is stable for every course of the speed.
    """

    name: ClassVar[str] = "preview-lqr"
    title: ClassVar[str] = "Preview LQ, clipped"
    source: ClassVar[str] = "Tomizuka 1976, J. Dyn. Syst. Meas. Control 98, 309-315; Louam, Wilson, Sharp 1988"
    parameters: ClassVar[tuple[Parameter, ...]] = LOW, HIGH, TYRE, STROKE, EFFORT, LAG
    reads: ClassVar[tuple[str, ...]] = (*STATES, "suspension_velocity", "attained", "road_ahead")
    demands: ClassVar[str] = "force"

    def begin(self, values: Values, setting: Setting) -> Law:
        return self.running(values, setting)

    def preview_gains(self, values: Values, setting: Setting) -> PreviewGains:
        names = (TYRE.name, STROKE.name, EFFORT.name, LAG.name)
        rows = zip(*(values[n].tolist() for n in names), strict=True)
        loops = [preview_loop(setting.parameters, *row, setting.sample_time) for row in rows]
        gain, ahead = np.array([p.gain for p in loops]), np.array([p.ahead(setting.preview) for p in loops])
        return PreviewGains(gain, ahead, np.zeros(setting.cars))


@dataclass(frozen=True, eq=False)
class PreviewLoop:
    """A car, its weights and the gains over them.

    Attributes
    ----------
    step, control, road : (n, n), (n,), (n,) arrays
        A, B, E.
    shown, direct : (q, n), (q,) arrays
        Weighted outputs of the cost, C x + D u.
    gain : (n,) array
        K.
    riccati : (n, n) array
        P.
    sample_time : float
        [s].
    """

    step: np.ndarray
    control: np.ndarray
    road: np.ndarray
    shown: np.ndarray
    direct: np.ndarray
    gain: np.ndarray
    riccati: np.ndarray
    sample_time: float
    weight: float = field(default=1.0)

    def ahead(self, samples: int) -> np.ndarray:
        """(samples,) K_j.

        Parameters
        ----------
        samples : int
            How many terms of the sum; 0 for none.

        Returns
        -------
        (samples,) array
            [N·s/m], j rising from 0.
        """
        loop, row = self.step - np.outer(self.control, self.gain), self.riccati @ self.road
        out = np.empty(samples)
        for j in range(samples):
            out[j] = self.control @ row / self.weight
            row = loop.T @ row
        return out

    def closed(self, samples: int) -> LPVStateSpace:
        """The unclipped loop with a register of so many samples, from the road's rate that far ahead to the outputs.

        States x, then w(k) … w(k + samples − 1); without preview the road's rate enters as it comes.

        Parameters
        ----------
        samples : int
            Samples of the road ahead that are known; 0 for none.

        Returns
        -------
        LPVStateSpace
            Discrete and constant; from `road_rate` [m/s] to `comfort`, `tyre`, `stroke` and `effort`, each [m/s²] as
            weighted in the cost.
        """
        n, p = len(self.step), samples
        a, b = np.zeros((n + p, n + p)), np.zeros((n + p, 1))
        c = np.zeros((len(self.shown), n + p))
        a[:n, :n] = self.step - np.outer(self.control, self.gain)
        c[:, :n] = self.shown - np.outer(self.direct, self.gain)
        if p:
            k = self.ahead(p)
            a[:n, n:] -= np.outer(self.control, k)
            a[:n, n] += self.road
            c[:, n:] -= np.outer(self.direct, k)
            a[n:-1, n + 1:] = np.eye(p - 1)
            b[-1, 0] = 1.0
        else:
            b[:n, 0] = self.road
        outputs = tuple(Signal(name) for name in ("comfort", "tyre", "stroke", "effort"))
        return LPVStateSpace(a[None], b[None], c[None], np.zeros((1, len(c), 1)), Polynomial((), 0), self.sample_time,
                             inputs=(Signal("road_rate", "m/s"),), outputs=outputs)

    def norm(self, samples: int) -> float:
        """H2 norm of `closed`, from the Riccati equation: √(Eᵀ P E − Σ_{j<samples} (r' + Bᵀ P B) K_j²).

        Parameters
        ----------
        samples : int
            Samples of the road ahead that are known; 0 for none.

        Returns
        -------
        float
            Rms of the weighted outputs for a white sequence of the road's rate with unit variance [m/s² per m/s].
        """
        won = self.weight * np.sum(self.ahead(samples) ** 2)
        return float(np.sqrt(self.road @ self.riccati @ self.road - won))


@lru_cache(maxsize=1024)
def preview_loop(parameters: CarParameters, tyre_weight: float, stroke_weight: float, effort_weight: float,
                 force_lag: float, sample_time: float) -> PreviewLoop:
    """The optimal loop of a car's design model.

    Parameters
    ----------
    parameters : CarParameters
        Its damping is left out: all of the damper's force is the control.
    tyre_weight, stroke_weight, effort_weight : float
        ρ_t, ρ_z, r of `PreviewQuadratic`, dimensionless; r is positive.
    force_lag : float
        τ, from the demanded force to the damper's [s].
    sample_time : float
        T [s].

    Returns
    -------
    PreviewLoop
        Shared by equal arguments.

    Raises
    ------
    InputError
        Masses, springs and weights for which there is no optimum.

    Examples
    --------
    >>> from quartercar.parameters import MEGANE
    >>> loop = preview_loop(MEGANE, 0.3, 0.01, 0.3, 0.01, 1 / 512)
    >>> loop.norm(60) < loop.norm(20) < loop.norm(0)
    True
    """
    from scipy.linalg import LinAlgError, solve_discrete_are

    model = PreviewModel.of(parameters.replace(damping=0.0), tyre_weight, stroke_weight, force_lag, sample_time)
    a, b, e = model.step, model.control, model.road
    c, d = np.vstack([model.shown, np.zeros(len(a))]), np.zeros(4)
    d[3] = np.sqrt(effort_weight) / parameters.sprung_mass
    try:
        p = solve_discrete_are(a, b[:, None], c.T @ c, np.array([[d @ d]]), s=(c.T @ d)[:, None])
    except (LinAlgError, ValueError) as error:
        raise InputError("there is no optimal force with preview for this car and these weights",
                         got=f"tyre_weight {tyre_weight:g}, stroke_weight {stroke_weight:g}", why=str(error)) from None
    weight = float(d @ d + b @ p @ b)
    return PreviewLoop(a, b, e, c, d, (b @ p @ a + d @ c) / weight, p, sample_time, weight)
