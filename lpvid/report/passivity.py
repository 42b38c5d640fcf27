"""Whether an identified damper gives energy: lines for the terminal and a section of the report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.remark import Cost
from lpvid.report.formatting import number
from lpvid.report.page import Item, Notes, PageFigure, PageTable, Paragraph, Section

if TYPE_CHECKING:
    from lpvid.analysis.passivity_margin import PassivityMargin
    from lpvid.identification.result import Identification
    from lpvid.validation import Validation

VELOCITY, FORCE = "m/s", "N"


def energy_statement(model: Any) -> PassivityMargin | None:
    """Damping in steady motion of a model from a velocity to a force; None for every other model.

    A model whose metadata state that its polarity is reversed is judged with the sign of its force turned. Amplitudes
    count up to the largest training velocity, where the metadata hold it: beyond that nothing was measured.

    Parameters
    ----------
    model : object
        A model of any class; judged where it is an `LPVTransferFunction` with one input in m/s or named velocity, and
        one output in N or named force.

    Returns
    -------
    PassivityMargin or None
        Its damping is in the sense of positive polarity.
    """
    if not isinstance(model, LPVTransferFunction) or len(model.inputs) != 1 or model.n_outputs != 1:
        return None
    source, target = model.inputs[0], model.outputs[0]
    moves = source.unit == VELOCITY or source.name == "velocity"
    if not (moves and (target.unit == FORCE or target.name == "force")):
        return None
    from lpvid.analysis.passivity_margin import passivity_margin

    assert model.c is not None
    turned = is_reversed(model)
    ends = model.metadata.get("training", {}).get("ranges", {}).get(source.name)
    largest = float(np.abs(ends).max()) if ends else None
    return passivity_margin(model.replace(b=-model.b, c=-model.c) if turned else model, largest=largest or None)


def is_reversed(model: Any) -> bool:
    """Whether the audit found the force of a model's training data against the motion.

    Parameters
    ----------
    model : object
        A model with metadata.

    Returns
    -------
    bool
    """
    return model.metadata.get("polarity") == "reversed"


def passivity_lines(found: Identification) -> list[str]:
    """What is printed of a model's energy: its certificate and cost with --passive, else where it is active.

    Parameters
    ----------
    found : Identification
        With "passive" in its model's metadata where the constraint was in force.

    Returns
    -------
    list of str
        Empty for a model that takes energy throughout, and for one that is no damper.
    """
    data = found.model.metadata.get("passive")
    if isinstance(data, Mapping):
        return [*str(_certificate(data)).splitlines(), *cost_lines(found)]
    margin = energy_statement(found.model)
    stated = "" if margin is None else margin.statement()
    if not stated:
        return []
    if is_reversed(found.model):
        return [f"NOT passive, with its force turned to positive polarity: {stated}: "
                f"--flip {found.model.outputs[0].name} --passive"]
    return [f"NOT passive: {stated}: --passive"]


def cost_lines(found: Identification) -> list[str]:
    """What the constraint costs in free run, held-out and training.

    Parameters
    ----------
    found : Identification
        With the figures of the unconstrained estimate.

    Returns
    -------
    list of str
        Free-run ESR without and with the constraint, and a remark on a training record that is simulated no better than
        by its mean; empty where there is no unconstrained figure.
    """
    after = [v for v in (found.training, found.held_out) if v is not None]
    pairs = list(zip(found.unconstrained_figures, after, strict=False))
    stated = [
        f"{new.label} free-run ESR {_esr(old)} unconstrained, {_esr(new)} passive" for old, new in reversed(pairs)
    ]
    lines: list[str] = [Cost(f"what it costs: {'; '.join(stated)}{_other_aim(found)}")] if stated else []
    worst = None if found.training is None else found.training.worst
    if lines and worst is not None and worst.free_run.esr is not None and worst.free_run.esr >= 1.0 \
            and not getattr(found.structure, "balanced", True):
        lines.append(f"training record '{worst.name}' is simulated no better than by its mean (free-run ESR "
                     f"{worst.free_run.esr:.3g}): --balanced divides each record's squared error by its variance")
    return lines


def _other_aim(found: Identification) -> str:
    """That the unconstrained estimate minimised another error than the passive one; empty where both are free runs."""
    from lpvid.report.stability import fits_free_run

    if found.unconstrained is None or fits_free_run(found.unconstrained):
        return ""
    return " (the unconstrained model minimises the one-step error, the passive one its free run)"


def passivity_section(found: Identification) -> tuple[Section, ...]:
    """The section of a report; empty for a model that is no damper.

    Parameters
    ----------
    found : Identification
        With or without the constraint.

    Returns
    -------
    tuple of Section
        One or none.
    """
    margin = energy_statement(found.model)
    if margin is None:
        return ()
    from lpvid import plot

    data, items = found.model.metadata.get("passive"), []
    if isinstance(data, Mapping):
        items.append(Paragraph(str(_certificate(data)).splitlines()[0] + ".", strong=True))
    if is_reversed(found.model):
        items.append(Paragraph("The polarity of these data is reversed: what follows holds for the model with its "
                               "force turned."))
    stated = margin.statement() or "in steady motion it takes energy at every amplitude, frequency and held scheduling"
    items.append(Paragraph(f"{stated[:1].upper()}{stated[1:]}."))
    items.append(
        PageFigure.of(
            plot.passivity(margin),
            "Damping in steady sine motion at the least favourable amplitude: "
            "where it is negative the model gives energy in every period.",
        )
    )
    items += _cost_table(found)
    return (Section("Energy", tuple(items)),)


def _esr(found: Validation) -> str:
    """Free-run ESR, or that the free run leaves all bounds."""
    value = found.overall.free_run.esr
    return "diverges" if value is None else number(value, 4)


def _cost_table(found: Identification) -> list[Item]:
    after = [v for v in (found.training, found.held_out) if v is not None]
    rows = tuple((new.label, _esr(old), _esr(new))
                 for old, new in zip(found.unconstrained_figures, after, strict=False))
    if not rows:
        return []
    return [
        PageTable(("data", "unconstrained", "passive"), rows, "Free-run ESR with and without the constraint.", (1, 2)),
        Notes(
            (
                "The passive model's free run was minimised; the unconstrained model is the estimate that it "
                f"started from{_other_aim(found)}.",
            )
        ),
    ]


def _certificate(data: Mapping) -> Any:
    from lpvid.analysis.passivity_certificate import PassivityCertificate

    return PassivityCertificate.from_dict(data)
