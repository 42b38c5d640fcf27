"""Control laws of semi-active dampers, one per file behind one contract, and the way from demand to coil current."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import lazy_loader

from lpvid.named_classes import NamedClasses

if TYPE_CHECKING:
    from quartercar.controllers.contract import Controller

C = TypeVar("C")

LAWS: tuple[tuple[str, str, str], ...] = (
    ("passive", "quartercar.controllers.laws.passive", "Passive"),
    ("skyhook", "quartercar.controllers.laws.skyhook", "Skyhook"),
    ("skyhook-linear", "quartercar.controllers.laws.skyhook_linear", "LinearSkyhook"),
    ("groundhook", "quartercar.controllers.laws.groundhook", "Groundhook"),
    ("hybrid", "quartercar.controllers.laws.hybrid", "Hybrid"),
    ("add", "quartercar.controllers.laws.add", "AccelerationDriven"),
    ("sh-add", "quartercar.controllers.laws.sh_add", "SkyhookAccelerationDriven"),
    ("sh-add-1s", "quartercar.controllers.laws.sh_add_one_sensor", "SkyhookAccelerationDrivenOneSensor"),
    ("pdd", "quartercar.controllers.laws.pdd", "PowerDriven"),
    ("clipped-optimal", "quartercar.controllers.laws.clipped_optimal", "ClippedOptimal"),
    ("preview-lqr", "quartercar.controllers.laws.preview_lqr", "PreviewQuadratic"),
    ("preview-lpv", "quartercar.controllers.laws.preview_lpv", "PreviewStorage"),
    ("mpc", "quartercar.controllers.laws.mpc", "Predictive"),
    ("lpv-hinf-clipped", "quartercar.controllers.designed.lpv_hinf_clipped", "LpvHinfClipped"),
    ("lpv-hinf", "quartercar.controllers.designed.lpv_hinf", "LpvHinf"),
    ("lpv-hinf-identified", "quartercar.controllers.designed.lpv_hinf_identified", "LpvHinfIdentified"),
    ("scheduled", "quartercar.controllers.designed.scheduled", "ScheduledController"),
    ("identified-plant", "quartercar.controllers.designed.lpv_hinf_identified", "IdentifiedController"),
)
"""Every law by its name on the command line: name, module, class. A new law adds its line here."""

_EXPORTS = {
    "contract": ("Controller", "Law", "Setting"),
    "designed.schedule_rules": ("Excess", "GivenShare", "Measured", "Rule", "SaturationRatio", "Yield"),
    **{module.removeprefix(f"{__name__}."): (cls,) for _, module, cls in LAWS},
}

CONTROLLERS = NamedClasses("control law", "quartercar.controllers", LAWS, "quartercar.controllers.contract:Controller")
"""`LAWS`, those of other packages (entry-point group ``quartercar.controllers``), and those that `register` adds."""

__getattr__: Callable[[str], Any]
__getattr__, __dir__, _exported = lazy_loader.attach(__name__, submod_attrs=_EXPORTS)
__all__ = ["CONTROLLERS", "LAWS", "law_class", "law_names", "register", *_exported]  # pyright: ignore


def law_class(name: str) -> type[Controller]:
    """The class behind a name of `CONTROLLERS`.

    Parameters
    ----------
    name : str
        Name on the command line, as in `law_names`.

    Returns
    -------
    type
        Class derived from `Controller`; its parameters still take their defaults.

    Raises
    ------
    InputError
        A name that no law has, with the nearest known one; an entry point that does not load.

    Examples
    --------
    >>> law_class("sh-add").title
    'SH-ADD'
    """
    return CONTROLLERS.get(name)


def law_names() -> tuple[str, ...]:
    """Names of every law that is known, the package's own first.

    Returns
    -------
    tuple of str
        In the order of `LAWS`, then those of other packages, then those that `register` added.
    """
    return CONTROLLERS.names


def register(cls: type[C]) -> type[C]:
    """Make a control law of the running program known by its name; serves as a decorator.

    It is then ridden, tuned, saved and loaded like the package's own. An installed package names its laws in the
    entry-point group ``quartercar.controllers`` instead.

    Parameters
    ----------
    cls : type
        A class derived from `Controller` that writes every abstract method; see docs/extending.md.

    Returns
    -------
    type
        `cls` itself.

    Raises
    ------
    InputError
        Methods that it lacks, or a name that is taken.
    """
    return CONTROLLERS.register(cls)
