"""LPV and LTI systems joined by the names of their signals; the feedback of a controller around a plant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.signals import listed_signals, signal_names
from lpvid.model.state_space import LPVStateSpace, Matrices
from lpvid.scheduling import Scheduling
from lpvid.synthesis._wiring import Drive, Wiring, wire
from lpvid.synthesis.generalized_plant import GeneralizedPlant, PlantMatrices
from lpvid.synthesis.matrix_function import MatrixFunction, block


def close_loop(plant: GeneralizedPlant, controller: LPVStateSpace) -> LPVStateSpace:
    """The closed loop from disturbances w to performance signals z; exact, with every signal's name and unit kept.

    ::

        w ──>┌───────┐──> z          x = [x_plant; x_controller]
         u ─>│ plant │─┐ y
         │   └───────┘ │
         └─ controller <┘

    Where both bases are polynomials the loop's is one, of the degree that the products need; any other pair gives
    products of the two (`Product`). Box and rate bounds are the plant's.

    Parameters
    ----------
    plant : GeneralizedPlant
    controller : LPVStateSpace
        Its inputs are the plant's measurements, its outputs the plant's controls, in any order.

    Returns
    -------
    LPVStateSpace

    Raises
    ------
    InputError
        Signals that do not match, unequal clocks, or feedthroughs around the loop that vary with the scheduling.

    Examples
    --------
    >>> from lpvid.model.signals import Signal
    >>> from lpvid.scheduling import Polynomial
    >>> system = LPVStateSpace([[[0.0]], [[1.0]]], [[[1.0, 1.0]], [[0.0, 0.0]]], [[[1.0], [1.0]], [[0.0], [0.0]]],
    ...                        np.zeros((2, 2, 2)), Polynomial("p", 1), None, inputs=(Signal("road"), Signal("force")),
    ...                        outputs=(Signal("comfort"), Signal("speed")))
    >>> gain = LPVStateSpace(np.zeros((2, 0, 0)), np.zeros((2, 0, 1)), np.zeros((2, 1, 0)), [[[-3.0]], [[-1.0]]],
    ...                      Polynomial("p", 1), None, inputs=(Signal("speed"),), outputs=(Signal("force"),))
    >>> loop = close_loop(GeneralizedPlant(system, ["force"], ["speed"]), gain)
    >>> loop.frozen([0.5])[0], loop.outputs
    (array([[-3.]]), (Signal(name='comfort', unit=''),))
    """
    inputs, outputs = signal_names(controller.inputs), signal_names(controller.outputs)
    for have, want, what, of in ((inputs, plant.measurements, "inputs", "measurements"),
                                 (outputs, plant.controls, "outputs", "controls")):
        if set(have) != set(want):
            raise InputError(f"the {what} of the controller are not the {of} of the plant", got=", ".join(have),
                             why=f"the plant has {', '.join(want)}", mend="name the signals alike")
    return connect([plant.system, controller], plant.disturbances, plant.performance)


def connect(systems: Sequence[LPVStateSpace], inputs: Sequence[str], outputs: Sequence[str],
            wires: Mapping[str, Drive] | None = None) -> LPVStateSpace:
    """One system from several: signals of equal name are joined, and `wires` drive inputs with signed sums.

    ::

              ┌─ K (I − D K)⁻¹ C ─┐       u = K y + E r          x⁺ = (A + B K W C) x + B (E + K W D E) r
        r ─>E─(+)──> A, B, C, D ──┴─> F   y = C x + D u          y  = W (C x + D E r),   W = (I − D K)⁻¹

    Parameters
    ----------
    systems : sequence of LPVStateSpace
        All of one sampling period; blocks without states fit any.
    inputs : sequence of str
        Names of the inputs of the whole. One of a block's inputs that bears the name is driven by it.
    outputs : sequence of str
        Outputs of the whole: names of outputs of blocks or of inputs of the whole, which then pass through, or signed
        sums of both, as ``"r - y"`` or, with a name, ``"error = r - y"``.
    wires : mapping of str to str or to mapping, optional
        For an input of a block, what drives it: ``{"error": "reference - 2 speed"}``, or factors by name.

    Returns
    -------
    LPVStateSpace
        States in the order of the systems. A scheduling variable has the box and rate bound of the first system that
        reads it.

    Raises
    ------
    InputError
        An unknown or doubly produced signal, an input that nothing drives, unequal clocks, a loop of feedthroughs that
        vary with the scheduling or have no solution (the message names its signals).

    Examples
    --------
    >>> from lpvid.model.signals import Signal
    >>> from lpvid.scheduling import Polynomial
    >>> integrator = LPVStateSpace([[[0.0]]], [[[1.0]]], [[[1.0]]], [[[0.0]]], Polynomial(), None,
    ...                            inputs=(Signal("error"),), outputs=(Signal("speed"),))
    >>> connect([integrator], ["reference"], ["speed"], {"error": "reference - 2 speed"}).frozen([])[0]
    array([[-2.]])
    """
    blocks = [_plain(s) for s in systems]
    tables = [finer_of(s) for s in blocks]
    whole = _joined(blocks, inputs, outputs, wires)
    if not any(t is not None for t in tables):
        return whole
    finer = _joined([s if t is None else t for s, t in zip(blocks, tables, strict=True)], inputs, outputs, wires)
    return whole.replace(metadata={**whole.metadata, "interpolation": _tables_joined(blocks, finer)})


def _joined(blocks: list[LPVStateSpace], inputs: Sequence[str], outputs: Sequence[str],
            wires: Mapping[str, Drive] | None) -> LPVStateSpace:
    inputs, outputs = _checks.names(inputs, "the inputs"), _checks.names(outputs, "the outputs")
    w = wire(blocks, inputs, outputs, dict(wires or {}))
    a, b, c, d, f, g = (_diagonal(blocks, name) for name in ("A", "B", "C", "D", "state_offset", "output_offset"))
    solve = _loop_solution(d @ w.feedback, w.produced)
    inner = block([[solve @ c, solve @ (d @ w.entry), solve @ g]])
    dynamic = block([[a, b @ w.entry, f]]) + b @ (w.feedback @ inner)
    static = w.exit @ inner + np.hstack([np.zeros((len(outputs), a.shape[0])), w.passed, np.zeros((len(outputs), 1))])
    return _assembled(block([[dynamic], [static]]).trimmed(), blocks, w)


def close_loop_at(plant: PlantMatrices, a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray
                  ) -> Matrices:
    """The closed loop at N points of the scheduling, from the plant's blocks and the controller's matrices there.

    u = (I − D_K D22)⁻¹ (C_K x_K + D_K C2 x + D_K D21 w); every array starts with the axis of the points (or none does).

    Parameters
    ----------
    plant : PlantMatrices
        As `GeneralizedPlant.at` returns it.
    a, b, c, d : (N, …) arrays
        The controller's, with inputs in the order of the plant's measurements and outputs in that of its controls.

    Returns
    -------
    tuple of four (N, …) arrays
        A, B, C, D from w to z with states [x; x_K].

    Raises
    ------
    InputError
        I − D_K D22 is singular at a point.
    """
    loop = np.eye(d.shape[-2]) - d @ plant.D22
    weak = np.linalg.cond(loop) > 1e12
    if np.any(weak):
        raise InputError("the feedthroughs of plant and controller form a loop without a solution",
                         got=f"I − D_K D22 singular at {int(np.sum(weak))} point(s)",
                         mend="design the controller without feedthrough")
    f = np.linalg.inv(loop)
    ux, uk, uw = f @ d @ plant.C2, f @ c, f @ d @ plant.D21
    yx, yk, yw = plant.C2 + plant.D22 @ ux, plant.D22 @ uk, plant.D21 + plant.D22 @ uw
    whole_a = np.block([[plant.A + plant.B2 @ ux, plant.B2 @ uk], [b @ yx, a + b @ yk]])
    whole_b = np.block([[plant.B1 + plant.B2 @ uw], [b @ yw]])
    return whole_a, whole_b, np.block([[plant.C1 + plant.D12 @ ux, plant.D12 @ uk]]), plant.D11 + plant.D12 @ uw


def _plain(system: LPVStateSpace) -> LPVStateSpace:
    if not isinstance(system, LPVStateSpace):
        raise InputError("a block must be an LPVStateSpace", got=type(system).__name__,
                         mend="turn a python-control system into one with lpvid.synthesis.weights.from_lti")
    if system.input_stage is not None or system.scheduling_stage is not None:
        raise InputError(f"the block with output {listed_signals(system.outputs)} is not linear in its inputs",
                         got="an input or scheduling stage", mend="join its linear part: replace(input_stage=None, …)")
    return system


def _diagonal(systems: Sequence[LPVStateSpace], name: str) -> MatrixFunction:
    """The matrices of one name on the diagonal; offsets one below the other."""
    parts = []
    for system in systems:
        array = getattr(system, name)
        parts.append(MatrixFunction(system.basis, array[:, :, None] if array.ndim == 2 else array))
    if name.endswith("offset"):
        return block([[p] for p in parts])
    return block([[p if i == j else np.zeros((p.shape[0], q.shape[1])) for j, q in enumerate(parts)]
                  for i, p in enumerate(parts)])


def _loop_solution(loop: MatrixFunction, names: Sequence[str]) -> MatrixFunction:
    """(I − L)⁻¹: loops of constant feedthroughs are inverted, chains of varying ones multiplied out."""
    from scipy.sparse.csgraph import connected_components

    n = len(names)
    _, part = connected_components(loop.pattern, directed=True, connection="strong")
    inside = part[:, None] == part[None, :]
    closed = MatrixFunction(loop.basis, loop.coefficients * inside).still
    if closed is None:
        moving = MatrixFunction(loop.basis, loop.coefficients * inside)
        stuck = [i for i in range(n) if any(moving[[j], [i]].still is None or moving[[i], [j]].still is None
                                            for j in range(n))]
        ring = ", ".join(names[i] for i in range(n) if part[i] in part[stuck])
        raise InputError(f"a loop of feedthroughs varies with {', '.join(loop.basis.names)}", got=f"the signals {ring}",
                         why="its solution is no finite sum over the basis",
                         mend="put a state into the loop (a lag, or a controller without feedthrough), or close it "
                              "point by point with close_loop_at")
    gap = np.eye(n) - closed
    if np.linalg.cond(gap) > 1e12:
        ring = ", ".join(names[i] for i in range(n) if np.count_nonzero(part == part[i]) > 1 or closed[i, i])
        raise InputError("a loop of feedthroughs has no solution", got=f"the signals {ring}",
                         mend="change a gain of the loop")
    inverse = np.linalg.inv(gap)
    chain = inverse @ MatrixFunction(loop.basis, loop.coefficients * ~inside)
    total = term = MatrixFunction.constant(inverse)
    for _ in range(n):
        term = chain @ term
        if not term.coefficients.any():
            break
        total = total + term
    return total


def _assembled(matrices: MatrixFunction, systems: Sequence[LPVStateSpace], w: Wiring) -> LPVStateSpace:
    n, x = sum(s.order for s in systems), matrices.coefficients
    return LPVStateSpace.of(x[:, :, :-1], n, matrices.basis, _clock(systems), _box(matrices.basis.names, systems),
                            state_offset=x[:, :n, -1], output_offset=x[:, n:, -1], inputs=w.inputs, outputs=w.outputs)


def _clock(systems: Sequence[LPVStateSpace]) -> float | None:
    """The sampling period that all blocks with states share."""
    moving = [s for s in systems if s.order] or list(systems[:1])
    for s in moving[1:]:
        if s.sample_time != moving[0].sample_time:
            clocks = " and ".join("continuous time" if t is None else f"{t:.6g} s"
                                  for t in (moving[0].sample_time, s.sample_time))
            raise InputError(f"the blocks with outputs {listed_signals(moving[0].outputs)} and "
                             f"{listed_signals(s.outputs)} have different sampling periods", got=clocks,
                             mend="convert one with lpvid.synthesis.discretising")
    return moving[0].sample_time


def _box(names: Sequence[str], systems: Sequence[LPVStateSpace]) -> Scheduling:
    """Every variable as the first system that names it describes it."""
    rows = []
    for name in names:
        box = next(s.box for s in systems if name in s.box.names)
        i = box.names.index(name)
        rows.append((name, box.lower[i], box.upper[i], box.rate[i], box.units[i]))
    return Scheduling(*(tuple(column) for column in zip(*rows, strict=True))) if rows else Scheduling((), (), ())


def finer_of(system: LPVStateSpace) -> LPVStateSpace | None:
    """The finer table behind a block, with the names that its signals have now; None where it has none.

    Parameters
    ----------
    system : LPVStateSpace
        A table, or a connection of some.

    Returns
    -------
    LPVStateSpace or None
        None also where the number of signals has changed since.
    """
    about = system.metadata.get("interpolation") or {}
    if "finer" not in about:
        return None
    finer = LPVStateSpace.from_dict(about["finer"])
    if len(finer.inputs) != len(system.inputs) or len(finer.outputs) != len(system.outputs):
        return None  # not the system that the table was taken for
    return finer.replace(inputs=system.inputs, outputs=system.outputs)


def _tables_joined(systems: Sequence[LPVStateSpace], finer: LPVStateSpace) -> dict:
    """``metadata["interpolation"]`` of what tables were joined to, of which at least one is a table."""
    parts = [about for s in systems if (about := s.metadata.get("interpolation"))]
    return {"error": max(p["error"] for p in parts), "knots": {k: v for p in parts for k, v in p["knots"].items()},
            "finer": finer.to_dict()}
