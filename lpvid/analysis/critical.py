"""The exact scheduling values at which the frozen model gains or loses stability."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.analysis.crossings import Crossing, LineSearch, search
from lpvid.analysis.frozen import CAVEAT, FrozenFamily, Line, Model, family, lines
from lpvid.codec import Encoded
from lpvid.errors import InputError
from lpvid.model.adaptable import checked_matrices


@dataclass(frozen=True)
class Critical(Encoded):
    """One value at which a pole reaches the boundary of stability.

    Parameters
    ----------
    value : float
        Value of the scheduling variable, or distance along a direction.
    variable, unit : str
        What `value` measures.
    direction : {"to-unstable", "to-stable", "touching"}
        What happens to the pole, for rising `value`.
    crossing : {"+1", "-1", "complex", "zero", "imaginary"}
        Where it meets the unit circle (discrete time) or the imaginary axis (continuous time).
    modulus_residual : float
        | |pole| − 1 |, or |Re pole| over the largest |pole|, at `value`.
    frequency_hz : float
        Frequency of the undamped oscillation there.
    pole : complex
    """

    JSON = ("value", "variable", "unit", "direction", "crossing", "frequency_hz", "modulus_residual", "pole")

    value: float
    variable: str
    unit: str
    direction: str
    crossing: str
    modulus_residual: float
    frequency_hz: float
    pole: complex

    def __str__(self) -> str:
        where = {"zero": "0", "imaginary": "the imaginary axis", "complex": "the unit circle"}.get(
            self.crossing, self.crossing)
        return (f"{self.direction} at {self.variable} = {self.value:.6g} {self.unit}".rstrip()
                + f" through {where} ({self.frequency_hz:.4g} Hz)")


@dataclass(frozen=True, eq=False)
class CriticalLine:
    """Frozen stability along one line through the scheduling space.

    ``values`` change the stability of the model; ``crossings`` also has the poles that cross while others are already
    unstable. ``stable_intervals`` are open, over the whole real line.

    Attributes
    ----------
    line : Line
        Where it was looked.
    values, crossings : tuple of Critical
        Rising.
    stable_intervals : tuple of (float, float)
        In the unit of the line; ends may be infinite.
    exact : bool
        False where a grid was searched in place of the whole line.
    notes : tuple of str
        Poles that stay on the boundary or only touch it, and what was found by bisection or on a grid.
    """

    line: Line
    values: tuple[Critical, ...]
    crossings: tuple[Critical, ...]
    stable_intervals: tuple[tuple[float, float], ...]
    exact: bool
    notes: tuple[str, ...]

    @property
    def stable_range(self) -> tuple[float, float] | None:
        """The stable interval that holds the whole box, or None where some of the box is unstable."""
        inside = [i for i in self.stable_intervals if i[0] < self.line.low and self.line.high < i[1]]
        return inside[0] if inside else None

    @property
    def stable(self) -> bool:
        """Whether the frozen model is stable at every value of the box."""
        return self.stable_range is not None

    def __str__(self) -> str:
        line = self.line
        span = f"{line.label} from {line.low:.6g} to {line.text(line.high)}"
        rows = [f"{'frozen-stable over' if self.stable else 'NOT frozen-stable at every point over'} {span}"]
        held = ", ".join(f"{x:.4g}" for x, d in zip(line.origin, line.direction, strict=True) if d == 0)
        if held:
            rows[0] += f", the other variables held at {held}"
        rows += [f"  {v}{'' if line.low <= v.value <= line.high else ', outside the range'}"
                 for v in self.values] or ["  no value changes the stability"]
        shown = ", ".join(f"({a:.6g}, {b:.6g})" for a, b in self.stable_intervals)
        rows.append(f"  frozen-stable: {shown or 'nowhere'} {line.unit}".rstrip())
        return "\n".join(rows + [f"  note: {n}" for n in self.notes])


@dataclass(frozen=True, eq=False)
class CriticalScheduling:
    """Critical values along one line, or along the axis of every scheduling variable.

    A frozen-stable model can still be unstable while its scheduling variable moves: two matrices whose poles are all
    zero, applied in turn, can make every state grow. `certify_stability` covers that; this result does not.

    Attributes
    ----------
    lines : tuple of CriticalLine
        One along a direction, else one for each variable.
    """

    lines: tuple[CriticalLine, ...]

    @property
    def values(self) -> tuple[Critical, ...]:
        """Values at which the stability of the frozen model changes."""
        return tuple(v for line in self.lines for v in line.values)

    @property
    def crossings(self) -> tuple[Critical, ...]:
        """Every pole that meets the boundary, among unstable ones too."""
        return tuple(v for line in self.lines for v in line.crossings)

    @property
    def exact(self) -> bool:
        """False where a basis is not piecewise polynomial and a grid was searched instead."""
        return all(line.exact for line in self.lines)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the result."""
        return tuple(n for line in self.lines for n in line.notes)

    def along(self, variable: str) -> CriticalLine:
        """The line of one scheduling variable.

        Parameters
        ----------
        variable : str
            One of the variables whose axes were followed.

        Returns
        -------
        CriticalLine
            Along its axis.
        """
        labels = [c.line.label for c in self.lines]
        return self.lines[labels.index(_checks.known_name(variable, labels, "line"))]

    @property
    def _single(self) -> CriticalLine:
        if len(self.lines) != 1:
            raise InputError("this result has more than one line", got=", ".join(c.line.label for c in self.lines),
                             mend="ask for one of them with .along(name)")
        return self.lines[0]

    @property
    def stable_intervals(self) -> tuple[tuple[float, float], ...]:
        """Open intervals on which the frozen model is stable, over the whole real line (of a single line)."""
        return self._single.stable_intervals

    @property
    def stable_range(self) -> tuple[float, float] | None:
        """The stable interval that holds the box, or None (of a single line)."""
        return self._single.stable_range

    @property
    def stable(self) -> bool:
        """Whether every line is frozen-stable over its part of the box."""
        return all(line.stable for line in self.lines)

    def __str__(self) -> str:
        rows = [str(line) for line in self.lines] or ["the model has no scheduling variables: nothing can be critical"]
        return "\n".join([*rows, CAVEAT])

    __repr__ = __str__

    def to_dict(self) -> dict:
        """Plain data for JSON; an unbounded end of an interval is null.

        Returns
        -------
        dict
            Plain values by name.
        """
        def interval(pair: tuple[float, float]) -> list[float | None]:
            return [x if np.isfinite(x) else None for x in pair]

        return {"critical": [v.to_dict() for v in self.values], "crossings": [v.to_dict() for v in self.crossings],
                "stable_intervals": {c.line.label: [interval(i) for i in c.stable_intervals] for c in self.lines},
                "range": {c.line.label: [c.line.low, c.line.high] for c in self.lines},
                "stable": {c.line.label: c.stable for c in self.lines}, "exact": self.exact,
                "notes": list(self.notes), "caveat": CAVEAT}


