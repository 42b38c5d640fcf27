"""H-infinity norms of frozen systems: what no bound of an induced gain can be smaller than."""

from __future__ import annotations

import math

import numpy as np

from lpvid.lmi.certificate import grid
from lpvid.lmi.driven import Driven, Matrices
from lpvid.scheduling import Scheduling

POINTS = {0: 1, 1: 41, 2: 9, 3: 5, 4: 3}
STEPS = 40
DECADE = 10
"""frequencies per decade that are looked at first, from a tenth of the slowest pole to ten times the fastest"""
PEAKS = 3
"""local maxima that are refined"""
ZOOMS, PARTS = 6, 8
"""Refinements of a maximum, and the parts into which the interval around it is divided: each leaves two of them, six
3e-4 of the first interval, in which a smooth maximum is flat to 1e-7."""


def h_infinity_norm(system: Matrices, discrete: bool = False) -> tuple[float, float]:
    """Largest gain over frequency of a stable time-invariant system, and where it is reached.

    The largest gain found so far is γ; eigenvalues of the Hamiltonian matrix of γ on the imaginary axis are the
    frequencies where a singular value equals γ, and between two of them the gain is larger (Bruinsma & Steinbuch,
    Systems & Control Letters 14 (1990) 287-293). What is returned is the gain at a frequency, never more.

    Where paths inside the system all but cancel (a controller with fast weights inside: Hankel singular values of 1e6
    beside a gain of 0.15), these eigenvalues lose the axis in any coordinates, and a maximum would be missed. So the
    search begins on a grid of frequencies, and where the eigenvalues show nothing above it the highest maxima are
    refined by gains alone.

    Parameters
    ----------
    system : (A, B, C, D)
    discrete : bool
        Frequencies are then in rad per sample.

    Returns
    -------
    norm : float
    frequency : float
        [rad/s]; may be infinite.

    Examples
    --------
    >>> norm, frequency = h_infinity_norm(tuple(np.array(x) for x in
    ...                                   ([[0, 1.0], [-1, -0.2]], [[0], [1.0]], [[1.0, 0]], [[0.0]])))
    >>> round(norm, 4), round(frequency, 4)
    (5.0252, 0.9899)
    """
    a, b, c, d = to_continuous(system) if discrete else system

    def tidy(omega: float) -> float:
        return 2 * math.atan(omega) if discrete else omega

    poles = _poles(a)
    tried = np.union1d(_guesses(poles), _around(poles))
    gains = _gains((a, b, c, d), tried)
    best = int(gains.argmax())
    level, where = float(gains[best]), float(tried[best])
    if not len(a) or not 0 < level < math.inf:
        return level, tidy(where)
    settled = False  # one step that raises the level leaves 2e-6 of it, also with paths of 1e7 times the gain inside
    for _ in range(STEPS):
        crossings = _crossings((a, b, c, d), level * (1 + 1e-9))
        if not len(crossings):
            break
        edges = np.concatenate([[0.0], crossings, [2 * crossings[-1]]])
        points = np.concatenate([0.5 * (edges[1:] + edges[:-1]), crossings])
        raised = _gains((a, b, c, d), points)
        best = int(raised.argmax())
        if not raised[best] > level * (1 + 1e-10):
            break
        level, where, settled = float(raised[best]), float(points[best]), True
    if not settled:
        refined, at = _refined((a, b, c, d), tried, gains)
        if refined > level:
            level, where = refined, at
    return level, tidy(where)


def _refined(system: Matrices, frequencies: np.ndarray, gains: np.ndarray) -> tuple[float, float]:
    """The largest gain near the highest local maxima of known ones, and its frequency."""
    finite = np.isfinite(frequencies)
    omega, first = np.unique(frequencies[finite], return_index=True)
    at = gains[finite][first]
    padded = np.concatenate([[-math.inf], at, [-math.inf]])
    tops = np.flatnonzero((at >= padded[:-2]) & (at >= padded[2:]))
    tops = tops[np.argsort(-at[tops], kind="stable")[:PEAKS]]
    low, high = omega[np.maximum(tops - 1, 0)], omega[np.minimum(tops + 1, len(omega) - 1)]
    best = float(at[tops[0]]), float(omega[tops[0]])
    for _ in range(ZOOMS):
        points = np.linspace(low, high, PARTS + 1, axis=1)
        found = _gains(system, points.ravel()).reshape(points.shape)
        k, rows = found.argmax(axis=1), np.arange(len(points))
        top = int(found[rows, k].argmax())
        if found[top, k[top]] > best[0]:
            best = float(found[top, k[top]]), float(points[top, k[top]])
        low, high = points[rows, np.maximum(k - 1, 0)], points[rows, np.minimum(k + 1, PARTS)]
    return best


def to_continuous(system: Matrices, sign: float = 1.0) -> Matrices:
    """The continuous system with the same gains, z = (1 + s)/(1 − s), or z = (s + 1)/(s − 1) for the sign −1.

    Parameters
    ----------
    system : (A, B, C, D), or each (N, …)
        Discrete.
    sign : float
        1 or −1, as `lpvid.synthesis.bilinear.sign_for` chooses it.

    Returns
    -------
    (A, B, C, D), or each (N, …)
        Continuous.
    """
    a, b, c, d = system
    eye = sign * np.eye(a.shape[-1])
    inverse = np.linalg.inv(a + eye)
    return inverse @ (a - eye), sign * np.sqrt(2) * inverse @ b, np.sqrt(2) * c @ inverse, d - c @ inverse @ b


