"""Delays as blocks for `connect`: exact registers in discrete time, Padé approximations with their error otherwise."""

from __future__ import annotations

import math

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace

WHOLE = 1e-6
"""samples by which a delay may miss a whole number of them"""


def delay(seconds: float, sample_time: float | None = None, *, order: int = 2, input: str | Signal = "in",
          output: str | Signal = "out") -> LPVStateSpace:
    """y(t) = u(t − τ) as a system.

    Discrete time: a register of τ/T samples, exact. A share η of a sample is met by the interpolation (1 − η) z⁻ᵏ +
    η z⁻ᵏ⁻¹, whose error at ω is at most ω²T²/8 of the signal. Continuous time: the Padé approximation of order n,
    Q(−s)/Q(s) with Q(s) = Σ_k (2n − k)!/((2n)!/n!·k!(n − k)!/n!) (τs)ᵏ: all-pass, with an error of its phase only
    (`delay_error`).

    Parameters
    ----------
    seconds : float
        τ ≥ 0 [s].
    sample_time : float or None
        T [s]; None for continuous time.
    order : int
        n of the Padé approximation.
    input, output : str or Signal
        Names, for `connect`.

    Returns
    -------
    LPVStateSpace
        Constant; its first output is `output`.

    Raises
    ------
    InputError
        A negative delay, an order above 10 (its coefficients lose their digits).

    Examples
    --------
    >>> delay(0.3, 0.1).order, delay(0.3, order=2).order, delay(0.0).order
    (3, 2, 0)
    """
    tau = _checks.real(seconds, "a delay")
    if tau < 0:
        raise InputError("a delay is not negative", got=f"{tau:g} s", mend="a prediction is a design, not a block")
    if sample_time is None:
        a, b, c, d = _pade(tau, _pade_order(order)) if tau else _through()
    else:
        a, b, c, d = _register(tau / _checks.positive(sample_time, "sample_time", "s"))
    ends = [x if isinstance(x, Signal) else Signal(x) for x in (input, output)]
    return LPVStateSpace.still(a, b, c, d, sample_time, inputs=(ends[0],), outputs=(ends[1],))


def delay_error(seconds: float, order: int, frequency: float) -> float:
    """Largest |Padé(jω) − e^(−jωτ)| for ω up to a frequency [rad/s], by its rising phase error.

    Both have modulus one, so that it is 2 sin(½|phase error|), and 2 once that error reaches π.

    Parameters
    ----------
    seconds : float
        The delay τ [s].
    order : int
        Order of the Padé approximation.
    frequency : float
        Largest ω [rad/s].

    Returns
    -------
    float
        Between 0 and 2.

    Examples
    --------
    >>> delay_error(0.1, 2, 10.0) < 0.002 < delay_error(0.1, 1, 10.0)
    True
    """
    tau, n = _checks.positive(seconds, "a delay", "s"), _pade_order(order)
    omega = np.linspace(0.0, _checks.positive(frequency, "a frequency", "rad/s"), 400)
    q = _coefficients(n)
    value = sum(q[k] * (1j * omega * tau) ** k for k in range(n + 1))
    error = np.abs(omega * tau - 2 * np.unwrap(np.angle(value)))
    return 2.0 if error.max() >= np.pi else float(2 * np.sin(0.5 * error.max()))


def _pade_order(order: int) -> int:
    n = _checks.count(order, "the order of a Padé approximation", at_least=1)
    if n > 10:
        raise InputError("a Padé approximation of so high an order loses its digits", got=n,
                         mend="at most 10, or discrete time, where a delay is exact")
    return n


def _coefficients(n: int) -> np.ndarray:
    """q_k of Q(x) = Σ q_k xᵏ with e^(−x) ≈ Q(−x)/Q(x)."""
    return np.array([math.factorial(2 * n - k) * math.factorial(n)
                     / (math.factorial(2 * n) * math.factorial(k) * math.factorial(n - k)) for k in range(n + 1)])


def _pade(tau: float, n: int) -> tuple[np.ndarray, ...]:
    """Controllable form in x = τs, scaled back in time; states of like size."""
    q = _coefficients(n)
    over = q[:-1] / q[-1]
    flipped = q * (-1.0) ** np.arange(n + 1) / q[-1]
    a = np.eye(n, k=1)
    a[-1] = -over
    c = flipped[:-1] - flipped[-1] * over
    scale = np.cumprod(np.r_[1.0, np.full(n - 1, over[0] ** (1 / n))])  # modes of size (q0/qn)^(1/n)
    b = np.zeros((n, 1))
    b[-1] = 1 / scale[-1]
    return scale[None] * a / scale[:, None] / tau, b / tau, (c * scale)[None], np.array([[flipped[-1]]])


def _register(samples: float) -> tuple[np.ndarray, ...]:
    k = math.floor(samples + WHOLE)
    share = max(samples - k, 0.0) if samples - k > WHOLE else 0.0
    n = k + (share > 0)
    if not n:
        return _through()
    a, b, c = np.eye(n, k=-1), np.zeros((n, 1)), np.zeros((1, n))
    b[0] = 1.0
    d = np.zeros((1, 1))
    for taps, weight in ((k, 1 - share), (k + 1, share)):
        if not weight:
            continue
        if taps:
            c[0, taps - 1] = weight
        else:
            d[0, 0] = weight
    return a, b, c, d


def _through() -> tuple[np.ndarray, ...]:
    return np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1))
