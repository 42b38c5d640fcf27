"""synthesize(plant, design): the one verb behind which every design stands."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

from lpvid.errors import InputError
from lpvid.synthesis.carried_error import carried
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.progress import interrupted, watched
from lpvid.synthesis.result import Synthesis


@runtime_checkable
class Design(Protocol):
    """Settings of a search for a controller: `OutputFeedback`, `StateFeedback` and others with `solve`."""

    def solve(self, plant: GeneralizedPlant) -> Synthesis:
        """The controller for a plant, or why there is none.

        Parameters
        ----------
        plant : GeneralizedPlant
            What is controlled.

        Returns
        -------
        Synthesis
            A failure is a verdict with its reason, no error.
        """
        ...


def synthesize(plant: GeneralizedPlant, design: Design, *, progress: Callable[[str], None] | None = None) -> Synthesis:
    """A controller for a plant, its closed loop verified; or a verdict with its reason and what would mend it.

    Parameters
    ----------
    plant : GeneralizedPlant
    design : OutputFeedback, StateFeedback, MultiObjective or another design
        What to ask of the closed loop.
    progress : callable, optional
        Takes a line about what is being done, the bound so far and how long the rest takes at most.

    Returns
    -------
    Synthesis
        Interrupted (Ctrl-C), a search that has a bound writes its controller down; where one was verified before, that
        is returned. A note states so.

    Raises
    ------
    InputError
        A plant or design of the wrong kind, and whatever the design refuses.
    KeyboardInterrupt
        Interrupted before there was a controller, or twice.

    Examples
    --------
    >>> from lpvid.model.signals import Signal
    >>> from lpvid.model.state_space import LPVStateSpace
    >>> from lpvid.scheduling import Polynomial
    >>> from lpvid.synthesis.output_feedback import OutputFeedback
    >>> system = LPVStateSpace([[[1.0]]], [[[1.0, 1.0]]], [[[1.0], [0.0]]], [[[0.0, 1.0], [1.0, 0.0]]],
    ...                        Polynomial((), 0), None, inputs=(Signal("road"), Signal("force")),
    ...                        outputs=(Signal("comfort"), Signal("sensor")))
    >>> blind = synthesize(GeneralizedPlant(system, ["force"], ["sensor"]), OutputFeedback())
    >>> blind.verdict, blind.mend[:12]
    ('undetectable', 'add a sensor')
    """
    if not isinstance(plant, GeneralizedPlant):
        raise InputError("synthesis needs a GeneralizedPlant", got=type(plant).__name__,
                         mend="sort the system's signals with GeneralizedPlant(system, controls=…, measurements=…)")
    if not isinstance(design, Design) or isinstance(design, type):
        raise InputError("synthesis needs a design", got=getattr(design, "__name__", type(design).__name__),
                         mend="give OutputFeedback(), StateFeedback() or another design of lpvid.synthesis")
    plant.system.basis.readings()  # refuses functions that no certificate could look at, before the search
    with watched(progress) as watch:
        try:
            found = design.solve(plant)
        except KeyboardInterrupt:
            if watch.best is None:
                raise
            found, watch.stopped = watch.best, True
        found = carried(plant, found)
        return interrupted(found, watch) if watch.stopped else found
