"""From a diagnosis of a hidden case to what is right and wrong about it, and to the table over many cases."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from helpers.hidden_causes import find
from helpers.hidden_truth import IMITATED, SAME, SEPARATE, SHARE, baseline_for, build, oracle_gain
from lpvid.diagnosis.diagnosis import Diagnosis
from lpvid.diagnosis.evidence import engine
from lpvid.effects.effect import Effect
from quartercar.effects import CATALOGUE

Row = dict
BOUC_WEN = {"series-compliance", "entrained-air", "coil-lag", "coulomb-friction", "hysteresis"}
"""what a Bouc-Wen damper has and Guo's law has not: a spring in series, linear or not, the lag of its current, of 0.3
to 1 ms here, and a force that builds up over a deflection (Dahl's friction is a Bouc-Wen element of constant force,
hysteresis any of its kind)"""

CHAIN = "shared-filter"
KNOWN = {e.name for e in CATALOGUE}
"""what the catalogue has: of the causes drawn as outside of it, the cubic spring came to it later"""


def case(seed: int, catalogue: tuple[Effect, ...], answers: list[Diagnosis] | None = None, **fixed: object) -> Row:
    """Draw, diagnose and mark one case; plain data. The diagnosis itself goes into `answers`."""
    made, truth = build(seed, catalogue, **fixed)
    begun, cpu = time.perf_counter(), time.process_time()
    answer = engine.diagnose(made.records, baseline_for(made.plan, made.records), catalogue)
    seconds, cpu = time.perf_counter() - begun, time.process_time() - cpu
    if answers is not None:
        answers.append(answer)
    row = made.plan.to_dict() | {
        "sizes": [s for _, s in made.hidden], "smallest": list(truth.smallest), "share": truth.share,
        "likelihood": truth.likelihood,
        "separable": truth.separable, "ambiguous": truth.ambiguous, "near": truth.rivals,
        "besides": list(truth.besides),
        "verdict": answer.verdict, "reason": answer.reason, "named": [c.name for c in answer.causes],
        "rivals": [list(r.names) for r in answer.rivals], "rejected": [[r.name, r.why] for r in answer.rejected],
        "explained": answer.explained_share, "predictable": answer.noise["predictable_share"],
        "gain": answer.gain_percent,
        "won": {c.name: [c.delta_bic, c.contribution] for c in answer.causes},
        "posterior": dict(answer.weights.causes) if answer.weights else {},
        "seconds": round(seconds, 2), "cpu": round(cpu, 2)}
    row |= _estimate(made.plan, made.hidden, answer)
    if truth.separable or made.plan.kind in ("two", "three"):
        row["held_out_gain"], row["oracle_gain"] = oracle_gain(made, catalogue, answer)
    return row


def _estimate(plan, hidden: tuple, answer: Diagnosis) -> Row:
    """Relative error and standard errors from the truth of the first cause, where it was named by the same law."""
    if len(hidden) != 1 or plan.law != "rig" or plan.kind != "one":
        return {}
    name, size = hidden[0]
    wanted = find(name).parameter
    for cause in answer.causes:
        for p in cause.parameters:
            if cause.name == name and p.name == wanted:
                return {"relative_error": abs(p.value - size) / abs(size),
                        "covered": None if not p.std else bool(abs(p.value - size) <= 1.96 * p.std)}
    return {}


# -- marks --------------------------------------------------------------------------------------------------------
def truths(row: Row) -> set[str]:
    """Names that would be right; of a Bouc-Wen damper also those of what Guo's law has not."""
    own = BOUC_WEN if row["kind"] == "wrong-baseline" else set()
    filters = {CHAIN} if row["chain"] == "full" else set()
    alike = imitators(row) if row["kind"] == "outside" else set()
    return {*row["causes"], *alike, *own, *filters}


def imitators(row: Row) -> set[str]:
    """Entries of the catalogue that explain 95 % of what is hidden in these data, or all but what the noise drowns."""
    limit = max(SEPARATE, IMITATED * row.get("likelihood", 0.0))
    return {name for name, apart in row["near"].items() if apart < limit}


def stated(row: Row) -> list[str]:
    """Causes named outright, without the filters that every channel of a full chain truly passes."""
    return [n for n in row["named"] if not (n == CHAIN and row["chain"] == "full")]


def wrong(row: Row) -> set[str]:
    """Causes named outright that are not there."""
    right = truths(row)
    return {n for n in row["named"] if n not in right and SAME.get(n) not in right}


