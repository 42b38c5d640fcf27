"""What output feedback refuses, in the words of the plant's signals."""

import re

import numpy as np
import pytest
from helpers.badly_scaled_plants import random_case
from helpers.synthesis_plants import column, plant, scherer
from scipy.linalg import block_diag

import lpvid as lpv
from lpvid.errors import ExtrapolationWarning, InputError
from lpvid.model.signals import Signal
from lpvid.synthesis.assumptions import fault_of
from lpvid.synthesis.interconnection import close_loop


def _named(**changes):
    """A car body on a spring: road in, force to choose, stroke measured; one block changed."""
    blocks = {"A": [[0.0, 1.0], [-2.0, 0.3]], "B": [[0.0, 0.0, 0.0], [1.0, 0.0, 1.0]],
              "C": [[1.0, 0.0], [0.0, 0.0], [1.0, 0.0]], "D": [[0.0, 0, 0], [0, 0, 0.3], [0, 0.1, 0]]} | changes
    blocks = {k: np.asarray(v, dtype=float) for k, v in blocks.items()}
    blocks = {k: v if v.ndim == 3 else v[None] for k, v in blocks.items()}
    count = max(len(v) for v in blocks.values())
    blocks = {k: np.concatenate([v, np.zeros((count - len(v), *v.shape[1:]))]) for k, v in blocks.items()}
    system = lpv.LPVStateSpace(**blocks, basis=lpv.Polynomial("speed", 1) if count > 1 else lpv.Polynomial((), 0),
                               sample_time=None,
                               inputs=(Signal("road", "m"), Signal("noise", "m"), Signal("force", "N")),
                               outputs=(Signal("comfort"), Signal("effort"), Signal("stroke", "m")))
    return lpv.GeneralizedPlant(system, ["force"], ["stroke"])


@pytest.mark.seconds
def test_the_plant_itself_is_fine_and_keeps_its_names():
    result = lpv.synthesize(_named(), lpv.OutputFeedback())
    assert result.solved
    assert [str(s) for s in result.controller.inputs] == ["stroke [m]"]
    assert [str(s) for s in result.controller.outputs] == ["force [N]"]
    assert [s.name for s in result.closed_loop.inputs] == ["road", "noise"]


def test_unstabilisable():
    lost = _named(A=block_diag([[0.0, 1.0], [-2.0, 0.3]], 0.7), B=[[0, 0, 0], [1, 0, 1], [1, 0, 0]],
                  C=[[1, 0, 0.1], [0, 0, 0], [1, 0, 1]])
    result = lpv.synthesize(lost, lpv.OutputFeedback())
    assert result.verdict == "unstabilisable" and result.controller is None
    assert "force" in result.why and "0.7" in result.why and "actuator" in result.mend


def test_undetectable():
    hidden = _named(A=block_diag([[0.0, 1.0], [-2.0, 0.3]], 0.7), B=[[0, 0, 0], [1, 0, 1], [1, 0, 1]],
                    C=[[1, 0, 0.1], [0, 0, 0], [1, 0, 0]])
    result = lpv.synthesize(hidden, lpv.OutputFeedback())
    assert result.verdict == "undetectable" and "stroke" in result.why and "sensor" in result.mend


def test_an_integrator_in_a_weight_is_told_from_a_missing_actuator():
    weighted = _named(A=block_diag([[0.0, 1.0], [-2.0, 0.3]], 0.0),
                      B=[[0, 0, 0], [1, 0, 1], [1, 0, 0]], C=[[1, 0, 1], [0, 0, 0], [1, 0, 0]])
    result = lpv.synthesize(weighted, lpv.OutputFeedback())
    assert result.verdict in ("unstabilisable", "undetectable") and "slow pole" in result.mend


def test_at_one_value_of_the_scheduling_only():
    """The force loses its grip exactly at speed = 1, where the spring is unstable."""
    a = [[[0, 1], [2, -0.3]], [[0, 0], [0, 0]]]
    b = [[[0, 0, 0], [1, 0, 1.0]], [[0, 0, 0], [0, 0, -1.0]]]
    result = lpv.synthesize(_named(A=a, B=b, C=[[1, 0], [0, 0], [1, 0]]), lpv.OutputFeedback())
    assert result.verdict == "unstabilisable" and "speed = 1" in result.why


