"""The choice between hydraulic networks: right where the data can tell, silent where they cannot."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from scipy.optimize import least_squares

from lpvid.errors import InputError
from lpvid.record import Channel, Record
from quartercar.dampers.bench.log_fit import NETWORKS, Points, fit_log_force, held_out_error, upper_bound
from quartercar.dampers.bench.slopes import log_slopes
from quartercar.dampers.bench.static_characteristic import StaticCharacteristic
from quartercar.dampers.bench.topology import choose_network, friction_profile
from quartercar.dampers.facts import Facts
from quartercar.dampers.fitting import fit
from quartercar.dampers.laws.hydraulics import Laminar, Parallel, Series, Turbulent, parallel_pressure
from quartercar.dampers.laws.network import MixedNetwork, ParallelNetwork, SeriesNetwork

SPEEDS = np.geomspace(2e-5, 2e-3, 23)
TRUTHS = {"series": (Series(Laminar(5e4), Turbulent(2e8)), 10.0),
          "parallel": (Parallel(Laminar(1 / 1.2e-5), Turbulent(2e9)), 3.0),
          "mixed": (Parallel(Series(Laminar(2e5), Turbulent(2e10)), Laminar(1e6)), 5.0)}
RANGES = {"series": SPEEDS, "parallel": SPEEDS, "mixed": np.geomspace(2e-6, 6e-3, 23)}


def characteristic(name: str, noise: float, rng: np.random.Generator,
                   speed: np.ndarray | None = None) -> StaticCharacteristic:
    """Points of a network solved by composition, not by the damper's closed forms."""
    path, friction = TRUTHS[name]
    v = RANGES[name] if speed is None else speed
    force = (path.pressure(v) + friction) * np.exp(noise * rng.standard_normal(v.size))
    return StaticCharacteristic(v, force, noise * force)


# -- fits in log-force -----------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", list(TRUTHS))
def test_exact_points_give_the_exact_network(name: str, rng: np.random.Generator) -> None:
    fit = fit_log_force(Points.of(characteristic(name, 0.0, rng)), name)
    truth = {"series": (5e4, 2e8, 0, 10.0), "parallel": (0, 2e9, 1.2e-5, 3.0), "mixed": (2e5, 2e10, 1e-6, 5.0)}[name]
    assert np.allclose(fit.theta, truth, rtol=1e-5)
    assert fit.rss < 1e-12


