"""Discrete output feedback with a Lyapunov matrix that moves, held against lifted trajectories and frozen norms."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from helpers.responses import largest_gain
from helpers.synthesis_plants import plant
from typer.testing import CliRunner

import lpvid as lpv
from lpvid.cli.app import app
from lpvid.scheduling import Fourier
from lpvid.synthesis.design_grid import fitted
from lpvid.synthesis.moving_feedback import lowest

H = 0.1  # s


def _spring(rate=None, swing=1.5, d22=0.0, box=(-1.0, 1.0)):
    """A mass on a spring of stiffness 2 + swing·p [N/m], by Euler's rule; measured displacement with noise."""
    a = [[[1, H], [-2 * H, 1 - 0.2 * H]], [[0, 0], [-swing * H, 0]]]
    b1, b2 = np.zeros((2, 2, 2)), np.zeros((2, 2, 1))
    b1[0, 1, 0], b2[0, 1, 0] = H, H
    c1, d12, c2, d21 = np.zeros((2, 2, 2)), np.zeros((2, 2, 1)), np.zeros((2, 1, 2)), np.zeros((2, 1, 2))
    c1[0, 0, 0], d12[0, 1, 0], c2[0, 0, 0], d21[0, 0, 1] = 1.0, 0.3, 1.0, 0.1
    through = np.array([[[d22]], [[0.0]]])
    made = plant(a, b1, b2, c1, np.zeros((2, 2, 2)), d12, c2, d21, lpv.Polynomial("p", 1),
                 lpv.Scheduling(("p",), *((end,) for end in box), (rate,)), sample_time=H)
    d = made.system.D.copy()
    d[:, 2:, 2:] = through
    return lpv.GeneralizedPlant(made.system.replace(D=d), made.controls, made.measurements)


def _design(varying="controls", **options):
    return lpv.OutputFeedback(lpv.Polynomial("p", 1), varying=varying, points=3, **options)


def _lifted_gain(loop, path):
    """Largest ‖z‖/‖w‖ over all disturbances along one path: the norm of the map from w to z written as one matrix."""
    matrices = [loop.frozen([p]) for p in path]
    nz, nw = matrices[0][3].shape
    whole = np.zeros((len(path) * nz, len(path) * nw))
    for j, (_, b, _, d) in enumerate(matrices):
        whole[j * nz : (j + 1) * nz, j * nw : (j + 1) * nw] = d
        x = b
        for k in range(j + 1, len(path)):
            a, _, c, _ = matrices[k]
            whole[k * nz : (k + 1) * nz, j * nw : (j + 1) * nw] = c @ x
            x = a @ x
    return float(np.linalg.norm(whole, 2))


def _admissible(rng, rate, samples):
    """Paths in the box that move by at most rate·H: a random walk, and full speed to and fro."""
    p, walk = rng.uniform(-1, 1), []
    for _ in range(samples):
        walk.append(p)
        p = float(np.clip(p + rate * H * rng.choice([-1.0, 0.0, 1.0]), -1, 1))
    period = 4 / rate
    return [np.array(walk), np.abs((np.arange(samples) * H + rng.uniform(0, period)) % period - period / 2) * rate - 1]


@pytest.mark.parametrize("varying", [pytest.param("controls", marks=pytest.mark.seconds),  # as in test_hull_moving.py
                                     pytest.param("measurements", marks=pytest.mark.slow)])
def test_a_moving_matrix_keeps_its_promise_on_every_admissible_path(varying):
    rate = 0.5
    result, constant = lpv.synthesize(_spring(rate), _design(varying)), lpv.synthesize(_spring(), lpv.OutputFeedback())
    assert result.verdict == "solved" and result.between_grid
    assert result.gamma_verified < 0.96 * constant.gamma_verified
    assert lpv.verify(result.certificate, result.closed_loop).between_grid
    assert result.controller.box.names == ("p",)  # the controller needs neither p(k+1) nor a rate
    rng = np.random.default_rng(3)
    gains = [_lifted_gain(result.closed_loop, path) for _ in range(3) for path in _admissible(rng, rate, 120)]
    assert 0.85 * result.gamma_verified < max(gains) <= result.gamma_verified
    z = np.exp(1j * np.concatenate([np.linspace(0, 0.5, 300), np.linspace(0.5, np.pi, 60)]))
    for p in np.linspace(-1, 1, 41):
        a, b, c, d = result.closed_loop.frozen([p])
        assert np.abs(np.linalg.eigvals(a)).max() < 1
        assert largest_gain((a, b, c, d), z) <= result.gamma_verified


@pytest.mark.slow
def test_slow_scheduling_is_worth_a_moving_matrix():
    constant = lpv.synthesize(_spring(), lpv.OutputFeedback())
    slow = lpv.synthesize(_spring(0.1), _design())
    assert slow.gamma_verified < 0.92 * constant.gamma_verified
    assert any("constant X and Y keep" in note and f"{constant.gamma_verified:.4g}"[:5] in note for note in slow.notes)


