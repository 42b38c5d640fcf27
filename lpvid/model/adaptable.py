"""Adaptable: what is no model of lpvid by itself, but acts as one at a given rate."""

from __future__ import annotations

from abc import ABC, abstractmethod

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.model.lft import LFTModel
from lpvid.model.quasi import QuasiLPVModel, SelfScheduled
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction

Acting = LPVTransferFunction | LPVStateSpace | SelfScheduled


class Adaptable(ABC):
    """A law of another package (such as a physical model in continuous time) that simulation and validation can run.

    What `lpvid.load` gives back may be one; `simulate`, `predict` and `validate` ask it for its model.
    """

    @property
    @abstractmethod
    def period(self) -> float | None:
        """Period of the data that it was fitted to [s]; None where that is not known."""

    @abstractmethod
    def to_model(self, sample_time: float) -> Acting:
        """The model that runs like it at this period [s]; one that is sampled itself keeps its own period.

        Parameters
        ----------
        sample_time : float
            Period of the record it is to run on [s].

        Returns
        -------
        model
        """

    @abstractmethod
    def to_linear_model(self) -> Acting:
        """The model whose stability is that of the law: an LPV one, or one of lpvid's that schedules itself.

        Returns
        -------
        model

        Raises
        ------
        InputError
            A law that has no such form.
        """


def checked_model(noun: object, what: str) -> None:
    """Refuse what is no model, such as an identification or a realisation, which hold one.

    Parameters
    ----------
    noun : object
    what : str
        A whole phrase: "a pole locus is that of a model".

    Raises
    ------
    InputError
        With what to give instead.

    Examples
    --------
    >>> checked_model(3, "a pole locus is that of a model")
    Traceback (most recent call last):
    lpvid.errors.InputError: a pole locus is that of a model: got int. Mend: give the .model of an identification...
    """
    kinds = (LPVTransferFunction, LPVStateSpace, SelfScheduled, LFTModel, Adaptable)
    holds = isinstance(getattr(noun, "model", None), kinds)
    _checks.instance(noun, kinds, what, "give its .model" if holds else
                     "give the .model of an identification or a realisation, or a damper that was fitted")


def checked_matrices(noun: object, what: str) -> None:
    """Refuse what is no LPV transfer function or state space, and name the one that it can be turned into.

    Parameters
    ----------
    noun : object
    what : str
        A whole phrase, as for `checked_model`.

    Raises
    ------
    InputError
        With what to give instead.

    Examples
    --------
    >>> from lpvid.model.signals import Signal
    >>> from lpvid.scheduling import Spline
    >>> own = QuasiLPVModel([[[0.0, -1.0]], [[0.0, 1.0]]], Spline("y", 1, 1, (-1.0, 1.0)), 0, (1,), (0,), 0.1,
    ...                     (Signal("u"),), (Signal("y"),), "trial", [1.0])
    >>> checked_matrices(own, "frozen stability is that of a model")
    Traceback (most recent call last):
    lpvid.errors.InputError: frozen stability is that of a model over a measured scheduling: got QuasiLPVModel...
    """
    checked_model(noun, what)
    for kind, mend in _TURNED.items():
        if isinstance(noun, kind):
            raise InputError(f"{what} over a measured scheduling", got=type(noun).__name__, mend=mend)


_TURNED = {
    QuasiLPVModel: "give its .embedding(), whose scheduling rho is free in the range of its own",
    SelfScheduled: "save it and take lpvid stability, which states what bounds its output",
    LFTModel: "give lpvid.from_lft(…).model",
    Adaptable: "give its .to_linear_model()",
}
"""what has no matrices over a basis, and what to give instead; the narrower kind first."""


def acting(model: Acting | Adaptable, sample_time: float) -> Acting:
    """`model` itself, or what acts for it at this period.

    Parameters
    ----------
    model : model or Adaptable
    sample_time : float
        Period [s].

    Returns
    -------
    model
    """
    return model.to_model(sample_time) if isinstance(model, Adaptable) else model
