"""Joining systems by names: against python-control's interconnect at frozen points, and against simulation."""

from __future__ import annotations

import control
import numpy as np
import pytest

from lpvid.errors import InputError
from lpvid.model.signals import Signal
from lpvid.model.state_space import LPVStateSpace
from lpvid.scheduling import Fourier, Polynomial, Product, Scheduling, Spline
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.interconnection import close_loop, close_loop_at, connect

STILL = Polynomial()


def random_system(rng, basis, order, inputs, outputs, sample_time=None, *, feedthrough=True) -> LPVStateSpace:
    m, nu, ny = basis.size, len(inputs), len(outputs)
    d = rng.normal(size=(m, ny, nu)) * (0.3 if feedthrough else 0.0)
    return LPVStateSpace(rng.normal(size=(m, order, order)), rng.normal(size=(m, order, nu)),
                         rng.normal(size=(m, ny, order)), d, basis, sample_time,
                         inputs=tuple(Signal(n, "N") for n in inputs), outputs=tuple(Signal(n, "m") for n in outputs))


def lower_lft(plant, controller, p, measured, driven) -> control.StateSpace:
    """python-control's own feedback around the last inputs and outputs."""
    names_in, names_out = [s.name for s in plant.system.inputs], [s.name for s in plant.system.outputs]
    columns = [names_in.index(n) for n in (*plant.disturbances, *(s.name for s in driven))]
    rows = [names_out.index(n) for n in (*plant.performance, *(s.name for s in measured))]
    a, b, c, d = plant.system.frozen(p)
    return control.ss(a, b[:, columns], c[rows], d[rows][:, columns]).lft(controller, len(driven), len(measured))


