"""Models and results as JSON files: exact, atomic, and refused with one line when they are not what they claim."""

from __future__ import annotations

import hashlib
import importlib
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from lpvid.codec import MissingKey, UnknownKind
from lpvid.entry_points import loaded
from lpvid.errors import InputError
from lpvid.export.json_files import jsonable, write_json, write_text
from lpvid.named_classes import NamedClasses
from lpvid.realization import Realization

__all__ = ["KINDS", "Kind", "jsonable", "known_kinds", "load", "model_from_dict", "model_hash", "package_version",
           "save", "write_json"]
T = TypeVar("T")
ENTRY_POINTS = "lpvid.kinds"
"""Group under which another package names its `Kind`, as ``name = "package.module:KIND"``."""
LARGEST_FILE = 256 * 2**20
"""bytes above which a JSON file is refused rather than read into memory."""
LARGEST_BASIS = 100_000
"""functions above which a basis claimed by a file is refused before it is built."""


@dataclass(frozen=True)
class Kind:
    """One sort of file: ``<house>/<name>/<version>``, and the classes it can hold.

    Attributes
    ----------
    name : str
        As in the schema.
    version : int
        Newest format that this version writes; older ones it reads.
    classes : tuple of (str, str, str)
        Value of "kind" in the file, module, class with `to_dict` and `from_dict`. The tag "" stands for a file
        without "kind".
    house : str
        The package whose files these are.
    more : NamedClasses, optional
        Classes that other packages and the running program add; "kind" is their name.
    """

    name: str
    version: int
    classes: tuple[tuple[str, str, str], ...]
    house: str = "lpvid"
    more: NamedClasses | None = None

    @property
    def tags(self) -> tuple[str, ...]:
        """Every value of "kind" that can be read."""
        return tuple(dict.fromkeys((*(tag for tag, _, _ in self.classes), *(self.more.names if self.more else ()))))

    def holds(self, cls: type) -> bool:
        """Whether files of this sort can hold objects of this class.

        Parameters
        ----------
        cls : type
            Compared by module and name, so that nothing is imported.

        Returns
        -------
        bool
            True also for classes of `more`.
        """
        own = (cls.__module__, cls.__name__)
        if any(own == (module, name) for _, module, name in self.classes):
            return True
        return self.more is not None and self.more.name_of(cls) is not None

    def class_of(self, tag: str) -> Any:
        """The class behind a value of "kind".

        Parameters
        ----------
        tag : str
            One of `tags`.

        Returns
        -------
        type
            Imported from its module where it is not yet.

        Raises
        ------
        KeyError
            A value that `classes` does not have, of a kind without `more`.
        InputError
            A value that `more` does not have either.
        """
        place = next(((module, name) for own, module, name in self.classes if own == tag), None)
        if place is None and self.more is not None:
            return self.more.get(tag)
        if place is None:
            raise KeyError(tag)
        return getattr(importlib.import_module(place[0]), place[1])

    @property
    def schema(self) -> str:
        """The schema as written."""
        return f"{self.house}/{self.name}/{self.version}"


