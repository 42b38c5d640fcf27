"""Which weight is active where, against gains computed by hand."""

import numpy as np
import pytest
from helpers.published_plants import near_integrators, quarter_car
from helpers.synthesis_plants import ill_conditioned, scherer

import lpvid as lpv
from lpvid.lmi.program import Program
from lpvid.model.signals import Signal
from lpvid.synthesis.design_log import limiting, limits


def _resonances():
    """Two resonances side by side: "comfort" at 1.4 Hz, "grip" at 11 Hz, the second of them heavier for large p."""
    a, b, c = np.zeros((2, 4, 4)), np.zeros((2, 4, 1)), np.zeros((2, 2, 4))
    for k, (hertz, height) in enumerate(((1.4, 0.2), (11.0, 0.1))):
        w, i = 2 * np.pi * hertz, 2 * k
        a[0, i : i + 2, i : i + 2] = [[0, 1], [-w * w, -2 * 0.05 * w]]
        b[0, i + 1, 0], c[0, k, i] = 1.0, height * w * w  # peak about height/(2·0.05)
    c[1, 1, 2] = 0.8 * c[0, 1, 2]  # grip: 1 + 0.8 p
    box = lpv.Scheduling(("p",), (-1.0,), (1.5,), (None,), ("kg",))
    return lpv.LPVStateSpace(a, b, c, np.zeros((2, 2, 1)), lpv.Polynomial("p", 1), None, box,
                             inputs=(Signal("road"),), outputs=(Signal("comfort"), Signal("grip")))


def test_the_signal_and_its_frequency_are_named():
    found = limits(_resonances())
    assert [x.where for x in found if "comfort" in str(x)] and found[0].gain >= found[-1].gain
    top = found[0]
    assert top.signals[0][0] == "grip" and top.at == (("p", 1.5, "kg"),)  # 0.1·2.2/0.1 = 2.2 against 0.2/0.1 = 2
    assert top.frequency == pytest.approx(11.0, rel=0.01) and top.gain == pytest.approx(2.2, rel=0.01)
    low = next(x for x in found if x.at[0][1] == -1.0)
    assert low.signals[0][0] == "comfort" and low.frequency == pytest.approx(1.4, rel=0.01)
    assert low.gain == pytest.approx(2.0, rel=0.01) and sum(share for _, share in low.signals) == pytest.approx(1.0)
    assert limiting(found, 3.0).startswith("grip at 11 Hz with p = 1.5 kg limits gamma: 2.2")


def test_frequencies_of_a_sampled_loop_are_hertz():
    """A resonance at 2 Hz sampled at 50 Hz."""
    r, angle = 0.97, 2 * np.pi * 2.0 * 0.02
    a = r * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    loop = lpv.LPVStateSpace(a[None], [[[0.0], [1.0]]], [[[1.0, 0.0]]], [[[0.0]]], lpv.Polynomial((), 0), 0.02,
                             inputs=(Signal("road"),), outputs=(Signal("comfort"),))
    assert limits(loop)[0].frequency == pytest.approx(2.0, rel=0.05)


@pytest.mark.seconds
def test_shares_are_those_of_the_worst_input():
    found = lpv.synthesize(quarter_car(), lpv.OutputFeedback())
    for limit in limits(found.closed_loop):
        a, b, c, d = found.closed_loop.frozen([v for _, v, _ in limit.at])
        s = 2j * np.pi * limit.frequency
        response = c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + d
        z = response @ np.linalg.svd(response)[2][0].conj()
        shares = dict(limit.signals)
        assert np.allclose(np.abs(z) ** 2 / (np.abs(z) ** 2).sum(), [shares[n.name] for n in found.closed_loop.outputs])
        assert limit.gain <= found.gamma_verified * (1 + 1e-9)


@pytest.fixture
def in_rounds(monkeypatch):
    """As with a solver that gives no dual matrices: the least bound takes a second round, to be found again."""
    monkeypatch.setattr(Program, "floor", lambda *_: -np.inf)


@pytest.mark.seconds
def test_progress_says_what_is_done_and_how_long_it_takes(in_rounds):
    stated: list[str] = []
    found = lpv.synthesize(quarter_car(), lpv.OutputFeedback(), progress=stated.append)
    assert found.verdict == "solved"
    assert any("the least gain" in x and "so far" in x and "at most" in x for x in stated)
    assert any("verifying" in x for x in stated)


@pytest.mark.seconds
def test_an_interruption_keeps_the_bound_so_far(in_rounds):
    """Ctrl-C in the second round: the controller of the first is written down and verified."""
    def stop(text: str) -> None:
        if "round 2" in text and "least gain" in text:
            raise KeyboardInterrupt

    plain = lpv.synthesize(quarter_car(), lpv.OutputFeedback())
    found = lpv.synthesize(quarter_car(), lpv.OutputFeedback(), progress=stop)
    assert found.solved and "interrupted after" in found.notes[0]
    assert plain.gamma_verified * 0.99 <= found.gamma_verified <= 1.3 * plain.gamma_verified


@pytest.mark.seconds
@pytest.mark.thinned(2)
@pytest.mark.parametrize("make", [lambda: near_integrators(1e-2), ill_conditioned])
def test_an_interruption_after_the_first_bound_leaves_a_controller(make, in_rounds):
    """Ctrl-C at any stage once there is a bound: while matrices are conditioned, while verifying."""
    stated: list[str] = []
    plain = lpv.synthesize(make(), lpv.OutputFeedback(), progress=stated.append)
    first = next(k for k, text in enumerate(stated) if "so far" in text)
    for last in range(first, len(stated)):
        found = lpv.synthesize(make(), lpv.OutputFeedback(), progress=_interrupting(last))
        assert "interrupted after" in found.notes[0], stated[last]
        assert 0.99 * plain.infimum <= found.gamma_verified <= 1.12 * plain.infimum, stated[last]


def _interrupting(last):
    """Takes what is being done, and raises once, at the stage of that number."""
    count = iter(range(last + 1))

    def stop(_):
        if next(count, None) == last:
            raise KeyboardInterrupt

    return stop


def test_an_interruption_before_there_is_anything_is_handed_on():
    def stop(text: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        lpv.synthesize(scherer(), lpv.OutputFeedback(), progress=stop)
