"""Reliability of the probabilities: short blind cases of both rigs, and measured records with fair answers.

    python tests/benchmarks/diagnosis_calibration.py OUT --foreign 100 --own 100 --seed 3
    python tests/benchmarks/diagnosis_calibration.py OUT --measured DATA
    python tests/benchmarks/diagnosis_calibration.py OUT --table [--picture FILE.png] [--csv FILE.csv]
    python tests/benchmarks/diagnosis_calibration.py tests/benchmarks/claims --table

The last line reads the claims that are kept with the project, a file per engine, so that sessions add up.

A claim is a component of a weight of at least `LISTED` over the sets of the search, with its support and whether it is
present. Forms of one component are one: breakaway friction is dry friction, air in the oil a spring. Left out, as
neither right nor wrong, are components that a record has by construction (filters of the measurement chain; friction
and springs of the law itself; the spring of a Bouc-Wen damper behind Guo's law), components that these data cannot
distinguish from the hidden one (`near`), and the related and accepted parts of `real_answers`. Maps are
tested on cases that they were not fitted to: by ten-fold cross-validation, and with a map of one half of the cases on
the other; both rigs and the measured records have equal weight. Rows of `rule_ablation` are read too. Claims kept
before 1 December 2026 count what the foreign rig cannot distinguish from the hidden cause as absent. Seeds rotate: a
seed that was looked at once is a training seed.
"""

from __future__ import annotations

import argparse
import csv
import sys
import tempfile
import time
import zlib
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import foreign_scoreboard
import numpy as np
import real_answers
import real_records
from helpers import hidden_score
from helpers.foreign_rig import cases, truth
from helpers.hidden_score import BOUC_WEN, imitators
from helpers.hidden_truth import SAME
from real_answers import parts_of
from rows import append, read, with_all_rules

from lpvid.diagnosis.diagnosis import Diagnosis
from lpvid.diagnosis.evidence.calibration import Support
from lpvid.record import Record
from lpvid.rounding import EPS
from quartercar.effects import CATALOGUE

LISTED = 0.05
BINS = 8
"""of the reliability, of equal numbers of claims"""
TENTHS = 10
FOREIGN_RATE = cases.RATE / 2
"""Hz, at which records of the foreign rig are analysed: half the time"""
STEEPEST = 10.0
"""slope of a map, where its claims are separable"""
KINDS = {e.name: e.form_of if e.form_of in {c.name for c in CATALOGUE} else e.component for e in CATALOGUE}
"""the component of every entry"""
Row = dict


@dataclass(frozen=True)
class Claim:
    """A component of some set, its support, and whether it is present.

    Attributes
    ----------
    rig, case : str
        `case` is the id of its row.
    component : str
    support : Support
    there : bool
    """

    rig: str
    case: str
    component: str
    support: Support
    there: bool

    @property
    def half(self) -> int:
        """0 or 1, by the case."""
        return zlib.crc32(self.case.encode()) % 2


@dataclass(frozen=True)
class Case:
    """A case that was diagnosed: what was in it, what was named, and its claims.

    Attributes
    ----------
    rig, case, kind, law : str
    mark : str
        One word on what was named.
    claims : tuple of Claim
    """

    rig: str
    case: str
    kind: str
    law: str
    mark: str
    claims: tuple[Claim, ...]


# -- cases --------------------------------------------------------------------------------------------------------
def foreign_case(seed: int) -> Row:
    """One case of the foreign rig, at half its rate, 10 s: plain data."""
    import lpvid as lpv

    plan = cases.draw(seed, duration=10.0)
    known, record = foreign_record(plan)
    begun = time.process_time()
    answer = lpv.diagnose(record, plan.baseline, sample_rate=FOREIGN_RATE)
    assert answer.weights is not None
    return plan.to_dict() | {
        "rig": "foreign", **known,
        "verdict": answer.verdict, "named": [c.name for c in answer.causes],
        "rivals": [list(r.names) for r in answer.rivals], "support": supports(answer),
        "changes": changes(answer),
        "families": dict(answer.weights.families), "before": answer.before.esr_held_out,
        "after": answer.after.esr_held_out, "cpu": round(time.process_time() - begun, 2)}


def foreign_record(plan: cases.Plan) -> tuple[Row, Record]:
    """What is hidden in a case of the foreign rig and whether it is separable, at `FOREIGN_RATE`; and its record."""
    import lpvid as lpv

    world = cases.world(plan)
    known = truth.truth_of(world, FOREIGN_RATE)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "record.csv"
        cases.written(world, cases.measured(world, world.run(known.hidden)), path)
        return foreign_scoreboard.truths(world, known), lpv.read(str(path))