KINDS: tuple[Kind, ...] = (
    Kind("model", 1, (("lpv-transfer-function", "lpvid.model.transfer_function", "LPVTransferFunction"),
                      ("lpv-state-space", "lpvid.model.state_space", "LPVStateSpace"),
                      ("lft", "lpvid.model.lft", "LFTModel"),
                      ("quasi-lpv", "lpvid.model.quasi", "QuasiLPVModel"),
                      ("compliance", "lpvid.model.compliance", "ComplianceModel"))),
    Kind("gain-certificate", 1, tuple((kind, "lpvid.lmi.gain_certificate", "GainCertificate")
                                      for kind in ("quadratic", "poly-quadratic", "parameter-dependent"))),
    Kind("rated-gain-certificate", 1, (("rated", "lpvid.analysis.rated_certificate", "RatedGainCertificate"),)),
    Kind("hull-certificate", 1, (("", "lpvid.lmi.hull_certificate", "HullCertificate"),)),
    Kind("robust-certificate", 1, (("", "lpvid.analysis.robust_certificate", "RobustCertificate"),)),
    Kind("bound-certificate", 1, tuple((kind, "lpvid.lmi.bound_certificate", "BoundCertificate")
                                       for kind in ("quadratic", "poly-quadratic", "parameter-dependent"))),
    Kind("passivity-certificate", 1, tuple(
        (kind, "lpvid.analysis.passivity_certificate", "PassivityCertificate")
        for kind in ("quadratic", "poly-quadratic", "parameter-dependent", "none"))),
    Kind("polytopic-certificate", 1, (("polytopic", "lpvid.analysis.switching", "PolytopicCertificate"),)),
    Kind("stability-certificate", 1, tuple(
        (kind, "lpvid.analysis.stability_certificate", "StabilityCertificate")
        for kind in ("quadratic", "poly-quadratic", "parameter-dependent", "none"))),
    Kind("extended", 1, (("", "lpvid.effects.extended", "ExtendedModel"),)),
    Kind("fleet-law", 1, (("fleet", "lpvid.effects.fleet_law", "FleetLaw"),)),
    Kind("synthesis", 1, (("", "lpvid.synthesis.result", "Synthesis"),)),
)
"""Every sort of file of lpvid's own that `save` writes and `load` reads, in order; a new noun adds its line here."""


def known_kinds() -> tuple[Kind, ...]:
    """`KINDS`, then those that installed packages name in the entry-point group ``lpvid.kinds``.

    Returns
    -------
    tuple of Kind
        lpvid's own first; those of packages sorted by name.

    Raises
    ------
    InputError
        An entry point that does not load, or names something else.
    """
    return (*KINDS, *installed(ENTRY_POINTS, Kind))


def installed(group: str, cls: type[T]) -> list[T]:
    """What installed packages name in a group of entry points.

    Parameters
    ----------
    group : str
        Of entry points.
    cls : type
        What each of them has to be.

    Returns
    -------
    list
        Objects of the class, by name.

    Raises
    ------
    InputError
        An entry point that does not load, or is something else.
    """
    found = []
    for name, made in loaded(group):
        if not isinstance(made, cls):
            raise InputError(f"the entry point '{name}' of {group} is no {cls.__name__}",
                             got=type(made).__name__, mend="update or remove the package that names it")
        found.append(made)
    return found


def save(obj: Any, path: str | os.PathLike) -> Path:
    """Write a model (or another noun of `known_kinds`) to a JSON file; a realisation saves its state-space model.

    The file appears complete or not at all. Numbers come back bit for bit.

    Parameters
    ----------
    obj : LPVTransferFunction, LPVStateSpace, Realization or another noun of `known_kinds`
    path : str or path-like

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    InputError
        An object of no known kind, metadata that JSON cannot hold, a folder that does not exist.

    Examples
    --------
    >>> import tempfile
    >>> from lpvid.model.transfer_function import LPVTransferFunction
    >>> from lpvid.scheduling import Polynomial
    >>> model = LPVTransferFunction.siso([[-0.9, 0.1]], [[0, 0], [0.1, 0]], Polynomial("p", degree=1), 0.01)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     model_hash(load(save(model, folder + "/model.json"))) == model_hash(model)
    True
    """
    noun = obj.model if isinstance(obj, Realization) else obj
    kind = _kind_for(noun)
    data = {"schema": kind.schema, "lpvid_version": package_version(), **noun.to_dict()}
    try:
        text = json.dumps(data, allow_nan=False, default=_plain, indent=1)
    except InputError:
        raise
    except (TypeError, RecursionError) as error:
        raise InputError(f"'{path}' cannot be written", why=_one_line(error),
                         mend="look at the model's metadata") from None
    except ValueError:
        raise InputError(f"'{path}' cannot be written", got="a number that is not finite",
                         why="a model file holds finite numbers", mend="look at the model's metadata") from None
    return write_text(text + "\n", path)


