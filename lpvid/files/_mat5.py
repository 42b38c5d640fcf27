"""MAT-files of level 5 (MATLAB 5 to 7): every tag is checked against the bytes that are there before it is used.

A file is a row of elements, each a tag (type, size) and its bytes, padded to 8; a variable is an element of elements:
flags, dimensions, name, and then numbers, text, or the variables of a struct. scipy's compiled reader follows tags
unchecked and takes the whole process down on a damaged one.
"""

from __future__ import annotations

import math
import zlib
from typing import Any

import numpy as np

from lpvid.files._table import SIZE_LIMIT, check_claim

_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_TEXTS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_MATRIX, _COMPRESSED = 14, 15
_STRUCT, _CHAR, _NUMERIC = 2, 4, range(6, 16)
_COMPLEX = 0x0800
_DEPTH = 8


def is_level5(head: bytes) -> bool:
    """True when the 128-byte head is that of a level-5 MAT-file."""
    return len(head) >= 128 and head[126:128] in (b"IM", b"MI")


def read_level5(raw: bytes, where: str) -> dict[str, Any]:
    """Variables of a level-5 MAT-file.

    Parameters
    ----------
    raw : bytes
        The whole file.
    where : str
        Its name, for messages.

    Returns
    -------
    dict
        Arrays without their singleton dimensions, text, dictionaries for structs; None for any other variable.

    Raises
    ------
    ValueError
        A tag does not fit the bytes.
    InputError
        A variable claims more samples than the file can hold.
    """
    parser = _Parser("<" if raw[126:128] == b"IM" else ">", where, len(raw))
    content = memoryview(raw)
    variables: dict[str, Any] = {}
    position, unpacked = 128, 0
    while position < len(content):
        kind, body, position = parser.element(content, position)
        if kind == _COMPRESSED:
            inner = _inflate(body, SIZE_LIMIT - unpacked)
            unpacked += len(inner)
            kind, body, _ = parser.element(memoryview(inner), 0)
        if kind != _MATRIX:
            raise ValueError(f"element of type {kind} where a variable should stand")
        name, value = parser.variable(body, _DEPTH)
        if name:  # MATLAB keeps the contents of objects in a variable without a name
            variables[name] = value
    return variables


def _inflate(body: memoryview, most: int) -> bytes:
    unpacker = zlib.decompressobj()
    inner = unpacker.decompress(body, max(most, 1))
    if unpacker.unconsumed_tail:
        raise ValueError(f"a variable unpacks to more than {SIZE_LIMIT / 1e6:.6g} MB")
    if not unpacker.eof:
        raise ValueError("a compressed variable breaks off")
    return inner


class _Parser:
    """Reads elements in one byte order."""

    def __init__(self, order: str, where: str, held: int) -> None:
        self.order, self.where, self.held = order, where, held

    def element(self, content: memoryview, position: int) -> tuple[int, memoryview, int]:
        """Type, bytes and end of the element at `position`; short ones (≤ 4 bytes) share the tag's 8 bytes."""
        if position + 8 > len(content):
            raise ValueError("an element's tag breaks off")
        endian = "little" if self.order == "<" else "big"
        tag = int.from_bytes(content[position:position + 4], endian)
        if tag >> 16:
            kind, size, start = tag & 0xFFFF, tag >> 16, position + 4
            if size > 4:
                raise ValueError(f"a short element claims {size} bytes")
            return kind, content[start:start + size], position + 8
        size = int.from_bytes(content[position + 4:position + 8], endian)
        start = position + 8
        if start + size > len(content):
            raise ValueError(f"an element claims {size} bytes where {len(content) - start} are left")
        padding = 0 if tag == _COMPRESSED else -size % 8
        return tag, content[start:start + size], start + size + padding

    def numbers(self, content: memoryview, position: int) -> tuple[np.ndarray, int]:
        """The numbers of one element."""
        kind, body, end = self.element(content, position)
        if kind not in _TYPES:
            raise ValueError(f"element of type {kind} where numbers should stand")
        return np.frombuffer(body, dtype=self.order + _TYPES[kind]), end

    def variable(self, body: memoryview, depth: int) -> tuple[str, Any]:
        """Name and value of one variable."""
        if not body:  # an empty cell or field
            return "", np.empty(0)
        flags, position = self.numbers(body, 0)
        if flags.size < 1:
            raise ValueError("a variable without flags")
        kind, is_complex = int(flags[0]) & 0xFF, bool(int(flags[0]) & _COMPLEX)
        if kind not in (_STRUCT, _CHAR, *_NUMERIC):
            return self._name_of(body, position, kind), None
        dimensions, position = self.numbers(body, position)
        shape = tuple(int(d) for d in dimensions)
        if len(shape) < 2 or min(shape) < 0:
            raise ValueError(f"dimensions {shape}")
        _, name_bytes, position = self.element(body, position)
        name = bytes(name_bytes).decode("latin-1")
        what = f"variable '{name[:40]}'" if name else "a field"
        check_claim(8 * math.prod(shape), self.where, held=self.held, what=what)
        if kind == _STRUCT:
            return name, self._struct(body, position, shape, depth)
        if kind == _CHAR:
            return name, self._text(body, position)
        values, _ = self.numbers(body, position)
        if values.size != math.prod(shape):
            raise ValueError(f"{what} of size {shape} holds {values.size} numbers")
        return name, None if is_complex else np.squeeze(values.reshape(shape, order="F"))

    def _name_of(self, body: memoryview, position: int, kind: int) -> str:
        """Name of a variable that is left out; an opaque one has no dimensions before it."""
        if kind != 17:
            _, position = self.numbers(body, position)
        return bytes(self.element(body, position)[1]).decode("latin-1")

    def _struct(self, body: memoryview, position: int, shape: tuple[int, ...], depth: int) -> Any:
        width, position = self.numbers(body, position)
        _, packed, position = self.element(body, position)
        if width.size != 1 or width[0] < 1 or len(packed) % int(width[0]):
            raise ValueError("a struct's field names are damaged")
        step = int(width[0])
        names = [bytes(packed[i:i + step]).split(b"\0")[0].decode("latin-1") for i in range(0, len(packed), step)]
        if math.prod(shape) != 1 or depth == 0:
            return None
        fields: dict[str, Any] = {}
        for name in names:
            kind, inner, position = self.element(body, position)
            if kind != _MATRIX:
                raise ValueError(f"element of type {kind} where a field should stand")
            fields[name] = self.variable(inner, depth - 1)[1]
        return fields

    def _text(self, body: memoryview, position: int) -> str:
        kind, inner, _ = self.element(body, position)
        if kind not in _TEXTS:
            raise ValueError(f"element of type {kind} where text should stand")
        encoding = _TEXTS[kind]
        suffix = ("-le" if self.order == "<" else "-be") if encoding in ("utf-16", "utf-32") else ""
        return bytes(inner).decode(encoding + suffix)
