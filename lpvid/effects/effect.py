"""Effect: one named cause, as a stage that composes with any baseline. Adding one touches no other file."""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from lpvid import _checks
from lpvid.baselines.signals import Core, Signals
from lpvid.errors import InputError

if TYPE_CHECKING:
    from lpvid.baselines.baseline import Baseline

BETWEEN = 0.01
"""share of a sample to which a time is known at best"""
MOST_POINTS, MOST_SIZES = 14, 6
"""grid points at which an effect is screened; sizes of a strength among them, two to a decade"""
SPREAD = (0.003, 0.1, 1.0)
"""least, middle and largest share of its natural size at which a parameter is screened"""
STAGES = ("inside", "core", "series", "force", "kinematics", "current", "channel", "measurement")
"""Where an effect acts, from the inside out::

    channel ─► current ─► kinematics ─►( core ─► series )─► + force ─► measurement

A stage to the left turns signals before anything inside sees them; `inside` changes the parts of a simulation that is
made of parts (a car), `core` changes what the law puts out, `series` puts an
element with a state in series with it, `force` adds to its output, `measurement` changes the sum on its way to the
data.
"""


@dataclass(frozen=True)
class EffectParameter:
    """A number of an effect.

    Attributes
    ----------
    name, unit, description : str
    neutral : float
        The value at which the effect is not there, for the strength; for a shape parameter, its typical value.
    plausible : (float, float)
        Range in which a physical instance lies, SI; the search stays inside the wider `bounds`.
    bounds : (float, float)
    grid : tuple of float
        Values at which it is screened: strengths away from neutral, or shapes.
    choices : tuple of str
        For a parameter that can only be one of several things: what its values 0, 1, 2 … mean. A search takes it from
        the grid and leaves it there.
    held : bool
        Whether it is never fitted: a search leaves it at the smallest size at which a number of its unit is screened
        (`SPREAD`), and a file keeps it, so that a simulation along other data is of the same numbers.
    former : tuple of str
        Names by which files of earlier versions hold it.
    """

    name: str
    unit: str
    description: str
    neutral: float
    plausible: tuple[float, float]
    bounds: tuple[float, float]
    grid: tuple[float, ...]
    choices: tuple[str, ...] = ()
    held: bool = False
    former: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        low, high = self.bounds
        if not (low <= self.plausible[0] <= self.plausible[1] <= high and low <= self.neutral <= high):
            raise InputError(f"effect parameter {self.name} is inconsistent", got=f"{self.bounds}, {self.plausible}")
        if not self.grid or any(not low <= g <= high for g in self.grid):
            raise InputError(f"effect parameter {self.name} needs a screening grid inside its bounds", got=self.grid)

    def spread(self, scale: float | None, strength: bool) -> tuple[float, ...]:
        """The grid at the natural size of the data: as many decades apart, evenly in the logarithm, signs kept.

        A strength with a single size in its grid, as one that acts in proportion, is screened at a tenth of the scale.

        Parameters
        ----------
        scale : float or None
            Natural size of a number of its unit in the data, in that unit; None where it has none: the grid stays as it
            is.
        strength : bool
            Whether it is a strength rather than a shape.

        Returns
        -------
        tuple of float
            In the unit of the parameter, inside its bounds.
        """
        sizes = sorted({abs(g) for g in self.grid if g})
        if scale is None or not sizes or self.choices:
            return self.grid
        if self.held:
            return (float(np.clip(SPREAD[0] * scale, *self.bounds)),)
        signs = sorted({float(np.sign(g)) for g in self.grid if g})
        ladder = (SPREAD[1],) if len(sizes) == 1 and strength else \
            tuple(np.geomspace(SPREAD[0], SPREAD[2], max(len(sizes), MOST_SIZES if strength else 1)))
        found = [s * scale * x for x in ladder for s in signs]
        if len(sizes) == 1 and not strength:
            found = [s * scale * SPREAD[1] for s in signs]
        return tuple(float(np.clip(v, *self.bounds)) for v in ([0.0] if 0.0 in self.grid else []) + found)

    def choice(self, value: float) -> str | None:
        """What a value means where there are choices; None for a number.

        Parameters
        ----------
        value : float
            Rounded to the nearest of 0, 1, 2 ….

        Returns
        -------
        str or None
        """
        return self.choices[min(max(round(value), 0), len(self.choices) - 1)] if self.choices else None


