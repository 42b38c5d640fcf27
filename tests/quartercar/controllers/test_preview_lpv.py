"""The law with a register of the road ahead: its demand, and the bounds that it keeps for every share and speed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from helpers.law_signals import seen
from scipy.linalg import solve_discrete_lyapunov

import lpvid as lpv
from lpvid.errors import InputError
from quartercar import controllers as laws
from quartercar.controllers.contract import Setting
from quartercar.controllers.laws.preview_lpv import StorageWithRegister, preview_storage, worst_road
from quartercar.controllers.laws.preview_lqr import preview_loop
from quartercar.controllers.laws.preview_model import PreviewModel
from quartercar.parameters import MEGANE

WEIGHTS = (0.3, 0.01, 0.3, 0.01)
STORAGES = {"h2": preview_storage(MEGANE, *WEIGHTS, 1500.0, 1 / 512),
            "hinf": preview_storage(MEGANE, *WEIGHTS, 1500.0, 1 / 512, 1.1)}
SCALE = np.array([0.01, 0.1, 0.002, 0.3, 100.0, 1.0, 1.0, 1.0, 1.0])
"""of a state"""


def driven(found: StorageWithRegister, samples: int, share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C of the loop with the register at a share that stays."""
    loop = found.closed(samples)
    a, c = (m[0] + share * m[1] for m in (loop.A, loop.C))
    return a, loop.B[0, :, 0], c


@pytest.mark.parametrize("criterion", STORAGES)
@pytest.mark.parametrize("samples", [0, 1, 2, 9])
def test_the_demand_is_the_least_cost_to_come(criterion: str, samples: int, rng):
    """Derivative of effort + V at the next sample by the demand, by differences, V from its definition."""
    found, m = STORAGES[criterion], STORAGES[criterion].model
    gain, ahead = found.gains(samples)
    x, w = SCALE * rng.normal(size=9), rng.normal(0, 0.3, samples)
    after = found.storage(max(samples - 1, 0))
    if not samples and found.gamma is not None:
        after = worst_road(found.terminal, m.road, found.gamma)

    def cost(u: float) -> float:
        y = m.step @ x + m.control * u + (m.road * w[0] if samples else 0.0)
        y = np.concatenate([y, w[1:]])
        return float(found.effort * u**2 + y @ after @ y)

    u = -gain @ x - ahead @ w
    slope, curve = cost(u + 1) - cost(u - 1), cost(u + 1) + cost(u - 1) - 2 * cost(u)
    assert abs(0.5 * slope / curve) < 1e-6 * max(abs(u), 1.0)


def test_the_storage_solves_the_lyapunov_and_riccati_equations_with_the_register():
    """Independent of the closed form: the car left alone with the delays as states, where nothing but the last one is
    driven. H2: Aᵀ V A + CᵀC = V for the register filled with zeros from behind."""
    samples = 5
    for found in STORAGES.values():
        m, whole = found.model, found.storage(samples)
        n = len(m.step)
        big = np.zeros((n + samples, n + samples))
        big[:n, :n], big[:n, n] = m.step, m.road
        big[n:-1, n + 1:] = np.eye(samples - 1)
        rows, into = np.hstack([m.shown, np.zeros((3, samples))]), np.zeros(n + samples)
        into[-1] = 1.0
        after = whole if found.gamma is None else worst_road(whole, into, found.gamma)
        unit = 1 / np.sqrt(np.diag(whole))
        np.testing.assert_allclose((big.T @ after @ big + rows.T @ rows - whole) * np.outer(unit, unit), 0, atol=1e-11)


