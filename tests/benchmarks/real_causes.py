"""The diagnosis on every real record, against fair answers that were written down before: a table.

    python tests/benchmarks/real_causes.py FOLDER OUT [CASE ...] [--limit SECONDS]
    python tests/benchmarks/real_causes.py FOLDER OUT --table
    python tests/benchmarks/real_causes.py FOLDER OUT --siblings
    python tests/benchmarks/real_causes.py FOLDER OUT --draw SEED

A case is ``GROUP/BASELINE``; its row, a line of JSON in OUT/real.jsonl, is not computed twice. ``--siblings`` takes
other records of the same specimens instead (OUT/siblings.jsonl), whose fair answers are the same. ``--draw`` takes
parts drawn anew (OUT/drawn.jsonl); the error by hand is fitted to the same parts then. All cases are run by the user's
command with held-out files. Marks:

- right: more than half of the expected parts named (or, where the catalogue may lack the only one, nothing named and
  the verdict not ``explained``), nothing wrong;
- helpful: an expected or related part named, nothing wrong;
- wrong: a cause named outright that is neither expected nor a rival nor related nor accepted;
- silent, timeout, refused, traceback.

Rivals that the diagnosis lists instead of a name count as named where every one of a list has the expected part, one
of its rivals or a related one, and one of them has the expected part.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

import commanded
import fair_fits
import numpy as np
import real_answers
import real_records
from real_answers import Answer, parts_of
from rows import append


def cases(siblings: bool = False, seed: int | None = None) -> list[tuple[str, str]]:
    """Groups and baselines, in the order of the table; of siblings and drawn parts those that have a fair answer."""
    if siblings or seed is not None:
        others = real_records.siblings() if seed is None else real_records.drawn(seed)
        return [(g.name, b) for g in others for b in g.baselines if real_answers.answer(g.of, b)]
    return [(g.name, b) for g in real_records.GROUPS for b in g.baselines]


def mark(row: dict, answer: Answer | None) -> str:
    """Right, helpful, wrong, silent; or why there is no answer; ``unscored`` without a fair answer."""
    if row["outcome"] != "answered":
        return row["outcome"]
    if answer is None:
        return "unscored"
    if wrong(row, answer):
        return "wrong"
    found = {p for p in answer.expected if p in credited(row, answer)}
    if 2 * len(found) > len(answer.expected):
        return "right"
    if answer.unknown and not row["named"] and row["verdict"] != "explained":
        return "right"
    if found or credited(row, answer) & set(answer.related):
        return "helpful"
    return "silent"


def wrong(row: dict, answer: Answer) -> list[str]:
    """Names given outright none of whose parts the answer has."""
    known = {*answer.expected, *answer.related, *answer.accepted, *real_answers.PARALLEL,
             *(r for rivals in answer.rivals.values() for r in rivals)}
    return [n for n in row["named"] if not parts_of(n, row.get("parameters", {}).get(n)) & known]


def credited(row: dict, answer: Answer) -> set[str]:
    """Parts named, expected ones of which a rival is named, and expected ones of a list of rivals."""
    parts = {p for n in row["named"] for p in parts_of(n, row.get("parameters", {}).get(n))}
    found = parts | {part for part, rivals in answer.rivals.items() if parts & set(rivals)}
    for names in row["rivals"]:
        for part in answer.expected:
            alike = {part, *answer.rivals.get(part, ()), *answer.related}
            if any(part in parts_of(n) for n in names) and all(parts_of(n) & alike for n in names):
                found.add(part)
    return found


def run(folder: Path, out: Path, options: argparse.Namespace) -> None:
    """Diagnose the cases that have no row yet."""
    path = _path(out, options)
    done = {(r["group"], r["baseline"]) for r in rows(path)}
    for name, baseline in cases(options.siblings, options.draw):
        if (name, baseline) in done or (options.case and f"{name}/{baseline}" not in options.case):
            continue
        group = real_records.group(name)
        with tempfile.TemporaryDirectory() as cut:
            data, held_out = (real_records.written(folder, part, Path(cut) / kind)
                              for kind, part in (("training", group.training), ("held_out", group.held_out)))
            row = commanded.diagnose(data, baseline, group.options, held_out, options.limit)
        row = {"group": name, "baseline": baseline, **row}
        if options.draw is not None:
            row["by_hand"] = by_hand(folder, group)
        how = mark(row, real_answers.answer(_base(name), baseline))
        print(f"{name}/{baseline}: {how} {row.get('named')}", flush=True)
        append(path, row)


def by_hand(folder: Path, group: real_records.Group) -> float | None:
    """Held-out ESR, from the first sample on, of the best structure of a specimen fitted by hand to these parts.

    None for the car, whose fit by hand is of whole runs (`fair_car`).
    """
    structure = next(a.best for a in real_answers.ANSWERS if a.group == group.of)
    if group.of == "car":
        return None
    return next(fair_fits.table(folder, group, (tuple(structure.split("+")),)))["whole"]


def _base(name: str) -> str:
    """The group whose fair answers hold."""
    return real_records.group(name).of or name


def _path(out: Path, options: argparse.Namespace) -> Path:
    return out / ("drawn.jsonl" if options.draw is not None else "siblings.jsonl" if options.siblings else "real.jsonl")


def rows(path: Path) -> list[dict]:
    """Rows of a file; none where it does not exist."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


