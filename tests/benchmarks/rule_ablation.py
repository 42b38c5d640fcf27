"""What every rule of the verdict earns: the same searches, concluded with one rule less at a time.

    python tests/benchmarks/rule_ablation.py OUT --own 200 --foreign 60 --removed 30 --seed 5 [--shard 0/2]
    python tests/benchmarks/rule_ablation.py OUT --measured DATA [--siblings | --draw SEED] [--shard 0/2]
    python tests/benchmarks/rule_ablation.py OUT [OUT ...] --table [--without RULE ...]

A rule is a line of the program's own text that is replaced (`RULES`); a text that is no longer there ends the run. The
search is the same for all, so that what a rule does while sets are visited is not seen. Cases are those of the
calibration of both rigs, foreign ones also with the true cause left out (`removed`), and measured records with what
their group holds out. A row, a line of JSON in OUT/ablation-*.jsonl, is not computed twice; it has every answer that
differs from the one with all rules.

Marks of a case: right, where a cause that is there is named (measured: as in `real_causes`; removed: where none is, or
only causes of the true one's family); wrong, where one is named that is not there. The table has the cases by which
each count changes without the rule.
"""

from __future__ import annotations

import argparse
import inspect
import sys
import tempfile
import textwrap
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

import diagnosis_calibration as calibration  # first: it puts the helpers on the path
import numpy as np
import real_answers
import real_causes
import real_records
from foreign_scoreboard import stated
from helpers import hidden_score
from helpers.foreign_rig import cases
from rows import append, read

from lpvid.diagnosis.diagnosis import Diagnosis
from lpvid.diagnosis.evidence import engine, members, outcome, rivals, selection, visited, weighed_sets
from lpvid.diagnosis.evidence.calibration import Support
from lpvid.diagnosis.evidence.laplace import EvaluatedSet
from quartercar.effects import CATALOGUE

Row = dict
ALL = "all rules"

RULES: dict[str, tuple[tuple[Any, str, str, str], ...]] = {
    # what is named
    ".5 % of the output": ((selection, "_ablated", "< NAMED_CHANGE", "< 0"),),
    "zero outside its interval": ((members.SelectedSet, "_unresolved",
                                   "not abs(fit.vector[at] - e.parameters[0].neutral) < error", "True"),),
    "every member lowers the error out of fold": (
        (selection, "_ablated", "if _gains(search.problem, ablation, after).sum() <= 0 or", "if"),),
    "calibrated probability": ((Support, "probability", "LIMIT / (1 + np.exp(-SLOPE * self.compressed))",
                                "self.weight"),),
    # rivals
    "rivals by the error alone": ((rivals, "rivals_beside", "_equally_likely(search, sets, best, effect)", "()"),),
    "sensors' noise in lags": ((rivals, "_equally_likely", "if other.path in LAGGING else _cost",
                                "if False else _cost"),),
    "what contains it is no rival": ((rivals, "_equally_likely", "_contains(w, other, {effect.name, component})",
                                      "False"),),
    "rivals are related": ((rivals, "_equally_likely", "not related(effect, other)", "False"),),
    "what a form describes": ((rivals, "rivals_beside", "if name == effect.name and", "if False and"),),
    "alternatives": ((rivals, "rivals_beside", "else _alternatives(sets, best, effect, match)", "else ()"),),
    "alternatives of the family": ((rivals, "_alternatives", "[k for k in of_family", "[k for k in ()"),),
    "a simpler name unless the error contradicts": (
        (rivals, "name_in", "if simpler is not None and not certain:", "if False:"),),
    "components for forms": ((rivals, "reported_name", "if form.probability < NAMED_PROBABILITY <= whole.probability:",
                              "if False:"),),
    # sets
    "median probability model": ((weighed_sets, "reported_set", "components = median if median and median in weights",
                                  "components = frozenset(sets[0][0].components) if True"),),
    "weight of a set that fails goes to a smaller one": (
        (weighed_sets, "confirmed_sets", "next(within, None)", "None"),),
    "nearly as probable, less error": ((selection, "_better_predicting", "return sorted(better",
                                        "return [] and sorted(better"),),
    "it keeps the names": ((members, "keeps_names", "return all(", "return True or all("),),
    "held-out error lower": ((outcome.EvidenceOutcome, "predicts", "return extended", "return True or extended"),),
    "sign-flip test": ((outcome.EvidenceOutcome, "significant", "return min(", "return True or min("),),
    "no strength at its bound": ((EvaluatedSet, "evidence", "-np.inf if self.at_bounds", "-np.inf if False"),),
    "averaged over α": ((visited, "posterior", "sets.kappas or (sets.kappa,)", "(sets.kappa,)"),),
    "α over a factor of four": ((visited, "posterior", "sets.kappas or (sets.kappa,)",
                                 "sets.kappas[1:4] or (sets.kappa,)"),),
    "prior of the error left": ((visited.VisitedSets, "evidence", "w.evidence(kappa) + misfit_prior(",
                                 "w.evidence(kappa) + 0 * misfit_prior("),),
}
"""A rule, and what is replaced in which function of a module or class to be without it."""