def test_steps_of_improvement_end_at_the_gains_of_preview_lq():
    """Policy iteration: the storage of the loop in place of that of the car left at c_nom, again and again, ends at the
    optimum of Riccati and at Tomizuka's gains for the road ahead (`preview_lqr`), with every demand met."""
    best = preview_loop(MEGANE, *WEIGHTS, 1 / 512)
    model = PreviewModel.of(MEGANE.replace(damping=0.0), *WEIGHTS[:2], WEIGHTS[3], 1 / 512)
    effort, gain = WEIGHTS[2] / MEGANE.sprung_mass**2, np.array([0, -1500.0, 0, 1500.0, 0, 0, 0, 0, 0])
    for _ in range(12):
        loop = model.step - np.outer(model.control, gain)
        rows = np.vstack([model.shown, -np.sqrt(effort) * gain])
        cost = solve_discrete_lyapunov((loop * SCALE / SCALE[:, None]).T, (rows * SCALE).T @ (rows * SCALE),
                                       method="bilinear") / np.outer(SCALE, SCALE)
        weight = effort + model.control @ cost @ model.control
        gain = model.control @ cost @ model.step / weight
    np.testing.assert_allclose(gain, best.gain, rtol=1e-5, atol=1e-6 * np.abs(best.gain).max())
    assert StorageWithRegister(model, effort, cost, None).gains(1)[1][0] == pytest.approx(
        best.ahead(1)[0], rel=1e-5)


@pytest.mark.parametrize("criterion", STORAGES)
def test_the_storage_proves_the_bound_for_every_share_and_speed(criterion: str):
    """V falls by at least |z|² − γ² w² from N to N and from N to N − 1 samples; largest eigenvalue by numpy.

    For H2 without the −γ² w²: what an unknown w adds to V is its variance, whatever the law.
    """
    found = STORAGES[criterion]
    n = len(found.model.step)
    for samples, share in ((1, 0.0), (1, 1.0), (6, 0.0), (6, 0.4), (6, 1.0), (6, 2.0), (40, 1.0)):
        a, b, c = driven(found, samples, share)
        before, after = found.storage(samples), found.storage(samples)
        unit = 1 / np.sqrt(np.diag(before))
        fall = a.T @ after @ a + c.T @ c - before
        if found.gamma is None:
            checked = fall * np.outer(unit, unit)
        else:
            side = a.T @ after @ b
            checked = np.block([[fall, side[:, None]], [side[None], np.array([[b @ after @ b - found.gamma**2]])]])
            unit = np.append(unit, 1 / found.gamma)
            checked = checked * np.outer(unit, unit)
        assert np.linalg.eigvalsh(checked)[-1] < 1e-8, (samples, share)
        shorter = found.storage(samples - 1)  # the car is faster: nothing new is known, one sample is passed
        fall = a[:n + samples - 1].T @ shorter @ a[:n + samples - 1] + c.T @ c - before
        assert np.linalg.eigvalsh(fall * np.outer(unit[:n + samples], unit[:n + samples]))[-1] < 1e-8, (samples, share)