def test_a_closed_loop_equals_the_lft_of_python_control_at_frozen_points():
    rng = np.random.default_rng(3)
    plant_basis, controller_basis = Polynomial(("p", "q"), 1), Polynomial(("q", "p"), 1, (0.2, 0.1), (2.0, 0.5))
    system = random_system(rng, plant_basis, 3, ["road", "valve", "noise", "force"], ["speed", "comfort", "stroke"])
    d = system.D.copy()
    d[1:, [[0], [2]], [1, 3]] = 0.0  # D22 constant
    system = system.replace(D=d)
    controller = random_system(rng, controller_basis, 2, ["stroke", "speed"], ["force", "valve"])
    controller = controller.replace(D=controller.D * np.eye(1, controller_basis.size)[0][:, None, None])
    plant = GeneralizedPlant(system, ["valve", "force"], ["speed", "stroke"])
    loop = close_loop(plant, controller)
    assert [s.name for s in loop.inputs] == ["road", "noise"] and loop.outputs == (Signal("comfort", "m"),)
    assert isinstance(loop.basis, Polynomial) and loop.basis.degree == 2 and loop.box.names == ("p", "q")
    for p in rng.uniform(-1, 1, (5, 2)):
        expected = lower_lft(plant, controller.to_control(p[::-1]), p, controller.inputs, controller.outputs)
        for s in (0.0, 1j, 10j, 3 + 2j):
            np.testing.assert_allclose(control.ss(*loop.frozen(p))(s), expected(s), rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("basis", [Polynomial("p", 2), Spline("p", 4, 1, tuple(np.linspace(-1, 1, 5)))])
def test_the_closed_loop_and_the_pointwise_one_agree(basis):
    rng = np.random.default_rng(5)
    system = random_system(rng, Polynomial("p", 1), 3, ["w1", "w2", "u"], ["z", "y1", "y2"])
    system = system.replace(D=system.D * np.array([[1, 1, 1], [1, 1, 0], [1, 1, 0]]))
    controller = random_system(rng, basis, 2, ["y1", "y2"], ["u"])
    plant = GeneralizedPlant(system, ["u"], ["y1", "y2"])
    loop = close_loop(plant, controller)
    points = np.linspace(-1, 1, 9)[:, None]
    k = [np.tensordot(controller.basis.evaluate(points), getattr(controller, x), axes=1) for x in "ABCD"]
    for got, name in zip(close_loop_at(plant.at(points), *k), "ABCD", strict=True):
        expected = np.tensordot(loop.basis.evaluate(points), getattr(loop, name), axes=1)
        np.testing.assert_allclose(got, expected, atol=1e-10)


def hats(name: str, count: int) -> Spline:
    return Spline(name, count, 1, tuple(np.linspace(-1, 1, count + 1)))


@pytest.mark.parametrize(("plant_basis", "controller_basis", "largest"), [
    (Polynomial(("p", "q"), 1), Product(hats("p", 6), hats("q", 6)), 3 + 49 + 6 * 49),  # none of them squared
    (Product(hats("p", 2), Polynomial("q", 1)), Product(Polynomial("q", 2), hats("p", 2)), 250),
    (Fourier("q", 1), Product(hats("q", 3), Polynomial("p", 1)), 60),
])
def test_two_parameter_grids_give_no_more_functions_than_their_products(plant_basis, controller_basis, largest):
    rng = np.random.default_rng(8)
    system = random_system(rng, plant_basis, 3, ["w", "u"], ["z", "y"])
    system = system.replace(D=system.D * np.array([[1, 1], [1, 0]]))
    controller = random_system(rng, controller_basis, 2, ["y"], ["u"])
    plant = GeneralizedPlant(system, ["u"], ["y"])
    loop = close_loop(plant, controller)
    assert loop.basis.size <= largest and loop.box.names[: len(plant.box.names)] == plant.box.names
    points = rng.uniform(-1, 1, (6, len(loop.box.names)))
    where = {n: points[:, i] for i, n in enumerate(loop.box.names)}
    k = [np.tensordot(controller_basis.evaluate(np.column_stack([where[n] for n in controller_basis.names])),
                      getattr(controller, x), axes=1) for x in "ABCD"]
    blocks = plant.at(np.column_stack([where[n] for n in plant.box.names]))
    for got, name in zip(close_loop_at(blocks, *k), "ABCD", strict=True):
        expected = np.tensordot(loop.basis.evaluate(points), getattr(loop, name), axes=1)
        np.testing.assert_allclose(got, expected, atol=1e-9)


def test_pointwise_closing_handles_feedthrough_on_both_sides():
    rng = np.random.default_rng(6)
    basis = Polynomial("p", 1)
    system = random_system(rng, basis, 3, ["w", "u"], ["z", "y"])
    controller = random_system(rng, basis, 2, ["y"], ["u"])
    plant = GeneralizedPlant(system, ["u"], ["y"])
    points = np.linspace(-1, 1, 5)[:, None]
    k = [np.tensordot(controller.basis.evaluate(points), getattr(controller, x), axes=1) for x in "ABCD"]
    a, b, c, d = close_loop_at(plant.at(points), *k)
    for i, p in enumerate(points):
        expected = lower_lft(plant, controller.to_control(p), p, controller.inputs, controller.outputs)
        np.testing.assert_allclose(control.ss(a[i], b[i], c[i], d[i])(2j), expected(2j), rtol=1e-9)
    with pytest.raises(InputError, match=r"loop of feedthroughs varies with p.*y.*u"):
        close_loop(plant, controller)


def test_a_varying_loop_simulates_like_its_parts():
    rng = np.random.default_rng(7)
    basis = Polynomial("p", 1)
    system = random_system(rng, basis, 2, ["w", "u"], ["z", "y"], 0.1, feedthrough=False)
    controller = random_system(rng, Spline("p", 2, 1, (-1.0, 0.0, 1.0)), 1, ["y"], ["u"], 0.1)
    loop = close_loop(GeneralizedPlant(system, ["u"], ["y"]), controller)
    x, xk, xl = np.zeros(2), np.zeros(1), np.zeros(3)
    for _ in range(12):
        p, w = rng.uniform(-1, 1, 1), rng.normal(size=1)
        a, b, c, _ = system.frozen(p)
        ak, bk, ck, dk = controller.frozen(p)
        u = ck @ xk + dk @ (c @ x)[1:]
        z = (c @ x)[:1]
        al, bl, cl, dl = loop.frozen(p)
        np.testing.assert_allclose(cl @ xl + dl @ w, z, rtol=1e-9, atol=1e-9)
        x, xk, xl = a @ x + b @ np.r_[w, u], ak @ xk + bk @ (c @ x)[1:], al @ xl + bl @ w


def test_wires_add_signals_with_signs_and_affine_terms_travel():
    basis = Polynomial("p", 1)
    plant = LPVStateSpace([[[-1.0]], [[0.5]]], [[[1.0]], [[0.2]]], [[[1.0]], [[0.0]]], np.zeros((2, 1, 1)), basis, None,
                          Scheduling(("p",), (0.0,), (2.0,), (3.0,), ("A",)), [[0.3], [0.0]], [[0.7], [0.1]],
                          inputs=(Signal("u", "N"),), outputs=(Signal("y", "m"),))
    gain = LPVStateSpace(np.zeros((2, 0, 0)), np.zeros((2, 0, 1)), np.zeros((2, 1, 0)), [[[2.0]], [[1.0]]], basis, 0.5,
                         inputs=(Signal("e", "m"),), outputs=(Signal("u", "N"),))
    loop = connect([plant, gain], ["r"], ["y", "u", "r"], {"e": "r - y"})
    assert loop.box == plant.box and loop.sample_time is None and loop.inputs == (Signal("r", "m"),)
    p = 1.3
    k, a, b, f, g = 2 + p, -1 + 0.5 * p, 1 + 0.2 * p, 0.3, 0.7 + 0.1 * p  # ẋ = a x + b k (r − x − g) + f
    phi = loop.basis.evaluate(np.array([[p]]))[0]
    assert loop.frozen([p])[0].item() == pytest.approx(a - b * k)
    assert (phi @ loop.state_offset).item() == pytest.approx(f - b * k * g)
    np.testing.assert_allclose(phi @ loop.output_offset, [g, -k * g, 0.0])
    np.testing.assert_allclose(loop.frozen([p])[3].ravel(), [0.0, k, 1.0])


def static(name_in, name_out, gain, basis=STILL, sample_time=None) -> LPVStateSpace:
    d = np.atleast_3d(np.asarray(gain, dtype=float)).reshape(basis.size, 1, 1)
    return LPVStateSpace(np.zeros((basis.size, 0, 0)), np.zeros((basis.size, 0, 1)), np.zeros((basis.size, 1, 0)), d,
                         basis, sample_time, inputs=(Signal(name_in),), outputs=(Signal(name_out),))


def test_constant_algebraic_loops_are_solved_and_chains_of_varying_gains_multiplied_out():
    loop = connect([static("e", "y", 3.0)], ["r"], ["y"], {"e": "r - y"})
    assert loop.frozen([])[3].item() == pytest.approx(3 / 4)
    basis = Polynomial("p", 1)
    chain = connect([static("a", "b", [1, 2], basis), static("b", "c", [0, 1], basis), static("e", "a", 2.0)],
                    ["r"], ["c"], {"e": "r - 0.5 a"})
    p = 0.7
    assert chain.frozen([p])[3].item() == pytest.approx(2 / (1 + 0.5 * 2) * (1 + 2 * p) * p)


@pytest.mark.parametrize(("systems", "inputs", "outputs", "wires", "message"), [
    ([static("a", "b", 1.0)], ["a"], ["c"], {}, "no output of a block 'c'"),
    ([static("a", "b", 1.0)], ["r"], ["b"], {}, "nothing drives the input 'a'"),
    ([static("a", "b", 1.0)], ["a", "r"], ["b"], {}, "drives nothing: got r"),
    ([static("a", "b", 1.0), static("c", "b", 1.0)], ["a"], ["b"], {}, "two blocks: got b"),
    ([static("a", "b", 1.0)], ["a"], ["b"], {"a": "x - b"}, "'x', which drives 'a', does not exist"),
    ([static("a", "b", 1.0)], ["a"], ["b"], {"a": "2 a b"}, "cannot be read"),
    ([static("a", "b", 1.0)], ["r"], ["b"], {"a": "r + b"}, "no solution: got the signals b"),
    ([static("a", "b", [0, 1], Polynomial("p", 1))], ["r"], ["b"], {"a": "r - b"}, "varies with p: got the signals b"),
])
def test_a_refusal_names_the_signal(systems, inputs, outputs, wires, message):
    with pytest.raises(InputError, match=message):
        connect(systems, inputs, outputs, wires)


def test_clocks_and_names_must_agree():
    rng = np.random.default_rng(1)
    one = random_system(rng, Polynomial(), 1, ["w", "u"], ["z", "y"], 0.1)
    other = random_system(rng, Polynomial(), 1, ["y"], ["u"], None)
    plant = GeneralizedPlant(one, ["u"], ["y"])
    with pytest.raises(InputError, match=r"different sampling periods: got 0\.1 s and continuous time"):
        close_loop(plant, other)
    with pytest.raises(InputError, match="inputs of the controller are not the measurements of the plant: got y2"):
        close_loop(plant, random_system(rng, Polynomial(), 1, ["y2"], ["u"], 0.1))
