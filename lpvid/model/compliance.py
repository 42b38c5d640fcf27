"""ComplianceModel: a damper law in series with a spring, as a first-order LPV model that is stable by construction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from lpvid import _checks
from lpvid.codec import VERBATIM, Coded
from lpvid.errors import InputError
from lpvid.model.noise_model import NoiseModel
from lpvid.model.quasi import SelfScheduled, lagged
from lpvid.model.scheduling_stage import SchedulingStage
from lpvid.model.signals import Signal
from lpvid.scheduling import Basis, Polynomial, Scheduling, Spline

HEAD = 10
"""samples over which a second element settles before the first takes the measured rest."""


@dataclass(frozen=True, eq=False)
class Element:
    """A spring in series with a rising law F = F_s(w, i), piecewise linear in the fluid speed w.

    Attributes
    ----------
    law : (Q, M) array
        F_s at the knots, one row per current function; rising along each row, zero at w = 0 [N].
    stiffness : float
        k_h [N/m].
    """

    law: np.ndarray
    stiffness: float

    def __post_init__(self) -> None:
        law = _checks.finite(_checks.frozen_array(self.law, "the law of a compliance", ndim=2), "the law")
        if np.any(np.diff(law, axis=1) <= 0):
            raise InputError("the law of a compliance must rise with the fluid speed", why="its inverse g must exist")
        object.__setattr__(self, "law", law)
        _checks.positive(self.stiffness, "the stiffness of a compliance", "N/m")


@dataclass(frozen=True, eq=False)
class ComplianceModel(Coded, SelfScheduled):
    r"""Damper with series compliance, and linear terms in parallel (equation sheet 9.3).

    ::

        y(k) = Σ_e F_e(k) + Σ_j d_j v(k−j) + Σ_q s_q x_q(k) + offset
        Ḟ_e = k_e (v − w_e),  F_e = F_{s,e}(w_e, i)  ⇔  Ḟ_e = k_e (v − ρ_e F_e),  ρ_e = g_e(F_e, i)/F_e > 0

    g, the inverse of F_s in w, is the law by which fluid passes: first-order LPV in its own force, with pole −k_h ρ.
    F_s is piecewise linear on `knots`, rising and zero at w = 0 by construction, for every current a convex mixture of
    rising laws. Two such elements in series are one (1/k_h and g add up), so that several elements stand in parallel.

    **Bounded for every bounded velocity.** Storage V = F²/2k_h has V̇ = F v − F g(F, i), negative as soon as
    |g(F, i)| > |v|, that is F outside F_s([−|v|, |v|], i): F never leaves the hull of its start and of F_s([−U, U], ·)
    for |v| ≤ U, at any rate of current and velocity. The same holds for the implicit Euler step
    F⁺ + h k_h w⁺ = F + h k_h v, F⁺ = F_s(w⁺), of any length h: its left side rises with w⁺, so the solution is unique,
    and w⁺ < v means F⁺ > F while F⁺ = F_s(w⁺) < F_s(v), so F⁺ lies between F and F_s(v) (and so for w⁺ > v).
    Two runs that differ in their start approach each other: |δF⁺| = |δF| F_s'/(F_s' + h k_h) piece by piece.
    As k_h → ∞ the step gives F⁺ = F_s(v), the static law.

    Parameters
    ----------
    elements : sequence of Element
        One or two.
    knots : (M,) array
        Fluid speeds, rising, with 0 among them; beyond the ends the end slopes hold [m/s].
    direct : (lags,) array
        d_j, from lag 0 on: viscous and inertial terms (fixture) and what the sensors' timing adds [N·s/m].
    side : (q,) array
        s_q of the further inputs, e.g. displacement for a gas spring [N/m].
    offset : float
        [N].
    sample_time : float
        [s].
    inputs : tuple of Signal
        Velocity, then the further inputs.
    outputs : tuple of Signal
        One.
    current : Basis
        Hat functions of the current (order 1), or the constant.
    box : Scheduling
        Box of the current.
    scheduling_stage : SchedulingStage, optional
        Filter on the current.
    substeps : int
        Euler steps per sample; velocity and current run linearly between samples.
    noise_variance : float
        Mean squared free-run error in training.
    metadata : mapping

    Examples
    --------
    >>> maxwell = ComplianceModel((Element([[-100.0, 0.0, 100.0]], 1000.0),), [-1.0, 0.0, 1.0], [0.0], [], 0.0, 0.1,
    ...                           (Signal("velocity", "m/s"),), (Signal("force", "N"),), substeps=1)
    >>> maxwell.free_run(np.ones((3, 1)), np.zeros((3, 0)), np.zeros(1), 1e9)[0]
    array([ 0., 50., 75.])
    """

    kind = "compliance"
    JSON = ("kind", "elements", "knots", "direct", "side", "offset", "sample_time", "inputs", "outputs", "current",
            ("scheduling", "box"), "scheduling_stage", "substeps", "noise_variance", "metadata")

    elements: Sequence[Element]
    knots: np.ndarray
    direct: np.ndarray
    side: np.ndarray
    offset: float
    sample_time: float
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    current: Basis = field(default_factory=Polynomial)
    box: Scheduling = field(default_factory=lambda: Scheduling((), (), ()))
    scheduling_stage: SchedulingStage | None = None
    substeps: int = 4
    noise_variance: float = 0.0
    metadata: Mapping = field(default_factory=dict, metadata=VERBATIM)
    memory: ClassVar[int] = 1
    noise: ClassVar[NoiseModel] = NoiseModel("equation")

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        set_(self, "elements", tuple(self.elements))
        set_(self, "knots", checked_knots(self.knots))
        set_(self, "inputs", tuple(self.inputs))
        set_(self, "outputs", tuple(self.outputs))
        for name in ("direct", "side"):
            set_(self, name, _checks.finite(_checks.frozen_array(getattr(self, name), name, ndim=1), name))
        _checks.shaped(self.side, (len(self.inputs) - 1,), "side")
        _checks.count(self.substeps, "substeps", at_least=1)
        if not 1 <= len(self.elements) <= 2:
            raise InputError("a compliance model has one or two elements", got=len(self.elements))
        if self.current.names and not (isinstance(self.current, Spline) and self.current.order == 1):
            raise InputError("the law of a compliance is mixed by hat functions of the current", got=self.current,
                             mend="Spline(name, segments, order=1)")
        for element in self.elements:
            _checks.shaped(element.law, (self.current.size, self.knots.size), "the law of a compliance")
            if np.any(element.law[:, self.zero] != 0):
                raise InputError("the law of a compliance must vanish at zero fluid speed",
                                 mend="put a constant force into offset")

    # -- sizes --------------------------------------------------------------------------------------------------
    @property
    def start(self) -> int:
        return max(self.direct.size, HEAD if len(self.elements) > 1 else 1)

    @property
    def zero(self) -> int:
        """Place of the knot at zero fluid speed."""
        return int(np.flatnonzero(self.knots == 0)[0])

    @property
    def vector(self) -> np.ndarray:
        parts = [np.append(np.log(np.diff(e.law, axis=1)).ravel(), np.log(e.stiffness)) for e in self.elements]
        return np.concatenate([*parts, self.direct, self.side, [self.offset]])

    def with_vector(self, vector: np.ndarray) -> ComplianceModel:
        vector = np.asarray(vector, dtype=float)
        q, rises = self.current.size, self.knots.size - 1
        size, elements = q * rises + 1, []
        for e in range(len(self.elements)):
            own = vector[e * size: (e + 1) * size]
            elements.append(Element(_law(np.exp(own[:-1].reshape(q, rises)), self.zero), float(np.exp(own[-1]))))
        rest = vector[len(elements) * size:]
        cut = self.direct.size
        return self.replace(elements=elements, direct=rest[:cut], side=rest[cut:-1], offset=float(rest[-1]))

    @property
    def parameter_names(self) -> tuple[str, ...]:
        names = []
        for e in range(1, len(self.elements) + 1):
            mark = f"{{{e}}}" if len(self.elements) > 1 else ""
            names += [f"ln rise{m}{mark}[{f}]" for f in self.current.labels for m in range(1, self.knots.size)]
            names.append(f"ln k_h{mark}")
        return (*names, *(f"d{j}" for j in range(self.direct.size)), *(s.name for s in self.inputs[1:]), "offset")

    @property
    def stiffness(self) -> tuple[float, ...]:
        """k_h of every element [N/m]."""
        return tuple(e.stiffness for e in self.elements)

    def static_force(self, speed: np.ndarray, current: float | None = None) -> np.ndarray:
        """ΣF_s(w, i) of the elements at fluid speeds [N]; parallel terms are not in it.

        Parameters
        ----------
        speed : float or (n,) array
            Fluid speeds [m/s]; beyond the knots the end slopes hold.
        current : float, optional
            In the unit of the box; left out, 0.

        Returns
        -------
        (n,) array
        """
        w = np.atleast_1d(np.asarray(speed, dtype=float))
        weights = self.current.evaluate(np.full((1, len(self.box.names)), 0.0 if current is None else current))[0]
        return np.sum([_interpolated(w, self.knots, weights @ e.law) for e in self.elements], axis=0)

    def force_bound(self, amplitude: float) -> float:
        """What |F| of the elements together never exceeds for |velocity| ≤ amplitude, from rest [N].

        Parameters
        ----------
        amplitude : float
            Of the velocity [m/s].

        Returns
        -------
        float
            At the worst current, whatever its course; parallel terms are not in it.
        """
        ends = np.array([-amplitude, amplitude])
        return float(sum(max(np.abs(_interpolated(ends, self.knots, row)).max() for row in e.law)
                         for e in self.elements))

    # -- running ------------------------------------------------------------------------------------------------
    def parallel(self, u: np.ndarray) -> np.ndarray:
        """(n, lags + q + 1) regressors of the linear terms.

        Parameters
        ----------
        u : (n, n_inputs) array
            Velocity [m/s], then the further inputs.

        Returns
        -------
        (n, lags + q + 1) array
            Lags of the velocity, further inputs, 1.
        """
        columns = [lagged(u[:, 0], j) for j in range(self.direct.size)]
        return np.column_stack([*columns, *u[:, 1:].T, np.ones(len(u))])

    def gain(self, element: Element) -> float:
        """k_h times the Euler step [N·s/m].

        Parameters
        ----------
        element : Element
            Whose stiffness counts.

        Returns
        -------
        float
        """
        return element.stiffness * self.sample_time / self.substeps

    def _arrays_of_first(self, u: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """`arrays`, the force of a second element, from its static law on, among the parallel force."""
        v, phi, beside = self.arrays(u, p)
        out = np.zeros(len(v))
        if len(self.elements) > 1:
            self._settled(self.elements[1], v, phi, out)
        return v, phi, beside + out

    def _settled(self, element: Element, v: np.ndarray, phi: np.ndarray, out: np.ndarray) -> None:
        from lpvid._quasi_kernels import run_compliance

        out[0] = _interpolated(v[:1], self.knots, phi[0] @ element.law)[0]
        run_compliance(element.law, self.knots, self.gain(element), phi, v, 0, self.substeps, out)

    def arrays(self, u: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Velocity (n,), current functions (n, Q), parallel force (n,).

        Parameters
        ----------
        u : (n, n_inputs) array
            Velocity [m/s], then the further inputs.
        p : (n, n_scheduling) array
            Current, behind its filter.

        Returns
        -------
        (n,) array, (n, Q) array, (n,) array
            The last in [N].
        """
        weights = np.concatenate([self.direct, self.side, [self.offset]])
        return (_checks.read_only(np.ascontiguousarray(u[:, 0])), np.ascontiguousarray(self.current.evaluate(p)),
                self.parallel(u) @ weights)

    def free_run(self, u: np.ndarray, p: np.ndarray, past: np.ndarray, limit: float) -> tuple[np.ndarray, int | None]:
        from lpvid._quasi_kernels import run_compliance

        v, phi, beside = self._arrays_of_first(u, p)
        first, begin, force = self.elements[0], self.start - 1, np.zeros(len(u))
        force[begin] = past[-1] - beside[begin]
        run_compliance(first.law, self.knots, self.gain(first), phi, v, begin, self.substeps, force)
        y = force + beside
        y[: self.start] = past
        return y, None

    def predict(self, u: np.ndarray, p: np.ndarray, y: np.ndarray, horizon: int) -> np.ndarray:
        from lpvid._quasi_kernels import ahead_compliance

        v, phi, beside = self._arrays_of_first(u, p)
        first, begin, force = self.elements[0], self.start - 1, np.zeros(len(u))
        ahead_compliance(first.law, self.knots, self.gain(first), phi, v, begin, self.substeps, horizon, y - beside,
                         force)
        out = force + beside
        out[: self.start] = y[: self.start]
        return out

    def __repr__(self) -> str:
        stiff = ", ".join(f"{k:.4g}" for k in self.stiffness)
        by = f", law over {', '.join(self.box.names)}" if self.box.names else ""
        return (f"ComplianceModel {', '.join(map(str, self.inputs))} -> {self.outputs[0]}: k_h {stiff} N/m, "
                f"{self.knots.size} knots{by}, {self.direct.size} direct lags, {1 / self.sample_time:.6g} Hz")


