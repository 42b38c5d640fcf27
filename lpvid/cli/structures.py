"""From `identify`'s words to a structure: which options each structure takes, and what they make of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, fields
from typing import TYPE_CHECKING, Any

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.identification.structure import STRUCTURES

if TYPE_CHECKING:
    from lpvid.identification.arx import ARX
    from lpvid.identification.structure import Structure
    from lpvid.scheduling import Basis

FUNCTIONS = ("degree", "basis", "segments")
ORDERS = ("na", "nb", "nk", *FUNCTIONS, "no-constant", "affine", "affine-terms", "lagged")
STAGES = ("shape", "schedule-filter", "schedule-lag")
STATES = ("order", "nk", *FUNCTIONS, "no-constant", "affine")
TAKES: Mapping[str, tuple[str, ...]] = {
    "arx": (*ORDERS, *STAGES, "ridge", "passive", "balanced"),
    "oe": (*ORDERS, *STAGES, "passive", "balanced"),
    "bj": (*ORDERS, *STAGES, "nc", "nd"),
    "armax": (*ORDERS, *STAGES, "nc"),
    "riv": (*ORDERS, *STAGES, "nc", "nd"),
    "subspace": (*STATES, "past"),
    "pem-ss": (*STATES, "innovation"),
    "coprime": ("na", "nb", "nk", *FUNCTIONS, "no-constant", "affine", "affine-terms", *STAGES),
    "quasi": ("na", "nb", "nk", *FUNCTIONS, "schedule-filter", "schedule-lag", "on", "trial", "odd"),
    "compliance": ("segments", "states", "side", "schedule-filter", "schedule-lag"),
    "recursive": (*ORDERS, "forgetting"),
}
"""Options of every structure, in the order in which they are listed to the user."""
FIELDS: Mapping[str, tuple[str, ...]] = {
    **{n: (n,) for n in ("na", "nb", "nk", "nc", "nd", "order", "past", "forgetting", "ridge", "lagged")},
    "basis": FUNCTIONS, "affine": ("no-constant", "affine", "affine-terms"), "stage": ("shape",),
    "schedule_filter": ("schedule-filter", "schedule-lag")}
"""Options of a structure that another package names, by the fields that it has."""
WITHOUT_FORMS = ("subspace", "pem-ss", "coprime", "quasi", "compliance")
"""Structures whose model is no transfer function."""
BUDGET = 300.0
"""time for the search of --auto [s]: the measured quarter car (15,000 samples, two inputs) took 217 s, busy."""
LAGS = 4
"""Output and input lags where none are requested."""


@dataclass(frozen=True)
class Request:
    """The model that the command line asks for.

    Parameters
    ----------
    input, output, schedule : tuple of str
    structure : str
        One of `TAKES`, or of `lpvid.identification.structure.STRUCTURES`.
    given : mapping
        Options that were written, by their name without dashes; others have the structure's own default.
    sample_rate : float or None
    automatic : bool
        Whether the structure is to be chosen from the data.
    form : str or None
        State-space form to write as well.
    refit : bool
        Whether the model is fitted to all data again once its held-out figures are known.
    refit_form : bool
        Whether the state-space form is re-estimated in its own entries.
    budget : float or None
        Processor time of the choice of the structure [s], if another than `BUDGET`.
    begun : float or None
        Processor time of the process at which the command began [s], from which the budget counts.
    """

    input: tuple[str, ...]
    output: tuple[str, ...]
    schedule: tuple[str, ...]
    structure: str
    given: Mapping[str, Any]
    sample_rate: float | None
    automatic: bool = False
    form: str | None = None
    refit: bool = False
    refit_form: bool = False
    budget: float | None = None
    begun: float | None = None

    def check(self) -> None:
        """Refuse what does not go together, before any data are read.

        Raises
        ------
        InputError
            An unknown structure, an option that it does not take, or options that exclude each other.
        """
        if self.structure not in TAKES:
            _checks.one_of(self.structure, (*TAKES, *STRUCTURES.names), "--structure")
        if self.refit_form:
            self._check_refit_form()
        if self.budget is not None and not self.automatic:
            raise InputError("--budget bounds the search of --auto", mend="add --auto, or leave it out")
        if self.automatic:
            wanted = [f"--{n}" for n in self.given] + (["--structure"] if self.structure != "arx" else [])
            if wanted:
                raise InputError("--auto chooses the structure by itself", got=", ".join(wanted),
                                 mend="leave these options out, or leave --auto out")
            return
        taken = self.takes
        for name in self.given:
            if name not in taken:
                raise InputError(f"--{name} does not apply to --structure {self.structure}",
                                 mend=f"it takes {', '.join(f'--{n}' for n in taken)}")
        if self.form is not None and self.structure in WITHOUT_FORMS:
            raise InputError(f"--form does not apply to --structure {self.structure}",
                             why="only a transfer function has state-space forms to choose from")
        if "balanced" in self.given and "passive" not in self.given:
            raise InputError("--balanced weighs the records of a passive model", mend="add --passive, or leave it out")
        more = [f"--{n}" for n in ("affine", "affine-terms") if n in self.given]
        if more and "no-constant" in self.given:
            raise InputError(f"{' and '.join(more)} and --no-constant exclude each other",
                             why="the first affine term is the constant c_0(p)", mend="leave one of them out")
        if "trial" in self.given and self.given.get("on", "trial") != "trial":
            raise InputError("--trial needs --on trial", got=f"--on {self.given['on']}")
        self.build(self.delay)

    def _check_refit_form(self) -> None:
        from lpvid.identification.form_layout import FREE

        if self.form not in FREE:
            raise InputError("--refit-form needs a form that is not exact", got=f"--form {self.form}" if self.form else
                             "no --form", why="the others equal the transfer function",
                             mend=f"add {' or '.join(f'--form {n}' for n in FREE)}, or fit the transfer function by "
                                  "simulation error with --structure oe")

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels and roles that the model reads and simulates, each once."""
        return tuple(dict.fromkeys((*self.input, *self.output, *self.schedule)))

    @property
    def takes(self) -> tuple[str, ...]:
        """Options of the structure."""
        if self.structure in TAKES:
            return TAKES[self.structure]
        own = {f.name for f in fields(STRUCTURES.get(self.structure))}
        return tuple(option for name, options in FIELDS.items() if name in own for option in options)

    # -- what was requested -------------------------------------------------------------------------------------
    @property
    def delay(self) -> int | tuple[int, ...] | None:
        """First input lags that were requested; 0 for a passive model, which has a direct term."""
        return self.given.get("nk", 0 if "passive" in self.given else None)

    @property
    def searches_delay(self) -> bool:
        """Whether the first input lag is to be chosen from the data."""
        return self.delay is None and self.structure not in ("quasi", "compliance")

    @property
    def filter(self) -> str | None:
        """Name of the scheduling filter."""
        named = self.given.get("schedule-filter")
        return named if named is not None else "rise-fall" if "schedule-lag" in self.given else None

    @property
    def affine(self) -> int:
        """Number of affine terms: a constant unless it was declined."""
        if "affine-terms" in self.given:
            return self.given["affine-terms"]
        if "affine" not in self.given:
            return 0 if "no-constant" in self.given else 1
        return 1 if self.structure == "coprime" or "passive" in self.given else self.given.get("na", LAGS) + 1

    def basis(self) -> Basis:
        """The basis in the scheduling variables.

        Returns
        -------
        Basis
            Polynomial of the requested degree in all variables, or the product of one spline in each; a constant
            without scheduling.
        """
        from lpvid.scheduling import Polynomial, Product, Spline

        degree, segments = self.given.get("degree", 1), self.given.get("segments", 3)
        if self.given.get("basis", "polynomial") == "polynomial" or not self.schedule:
            return Polynomial(self.schedule, degree=degree)
        basis: Basis = Spline(self.schedule[0], segments=segments, order=max(degree, 1))
        for name in self.schedule[1:]:
            basis = Product(basis, Spline(name, segments=segments, order=max(degree, 1)))
        return basis

    def arx(self, delay: int | tuple[int, ...] | None = None) -> ARX:
        """The equation-error structure of the same orders (or of the defaults, where there are none).

        Parameters
        ----------
        delay : int, tuple of int or None
            First input lags; left out, 1.

        Returns
        -------
        ARX
            With this request's channels, basis, affine terms and scheduling filter.
        """
        from lpvid.identification.arx import ARX

        order = self.given.get("order", LAGS)
        return ARX(na=self.given.get("na", order), nb=self.given.get("nb", order), nk=1 if delay is None else delay,
                   input=self.input, output=self.output, basis=self.basis(), affine=self.affine,
                   lagged="lagged" in self.given, stage=self.given.get("shape"), schedule_filter=self.filter,
                   ridge=self.given.get("ridge", 0.0))

    # -- the structure ------------------------------------------------------------------------------------------
    def build(self, delay: int | tuple[int, ...] | None, affine: int | None = None) -> Structure:
        """The structure, with these first input lags and number of affine terms in place of those requested.

        Parameters
        ----------
        delay : int, tuple of int or None
            First input lags; None stands for 1. Quasi-LPV and compliance structures keep what was requested.
        affine : int, optional
            Number of affine terms, for structures that take it from the ARX; left out, as requested.

        Returns
        -------
        Structure
            Ready for `lpvid.identify`.
        """
        from dataclasses import replace

        arx = self.arx(delay)
        arx = arx if affine is None else replace(arx, affine=affine)
        if self.structure not in TAKES:
            return self._registered(arx)
        if self.structure in ("subspace", "pem-ss"):
            return self._state_space(arx)
        if self.structure in ("quasi", "compliance"):
            return self._own_scheduling()
        return self._input_output(arx)

    def without_filter(self, structure: Structure) -> Structure | None:
        """The structure without its scheduling filter, or None where it has none.

        Parameters
        ----------
        structure : Structure
            As `build` returned it.

        Returns
        -------
        Structure or None
            A copy without it.
        """
        from dataclasses import replace

        if getattr(structure, "schedule_filter", None) is None:
            return None
        return replace(structure, schedule_filter=None)  # type: ignore[type-var]

    def _registered(self, arx: ARX) -> Structure:
        """A structure of another package: its fields that an ARX has too, then those with an option of the name.

        A default of its own, other than that of the ARX, stands where no option of the field was written.
        """
        cls = STRUCTURES.get(self.structure)
        own = {f.name: f.default for f in fields(cls) if f.name != "weight"}

        def requested(f: Field) -> bool:
            written = any(option in self.given for option in FIELDS.get(f.name, ()))
            return written or f.name == "nk" or own[f.name] in (f.default, MISSING)

        common = {f.name: getattr(arx, f.name) for f in fields(arx) if f.name in own and requested(f)}
        rest = {n: self.given[n] for n in FIELDS if n in own and n in self.given and n not in common}
        return cls(**common, **rest)

    def _input_output(self, arx: ARX) -> Structure:
        from lpvid.identification.armax import ARMAX
        from lpvid.identification.box_jenkins import BoxJenkins
        from lpvid.identification.coprime import RightCoprime
        from lpvid.identification.output_error import OutputError
        from lpvid.identification.passive import Passive
        from lpvid.identification.recursive import Recursive
        from lpvid.identification.refined_iv import RefinedIV

        common = {n: getattr(arx, n) for n in ("na", "nb", "nk", "input", "output", "basis", "affine", "lagged",
                                               "stage", "schedule_filter")}
        colour = {n: self.given[n] for n in ("nc", "nd") if n in self.given}
        if self.structure in ("arx", "oe"):
            plain = arx if self.structure == "arx" else OutputError(**common)
            return Passive(plain, balanced="balanced" in self.given) if "passive" in self.given else plain
        if self.structure == "bj":
            return BoxJenkins(**common, **colour)
        if self.structure == "armax":
            return ARMAX(**common, **colour)
        if self.structure == "riv":
            return RefinedIV(**common, **colour, noise="box-jenkins" if any(colour.values()) else "output")
        if self.structure == "recursive":
            return Recursive(arx, forgetting=self.given.get("forgetting", 0.995))
        if len(set(arx.width)) > 1:
            raise InputError("--structure coprime has one number of input lags", got=f"--nb {self.given.get('nb')}",
                             mend="give --nb one number")
        rest = {n: v for n, v in common.items() if n not in ("nb", "nk", "lagged")}
        return RightCoprime(**rest, nb=arx.width[0], direct=self._direct(arx))

    def _direct(self, arx: ARX) -> bool:
        if self.delay is not None and not set(arx.delay) <= {0, 1}:
            raise InputError(f"--structure {self.structure} takes --nk 0 or --nk 1", got=f"--nk {self.delay}",
                             why="further delays are states of their own", mend="raise its order instead")
        return 0 in arx.delay

    def _state_space(self, arx: ARX) -> Structure:
        from lpvid.identification.state_space_error import StateSpaceError
        from lpvid.identification.subspace import Subspace

        common = {"order": self.given.get("order"), "input": self.input, "output": self.output, "basis": arx.basis,
                  "direct": self._direct(arx), "affine": "no-constant" not in self.given}
        if self.structure == "subspace":
            return Subspace(**common, past=self.given.get("past"))
        return StateSpaceError(**common, noise="innovation" if "innovation" in self.given else "output")

    def _own_scheduling(self) -> Structure:
        from lpvid.identification.compliance import Compliance
        from lpvid.identification.quasi_lpv import QuasiLPV
        from lpvid.scheduling import Polynomial, Spline

        given = self.given
        inputs, outputs, schedule = list(self.input), list(self.output), list(self.schedule)
        if self.structure == "compliance":
            if len(inputs) > 1 or len(outputs) > 1 or len(schedule) > 1:
                raise InputError("--structure compliance has one input, one output and at most one scheduling variable",
                                 got=f"{len(inputs)}, {len(outputs)} and {len(schedule)}",
                                 mend="name further inputs that act in parallel with --side")
            return Compliance(inputs[0], outputs[0], schedule[0] if schedule else None,
                              levels=given.get("segments", 2), side=given.get("side", ()),
                              states=given.get("states", 1), schedule_filter=self.filter)
        on, degree = given.get("on", "trial"), given.get("degree", 1)
        name = inputs[0] if on == "input" else outputs[0]
        if given.get("basis", "spline") == "spline":
            own: Basis = Spline(name, segments=given.get("segments", 10), order=1)
        else:
            own = Polynomial((name,), degree=max(degree, 1))
        return QuasiLPV(na=given.get("na", 0), nb=given.get("nb", LAGS), nk=given.get("nk", 0), input=self.input,
                        output=self.output, basis=own, on=on, trial=given.get("trial", 1),
                        external=Polynomial(self.schedule, degree=degree if self.schedule else 0),
                        schedule_filter=self.filter, oddness=given.get("odd", 0.0))
