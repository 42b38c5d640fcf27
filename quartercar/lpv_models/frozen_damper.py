"""FrozenDamper: an identified damper at one current as a linear filter, and what any other current adds to it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lpvid.errors import InputError
from lpvid.model.input_stage import TanhStage
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.synthesis.bilinear import to_continuous
from quartercar.dampers.contract import Damper
from quartercar.dampers.laws.secant import secant
from quartercar.vehicle.filter_bank import filter_of

Matrices = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
LEAST_KNEE = 0.05
"""share of v_0 below which the knee does not fall, as in `TanhStage`"""


@dataclass(frozen=True, eq=False)
class FrozenDamper:
    """The damper about rest at i_0, driven by velocity, shaped velocity and the force that the current adds.

    ::

        F(k) − F_0 = −Σ_j a_j(i_0) (F(k−j) − F_0) + Σ_j b_j(i_0) u_0(k−j) + f(k)/g,      u_0 = (v, tanh(v/v_0(i_0)))

    F_0 = c(i_0)/A_0(1) is the force at rest, g = 1/A_0(1). This defines f for every course of the current, whatever the
    coefficients are as functions of it: zero while i = i_0, and g (r δ + what earlier currents left in the shaped
    velocities) for the r of E9 (equation sheet 4.3). It is the force to which the current's contribution settles. The
    filter is time-invariant: with f as its input no current is left in it.

    Attributes
    ----------
    model : LPVTransferFunction
        From velocity to force, as `quartercar.vehicle.filter_bank.filter_of` gives it.
    current : float
        i_0.

    Examples
    --------
    >>> from quartercar.rides.default_damper import identified_damper
    >>> frozen = FrozenDamper.of(identified_damper(), 0.0)
    >>> frozen.order, round(frozen.settled, 2)
    (2, 7.11)
    """

    model: LPVTransferFunction
    current: float

    @classmethod
    def of(cls, damper: Damper, current: float) -> FrozenDamper:
        """Of a damper with an identified transfer function inside.

        Parameters
        ----------
        damper : Damper
            Identified from velocity to force, scheduled on the current.
        current : float
            i_0 [A].

        Returns
        -------
        FrozenDamper
            About rest at that current.

        Raises
        ------
        InputError
            Another kind of damper; one that reads the displacement, or no current.
        """
        model = filter_of(damper)
        if not isinstance(model, LPVTransferFunction):
            raise InputError("the plant with the damper's dynamics needs an identified transfer function",
                             got=f"'{damper.name}'", mend="lpv-arx, or plant = \"nominal\"")
        names = [s.name for s in model.inputs]
        if names != ["velocity"]:
            raise InputError("the plant with the damper's dynamics needs a model whose input is the velocity",
                             got=", ".join(names), mend="identify from velocity to force, or plant = \"nominal\"")
        if not model.box.names:
            raise InputError("nothing can be commanded on a damper that does not read the current",
                             got="a time-invariant model", mend="identify with the current as scheduling variable")
        return cls(model, float(current))

    # -- coefficients -------------------------------------------------------------------------------------------------
    @cached_property
    def _coefficients(self) -> tuple[np.ndarray, np.ndarray, float]:
        """a (na,), b (lags, inputs) and c at i_0."""
        a, b, c = self.model.coefficients([self.current])
        return a[:, 0, 0], b[:, 0], float(c.sum())

    @property
    def a(self) -> np.ndarray:
        """(na,) a_j(i_0), j = 1 …"""
        return self._coefficients[0]

    @property
    def b(self) -> np.ndarray:
        """(lags, 1 or 2) b_j(i_0), j = 0 …"""
        return self._coefficients[1]

    @property
    def settled(self) -> float:
        """g = 1/A_0(1)."""
        return float(1 / (1 + self.a.sum()))

    @property
    def rest(self) -> float:
        """F_0 [N]."""
        return self._coefficients[2] * self.settled

    @property
    def shaped(self) -> bool:
        """Whether a tanh of the velocity is among the inputs."""
        return self.model.input_stage is not None

    @property
    def knee(self) -> float:
        """v_0(i_0) [m/s]; infinite without a shaped velocity."""
        stage = self.model.input_stage
        if not isinstance(stage, TanhStage):
            return np.inf
        return float(max(stage.v0 + stage.slope * self.current, LEAST_KNEE * stage.v0))

    @property
    def order(self) -> int:
        """States of the minimal filter."""
        return max(len(self.a), len(self.b) - 1)

    @property
    def stable(self) -> bool:
        """Whether all poles of A_0 lie inside the unit circle."""
        return bool(np.all(np.abs(np.linalg.eigvals(self.discrete[0])) < 1)) if self.order else True

    # -- signals ------------------------------------------------------------------------------------------------------
    def secant(self, velocity: np.ndarray) -> np.ndarray:
        """(…) ρ_v = tanh(v/v_0)/v [s/m]; zero without a shaped velocity.

        Parameters
        ----------
        velocity : array
            Of any shape [m/s].

        Returns
        -------
        array
            Of the same shape, between 0 and 1/v_0, which it has at zero velocity.
        """
        v = np.asarray(velocity, dtype=float)
        return secant(v / self.knee) / self.knee if self.shaped else np.zeros_like(v)

    def inputs(self, velocity: np.ndarray) -> np.ndarray:
        """(…, 1 or 2) u_0 at velocities.

        Parameters
        ----------
        velocity : array
            Of any shape [m/s].

        Returns
        -------
        array
            Velocity [m/s] along the last axis, and behind it tanh(v/v_0) where there is a shaped velocity.
        """
        v = np.asarray(velocity, dtype=float)
        return np.stack([v, np.tanh(v / self.knee)], axis=-1) if self.shaped else v[..., None]

    def added(self, velocity: np.ndarray, force: np.ndarray) -> np.ndarray:
        """(n,) f [N] along velocities and forces of the damper itself, which was at rest before.

        Parameters
        ----------
        velocity : (n,) array
            At the model's rate [m/s].
        force : (n,) array
            F, the force at rest included [N].

        Returns
        -------
        (n,) array
            Force to which the contribution of the current settles [N].
        """
        u = self.inputs(velocity)
        own = np.asarray(force, dtype=float) - self.rest
        before = np.concatenate([np.full(len(self.a), own[0]), own])
        heads = np.concatenate([np.repeat(u[:1], len(self.b) - 1, axis=0), u])
        n = len(own)
        out = own.copy()
        for j, a in enumerate(self.a, start=1):
            out += a * before[len(self.a) - j: len(self.a) - j + n]
        for j, b in enumerate(self.b):
            out -= heads[len(self.b) - 1 - j: len(self.b) - 1 - j + n] @ b
        return self.settled * out

    # -- filters ------------------------------------------------------------------------------------------------------
    @cached_property
    def discrete(self) -> Matrices:
        """A, B, C, D of the minimal filter (v, tanh(v/v_0), f) ↦ F − F_0 at the model's rate, in observer form."""
        n, width = self.order, self.b.shape[1] + 1
        a, b = np.zeros(n), np.zeros((n + 1, width))
        a[:len(self.a)] = self.a
        b[:len(self.b), :-1] = self.b
        b[0, -1] = 1 / self.settled
        step = np.zeros((n, n))
        if n:
            step[:, 0] = -a
            step[:-1, 1:] = np.eye(n - 1)
        return step, b[1:] - np.outer(a, b[0]), np.eye(1, n), b[:1].copy()

    @cached_property
    def continuous(self) -> Matrices:
        """The same in continuous time by the bilinear map s = (2/T)(z − 1)/(z + 1).

        It carries positive realness over, both ways: the half plane is mapped onto the disc. A frequency f of the
        samples becomes tan(π f T)/(π T).
        """
        pace = 2 / self.model.sample_time
        a, b, c, d = (m[0] for m in to_continuous(tuple(m[None] for m in self.discrete), 1.0))  # type: ignore[arg-type]
        return pace * a, pace * b, c, d


