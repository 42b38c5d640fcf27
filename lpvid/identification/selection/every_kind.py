"""One cheap structure of every kind, tried before a search looks further."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

from lpvid.errors import InputError
from lpvid.identification.arx import ARX, scheduling_box
from lpvid.identification.quasi_lpv import QuasiLPV
from lpvid.identification.refined_iv import RefinedIV
from lpvid.identification.selection.hasty import hasty
from lpvid.identification.selection.rounds import INPUT_LAGS, SEGMENTS, TRIALS, output_error
from lpvid.identification.structure import Structure
from lpvid.identification.subspace import Subspace
from lpvid.record import Record
from lpvid.scheduling import Polynomial, Spline

ORDER = 2
"""poles of each: the least with which a system can oscillate."""


def every_kind(records: Sequence[Record], input: tuple[str, ...], output: tuple[str, ...],
               scheduling: tuple[str, ...], damper: bool) -> tuple[Structure, ...]:
    """ARX, output error, refined instruments, state space and quasi-LPV of order two, affine in the scheduling.

    Least squares of one step may give a model that does not run freely where the noise is on the output, and from
    a search that ends among the ARX such a model would be taken. Output error, instruments and subspace do not share
    that bias, so that one of each stands beside the ARX before the search looks further. (A state space by prediction
    error is not cheap: with three scheduling variables it takes ten times as long as the rest together.) A damper is
    scheduled on its own trial force, anything else on its last output.

    Parameters
    ----------
    records : sequence of Record
        Training data, for the range of the scheduling.
    input, output, scheduling : tuple of str
        Channels.
    damper : bool
        Whether the one input is a velocity and the one output a force.

    Returns
    -------
    tuple of Structure
        Cheap before dear. Without the kinds that these channels exclude: a quasi-LPV structure has one output.

    Raises
    ------
    InputError
        The scheduling does not move.
    """
    basis = Polynomial(scheduling, degree=1) if scheduling else Polynomial()
    # nb = na + 1 from lag 0 on holds a first lag of 0 and of 1.
    arx = ARX(na=ORDER, nb=ORDER + 1, nk=0, input=input, output=output, basis=basis, affine=1)
    arx = replace(arx, basis=arx.basis.bound(scheduling_box(records, arx.basis)))
    shared = {n: getattr(arx, n) for n in ("na", "nb", "nk", "input", "output", "affine")}
    found: list[Structure] = [
        arx,
        hasty(replace(output_error(arx), basis=basis)),
        Subspace(order=ORDER, input=input, output=output, basis=basis, direct=True, affine=True),
        RefinedIV(**shared, basis=basis, noise="output"),
    ]
    with suppress(InputError):
        found += _scheduled_on_itself(input, output, basis, damper)
    return tuple(found)


def _scheduled_on_itself(input: tuple[str, ...], output: tuple[str, ...], external: Polynomial,
                         damper: bool) -> list[QuasiLPV]:
    """The smallest quasi-LPV structure of those that a search tries later, of a damper the largest too.

    One least squares each. On measured dampers at a constant voltage the one is below the other by up to four points
    (on the two orders of `labcontrol-0.87V` and `-0V`), and the screening of many ARX may take the whole budget.
    """
    if damper:
        return [QuasiLPV(nb=nb, input=input, output=output, basis=Spline(output[0], SEGMENTS, 1), on="trial",
                         trial=trial, external=external) for nb, trial in zip(INPUT_LAGS, TRIALS, strict=True)]
    return [QuasiLPV(na=ORDER, nb=ORDER, nk=0, input=input, output=output, basis=Polynomial(output[:1], degree=2),
                     on="output", external=external)]
