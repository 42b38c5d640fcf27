"""Sparse LPV-ARX: which coefficients depend on which scheduling variable, found from the R factor alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid import _checks
from lpvid._threads import single_thread
from lpvid.errors import InputError
from lpvid.identification._support import Supports, units_of, variables_of
from lpvid.identification.arx import ARX, ThroughARX, scheduling_box
from lpvid.identification.covariance import sandwich_covariance
from lpvid.identification.layout import ParameterLayout
from lpvid.identification.regression import Columns, Factor, factorize
from lpvid.identification.result import COVARIANCE_LIMIT, Identification
from lpvid.record import Record

METHODS = ("garrote", "adaptive-lasso")
CRITERIA = ("bic", "cv")
GROUPS = ("parameter", "coefficient", "variable")
FOLDS = 5


@dataclass(frozen=True)
class SparseARX(ThroughARX):
    """An LPV-ARX of which only the parameters that the data support are kept.

    ::

        garrote:         min_c ‖y − Σ_j c_j θ̂_j x_j‖² + 2μ Σ_j c_j,  c_j ≥ 0        (Breiman 1995)
        adaptive lasso:  min_θ ‖y − Xθ‖² + 2μ Σ_j |θ_j|/|θ̂_j|                      (Zou 2006)

    θ̂ is the full least squares. The whole path over μ is followed by homotopy on the R factor; every support on it is
    refitted by least squares, the criterion chooses one, and single units are then added or dropped while BIC falls.

    Parameters
    ----------
    arx : ARX
        The full structure, without ridge.
    method : {"garrote", "adaptive-lasso"}
    criterion : {"bic", "cv"}
        BIC of the refit, or blocked cross-validation of the one-step error for the number of parameters (fewest within
        one standard error).
    group : {"parameter", "coefficient", "variable"}
        What goes in or out together: single parameters; all of a coefficient's functions of the same variables; or
        those of all coefficients, so that a variable is in the model or not. The last two keep the constant parts
        and take a garrote on the groups.

    Examples
    --------
    >>> SparseARX(ARX(na=2, nb=2)).channels
    ('velocity', 'force')
    """

    KIND = "sparse-arx"

    arx: ARX
    method: str = "garrote"
    criterion: str = "bic"
    group: str = "parameter"

    def __post_init__(self) -> None:
        _checks.one_of(self.method, METHODS, "method")
        _checks.one_of(self.criterion, CRITERIA, "criterion")
        _checks.one_of(self.group, GROUPS, "group")
        if self.arx.ridge:
            raise InputError("sparsity starts from plain least squares", got="an ARX with ridge", mend="set ridge to 0")
        if self.group != "parameter":
            if self.method != "garrote":
                raise InputError("groups are chosen by the garrote", got=self.method, mend='method="garrote"')
            if "1" not in self.arx.basis.labels:
                raise InputError("groups need a basis with a constant function",
                                 got=", ".join(self.arx.basis.labels[:4]),
                                 why="without it no coefficient can be constant",
                                 mend='use a Polynomial, or group="parameter"')

    def estimate(self, records: Sequence[Record]) -> Identification:
        full = self.arx
        if full.fits_stages:
            fitted = full.estimate(records).structure
            full = replace(full, stage=fitted.stage, schedule_filter=fitted.schedule_filter)
        box = scheduling_box(records, full.basis)
        full = replace(full, basis=full.basis.bound(box))
        with single_thread():
            whole = full.regress(records, box)
            factor = full.factor(records, box)
            supports = [self._support(records, full, box, factor, o) for o in range(len(full.output))]
            return self._package(whole, full, factor, supports)

    def coloured_covariance(self, records: Sequence[Record], found: Identification, memory: int) -> np.ndarray | None:
        if len(self.arx.output) > 1 or not isinstance(found.layout, ParameterLayout):
            return None
        full = self.arx._data(found.model.box, None)
        place = {tuple(row): i for i, row in enumerate(self.arx.places().tolist())}
        kept = [place[tuple(row)] for row in found.layout.table[:, [0, 1, 3, 4]].tolist()]
        c = full.columns
        columns = Columns(c.source[kept], c.sign[kept], c.lag[kept], c.function[kept], c.phi_lag[kept])
        data = replace(full, columns=columns)
        return sandwich_covariance(records, data, factorize(records, data), found.parameters[:, None], memory)

    def _support(self, records: Sequence[Record], full: ARX, box, factor: Factor, output: int) -> np.ndarray:
        units, always = units_of(full.places(), full.basis, box, self.group)
        signed = self.method == "adaptive-lasso"
        search = Supports.of(factor, output, units, always, signed)
        if self.criterion == "bic":
            return search.polished(search.best_by_bic())
        from lpvid.condition import folds

        sample_time = records[0].sample_time
        assert sample_time is not None
        errors: list[np.ndarray] = []
        for training, held in folds(list(records), FOLDS, full.start * sample_time):
            usable = [r for r in training if r.n_samples > full.start], [r for r in held if r.n_samples > full.start]
            if not all(usable):
                raise InputError("the records are too short for cross-validation", mend='use criterion="bic"')
            inner = Supports.of(full.factor(usable[0], box), output, units, always, signed)
            errors.append(inner.errors_by_size(full.factor(usable[1], box)))
        return search.of_size(_fewest(np.array(errors)))

    def _package(self, whole: Identification, full: ARX, factor: Factor, supports: list[np.ndarray]) -> Identification:
        k, ny = factor.columns, len(supports)
        assert isinstance(whole.layout, ParameterLayout)
        r11, r12, r22 = factor.r[:k, :k], factor.r[:k, k:], factor.r[k:, k:]
        inverses = [np.linalg.pinv(r11[:, s]) for s in supports]
        theta = [a @ r12[:, o] for o, a in enumerate(inverses)]
        misfit = np.column_stack([r12[:, o] - r11[:, s] @ theta[o] for o, s in enumerate(supports)])
        residual = np.vstack([misfit, r22])
        counts = np.sqrt(np.maximum(factor.rows - np.array([len(s) for s in supports]), 1))
        noise = residual.T @ residual / np.outer(counts, counts)
        covariance = np.block([[noise[o, q] * inverses[o] @ inverses[q].T for q in range(ny)] for o in range(ny)])
        layout = ParameterLayout(whole.layout.table[np.concatenate([o * k + s for o, s in enumerate(supports)])])
        metadata = {**whole.model.metadata, "structure": self.to_dict()}
        metadata.pop("parameters", None)
        if layout.size <= COVARIANCE_LIMIT:
            metadata["parameters"] = {"layout": layout.to_list(), "covariance": covariance.tolist()}
        empty = whole.layout.fill(whole.model, np.zeros(whole.layout.size))
        model = layout.fill(empty, np.concatenate(theta)).replace(noise_covariance=noise, metadata=metadata)
        kept = [r11[:, s] for s in supports]
        condition = max(float(np.linalg.cond(x)) for x in kept)
        scaled = max(float(np.linalg.cond(x / np.linalg.norm(x, axis=0))) for x in kept)
        found = Identification(model, replace(self, arx=full), layout, covariance, condition, scaled, factor.rows)
        dead = [n for n in full.basis.names if not any(n in v for v in dependence(found).values())]
        notes = (*whole.notes, f"kept {layout.size} of {whole.layout.size} parameters ({self.method}, {self.criterion}"
                               f", by {self.group}); the standard errors ignore that they were chosen",
                 *(f"no coefficient depends on '{n}'" for n in dead))
        return found.replace(notes=notes)


def _fewest(errors: np.ndarray) -> int:
    """Number of units: the fewest within one standard error (of the paired difference) of the least mean error."""
    count = errors.shape[1]
    mean = errors.mean(axis=0)
    best = int(np.argmin(mean))
    for size in range(count):
        excess = errors[:, size] - errors[:, best]
        if excess.mean() <= np.std(excess, ddof=1) / np.sqrt(len(excess)):
            return size
    return best


def sparsify(records: Record | Sequence[Record], structure: ARX, method: str = "garrote", criterion: str = "bic", *,
             group: str = "parameter", sample_rate: float | None = None,
             held_out: Sequence[Record] | None = None) -> Identification:
    """Fit an ARX and keep only the parameters that the data support.

    Parameters
    ----------
    records : Record or sequence of Record
        Training data.
    structure : ARX
        The full structure.
    method, criterion, group
        As for `SparseARX`.
    sample_rate, held_out
        As for `identify`.

    Returns
    -------
    Identification
        Its layout holds the kept parameters alone, refitted by least squares; the others are zero in the model.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> rng = np.random.default_rng(0)
    >>> u, p, y = rng.normal(size=900), rng.uniform(-1, 1, 900), np.zeros(900)
    >>> for k in range(1, 900):
    ...     y[k] = 0.5 * y[k - 1] + (1 + 0.8 * p[k]) * u[k - 1] + 0.01 * rng.normal()
    >>> record = Record({"u": u, "p": p, "y": y}, sample_time=0.01)
    >>> full = ARX(na=2, nb=2, input="u", output="y", basis=Polynomial("p", degree=1))
    >>> sparsify(record, full).parameter_names
    ('a1[1]', 'b1[1]', 'b1[p]')
    """
    from lpvid.identification import identify

    return identify(records, SparseARX(structure, method, criterion, group), sample_rate=sample_rate,
                    held_out=held_out)


def dependence(found: Identification) -> dict[str, tuple[str, ...]]:
    """Scheduling variables that every kept coefficient depends on, e.g. ``{"a1": (), "b1": ("current",)}``.

    Parameters
    ----------
    found : Identification
        Of an input-output model.

    Returns
    -------
    dict of str to tuple of str
        By stem of the coefficient's name; variables in the order of the box, none for a constant one.

    Raises
    ------
    InputError
        The estimate is of another kind of model.
    """
    model = found.model
    of_function = variables_of(model.basis, model.box)
    if not isinstance(found.layout, ParameterLayout):
        raise InputError("dependence is read off the layout of an input-output model", got=type(found.model).__name__)
    listed: dict[str, set[str]] = {}
    for name, place in zip(found.parameter_names, found.layout.table, strict=True):
        listed.setdefault(name.split("[")[0], set()).update(of_function[place[4]])
    return {k: tuple(n for n in model.box.names if n in v) for k, v in listed.items()}