def response(matrices: Matrices, at: np.ndarray) -> np.ndarray:
    """(n, outputs, inputs) C (λI − A)⁻¹ B + D at complex λ.

    Parameters
    ----------
    matrices : (A, B, C, D)
        Of a filter, continuous or discrete.
    at : (n,) complex array
        λ: jω for a continuous filter, e^{jωT} for a discrete one.

    Returns
    -------
    (n, outputs, inputs) array
        Complex, in the units of output over input.
    """
    a, b, c, d = matrices
    return c @ np.linalg.solve(at[:, None, None] * np.eye(len(a)) - a, np.broadcast_to(b + 0j, (len(at), *b.shape))) + d


def trapezoidal(matrices: Matrices, period: float) -> tuple[np.ndarray, np.ndarray]:
    """M, N of x(k) = M x(k−1) + N (u(k−1) + u(k)): the bilinear map back, so that C x + D u is the discrete output.

    Parameters
    ----------
    matrices : (A, B, C, D)
        Of a continuous filter; C and D are not needed.
    period : float
        Of the samples [s].

    Returns
    -------
    tuple of two arrays
        M (states, states) and N (states, inputs).

    Examples
    --------
    >>> from quartercar.rides.default_damper import identified_damper
    >>> frozen = FrozenDamper.of(identified_damper(), 0.0)
    >>> m, n = trapezoidal(frozen.continuous, frozen.model.sample_time)
    >>> bool(np.allclose(np.sort_complex(np.linalg.eigvals(m)), np.sort_complex(np.linalg.eigvals(frozen.discrete[0]))))
    True
    """
    a, b, _, _ = matrices
    half, eye = 0.5 * period, np.eye(len(a))
    inverse = np.linalg.inv(eye - half * a)
    return inverse @ (eye + half * a), half * inverse @ b


def filtered(matrices: Matrices, inputs: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """(n, states) and (n, outputs) along (n, inputs) by the trapezoidal rule, settled at the first sample.

    Parameters
    ----------
    matrices : (A, B, C, D)
        Of a continuous filter without a pole at zero.
    inputs : (n, inputs) array
        At the samples; linear in between.
    period : float
        Of the samples [s].

    Returns
    -------
    states : (n, states) array
        At the samples.
    outputs : (n, outputs) array
        C x + D u.
    """
    a, b, c, d = matrices
    m, n = trapezoidal(matrices, period)
    drive = np.zeros((len(inputs), len(a)))
    drive[1:] = (inputs[:-1] + inputs[1:]) @ n.T
    x = np.empty_like(drive)
    if len(a):
        x[0] = np.linalg.solve(-a, b @ inputs[0])
    for k in range(1, len(x)):
        x[k] = m @ x[k - 1] + drive[k]
    return x, x @ c.T + inputs @ d.T
