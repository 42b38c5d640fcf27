"""Hydraulic networks of any wiring: nodes joined by flow paths, bridges among them that are no series or parallel."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid.errors import InputError, NumericalError
from quartercar.dampers.laws.hydraulics import Path, invert_odd

SWEEPS = 500
"""passes over all loops at most"""
CLOSED = 1e-12
"""pressure left around a loop, as a share of the pressures in it, at which the loops count as closed"""

EPS = 4 * float(np.finfo(float).eps)
"""finest resolution of a root, as a share of the flows in its loop"""


@dataclass(frozen=True)
class Branch:
    """A flow path from one node to another; `path` is any composition of laminar and turbulent losses.

    Attributes
    ----------
    start, end : str
        Names of its nodes; flow from `start` to `end` is positive.
    path : Path
        Its loss.
    """

    start: str
    end: str
    path: Path


@dataclass(frozen=True)
class Loop:
    """Branches around one mesh, with +1 where the loop runs along a branch and −1 where it runs against it.

    Attributes
    ----------
    places : (m,) array of int
        Places of its branches in `Bridged.branches`.
    signs : (m,) array
        1 or −1.
    """

    places: np.ndarray
    signs: np.ndarray


class Bridged(Path):
    """Nodes joined by branches, between two terminals: g(p_1 … p_N) = 0 of (3)-(4) in source 003.

    ::

        inlet ──┬── path a ──┬── path b ──┬── outlet        Σ Q at every node = 0
                └── path d ──┼── path e ──┘                 Σ Δp around every loop = 0
                         (a bridge)

    Flows that obey the balance at the nodes are one particular solution plus circulations of the loops. The right
    circulations minimise Σ ∫ Δp dQ, which is strictly convex since every path is monotone; each is found in turn, by
    one-dimensional roots whose bracket is known exactly, until no pressure is left around any loop (Hardy Cross 1936,
    with exact line searches; of convex co-content, Duffin 1947).

    Parameters
    ----------
    branches : sequence of Branch
    inlet, outlet : str
        Names of the terminals.

    Raises
    ------
    InputError
        Terminals that are one node, or that no branches connect.

    Examples
    --------
    >>> from quartercar.dampers.laws.hydraulics import Laminar
    >>> wires = [("in", "a", 1.0), ("in", "b", 2.0), ("a", "b", 5.0), ("a", "out", 2.0), ("b", "out", 1.0)]
    >>> bridge = Bridged([Branch(start, end, Laminar(r)) for start, end, r in wires])
    >>> round(float(bridge.pressure(1.0)), 9)
    1.461538462
    """

    def __init__(self, branches: Sequence[Branch], inlet: str = "in", outlet: str = "out") -> None:
        if inlet == outlet:
            raise InputError("a network needs two terminals", got=f"'{inlet}' twice")
        self.branches, self.inlet, self.outlet = tuple(branches), inlet, outlet
        parent = self._tree(inlet)
        if outlet not in parent:
            raise InputError("the terminals of a network must be connected",
                             got=f"no path from '{inlet}' to '{outlet}'", mend="check the names of the nodes")
        self._through = self._signed(self._way(parent, outlet))
        chords = [k for k, b in enumerate(self.branches) if b.start in parent and k not in
                  {place for place, _ in parent.values()}]
        self._loops = tuple(self._loop(parent, k) for k in chords if self.branches[k].start != self.branches[k].end)

    def flows(self, flow: float) -> np.ndarray:
        """Flow of every branch, from its start to its end [m³/s].

        Parameters
        ----------
        flow : float
            Through the terminals [m³/s].

        Returns
        -------
        (b,) array
            In the order of `branches`.

        Raises
        ------
        NumericalError
            Loops that do not close within `SWEEPS` passes.
        """
        from scipy.optimize import brentq

        q = flow * self._through
        for _ in range(SWEEPS):
            if max((self._open(loop, q) for loop in self._loops), default=0.0) <= CLOSED:
                return q
            for loop in self._loops:
                along = loop.signs * q[loop.places]  # every term is odd and rising, so that the root lies between
                low, high = -along.max(), -along.min()
                if high > low:
                    move = brentq(lambda d, loop=loop, along=along: self._around(loop, along + d), low, high,
                                  xtol=EPS * np.abs(along).max(), rtol=np.float64(EPS))
                    q[loop.places] += loop.signs * move
        raise NumericalError(f"the flows of a network with {len(self._loops)} loops did not settle in {SWEEPS} passes")

    def pressure(self, flow: np.ndarray | float) -> np.ndarray:
        values = np.asarray(flow, dtype=float)
        return np.array([self._pressure(float(q)) for q in values.ravel()]).reshape(values.shape)

    def flow(self, pressure: np.ndarray | float) -> np.ndarray:
        start = next(self.branches[k].path for k in np.flatnonzero(self._through))
        return invert_odd(self.pressure, np.asarray(pressure, dtype=float), 1.5, start.flow)

    def _pressure(self, flow: float) -> float:
        q = self.flows(flow)
        used = np.flatnonzero(self._through)
        return float(sum(self._through[k] * self.branches[k].path.pressure(q[k]) for k in used))

    def _around(self, loop: Loop, along: np.ndarray) -> float:
        """Σ Δp around a loop, flows counted along it."""
        return float(sum(self.branches[k].path.pressure(a) for k, a in zip(loop.places, along, strict=True)))

    def _open(self, loop: Loop, q: np.ndarray) -> float:
        """Pressure left around a loop as a share of the sizes of its terms."""
        terms = [float(self.branches[k].path.pressure(s * q[k]))
                 for k, s in zip(loop.places, loop.signs, strict=True)]
        size = sum(map(abs, terms))
        return abs(sum(terms)) / size if size > 0 else 0.0

    # -- wiring ------------------------------------------------------------------------------------------------------
    def _tree(self, root: str) -> dict[str, tuple[int, str]]:
        """For every node that is connected to the root: the branch and the node that lead back towards it."""
        found: dict[str, tuple[int, str]] = {root: (-1, root)}
        queue = deque([root])
        while queue:
            here = queue.popleft()
            for k, b in enumerate(self.branches):
                for near, far in ((b.start, b.end), (b.end, b.start)):
                    if near == here and far not in found:
                        found[far] = (k, here)
                        queue.append(far)
        return found

    def _way(self, parent: dict[str, tuple[int, str]], node: str) -> list[tuple[int, int]]:
        """Branches of the tree from its root to a node, with the sign in which they are passed."""
        out: list[tuple[int, int]] = []
        while parent[node][0] >= 0:
            k, before = parent[node]
            out.append((k, 1 if self.branches[k].end == node else -1))
            node = before
        return out[::-1]

    def _signed(self, way: list[tuple[int, int]]) -> np.ndarray:
        q = np.zeros(len(self.branches))
        for k, sign in way:
            q[k] += sign
        return q

    def _loop(self, parent: dict[str, tuple[int, str]], chord: int) -> Loop:
        """The loop of a branch outside the tree: along it, and back through the tree."""
        b = self.branches[chord]
        signs = self._signed(self._way(parent, b.start)) - self._signed(self._way(parent, b.end))
        signs[chord] += 1
        places = np.flatnonzero(signs)
        return Loop(places, signs[places])
