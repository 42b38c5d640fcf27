"""The model of Díaz Salas (2011) in every sense of the word: free-run ESR of each, experiment by experiment, held-out.

    python tests/benchmarks/thesis_study.py [TEST…]

The split of `examples/compare_dampers.py`: training on replicate 0 of tests 1-3 and the seven constant currents of test
6; held-out are other roads and currents of all eight experiments. Order 4, coefficients of first degree in the current,
three zones. About five minutes on one core.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence

import lpvid as lpv
from lpvid.identification.zone_regression import regress_zones
from quartercar.rig import EXPERIMENTS, default_records

SETTINGS = {"input": "velocity", "output": "force", "basis": lpv.Polynomial("current", degree=1)}


def models(training: Sequence[lpv.Record], constant: Sequence[lpv.Record]) -> Iterator[tuple[str, object]]:
    """Every model with its name, in the order of the table."""
    direct = lpv.identify(training, lpv.ARX(4, 4, 0, stage="three-zone", **SETTINGS)).model
    yield "transfer function, b_0 (nk = 0)", direct
    plain = lpv.identify(training, lpv.ARX(4, 4, 1, stage="three-zone", **SETTINGS)).model
    yield "transfer function, D = 0 (3.13)", plain
    realized = lpv.realize(plain, "controllable")
    yield "its canonical form (3.23)", realized.model
    yield "coprime fit of that form", lpv.identify(training, lpv.RightCoprime(4, 4, stage="three-zone",
                                                                             **SETTINGS)).model
    held = lpv.refit_form(realized, training, stages=False)
    yield "form re-estimated, zones held", held.model
    refit = lpv.refit_form(realized, training)
    print(refit, file=sys.stderr)
    yield "form re-estimated, zones too", refit.model
    yield "same with b_0 (nk = 0)", lpv.refit_form(direct, training, form="controllable").model
    yield "same, observable form, D = 0", lpv.refit_form(plain, training, form="observable").model
    lagged = lpv.identify(training, lpv.ARX(4, 4, 1, stage="three-zone", schedule_filter="rise-fall", **SETTINGS)).model
    yield "same with a lag of the current", lpv.refit_form(lagged, training, form="controllable").model
    second = {**SETTINGS, "basis": lpv.Polynomial("current", degree=2)}
    curved = lpv.identify(training, lpv.ARX(4, 4, 1, stage="three-zone", **second)).model
    yield "same of second degree", lpv.refit_form(curved, training, form="controllable").model
    zones = regress_zones(constant)
    print(zones, file=sys.stderr)
    level = lpv.identify(training, lpv.ARX(4, 4, 1, stage=zones.stage, **SETTINGS)).model
    yield "zones by level (3.14)-(3.22), D = 0", level
    yield "its canonical form (3.23)", lpv.realize(level, "controllable").model
    yield "form re-estimated, zones held", lpv.refit_form(level, training, form="controllable", stages=False).model
    yield "form re-estimated, lines too", lpv.refit_form(level, training, form="controllable").model


def main(tests: Sequence[str] = tuple(EXPERIMENTS)) -> None:
    """Print the table."""
    training = default_records(part="training")
    kept = default_records(part="held-out") + default_records(1, "training", ["test-6"])
    held_out = {name: [r for r in kept if r.name.startswith(name)] for name in tests}
    print(f"{'free-run ESR, held-out':<38}{''.join(f'{n:>8}' for n in tests)}{'mean':>9}{'s':>6}")
    begun = time.perf_counter()
    for title, model in models(training, [r for r in training if r.name.startswith("test-6")]):
        esr = [lpv.validate(model, runs).overall.free_run.esr for runs in held_out.values()]  # type: ignore[arg-type]
        mean = None if None in esr else sum(e for e in esr if e is not None) / len(esr)
        shown = "".join(f"{'div.' if e is None else format(e, '.4f'):>8}" for e in esr)
        print(f"{title:<38}{shown}{'–' if mean is None else format(mean, '.4f'):>9}"
              f"{time.perf_counter() - begun:6.0f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or tuple(EXPERIMENTS))