def right_first(row: Row) -> bool:
    """Whether the first cause named is the one that is hidden (or the single one of several)."""
    if row["kind"] == "wrong-baseline":
        return row["causes"][0] in row["named"]
    hidden = {*row["causes"], *(SAME.get(n, n) for n in row["causes"])}
    return bool(stated(row)) and stated(row)[0] in hidden


def abstains(row: Row) -> bool:
    """Whether nothing is named outright."""
    return not stated(row)


def exact(row: Row) -> bool:
    """Whether all causes are named outright and no other.

    A cause that the diagnosis lists among rivals is not named, but where nothing can tell them apart whatever the data
    (`SAME`: a constant force at the damper or in the load cell).
    """
    alike = [set(group) for group in row["rivals"] if any({n, SAME.get(n)} == set(group) for n in group)]
    named = {*row["named"], *(SAME.get(n) for n in row["named"]), *(n for group in alike for n in group)}
    return (all(n in named for n in wanted(row)) and not wrong(row)
            and len(stated(row)) + len(alike) <= len(row["causes"]))


def contained(row: Row) -> bool:
    """Whether every cause is named or in a group of rivals."""
    among = {*row["named"], *(n for r in row["rivals"] for n in r)}
    return all(n in among or SAME.get(n) in among for n in wanted(row))


def wanted(row: Row) -> list[str]:
    """Hidden causes that must be named: like a single one, those that change at least 1 % of the force."""
    besides = row.get("besides") or [np.inf] * len(row["causes"])
    return [n for n, share in zip(row["causes"], besides, strict=True) if share >= SHARE]


# -- telling ------------------------------------------------------------------------------------------------------
def line(row: Row) -> str:
    """One case in one line."""
    if "error" in row:
        return f"{row['id']} ERROR {row['error']}"
    mark = "WRONG " + ",".join(wrong(row)) if wrong(row) else "ok"
    state = "separable" if row["separable"] else "ambiguous" if row["ambiguous"] else "-"
    return (f"{row['id']} {row['kind']} {row['baseline'][:3]} {row['excitation']}/{row['current']} "
            f"{row['level']:.1%} {row['colour']} {row['chain']} {'rep' if row['repeats'] else 'single'} "
            f"{'+'.join(row['causes']) or 'nothing'} ({row['law']}) x{row['ratio']:g} share {row['share']:.2%} {state} "
            f"-> {row['verdict']}: {','.join(row['named']) or '-'} "
            f"rivals {row['rivals'] or '-'} | {mark} {row['seconds']:.1f} s, {row['cpu']:.1f} s on the processor")


def table(rows: list[Row]) -> str:
    """Figures over all cases, and over those with repeats."""
    broken = [r for r in rows if "error" in r]
    rows = [r for r in rows if "error" not in r]
    repeated, single = [r for r in rows if r["repeats"]], [r for r in rows if not r["repeats"]]
    out = [f"{len(rows)} cases, {len(repeated)} with repeats; {len(broken)} ended in an error",
           f"{'':58s}{'repeats':>18s}{'no repeats':>18s}{'all':>18s}   target"]
    for label, pick, mark, target in _lines():
        cells = "".join(f"{_share(part, pick, mark):>18s}" for part in (repeated, single, rows))
        out.append(f"{label:58s}{cells}   {target}")
    out += _gains(rows) + _estimates(rows) + _times(rows)
    return "\n".join(out)


def _share(rows: list[Row], pick: Callable[[Row], bool], mark: Callable[[Row], bool]) -> str:
    chosen = [r for r in rows if pick(r)]
    return f"{np.mean([mark(r) for r in chosen]):.1%} of {len(chosen)}" if chosen else "-"


