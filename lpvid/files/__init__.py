"""Reading measurements: one module per format, chosen by the file's extension."""

from __future__ import annotations

import glob
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from lpvid import _checks
from lpvid.condition.recalling import readings_of
from lpvid.condition.tables import ColumnTable, to_record
from lpvid.errors import InputError
from lpvid.files import csv, mat, mdf4, parquet, tdms
from lpvid.files.own_results import without_results
from lpvid.record import Record

READERS: tuple[tuple[tuple[str, ...], Callable[[Path], ColumnTable]], ...] = (
    (csv.EXTENSIONS, csv.read_table),
    (parquet.EXTENSIONS, parquet.read_table),
    (mat.EXTENSIONS, mat.read_table),
    (mdf4.EXTENSIONS, mdf4.read_table),
    (tdms.EXTENSIONS, tdms.read_table),
)
"""Extensions and the function that reads them, in the order in which they are tried."""
SPREADSHEETS = (".xlsx", ".xlsm", ".xls", ".ods")
"""Extensions of what a spreadsheet program saves and nothing here reads."""
_EXTENSIONS = tuple(e for extensions, _ in READERS for e in extensions)


def read(paths: str | Path | Iterable[str | Path], *, roles: Mapping[str, str] | None = None, name: str | None = None,
         sample_rate: float | None = None, like: Any = None) -> list[Record]:
    """Read measurements; one record per file, SI inside.

    Parameters
    ----------
    paths : str, Path or several of them
        Files, patterns such as ``"run*.csv"`` (in natural order: run2 before run10), or folders (every file in them
        whose format is known).
    roles : mapping of str to str, optional
        Role name to channel name, for every record.
    name : str, optional
        Name of the record, when there is one file; otherwise the file's stem, with its folder where stems collide.
    sample_rate : float, optional
        Rate [Hz] of files that have no time column and state no rate; it changes nothing for those that do.
    like : model or sequence of models, optional
        Read as the training data of these models were: the clock and the units that roles stated there (metadata
        ``reading``) count where `roles` and the header leave them open.

    Returns
    -------
    list of Record
        Samples and time stamps as they are: missing ones are NaN, nothing is interpolated. A channel that holds text
        keeps its fault, and one whose unit is unknown is a pure number.

    Raises
    ------
    InputError
        No such file, a format that is not known, or a file that cannot be read; in one line.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "run1.csv"
    >>> _ = path.write_text("time [ms],velocity [mm/s]\\n0,10\\n2,12.5\\n4,15\\n")
    >>> read(path)
    [Record 'run1': 3 samples, 500 Hz, velocity [m/s]]
    """
    files = find(paths)
    if name is not None and len(files) > 1:
        raise InputError("one name for several files", got=f"'{name}' for {len(files)} files",
                         mend="leave the name out: records are named after their files")
    rate = None if sample_rate is None else _checks.positive(sample_rate, "sample_rate", "Hz")
    names = [name] if name is not None else record_names(files)
    readings = readings_of(like)
    return [_read_one(path, label, rate, roles, readings) for path, label in zip(files, names, strict=True)]


def find(paths: str | Path | Iterable[str | Path]) -> list[Path]:
    """Files behind names, patterns and folders, in natural order within each.

    Results that commands of this program wrote into a folder (``--out``) are no data of that folder, nor of a pattern
    that other files match; one that is named itself is read.

    Parameters
    ----------
    paths : str, Path or several of them

    Returns
    -------
    list of Path

    Raises
    ------
    InputError
        Nothing found, a format that is not known, or a file named twice.
    """
    given = [paths] if isinstance(paths, (str, Path)) else list(paths)
    found = [path for item in given for path in _expand(item)]
    if not found:
        raise InputError("no files to read", mend="name at least one file")
    seen: set[Path] = set()
    for path in found:
        real = path.resolve()
        if real in seen:
            raise InputError(f"{path}: the file is named twice", why="its samples would count twice",
                             mend="name every file once")
        seen.add(real)
        _reader(path)
    return found


