"""The codec: what goes to plain data comes back the same, and every fault of a file is named by its key."""

from __future__ import annotations

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lpvid.codec import ADDED, VERBATIM, Coded, Encoded, MissingKey, build, encode, null
from lpvid.errors import InputError


class Shape(Coded, ABC):
    NOUN = "shape"
    JSON = ("kind", ...)

    @abstractmethod
    def area(self) -> float: ...


@dataclass(frozen=True)
class Square(Shape):
    kind = "square"
    side: float

    def area(self) -> float:
        return self.side**2


@dataclass(frozen=True)
class Circle(Shape):
    kind = "circle"
    radius: float = 1.0

    def area(self) -> float:
        return math.pi * self.radius**2


@dataclass(frozen=True, eq=False)
class Drawing(Coded):
    JSON = ("title", ("outline", "shapes"), "table", "total", "limit", "pair", "notes", "named", "extra", "switch")

    title: str
    shapes: tuple[Shape, ...]
    table: np.ndarray
    limit: float = field(default=math.inf, metadata=null(math.inf))
    pair: tuple[int, str] | None = None
    notes: Mapping = field(default_factory=dict, metadata=VERBATIM)
    named: Mapping[str, Circle] = field(default_factory=dict)
    extra: int = field(default=7, metadata=ADDED)
    switch: bool | str = False

    @property
    def total(self) -> float:
        return sum(s.area() for s in self.shapes)

    @classmethod
    def array_shapes(cls, values: Mapping) -> dict[str, tuple[int, ...]]:
        return {"table": (-1, len(values["shapes"]))}


def drawing(**changes) -> Drawing:
    return Drawing(**{"title": "one", "shapes": (Square(2.0), Circle(0.5)), "table": np.arange(6.0).reshape(3, 2),
                      "pair": (3, "x"), "named": {"c": Circle(2.0)}, "notes": {"who": ["a"]}, **changes})


def test_keys_stand_in_the_order_of_the_layout_with_renamed_and_computed_ones():
    data = drawing().to_dict()
    assert list(data) == ["title", "outline", "table", "total", "limit", "pair", "notes", "named", "extra", "switch"]
    assert data["outline"] == [{"kind": "square", "side": 2.0}, {"kind": "circle", "radius": 0.5}]
    assert data["total"] == pytest.approx(4.0 + math.pi / 4)
    assert data["limit"] is None
    assert json.loads(json.dumps(data, allow_nan=False)) == data


@pytest.mark.parametrize("table", [np.arange(6.0).reshape(3, 2), np.zeros((0, 2))])
def test_what_was_written_is_read_with_types_and_shapes(table):
    one = drawing(table=table, switch="lag", extra=2)
    back = Drawing.from_dict(json.loads(json.dumps(one.to_dict())))
    assert np.array_equal(back.table, table) and back.table.shape == table.shape
    assert (back.shapes, back.pair, back.limit, back.named) == (one.shapes, (3, "x"), math.inf, {"c": Circle(2.0)})
    assert (back.notes, back.extra, back.switch) == ({"who": ["a"]}, 2, "lag")


def test_a_field_that_older_files_lack_has_its_default():
    data = drawing(extra=3).to_dict()
    del data["extra"], data["total"]
    assert Drawing.from_dict({"schema": "x/1", "lpvid_version": "0", **data}).extra == 7


PLAIN = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text()


@pytest.mark.seconds
@given(st.recursive(PLAIN, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner), max_leaves=20))
def test_plain_data_stay_as_they_are(value):
    assert encode(value) == value


def test_numbers_of_every_kind_are_plain():
    got = encode((np.float64(1.5), np.int64(2), np.bool_(True), 1 + 2j, math.nan, -math.inf, np.array([1.0, np.nan]),
                  np.array([1j]), np.array([True])))
    assert got == [1.5, 2, True, [1.0, 2.0], None, None, [1.0, None], [[0.0, 1.0]], [True]]
    assert [type(v) for v in got[:3]] == [float, int, bool]


FAULTS = {
    "unknown key": ({"titel": "x"}, r"no key of Drawing 'titel'; there are title, .*did you mean 'title'\?"),
    "wrong text": ({"title": 3}, "title must be text: got 3"),
    "wrong number": ({"limit": "far"}, "limit must be a number: got 'far'"),
    "true is no number": ({"limit": True}, "limit must be a number: got True"),
    "whole number": ({"extra": 1.5}, "extra must be a whole number: got 1.5"),
    "no list": ({"outline": 3}, "outline must be a list: got 3"),
    "length": ({"pair": [1]}, r"pair must be a list of 2: got \[1\]"),
    "text in an array": ({"table": [["a", 1]]}, "table must hold numbers"),
    "ragged array": ({"table": [[1.0, 2.0], [1.0]]}, "table must hold numbers"),
    "unknown kind": ({"outline": [{"kind": "cube"}]}, "unknown shape in a model file: got cube; known: circle, square"),
    "no table": ({"named": {"c": 3}}, "must be a table: got 3"),
    "inner key": ({"named": {"c": {"kind": "circle", "radios": 1.0}}},
                  "no key of Circle 'radios'.*did you mean 'radius'"),
}


@pytest.mark.parametrize("case", FAULTS)
def test_a_fault_is_one_line_that_names_the_key(case):
    changes, message = FAULTS[case]
    with pytest.raises(InputError, match=message) as caught:
        Drawing.from_dict({**drawing().to_dict(), **changes})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("key", ["title", "outline", "table", "limit", "pair", "named"])
def test_a_missing_key_is_named_with_its_place(key):
    data = drawing().to_dict()
    del data[key]
    with pytest.raises(MissingKey, match=f"the key '{key}' is missing") as caught:
        Drawing.from_dict(data)
    assert caught.value.key == key
    with pytest.raises(MissingKey, match=r"'named\.radius'"):
        Drawing.from_dict({**drawing().to_dict(), "named": {"c": {"kind": "circle"}}})


def test_a_table_may_leave_keys_out_where_that_is_said():
    assert build(Circle, {}, "c", partial=True) == Circle()
    with pytest.raises(MissingKey, match="radius"):
        build(Circle, {}, "c")


def test_what_only_goes_out_has_no_way_back():
    @dataclass(frozen=True)
    class Verdict(Encoded):
        JSON = (..., "good")
        score: float

        @property
        def good(self) -> bool:
            return self.score > 0

    assert Verdict(math.nan).to_dict() == {"score": None, "good": False}
    assert not hasattr(Verdict, "from_dict")
