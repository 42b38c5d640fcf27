"""Which channel plays which part of a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.simulation import Model

if TYPE_CHECKING:
    from lpvid.validation import Validation


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


def refuse_still(model: Model, found: Validation) -> None:
    """A measured output that never moves has no figures, and with them no report.

    Parameters
    ----------
    model : LPVTransferFunction, LPVStateSpace or SelfScheduled
    found : Validation
        Of that model.

    Raises
    ------
    InputError
        No free-run figure, though the run did not diverge.
    """
    free = found.overall.free_run
    if free.esr is None and free.diverged_at is None:
        raise _still([s.name for s in model.outputs], "these records")


def refuse_still_output(records: Sequence[Record], outputs: Sequence[str]) -> None:
    """Held-out records in which no output moves, before anything is fitted.

    Parameters
    ----------
    records : sequence of Record
        Held-out; none is well.
    outputs : sequence of str
        Channels or roles.

    Raises
    ------
    InputError
        Every output is constant in every record.
    """
    known = [(r, name) for r in records for name in outputs if r.has(name)]
    if known and all(_constant(r[name]) for r, name in known):
        raise _still(outputs, "the held-out records")


def _constant(values: np.ndarray) -> bool:
    finite = values[np.isfinite(values)]
    return finite.size > 0 and not np.ptp(finite) > 0


def _still(names: Sequence[str], where: str) -> InputError:
    listed = ", ".join(f"'{n}'" for n in names)
    return InputError(f"output {listed} never moves in {where}", why="no figure can be formed",
                      mend="check the sensor and the files; lpvid simulate runs a model without a measured output")


def damper_parts(record: Record, inputs: Sequence[str], outputs: Sequence[str], schedule: Sequence[str]) -> Record:
    """The record with the roles of a damper as --input, --output and --schedule name them.

    An input in m/s is the velocity, one in m the displacement; the output is the force, what schedules the current.

    Parameters
    ----------
    record : Record
        With the units of its channels.
    inputs, outputs, schedule : sequence of str
        Channels or roles, as written; empty where the option was left out. At most one output and one scheduling
        variable.

    Returns
    -------
    Record
        With the roles velocity, displacement, force and current as far as they are named.

    Raises
    ------
    InputError
        An input whose unit is neither m/s nor m, two inputs of one unit, more than one output or scheduling variable.
    """
    roles: dict[str, str] = {}
    for name in inputs:
        unit = record.unit(name)
        role = {"m/s": "velocity", "m": "displacement"}.get(unit)
        if role is None or role in roles:
            raise InputError(f"--input {name}: the motion of a damper is a velocity or a displacement",
                             got=f"{unit or 'no unit'} in record '{record.name}'",
                             mend="--role velocity=CHANNEL states which it is")
        roles[role] = record.resolve(name)
    for option, role, names in (("--output", "force", outputs), ("--schedule", "current", schedule)):
        if len(names) > 1:
            raise InputError(f"{option} takes one channel here", got=", ".join(names))
        if names:
            roles[role] = record.resolve(names[0])
    return record.with_roles(roles)
