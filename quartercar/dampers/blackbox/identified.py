"""Identified: what `lpvid identify` wrote, from motion and at most one command to one force, as a damper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

from lpvid.errors import InputError
from lpvid.export.renaming import renamed
from lpvid.model.compliance import ComplianceModel
from lpvid.model.quasi import QuasiLPVModel
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from quartercar.dampers.blackbox.sampled import SampledDamper
from quartercar.dampers.drive import UNITS
from quartercar.dampers.facts import Facts

if TYPE_CHECKING:
    from lpvid.identification import Identification

KINDS = (LPVTransferFunction, LPVStateSpace, QuasiLPVModel, ComplianceModel)
MOTIONS = ("velocity", "displacement")
COMMANDS = ("A", "V", "")
"""units of what can schedule a damper: current, voltage, duty"""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Identified(SampledDamper):
    """A model that `lpvid identify` found, as a damper: F from velocity or displacement and at most one command.

    Its signals are named by their roles and they have the damper's own sign: tension positive, zero displacement
    where the car rests. What the file held comes back along records (`to_model`).
    """

    name: ClassVar[str] = "identified"
    title: ClassVar[str] = "Identified LPV model"
    source: ClassVar[str] = "lpvid identify"

    def check_orders(self) -> None:
        if self.stored is None:
            raise InputError("an identified damper is made from a model", mend="quartercar.dampers.load_damper(path)")

    @property
    def past(self) -> int:
        return self.held.model.start

    @property
    def wanted(self) -> tuple[str, ...]:
        return self.reads

    @classmethod
    def suited(cls, facts: Facts) -> Identified:
        raise InputError("a model of lpvid is identified by lpvid", mend="lpvid identify, or --models lpv-arx")

    def identified(self, records: Sequence[Record]) -> tuple[Self, Identification, tuple[str, ...]]:
        raise InputError("a model of lpvid is identified by lpvid", mend="lpvid identify, or --models lpv-arx")

    def to_lpv(self, sample_time: float) -> Any:
        """The LPV model inside: of one that schedules itself on its trial or output, the one whose ρ moves freely."""
        model = self.at_clock(sample_time)
        if isinstance(model, QuasiLPVModel):
            return model.embedding()
        if isinstance(model, ComplianceModel):
            raise InputError("no LPV form of a compliance model of free scheduling",
                             why="its several implicit steps per sample are rational in 1/(F'(w) + k_h h)",
                             mend="to_model gives the quasi-LPV model, which is stable for every course of its force")
        return model

    @classmethod
    def of(cls, model: Any, label: str = "this model") -> Identified:
        """The damper that a model of lpvid is.

        Parameters
        ----------
        model : LPVTransferFunction, LPVStateSpace, QuasiLPVModel or ComplianceModel
            Discrete-time; from velocity and/or displacement, scheduled by at most one command, to one force.
        label : str
            What to call it in a refusal.

        Returns
        -------
        Identified
            In the damper's own sense, current range and unit from the model's box.

        Raises
        ------
        InputError
            What keeps it from being a damper.
        """
        from quartercar.dampers.blackbox.held import Held, layout_of
        from quartercar.dampers.moved import moved

        named = _with_roles(model, label)
        training = model.metadata.get("training", {})
        own = {old: new for new, old in named.items()}
        ranges = {own[n]: list(map(float, r)) for n, r in training.get("ranges", {}).items() if n in own}
        usual = {own[n]: list(map(float, r)) for n, r in training.get("usual", {}).items() if n in own}
        polarity = -1 if model.metadata.get("polarity") == "reversed" else 1
        centre = _rest_position(ranges.get("displacement")) if "displacement" in named else 0.0
        inner = moved(renamed(model, own), polarity, centre)
        box = model.box
        kept = {k: v for k, v in training.items() if k not in ("ranges", "usual")}
        metadata = {"training": {**kept, "sample_time": model.sample_time, "ranges": ranges,
                                 **({"usual_currents": usual["current"]} if "current" in usual else {})},
                    "roles": {**model.metadata.get("roles", {}), **_channels(model, named)},
                    **({"reading": model.metadata["reading"]} if "reading" in model.metadata else {}),
                    "model": type(model).__name__}
        held = Held(inner, layout_of(inner))
        return cls(stored=held.to_dict(), metadata=metadata, polarity=polarity, centre=centre,
                   current_range=(box.lower[0], box.upper[0]) if box.names else None,
                   current_unit=(box.units[0] or "1") if box.names else "A")


def _rest_position(span: Sequence[float] | None) -> float:
    """Displacement of the records at which the car rests: 0 where they cross it, else their middle (as `Facts`)."""
    if span is None or span[0] < 0 < span[1]:
        return 0.0
    return 0.5 * (span[0] + span[1])


# -- which signal is what --------------------------------------------------------------------------------------------
def _with_roles(model: Any, label: str) -> dict[str, str]:
    """Role to the model's own name; InputError where the model is no damper."""
    if not isinstance(model, KINDS):
        raise InputError(f"{label} holds no damper", got=type(model).__name__,
                         mend="a file that `quartercar fit` or `lpvid identify` wrote")
    if model.sample_time is None:
        raise InputError(f"{label} is continuous in time", why="a car steps an identified damper from sample to sample",
                         mend="identify a discrete model, or discretise it")
    if len(model.outputs) != 1:
        raise InputError(f"{label} has {len(model.outputs)} outputs",
                         got=", ".join(map(str, model.outputs)), why="a damper gives one force",
                         mend="identify again with --output force alone")
    named: dict[str, str] = {}
    stated = model.metadata.get("roles", {})
    for signal in model.inputs:
        role = _motion(signal.name, signal.unit, stated, label)
        if role in named:
            raise InputError(f"{label} has two inputs for the {role}", got=f"{named[role]}, {signal.name}",
                             mend="identify again with one of them as --input")
        named[role] = signal.name
    if not any(m in named for m in MOTIONS):
        raise InputError(f"{label} has no velocity and no displacement among its inputs",
                         got=", ".join(map(str, model.inputs)) or "no inputs",
                         mend="identify again with --input velocity")
    _add_command(model, named, label)
    out = model.outputs[0]
    if out.unit not in ("N", "") or (not out.unit and _role(out.name, stated) != "force"):
        raise InputError(f"{label} gives no force", got=f"'{out.name}' in {out.unit or 'no unit'}",
                         why="a damper's output is in N", mend="identify again with the force as --output, its unit in "
                         "the header")
    named["force"] = out.name
    return named


