"""`--auto` against every structure by hand at its best order, on every shared record group.

    LPVID_DATA=… python tests/benchmarks/auto_study.py [--budget SECONDS] [--out FILE.jsonl] [GROUP…]

By hand is given the advantage: each structure's best order is the one of the highest held-out fit, of which `--auto`
sees nothing. All figures are free-run fits [%] on held-out data, but the ceiling, which is estimated from the training
data's noise and applied to the held-out data's spread. A group that stands in FILE already is not run again.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from real_records import GROUPS, Part, written

import lpvid as lpv
from lpvid.cli.automatic import choose
from lpvid.cli.structures import Request
from lpvid.condition.preparing import decimation
from lpvid.errors import LpvError
from lpvid.identification.structure import Structure
from lpvid.record import Record

GYROSCOPE = "gyroscope/estimation.csv"
SCHEDULED = {"random": "voltage", "sines": "current", "labcontrol-voltages": "voltage"}
"""groups whose damper has a command that moves."""


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


def cases() -> list[Case]:
    """All groups of `real_records`, and the gyroscope."""
    found = [Case("gyroscope", (Part(GYROSCOPE, 0.0, 2 / 3),), (Part(GYROSCOPE, 2 / 3, 1.0),), ("motor current",),
                  "gimbal speed", ("p1", "p2", "p3"))]
    for group in GROUPS:
        rate = float(group.options[1]) if group.options[:1] == ("--sample-rate",) else None
        if group.name == "car":
            found.append(Case("car", group.training, group.held_out, ("actuator force", "road"), "sprung"))
            continue
        schedule = SCHEDULED.get(group.name)
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


def run(case: Case, folder: Path, budget: float) -> dict:
    """One row of the table."""
    with TemporaryDirectory() as cut:
        training = lpv.read(written(folder, case.training, Path(cut) / "training"))
        held_out = lpv.read(written(folder, case.held_out, Path(cut) / "held_out"))
    rate = case.sample_rate or decimation([*training, *held_out])[0]
    begun = time.perf_counter()
    request = Request(case.input, (case.output,), case.schedule, "arx", {}, rate, True)
    choice, found = choose(request, training, held_out, lambda text: None, budget)
    seconds = time.perf_counter() - begun
    judged = found.held_out
    assert judged is not None
    hand, spent = _hand(case, training, held_out, rate)
    return {"group": case.name, "auto": judged.overall.free_run.fit_percent, "structure":
            choice.to_dict()["best"], "ceiling": choice.held_out_percent, "seconds": seconds,
            "candidates": sum(r.esr is not None for r in choice.selection.table), "hand": hand, "hand_seconds": spent,
            "notes": list(choice.selection.notes)}


def _hand(case: Case, training: Sequence[Record], held_out: Sequence[Record],
          rate: float | None) -> tuple[dict[str, float], float]:
    best: dict[str, float] = {}
    begun = time.perf_counter()
    for kind, structure in by_hand(case):
        try:
            found = lpv.identify(training, structure, sample_rate=rate, held_out=held_out)
        except LpvError:
            continue
        assert found.held_out is not None
        fit = found.held_out.overall.free_run.fit_percent
        if fit is not None:
            best[kind] = max(best.get(kind, -1e9), float(fit))
    return best, time.perf_counter() - begun


def table(rows: Sequence[dict]) -> str:
    """Markdown."""
    kinds = ("arx", "oe", "riv", "subspace", "pem-ss", "quasi")
    lines = ["| group | auto | structure of it | " + " | ".join(kinds) + " | auto − best | ceiling | auto, s |",
             "|---" * (len(kinds) + 6) + "|"]
    for row in rows:
        cells = [f"{row['hand'][k]:.1f}" if k in row["hand"] else "–" for k in kinds]
        ceiling = "–" if row["ceiling"] is None else f"{row['ceiling']:.1f}"
        lines.append(f"| {row['group']} | {row['auto']:.1f} | {row['structure']} | {' | '.join(cells)} | "
                     f"{row['auto'] - max(row['hand'].values()):+.1f} | {ceiling} | {row['seconds']:.0f} |")
    return "\n".join(lines)


def main() -> None:
    """Run what is missing and print the table."""
    parser = argparse.ArgumentParser(description="--auto against every structure by hand")
    parser.add_argument("groups", nargs="*")
    parser.add_argument("--budget", type=float, default=300.0)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    rows = [json.loads(line) for line in asked.out.read_text().splitlines()] if asked.out and asked.out.exists() else []
    for case in cases():
        if (asked.groups and case.name not in asked.groups) or any(r["group"] == case.name for r in rows):
            continue
        rows.append(run(case, Path(os.environ["LPVID_DATA"]), asked.budget))
        print(table(rows[-1:]).splitlines()[-1], flush=True)
        if asked.out:
            with asked.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    print(table(rows))


if __name__ == "__main__":
    main()
