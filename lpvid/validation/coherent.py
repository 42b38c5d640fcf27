"""What figures hold for where a model's inputs moved together in its training data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from lpvid.auditing.coherence import input_coherence
from lpvid.auditing.view import View
from lpvid.caveat import Caveat
from lpvid.record import Record


def independence_remark(model: Any, records: Sequence[Record], label: str) -> str | None:
    """Whether these records test each input, or again only their sum.

    Parameters
    ----------
    model : LPVTransferFunction, LPVStateSpace or SelfScheduled
        Its metadata state whether its inputs moved together in training (`lpvid.identification.separation`).
    records : sequence of Record
    label : str
        What these data are to the model, e.g. "held-out".

    Returns
    -------
    str or None
        None for a model whose inputs were independent in training, or records too short for it.
    """
    if "coherent_inputs" not in model.metadata:
        return None
    names = [s.name for s in model.inputs]
    coherence = input_coherence([View(r, ()) for r in records], names)
    if coherence is None:
        return None
    if coherence.separable:
        return f"the {label} inputs move independently: the {label} figures hold for each of them"
    share = 100 * float(1 - np.min(coherence.share))
    return Caveat(f"the {label} inputs move together as in training ({share:.4g} % explained by the others): the "
                  f"{label} figures do not hold for independent inputs")
