"""Weights of errors by the noise that repeats show: against generalised least squares and against white noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.toy_diagnosis import PERIOD, coloured, drive
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from lpvid._stationary import toeplitz_basis, variance_components
from lpvid.baselines.repeats import repeats
from lpvid.baselines.signals import Signals
from lpvid.diagnosis.evidence.effective_samples import kappa_of
from lpvid.rounding import EXPLODED
from lpvid.validation.whitening import Whitening, whitening_of

SIZE, BLOCKS, ALPHA = 60, 50, 25.0
POLE = 0.95
AR1 = POLE ** np.arange(SIZE)
"""autocovariance of the slow noise, of unit variance"""


def slow() -> Whitening:
    noise, basis = toeplitz_basis(AR1)
    return Whitening(float(noise.mean()), noise, noise, np.zeros(SIZE), np.ones((1, SIZE)), basis, np.ones(SIZE))


def runs(count: int, rng: np.random.Generator, misfit: float = 0.0) -> tuple[list[Signals], list[np.ndarray]]:
    """Records of one input, with errors of which the misfit repeats and slow noise of unit variance does not."""
    u = drive(SIZE * BLOCKS, rng)
    found = [Signals(PERIOD, {"u": u}, u, f"run-{k}") for k in range(count)]
    return found, [misfit * np.sin(5 * u) + coloured(u.size, rng, u) for _ in range(count)]


def noise_of(signals: list[Signals], errors: list[np.ndarray], output: np.ndarray, size: int = SIZE, start: int = 0
             ) -> Whitening | None:
    return whitening_of(repeats(signals, ["u"]), errors, output, size, start)


def test_white_noise_and_a_white_misfit_count_as_without_weights(rng: np.random.Generator) -> None:
    """κ is that of p = 1/5 for noise of variance 4 and a misfit of variance 1; all weights are one."""
    noise, basis = toeplitz_basis(4.0 * np.eye(1, SIZE)[0])
    flat = Whitening(float(noise.mean()), noise, noise, np.zeros(SIZE), np.ones((1, SIZE)), basis, np.ones(SIZE))
    found = flat.beside(np.sqrt(5.0) * rng.standard_normal(SIZE * 4000), ALPHA)
    np.testing.assert_allclose(found.root_weight, 1.0, rtol=1e-9)
    assert found.misfit == pytest.approx(1.0, rel=0.1)
    share = float(found.misfit.mean() / (found.noise + found.misfit).mean())
    for alpha in (ALPHA, 2 * ALPHA):
        assert found.independent_share(SIZE * BLOCKS, alpha) == pytest.approx(kappa_of(share, SIZE * BLOCKS, alpha))


def test_least_squares_of_weighed_values_are_generalised_least_squares(rng: np.random.Generator) -> None:
    """Aitken (1935), by the inverse covariance of a block; without misfit every sample is worth one."""
    found = slow().beside(coloured(SIZE * BLOCKS, rng, np.ones(1)) * 0.9, ALPHA)
    assert np.allclose(found.misfit, 0.0, atol=1e-9) and found.independent_share(SIZE * BLOCKS, ALPHA) > 0.9
    columns, y = rng.standard_normal((SIZE * BLOCKS, 3)), rng.standard_normal(SIZE * BLOCKS)
    ours = np.linalg.lstsq(found.weighed(columns), found.weighed(y), rcond=None)[0]
    inverse = np.kron(np.eye(BLOCKS), np.linalg.inv(toeplitz(AR1)))
    np.testing.assert_allclose(ours, np.linalg.solve(columns.T @ inverse @ columns, columns.T @ inverse @ y), rtol=1e-8)


def test_a_precision_is_that_of_noise_and_of_a_misfit_worth_few_samples(rng: np.random.Generator) -> None:
    """Noise of variances 1 and 4 beside a white misfit of 2: p = 1/(λ + 2 N/α), as ratios of the weights."""
    noise = np.repeat([1.0, 4.0], SIZE // 2)
    known = Whitening(2.5, noise, noise, np.zeros(SIZE), np.ones((1, SIZE)), np.eye(SIZE), np.ones(SIZE))
    error = np.sqrt(noise + 2.0) * rng.standard_normal((4000, SIZE))
    error *= np.sqrt((noise + 2.0) / np.mean(error**2, axis=0))
    found = known.beside(error.ravel(), 80.0 * SIZE)  # N/α = 50
    np.testing.assert_allclose(found.misfit, 2.0, rtol=1e-4)
    assert (found.root_weight[0] / found.root_weight[-1]) ** 2 == pytest.approx((4 + 100) / (1 + 100), rel=1e-4)
    assert found.independent_share(4000 * SIZE, 80.0 * SIZE) == pytest.approx(
        np.mean((noise + 2) / (noise + 100)), rel=1e-4)


def test_no_misfit_is_less_than_the_least_one(rng: np.random.Generator) -> None:
    """Two shapes of mean one: of noise alone the misfit is the least one, half of either; a larger misfit stays."""
    ramp = np.linspace(0.0, 2.0, SIZE)
    known = Whitening(1.0, np.ones(SIZE), np.ones(SIZE), np.zeros(SIZE), np.array([ramp, np.ones(SIZE)]), np.eye(SIZE),
                      np.ones(SIZE), 0.1)
    noise, large = (rng.standard_normal((4000, SIZE)) for _ in range(2))
    noise /= np.sqrt(np.mean(noise**2, axis=0)) * 1.001  # no more than is known
    alone, beside = known.beside(noise.ravel(), ALPHA), known.beside((noise + 2 * large).ravel(), ALPHA)
    np.testing.assert_allclose(alone.misfit, 0.1 * (ramp + 1) / 2, rtol=1e-6)
    assert alone.independent_share(noise.size, ALPHA) == pytest.approx(1.1 / (1 + 0.1 * noise.size / ALPHA), rel=0.3)
    np.testing.assert_allclose(beside.misfit, replace(known, least=0.0).beside((noise + 2 * large).ravel()).misfit)


def test_what_a_simulation_starts_with_is_no_noise(rng: np.random.Generator) -> None:
    """A transient at the head of the first half of a periodic record only."""
    u = np.tile(drive(SIZE * 25, rng), 2)
    signals, error = [Signals(PERIOD, {"u": u}, u, "run")], rng.standard_normal(u.size)
    starting = error + 50 * (np.arange(u.size) < 30)
    plain, left_out, counted = (noise_of(signals, [e], u, start=start)
                                for e, start in ((error, 30), (starting, 30), (starting, 0)))
    assert plain is not None and left_out is not None and counted is not None
    np.testing.assert_allclose(left_out.noise, plain.noise)
    assert counted.variance > 5 * plain.variance


def test_weights_are_taken_back(rng: np.random.Generator) -> None:
    found = slow().beside(rng.standard_normal(SIZE * BLOCKS), ALPHA)
    for values in (rng.standard_normal(SIZE * BLOCKS), rng.standard_normal((SIZE * BLOCKS, 4))):
        np.testing.assert_allclose(found.unweighed(found.weighed(values)), values, atol=1e-9)
        assert not np.allclose(found.weighed(values), values, rtol=0.1)


def test_the_noise_is_what_does_not_repeat(rng: np.random.Generator) -> None:
    """Whatever repeats: a misfit of three times the noise changes nothing. The spectrum is that of an AR(1)."""
    signals, errors = runs(3, rng)
    output = signals[0].output - signals[0].output.mean()
    found = noise_of(signals, errors, output)
    assert found is not None
    repeated = 3.0 * np.sin(5 * signals[0]["u"])
    again = noise_of(signals, [e + repeated for e in errors], output, SIZE)
    assert again is not None
    np.testing.assert_allclose(again.noise, found.noise, rtol=1e-6)
    true = np.linalg.eigvalsh(toeplitz(AR1))
    assert found.noise.mean() == pytest.approx(1.0, rel=0.25)
    np.testing.assert_allclose(np.log(found.within), np.log(true), atol=0.7)


def test_nothing_is_weighed_where_nothing_repeats(rng: np.random.Generator) -> None:
    signals, errors = runs(2, rng)
    output = signals[0].output
    other = Signals(PERIOD, {"u": drive(SIZE * BLOCKS, rng)}, output, "other")
    assert noise_of([signals[0], other], errors, output, SIZE) is None
    assert noise_of(signals, [np.full(output.size, EXPLODED), errors[1]], output, SIZE) is None
    assert noise_of(signals, [errors[0], errors[0]], output, SIZE) is None
    assert noise_of(signals, errors, output, output.size) is None


def test_a_misfit_counts_as_few_samples_where_it_is(rng: np.random.Generator) -> None:
    """Like the output, at low frequencies: above them the noise alone decides, and errors there count."""
    signals, errors = runs(2, rng, misfit=0.0)
    output = 4.0 * (signals[0].output - signals[0].output.mean())
    found = noise_of(signals, errors, output)
    assert found is not None
    noisy = found.beside(errors[0], ALPHA)
    misfitting = found.beside(errors[0] + output, ALPHA)
    assert misfitting.misfit.mean() > 5 * noisy.misfit.mean()
    assert misfitting.independent_share(output.size, ALPHA) < 0.5 * noisy.independent_share(output.size, ALPHA)
    slow, fast = found.noise.argmax(), found.noise.argmin()
    assert misfitting.root_weight[slow] / misfitting.root_weight[fast] < \
        0.7 * noisy.root_weight[slow] / noisy.root_weight[fast]


def test_variances_are_those_that_were_drawn(rng: np.random.Generator) -> None:
    """Two spectra beside known noise, from 400 draws of 100 coordinates; a third one is absent."""
    at = np.linspace(0, 1, 100)
    known, shapes = rng.uniform(0.5, 2.0, 100), np.array([2 * at, np.sin(20 * at) ** 2, 3 * at**8])
    variance = known + np.array([1.0, 0.0, 3.0]) @ shapes
    squares = np.mean(variance * rng.standard_normal((400, 100)) ** 2, axis=0)
    found = variance_components(squares, known, shapes)
    np.testing.assert_allclose(found, [1.0, 0.0, 3.0], atol=0.3)
    assert (found >= 0).all()


def test_noise_slower_than_a_block_is_worth_few_of_them(rng: np.random.Generator) -> None:
    """An AR(1) of 200 samples in blocks of 60: the mean of a block has the variance of its sum over many, by draws."""
    pole, n = 1 - 1 / 200, SIZE * 1600
    u = drive(n, rng)
    signals = [Signals(PERIOD, {"u": u}, u, f"run-{k}") for k in range(2)]

    def slow_noise() -> np.ndarray:
        steps = rng.standard_normal(n + 4000) * np.sqrt(1 - pole**2)
        return np.asarray(lfilter([1.0], [1.0, -pole], steps))[4000:]

    found = noise_of(signals, [slow_noise() for _ in signals], u)
    assert found is not None
    flat = np.ones(SIZE) / np.sqrt(SIZE)
    of_mean = float((found.basis.T @ flat) ** 2 @ found.noise)
    drawn = np.mean([(slow_noise().reshape(-1, SIZE) @ flat).sum() ** 2 / 1600 for _ in range(100)])
    alone = flat @ toeplitz(pole ** np.arange(SIZE)) @ flat
    assert of_mean == pytest.approx(drawn, rel=0.4) and drawn > 5 * alone
    assert found.variance == pytest.approx(1.0, rel=0.3)