def critical_scheduling(model: Model, variable: str | Sequence[str] | None = None,
                        at: Mapping[str, float] | Sequence[float] | None = None,
                        direction: Mapping[str, float] | Sequence[float] | None = None) -> CriticalScheduling:
    """The exact scheduling values at which the frozen model changes stability, over the whole real line.

    Guardian maps: A(p) has an eigenvalue +1 or −1 where det(A(p) ∓ I) = 0, and a pair on the unit circle where
    det(A(p)⊙A(p) − I) = 0 with the bialternate product; in continuous time det A(p) = 0 and det(2A(p)⊙I) = 0
    (Saydy, Tits & Abed 1990). Along a line each is a polynomial eigenvalue problem in one unknown; no grid decides.
    Each solution is polished by Newton steps and verified on the poles, and the number of unstable poles is counted
    between neighbours, so that a solution missed by an ill-conditioned problem is found by bisection (and noted).
    Splines are taken piece by piece. A basis that is neither is searched on a grid, and ``exact`` is then False.

    It gives no information on a scheduling variable that *moves*; see `certify_stability`.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
    variable : str or sequence of str, optional
        Variables whose axes to follow; all by default.
    at : mapping or (n_scheduling,) sequence, optional
        The point through which the lines go, in the variables' units; the middle of the box by default.
    direction : mapping or (n_scheduling,) sequence, optional
        Follow p(s) = at + s·direction instead of the axes.

    Returns
    -------
    CriticalScheduling

    Examples
    --------
    >>> from lpvid.model.transfer_function import LPVTransferFunction
    >>> from lpvid.scheduling import Polynomial
    >>> model = LPVTransferFunction.siso(a=[[-0.5, 0.25]], b=[[0, 0], [1, 0]], sample_time=0.1,
    ...                                  basis=Polynomial("current", degree=1))
    >>> [(round(c.value, 9), c.direction, c.crossing) for c in critical_scheduling(model).values]
    [(-2.0, 'to-stable', '+1'), (6.0, 'to-unstable', '-1')]
    """
    checked_matrices(model, "critical scheduling values are those of a model")
    models = family(model)
    return CriticalScheduling(tuple(_along(models, model.box.names, line)
                                    for line in lines(model, variable, at, direction)))


def _along(models: FrozenFamily, names: tuple[str, ...], line: Line) -> CriticalLine:
    found = search(models, names, line)
    crossings = tuple(_critical(c, line, models.sample_time) for group in found.groups for c in group.crossings)
    values = tuple(_critical(c, line, models.sample_time) for group in found.groups if group.changes_stability
                   for c in group.crossings)
    return CriticalLine(line, values, crossings, tuple(found.stable_intervals), found.exact, _notes(found, line))


def _critical(crossing: Crossing, line: Line, sample_time: float | None) -> Critical:
    pole = crossing.pole
    radians = abs(pole.imag) if sample_time is None else abs(np.angle(pole)) / sample_time
    return Critical(float(crossing.s), line.label, line.unit, crossing.direction, crossing.kind,
                    float(crossing.residual), float(radians / (2 * np.pi)), complex(pole))


def _notes(found: LineSearch, line: Line) -> tuple[str, ...]:
    notes = []
    for low, high, kinds in found.always:
        where = "every value" if np.isinf(low) and np.isinf(high) else f"{low:.6g} to {line.text(high)}"
        notes.append(f"a pole stays on the stability boundary ({', '.join(kinds)}) at {where} of {line.label}: "
                     "the frozen model is not asymptotically stable there")
    if found.bisected and found.exact:
        why = "beside a pole that stays there" if found.always else "where the eigenvalue problem was ill-conditioned"
        notes.append(f"{found.bisected} crossing(s) of the boundary found by bisection, {why}")
    if not found.exact:
        notes.append(f"searched on a grid from {found.window[0]:.6g} to {line.text(found.window[1])} only: "
                     f"{found.why_grid}")
    touching = [group.s for group in found.groups if group.crossings[0].direction == "touching"]
    notes += [f"a pole touches the boundary at {line.label} = {line.text(s)} without crossing it" for s in touching]
    return tuple(notes)