def table(found: list[dict]) -> str:
    """Markdown: a line per case, then the shares; errors are free-run ESR, held-out."""
    lines = ["| records | baseline | mark | verdict | named | rivals | fair answer | before | after | by hand | s |",
             "|---|---|---|---|---|---|---|---|---|---|---|"]
    marks, ratios = [], []
    for row in found:
        answer = real_answers.answer(_base(row["group"]), row["baseline"])
        how, hand = mark(row, answer), row["by_hand"] if "by_hand" in row else real_answers.BY_HAND[row["group"]]
        if answer is not None:
            marks.append(how)
            if row["outcome"] == "answered" and hand:
                ratios.append(row["after"] / hand)
        esr = [f"{row[k]:.4f}" if k in row else "" for k in ("before", "after")]
        lines.append("| " + " | ".join([
            row["group"], row["baseline"], how, row.get("verdict", ""), ", ".join(row.get("named", [])),
            "; ".join("/".join(r) for r in row.get("rivals", [])), " + ".join(answer.expected) if answer else "",
            *esr, f"{hand:.4f}" if answer and hand else "", f"{row['seconds']:.0f}"]) + " |")
    count = len(marks)
    if count:
        shares = ", ".join(f"{m} {marks.count(m)} ({marks.count(m) / count:.0%})" for m in dict.fromkeys(marks))
        lines += ["", f"{count} scored cases: {shares}"]
    if ratios:
        lines.append(f"held-out ESR over the best by hand, {len(ratios)} answered: median {np.median(ratios):.2f}, "
                     f"at most 1.2 in {np.mean(np.array(ratios) <= 1.2):.0%}")
    return "\n".join(lines)


def main() -> None:
    """Run what is missing, then print the table."""
    parser = argparse.ArgumentParser(description="The diagnosis on every real record, against fair answers.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("case", nargs="*", help="GROUP/BASELINE")
    parser.add_argument("--limit", type=float, default=180.0, help="seconds per case")
    parser.add_argument("--table", action="store_true", help="print the table of the rows computed")
    parser.add_argument("--siblings", action="store_true", help="other records of the same specimens")
    parser.add_argument("--draw", type=int, metavar="SEED", help="parts of the same specimens drawn anew")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    if not options.table:
        run(options.folder, options.out, options)
    print(table(rows(_path(options.out, options))))


if __name__ == "__main__":
    main()
