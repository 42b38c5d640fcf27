"""Baselines by name: every damper model and the quarter car, for the entry-point group ``lpvid.baselines``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from lpvid.baselines.baseline import Baseline
from lpvid.baselines.named import Factory
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.toolkit import checks
from quartercar.dampers import DAMPERS, model_class, model_names
from quartercar.dampers.contract import Damper
from quartercar.dampers.families import LawDamper


def damper_baseline(name: str, records: Sequence[Record], parameters: Any = None) -> Baseline:
    """A damper model as a baseline, in the structure and the polarity that records call for.

    Parameters
    ----------
    name : str
        Of `quartercar.dampers.model_names`.
    records : sequence of Record
        Uniform, with velocity and force.
    parameters : path, Damper or mapping, optional
        A parameter set as `quartercar.dampers.published.read_parameters` reads it, a damper, or what `to_dict` gave.

    Returns
    -------
    Baseline
        At the parameters that are given; without any, a law at its defaults, still to be fitted, or another model
        fitted to the records.

    Raises
    ------
    InputError
        Why this model does not suit these data, or this file is no set of this model.
    """
    if isinstance(parameters, Mapping):
        return _baseline(model_class(name).from_dict(parameters["damper"]))
    if isinstance(parameters, Damper):
        return _baseline(parameters)
    lacking = next((r for r in records if not (r.has("velocity") and r.has("force"))), None)
    if not records:
        raise InputError(f"the baseline '{name}' needs velocity and force", got="no records")
    if lacking is not None:
        absent = [n for n in ("velocity", "force") if not lacking.has(n)]
        wanted = ["velocity", "displacement", *absent[1:]] if absent[0] == "velocity" else absent
        raise InputError(f"the baseline '{name}' needs velocity (or displacement) and force; record '{lacking.name}' "
                         f"has no {' and no '.join(absent)}", got=f"roles {', '.join(lacking.channels) or 'none'}",
                         mend=checks.role_mend(*wanted))
    from quartercar.dampers.facts import Facts
    from quartercar.dampers.fitting import fit
    from quartercar.dampers.preparing import sense_of

    facts = Facts.of(records, sense_of(records)[0])
    suited = model_class(name).suited(facts)
    if parameters is not None:
        return _given(name, suited, parameters)
    return _baseline(suited.all_free() if isinstance(suited, LawDamper) else fit(suited, records).damper)


def _given(name: str, suited: Damper, file: Any) -> Baseline:
    from quartercar.dampers.published import read_parameters

    damper = read_parameters(file, suited)
    if damper.name != name:
        raise InputError(f"'{file}' holds no parameters of '{name}'", got=damper.name,
                         mend=f"--baseline {damper.name}, or another file")
    return _baseline(damper)


def _baseline(damper: Damper) -> Baseline:
    if isinstance(damper, LawDamper):
        from quartercar.baselines.damper import DamperBaseline

        return DamperBaseline(damper)
    from lpvid.baselines.lpv_baseline import LpvBaseline
    from quartercar.dampers.blackbox.sampled import SampledDamper

    if isinstance(damper, SampledDamper):
        return LpvBaseline(damper.held.at(damper.vector), damper.name, "device", damper.polarity,
                           {"displacement": damper.centre})
    return LpvBaseline(damper.to_model(damper.clock or 0.0), damper.name)


def car_baseline(records: Sequence[Record], parameters: Any = None) -> Baseline:
    """The quarter car: all of its parameters free, or none where they are given.

    A file holds ``{"model": "quarter-car", "parameters": {"sprung_mass": "2.45 kg", …}}``; parameters left out are
    those of `quartercar.parameters.BENCH`.

    Parameters
    ----------
    records : sequence of Record
        Prepared; with an actuator where all of them have one.
    parameters : path, CarParameters or mapping, optional
        A file, a car, or what `to_dict` gave.

    Returns
    -------
    Baseline
    """
    from quartercar.baselines.quarter_car import UNITS, QuarterCarBaseline
    from quartercar.parameters import BENCH, CarParameters

    if isinstance(parameters, Mapping):
        return QuarterCarBaseline.from_dict(dict(parameters))
    actuated = all(r.has("actuator") for r in records)
    if parameters is None:
        return QuarterCarBaseline(actuated=actuated)
    if isinstance(parameters, CarParameters):
        return QuarterCarBaseline(parameters, (), actuated=actuated)
    from quartercar.dampers.published import read_values

    return QuarterCarBaseline(BENCH.replace(**read_values(parameters, "quarter-car", UNITS)), (), actuated=actuated)


class _Baselines(Mapping[str, Factory]):
    """Every damper model that is known when it is requested, and the car."""

    def __getitem__(self, name: str) -> Factory:
        if name == "quarter-car":
            return car_baseline
        if name not in DAMPERS:
            raise KeyError(name)
        return partial(damper_baseline, name)

    def __iter__(self) -> Iterator[str]:
        yield from (*model_names(), "quarter-car")

    def __len__(self) -> int:
        return len(model_names()) + 1


BASELINES: Mapping[str, Factory] = _Baselines()
"""Every damper model, and the car, by their names on the command line."""
