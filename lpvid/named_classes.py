"""NamedClasses: classes by name, of a package itself, of other installed packages, and of the running program."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Sequence
from importlib.metadata import EntryPoint, entry_points
from typing import TypeVar

from lpvid import _checks
from lpvid.errors import InputError

T = TypeVar("T")


class NamedClasses:
    """What a name on the command line, in a configuration or in a file stands for.

    Parameters
    ----------
    what : str
        What they are, for messages.
    group : str
        Entry-point group in which other packages name theirs, as ``name = "module:Class"``.
    own : sequence of (str, str, str)
        Name, module and class of the package's own; imported when they are requested.
    base : str
        ``"module:Class"`` that all of them derive from.

    Examples
    --------
    >>> from collections import OrderedDict
    >>> class Tidy(OrderedDict):
    ...     name = "tidy"
    >>> known = NamedClasses("mapping", "none.of.these", [("plain", "collections", "UserDict")], "builtins:dict")
    >>> known.register(Tidy) is known.get("tidy"), known.names
    (True, ('plain', 'tidy'))
    """

    def __init__(self, what: str, group: str, own: Sequence[tuple[str, str, str]], base: str) -> None:
        self._what, self._group, self._base = what, group, base
        self._own = {name: (module, cls) for name, module, cls in own}
        self._registered: dict[str, type] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """The package's own, then those of installed packages, then the registered ones."""
        return tuple(dict.fromkeys((*self._own, *self._installed(), *self._registered)))

    def __contains__(self, name: object) -> bool:
        return name in self._own or name in self._registered or name in self._installed()

    def get(self, name: str) -> type:
        """The class behind a name.

        Parameters
        ----------
        name : str
            Own names come before registered ones, these before those of installed packages.

        Returns
        -------
        type

        Raises
        ------
        InputError
            An unknown name, with the nearest known one; an entry point that does not load.
        """
        if name in self._own:
            return _attribute(*self._own[name])
        if name in self._registered:
            return self._registered[name]
        installed = self._installed()
        _checks.known_name(name, list(self.names), self._what)
        return self._loaded(installed[name])

    def register(self, cls: type[T]) -> type[T]:
        """Add a class of the running program under its own ``name``; serves as a decorator.

        A class of the same name that was registered before is replaced, so that a notebook's cell can be run again.
        Another process does not have it: an installed package names it as an entry point instead. A class that its
        package both registers and names so is one class, known by the entry point.

        Parameters
        ----------
        cls : type
            A class that can be instantiated, derived from the base, with a ``name`` in kebab case.

        Returns
        -------
        type
            `cls` itself.

        Raises
        ------
        InputError
            No such class, abstract methods that it lacks, or a name that is taken.
        """
        name = self._checked(cls)
        installed = self._installed().get(name)
        if installed is not None and installed.value.replace(" ", "") == f"{cls.__module__}:{cls.__qualname__}":
            return cls
        if name in self._own or installed is not None:
            raise InputError(f"there is a {self._what} '{name}' already", got=cls.__qualname__,
                             mend="give the class another name")
        self._registered[name] = cls
        return cls

    def forget(self, name: str) -> None:
        """Take back `register`; nothing where the name was not registered.

        Parameters
        ----------
        name : str
        """
        self._registered.pop(name, None)

    def name_of(self, cls: type) -> str | None:
        """The name under which a class is known; None for another.

        Parameters
        ----------
        cls : type

        Returns
        -------
        str or None
        """
        own = (cls.__module__, cls.__name__)
        for name, place in self._own.items():
            if place == own:
                return name
        for name, registered in self._registered.items():
            if registered is cls:
                return name
        return next((n for n, point in self._installed().items() if point.value == ":".join(own)), None)

    # -- looking up --------------------------------------------------------------------------------------------------
    def _installed(self) -> dict[str, EntryPoint]:
        found = sorted(entry_points(group=self._group), key=lambda p: (p.name, p.value))
        return {p.name: p for p in found if p.name not in self._own}

    def _loaded(self, point: EntryPoint) -> type:
        lead = f"the entry point '{point.name}' of {self._group}"
        try:
            cls = point.load()
            name = self._checked(cls)
        except Exception as error:  # whatever a foreign module raises when it is imported
            why = " ".join(str(error).split())[:200] or type(error).__name__
            raise InputError(f"{lead} does not load", why=why,
                             mend="update or remove the package that names it") from None
        if name != point.name:
            raise InputError(f"{lead} names a class of another name", got=name,
                             mend="give both the same name in the package that names it")
        return cls

    def _checked(self, cls: object) -> str:
        """The name of a class that fits; InputError where it does not."""
        base = _attribute(*self._base.split(":"))
        if not (isinstance(cls, type) and issubclass(cls, base)):
            raise InputError(f"a {self._what} is a class derived from {base.__name__}",
                             got=getattr(cls, "__qualname__", type(cls).__name__))
        if inspect.isabstract(cls):
            raise InputError(f"{cls.__qualname__} is not complete", why="it lacks "
                             + ", ".join(sorted(cls.__abstractmethods__)), mend="write these methods")
        name = getattr(cls, "name", None)
        if not isinstance(name, str) or not name:
            raise InputError(f"{cls.__qualname__} has no name", mend='name: ClassVar[str] = "in-kebab-case"')
        return name


def _attribute(module: str, name: str) -> type:
    return getattr(importlib.import_module(module), name)
