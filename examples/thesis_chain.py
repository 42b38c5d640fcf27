"""What does the chain of the thesis give: identify, realise, re-estimate the form, critical current, certificate?"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import lpvid as lpv
from lpvid import plot
from quartercar.rig import EXPERIMENTS, default_records

SETTINGS = {"input": "velocity", "output": "force", "basis": lpv.Polynomial("current", degree=1), "stage": "three-zone"}


def show(models: Mapping[str, object], tests: Sequence[str]) -> dict[str, float]:
    """Free-run ESR of every model on every test, with roads and currents that no fit has seen; returns the means."""
    kept = default_records(part="held-out") + default_records(1, "training", ["test-6"])
    held_out = {name: [r for r in kept if r.name.startswith(name)] for name in tests}
    means = {}
    print(f"{'free-run ESR, held-out':<34}{''.join(f'{n:>8}' for n in tests)}{'mean':>8}")
    for title, model in models.items():
        esr = [lpv.validate(model, runs).overall.free_run.esr for runs in held_out.values()]  # type: ignore[arg-type]
        means[title] = sum(float("inf") if e is None else e for e in esr) / len(esr)
        print(f"{title:<34}{''.join('    div.' if e is None else f'{e:>8.4f}' for e in (*esr, means[title]))}")
    return means


def main(tests: Sequence[str] = tuple(EXPERIMENTS), figure: Path | None = None) -> dict[str, float]:
    """Print every figure beside the others; returns the mean ESR of every model."""
    training = default_records(part="training")
    direct = lpv.identify(training, lpv.ARX(na=4, nb=4, nk=0, **SETTINGS)).model
    plain = lpv.identify(training, lpv.ARX(na=4, nb=4, nk=1, **SETTINGS)).model
    realized = lpv.realize(plain, "controllable")
    coprime = lpv.identify(training, lpv.RightCoprime(na=4, nb=4, **SETTINGS)).model
    refit = lpv.refit_form(realized, training)
    means = show({"transfer function, with b_0": direct, "transfer function, D = 0 (3.13)": plain,
                  "its canonical form (3.23)": realized.model, "coprime fit of that form": coprime,
                  "canonical form re-estimated": refit.model}, tests)
    print(refit)
    critical = lpv.critical_scheduling(refit.model)
    certificate = lpv.certify_stability(refit.model)
    print(critical, certificate, lpv.verify(certificate, refit.model), sep="\n")
    plot.show(plot.locus(lpv.pole_locus(refit.model), critical=critical), figure)
    return means


if __name__ == "__main__":
    main(figure=Path(sys.argv[1]) if len(sys.argv) > 1 else None)
