"""Figures are at hand after one import."""

import subprocess
import sys


def test_plot_is_there_after_import_and_loads_nothing_by_itself() -> None:
    probe = ("import sys, lpvid as lpv, quartercar as qc; before = 'matplotlib' in sys.modules; "
             "print(before, callable(lpv.plot.bode), callable(qc.plot.ranking))")
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False True True"
