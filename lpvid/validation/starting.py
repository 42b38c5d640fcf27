"""Whether a free run is wrong because of where it starts: the same run from an estimated past."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from lpvid.caveat import Caveat
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.record import Record
from lpvid.simulation import Model, simulate
from lpvid.validation.figures import Figures, Pool
from lpvid.validation.trust import esr_interval, independent_samples

ROWS_PER_PARAMETER = 3
"""fewest samples for each past output that is estimated, as for any fit that is to be trusted (`training_doubt`)"""


def from_estimated_past(model: Model, pieces: Sequence[Record], found: Figures, count: float | None) -> Figures | None:
    """The free run of the same samples from an estimated past, where that is better by more than both are uncertain.

    A transfer function starts from its first measured samples, whose noise a slow mode carries on for as long as it
    decays. Such a free run shows the start, not the model. The two runs differ where the 95 % intervals of their ESR
    (`esr_interval`) do not meet.

    Parameters
    ----------
    model : LPVTransferFunction, LPVStateSpace or SelfScheduled
        Others than transfer functions are passed over: a state space weighs its start against what its state can be.
    pieces : sequence of Record
        Uniform, at the model's rate; where one is too short to estimate its past from, none is.
    found : Figures
        Of the free run from measured samples.
    count : float or None
        `independent_samples` of its residual.

    Returns
    -------
    Figures or None
    """
    if not isinstance(model, LPVTransferFunction) or not model.na or found.esr is None or not count:
        return None
    if any(p.n_samples < (1 + ROWS_PER_PARAMETER) * model.start for p in pieces):
        return None
    names, pool, residuals = [s.name for s in model.outputs], Pool(), []
    for piece in pieces:
        run = replace(simulate(model, piece, "estimate"), start=model.start)
        y = piece.matrix(names)
        pool.add(y, run)
        residuals.append((y - run.output)[model.start:, 0])
    other = pool.total("free-run")
    if other.esr is None or not other.esr < found.esr:
        return None
    least, most = esr_interval(found.esr, count)[0], esr_interval(other.esr, independent_samples(residuals))[1]
    return other if most < least else None


def start_remark(found: Figures, other: Figures) -> str:
    """The two figures beside each other in words.

    Parameters
    ----------
    found : Figures
        From measured samples.
    other : Figures
        From an estimated past.

    Returns
    -------
    str
    """
    return Caveat(f"the free-run error is that of its start: from the first measured samples fit "
                  f"{found.fit_percent:.1f} %, from a past estimated from the record's beginning fit "
                  f"{other.fit_percent:.1f} %; a slow mode of the model carries the error of the first samples on")