def _expand(item: str | Path) -> list[Path]:
    if not isinstance(item, (str, Path)):
        raise InputError("a path must be text", got=repr(item))
    text, path = str(item), Path(item)
    if not text.strip() or "\0" in text:
        raise InputError("a path must not be empty", got=repr(text))
    try:
        if path.is_dir():
            inside = [p for p in path.iterdir() if p.suffix.lower() in _EXTENSIONS and p.is_file()]
            if not inside:
                raise InputError(f"{path}: the folder holds no file that can be read",
                                 mend=f"readable are {', '.join(_EXTENSIONS)}")
            measured = without_results(inside)
            if not measured:
                raise InputError(f"{path}: the folder holds nothing but results of this program",
                                 got=", ".join(p.name for p in sorted(inside, key=natural)[:4]),
                                 mend="name such a file itself to read it")
            return sorted(measured, key=natural)
        if path.exists():
            if not path.is_file():
                raise InputError(f"{path}: not a file or folder", mend="name a file")
            return [path]
    except OSError as error:
        raise _no_access(path, error) from None
    if re.search(r"[*?\[]", text):
        matches = [Path(m) for m in glob.glob(text, recursive=True) if Path(m).is_file()]  # noqa: PTH207
        if matches:
            return sorted(without_results(matches) or matches, key=natural)
        raise InputError(f"no file matches '{text}'", mend="check folder and extension")
    raise InputError(f"{path}: there is no such file", mend="check folder and extension")


def natural(path: Path) -> list[tuple[int, int, str]]:
    """Sorting key in which run2 comes before run10.

    Parameters
    ----------
    path : Path

    Returns
    -------
    list of (int, int, str)
        One entry per run of digits or of other characters, letters without their case.
    """
    return [(0, int(part), "") if part.isdigit() else (1, 0, part.casefold())
            for part in re.split(r"([0-9]+)", str(path)) if part]


def record_names(files: Iterable[Path]) -> list[str]:
    """Stems of the files, with the extension and as many parent folders as it takes to separate them.

    Parameters
    ----------
    files : iterable of Path
        All of one data set.

    Returns
    -------
    list of str
        In the order of the files.
    """
    resolved = [path.resolve() for path in files]
    bare = [path.with_suffix("") for path in resolved]
    tails = [path if bare.count(stem) > 1 else stem for path, stem in zip(resolved, bare, strict=True)]
    names = [path.name for path in tails]
    for level in range(2, max((len(path.parts) for path in tails), default=0) + 1):
        count = Counter(names)
        if max(count.values()) == 1:
            break
        names = [n if count[n] == 1 else "/".join(path.parts[-level:]) for n, path in zip(names, tails, strict=True)]
    return names


def _reader(path: Path) -> Callable[[Path], ColumnTable]:
    for extensions, reader in READERS:
        if path.suffix.lower() in extensions:
            return reader
    sheet = "save the sheet as CSV; " if path.suffix.lower() in SPREADSHEETS else ""
    raise InputError(f"{path}: the format '{path.suffix}' is not known",
                     mend=f"{sheet}readable are {', '.join(_EXTENSIONS)}")


def _read_one(path: Path, name: str, sample_rate: float | None, roles: Mapping[str, str] | None,
              readings: Sequence[Mapping[str, str]]) -> Record:
    where = str(path)
    try:
        if path.stat().st_size == 0:
            raise InputError(f"{where}: the file is empty (0 bytes)", mend="export the data again")
        with path.open("rb"):
            pass
        table = _reader(path)(path)
    except OSError as error:
        raise _no_access(path, error) from None
    except MemoryError:
        raise InputError(f"{where}: the file does not fit into memory", mend="split it") from None
    return to_record(table, where, name=name, sample_rate=sample_rate, roles=roles, readings=readings)


def _no_access(path: Path, error: OSError) -> InputError:
    return InputError(f"{path}: cannot be read", got=error.strerror or str(error),
                      mend="check the path and its permissions")
