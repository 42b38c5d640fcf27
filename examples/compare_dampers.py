"""Which damper model simulates the eight experiments of the thesis best, on roads and currents it has not seen?"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from lpvid.plot import show
from quartercar import plot
from quartercar.dampers import LpvArx, compare, fit
from quartercar.rig import default_records

THESIS = ("guo", "guo-5", "guo-6", "guo-7", "guo-15", "bouc-wen", "kwok", "wang-kamath", "narx-2", "narx-3", "lpv-arx")
"""Models that Díaz Salas (2011) compares; the others are beyond it."""
BEYOND = ("quasi-lpv", "compliance")
LABEL = "three zones"
FORMS = {"lpv-arx": "the LPV model with tanh, lag of the current and affine term, by simulation error",
         f"lpv-arx ({LABEL})": "the LPV model in the thesis's own form: three zones, by least squares"}


def main(models: Sequence[str] = (*THESIS, *BEYOND), tests: Sequence[str] | None = None,
         figure: str | None = None) -> dict[str, float]:
    """Train on replicate 0 of tests 1-3 and on test 6; returns the mean ESR over experiments, all of them held out."""
    training = default_records(part="training", names=tests)
    held_out = default_records(part="held-out", names=tests)
    if tests is None or "test-6" in tests:  # constant currents again, on roads of another seed
        held_out += default_records(1, "training", ["test-6"])
    own = []
    if "lpv-arx" in models:
        printed = fit(LpvArx(shape="three-zone"), training).damper
        own = [printed.replace(metadata={**printed.metadata, "label": LABEL})]
    found = compare(training, [*models, *own], held_out, progress=lambda text: print(text, file=sys.stderr))
    print(found)

    names = [name for name, _ in found.best.held_out.experiments]
    print(f"\n  {'free-run ESR, held-out':<24}{''.join(f'{n:>8}' for n in names)}{'mean':>8}")
    means: dict[str, float] = {}
    for row in found.rows:
        esr = [run.esr for _, run in row.held_out.experiments]
        if None not in esr:
            means[row.name] = sum(e for e in esr if e is not None) / len(esr)
        shown = "".join(f"{'–' if e is None else format(e, '.4f'):>8}" for e in (*esr, means.get(row.name)))
        print(f"  {row.name:<24}{shown}")

    ranked = sorted(means, key=lambda name: means[name])
    print("\n  by mean, models of the thesis:")
    for place, name in enumerate([name for name in ranked if name not in BEYOND], start=1):
        print(f"  {place:>3}  {FORMS.get(name, name)}")
    beyond = [f"{name} (place {place} of all)" for place, name in enumerate(ranked, start=1) if name in BEYOND]
    print(f"  beyond the thesis: {', '.join(beyond)}" if beyond else "")
    drawn = plot.experiments_by_model(found)
    if drawn is not None:
        show(drawn, figure)
    return means


if __name__ == "__main__":
    main(figure=sys.argv[1] if len(sys.argv) > 1 else None)
