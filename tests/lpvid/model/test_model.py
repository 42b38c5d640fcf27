"""The model nouns: shapes, frozen behaviour, and a bitwise round trip through plain data."""

from __future__ import annotations

import json

import numpy as np
import pytest

from lpvid.errors import InputError
from lpvid.model.input_stage import TanhStage, ThreeZoneStage
from lpvid.model.scheduling_stage import SchedulingLag
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.model.transfer_function import LPVTransferFunction, block_companion
from lpvid.scheduling import Polynomial, Product, Scheduling, Shifted, Spline, Stacked

BOX = Scheduling(("p", "q"), (0.0, -2.0), (3.0, 5.0), rate=(10.0, None), units=("A", ""))
BASES = [
    Polynomial(("p", "q"), degree=2).bound(BOX),
    Product(Polynomial("p"), Spline("q", segments=2)).bound(BOX),
    Stacked((Polynomial("p"), Shifted(Polynomial("q"), 1))).bound(BOX),
]


def a_transfer_function(rng: np.random.Generator, basis=BASES[0], **changes) -> LPVTransferFunction:
    m = basis.size
    settings = {
        "c": rng.normal(size=(2, 2, m)),
        "lagged": True,
        "inputs": (Signal("u", "A"), Signal("w", "m/s")),
        "outputs": (Signal("F", "N"), Signal("x", "m")),
        "noise_covariance": np.diag(rng.uniform(size=2)),
        "metadata": {"note": "a", "list": [1, 2.5, None]},
    } | changes
    width = 3 if settings.get("input_stage") else 2
    return LPVTransferFunction(
        rng.normal(size=(3, 2, 2, m)), rng.normal(size=(4, 2, width, m)), basis, 1 / 512, BOX, **settings
    )


def a_state_space(rng: np.random.Generator, basis=BASES[0], **changes) -> LPVStateSpace:
    m = basis.size
    settings = {
        "state_offset": rng.normal(size=(m, 3)),
        "output_offset": rng.normal(size=(m, 2)),
        "observer_gain": rng.normal(size=(m, 3, 2)),
        "inputs": ("u",),
        "outputs": ("F", "x"),
        "noise_covariance": np.eye(2),
        "metadata": {"a": 1},
    } | changes
    width = 2 if settings.get("input_stage") else 1
    return LPVStateSpace(
        rng.normal(size=(m, 3, 3)),
        rng.normal(size=(m, 3, width)),
        rng.normal(size=(m, 2, 3)),
        rng.normal(size=(m, 2, width)),
        basis,
        1 / 512,
        BOX,
        **settings,
    )


def assert_same(a, b) -> None:
    """Every array equal bit by bit, everything else equal."""
    for name in a.__dataclass_fields__:
        mine, other = getattr(a, name), getattr(b, name)
        if isinstance(mine, np.ndarray):
            assert np.array_equal(mine, other), name
            assert mine.dtype == other.dtype
        else:
            assert mine == other, name


@pytest.mark.parametrize("basis", BASES, ids=lambda b: type(b).__name__)
@pytest.mark.parametrize("stage", [None, TanhStage(0.1, 1 / 3), ThreeZoneStage(0.07, channel=0)])
def test_round_trip_is_bitwise(rng: np.random.Generator, basis, stage) -> None:
    lag = SchedulingLag(tau_rise=0.005, tau_fall=0.01, delay=1 / 3000) if stage is None else None
    ours = [a_state_space(rng, basis, scheduling_stage=lag)]
    if stage is None:
        ours += [a_transfer_function(rng, basis, scheduling_stage=lag), a_state_space(rng, basis, observer_gain=None)]
    elif isinstance(stage, TanhStage):
        ours += [a_transfer_function(rng, basis, input_stage=stage), a_state_space(rng, basis, input_stage=stage)]
    for model in ours:
        again = type(model).from_dict(json.loads(json.dumps(model.to_dict())))
        assert_same(model, again)
        assert repr(again) == repr(model)


