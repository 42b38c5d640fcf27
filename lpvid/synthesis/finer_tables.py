"""The finer tables behind systems from samples (`lpvid.synthesis.sampled_plants`), and behind their connections."""

from __future__ import annotations

from collections.abc import Sequence

from lpvid.model.state_space import LPVStateSpace


def joined(systems: Sequence[LPVStateSpace], finer: LPVStateSpace) -> dict:
    """``metadata["interpolation"]`` of what tables were joined to.

    Parameters
    ----------
    systems : sequence of LPVStateSpace
        The parts; at least one is a table.
    finer : LPVStateSpace
        What their finer tables were joined to.

    Returns
    -------
    dict
        Largest error of the parts, knots of all of them, and the finer table as a dict.
    """
    parts = [about for s in systems if (about := s.metadata.get("interpolation"))]
    return {"error": max(p["error"] for p in parts), "knots": {k: v for p in parts for k, v in p["knots"].items()},
            "finer": finer.to_dict()}


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