@pytest.mark.slow
def test_the_least_gain_rises_with_the_rate_up_to_that_of_jumps():
    """Frozen ≤ slow ≤ fast ≤ jumps ≤ constant matrices, whose inequalities are a special case."""
    moving = [lpv.synthesize(_spring(rate), _design()).infimum for rate in (0.0, 1.0, None)]
    constant = lpv.synthesize(_spring(), lpv.OutputFeedback()).infimum
    frozen = max(lpv.synthesize(_spring(box=(p, p)), lpv.OutputFeedback()).infimum for p in (-1.0, 0.0, 1.0))
    for lower, upper in itertools.pairwise([frozen, *moving, constant]):
        assert lower <= upper * (1 + 1e-3)
    assert moving[2] > 0.98 * constant  # where p may jump, there is little to be had


@pytest.mark.slow
def test_both_is_the_better_of_the_two():
    result = lpv.synthesize(_spring(1.0), _design("both"))
    one = [lpv.synthesize(_spring(1.0), _design(v)).gamma_verified for v in ("controls", "measurements")]
    assert result.gamma_verified == pytest.approx(min(one), rel=1e-9)


@pytest.mark.slow
def test_without_feedthrough():
    result = lpv.synthesize(_spring(0.5), _design(strictly_proper=True))
    free = lpv.synthesize(_spring(0.5), _design())
    assert not result.controller.D.any() and result.between_grid
    assert free.infimum <= result.infimum * (1 + 1e-6)


@pytest.mark.parametrize("varying", [
    pytest.param("controls", marks=pytest.mark.slow), pytest.param("measurements", marks=pytest.mark.seconds)])
def test_a_path_from_control_to_sensor_costs_the_feedthrough_alone(varying):
    """The controller is put around D22, so that the loop is the same; it is closed and certified with D22 in it."""
    without = lpv.synthesize(_spring(0.5), _design(varying, strictly_proper=True))
    within = lpv.synthesize(_spring(0.5, d22=0.4), _design(varying))
    assert within.gamma_verified == pytest.approx(without.gamma_verified, rel=5e-3)
    assert any("no feedthrough" in note for note in within.notes)
    assert lpv.verify(within.certificate, within.closed_loop).holds


@pytest.mark.slow
def test_constants_where_matrices_that_move_fail_or_do_worse():
    constant = lpv.synthesize(_spring(), lpv.OutputFeedback())
    failed = lpv.synthesize(_spring(0.1), lpv.OutputFeedback(lpv.Polynomial("p", 1), points=2, bound=0.01))
    assert failed.verdict == "infeasible" and failed.controller is None and "constant" in failed.notes[0]
    kept = lowest([failed], constant)
    assert kept.controller is constant.controller and "gave no controller (infeasible" in kept.notes[0]
    worse = replace(constant, gamma_verified=2 * constant.gamma_verified)
    kept = lowest([worse, failed], constant)
    assert kept.gamma_verified == constant.gamma_verified and "which is more" in kept.notes[0]


def test_a_lyapunov_matrix_over_an_unknown_variable_is_refused():
    with pytest.raises(lpv.InputError, match="scheduling variable") as refused:
        lpv.synthesize(_spring(0.5), lpv.OutputFeedback(lpv.Polynomial("q", 1)))
    assert "\n" not in str(refused.value) and "'q'" in str(refused.value)


def test_gains_over_an_angle_stay_a_fourier_series():
    """Smooth functions that the re-check can decide between the points, where a table of them would be taken before."""
    box, series = lpv.Scheduling(("p",), (-np.pi,), (np.pi,)), Fourier("p", 1)

    def law(points):
        return np.stack([1 + 2 * np.cos(2 * points), np.sin(points)], axis=1)

    basis, found = fitted(law, box, (np.linspace(-np.pi, np.pi, 7),), series)
    assert basis == Fourier("p", 2)
    assert found[:, :, 0].round(9).tolist() == [[1, 0], [0, 0], [0, 1], [2, 0], [0, 0]]
    steep, _ = fitted(lambda points: np.abs(points)[:, None], box, (np.linspace(-np.pi, np.pi, 7),), series)
    assert isinstance(steep, lpv.Spline)


@pytest.mark.slow
def test_from_a_plant_file_to_a_certificate_that_verifies(tmp_path):
    (tmp_path / "plant.toml").write_text("""
        inputs = ["push", "noise", "force"]
        outputs = ["stroke", "effort", "sensor"]
        controls = ["force"]
        measurements = ["sensor"]
        sample_time = 0.1
        [scheduling.stiffness]
        range = [-1.0, 1.0]
        rate = 0.5
        [matrices.1]
        A = [[1.0, 0.1], [-0.2, 0.98]]
        B = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.1]]
        C = [[1.0, 0.0], [0.0, 0.0], [1.0, 0.0]]
        D = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.3], [0.0, 0.1, 0.0]]
        [matrices.stiffness]
        A = [[0.0, 0.0], [-0.15, 0.0]]
        [design]
        design = "output-feedback"
        lyapunov_degree = 1
        varying = "controls"
        points = 3
        """)
    made = CliRunner().invoke(app, ["synthesize", str(tmp_path / "plant.toml"), "--out", str(tmp_path / "out")])
    assert made.exit_code == 0, made.output
    assert "verified on the whole box" in made.output and "for scheduling that jumps" in made.output
    files = [str(tmp_path / "out" / f) for f in ("certificate.json", "closed_loop.json")]
    assert CliRunner().invoke(app, ["verify", *files]).exit_code == 0
