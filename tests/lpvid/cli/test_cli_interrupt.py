"""Ctrl-C while a program loads its modules: exit code 130 and one line, at any time after its entry point."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

START = """
import signal
signal.signal(signal.SIGINT, signal.{handler})  # whatever the shell of the tests set
from {package}.cli import main
print("begun", flush=True)
main()
"""


def interrupted(package: str, delay: float, handler: str = "default_int_handler") -> subprocess.CompletedProcess[str]:
    """The program with a command that ends with 2, sent SIGINT `delay` seconds [s] after its entry point."""
    words = {"lpvid": ["identify", "nowhere.csv"], "quartercar": ["fit", "nowhere.csv"]}[package]
    code = START.format(package=package, handler=handler)
    with subprocess.Popen([sys.executable, "-c", code, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"
        time.sleep(delay)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    return subprocess.CompletedProcess(words, process.returncode, out, err)


@pytest.mark.parametrize("package", ["lpvid", "quartercar"])
@pytest.mark.parametrize("delay", [0.005, 0.02, 0.05, 0.08, 0.12])
def test_ctrl_c_among_the_imports_ends_with_130_and_one_line(package, delay):
    done = interrupted(package, delay)
    assert (done.returncode, done.stderr, done.stdout) == (130, "interrupted: nothing was written\n", "")


@pytest.mark.parametrize("delay", [0.2, 0.3, 0.45])
def test_ctrl_c_near_the_command_never_ends_with_a_traceback(delay):
    done = interrupted("lpvid", delay)
    assert done.returncode in (130, 2, -signal.SIGINT)  # the last two where the command was done before
    assert done.stderr.count("\n") == 1
    assert "Traceback" not in done.stderr


@pytest.mark.seconds
def test_a_program_in_the_background_ignores_it():
    done = interrupted("lpvid", 0.05, "SIG_IGN")
    assert done.returncode == 2
    assert "there is no such file" in done.stderr


COMPILING = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from ctypes import CFUNCTYPE
import typer
from lpvid.cli.leaving import run_program
from lpvid.cli.running import command

app = typer.Typer()

@app.command()
@command
def go():
    CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGINT))()  # as in a compiler: nothing can catch it there
    raise RuntimeError("no compiled object yet")

run_program(lambda: app, "go")
"""


def test_ctrl_c_that_a_compiler_turns_into_its_own_error_ends_with_130_and_one_line():
    done = subprocess.run([sys.executable, "-c", COMPILING], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (130, "interrupted: nothing was written\n")
    other = COMPILING.replace("signal.raise_signal(signal.SIGINT)", "None")
    done = subprocess.run([sys.executable, "-c", other], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1 and "no compiled object yet" in done.stderr  # a bug keeps its traceback


@pytest.mark.parametrize("handler", ["default_int_handler", "SIG_IGN"])
def test_a_caller_that_goes_on_has_its_own_handler_again(handler, monkeypatch, capsys):
    from lpvid.cli import main

    monkeypatch.setattr(sys, "argv", ["lpvid", "--version"])
    before = signal.signal(signal.SIGINT, own := getattr(signal, handler))
    try:
        with pytest.raises(SystemExit):
            main()
        assert signal.getsignal(signal.SIGINT) is own
    finally:
        signal.signal(signal.SIGINT, before)


def test_once_the_process_ends_ctrl_c_ends_it_by_itself():
    code = START.format(package="lpvid", handler="default_int_handler").replace("main()\n", (
        "import atexit, os, sys\natexit.register(lambda: os.kill(os.getpid(), signal.SIGINT))\nmain()\n"))
    done = subprocess.run([sys.executable, "-c", code, "--version"], capture_output=True, text=True, timeout=60)
    assert "Traceback" not in done.stderr
    assert done.returncode == -signal.SIGINT


def test_a_program_in_another_thread_runs(monkeypatch, capsys):
    from concurrent.futures import ThreadPoolExecutor

    from lpvid.cli import main

    monkeypatch.setattr(sys, "argv", ["lpvid", "--version"])
    with ThreadPoolExecutor(1) as other:
        ended = other.submit(main).exception(timeout=60)
    assert isinstance(ended, SystemExit)
    assert not ended.code
