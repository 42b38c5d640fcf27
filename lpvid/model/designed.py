"""Controllers and closed loops that were designed for a scheduling box: what was shown of them holds inside it only."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from lpvid.errors import ExtrapolationWarning
from lpvid.model.state_space import LPVStateSpace

KEY = "designed"
"""Entry of a model's metadata that states what it was designed as."""


def designed(model: LPVStateSpace, role: str) -> LPVStateSpace:
    """The same model, marked as designed: a "controller" or a "closed loop".

    Parameters
    ----------
    model : LPVStateSpace
        Any.
    role : {"controller", "closed loop"}
        Kept in the metadata; a role that is known already stays.

    Returns
    -------
    LPVStateSpace
    """
    return model if role_of(model) else model.replace(metadata={**model.metadata, KEY: role})


def role_of(model: Any) -> str:
    """What a model was designed as; empty for one that was identified or written down.

    Parameters
    ----------
    model : model
        Any; one without metadata counts as not designed.

    Returns
    -------
    str
    """
    return str(getattr(model, "metadata", {}).get(KEY, ""))


def warn_outside(model: Any, p: np.ndarray, record: str) -> None:
    """State which scheduling variables leave the box that a model was designed for, how far, and for how long.

    Warns
    -----
    ExtrapolationWarning
        A designed model along (n, variables) scheduling outside its box.

    Parameters
    ----------
    model : model
        Any; nothing is stated of one that was not designed.
    p : (n, n_scheduling) array
        Along the record, in the units of the box.
    record : str
        Name of the record, for the message.
    """
    role, box = role_of(model), model.box
    if not role or not len(p):
        return
    described = []
    for i, name in enumerate(box.names):
        low, high, unit = box.lower[i], box.upper[i], box.units[i]
        slack = 1e-9 * (1 + high - low)
        share = float(np.mean((p[:, i] < low - slack) | (p[:, i] > high + slack)))
        if share:
            tail = f" {unit}" if unit else ""
            described.append(
                f"'{name}' runs from {p[:, i].min():.4g} to {p[:, i].max():.4g}{tail} and lies outside its "
                f"{low:.4g} to {high:.4g}{tail} at {100 * share:.3g} % of the samples"
            )
    if described:
        warnings.warn(
            f"the {role} was designed for a scheduling box that record '{record}' leaves: "
            f"{'; '.join(described)}. There, no bound and no stability was shown. Mend: hold the scheduling at "
            "the ends of its range, or design for a wider one",
            ExtrapolationWarning,
            stacklevel=3,
        )
