"""Whether a model that explains nothing would explain the same records with an output's sign turned."""

from __future__ import annotations

from collections.abc import Sequence

from lpvid.caveat import Caveat
from lpvid.record import Record
from lpvid.simulation import Model, simulate
from lpvid.validation.figures import Figures, Pool


def opposite_remark(model: Model, pieces: Sequence[Record], found: Figures) -> str | None:
    """What to try where a sensor's sign may have changed since training.

    Only where the free run is worse than the output's mean (ESR above 1); stated only where the run of the turned
    output, from its own first samples, is better than its mean.

    Parameters
    ----------
    model : LPVTransferFunction, LPVStateSpace or SelfScheduled
        With one output; others are passed over.
    pieces : sequence of Record
        Uniform, at the model's rate.
    found : Figures
        Of the free run as measured.

    Returns
    -------
    str or None
    """
    if len(model.outputs) != 1 or found.esr is None or found.esr <= 1:
        return None
    (name,), pool = [s.name for s in model.outputs], Pool()
    for piece in pieces:
        turned = piece.with_channel(name, -piece[name])
        pool.add(turned.matrix([name]), simulate(model, turned))
    other = pool.total("free-run")
    if other.esr is None or other.esr >= 1 or other.fit_percent is None:
        return None
    return Caveat(f"with the sign of '{name}' turned the free-run fit would be {other.fit_percent:.1f} %: its polarity "
                  f"is another than in the training data; --flip {name}")
