"""Record: immutable channels on one time base."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lpvid.errors import InputError
from lpvid.record import Channel, Record


def a_record(**changes) -> Record:
    settings = {"sample_time": 0.1, "units": {"v": "m/s", "F": "N"}, "roles": {"force": "F"}, "name": "run"} | changes
    return Record({"v": [0.0, 1.0, 2.0, 3.0], "F": [4.0, 5.0, 6.0, 7.0]}, **settings)


def test_the_callers_array_is_copied_and_the_copy_is_read_only() -> None:
    mine = np.arange(3.0)
    record = Record({"x": mine}, sample_time=1.0)
    mine[0] = 99.0
    assert record["x"].tolist() == [0.0, 1.0, 2.0]
    with pytest.raises(ValueError, match="read-only"):
        record["x"][0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        record.name = "other"  # type: ignore[misc]
    with pytest.raises(TypeError):
        record.channels["y"] = Channel(np.zeros(3))  # type: ignore[index]
    with pytest.raises(TypeError):
        record.roles["force"] = "x"  # type: ignore[index]


def test_the_callers_time_stamps_are_copied_too() -> None:
    stamps = np.array([0.0, 0.1, 0.2])
    record = Record({"x": np.zeros(3)}, time=stamps)
    stamps[0] = -5.0
    assert record.times[0] == 0.0
    assert record.time is not None
    with pytest.raises(ValueError, match="read-only"):
        record.time[0] = 1.0


@pytest.mark.parametrize("dtype", [np.float32, np.int16, np.uint8, bool, ">f8"])
def test_any_real_number_type_becomes_double(dtype) -> None:
    record = Record({"x": np.array([0, 1, 1]).astype(dtype)}, sample_time=1.0)
    assert record["x"].dtype == np.float64
    assert record["x"].dtype.isnative
    assert record["x"].tolist() == [0.0, 1.0, 1.0]


def test_a_negated_unsigned_channel_is_negative() -> None:
    assert Record({"x": np.array([1, 2], dtype=np.uint8)}, sample_time=1.0).flip("x")["x"].tolist() == [-1.0, -2.0]


def test_roles_names_and_case_lead_to_the_same_channel() -> None:
    record = a_record()
    assert record["force"] is record["F"]
    assert record["f"] is record["F"]
    assert (record.unit("force"), record.resolve("V"), record.has("force"), record.has("torque")) == (
        "N",
        "v",
        True,
        False,
    )
    more = record.with_roles({"speed": "v"})
    assert more["speed"].tolist() == [0, 1, 2, 3]
    assert more["force"].tolist() == [4, 5, 6, 7]
    assert record.matrix(["force", "v"]).tolist() == [[4, 0], [5, 1], [6, 2], [7, 3]]
    assert record.matrix([]).shape == (4, 0)


def test_a_wrong_name_lists_what_there_is_and_how_to_map_it() -> None:
    with pytest.raises(InputError, match=r"record 'run' has no channel 'torque'; there are v, F\. Mend: .*torque="):
        a_record()["torque"]
    with pytest.raises(InputError, match=r"did you mean 'F'|role 'force'"):
        a_record(roles={"force": "Fz"})


@pytest.mark.parametrize(
    ("channels", "clock", "words"),
    [
        ({}, {"sample_time": 1.0}, "no channels"),
        ({"a": [1, 2], "b": [1, 2, 3]}, {"sample_time": 1.0}, "differ in length"),
        ({"a": [1, 2]}, {}, "either sample_time or time: got neither"),
        ({"a": [1, 2]}, {"sample_time": 1.0, "time": [0, 1]}, "either sample_time or time: got both"),
        ({"a": [1, 2]}, {"time": [0, 1, 2]}, "time differs in length"),
        ({"a": [1, 2]}, {"sample_time": 0.0}, "sample_time must be positive"),
        ({"a": [1, 2]}, {"sample_time": np.nan}, "sample_time must be finite"),
        ({"a": ["x", "y"]}, {"sample_time": 1.0}, "channel 'a' must hold numbers"),
        ({"a": [1j, 2]}, {"sample_time": 1.0}, "channel 'a' must hold numbers"),
        ({"a": [[1, 2], [3, 4]]}, {"sample_time": 1.0}, "channel 'a' must have 1 dimension"),
    ],
)
def test_what_is_no_record_is_refused(channels, clock, words) -> None:
    with pytest.raises(InputError, match=words):
        Record(channels, name="run", **clock)


@given(n=st.integers(1, 40), first=st.integers(-50, 50), last=st.integers(-50, 50))
def test_a_slice_is_what_numpy_slices_with_its_times(n: int, first: int, last: int) -> None:
    record = Record({"x": np.arange(float(n))}, sample_time=0.25, start=3.0, roles={"in": "x"})
    cut = record.slice(first, last)
    expected = slice(first, last)
    assert cut["in"].tolist() == np.arange(float(n))[expected].tolist()
    np.testing.assert_allclose(cut.times, (3.0 + 0.25 * np.arange(n))[expected], rtol=0, atol=1e-12)
    assert cut.duration == pytest.approx(max(0.25 * (cut.n_samples - 1), 0.0))


def test_a_slice_of_stamped_samples_keeps_their_stamps() -> None:
    stamps = np.array([0.0, 0.1, 0.2, 0.9, 1.0, 1.1])
    record = Record({"x": np.arange(6.0)}, time=stamps)
    assert not record.is_uniform
    tail = record.slice(3, 6)
    assert tail.times.tolist() == [0.9, 1.0, 1.1]
    assert tail.is_uniform
    assert tail.sample_time == pytest.approx(0.1)


def test_a_flip_turns_one_channel_and_says_so() -> None:
    flipped = a_record(notes=("read",)).flip("force")
    assert flipped["F"].tolist() == [-4, -5, -6, -7]
    assert flipped["v"].tolist() == [0, 1, 2, 3]
    assert flipped.notes == ("read", "sign of 'F' turned on request")
    assert flipped.unit("F") == "N"
    assert flipped.flip("F")["F"].tolist() == a_record()["F"].tolist()


def test_a_derived_channel_keeps_the_rest_and_leaves_the_original() -> None:
    record = a_record()
    more = record.with_channel("power", record["F"] * record["v"], "W", "computed")
    assert more["power"].tolist() == [0, 5, 12, 21]
    assert (more.unit("power"), more.notes, more.sample_time) == ("W", ("computed",), 0.1)
    assert not record.has("power")
    assert more.with_note("seen").notes == ("computed", "seen")


@pytest.mark.parametrize(
    "derive",
    [
        lambda r: r.with_note("n"),
        lambda r: r.flip("x"),
        lambda r: r.with_roles({"r": "x"}),
        lambda r: r.with_channel("y", np.ones(4)),
    ],
)
@pytest.mark.parametrize(
    "clock", [{"sample_time": 0.5, "start": 7.0}, {"time": [7.0, 7.5, 8.0, 8.5]}, {"time": [7.0, 7.5, 8.0, 9.5]}]
)
def test_deriving_keeps_the_clock(derive, clock) -> None:
    record = Record({"x": np.arange(4.0)}, **clock)
    derived = derive(record)
    assert derived.times.tolist() == record.times.tolist()
    assert derived.sample_time == record.sample_time
    assert derived.start == 7.0


def test_it_prints_in_one_line() -> None:
    assert repr(a_record()) == "Record 'run': 4 samples, 10 Hz, v [m/s], F [N]"


@pytest.mark.parametrize(("there", "stated"), [
    ("force_2", "force_1"), ("force_12", "force_1"), ("accel_y", "accel_x"), ("velocity_1", "velocity_2"),
    ("velocity_x", "velocity"), ("accel_front_left", "accel_front_right"), ("Velocity_Rear", "Velocity_Front"),
    ("wheel_speed_fl", "wheel_speed_rr"),
])
def test_the_unit_of_another_channel_is_no_slip(there, stated) -> None:
    assert Record({there: [1.0, 2.0]}, 0.1, units={stated: "kN"})[there].tolist() == [1.0, 2.0]


@pytest.mark.parametrize(("there", "stated"), [
    ("force_1", "forec_1"), ("force_2", "force 2"), ("accel_x", "acel_x"), ("Force", "force"), ("velocity", "velocty"),
])
def test_the_unit_of_a_misspelt_channel_is_refused(there, stated) -> None:
    with pytest.raises(InputError, match=f"names '{stated}', which is no channel.*mean '{there}'"):
        Record({there: [1.0, 2.0], "other": [1.0, 2.0]}, 0.1, units={stated: "kN"})


def test_a_channel_with_its_own_unit_does_not_want_one() -> None:
    assert Record({"force": Channel([1.0, 2.0], "N")}, 0.1, units={"forcee": "kN"}).unit("force") == "N"