# -- without a rule ---------------------------------------------------------------------------------------------------
@contextmanager
def without(rule: str) -> Iterator[None]:
    """The program without a rule."""
    with ExitStack() as stack:
        for owner, name, old, new in RULES.get(rule, ()):
            for place, function in _patched(owner, name, old, new):
                stack.enter_context(mock.patch.object(place, name, function))
        yield


def _patched(owner: Any, name: str, old: str, new: str) -> list[tuple[Any, Any]]:
    """The changed function, for its class, or for every module of the diagnosis that has it."""
    known = inspect.getattr_static(owner, name)
    is_property = isinstance(known, property)
    function = known.fget if is_property else known
    source = textwrap.dedent(inspect.getsource(function))
    source = source[source.index("def "):]
    if source.count(old) != 1:
        raise SystemExit(f"rule_ablation: {source.count(old)} times in {name} of {owner.__name__}: {old}")
    space: dict[str, Any] = {}
    exec(compile("from __future__ import annotations\n" + source.replace(old, new), f"<{name}>", "exec"),
         function.__globals__, space)
    changed = property(space[name]) if is_property else space[name]
    if inspect.isclass(owner):
        return [(owner, changed)]
    modules = [m for n, m in sys.modules.items() if n.startswith("lpvid.diagnosis")]
    return [(m, changed) for m in modules if getattr(m, name, None) is known]


@contextmanager
def remembered() -> Iterator[None]:
    """Refits, folds and errors of one search computed once for all rules."""
    refitted, on_all, screen = selection._refitted, selection.on_all_samples, engine.screen
    share = selection.predicted_share
    known: dict[Any, Any] = {}

    def once(key: Any, make: Callable[[], Any]) -> Any:
        if key not in known:
            known[key] = make()
        return known[key]

    def on_all_samples(search: Any, selected: Any, problem: Any) -> Any:
        fit = selected.fit.composition
        found = once(("all", id(search), fit.members), lambda: on_all(search, selected, problem))
        places = {e.name: p for e, p in zip(found.fit.composition.effects, found.fit.composition.places, strict=True)}
        return replace(selected, problem=found.problem, root=found.root, fit=found.fit, before=found.before,
                       after=found.after, members=tuple(replace(m, values=found.fit.vector[places[m.effect.name]])
                                                        for m in selected.members))

    with ExitStack() as stack:
        for place, name, new in (
                (selection, "_refitted", lambda search, composition, near, parallel: once(
                    ("fit", id(search), composition.members),
                    lambda: refitted(search, composition, near, parallel))),
                (engine, "on_all_samples", on_all_samples),
                (engine, "screen", lambda problem, *rest: once(("screen", id(problem)),
                                                               lambda: screen(problem, *rest))),
                (selection, "predicted_share", lambda problem, errors, channels: once(
                    ("share", id(problem), np.concatenate(errors).tobytes()),
                    lambda: share(problem, errors, channels)))):
            stack.enter_context(mock.patch.object(place, name, new))
        yield


