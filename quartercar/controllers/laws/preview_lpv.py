"""LPV control with a register of the road ahead, certified for every course of the speed and of the attained share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np

from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial, Scheduling
from lpvid.toolkit import checks
from quartercar.controllers.contract import Law, Setting, Signals, Values
from quartercar.controllers.laws.clipped_optimal import STATES
from quartercar.controllers.laws.damping import HIGH, LOW
from quartercar.controllers.laws.horizon_uncertainty import sum_of_powers
from quartercar.controllers.laws.mpc import STROKE, TYRE
from quartercar.controllers.laws.preview_lqr import EFFORT
from quartercar.controllers.laws.preview_model import LAG, LinearPreview, LinearPreviewLaw, PreviewGains, PreviewModel
from quartercar.dampers.parameter import Parameter
from quartercar.parameters import CarParameters

NOMINAL = Parameter("nominal_damping", "N*s/m", "c_nom of the design", 2700.0, 300.0, 5000.0, log=True)
DEFAULTS = {LOW: 500.0, HIGH: 10e3, TYRE: 0.08, STROKE: 0.03, EFFORT: 0.5, LAG: 0.0015}
"""Of the embedded damper on ISO C: the best of 48 evaluations, half comfort and half tyre load, rounded"""
CRITERIA = ("h2", "hinf")
SHARE = "given_share"
LARGEST_SHARE = 2.0
"""of a demand, up to which the storage function falls: V is a parabola in u with its minimum at the demand"""
STILL = 1.0
"""demand below which no share is counted [N], a thousandth of a damper's force"""
SLOWEST = 1e-9
"""decay per sample below which rounding decides whether a mode decays"""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class PreviewStorage(LinearPreview):
    """F = c_nom v_d + u, u the demand that makes the cost to come of the car left at c_nom least, one sample at a time.

    ::

        x(k+1) = A x(k) + s(k) B u(k) + E w(k)            z = (C x, s √r u/m_s)        A with F = c_nom v_d
        the road's rates w(k) … w(k + N(k) − 1) known, N = L/(v T) by the speed v; s(k) ∈ [0, 2] the attained share
        V_N(x, w) = Σ_{i<N} |C x_i|² + x_Nᵀ Π x_N          x_i of the car left at c_nom
        u = argmin r (u/m_s)² + V_{N−1}(A x + B u + E w(k); w(k+1) …) = −K x − Σ_{j<N} K_j w(k+j)
        K   = (r' + Bᵀ P_{N−1} B)⁻¹ Bᵀ P_{N−1} A           P_0 = Π,  P_n = CᵀC + Aᵀ P_{n−1} A
        K_j = (r' + Bᵀ P_{N−1} B)⁻¹ Bᵀ (Aᵀ)^j P_{N−1−j} E

    Scheduling variables are the speed, which sets N, and s: what the damper makes of a demand. Both may move in any
    way, as long as a known sample of the road is not forgotten (N(k+1) ≥ N(k) − 1). V is a parabola in u, so that for
    every s ∈ [0, 2] it falls by (2s − s²)(r' + BᵀP_{N−1}B) u² more than in the car left at c_nom.

    - ``criterion="h2"``: Π = CᵀC + AᵀΠA. For white w of unit variance E|z|² = EᵀΠE − E[(2s − s²)(r' + BᵀΠB) u²].
    - ``criterion="hinf"``: Π of the bounded-real Riccati equation of the car left at c_nom for
      γ = back_off · (its norm). Then Σ|z|² ≤ γ² Σ w² from rest.

    So neither is ever worse than in the car at c_nom. With a long register both are nearly the same law, since Π enters
    by (Aᵀ)^N Π A^N alone.

    Attributes
    ----------
    criterion : {"h2", "hinf"}
    back_off : float
        γ over the norm of the car left at c_nom; for "hinf".
    """

    name: ClassVar[str] = "preview-lpv"
    title: ClassVar[str] = "LPV with road register"
    source: ClassVar[str] = "Tseng, Hedrick 1994, Vehicle System Dynamics 23, 545-569; Scruggs, Taflanidis, Iwan " \
                            "2007, Struct. Control Health Monit. 14, 1101-1120; here with preview"
    parameters: ClassVar[tuple[Parameter, ...]] = (*(replace(p, default=v) for p, v in DEFAULTS.items()), NOMINAL)
    reads: ClassVar[tuple[str, ...]] = (*STATES, "suspension_velocity", "attained", "road_ahead")
    demands: ClassVar[str] = "force"

    criterion: str = "h2"
    back_off: float = 1.1

    def check_settings(self) -> None:
        checks.one_of(self.criterion, CRITERIA, "criterion of preview-lpv")
        if checks.real(self.back_off, "back_off of preview-lpv") <= 1:
            raise InputError("back_off of preview-lpv must be above 1", got=f"{self.back_off:g}",
                             why="the car left at its nominal damping has no lower bound than its own norm")

    def begin(self, values: Values, setting: Setting) -> Law:
        return _ShareCountingLaw(self.running(values, setting))

    def preview_gains(self, values: Values, setting: Setting) -> PreviewGains:
        names = (TYRE.name, STROKE.name, EFFORT.name, LAG.name, NOMINAL.name)
        rows = zip(*(values[n].tolist() for n in names), strict=True)
        back_off = None if self.criterion == "h2" else self.back_off
        found = [preview_storage(setting.parameters, *row, setting.sample_time, back_off) for row in rows]
        gain, ahead = (np.array(g) for g in zip(*(s.gains(setting.preview) for s in found), strict=True))
        return PreviewGains(gain, ahead, values[NOMINAL.name])


