"""The diagnosis by the user's command, in a process of its own with a time limit: a row of plain data."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

TRACEBACK = "Traceback (most recent call last)"
COMMAND = "import sys; from lpvid.cli import main; sys.exit(main())"


def diagnose(data: Sequence[str], baseline: str, options: Sequence[str] = (), held_out: Sequence[str] = (),
             limit: float = 180.0) -> dict:
    """Run ``lpvid diagnose`` and read what it wrote.

    Parameters
    ----------
    data, held_out : sequence of str
        Files.
    baseline : str
    options : sequence of str
        Further words of the command line.
    limit : float
        Seconds after which the process is ended.

    Returns
    -------
    dict
        ``outcome`` (answered, refused, traceback, timeout), ``seconds``, and where it answered ``verdict``, ``named``,
        ``probabilities``, ``families``, ``rivals``, ``stand_ins``, ``before`` and ``after`` (free-run ESR, held-out).
    """
    with tempfile.TemporaryDirectory() as folder:
        words = ["diagnose", *data, "--baseline", baseline, *options, "--out", folder]
        for file in held_out:
            words += ["--held-out", file]
        begun = time.perf_counter()
        code, errors = _run([sys.executable, "-c", COMMAND, *words], limit)
        row: dict = {"seconds": round(time.perf_counter() - begun, 1), "code": code}
        path = Path(folder) / "diagnosis.json"
        if code is None:
            return row | {"outcome": "timeout"}
        if TRACEBACK in errors:
            return row | {"outcome": "traceback", "said": errors.strip().splitlines()[-1][-300:]}
        if code or not path.exists():
            return row | {"outcome": "refused", "said": errors.strip()[-300:]}
        return row | {"outcome": "answered"} | summary(json.loads(path.read_text(encoding="utf-8")))


def summary(found: dict) -> dict:
    """What a score is made of, from ``diagnosis.json``."""
    before = found["baseline"]
    spread = before["rmse"] / before["esr"]["held_out"] ** 0.5 if before["esr"]["held_out"] else float("nan")
    return {"verdict": found["verdict"], "reason": found["reason"], "named": [c["name"] for c in found["causes"]],
            "parameters": {c["name"]: {p["name"]: p["value"] for p in c["parameters"]} for c in found["causes"]},
            "probabilities": [c.get("probability") for c in found["causes"]],
            "changes": {c["name"]: c["contribution"] / spread for c in found["causes"]},
            "families": found.get("families", []), "posterior": found.get("probabilities", {}),
            "sets": [[s["names"], s["probability"]] for s in found.get("sets", [])][:4],
            "rivals": [r["names"] for r in found["rivals"]], "stand_ins": found["extended"]["stand_ins"],
            "before": found["baseline"]["esr"]["held_out"], "after": found["extended"]["esr"]["held_out"],
            "rejected": [[r["name"], r["why"]] for r in found["rejected"]][:8]}


def _run(words: list[str], limit: float) -> tuple[int | None, str]:
    """Exit code (None beyond the limit) and standard error; the process and its children end with it."""
    environment = os.environ | {"COLUMNS": "200", "NO_COLOR": "1"}
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=environment,
                          start_new_session=True) as process:
        try:
            _, errors = process.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            return None, ""
        except BaseException:  # Ctrl-C here must not leave it computing
            os.killpg(process.pid, signal.SIGKILL)
            raise
    return process.returncode, errors
