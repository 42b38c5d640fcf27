"""The first input lag is chosen by what it does to the free run."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from lpvid.identification.arx import ARX
from lpvid.identification.delay import choose_delay
from lpvid.record import Record

TS = 0.01
BASE = ARX(na=1, nb=1, input="u", output="y")


def delayed(rng: np.random.Generator, delay: int, n: int = 1500) -> Record:
    u = rng.normal(size=n)
    y = lfilter(np.eye(5)[delay], [1.0, -0.7], u) + 0.05 * rng.normal(size=n)
    return Record({"u": u, "y": y}, sample_time=TS)


@pytest.mark.parametrize("delay", [0, 1, 2, 4])
def test_the_true_delay_is_taken(delay: int, rng: np.random.Generator) -> None:
    chosen, note = choose_delay([delayed(rng, delay)], BASE, candidates=(0, 1, 2, 4))
    assert chosen.delay == (delay,)
    assert f"took nk={delay}" in note
    assert all(f"nk={k} " in note for k in (0, 1, 2, 4))


def test_everything_else_of_the_structure_stays(rng: np.random.Generator) -> None:
    structure = ARX(na=2, nb=3, nk=9, input="u", output="y", affine=1, ridge=1e-9)
    chosen, _ = choose_delay(delayed(rng, 1), structure)
    assert (chosen.na, chosen.nb, chosen.affine, chosen.ridge, chosen.input) == (2, (3,), 1, 1e-9, ("u",))


def test_ties_go_to_the_least_delay_without_a_direct_term(rng: np.random.Generator) -> None:
    """Three lags catch a delay of 2 as lags (0, 1, 2), (1, 2, 3) and (2, 3, 4): no difference in the free run.

    nk=2 would have two more states than nk=0 and one more than nk=1; nk=0 a direct term.
    """
    chosen, note = choose_delay([delayed(rng, 2, 6000)], ARX(na=1, nb=3, input="u", output="y"))
    assert chosen.delay == (1,)
    costs = [float(part.split()[1].rstrip(",;")) for part in note.split("nk=")[1:4]]
    assert max(costs) < 1.02 * min(costs)
    assert note.endswith("within 2 % of the least error") == (costs[1] > min(costs))


def test_a_direct_term_is_taken_where_a_later_lag_costs(rng: np.random.Generator) -> None:
    chosen, _ = choose_delay([delayed(rng, 0, 3000)], ARX(na=1, nb=2, input="u", output="y"))
    assert chosen.delay == (0,)


def test_the_order_of_candidates_does_not_matter(rng: np.random.Generator) -> None:
    record = delayed(rng, 2)
    assert choose_delay([record], BASE, candidates=(2, 0, 1)) == choose_delay([record], BASE, candidates=(0, 1, 2))


def test_velocity_is_derived_from_displacement(rng: np.random.Generator) -> None:
    t = TS * np.arange(2000)
    x = np.sum([np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) / f for f in (0.3, 1.1, 2.9)], axis=0)
    force = 100.0 * np.gradient(x, TS)
    record = Record({"displacement": x, "force": force}, sample_time=TS)
    chosen, _ = choose_delay([record], ARX(na=0, nb=1))
    assert chosen.delay == (0,)
