"""Worst-case gains of uncertain systems: closed forms, the scheduling route as oracle, and limits that must show."""

import json

import numpy as np
import pytest

import lpvid as lpv
from lpvid.analysis.frozen_norms import h_infinity_norm
from lpvid.analysis.robust_certificate import RobustCertificate
from lpvid.analysis.uncertain_blocks import block_from_dict

ONE = lpv.Polynomial((), 0)


def system(a, b, c, sample_time=None):
    """Inputs p, w and outputs q, z without feedthrough."""
    return lpv.LPVStateSpace([a], [b], [c], np.zeros((1, 2, 2)), ONE, sample_time, inputs=("p", "w"),
                             outputs=("q", "z"))


LAG = system([[-1.0]], [[1.0, 1.0]], [[1.0], [1.0]])
OSCILLATOR = system([[0, 1.0], [-1, -0.4]], [[0, 0], [-1, 1.0]], [[1.0, 0], [1.0, 0]])


@pytest.mark.seconds
@pytest.mark.parametrize("block", [lpv.Parametric("p", "q", 0.5), lpv.Parametric("p", "q", 0.5, moving=True),
                                   lpv.Dynamic("p", "q", 0.5), lpv.Sector("p", "q", -0.5, 0.5),
                                   lpv.Lipschitz("p", "q", 0.5)])
def test_lag_with_uncertain_pole(block):
    """1/(s + 1 − δ) with |δ| ≤ ½: 2 for every kind, for the worst is a constant."""
    found = lpv.robust_gain(LAG, block)
    assert found.verdict == "certified"
    assert found.upper == pytest.approx(2.0, rel=1e-4)
    assert 1.99 < found.lower <= found.upper
    assert lpv.verify(found.certificate, LAG).holds


@pytest.mark.seconds
def test_constant_stiffness_is_the_worst_frozen_one():
    """Lightly damped: filters make the bound of a constant tight; a moving one pumps and is worse."""
    worst = max(h_infinity_norm((np.array([[0, 1], [-1 - d, -0.4]]), np.array([[0], [1.0]]), np.array([[1.0, 0]]),
                                 np.zeros((1, 1))))[0] for d in np.linspace(-0.3, 0.3, 61))
    still = lpv.robust_gain(OSCILLATOR, lpv.Parametric("p", "q", 0.3))
    assert worst <= still.upper <= 1.001 * worst
    moving = lpv.robust_gain(OSCILLATOR, lpv.Parametric("p", "q", 0.3, moving=True))
    assert moving.upper > 2 * still.upper


@pytest.mark.seconds
@pytest.mark.parametrize("sample_time", [None, 0.2])
def test_moving_parameter_is_one_more_scheduling_variable(sample_time):
    """ẋ = A(s)x + δ B_p C_q x + B_w w by l2_gain with δ as scheduling, against δ as an uncertainty."""
    a0, a1 = np.array([[0, 1.0], [-1, -1.0]]), np.array([[0, 0], [-0.2, 0.0]])
    bp, bw, c = np.array([[0.0], [1.0]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.5]])
    if sample_time is not None:
        a0, a1, bp, bw = np.eye(2) + sample_time * a0, sample_time * a1, sample_time * bp, sample_time * bw
    box = lpv.Scheduling(("s",), (-1.0,), (1.0,))
    zero = np.zeros((2, 2, 2))
    model = lpv.LPVStateSpace([a0, a1], [np.hstack([bp, bw]), np.zeros((2, 2))], [np.vstack([c, c]), np.zeros((2, 2))],
                              zero, lpv.Polynomial("s", 1), sample_time, box, inputs=("p", "w"), outputs=("q", "z"))
    found = lpv.robust_gain(model, lpv.Parametric("p", "q", 0.25, moving=True), basis=ONE)
    wide = lpv.Scheduling(("s", "d"), (-1.0, -0.25), (1.0, 0.25))
    scheduled = lpv.LPVStateSpace([a0, a1, bp @ c], [bw, 0 * bw, 0 * bw], [c, 0 * c, 0 * c], np.zeros((3, 1, 1)),
                                  lpv.Polynomial(("s", "d"), 1), sample_time, wide)
    oracle = lpv.l2_gain(scheduled, basis=ONE, trajectories=False)
    assert found.verdict == "certified"
    assert oracle.lower <= found.upper
    assert 0.999 * oracle.upper <= found.upper <= 1.05 * oracle.upper     # multipliers do not move with s


@pytest.mark.seconds
def test_delay():
    """ẋ = −x(t − τ) + w is stable for τ < π/2 only: the bound holds below, and nothing is promised beyond."""
    loop = system([[0.0]], [[-1.0, 1.0]], [[1.0], [1.0]])
    omega = np.linspace(1e-3, 10, 4000)
    for tau in (0.3, 0.7):
        exact = max(np.abs(1 / (1j * omega + np.exp(-1j * omega * t))).max() for t in np.linspace(0, tau, 5))
        found = lpv.robust_gain(loop, lpv.Delay("p", "q", tau))
        assert exact <= found.upper <= 1.15 * exact
        assert found.lower <= exact * 1.001
    assert lpv.robust_gain(loop, lpv.Delay("p", "q", 1.6)).verdict == "not certified"


