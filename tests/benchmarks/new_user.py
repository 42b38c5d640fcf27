"""Ten tasks of a new user, from the README alone: commands, time, exit code and headline of each.

    python tests/benchmarks/new_user.py [--keep FOLDER] [RUN.csv NEW.csv]

Without files of your own, two records of a damper with a moving current are written first, by numpy alone: displacement
[mm], current [A], force [N] over 20 s at 512 Hz. The aim for each task: a report in at most three commands and 60 s.
Beside the time on the clock stands the processors' time, which does not depend on what else the machine does.
"""

from __future__ import annotations

import argparse
import resource
import shlex
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

MOST_COMMANDS, MOST_SECONDS = 3, 60.0
CHANNELS = "--input velocity --output force --schedule current"
TASKS: dict[str, tuple[str, ...]] = {
    "is my record fit for use": ("lpvid inspect run.csv --out 1",),
    "a model of my damper, on data it has not seen": (
        f"lpvid identify run.csv {CHANNELS} --shape tanh --hold-out 1/3 --out model",),
    "figures on a new record": ("lpvid validate model/model.json new.csv --out 3",),
    "is it stable while the current moves": ("lpvid stability model/model.json --out 4",),
    "two models on one record": (
        f"lpvid identify run.csv {CHANNELS} --structure oe --out other",
        "lpvid compare model/model.json other/model.json new.csv --out 5"),
    "C code of it": ("lpvid export model/model.json --to c --out 6",),
    "a dynamometer's page": ("quartercar characterise run.csv --out 7",),
    "damper laws, ranked": ("quartercar fit run.csv --models guo,kwok,bouc-wen --held-out new.csv --out 8",),
    "what my law misses": ("lpvid diagnose run.csv --baseline guo --out 9",),
    "is it worth it in a car": (
        f"lpvid identify run.csv {CHANNELS} --shape tanh --passive --out passive",
        "quartercar ride --damper passive/model.json --controller sh-add,passive --seeds 3 --out 10"),
}


def record(seed: int, seconds: float = 20.0, rate: float = 512.0) -> str:
    """A damper with a knee, gas and a lag of its force behind the current, as CSV; numpy alone."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    tones = [8e-3 / f * np.sin(2 * np.pi * f * t + rng.uniform(0, 6.28)) for f in (0.7, 1.6, 3.7, 8.3, 13.1)]
    x = np.sum(tones, axis=0)
    v = np.gradient(x, t)
    current = np.repeat(rng.uniform(0, 1.5, round(seconds / 0.5)), round(rate / 2))[: t.size]
    yielding = np.zeros(t.size)
    for k in range(1, t.size):
        yielding[k] = yielding[k - 1] + (current[k] - yielding[k - 1]) / (rate * 0.012)
    force = (350 + 250 * yielding) * v + (60 + 420 * yielding) * np.tanh(v / 0.03) + 900 * x + 25
    columns = (t, 1e3 * x, current, force + 2.0 * rng.standard_normal(t.size))
    rows = (",".join(f"{c:.7g}" for c in row) for row in zip(*columns, strict=True))
    return "\n".join(["time [s],displacement [mm],current [A],force [N]", *rows]) + "\n"


@dataclass(frozen=True)
class Done:
    """What one task took.

    Attributes
    ----------
    task : str
    commands : tuple of str
    seconds, processor : float
        On the clock and of the processors [s].
    code : int
        The first exit code that is not 0.
    headline : str
        First line that the last command printed.
    report : int
        Size of its report [bytes]; 0 where there is none.
    """

    task: str
    commands: tuple[str, ...]
    seconds: float
    processor: float
    code: int
    headline: str
    report: int

    @property
    def reached(self) -> bool:
        """Whether it ended well, in few commands and in time."""
        return self.code == 0 and len(self.commands) <= MOST_COMMANDS and self.processor <= MOST_SECONDS


def do(task: str, folder: Path) -> Done:
    """Run the commands of a task as a user would."""
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    begun, code, headline = time.perf_counter(), 0, ""
    for line in TASKS[task]:
        package, *rest = shlex.split(line)
        run = subprocess.run([sys.executable, "-m", package, *rest], cwd=folder, capture_output=True, text=True)
        code = code or run.returncode
        headline = next(iter((run.stdout.strip() or run.stderr.strip()).splitlines()), "")
        if run.returncode:
            headline = next(iter(run.stderr.strip().splitlines()[-1:]), headline)
            break
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - spent.ru_utime - spent.ru_stime
    report = folder / TASKS[task][-1].rpartition(" ")[2] / "report.html"
    return Done(task, TASKS[task], time.perf_counter() - begun, processor, code, headline,
                report.stat().st_size if report.is_file() else 0)


def table(rows: list[Done]) -> str:
    """Markdown."""
    lines = ["| task | commands | clock, s | processors, s | exit | report, kB | headline |", "|---" * 7 + "|"]
    for row in rows:
        shown = "; ".join(f"`{c}`" for c in row.commands)
        lines.append(f"| {row.task} | {shown} | {row.seconds:.1f} | {row.processor:.1f} | {row.code} | "
                     f"{row.report // 1000} | {row.headline[:160].replace('|', '/')} |")
    return "\n".join(lines)


def main() -> None:
    """Run all tasks; exit code 1 where one misses its aim."""
    parser = argparse.ArgumentParser(description="ten tasks of a new user")
    parser.add_argument("files", nargs="*", type=Path, help="RUN.csv NEW.csv; left out, a record is made")
    parser.add_argument("--keep", type=Path, help="folder for files and reports; left out, they are removed")
    asked = parser.parse_args()
    with TemporaryDirectory() as temporary:
        folder = asked.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for i, name in enumerate(("run.csv", "new.csv")):
            text = asked.files[i].read_text(encoding="utf-8") if asked.files else record(i)
            (folder / name).write_text(text, encoding="utf-8")
        rows = []
        for task in TASKS:
            rows.append(do(task, folder))
            print(table(rows[-1:]).splitlines()[-1], file=sys.stderr, flush=True)
    print(table(rows))
    missed = [row.task for row in rows if not row.reached]
    print(f"{len(rows) - len(missed)} of {len(rows)} within {MOST_COMMANDS} commands and {MOST_SECONDS:.0f} s of "
          f"processor time{': not ' + ', '.join(missed) if missed else ''}")
    sys.exit(bool(missed))


if __name__ == "__main__":
    main()
