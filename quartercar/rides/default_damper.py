"""The identified damper that rides take where none is given: the embedded rig data's, kept beside the code."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from quartercar.dampers.contract import Damper

FILE = Path(__file__).with_name("default_damper.json")
ORDER = 2
"""of the embedded model; the fourth-order one of the demo has a hundredth less ESR, but in a car at 0 A, that is at
frequencies that its data do not reach, it gives energy to the wheel"""


@cache
def identified_damper() -> Damper:
    """The damper of the virtual rig as stored by `identify_damper`, whose fit takes half a minute.

    Returns
    -------
    Damper
        Sampled at 512 Hz; one object for all callers.

    Examples
    --------
    >>> damper = identified_damper()
    >>> damper.name, damper.start, round(1 / damper.clock)
    ('lpv-arx', 2, 512)
    """
    from lpvid.export.serialise import load

    return load(FILE)


def identify_damper(seed: int = 0) -> Damper:
    """An LPV-ARX damper of second order from the training part of the embedded rig data, anew.

    Parameters
    ----------
    seed : int
        Of the rig's noise.

    Returns
    -------
    Damper
        Without prints of the rows of its training records in its metadata.
    """
    from quartercar.dampers.blackbox.lpv import LpvArx
    from quartercar.dampers.facts import Facts
    from quartercar.dampers.fitting import fit
    from quartercar.dampers.preparing import prepare
    from quartercar.rig import default_records

    records = default_records(seed, "training")
    prepared = prepare(records, [], None)
    facts = Facts.of(prepared.training, prepared.polarity)
    found = fit(LpvArx.suited(facts).replace(order=ORDER), records).damper
    training = {k: v for k, v in found.metadata["training"].items() if k != "rows"}
    return found.replace(metadata={"training": training})
