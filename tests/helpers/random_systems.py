"""Random stable LPV systems whose stability is beyond doubt, and how near estimates come to them in free run."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, solve_discrete_are
from scipy.signal import lfilter

from lpvid.identification import identify
from lpvid.identification.arx import ARX
from lpvid.identification.output_error import OutputError
from lpvid.identification.refined_iv import RefinedIV
from lpvid.identification.selection import Candidates, select
from lpvid.identification.selection.rounds import output_error as of_orders
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.scheduling import Polynomial, Scheduling
from lpvid.validation import validate

SAMPLES = 4000
CONTRACTION = 0.995
"""radius of the circle that the small-gain condition is asked on."""
GAIN = 0.98
"""share of the small-gain limit that the dependence on the scheduling takes up."""


@dataclass(frozen=True, eq=False)
class RandomSystem:
    """A system x(k), its noise and its data: training and fresh, from different draws."""

    seed: int
    model: LPVTransferFunction
    lyapunov: np.ndarray
    snr: float
    coloured: bool
    training: Record
    fresh: Record

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"p{i + 1}" for i in range(self.model.basis.size - 1))

    @property
    def settings(self) -> dict:
        """What a user who knows the orders would ask for."""
        return {"na": self.model.na, "nb": self.model.na, "nk": 1, "input": "u1", "output": "y1",
                "basis": Polynomial(self.names, degree=1)}

    def true_fit(self) -> float:
        """Free-run fit of the true model on the fresh record [%]: what the noise leaves."""
        return fit_of(self.model, self.fresh)


def fit_of(model, record: Record) -> float:
    found = validate(model, record).overall.free_run.fit_percent
    return -np.inf if found is None else float(found)


def random_system(seed: int, n: int = SAMPLES) -> RandomSystem:
    """Order 2 to 6, one to three scheduling variables, SNR 10 to 40 dB, all by the seed alone."""
    rng = np.random.default_rng([20260101, seed])
    order, variables = 2 + seed % 5, 1 + seed % 3
    coloured, snr = bool(seed % 2), float(rng.uniform(10, 40))
    a, lyapunov = _stable_denominator(rng, order, variables)
    b = rng.normal(size=(order, 1 + variables)) * np.r_[1.0, 0.4 * np.ones(variables)]
    names = tuple(f"p{i + 1}" for i in range(variables))
    box = Scheduling(names, (-1.0,) * variables, (1.0,) * variables)
    model = LPVTransferFunction.siso(a, np.vstack([np.zeros(1 + variables), b]), Polynomial(names, degree=1).bound(box),
                                     0.01, scheduling=box)
    training, fresh = (_measured(model, rng, n, snr, coloured) for _ in range(2))
    return RandomSystem(seed, model, lyapunov, snr, coloured, training, fresh)


def _stable_denominator(rng: np.random.Generator, order: int, variables: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows a_i over (1, p1, …) and P with A(p)ᵀPA(p) < P at every vertex, hence all over the box.

    Each variable moves the coefficients towards those of other poles. With Δ(z) the moves and A₀(z) the middle,
    √M ‖Δ/A₀‖∞ < 1 suffices (small gain, circle |z| = CONTRACTION); the bounded-real Riccati equation gives P.
    """
    nominal = _coefficients(_poles(rng, order))
    moves = np.array([_coefficients(_poles(rng, order)) - nominal for _ in range(variables)])
    delays = (CONTRACTION * np.exp(1j * np.linspace(0, np.pi, 4000))) ** -np.arange(1, order + 1)[:, None]
    gains = np.abs(moves @ delays / (1 + nominal @ delays))
    moves /= gains.max(axis=1)[:, None]
    moves *= GAIN / np.sqrt(variables * (np.abs(moves @ delays / (1 + nominal @ delays)) ** 2).sum(axis=0).max())
    a, middle = np.column_stack([nominal, moves.T]), np.zeros((order, 1 + variables))
    middle[:, 0] = nominal
    return a, solve_discrete_are(vertices(middle)[0] / CONTRACTION, np.eye(order)[:, :1],
                                 variables * moves.T @ moves / CONTRACTION**2 + 1e-9 * np.eye(order), -np.eye(1))


