"""`--auto` against every structure by hand at its best order, on every shared record group.

    LPVID_DATA=… python tests/benchmarks/auto_study.py [--budget S] [--out FILE.jsonl] [--only auto|hand] [GROUP…]

GROUP is a group of `real_records`, or one of its siblings as ``NAME:TURN``: the same specimens with less or other data.

By hand is given the advantage: each structure's best order is the one of the highest held-out fit, of which `--auto`
sees nothing. All figures are free-run fits [%] on held-out data, but the ceiling, which is estimated from the training
data's noise and applied to the held-out data's spread. Times are processor seconds. FILE has one line for each group
and part; what stands there is not run again, so that several of these may share the work.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from real_records import GROUPS, Group, Part, siblings, written

import lpvid as lpv
from lpvid._forks import processor_time
from lpvid.cli.automatic import choose
from lpvid.cli.structures import Request
from lpvid.condition.preparing import decimation
from lpvid.errors import LpvError
from lpvid.identification.selection.hasty import in_full
from lpvid.identification.selection.result import CandidateRow
from lpvid.identification.structure import Structure
from lpvid.record import Record

GYROSCOPE = "gyroscope/estimation.csv"
SCHEDULED = {"random": "voltage", "sines": "current", "labcontrol-voltages": "voltage"}
"""groups whose damper has a command that moves."""
KINDS = ("quasi", "subspace", "arx", "riv", "oe", "pem-ss")
"""structures by hand, cheap before dear."""


@dataclass(frozen=True)
class Case:
    """A group with the channels of its model."""

    name: str
    training: tuple[Part, ...]
    held_out: tuple[Part, ...]
    input: tuple[str, ...] = ("velocity",)
    output: str = "force"
    schedule: tuple[str, ...] = ()
    sample_rate: float | None = None

    @property
    def is_damper(self) -> bool:
        """Whether its input is a velocity and its output a force."""
        return self.input == ("velocity",) and self.output == "force"


def cases(groups: Sequence[Group] = GROUPS) -> list[Case]:
    """These groups, and the gyroscope with all of `GROUPS`."""
    found = [Case("gyroscope", (Part(GYROSCOPE, 0.0, 2 / 3),), (Part(GYROSCOPE, 2 / 3, 1.0),), ("motor current",),
                  "gimbal speed", ("p1", "p2", "p3"))] if groups is GROUPS else []
    for group in groups:
        rate = float(group.options[1]) if group.options[:1] == ("--sample-rate",) else None
        specimen = group.of or group.name
        if specimen == "car":
            found.append(Case(group.name, group.training, group.held_out, ("actuator force", "road"), "sprung"))
            continue
        schedule = SCHEDULED.get(specimen)
        found.append(Case(group.name, group.training, group.held_out, sample_rate=rate,
                          schedule=(schedule,) if schedule else ()))
    return found


def by_hand(case: Case) -> Iterator[tuple[str, Structure]]:
    """Structures with the orders that a user would try."""
    common: dict = {"input": case.input, "output": case.output}
    basis = lpv.Polynomial(case.schedule, degree=1) if case.schedule else lpv.Polynomial()
    affine = 1 if case.name != "gyroscope" else None
    stages: list[dict] = [{}]
    if case.is_damper:
        lag = {"schedule_filter": "rise-fall"} if case.schedule else {}
        stages += [{"stage": "tanh", **lag}, {"stage": "three-zone", **lag}]
    for n in (2, 3, 4, 6):
        terms = n + 1 if affine is None else affine
        for nk in (0, 1):
            shared = {**common, "na": n, "nb": n, "nk": nk, "basis": basis, "affine": terms}
            for stage in stages:
                yield "arx", lpv.ARX(**shared, **stage, lagged=affine is None)
                if nk == 1 - case.is_damper and (not stage or n in (2, 4)):
                    yield "oe", lpv.OutputError(**shared, **stage, lagged=affine is None)
        if n in (2, 4):
            yield "riv", lpv.RefinedIV(**common, na=n, nb=n, nk=1, basis=basis, affine=terms, lagged=affine is None)
            yield "pem-ss", lpv.StateSpaceError(order=n, **common, basis=basis, affine=True, direct=case.is_damper)
    yield "subspace", lpv.Subspace(**common, basis=basis, affine=True, direct=case.is_damper)
    if case.is_damper:
        external = basis if case.schedule else lpv.Polynomial()
        for nb, trial in ((4, 1), (10, 3)):
            yield "quasi", lpv.QuasiLPV(nb=nb, **common, basis=lpv.Spline(case.output, 10, 1), on="trial", trial=trial,
                                        external=external)


@dataclass(frozen=True)
class Data:
    """Records of a case, read once.

    Attributes
    ----------
    training, held_out : list of Record
    rate : float or None
        Rate of the models [Hz].
    """

    training: list[Record]
    held_out: list[Record]
    rate: float | None


def read(case: Case, folder: Path) -> Data:
    """The records of a case, with the rate that the command would take."""
    with TemporaryDirectory() as cut:
        training = lpv.read(written(folder, case.training, Path(cut) / "training"))
        held_out = lpv.read(written(folder, case.held_out, Path(cut) / "held_out"))
    return Data(training, held_out, case.sample_rate or decimation([*training, *held_out])[0])


def by_auto(case: Case, data: Data, budget: float, everyone: bool = False) -> dict:
    """The command's choice and its figures."""
    begun = processor_time()
    request = Request(case.input, (case.output,), case.schedule, "arx", {}, data.rate, True)
    choice, found = choose(request, data.training, data.held_out, lambda text: None, budget)
    seconds = processor_time() - begun
    judged = found.held_out
    assert judged is not None
    return {"auto": judged.overall.free_run.fit_percent, "structure": choice.to_dict()["best"],
            "ceiling": choice.held_out_percent, "seconds": seconds,
            "candidates": sum(r.esr is not None for r in choice.selection.table),
            "left_out": list(choice.selection.left_out), "notes": list(choice.selection.notes),
            "table": [str(row) for row in choice.selection.table[:12]],
            "rows": _held_out_of(choice.selection.table, data) if everyone else []}