@pytest.mark.seconds
def test_slope_is_worth_more_than_a_sector():
    """Circle criterion against Zames-Falb multipliers on a lightly damped oscillator; linear slopes reach `lower`."""
    loop = system([[0, 1.0], [-1, -0.2]], [[0, 0], [-1, 1.0]], [[1.0, 0], [1.0, 0]])
    circle = lpv.robust_gain(loop, lpv.Sector("p", "q", 0, 0.3), poles=(1.0,))
    falb = lpv.robust_gain(loop, lpv.Sector("p", "q", 0, 0.3, slope=True), poles=(1.0,))
    assert falb.upper < 0.6 * circle.upper
    assert falb.lower <= falb.upper
    beyond = lpv.robust_gain(loop, lpv.Sector("p", "q", 0, 5.0), poles=(1.0,))
    assert beyond.verdict == "not certified" and "range" in beyond.mend


@pytest.mark.seconds
def test_what_is_not_certified_still_has_a_lower_bound():
    """Largest gains are those without uncertainty: 1/(s+1)³ at rest, 1/(2ζ√(1 − ζ²)) of the oscillator with ζ = 0.1."""
    cube = system([[-1.0, 0, 0], [1, -1, 0], [0, 1, -1]], [[-1.0, 1.0], [0, 0], [0, 0]], [[0, 0, 1.0], [0, 0, 1.0]])
    shaky = system([[0, 1.0], [-1, -0.2]], [[0, 0], [-1, 1.0]], [[1.0, 0], [1.0, 0]])
    for loop, block, least in ((cube, lpv.Sector("p", "q", 0, 7.9), 1.0),
                               (shaky, lpv.Sector("p", "q", 0, 5.0), 1 / (0.2 * np.sqrt(0.99)))):
        found = lpv.robust_gain(loop, block, poles=(1.0,))
        assert found.verdict == "not certified"
        assert least * (1 - 1e-9) <= found.lower < np.inf
        assert f"at least {found.lower:.6g}" in repr(found)


@pytest.mark.parametrize("block", [lpv.Parametric("p", "q", 1.0), lpv.Parametric("p", "q", 1.2, moving=True),
                                   lpv.Sector("p", "q", 0, 1.1), lpv.Lipschitz("p", "q", 1.01),
                                   lpv.Dynamic("p", "q", 1.0)])
def test_an_admissible_uncertainty_that_destabilises_makes_the_worst_case_infinite(block):
    """1/(s + 1 − δ) is unstable from δ = 1 on."""
    found = lpv.robust_gain(LAG, block)
    assert found.verdict == "not certified" and found.lower == np.inf
    assert "unstable" in repr(found)
    assert type(found).from_dict(json.loads(json.dumps(found.to_dict()))).lower == np.inf


@pytest.mark.seconds
def test_neglected_dynamics_destabilise_from_the_small_gain_on():
    """The largest gain from p to q is 1/(2ζ√(1 − ζ²)), ζ = 0.2, at its resonance, where no constant is the worst."""
    limit = 0.4 * np.sqrt(0.96)
    assert lpv.robust_gain(OSCILLATOR, lpv.Dynamic("p", "q", 1.001 * limit)).lower == np.inf
    below = lpv.robust_gain(OSCILLATOR, lpv.Dynamic("p", "q", 0.9 * limit))
    assert 1 / limit <= below.lower <= below.upper < np.inf


@pytest.mark.seconds
def test_a_simulated_nonlinearity_keeps_the_bound():
    """Runs of the loop with a saturation in the sector, over random inputs: ‖z‖ ≤ γ‖w‖ in every one."""
    found = lpv.robust_gain(OSCILLATOR, lpv.Sector("p", "q", 0.0, 0.5, slope=True, odd=True), poles=(0.5, 2.0))
    assert np.isfinite(found.upper)
    generator, step, worst = np.random.default_rng(5), 0.01, 0.0
    a, b, c, _ = OSCILLATOR.frozen([])
    for _ in range(10):
        omega = generator.uniform(0.7, 1.3)
        x, into, out = np.zeros(2), 0.0, 0.0
        for k in range(4000):
            w = generator.choice([0.2, 3.0]) * np.sin(omega * k * step) if k < 2500 else 0.0

            def flow(x, w=w):
                return a @ x + b @ np.array([0.5 * np.clip((c @ x)[0], -1, 1), w])

            k1 = flow(x)
            k2 = flow(x + 0.5 * step * k1)
            x = x + step * k2
            into, out = into + w**2, out + (c @ x)[1] ** 2
        worst = max(worst, np.sqrt(out / into))
    assert 0.3 * found.upper < worst < found.upper


