"""What every damper model must do, whatever its kind; a model that lacks something fails."""

from __future__ import annotations

import json
import re
from typing import cast

import numpy as np
import pytest
from helpers.damper_cases import (
    DYNAMIC,
    FREE,
    LAWS,
    NAMES,
    PENALISED,
    STATIC,
    Multisine,
    blank,
    case_of,
    noisy_record,
    record_of,
    recovery_drive,
    truth,
)
from helpers.monte_carlo import coverage
from scipy.integrate import solve_ivp
from scipy.stats import chi2

from lpvid import InputError
from quartercar.dampers import DynamicDamper, ExtrapolationWarning, FitSettings, StaticDamper, model_class
from quartercar.dampers.drive import Drive
from quartercar.dampers.families import LawDamper
from quartercar.dampers.fitting import fit

every = pytest.mark.parametrize("name", NAMES)


@every
def test_registered_under_its_own_name(name: str) -> None:
    kind = model_class(name)
    assert kind.name == name
    assert kind.title and kind.source
    damper = truth(name)
    assert len(set(damper.names)) == len(damper.names) > 0
    assert all(p.description for p in damper.parameters)
    if name in LAWS:
        assert all(p.name.isidentifier() and p.name == p.name.lower() for p in damper.parameters)
    assert set(damper.reads) <= {"displacement", "velocity", "current"}
    assert len(repr(damper).splitlines()) == 1


@every
def test_values_outside_their_bounds_are_refused_in_one_line(name: str) -> None:
    damper = truth(name)
    for p in damper.parameters:
        for bound, sign in ((p.lower, -1.0), (p.upper, 1.0)):
            if np.isfinite(bound):
                with pytest.raises(InputError, match=re.escape(p.name)) as caught:
                    damper.with_values(**{p.name: bound + sign * max(1e-3, 1e-3 * abs(bound))})
                assert len(str(caught.value).splitlines()) == 1
        with pytest.raises(InputError, match=re.escape(p.name)):
            damper.with_values(**{p.name: float("nan")})
    with pytest.raises(InputError, match="no parameter of"):
        damper.with_values(no_such_parameter=1.0)


@every
def test_vector_and_back(name: str) -> None:
    damper = truth(name)
    assert np.array_equal(damper.with_vector(damper.vector).vector, damper.vector)
    assert list(damper.values) == list(damper.names)


@every
def test_saved_and_loaded_it_is_the_same(name: str) -> None:
    damper, drive = truth(name), recovery_drive(name).head(400)
    again = type(damper).from_dict(json.loads(json.dumps(damper.to_dict())))
    assert again.settings == damper.settings
    assert np.array_equal(again.vector, damper.vector)
    assert (again.current_range, again.polarity, again.centre) == (damper.current_range, damper.polarity, damper.centre)
    assert np.array_equal(again.response(drive, again.vector), damper.response(drive, damper.vector))


@every
def test_a_record_without_a_channel_it_reads_is_refused(name: str) -> None:
    damper, record = truth(name), record_of(recovery_drive(name).head(100))
    for role in damper.reads:
        kept = {k: c for k, c in record.channels.items() if k != role}
        with pytest.raises(InputError, match=f"has no {role}"):
            damper.simulate(type(record)(kept, sample_time=record.sample_time))


@every
def test_currents_outside_the_fitted_range_warn(name: str) -> None:
    damper, drive = truth(name), recovery_drive(name)
    low, high = case_of(name).currents
    record = record_of(drive, unit=damper.current_unit)
    narrow = damper.replace(current_range=(low, low + 0.5 * (high - low)))
    if "current" not in damper.reads:
        assert narrow.simulate(record).extrapolation_share == 0.0
        return
    with pytest.warns(ExtrapolationWarning, match="outside the fitted"):
        run = narrow.simulate(record)
    middle = 0.5 * (low + high)
    assert np.mean(drive.current > 1.05 * middle) <= run.extrapolation_share <= np.mean(drive.current > middle)