def test_round_trip_of_the_smallest_models() -> None:
    constant = Polynomial()
    fir = LPVTransferFunction.siso([], [[0.0], [2.0]], constant, 0.1)
    assert fir.na == 0
    assert fir.frozen_poles([]).size == 0
    assert_same(fir, LPVTransferFunction.from_dict(json.loads(json.dumps(fir.to_dict()))))
    gain = LPVStateSpace(np.zeros((1, 0, 0)), np.zeros((1, 0, 1)), np.zeros((1, 1, 0)), [[[3.0]]], constant, None)
    again = LPVStateSpace.from_dict(json.loads(json.dumps(gain.to_dict())))
    assert_same(gain, again)
    assert again.order == 0
    assert not again.is_discrete


def test_frozen_poles_are_the_roots_of_the_denominator(rng: np.random.Generator) -> None:
    for _ in range(20):
        a = rng.normal(scale=0.4, size=(4, 3))
        model = LPVTransferFunction.siso(a, [[1, 0, 0]], Polynomial("p", degree=2), 0.01)
        p = rng.uniform(-1, 1)
        roots = np.roots([1.0, *(a @ [1, p, p**2])])
        np.testing.assert_allclose(np.sort_complex(model.frozen_poles([p])), np.sort_complex(roots), atol=1e-9)


def test_frozen_poles_of_several_outputs_annul_the_determinant(rng: np.random.Generator) -> None:
    model = a_transfer_function(rng)
    a, b, c = model.coefficients([1.3, 0.2])
    phi = model.basis.evaluate(np.array([[1.3, 0.2]]))[0]
    np.testing.assert_allclose(b[1], np.einsum("oqm,m->oq", model.b[1], phi), rtol=1e-12)
    np.testing.assert_allclose(c[1], model.c[1] @ phi, rtol=1e-12)  # type: ignore[index]
    poles = model.frozen_poles([1.3, 0.2])
    assert poles.size == 6
    for z in poles:
        matrix = z**3 * np.eye(2) + z**2 * a[0] + z * a[1] + a[2]
        s = np.linalg.svd(matrix, compute_uv=False)
        assert s[-1] < 1e-9 * max(s[0], 1)
    assert block_companion(a).shape == (6, 6)


def test_frozen_matrices_of_a_state_space(rng: np.random.Generator) -> None:
    model = a_state_space(rng)
    phi = model.basis.evaluate(np.array([[0.5, 1.0]]))[0]
    for frozen, array in zip(model.frozen([0.5, 1.0]), (model.A, model.B, model.C, model.D), strict=True):
        np.testing.assert_allclose(frozen, sum(w * x for w, x in zip(phi, array, strict=True)), rtol=1e-12)
    eigen = np.linalg.eigvals(model.frozen([0.5, 1.0])[0])
    np.testing.assert_allclose(np.sort_complex(model.frozen_poles([0.5, 1.0])), np.sort_complex(eigen))


def test_sizes_and_start() -> None:
    basis = Polynomial("p")
    assert LPVTransferFunction.siso(np.zeros((2, 2)), np.zeros((5, 2)), basis, 1.0).start == 4
    assert LPVTransferFunction.siso(np.zeros((4, 2)), np.zeros((2, 2)), basis, 1.0).start == 4
    assert LPVTransferFunction.siso(np.zeros((1, 2)), np.zeros((1, 2)), basis, 1.0, c=np.zeros((6, 2))).start == 5
    assert LPVTransferFunction.siso(np.zeros((1, 2)), np.zeros((1, 2)), Shifted(basis, 3), 1.0).start == 4
    assert LPVTransferFunction.siso([], np.zeros((1, 2)), basis, 1.0).start == 0


def test_models_are_frozen_copies(rng: np.random.Generator) -> None:
    mine = rng.normal(size=(1, 1, 1, 2))
    model = LPVTransferFunction(mine, np.ones((1, 1, 1, 2)), Polynomial("p"), 1.0)
    mine[:] = 7
    assert not np.any(model.a == 7)
    with pytest.raises(ValueError, match="read-only"):
        model.b[0] = 0
    other = model.replace(sample_time=2.0)
    assert (model.sample_time, other.sample_time) == (1.0, 2.0)


