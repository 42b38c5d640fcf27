"""Ridge on the scheduling dependence: limits, an independent marginal likelihood, and what it gains."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.errors import InputError
from lpvid.identification import identify
from lpvid.identification.arx import ARX
from lpvid.identification.ridge import Ridge, _RidgeProblem
from lpvid.record import Record
from lpvid.scheduling import Polynomial, Product, Scheduling, Spline

SHAPE = {"na": 2, "nb": 2, "input": "u", "output": "y"}


def system(rng: np.random.Generator, n: int, noise: float) -> Record:
    """y(k) = 1.1 y(k−1) − 0.4 y(k−2) + (1 + 0.5 p) u(k−1) + noise."""
    u, p, e = rng.normal(size=n), rng.uniform(-1, 1, n), noise * rng.normal(size=n)
    y = np.zeros(n)
    for k in range(2, n):
        y[k] = 1.1 * y[k - 1] - 0.4 * y[k - 2] + (1 + 0.5 * p[k]) * u[k - 1] + e[k]
    return Record({"u": u, "p": p, "y": y}, sample_time=0.01)


def test_a_weak_ridge_is_least_squares_and_a_strong_one_removes_the_dependence(rng):
    record = system(rng, 500, 0.1)
    rich = Polynomial("p", degree=2)
    plain = identify(record, ARX(**SHAPE, basis=rich))
    weak = identify(record, ARX(**SHAPE, basis=rich, ridge=Ridge(strength=1e-12)))
    strong = identify(record, ARX(**SHAPE, basis=rich, ridge=Ridge(strength=1e9)))
    constant = identify(record, ARX(**SHAPE, basis=Polynomial()))
    np.testing.assert_allclose(weak.parameters, plain.parameters, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(strong.parameters.reshape(4, 3)[:, 0], constant.parameters, rtol=1e-6)
    assert np.abs(strong.parameters.reshape(4, 3)[:, 1:]).max() < 1e-6


def test_criterion_is_the_restricted_likelihood_of_the_dense_gaussian_model(rng):
    """Oracle: −2 ln of the density of contrasts of y, with the n×n covariance written out."""
    n = 40
    record = system(rng, n, 0.3)
    arx = ARX(na=1, nb=1, input="u", output="y", basis=Polynomial("p", degree=2))
    bound = arx.__class__(na=1, nb=1, input="u", output="y",
                          basis=arx.basis.bound(Scheduling.of(("p",), record.matrix(["p"]))))
    box = Scheduling.of(("p",), record.matrix(["p"]))
    factor = bound.factor([record], box)
    problem = _RidgeProblem.of(factor, bound.places(), Ridge().matrix(bound.basis))
    phi = bound.basis.evaluate(record.matrix(["p"]))[1:]
    y, u = record["y"], record["u"]
    x = np.hstack([-y[:-1, None] * phi, u[:-1, None] * phi])
    norms = np.linalg.norm(x, axis=0)
    scale = np.repeat([np.sqrt(np.mean(norms[:3] ** 2)), np.sqrt(np.mean(norms[3:] ** 2))], 3)
    free = np.array([0, 3])
    varying = np.array([1, 2, 4, 5])
    contrasts = np.linalg.svd(x[:, free])[0][:, 2:].T

    def oracle(strength: float) -> float:
        z = contrasts @ x[:, varying] / scale[varying]
        prior = np.diag(1 / (strength * np.array([1.0, 4.0, 1.0, 4.0])))
        covariance = np.eye(len(contrasts)) + z @ prior @ z.T
        r = contrasts @ y[1:]
        m = len(r)
        return float(m * np.log(r @ np.linalg.solve(covariance, r)) + np.linalg.slogdet(covariance)[1])

    strengths = [1e-4, 1e-2, 1.0, 10.0]
    ours = np.array([problem.criterion(s) for s in strengths])
    theirs = np.array([oracle(s) for s in strengths])
    np.testing.assert_allclose(np.diff(ours), np.diff(theirs), rtol=1e-9)


@pytest.mark.thinned(2)
@pytest.mark.parametrize("penalty, basis", [("curvature", Spline("p", segments=8)),
                                            ("variation", Polynomial("p", degree=7))])
def test_beats_least_squares_on_short_noisy_records_with_a_rich_basis(penalty, basis):
    errors = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        short, long = system(rng, 120, 0.5), system(rng, 2000, 0.5)
        tested = []
        for ridge in (0.0, Ridge(penalty)):
            found = identify(short, ARX(**SHAPE, basis=basis, ridge=ridge), held_out=[long])
            tested.append(found.held_out.overall.one_step.esr)
        errors.append(tested)
    plain, ridged = np.array(errors).T
    assert ridged.mean() < 0.8 * plain.mean()
    assert np.sum(ridged < plain) >= 9


def test_penalties_of_other_bases():
    assert Ridge("size").matrix(Spline("p")).tolist() == np.eye(6).tolist()
    linear = np.arange(6.0)
    assert np.abs(Ridge("curvature").matrix(Spline("p")) @ linear).max() < 1e-12
    product = Ridge().matrix(Product(Polynomial("p", degree=1), Polynomial("q", degree=1)))
    assert product.diagonal().tolist() == [0, 1, 1, 2]
    with pytest.raises(InputError, match="one weight for each of 2"):
        Ridge((0.0, 1.0, 2.0)).matrix(Polynomial("p", degree=1))
    with pytest.raises(InputError, match="penalty must be one of"):
        Ridge("roughness")