@pytest.mark.seconds
def test_certificate_survives_json_and_not_tampering():
    found = lpv.robust_gain(LAG, [lpv.Dynamic("p", "q", 0.5)])
    data = json.loads(json.dumps(found.to_dict()))
    again = type(found).from_dict(data).certificate
    assert isinstance(again, RobustCertificate) and lpv.verify(again, LAG).holds
    for change in ({"gamma": 1.9}, {"multipliers": [[[[-1.0, 0.0], [0.0, -1.0]]]]},
                   {"blocks": [lpv.Dynamic("p", "q", 0.9).to_dict()]}):
        assert not lpv.verify(RobustCertificate.from_dict({**data["certificate"], **change}), LAG).holds
    other = system([[-0.9]], [[1.0, 1.0]], [[1.0], [1.0]])
    assert not lpv.verify(again, other).holds


@pytest.mark.parametrize("block", [lpv.Parametric(("p", "w"), ("q", "z"), 0.3), lpv.Dynamic("p", ("q", "z"), 0.3),
                                   lpv.Sector("p", "q", -1, 2, slope=True, odd=True), lpv.Delay("p", "q", 0.3),
                                   lpv.Lipschitz("p", ("q", "z"), 0.3)])
def test_constraints_hold_along_runs(block):
    """∫ rᵀMr ≥ 0 over every horizon for random admissible multipliers, signals and Δ: what the proofs rest on."""
    generator, step, poles = np.random.default_rng(2), 2e-3, (0.7, 4.0)
    a, b, c, d = block.filter(poles, None)
    nq, n_p, steps = len(block.outputs), len(block.inputs), 6000
    t = step * np.arange(steps)
    q = np.stack([sum(generator.standard_normal() * np.sin(generator.uniform(0.1, 6) * t + generator.uniform(0, 6))
                      for _ in range(5)) * np.minimum(t, 1) for _ in range(nq)], axis=1)
    if isinstance(block, lpv.Parametric):
        p = -0.28 * q
    elif isinstance(block, lpv.Delay):
        p = np.vstack([np.zeros((100, nq)), q[:-100]])          # 0.2 s
    elif isinstance(block, lpv.Sector):
        p = 2.0 * np.clip(q, -0.3, 0.3) - 1.0 * (q - np.clip(q, -0.3, 0.3))
    elif isinstance(block, lpv.Lipschitz):
        p = 0.28 * np.linalg.norm(q, axis=1, keepdims=True) * np.sign(np.sin(3 * t))[:, None]
    else:                                                        # 0.3 (2 − s)/(2 + s) of a unit combination
        v, x, p = q @ np.array([0.6, 0.8]), 0.0, np.zeros((steps, n_p))
        for k in range(steps):
            p[k] = 0.3 * (2 * x - v[k])
            x += step * 2 * (v[k] - x)
    x, r = np.zeros(len(a)), np.zeros((steps, len(c)))
    for k in range(steps):
        u = np.concatenate([q[k], p[k]])
        r[k] = c @ x + d @ u
        x = x + step * (a @ x + b @ u)
    from lpvid.analysis.robust_certificate import given

    for _ in range(6):
        parts = []
        for kind, size in block.unknowns(poles):
            m = generator.standard_normal((size, size))
            parts.append(given(m @ m.T if kind.startswith("symmetric") else m - m.T))
        supply = np.einsum("ki,ij,kj->k", r, block.multiplier(parts, poles).constant, r)
        assert np.cumsum(supply).min() >= -0.01 * np.abs(supply).sum()
    assert block_from_dict(json.loads(json.dumps(block.to_dict()))) == block


def test_bad_input_in_one_line():
    with pytest.raises(lpv.InputError, match="needs blocks of uncertainty"):
        lpv.robust_gain(LAG, [])
    with pytest.raises(lpv.InputError, match="output"):
        lpv.robust_gain(LAG, lpv.Dynamic("p", "nothing", 0.1))
    with pytest.raises(lpv.InputError, match="drive one input"):
        lpv.robust_gain(LAG, [lpv.Dynamic("p", "q", 0.1), lpv.Parametric("p", "q", 0.1)])
    with pytest.raises(lpv.InputError, match="not stable without uncertainty"):
        lpv.robust_gain(system([[0.1]], [[1.0, 1.0]], [[1.0], [1.0]]), lpv.Dynamic("p", "q", 0.1))
    with pytest.raises(lpv.InputError, match="as many inputs as outputs"):
        lpv.Parametric("p", ("q", "z"), 0.1)
    with pytest.raises(lpv.InputError, match="stated in continuous time"):
        lpv.robust_gain(system([[0.5]], [[1.0, 1.0]], [[1.0], [1.0]], 0.1), lpv.Delay("p", "q", 0.1))
