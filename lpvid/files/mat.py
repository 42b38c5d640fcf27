"""MATLAB files: version 5 to 7 here, version 7.3 (HDF5) by h5py, version 4 by scipy."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from lpvid.condition.tables import Column, ColumnTable, is_time_name
from lpvid.errors import InputError
from lpvid.files._mat5 import is_level5, read_level5
from lpvid.files._table import check_claim, headed, intact, stated_period, without_library

EXTENSIONS = (".mat",)
_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_DEPTH = 4
_STATED = ("sample_time", "sample_rate")

Tree = dict[str, Any]
"""Variables of a file: arrays, text, nested trees for structs, None for what is none of these."""


def read_table(path: Path) -> ColumnTable:
    """Read a MATLAB file.

    Every numeric vector as long as the time vector (without one: as the longest vector) is a channel; of a matrix with
    that many rows each column is one, named ``name_1`` … ``name_k``. Fields of structs count as variables, named
    ``struct.field`` only where two structs share a field name. Units stand in a struct ``units`` whose fields carry
    the variables' names, on the same level or at the top. Scalars ``sample_time`` [s] or ``sample_rate`` [Hz] state
    the clock. The rest is left out, with a note.

    Parameters
    ----------
    path : Path

    Returns
    -------
    ColumnTable

    Raises
    ------
    InputError
        Damaged, a size claim that the file cannot hold, no vectors, or h5py is not installed (version 7.3).
    """
    where = str(path)
    with path.open("rb") as stream:
        head = stream.read(520)
    is_hdf5 = head[:8] == _HDF5_SIGNATURE or head[512:520] == _HDF5_SIGNATURE
    with intact(where, "a MATLAB file"):
        if is_hdf5:
            tree = _read_hdf5(path, where)
        elif is_level5(head):
            tree = read_level5(path.read_bytes(), where)
        else:
            tree = _read_level4(path, where)
    return _table(tree, where)


# -- version 4 ------------------------------------------------------------------------------------------------------
def _read_level4(path: Path, where: str) -> Tree:
    from scipy.io import loadmat, whosmat
    from scipy.io.matlab import matfile_version

    if matfile_version(str(path))[0] != 0:
        raise ValueError("the head is that of no MAT-file")
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # scipy warns of doubled variables and of tails that it cannot read
        listed = [(name, shape) for name, shape, kind in whosmat(str(path)) if kind != "sparse"]
        check_claim(sum(8 * math.prod(int(d) for d in shape) for _, shape in listed), where, held=path.stat().st_size)
        loaded = loadmat(str(path), squeeze_me=True, variable_names=[name for name, _ in listed]) if listed else {}
    return {name: value for name, value in loaded.items() if not name.startswith("__")}


# -- version 7.3 ----------------------------------------------------------------------------------------------------
def _read_hdf5(path: Path, where: str) -> Tree:
    try:
        import h5py
    except ImportError:
        raise without_library(where, "h5py") from None
    with h5py.File(path, "r") as file:
        sizes: list[int] = []

        def weigh(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset):
                claimed = math.prod(item.shape or ()) * max(item.dtype.itemsize, 1)
                check_claim(claimed, where, held=item.id.get_storage_size(), what=f"'{name}'")
                sizes.append(claimed)

        file.visititems(weigh)
        check_claim(sum(sizes), where)
        return _group(file, _DEPTH)


def _group(group: Any, depth: int, above: tuple[Any, ...] = ()) -> Tree:
    """Variables of one group; links that lead elsewhere, or back, are not followed."""
    import h5py

    tree: Tree = {}
    for name in group:
        if name.startswith("#"):  # MATLAB's store of referenced objects
            continue
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            tree[name] = None
            continue
        item = group[name]
        if isinstance(item, h5py.Group):
            closed = depth == 0 or item in (*above, group) or "MATLAB_sparse" in item.attrs
            tree[name] = None if closed else _group(item, depth - 1, (*above, group))
        elif isinstance(item, h5py.Dataset):
            tree[name] = _dataset(item)
    return tree


def _dataset(item: Any) -> Any:
    kind = item.attrs.get("MATLAB_class", b"")
    if "MATLAB_empty" in item.attrs:
        return "" if kind == b"char" else np.empty(0)
    if item.is_virtual or item.external or item.dtype.kind not in "fiub":
        return None
    values = np.asarray(item[()]).T
    if kind == b"char":
        return "".join(map(chr, values.ravel().astype(int)))
    return np.squeeze(values)


# -- variables to columns -------------------------------------------------------------------------------------------
def _leaves(tree: Tree, above: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    for name, value in tree.items():
        if name == "units" and isinstance(value, dict):
            continue
        if isinstance(value, dict):
            yield from _leaves(value, (*above, name))
        else:
            yield (*above, name), value


def _unit(tree: Tree, place: tuple[str, ...]) -> str | None:
    """Text of the unit of a variable, from the `units` beside it or else from the `units` at the top."""
    level = tree
    for step in place[:-1]:
        level = level[step]
    for holder in (level.get("units"), tree.get("units")):
        text = holder.get(place[-1]) if isinstance(holder, dict) else None
        if isinstance(text, str):
            return text.strip()
    return None


def _table(tree: Tree, where: str) -> ColumnTable:
    leaves = list(_leaves(tree))
    last = [place[-1] for place, value in leaves if _is_numeric(value)]
    named = {place: place[-1] if last.count(place[-1]) <= 1 else ".".join(place) for place, _ in leaves}
    stated = {p[-1]: float(v) for p, v in leaves if p[-1] in _STATED and _is_numeric(v) and np.size(v) == 1}
    arrays = {p: np.asarray(v) for p, v in leaves if _is_numeric(v) and p[-1] not in stated}
    n = _length([a for p, a in arrays.items() if is_time_name(named[p])], list(arrays.values()), where)
    columns: list[Column] = []
    notes: list[str] = []
    for place, _ in leaves:
        array = arrays.get(place)
        if place[-1] in stated:
            continue
        if array is None or array.ndim > 2 or not array.ndim or array.shape[0] != n:
            size = "no numbers" if array is None else f"size {'x'.join(map(str, array.shape)) or 1}"
            notes.append(f"variable '{'.'.join(place)}' is left out: {size}, where vectors have {n} samples")
            continue
        columns += _columns(named[place], array.astype(float), _unit(tree, place))
    scalars = {p[-1]: float(a.item()) for p, a in arrays.items() if a.size == 1}
    return ColumnTable(columns, stated_period(stated, where), notes, scalars)


def _columns(name: str, array: np.ndarray, unit: str | None) -> list[Column]:
    bare, in_name = headed(name)
    unit = unit if unit is not None else in_name
    if array.ndim == 1:
        return [Column(bare, array, unit)]
    return [Column(f"{bare}_{i + 1}", array[:, i], unit) for i in range(array.shape[1])]


def _is_numeric(value: Any) -> bool:
    return isinstance(value, (int, float, bool, np.ndarray, np.generic)) and np.asarray(value).dtype.kind in "fiub"


def _length(clocks: list[np.ndarray], arrays: list[np.ndarray], where: str) -> int:
    """Number of samples: that of the time vector, or of the longest vector."""
    lengths = [a.shape[0] for a in clocks or arrays if a.ndim in (1, 2)]
    if not lengths or max(lengths) == 0:
        raise InputError(f"{where}: there is no numeric vector",
                         mend="save time and channels as vectors: save('data.mat', 'time', 'velocity', 'force')")
    return max(lengths)