def _role(name: str, stated: Mapping[str, str]) -> str | None:
    """The role under which a damper reads a signal: its own name, or the role that was given to its channel."""
    known = ("velocity", "displacement", "current", "force")
    if name in known:
        return name
    channel = stated.get(name, name)
    return next((r for r in known if stated.get(r) == channel), None)


def _motion(name: str, unit: str, stated: Mapping[str, str], label: str) -> str:
    role = _role(name, stated) or {"m/s": "velocity", "m": "displacement"}.get(unit)
    if role not in MOTIONS:
        raise InputError(f"{label} reads '{name}' [{unit or '1'}]",
                         why="a car moves a damper by its velocity and displacement alone",
                         mend="identify again with --input velocity")
    if unit not in (UNITS[role], ""):
        raise InputError(f"{label}: its input '{name}', the {role}, is in {unit}", why=f"{UNITS[role]} expected",
                         mend="correct the unit in the header of the records, and identify again")
    return role


def _add_command(model: Any, named: dict[str, str], label: str) -> None:
    names, units = model.box.names, model.box.units
    if len(names) > 1:
        raise InputError(f"{label} is scheduled by {len(names)} variables", got=", ".join(names),
                         why="a car commands one current", mend="identify again with one --schedule")
    if not names:
        return
    if _role(names[0], model.metadata.get("roles", {})) != "current" and units[0] not in COMMANDS:
        raise InputError(f"{label} is scheduled by '{names[0]}' [{units[0]}]",
                         why="a car commands a current, a voltage or a duty",
                         mend="identify again with --schedule current, or --role current=CHANNEL")
    if names[0] in named.values():
        raise InputError(f"{label} is scheduled by its own input", got=names[0],
                         mend="identify again with --schedule current, or without --schedule")
    named["current"] = names[0]


def _channels(model: Any, named: Mapping[str, str]) -> dict[str, str]:
    """Role to channel of the files, as the training records had them."""
    stated = model.metadata.get("roles", {})
    return {role: stated.get(name, name) for role, name in named.items()}