@dataclass(frozen=True, eq=False)
class StorageWithRegister:
    """A car left at its nominal damping, what it costs with so much of the road known, and the demand that follows.

    Attributes
    ----------
    model : PreviewModel
    effort : float
        r' = r/m_s² [(m/s²)²/N²].
    terminal : (n, n) array
        Π.
    gamma : float or None
        γ of the bound [m/s² per m/s]; None for H2.
    """

    model: PreviewModel
    effort: float
    terminal: np.ndarray
    gamma: float | None

    def costs(self, samples: int) -> list[np.ndarray]:
        """P_0 … P_samples.

        Parameters
        ----------
        samples : int
            N.

        Returns
        -------
        list of (n, n) arrays
            Each is that of the cost to come with so many samples of the road known.
        """
        a, q = self.model.step, self.model.shown.T @ self.model.shown
        found = [self.terminal]
        for _ in range(samples):
            found.append(q + a.T @ found[-1] @ a if self.gamma is not None else self.terminal)
        return found

    def gains(self, samples: int) -> tuple[np.ndarray, np.ndarray]:
        """K and K_j.

        Parameters
        ----------
        samples : int
            N, 0 for no preview.

        Returns
        -------
        (n,), (samples,) arrays
            [N per unit of x], [N·s/m] with j rising from 0.
        """
        m = self.model
        if samples:
            p = self.costs(samples - 1)
        else:
            p = [self.terminal if self.gamma is None else worst_road(self.terminal, m.road, self.gamma)]
        weight = self.effort + m.control @ p[-1] @ m.control
        row, ahead = m.control, np.empty(samples)
        for j in range(samples):
            ahead[j] = row @ p[-1 - j] @ m.road / weight
            row = m.step @ row
        return m.control @ p[-1] @ m.step / weight, ahead

    def storage(self, samples: int) -> np.ndarray:
        """V_N as a matrix over (x, w(k) … w(k + N − 1)).

        Parameters
        ----------
        samples : int
            N.

        Returns
        -------
        (n + N, n + N) array
            Symmetric.
        """
        m, n = self.model, len(self.model.step)
        reach, total = np.eye(n, n + samples), np.zeros((n + samples, n + samples))
        for i in range(samples):
            row = m.shown @ reach
            total += row.T @ row
            reach = m.step @ reach
            reach[:, n + i] += m.road
        return total + reach.T @ self.terminal @ reach

    def closed(self, samples: int) -> LPVStateSpace:
        """The loop with a register of so many samples, over the attained share.

        States x, then w(k) … w(k + samples − 1).

        Parameters
        ----------
        samples : int
            N, constant.

        Returns
        -------
        LPVStateSpace
            Discrete; from `road_rate` [m/s], N samples ahead, to `comfort`, `tyre`, `stroke` and `effort` [m/s²].
        """
        m, n, p = self.model, len(self.model.step), samples
        a, b = np.zeros((2, n + p, n + p)), np.zeros((2, n + p, 1))
        c = np.zeros((2, len(m.shown) + 1, n + p))
        feedback = -np.concatenate(self.gains(samples))
        a[0, :n, :n], a[1, :n] = m.step, np.outer(m.control, feedback)
        c[0, :-1, :n], c[1, -1] = m.shown, np.sqrt(self.effort) * feedback
        if p:
            a[0, :n, n] = m.road
            a[0, n:-1, n + 1:] = np.eye(p - 1)
            b[0, -1, 0] = 1.0
        else:
            b[0, :n, 0] = m.road
        outputs = tuple(Signal(name, "m/s^2") for name in ("comfort", "tyre", "stroke", "effort"))
        return LPVStateSpace(a, b, c, np.zeros((2, len(m.shown) + 1, 1)), Polynomial((SHARE,), 1), m.sample_time,
                             Scheduling((SHARE,), (0.0,), (1.0,)), inputs=(Signal("road_rate", "m/s"),),
                             outputs=outputs)


