"""Which channel plays which part of a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

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
        names = ", ".join(f"'{s.name}'" for s in model.outputs)
        raise InputError(f"output {names} never moves in these records", why="no figure can be formed",
                         mend="check the sensor and the files; lpvid simulate runs a model without a measured output")


def damper_parts(record: Record, inputs: Sequence[str], outputs: Sequence[str], schedule: Sequence[str]) -> Record:
    """The record with the roles of a damper as --input, --output and --schedule name them.

    An input in m/s is the velocity, one in m the displacement; the output is the force, what schedules the current.
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
