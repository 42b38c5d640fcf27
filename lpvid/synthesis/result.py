"""Synthesis: what every controller design returns, whether it succeeded or not."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from lpvid import _checks
from lpvid._shown import Shown
from lpvid.codec import ADDED, Coded
from lpvid.errors import InputError, NumericalError
from lpvid.lmi.gain_certificate import GainCertificate
from lpvid.lmi.hull_certificate import HullCertificate
from lpvid.model.designed import designed
from lpvid.model.signals import listed_signals
from lpvid.model.state_space import LPVStateSpace

if TYPE_CHECKING:
    import control
    import numpy as np

VERDICTS = ("solved", "backed-off", "infeasible", "unstabilisable", "undetectable", "numerical")
"""Outcomes: "backed-off" is a controller whose promise had to be relaxed by more than the design allowed at first;
the last four come without a controller."""
_CERTIFICATES = {
    "lpvid/gain-certificate/1": ("lpvid.lmi.gain_certificate", "GainCertificate"),
    "lpvid/hull-certificate/1": ("lpvid.lmi.hull_certificate", "HullCertificate"),
    "lpvid/rated-gain-certificate/1": ("lpvid.analysis.rated_certificate", "RatedGainCertificate"),
    "lpvid/robust-certificate/1": ("lpvid.analysis.robust_certificate", "RobustCertificate"),
    "lpvid/stability-certificate/1": ("lpvid.analysis.stability_certificate", "StabilityCertificate"),
}
"""Module and class of a stored certificate, by its schema."""


@dataclass(frozen=True, eq=False)
class Synthesis(Coded, Shown):
    """A controller with the verified figures of its closed loop, or why there is none.

    Parameters
    ----------
    verdict : str
        One of `VERDICTS`.
    gamma : float or None
        Bound of the induced gain w → z that the matrix inequalities promised.
    gamma_verified : float or None
        Bound re-checked with numpy for the closed loop with `controller` exactly as returned; the number to quote.
    gamma_lower : float or None
        Gain that the closed loop has at some frozen scheduling or on some trajectory: no bound can be smaller.
    controller : LPVStateSpace or None
        Its inputs are the plant's measurements, its outputs the plant's controls.
    closed_loop : LPVStateSpace or None
        w → z.
    certificate : object or None
        What `lpvid.verify` re-checks against `closed_loop`.
    between_grid : bool
        `gamma_verified` is proven on the whole scheduling box (or the hull of the design), not only at the points of a
        grid.
    why, mend : str
        What decided the verdict, and what the user can do about it, in physical words.
    notes : tuple of str
        Remarks: rank-deficient feedthroughs, conditioning, scalings.
    seconds : float
        Wall time.
    solver : str
        Who proposed the matrices.
    method : str
        The design in a few words.
    infimum : float or None
        Least bound that any route found admitted, as the solver has it: approached, not promised.
    figures : tuple of mapping
        For each criterion of a design with several: ``criterion`` ("H-infinity" or "H2"), ``channel``, ``promised``,
        ``verified`` (with the controller as returned), ``lower`` and ``between_grid``.

    Examples
    --------
    >>> result = Synthesis("infeasible", why="no controller bounds the gain", mend="lower the weight on comfort")
    >>> result.solved
    False
    >>> print(result)
    infeasible: no controller bounds the gain
      mend: lower the weight on comfort
    """

    BESIDE = ("schema", "lpvid_version", "plant", "design", "limits")  # in the synthesis.json of a command
    JSON = ("verdict", "gamma", "gamma_verified", "gamma_lower", "infimum", "between_grid", "why", "mend", "notes",
            "seconds", "solver", "method", "h2_verified", "figures", "controller", "closed_loop", "certificate")

    verdict: str
    gamma: float | None = None
    gamma_verified: float | None = None
    gamma_lower: float | None = None
    controller: LPVStateSpace | None = None
    closed_loop: LPVStateSpace | None = None
    certificate: Any = field(default=None, metadata={"read": lambda data, _: _certificate(data)})
    between_grid: bool = False
    why: str = ""
    mend: str = ""
    notes: tuple[str, ...] = ()
    seconds: float = 0.0
    solver: str = ""
    method: str = ""
    infimum: float | None = field(default=None, metadata=ADDED)
    figures: tuple[Mapping[str, Any], ...] = field(default=(), metadata=ADDED)

    def __post_init__(self) -> None:
        _checks.one_of(self.verdict, VERDICTS, "the verdict of a synthesis")
        object.__setattr__(self, "notes", tuple(self.notes))
        object.__setattr__(self, "figures", tuple(dict(f) for f in self.figures))
        for name, role in (("controller", "controller"), ("closed_loop", "closed loop")):
            part = getattr(self, name)
            object.__setattr__(self, name, None if part is None else designed(part, role))
        if self.solved != (self.controller is not None):
            raise InputError("a synthesis has a controller exactly if it succeeded", got=self.verdict)

    @property
    def solved(self) -> bool:
        """There is a controller."""
        return self.verdict in ("solved", "backed-off")

    @property
    def h2_verified(self) -> float | None:
        """The verified H2 norm of the first H2 criterion; None where there is none."""
        return next((f["verified"] for f in self.figures if f["criterion"] == "H2"), None)

    @property
    def region(self) -> str:
        """The scheduling set of the design: "box" or "polytope"."""
        moving = isinstance(self.certificate, GainCertificate) and self.certificate.vertices is not None
        return "polytope" if moving or isinstance(self.certificate, HullCertificate) else "box"

    def required(self) -> LPVStateSpace:
        """The controller.

        Returns
        -------
        LPVStateSpace
            From the plant's measurements to its controls.

        Raises
        ------
        NumericalError
            There is none; the message is `why` and `mend`.
        """
        if self.controller is None:
            raise NumericalError(f"{self.verdict}: {self.why}. Mend: {self.mend}.")
        return self.controller

    def to_control(self, at: Sequence[float] | np.ndarray) -> control.StateSpace:
        """The controller with its scheduling frozen, as a python-control `StateSpace`.

        Parameters
        ----------
        at : (n_scheduling,) array
            Scheduling, SI. The varying controller: `lpvid.to_control`.

        Returns
        -------
        control.StateSpace

        Raises
        ------
        InputError
            There is no controller.
        """
        return self.required().to_control(at)

    def __repr__(self) -> str:
        lines = [f"{self.verdict}: {self.why or self.method}"]
        if self.gamma_verified is not None and self.closed_loop is not None:
            where = f"on the whole {self.region}" if self.between_grid else "at the points of a grid only"
            lower = "" if self.gamma_lower is None else f", at least {self.gamma_lower:.6g}"
            loop = self.closed_loop
            lines.append(f"  gain from {listed_signals(loop.inputs)} to {listed_signals(loop.outputs)}: at most "
                         f"{self.gamma_verified:.6g}{lower}, verified {where}")
        if self.gamma is not None:
            lines.append(f"  the matrix inequalities promised {self.gamma:.6g} ({self.solver}, {self.seconds:.2g} s)")
        if self.controller is not None:
            names = f"{listed_signals(self.controller.inputs)} -> {listed_signals(self.controller.outputs)}"
            lines.append(f"  controller {names}, {self.controller.order} states")
        if self.mend:
            lines.append(f"  mend: {self.mend}")
        return "\n".join(lines + [f"  note: {note}" for note in self.notes[: max(0, 10 - len(lines))]])


def _certificate(data: Mapping | None) -> Any:
    if data is None:
        return None
    if data.get("schema") not in _CERTIFICATES:
        raise InputError("a synthesis holds an unknown certificate", got=data.get("schema"))
    module, name = _CERTIFICATES[data["schema"]]
    return getattr(importlib.import_module(module), name).from_dict(data)
