"""Quasi-LPV: an input-output model scheduled on its own simulated output, fitted to its free run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from lpvid import _checks
from lpvid._threads import single_thread
from lpvid.errors import InputError, NumericalError, TooFewSamples
from lpvid.identification.arx import require_motion_of, scheduling_box
from lpvid.identification.free_run_search import FreeRunSearchEnd, Prior, minimise, package, wanted_filter
from lpvid.identification.quasi_problem import QuasiProblem
from lpvid.identification.result import Identification
from lpvid.identification.structure import Structure
from lpvid.model.quasi import ON, QuasiLPVModel, checked_own
from lpvid.model.scheduling_stage import FITTED, SchedulingStage
from lpvid.model.signals import Signal
from lpvid.record import Record
from lpvid.scheduling import Basis, Polynomial, Scheduling, Spline
from lpvid.scheduling.basis import checked_basis

TRIALS = (0.2, 0.0, 0.6)
"""starting trial weights, in units of output spread over input spread."""


@dataclass(frozen=True)
class QuasiLPV(Structure):
    """LPV input-output structure whose scheduling variable is simulated along with it.

    The equations stand at `lpvid.model.quasi.QuasiLPVModel`. Its start is the least squares of one step; then the
    prediction error of the free run is minimised by Levenberg-Marquardt with exact sensitivities, which carry the path
    ∂φ/∂ρ·∂ρ/∂θ through the scheduling variable. A step whose run leaves all bounds is refused.

    With na = 0 (the default) and hat functions, the output is a convex mixture of finitely many linear functions of the
    input's recent past: bounded for every bounded input, whatever the data were (`QuasiLPVModel.output_bound`). All
    memory beyond the input lags is then in the scheduling variable.

    With na > 0 the equations of the prior are scaled by the error of one step over the spread of the output, without
    which they would outweigh the data wherever these are good; with na = 0 they are not. A second search then starts
    from the end of one under the unscaled prior, and the one with the least cost is returned.

    Parameters
    ----------
    na : int
        Linear output lags. With na > 0, certify ``model.embedding()``.
    nb, nk : int or one per input
        Number of input lags, and the first of them.
    input, output : str or sequence of str
        Channels; one output.
    basis : Basis
        `Spline(output, segments, order=1)` (hat functions) or `Polynomial(output, degree)` of the scheduling variable,
        named like the output, or like the first input for on="input".
    on : {"output", "trial", "input"}
        ρ = y(k−1); y(k−1) plus fitted weights on the first input (the trial force of a yielding element); u(k−1).
    trial : int
        Input lags in the trial variable.
    external : Basis, optional
        Dependence on a measured scheduling variable, multiplied with `basis`.
    schedule_filter : None, name or SchedulingStage
        Filter on the measured scheduling variable; a name is fitted along.
    smoothness : float
        Weight of the second differences of neighbouring hat coefficients, in equivalent samples: a prior, for ranges
        that the data do not visit.
    ridge : float
        Weight of every coefficient itself, in equivalent samples.
    oddness : float
        Weight of the odd symmetry y(−u) = −y(u), in equivalent samples; the hats then stand symmetrically.
    max_iterations : int
    tolerance : float
        Stop when the cost falls by less than this share.

    Examples
    --------
    >>> QuasiLPV(nb=4, input="velocity", output="force", basis=Spline("force", segments=10, order=1)).start
    3
    """

    KIND = "quasi-lpv"
    JSON = ("na", "nb", "nk", "input", "output", "basis", "on", "trial", "external", "schedule_filter", "smoothness",
            "ridge", "oddness")

    na: int = 0
    nb: int | tuple[int, ...] = 4
    nk: int | tuple[int, ...] = 0
    input: str | tuple[str, ...] = "velocity"
    output: str | tuple[str, ...] = "force"
    basis: Basis = field(default_factory=lambda: Spline("force", segments=8, order=1))
    on: str = "output"
    trial: int = 1
    external: Basis = field(default_factory=Polynomial)
    schedule_filter: SchedulingStage | str | None = None
    smoothness: float = 4.0
    ridge: float = 0.1
    oddness: float = 0.0
    max_iterations: int = 80
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        set_(self, "input", _checks.names(self.input, "input"))
        set_(self, "output", _checks.names(self.output, "output"))
        if len(self.output) != 1 or self.output[0] in self.input:
            raise InputError("a quasi-LPV structure has one output that is no input", got=", ".join(self.output))
        _checks.count(self.na, "na")
        set_(self, "nb", _checks.counts(self.nb, len(self.input), "nb", at_least=1))
        set_(self, "nk", _checks.counts(self.nk, len(self.input), "nk"))
        _checks.one_of(self.on, ON, "on")
        _checks.count(self.trial, "trial", at_least=1)
        _checks.count(self.max_iterations, "max_iterations")
        checked_basis(self.basis)
        checked_own(self.basis)
        own = self.input[0] if self.on == "input" else self.output[0]
        if self.basis.names != (own,):
            raise InputError(f"a quasi-LPV structure on='{self.on}' has a basis of '{own}'",
                             got=", ".join(self.basis.names))
        if isinstance(self.schedule_filter, str):
            _checks.one_of(self.schedule_filter, tuple(FITTED), "schedule_filter")
        if self.schedule_filter is not None and not self.external.names:
            raise InputError("a scheduling filter needs a measured scheduling variable", mend="give an external basis")
        for name in ("smoothness", "ridge", "oddness"):
            if not _checks.real(getattr(self, name), name) >= 0:
                raise InputError(f"{name} must not be negative", got=getattr(self, name))

    @property
    def summary(self) -> str:
        nb, nk = (",".join(map(str, n)) if isinstance(n, tuple) else n for n in (self.nb, self.nk))
        trial = f" over {self.trial} lags" if self.on == "trial" and self.trial > 1 else ""
        return (f"QuasiLPV on {self.on}{trial} na={self.na} nb={nb} nk={nk} {self.basis.summary}"
                + (" nearly odd" if self.oddness else ""))

    @property
    def channels(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((*self.input, *self.output, *self.external.names)))

    @property
    def start(self) -> int:
        lags = zip(self._tuple(self.nb), self._tuple(self.nk), strict=True)
        trial = self._tuple(self.nk)[0] + self.trial - 1 if self.on == "trial" else 0
        return max(self.na, 1, trial, *(b + k - 1 for b, k in lags))

    @staticmethod
    def _tuple(value: int | tuple[int, ...]) -> tuple[int, ...]:
        assert isinstance(value, tuple)
        return value

    # -- estimate -----------------------------------------------------------------------------------------------
    def estimate(self, records: Sequence[Record]) -> Identification:
        for name in (*self.input, *self.output):
            require_motion_of(records, name, "input" if name in self.input else "output")
        box = scheduling_box(records, self.external)
        wanted = self.basis.size * self.external.size * (self.na + sum(self._tuple(self.nb)) + 1)
        equations = sum(r.n_samples - self.start for r in records)
        if equations <= wanted:
            raise TooFewSamples(f"{equations} equations cannot determine {wanted} parameters",
                                mend="give longer records, or fewer lags or segments")
        with single_thread():
            tried = [t for k in self._kappas(records) if (t := self._from(records, box, k)) is not None]
            if not tried:
                raise NumericalError("every start of the quasi-LPV search diverges in free run; lower the degree, or "
                                     "use hat functions with na=0, which cannot diverge")
            problem, found = min(tried, key=lambda t: t[1].cost)
            note = () if len(tried) < 2 else (f"best of {len(tried)} starts",)
            return package(self, problem.model_at(found.trial.x), problem, found, records, note)

    def _kappas(self, records: Sequence[Record]) -> list[np.ndarray]:
        if self.on != "trial":
            return [np.zeros(0)]
        y, u = (np.concatenate([r[n] for r in records]) for n in (self.output[0], self.input[0]))
        unit = float(np.std(y) / np.std(u)) * np.sign(np.corrcoef(y, u)[0, 1] or 1.0)
        return [np.append(share * unit, np.zeros(self.trial - 1)) for share in TRIALS]

    def _from(self, records: Sequence[Record], box: Scheduling,
              kappa: np.ndarray) -> tuple[QuasiProblem, FreeRunSearchEnd] | None:
        """One search from trial weights `kappa`."""
        assert records[0].sample_time is not None
        external = self.external.bound(box) if box.names else self.external
        stage = wanted_filter(self.schedule_filter, records[0].sample_time)
        nb, nk = self._tuple(self.nb), self._tuple(self.nk)
        shape = (self.basis.size, external.size, self.na + sum(nb) + 1)
        model = QuasiLPVModel(np.zeros(shape), self.basis.bound(self._range(records, kappa)), self.na, nb, nk,
                              records[0].sample_time, tuple(Signal(n, records[0].unit(n)) for n in self.input),
                              (Signal(self.output[0], records[0].unit(self.output[0])),), self.on, kappa, external, box,
                              stage)
        problem = QuasiProblem.of(records, model, isinstance(self.schedule_filter, str))
        scales, prior = self._prior(problem)
        if self.na:
            ends = self._with_lags(problem, prior, scales)
        else:
            ends = [self._search(problem, prior, scales, problem.one_step(prior))]
        runs = [end for end in ends if end is not None]
        return (problem, min(runs, key=lambda end: end.trial.cost)) if runs else None

    def _with_lags(self, problem: QuasiProblem, prior: Prior, scales: np.ndarray) -> list[FreeRunSearchEnd | None]:
        """Searches from the data's one step, and from the end under the prior in units of the output.

        The former is near where the data are good; where noise hides the lags its free run is far off or none, and the
        strong prior leads to calm models first.
        """
        model, start = problem.model, problem.one_step(prior)
        strong = Prior(prior.rows / self._share_of_noise(problem), prior.values)
        before = problem.one_step(strong)
        calm = self._search(problem, strong, scales, before)
        if calm is None:  # a start that runs: without feedback through the linear lags
            before[: model.theta.size].reshape(model.theta.shape)[:, :, : self.na] *= 0.5
            calm = self._search(problem, strong, scales, before)
        ends = [self._search(problem, prior, scales, start)]
        return ends if calm is None else [*ends, self._search(problem, prior, scales, calm.trial.x)]

    def _search(self, problem: QuasiProblem, prior: Prior, scales: np.ndarray,
                start: np.ndarray) -> FreeRunSearchEnd | None:
        return minimise(problem, prior, start, scales, max_iterations=self.max_iterations, tolerance=self.tolerance)

    def _range(self, records: Sequence[Record], kappa: np.ndarray) -> Scheduling:
        """Range of the scheduling variable along the measured training data."""
        name = self.basis.names[0]
        low, high = np.inf, -np.inf
        for r in records:
            rho = np.array(r[name][self.start - 1: -1])
            for j, weight in enumerate(kappa):
                first = self.start - self._tuple(self.nk)[0] - j
                rho += weight * r[self.input[0]][first: first + rho.size]
            low, high = min(low, float(rho.min())), max(high, float(rho.max()))
        if self.oddness:
            high = max(-low, high)
            low = -high
        return Scheduling((name,), (low,), (high,))

    def _prior(self, problem: QuasiProblem) -> tuple[np.ndarray, Prior]:
        """Scales of the parameters, and the prior's equations in units of the output."""
        model, m = problem.model, self.basis.size
        _, e, r = model.theta.shape
        regressors = np.vstack([rows[model.start:] for rows in problem.measured_rows()])
        size = np.sqrt(np.maximum(np.mean(regressors**2, axis=0), 1e-300))
        unit = np.kron(np.eye(e), np.diag(size))
        blocks = [np.sqrt(self.ridge) * np.kron(np.eye(m), unit)]
        hats = isinstance(self.basis, Spline)
        if hats and m > 2:
            blocks.append(np.sqrt(self.smoothness) * np.kron(np.diff(np.eye(m), 2, axis=0), unit))
        if self.oddness:
            constant = np.kron(np.eye(e), np.diag(np.arange(r) == r - 1)).astype(float)
            mirror = np.eye(m)[::-1] if hats else np.diag((-1.0) ** np.arange(m))
            for keep, sign in ((constant, 1.0), (np.eye(e * r) - constant, -1.0)):
                blocks.append(np.sqrt(self.oddness) * 0.5 * np.kron(np.eye(m) + sign * mirror, keep @ unit))
        rows = np.vstack(blocks) * (self._share_of_noise(problem) if self.na else 1.0)
        extra = model.kappa.size + problem.filter_scales.size
        scales = np.tile(float(np.std(np.concatenate(problem.outputs))) / size, m * e)
        trial = np.full(model.kappa.size, float(np.std(problem.outputs[0])) * 0.1 / size[self.na])
        own = problem.filter_scales
        return np.concatenate([scales, trial, own]), Prior(np.hstack([rows, np.zeros((len(rows), extra))]),
                                                           np.zeros(len(rows)))

    @staticmethod
    def _share_of_noise(problem: QuasiProblem) -> float:
        """Error of one step over the output's size: what makes one equation of the prior as much as one sample.

        A sample counts with the square of its error, an equation of the prior with that of a contribution, which is of
        the output's size: with linear lags, whose coefficients are near −2 and 1 at a high rate, a million samples
        where the noise is a thousandth. Without lags the free run's error is a fair share of the output.
        """
        spread = float(np.std(np.concatenate(problem.outputs)))
        return max(problem.one_step_error() / spread, float(np.sqrt(np.finfo(float).eps)))

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Plain values by name.
        """
        return {**super().to_dict(), "nb": list(self._tuple(self.nb)), "nk": list(self._tuple(self.nk))}
