"""Plants from functions and from grids: exact at knots, errors stated, promises that hold for the function itself."""

import control
import numpy as np
import pytest
from scipy.io import savemat

import lpvid as lpv
from lpvid.analysis.frozen_norms import h_infinity_norm
from lpvid.synthesis.generalized_plant import PlantMatrices
from lpvid.synthesis.interconnection import close_loop_at
from lpvid.synthesis.joining import gain

SIGNALS = {"inputs": ["push", "noise", "force"], "outputs": ["stroke", "effort", "sensor"]}


def _matrices(p):
    """A mode whose stiffness and damping go with 1/p."""
    return (np.array([[-1 / p, 1.0], [-0.5, -0.3 / p]]), np.array([[1.0, 0, 0], [0.3, 0, 1]]),
            np.array([[1.0, 0], [0, 0], [0, 1]]), np.array([[0, 0, 0], [0, 0, 0.3], [0, 0.05, 0]]))


def _true_gain(controller, points):
    """Largest frozen gain with the function's own matrices."""
    worst = 0.0
    for p in points:
        a, b, c, d = _matrices(p)
        plant = PlantMatrices(a, b[:, :2], b[:, 2:], c[:2], d[:2, :2], d[:2, 2:], c[2:], d[2:, :2], d[2:, 2:])
        worst = max(worst, h_infinity_norm(close_loop_at(plant, *controller.frozen([p])), False)[0])
    return worst


def test_the_table_of_a_function_misses_it_by_no_more_than_stated():
    system = lpv.from_function(_matrices, {"p": (0.2, 2.0)}, tolerance=2e-3, **SIGNALS)
    about = system.metadata["interpolation"]
    assert about["error"] <= 2e-3 and system.order == 2
    size = np.abs(_matrices(0.2)[0]).max(axis=None)
    for p in np.random.default_rng(0).uniform(0.2, 2.0, 200):
        for mine, true in zip(system.frozen([p]), _matrices(p), strict=True):
            assert np.abs(mine - true).max() <= 1.1 * about["error"] * max(size, 1.0)
    for knot in about["knots"]["p"]:
        np.testing.assert_allclose(system.frozen([knot])[0], _matrices(knot)[0], atol=1e-12)


def test_an_affine_function_needs_no_more_than_its_ends():
    system = lpv.from_function(lambda p: ([[-1 - p]], [[1.0]], [[1.0]], [[0.0]]), {"p": (0.0, 1.0)}, points=2)
    assert system.metadata["interpolation"]["knots"]["p"] == [0.0, 1.0]
    assert system.metadata["interpolation"]["error"] < 1e-12 and "finer" not in system.metadata["interpolation"]


def test_two_variables_and_python_control_systems():
    def of(p):
        return control.ss([[-1 - p[0] * p[1]]], [[1.0]], [[np.sin(p[1])]], [[0.0]], inputs=["w"], outputs=["z"])

    system = lpv.from_function(of, {"p": (0.0, 1.0), "q": (0.0, 1.5)}, tolerance=5e-3)
    assert [s.name for s in system.inputs] == ["w"]
    for p in np.random.default_rng(1).uniform([0, 0], [1, 1.5], (50, 2)):
        assert abs(system.frozen(p)[2][0, 0] - np.sin(p[1])) < 6e-3


@pytest.mark.slow
def test_the_promise_holds_for_the_function_and_not_for_its_table_alone():
    """1/p on nine evenly spaced points: between the first two the table is off by a fifth."""
    grid = lpv.from_grid({p: _matrices(p) for p in np.linspace(0.1, 2.0, 9)}, tolerance=0.03, **SIGNALS)
    coarse = lpv.from_function(_matrices, {"p": (0.1, 2.0)}, tolerance=0.1, **SIGNALS)
    for system in (grid, coarse):
        found = lpv.synthesize(lpv.GeneralizedPlant(system, ["force"], ["sensor"]), lpv.OutputFeedback())
        assert found.solved and "its own values" in found.notes[0]
        assert lpv.verify(found.certificate, found.closed_loop).holds
        if system is coarse:
            assert _true_gain(found.controller, np.geomspace(0.1, 2.0, 300)) <= found.gamma_verified
    assert grid.metadata["interpolation"]["error"] > 0.02  # leaving out every second point shows it