def _poles(a: np.ndarray) -> np.ndarray:
    return np.linalg.eigvals(a) if len(a) else np.zeros(0)


def _guesses(poles: np.ndarray) -> np.ndarray:
    """Ends of the axis, and the frequencies of the poles."""
    resonant = np.sqrt(np.maximum(np.imag(poles)**2 - np.real(poles)**2, 0.0))
    return np.unique(np.concatenate([[0.0, math.inf], np.abs(poles), np.abs(np.imag(poles)), resonant]))


def _around(poles: np.ndarray) -> np.ndarray:
    """A grid of frequencies around the poles, those that are zero but for rounding apart."""
    moving = np.abs(poles)[np.abs(poles) > 1e-12 * np.abs(poles).max(initial=0.0)]
    if not len(moving):
        return moving
    low, high = moving.min() / 10, 10 * moving.max()
    return np.geomspace(low, high, 1 + math.ceil(DECADE * math.log10(high / low)))


def _gains(system: Matrices, frequencies: np.ndarray) -> np.ndarray:
    a, b, c, d = system
    if not d.size:
        return np.zeros(len(frequencies))
    finite = np.where(np.isfinite(frequencies), frequencies, 0.0)
    pencil = 1j * finite[:, None, None] * np.eye(len(a)) - a
    try:
        response = c @ np.linalg.solve(pencil, np.broadcast_to(b.astype(complex), (len(finite), *b.shape)))
    except np.linalg.LinAlgError:  # a pole on the axis
        return np.full(len(frequencies), math.inf)
    response = np.where(np.isfinite(frequencies)[:, None, None], response, 0.0) + d
    return np.linalg.norm(response, 2, axis=(1, 2))


def _crossings(system: Matrices, level: float) -> np.ndarray:
    a, b, c, d = system
    weight = level**2 * np.eye(d.shape[1]) - d.T @ d
    try:
        inverse = np.linalg.inv(weight)
    except np.linalg.LinAlgError:
        return np.zeros(0)
    inner = a + b @ inverse @ d.T @ c
    hamiltonian = np.block([[inner, b @ inverse @ b.T], [-c.T @ (np.eye(len(c)) + d @ inverse @ d.T) @ c, -inner.T]])
    if not np.all(np.isfinite(hamiltonian)):
        return np.zeros(0)
    roots = np.linalg.eigvals(hamiltonian)
    near = np.abs(roots.real) <= 1e-7 * np.maximum(np.abs(roots), 1e-3 * np.abs(roots).max(initial=1e-300))
    return np.unique(np.abs(roots.imag[near]))


def largest_frozen_norm(system: Driven, box: Scheduling) -> tuple[float, np.ndarray, float]:
    """Largest H-infinity norm over a grid, refined around it: (norm, p, frequency [rad/s]).

    Parameters
    ----------
    system : Driven
        w → z; stable at every held value.
    box : Scheduling
        One entry for each reading.

    Returns
    -------
    float
        Norm, in units of z per w.
    (readings,) array
        Scheduling where it is.
    float
        Frequency [rad/s]; may be infinite.
    """
    points = grid(box, POINTS.get(len(box.names), 2))
    discrete = system.sample_time is not None

    def norm(point: np.ndarray) -> tuple[float, float]:
        a, b, c, d = (x[0] for x in system.matrices(point[None, :]))
        return h_infinity_norm((a, b, c, d), discrete)

    rough = _rough(system, points)
    found = [(*norm(points[k]), points[k]) for k in np.argsort(rough)[-4:]]
    level, frequency, at = max(found, key=lambda x: x[0])
    step = 2 * box.half_width / max(POINTS.get(len(box.names), 2) - 1, 1)
    for _ in range(5):
        for i in range(len(box.names)):
            for sign in (-1.0, 1.0):
                trial = at.copy()
                trial[i] = np.clip(at[i] + sign * 0.5 * step[i], box.lower[i], box.upper[i])
                value, omega = norm(trial) if trial[i] != at[i] else (0.0, 0.0)
                if value > level:
                    level, frequency, at = value, omega, trial
        step = 0.5 * step
    return level, at, frequency / (system.sample_time or 1.0)


def _rough(system: Driven, points: np.ndarray) -> np.ndarray:
    """(N,) gains at a few frequencies each."""
    a, b, c, d = system.matrices(points)
    discrete = system.sample_time is not None
    found = np.zeros(len(points))
    for k in range(len(points)):
        parts = (a[k], b[k], c[k], d[k])
        plain = to_continuous(parts) if discrete else parts
        found[k] = _gains(plain, _guesses(_poles(plain[0]))).max()
    return found


def response_at(system: Matrices, s: complex) -> np.ndarray:
    """(ny, nu) response of a time-invariant system at one point of the plane.

    Parameters
    ----------
    system : (A, B, C, D)
        The system.
    s : complex
        jω, or z = exp(jωT) in discrete time.

    Returns
    -------
    (ny, nu) complex array
        C (sI − A)⁻¹ B + D.
    """
    a, b, c, d = system
    return c @ np.linalg.solve(s * np.eye(len(a)) - a, b.astype(complex)) + d if len(a) else d.astype(complex)
