"""How commands run: one-line errors and exit codes, progress on standard error, results that appear whole."""

from __future__ import annotations

import functools
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import typer

from lpvid._threads import showing_progress
from lpvid.cli.invocation import Invocation
from lpvid.cli.leaving import INTERRUPTED, NOTHING_WRITTEN, command_begins, was_pressed
from lpvid.errors import InputError, LpvError
from lpvid.files.own_results import is_own, listed, note_written

if TYPE_CHECKING:
    from lpvid.report import Page

RUNNING: ContextVar[str] = ContextVar("RUNNING", default="")
"""The command that runs, such as "lpvid identify"."""
ASKED: ContextVar[Invocation | None] = ContextVar("ASKED", default=None)
"""How the command that runs was called, for the foot of its report."""
P = ParamSpec("P")
T = TypeVar("T")
WRITTEN = (".json", ".html", ".csv", ".parquet", ".mat", ".png", ".toml", ".fmu", ".c", ".h", ".m", ".mo", ".py")
"""Extensions of files that commands write into their folder, those of `export` among them."""
SHORTFALL = 3
"""Exit code of a numerical outcome short of the request."""
PATIENCE = 3.0
"""Seconds before progress is written to a pipe."""


EXIT_CODES = """

Exit codes: 0 done; 2 the input is at fault (one line, nothing is written); 3 a numerical outcome short of the request,
with the result written."""
"""What the help of both programs ends with."""


def new_app(program: str, about: str) -> typer.Typer:
    """A Typer application with the settings common to both programs.

    Parameters
    ----------
    program : str
        As `--version` prints it.
    about : str
        What the program does, for its help.

    Returns
    -------
    typer.Typer
        Without commands yet: help by -h too, the version, and errors in one line.
    """
    from lpvid.cli.helping import Group

    def print_version(value: bool) -> None:
        if value:
            from lpvid import __version__

            typer.echo(f"{program} {__version__}")
            raise typer.Exit

    option = typer.Option(False, "--version", "-v", callback=print_version, is_eager=True,
                          help="Print the version and stop.")
    app = typer.Typer(cls=Group, no_args_is_help=True, pretty_exceptions_enable=False,
                      context_settings={"help_option_names": ["-h", "--help"]})

    @app.callback(help=about + EXIT_CODES)
    def common(version: bool = option) -> None:
        pass

    return app


def add(app: typer.Typer, function: Callable[..., Any], examples: Iterable[tuple[str, str]]) -> None:
    """Add a command with (comment, command line) examples to an application.

    Parameters
    ----------
    app : typer.Typer
        From `new_app`.
    function : callable
        Its options are annotated; its name is that of the command.
    examples : iterable of (str, str)
        Printed under the help.
    """
    from lpvid.cli.helping import Command, written

    app.command(cls=Command, epilog=written(examples))(function)


def command(function: Callable[P, T]) -> Callable[P, T]:
    """Let a command end with one line and its exit code where the input or the numbers are at fault.

    An unexpected exception is a bug and keeps its traceback.

    Parameters
    ----------
    function : callable
        With options as keywords.

    Returns
    -------
    callable
        The same with errors as exit codes: that of the `LpvError`, 2 for a file that the system refuses, 130 after
        Ctrl-C.
    """

    @functools.wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        command_begins()
        RUNNING.set(f"{function.__module__.partition('.')[0]} {function.__name__}")
        ASKED.set(Invocation(RUNNING.get(), function, kwargs))
        try:
            return function(*args, **kwargs)
        except LpvError as error:
            typer.echo(f"error: {' '.join(str(error).split())}", err=True)
            raise typer.Exit(error.exit_code) from None
        except KeyboardInterrupt:
            typer.echo(NOTHING_WRITTEN, err=True)
            raise typer.Exit(INTERRUPTED) from None
        except BrokenPipeError:
            raise  # the reader of the output left, as `head` does: no fault of the input
        except OSError as error:
            typer.echo(f"error: {error.filename or 'a file'}: {error.strerror or error}", err=True)
            raise typer.Exit(InputError.exit_code) from None
        except Exception as error:
            if isinstance(error, typer.Exit | typer.Abort) or not was_pressed():
                raise
            typer.echo(NOTHING_WRITTEN, err=True)
            raise typer.Exit(INTERRUPTED) from None

    return run


@contextmanager
def working(what: str) -> Iterator[Callable[[str], None]]:
    """A spinner with the elapsed time on standard error, gone when done; a line for each stage where it is piped.

    Yields a function that takes what is being done now.

    Parameters
    ----------
    what : str
        First stage, "reading" for instance.

    Yields
    ------
    callable
        From the text of a stage to nothing.
    """
    if not sys.stderr.isatty():
        stages = StageLines(what)
        try:
            yield stages.enter
        finally:
            stages.close()
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    with ExitStack() as ending:
        with showing_progress():
            progress = ending.enter_context(Progress(SpinnerColumn(), TextColumn("{task.description}"),
                                                     TimeElapsedColumn(), console=Console(stderr=True), transient=True))
        task = progress.add_task(what, total=None)
        yield lambda text: progress.update(task, description=text)


