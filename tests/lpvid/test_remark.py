"""Kinds of remarks: what a record lost, or how its velocity came about, is a class and not a wording."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from lpvid import InputError, Record
from lpvid.condition.band_limited import with_quiet_velocity
from lpvid.condition.differentiation import DERIVED, with_velocity
from lpvid.condition.preparing import losses, with_motion
from lpvid.condition.segmentation import segments
from lpvid.remark import Cut, Derivation, LeftOut, QuietDerivation, Turned

PERIOD = 1 / 500


def moved(name: str = "run", n: int = 3000) -> Record:
    x = 0.01 * np.sin(0.02 * np.arange(n))
    return Record({"displacement": x, "force": 100 * x}, sample_time=PERIOD, name=name,
                  units={"displacement": "m", "force": "N"})


@pytest.mark.parametrize("note", ["dropped on the floor before this test", "cut into the hose", "sign of wear",
                                  "record 'b' is the same damper"])
def test_a_note_of_the_user_is_no_loss_whatever_it_begins_with(note):
    assert losses([moved().with_note(note)]) == ()


def test_a_note_of_the_user_does_not_make_a_measured_velocity_a_derived_one():
    record = moved()
    v = np.gradient(record["displacement"], PERIOD) + 0.01 * np.random.default_rng(1).standard_normal(record.n_samples)
    noted = record.with_channel("velocity", v, "m/s").with_note(f"{DERIVED} by the rig's software")
    assert np.array_equal(with_quiet_velocity(noted)["velocity"], v)
    derived = with_quiet_velocity(with_velocity(record))
    assert any(isinstance(n, QuietDerivation) for n in derived.notes)


def test_losses_have_their_kind_and_name_their_record_once():
    broken = moved()
    x = broken["displacement"].copy()
    x[1000:1010] = np.nan
    missing = moved("empty").with_channel("displacement", np.full(3000, np.nan), "m")
    pieces = segments([broken.with_channel("displacement", x, "m").flip("force"), missing], ["displacement", "force"],
                      minimum=100)
    kinds = {type(n) for r in pieces for n in r.notes}
    assert {Cut, Turned, LeftOut} <= kinds
    stated = losses(pieces)
    assert "record 'empty' left out: no row has all channels in use" in stated
    assert sum("'empty'" in line for line in stated) == 1
    assert any(line.startswith(f"record '{broken.name}': cut into 2 pieces") for line in stated)
    assert any("cut into 2 pieces" in line for line in stated) and any("turned on request" in line for line in stated)


def test_the_kind_stays_where_some_records_only_are_derived_and_in_another_process():
    _, notes = with_motion([moved(), with_velocity(moved("b"))])
    assert [type(n) for n in notes] == [Derivation] and "in 1 of 2 records" in notes[0]
    again, = pickle.loads(pickle.dumps(notes))
    assert isinstance(again, Derivation) and again == notes[0]


def test_a_derived_velocity_of_a_wrong_unit_names_the_displacement():
    wrong = with_velocity(moved().with_channel("displacement", moved()["displacement"], "N"))
    with pytest.raises(InputError, match=r"channel 'displacement' has a unit of another quantity.*calls for m\b"):
        segments([wrong], ["velocity", "force"], minimum=10)
