"""A controller behind limits: what it does while its controls are at their stops, sample by sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.lft import held
from lpvid.model.state_space import LPVStateSpace

Limits = Mapping[str, float | tuple[float, float]]
"""For every control its largest modulus, or its lower and upper end."""


@dataclass(frozen=True, eq=False)
class SaturatedController:
    """x_K⁺ = A_K x_K + B_K y + E (u − v), v = C_K x_K + D_K y, u = v cut to its limits.

    ::

        y ──> A_K, B_K, C_K, D_K ──> v ──[limits]──┬──> u
                  ^                  └──(−)──>(+)<─┘
                  └─────────── E(p) ───────────┘

    Parameters
    ----------
    controller : LPVStateSpace
    lower, upper : (n_u,) arrays
    gain : (M, n_K, n_u) array
        E over the controller's basis.
    """

    controller: LPVStateSpace
    lower: np.ndarray
    upper: np.ndarray
    gain: np.ndarray

    def start(self, period: float | None = None) -> SaturatedRun:
        """A run from rest.

        Parameters
        ----------
        period : float, optional
            Time between calls [s], over which inputs and scheduling are held; for a continuous controller.

        Returns
        -------
        SaturatedRun
            With x_K = 0.

        Raises
        ------
        InputError
            A continuous controller without a period, or a discrete one with another than its own.
        """
        if self.controller.sample_time is None:
            if period is None:
                raise InputError("a continuous controller needs the time between its samples", mend="start(period)")
            return SaturatedRun(self, _checks.positive(period, "the period", "s"))
        if period is not None and abs(period / self.controller.sample_time - 1) > 1e-9:
            raise InputError("the controller runs at its own period", got=f"{period:g} s",
                             why=f"it was designed for {self.controller.sample_time:g} s")
        return SaturatedRun(self, None)


class SaturatedRun:
    """The moving part of a `SaturatedController`.

    Parameters
    ----------
    law : SaturatedController
        What is run.
    period : float or None
        Time between calls [s] of a continuous controller; None for a discrete one.
    """

    def __init__(self, law: SaturatedController, period: float | None) -> None:
        self._law, self._period = law, period
        self._state = np.zeros(law.controller.order)
        self._point: np.ndarray | None = None
        self._matrices: tuple[np.ndarray, ...] = ()

    def advance(self, measurements: np.ndarray, scheduling: np.ndarray | None = None) -> np.ndarray:
        """Controls for the measurements of this sample; the state moves on to the next.

        Parameters
        ----------
        measurements : (n_y,) array
        scheduling : (n_scheduling,) array, optional
            None for a controller that reads none.

        Returns
        -------
        (n_u,) array
            Within the limits.

        Raises
        ------
        InputError
            A scheduling value outside the box for which the controller was designed.
        """
        p = np.empty(0) if scheduling is None else np.asarray(scheduling, dtype=float)
        y = np.asarray(measurements, dtype=float)
        if self._point is None or not np.array_equal(p, self._point):
            self._matrices, self._point = self._frozen(p), p.copy()
        a, b, c, d, e = self._matrices
        wanted = c @ self._state + d @ y
        given = np.clip(wanted, self._law.lower, self._law.upper)
        self._state = a @ self._state + b @ y + e @ (given - wanted)
        return given

    def _frozen(self, p: np.ndarray) -> tuple[np.ndarray, ...]:
        k = self._law.controller
        if not k.box.contains(p[None])[0]:
            text = ", ".join(f"{n} = {v:.6g} outside [{low:.6g}, {high:.6g}]" for n, v, low, high in
                             zip(k.box.names, p, k.box.lower, k.box.upper, strict=True) if not low <= v <= high)
            raise InputError("the scheduling left the box that the controller was designed for", got=text,
                             mend="clip it to the box, or design for a wider one")
        phi = k.basis.evaluate(p[None])[0]
        a, b, c, d, e = (np.tensordot(phi, m, axes=1) for m in (k.A, k.B, k.C, k.D, self._law.gain))
        if self._period is not None and len(a):
            (a,), (pushed,) = held(a[None], np.hstack([b, e])[None], self._period)
            b, e = pushed[:, : b.shape[1]], pushed[:, b.shape[1] :]
        return a, b, c, d, e


def saturate(controller: LPVStateSpace, limits: Limits, gain: np.ndarray | None = None) -> SaturatedController:
    """A controller behind limits, with an anti-windup gain or (left out) none.

    Parameters
    ----------
    controller : LPVStateSpace
        Its outputs are the controls.
    limits : mapping of control to its largest modulus or (lower, upper)
    gain : (n_K, n_u) or (M, n_K, n_u) array, optional
        E, constant or over the controller's basis.

    Returns
    -------
    SaturatedController
        A control without a limit has ±∞.

    Raises
    ------
    InputError
        A limit of an unknown control, a lower end that is not below the upper, a gain of another shape, or a constant
        one for a basis that does not contain constants.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> integrator = LPVStateSpace([[[1.0]]], [[[1.0]]], [[[1.0]]], [[[0.0]]], Polynomial((), 0), 0.1,
    ...                            inputs=("error",), outputs=("force",))
    >>> run = saturate(integrator, {"force": 2.0}, gain=np.ones((1, 1))).start()
    >>> [float(run.advance([1.0])[0]) for _ in range(4)]
    [0.0, 1.0, 2.0, 2.0]
    """
    names = [s.name for s in controller.outputs]
    for name in limits:
        _checks.known_name(name, names, "control")
    ends = []
    for name in names:
        value = limits.get(name, np.inf)
        low, high = value if isinstance(value, tuple) else (-value, value)
        if not low < high:
            raise InputError(f"the limits of '{name}' leave nothing between them", got=f"{low} and {high}")
        ends.append((low, high))
    shape = (controller.order, len(names))
    e = np.zeros(shape) if gain is None else np.asarray(gain, dtype=float)
    if e.ndim == 2:
        e = _checks.shaped(e, shape, "an anti-windup gain") * _constant_one(controller)[:, None, None]
    e = _checks.shaped(e, (controller.basis.size, *shape), "an anti-windup gain")
    return SaturatedController(controller, np.array([x[0] for x in ends]), np.array([x[1] for x in ends]), e)


def _constant_one(system: LPVStateSpace) -> np.ndarray:
    """(M,) coefficients with which a system's basis makes the constant 1."""
    points = system.box.grid(5)
    phi = system.basis.evaluate(points)
    one = np.linalg.lstsq(phi, np.ones(len(points)), rcond=None)[0]
    if np.abs(phi @ one - 1).max() > 1e-9:
        raise InputError("the controller's basis does not contain constants", got=", ".join(system.basis.labels),
                         mend="give the gain over the controller's own basis")
    return one