@dataclass(frozen=True)
class LpvChange:
    """Change of the structure of an LPV model by which it can represent an effect.

    Attributes
    ----------
    description : str
        In words, e.g. "one more degree in the current".
    degree, order : int
        Added to the degree in the scheduling variable, to na and nb.
    schedule_filter : str or None
        Filter on the scheduling variable: "lag", "rise-fall", "delay", "rise-fall-delay" (names of `lpvid.ARX`).
    regressors : tuple of str
        Further inputs: "displacement", "acceleration", "sign(velocity)", "velocity|velocity|", "positive(velocity)".
    schedule : tuple of str
        Further scheduling variables: "temperature", "displacement", "sign(velocity)".
    delay : bool
        Whether the input's delay nk is chosen anew.
    """

    description: str
    degree: int = 0
    order: int = 0
    schedule_filter: str | None = None
    regressors: tuple[str, ...] = ()
    schedule: tuple[str, ...] = ()
    delay: bool = False


class Effect(ABC):
    """A cause by name: its change of a simulation, its parameters, and the measurement that reveals it.

    The first parameter is the strength; at its neutral value the composition is the baseline to the last bit. A further
    parameter is a shape (a corner frequency, a Stribeck speed), which is without effect at neutral strength.
    """

    name: ClassVar[str]
    """id used in files, tests and on the command line"""
    title: ClassVar[str]
    """in words"""
    family: ClassVar[str]
    """friction, elastic, hydraulics, electrical, thermal, structure, measurement, model, car"""
    stage: ClassVar[str]
    """one of `STAGES`"""
    layer: ClassVar[int] = 0
    """where within its stage it acts, from the inside out: what scales all of a law lies around what changes it"""
    equation: ClassVar[str]
    reference: ClassVar[str]
    experiment: ClassVar[str]
    """the measurement that reveals it, in one sentence"""
    needs: ClassVar[tuple[str, ...]] = ()
    """roles without which it cannot be tested"""
    strengths: ClassVar[int] = 1
    """how many of the leading parameters are strengths; the others are shapes"""
    memoryless: ClassVar[bool] = False
    """whether what it does at an instant depends on the signals at that instant alone"""
    smooth: ClassVar[bool] = True
    """False where the output is not differentiable in the strength: scanned, never linearised"""
    partners: ClassVar[tuple[str, ...]] = ()
    """names of effects with which it is linked physically, visited as a pair: each alone may be without gain"""
    added_later: ClassVar[tuple[str, ...]] = ()
    """parameters that it had not from the first: a file without them is read with them at neutral"""
    rugged: ClassVar[str] = ""
    """name of the number along which the error has many minima, as where a kink passes samples one by one: it is moved
    by trial as well; "" where there is none"""
    path: ClassVar[str] = ""
    """what a lag, a delay or a filter acts on: "current", "motion", "force" or "all"; "" for everything else. Those of
    motion and force can fit each other's error and that of every dynamic cause: a set holds one of them"""
    stepwise: ClassVar[bool] = False
    """whether the strength is a lag that acts in whole samples of a held signal, so that it has no useful derivative"""
    flexible: ClassVar[bool] = False
    """whether it is so general that its prior probability is lower"""
    common: ClassVar[bool] = False
    """whether it is as probable as not before any data, as most real devices have it; not counted where `flexible`"""
    visible: ClassVar[bool] = False
    """whether it is a candidate only where the samples show it before any fit, so that it is more probable than not"""
    placement_of: ClassVar[str] = ""
    """name of the effect of which it is the same component in another place; "" where it is none"""
    form_of: ClassVar[str] = ""
    """name of the component of which it is another form, so that evidence for either counts for it; "" where it is one
    of its own. A special case that is another component (a stop, a linear spring) is none"""
    contains: ClassVar[tuple[str, ...]] = ()
    """names of other components that its equation contains, so that it can replace them"""
    behind: ClassVar[str] = ""
    """stage without which it has no effect of its own: friction behind a spring needs something in series"""
    turns: ClassVar[str] = ""
    """channel that it changes before the law reads it; no candidate where neither the law nor an effect reads it"""
    brings: ClassVar[tuple[str, ...]] = ()
    """channels that a simulation reads with it though the law does not"""

    @property
    @abstractmethod
    def parameters(self) -> tuple[EffectParameter, ...]:
        """Strength first, then shapes."""

    @abstractmethod
    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        """Parameter vectors away from neutral at which it is screened; at most about a dozen.

        Parameters
        ----------
        signals : tuple of Signals

        Returns
        -------
        list of (k,) array
        """

    def spread_points(self, signals: tuple[Signals, ...], scale: Callable[[str], float | None]) -> list[np.ndarray]:
        """The same points, scaled to the data; `scale` gives the natural size of a quantity of a unit.

        Parameters
        ----------
        signals : tuple of Signals
        scale : callable
            From a unit to a size, None where it has none.

        Returns
        -------
        list of (k,) array
        """
        return self.points(signals)

    def refit_points(self, signals: tuple[Signals, ...], scale: Callable[[str], float | None]) -> list[np.ndarray]:
        """Start points of a refit in which the effect replaces another of its family.

        At `spread_points`, and at further shapes, too many to be screened always.

        Parameters
        ----------
        signals : tuple of Signals
        scale : callable
            From a unit to a size, None where it has none.

        Returns
        -------
        list of (k,) array
        """
        return self.spread_points(signals, scale)

    @abstractmethod
    def applies(self, baseline: Baseline, signals: tuple[Signals, ...]) -> str | None:
        """Why it cannot be composed with this baseline on these data (a missing channel apart); None where it can.

        Parameters
        ----------
        baseline : Baseline
        signals : tuple of Signals

        Returns
        -------
        str or None
        """

    def determined(self, signals: tuple[Signals, ...]) -> str | None:
        """Why these data could not reveal it whatever the law reads.

        Parameters
        ----------
        signals : tuple of Signals

        Returns
        -------
        str or None
            None where they could.
        """
        return None

    @abstractmethod
    def compose(self, core: Core, values: np.ndarray, baseline: Baseline) -> Core:
        """The simulation with the effect in it; `values` are its parameters in order.

        Parameters
        ----------
        core : Core
        values : (k,) array
        baseline : Baseline

        Returns
        -------
        Core
        """

    @abstractmethod
    def lpv_change(self) -> LpvChange | None:
        """How a discrete LPV model takes it in; None where no LPV structure can.

        Returns
        -------
        LpvChange or None
        """

    @property
    def component(self) -> str:
        """Name of the component that it is, wherever that sits."""
        return self.placement_of or self.name

    @property
    def neutral(self) -> np.ndarray:
        """(k,) parameters at which it is not there."""
        return np.array([p.neutral for p in self.parameters])

    def in_place_of(self, other: Effect, values: np.ndarray) -> np.ndarray:
        """Parameters that this effect takes over from another one: those of the same name; neutral for the rest.

        Parameters
        ----------
        other : Effect
        values : (m,) array
            Of the other one.

        Returns
        -------
        (k,) array
        """
        named = dict(zip((p.name for p in other.parameters), values, strict=True))
        return np.array([named.get(p.name, p.neutral) for p in self.parameters])

    def comes_to(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        """Names of the simpler effects to which this one reduces at these values.

        Parameters
        ----------
        values : (k,) array
        signals : sequence of Signals
            The data: they define what is fast, slow or beyond their rate.

        Returns
        -------
        tuple of str
        """
        return ()

    def stands_for(self, values: np.ndarray, signals: Sequence[Signals]) -> tuple[str, ...]:
        """Names of components that a form with these values describes too: it is reported with them, never alone.

        A form (another power of the speed, one more mode) is no part of a damper. Beside a law that is itself slightly
        wrong it can fit better than any single component, so that the error cannot decide between them.

        Parameters
        ----------
        values : (k,) array
        signals : sequence of Signals
            The data: they define what is fast, slow or beyond their rate.

        Returns
        -------
        tuple of str
        """
        return ()

    def missing(self, signals: tuple[Signals, ...]) -> tuple[str, ...]:
        """Needed roles that some record does not have.

        Parameters
        ----------
        signals : tuple of Signals

        Returns
        -------
        tuple of str
            Empty where every record has all of `needs`.
        """
        return tuple(n for n in self.needs if not all(s.has(n) for s in signals))

    def described(self, values: np.ndarray) -> str:
        """The title, with what was chosen where a parameter has choices.

        Parameters
        ----------
        values : (k,) array

        Returns
        -------
        str
        """
        chosen = [c for p, v in zip(self.parameters, values, strict=True) if (c := p.choice(float(v))) is not None]
        return f"{self.title}: {', '.join(chosen)}" if chosen else self.title

    def is_static(self, values: np.ndarray) -> bool:
        """Whether it is memoryless at these parameters.

        Parameters
        ----------
        values : (k,) array

        Returns
        -------
        bool
        """
        return self.memoryless

    def clock_error(self, signals: Sequence[Signals]) -> float:
        """Standard error of the strength beyond that of the fit, because signals are unknown between their samples.

        A held signal may jump anywhere between two samples; in a smooth one a time is known to a hundredth of a sample.

        Parameters
        ----------
        signals : sequence of Signals
            Of one rate.

        Returns
        -------
        float
            In the unit of the strength; 0 for one that is no time.
        """
        period = signals[0].sample_time
        if self.stepwise:
            return period / (2 * np.sqrt(3))
        return BETWEEN * period if self.parameters[0].unit == "s" else 0.0

    def clock_errors(self, values: np.ndarray, signals: Sequence[Signals]) -> np.ndarray:
        """(k,) the same for all of its parameters, at their values.

        Parameters
        ----------
        values : (k,) array
        signals : sequence of Signals

        Returns
        -------
        (k,) array
        """
        return np.append(self.clock_error(signals), np.zeros(len(self.parameters) - 1))

    def describe(self) -> dict[str, Any]:
        """Plain data for a table of the catalogue.

        Returns
        -------
        dict
            The class attributes by name, and ``parameters``: a list of their names, units, descriptions (``says``),
            neutral values and plausible ranges, and ``held`` where one is not fitted.
        """
        return {"name": self.name, "title": self.title, "family": self.family, "stage": self.stage,
                "equation": self.equation, "reference": self.reference, "experiment": self.experiment,
                "needs": list(self.needs),
                "parameters": [{"name": p.name, "unit": p.unit, "says": p.description, "neutral": p.neutral,
                                "plausible": list(p.plausible), **({"held": True} if p.held else {})}
                               for p in self.parameters]}

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name})"