def _crossing(at: float, more: int = 1):
    """x1' = 0.5 x1 + (p − at) x2 and x2' = −x2 + u: vᵀb = (p − at)/1.5, zero at one p, which no corner is."""
    a = [[[0.5, -at], [0, -1]], [[0, 1], [0, 0]]]
    b = np.hstack([[[1.0], [0]], np.zeros((2, 1)), [[0.0], [1]], np.full((2, more - 1), 1.0)])[None]
    c = np.array([[[1.0, 0], [0, 0], [1, 0]]])
    d = np.hstack([[[0.0, 0, 0], [0, 0, 0.3], [0, 0.1, 0]], np.zeros((3, more - 1))])[None]
    forces = [f"force{k}" for k in range(more)]
    system = lpv.LPVStateSpace(a, *(np.concatenate([m, 0 * m]) for m in (b, c, d)), lpv.Polynomial("p", 1), None,
                               lpv.Scheduling(("p",), (-1.0,), (1.0,)), inputs=("push", "noise", *forces),
                               outputs=("stroke", "effort", "sensor"))
    return lpv.GeneralizedPlant(system, forces, ["sensor"])


@pytest.mark.parametrize("design", [lpv.OutputFeedback(), lpv.MultiObjective(), lpv.LFTFeedback()],
                         ids=["output-feedback", "multi-objective", "lft"])
def test_a_mode_that_one_control_loses_between_the_points_of_the_grid(design):
    found = lpv.synthesize(_crossing(0.3127), design)
    assert found.verdict == "unstabilisable" and "p = 0.3127," in found.why and "pole 0.5" in found.why


def test_what_two_controls_reach_and_what_is_lost_outside_the_box_is_no_fault():
    for case in (_crossing(0.3127, more=2), _crossing(1.0001)):
        points = case.box.grid(2)
        assert fault_of(case, case.at(points), points, between=True) is None


@pytest.mark.parametrize("seed", [1088, 1104])
def test_random_plants_that_were_numerical_are_lost_between_the_points(seed):
    """One control, a real pole, a table of nine knots: the place is checked by the rank of [A − λI, B]."""
    case, design, _ = random_case(seed)
    found = lpv.synthesize(case, design)
    assert found.verdict == "unstabilisable"
    p = float(re.search(r"p = (\S+),", found.why)[1])
    near = [case.at(np.array([[q]])).point(0) for q in (p - 1e-3, p + 1e-3)]
    sides = []
    for m in near:
        poles, left = np.linalg.eig(m.A.T)
        k = int(np.argmax(np.where(poles.imag == 0, poles.real, -np.inf)))
        v = left[:, k].real
        sides.append(float(v @ m.B2[:, 0]) * np.sign(v[np.argmax(np.abs(v))]))
    assert sides[0] * sides[1] < 0


def test_reversed_polarity():
    """The force pushes at one end of the box and pulls at the other."""
    b = [[[0, 0, 0], [1, 0, 0.2]], [[0, 0, 0], [0, 0, 1.0]]]
    d = [[[0, 0, 0], [0, 0, 0], [0, 0.1, 0]]]
    with pytest.raises(lpv.InputError, match=r"'force' acts in opposite dir.*reversed polarity.*sign of 'force'"):
        lpv.synthesize(_named(B=b, D=d), lpv.OutputFeedback())
    c = [[[1, 0], [0, 0], [0.2, 0]], [[0, 0], [0, 0], [1, 0]]]
    with pytest.raises(lpv.InputError, match=r"'stroke' changes its sign"):
        lpv.synthesize(_named(C=c, D=[[0, 0, 0], [0, 0, 0.3], [0, 0, 0]]), lpv.OutputFeedback())


def test_dead_signals():
    with pytest.raises(lpv.InputError, match="'force' has no effect"):
        lpv.synthesize(_named(B=[[0, 0, 0], [1, 0, 0]], D=[[0, 0, 0], [0, 0, 0], [0, 0.1, 0]]), lpv.OutputFeedback())
    with pytest.raises(lpv.InputError, match="'stroke' depends on no state"):
        lpv.synthesize(_named(C=[[1, 0], [0, 0], [0, 0]], D=[[0, 0, 0], [0, 0, 0.3], [0, 0, 0]]), lpv.OutputFeedback())


def test_wrong_nouns():
    with pytest.raises(lpv.InputError, match=r"needs a GeneralizedPlant.*LPVStateSpace"):
        lpv.synthesize(_named().system, lpv.OutputFeedback())
    with pytest.raises(lpv.InputError, match="needs a design"):
        lpv.synthesize(_named(), "hinf")
    with pytest.raises(lpv.InputError, match="needs a design"):
        lpv.synthesize(_named(), lpv.OutputFeedback)


@pytest.mark.parametrize(("settings", "message"), [
    ({"varying": "X"}, "varying must be one of"), ({"back_off": -0.1}, "share between 0 and 1"),
    ({"bound": 0.0}, "must be positive"), ({"points": 1}, "at least 2")])
def test_settings(settings, message):
    with pytest.raises(lpv.InputError, match=message):
        lpv.OutputFeedback(**settings)


