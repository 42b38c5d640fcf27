"""What every design returns: verdicts, printing, and files."""

import numpy as np
import pytest

import lpvid as lpv
from lpvid.errors import NumericalError
from lpvid.model.signals import Signal
from lpvid.synthesis.result import Synthesis


def _gain(value: float) -> lpv.LPVStateSpace:
    return lpv.LPVStateSpace(np.zeros((1, 0, 0)), np.zeros((1, 0, 1)), np.zeros((1, 1, 0)), [[[value]]],
                             lpv.Polynomial((), 0), None, inputs=(Signal("stroke", "m"),),
                             outputs=(Signal("force", "N"),))


def test_it_is_a_file_and_comes_back(tmp_path):
    result = Synthesis("solved", 1.5, 1.49, 1.2, _gain(2.0), _gain(0.1), between_grid=True, notes=("a", "b"),
                       seconds=0.25, solver="CLARABEL", method="output feedback")
    back = lpv.load(lpv.save(result, tmp_path / "synthesis.json"))
    assert back.to_dict() == result.to_dict()
    assert back.controller.D.tolist() == [[[2.0]]] and back.notes == ("a", "b")


def test_a_failure_is_never_a_controller():
    with pytest.raises(lpv.InputError, match="exactly if it succeeded"):
        Synthesis("infeasible", controller=_gain(0.0))
    with pytest.raises(lpv.InputError, match="exactly if it succeeded"):
        Synthesis("solved")
    with pytest.raises(lpv.InputError, match="verdict"):
        Synthesis("optimal_inaccurate")


def test_asking_a_failure_for_its_controller_says_why():
    result = Synthesis("unstabilisable", why="force cannot reach the state of pole 2", mend="another actuator")
    with pytest.raises(NumericalError, match=r"unstabilisable: force cannot reach.*Mend: another actuator"):
        result.required()


def test_it_prints_in_ten_lines_verdict_first():
    notes = tuple(f"remark {i}" for i in range(30))
    text = repr(Synthesis("backed-off", 1.5, 1.6, 1.2, _gain(2.0), _gain(0.1), notes=notes, why="relaxed by 6 %"))
    lines = text.splitlines()
    assert lines[0] == "backed-off: relaxed by 6 %" and len(lines) <= 10
    assert "at most 1.6" in text and "grid only" in text and "stroke -> force" in text
