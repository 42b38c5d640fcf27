"""Experiments: plans of further measurements, from packages with a rig (entry-point group ``lpvid.experiments``)."""

from __future__ import annotations

from dataclasses import dataclass

from lpvid.diagnosis.diagnosis import Diagnosis
from lpvid.entry_points import loaded
from lpvid.errors import InputError

GROUP = "lpvid.experiments"


@dataclass(frozen=True)
class ExperimentProposal:
    """An experiment.

    Attributes
    ----------
    text : str
        A plan file; empty where there is nothing to run.
    description : str
        In one sentence.
    names : tuple of str
        Effects that it is meant for.
    advice : tuple of str
        Questions that no plan of the rig decides, each with the measurement that would.
    """

    text: str
    description: str
    names: tuple[str, ...]
    advice: tuple[str, ...] = ()


def open_questions(found: Diagnosis) -> tuple[str, ...]:
    """Effects that the data do not decide: rivals first, then those that these data cannot reveal.

    Parameters
    ----------
    found : Diagnosis

    Returns
    -------
    tuple of str
        Names, each once.
    """
    named = [n for r in found.rivals for n in r.names] + [c.name for c in found.cannot_tell]
    return tuple(dict.fromkeys(named))


def proposed(found: Diagnosis) -> ExperimentProposal | None:
    """The first plan of an installed package for the open questions of a diagnosis; None where there is none.

    Parameters
    ----------
    found : Diagnosis

    Returns
    -------
    ExperimentProposal or None

    Raises
    ------
    InputError
        An entry point of the group that is no function.
    """
    for name, planner in loaded(GROUP):
        if not callable(planner):
            raise InputError(f"the entry point '{name}' of {GROUP} is no function", got=type(planner).__name__,
                             mend="update or remove the package that names it")
        proposal = planner(found)
        if isinstance(proposal, ExperimentProposal):
            return proposal
    return None