def test_regions_and_a_varying_lyapunov_matrix_exclude_each_other():
    with pytest.raises(lpv.InputError, match="pole regions need constant"):
        lpv.OutputFeedback(lpv.Polynomial("speed", 1), regions=lpv.HalfPlane(0.1))


def test_a_lyapunov_matrix_over_what_the_plant_does_not_read():
    with pytest.raises(lpv.InputError, match=r"no scheduling variable 'load'.*"):
        lpv.synthesize(_named(), lpv.OutputFeedback(lpv.Polynomial("load", 1)))
    varying = _named(A=[[[0, 1], [-2, 0.3]], [[0, 0], [-1, 0]]])
    with pytest.raises(lpv.InputError, match=r"'speed'.*rate has no bound"):
        lpv.synthesize(varying, lpv.OutputFeedback(lpv.Polynomial("speed", 1)))
    with pytest.raises(lpv.InputError, match="no scheduling variable 'sped'"):
        lpv.synthesize(varying, lpv.OutputFeedback(rate={"sped": 1.0}))


def test_infeasible_names_the_weights():
    result = lpv.synthesize(_named(), lpv.OutputFeedback(bound=1e-3))
    assert result.verdict == "infeasible" and "comfort, effort" in result.mend and result.gamma is None


@pytest.mark.seconds
def test_mismatched_names_of_signals():
    p = _named()
    result = lpv.synthesize(p, lpv.OutputFeedback())
    other = result.controller.replace(inputs=(Signal("speed"),))
    with pytest.raises(lpv.InputError, match=r"inputs of the controller.*speed.*stroke"):
        close_loop(p, other)


@pytest.mark.seconds
def test_pole_regions_are_kept():
    result = lpv.synthesize(scherer(), lpv.OutputFeedback(regions=lpv.HalfPlane(0.8)))
    assert result.solved
    assert result.closed_loop.frozen_poles([]).real.max() < -0.8


def test_outside_the_box_the_controller_is_flagged_by_validation():
    """simulate runs on, as everywhere; the share of samples outside the box is what validate reports."""
    a = [[[1, 0.1], [-0.2, 0.98]], [[0, 0], [-0.1, 0]]]
    p = plant(a, [[[0, 0], [0.1, 0]], np.zeros((2, 2))], [[[0], [0.1]], np.zeros((2, 1))],
              [[[1, 0], [0, 0]], np.zeros((2, 2))], np.zeros((2, 2, 2)), [column(0, 0.3), column(0, 0)],
              [[[1, 0]], np.zeros((1, 2))], [[[0, 0.1]], np.zeros((1, 2))], lpv.Polynomial("p", 1),
              lpv.Scheduling(("p",), (-1.0,), (1.0,)), sample_time=0.1)
    k = lpv.synthesize(p, lpv.OutputFeedback()).required()
    assert k.box.contains(np.array([[0.5], [1.5]])).tolist() == [True, False]
    t = np.arange(40)
    record = lpv.Record({"y1": np.sin(t), "p": np.where(t < 30, 0.5, 1.5), "u1": np.cos(t)}, sample_time=0.1)
    with pytest.warns(ExtrapolationWarning, match="25 % of the samples"):
        assert lpv.validate(k, [record]).extrapolation_share == pytest.approx(0.25)


@pytest.mark.parametrize("lacking", ["control", "measurement"])
def test_a_plant_without_control_or_measurement(lacking):
    whole = _named()
    bare = lpv.GeneralizedPlant(whole.system, () if lacking == "control" else whole.controls,
                                () if lacking == "measurement" else whole.measurements)
    with pytest.raises(InputError, match=f"needs a {lacking}: got a plant without {lacking}s"):
        lpv.synthesize(bare, lpv.OutputFeedback())


def test_one_name_for_two_signals():
    system = _named().system
    twice = system.replace(inputs=(Signal("force"), Signal("noise"), Signal("force")))
    with pytest.raises(InputError, match="two inputs of a plant bear one name"):
        lpv.GeneralizedPlant(twice, ["force"], ["stroke"])


def test_a_weight_on_the_control_does_not_hide_that_its_polarity_turns_over():
    """B2 = [0, speed]: at speed 0 the force has no authority, though its effort is weighed everywhere."""
    b = [[[0, 0, 0], [1, 0, 0]], [[0, 0, 0], [0, 0, 1]]]
    turned = lpv.GeneralizedPlant(_named(B=b).system.replace(
        scheduling=lpv.Scheduling(("speed",), (-1.0,), (1.0,))), ["force"], ["stroke"])
    with pytest.raises(InputError, match="'force' acts in opposite directions"):
        lpv.synthesize(turned, lpv.OutputFeedback())
