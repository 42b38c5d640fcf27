"""The evidence against oracles: a dense normal density, quadrature, known noise and memories."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.toy_diagnosis import Dry, problem_of, record
from scipy.integrate import quad
from scipy.signal import butter, lfilter
from scipy.stats import multivariate_normal

from lpvid.baselines.signals import Signals
from lpvid.diagnosis.evidence.discrepancy import MISFIT_SIZES, TYPICAL_MISFIT, Discrepancy, marginal
from lpvid.diagnosis.evidence.effective_samples import STRUCTURED_SAMPLES, effective_samples, sensor_noise_share
from lpvid.diagnosis.evidence.laplace import EvaluatedSet, EvidenceData
from lpvid.diagnosis.evidence.priors import (
    STRENGTH_SCALE,
    determined_count,
    deviation_penalty,
    inclusion_prior,
    shape_prior,
    strength_prior,
)
from lpvid.diagnosis.refitting import refit
from lpvid.effects.composition import Composition
from lpvid.effects.effect import EffectParameter
from lpvid.effects.scaling import Scales
from quartercar.effects.compliance import Backlash, EntrainedAir, SeriesCompliance
from quartercar.effects.electrical import CoilLag
from quartercar.effects.measurement import ForceClipping


def test_the_marginal_is_that_of_a_dense_normal_density():
    rng = np.random.default_rng(0)
    columns = np.linalg.qr(rng.standard_normal((60, 5)))[0] * np.array([6.0, 4.0, 3.0, 2.0, 1.0])
    d = Discrepancy(columns, (columns**2).sum(axis=0), output_rms=10.0)
    error = rng.standard_normal(60) + columns @ rng.standard_normal(5) * 0.3
    found = marginal(float(error @ error), columns.T @ error, d, 60, 1.0)

    def dense(noise: float, size: float) -> float:
        covariance = noise * np.eye(60) + (size * 10.0) ** 2 * columns @ columns.T
        return float(multivariate_normal(np.zeros(60), covariance).logpdf(error)) - (size / TYPICAL_MISFIT) ** 2 / 2

    assert np.isclose(found.likelihood, dense(found.noise, found.size), atol=1e-9)
    around = [dense(found.noise * f, s) for f in (0.9, 1.0, 1.1) for s in MISFIT_SIZES]
    assert found.likelihood >= max(around) - 1e-3
    inverse = (np.eye(60) - columns @ (found.woodbury_weights[:, None] * columns.T)) / found.noise
    covariance = found.noise * np.eye(60) + (found.size * 10.0) ** 2 * columns @ columns.T
    assert np.allclose(inverse, np.linalg.inv(covariance))


def test_the_evidence_of_one_linear_cause_is_its_integral():
    problem, composition = problem_of(record(np.random.default_rng(3), hidden=lambda u: 0.6 * np.sign(u)))
    columns = np.zeros((problem.n_samples, 1))
    force = float(np.sqrt(np.mean(problem.stack([s.output - s.output.mean() for s in problem.signals]) ** 2)))
    data = EvidenceData(problem, Discrepancy(columns, np.zeros(1), force), {"dry": np.array([[0.1]])})
    root = EvaluatedSet(data, refit(problem, composition, composition.neutral))
    larger = Composition(composition.baseline, (Dry(),))
    with_it = EvaluatedSet(data, refit(problem, larger, np.append(root.fit.vector, 0.5)))
    won = with_it.evidence(1.0) - root.evidence(1.0) - inclusion_prior(Dry())
    noise, basis = with_it.marginal(1.0).noise, with_it.fit.jacobian
    own = np.linalg.qr(basis[:, :3])[0]
    left = basis[:, 3] - own @ (own.T @ basis[:, 3])
    size, best = float(left @ left) / noise, float(with_it.fit.vector[3])
    slope = float(np.sqrt(np.mean(basis[:, 3] ** 2))) / force

    def density(a: float) -> float:
        return float(np.exp(strength_prior(abs(a) * slope, slope)[0] - size * (a - best) ** 2 / 2))

    integral = np.log(quad(density, best - 8 / np.sqrt(size), best + 8 / np.sqrt(size))[0])
    likelihood = with_it.marginal(1.0).likelihood - root.marginal(1.0).likelihood
    assert np.isclose(won, likelihood + integral, atol=0.02)


def test_a_set_whose_sensitivities_explode_has_no_evidence():
    """Its determinant is lost, and with an infinite evidence no other set would have a weight."""
    problem, composition = problem_of(record(np.random.default_rng(0), hidden=lambda u: 0.5 * np.sign(u)))
    composition = Composition(composition.baseline, (Dry(),))
    fit = refit(problem, composition, composition.neutral)
    data = EvidenceData(problem, Discrepancy.of(problem, composition.baseline), {"dry": np.array([[0.1], [1.0]])})
    assert np.isfinite(EvaluatedSet(data, fit).evidence(0.5))
    exploded = replace(fit, cache={"jacobian": np.tile(1e70 * fit.jacobian[:, -1:], fit.vector.size)})
    assert EvaluatedSet(data, exploded).evidence(0.5) == -np.inf


def test_the_prior_of_a_strength_is_a_density_whatever_its_unit():
    for slope in (1e-4, 1.0, 1e6):
        whole = quad(lambda a, k=slope: np.exp(strength_prior(a * k, k)[0]), 0, 1e3 * STRENGTH_SCALE / slope, limit=500,
                     points=[STRENGTH_SCALE / slope, 10 * STRENGTH_SCALE / slope])[0]
        assert np.isclose(whole, 1.0, atol=1e-3)


@pytest.mark.parametrize("wave, wanted", [(0.0, 0.0), (0.5, 0.125 / 1.125), (2.0, 2.0 / 3.0)])
def test_white_noise_is_the_floor_and_the_rest_is_structure(wave, wanted):
    slow = lfilter(*butter(2, 0.02), np.random.default_rng(3).standard_normal(12000))
    noise = np.random.default_rng(1).standard_normal(12000) + wave * slow / slow.std() / np.sqrt(2)
    problem, _ = problem_of(record(np.random.default_rng(2), n=12000))
    found = effective_samples(problem, [noise])
    assert np.isclose(found.structured, wanted, atol=0.07)
    assert np.isclose(found.floor, 1.0, rtol=0.1)


def test_the_floor_is_not_free_to_take_up_slow_noise():
    noise = lfilter([1.0], [1.0, -0.9], np.random.default_rng(1).standard_normal(12000))
    problem, _ = problem_of(record(np.random.default_rng(2), n=12000))
    floor = 1 / 1.9**2  # the spectrum of the filter at half the rate
    assert floor < effective_samples(problem, [noise]).floor < 1.5 * floor


@pytest.mark.parametrize("share", [0.0, 0.05, 0.1])
def test_bursts_as_wide_as_the_band_are_no_noise(share):
    """A law's misfit at reversals: short, and at half the rate as strong as anywhere. Up to three fifths of
    the squared error are in the bursts; the floor is that of the noise between them, up to what a median shifts."""
    rng = np.random.default_rng(5)
    problem, _ = problem_of(record(np.random.default_rng(2), n=12000))
    bursts = np.repeat(rng.random(1500) < share, 8) * 4 * rng.standard_normal(12000)
    found = effective_samples(problem, [rng.standard_normal(12000) + bursts])
    assert 0.9 < found.floor < 1.1 + 3 * share
    assert np.isclose(found.structured, 16 * share / (1 + 16 * share), atol=0.15)


@pytest.mark.parametrize(("louder", "wave", "white"), [
    (1.0, 0.0, 0.0), (3.0, 0.0, 0.0), (1.0, 1.0, 0.0), (3.0, 1.0, 1.0)])
def test_as_much_sensor_noise_is_found_in_an_error_as_it_holds(louder, wave, white):
    """Noise of a derived velocity: white noise differenced. Its shape is given, its level is found."""
    rng = np.random.default_rng(3)
    noise, again = (np.diff(rng.standard_normal(12001)) for _ in range(2))
    problem, _ = problem_of(record(np.random.default_rng(2), n=12000))
    error = problem.stack([noise + wave * np.sin(0.05 * np.arange(12000)) + white * rng.standard_normal(12000)])
    found = sensor_noise_share(problem, [error], [louder * problem.stack([again])])
    assert np.isclose(found * louder**2, 1.0, rtol=0.15)


@pytest.mark.parametrize("sensors", [0.0, 1.0])
def test_white_noise_of_the_output_is_none_of_the_sensors(sensors):
    """By itself a model that passes the sensors' noise on as white does not separate the two; beside one that does not
    it does, whose error lacks it."""
    rng = np.random.default_rng(4)
    problem, _ = problem_of(record(np.random.default_rng(2), n=12000))
    at_output, passed, again = (rng.standard_normal(12000) for _ in range(3))
    smooth = [lfilter([0.1], [1.0, -0.9], x) for x in (passed, again)]
    errors = [problem.stack([at_output + sensors * x]) for x in (passed, smooth[0])]
    assert np.isclose(sensor_noise_share(problem, errors, [problem.stack([x]) for x in (again, smooth[1])]), sensors,
                      atol=0.1)


def test_noise_that_the_error_does_not_hold_is_no_part_of_it():
    problem, _ = problem_of(record(np.random.default_rng(2), n=12000))
    error = problem.stack([np.sin(0.05 * np.arange(12000))])
    carried = problem.stack([np.random.default_rng(3).standard_normal(12000)])
    assert sensor_noise_share(problem, [error], [carried]) < 0.01 * float(np.mean(error**2))


def test_an_error_that_is_all_structure_counts_as_few_samples():
    problem, _ = problem_of(record(np.random.default_rng(2)))
    found = effective_samples(problem, [np.tanh(3 * s["u"]) ** 2 for s in problem.signals])
    assert found.structured > 0.9
    assert found.kappa * problem.n_samples < 1.2 * STRUCTURED_SAMPLES


def test_a_shape_that_the_data_do_not_determine_costs_nothing():
    a, h, scale = np.array([3.0]), np.array([2.0]), np.array([0.5])
    product = quad(lambda t: np.exp(-0.5 * h[0] * t**2 - 0.5 * scale[0] * (t + a[0] / np.sqrt(scale[0])) ** 2), -50, 50)
    expected = np.log(product[0]) - 0.5 * np.log(2 * np.pi / (h[0] + scale[0]))
    assert np.isclose(deviation_penalty(a, scale, h), expected, rtol=1e-9)
    assert deviation_penalty(a, scale, np.zeros(1)) == 0.0


def test_scales_follow_the_size_of_the_rig():
    t = np.arange(2000) / 500
    x, v = 0.02 * np.sin(6 * t), 0.12 * np.cos(6 * t)

    def scales(length: float, force: float) -> Scales:
        return Scales.of([Signals(0.002, {"displacement": length * x, "velocity": length * v}, force * 1e3 * v)])

    small, large = scales(1.0, 1.0), scales(3.0, 100.0)
    for unit, factor in (("N", 100.0), ("m/N", 0.03), ("N*s/m", 100 / 3), ("kg", 100 / 3), ("s", 1.0), ("m/s", 3.0)):
        assert np.isclose(large.size(unit) / small.size(unit), factor)


def test_a_displacement_that_was_not_measured_is_the_integral_of_the_velocity():
    t = np.arange(3000) / 500
    both = {"displacement": 0.02 * np.sin(6 * t), "velocity": 0.12 * np.cos(6 * t)}
    measured = Scales.of([Signals(0.002, both, both["velocity"])])
    derived = Scales.of([Signals(0.002, {"velocity": both["velocity"]}, both["velocity"])])
    assert np.isclose(derived.displacement, measured.displacement, rtol=0.1)


def test_a_shape_costs_as_much_of_a_parameter_as_the_data_determine():
    """Oracle: h/(h + Λ) by hand; a choice has no precision and counts as one."""
    curvature, precision = np.array([0.0, 1.0, 3.0, 1e12, 0.0]), np.array([1.0, 1.0, 1.0, 1.0, 0.0])
    assert determined_count(curvature, precision) == pytest.approx(3.25)


def test_what_the_samples_show_is_as_probable_as_another_cause_is_improbable():
    """A force clipped by its amplifier rests at its largest value, and is a candidate only where it does."""
    assert inclusion_prior(ForceClipping()) == pytest.approx(-inclusion_prior(CoilLag())) and \
        inclusion_prior(CoilLag()) < 0


def test_a_shape_has_one_prior_whether_its_grid_holds_zero_or_not():
    """A friction's deflection of many strokes is as probable in the entry that may have none as in one that must."""
    deflection = EffectParameter("deflection", "m", "d", 0.0, (0.0, 3e-4), (0.0, 0.5), (0.0, 1e-5, 1e-4))
    some, or_none = (1e-5, 1e-4), (0.0, 1e-5, 1e-4)
    for value in (1e-4, 1e-3, 1e-2):
        assert shape_prior(deflection, value, or_none) == shape_prior(deflection, value, some)
        assert shape_prior(deflection, value, some)[0] > 0
    assert [shape_prior(deflection, v, or_none)[0] for v in (0.0, 1e-8, 1e-5)] == [0.0, 0.0, 0.0]
    assert shape_prior(deflection, 1e-8, some)[0] < -1
    share = EffectParameter("share", "", "s", 0.0, (0.0, 1.0), (0.0, 1.0), (0.0, 0.5))
    assert shape_prior(share, 1.0, (0.0, 0.5)) == (2.0, 4.0)  # no decades: normal about none of it


def test_a_spring_in_series_is_as_probable_as_not():
    """Every measured damper has one; neither play nor air, which are rarer, has the same prior."""
    assert inclusion_prior(SeriesCompliance()) == pytest.approx(0.0)
    assert inclusion_prior(Backlash()) == inclusion_prior(EntrainedAir()) == inclusion_prior(CoilLag())