def supports(answer: Diagnosis) -> dict[str, list]:
    """The support of every component for a row, as lists in the order of `Support`."""
    assert answer.weights is not None
    return {k: list(astuple(s)) for k, s in answer.weights.components.items()}


def changes(answer: Diagnosis) -> dict[str, float]:
    """What every named cause changes, over the spread of the output."""
    spread = answer.before.rmse / np.sqrt(answer.before.esr_held_out)
    return {c.name: float(c.contribution / spread) for c in answer.causes}


def own_case(seed: int) -> Row:
    """One case of the own rig as the scoreboard has it."""
    answers: list[Diagnosis] = []
    row = hidden_score.case(seed, CATALOGUE, answers=answers)
    return row | {"rig": "own", "support": supports(answers[0]), "changes": changes(answers[0])}


def measured_case(folder: Path, group: str, baseline: str) -> Row:
    """One group of measured records with a fair answer."""
    import lpvid as lpv

    chosen = real_records.group(group)
    with tempfile.TemporaryDirectory() as cut:
        records = [r for file in real_records.written(folder, chosen.training, Path(cut)) for r in lpv.read(file)]
    begun = time.process_time()
    rate = dict(zip(chosen.options[::2], chosen.options[1::2], strict=False)).get("--sample-rate")
    answer = lpv.diagnose(records, baseline, sample_rate=None if rate is None else float(rate))
    return {"rig": "measured", "kind": group, "law": baseline, "causes": [], "verdict": answer.verdict,
            "named": [c.name for c in answer.causes], "rivals": [list(r.names) for r in answer.rivals],
            "support": supports(answer), "changes": changes(answer), "cpu": round(time.process_time() - begun, 2)}


def run(options: argparse.Namespace) -> None:
    """The cases that no file of the folder holds."""
    done = {r["id"] for r in read(options.folder)}
    wanted = [] if options.measured is None else [
        (f"measured-0-{n}", partial(measured_case, options.measured, a.group), a.baseline)
        for n, a in enumerate(real_answers.ANSWERS)]
    wanted += [(f"{rig}-{options.seed}-{n}", make, options.seed * 100_000 + n)
              for rig, make, count in (("foreign", foreign_case, options.foreign), ("own", own_case, options.own))
              for n in range(count)]
    for name, make, seed in wanted:
        if name in done:
            continue
        try:
            row = make(seed)
        except Exception as error:
            row = {"error": f"{type(error).__name__}: {error}"}
        print(name, row.get("kind"), row.get("law"), row.get("causes"), "->", row.get("verdict"), row.get("named"),
              row.get("rivals"), row.get("cpu"), row.get("error", ""), flush=True)
        append(options.folder / "calibration.jsonl", row | {"id": name})


# -- claims -------------------------------------------------------------------------------------------------------
def kind(name: str) -> str:
    """The component of a name, of the catalogue or of a rig."""
    return KINDS.get(name, name)


def besides(row: Row) -> set[str]:
    """Components that are neither right nor wrong in a case of a rig."""
    if row["rig"] == "foreign":
        own = cases.own(row["law"], row["baseline"]) | cases.CHAIN | {"force-offset", "gas-preload"}
        own = own.union(*(cases.BESIDES.get(c, set()) for c in row["causes"]))
        own |= set() if row.get("separable", True) else set(row["near"])
    else:
        own = {"shared-filter"} if row["chain"] == "full" else set()
        own |= imitators(row) if row["kind"] == "outside" or not row["separable"] else set()
        own |= BOUC_WEN if row["kind"] == "wrong-baseline" else set()
    return {kind(n) for n in own}


def judged(name: str, row: Row) -> bool | None:
    """Whether a component is present; None where it is neither right nor wrong."""
    if row["rig"] == "measured":
        return _by_answer(name, row)
    hidden = {kind(c) for c in row["causes"]}
    if name in hidden | {SAME.get(c) for c in hidden} or any(c in parts_of(name) for c in row["causes"]):
        return True
    return None if name in besides(row) else False


def _by_answer(name: str, row: Row) -> bool | None:
    """The same by the fair answer of measured records."""
    answer = real_answers.answer(real_records.group(row["kind"]).of or row["kind"], row["law"])
    assert answer is not None
    parts, right = parts_of(name), {*answer.expected, *(r for rivals in answer.rivals.values() for r in rivals)}
    if parts & right:
        return True
    return None if parts & {*answer.related, *answer.accepted, *real_answers.PARALLEL} else False


