"""The system's C compiler: found, asked to compile, and the self-test run."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from lpvid.errors import InputError, NumericalError
from lpvid.export.c_source import FLAGS

COMPILERS = ("cc", "gcc", "clang")
"""Names that are looked for, after the environment's CC."""
PATIENCE = 120
"""seconds after which a compiler, a self-test or Octave is stopped"""


@dataclass(frozen=True)
class SelfTest:
    """What the compiled self-test printed.

    Attributes
    ----------
    passed : bool
    error : float
        Largest error, relative to the largest reference output.
    state_bytes, parameter_bytes : int
    compiler : str
    """

    passed: bool
    error: float
    state_bytes: int
    parameter_bytes: int
    compiler: str


def find_compiler() -> str | None:
    """The path of a C compiler: the environment's CC, else cc, gcc or clang; None where there is none.

    Returns
    -------
    str or None
        Path of the first of these on the PATH; of CC its first word alone, without options.
    """
    wanted = os.environ.get("CC", "").split()[:1]
    return next((path for name in (*wanted, *COMPILERS) if (path := shutil.which(name)) is not None), None)


def compile_c(sources: Sequence[Path], target: Path, extra: Sequence[str] = (), compiler: str | None = None) -> None:
    """Compile and link C files.

    Parameters
    ----------
    sources : sequence of Path
        C files; headers are looked for beside them.
    target : Path
        Program or library to write.
    extra : sequence of str
        Further options of the compiler, behind `lpvid.export.c_source.FLAGS`.
    compiler : str, optional
        Path of a compiler; left out, that of `find_compiler`.

    Raises
    ------
    InputError
        No compiler; one that refuses the files, with its first line.
    """
    chosen = compiler or find_compiler()
    if chosen is None:
        raise InputError("there is no C compiler", got="no CC, cc, gcc or clang on the PATH",
                         mend="install gcc or clang, or set CC")
    done = run_tool([chosen, *FLAGS, *extra, *map(str, sources), "-lm", "-o", str(target)])
    if done.returncode:
        text = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr.strip())
        raise InputError("the C compiler refused the exported files", got=text[:300], mend="try another CC")


def run_self_test(files: Mapping[str, str], extra: Sequence[str] = (), compiler: str | None = None) -> SelfTest:
    """Compile exported files in a folder of their own, and run their self-test.

    Parameters
    ----------
    files : mapping of str to str
        As `lpvid.export.c_source.c_files` gives them.
    extra : sequence of str
        Further options of the compiler, ``-fsanitize=address,undefined`` for instance.
    compiler : str, optional

    Returns
    -------
    SelfTest
        What the test printed; `passed` is False where the error exceeds the limit.

    Raises
    ------
    InputError
        No compiler.
    NumericalError
        A self-test that does not end as it should.
    """
    chosen = compiler or find_compiler()
    with tempfile.TemporaryDirectory(prefix="lpvid-c-") as folder:
        home = Path(folder)
        for name, text in files.items():
            (home / name).write_text(text, encoding="utf-8")
        target = home / "self_test"
        compile_c([home / name for name in files if name.endswith(".c")], target, extra, chosen)
        done = run_tool([str(target)])
    number = r"([-+.\w]+)"
    found = re.search(rf"relative error {number}, limit {number}, states (\d+) bytes, parameters (\d+) bytes",
                      done.stdout)
    if found is None or done.returncode not in (0, 1):
        raise NumericalError(f"the self-test ended with {done.returncode}: {(done.stderr or done.stdout)[:300]}")
    return SelfTest(done.returncode == 0, float(found[1]), int(found[3]), int(found[4]), Path(str(chosen)).name)


def run_tool(command: Sequence[str], folder: str | None = None) -> subprocess.CompletedProcess[str]:
    """A program of the system, its output caught; InputError where it does not run or does not end.

    Parameters
    ----------
    command : sequence of str
        Program and its arguments; no shell is involved.
    folder : str, optional
        Working folder; left out, the present one.

    Returns
    -------
    subprocess.CompletedProcess
        With `stdout` and `stderr` as text; a return code other than 0 is left to the caller.

    Raises
    ------
    InputError
        A program that cannot be started, or that runs for more than `PATIENCE` seconds.
    """
    try:
        return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=PATIENCE, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise InputError(f"'{command[0]}' does not run", why=str(error)) from None