@every
def test_polarity_turns_the_simulation_and_nothing_else(name: str) -> None:
    damper, record = truth(name), record_of(recovery_drive(name).head(600))
    turned = damper.replace(polarity=-1)
    assert np.array_equal(turned.simulate(record).output, -damper.simulate(record).output)
    v = np.linspace(-0.5, 0.5, 5)
    assert np.array_equal(turned.static_force(v), damper.static_force(v))


@pytest.mark.parametrize("name", [
    pytest.param(n, marks=pytest.mark.seconds if n == "extended-bouc-wen" else ()) for n in NAMES  # 2.8 s
])
def test_typical_parameters_are_passive(name: str) -> None:
    found = (blank(name) if name in LAWS else truth(name)).passivity()
    assert found.passive, found


@every
def test_long_run_is_finite(name: str) -> None:
    damper, drive = truth(name), recovery_drive(name, seed=5)
    assert np.isfinite(damper.response(drive, damper.vector)).all()


COMPILED = ("relief-valve", "relief-valve-orifice", "extended-bouc-wen")
"""laws whose kernels for derivatives take 8 to 12 s to compile"""


@pytest.mark.parametrize("name", [
    pytest.param(n, marks=pytest.mark.seconds if n in COMPILED else ()) for n in LAWS
])
def test_jacobian_against_central_differences(name: str) -> None:
    damper, drive = cast(LawDamper, truth(name)), recovery_drive(name).head(1500)
    theta = damper.vector
    found = damper.jacobian(drive, theta)
    assert found.shape == (drive.n_samples, theta.size)
    force = damper.response(drive, theta)
    for j, p in enumerate(damper.parameters):
        step = 1e-6 * max(abs(theta[j]), abs(p.default), 1e-3)
        up, down = theta.copy(), theta.copy()
        up[j] += step
        down[j] -= step
        differences = (damper.response(drive, up) - damper.response(drive, down)) / (2 * step)
        rounding = 1e-14 * np.linalg.norm(force) / step
        assert np.linalg.norm(found[:, j] - differences) <= 2e-4 * np.linalg.norm(differences) + 100 * rounding, p.name


@pytest.mark.parametrize("name", LAWS)
def test_linear_parameters_enter_affinely(name: str) -> None:
    damper, drive = cast(LawDamper, truth(name)), recovery_drive(name).head(800)
    rng, theta = np.random.default_rng(3), damper.vector
    places = [damper.names.index(n) for n in damper.linear]
    one, two = theta.copy(), theta.copy()
    size = np.maximum(np.abs(theta[places]), 1.0)
    one[places] += 0.3 * size * rng.uniform(-1, 1, len(places))
    two[places] += 0.3 * size * rng.uniform(-1, 1, len(places))
    ends = damper.response(drive, one), damper.response(drive, two)
    middle = damper.response(drive, 0.5 * (one + two))
    assert np.abs(0.5 * (ends[0] + ends[1]) - middle).max() <= 1e-8 * np.abs(middle).max()


@pytest.mark.parametrize("name", STATIC)
def test_force_is_the_law_at_every_sample(name: str) -> None:
    damper, drive = cast(StaticDamper, truth(name)), recovery_drive(name).head(300)
    force = damper.force(drive.displacement, drive.velocity, drive.current)
    assert np.array_equal(force, damper.response(drive, damper.vector))
    backward = Drive(drive.sample_time, drive.velocity[::-1], drive.displacement[::-1], drive.current[::-1])
    assert np.array_equal(damper.response(backward, damper.vector)[::-1], force)


def _smooth(name: str, sample_time: float, duration: float) -> Drive:
    case, times = case_of(name), np.arange(0.0, duration, sample_time)
    x, v = Multisine.of(case, np.random.default_rng(11)).at(times)
    return Drive(sample_time, v, x, np.full(times.size, 0.5 * sum(case.currents)))


