"""The checks: what passes, what does not, and in which words."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid import _checks
from lpvid.errors import InputError, LpvError, NumericalError


def test_errors_read_what_got_why_mend() -> None:
    error = InputError("no column", got="a, b", why="force is missing", mend="map it.")
    assert str(error) == "no column: got a, b; force is missing. Mend: map it."
    assert (error.what, error.got, error.why, error.mend) == ("no column", "a, b", "force is missing", "map it.")
    assert "\n" not in str(InputError("one\nline", got="x\n  y"))
    assert (InputError.exit_code, NumericalError.exit_code) == (2, 3)
    assert issubclass(InputError, ValueError)
    assert issubclass(NumericalError, LpvError)


def test_a_frozen_array_is_a_read_only_copy() -> None:
    mine = np.asfortranarray(np.ones((2, 3)))
    frozen = _checks.frozen_array(mine, "m", ndim=2)
    mine[0, 0] = 7
    assert frozen[0, 0] == 1
    assert frozen.flags.c_contiguous
    assert not frozen.flags.writeable


@pytest.mark.parametrize("bad", ["abc", [[1, 2], [3]], [1j], object()])
def test_what_is_no_array_of_numbers_is_refused(bad) -> None:
    with pytest.raises(InputError, match="m must hold numbers"):
        _checks.frozen_array(bad, "m")


def test_shapes_and_finiteness() -> None:
    array = np.ones((2, 3))
    assert _checks.shaped(array, (2, None), "m") is array
    for shape in ((3, 3), (2,), (2, 3, 1)):
        with pytest.raises(InputError, match=r"m must have shape .* got shape \(2, 3\)"):
            _checks.shaped(array, shape, "m")
    assert _checks.finite(array, "m") is array
    with pytest.raises(InputError, match=r"m must be finite: got inf at index \(1, 2\)"):
        _checks.finite(np.array([[1, 2, 3], [4, 5, np.inf]]), "m")
    with pytest.raises(InputError, match="2 dimension"):
        _checks.frozen_array([1.0], "m", ndim=2)


@pytest.mark.parametrize("bad", [0, -1, np.nan, np.inf, "x", None])
def test_positive_numbers(bad) -> None:
    assert _checks.positive(np.float32(0.5), "x") == 0.5
    with pytest.raises(InputError, match="x must be"):
        _checks.positive(bad, "x", "Hz")


@pytest.mark.parametrize("bad", [-1, 1.0, True, "1", None, np.float64(2)])
def test_whole_numbers(bad) -> None:
    assert _checks.count(np.int64(3), "n") == 3
    assert type(_checks.count(np.int64(3), "n")) is int
    with pytest.raises(InputError, match="n must be a whole number of at least 0"):
        _checks.count(bad, "n")


def test_counts_spread_over_channels() -> None:
    assert _checks.counts(2, 3, "nb") == (2, 2, 2)
    assert _checks.counts(np.array([1, 2]), 2, "nb") == (1, 2)
    with pytest.raises(InputError, match=r"one number for each of 2 channel\(s\): got 3 numbers"):
        _checks.counts([1, 2, 3], 2, "nb")
    with pytest.raises(InputError, match="at least 1"):
        _checks.counts([1, 0], 2, "nb", at_least=1)
    with pytest.raises(InputError, match="nb must be"):
        _checks.counts("22", 2, "nb")


def test_lists_of_names() -> None:
    assert _checks.names(" a, b ,", "input") == ("a", "b")
    assert _checks.names(["a", "b"], "input") == ("a", "b")
    for bad in ("", ",", []):
        with pytest.raises(InputError, match="input needs at least one name"):
            _checks.names(bad, "input")
    with pytest.raises(InputError, match="input names a channel twice: got a, b, a"):
        _checks.names("a,b,a", "input")
    with pytest.raises(InputError, match="input must be channel names"):
        _checks.names([1, 2], "input")  # type: ignore[list-item]


def test_a_near_miss_is_pointed_out() -> None:
    with pytest.raises(InputError, match="did you mean 'velocity'"):
        _checks.known_name("velocty", ["velocity", "force"], "channel")
    with pytest.raises(InputError, match=r"did you mean 'velocity'\? Or map it with --role v=CHANNEL\.$"):
        _checks.known_name("velocty", ["velocity", "force"], "channel", "map it with --role v=CHANNEL")
    with pytest.raises(InputError, match=r"Mend: did you mean 'velocity'\?$"):
        _checks.known_name("velocty", ["velocity", "force"], "channel")
    with pytest.raises(InputError, match="there are none"):
        _checks.known_name("x", [], "channel")
    with pytest.raises(InputError, match=r"form must be one of a, bcd: got 'bc'\. Mend: did you mean 'bcd'"):
        _checks.one_of("bc", ("a", "bcd"), "form")


def test_an_array_that_nobody_can_write_to_is_not_copied() -> None:
    frozen = _checks.owned(np.arange(6.0))
    assert _checks.frozen_array(frozen, "m") is frozen
    assert _checks.frozen_array(frozen[:], "m").base is frozen  # the whole of it under another name
    part = _checks.frozen_array(frozen[:3], "m")  # a part would keep all of it
    mine = np.arange(6.0)
    seen = _checks.frozen_array(_checks.read_only(mine), "m")  # the array behind that view can be written to
    mine[0] = 7.0
    assert part.base is None and seen[0] == 0.0
    assert _checks.frozen_array(_checks.owned(np.arange(3)), "m").dtype == float
