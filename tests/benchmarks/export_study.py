"""Exports in figures: error against the simulation in both precisions, time of a step, size of code and data.

    python tests/benchmarks/export_study.py            C: one row per kind and precision
    python tests/benchmarks/export_study.py --forms    FMU, Octave, Modelica and python-control: one row per kind

Compiled with ``cc -O2``; the time is the mean over a million steps along the trajectory of the self-test, the code size
that of the object file's text segment (``size``). With --forms, every error is what the export itself prints, relative
to the largest output, along a random trajectory against this package's own simulation; continuous models go to model
exchange, with the error of their directional derivatives beside that of derivatives and outputs.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.export.c_build import compile_c, find_compiler, run_self_test
from lpvid.export.c_source import FLAGS, c_files
from lpvid.export.exportable import Exportable, Options, exportable
from lpvid.export.exporting import Content, content
from lpvid.synthesis.saturated import saturate
from quartercar.controllers import law_class
from quartercar.controllers.contract import Setting
from quartercar.controllers.loop.chain import ChainSettings
from quartercar.controllers.loop.sensing import SETS
from quartercar.dampers import (
    BoucWen,
    ExtendedBoucWen,
    ForceMap,
    Guo,
    Guo5,
    Guo6,
    Guo7,
    Guo15,
    Kwok,
    PowerLaw,
    PowerLawFrictionGas,
    WangKamath,
)
from quartercar.export import EXPORTER
from quartercar.export.loop_steps import LoopLaw
from quartercar.parameters import MEGANE
from quartercar.rides.default_damper import identified_damper
from quartercar.vehicle.nonlinear import Coil

STEPS = 1_000_000


def cases() -> dict[str, Exportable]:
    """What is exported, by name."""
    rng = np.random.default_rng(0)
    box = lpv.Scheduling(("current",), (0.0,), (2.5,), units=("A",))

    def system(basis: Any, order: int) -> lpv.LPVStateSpace:
        m = basis.size
        return lpv.LPVStateSpace(0.5 * rng.normal(size=(m, order, order)) / (m * order**0.5),
                                 rng.normal(size=(m, order, 2)), rng.normal(size=(m, 1, order)),
                                 rng.normal(size=(m, 1, 2)), basis, 0.002, box)

    damper = identified_damper()
    found = {"lpv-arx damper, order 2": EXPORTER.prepare(damper, Options()),
             "state space, 8 states, affine": exportable(system(lpv.Polynomial(("current",), 1).bound(box), 8)),
             "state space, 8 states, grid of 9": exportable(system(lpv.Spline("current", 8, 1).bound(box), 8)),
             "state space, 8 states, cubic": exportable(system(lpv.Spline("current", 4, 3).bound(box), 8)),
             "state space, 8 states, Fourier 2": exportable(system(lpv.Fourier("current", 2), 8)),
             "controller, 8 states, limits": exportable(saturate(
                 system(lpv.Polynomial(("current",), 1).bound(box), 8), {"y1": 0.5}, 0.1 * rng.normal(size=(8, 1))))}
    dampers = {"guo": Guo(degree=1, current_range=(0.0, 2.0)), "kwok": Kwok(degree=1, current_range=(0.0, 2.0)),
               "force-map, 3 nodes": ForceMap(nodes=(0.0, 1.0, 2.0), current_range=(0.0, 2.0)),
               "extended-bouc-wen, 3 nodes": ExtendedBoucWen(nodes=(0.0, 1.0, 2.0), current_range=(0.0, 2.0))}
    span: dict[str, Any] = {"current_range": (0.0, 2.0)}
    more = {"guo-5": Guo5(**span), "guo-6": Guo6(**span), "guo-7": Guo7(**span), "guo-15": Guo15(**span),
            "power-law": PowerLaw(), "power-law-friction-gas": PowerLawFrictionGas()}
    found |= {name: EXPORTER.prepare(d, Options()) for name, d in {**dampers, **more}.items()}
    for law, sensors, known in (("skyhook", "stroke-body", damper), ("skyhook", "stroke-body", dampers["guo"]),
                                ("clipped-optimal", "stroke-body-wheel", dampers["guo"]),
                                ("skyhook", "stroke-body", dampers["extended-bouc-wen, 3 nodes"])):
        setting = Setting(known.clock or 0.002, 1, MEGANE, known, (0.0, 2.0))
        loop = LoopLaw(law_class(law)(), setting, Coil(0.005, 0.010, 0.0, 2.0), ChainSettings(SETS[sensors]))
        found[f"loop: {law} on {known.name}"] = EXPORTER.prepare(loop, Options())
    return found


def timing(found: Exportable, precision: str) -> tuple[float, int]:
    """Nanoseconds per step, and bytes of code."""
    name = found.program.name
    files = c_files(found, precision)
    main = files[f"{name}_test.c"].split("int main(void)")[0] + f"""#include <time.h>
