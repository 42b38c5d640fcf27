"""A basis of another package: its name in files, what it serves for, and what refuses it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

import lpvid as lpv
from lpvid.errors import InputError
from lpvid.scheduling import Basis


@dataclass(frozen=True)
class Exponential(Basis):
    """1 and exp(−p/scale), as a user writes it: without a `kind`."""

    name: str
    scale: float = 1.0
    size: ClassVar[int] = 2
    degree: ClassVar[None] = None
    lags: ClassVar[tuple[int, int]] = (0, 0)
    labels: ClassVar[tuple[str, ...]] = ("1", "exp(-p)")
    unity: ClassVar[np.ndarray] = np.array([1.0, 0.0])

    @property
    def names(self):
        return (self.name,)

    def evaluate(self, p):
        return np.column_stack([np.ones(len(p)), np.exp(-p[:, 0] / self.scale)])

    def derivative(self, p, name):
        return np.column_stack([np.zeros(len(p)), -np.exp(-p[:, 0] / self.scale) / self.scale])

    def bound(self, box):
        return self


@pytest.fixture(scope="module")
def found():
    rng = np.random.default_rng(5)
    u, p, y = rng.normal(size=600), rng.uniform(0, 2, 600), np.zeros(600)
    for k in range(1, 600):
        y[k] = (0.5 + 0.3 * np.exp(-p[k])) * y[k - 1] + u[k - 1]
    record = lpv.Record({"u": u, "p": p, "y": y}, sample_time=0.01)
    return lpv.identify(record, lpv.ARX(na=1, nb=1, input="u", output="y", basis=Exponential("p"))), record


def test_it_is_identified_and_comes_back_from_its_file(found, tmp_path):
    model = found[0].model
    np.testing.assert_allclose(model.a.ravel(), [-0.5, -0.3], atol=1e-12)
    back = lpv.load(lpv.save(model, tmp_path / "model.json"))
    assert back.basis == model.basis == Exponential("p")
    assert Exponential.kind == f"{__name__}.Exponential"
    np.testing.assert_array_equal(back.a, model.a)


def test_a_file_of_an_unknown_basis_says_what_to_import(found, tmp_path):
    path = lpv.save(found[0].model, tmp_path / "model.json")
    path.write_text(path.read_text().replace(Exponential.kind, "elsewhere.Exponential"))
    with pytest.raises(InputError, match="import the module that defines it"):
        lpv.load(path)


def test_its_realisation_runs_alike_and_a_grid_of_it_is_certified(found):
    identified, record = found
    system = lpv.realize(identified.model, "augmented").model
    np.testing.assert_allclose(lpv.simulate(system, record, "zero").output,
                               lpv.simulate(identified.model, record, "zero").output, atol=1e-12)
    with pytest.raises(InputError, match="polynomials, splines or sines"):
        lpv.certify_stability(system)
    assert lpv.certify_stability(lpv.to_gridded(system).model).verified


def test_the_kinds_of_the_package_are_as_ever():
    kinds = {b.kind for b in (lpv.Polynomial, lpv.Spline, lpv.Fourier, lpv.Product, lpv.Shifted, lpv.Stacked)}
    assert kinds == {"polynomial", "spline", "fourier", "product", "shifted", "stacked"}
