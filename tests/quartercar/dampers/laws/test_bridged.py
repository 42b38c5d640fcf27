"""Networks of any wiring: linear circuits by Kirchhoff's matrix, balance and symmetry for turbulent ones."""

from __future__ import annotations

import numpy as np
import pytest

from lpvid.errors import InputError
from quartercar.dampers.laws.bridged import Branch, Bridged
from quartercar.dampers.laws.hydraulics import Laminar, Parallel, Series, Turbulent

WIRES = (("in", "a"), ("in", "b"), ("a", "b"), ("a", "out"), ("b", "out"))


def bridge(*paths):
    return Bridged([Branch(s, e, p) for (s, e), p in zip(WIRES, paths, strict=True)])


def by_kirchhoff(edges, resistances, terminals, flow):
    """Node pressures of a linear circuit from its conductance matrix."""
    nodes = sorted({n for e in edges for n in e})
    g = np.zeros((len(nodes), len(nodes)))
    for (a, b), r in zip(edges, resistances, strict=True):
        i, j = nodes.index(a), nodes.index(b)
        g[[i, j, i, j], [i, j, j, i]] += np.array([1, 1, -1, -1]) / r
    source = np.zeros(len(nodes))
    source[nodes.index(terminals[0])], ground = flow, nodes.index(terminals[1])
    keep = [k for k in range(len(nodes)) if k != ground]
    p = np.zeros(len(nodes))
    p[keep] = np.linalg.solve(g[np.ix_(keep, keep)], source[keep])
    return p[nodes.index(terminals[0])]


def test_a_linear_bridge_obeys_kirchhoff():
    r = (1.0, 2.0, 5.0, 2.0, 1.0)
    assert float(bridge(*map(Laminar, r)).pressure(1.5)) == pytest.approx(by_kirchhoff(WIRES, r, ("in", "out"), 1.5),
                                                                          rel=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_random_linear_networks_obey_kirchhoff(seed):
    rng = np.random.default_rng(seed)
    nodes = [*"abcde", "in", "out"]
    edges = [(nodes[i], nodes[(i + 1) % 7]) for i in range(7)]  # a ring keeps all of them connected
    edges += [(nodes[i], nodes[j]) for i, j in (rng.choice(7, 2, replace=False) for _ in range(5))]
    r = rng.uniform(0.1, 10.0, len(edges))
    net = Bridged([Branch(a, b, Laminar(x)) for (a, b), x in zip(edges, r, strict=True)])
    assert float(net.pressure(2.0)) == pytest.approx(by_kirchhoff(edges, r, ("in", "out"), 2.0), rel=1e-10)


def test_a_balanced_turbulent_bridge_carries_nothing_across():
    """Arms in one ratio: both middle nodes have one pressure, and the bridge may as well be cut."""
    net = bridge(Turbulent(1.0), Turbulent(4.0), Turbulent(0.3), Turbulent(2.0), Turbulent(8.0))
    cut = Parallel(Series(Turbulent(1.0), Turbulent(2.0)), Series(Turbulent(4.0), Turbulent(8.0)))
    assert abs(net.flows(1.0)[2]) < 1e-9
    assert float(net.pressure(1.0)) == pytest.approx(float(cut.pressure(1.0)), rel=1e-12)


def test_a_turbulent_bridge_is_homogeneous_balanced_and_gives_no_power():
    net = bridge(Turbulent(1.0), Turbulent(3.0), Turbulent(0.3), Turbulent(5.0), Turbulent(2.0))
    q = np.array([0.01, 0.5, 4.0])
    assert np.allclose(net.pressure(q), float(net.pressure(1.0)) * q**2, rtol=1e-11)
    flows = net.flows(1.0)
    assert flows[0] + flows[1] == pytest.approx(1.0) and flows[0] == pytest.approx(flows[2] + flows[3])
    lost = sum(float(b.path.pressure(f)) * f for b, f in zip(net.branches, flows, strict=True))
    assert lost == pytest.approx(float(net.pressure(1.0)), rel=1e-11)  # Tellegen: what enters is lost in the branches
    assert np.allclose(net.pressure(-q), -net.pressure(q), rtol=1e-12)


@pytest.mark.seconds
def test_it_contains_series_and_parallel_and_inverts():
    leak, orifice, gap = Laminar(3.0), Turbulent(0.7), Laminar(0.2)
    net = Bridged([Branch("in", "a", gap), Branch("a", "out", orifice), Branch("out", "in", leak)])
    same = Parallel(Series(gap, orifice), leak)
    q = np.geomspace(1e-4, 1e2, 9)
    assert np.allclose(net.pressure(q), same.pressure(q), rtol=1e-11)
    mixed = bridge(gap, Turbulent(2.0), Laminar(0.4), Turbulent(0.5), leak)
    assert np.allclose(mixed.flow(mixed.pressure(q)), q, rtol=1e-11)


def test_dead_ends_carry_nothing_and_terminals_must_be_connected():
    net = Bridged([Branch("in", "out", Laminar(2.0)), Branch("out", "blind", Turbulent(1.0))])
    assert net.flows(3.0).tolist() == [3.0, 0.0] and float(net.pressure(3.0)) == 6.0
    with pytest.raises(InputError, match="connected"):
        Bridged([Branch("in", "a", Laminar(1.0)), Branch("b", "out", Laminar(1.0))])
    with pytest.raises(InputError, match="two terminals"):
        Bridged([], "in", "in")
