"""RealTime: a damper that takes one sample of motion and current and gives one force, at a fixed step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from lpvid.toolkit import checks
from quartercar.dampers.laws.current_lag import LATEST


class RealTime:
    """A damper stepped sample by sample; its state is carried from call to call, nothing looks ahead.

    The first call starts it settled. A call allocates no memory and takes the same number of operations whatever the
    stiffness of the parameters but for a few Newton steps; it gives what `response` gives at the same sampling.

    Parameters
    ----------
    step : float
        Time from call to call [s].
    begin : callable
        (x, v, u, buffer, state) sets the state to a settled one and returns the force [N].
    advance : callable
        (x0, x1, v0, v1, k, buffer, state) advances the state to sample k and returns the force [N].
    states : int
        Length of the state.

    Examples
    --------
    >>> from quartercar.dampers.laws.force_map import ForceMap
    >>> stepper = ForceMap().real_time(step=1e-3)
    >>> bool(stepper(0.0, 0.1) == ForceMap().static_force(np.array([0.1]))[0])
    True
    """

    def __init__(self, step: float, begin: Callable[..., float], advance: Callable[..., float], states: int) -> None:
        self.step = checks.positive(step, "step", "s")
        self._begin, self._advance = begin, advance
        self._state: np.ndarray[Any, np.dtype[np.float64]] = np.zeros(states)
        self._buffer = np.zeros(int(np.ceil(LATEST / step)) + 3)
        self.reset()

    def reset(self) -> None:
        """Forget everything; the next call starts settled."""
        self._k = 0
        self._x = self._v = 0.0

    def __call__(self, displacement: float, velocity: float, current: float = 0.0) -> float:
        """Force now [N].

        Parameters
        ----------
        displacement, velocity : float
            Of the damper from its `centre` [m], [m/s].
        current : float
            Command now, in the model's `current_unit`.
        """
        k = self._k
        self._buffer[k % self._buffer.size] = current
        if k == 0:
            force = self._begin(displacement, velocity, current, self._buffer, self._state)
        else:
            force = self._advance(self._x, displacement, self._v, velocity, k, self._buffer, self._state)
        self._k, self._x, self._v = k + 1, displacement, velocity
        return force

    def peek(self, displacement: float, velocity: float, current: float = 0.0) -> float:
        """The force that a call would give [N]; the call is yet to come.

        Parameters
        ----------
        displacement, velocity : float
            Of the damper from its `centre` [m], [m/s].
        current : float
            Command, in the model's `current_unit`.

        Returns
        -------
        float
            Force [N]; the state stays as it is.
        """
        kept, k, x, v = self._state.copy(), self._k, self._x, self._v
        slot = k % self._buffer.size
        command = self._buffer[slot]
        force = self(displacement, velocity, current)
        self._state[:] = kept
        self._buffer[slot] = command
        self._k, self._x, self._v = k, x, v
        return force
