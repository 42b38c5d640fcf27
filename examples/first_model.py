"""From rig records to a validated LPV damper model: which steps, in which order?"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import lpvid as lpv
from lpvid.condition import split_tail
from quartercar.rig import EXPERIMENTS, Rig, write_csv


def main(folder: Path) -> float:
    """Identify from two records, validate on their last third; returns the held-out free-run ESR."""
    files = [write_csv(Rig().run(EXPERIMENTS[name], seed=7), folder / f"{name}.csv") for name in ("test-1", "test-3")]

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
    esr = again.overall.free_run.esr
    assert esr is not None
    return esr


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(tempfile.mkdtemp())
    target.mkdir(parents=True, exist_ok=True)
    main(target)
