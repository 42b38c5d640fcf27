"""LPV subspace identification: states from predictions, then every matrix by least squares."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from lpvid import _checks
from lpvid._threads import single_thread
from lpvid.errors import InputError
from lpvid.identification.arx import scheduling_box
from lpvid.identification.result import Identification
from lpvid.identification.state_space_layout import StateSpaceLayout
from lpvid.identification.state_space_result import (
    StateSpaceStructure,
    empty_model,
    number_of_parameters,
    package,
    refuse_poor_data,
)
from lpvid.identification.state_space_search import SearchData, StateSpaceSearchEnd, bounded, evaluate, triangle
from lpvid.identification.subspace_order import FOLDS, free_run_errors
from lpvid.identification.subspace_words import KernelWords, Trace, Words, WrittenWords, number_of_words
from lpvid.model.state_space import LPVStateSpace
from lpvid.record import Record
from lpvid.scheduling import Basis, Polynomial, Scheduling

SHORTEST, LONGEST, KERNEL_PAST = 3, 12, 4
"""past chosen automatically: the longest between these two that can be written out, or else the third."""
WRITTEN = 700
"""words up to which the regression is written out; beyond, it works by inner products."""
KERNEL_ROWS = 2000
"""rows of the regression by inner products; more are thinned out evenly."""
MAX_SAMPLES = 60_000
"""samples used; more are thinned out to evenly spread pieces."""
MAX_ORDER = 12
"""highest order that is chosen automatically."""
NO_WORSE = 0.02
"""share by which the ESR out of fold of a lower order may exceed the least: 1 % of what the fit lacks to 100 %."""


@dataclass(frozen=True)
class Subspace(StateSpaceStructure):
    """Predictor-based LPV subspace estimate (van Wingerden & Verhaegen 2009), in innovation form.

    ::

        x(k+1) = A(p) x + B(p) u [+ f(p)] + K(p) e
        y(k)   = C(p) x [+ D(p) u] [+ g(p)] + e

    The output is regressed on words of past inputs, outputs and scheduling, with a penalty found by generalised
    cross-validation; the states are the leading singular directions of the predicted outputs; all matrices follow
    from two least squares. No iteration and no local minima, but short of the accuracy of a prediction-error estimate:
    refine it with `StateSpaceError`. The number of words grows as Mᵖᵃˢᵗ; beyond 700 the regression works with their
    inner products on at most 2000 rows, and at most 60 000 samples are read (both spread evenly).

    Parameters
    ----------
    order : int or None
        States; None takes the lowest whose free run on blocks that were not fitted is within 2 % of the least ESR (from
        the largest gap between successive singular values where the records are too short for blocks).
    past : int or None
        Samples that the state is estimated from; None for as many as keep the words within what is written out.
    future : int
        Predicted outputs that the state is read from; no more than the past.
    input, output : str or sequence of str
        Channel (or role) names; any number of each.
    basis : Basis
        Dependence on p(k), the same for all matrices.
    direct : bool
        Whether u(k) acts on y(k) directly (D).
    affine : bool
        Offsets f(p) and g(p).
    kernel : bool or None
        True for inner products, False for written-out words, None to choose by their number.

    Examples
    --------
    >>> Subspace(order=2, input="u", output="y", basis=Polynomial("p", degree=1)).past
    6
    """

    KIND = "subspace"

    order: int | None = None
    past: int | None = None
    future: int = 4
    input: str | tuple[str, ...] = "velocity"
    output: str | tuple[str, ...] = "force"
    basis: Basis = field(default_factory=Polynomial)
    direct: bool = False
    affine: bool = False
    kernel: bool | None = None

    def __post_init__(self) -> None:
        self._check_signals()
        _checks.count(self.future, "future", at_least=1)
        if self.past is None:
            object.__setattr__(self, "past", self._affordable())
        _checks.count(self.past, "past", at_least=1)
        if self.order is not None and not 1 <= _checks.count(self.order, "order") <= self._most:
            raise InputError(f"the order must lie between 1 and {self._most} here", got=self.order,
                             why="the state is read from future · outputs · basis functions predicted values",
                             mend="raise future and past")

    @property
    def _most(self) -> int:
        return self._ahead * len(self.output) * self.basis.size

    @property
    def _back(self) -> int:
        return self.past  # type: ignore[return-value]

    @property
    def _ahead(self) -> int:
        return min(self.future, self._back)

    @property
    def _inputs(self) -> tuple[str, ...]:
        return tuple(self.input)

    @property
    def _outputs(self) -> tuple[str, ...]:
        return tuple(self.output)

    def _parameters(self, order: int) -> int:
        return number_of_parameters(self.basis.size, order, len(self.input), len(self.output), direct=self.direct,
                                    affine=self.affine)

    def _affordable(self) -> int:
        signals = len(self.input) + len(self.output) + (1 if self.affine else 0)
        direct = (len(self.input) if self.direct else 0) + (1 if self.affine else 0)
        fits = [v for v in range(SHORTEST, LONGEST + 1)
                if number_of_words(self.basis.size, signals, direct, v) <= WRITTEN]
        return max(fits, default=KERNEL_PAST)

    @property
    def start(self) -> int:
        return self._back

    def estimate(self, records: Sequence[Record]) -> Identification:
        box = scheduling_box(records, self.basis)
        bound = replace(self, basis=self.basis.bound(box))
        refuse_poor_data(records, bound._inputs, bound._outputs, self._back, self._parameters(self.order or 1))
        used, notes = _thinned(records, self._back)
        with single_thread():
            return bound._estimate(used, box, notes)

    def _estimate(self, records: Sequence[Record], box: Scheduling, notes: list[str]) -> Identification:
        traces, scales = self._traces(records, box)
        predicted, stated = self._predicted(traces)
        singular, basis = _principal(predicted)
        equations = sum(t.y[self._back:].size for t in traces)
        known = [n for n in range(1, min(self._most - 1, MAX_ORDER) + 1) if 2 * self._parameters(n) <= equations]
        order, how = self._order(records, singular, known)
        states = [g @ basis[:, :order] for g in predicted]
        listed = ", ".join(f"{s:.3g}" for s in singular[: max(order + 3, 6)])
        notes += [stated, f"singular values {listed}; order {order} {how}"]
        model, data, safe, shrunk = self._bounded(records, box, traces, states, scales)
        if safe is not model:
            notes.append("the estimated observer diverges on these data: "
                         + ("its gain was set to zero" if shrunk == 1 else f"the state matrix was shrunk by {shrunk}"))
        arrays = ("A", "B", "C", "observer_gain", *(("D",) if self.direct else ()),
                  *(("state_offset", "output_offset") if self.affine else ()))
        layout = StateSpaceLayout.full(safe, arrays)
        notes.append("standard errors are those of an efficient estimate at this point: a lower bound")
        end = StateSpaceSearchEnd(safe, evaluate(safe, data), data, 0, "not begun")
        return package(replace(self, order=order), end, layout, records, notes)

    def _predicted(self, traces: Sequence[Trace]) -> tuple[list[np.ndarray], str]:
        """Predicted outputs of every record at the mean of the basis functions, and what the regression is."""
        words, stated = self._words(traces)
        mean = np.mean(np.vstack([t.phi for t in traces]), axis=0)
        return [words.rows(t, mean, self._ahead) for t in traces], stated

    def _bounded(self, records: Sequence[Record], box: Scheduling, traces: Sequence[Trace],
                 states: Sequence[np.ndarray], scales: tuple[np.ndarray, np.ndarray]):
        """The matrices for these states, the data as they see them, and the nearest bounded model."""
        model = self._matrices(records, box, traces, states, scales)
        data = SearchData.of(records, model)
        return model, data, *bounded(model, data)

    # -- the order ----------------------------------------------------------------------------------------------
    def _order(self, records: Sequence[Record], singular: np.ndarray, known: Sequence[int]) -> tuple[int, str]:
        """The order, and how it was found: requested, by the free run out of fold, or by the singular values."""
        if self.order:
            return self.order, "as requested"
        if len(known) < 2:
            return max(known, default=1), "the only one that these data can carry"
        errors = free_run_errors(self, records, known)
        if not errors:
            return _order_by_gap(singular, max(known, default=1)), "from the largest gap (too short for folds)"
        least = min(errors.values())
        order = min(n for n, esr in errors.items() if esr <= (1 + NO_WORSE) * least)
        listed = ", ".join(f"{n}: {esr:.3g}" for n, esr in sorted(errors.items()))
        return order, f"by its free run out of {FOLDS} folds of these data (ESR by order {listed})"

    def by_order(self, records: Sequence[Record], orders: Sequence[int]) -> Iterator[tuple[int, LPVStateSpace | None]]:
        """Order and estimate for several orders from one regression; None where there is none.

        Parameters
        ----------
        records : sequence of Record
            Uniform and finite.
        orders : sequence of int
            Numbers of states.

        Yields
        ------
        int, LPVStateSpace or None
            The nearest model whose runs on these data are bounded.
        """
        box = scheduling_box(records, self.basis, check_basis=False)
        traces, scales = self._traces(records, box)
        predicted, _ = self._predicted(traces)
        directions = _principal(predicted)[1]
        for order in orders:
            states = [g @ directions[:, :order] for g in predicted]
            try:
                yield order, self._bounded(records, box, traces, states, scales)[2]
            except np.linalg.LinAlgError:
                yield order, None

    # -- the regression -----------------------------------------------------------------------------------------
    def _traces(self, records: Sequence[Record], box: Scheduling) -> tuple[list[Trace], tuple[np.ndarray, np.ndarray]]:
        """The records in units of their spread, letters of unit mean square."""
        u, y = [r.matrix(self.input) for r in records], [r.matrix(self.output) for r in records]
        su, sy = _spread(np.vstack(u)), _spread(np.vstack(y))
        phi = [self.basis.evaluate(r.matrix(box.names)) for r in records]
        unit = 1.0 / np.sqrt(np.mean(np.sum(np.vstack(phi) ** 2, axis=1)))
        traces = []
        for letters, inputs, outputs in zip(phi, u, y, strict=True):
            one = np.ones((len(inputs), 1 if self.affine else 0))
            now = np.hstack([inputs / su, one]) if self.direct else one
            traces.append(Trace(unit * letters, np.hstack([inputs / su, outputs / sy, one]), now, outputs / sy))
        return traces, (su, sy)

    def _words(self, traces: Sequence[Trace]) -> tuple[Words, str]:
        first = traces[0]
        number = number_of_words(first.phi.shape[1], first.z.shape[1], first.now.shape[1], self._back)
        total = sum(len(t.y) - self._back for t in traces)
        by_kernel = number > WRITTEN if self.kernel is None else self.kernel
        if not by_kernel:
            written = WrittenWords.fit(traces, self._back)
            return written, f"regression on {number} words and {total} rows, penalty {written.penalty:.3g}"
        kernel = KernelWords.fit(traces, self._back, KERNEL_ROWS)
        rows = sum(k.size for _, k in kernel.chosen)
        return kernel, f"kernel regression on {rows} of {total} rows, penalty {kernel.penalty:.3g}"

    # -- the matrices -------------------------------------------------------------------------------------------
    def _matrices(self, records: Sequence[Record], box: Scheduling, traces: Sequence[Trace],
                  states: Sequence[np.ndarray], scales: tuple[np.ndarray, np.ndarray]):
        """Output equation first, then the state equation with its residuals as the innovation."""
        su, sy = scales
        m, n, nu, ny = self.basis.size, states[0].shape[1], len(self.input), len(self.output)
        phi = [self.basis.evaluate(r.matrix(box.names))[self._back:] for r in records]
        u = [t.z[self._back:, :nu] for t in traces]
        y = [t.y[self._back:] for t in traces]
        one = [t.z[self._back:, nu + ny:] for t in traces]
        seen = [np.hstack([x, *([v] if self.direct else []), o]) for x, v, o in zip(states, u, one, strict=True)]
        output = _solve(phi, seen, y)
        errors = [b - _apply(p, s, output) for p, s, b in zip(phi, seen, y, strict=True)]
        drive = [np.hstack([x, v, o, e])[:-1] for x, v, o, e in zip(states, u, one, errors, strict=True)]
        state = _solve([p[:-1] for p in phi], drive, [x[1:] for x in states])
        c, rest = output[:, :n], output[:, n:]
        d = rest[:, :nu] if self.direct else np.zeros((m, nu, ny))
        g = rest[:, -1] if self.affine else np.zeros((m, ny))
        f = state[:, n + nu] if self.affine else np.zeros((m, n))
        turned = (0, 2, 1)
        return empty_model(records[0], box, self.basis, self.input, self.output, n).replace(
            A=state[:, :n].transpose(turned), B=state[:, n: n + nu].transpose(turned) / su, state_offset=f,
            observer_gain=state[:, -ny:].transpose(turned) / sy, C=c.transpose(turned) * sy[:, None],
            D=d.transpose(turned) * sy[:, None] / su, output_offset=g * sy)


def _spread(values: np.ndarray) -> np.ndarray:
    """Root mean square of every column, 1 where it is zero."""
    rms = np.sqrt(np.mean(values**2, axis=0))
    return np.where(rms > 0, rms, 1.0)


def _principal(predicted: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Singular values (per root sample) and directions, scaled so that the states have unit mean square."""
    total, count = sum(g.T @ g for g in predicted), sum(len(g) for g in predicted)
    values, vectors = np.linalg.eigh(total / count)  # type: ignore[operator]
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    singular = np.sqrt(values)
    return singular, vectors / np.maximum(singular, 1e-8 * max(singular[0], 1e-300))