class StageLines:
    """A line on standard error for each stage of a long command: none in the first seconds, so that a short one has
    none.

    Texts that differ in numbers only ("round 3 of 40") are one stage. The environment variable LPVID_PROGRESS=quiet
    leaves the lines out.

    Parameters
    ----------
    what : str
        The first stage.
    """

    def __init__(self, what: str) -> None:
        import threading

        self._begun, self._stage, self._shown = time.monotonic(), what, ""
        self._lock = threading.Lock()
        self._quiet = os.environ.get("LPVID_PROGRESS") == "quiet"
        self._later = threading.Timer(PATIENCE, self._show)
        self._later.daemon = True
        if not self._quiet:
            with showing_progress():
                self._later.start()

    def enter(self, text: str) -> None:
        """The next stage.

        Parameters
        ----------
        text : str
            What is done now.
        """
        self._stage = text
        if time.monotonic() - self._begun > PATIENCE:
            self._show()

    def close(self) -> None:
        """The end of the last stage."""
        self._later.cancel()

    def _show(self) -> None:
        with self._lock:
            kind = re.sub(r"[\d.,]+", "#", self._stage)
            if kind != self._shown and not self._quiet:
                self._shown = kind
                typer.echo(f"[{time.monotonic() - self._begun:4.0f} s] {self._stage}", err=True)


@contextmanager
def solver_output_suppressed() -> Iterator[None]:
    """The output of compiled solvers is dropped: it is no result, and --json prints the result alone.

    Yields
    ------
    None
        Nothing is suppressed where standard output is closed. Python's own output inside the block is lost too.
    """
    sys.stdout.flush()
    try:
        kept = os.dup(1)
    except OSError:
        yield
        return
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.close(nowhere)
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)


class Results:
    """Files to write together: nothing appears before all of them are complete.

    Parameters
    ----------
    folder : Path or None
        Where they go; None keeps nothing.
    *names : str
        Files that are known to be among them.

    Raises
    ------
    InputError
        A folder that is a file, or that cannot be made or written, or that has a file of the user's of one of these
        names: found before any work is done.
    """

    def __init__(self, folder: Path | None, *names: str) -> None:
        self.folder = folder
        self._writers: list[tuple[str, Callable[[Path], object]]] = []
        self._absent: list[str] = []
        self._data: list[str] = []
        if folder is not None:
            _refuse_a_files_name(folder)
            _check_writable(folder)
            _spare(folder, names)

    @property
    def kept(self) -> bool:
        """Whether anything will be written."""
        return self.folder is not None

    def add(self, name: str, writer: Callable[[Path], object], *, data: bool = False) -> None:
        """A file by the function that writes it to a path.

        Parameters
        ----------
        name : str
            Of the file, without a folder.
        writer : callable
            From a path to anything; runs when `write` does.
        data : bool
            Whether it is a record that other commands are meant to read where they are given the folder.
        """
        self._writers.append((name, writer))
        if data:
            self._data.append(name)

    def without(self, name: str) -> None:
        """A file that this result does not have: one of an earlier result goes, lest it be taken for this one's.

        Parameters
        ----------
        name : str
            Of the file, without a folder.
        """
        self._absent.append(name)

    def json(self, name: str, data: Mapping[str, Any]) -> None:
        """A JSON file; numbers that are not finite become null.

        Parameters
        ----------
        name : str
            Of the file, without a folder.
        data : mapping of str to object
            As for `lpvid.export.json_files.jsonable`.
        """
        from lpvid.export.serialise import write_json

        self.add(name, lambda path: write_json(data, path))

    def save(self, name: str, noun: object) -> None:
        """A model, certificate, damper or controller.

        Parameters
        ----------
        name : str
            Of the file, without a folder.
        noun : object
            As for `lpvid.save`.
        """
        from lpvid.export.serialise import save

        self.add(name, lambda path: save(noun, path))

    def figures(self, drawn: Iterable[Any]) -> None:
        """Pictures of figures, NAME.png.

        Parameters
        ----------
        drawn : iterable
            Each with a name and a figure.
        """
        from lpvid.plot import png

        for one in drawn:
            self.bytes(f"{one.name}.png", png(one.figure))

    def bytes(self, name: str, content: bytes) -> None:
        """A file of bytes.

        Parameters
        ----------
        name : str
            Of the file, without a folder.
        content : bytes
            Of the whole file.
        """
        self.add(name, lambda path: path.write_bytes(content))

    def report(self, page: Page) -> None:
        """report.html, with date, command, files read and the files beside it.

        Parameters
        ----------
        page : Page
            One with an origin of its own keeps it.
        """
        from dataclasses import replace

        from lpvid.report import render

        def written(path: Path) -> None:
            called = ASKED.get()
            names = tuple(name for name, _ in self._writers if name != "report.html")
            origin = None if called is None else called.origin(self.folder, names)
            path.write_bytes(render(replace(page, origin=page.origin or origin)).encode("utf-8"))

        self.add("report.html", written)

    def write(self) -> list[Path]:
        """Write all files to a hidden folder beside or inside, then move them into place.

        Returns
        -------
        list of Path
            The files; empty when nothing is kept.

        Raises
        ------
        InputError
            A folder that cannot be made, a file that the system refuses to write, or one that would replace a file of
            the user's.
        """
        if self.folder is None:
            return []
        _spare(self.folder, [name for name, _ in self._writers])
        try:
            return self._write(self.folder)
        except OSError as error:
            raise InputError(f"--out {self.folder}: cannot write there", got=error.strerror or str(error),
                             mend="check the folder, its permissions and the space left") from None

    def _write(self, folder: Path) -> list[Path]:
        missing = [p for p in (folder.absolute(), *folder.absolute().parents) if not p.exists()]
        folder.absolute().parent.mkdir(parents=True, exist_ok=True)
        home = folder if folder.is_dir() else folder.absolute().parent  # the same file system, so that moves are atomic
        stage = Path(tempfile.mkdtemp(prefix=f".{folder.name or 'results'}.", dir=home))
        try:
            for name, writer in self._writers:
                writer(stage / name)
            folder.mkdir(exist_ok=True)
            names = [name for name, _ in self._writers]
            for name in {*self._absent, *listed(folder).get(RUNNING.get(), ())} - set(names):
                if is_own(folder / name):
                    (folder / name).unlink()
            written = [(stage / name).replace(folder / name) for name in names]
            note_written(folder, RUNNING.get(), names, self._data)
            return written
        except BaseException:
            shutil.rmtree(stage, ignore_errors=True)
            for made in missing:  # only what was not there before, and only while empty
                if made.is_dir() and not any(made.iterdir()):
                    made.rmdir()
            raise
        finally:
            shutil.rmtree(stage, ignore_errors=True)