def claims(row: Row, least: float = LISTED) -> tuple[Claim, ...]:
    """Every component of a case that has at least a weight, and is right or wrong."""
    supports = {name: Support(*values[:2]) for name, values in row["support"].items()}
    there = {name: judged(name, row) for name, support in supports.items() if support.weight >= least}
    return tuple(Claim(row["rig"], row["id"], name, supports[name], right)
                 for name, right in there.items() if right is not None)


def diagnosed(rows: Sequence[Row]) -> list[Case]:
    """The cases of rows, of `rule_ablation` too; those that ended in an error are left out."""
    found = [with_all_rules(r) for r in rows if r.get("rig") != "removed"]
    return [Case(r["rig"], r["id"], r["kind"], r["law"], mark(r), claims(r)) for r in found if "support" in r]


COLUMNS = ("rig", "case", "kind", "law", "mark", "component", "weight", "against", "probability", "there")
"""of a file of claims"""


def keep(cases: Sequence[Case], path: Path) -> None:
    """Write the claims of cases; a case without claims has a line without a component."""
    lines = []
    for case in cases:
        about = (case.rig, case.case, case.kind, case.law, case.mark)
        lines += [(*about, c.component, *(f"{v:.6g}" for v in (*astuple(c.support), c.support.probability)),
                   int(c.there)) for c in case.claims] or [(*about, *[""] * (len(COLUMNS) - len(about)))]
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *lines])


def kept(path: Path) -> list[Case]:
    """The cases of a file of claims."""
    found: dict[tuple[str, str, str, str, str], list[Claim]] = {}
    with path.open(newline="", encoding="utf-8") as file:
        for line in csv.DictReader(file):
            listed = found.setdefault((line["rig"], line["case"], line["kind"], line["law"], line["mark"]), [])
            if line["component"]:
                support = Support(float(line["weight"]), float(line["against"]))
                listed.append(Claim(line["rig"], line["case"], line["component"], support, line["there"] == "1"))
    return [Case(*about, tuple(listed)) for about, listed in found.items()]


def reliability(p: np.ndarray, there: np.ndarray) -> tuple[list[tuple[float, float, int]], float]:
    """Mean probability, share that is present and count per bin of equal counts; and the expected calibration error,
    the mean difference of the first two."""
    order = np.argsort(p, kind="stable")
    parts = [part for part in np.array_split(order, BINS) if part.size]
    rows = [(float(p[k].mean()), float(there[k].mean()), k.size) for k in parts]
    return rows, float(sum(n * abs(a - b) for a, b, n in rows) / max(p.size, 1))


def by_chance(p: np.ndarray, draws: int = 200) -> float:
    """The expected calibration error of claims with exact probabilities, which is not zero for a finite number."""
    rng = np.random.default_rng(0)
    return float(np.mean([reliability(p, (rng.random(p.size) < p).astype(float))[1] for _ in range(draws)]))


def fitted(found: Sequence[Claim]) -> tuple[float, float]:
    """Slope and limit of the map of maximum likelihood (logistic regression with a limit; Platt 1999)."""
    from scipy.optimize import minimize

    compressed = np.array([c.support.compressed for c in found])
    there = np.array([float(c.there) for c in found])
    rigs = [c.rig for c in found]
    share = np.array([len(found) / (len(set(rigs)) * rigs.count(r)) for r in rigs])  # sources have equal weight

    def loss(x: np.ndarray) -> float:
        p = np.clip(x[1] / (1 + np.exp(-x[0] * compressed)), EPS, 1 - EPS)
        return -float(share @ (there * np.log(p) + (1 - there) * np.log(1 - p)))

    best = minimize(loss, [1.0, 0.9], bounds=[(0.0, STEEPEST), (0.5, 1.0)]).x
    return float(best[0]), float(best[1])


def by_map(found: Sequence[Claim], slope: float, limit: float) -> np.ndarray:
    """Probabilities of claims by a map."""
    return limit / (1 + np.exp(-slope * np.array([c.support.compressed for c in found])))


def halves(found: Sequence[Claim]) -> tuple[list[Claim], list[Claim]]:
    """Claims of either half of the cases."""
    first, second = ([c for c in found if c.half == k] for k in (0, 1))
    return first, second