def _held_out_of(rows: Sequence[CandidateRow], data: Data) -> list[dict]:
    """Every candidate with a cross-validated figure, refitted on all training data, on the held-out data [%]."""
    out = []
    for row in rows:
        if row.esr is None:
            continue
        try:
            found = lpv.identify(data.training, in_full(row.structure), sample_rate=data.rate, held_out=data.held_out)
        except LpvError:
            continue
        assert found.held_out is not None
        out.append({**row.to_dict(), "held_out": found.held_out.overall.free_run.fit_percent, "training": found.fit})
    return out


def by_all_hands(case: Case, data: Data, most: float) -> dict:
    """The best held-out fit of every structure, cheap kinds first, in `most` processor seconds.

    Those not tried by then are counted.
    """
    best: dict[str, float] = {}
    which: dict[str, str] = {}
    begun, left = processor_time(), 0
    tried = sorted(by_hand(case), key=lambda pair: KINDS.index(pair[0]))
    for kind, structure in tried:
        if processor_time() - begun > most:
            left += 1
            continue
        try:
            found = lpv.identify(data.training, structure, sample_rate=data.rate, held_out=data.held_out)
        except LpvError:
            continue
        assert found.held_out is not None
        fit = found.held_out.overall.free_run.fit_percent
        if fit is not None and fit > best.get(kind, -np.inf):
            best[kind], which[kind] = float(fit), structure.summary
    return {"hand": best, "which": which, "hand_seconds": processor_time() - begun, "hand_left": left}


def table(rows: Sequence[dict]) -> str:
    """Markdown."""
    lines = ["| group | auto | structure of it | " + " | ".join(KINDS) + " | auto − best | ceiling | auto, s |",
             "|---" * (len(KINDS) + 6) + "|"]
    for row in rows:
        hand, ceiling = row.get("hand", {}), row.get("ceiling")
        cells = [f"{hand[k]:.1f}" if k in hand else "–" for k in KINDS]
        gap = f"{row['auto'] - max(hand.values()):+.1f}" if hand and "auto" in row else "–"
        found = ("– | –", "–")
        if "auto" in row:
            found = f"{row['auto']:.1f} | {row['structure']}", f"{row['seconds']:.0f}"
        lines.append(f"| {row['group']} | {found[0]} | {' | '.join(cells)} | {gap} | "
                     f"{'–' if ceiling is None else f'{ceiling:.1f}'} | {found[1]} |")
    return "\n".join(lines)


def stored(file: Path | None) -> dict[str, dict]:
    """Rows by group, their parts put together."""
    rows: dict[str, dict] = {}
    for line in file.read_text(encoding="utf-8").splitlines() if file and file.exists() else ():
        row = json.loads(line)
        rows.setdefault(row["group"], {}).update(row)
    return rows


def main() -> None:
    """Run what is missing and print the table."""
    parser = argparse.ArgumentParser(description="--auto against every structure by hand")
    parser.add_argument("groups", nargs="*")
    parser.add_argument("--budget", type=float, default=300.0)
    parser.add_argument("--most", type=float, default=600.0, help="processor seconds for a group by hand")
    parser.add_argument("--only", choices=("auto", "hand"))
    parser.add_argument("--rules", action="store_true", help="also the held-out fit of every candidate, for `rules`")
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    known = {case.name: case for case in cases() + cases(siblings())}
    rows = stored(asked.out)
    for name in asked.groups or [case.name for case in cases()]:
        for part, key in (("auto", "auto"), ("hand", "hand")):
            row = stored(asked.out).get(name, rows.get(name, {}))
            if key in row or asked.only not in (None, part):
                continue
            data = read(known[name], Path(os.environ["LPVID_DATA"]))
            found = (by_auto(known[name], data, asked.budget, asked.rules) if part == "auto" else
                     by_all_hands(known[name], data, asked.most))
            rows[name] = {**row, "group": name, **found}
            print(table([rows[name]]).splitlines()[-1], flush=True)
            if asked.out:
                with asked.out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps({"group": name, **found}) + "\n")
    shown = stored(asked.out) or rows
    print(table([shown[n] for n in known if n in shown]))


if __name__ == "__main__":
    main()