def _lines() -> list[tuple[str, Callable[[Row], bool], Callable[[Row], bool], str]]:
    def one(chain: str) -> Callable[[Row], bool]:
        return lambda r: r["kind"] == "one" and r["separable"] and r["chain"] == chain

    def three(r: Row) -> bool:
        return r["kind"] == "three"

    def foreign(r: Row) -> bool:
        return r["kind"] == "outside" and not imitators(r) and KNOWN.isdisjoint(r["causes"])

    def slightly(r: Row) -> bool:
        return r["kind"] == "wrong-baseline" and r["separable"]

    lines = [("right name first, separable, clean channels", one("clean"), right_first, ">= 95 %"),
             ("right name first, separable, full chain", one("full"), right_first, ">= 85 %"),
             ("  of them by another law", lambda r: r["kind"] == "one" and r["separable"] and r["law"] == "other",
              right_first, ""),
             ("wrong name, all cases", lambda r: True, lambda r: bool(wrong(r)), "<= 3 %"),
             ("  without those outside the catalogue", lambda r: r["kind"] != "outside", lambda r: bool(wrong(r)), "")]
    for colour in ("white", "ar1", "low-passed", "proportional"):
        for chain in ("clean", "full"):
            lines.append((f"false alarm, nothing hidden, {colour}, {chain}",
                          lambda r, c=colour, h=chain: r["kind"] == "nothing" and r["colour"] == c and r["chain"] == h,
                          lambda r: bool(stated(r)), "<= 5 %, none > 8 %"))
    lines += [("false alarm, nothing hidden, all", lambda r: r["kind"] == "nothing", lambda r: bool(stated(r)), ""),
              ("  rivals or names, nothing hidden, all", lambda r: r["kind"] == "nothing",
               lambda r: bool(stated(r) or r["rivals"]), ""),
              ("outside the catalogue: refused", foreign, abstains, ">= 90 %"),
              ("  misnamed, verdict 'explained'", foreign,
               lambda r: bool(stated(r)) and r["verdict"] == "explained", "<= 5 %"),
              ("  imitated to 95 % by an entry: no other name",
               lambda r: r["kind"] == "outside" and not foreign(r), lambda r: not wrong(r), ""),
              ("cannot tell: said so", lambda r: r["kind"] == "one" and r["ambiguous"],
               lambda r: abstains(r) and r["verdict"] != "explained", ">= 90 %"),
              ("  of the others the right name", lambda r: r["kind"] == "one" and r["ambiguous"] and not abstains(r),
               right_first, ""),
              ("needless abstention, separable", lambda r: r["kind"] == "one" and r["separable"], abstains, "<= 10 %"),
              ("two at once: exact", lambda r: r["kind"] == "two", exact, ""),
              ("three at once: exact", three, exact, ">= 80 %"),
              ("three at once: contained", three, contained, ">= 95 %"),
              ("slightly wrong baseline, separable: right name first", slightly, right_first, ">= 70 %"),
              ("  wrong name", lambda r: r["kind"] == "wrong-baseline", lambda r: bool(wrong(r)), "abstain")]
    return lines


def _gains(rows: list[Row]) -> list[str]:
    ratios = np.array([r["held_out_gain"] / r["oracle_gain"] for r in rows
                       if r.get("oracle_gain", 0) > 0.05 and r["kind"] != "wrong-baseline"])
    if not ratios.size:
        return []
    return [f"held-out gain over that of the oracle, {ratios.size} cases: median {np.median(ratios):.3f} (>= .97), "
            f"5th percentile {np.quantile(ratios, 0.05):.3f} (>= .85)"]


def _estimates(rows: list[Row]) -> list[str]:
    errors = [r["relative_error"] for r in rows if "relative_error" in r and r["ratio"] == 10]
    covered = [r["covered"] for r in rows if r.get("covered") is not None]
    out = []
    if errors:
        out.append(f"parameter error at 10 e_min, {len(errors)} cases: median {np.median(errors):.1%} (<= 5 %)")
    if covered:
        out.append(f"coverage of 95 % intervals, {len(covered)} cases: {np.mean(covered):.1%} (>= 90 %)")
    covered = [r["covered"] for r in rows if r.get("covered") is not None and r["chain"] == "clean"]
    if covered:
        out.append(f"  clean channels alone, {len(covered)} cases: {np.mean(covered):.1%}")
    return out


def _times(rows: list[Row]) -> list[str]:
    out = []
    for label, pick in (("nothing hidden", lambda r: r["kind"] == "nothing"),
                        ("something", lambda r: r["kind"] != "nothing")):
        seconds = [r["seconds"] for r in rows if pick(r)]
        if seconds:
            cpu = [r["cpu"] for r in rows if pick(r)]
            out.append(f"seconds on the processor, {label}: median {np.median(cpu):.1f}, 95 % "
                       f"{np.quantile(cpu, 0.95):.1f}, largest {max(cpu):.1f} (by the clock: {np.median(seconds):.1f}, "
                       f"{np.quantile(seconds, 0.95):.1f}, {max(seconds):.1f})")
    return out
