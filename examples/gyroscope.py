"""How far does one least squares get on the gyroscope benchmark? Usage: gyroscope.py estimation.csv [model.json]"""

from __future__ import annotations

import sys

import lpvid as lpv
from lpvid import plot
from lpvid.condition import split_tail


def main(path: str, model_path: str | None = None, figure: str | None = None) -> float:
    """Train on the first two thirds, return the free-run fit in percent on the last third."""
    training, held_out = split_tail(lpv.read(path)[0])
    structure = lpv.ARX(na=4, nb=4, nk=1, input="motor current", output="gimbal speed", affine=5, lagged=True,
                        basis=lpv.Polynomial(("p1", "p2", "p3"), degree=1))
    found = lpv.identify([training], structure, held_out=[held_out])
    print(found)
    if model_path is not None:
        lpv.save(found.model, model_path)
    plot.show(plot.free_run(plot.compare(found.model, held_out, "held-out"), ["p1", "p2", "p3"]), figure)
    assert found.held_out is not None
    fit = found.held_out.overall.free_run.fit_percent
    assert fit is not None
    return fit


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit("usage: gyroscope.py estimation.csv [model.json]; docs/benchmarks.md states where the data are")
    main(*sys.argv[1:])