@pytest.mark.parametrize("name", DYNAMIC)
def test_response_against_a_tight_integration(name: str) -> None:
    damper, case = cast(DynamicDamper, truth(name)), case_of(name)
    drive = _smooth(name, 1 / 2048, 0.15)
    force = damper.response(drive, damper.vector)
    moved, current = Multisine.of(case, np.random.default_rng(11)), drive.current[0]
    start = damper.rest(drive.displacement[0], drive.velocity[0], current, None, damper.vector)
    scale = np.maximum(np.abs(start), 1e-6)
    for tolerance in (1e-4, 1e-8):
        run = solve_ivp(lambda t, z: damper.rates(z, *moved.at(t), current), (0.0, drive.times[-1]), start, "LSODA",
                        drive.times[::8], rtol=tolerance, atol=1e-2 * tolerance * scale, max_step=0.01)
        assert run.success
        scale = np.maximum(np.abs(run.y).max(axis=1), 1e-9)
    exact = [damper.output(z, *moved.at(t), current) for t, z in zip(run.t, run.y.T, strict=True)]
    assert np.abs(force[::8] - exact).max() <= case.smooth_tolerance * np.ptp(force)


@pytest.mark.parametrize("name", DYNAMIC)
def test_half_the_sample_time_gives_the_same_force(name: str) -> None:
    damper = truth(name)
    coarse, fine = _smooth(name, 1 / 512, 2.0), _smooth(name, 1 / 1024, 2.0)
    difference = damper.response(coarse, damper.vector) - damper.response(fine, damper.vector)[::2]
    assert np.sqrt(np.mean(difference**2)) <= 3e-3 * damper.response(coarse, damper.vector).std()


def _recovered(name: str, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(estimates (R, P), covariances (R, P, P), truth) of fits to the model's own noisy force."""
    true = truth(name)
    settings = FitSettings(**{"starts": 6, "polished": 2, "short_samples": 1500, **case_of(name).fit})
    vectors, covariances = [], []
    for seed in range(count):
        found = fit(blank(name), [noisy_record(name, np.random.default_rng(100 + seed))], settings=settings)
        assert not found.at_bounds, found
        assert not found.undetermined, found
        assert found.covariance is not None and np.isfinite(found.covariance).all()
        vectors.append(found.damper.vector)
        covariances.append(found.covariance)
    return np.array(vectors), np.array(covariances), true.vector


def _assert_recovered(name: str, count: int, band: tuple[float, float]) -> None:
    vectors, covariances, true = _recovered(name, count)
    errors = vectors - true
    std = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    standardised = covariances / (std[:, :, None] * std[:, None, :])
    scaled = errors / std
    statistic = sum(float(e @ np.linalg.solve(c, e)) for e, c in zip(scaled, standardised, strict=True))
    p = float(chi2.sf(statistic, errors.size))
    worst = dict(zip(truth(name).names, np.abs(scaled).max(axis=0).round(1).tolist(), strict=True))
    assert p > 0.001, worst
    assert band[0] <= coverage(vectors, std, true) <= band[1], worst


@pytest.mark.parametrize("name", FREE)
@pytest.mark.slow
def test_parameters_are_recovered_from_noisy_simulations(name: str) -> None:
    _assert_recovered(name, 1, (0.6, 1.0))


@pytest.mark.parametrize("name", PENALISED)
def test_force_of_penalised_models_is_recovered_within_the_noise(name: str) -> None:
    """Their parameters are no test; a fit to the noisy force must be nearer to the true one than the noise is."""
    true, drive = truth(name), recovery_drive(name, 4)
    found = fit(blank(name), [noisy_record(name, np.random.default_rng(100))]).damper
    force = true.response(drive, true.vector)
    assert np.std(found.response(drive, found.vector) - force) < case_of(name).noise * force.std()


@pytest.mark.slow
@pytest.mark.parametrize("name", FREE)
def test_intervals_cover(name: str) -> None:
    _assert_recovered(name, 40, (0.90, 0.98))