def _refuse_a_files_name(folder: Path) -> None:
    """Refuse to make a folder that is called like a file: whoever asks for `run.parquet` expects that file."""
    if folder.suffix.lower() in WRITTEN and not folder.exists():
        form = folder.suffix.lower().removeprefix(".")
        tables = f"; a table's format is --format {form}, where there is one" if form in ("parquet", "mat") else ""
        raise InputError("--out names a folder", got=f"{folder}, the name of a file",
                         mend=f"--out {folder.with_suffix('')}{tables}")


def _check_writable(folder: Path) -> None:
    """Refuse a folder that cannot be made or written."""
    try:
        if folder.exists() and not folder.is_dir():
            raise InputError(f"--out {folder}: there is a file of this name", mend="name a folder")
        held = next(p for p in (folder.absolute(), *folder.absolute().parents) if p.exists())
        if not held.is_dir():
            raise InputError(f"--out {folder}: '{held}' is a file", mend="name a folder elsewhere")
        probe = Path(tempfile.mkdtemp(prefix=".lpvid.", dir=held))  # what permissions alone do not show: try
        try:
            (probe / folder.absolute().relative_to(held)).mkdir(parents=True, exist_ok=True)
        finally:
            shutil.rmtree(probe, ignore_errors=True)
    except OSError as error:
        raise InputError(f"--out {folder}: cannot write there", got=error.strerror or str(error),
                         mend="name another folder, or change its permissions") from None


def _spare(folder: Path, names: Iterable[str]) -> None:
    """Refuse to write over a file that no command wrote, or that was changed since: it may be the only copy."""
    called = ASKED.get()
    read = set() if called is None else {path.resolve() for path in called.files()}
    for name in names:
        path = folder / name
        if path.exists() and not is_own(path):
            kind = ("the file of that name that was read" if path.resolve() in read else
                    "a file of that name that this program did not write, or that was changed since")
            raise InputError(f"--out {folder}: its result {name} would replace {kind}",
                             mend="name another folder, or move that file")


def conclude(results: Results | None, data: Mapping[str, Any], text: str, as_json: bool) -> None:
    """Write what is kept, then print the result: as JSON alone, or as text with the files that were written.

    Parameters
    ----------
    results : Results or None
        Files that are queued; None of a command that writes none.
    data : mapping of str to object
        Printed where JSON is requested.
    text : str
        Printed elsewhere.
    as_json : bool
        Whether --json was written.
    """
    written = [] if results is None else results.write()
    if as_json:
        import json

        from lpvid.export.serialise import jsonable

        typer.echo(json.dumps(jsonable(data), allow_nan=False, indent=2, ensure_ascii=False))
        return
    typer.echo(text)
    if results is None:
        return
    if not results.kept:
        typer.echo("nothing was saved: --out DIR keeps the result and its report", err=True)
    if written:
        typer.echo(f"wrote {', '.join(p.name for p in written[:8])}"
                   + (f" and {len(written) - 8} more" if len(written) > 8 else "") + f" to {results.folder}")