def answers(diagnose: Callable[[], Any], rules: Sequence[str]) -> dict[str, Diagnosis]:
    """Diagnoses of one case by one search, with all rules and without each of some."""
    found: dict[str, Diagnosis] = {}
    concluded = engine.concluded

    def all_of(search: Any, *rest: Any) -> Diagnosis:
        with remembered():
            for rule in (ALL, *rules):
                with without(rule):
                    found[rule] = concluded(search, *rest)
        return found[ALL]

    with mock.patch.object(engine, "concluded", all_of):
        diagnose()
    return found


# -- cases ------------------------------------------------------------------------------------------------------------
def plain(answer: Diagnosis) -> Row:
    """What is marked of a diagnosis."""
    return {"verdict": answer.verdict, "named": [c.name for c in answer.causes],
            "rivals": [list(r.names) for r in answer.rivals], "after": answer.after.esr_held_out,
            "support": calibration.supports(answer),
            "parameters": {c.name: {p.name: p.value for p in c.parameters} for c in answer.causes}}


def variants(found: dict[str, Diagnosis]) -> Row:
    """The answer with all rules, and those that differ from it."""
    every = {rule: plain(a) for rule, a in found.items()}
    return {"variants": {r: a for r, a in every.items() if r == ALL or a != every[ALL]}, "rules": list(every)}


def own_case(seed: int, rules: Sequence[str]) -> Row:
    """A case of the own rig."""
    made, known = hidden_score.build(seed, CATALOGUE)
    baseline = hidden_score.baseline_for(made.plan, made.records)
    found = answers(lambda: engine.diagnose(made.records, baseline, CATALOGUE), rules)
    return made.plan.to_dict() | {"rig": "own", "separable": known.separable, "near": known.rivals,
                                  "likelihood": known.likelihood} | variants(found)


def foreign_case(seed: int, rules: Sequence[str], removed: bool = False) -> Row:
    """A case of the foreign rig; `removed`, a single cause whose component the catalogue lacks."""
    import lpvid as lpv

    plan = cases.draw(seed, duration=10.0, **({"kind": "single"} if removed else {}))
    known, record = calibration.foreign_record(plan)
    kinds = calibration.KINDS
    gone = {kinds.get(c, c) for c in plan.causes} if removed else set()
    catalogue = [e for e in CATALOGUE if kinds[e.name] not in gone]
    found = answers(lambda: lpv.diagnose(record, plan.baseline, catalogue, sample_rate=calibration.FOREIGN_RATE), rules)
    return plan.to_dict() | known | {"rig": "removed" if removed else "foreign"} | variants(found)


def measured_case(folder: Path, group: str, baseline: str, rules: Sequence[str]) -> Row:
    """Measured records, with what their group holds out."""
    import lpvid as lpv

    chosen = real_records.group(group)
    with tempfile.TemporaryDirectory() as cut:
        records, later = ([r for file in real_records.written(folder, parts, Path(cut) / kind) for r in lpv.read(file)]
                          for kind, parts in (("training", chosen.training), ("held_out", chosen.held_out)))
    rate = dict(zip(chosen.options[::2], chosen.options[1::2], strict=False)).get("--sample-rate")
    found = answers(lambda: lpv.diagnose(records, baseline, held_out=later,
                                         sample_rate=None if rate is None else float(rate)), rules)
    return {"rig": "measured", "kind": group, "law": baseline} | variants(found)


def run(options: argparse.Namespace) -> None:
    """The cases of this shard that have no row."""
    part, parts = map(int, options.shard.split("/"))
    (out,) = options.folder
    done = {r["id"] for r in read(out)}
    wanted: list[tuple[str, Callable[[], Row]]] = []
    if options.measured is not None:
        named = real_causes.cases(options.siblings, options.draw)
        wanted = [(f"measured-{g}/{b}", lambda g=g, b=b: measured_case(options.measured, g, b, options.without))
                  for g, b in named if g.partition("@")[0].partition(":")[0] != "car"
                  and real_answers.answer(real_records.group(g).of or g, b)]
    makers = (("foreign", foreign_case, options.foreign), ("own", own_case, options.own),
              ("removed", lambda *a: foreign_case(*a, True), options.removed))
    wanted += [(f"{rig}-{options.seed}-{n}", lambda m=make, n=n: m(options.seed * 100_000 + n, options.without))
               for rig, make, count in makers for n in range(count)]
    for name, make in wanted[part::parts]:
        if name in done:
            continue
        begun = time.process_time()
        try:
            row = make()
        except Exception as error:
            row = {"error": f"{type(error).__name__}: {error}"}
        row |= {"id": name, "cpu": round(time.process_time() - begun, 1)}
        print(name, row.get("kind"), row.get("causes"), row.get("error") or row["variants"][ALL]["named"],
              len(row.get("variants", ())) - 1, row["cpu"], flush=True)
        append(out / f"ablation-{part}.jsonl", row)


