"""NARX dampers against loops written out here: recovered, simulated, recursive, out of the one-step trap."""

from __future__ import annotations

import numpy as np
import pytest

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.record import Record
from quartercar.dampers.blackbox.narx import Narx2, Narx3
from quartercar.dampers.drive import Drive
from quartercar.dampers.facts import Facts
from quartercar.dampers.fitting import FitSettings, fit

RATE = 256.0
UNITS = {"displacement": "m", "velocity": "m/s", "current": "A", "force": "N"}
A = np.array([[1.1, -0.1], [-0.35, 0.04]])
"""a_j = A[j, 0] + A[j, 1] i, of past forces"""
B = np.array([[900.0, 200.0], [-500.0, -100.0]])
C = np.array([[300.0, 150.0], [-120.0, -60.0]])


def motion(n: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacement, velocity and current: smooth motion, a current that jumps."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / RATE
    f, phase, size = rng.uniform(0.5, 40, 30), rng.uniform(0, 2 * np.pi, 30), rng.uniform(0.2, 1.0, 30)
    v = (size * np.cos(2 * np.pi * np.outer(t, f) + phase)).sum(axis=1) * 0.05
    x = (size / (2 * np.pi * f) * np.sin(2 * np.pi * np.outer(t, f) + phase)).sum(axis=1) * 0.05
    return x, v, np.repeat(rng.uniform(0, 2, n // 16 + 1), 16)[:n]


def loop(x: np.ndarray, v: np.ndarray, i: np.ndarray, a=A, b=B, c=C, start: tuple = (0.0, 0.0, 0.0)) -> np.ndarray:
    """The equation of the thesis, sample by sample."""
    n = len(a)
    force = np.zeros(x.size)
    force[:n] = start[:n]
    for k in range(n, x.size):
        force[k] = sum((a[j] @ (1.0, i[k])) * force[k - 1 - j] + (b[j] @ (1.0, i[k])) * x[k - 1 - j]
                       + (c[j] @ (1.0, i[k])) * v[k - 1 - j] for j in range(n))
    return force


def record(n: int = 1500, seed: int = 0, noise: float = 0.0, turn: float = 1.0) -> Record:
    x, v, i = motion(n, seed)
    force = loop(x, v, i)
    force = force + noise * force.std() * np.random.default_rng(seed + 50).normal(size=n)
    return Record({"displacement": x, "velocity": v, "current": i, "force": turn * force}, 1 / RATE, units=UNITS)


def estimated(damper, records):
    return damper.estimate(records, FitSettings())


@pytest.mark.parametrize("method", ["least-squares", "one-step", "recursive"])
def test_coefficients_of_the_loop_come_back(method: str) -> None:
    found = estimated(Narx2(method=method, degree=1), [record()]).damper
    model = found.to_lpv(1 / RATE)
    for i in (0.0, 0.7, 2.0):
        a, b, _ = model.coefficients([i])
        np.testing.assert_allclose(-a[:, 0, 0], A @ (1, i), rtol=1e-6)
        np.testing.assert_allclose(b[1:, 0, 0], B @ (1, i), rtol=1e-5)
        np.testing.assert_allclose(b[1:, 0, 1], C @ (1, i), rtol=1e-5)
    assert np.all(b[0] == 0)
    assert len(found.names) == 12 and found.reads == ("displacement", "velocity", "current")


@pytest.mark.seconds
def test_three_lags() -> None:
    rng = np.random.default_rng(2)
    a = np.column_stack([-np.poly([0.6, 0.3 + 0.4j, 0.3 - 0.4j])[1:].real, np.zeros(3)])
    b, c = (np.column_stack([rng.normal(size=3) * 300, np.zeros(3)]) for _ in range(2))
    x, v, i = motion(800, 3)
    force = loop(x, v, i, a, b, c)
    data = Record({"displacement": x, "velocity": v, "force": force}, 1 / RATE,
                  units={"displacement": "m", "velocity": "m/s", "force": "N"})
    found = estimated(Narx3(), [data]).damper
    model = found.to_lpv(1 / RATE)
    np.testing.assert_allclose(-model.a[:, 0, 0, 0], a[:, 0], rtol=1e-6)
    np.testing.assert_allclose(model.b[1:, 0, 1, 0], c[:, 0], rtol=1e-4)
    assert found.start == 3 and "current" not in found.reads


def test_free_run_is_the_loop_from_the_first_measured_samples() -> None:
    found = estimated(Narx2(method="one-step", degree=1), [record()]).damper
    other = record(600, seed=9)
    shifted = other.with_channel("force", other["force"] + 0.0, "N")
    run = found.simulate(shifted)
    x, v, i = motion(600, 9)
    expected = loop(x, v, i, start=tuple(shifted["force"][:2]))
    np.testing.assert_allclose(run.output[:, 0], expected, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_array_equal(run.output[:, 0], lpv.simulate(found.to_lpv(1 / RATE), shifted).output[:, 0])


def regressor(data: Record) -> tuple[np.ndarray, np.ndarray]:
    """(n − 2, 6) rows F(k−1), F(k−2), x(k−1), x(k−2), v(k−1), v(k−2), and F(k)."""
    f, x, v = (data[n] for n in ("force", "displacement", "velocity"))
    return np.column_stack([s[2 - j: s.size - j] for s in (f, x, v) for j in (1, 2)]), f[2:]


@pytest.mark.parametrize("forgetting", [1.0, 0.99])
def test_recursive_least_squares_is_weighted_least_squares(forgetting: float) -> None:
    data = record(700, noise=0.05)
    found = estimated(Narx2(method="recursive", forgetting=forgetting), [data]).damper
    rows, target = regressor(data)
    weight = np.sqrt(forgetting ** np.arange(len(target) - 1, -1, -1))
    theta = np.linalg.lstsq(rows * weight[:, None], target * weight, rcond=None)[0]
    model = found.to_lpv(1 / RATE)
    ours = np.concatenate([-model.a[:, 0, 0, 0], model.b[1:, 0, 0, 0], model.b[1:, 0, 1, 0]])
    np.testing.assert_allclose(ours, theta, rtol=1e-5)


def test_one_step_is_least_squares() -> None:
    data = record(700, noise=0.05)
    model = estimated(Narx2(method="one-step"), [data]).damper.to_lpv(1 / RATE)
    rows, target = regressor(data)
    theta = np.linalg.lstsq(rows, target, rcond=None)[0]
    np.testing.assert_allclose([*-model.a[:, 0, 0, 0], *model.b[1:, 0, 0, 0]], theta[:4], rtol=1e-6)


@pytest.mark.seconds
def test_simulation_error_escapes_the_one_step_trap() -> None:
    data, clean = record(2500, noise=0.1), record(1000, seed=4)
    errors = {}
    for method in ("one-step", "least-squares"):
        found = estimated(Narx2(method=method, degree=1), [data])
        run = found.damper.simulate(clean)
        errors[method] = float(np.std(run.output[2:, 0] - clean["force"][2:]) / clean["force"].std())
    assert errors["least-squares"] < min(0.02, 0.4 * errors["one-step"])
    assert any("simulation error" in n for n in found.notes)


@pytest.mark.seconds
def test_poles_stay_inside() -> None:
    x, v, _ = motion(1500, 6)
    force = np.cumsum(40 * v)  # a pole at 1: force that never relaxes
    force = force + 0.01 * force.std() * np.random.default_rng(1).normal(size=force.size)
    data = Record({"displacement": x, "velocity": v, "force": force}, 1 / RATE, units={"displacement": "m"})
    found = estimated(Narx2(displacement=False), [data])
    model = found.damper.to_lpv(1 / RATE)
    assert np.abs(np.roots([1.0, *model.a[:, 0, 0, 0]])).max() <= 0.999
    assert any("poles drawn in" in n for n in found.notes) and any("no displacement" in n for n in found.notes)
    run = found.damper.simulate(data)
    assert np.var(run.output[2:, 0] - force[2:]) < 0.2 * force.var()


def test_structure_follows_the_data() -> None:
    data = record()
    whole = Facts.of([data])
    assert (Narx2.suited(whole).degree, Narx2.suited(whole).displacement) == (2, True)
    bare = Record({"velocity": data["velocity"], "force": data["force"]}, 1 / RATE, units=UNITS)
    poor = Narx3.suited(Facts.of([bare]))
    assert (poor.degree, poor.displacement, poor.reads) == (0, False, ("velocity",))


@pytest.mark.seconds
def test_rest_and_static_force_against_a_long_loop() -> None:
    found = estimated(Narx2(degree=1), [record()]).damper
    x, v, i = 0.01, 0.2, 1.3
    n = 400
    ramp = x + v / RATE * np.arange(1 - n, 51)
    expected = loop(ramp, np.full(n + 50, v), np.full(n + 50, i))
    assert found.static_force(np.array([v]), i, x)[0] == pytest.approx(expected[n - 1], rel=1e-6)
    moving = Drive(1 / RATE, np.full(51, v), ramp[n - 1:], np.full(51, i))
    np.testing.assert_allclose(found.response(moving, found.vector), expected[n - 1:], rtol=1e-6)
    gas = loop(np.full(n, x), np.zeros(n), np.full(n, found.current_range[0] if found.current_range else 0.0))[-1]
    assert found.conservative_force(np.array([x]))[0] == pytest.approx(gas, rel=1e-6)


def test_a_dashpot_told_by_differences_of_displacement_is_one_at_constant_velocity() -> None:
    """F(k) = c (x(k−1) − x(k−2))/T is a dashpot, though the velocity does not enter; held still it gives none."""
    x, v, _ = motion(1500, 8)
    force = loop(x, v, 0 * v, np.zeros((2, 2)), np.array([[1500.0 * RATE, 0], [-1500.0 * RATE, 0]]), np.zeros((2, 2)))
    data = Record({"displacement": x, "velocity": v, "force": force}, 1 / RATE, units=UNITS)
    found = estimated(Narx2(method="one-step"), [data]).damper
    speeds = np.array([-0.4, 0.1, 1.5])
    np.testing.assert_allclose(found.static_force(speeds), 1500 * speeds, rtol=1e-4)
    np.testing.assert_allclose(found.conservative_force(np.array([0.01])), 0.0, atol=1e-3)
    assert found.passivity().power == 0.0


@pytest.mark.seconds
def test_work_of_a_cycle_against_the_loop() -> None:
    found = estimated(Narx2(degree=1), [record()]).damper
    size, f = 0.01, 4.0
    t = np.arange(int(40 * RATE / f)) / RATE
    omega = 2 * np.pi * f
    x, v = size * np.sin(omega * t), size * omega * np.cos(omega * t)
    force = loop(x, v, np.ones(t.size))
    last = slice(-int(RATE / f), None)  # 64 samples of a sine: the rectangle rule is exact for its work
    work = float(np.sum(force[last] * v[last]) / RATE)
    assert found.energy_per_cycle(size, f, 1.0) == pytest.approx(work, rel=1e-4)


@pytest.mark.seconds
def test_reversed_polarity_and_moved_zero() -> None:
    straight = estimated(Narx2(degree=1), [record()]).damper
    moved = record(turn=-1.0)
    moved = moved.with_channel("displacement", moved["displacement"] + 0.25, "m")
    turned = estimated(Narx2(degree=1, polarity=-1, centre=0.25), [moved]).damper
    np.testing.assert_allclose(turned.vector, straight.vector, rtol=1e-5)
    run = turned.simulate(moved)
    np.testing.assert_allclose(run.output[2:, 0], moved["force"][2:], atol=1e-5 * moved["force"].std())
    acting = lpv.simulate(turned, moved)  # the transfer function that lpvid runs, turned and moved exactly
    np.testing.assert_allclose(acting.output, run.output, atol=1e-6 * moved["force"].std())
    assert lpv.validate(turned, moved).overall.free_run.esr < 1e-9


@pytest.mark.seconds
def test_fit_reports_free_run_figures() -> None:
    found = fit(Narx2(degree=1), record(noise=0.02), record(seed=3, noise=0.02))
    assert found.held_out is not None and found.held_out.esr is not None
    assert found.held_out.esr == pytest.approx(0.02**2, rel=0.2)
    assert found.covariance is not None and found.covariance.shape == (12, 12)
    errors = (found.damper.vector - estimated(Narx2(degree=1), [record()]).damper.vector) / np.sqrt(
        np.diag(found.covariance))
    assert np.abs(errors).max() < 4


@pytest.mark.seconds
def test_refusals() -> None:
    with pytest.raises(InputError, match="has not been fitted yet"):
        Narx2().simulate(record())
    with pytest.raises(InputError, match="method"):
        Narx2(method="magic")
    with pytest.raises(InputError, match="true or false"):
        Narx2(displacement=1)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"\(0, 1\]"):
        Narx2(forgetting=1.5)
    found = estimated(Narx2(degree=1), [record()]).damper
    slow = lpv.condition.resample(record(), 128.0)
    with pytest.raises(InputError, match=r"rate of its training data only.*Mend: resample") as caught:
        found.simulate(slow)
    assert len(str(caught.value).splitlines()) == 1
    with pytest.raises(InputError, match="rate of its training data only"):
        found.to_lpv(0.1)
