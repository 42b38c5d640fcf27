"""`--beside`: other models on the records of a report, in one table and drawn over each other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lpvid.model.adaptable import Adaptable
    from lpvid.record import Record
    from lpvid.report.page import Section
    from lpvid.simulation import Model
    from lpvid.validation.comparing import ModelComparison


def labels(files: Sequence[str]) -> list[str]:
    """Names of model files, short where that distinguishes them: stems, else with their folders.

    Parameters
    ----------
    files : sequence of str

    Returns
    -------
    list of str
    """
    stems = [Path(f).stem for f in files]
    folders = [f"{Path(f).parent.name}/{Path(f).stem}" for f in files]
    for names in (stems, folders):
        if len(set(names)) == len(files):
            return names
    return list(files)


def load_beside(files: Sequence[str] | None, own: str) -> tuple[str, dict[str, Model | Adaptable]]:
    """The name of a report's own model, and others by name; a file that holds none is refused before the work begins.

    Parameters
    ----------
    files : sequence of str or None
        Of the others.
    own : str
        File of the report's own model.

    Returns
    -------
    str, dict of str to model
    """
    from lpvid.export.serialise import load

    listed = list(files or ())
    name, *rest = labels([own, *listed])
    return name, {n: load(Path(file)) for n, file in zip(rest, listed, strict=True)}


def with_roles_of(named: Mapping[str, Sequence[str]]) -> Callable[[Model, list[Record]], list[Record]]:
    """What gives records the roles that one model reads.

    Parameters
    ----------
    named : mapping of str to sequence of str
        Channels that play the parts of the inputs, outputs and scheduling variables.

    Returns
    -------
    callable
        Of a model and records, to records.
    """
    from lpvid.cli.parts import parts

    given = {part: tuple(names) for part, names in named.items()}
    return lambda model, records: [r.with_roles(parts(model, given)) for r in records]


def compared(own: tuple[str, Model], others: Mapping[str, Model | Adaptable], records: Sequence[Record],
             label: str | None, sample_rate: float | None, named: Mapping[str, Sequence[str]],
             ) -> ModelComparison | None:
    """The model of a report with others on the same records; None without others.

    Parameters
    ----------
    own : (str, Model)
        What the report calls its model, and the model.
    others : mapping of str to model
    records : sequence of Record
        As measured.
    label : str or None
        "training" or "held-out"; None where the rows decide.
    sample_rate : float or None
        For models without a rate of their own [Hz].
    named : mapping of str to sequence of str
        Channels that play the parts of the inputs, outputs and scheduling variables.

    Returns
    -------
    ModelComparison or None
    """
    from lpvid.validation.comparing import compare_models

    if not others:
        return None
    return compare_models({own[0]: own[1], **others}, records, sample_rate=sample_rate, label=label,
                          fitted=with_roles_of(named))


def beside_sections(found: ModelComparison | None, records: Sequence[Record],
                    named: Mapping[str, Sequence[str]]) -> tuple[Section, ...]:
    """The section of a report about that comparison, or none.

    Parameters
    ----------
    found : ModelComparison or None
    records : sequence of Record
        As measured.
    named : mapping of str to sequence of str
        As for `compared`.

    Returns
    -------
    tuple of Section
    """
    from lpvid.report.comparing import beside_section

    return () if found is None else (beside_section(found, records, with_roles_of(named)),)
