"""Processor time and free-run figures of every damper model that `quartercar fit --models all` fits.

    python tests/benchmarks/fit_times.py [DATA.csv …] [--duration 30] [--only guo,spencer] [--table FILE.json]

Without data, one record of the virtual rig (test 1, 512 Hz, seed 1), its last third held out. Each fit is made by one
process, after one on a tenth of its samples that compiles what there is to compile. ``--table`` keeps the figures and
prints those that stood there beside the new ones, so that a change of the search shows what it costs in fit.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import lpvid as lpv  # noqa: E402
from quartercar.dampers import model_names  # noqa: E402
from quartercar.dampers.evaluation import comparison  # noqa: E402
from quartercar.dampers.evaluation.scoring import score  # noqa: E402
from quartercar.dampers.facts import Facts  # noqa: E402
from quartercar.dampers.preparing import prepare  # noqa: E402
from quartercar.rig import EXPERIMENTS, Rig  # noqa: E402


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", nargs="*")
    parser.add_argument("--duration", type=float, default=30.0)
    parser.add_argument("--only", default="")
    parser.add_argument("--table", type=Path)
    given = parser.parse_args()
    records = lpv.read(given.data) if given.data else [
        Rig().run(replace(EXPERIMENTS["test-1"], duration=given.duration), seed=1)]
    training, kept, _ = comparison._held_out(records, None)
    data, settings = prepare(training, kept), comparison.CompareSettings()
    suited, refused = comparison._suited(list(model_names()), Facts.of(data.training, data.polarity))
    before = json.loads(given.table.read_text()) if given.table and given.table.exists() else {}
    found: dict[str, dict] = {}
    print(f"{'model':<26} {'seconds':>8} {'training':>10} {'held-out':>10}   before: seconds, training, held-out ESR")
    for damper in suited:
        if given.only and damper.name not in given.only.split(","):
            continue
        job = comparison._job(damper, data, settings)
        brief = tuple(r.slice(0, max(r.n_samples // 10, 400)) for r in job[1])
        with suppress(ArithmeticError, ValueError):  # too short for this model: it compiles in the clock
            comparison._fitted((job[0], brief, replace(job[2], starts=1, polished=1, evaluations=2)))
        begun = time.process_time()
        try:
            fitted = comparison._fitted(job).damper
        except ArithmeticError as error:
            print(f"{damper.name:<26} failed: {error}", flush=True)
            continue
        spent = time.process_time() - begun
        esr = [score(fitted, part, fitted.start).total.esr for part in (data.training, data.held_out)]
        found[damper.name] = {"seconds": spent, "training": esr[0], "held_out": esr[1]}
        old = before.get(damper.name)
        beside = "" if old is None else f"   {old['seconds']:8.2f} {_esr(old['training'])} {_esr(old['held_out'])}"
        print(f"{damper.name:<26} {spent:8.2f} {_esr(esr[0])} {_esr(esr[1])}{beside}", flush=True)
    print(f"{'together':<26} {sum(f['seconds'] for f in found.values()):8.2f}; not suited: "
          f"{', '.join(n for n, _ in refused) or '-'}")
    if given.table:
        given.table.write_text(json.dumps({**before, **found}, indent=1))


def _esr(value: float | None) -> str:
    return f"{'diverges':>10}" if value is None else f"{value:10.6f}"


if __name__ == "__main__":
    main()