def checked_knots(knots: object) -> np.ndarray:
    """Fluid speeds at which a law bends: at least three, rising, with 0 inside.

    Parameters
    ----------
    knots : (M,) array-like
        [m/s].

    Returns
    -------
    (M,) array
        Read-only.

    Raises
    ------
    InputError
        Fewer than three knots, knots that do not rise, or no 0 between the ends.
    """
    array = _checks.finite(_checks.frozen_array(knots, "knots", ndim=1), "knots")
    if array.size < 3 or np.any(np.diff(array) <= 0) or not np.any(array[1:-1] == 0):
        raise InputError("knots of a compliance are rising fluid speeds with 0 inside", got=array.tolist())
    return array


def _law(rises: np.ndarray, zero: int) -> np.ndarray:
    """(Q, M) law from its (Q, M − 1) rises, zero at knot `zero`."""
    total = np.hstack([np.zeros((len(rises), 1)), np.cumsum(rises, axis=1)])
    return total - total[:, zero: zero + 1]


def _interpolated(w: np.ndarray, knots: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Piecewise linear, with the end slopes beyond the ends."""
    s = np.clip(np.searchsorted(knots, w, side="right") - 1, 0, knots.size - 2)
    part = (w - knots[s]) / (knots[s + 1] - knots[s])
    return values[s] * (1 - part) + values[s + 1] * part