int main(void)
{{
    {name}_states s;
    {name}_inputs u;
    {name}_outputs y;
    double sum = 0.0;
    {name}_init(&s);
    const clock_t begin = clock();
    for (long k = 0; k < {STEPS}L; k++) {{
{chr(10).join(f'        u.{q.name} = test_inputs[k % SAMPLES][{i}];' for i, q in enumerate(found.program.inputs))}
        {name}_step(&{name}_defaults, &s, &u, &y);
        sum += (double)y.{found.program.outputs[0].name};
    }}
    const double seconds = (double)(clock() - begin) / (double)CLOCKS_PER_SEC;
    printf("%g %g %g\\n", 1e9 * seconds / {STEPS}.0, sum, test_outputs[0][0]);
    return 0;
}}
"""
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        for file, text in {**files, f"{name}_test.c": main}.items():
            (home / file).write_text(text, encoding="utf-8")
        compile_c([home / f"{name}.c", home / f"{name}_test.c"], home / "run")
        ran = subprocess.run([str(home / "run")], capture_output=True, text=True, check=True)
        unit = str(home / "unit.o")
        subprocess.run([find_compiler() or "cc", *FLAGS, "-c", str(home / f"{name}.c"), "-o", unit], check=True)
        listed = subprocess.run(["size", unit], capture_output=True, text=True, check=True).stdout
    return float(ran.stdout.split()[0]), int(re.findall(r"\d+", listed.splitlines()[1])[0])


FORMS = ("fmu2", "fmu3", "matlab", "modelica", "control")


def continuous() -> dict[str, Any]:
    """Models that an importer integrates."""
    box = lpv.Scheduling(("rho",), (0.0,), (1.0,))
    a = np.array([[[-1.0, 2.0], [-2.0, -3.0]], [[0.0, 1.0], [-1.0, -1.0]]])
    rng = np.random.default_rng(0)
    model = lpv.LPVStateSpace(a, rng.normal(size=(2, 2, 1)), rng.normal(size=(2, 1, 2)), rng.normal(size=(2, 1, 1)),
                              lpv.Polynomial("rho", 1), None, box)
    span: dict[str, Any] = {"current_range": (0.0, 2.0)}
    return {"continuous state space": model, "bouc-wen": BoucWen(**span), "wang-kamath": WangKamath(degree=2, **span)}


def figures(made: Content) -> str:
    """Every relative error that an export prints, and a mark where it did not pass."""
    errors = [e for check in made.checks for e in re.findall(r"error ([-+.\de]+)", check)]
    return " ".join(errors or ["not run"]) + ("" if made.passed else " FAILED")


def forms() -> None:
    """One row per kind: the errors of every form."""
    print("| kind | " + " | ".join(FORMS) + " |\n|" + "---|" * (1 + len(FORMS)))
    for name, noun in {**cases(), **continuous()}.items():
        row = []
        for form in FORMS:
            try:
                row.append(figures(content(noun, form)))
            except InputError:
                row.append("–")
        print(f"| {name} | " + " | ".join(row) + " |", flush=True)


def main() -> None:
    if "--forms" in sys.argv[1:]:
        forms()
        return
    if find_compiler() is None or shutil.which("size") is None:
        sys.exit("this study needs a C compiler and binutils")
    print(f"{'kind':40s} {'precision':9s} {'error':>8s} {'rounding':>8s} {'ns/step':>8s} {'code+const':>10s} "
          f"{'state':>6s} {'assignments':>11s}")
    for name, found in cases().items():
        for precision in ("double", "float"):
            test = run_self_test(c_files(found, precision))
            time, size = timing(found, precision)
            share = f"{found.rounding():.1e}" if precision == "float" else ""
            print(f"{name:40s} {precision:9s} {test.error:8.1e} {share:>8s} {time:8.0f} {size:10d} "
                  f"{test.state_bytes:6d} {found.program.operations():11d}")


if __name__ == "__main__":
    main()
