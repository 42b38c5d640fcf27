"""How a command was called: its line as it would be typed, and the files that it named."""

from __future__ import annotations

import inspect
import shlex
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args, get_origin, get_type_hints

from typer.models import ArgumentInfo, OptionInfo

if TYPE_CHECKING:
    from lpvid.report.origin import Origin

RESULTS = "out"
"""The option that names where results go: no file that is read."""


@dataclass(frozen=True, eq=False)
class Invocation:
    """A command with the values it was given.

    Attributes
    ----------
    name : str
        Such as "lpvid identify".
    function : callable
        The command, its options in its annotations.
    values : mapping of str to object
    """

    name: str
    function: Callable
    values: Mapping[str, Any]

    @property
    def line(self) -> str:
        """The command as it would be typed; what has its default is left out.

        Examples
        --------
        >>> from typing import Annotated
        >>> import typer
        >>> def audit(data: Annotated[list[str], typer.Argument()], strict: Annotated[bool, typer.Option("--strict")]
        ...           = False) -> None: ...
        >>> Invocation("lpvid audit", audit, {"data": ["a b.csv"], "strict": True}).line
        "lpvid audit 'a b.csv' --strict"
        """
        arguments, options = [], []
        for name, info, default in _declared(self.function):
            value = self.values.get(name, default)
            if value is None or value == default or value == []:
                continue
            if isinstance(info, ArgumentInfo):
                arguments += [_text(v) for v in _several(value)]
            else:
                options += _spelled(name, info, value)
        return shlex.join([*self.name.split(), *arguments, *options])

    def files(self) -> list[Path]:
        """The files that were named, folders and patterns resolved; a word that only happens to name a file is not.

        Returns
        -------
        list of Path
            Each once: those of the arguments, then those of the options, as they are declared; what --out names is left
            out.
        """
        found: list[Path] = []
        declared = sorted(_declared(self.function), key=lambda row: not isinstance(row[1], ArgumentInfo))
        for name in dict.fromkeys([*(name for name, _, _ in declared), *self.values]):
            if name != RESULTS and name in self.values:
                found += [p for v in _several(self.values[name]) for p in _behind(v)]
        return list(dict.fromkeys(found))

    def origin(self, folder: Path | None, names: tuple[str, ...]) -> Origin:
        """For the foot of a report: now, this command, these files.

        Parameters
        ----------
        folder : Path or None
            Where the results go; None where nothing is kept.
        names : tuple of str
            Files beside the report in that folder.

        Returns
        -------
        Origin
            With the hashes of the files that were read.
        """
        from lpvid.report.origin import Origin, sources_of

        return Origin(self.line, datetime.now().astimezone(), sources_of(self.files()), names,
                      "" if folder is None else str(folder))


def _declared(function: Callable) -> Iterator[tuple[str, ArgumentInfo | OptionInfo, Any]]:
    """Name, declaration and default of every parameter."""
    hints = get_type_hints(function, include_extras=True)
    for name, parameter in inspect.signature(function).parameters.items():
        found = [m for m in _metadata(hints[name]) if isinstance(m, (ArgumentInfo, OptionInfo))]
        if found:
            yield name, found[0], None if parameter.default is inspect.Parameter.empty else parameter.default


def _metadata(hint: Any) -> tuple[Any, ...]:
    """What is annotated, also within `Annotated[...] | None`, which get_type_hints makes of a default None."""
    direct = getattr(hint, "__metadata__", ())
    return direct or tuple(m for part in get_args(hint) if get_origin(hint) is not None
                           for m in getattr(part, "__metadata__", ()))


def _spelled(name: str, info: OptionInfo, value: Any) -> list[str]:
    flag = info.param_decls[0] if info.param_decls else f"--{name.replace('_', '-')}"
    if isinstance(value, bool):
        return [flag.split("/")[0] if value else flag.split("/")[-1]]
    return [word for v in _several(value) for word in (flag, _text(v))]


def _several(value: Any) -> list[Any]:
    return list(value) if isinstance(value, (list, tuple)) else [value]


def _text(value: Any) -> str:
    return str(value.value) if isinstance(value, Enum) else f"{value:.12g}" if isinstance(value, float) else str(value)


def _behind(value: Any) -> list[Path]:
    """Files behind a word: itself, all in a folder, all that match; none where it does not look like a path."""
    if not isinstance(value, (str, Path)) or (isinstance(value, str) and not set(value) & set("./\\")):
        return []
    path = Path(value)
    if path.is_file():
        return [path]
    if isinstance(value, Path):
        return []
    from lpvid.errors import LpvError
    from lpvid.files import find

    if not path.is_dir() and not set(value) & set("*?["):
        return _road_file(value)
    try:
        return find([value])
    except LpvError:
        return []


def _road_file(text: str) -> list[Path]:
    """The file of ``file#track@speed``, where there is one."""
    path = Path(text.rpartition("@")[0].partition("#")[0])
    return [path] if path.name and path.is_file() else []
