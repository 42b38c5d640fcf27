"""Report of `diagnose`: what is wrong, its cause, the gain, what the data leave open and what would settle it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lpvid.diagnosis.diagnosis import Cause, Diagnosis, Estimated, SetProbabilities
from lpvid.diagnosis.evidence.discrepancy import ACCEPTABLE_MISFIT
from lpvid.diagnosis.task import DiagnosisTask
from lpvid.effects.lpv_extension import LpvExtension
from lpvid.plot import diagnosis as draw
from lpvid.report.courses import signal_traces
from lpvid.report.formatting import number, percent
from lpvid.report.inspection import findings_table
from lpvid.report.page import OUT, Item, Mark, NextStep, Notes, Page, PageFigure, PageTable, Paragraph, Section, Traces
from lpvid.validation.residuals import probability
from lpvid.validation.trust import QUANTILE

SIGNIFICANT = 0.05
TINY = float(np.finfo(float).tiny)
"""p-values below underflow."""
_MARKS: dict[str, Mark] = {"explained": "good", "nothing-to-explain": "good", "partly-explained": "warn",
                           "cannot-tell": "warn", "unexplained": "bad"}
_HEADINGS = {"explained": "Explained", "nothing-to-explain": "Nothing to explain",
             "partly-explained": "Partly explained", "cannot-tell": "Cannot be decided from these data",
             "unexplained": "Unexplained"}
_ADVICE = {
    "explained": "Use the extended model in place of the baseline, or mend the cause and measure again.",
    "nothing-to-explain": "The baseline is as good as these data can show. A better one needs other data.",
    "partly-explained": "Use the extended model with care: a known part of the error is named, another part is not.",
    "cannot-tell": "Do not mend anything yet: run the experiment below, then diagnose its records.",
    "unexplained": "Do not add a component on this evidence: no known cause reproduces it, or none is probable enough.",
}
_REPEAT = ("Repeat the run. An error that the repeat does not show again is noise, and the baseline is as good as "
           "these data can show; one that it shows again has a cause which none of those known here explains.")
_RECORD_MORE = (" Error that repeats is no noise: record what else is the same in every run, such as a load, a "
                "temperature or the angle of a drive.")

PLAN = "experiment.toml"
"""File beside the page that holds the planned experiment; its description begins with this name."""


def diagnosis_page(found: Diagnosis, task: DiagnosisTask, lpv: LpvExtension | None = None,
                   experiment: Sequence[str] = ()) -> Page:
    """A page about a diagnosis.

    Parameters
    ----------
    found : Diagnosis
    task : DiagnosisTask
        Records and baseline.
    lpv : LpvExtension, optional
        The same causes in an LPV model.
    experiment : sequence of str
        The experiment that was planned, and what no run of the rig can separate, where a plan was wanted.

    Returns
    -------
    Page
    """
    shown = before_after(found, task)
    extended = found.extended is not None and bool(found.extended.effects)
    mark, advice = _MARKS[found.verdict], _ADVICE[found.verdict]
    if found.verdict == "nothing-to-explain" and found.noise_floor is None and \
            found.after.esr_held_out > ACCEPTABLE_MISFIT**2:  # much, and nothing shows that it is noise
        mark, advice = "warn", _REPEAT
    rms = found.after.rmse / np.sqrt(max(found.after.esr_held_out, TINY))
    if mark in ("bad", "warn") and found.noise.get("repeating", (0.0, 0.0))[0] > ACCEPTABLE_MISFIT * rms:
        advice += _RECORD_MORE
    sections = []
    if found.causes or found.rivals:
        sections.append(Section("The cause" if len(found.causes) < 2 else "The causes", tuple(_causes(found))))
    sections.append(Section("What the simulation gets wrong", tuple(_wrong(found, shown, extended))))
    if extended:
        sections.append(Section("Before and after", tuple(_gain(found, shown, lpv))))
    if found.weights is not None:
        sections.append(Section("Sets of causes", tuple(_sets(found.weights))))
    sections.append(Section("Candidates", tuple(_candidates(found))))
    sections.append(Section("What cannot be decided from these data", tuple(_cannot_tell(found))))
    sections.append(Section("The data", tuple(_data(found))))
    verdict = f"{_HEADINGS[found.verdict]}: {found.reason}."
    name = str(found.baseline.get("name", "a baseline"))
    return Page(f"Diagnosis of {name}", verdict, mark, _facts(found, extended), _caveats(found),
                tuple(sections), _steps(found, advice, experiment, extended))


def before_after(found: Diagnosis, task: DiagnosisTask) -> list[draw.BeforeAfter]:
    """The records with the free runs of the baseline and of the extended model, in the records' sense.

    Parameters
    ----------
    found : Diagnosis
        Its baseline's refitted parameters are used where it holds them.
    task : DiagnosisTask
        What was diagnosed, with its prepared records.

    Returns
    -------
    list of BeforeAfter
        Training records, then held-out ones; without an extended model its run is that of the baseline.
    """
    values = np.array([p["value"] for p in found.baseline.get("parameters", [])], dtype=float)
    baseline = task.baseline if found.extended is None else found.extended.composition.baseline
    baseline = baseline.with_vector(values) if values.size == baseline.vector.size else baseline
    listed = []
    for part, records in (("training", task.prepared.training), ("held-out", task.prepared.held_out)):
        for record in records:
            s = baseline.signals(record)
            before = baseline.core(baseline.vector)(s)
            after = before if found.extended is None else \
                found.extended.composition.free_run(s, found.extended.vector)
            s.cache.clear()  # what is cached refers to its signals, and would stay
            sign = baseline.polarity
            listed.append(draw.BeforeAfter(record.name, part, s.sample_time, dict(s.channels), sign * s.output,
                                           sign * before, sign * after, baseline.output, baseline.output_unit,
                                           {n: record.unit(n) for n in s.channels if record.has(n)}))
    return listed


# -- sections --------------------------------------------------------------------------------------------------------
def _facts(found: Diagnosis, extended: bool) -> tuple[tuple[str, str], ...]:
    part = found.before.part
    facts = [(f"free-run ESR, baseline, {part}", number(found.before.esr_held_out)),
             (f"free-run rmse, baseline, {part}", number(found.before.rmse, 4, found.unit))]
    if extended:
        facts += [(f"free-run ESR, extended, {part}", number(found.after.esr_held_out)),
                  (f"free-run rmse, extended, {part}", number(found.after.rmse, 4, found.unit)),
                  (f"free-run gain, {part}", f"{found.gain_percent:.1f} %")]
    facts.append(("noise level", number(found.noise_floor, 4, found.unit) if found.noise_floor is not None
                  else "not known"))
    return tuple(facts)


def _caveats(found: Diagnosis) -> tuple[str, ...]:
    stated = [f"{found.before.part.capitalize()} figures are on {found.held_out}."]
    if not found.complete:
        stated.insert(0, "The diagnosis was interrupted: no cause is named.")
    if found.noise_floor is None and found.causes:
        stated.append("Nothing in these data repeats, so that the noise level is not known and the share explained is "
                    "a bound.")
    if found.rivals:
        stated.append("The extended model contains one of several rivals that do equally well here: it simulates these "
                    "conditions, but does not show which rival is the cause.")
    if found.stand_ins:
        stated.append(f"The extended model also contains {', '.join(found.stand_ins)}. The error on data that the fit "
                      "has not seen is lower with it; as a cause it is too uncertain to be named.")
    return tuple(stated)


def _steps(found: Diagnosis, advice: str, experiment: Sequence[str], extended: bool) -> tuple[NextStep, ...]:
    """The advice, what would settle what is open, and the commands for both."""
    proposed = list(experiment) or [f"{' or '.join(r.names)}: {r.experiment}" for r in found.rivals]
    steps = [NextStep(advice)]
    for text in proposed:
        command = f"quartercar rig {OUT}/{PLAN} --out records" if text.startswith(PLAN) else ""
        steps.append(NextStep(f"{text.rstrip('.')}.", command))
    if extended:
        steps.append(NextStep("Judge the extended model on records that this diagnosis has not seen.",
                              f"lpvid validate {OUT}/extended_model.json NEW.csv --out checked"))
    return tuple(steps)


def _causes(found: Diagnosis) -> list[Item]:
    rows = [_cause_row(c) for c in found.causes]
    items: list[Item] = []
    if rows:
        items.append(Notes(tuple(f"{c.name}: {c.description}." for c in found.causes)))
        items.append(PageTable(("cause", "parameter", "value", "95 % interval", "p", "ΔBIC", "held-out gain",
                            "share alone", "share beside the others"), tuple(r for one in rows for r in one),
                           "Shares are of the baseline's excess squared error.", (2, 4, 5, 6, 7, 8),
                           ("good",) * sum(map(len, rows))))
    if found.explained_share is not None and found.causes:
        items.append(Paragraph(_share(found)))
    if found.rivals:
        described = [(" / ".join(r.names), number(r.similarity, 3),
                 "; ".join(f"{n}: {', '.join(map(_plain, p))}" for n, p in r.parameters.items()), r.experiment)
                for r in found.rivals]
        heads = ("cannot be distinguished", "weight of the others", "parameters, each taken alone",
                 "what separates them")
        items.append(PageTable(heads, tuple(described), "", (1,), ("warn",) * len(described)))
    return items


def _sets(weights: SetProbabilities) -> list[Item]:
    """Visited sets and families with their probabilities, and what the law itself leaves."""
    sets = tuple((", ".join(s.names) or "none", number(s.probability, 3),
                  "–" if s.held_out_esr is None else number(s.held_out_esr)) for s in weights.sets)
    families = tuple((n, number(p, 3)) for n, p in weights.families.items())
    return [PageTable(("set of causes", "weight", "free-run ESR, held-out"), sets, "Among the sets that were looked "
                      "at. A weight ranks sets by their evidence. It does not state how often such a set is right.",
                      (1, 2)),
            PageTable(("family", "probability that one of it is there"), families, "", (1,)),
            Paragraph(f"What the inputs still predict of the error is {percent(weights.discrepancy)} of the output, "
                      f"most of it: {weights.where}. Every real law leaves one to three per cent.")]


def _share(found: Diagnosis) -> str:
    assert found.explained_share is not None
    who = "the causes, with what else the extended model contains, explain" if found.stand_ins else "they explain"
    value, std = found.explained_share
    if found.noise_floor is None:
        return (f"Of the error that follows the inputs at all, {who} {percent(min(value, 1.0))}. Nothing "
                "repeats in these data, so that noise is what no regression on the inputs predicts.")
    return f"Of the error beyond the noise level, {who} {percent(value)} ± {percent(std)}."


def _cause_row(c: Cause) -> list[tuple[str, ...]]:
    rows = []
    for k, p in enumerate(c.parameters):
        end = f"at its {p.bound} bound" if p.bound else "at a bound"
        interval = "a choice" if p.choice is not None else "held" if p.held else end if p.std is None else \
            f"{number(p.value - QUANTILE * p.std)} … {number(p.value + QUANTILE * p.std)}"
        head = (c.name,) if k == 0 else ("",)
        tail = (_p_text(c.p_value), number(c.delta_bic, 3), f"{c.held_out_gain:.1f} %", percent(c.share_alone),
                percent(c.share_given_others)) if k == 0 else ("",) * 5
        rows.append((*head, p.name, p.choice or number(p.value, 4, p.unit), interval, *tail))
    return rows


def _p_text(p: float | None) -> str:
    """A p-value; below what double precision resolves a bound, never 0.

    Examples
    --------
    >>> _p_text(0.0), _p_text(0.0123), _p_text(None)
    ('< 2.2e-308', '0.012', '–')
    """
    return "–" if p is None else probability(p).removeprefix("p ") if p < TINY else number(p, 2)


def _plain(p: Estimated) -> str:
    return f"{p.name} {p.choice or number(p.value, 3, p.unit)}"


def _wrong(found: Diagnosis, shown: Sequence[draw.BeforeAfter], extended: bool) -> list[Item]:
    rows = tuple((w.where, percent(w.share), percent(w.time), number(w.share / max(w.time, 1e-9), 3))
                 for w in found.wrong)
    items: list[Item] = []
    if rows:
        items.append(PageTable(("where", "share of the squared error", "share of the data", "ratio"), rows,
                           "Regimes that hold more of the baseline's error than of the data; frequency bands and "
                           "lines, than of the output's power.", (1, 2, 3)))
    else:
        items.append(Paragraph("The error is spread evenly: no regime stands out."))
    maps = draw.error_maps(shown, extended)
    if maps is not None:
        items.append(
            PageFigure.of(
                maps,
                f"Root mean square error of the free run{_parts(shown)} by regime; empty cells were not visited. "
                "Both columns share one scale.",
            )
        )
    shapes = draw.error_shapes(shown, extended)
    if shapes is not None:
        items.append(PageFigure.of(shapes, f"Mean error of the free run{_parts(shown)} over each input, with the band "
                                   "of its middle half: the shape of what the simulation lacks."))
    items.append(PageFigure.of(draw.error_courses(shown, found.noise_floor, extended),
                               f"The error of the free run{_parts(shown)} over time and over frequency."))
    return items


def _parts(shown: Sequence[draw.BeforeAfter]) -> str:
    """On which data the records shown are, for a caption."""
    return f", {' and '.join(dict.fromkeys(s.label for s in shown))} data,"


def _gain(found: Diagnosis, shown: Sequence[draw.BeforeAfter], lpv: LpvExtension | None) -> list[Item]:
    rows = [(name, number(e.esr_training), number(e.esr_held_out) if e.part == "held-out" else "–",
             number(e.rmse, 4, found.unit), gain) for name, e, gain in (
                 ("baseline", found.before, "–"), ("extended model", found.after, f"{found.gain_percent:.1f} %"))]
    head = ("model", "ESR, training", "ESR, held-out", f"rmse, {found.after.part}", "gain")
    items: list[Item] = [PageTable(head, tuple(rows),
                               f"Free run; rmse and gain on {found.held_out}.", (1, 2, 3, 4), ("plain", "good"))]
    if lpv is not None:
        items.append(_lpv_table(lpv))
    drawn = draw.loops(shown, True)
    if drawn is not None:
        items.append(PageFigure.of(drawn, f"Measured output and free runs{_parts(shown)} over velocity."))
    items.append(_before_after_traces(shown))
    return items


def _before_after_traces(shown: Sequence[draw.BeforeAfter]) -> Traces:
    """Measured output, baseline and extended model over the record on which the baseline is most wrong."""
    worst = draw.most_wrong(shown)
    unit = worst.unit or "1"
    runs = {"measured": worst.measured, "baseline": worst.before, "extended model": worst.after}
    errors = {n: worst.measured - runs[n] for n in ("baseline", "extended model")}
    moving = {(stated := worst.axis_label(n)): {stated.partition(" [")[0]: v} for n, v in worst.channels.items()
              if n in ("velocity", "current")}
    return signal_traces(worst.times, {f"{worst.output} [{unit}]": runs, f"error [{unit}]": errors, **moving},
                         f"{worst.name}, {worst.label}: the record on which the baseline is most wrong, free run.")


def _lpv_table(lpv: LpvExtension) -> PageTable:
    rows = []
    for stated, found in (("LPV model without the cause", lpv.base), ("LPV model with it", lpv.extended)):
        assert found.training is not None and found.held_out is not None
        runs = (found.training.overall.free_run, found.held_out.overall.free_run)
        gain = lpv.gain_percent if found is lpv.extended else None
        rows.append((stated, str(found.n_parameters), number(runs[0].esr), number(runs[1].esr),
                     number(runs[1].rmse, 4, runs[1].rmse_unit), "–" if gain is None else f"{gain:.1f} %"))
    return PageTable(("model", "parameters", "ESR, training", "ESR, held-out", "rmse, held-out", "gain"), tuple(rows),
                 "The same in black box: an identified LPV model, then one with "
                 + ("; ".join(lpv.changes) or "nothing added")
                 + (f" (not taken in: {'; '.join(lpv.left_out)})" if lpv.left_out else "")
                 + ". Free run on records or last thirds that its fit has not seen.", (1, 2, 3, 4, 5))


def _candidates(found: Diagnosis) -> list[Item]:
    named, rivals = {n for c in found.causes for n in (c.name, c.form)}, {n for r in found.rivals for n in r.names}
    refused = {r.name for r in found.rejected}

    def fate(name: str, p: float) -> str:
        if name in named:
            return "named"
        if name in rivals:
            return "rival"
        return "rejected" if name in refused else "not needed" if p < SIGNIFICANT else "within noise"

    rows = [(n, float(e["likelihood_ratio"] or 0.0), fate(n, float(e["p_value"]))) for n, e in found.evidence.items()]
    drawn = draw.suspects(rows)
    if drawn is None:
        return [Paragraph("No candidate was tested.")]
    items: list[Item] = [
        PageFigure.of(
            drawn,
            "Every candidate by itself. Not needed: alone it explains a part of the error, "
            "but none beyond the named causes.",
        ),
        PageTable(
            ("candidate", "likelihood ratio", "p", "smallest detectable strength", "what became of it"),
            tuple(
                (
                    n,
                    number(r, 4),
                    _p_text(found.evidence[n]["p_value"]),
                    number(found.evidence[n]["smallest_detectable"], 3),
                    f,
                )
                for n, r, f in sorted(rows, key=lambda r: -r[1])
            ),
            "",
            (1, 2, 3),
            folded="All candidates in numbers",
        ),
    ]
    if found.rejected:
        items.append(PageTable(("looked at and not named", "why"), tuple((r.name, r.why) for r in found.rejected)))
    return items


def _cannot_tell(found: Diagnosis) -> list[Item]:
    if not found.cannot_tell:
        return [Paragraph("Every candidate of a plausible size would have shown.")]
    looked = [c for c in found.cannot_tell if c.name in found.evidence]
    items: list[Item] = []
    if looked:
        rows = tuple((c.name, c.reason, number(c.smallest_detectable, 3, c.unit), c.experiment) for c in looked)
        items.append(PageTable(("candidate", "why not", "smallest detectable", "what would settle it"), rows,
                           "None of these is excluded: these data carry no information on them.", (2,)))
    reasons = dict.fromkeys(c.reason for c in found.cannot_tell if c not in looked)
    if reasons:
        table = tuple((", ".join(c.name for c in found.cannot_tell if c.reason == r and c not in looked), r)
                      for r in reasons)
        items.append(PageTable(("not tested", "why"), table, "These could not be composed with this baseline on these "
                           "data."))
    return items


def _data(found: Diagnosis) -> list[Item]:
    noise, stated = found.noise, []
    if noise:
        low, high = noise.get("repeating", (0.0, 0.0))
        repeats = f"; an error of {number(low, 3)} to {number(high, 3, found.unit)} repeats" if high > 0 else ""
        weighed = "; its spectrum weighs the errors of the search" if noise.get("weighed") else ""
        stated = [f"Noise: {str(noise.get('name', '')).replace('-', ' ')}, {noise.get('from_repeats', '')}{repeats}"
                  f"{weighed}."]
    parameters = found.baseline.get("parameters", [])
    items: list[Item] = [Notes((*stated, *found.notes, f"{found.seconds:.1f} s of computing."))]
    if parameters:
        items.append(PageTable(("parameter of the baseline", "value"),
                           tuple((p["name"], number(p["value"], 5, p["unit"])) for p in parameters), "", (1,),
                           folded=f"Parameters of {found.baseline.get('name')}"))
    if found.audit is not None:
        items.append(findings_table(found.audit))
    return items