@lru_cache(maxsize=1024)
def preview_storage(parameters: CarParameters, tyre_weight: float, stroke_weight: float, effort_weight: float,
                    force_lag: float, nominal_damping: float, sample_time: float, back_off: float | None = None
                    ) -> StorageWithRegister:
    """The storage function of a car's design model.

    Parameters
    ----------
    parameters : CarParameters
        With any damping; `nominal_damping` is put in its place.
    tyre_weight, stroke_weight, effort_weight : float
        ρ_t, ρ_z, r, dimensionless; r is positive.
    force_lag : float
        τ, from the demanded force to the damper's [s].
    nominal_damping : float
        c_nom [N·s/m].
    sample_time : float
        T [s].
    back_off : float, optional
        γ over the H-infinity norm of the car left at c_nom; None for H2.

    Returns
    -------
    StorageWithRegister
        Shared by equal arguments.

    Raises
    ------
    InputError
        A car that is not stable at its nominal damping.

    Examples
    --------
    >>> from quartercar.parameters import MEGANE
    >>> found = preview_storage(MEGANE, 0.3, 0.01, 0.3, 0.01, 1500.0, 1 / 512)
    >>> gain, ahead = found.gains(69)
    >>> gain.shape, ahead.shape, found.gamma
    ((9,), (69,), None)
    """
    car = parameters.replace(damping=nominal_damping)
    model = PreviewModel.of(car, tyre_weight, stroke_weight, force_lag, sample_time)
    fastest = float(np.abs(np.linalg.eigvals(model.step)).max())
    if fastest > 1 - SLOWEST:
        raise InputError("a car that is left at its nominal damping must come to rest",
                         got=f"a mode that keeps {fastest:.12g} of itself per sample at {nominal_damping:g} N*s/m")
    effort = effort_weight / parameters.sprung_mass**2
    if back_off is None:
        return StorageWithRegister(model, effort, _left_alone(model, None), None)
    gamma = back_off * _norm(model)
    return StorageWithRegister(model, effort, _left_alone(model, gamma), gamma)


def worst_road(cost: np.ndarray, road: np.ndarray, gamma: float) -> np.ndarray:
    """max over w of (x + E w)ᵀ Π (x + E w) − γ² w², as a matrix over x: Π + ΠE (γ² − EᵀΠE)⁻¹ EᵀΠ.

    Parameters
    ----------
    cost : (n, n) array
        Π.
    road : (n,) array
        E.
    gamma : float
        γ, above √(EᵀΠE).

    Returns
    -------
    (n, n) array
        Symmetric.
    """
    row = cost @ road
    return cost + np.outer(row, row) / (gamma**2 - road @ row)


def _norm(model: PreviewModel) -> float:
    """H-infinity norm from the road's rate to C x."""
    from lpvid.analysis.frozen_norms import h_infinity_norm

    d = np.zeros((len(model.shown), 1))
    return h_infinity_norm((model.step, model.road[:, None], model.shown, d), discrete=True)[0]


def _left_alone(model: PreviewModel, gamma: float | None) -> np.ndarray:
    """Π of the car without control; of its bounded-real Riccati equation for a γ, of its Lyapunov equation for None.

    Solved in units in which the sum of powers, which loses half of the digits, has a unit diagonal.
    """
    from scipy.linalg import LinAlgError, solve_discrete_are, solve_discrete_lyapunov

    unit = 1 / np.sqrt(np.diag(sum_of_powers(model.step, model.shown.T @ model.shown)))
    a, c = model.step * unit / unit[:, None], model.shown * unit
    if gamma is None:
        return solve_discrete_lyapunov(a.T, c.T @ c, method="bilinear") / np.outer(unit, unit)
    e = model.road / unit / gamma
    try:
        found = solve_discrete_are(a, e[:, None], c.T @ c, -np.eye(1))
    except (LinAlgError, ValueError) as error:
        raise InputError("no storage function was found for this bound", got=f"gamma {gamma:.6g}", why=str(error),
                         mend="a larger back_off") from None
    return found / np.outer(unit, unit)


class _ShareCountingLaw(Law):
    """A preview law with a count of the samples whose attained share lies outside of what its bound holds for."""

    def __init__(self, inner: LinearPreviewLaw) -> None:
        self._inner, self._outside = inner, np.zeros(len(inner.wanted))

    def step(self, seen: Signals) -> np.ndarray:
        u, had = self._inner.wanted, seen["attained"] - self._inner.base
        share = had / np.where(np.abs(u) > STILL, u, np.inf)
        self._outside += (share < 0) | (share > LARGEST_SHARE)
        return self._inner.step(seen)

    def counted(self) -> dict[str, np.ndarray]:
        """Samples at which the damper gave the contrary of a demand, or more than twice of it."""
        return {"share_outside": self._outside}
