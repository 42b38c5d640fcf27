"""LPV-BJ: k-step prediction by hand, consistent and efficient under coloured output noise."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.monte_carlo import coverage, joint_bias_test
from scipy.signal import lfilter

from lpvid.errors import InputError
from lpvid.identification import identify
from lpvid.identification.box_jenkins import BoxJenkins
from lpvid.identification.output_error import OutputError
from lpvid.model.noise_model import NoiseModel
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.scheduling import Polynomial
from lpvid.simulation import predict, simulate

TRUTH = np.array([-1.0, 0.3, 0.4, -0.2, 0.6, 0.3, 0.3, -0.2])
BASIS = Polynomial("p", degree=1)
SETTINGS = {"na": 2, "nb": 2, "nk": 1, "input": "u", "output": "y", "basis": BASIS}


def system(rng: np.random.Generator, n: int = 2000) -> Record:
    """The plant of `TRUTH` with noise (1 + 0.5 q⁻¹)/(1 − 0.85 q⁻¹) e at its output, by plain loops."""
    u = rng.normal(size=n)
    p = np.clip(lfilter([0.3], [1, -0.9], rng.normal(size=n)), -1, 1)
    p[:2] = -1, 1
    x = np.zeros(n)
    for k in range(2, n):
        x[k] = ((1.0 - 0.3 * p[k]) * x[k - 1] - (0.4 - 0.2 * p[k]) * x[k - 2]
                + (0.6 + 0.3 * p[k]) * u[k - 1] + (0.3 - 0.2 * p[k]) * u[k - 2])
    return Record({"u": u, "p": p, "y": x + lfilter([1, 0.5], [1, -0.85], 0.3 * rng.normal(size=n))}, sample_time=1.0)


def random_record(rng: np.random.Generator, n: int) -> Record:
    return Record({"u1": rng.normal(size=n), "p": rng.uniform(-1, 1, n), "y1": rng.normal(size=n)}, sample_time=1.0)


def study(structure, runs: int) -> tuple[np.ndarray, np.ndarray, list]:
    found = [identify(system(np.random.default_rng(r)), structure) for r in range(runs)]
    return (np.array([f.parameters for f in found]), np.array([f.standard_errors for f in found]),
            [f.model.noise for f in found])


@pytest.mark.slow
def test_consistent_and_sharper_than_output_error_sample():
    estimates, errors, noise = study(BoxJenkins(**SETTINGS, nc=1, nd=1, starts=1), 12)
    plain, _, _ = study(OutputError(**SETTINGS, starts=1), 12)
    assert joint_bias_test(estimates, TRUTH) > 0.001
    assert coverage(estimates, errors, TRUTH) > 0.85
    assert np.mean((estimates - TRUTH) ** 2) < 0.7 * np.mean((plain - TRUTH) ** 2)
    np.testing.assert_allclose(np.mean([n.vector for n in noise], axis=0), [0.5, -0.85], atol=0.03)


@pytest.mark.slow
def test_consistent_and_its_intervals_cover():
    estimates, errors, noise = study(BoxJenkins(**SETTINGS, nc=1, nd=1, starts=1), 100)
    coefficients = np.array([n.vector for n in noise])
    print(f"BJ: p = {joint_bias_test(estimates, TRUTH):.3f}, coverage {coverage(estimates, errors, TRUTH):.3f}; "
          f"noise model: p = {joint_bias_test(coefficients, np.array([0.5, -0.85])):.3f}")
    assert joint_bias_test(estimates, TRUTH) > 0.001
    assert 0.90 <= coverage(estimates, errors, TRUTH) <= 0.98


def by_hand(model: LPVTransferFunction, record: Record, horizon: int) -> np.ndarray:
    """Ljung 1999 (3.31) sample by sample: the noise runs on its own past, future innovations are zero."""
    x, y = simulate(model, record).output[:, 0], record["y1"]
    c, d = model.noise.c[:, 0, 0], model.noise.d[:, 0]
    n, start = len(y), model.start
    v, e, out = y - x, np.zeros(len(y)), y.copy()
    for k in range(start, n):
        e[k] = v[k] + sum(d[i] * v[k - i - 1] for i in range(len(d)) if k - i - 1 >= start)
        e[k] -= sum(c[i] * e[k - i - 1] for i in range(len(c)) if k - i - 1 >= start)
    for k in range(start, n):
        base = max(k - horizon + 1, start)
        path = dict(enumerate(v[:base]))
        for t in range(base, k + 1):
            path[t] = -sum(d[i] * path[t - i - 1] for i in range(len(d)) if t - i - 1 >= start)
            path[t] += sum(c[i] * e[t - i - 1] for i in range(len(c)) if start <= t - i - 1 < base)
        out[k] = x[k] + path[k]
    return out


@pytest.mark.parametrize("horizon", [1, 2, 5, 1000])
def test_prediction_by_hand(horizon, rng):
    noise = NoiseModel("box-jenkins", [[[0.4]], [[0.1]]], [[-0.9], [0.3], [0.1]])
    model = LPVTransferFunction.siso([[-0.8, 0.1], [0.2, 0.0]], [[0, 0], [1.0, 0.5]], BASIS, 1.0, noise=noise)
    record = random_record(rng, 60)
    ahead = predict(model, record, horizon).output[:, 0]
    np.testing.assert_allclose(ahead, by_hand(model, record, horizon), atol=1e-12)


def test_the_innovations_of_the_truth_are_what_drove_it(rng):
    n, e = 300, rng.normal(size=300)
    noise = NoiseModel("box-jenkins", [[[0.5]]], [[-0.85]])
    model = LPVTransferFunction.siso([[-0.8, 0.1]], [[0, 0], [1.0, 0.5]], BASIS, 1.0, noise=noise)
    driven = Record({"u1": rng.normal(size=n), "p": rng.uniform(-1, 1, n)}, sample_time=1.0)
    e[: model.start] = 0.0
    y = simulate(model, driven, "zero").output[:, 0] + lfilter([1, 0.5], [1, -0.85], e)
    record = Record({"u1": driven["u1"], "p": driven["p"], "y1": y}, sample_time=1.0)
    np.testing.assert_allclose((y - predict(model, record).output[:, 0])[model.start:], e[model.start:], atol=1e-10)


@pytest.mark.seconds
def test_without_noise_orders_it_is_output_error(rng):
    record = system(rng, 600)
    one = identify(record, BoxJenkins(**SETTINGS, nc=0, nd=0))
    two = identify(record, OutputError(**SETTINGS))
    np.testing.assert_allclose(one.parameters, two.parameters, atol=1e-4)


def test_noise_models_refuse_what_does_not_fit():
    for bad in ({"kind": "pink"}, {"kind": "output", "c": [[[0.1]]]}, {"kind": "armax", "d": [[0.1]]},
                {"kind": "box-jenkins", "c": [[[0.1, 0.2]]]}, {"kind": "armax", "c": [[[np.nan]]]}):
        with pytest.raises(InputError):
            NoiseModel(**bad)
    with pytest.raises(InputError, match="functions"):
        LPVTransferFunction.siso([[-0.8, 0.1]], [[0, 0]], BASIS, 1.0, noise=NoiseModel("armax", [[[0.1, 0.2, 0.3]]]))


def test_a_noise_vector_goes_round(rng):
    noise = NoiseModel("box-jenkins", rng.normal(size=(2, 3, 1)), rng.normal(size=(4, 3)))
    assert noise.with_vector(noise.vector) == noise
    assert NoiseModel.from_dict(noise.to_dict()) == noise
    assert hash(NoiseModel.from_dict(noise.to_dict())) == hash(noise)
    names = noise.names(("1", "p"), ("x", "y", "z"))
    assert len(names) == noise.vector.size
    assert names[0] == "x:noise c1[1]"
    assert names[-1] == "z:noise d4"
    assert NoiseModel.from_dict(None).kind == "equation"