def _order_by_gap(singular: np.ndarray, most: int) -> int:
    """Number of singular values before the largest relative drop."""
    floor = 1e-10 * max(float(singular[0]), 1e-300)
    head = np.maximum(singular[: most + 1], floor)
    return int(np.argmax(head[:-1] / head[1:])) + 1


def _solve(phi: Sequence[np.ndarray], signals: Sequence[np.ndarray], targets: Sequence[np.ndarray]) -> np.ndarray:
    """(M, signals, targets) coefficients of target(k) = Σ_m φ_m(k) Θ_mᵀ signal(k), by QR record after record."""
    m, width = phi[0].shape[1], signals[0].shape[1]
    factor = np.zeros((0, m * width + targets[0].shape[1]))
    for p, s, t in zip(phi, signals, targets, strict=True):
        columns = np.einsum("km,kw->kmw", p, s).reshape(len(p), -1)
        factor = triangle(np.vstack([factor, np.hstack([columns, t])]))
    k = m * width
    norms = np.linalg.norm(factor[:, :k], axis=0)
    scale = np.where(norms > 0, norms, 1.0)
    theta = np.linalg.lstsq(factor[:, :k] / scale, factor[:, k:], rcond=1e-10)[0] / scale[:, None]
    return theta.reshape(m, width, -1)


def _apply(phi: np.ndarray, signals: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    return np.einsum("km,kw,mwo->ko", phi, signals, coefficients)


def _thinned(records: Sequence[Record], past: int) -> tuple[list[Record], list[str]]:
    """Evenly spread pieces where there are more samples than `MAX_SAMPLES`."""
    total = sum(r.n_samples for r in records)
    if total <= MAX_SAMPLES:
        return list(records), []
    piece = max(2000, 20 * past)
    pieces = [r.slice(first, first + piece) for r in records for first in range(0, r.n_samples - piece + 1, piece)]
    if not pieces:  # many short records
        return list(records), []
    keep = np.unique(np.linspace(0, len(pieces) - 1, MAX_SAMPLES // piece).astype(int))
    return [pieces[i] for i in keep], [f"states from {len(keep) * piece} of {total} samples, in evenly spread pieces"]