def left_out(found: Sequence[Claim]) -> np.ndarray:
    """Probabilities of claims, each by the map of the cases of the nine other tenths."""
    names = sorted({(c.rig, c.case) for c in found})
    place = dict(zip(names, np.random.default_rng(0).permutation(len(names)) % TENTHS, strict=True))
    tenth = np.array([place[c.rig, c.case] for c in found])
    p = np.zeros(len(found))
    for k in range(TENTHS):
        chosen = [c for c, t in zip(found, tenth, strict=True) if t == k]
        if chosen:
            p[tenth == k] = by_map(chosen, *fitted([c for c, t in zip(found, tenth, strict=True) if t != k]))
    return p


def table(found_cases: Sequence[Case]) -> str:
    """The map of all cases; the reliability of weights, of the program's probabilities, and of maps on cases that they
    were not fitted to (ten-fold, and of one half on the other); of all sources and of each."""
    found = [c for case in found_cases for c in case.claims]
    first, second = halves(found)
    lines = [f"{len(found_cases)} cases, {len(found)} components",
             "slope and limit of all: {:.2f}, {:.3f}".format(*fitted(found)),
             "slope and limit of half of the cases: {:.2f}, {:.3f}".format(*fitted(first))]
    kinds = (("weights", found, np.array([c.support.weight for c in found])),
             ("as given", found, np.array([c.support.probability for c in found])),
             ("tenths left out", found, left_out(found)),
             ("one half by the other", second, by_map(second, *fitted(first))))
    for label, part, p in kinds:
        for rig in ("all", "foreign", "own", "measured"):
            pick = np.array([rig in ("all", c.rig) for c in part])
            if pick.any():
                bins, error = reliability(p[pick], np.array([float(c.there) for c in part])[pick])
                chance = by_chance(p[pick])
                lines += [f"{label}, {rig}: calibration error {error:.3f} of {pick.sum()} (by chance {chance:.3f})",
                          *(f"  {a:.3f} given, {b:.3f} there, {n}" for a, b, n in bins if rig == "all")]
    return "\n".join([*lines, *named_table(found_cases)])


def named_table(found_cases: Sequence[Case]) -> list[str]:
    """Cases by what was named."""
    lines = []
    for rig in ("foreign", "own", "measured"):
        marks = [c.mark for c in found_cases if c.rig == rig]
        lines.append(f"named, {rig}: " + ", ".join(f"{marks.count(m)} {m}" for m in sorted(set(marks))))
    return lines


def mark(row: Row) -> str:
    """One word on what was named in a case."""
    found = [judged(kind(n), row) for n in row["named"]]
    if False in found:
        return "wrong"
    if row["kind"] in ("nothing", "outside"):
        return "clean"
    return "right" if True in found else "silent"


def picture(found_cases: Sequence[Case], path: Path) -> None:
    """Reliability diagram: weights, and probabilities as the program gives them."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    found = [c for case in found_cases for c in case.claims]
    there = np.array([float(c.there) for c in found])
    figure, axes = plt.subplots(figsize=(5, 4.5), layout="constrained")
    axes.plot([0, 1], [0, 1], color="0.7", lw=1)
    for label, p, style in (("weight", np.array([c.support.weight for c in found]), "o--"),
                            ("probability", np.array([c.support.probability for c in found]), "s-")):
        bins, error = reliability(p, there)
        axes.plot([b[0] for b in bins], [b[1] for b in bins], style, label=f"{label}: error {error:.3f}")
    axes.set(xlabel="given", ylabel="share that is there", xlim=(0, 1.02), ylim=(0, 1.02),
             title=f"{len(found)} components, {len(found_cases)} cases:\nvirtual rigs and measured records")
    axes.legend(loc="upper left")
    figure.savefig(path, dpi=110)


def main() -> None:
    """Run what is missing, then print the table."""
    parser = argparse.ArgumentParser(description="Reliability of the probabilities of a diagnosis.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--foreign", type=int, default=0)
    parser.add_argument("--own", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--measured", type=Path, default=None, help="folder of the measured records")
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--picture", type=Path, default=None)
    parser.add_argument("--csv", type=Path, default=None)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    if not options.table:
        run(options)
    found = diagnosed(read(options.folder)) + [c for file in sorted(options.folder.glob("*.csv")) for c in kept(file)]
    print(table(found))
    if options.picture:
        picture(found, options.picture)
    if options.csv:
        keep(found, options.csv)


if __name__ == "__main__":
    main()
