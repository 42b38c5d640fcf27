"""Records that hold training rows are known again, wherever they begin; where that is open, it is stated."""

from __future__ import annotations

import json

import numpy as np
import pytest

import lpvid as lpv
from lpvid.training_rows import STRETCHES, RowComparison, TrainingRows
from lpvid.validation.free_runs import free_runs
from lpvid.validation.streamed import validate_stream

ARX = lpv.ARX(na=1, nb=1, input="u", output="y")


@pytest.fixture(scope="module")
def whole() -> lpv.Record:
    rng = np.random.default_rng(4)
    u = rng.normal(size=9000)
    y = np.zeros(9000)
    for k in range(1, 9000):
        y[k] = 0.8 * y[k - 1] + u[k - 1] + 0.1 * rng.normal()
    return lpv.Record({"u": u, "y": y}, sample_time=0.01, name="run", units={"u": "V", "y": "N"})


@pytest.fixture(scope="module")
def model(whole: lpv.Record):
    return lpv.identify(whole.slice(0, 6000), ARX).model


def test_the_first_rows_of_a_training_record_are_no_held_out_data(model, whole) -> None:
    for n in (8, 12, 31, 33, 5000):
        assert lpv.validate(model, whole.slice(0, n)).label == "training", n
        assert free_runs(model, whole.slice(0, n)).label == "training", n


def test_a_part_from_the_middle_is_known_again_wherever_it_begins(model, whole) -> None:
    needed = RowComparison(model.metadata).needed
    for start in (1, 777, 2048, 5990 - needed):
        found = lpv.validate(model, whole.slice(start, start + needed))
        assert found.label == "training", start
        assert any("not held-out: run holds samples" in n for n in found.notes)
    assert lpv.validate(model, whole.slice(6000, 9000)).label == "held-out"
    assert lpv.validate(model, whole.slice(5000, 7000)).label == "partly training"
    assert lpv.validate(model, whole).label == "partly training"


def test_a_record_that_is_too_short_to_decide_is_not_called_held_out(model, whole) -> None:
    for part in (whole.slice(100, 112), whole.slice(8000, 8012)):
        found = lpv.validate(model, part)
        assert found.label == "held-out or training"
        note, = [n for n in found.notes if "not known to be held-out" in n]
        assert "12 rows are too few" in note
        assert free_runs(model, part).label == "held-out or training"
        assert validate_stream(model, [part]).label == "held-out or training"
        assert lpv.validate(model, part, label="held-out").label == "held-out"  # the caller knows
    both = lpv.validate(model, [whole.slice(8000, 8012), whole.slice(7000, 7900)])
    assert both.label == "held-out"  # pieces of one record, of which the longer decides


def test_held_out_rows_that_identify_was_given_apart_stay_held_out(whole) -> None:
    found = lpv.identify(whole.slice(0, 60), ARX, held_out=whole.slice(60, 80))
    assert found.held_out.label == "held-out"


def test_a_turned_sensor_and_another_unit_change_nothing(model, whole) -> None:
    part = whole.slice(1000, 1500)
    turned = part.with_channel("y", -part["y"], "N")
    assert lpv.validate(model, turned).label == "training"
    in_kilonewton = lpv.Record({"u": part["u"], "y": part["y"] / 1000}, sample_time=0.01, units={"u": "V", "y": "kN"})
    assert lpv.validate(model, in_kilonewton).label == "training"


def test_a_part_of_a_file_that_was_resampled_is_known_again(whole) -> None:
    """As read it has the rows of the file; at the model's rate a part has other ones than the whole."""
    model = lpv.identify(whole.slice(0, 6000), ARX, sample_rate=40.0).model
    for part in (whole.slice(0, 700), whole.slice(1001, 1700)):
        assert lpv.validate(model, part).label == "training"
    assert lpv.validate(model, whole.slice(6000, 9000)).label == "held-out"


def test_missing_samples_hide_no_training_rows(model, whole) -> None:
    y = whole["y"].copy()
    y[[100, 2000, 2001, 4000]] = np.nan
    assert lpv.validate(model, whole.with_channel("y", y, "N").slice(50, 5950)).label == "training"


def test_records_of_one_rig_are_not_taken_for_each_other() -> None:
    """Two runs of one sine, 12 bits, noise of one step: only the noise differs."""
    rng = np.random.default_rng(11)
    t = np.arange(20_000) / 500
    runs = [np.round(900 * np.sin(2 * np.pi * t) + rng.normal(size=t.size)) for _ in range(2)]
    known = TrainingRows()
    known.add(runs[0])
    metadata = {"training": {"rows": known.to_dict()}}
    for run, label in zip(runs, ("training", "held-out"), strict=True):
        compared = RowComparison(metadata)
        compared.add(run, "run")
        assert compared.label == label


def test_rest_is_no_print() -> None:
    """A sensor at rest, one step to and fro now and then, is alike in all records."""
    rng = np.random.default_rng(2)
    known = TrainingRows()
    known.add(np.where(rng.uniform(size=4000) < 0.02, 1.0, 0.0))
    assert not known.prints


