"""Series, parallel and side by side: against python-control's own at frozen points."""

from __future__ import annotations

import control
import numpy as np
import pytest

from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Polynomial, Spline
from lpvid.synthesis.joining import append, gain, parallel, series, summing_junction


def system(seed: int, basis, names_in: str, names_out: str, order: int = 2) -> LPVStateSpace:
    rng = np.random.default_rng(seed)
    m, nu, ny = basis.size, len(names_in), len(names_out)
    return LPVStateSpace(rng.normal(size=(m, order, order)), rng.normal(size=(m, order, nu)),
                         rng.normal(size=(m, ny, order)), rng.normal(size=(m, ny, nu)), basis, None,
                         inputs=tuple(Signal(n, "N") for n in names_in),
                         outputs=tuple(Signal(n, "m") for n in names_out))


ONE = system(1, Polynomial("p", 1), "ab", "cd")
TWO = system(2, Spline("p", 2, 1, (-1.0, 0.0, 1.0)), "cd", "ab", 3)
P = [0.4]


@pytest.mark.parametrize(("joined", "expected", "names"), [
    (series(ONE, TWO), control.series(ONE.to_control(P), TWO.to_control(P)), ("ab", "ab")),
    (series(ONE, TWO, ONE), control.series(ONE.to_control(P), TWO.to_control(P), ONE.to_control(P)), ("ab", "cd")),
    (parallel(ONE, TWO), control.parallel(ONE.to_control(P), TWO.to_control(P)), ("ab", "cd")),
    (append(ONE, TWO), control.append(ONE.to_control(P), TWO.to_control(P)), ("abcd", "cdab")),
])
def test_joined_systems_equal_those_of_python_control(joined, expected, names):
    got = joined.to_control(P)
    for s in (0.1, 2j, 1 + 30j):
        np.testing.assert_allclose(got(s), expected(s), rtol=1e-9)
    assert ("".join(s.name for s in joined.inputs), "".join(s.name for s in joined.outputs)) == names
    assert {s.unit for s in joined.inputs} == {"N"} and {s.unit for s in joined.outputs} == {"m"}


def test_a_summing_junction_and_a_gain_are_their_matrices():
    junction = summing_junction("e = r - 2 y + 1e-1*n")
    np.testing.assert_array_equal(junction.frozen([])[3], [[1.0, -2.0, 0.1]])
    assert [s.name for s in junction.inputs] == ["r", "y", "n"]
    lag = series(gain([[3.0]], ["u"], ["v"]), system(4, Polynomial(), "v", "y", 1))
    assert lag.order == 1


@pytest.mark.parametrize(("call", "message"), [
    (lambda: series(ONE, gain([[1.0]], ["x"], ["y"])), r"2 output\(s\) \(c, d\) for 1 input\(s\) \(x\)"),
    (lambda: parallel(ONE, gain([[1.0]], ["x"], ["y"])), "different numbers of signals"),
    (lambda: append(ONE, ONE), "inputs bear one name: got a, b"),
    (lambda: summing_junction("r - y"), "name for its output"),
    (lambda: summing_junction("e = "), "sum of signals is empty"),
    (lambda: gain([[1.0]], ["a", "b"], ["c"]), "shape"),
])
def test_what_does_not_fit_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()
