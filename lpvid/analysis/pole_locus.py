"""Pole locus: frozen poles as branches over a scheduling variable, tracked through crossings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.analysis.frozen import CAVEAT, FrozenFamily, Line, Model, family, lines
from lpvid.codec import Encoded
from lpvid.errors import InputError
from lpvid.model.adaptable import checked_matrices

DEEPEST = 14
FIXED = 1e-3
REAL_POLE = 1e-7


@dataclass(frozen=True, eq=False)
class FixedPole(Encoded):
    """A pole that does not depend on the scheduling variable.

    Parameters
    ----------
    pole : complex
        z, or s [rad/s]; of a pair the one with positive imaginary part.
    branch : int
        Column of the locus.
    time_constant : float or None
        −1/Re s [s]; None where it does not decay.
    frequency_hz : float
        |s|/2π [Hz].
    """

    JSON = ("pole", "time_constant", "frequency_hz")

    pole: complex
    branch: int
    time_constant: float | None
    frequency_hz: float

    def text(self, variable: str) -> str:
        """One line for a report.

        Parameters
        ----------
        variable : str
            Name of the scheduling variable.

        Returns
        -------
        str
            With time constant [ms] and frequency [Hz].
        """
        slow = f", time constant {self.time_constant * 1e3:.4g} ms" if self.time_constant is not None else ""
        return (f"{variable}-independent pole {_complex(self.pole)}{slow}, {self.frequency_hz:.4g} Hz: "
                "suspect the rig or a filter rather than the device")


@dataclass(frozen=True)
class Meeting(Encoded):
    """Where two real poles become a complex pair ("pair") or the reverse ("real"), for a rising variable.

    Parameters
    ----------
    value : float
        Of the scheduling variable, in its unit.
    becomes : str
        "pair" or "real".
    pole : complex
        Where they meet: z, or s [rad/s].
    """

    JSON = ("value", "becomes")

    value: float
    becomes: str
    pole: complex


@dataclass(frozen=True, eq=False)
class PoleLocus(Encoded):
    """Frozen poles along one scheduling variable, one column for each branch.

    It gives no information on a scheduling variable that moves; see `certify_stability`.

    Parameters
    ----------
    variable, unit : str
        What `p` measures.
    p : (n,) array
    poles : (n, n_poles) complex array
        z in discrete time, s [rad/s] in continuous time.
    sample_time : float or None
        [s]; None in continuous time.
    fixed : tuple of FixedPole
    meetings : tuple of Meeting
    notes : tuple of str
    """

    caveat = CAVEAT
    JSON = ("variable", "unit", "p", "poles", "fixed", "meetings", "notes", "caveat")

    variable: str
    unit: str
    p: np.ndarray
    poles: np.ndarray
    sample_time: float | None
    fixed: tuple[FixedPole, ...]
    meetings: tuple[Meeting, ...]
    notes: tuple[str, ...]

    @property
    def is_discrete(self) -> bool:
        """True for poles in z."""
        return self.sample_time is not None

    @property
    def continuous_poles(self) -> np.ndarray:
        """(n, n_poles) poles in rad/s: log(z)/Ts in discrete time; −inf for z = 0."""
        return _to_continuous(self.poles, self.sample_time)

    @property
    def frequency_hz(self) -> np.ndarray:
        """(n, n_poles) natural frequency |s|/2π [Hz]."""
        return np.abs(self.continuous_poles) / (2 * np.pi)

    @property
    def damping_ratio(self) -> np.ndarray:
        """(n, n_poles) −Re s/|s|; 1 for a pole z = 0, NaN for a pole s = 0."""
        s = self.continuous_poles
        size = np.abs(s)
        usable = np.isfinite(size) & (size > 0)
        ratio = np.where(usable, -np.real(s) / np.where(usable, size, 1.0), np.nan)
        return np.where(np.isinf(size), 1.0, ratio)

    @property
    def max_modulus(self) -> np.ndarray:
        """(n,) largest |z|, or largest Re s [1/s] in continuous time."""
        if self.poles.shape[1] == 0:
            return np.full(self.p.size, 0.0 if self.is_discrete else -np.inf)
        return (np.abs(self.poles) if self.is_discrete else np.real(self.poles)).max(axis=1)

    @property
    def stable(self) -> np.ndarray:
        """(n,) bool: whether all poles decay."""
        return self.max_modulus < (1.0 if self.is_discrete else 0.0)

    def __str__(self) -> str:
        span = f"{self.variable} from {self.p[0]:.6g} to {self.p[-1]:.6g} {self.unit}".rstrip()
        worst = int(np.argmax(self.max_modulus))
        what = "modulus" if self.is_discrete else "real part"
        verdict = "frozen-stable at every point shown" if self.stable.all() else (
            f"frozen-UNSTABLE at {int((~self.stable).sum())} of {self.p.size} points")
        rows = [f"{verdict}: {self.poles.shape[1]} poles over {span}",
                f"  largest {what} {self.max_modulus[worst]:.6g} at {self.p[worst]:.6g} {self.unit}".rstrip()]
        return "\n".join([*rows, *(f"  {n}" for n in self.notes), CAVEAT])

    __repr__ = __str__


def pole_locus(model: Model, variable: str | None = None, points: int = 201,
               at: Mapping[str, float] | Sequence[float] | None = None,
               direction: Mapping[str, float] | Sequence[float] | None = None,
               range: tuple[float, float] | None = None) -> PoleLocus:
    """Frozen poles along one scheduling variable (or a direction), as continuous branches.

    Neighbouring sets of poles are matched by linear assignment to a linear prediction; a step on which the poles
    move further than they lie apart is halved until they do not, so that branches do not swap where they pass close by.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
    variable : str, optional
        Which one; may be left out when there is only one.
    points : int
        Number of values shown.
    at : mapping or (n_scheduling,) sequence, optional
        Where the other variables stand; the middle of the box by default.
    direction : mapping or (n_scheduling,) sequence, optional
        Follow p(s) = at + s·direction instead.
    range : (low, high), optional
        Values shown; the box by default.

    Returns
    -------
    PoleLocus

    Examples
    --------
    >>> from lpvid.model.transfer_function import LPVTransferFunction
    >>> from lpvid.scheduling import Polynomial
    >>> model = LPVTransferFunction.siso(a=[[-0.5, 0.25]], b=[[0, 0], [1, 0]], sample_time=0.1,
    ...                                  basis=Polynomial("current", degree=1))
    >>> pole_locus(model, points=3).poles.real.ravel()
    array([0.75, 0.5 , 0.25])
    """
    checked_matrices(model, "a pole locus is that of a model")
    line = one_line(model, variable, at, direction)
    p = grid_along(line, points, range)
    models = family(model)
    poles, rough = _tracked(models, line, p)
    meetings = _meetings(models, line, p, poles)
    fixed = _fixed(poles, models.sample_time)
    notes = [f.text(line.label) for f in fixed] + _ringing(poles, models.sample_time)
    notes += [f"two real poles {'become a complex pair' if m.becomes == 'pair' else 'come out of a complex pair'} "
              f"at {line.label} = {line.text(m.value)}" for m in meetings[:4]]
    notes += [f"{len(meetings) - 4} more meetings of real poles"] if len(meetings) > 4 else []
    away = [s for s in rough if not any(abs(s - m.value) <= 2 * (p[-1] - p[0]) / (points - 1) for m in meetings)]
    if away:
        notes.append(f"branches meet and may have swapped near {line.label} = "
                     + ", ".join(line.text(s) for s in away[:4]))
    poles.setflags(write=False)
    return PoleLocus(line.label, line.unit, p, poles, models.sample_time, fixed, meetings, tuple(notes))


def one_line(model: Model, variable: str | None, at: Mapping[str, float] | Sequence[float] | None,
             direction: Mapping[str, float] | Sequence[float] | None) -> Line:
    """The single line that a plot over one variable needs.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        Its box names the variables.
    variable : str or None
        Which one; None where there is only one, or a direction.
    at : mapping or (n_scheduling,) sequence, or None
        Where the other variables stand; None for the middle of the box.
    direction : mapping or (n_scheduling,) sequence, or None
        Follow p(s) = at + s·direction instead.

    Returns
    -------
    Line
        With the range of the box.

    Raises
    ------
    InputError
        No scheduling variable, or several and none named; whatever `lines` refuses.
    """
    listed = lines(model, variable, at, direction)
    if len(listed) != 1:
        raise InputError("a locus is drawn over one scheduling variable",
                         got=", ".join(model.box.names) or "a model without scheduling variables",
                         mend="name one with variable=..." if listed else None)
    return listed[0]


def grid_along(line: Line, points: int, span: tuple[float, float] | None) -> np.ndarray:
    """`points` equal steps over `span`, or over the box.

    Parameters
    ----------
    line : Line
        Gives the range of the box.
    points : int
        Number of values, at least 2.
    span : (float, float) or None
        Lower and upper value, in the unit of the line; None for the box.

    Returns
    -------
    (points,) array
        Rising, ends included, read-only.

    Raises
    ------
    InputError
        Fewer than two points, or a range whose lower end is not below its upper end (a box without width too).
    """
    _checks.count(points, "points", at_least=2)
    low, high = (line.low, line.high) if span is None else (_checks.real(x, "range") for x in span)
    if not low < high:
        raise InputError("the range of a locus needs its lower end below its upper end", got=f"{low} and {high}",
                         mend="give range=(low, high)")
    grid = np.linspace(low, high, points)
    grid.setflags(write=False)
    return grid


# -- tracking ---------------------------------------------------------------------------------------------------------
def _tracked(models: FrozenFamily, line: Line, p: np.ndarray) -> tuple[np.ndarray, list[float]]:
    """(n, n_poles) poles in matched order, and the values near which the order is uncertain."""
    from scipy.optimize import linear_sum_assignment

    raw = models.poles(line.points(p))
    if raw.shape[1] == 0:
        return raw, []
    order = np.lexsort((-raw[0].imag, -raw[0].real, -np.abs(raw[0]).round(9)))
    raw[0] = raw[0][order]
    rough: list[float] = []

    def match(before: np.ndarray, slope: np.ndarray, step: float, after: np.ndarray) -> tuple[np.ndarray, bool]:
        predicted = before + slope * step
        cost = np.abs(predicted[:, None] - after[None, :])
        _, column = linear_sum_assignment(cost)
        matched = after[column]
        missed = np.abs(matched - predicted)
        apart = np.abs(after[:, None] - after[None, :])[np.ix_(column, column)] + np.diag(np.full(after.size, np.inf))
        ambiguous = missed[:, None] + missed[None, :] > 0.5 * apart
        close_anyway = apart <= 1e-6 * max(1.0, float(np.abs(after).max()))
        return matched, not bool((ambiguous & ~close_anyway).any())

    def advance(a: float, before: np.ndarray, slope: np.ndarray, b: float, after: np.ndarray,
                depth: int) -> tuple[np.ndarray, np.ndarray]:
        matched, safe = match(before, slope, b - a, after)
        if safe or depth == DEEPEST:
            if not safe:
                rough.append(0.5 * (a + b))
            return matched, (matched - before) / (b - a)
        middle = 0.5 * (a + b)
        halfway, slope = advance(a, before, slope, middle, models.poles(line.points(middle))[0], depth + 1)
        return advance(middle, halfway, slope, b, after, depth + 1)

    slope = np.zeros(raw.shape[1], dtype=complex)
    for k in np.arange(1, p.size):
        raw[k], slope = advance(float(p[k - 1]), raw[k - 1], slope, float(p[k]), raw[k], 0)
    return raw, rough


def _meetings(models: FrozenFamily, line: Line, p: np.ndarray, poles: np.ndarray) -> tuple[Meeting, ...]:
    """Where the number of real poles changes, by bisection to full precision."""
    size = 1.0 if models.discrete else max(float(np.abs(poles).max(initial=0.0)), 1e-300)
    real = (np.abs(np.imag(poles)) <= REAL_POLE * size).sum(axis=1)
    listed = []
    for k in np.nonzero(np.diff(real))[0]:
        a, b = float(p[k]), float(p[k + 1])
        for _ in np.arange(50):
            middle = 0.5 * (a + b)
            here = models.poles(line.points(middle))[0]
            count = int((np.abs(here.imag) <= REAL_POLE * size).sum())
            a, b = (middle, b) if count == real[k] else (a, middle)
        there = models.poles(line.points(b))[0]
        gap = np.abs(there[:, None] - there[None, :]) + np.diag(np.full(there.size, np.inf))
        i, j = np.unravel_index(int(np.argmin(gap)), gap.shape)
        listed.append(Meeting(b, "pair" if real[k + 1] < real[k] else "real", complex(0.5 * (there[i] + there[j]))))
    return tuple(listed)


# -- findings ---------------------------------------------------------------------------------------------------------
def _to_continuous(poles: np.ndarray, sample_time: float | None) -> np.ndarray:
    if sample_time is None:
        return poles
    nonzero = np.abs(poles) > 0
    log = np.log(np.where(nonzero, poles, 1.0)) / sample_time
    return np.where(nonzero, log, complex(-np.inf, 0.0))


def _fixed(poles: np.ndarray, sample_time: float | None) -> tuple[FixedPole, ...]:
    """Branches that stay put while at least one other moves; a pole that stays at z = 0 is a mere delay."""
    if poles.shape[1] < 2:
        return ()
    size = 1.0 if sample_time is not None else np.maximum(np.abs(poles).mean(axis=0), 1e-300)
    spread = np.abs(poles - poles.mean(axis=0)).max(axis=0) / size
    moving = spread.max(initial=0.0)
    listed = []
    for i in np.nonzero((spread <= FIXED) & (spread < 0.05 * moving))[0]:
        pole = complex(poles[:, i].mean())
        if (sample_time is not None and abs(pole) < 1e-6) or pole.imag < -1e-12:
            continue
        s = complex(_to_continuous(np.array([pole]), sample_time)[0])
        decay = -1.0 / s.real if s.real < 0 else None
        listed.append(FixedPole(pole, int(i), decay, abs(s) / (2 * np.pi)))
    return tuple(listed)


def _ringing(poles: np.ndarray, sample_time: float | None) -> list[str]:
    if sample_time is None or poles.shape[1] == 0:
        return []
    negative = (np.real(poles) < -1e-6) & (np.abs(np.imag(poles)) <= 1e-9 * np.maximum(np.abs(poles), 1e-300))
    count = int(negative.any(axis=0).sum())
    if not count:
        return []
    lowest = float(np.real(poles)[negative].min())
    which = "a negative real pole" if count == 1 else f"{count} negative real poles"
    return [f"{which} (down to {lowest:.4g}): ringing at the Nyquist frequency {0.5 / sample_time:.5g} Hz, without a "
            "continuous counterpart; the order may be too high"]


def _complex(pole: complex) -> str:
    return f"{pole.real:.4g}" if abs(pole.imag) < 1e-9 else f"{pole.real:.4g}{pole.imag:+.4g}j"