def test_prints_do_not_grow_with_the_data_nor_depend_on_their_parts(rng) -> None:
    data = rng.normal(size=100_000)
    one, many = TrainingRows(), TrainingRows()
    one.add(data)
    for k, a in enumerate(range(0, 100_000, 777)):
        many.add(data[a:a + 777], continues=k > 0)
        if k == 50:
            many = TrainingRows.restored(json.loads(json.dumps(many.state())))
    assert STRETCHES / 2 - 1 <= len(one.prints) <= STRETCHES
    assert one.to_dict() == many.to_dict()
    assert len(json.dumps(one.to_dict())) < 12_000
    assert one.spacing * STRETCHES >= one.rows > one.spacing * STRETCHES / 2


def test_a_model_of_no_data_makes_every_record_held_out_and_an_old_one_leaves_it_open(whole, model) -> None:
    bare = model.replace(metadata={})
    assert lpv.validate(bare, whole.slice(0, 12)).label == "held-out"
    old = model.replace(metadata={"training": {"heads": model.metadata["training"]["rows"]["heads"]}})
    assert lpv.validate(old, whole).label == "training"
    found = lpv.validate(old, whole.slice(6000, 9000))
    assert found.label == "held-out or training"
    assert any("the model keeps no rows of its training data by which to decide" in n for n in found.notes)


def label_of(known: np.ndarray, record: np.ndarray, piece: int | None = None) -> str:
    rows = TrainingRows()
    rows.add(known)
    compared = RowComparison({"training": {"rows": rows.to_dict()}})
    for a in range(0, len(record), piece or len(record)):
        compared.add(record[a: a + (piece or len(record))], "run", continues=a > 0)
    return compared.label


def test_where_training_rows_end_is_found_in_pieces_of_any_length(rng) -> None:
    """A piece that ends where they do holds no other row, and one that is shorter than from print to print none."""
    known = rng.normal(size=20_000)
    for whole in (np.concatenate([known, rng.normal(size=10_000)]), np.concatenate([rng.normal(size=10_000), known])):
        for piece in (None, 10_000, 50):
            assert label_of(known, whole, piece) == "partly training", piece
    for piece in (None, 10_000, 50):
        assert label_of(known, known, piece) == "training", piece
        assert label_of(known, rng.normal(size=3000), piece) == "held-out", piece


def test_rows_that_are_too_alike_to_be_known_again_are_not_called_held_out(rng) -> None:
    t = np.arange(20_000) / 1000
    coarse = np.round(3 * np.sin(np.pi * t) + 0.1 * rng.normal(size=t.size))
    square = np.sign(np.sin(2.6 * np.pi * t))
    rest = np.concatenate([np.round(0.2 * rng.normal(size=20_000)), 50 * rng.normal(size=2000)])
    for known in (coarse, square, rest):
        assert label_of(known, known[5000:9000]) == "held-out or training"
        assert label_of(known, known[5000:9000], 1000) == "held-out or training"
    assert label_of(rest, rest[20_500:21_000]) == "training"
    assert label_of(rest, 50 * rng.normal(size=500)) == "held-out"


def test_a_step_from_rest_is_no_beginning_of_a_training_record(rng) -> None:
    for head in (np.repeat([0.0, 1.0, 0.0], [20, 1, 19]), np.repeat([0.0, 1.0], [10, 30])):
        known, other = (np.concatenate([head, rng.normal(size=4000)]) for _ in range(2))
        assert label_of(known, known) == "training"
        assert label_of(known, other) == "held-out"


def test_a_record_that_was_written_with_fewer_digits_is_known_by_its_beginning(rng) -> None:
    known = rng.normal(size=4000)
    assert label_of(known, known.round(7)) == "training"
    run_up = np.arange(40) ** 3.0  # the same in both, to the last digit, and nothing behind it is
    other = np.concatenate([run_up, rng.normal(size=400)])
    assert label_of(np.concatenate([run_up, known]), other) == "partly training"


@pytest.mark.seconds
def test_training_records_of_two_rates_are_both_known_again(whole) -> None:
    slow = lpv.Record({n: whole[n][::2] for n in ("u", "y")}, 0.02, name="slow", units={"u": "V", "y": "N"})
    for records in ([whole, slow], [slow, whole]):
        model = lpv.identify(records, ARX, sample_rate=50.0).model
        for part in (whole, slow, [whole, slow], whole.slice(3000, 7000), slow.slice(1001, 4000)):
            assert lpv.validate(model, part).label == "training"
            assert free_runs(model, part).label == "training"


def test_prints_of_parts_that_were_taken_in_apart_know_each_of_them(rng) -> None:
    for sizes in ((9000, 400, 30_000), (300,) * 40):
        parts = [rng.normal(size=n) for n in sizes]
        several = [TrainingRows() for _ in parts]
        for rows, values in zip(several, parts, strict=True):
            rows.add(values)
        found = TrainingRows.merged(several)
        assert 0 < len(found.prints) <= STRETCHES and len(found.heads) == len(parts)
        metadata = {"training": {"rows": found.to_dict()}}
        assert found.spacing * STRETCHES >= sum(sizes)
        for values, label in [(values, "training") for values in parts] + [(rng.normal(size=900), "held-out")]:
            compared = RowComparison(metadata)
            compared.add(values, "run")
            assert compared.label == label