class GridEffect(Effect):
    """An effect that is screened on the product of its parameters' grids, whatever the data."""

    def points(self, signals: tuple[Signals, ...]) -> list[np.ndarray]:
        return _product([p.grid for p in self.parameters])

    def spread_points(self, signals: tuple[Signals, ...], scale: Callable[[str], float | None]) -> list[np.ndarray]:
        grids = [p.spread(scale(p.unit), k < self.strengths) for k, p in enumerate(self.parameters)]
        return _product(grids)


def _product(grids: Sequence[Sequence[float]]) -> list[np.ndarray]:
    """Every combination, thinned evenly to `MOST_POINTS`."""
    found = [np.array(p) for p in itertools.product(*grids)]
    if len(found) > MOST_POINTS:
        found = [found[k] for k in np.unique(np.linspace(0, len(found) - 1, MOST_POINTS).round().astype(int))]
    return found


def by_name(catalogue: tuple[Effect, ...]) -> Mapping[str, Effect]:
    """The catalogue as a table; two effects of one name are an error.

    Parameters
    ----------
    catalogue : tuple of Effect

    Returns
    -------
    mapping of str to Effect
        In the order of the catalogue.

    Raises
    ------
    InputError
        Two effects of one name, a stage that is none of `STAGES`, `rugged` that is none of its parameters.
    """
    table: dict[str, Effect] = {}
    for effect in catalogue:
        _checks.one_of(effect.stage, STAGES, f"stage of effect '{effect.name}'")
        if effect.name in table:
            raise InputError("two effects have one name", got=effect.name)
        if effect.rugged:
            _checks.one_of(effect.rugged, [p.name for p in effect.parameters], f"rugged of effect '{effect.name}'")
        table[effect.name] = effect
    return table