def _coefficients(poles: np.ndarray) -> np.ndarray:
    return np.real(np.poly(poles))[1:]


def _poles(rng: np.random.Generator, order: int) -> np.ndarray:
    pairs = order // 2
    upper = rng.uniform(0.4, 0.9, pairs) * np.exp(1j * rng.uniform(0.1, 1.6, pairs))
    return np.r_[upper, upper.conj(), rng.uniform(-0.3, 0.85, order % 2)]


def vertices(a: np.ndarray) -> list[np.ndarray]:
    """Companion matrices at the corners of the box."""
    order, width = a.shape
    shift = np.eye(order, k=-1)
    found = []
    for corner in itertools.product((-1.0, 1.0), repeat=width - 1):
        companion = shift.copy()
        companion[0] = -a @ np.r_[1.0, corner]
        found.append(companion)
    return found


def contraction(corners: list[np.ndarray], p: np.ndarray) -> float:
    """Largest factor by which sqrt(xᵀPx) can grow in a sample."""
    return float(np.sqrt(max(eigh(m.T @ p @ m, p, eigvals_only=True)[-1] for m in corners)))


def _measured(model: LPVTransferFunction, rng: np.random.Generator, n: int, snr: float, coloured: bool) -> Record:
    """White input, each scheduling variable low-pass noise in the box; the output by a plain loop, then noise."""
    u, size = rng.normal(size=n), model.basis.size - 1
    p = np.clip(lfilter([0.25], [1, -0.92], rng.normal(size=(n, size)), axis=0), -1, 1)
    phi = np.column_stack([np.ones(n), p])
    a, b = model.a[:, 0, 0], model.b[1:, 0, 0]
    x, order = np.zeros(n), len(a)
    for k in range(order, n):
        x[k] = -(a @ phi[k]) @ x[k - order: k][::-1] + (b @ phi[k]) @ u[k - order: k][::-1]
    v = lfilter([1], [1, -0.8 if coloured else 0.0], rng.normal(size=n))
    y = x + v * (x.std() / v.std() * 10 ** (-snr / 20))
    channels = {"u1": u, **{f"p{i + 1}": p[:, i] for i in range(size)}, "y1": y}
    return Record(channels, sample_time=0.01)


# -- routes from data to a model -------------------------------------------------------------------------------------
def least_squares(system: RandomSystem):
    return identify(system.training, ARX(**system.settings)).model


def refined_iv(system: RandomSystem):
    return identify(system.training, RefinedIV(**system.settings)).model


def output_error(system: RandomSystem):
    return identify(system.training, OutputError(**system.settings)).model


def selected(system: RandomSystem):
    """Orders unknown: a small grid, and the output-error structure of the best."""
    grid = Candidates("u1", "y1", system.names, na=(1, 2, 3, 4, 5, 6), nk=(1,), degree=(1,), affine=("none",),
                      lagged=(False,))
    return select(system.training, grid, then=lambda arx: [of_orders(arx)] if arx.na else []).identification.model


def time_invariant(system: RandomSystem):
    """What ignoring the scheduling costs; not a route, but the measure of how much there is to find."""
    return identify(system.training, OutputError(**{**system.settings, "basis": Polynomial()})).model


ROUTES: dict[str, Callable] = {"ARX": least_squares, "RefinedIV": refined_iv, "OutputError": output_error,
                               "select": selected}


def shortfall(system: RandomSystem, route: Callable) -> float:
    """Points of free-run fit by which a route's model falls short of the true model on the fresh record."""
    model = route(system)
    assert all(np.isfinite(x).all() for x in (model.a, model.b, model.c))
    found = system.true_fit() - fit_of(model, system.fresh)
    assert not np.isnan(found)
    return found