def load(path: str | os.PathLike) -> Any:
    """Read a file written by `save`.

    Parameters
    ----------
    path : str or path-like

    Returns
    -------
    object
        For a model file an LPVTransferFunction or an LPVStateSpace.

    Raises
    ------
    InputError
        A missing, huge or corrupt file, another schema, a newer version, missing keys, wrong shapes, numbers that
        are not finite. The message names the file.
    """
    data = _read_object(Path(path))
    kind = _kind_named(data.get("schema"), path)
    tags = kind.tags
    tag = data.get("kind", "")
    if not isinstance(tag, str) or tag not in tags:
        raise InputError(f"'{path}' holds an unknown kind of {kind.name}", got=repr(tag),
                         why=f"known: {', '.join(tags)}", mend="write it again with lpvid.save")
    try:
        return _rebuilt(data, kind)
    except UnknownKind as error:
        raise InputError(f"'{path}' is not a consistent {kind.name} file", got=f"{error.what} '{error.got}'",
                         why=error.why, mend=error.mend) from None
    except (MissingKey, KeyError) as error:
        key = error.key if isinstance(error, MissingKey) else error.args[0]
        raise InputError(f"'{path}' lacks '{key}'", why=f"a {kind.name} file needs it",
                         mend="write it again with lpvid.save") from None
    except (InputError, ValueError, TypeError, AttributeError, IndexError, OverflowError, MemoryError,
            RecursionError) as error:
        raise InputError(f"'{path}' is not a consistent {kind.name} file", why=_one_line(error),
                         mend="write it again with lpvid.save") from None


def model_from_dict(data: Mapping) -> Any:
    """The model that a `to_dict` of lpvid's models describes, for files that hold one inside.

    Parameters
    ----------
    data : mapping
        With the model's "kind", as `to_dict` writes it; "schema" is not needed.

    Returns
    -------
    LPVTransferFunction, LPVStateSpace, LFTModel, QuasiLPVModel or ComplianceModel
        By its kind.

    Raises
    ------
    InputError, KeyError, ValueError, TypeError
        What is missing or inconsistent; `load` turns it into one line.
    """
    if not isinstance(data, Mapping) or data.get("kind") not in [tag for tag, _, _ in KINDS[0].classes]:
        raise InputError("a model inside is of no known kind", got=data.get("kind") if isinstance(data, Mapping) else
                         type(data).__name__)
    return _rebuilt(data, KINDS[0])


