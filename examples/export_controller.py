"""Can this damper and its controller run on a microcontroller, and in a tool that takes FMUs?

The identified damper of the virtual rig and a whole loop law (observer, skyhook, inverse damper: from two sensors to a
current) become C99 in both precisions and FMUs. Where a C compiler, FMPy or Octave is missing, that part is left out.
"""

from __future__ import annotations

import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import lpvid as lpv
from lpvid.export.c_build import find_compiler, run_self_test
from lpvid.export.c_source import c_files
from lpvid.export.exportable import Options
from lpvid.export.exporting import content
from lpvid.export.matlab import find_octave
from lpvid.plot import show
from lpvid.plot.style import look, panels
from quartercar.controllers import law_class
from quartercar.controllers.contract import Setting
from quartercar.export import EXPORTER
from quartercar.export.loop_steps import LoopLaw
from quartercar.parameters import MEGANE
from quartercar.rides.default_damper import identified_damper
from quartercar.vehicle.nonlinear import Coil


def main(folder: str | Path, figure: str | None = None) -> dict[str, float]:
    damper = identified_damper()
    assert damper.clock is not None
    setting = Setting(damper.clock, 1, MEGANE, damper, (0.0, 2.0))
    loop = LoopLaw(law_class("skyhook")(), setting, Coil(0.005, 0.010, 0.0, 2.0))
    errors: dict[str, float] = {}
    for name, noun in (("damper", damper), ("loop", loop)):
        found = EXPORTER.prepare(noun, Options(name=name))  # lpv.exportable(noun) finds it too
        made = lpv.export_c(found, Path(folder) / name)
        print(made)
        if find_compiler():
            for precision in ("double", "float"):
                errors[f"{name}, {precision}"] = run_self_test(c_files(found, precision)).error
    forms = ["fmu2", "fmu3"] if find_spec("fmpy") and find_compiler() else []
    for form in [*forms, *(["matlab"] if find_octave() else [])]:
        print(*content(damper, form, Options(name="damper")).checks, sep="\n")
    with look():
        canvas, ((axes,),) = panels(1, 1, height=2.2)
        axes.barh(list(errors), [max(e, 1e-17) for e in errors.values()], height=0.5)
        axes.set(xscale="log", xlabel="largest relative error of the compiled C against the simulation [1]")
        show(canvas, figure)
    return errors


if __name__ == "__main__":
    print(main(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp()))
