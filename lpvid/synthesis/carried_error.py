"""What a design for a table promises of the plant that the table was taken from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lpvid.analysis.gain import l2_gain
from lpvid.lmi.driven import driven
from lpvid.lmi.gain_certificate import GainCertificate, recheck_gain
from lpvid.model.state_space import LPVStateSpace
from lpvid.synthesis.figures import channel
from lpvid.synthesis.generalized_plant import GeneralizedPlant
from lpvid.synthesis.interconnection import close_loop, finer_of
from lpvid.synthesis.result import Synthesis
from lpvid.synthesis.sampled_plants import DENSER

SHARES = (1e-6, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3)
"""by which the storage function's bound may rise on the plant's own values, before another one is looked for"""


def carried(plant: GeneralizedPlant, found: Synthesis) -> Synthesis:
    """A synthesis whose promise holds on the plant's own values, four times as many as its table has.

    The storage function is re-checked on the closed loop with the finer table; where it bounds no gain there, the
    analysis looks for another. What lies between those values is stated in a note.

    Parameters
    ----------
    plant : GeneralizedPlant
        Its system's ``metadata["interpolation"]`` holds the error of the table and the finer one.
    found : Synthesis
        For the table.

    Returns
    -------
    Synthesis
        `found` itself for a plant that is no table, without a finer one, or without a controller. "backed-off" where
        the bound rises by more than 2 %, "numerical" where none is found on the finer table.
    """
    about = plant.system.metadata.get("interpolation")
    if not about or found.controller is None or found.closed_loop is None:
        return found
    knots = int(np.prod([len(k) for k in about["knots"].values()]))
    stated = f"the plant is a table of {knots} knots that misses it by {about['error']:.2g} of an entry's size"
    if "finer" not in about:
        return found
    finer = finer_of(plant.system)
    if finer is None or not _same(plant.system, finer := finer.replace(scheduling=plant.box)):
        return replace(found, notes=(f"{stated}; its matrices were changed since, and the promise is the table's",
                                     *found.notes))
    dense = GeneralizedPlant(finer, plant.controls, plant.measurements)
    whole = close_loop(dense, found.controller)
    loop = channel(whole, *(_places(part, of) for part, of in ((found.closed_loop.inputs, whole.inputs),
                                                              (found.closed_loop.outputs, whole.outputs))))
    note = (f"{stated}; the gain was verified on {DENSER} times as many of its own values, between which about "
            f"{about['error'] / DENSER**2:.1g} is missed")
    if any(n not in plant.box.names for n in found.controller.box.names):
        rates = f"{stated}, and the controller reads rates: the promise is the table's"
        return replace(found, notes=(rates, *found.notes))
    best = _rechecked(found, loop)
    if best is None:
        gain = l2_gain(loop, trajectories=False)
        best = gain.certificate if math.isfinite(gain.upper) else None
    if best is None:
        return Synthesis("numerical", why=f"{stated}, and the closed loop could not be verified on its own values",
                         mend="sample the plant with a smaller tolerance, or raise back_off", infimum=found.infimum,
                         method=found.method, seconds=found.seconds, notes=found.notes)
    verified = best.gamma
    worse = found.gamma_verified is not None and verified > 1.02 * found.gamma_verified
    why = (f"{found.why}; on the plant's own values between the knots it keeps {verified:.6g}" if worse else found.why)
    return replace(found, gamma_verified=verified, gamma=max(found.gamma or 0.0, verified), closed_loop=loop,
                   certificate=best, between_grid=best.between_grid, notes=(note, *found.notes), why=why,
                   verdict="backed-off" if worse else found.verdict)


def _rechecked(found: Synthesis, loop: LPVStateSpace) -> GainCertificate | None:
    old = found.certificate
    if not isinstance(old, GainCertificate):
        return None
    system, storage = driven(loop), old.storage
    for share in SHARES:
        gamma = old.gamma * (1 + share)
        outcome = recheck_gain(system, storage, gamma, states=old.states, inverse=old.inverse)
        if outcome.holds:
            return GainCertificate.of(system, storage, gamma, outcome, old.solver, old.states, old.inverse)
    return None


def _same(table: LPVStateSpace, finer: LPVStateSpace) -> bool:
    """The finer table passes through the coarse one's ends and middle."""
    if table.box.names != finer.box.names or table.order != finer.order:
        return False
    for p in table.box.grid(2):
        for a, b in zip(table.frozen(p), finer.frozen(p), strict=True):
            if a.shape != b.shape or np.abs(a - b).max(initial=0.0) > 1e-9 * np.abs(a).max(initial=1e-300):
                return False
    return True


def _places(names: Sequence, of: Sequence) -> list[int]:
    known = [s.name for s in of]
    return [known.index(s.name) for s in names]
