"""Stability of models that schedule themselves: what holds by construction, and what a certificate covers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from lpvid.model.compliance import ComplianceModel
from lpvid.model.quasi import QuasiLPVModel, SelfScheduled
from lpvid.report.formatting import number
from lpvid.report.page import Mark, Page, PageTable, Paragraph, Section
from lpvid.report.stability import StabilityStudy, narrowed, stability_page, study_stability

AMPLITUDES = (0.1, 1.0)
"""Largest moduli of the inputs for which the bound on the output is given, in their SI units."""
MIXTURE = ("without linear output lags every output is a mixture of finitely many linear functions of the newest "
           "inputs, whatever the model's own scheduling variable does and however fast")
PASSIVE = ("a rising damper law in series with a positive stiffness: the element's force never leaves the range of its "
           "static law for the largest velocity, at any rate of velocity and scheduling")


@dataclass(frozen=True, eq=False)
class SelfScheduledStudy:
    """What the stability report states about a model that schedules itself.

    Attributes
    ----------
    model : SelfScheduled
        With the range requested as its box.
    embedded : StabilityStudy or None
        Of the LPV model in which the model's own scheduling variable moves freely; None where the model is bounded by
        construction.
    bounds : tuple of (float, float)
        Largest modulus of the inputs, and what the output then never exceeds; empty where nothing is proven.
    """

    model: SelfScheduled
    embedded: StabilityStudy | None
    bounds: tuple[tuple[float, float], ...]

    @property
    def certified(self) -> bool:
        """Whether every bounded input has a bounded output, proven."""
        return self.embedded is None or self.embedded.certified

    @property
    def mark(self) -> Mark:
        """Colour of the verdict; open is not bad."""
        if self.embedded is None:
            return "good"
        return self.embedded.mark if self.certified else "warn"

    @property
    def why(self) -> str:
        """What the statement rests on."""
        if self.embedded is not None:
            return ("every run of this model is one of the LPV model in which its own scheduling variable 'rho' moves "
                    "freely within the clamped range")
        return PASSIVE if isinstance(self.model, ComplianceModel) else MIXTURE

    @property
    def verdict(self) -> str:
        """One or two sentences."""
        if self.embedded is None:
            return f"Bounded for every bounded input, by construction: {self.why}."
        if self.certified:
            return (f"Bounded for every bounded input: {self.why}, and that model is "
                    f"{self.embedded.certificate.verdict}: {self.embedded.certificate.claim}.")
        return ("Not certified: no proof of stability was found with its own scheduling variable moving freely in the "
                "clamped range. By itself the model may still be bounded; that is not decided. With na = 0 it would "
                "be bounded by construction.")

    def to_dict(self) -> dict:
        """stability.json.

        Returns
        -------
        dict
            Plain values by name.
        """
        box = self.model.box
        data = {"schema": "lpvid/stability/1", "verdict": self.verdict, "certified": self.certified,
                "covers": self.why, "output_bounds": [{"inputs_within": a, "output_within": b} for a, b in self.bounds]}
        if self.embedded is not None:
            return {**self.embedded.to_dict(), **data}
        certificate = {"kind": "by construction", "rate_bound": dict.fromkeys(box.names), "verified": True,
                       "margin": None, "between_grid": True, "claim": self.why}
        return {**data, "range": {n: [low, high] for n, low, high in zip(box.names, box.lower, box.upper, strict=True)},
                "units": dict(zip(box.names, box.units, strict=True)),
                "frozen": {"stable": True, "max_modulus": None, "at": {}}, "critical": [], "probability": None,
                "certificate": certificate, "notes": []}

    def __str__(self) -> str:
        lines = [f"Stability: {self.verdict}"]
        lines += [f"  {row[0]}: {row[1]}" for row in self.rows()]
        if self.embedded is not None:
            lines += [f"  embedding: {line.strip()}" for line in str(self.embedded).splitlines()]
        return "\n".join(lines)

    def rows(self) -> list[tuple[str, str]]:
        """The bounds in words.

        Returns
        -------
        list of (str, str)
            Amplitude of the inputs and bound of the output, with units; empty where nothing is bounded.
        """
        units = {s.unit or "1" for s in _bounded_inputs(self.model)}
        unit = units.pop() if len(units) == 1 else "SI"
        names = ", ".join(s.name for s in _bounded_inputs(self.model))
        return [(f"|{names}| ≤ {number(a)} {unit}", f"|{self.model.outputs[0].name}| ≤ "
                 f"{number(b, 4, self.model.outputs[0].unit)}") for a, b in self.bounds]


def study_self_scheduled(model: SelfScheduled, *, rate: float | Mapping[str, float | None] | None = None,
                         range: Mapping[str, tuple[float, float]] | None = None, seed: int = 0,
                         report_progress: Callable[[str], None] = lambda text: None) -> SelfScheduledStudy:
    """What is proven of a model that schedules itself.

    Parameters
    ----------
    model : QuasiLPVModel or ComplianceModel
    rate, range, seed, report_progress
        As for `study_stability`; they concern the measured scheduling variables, the model's own is free.

    Returns
    -------
    SelfScheduledStudy
    """
    ranged = model if not range else model.replace(box=narrowed(model.box, range))
    if isinstance(ranged, QuasiLPVModel) and ranged.na:
        measured = rate if isinstance(rate, Mapping) else dict.fromkeys(ranged.box.names, rate)
        embedded = study_stability(
            ranged.embedding(), rate={**measured, "rho": None}, seed=seed, report_progress=report_progress
        )
        return SelfScheduledStudy(ranged, embedded, _bounds(ranged) if embedded.certified else ())
    return SelfScheduledStudy(ranged, None, _bounds(ranged))


def self_scheduled_page(study: SelfScheduledStudy, name: str) -> Page:
    """A page about the stability of a model that schedules itself.

    Parameters
    ----------
    study : SelfScheduledStudy
    name : str
        What to call the model.

    Returns
    -------
    Page
    """
    sections = [Section("What this rests on", (Paragraph(f"{study.why[:1].upper()}{study.why[1:]}."),))]
    rows = study.rows()
    if rows:
        side = [s.name for s in study.model.inputs[1:]] if isinstance(study.model, ComplianceModel) else []
        besides = f" What {', '.join(side)} adds in parallel comes on top." if side else ""
        sections.append(
            Section(
                "Bounds",
                (
                    PageTable(
                        ("inputs", "output"),
                        tuple(rows),
                        f"What the output never exceeds, from rest, whatever the course of the inputs.{besides}",
                    ),
                ),
            )
        )
    if study.embedded is not None:
        inner = stability_page(study.embedded, name)
        sections += [Section(f"{s.title}, own scheduling free", s.items) for s in inner.sections]
    sections.append(Section("The model itself", (Paragraph(repr(study.model)),)))
    return Page(f"Stability of {name}", study.verdict, study.mark, tuple(rows), (), tuple(sections))


def _bounded_inputs(model: SelfScheduled) -> tuple:
    return model.inputs[:1] if isinstance(model, ComplianceModel) else model.inputs


def _bounds(model: SelfScheduled) -> tuple[tuple[float, float], ...]:
    """What the output never exceeds for inputs within the amplitudes; those that cannot be determined are left out."""
    found = []
    for amplitude in AMPLITUDES:
        if isinstance(model, ComplianceModel):
            parallel = float(np.abs(model.direct).sum()) * amplitude + abs(model.offset)
            bound = model.force_bound(amplitude) + parallel
        else:
            assert isinstance(model, QuasiLPVModel)
            bound = model.output_bound(amplitude)
        if np.isfinite(bound):
            found.append((amplitude, bound))
    return tuple(found)