def model_hash(model: Any) -> str:
    """SHA-256 of a model's canonical JSON without its metadata: what a certificate refers to.

    Parameters
    ----------
    model : LPVTransferFunction or LPVStateSpace
        Anything with `to_dict`.

    Returns
    -------
    str
        64 hexadecimal digits; equal for models that compute alike, whatever is noted about them.
    """
    data = {k: v for k, v in model.to_dict().items() if k != "metadata"}
    text = json.dumps(_canonical(data), sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def package_version() -> str:
    """Version of the installed package.

    Returns
    -------
    str
        As in the metadata of the installation; "unknown" where there is none.
    """
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("lpvid")
    except PackageNotFoundError:
        return "unknown"


# -- reading ---------------------------------------------------------------------------------------------------------
def _read_object(path: Path) -> dict:
    if not path.is_file():
        inside = path / "model.json"
        raise InputError(f"no file '{path}'", got="a folder" if path.is_dir() else None,
                         mend=f"give '{inside}'" if inside.is_file() else "check the path")
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE:
            raise InputError(f"'{path}' is too large for a model file", got=f"{size / 2**20:.0f} MiB",
                             why=f"the limit is {LARGEST_FILE // 2**20} MiB", mend="give the file that save wrote")
        data = json.loads(path.read_bytes().decode("utf-8"), parse_constant=_refuse, parse_float=_finite)
    except OSError as error:
        raise InputError(f"'{path}' cannot be read", why=error.strerror, mend="check its permissions") from None
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        order = "" if path.suffix == ".json" else "; the model comes before the data"
        why = _one_line(error) if size else "the file is empty (0 bytes)"
        raise InputError(f"'{path}' is not a JSON file", why=why,
                         mend=f"give a file written by lpvid.save{order}") from None
    except (_NotFinite, ValueError) as error:
        raise InputError(f"'{path}' holds a number that cannot be used", got=_one_line(error),
                         why="a model file holds finite numbers", mend="write it again with lpvid.save") from None
    if not isinstance(data, dict):
        raise InputError(f"'{path}' is no model file", got=f"a JSON {type(data).__name__}",
                         why="it should hold an object", mend="give a file written by lpvid.save")
    return data


class _NotFinite(Exception):
    """A number in the text that is NaN, infinite or beyond the range of a float."""


def _refuse(text: str) -> float:
    raise _NotFinite(text)


def _finite(text: str) -> float:
    number = float(text)
    return number if math.isfinite(number) else _refuse(text)


def _kind_named(schema: object, path: object) -> Kind:
    parts = schema.split("/") if isinstance(schema, str) else []

    def among(kinds: Sequence[Kind]) -> Kind | None:
        return next((k for k in kinds if len(parts) == 3 and parts[:2] == [k.house, k.name]), None)

    kind = among(KINDS) or among(known_kinds())
    if kind is None or not parts[2].isdecimal() or int(parts[2]) < 1:
        known = ", ".join(k.schema for k in known_kinds())
        beside = Path(str(path)).with_name("model.json")
        if len(parts) == 3 and parts[0] in {k.house for k in known_kinds()} and beside.is_file():
            raise InputError(f"'{path}' holds results, no model", got=repr(schema), mend=f"give '{beside}'")
        if schema is None:
            raise InputError(f"'{path}' holds no model", why="it names no 'schema'",
                             mend="give a file written by lpvid.save, such as model.json or controller.json")
        raise InputError(f"'{path}' has a schema that cannot be loaded", got=repr(schema),
                         why=f"known: {known}", mend="give a file written by lpvid.save")
    if int(parts[2]) > kind.version:
        raise InputError(f"'{path}' was written in a newer format", got=repr(schema),
                         why=f"this version reads up to {kind.schema}", mend=f"update {kind.house}")
    return kind


def _rebuilt(data: Mapping, kind: Kind) -> Any:
    _check_basis(data.get("basis"))
    return kind.class_of(data.get("kind", "")).from_dict(data)


def _check_basis(data: object) -> int:
    """Number of functions a basis in a file would have, refused before anything of that size is built."""
    if not isinstance(data, Mapping):
        return 0
    kind = data.get("kind")
    if kind == "polynomial":
        degree, variables = int(data["degree"]), len(data["names"])
        size = math.comb(variables + min(degree, LARGEST_BASIS), variables) if degree >= 0 else 0
    elif kind == "spline":
        size = int(data["segments"]) + int(data["order"])
    elif kind == "fourier":
        size = 2 * int(data["harmonics"]) + 1
    elif kind == "product":
        size = _check_basis(data["first"]) * _check_basis(data["second"])
    elif kind == "stacked":
        size = sum(_check_basis(f) for f in data["factors"])
    else:
        size = _check_basis(data.get("basis"))
    if size > LARGEST_BASIS:
        raise InputError(f"the basis claims {size} functions", why=f"the limit is {LARGEST_BASIS}")
    return size


def _one_line(error: BaseException) -> str:
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 200 else text[:197] + "..."


# -- writing ---------------------------------------------------------------------------------------------------------
def _kind_for(obj: object) -> Kind:
    def among(kinds: Sequence[Kind]) -> Kind | None:
        return next((k for k in kinds if k.holds(type(obj))), None)

    kind = among(KINDS) or among(known_kinds())
    if kind is None:
        names = dict.fromkeys(name for k in KINDS for _, _, name in k.classes)
        raise InputError("this object cannot be saved", got=type(obj).__name__,
                         mend="save its .model" if hasattr(obj, "model") else f"save one of {', '.join(names)}")
    return kind


def _plain(value: object) -> object:
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise InputError("the metadata hold something that JSON cannot", got=type(value).__name__,
                     mend="keep to text, numbers, lists and mappings")


def _canonical(value: object) -> object:
    if isinstance(value, bool) or value is None or isinstance(value, str):
        return value
    if isinstance(value, (int, float)):
        return float(value) + 0.0  # 1 and 1.0 compute alike, and so do 0.0 and -0.0
    if isinstance(value, Mapping):
        return {str(k): _canonical(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_canonical(v) for v in value]
    return _canonical(_plain(value))