@pytest.mark.seconds
def test_a_loop_of_fine_tables_has_no_more_functions_than_it_needs():
    """B2(v) D_K(v) C2(v) over tables of 61 and 15 functions: 55,815 products, whose coefficients take 25 GB."""
    def of(v):
        return ([[-50 / v, 1 / v - 1], [20.0, -80 / v]], [[0, 0, 40 / v], [1, 0, 30]], [[0, 1], [0, 0], [5 / v, 1]],
                [[0, 0, 0], [0, 0, 0.3], [0, 0.1, 0]])

    system = lpv.from_function(of, {"v": (10.0, 40.0)}, tolerance=2e-3, **SIGNALS)
    found = lpv.synthesize(lpv.GeneralizedPlant(system, ["force"], ["sensor"]), lpv.OutputFeedback())
    assert found.solved and found.closed_loop.basis.size < 1000
    assert lpv.verify(found.certificate, found.closed_loop).holds


def test_the_finer_table_comes_along_through_connections():
    system = lpv.from_function(_matrices, {"p": (0.2, 2.0)}, tolerance=0.05, **SIGNALS)
    whole = lpv.connect([system], ["push", "noise", "force"], ["stroke", "effort", "sensor", "gap = stroke - sensor"])
    finer = lpv.LPVStateSpace.from_dict(whole.metadata["interpolation"]["finer"])
    assert finer.n_outputs == 4 and finer.basis.size > system.basis.size
    p = 0.31
    assert np.abs(finer.frozen([p])[0] - _matrices(p)[0]).max() < np.abs(system.frozen([p])[0] - _matrices(p)[0]).max()


def test_the_finer_table_bears_the_names_that_a_connection_gives():
    """Weights rename the plant's own signals, and series, parallel and append those of every block."""
    system = lpv.from_function(_matrices, {"p": (0.2, 2.0)}, tolerance=0.05, **SIGNALS)
    plant = lpv.GeneralizedPlant(system, ["force"], ["sensor"])
    weighed = lpv.weigh(plant, {"push": 0.5}, {"stroke": 2.0, "sensor": 1.0}).system
    chain = lpv.series(system, gain(np.eye(3), ["a", "b", "c"], ["d", "e", "f"]))
    for made, stroke in ((weighed, 1.0), (chain, 1.0), (lpv.parallel(system, system), 2.0), (lpv.append(system), 1.0)):
        about = made.metadata["interpolation"]
        finer = lpv.LPVStateSpace.from_dict(about["finer"])
        for p in (0.2, 0.21, 0.33, 2.0):
            a, b, c, d = finer.frozen([p])
            want = _matrices(p)
            got = c @ np.linalg.solve(2j * np.eye(len(a)) - a, b) + d
            true = want[2] @ np.linalg.solve(2j * np.eye(2) - want[0], want[1]) + want[3]
            assert abs(got[0, 0] - stroke * true[0, 0]) < 0.01 * abs(true[0, 0])


def test_a_mat_file_as_matlab_saves_an_array_of_systems(tmp_path):
    speeds = np.linspace(1.0, 3.0, 5)
    stack = [np.stack(m, axis=-1) for m in zip(*map(_matrices, speeds), strict=True)]
    savemat(tmp_path / "grid.mat", dict(zip("ABCD", stack, strict=True), speed=speeds))
    system = lpv.from_grid(tmp_path / "grid.mat")
    assert system.box.names == ("speed",) and system.sample_time is None
    np.testing.assert_allclose(system.frozen([2.5])[0], _matrices(2.5)[0], atol=1e-12)
    savemat(tmp_path / "short.mat", {"A": stack[0]})
    with pytest.raises(lpv.InputError, match="holds no B, C, D"):
        lpv.from_grid(tmp_path / "short.mat")
    with pytest.raises(lpv.InputError, match="no such file"):
        lpv.from_grid(tmp_path / "none.mat")


@pytest.mark.parametrize(("of", "text"), [
    (lambda p: ([[1.0]], [[1.0]], [[1.0]]), "four matrices"),
    (lambda p: 3.0, "python-control system"),
    (lambda p: ([[1 / p]], [[1.0]], [[1.0]], [[0.0]]), "division by zero at"),
    (lambda p: ([[np.inf if p > 0.4 else 1.0]], [[1.0]], [[1.0]], [[0.0]]), "not finite"),
    (lambda p: tuple(np.eye(1 if p < 0.4 else 2) for _ in range(4)), "differ in states")])
def test_what_is_no_function_of_systems_is_refused_in_one_line(of, text):
    with pytest.raises(lpv.InputError, match=text):
        lpv.from_function(of, {"p": (0.0, 1.0)})


def test_points_that_form_no_grid_are_refused():
    four = ([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    with pytest.raises(lpv.InputError, match="no full grid"):
        lpv.from_grid({(0, 0): four, (1, 1): four, (0, 1): four})
    with pytest.raises(lpv.InputError, match="reach the ends"):
        lpv.from_grid({0.0: four, 1.0: four}, lpv.Scheduling(("p",), (0.0,), (2.0,)))