def test_the_fit_is_that_of_a_general_solver(rng: np.random.Generator) -> None:
    c = characteristic("series", 0.02, rng)
    fit = fit_log_force(Points.of(c), "series")

    def residual(logs: np.ndarray) -> np.ndarray:
        low, high, friction = np.exp(logs)
        return np.log((friction + low * c.speed + high * c.speed**2) / c.force)

    other = least_squares(residual, np.log([1e5, 1e8, 5.0]), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert fit.theta[[0, 1, 3]] == pytest.approx(np.exp(other.x), rel=1e-5)
    per_log = np.linalg.inv(other.jac.T @ other.jac) * 2 * other.cost / (23 - 3)
    std = np.sqrt(np.diag(per_log)) * np.exp(other.x)
    assert list(fit.std.values()) == pytest.approx(std, rel=1e-4)


@pytest.mark.slow
def test_standard_errors_and_friction_intervals_cover_the_truth() -> None:
    inside, scaled = 0, []
    for seed in range(60):
        points = Points.of(characteristic("series", 0.02, np.random.default_rng(seed)))
        fit = fit_log_force(points, "series")
        scaled.append((fit.theta - (5e4, 2e8, 0, 10.0))[[0, 1, 3]] / list(fit.std.values()))
        low, high = friction_profile(points, fit).interval
        inside += low <= 10.0 <= high
    assert 0.88 <= np.mean(np.abs(scaled) < 2.086) <= 1.0  # t with 20 degrees of freedom
    assert inside >= 52


def test_subtracting_the_least_force_biases_the_laminar_loss(rng: np.random.Generator) -> None:
    """E3.7: F − min F forces one point to zero force; friction found with the rest does not."""
    c = characteristic("series", 0.002, rng)
    joint = fit_log_force(Points.of(c), "series")
    shifted = c.force - c.force.min()
    design = np.column_stack([c.speed, c.speed**2])
    printed = np.linalg.lstsq(design[2:], shifted[2:], rcond=None)[0]  # (7), two slowest points left out
    assert abs(joint.theta[0] / 5e4 - 1) < 0.02
    assert abs(joint.theta[0] - 5e4) < 0.25 * abs(printed[0] - 5e4)


def test_likelihoods_are_those_of_the_formulas(rng: np.random.Generator) -> None:
    fit = fit_log_force(Points.of(characteristic("series", 0.02, rng)), "series")
    assert fit.log_likelihood == pytest.approx(-11.5 * np.log(fit.rss / 23))
    assert fit.aicc == pytest.approx(23 * np.log(fit.rss / 23) + 8 + 40 / 18)
    assert fit.bic == pytest.approx(23 * np.log(fit.rss / 23) + 4 * np.log(23))


@pytest.mark.seconds
def test_a_network_never_fits_worse_than_what_it_contains() -> None:
    for seed in range(3):
        for name in TRUTHS:
            fits = choose_network(characteristic(name, 0.03, np.random.default_rng(seed))).fits
            for small, some in NETWORKS.items():
                for large, all_ in NETWORKS.items():
                    if set(some) < set(all_):
                        assert fits[large].rss <= fits[small].rss * (1 + 1e-6)


def test_units_do_not_matter(rng: np.random.Generator) -> None:
    c = characteristic("mixed", 0.01, rng)
    scaled = StaticCharacteristic(7.0 * c.velocity, 0.3 * c.force, 0.3 * c.std)
    for name in NETWORKS:
        a, b = fit_log_force(Points.of(c), name), fit_log_force(Points.of(scaled), name)
        assert a.rss == pytest.approx(b.rss, rel=1e-6)


def test_held_out_error_is_that_of_fits_without_those_points(rng: np.random.Generator) -> None:
    points = Points.of(characteristic("series", 0.02, rng))
    fit = fit_log_force(points, "series")
    total = 0.0
    for k in range(6):
        out = np.arange(23) % 6 == k
        apart = fit_log_force(points.select(~out), "series")
        total += float(np.sum(np.log(apart.force(points.speed[out]) / points.force[out]) ** 2))
    assert held_out_error(points, [fit], 6)[0] == pytest.approx(np.sqrt(total / 23), rel=1e-4)


# -- slopes ----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("name", "trend"), [("series", "rising"), ("parallel", "falling")])
def test_slopes_have_the_signature(name: str, trend: str, rng: np.random.Generator) -> None:
    d = log_slopes(Points.of(characteristic(name, 0.003, rng)), TRUTHS[name][1])
    assert d.trend == trend and d.network == name


def test_slopes_of_a_mixed_network_rise_and_fall(rng: np.random.Generator) -> None:
    speed = np.geomspace(1e-7, 1.0, 29)  # turbulent from 0.01 mm/s on, leaking from 5 mm/s on
    force = MixedNetwork(values={"laminar_damping": 2e5, "quadratic_damping": 2e10, "leak_mobility": 1e-8,
                                 "friction": 0.0}).force(0.0, speed) * np.exp(0.01 * rng.standard_normal(29))
    d = log_slopes(Points.of(StaticCharacteristic(speed, force, 0.01 * force)), 0.0)
    assert d.trend == "rising, then falling" and d.network == "mixed"
    assert d.slope.max() > 1.8 and max(d.slope[0], d.slope[-1]) < 1.2


def test_local_slopes_match_the_derivative(rng: np.random.Generator) -> None:
    d = log_slopes(Points.of(characteristic("series", 0.01, rng)), 10.0)
    exact = 1 + 2e8 * d.speed / (5e4 + 2e8 * d.speed)  # of c_L v + c_Q v²
    assert np.abs(d.slope - exact).max() < 0.5
    assert 0.4 < np.sqrt(np.mean(((d.slope - exact) / d.std) ** 2)) < 1.6


def test_uncertain_friction_widens_the_slopes(rng: np.random.Generator) -> None:
    points = Points.of(characteristic("series", 0.01, rng))
    sure, unsure = log_slopes(points, 10.0), log_slopes(points, 10.0, 0.5)
    assert unsure.std[0] > 2 * sure.std[-unsure.std.size]
    assert unsure.points_left_out > 0
    with pytest.raises(InputError, match="exceed the friction"):
        log_slopes(points, float(points.force.max()))


# -- the choice ------------------------------------------------------------------------------------------------------
@pytest.mark.slow
@pytest.mark.parametrize(("name", "noise"), [("series", 0.01), ("series", 0.04), ("parallel", 0.01), ("parallel", 0.03),
                                             ("mixed", 0.01), ("mixed", 0.02)])
def test_the_right_network_is_chosen_over_twenty_draws(name: str, noise: float) -> None:
    verdicts = Counter(choose_network(characteristic(name, noise, np.random.default_rng(s))).verdict for s in range(20))
    assert verdicts[name] >= 18, verdicts


@pytest.mark.thinned(3, "slow", "seconds")
@pytest.mark.parametrize(("name", "low", "high", "missing"), [
    ("series", 1e-3, 2.5e-3, "below"), ("series", 2e-5, 6e-5, "above"), ("parallel", 1e-5, 3e-5, "above|below")])
def test_a_short_range_cannot_tell_and_names_the_missing_speeds(name: str, low: float, high: float,
                                                               missing: str) -> None:
    speed = np.geomspace(low, high, 12)
    choices = [choose_network(characteristic(name, 0.01, np.random.default_rng(s), speed)) for s in range(12)]
    verdicts = Counter(c.verdict for c in choices)
    assert verdicts["cannot tell"] >= 10, verdicts
    undecided = [c.reason for c in choices if c.verdict == "cannot tell"]
    assert all("mm/s" in r and any(word in r for word in missing.split("|")) for r in undecided)


@pytest.mark.seconds
def test_the_missing_speeds_do_tell(rng: np.random.Generator) -> None:
    short = choose_network(characteristic("series", 0.01, rng, np.geomspace(2e-5, 6e-5, 12)))
    assert short.verdict == "cannot tell"
    assert choose_network(characteristic("series", 0.01, rng, np.geomspace(2e-5, 2e-3, 12))).verdict == "series"


@pytest.mark.parametrize(("law", "regime"), [(lambda v: 10 + 1e5 * v, "laminar"),
                                             (lambda v: 1 + 1e8 * v**2, "turbulent")])
def test_one_regime_alone_is_not_a_topology(law, regime: str, rng: np.random.Generator) -> None:
    force = law(SPEEDS) * np.exp(0.01 * rng.standard_normal(23))
    choice = choose_network(StaticCharacteristic(SPEEDS, force, 0.01 * force))
    assert choice.verdict == "cannot tell"
    assert choice.reason.startswith(f"a {regime} loss alone")
    assert choice.best.network == regime
    assert isinstance(choice.damper(), SeriesNetwork)


@pytest.mark.seconds
def test_the_bound_on_a_leak_holds() -> None:
    """A small true leak lies below its one-sided 95 % bound."""
    force = Parallel(Series(Laminar(5e4), Turbulent(2e8)), Laminar(1 / 3e-8)).pressure(SPEEDS) + 10.0
    held = 0
    for seed in range(40):
        noisy = force * np.exp(0.01 * np.random.default_rng(seed).standard_normal(23))
        points = Points.of(StaticCharacteristic(SPEEDS, noisy, 0.01 * noisy))
        held += upper_bound(points, fit_log_force(points, "mixed"), "leak_mobility") > 3e-8
    assert held >= 34


@pytest.mark.slow
def test_ratio_of_a_true_null_is_rarely_small() -> None:
    """p of mixed against series where series is the truth: at most uniform."""
    draws = [choose_network(characteristic("series", 0.02, np.random.default_rng(s))).ratios for s in range(40)]
    p = np.array([next(r.p_value for r in some if (r.smaller, r.larger) == ("series", "mixed")) for some in draws])
    assert np.mean(p < 0.1) <= 0.2
    assert p.max() <= 0.5


@pytest.mark.seconds
def test_both_directions_are_folded_and_asymmetry_is_said(rng: np.random.Generator) -> None:
    c = characteristic("series", 0.01, rng)

    def two_sided(factor: float, offset: float) -> StaticCharacteristic:
        return StaticCharacteristic(np.concatenate([c.speed, -c.speed]),
                                    np.concatenate([c.force, -factor * c.force]) + offset,
                                    np.concatenate([c.std, factor * c.std]))

    even = choose_network(two_sided(1.0, 4.0))
    assert even.verdict == "series"
    assert "offset 4 " in even.notes[0] and not any("differ" in n for n in even.notes)
    uneven = two_sided(1.5, 0.0)
    stated = next(n for n in choose_network(uneven).notes if "extension and compression differ" in n)
    assert 0.15 < float(stated.split("differ by ")[1].split("%")[0]) / 100 < 0.45
    back = choose_network(uneven, direction=-1)
    assert back.verdict == "series"
    assert back.best.theta[0] == pytest.approx(1.5 * choose_network(uneven, direction=1).best.theta[0], rel=1e-4)


def test_a_curve_of_no_network_is_said_to_be_missed(rng: np.random.Generator) -> None:
    knee = 10 + 1e5 * SPEEDS + np.where(SPEEDS > 3e-4, 60.0, 0.0)  # a valve that closes
    c = StaticCharacteristic(SPEEDS, knee * np.exp(0.005 * rng.standard_normal(23)), 0.005 * knee)
    assert any("times their errors" in n for n in choose_network(c).notes)


@pytest.mark.seconds
def test_it_prints_stores_and_becomes_a_damper(rng: np.random.Generator) -> None:
    choice = choose_network(characteristic("mixed", 0.01, rng))
    text = repr(choice)
    assert text.startswith("Network: mixed") and "AICc" in text and "friction" in text
    assert len(text.splitlines()) <= 14
    damper = choice.damper()
    assert isinstance(damper, MixedNetwork)
    speed = RANGES["mixed"]
    assert np.allclose(damper.force(0.0, speed), choice.best.force(speed), rtol=1e-3)
    other = choice.damper("parallel")
    assert np.allclose(other.force(0.0, speed), choice.fits["parallel"].force(speed), rtol=1e-3)
    assert choice.to_dict()["networks"]["mixed"]["values"] == choice.fits["mixed"].values
    with pytest.raises(InputError, match="no network 'serial'"):
        choice.damper("serial")


def test_too_few_points_are_refused(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="too few points"):
        choose_network(characteristic("series", 0.01, rng, SPEEDS[:5]))
    with pytest.raises(InputError, match="takes one direction"):
        Points.of(StaticCharacteristic(-SPEEDS, -SPEEDS, SPEEDS))


def test_part_of_the_printed_margin_is_the_norm(rng: np.random.Generator) -> None:
    """E3.6: (8) minimises the error of Q with noisy regressors; in one norm parallel does better, yet series wins."""
    c = characteristic("series", 0.01, rng)
    net = (c.force - 10.0)[2:]  # the true friction, so that only the norm differs; two slowest points left out
    v = c.speed[2:]
    a, b = np.linalg.lstsq(np.column_stack([net, np.sqrt(net)]), v, rcond=None)[0]
    printed = parallel_pressure(v, a, b)
    points = Points(v, net, np.full(v.size, 0.01))
    best, series = (fit_log_force(points, n, friction=0.0) for n in ("parallel", "series"))

    def miss(model: np.ndarray) -> float:
        return float(np.sqrt(np.mean(np.log(model / net) ** 2)))

    assert miss(printed) > 1.2 * miss(best.force(v))
    assert miss(best.force(v)) > 5 * miss(series.force(v))


@pytest.mark.seconds
def test_free_runs_rank_the_networks_the_same_way(rng: np.random.Generator) -> None:
    path, friction = TRUTHS["series"]
    records = []
    for speed in SPEEDS[::2]:
        v = speed * np.where(np.arange(400) % 200 < 100, 1.0, -1.0)
        force = path.pressure(v) + friction * np.sign(v)
        records.append(Record({"velocity": Channel(v, "m/s"), "force": Channel(
            force * (1 + 0.01 * rng.standard_normal(v.size)), "N")}, sample_time=0.01))
    esr = [fit(kind.suited(Facts.of(records)).replace(smoothing=1e-6), records).training.esr or 0.0
           for kind in (SeriesNetwork, ParallelNetwork, MixedNetwork)]
    assert 0.0 < esr[0] < 0.6 * esr[1]  # the fast runs weigh most in newtons: log-force tells the two apart by far more
    assert 0.0 < esr[2] <= esr[0] * (1 + 1e-4)
