"""Which channel plays which part of a model."""

from __future__ import annotations

from collections.abc import Mapping

from lpvid.errors import InputError
from lpvid.simulation import Model


def parts(model: Model, given: Mapping[str, tuple[str, ...]]) -> dict[str, str]:
    """Roles from the model's own names to the channels given in its order.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
    given : mapping
        Channel names under "input", "output" and "schedule"; empty ones keep the model's names.

    Returns
    -------
    dict of str to str

    Raises
    ------
    InputError
        Another number of channels than the model has.
    """
    own = {"input": [s.name for s in model.inputs], "output": [s.name for s in model.outputs],
           "schedule": list(model.box.names)}
    roles: dict[str, str] = {}
    for part, channels in given.items():
        if channels and len(channels) != len(own[part]):
            raise InputError(f"--{part} names {len(channels)} channel(s), the model has {len(own[part])}",
                             got=", ".join(channels), mend=f"give them in the order {', '.join(own[part]) or 'none'}")
        roles |= {name: channel for name, channel in zip(own[part], channels, strict=False) if name != channel}
    return roles
