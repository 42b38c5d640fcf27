"""The energy of a damper with a transfer function inside: its margin, its certificate, what it stores."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from lpvid.analysis.passivity import certify_passivity
from lpvid.analysis.passivity_margin import passivity_margin
from lpvid.lmi.passive_form import obstacle, preload, sector_basis, supplied
from lpvid.model.transfer_function import LPVTransferFunction
from quartercar.dampers.blackbox.sampled import SampledDamper

if TYPE_CHECKING:
    from lpvid.analysis.passivity_certificate import PassivityCertificate
    from lpvid.analysis.passivity_margin import PassivityMargin
    from lpvid.scheduling import Scheduling
    from quartercar.dampers.contract import Damper

DEGREE = 0
"""of the storage functions that are tried: one for all currents, a fraction of a second, and what `Passive` ends at."""
BEYOND = 1e-9
"""share of the range of the current that counts as inside it: rounding."""
KEPT = 16
"""Certificates that are remembered: those of the dampers of one comparison or one set of rides."""


def _transfer_function_of(damper: Damper | None) -> LPVTransferFunction | None:
    """The transfer function from velocity to force inside a damper, in its own sense; None where there is none."""
    if not isinstance(damper, SampledDamper) or damper.stored is None:
        return None
    model = damper.held.at(damper.vector)
    if not isinstance(model, LPVTransferFunction) or [s.name for s in model.inputs] != ["velocity"]:
        return None
    return model


def margin_of(damper: Damper | None) -> PassivityMargin | None:
    """Damping in steady motion by current and frequency; None for a damper without such a model.

    Parameters
    ----------
    damper : Damper or None
        Of any kind.

    Returns
    -------
    PassivityMargin or None
        Of the transfer function from velocity to force inside a sampled damper, at amplitudes up to the largest speed
        of its training records; at any where that is not known.
    """
    model = _transfer_function_of(damper)
    if model is None or damper is None:
        return None
    return passivity_margin(model, largest=damper.largest_speed)


def certificate_for(damper: Damper | None) -> PassivityCertificate | None:
    """A certificate of passivity for any motion of the current; None where there is none.

    Parameters
    ----------
    damper : Damper or None
        Of any kind.

    Returns
    -------
    PassivityCertificate or None
        Verified; the last `KEPT` are remembered. None too where no proof was found, which does not show that energy is
        given.
    """
    model = _transfer_function_of(damper)
    if model is None or obstacle(model) or preload(model) is None:
        return None
    key = supplied(model, np.zeros(sector_basis(model).size if model.n_filter_inputs > 1 else 0)).digest
    found = _certificate(_Keyed(key + repr(model.box.to_dict()), model))
    return found if found.verified else None


class _Keyed:
    """A model that is the same as another where its key is."""

    def __init__(self, key: str, model: LPVTransferFunction) -> None:
        self.key, self.model = key, model

    def __hash__(self) -> int:
        return hash(self.key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Keyed) and other.key == self.key


@lru_cache(maxsize=KEPT)
def _certificate(keyed: _Keyed) -> PassivityCertificate:
    return certify_passivity(keyed.model, degree=DEGREE)


def stored_energy(damper: Damper | None, velocity: np.ndarray, current: np.ndarray, force: np.ndarray
                  ) -> np.ndarray | None:
    """(n + 1,) energy [J] in a certified damper before each sample of a run at its own rate, and after the last.

    Before the first sample it was at rest. None for a damper without a certificate, or at currents beyond it.

    Parameters
    ----------
    damper : Damper
    velocity, current : (n,) arrays
        [m/s], [A]
    force : (n,) array
        Without the force at rest [N].

    Returns
    -------
    (n + 1,) array or None
        [J].
    """
    model, certificate = _transfer_function_of(damper), certificate_for(damper)
    if model is None or certificate is None:
        return None
    p = current[:, None] if model.box.names else np.zeros((len(velocity), 0))
    if model.scheduling_stage is not None:
        p = model.scheduling_stage.apply(p, model.sample_time)
    if len(p) and model.box.names and not _inside(p, model.box):
        return None
    u = velocity[:, None]
    u = u if model.input_stage is None else model.input_stage.apply(u, p)
    rows = len(velocity) + 1
    columns = [_behind(force, lag, rows) for lag in range(model.na)]
    columns += [_behind(u[:, q], lag, rows) for lag in range(model.n_lags - 1) for q in range(u.shape[1])]
    ahead = np.vstack([p, p[-1:]])
    return certificate.stored(np.column_stack(columns) if columns else np.zeros((rows, 0)), ahead)


def _inside(p: np.ndarray, box: Scheduling) -> bool:
    low, high = np.array(box.lower), np.array(box.upper)
    return bool(np.all(p >= low - BEYOND * (high - low)) and np.all(p <= high + BEYOND * (high - low)))


def _behind(values: np.ndarray, lag: int, rows: int) -> np.ndarray:
    """Values of the sample `lag` + 1 before each of `rows`, zero before the first."""
    out = np.zeros(rows)
    out[lag + 1 :] = values[: rows - 1 - lag]
    return out
