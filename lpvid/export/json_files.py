"""Results as JSON files: complete or not there, in JSON's own types."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import secrets
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lpvid.errors import InputError


def write_json(data: Mapping, path: str | os.PathLike) -> Path:
    """Write a result as JSON: atomically, NaN and infinities as null, numpy values as plain ones.

    Parameters
    ----------
    data : mapping
        Nested mappings, sequences, arrays, numbers, text.
    path : str or path-like

    Returns
    -------
    Path
    """
    return write_text(json.dumps(jsonable(data), allow_nan=False, indent=2, ensure_ascii=False) + "\n", path)


def jsonable(value: Any) -> Any:
    """The same data in JSON's own types, what is not finite as None.

    Parameters
    ----------
    value : object
        Data of nested mappings, sequences, sets, dataclasses, arrays, numbers, paths and text.

    Returns
    -------
    None, bool, int, float, str, list or dict
        Keys as text, sets sorted, a dataclass as a dict of its fields, a complex number as [real, imaginary].

    Raises
    ------
    InputError
        An object of another class.

    Examples
    --------
    >>> jsonable({"esr": np.float64("nan"), "at": np.arange(2), "ok": np.True_})
    {'esr': None, 'at': [0, 1], 'ok': True}
    """
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, (np.ndarray, np.generic)):
        return jsonable(value.tolist())
    if isinstance(value, complex):
        return [jsonable(value.real), jsonable(value.imag)]
    if isinstance(value, Mapping):
        return {str(k): jsonable(v) for k, v in value.items()}
    if isinstance(value, (Sequence, set, frozenset)):
        return [jsonable(v) for v in (sorted(value) if isinstance(value, (set, frozenset)) else value)]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: jsonable(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise InputError("a result holds something that JSON cannot", got=type(value).__name__)


def write_text(text: str, path: str | os.PathLike) -> Path:
    """Write a text file that appears complete or not at all: under another name first, then renamed.

    Parameters
    ----------
    text : str
        Encoded in UTF-8.
    path : str or path-like
        File to write, in a folder that exists; one of the same name is replaced.

    Returns
    -------
    Path
        The file written.
    """
    return write_bytes(text.encode("utf-8"), path)


def write_bytes(data: bytes, path: str | os.PathLike) -> Path:
    """Write a file that appears complete or not at all: under another name first, then renamed.

    Parameters
    ----------
    data : bytes
        Content of the whole file.
    path : str or path-like
        File to write, in a folder that exists; one of the same name is replaced.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    InputError
        A path that is a folder, a folder that does not exist, or a file that the system refuses to write.
    """
    target = Path(path)
    if target.is_dir():
        raise InputError(f"'{target}' is a folder", mend="name a file in it")
    if not target.parent.is_dir():
        raise InputError(f"no folder '{target.parent}'", mend="create it first")
    scratch = target.with_name(f".{target.name}.{secrets.token_hex(6)}.tmp")
    try:
        with scratch.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        scratch.replace(target)
    except OSError as error:
        raise InputError(f"'{target}' cannot be written", why=error.strerror, mend="check the folder") from None
    finally:
        scratch.unlink(missing_ok=True)
    return target
