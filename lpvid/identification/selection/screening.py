"""Screening: the residual sums of all nested ARX structures from one R factor per family."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lpvid.errors import InputError
from lpvid.identification.arx import ARX, scheduling_box
from lpvid.identification.regression import SINGULAR, Factor
from lpvid.identification.result import Identification
from lpvid.model.input_stage import InputStage
from lpvid.model.scheduling_stage import SchedulingStage
from lpvid.record import Record
from lpvid.scheduling import Scheduling

PILOT_ORDER = 4
"""order of the structure to which a family's stages are fitted before its orders are compared."""


@dataclass(frozen=True, eq=False)
class Screened:
    """A candidate with what one least squares on the common rows states of it.

    Attributes
    ----------
    asked, structure : ARX
        As given, and with its basis bound and its stages fitted.
    box : Scheduling
    factor : Factor
        R of its own columns.
    n_parameters : int
        All outputs together, stages included.
    bic, aicc : float
    one_step : float
        Training one-step fit [%].
    """

    asked: ARX
    structure: ARX
    box: Scheduling
    factor: Factor
    n_parameters: int
    bic: float
    aicc: float
    one_step: float

    def identification(self, records: Sequence[Record]) -> Identification:
        """The estimate on the common rows.

        Parameters
        ----------
        records : sequence of Record
            Those of the screening.

        Returns
        -------
        Identification
        """
        return self.structure.solved(records, self.box, self.factor)


@dataclass(frozen=True, eq=False)
class Refused:
    """A candidate that could not be compared, and why.

    Attributes
    ----------
    asked : ARX
        As given.
    reason : str
        For the ranking's row.
    """

    asked: ARX
    reason: str


def screen(records: Sequence[Record], structures: Sequence[ARX],
           report_progress: Callable[[str], None]) -> Iterator[Screened | Refused]:
    """Information criteria of every structure, all on the same rows.

    ::

        BIC = N ln det(S/N) + K ln N        AICc = N ln det(S/N) + 2 K N/(N − K − 1)

    S is the residual matrix of N equations per output and K the number of parameters (Schwarz 1978; Hurvich & Tsai
    1989). The largest regressor of a family (one basis, stage and filter) is factorised once; the residual of any
    structure nested in it is that of the corresponding columns of R.

    Parameters
    ----------
    records : sequence of Record
        Uniform and finite.
    structures : sequence of ARX
    report_progress : callable
        Receives a line before every family.

    Yields
    ------
    Screened or Refused
        One per structure, family by family.
    """
    start = max(s.start for s in structures)
    power = _power(records, structures[0].output, start)
    families: dict[tuple, list[ARX]] = {}
    for s in structures:
        families.setdefault((s.input, s.output, s.basis, s.stage, s.schedule_filter, s.lagged, s.weight), []).append(s)
    fitted: dict[tuple, ARX | str] = {}
    for key, members in families.items():
        report_progress(f"screening {len(members)} structures")
        stages = (*key[:5], key[6])
        if stages not in fitted:
            alike = [s for k, group in families.items() if (*k[:5], k[6]) == stages for s in group]
            fitted[stages] = _fitted(records, alike)
        pilot = fitted[stages]
        if isinstance(pilot, str):
            yield from (Refused(s, pilot) for s in members)
        else:
            yield from _family(records, members, pilot, start, power)


def _fitted(records: Sequence[Record], members: Sequence[ARX]) -> ARX | str:
    """A structure of the family with bound basis and fitted stages, or why there is none."""
    pilot = min(members, key=lambda s: (abs(s.na - PILOT_ORDER) + sum(abs(b - PILOT_ORDER) for b in s.width),
                                        s.delay, s.lagged, abs(s.affine - 1)))
    try:
        if isinstance(pilot.stage, str) or isinstance(pilot.schedule_filter, str):
            return pilot.estimate(records).structure
        return replace(pilot, basis=pilot.basis.bound(scheduling_box(records, pilot.basis)))
    except InputError as error:
        return error.what + (f" ({error.why})" if error.why else "")


def _family(records: Sequence[Record], members: Sequence[ARX], pilot: ARX, start: int,
            power: np.ndarray) -> Iterator[Screened | Refused]:
    box = scheduling_box(records, pilot.basis, check_basis=False)
    bound = [replace(s, basis=pilot.basis, stage=pilot.stage, schedule_filter=pilot.schedule_filter) for s in members]
    first = tuple(min(s.delay[i] for s in bound) for i in range(len(pilot.input)))
    last = tuple(max(s.delay[i] + s.width[i] for s in bound) for i in range(len(pilot.input)))
    whole = replace(bound[0], na=max(s.na for s in bound), nk=first, affine=max(s.affine for s in bound),
                    nb=tuple(b - a for a, b in zip(first, last, strict=True)))
    column = {tuple(row): i for i, row in enumerate(whole.places().tolist())}
    factor = whole.factor(records, box, start)
    for asked, structure in zip(members, bound, strict=True):
        columns = [column[tuple(row)] for row in structure.places().tolist()]
        yield _judge(asked, structure, box, nested(factor, columns), power)


def nested(factor: Factor, columns: Sequence[int]) -> Factor:
    """R of some columns of X, from R of all: no pass over the data.

    Parameters
    ----------
    factor : Factor
        R of [X Y] with all columns.
    columns : sequence of int
        Places of the columns of X that are kept, in the order wanted.

    Returns
    -------
    Factor
    """
    outputs = range(factor.columns, factor.r.shape[1])
    chosen = factor.r[:, [*columns, *outputs]]
    return Factor(np.asarray(np.linalg.qr(chosen, mode="r")), factor.rows, len(columns))


def _judge(asked: ARX, structure: ARX, box: Scheduling, factor: Factor, power: np.ndarray) -> Screened | Refused:
    k, n = factor.columns, factor.rows
    scale = np.linalg.norm(factor.r[:k, :k], axis=0)
    if not np.all(scale > 0) or np.abs(np.diag(factor.r)[:k] / scale).min() < 10 * SINGULAR:
        return Refused(asked, "its regressors are linearly dependent")
    residual = factor.r[k:, k:]
    ny = residual.shape[1]
    stages = sum(s.vector.size for s in (structure.stage, structure.schedule_filter)
                 if isinstance(s, InputStage | SchedulingStage))
    size = k * ny + stages
    if n - size / ny - 1 <= 0:
        return Refused(asked, f"{n} equations cannot determine its {k} parameters per output")
    sign, logdet = np.linalg.slogdet(residual.T @ residual / n)
    cost = n * logdet if sign > 0 else -np.inf
    esr = float(np.mean(np.sum(residual**2, axis=0) / power))
    return Screened(asked, structure, box, factor, size, cost + size * np.log(n), cost + 2 * size * n / (n - size - 1),
                    100 * (1 - np.sqrt(esr)))


def _power(records: Sequence[Record], outputs: Sequence[str], start: int) -> np.ndarray:
    moved = [r.matrix(outputs)[start:] for r in records if r.n_samples > start]
    if not moved:
        raise InputError("every record is shorter than the largest candidate's past", got=f"{start} samples",
                         mend="give longer records, or smaller orders")
    return np.maximum(np.sum([np.sum((y - y.mean(axis=0)) ** 2, axis=0) for y in moved], axis=0), 1e-300)
