"""Model files: exact, atomic, refused with one line when they are not what they claim."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lpvid.errors import InputError
from lpvid.export import serialise
from lpvid.export.serialise import load, model_hash, save, write_json
from lpvid.model.input_stage import TanhStage, ThreeZoneStage
from lpvid.model.scheduling_stage import SchedulingLag
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.realization import realize
from lpvid.scheduling import Polynomial, Product, Scheduling, Shifted, Spline, Stacked

ARRAYS = {LPVTransferFunction: ("a", "b", "c", "noise_covariance"),
          LPVStateSpace: ("A", "B", "C", "D", "state_offset", "output_offset", "observer_gain", "noise_covariance")}


def model(values=None, **more) -> LPVTransferFunction:
    box = Scheduling(("current",), (0.0,), (2.5,), rate=(100.0,), units=("A",))
    a = [[-0.9, 1 / 3], [math.pi, 1e-300]] if values is None else values
    return LPVTransferFunction.siso(a, [[0, 0], [0.1, 2.0]], Polynomial("current", 1).bound(box), 1 / 512,
                                    scheduling=box, c=[[1.0, -0.0]], **{"inputs": ("velocity",), "outputs": ("force",),
                                                                        **more})


def same(one, other) -> None:
    assert type(one) is type(other)
    for name in ARRAYS[type(one)]:
        first, second = getattr(one, name), getattr(other, name)
        if first is None:
            assert second is None
        else:
            assert first.shape == second.shape
            assert first.tobytes() == second.tobytes(), name  # bit for bit, the sign of zero included
    for name in ("basis", "sample_time", "scheduling", "inputs", "outputs", "input_stage", "scheduling_stage",
                 "metadata"):
        assert getattr(one, name) == getattr(other, name), name


finite = st.floats(allow_nan=False, allow_infinity=False)


@pytest.mark.seconds
@settings(max_examples=60, deadline=None)
@given(numbers=st.lists(st.tuples(finite, finite), min_size=0, max_size=4))
def test_numbers_come_back_bit_for_bit(tmp_path_factory, numbers):
    path = tmp_path_factory.mktemp("m") / "model.json"
    one = model(numbers)
    save(one, path)
    same(one, load(path))


@pytest.mark.parametrize("form", ["controllable", "observable", "shifted", "augmented"])
def test_a_realisation_saves_its_state_space_model(form, tmp_path):
    made = realize(model(scheduling_stage=SchedulingLag(0.005, 0.01, 0.002, with_delay=True),
                         metadata={"polarity": "passive", "records": ["a", "b"]}), form)
    path = save(made, tmp_path / "model.json")
    back = load(path)
    same(made.model, back)
    assert back.metadata["realization"]["form"] == form
    assert json.loads(path.read_text())["schema"] == "lpvid/model/1"


@pytest.mark.parametrize("stage", [TanhStage(0.1, 0.02), ThreeZoneStage(0.05, 0.01, 0.2, 0.0, 0.1, 0.03)])
@pytest.mark.parametrize("basis", [
    Polynomial(("p", "q"), 2), Product(Polynomial("p", 1), Spline("q", 2, 3, (0.0, 1.0, 2.5))),
    Spline("p", 5, 2, (-1.0, -0.3, -0.3, 0.1, 0.4, 1.0)), Polynomial((), 0),
    Stacked((Polynomial("p", 1), Shifted(Polynomial("p", 2), -3)))],
    ids=["polynomial", "product", "doubled-knot", "none", "stacked"])
def test_every_basis_and_stage_comes_back(stage, basis, tmp_path, rng):
    width = 2 if isinstance(stage, TanhStage) else 1
    one = LPVTransferFunction(rng.normal(size=(2, 2, 2, basis.size)), rng.normal(size=(3, 2, width, basis.size)), basis,
                              0.002, inputs=("velocity",), input_stage=stage, lagged=True)
    same(one, load(save(one, tmp_path / "model.json")))


def test_a_continuous_model_and_one_without_states_come_back(tmp_path):
    continuous = LPVStateSpace([[[-1.0]]], [[[1.0]]], [[[1.0]]], [[[0.0]]], Polynomial((), 0), None)
    gain = LPVStateSpace(np.zeros((1, 0, 0)), np.zeros((1, 0, 1)), np.zeros((1, 1, 0)), [[[3.0]]],
                         Polynomial((), 0), 0.1)
    for one in (continuous, gain):
        same(one, load(save(one, tmp_path / "model.json")))


# -- what is not a model file ----------------------------------------------------------------------------------------
def altered(**changes) -> str:
    data = {"schema": "lpvid/model/1", **model().to_dict()}
    for key, value in changes.items():
        if value is ...:
            del data[key]
        else:
            data[key] = value
    return json.dumps(data)


BAD = {
    "not json": ("{\"schema\": ", "is not a JSON file"),
    "empty": ("", r"is not a JSON file; the file is empty \(0 bytes\)"),
    "binary": (b"\x89HDF\r\n\x1a\n\xff\xfe", "is not a JSON file"),
    "deep": ("[" * 200_000, "is not a JSON file"),
    "array": ("[1, 2]", "a JSON list"),
    "number": ("3", "a JSON int"),
    "no schema": (altered(schema=...), "holds no model; it names no .schema.*written by lpvid.save"),
    "other schema": (altered(schema="lpvid/other/1"), "'lpvid/other/1'"),
    "no version": (altered(schema="lpvid/other"), "'lpvid/other'"),
    "other house": (altered(schema="acme/model/1"), "'acme/model/1'"),
    "schema a number": (altered(schema=1), "schema that cannot be loaded: got 1"),
    "version zero": (altered(schema="lpvid/model/0"), "schema that cannot be loaded"),
    "newer": (altered(schema="lpvid/model/2"), "newer format.*reads up to lpvid/model/1. Mend: update lpvid"),
    "kind": (altered(kind="lpv-lft"), "unknown kind of model: got 'lpv-lft'"),
    "kind a list": (altered(kind=["x"]), "unknown kind of model"),
    "no kind": (altered(kind=...), "unknown kind of model"),
    "no coefficients": (altered(a=...), "lacks 'a'"),
    "no basis": (altered(basis=...), "lacks 'basis'"),
    "shape": (altered(a=[[[[0.1, 0.2, 0.3]]]]), "not a consistent model file"),
    "ragged": (altered(b=[[[[0.1, 0.2]]], [[[0.1]]]]), "not a consistent model file"),
    "text": (altered(a="abc"), "not a consistent model file"),
    "null": (altered(a=[[[[None, 0.2]]]]), "not a consistent model file.*finite"),
    "nan": (altered(a=[[[[math.nan, 0.2]]]]), "holds a number that cannot be used: got NaN"),
    "infinity": (altered(sample_time=math.inf), "holds a number that cannot be used: got Infinity"),
    "overflow": (altered().replace("0.001953125", "1e999"), "holds a number that cannot be used: got 1e999"),
    "negative period": (altered(sample_time=-1.0), "sample_time must be positive"),
    "other names": (altered(scheduling={"names": ["v"], "lower": [0.0], "upper": [1.0], "rate": [None], "units": [""]}),
                    "name different variables"),
    "basis kind": (altered(basis={"kind": "wavelet"}), "not a consistent model file"),
    "vast basis": (altered(basis={"kind": "polynomial", "names": ["p", "q", "r"], "degree": 10**9, "centre": [0, 0, 0],
                                  "half_width": [1, 1, 1]}), "functions"),
    "stage kind": (altered(input_stage={"kind": "cubic"}), "unknown input stage"),
    "stage field": (altered(input_stage={"kind": "tanh", "v1": 3}), "not a consistent model file"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_file_is_one_line_with_its_name_and_a_mend(case, tmp_path):
    content, message = BAD[case]
    path = tmp_path / "suspect.json"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=message) as caught:
        load(path)
    text = str(caught.value)
    assert "suspect.json" in text
    assert "Mend: " in text
    assert "\n" not in text
    assert len(text) < 700


@pytest.mark.parametrize("key", [k for k in model().to_dict() if k not in ("kind", "noise")])
def test_every_missing_key_is_named(key, tmp_path):
    path = tmp_path / "suspect.json"
    path.write_text(altered(**{key: ...}))
    with pytest.raises(InputError, match=f"suspect.json' lacks '{key}'"):
        load(path)


@pytest.mark.parametrize("key", [k for k in realize(model(), "observable").model.to_dict() if k != "kind"])
def test_every_missing_key_of_a_state_space_model_is_named(key, tmp_path):
    data = {"schema": "lpvid/model/1", **realize(model(), "observable").model.to_dict()}
    del data[key]
    path = tmp_path / "suspect.json"
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match=f"suspect.json' lacks '{key}'"):
        load(path)


def test_a_huge_file_is_not_read(tmp_path, monkeypatch):
    path = tmp_path / "huge.json"
    with path.open("wb") as file:
        file.truncate(serialise.LARGEST_FILE + 1)  # sparse: takes no space
    monkeypatch.setattr(type(path), "read_bytes", lambda self: pytest.fail("the file was read"))
    with pytest.raises(InputError, match=r"too large.*257 MiB|too large.*256 MiB"):
        load(path)


def test_a_missing_file_and_a_folder_are_named(tmp_path):
    with pytest.raises(InputError, match=r"no file '.*gone.json'"):
        load(tmp_path / "gone.json")
    with pytest.raises(InputError, match="a folder"):
        load(tmp_path)


# -- writing ---------------------------------------------------------------------------------------------------------
def test_what_cannot_be_saved_leaves_nothing_behind(tmp_path):
    with pytest.raises(InputError, match="cannot be saved: got dict"):
        save({"a": 1}, tmp_path / "x.json")
    with pytest.raises(InputError, match="not finite"):
        save(model(metadata={"esr": math.nan}), tmp_path / "x.json")
    with pytest.raises(InputError, match="metadata hold something that JSON cannot: got set"):
        save(model(metadata={"records": {1}}), tmp_path / "x.json")
    with pytest.raises(InputError, match="keys must be str"):
        save(model(metadata={(1, 2): "x"}), tmp_path / "x.json")
    with pytest.raises(InputError, match="no folder"):
        save(model(), tmp_path / "none" / "x.json")
    with pytest.raises(InputError, match="is a folder"):
        save(model(), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_failed_write_keeps_the_old_file(tmp_path, monkeypatch):
    path = save(model(), tmp_path / "model.json")
    before = path.read_bytes()

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(InputError, match="No space left"):
        save(model([[0.5, 0.5]]), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["model.json"]


def test_numpy_values_in_metadata_are_written_plainly(tmp_path):
    one = model(metadata={"esr": np.float64(0.25), "n": np.int64(3), "mask": np.array([True, False])})
    assert load(save(one, tmp_path / "m.json")).metadata == {"esr": 0.25, "n": 3, "mask": [True, False]}


def test_results_write_what_is_not_finite_as_null(tmp_path):
    path = write_json({"esr": np.nan, "limits": (np.inf, -np.inf, 1.5), "at": np.array([[1, 2]]), "ok": np.bool_(True),
                       "n": np.int32(7), "path": tmp_path, "pole": 1 + 2j, "name": "Größe", "none": None},
                      tmp_path / "r.json")
    assert json.loads(path.read_text(encoding="utf-8")) == {
        "esr": None, "limits": [None, None, 1.5], "at": [[1, 2]], "ok": True, "n": 7, "path": str(tmp_path),
        "pole": [1.0, 2.0], "name": "Größe", "none": None}
    with pytest.raises(InputError, match="JSON cannot: got object"):
        write_json({"x": object()}, tmp_path / "r.json")


# -- identity --------------------------------------------------------------------------------------------------------
def test_the_hash_sees_what_computes_and_not_what_is_noted(tmp_path):
    one = model()
    assert model_hash(one) == model_hash(one.replace(metadata={"note": "x"}))
    assert model_hash(one) == model_hash(load(save(one, tmp_path / "m.json")))
    assert len(model_hash(one)) == 64
    others = [one.replace(a=one.a * (1 + 2**-52)), one.replace(lagged=True), one.replace(sample_time=1 / 500),
              one.replace(outputs=("load",)), realize(one, "observable").model]
    assert len({model_hash(m) for m in [one, *others]}) == 6


def test_the_hash_does_not_tell_one_from_one_point_zero():
    whole = Scheduling(("current",), (0.0,), (2.5,), rate=(100,), units=("A",))
    assert model_hash(model()) == model_hash(model().replace(scheduling=whole))


def test_a_file_without_a_noise_model_has_equation_noise(tmp_path):
    path = tmp_path / "old.json"
    path.write_text(altered(noise=...))
    assert load(path).noise.kind == "equation"
