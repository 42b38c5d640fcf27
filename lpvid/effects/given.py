"""Given: what a user gives as a baseline and as candidates, and the baseline and the effects that it becomes."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.lpv_baseline import LpvBaseline
from lpvid.baselines.named import factories, named_baseline
from lpvid.baselines.signals import ROLES
from lpvid.condition.segmentation import RATE_TOLERANCE
from lpvid.effects.catalogues import catalogue
from lpvid.effects.effect import Effect
from lpvid.effects.extended import ExtendedModel
from lpvid.effects.extended_baseline import ExtendedBaseline
from lpvid.errors import InputError
from lpvid.export.renaming import renamed
from lpvid.export.serialise import load
from lpvid.model.adaptable import Adaptable
from lpvid.model.quasi import SelfScheduled
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record


def is_file(text: str | os.PathLike) -> bool:
    """Whether a baseline is given as a file rather than by name.

    Parameters
    ----------
    text : str or path

    Returns
    -------
    bool
        True for a path object, for a text that ends in ``.json`` or holds a separator of folders, and for the name of a
        file that exists.
    """
    return not isinstance(text, str) or text.endswith(".json") or os.sep in text or Path(text).is_file()


def opened(given: Any) -> Any:
    """What a file holds, where a user gives one; else what is given.

    Parameters
    ----------
    given : str, path, model or Baseline

    Returns
    -------
    object
    """
    return load(given) if isinstance(given, (str, os.PathLike)) and is_file(given) else given


def channels_of(given: Any) -> tuple[str, ...]:
    """Channels that a baseline or a model requires; none for a name, whose baseline is created later.

    Parameters
    ----------
    given : str, model or Baseline

    Returns
    -------
    tuple of str
        By role, or as a model's signals are named.
    """
    if isinstance(given, Baseline):
        return given.channels
    if not all(hasattr(given, n) for n in ("inputs", "outputs", "box")):
        return ()
    return (*(s.name for s in given.inputs), *given.box.names, *(s.name for s in given.outputs))


def by_roles(model: Any) -> Any:
    """A model whose signals have the names of their roles in training, by which effects find them.

    Parameters
    ----------
    model : object
        What is no model, or has no roles in its metadata, stays as it is.

    Returns
    -------
    object
    """
    stated = getattr(model, "metadata", {}).get("roles", {})
    names = channels_of(model)
    known = [r for r in ROLES if r in stated and r not in names]
    others = {n: r for r in known for n in names if n not in ROLES and stated.get(n, n) == stated[r]}
    if not others or not isinstance(stated, Mapping) or not hasattr(model, "to_dict"):
        return model
    return renamed(model, others)


def rate_of(given: Any, records: Sequence[Record]) -> float | None:
    """Rate of a sampled model where that of the records differs; None where it does not.

    Parameters
    ----------
    given : str, model or Baseline
    records : sequence of Record

    Returns
    -------
    float or None
        [Hz].
    """
    period = given.clock if isinstance(given, Baseline) else getattr(given, "sample_time", None)
    if period is None or isinstance(given, str):
        return None
    foreign = any(not r.time_base.steady or abs(r.time_base.period / period - 1) > RATE_TOLERANCE for r in records)
    return 1.0 / period if foreign else None


def as_effects(given: Any) -> tuple[Effect, ...]:
    """The candidates that a user gives.

    Parameters
    ----------
    given : sequence of Effect, name, names or None
        Effects, or the names of installed catalogues; None for all installed ones.

    Returns
    -------
    tuple of Effect

    Raises
    ------
    InputError
        Anything else; an unknown name, nothing installed, two effects of one name.
    """
    if given is None:
        return catalogue()
    listed: list[Any] = [given] if isinstance(given, (str, Effect)) else list(given)
    effects = [x for x in listed if isinstance(x, Effect)]
    names = [x for x in listed if isinstance(x, str)]
    if len(effects) + len(names) < len(listed) or (effects and names):
        raise InputError("a catalogue is a sequence of effects, or names of installed catalogues",
                         got=", ".join(sorted({type(x).__name__ for x in listed})))
    return catalogue(names) if names else tuple(effects)


def as_baseline(given: Any, records: Sequence[Record], parameters: Any) -> Baseline:
    """The baseline that a user gives by name, as a file's object, or as a model.

    Parameters
    ----------
    given : str, model or Baseline
        As `opened` returns it.
    records : sequence of Record
        Prepared.
    parameters : path, object or mapping, optional
        Of a named baseline.

    Returns
    -------
    Baseline

    Raises
    ------
    InputError
        An unknown name, or nothing that can be a baseline.
    """
    if isinstance(given, Baseline):
        return given
    if isinstance(given, str):
        return named_baseline(given, records, parameters)
    if isinstance(given, ExtendedModel):
        return ExtendedBaseline(given)
    if isinstance(given, (LPVTransferFunction, LPVStateSpace, SelfScheduled)):
        return LpvBaseline(given)
    name = getattr(given, "name", None)
    if isinstance(name, str) and name in factories():
        return named_baseline(name, records, given)
    if isinstance(given, Adaptable) and given.period is not None:
        return as_baseline(given.to_model(given.period), records, parameters)
    raise InputError("this is no baseline", got=type(given).__name__,
                     mend="name one, or give a saved damper, transfer function, state space or extended model")
