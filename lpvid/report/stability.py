"""The stability report: frozen poles, critical values, probability, and the certificate for a moving scheduling."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid import _checks, plot
from lpvid._shown import Shown
from lpvid.analysis.certificates import Rate, certify_stability
from lpvid.analysis.frozen import CAVEAT, Model
from lpvid.analysis.frozen_stability import FrozenStability, frozen_stability
from lpvid.analysis.pole_locus import PoleLocus, pole_locus
from lpvid.analysis.stability_certificate import StabilityCertificate
from lpvid.analysis.uncertainty import PoleBand, StabilityProbability, pole_band, stability_probability
from lpvid.identification.layout import ParameterCloud
from lpvid.model.hull import KEY, Hull, design_hull
from lpvid.model.quasi import SelfScheduled
from lpvid.report.formatting import number, percent
from lpvid.report.page import OUT, Item, Mark, NextStep, Notes, Page, PageFigure, PageTable, Paragraph, Section
from lpvid.report.stability_reach import (
    NOTHING,
    UNCONSTRAINED,
    Questions,
    StabilityAnswers,
    is_constrained,
    reach,
)
from lpvid.scheduling import Scheduling

DRAWS = 300
"""Models drawn from the parameter covariance where no number of draws is requested."""
MOST_LOCI = 4
BECOMES = {"to-stable": "becomes stable", "to-unstable": "becomes unstable", "touching": "touches the limit"}
CROSSES = {"complex": "a complex pair", "zero": "0", "imaginary": "an imaginary pair"}
"""words for the direction and the crossing of a critical value"""
FREE_RUN = ("oe", "state-space-error", "quasi-lpv", "compliance", "right-coprime")
"""kinds of structure whose estimate minimises the free-run error, unless it has an observer gain"""
WARNING = ("Frozen stability holds every scheduling value still. It does not cover a moving scheduling variable, "
           "unless a certificate states so.")


@dataclass(frozen=True, eq=False)
class StabilityStudy(Shown):
    """Everything the stability report states about one model.

    Attributes
    ----------
    model : LPVTransferFunction or LPVStateSpace
        With the range requested as its box.
    frozen : FrozenStability
    certificate : StabilityCertificate
    probability : StabilityProbability or None
        None when the parameters' covariance is not known.
    loci : tuple of (PoleLocus, PoleBand or None)
        One for each scheduling variable, at most four.
    reach : Reach
        How far the statement reaches, as far as that was requested.
    caution : str
        Why there is no probability although the model carries a covariance, or what it is worth; empty for neither.
    """

    model: Model
    frozen: FrozenStability
    certificate: StabilityCertificate
    probability: StabilityProbability | None
    loci: tuple[tuple[PoleLocus, PoleBand | None], ...]
    reach: StabilityAnswers = NOTHING
    caution: str = ""

    @property
    def hull(self) -> Hull | None:
        """The polytope examined, for which a controller or closed loop was designed; None for the box."""
        return self.frozen.hull

    @property
    def span(self) -> str:
        """The set examined: "range" or "hull of the design"."""
        return "range" if self.hull is None else "hull of the design"

    @property
    def certified(self) -> bool:
        """Frozen-stable, and proven for the moving scheduling variable in question.

        The poles decide of a model without scheduling: where no Lyapunov function was found it is stable all the same.
        """
        return self.frozen.stable and (self.certificate.verified or not self.model.box.names)

    @property
    def mark(self) -> Mark:
        """Colour of the verdict."""
        if not self.frozen.stable:
            return "bad"
        if not self.model.box.names:
            return "good"
        return "good" if self.certificate.verified and self.certificate.between_grid else "warn"

    @property
    def verdict(self) -> str:
        """One or two sentences."""
        if not self.model.box.names:
            return "Stable: all poles decay." if self.certified else "NOT stable: a pole does not decay."
        if not self.frozen.stable:
            where = ", ".join(f"{n} = {number(v)}" for n, v in self.frozen.at.items())
            return f"NOT stable: even with the scheduling held still, the model is unstable at {where}."
        if self.certificate.verified:
            return f"Stable, and {self.certificate.verdict}: {self.certificate.claim}."
        if self.certificate.divergence is not None:
            return (f"Stable only while the scheduling is constant: the model {self.certificate.divergence} when it "
                    f"moves within the {self.span}.")
        return (f"Frozen-stable over the {self.span}, but not certified for a moving scheduling variable: no proof and "
                "no counterexample was found.")

    @property
    def ends(self) -> dict[str, tuple[float, float]]:
        """Between which values each variable moves along its line of critical values, in its unit."""
        return {c.line.label: (c.line.low, c.line.high) for c in self.frozen.critical.lines}

    def to_dict(self) -> dict:
        """stability.json.

        Returns
        -------
        dict
            Plain values by name.
        """
        box, critical = self.model.box, self.frozen.critical
        return {"schema": "lpvid/stability/1", "verdict": self.verdict, "certified": self.certified,
                "range": {n: [low, high] for n, low, high in zip(box.names, box.lower, box.upper, strict=True)},
                "units": dict(zip(box.names, box.units, strict=True)), "hull": _of_hull(self.hull),
                "frozen": self.frozen.to_dict(), "critical": [v.to_dict() for v in critical.values],
                "stable_intervals": critical.to_dict()["stable_intervals"], "critical_exact": critical.exact,
                "probability": None if self.probability is None else self.probability.to_dict(),
                "certificate": self.certificate.to_dict(), **self.reach.to_dict(), "caveat": CAVEAT,
                "notes": [*critical.notes, *_locus_notes([found for found, _ in self.loci]),
                          *([self.caution] if self.caution else [])]}

    def __str__(self) -> str:
        lines = [f"Stability: {self.verdict}"]
        if self.hull is not None:
            lines.append(f"  examined: {self.hull.text}, for which this loop or controller was designed, not the box")
        if self.frozen.max_modulus is not None:
            at = ", ".join(f"{n} = {number(v)}" for n, v in self.frozen.at.items())
            size = _modulus(self.frozen.max_modulus)
            lines.append(f"  frozen: largest pole modulus {size}" + (f" at {at}" if at else ""))
        box = self.ends
        for v in self.frozen.critical.values:
            low, high = box.get(v.variable, (-np.inf, np.inf))
            lines.append(f"  {v}" + ("" if low <= v.value <= high else f", outside the {self.span}"))
        if self.model.box.names and not self.frozen.critical.values:
            lines.append("  no scheduling value on the whole real line changes the stability of the frozen model")
        if self.probability is not None:
            lines.append("  " + str(self.probability).splitlines()[0])
        if self.caution:
            lines.append(f"  note: {self.caution}")
        if self.certificate.verified:
            lines += [f"  certificate: {line.strip()}" for line in repr(self.certificate).splitlines()[1:]]
        lines += [f"  {line}" for line in self.reach.lines()]
        if self.model.box.names:
            lines.append(f"  {WARNING}")
        return "\n".join(lines)


def study_stability(model: Model, *, rate: Rate = None, range: Mapping[str, tuple[float, float]] | None = None,
                    seed: int = 0, questions: Questions | None = None,
                    report_progress: Callable[[str], None] = lambda text: None) -> StabilityStudy:
    """Frozen stability, critical values, probability and certificate of one model.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
    rate
        As for `certify_stability`.
    range : mapping of name to (low, high), optional
        Range of each scheduling variable, instead of the model's box, or of the hull for which it was designed.
    seed : int
        Seed of the draws from the parameter covariance.
    questions : Questions, optional
        What else to look for.
    report_progress : callable
        Receives what is being done.

    Returns
    -------
    StabilityStudy
    """
    report_progress("looking for a certificate")
    ranged = model if not range else model.replace(
        scheduling=narrowed(model.box, range), metadata={k: v for k, v in model.metadata.items() if k != KEY})
    certificate = certify_stability(ranged, rate=rate)
    report_progress("frozen poles and critical values")
    frozen = frozen_stability(ranged)
    drawn = _drawn(ranged, seed, questions.draws if questions is not None and questions.draws else DRAWS)
    report_progress("poles of models drawn from the parameters' covariance")
    probability = stability_probability(drawn) if drawn else None
    further = reach(ranged, certificate, rate, questions, seed, report_progress) if questions is not None else NOTHING
    if rate is not None and not ranged.box.names:
        further = replace(further, notes=(*further.notes, "the rate has no effect: nothing schedules this model"))
    return StabilityStudy(ranged, frozen, certificate, probability, loci(ranged, drawn), further,
                          _caution(ranged, frozen, probability))


def loci(model: Model, drawn: list[Model] | None) -> tuple[tuple[PoleLocus, PoleBand | None], ...]:
    """A locus with its band along each scheduling variable that moves, the others in the middle of the box.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        With the range of interest as its box.
    drawn : list of models or None
        From the covariance of its parameters; None or empty for no bands.

    Returns
    -------
    tuple of (PoleLocus, PoleBand or None)
        At most `MOST_LOCI`, in the order of the box.
    """
    found = []
    for name, low, high in zip(model.box.names, model.box.lower, model.box.upper, strict=True):
        if low < high and len(found) < MOST_LOCI:
            found.append((pole_locus(model, name), pole_band(drawn, name) if drawn else None))
    return tuple(found)


def _locus_notes(found: Sequence[PoleLocus]) -> list[str]:
    """Notes of the loci, with the variable along which they hold where there are several."""
    if len(found) == 1:
        return list(found[0].notes)
    return [f"along {locus.variable}: {note}" for locus in found for note in locus.notes]


def locus_items(model: Model | SelfScheduled) -> list[Item]:
    """Figures of the frozen poles, for other reports; none for a model that schedules itself.

    Parameters
    ----------
    model : LPVTransferFunction, LPVStateSpace, QuasiLPVModel or ComplianceModel
        One without scheduling has its poles in a single figure.

    Returns
    -------
    list of Item
        One figure per scheduling variable that moves.
    """
    if isinstance(model, SelfScheduled):
        return []  # its poles follow from its own output: see the stability report
    if not model.box.names:
        return [PageFigure.of(plot.poles(model.frozen_poles([]), model.sample_time is not None), "Poles of the model.")]
    drawn = _drawn(model, 0)
    return [_locus_figure(found, band, model) for found, band in loci(model, drawn)]


def stability_page(study: StabilityStudy, name: str) -> Page:
    """A page about the stability of a model.

    Parameters
    ----------
    study : StabilityStudy
    name : str
        What to call the model.

    Returns
    -------
    Page
    """
    figures: list[Item] = [_locus_figure(found, band, study) for found, band in study.loci]
    figures = figures or locus_items(study.model)
    notes = tuple(study.to_dict()["notes"])
    sections = [Section("Frozen poles", (*figures, *([Notes(notes)] if notes else []))),
                Section("Critical values", tuple(_critical(study))),
                Section("While the scheduling moves", tuple(_certificate(study))),
                Section("The model", (Paragraph(repr(study.model)),))]
    if not study.model.box.names:
        sections = [sections[0], sections[3]]
    if study.reach.items():
        sections.insert(-1, Section("How far it reaches", tuple(study.reach.items())))
    return Page(f"Stability of {name}", study.verdict, study.mark, _facts(study),
                (*_uncertainty(study), *((WARNING,) if study.model.box.names else ())), tuple(sections),
                _steps(study, name))


def _uncertainty(study: StabilityStudy) -> tuple[str, ...]:
    """That the verdict is one of the estimate, where some of the models that the data allow are unstable."""
    found = study.probability
    if found is None or not study.frozen.stable or found.probability >= 1:
        return ()
    return (f"The verdict is that of the estimate: of the models drawn from the covariance of its parameters "
            f"{percent(1 - found.probability)} have a frozen pole beyond the limit.",)


def _steps(study: StabilityStudy, name: str) -> tuple[NextStep, ...]:
    """What would settle what is open, and what to do with a proof."""
    if not study.frozen.stable:
        return (
            *((NextStep("Keep the scheduling out of where the frozen model is unstable, and see whether the rest is "
                        "stable.", f"lpvid stability {name} --range LOW:HIGH --out narrower"),)
              if study.model.box.names else ()),
            NextStep("Try a lower order or degree, or --passive for a damper." if fits_free_run(study.model) else
                     "Fit the free run itself, which an unstable model cannot follow: lpvid identify --structure oe, "
                     "or --passive for a damper."),
        )
    if study.certificate.verified:
        again = f"lpvid verify {OUT}/certificate.json {name}"
        steps = [NextStep("Let anyone check the certificate without a solver.", again)]
        if study.hull is not None:
            faster = "" if study.certificate.kind == "quadratic" else " --largest-rate"  # one P covers any motion
            steps.append(NextStep("See how far it reaches: the hull of the design, scaled"
                                  + (", and the largest rate within it." if faster else "."),
                                  f"lpvid stability {name} --largest-range{faster} --out reach"))
        elif study.model.box.names:
            steps.append(NextStep("See how far it reaches: the largest range and the largest rate.",
                              f"lpvid stability {name} --largest-range --largest-rate --out reach"))
        return tuple(steps)
    if not study.model.box.names:
        return ()
    return (NextStep("State how fast the scheduling moves: a bounded rate is easier to certify.",
                 f"lpvid stability {name} --rate RATE --out bounded"),
            NextStep("Or ask for the largest range that is certified.",
                     f"lpvid stability {name} --largest-range --out reach"))



def fits_free_run(model: Model | SelfScheduled) -> bool:
    """Whether a model was already fitted by its free run, so that advice to do so is of no use.

    Parameters
    ----------
    model : LPVTransferFunction, LPVStateSpace, QuasiLPVModel or ComplianceModel

    Returns
    -------
    bool
        False where its file states no structure.
    """
    structure = model.metadata.get("structure", {})
    if not isinstance(structure, Mapping) or structure.get("noise") == "innovation":
        return False
    return structure.get("kind") in FREE_RUN or bool(structure.get("passive"))


def _modulus(value: float, digits: int = 6) -> str:
    """A largest modulus with so many digits that it shows on which side of 1 it lies."""
    shown = number(value, digits)
    if value == 1 or float(shown) != 1:
        return shown
    return f"1 {'−' if value < 1 else '+'} {abs(1 - value):.2g}"


def _facts(study: StabilityStudy) -> tuple[tuple[str, str], ...]:
    box, rows = study.model.box if study.hull is None else study.hull.enclosing(study.model.box), []
    if study.frozen.max_modulus is not None:
        rows.append(("largest frozen pole modulus", _modulus(study.frozen.max_modulus, 5)))
    for n, low, high, unit in zip(box.names, box.lower, box.upper, box.units, strict=True):
        rows.append((f"range of {n}", f"{number(low)} … {number(high)} {unit}".rstrip()))
    if study.hull is not None:
        rows.append(("examined, as designed for", study.hull.text))
    if study.probability is not None:
        rows.append(("probability of frozen stability", percent(study.probability.probability, 4)))
    if box.names:
        rows.append(("certificate", study.certificate.verdict))
    return tuple(rows)


def _critical(study: StabilityStudy) -> list[Item]:
    values = study.frozen.critical.values
    if not values:
        return [Paragraph("No scheduling value on the whole real line changes the stability of the frozen model.")]
    inside = study.ends
    rows, marks = [], []
    for v in values:
        low, high = inside.get(v.variable, (-np.inf, np.inf))
        within = low <= v.value <= high
        rows.append((v.variable, number(v.value, 6, v.unit), BECOMES[v.direction], CROSSES.get(v.crossing, v.crossing),
                     number(v.frequency_hz, 4, "Hz"), f"{'inside' if within else 'outside'} the {study.span}"))
        marks.append("bad" if within else "plain")
    exact = "from guardian maps, no grid" if study.frozen.critical.exact else "searched on a grid"
    heads = ("variable", "value", "for rising values", "pole crosses the limit at", "frequency", "where")
    return [PageTable(heads, tuple(rows),
                  f"Values at which the frozen model changes stability, over the whole real line ({exact}).",
                  (1, 4), tuple(marks))]


def _certificate(study: StabilityStudy) -> list[Item]:
    c = study.certificate
    speeds = ", ".join(f"{n} {'arbitrary' if r is None else number(r, 4, (u or '1') + '/s')}"
                       for n, r, u in zip(c.box.names, c.box.rate, c.box.units, strict=True))
    rows = [("verdict", c.verdict), ("claim", c.claim), ("kind", c.kind), ("rate of change allowed", speeds or "–"),
            ("margin", number(c.margin)), ("proven between grid points", "yes" if c.between_grid else "no"),
            *(() if study.hull is None else (("proven for", study.hull.text if c.vertices is not None else
                                              "the box around the hull" if c.verified else "–"),)),
            ("guaranteed decay", "–" if not c.time_constant else f"exp(−t/{number(c.time_constant, 4, 's')})")]
    items: list[Item] = [PageTable((), tuple(rows), "Re-checked with numpy alone, whatever the solver's status.")]
    if c.divergence is not None:
        items.append(Paragraph(f"Counterexample: the model {c.divergence}.", strong=True))
    return items


def _of_hull(hull: Hull | None) -> dict | None:
    """A hull by its vertices, for JSON."""
    return None if hull is None else {"names": list(hull.names), "vertices": hull.vertices().tolist()}


def _locus_figure(found: PoleLocus, band: PoleBand | None, subject: StabilityStudy | Model) -> PageFigure:
    study = subject if isinstance(subject, StabilityStudy) else None
    model = subject.model if isinstance(subject, StabilityStudy) else subject
    box, hull = model.box, design_hull(model)
    middle, span = (box.centre, "range") if hull is None else (hull.middle, "hull of the design")
    cloud = f"; grey, the poles of {band.draws} models drawn from the parameters' covariance" if band else ""
    held = ", ".join(f"{n} = {number(v, 4, u)}" for n, v, u in zip(box.names, middle.tolist(), box.units,
                                                                   strict=True) if n != found.variable)
    others = f" Held meanwhile: {held}, the middle of the {span}." if held else ""
    return PageFigure.of(plot.locus(found, band, None if study is None else study.frozen.critical),
                     f"Left: frozen poles over {found.variable}{cloud}. Right: the largest pole modulus over "
                     f"the {span}, with the stability limit.{others}",
                     f"Pole locus over {found.variable}")


def _drawn(model: Model, seed: int, draws: int = DRAWS) -> list[Model]:
    """Models from the normal law of the estimate; none where its covariance is unknown, none, or of another law."""
    cloud = ParameterCloud.of(model)
    return [] if cloud is None or cloud.fault or is_constrained(model) else list(
        cloud.draw(np.random.default_rng(seed), draws))


def _caution(model: Model, frozen: FrozenStability, found: StabilityProbability | None) -> str:
    """Why draws give no probability, or why it is worth little; empty for neither.

    The draws lie evenly about the estimate. Where the pole that limits stability changes in proportion to the
    parameters, at least half of them are then as stable as the estimate; where surely fewer are, the spread is wider
    than that proportion holds.
    """
    if is_constrained(model):
        return f"no probability of stability: {UNCONSTRAINED}"
    cloud = ParameterCloud.of(model)
    if cloud is not None and cloud.fault:
        return f"no probability of stability: {cloud.fault}, the data determine too few of the parameters together"
    if found is None or not frozen.stable or found.interval[1] >= 0.5:
        return ""
    return ("the estimate itself is stable, but its parameters are so uncertain that most models drawn are not: "
            "longer or richer data, or fewer parameters, would settle it")


def narrowed(box: Scheduling, range: Mapping[str, tuple[float, float]]) -> Scheduling:
    """The box with other ends for the variables named.

    Parameters
    ----------
    box : Scheduling
        Ranges of a model.
    range : mapping of str to (float, float)
        Low and high end, in the unit of the variable; it may also widen. What is not named keeps its own.

    Returns
    -------
    Scheduling
        With names, units and rates as before.

    Raises
    ------
    InputError
        A name that is no scheduling variable of the box.
    """
    for name in range:
        _checks.known_name(name, list(box.names), "scheduling variable")
    ends = [range.get(n, old) for n, old in zip(box.names, zip(box.lower, box.upper, strict=True), strict=True)]
    return replace(box, lower=tuple(e[0] for e in ends), upper=tuple(e[1] for e in ends))