ONE = Polynomial("p")
ZERO = np.zeros


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: LPVTransferFunction.siso([[1, 2, 3]], [[0, 0]], ONE, 1.0),
            r"a \(lags by basis functions\) must have shape",
        ),
        (
            lambda: LPVTransferFunction.siso([[1, 2, 3, 4]], [[0, 0]], ONE, 1.0),
            r"a \(lags by basis functions\) must have",
        ),
        (
            lambda: LPVTransferFunction.siso([1, 2], [[0, 0]], ONE, 1.0),
            r"a \(lags by basis functions\) must have shape",
        ),
        (lambda: LPVTransferFunction.siso([[1, 2], [3]], [[0, 0]], ONE, 1.0), "a must hold numbers"),
        (lambda: LPVTransferFunction.siso([[1, np.nan]], [[0, 0]], ONE, 1.0), "a must be finite"),
        (lambda: LPVTransferFunction(ZERO((1, 1, 1, 3)), ZERO((1, 1, 1, 2)), ONE, 1.0), "a must have shape"),
        (lambda: LPVTransferFunction(ZERO((1, 1, 1, 2)), ZERO((1, 1, 2)), ONE, 1.0), "b must have 4 dimension"),
        (lambda: LPVTransferFunction(ZERO((1, 1, 1, 2)), ZERO((1, 1, 1, 3)), ONE, 1.0), "b must have shape"),
        (
            lambda: LPVTransferFunction(ZERO((1, 2, 2, 2)), ZERO((1, 2, 1, 2)), ONE, 1.0, c=ZERO((1, 1, 2))),
            "c must have",
        ),
        (lambda: LPVTransferFunction.siso([[0, 0]], [[0, 0]], ONE, 0.0), "sample_time must be positive"),
        (lambda: LPVTransferFunction.siso([[0, 0]], [[0, 0]], ONE, 1.0, scheduling=BOX), "name different variables"),
        (lambda: LPVTransferFunction.siso([[0, 0]], [[0, 0]], ONE, 1.0, inputs=("a", "b")), "signals do not match"),
        (lambda: LPVTransferFunction.siso([[0, 0]], [[0, 0]], ONE, 1.0, outputs=("a", "b")), "signals do not match"),
        (
            lambda: LPVTransferFunction.siso([[0, 0]], [[0, 0]], ONE, 1.0, input_stage=TanhStage()),
            "signals do not match",
        ),
        (
            lambda: LPVTransferFunction.siso([[0, 0]], [[0, 0]], ONE, 1.0, noise_covariance=ZERO((2, 2))),
            "noise_covariance",
        ),
        (lambda: LPVTransferFunction.siso([[0, 0]], [[0, 0]], ONE, 1.0).frozen_poles([1.0, 2.0]), "scheduling point"),
        (lambda: LPVTransferFunction.siso([[0, 0]], [[0, 0]], ONE, 1.0).frozen_poles([np.nan]), "scheduling point"),
        (
            lambda: LPVStateSpace(ZERO((2, 2, 3)), ZERO((2, 2, 1)), ZERO((2, 1, 2)), ZERO((2, 1, 1)), ONE, 1.0),
            "A must have",
        ),
        (
            lambda: LPVStateSpace(ZERO((2, 2, 2)), ZERO((2, 3, 1)), ZERO((2, 1, 2)), ZERO((2, 1, 1)), ONE, 1.0),
            "B must have",
        ),
        (
            lambda: LPVStateSpace(ZERO((2, 2, 2)), ZERO((2, 2, 1)), ZERO((2, 1, 3)), ZERO((2, 1, 1)), ONE, 1.0),
            "C must have",
        ),
        (
            lambda: LPVStateSpace(ZERO((1, 2, 2)), ZERO((1, 2, 1)), ZERO((1, 1, 2)), ZERO((1, 1, 1)), ONE, 1.0),
            "A must have",
        ),
        (
            lambda: LPVStateSpace(
                ZERO((2, 2, 2)), ZERO((2, 2, 1)), ZERO((2, 1, 2)), ZERO((2, 1, 1)), ONE, 1.0, state_offset=ZERO((2, 3))
            ),
            "state_offset must have",
        ),
        (
            lambda: LPVStateSpace(
                ZERO((2, 2, 2)),
                ZERO((2, 2, 1)),
                ZERO((2, 1, 2)),
                ZERO((2, 1, 1)),
                ONE,
                1.0,
                observer_gain=ZERO((2, 1, 2)),
            ),
            "observer_gain must have",
        ),
        (
            lambda: LPVStateSpace(ZERO((2, 2, 2)), ZERO((2, 2, 1)), ZERO((2, 1, 2)), ZERO((2, 1, 1)), ONE, -1.0),
            "sample_time",
        ),
    ],
)
def test_wrong_shapes_say_which_array(make, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()
