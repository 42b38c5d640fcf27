"""RobustFeedback: certified gains against loops with drawn uncertainties, and the nominal design as a baseline."""

from __future__ import annotations

import numpy as np
import pytest

import lpvid as lpv


def platform(stiffness: tuple[float, float] = (1.0, 4.0)) -> lpv.GeneralizedPlant:
    """A mass on a spring; the force comes with neglected dynamics: force + p, p = Δ(force)."""
    a = [[[0, 1], [0, -0.2]], [[0, 0], [-1, 0]]]
    b = [[[0, 0, 0, 0], [1, 0, 1, 1]], np.zeros((2, 4))]
    c = [[[1, 0], [0, 0], [0, 0], [1, 0]], np.zeros((4, 2))]
    d = [[[0, 0, 0, 0], [0, 0, 0, 0.1], [0, 0, 0, 1], [0, 0.05, 0, 0]], np.zeros((4, 4))]
    box = lpv.Scheduling(("stiffness",), stiffness[:1], stiffness[1:], units=("N/m",))
    system = lpv.LPVStateSpace(a, b, c, d, lpv.Polynomial("stiffness", degree=1), None, box,
                               inputs=("push", "noise", "p", "force"), outputs=("stroke", "effort", "q", "sensor"))
    return lpv.GeneralizedPlant(system, controls=["force"], measurements=["sensor"])


def worst_drawn(loop: lpv.LPVStateSpace, bound: float) -> float:
    """Largest gain over frequencies, held stiffness and Δ = ±bound (a − s)/(a + s) or ±bound."""
    worst, s = 0.0, 1j * np.geomspace(0.05, 50, 120)
    for stiffness in np.linspace(1, 4, 7):
        a, b, c, d = loop.frozen([stiffness])
        g = c @ np.linalg.solve(s[:, None, None] * np.eye(len(a)) - a, b + 0j) + d
        for pole in (0.0, *np.geomspace(0.2, 20, 9)):
            for sign in (-1, 1):
                delta = (sign * bound * (pole - s) / (pole + s))[:, None, None]
                inner = g[:, :2, 2:] @ (delta / (1 - delta * g[:, 2:, 2:])) @ g[:, 2:, :2]
                worst = max(worst, float(np.linalg.norm(g[:, :2, :2] + inner, 2, axis=(1, 2)).max()))
    return worst


@pytest.mark.thinned(3)
@pytest.mark.parametrize(("poles", "share"), [((), 0.85), ((3.0,), 0.75)])
def test_the_certified_gain_is_lower_and_no_drawn_uncertainty_exceeds_it(poles, share):
    found = lpv.RobustFeedback(lpv.Dynamic("p", "q", 0.5), poles=poles).solve(platform())
    assert found.gain.upper < share * found.nominal.upper
    assert lpv.verify(found.gain.certificate, found.closed_loop).holds
    reached = worst_drawn(found.closed_loop, 0.5)
    assert 0.8 * found.gain.upper < reached <= found.gain.upper
    assert min(found.turns) == found.gain.upper and found.turns[0] == found.nominal.upper


@pytest.mark.slow
def test_a_loop_that_is_certified_for_part_only_is_made_robust_to_all():
    """Nothing can be certified of the nominal controller where four fifths of the force are uncertain."""
    found = lpv.RobustFeedback(lpv.Dynamic("p", "q", 0.8), poles=(3.0,), turns=3).solve(platform())
    assert found.nominal.upper == np.inf and found.solved and found.gain.upper < 1.5
    assert worst_drawn(found.closed_loop, 0.8) <= found.gain.upper


@pytest.mark.seconds
def test_without_much_uncertainty_it_is_the_nominal_design():
    found = lpv.RobustFeedback(lpv.Dynamic("p", "q", 1e-4), turns=1).solve(platform())
    assert found.gain.upper == pytest.approx(found.nominal.upper, rel=0.02)


def test_bad_blocks_are_refused():
    with pytest.raises(lpv.InputError, match="bounded in norm"):
        lpv.RobustFeedback(lpv.Sector("p", "q", 0.0, 1.0))
    with pytest.raises(lpv.InputError, match="disturbance"):
        lpv.RobustFeedback(lpv.Dynamic("elsewhere", "q", 0.1)).solve(platform())