# -- table ------------------------------------------------------------------------------------------------------------
def marks(row: Row, rule: str) -> tuple[bool, bool]:
    """Whether a case is right, and whether it has a wrong name, without a rule."""
    answer = row["variants"].get(rule, row["variants"][ALL])
    if row["rig"] == "measured":
        of = real_records.group(row["kind"]).of or row["kind"]
        how = real_causes.mark({"outcome": "answered", **answer}, real_answers.answer(of, row["law"]))
        return how == "right", how == "wrong"
    if row["rig"] == "removed":
        (cause,) = row["causes"]
        named = [n for n in stated(row | answer) if n not in cases.BESIDES.get(cause, set())]
        family = {e.name: e.family for e in CATALOGUE}
        misnamed = bool(named) and not all(family[n] == family.get(cause) for n in named)
        return not misnamed, misnamed
    judged = [calibration.judged(calibration.kind(n), row) for n in answer["named"]]
    right = not any(j is False for j in judged) if not row["causes"] or row["kind"] == "outside" else True in judged
    return right, False in judged


def table(rows: list[Row], rules: Sequence[str]) -> str:
    """Markdown: a line per rule, with the change of right and of wrong cases, of every source, without it."""
    rows = [r for r in rows if "variants" in r]
    sources = [s for s in ("measured", "foreign", "own", "removed") if any(r["rig"] == s for r in rows)]
    groups = {s: [r for r in rows if r["rig"] == s] for s in sources}
    heads = [f"{s}, {len(g)}: right, wrong" for s, g in groups.items()]
    lines = [f"| without | {' | '.join(heads)} | answers changed | error of the extended model: ratio |",
             "|" + "---|" * (len(sources) + 3)]
    for rule in (ALL, *rules):
        cells = []
        for g in groups.values():
            before, after = (np.array([marks(r, k) for r in g], int) for k in (ALL, rule))
            total = after.sum(axis=0) if rule == ALL else (after - before).sum(axis=0)
            cells.append(", ".join(f"{v}" if rule == ALL else f"{v:+d}" for v in total))
        changed = [r for r in rows if rule in r["variants"] and rule != ALL]
        ratios = [r["variants"][rule]["after"] / r["variants"][ALL]["after"] for r in changed
                  if r["rig"] == "measured" and r["variants"][ALL]["after"] > 0]
        other = [q for q in ratios if abs(q - 1) > 0.01]
        text = f"{np.exp(np.mean(np.log(other))):.2f} on {len(other)}" if other else ""
        lines.append(f"| {rule} | {' | '.join(cells)} | {len(changed) or ''} | {text} |")
    return "\n".join(lines)


def main() -> None:
    """Run what is missing, then print the table."""
    parser = argparse.ArgumentParser(description="What every rule of the verdict earns.")
    parser.add_argument("folder", type=Path, nargs="+")
    for rig in ("own", "foreign", "removed"):
        parser.add_argument(f"--{rig}", type=int, default=0, metavar="CASES")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--measured", type=Path, metavar="DATA", help="measured records")
    parser.add_argument("--siblings", action="store_true", help="other records of the same specimens")
    parser.add_argument("--draw", type=int, metavar="SEED", help="parts of the same specimens drawn anew")
    parser.add_argument("--without", nargs="*", default=list(RULES), metavar="RULE", help="all of them by default")
    parser.add_argument("--shard", default="0/1")
    parser.add_argument("--table", action="store_true", help="print the table of the rows computed")
    options = parser.parse_args()
    for folder in options.folder:
        folder.mkdir(parents=True, exist_ok=True)
    if not options.table:
        run(options)
    print(table([row for folder in options.folder for row in read(folder)], options.without))


if __name__ == "__main__":
    main()
