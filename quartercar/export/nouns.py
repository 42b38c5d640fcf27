"""Which nouns of a car have a step program, and what stands in for those that have none."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from lpvid.errors import InputError
from lpvid.export.contract import Exportable, Options
from lpvid.export.model_steps import prepare as prepare_model
from quartercar.controllers.contract import Controller
from quartercar.dampers.as_model import Turned
from quartercar.dampers.blackbox.sampled import SampledDamper
from quartercar.dampers.contract import Damper
from quartercar.export.controller_steps import prepare_controller
from quartercar.export.damper_steps import prepare_damper
from quartercar.export.loop_steps import LoopLaw, prepare_loop


def accepts(noun: Any) -> bool:
    """Dampers, controllers and loop laws.

    Parameters
    ----------
    noun : object
        What is to be exported.

    Returns
    -------
    bool
        Whether `prepare` is the one to ask.
    """
    return isinstance(noun, (Damper, Controller, LoopLaw, Turned))


def prepare(noun: Any, options: Options) -> Exportable:
    """A noun of a car as a step program; see `lpvid.export.exportable.exportable`.

    Parameters
    ----------
    noun : Damper, Controller, LoopLaw or Turned
        What `accepts` takes.
    options : Options
        A sample time belongs to what runs at any; what is sampled keeps its own.

    Returns
    -------
    Exportable
        With the simulation that the program must reproduce.

    Raises
    ------
    InputError
        A noun without a step, one that has not been fitted yet, or another rate than its own.
    """
    if isinstance(noun, LoopLaw):
        return prepare_loop(noun, options)
    if isinstance(noun, Controller):
        return prepare_controller(noun, options)
    if isinstance(noun, Turned):
        return _in_own_sense(noun, options)
    assert isinstance(noun, Damper)
    if not isinstance(noun, SampledDamper):
        return prepare_damper(noun, options)
    if noun.stored is None or noun.clock is None:
        raise InputError(f"{noun.name} has not been fitted yet", mend="fit it to records first")
    _own_period(noun, options)
    named = replace(options, name=options.name or noun.name)
    model = noun.to_model(noun.clock)
    return _in_own_sense(model, named) if isinstance(model, Turned) else prepare_model(model, named)


def _own_period(damper: SampledDamper, options: Options) -> None:
    clock = damper.clock
    assert clock is not None
    if options.sample_time is not None and not np.isclose(options.sample_time, clock, rtol=1e-9):
        raise InputError(f"this {damper.name} runs at the rate of its training data only",
                         got=f"{1 / options.sample_time:.6g} Hz against {1 / clock:.6g} Hz",
                         mend="leave the sample rate out, or fit it to records resampled to the wanted rate")


def _in_own_sense(model: Turned, options: Options) -> Exportable:
    found = prepare_model(model.inner, options)
    note = (f"Force in the damper's own sense, positive in extension: the records had sign {model.polarity:+d} and the "
            f"displacement zero {model.centre:g} m.")
    return replace(found, program=replace(found.program, notes=(*found.program.notes, note)))
