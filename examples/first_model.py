"""From rig records to a validated LPV damper model: which steps, in which order?"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import lpvid as lpv
from lpvid import plot
from lpvid.condition import split_tail
from quartercar.rig import EXPERIMENTS, Rig, write_csv


def main(folder: Path, figure: Path | None = None) -> float:
    """Identify from two records, validate on their last third; returns the held-out free-run ESR."""
    runs = {name: Rig().run(EXPERIMENTS[name], seed=7) for name in ("test-1", "test-3")}
    files = [write_csv(run, folder / f"{name}.csv") for name, run in runs.items()]

    records = lpv.read(files)
    print(lpv.audit(records))

    pairs = [split_tail(record) for record in records]
    training, held_out = [a for a, _ in pairs], [b for _, b in pairs]
    structure = lpv.ARX(na=4, nb=4, nk=0, input="velocity", output="force", stage="tanh", affine=1,
                        basis=lpv.Polynomial("current", degree=1))
    found = lpv.identify(training, structure, held_out=held_out)
    print(found)

    path = folder / "damper.json"
    lpv.save(found.model, path)
    again = lpv.validate(lpv.load(path), held_out)
    print(again)
    shown = plot.compare(found.model, split_tail(runs["test-1"])[1], "held-out")
    plot.show(plot.free_run(shown, scheduling=["current"]), figure)
    esr = again.overall.free_run.esr
    assert esr is not None
    return esr


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp())
    target.mkdir(parents=True, exist_ok=True)
    main(target)
