"""Small blocks and the ways to put systems side by side or one behind the other."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.signals import Signal, as_signals, listed_signals
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial
from lpvid.synthesis._wiring import signed_sum
from lpvid.synthesis.interconnection import connect


def gain(matrix: np.ndarray | Sequence, inputs: Sequence[str | Signal], outputs: Sequence[str | Signal]
         ) -> LPVStateSpace:
    """y = matrix · u without states; it joins systems of any sampling period.

    Parameters
    ----------
    matrix : (n_outputs, n_inputs) array
        In units of output per input.
    inputs, outputs : sequence of str or Signal
        Names, or names with units.

    Returns
    -------
    LPVStateSpace
        Without states and sample time.

    Examples
    --------
    >>> gain([[2.0, -1.0]], ["r", "y"], ["e"]).frozen([])[3]
    array([[ 2., -1.]])
    """
    d = _checks.frozen_array(matrix, "the matrix of a gain", ndim=2)
    _checks.shaped(d, (len(outputs), len(inputs)), "the matrix of a gain")
    return LPVStateSpace.of(d[None], 0, Polynomial(), None, inputs=as_signals(inputs, "u", 0),
                            outputs=as_signals(outputs, "y", 0))


def summing_junction(text: str, unit: str = "") -> LPVStateSpace:
    """The block of a signed sum; all its signals carry one unit.

    Parameters
    ----------
    text : str
        "output = signed sum of inputs", each with a number before it where that is not 1.
    unit : str
        Of every signal; empty where it is not known.

    Returns
    -------
    LPVStateSpace
        A gain with one row.

    Raises
    ------
    InputError
        No equals sign, no name before it, or what follows is no signed sum.

    Examples
    --------
    >>> summing_junction("error = reference - 2 speed", "m/s")
    LPVStateSpace reference [m/s], speed [m/s] -> error [m/s]: 0 states, basis {1}, continuous
    """
    left, equals, right = text.partition("=")
    if not equals or not left.strip():
        raise InputError("a summing junction needs a name for its output", got=repr(text), mend='write "e = r - y"')
    factors = signed_sum(right)
    return gain([list(factors.values())], [Signal(n, unit) for n in factors], [Signal(left.strip(), unit)])


def append(*systems: LPVStateSpace) -> LPVStateSpace:
    """The systems side by side: all inputs, all outputs, nothing joined.

    Parameters
    ----------
    *systems : LPVStateSpace
        Of one sample time, apart from gains.

    Returns
    -------
    LPVStateSpace
        Inputs and outputs in the order of the systems.

    Raises
    ------
    InputError
        A name that occurs twice among the inputs or among the outputs.

    Examples
    --------
    >>> append(gain([[2.0]], ["a"], ["b"]), gain([[3.0]], ["b"], ["c"])).frozen([])[3]
    array([[2., 0.],
           [0., 3.]])
    """
    apart = [_renamed(s, f"block{k}") for k, s in enumerate(systems)]
    inputs, outputs = ([s for system in systems for s in getattr(system, side)] for side in ("inputs", "outputs"))
    for signals, what in ((inputs, "inputs"), (outputs, "outputs")):
        twice = sorted({s.name for s in signals if [t.name for t in signals].count(s.name) > 1})
        if twice:
            raise InputError(f"two of the {what} bear one name", got=", ".join(twice), mend="rename one")
    whole = connect(apart, [s.name for a in apart for s in a.inputs], [s.name for a in apart for s in a.outputs])
    return whole.replace(inputs=tuple(inputs), outputs=tuple(outputs))


def series(*systems: LPVStateSpace) -> LPVStateSpace:
    """One behind the other, first to last: outputs drive the next one's inputs in their order.

    Parameters
    ----------
    *systems : LPVStateSpace
        At least one; of one sample time, apart from gains.

    Returns
    -------
    LPVStateSpace
        Inputs of the first, outputs of the last.

    Raises
    ------
    InputError
        A system with another number of inputs than the one before has outputs.

    Examples
    --------
    >>> series(gain([[2.0]], ["a"], ["b"]), gain([[3.0]], ["x"], ["y"])).frozen([])[3]
    array([[6.]])
    """
    apart = [_renamed(s, f"block{k}") for k, s in enumerate(systems)]
    wires = {}
    for before, after in itertools.pairwise(apart):
        if len(before.outputs) != len(after.inputs):
            k = apart.index(after)
            raise InputError("systems in series do not fit", got=f"{len(before.outputs)} output(s) "
                             f"({listed_signals(systems[k - 1].outputs)}) for {len(after.inputs)} input(s) "
                             f"({listed_signals(systems[k].inputs)})")
        wires |= {i.name: {o.name: 1.0} for i, o in zip(after.inputs, before.outputs, strict=True)}
    whole = connect(apart, [s.name for s in apart[0].inputs], [s.name for s in apart[-1].outputs], wires)
    return whole.replace(inputs=systems[0].inputs, outputs=systems[-1].outputs)


def parallel(*systems: LPVStateSpace) -> LPVStateSpace:
    """Fed by the same inputs, outputs added, both in their order and under the names of the first.

    Parameters
    ----------
    *systems : LPVStateSpace
        At least one; of one sample time, apart from gains.

    Returns
    -------
    LPVStateSpace
        Inputs and outputs as the first has them.

    Raises
    ------
    InputError
        Systems with different numbers of inputs or of outputs.

    Examples
    --------
    >>> parallel(gain([[2.0]], ["a"], ["b"]), gain([[3.0]], ["x"], ["y"])).frozen([])[3]
    array([[5.]])
    """
    first = systems[0]
    for other in systems[1:]:
        if len(other.inputs) != len(first.inputs) or len(other.outputs) != len(first.outputs):
            raise InputError("systems in parallel have different numbers of signals",
                             got=f"{listed_signals(first.inputs)} -> {listed_signals(first.outputs)} and "
                                 f"{listed_signals(other.inputs)} -> {listed_signals(other.outputs)}")
    apart = [_renamed(s, f"block{k}") for k, s in enumerate(systems)]
    sources = [f"in{i}" for i in range(len(first.inputs))]
    wires = {s.name: {r: 1.0} for a in apart for s, r in zip(a.inputs, sources, strict=True)}
    sums = [f"out{i}" for i in range(len(first.outputs))]
    adder = gain(np.tile(np.eye(len(sums)), len(apart)), [f"to{k}{n}" for k in range(len(apart)) for n in sums], sums)
    wires |= {f"to{k}{n}": {s.name: 1.0} for k, a in enumerate(apart) for s, n in zip(a.outputs, sums, strict=True)}
    whole = connect([*apart, adder], sources, sums, wires)
    return whole.replace(inputs=first.inputs, outputs=first.outputs)


def _renamed(system: LPVStateSpace, prefix: str) -> LPVStateSpace:
    """Signals of its own, so that nothing joins by name."""
    return system.replace(inputs=tuple(Signal(f"{prefix}.in{i}", s.unit) for i, s in enumerate(system.inputs)),
                          outputs=tuple(Signal(f"{prefix}.out{i}", s.unit) for i, s in enumerate(system.outputs)))