def course(steps: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """N that rises and falls by one, and shares that jump."""
    return (30 + np.round(20 * np.sin(0.05 * np.arange(steps))).astype(int),
            rng.choice([0.0, 0.3, 1.0, 1.7], size=steps))


@pytest.mark.seconds
def test_a_course_of_speed_and_share_keeps_the_gain(rng):
    found, m = STORAGES["hinf"], STORAGES["hinf"].model
    samples, shares = course(4000, rng)
    assert np.diff(samples).min() == -1
    t, gains = np.arange(samples.size + 60) / 512, {n: found.gains(n) for n in range(10, 51)}
    for w in (rng.normal(size=t.size), np.sin(2 * np.pi * 1.4 * t), np.sin(2 * np.pi * 12.0 * t)):
        x, total = np.zeros(9), 0.0
        for k, (n, share) in enumerate(zip(samples, shares, strict=True)):
            gain, ahead = gains[n]
            u = share * (-gain @ x - ahead @ w[k:k + n])
            total += np.sum((m.shown @ x) ** 2) + found.effort * u**2
            x = m.step @ x + m.control * u + m.road * w[k]
        assert found.gamma is not None and total < found.gamma**2 * np.sum(w**2)


def test_a_course_of_speed_and_share_has_the_mean_square_as_stated(rng):
    """E V and E|z|² of every sample from the covariance of the state, with the road's next 50 rates as states."""
    found, m, most = STORAGES["h2"], STORAGES["h2"].model, 51
    samples, shares = course(300, rng)
    n, storage = len(m.step), found.storage(most)
    shift = np.zeros((n + most, n + most))
    shift[:n, :n], shift[:n, n] = m.step, m.road
    shift[n:-1, n + 1:] = np.eye(most - 1)
    spread = np.diag(np.append(np.zeros(n), np.ones(most)))
    weight = found.effort + m.control @ found.terminal @ m.control
    for known, share in zip(samples, shares, strict=True):
        gain, ahead = found.gains(known)
        feedback = -np.concatenate([gain, ahead, np.zeros(most - known)])
        loop = shift.copy()
        loop[:n] += share * np.outer(m.control, feedback)
        rows = np.vstack([np.hstack([m.shown, np.zeros((3, most))]), share * np.sqrt(found.effort) * feedback])
        cost, demand = np.trace(rows @ spread @ rows.T), feedback @ spread @ feedback
        after = loop @ spread @ loop.T
        after[-1, -1] += 1.0
        change = np.trace(storage @ after) - np.trace(storage @ spread)
        assert change + cost == pytest.approx(storage[-1, -1] - (2 * share - share**2) * weight * demand, rel=1e-6)
        spread = after
    # what an unknown sample of white road adds is Eᵀ Π E, once the register has brought it to the car
    assert found.storage(1)[-1, -1] == pytest.approx(m.road @ found.terminal @ m.road, rel=1e-9)


@pytest.mark.slow
def test_the_gain_is_certified_by_the_library_too():
    """`lpvid.l2_gain` over every course of the share in [0, 1]: no more than γ, no less than the frozen loops' gain."""
    found = preview_storage(MEGANE, *WEIGHTS, 1500.0, 1 / 100, 1.1)
    gain = lpv.l2_gain(found.closed(3), trajectories=False)
    z, peaks = np.exp(1j * np.geomspace(1e-3, np.pi, 2000)), []
    for share in (0.0, 1.0):
        a, b, c = driven(found, 3, share)
        peaks.append(max(np.linalg.norm(c @ np.linalg.solve(s * np.eye(len(a)) - a, b)) for s in z))
    assert gain.verdict == "certified" and found.gamma is not None
    assert max(peaks) * (1 - 1e-6) <= gain.upper <= found.gamma * 1.001


def test_a_long_register_leaves_nothing_of_the_criterion():
    gains = {n: [STORAGES[c].gains(n)[0] for c in STORAGES] for n in (0, 1000)}
    off = {n: np.abs(a - b).max() / np.abs(a).max() for n, (a, b) in gains.items()}
    assert off[1000] < 0.05 * off[0]


def test_preview_is_worth_more_the_farther_it_reaches():
    """H2 norms of the loop with every demand met, from the impulse response."""
    norms = []
    for samples in (0, 20, 69):
        a, x, c = driven(STORAGES["h2"], samples, 1.0)
        total = 0.0
        for _ in range(4000):
            total, x = total + np.sum((c @ x) ** 2), a @ x
        norms.append(np.sqrt(total))
    assert all(b < a for a, b in pairwise(norms))


def test_a_contrary_force_is_counted():
    setting = Setting(1 / 512, 2, MEGANE, preview=4)
    law, rows = laws.PreviewStorage().start(setting), [seen(2, seed=k, ahead=4) for k in range(3)]
    law.step(rows[0])
    inner = law._inner
    met = {**rows[1], "attained": inner.base + np.array([0.5, -0.5]) * inner.wanted}
    law.step(met)
    np.testing.assert_array_equal(law.counted()["share_outside"], [0.0, 1.0])


@pytest.mark.parametrize(("settings", "message"), [({"criterion": "h3"}, "h2"), ({"back_off": 1.0}, "above 1")])
def test_settings_are_checked(settings, message: str):
    with pytest.raises(InputError, match=message):
        laws.PreviewStorage(**settings)


def test_a_car_that_does_not_come_to_rest_is_refused():
    with pytest.raises(InputError, match="come to rest"):
        preview_storage(MEGANE.replace(tyre_damping=0.0), *WEIGHTS, 0.0, 1 / 512)
