"""Derivatives in the band in which a signal moves: a velocity without noise and hum of the displacement's sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lpvid.condition.continuation import Continued
from lpvid.condition.differentiation import DERIVED
from lpvid.condition.interference import FEWEST, SHORT, interference, of_motion, power_of_all
from lpvid.record import Record
from lpvid.remark import Derivation, QuietDerivation

QUIETER = f"{DERIVED} without the sensor's noise beyond the band that moves"
"""note that replaces it where that was done"""
IN_BAND = {"derived_velocity": "in band"}
"""in a model's metadata: of a record without velocity it reads one that is derived in the band of the motion"""
BAND = 1.5
"""times the highest frequency of a motion up to which all of it is differentiated; nothing from twice that on"""
MEANT = 0.05
"""share of a channel's variance that is no sensor's noise"""
STEPPED = 0.3
"""ratio of the median to the root mean square of its increments below which a channel jumps between levels"""


def share_of_motion(omega: np.ndarray, several: Sequence[np.ndarray], period: float, finer: int = 1) -> np.ndarray:
    """Share of motion in a channel, none beyond the band that was recorded.

    Parameters
    ----------
    omega : (m,) array
        Frequencies [rad/s].
    several : sequence of (n,) arrays
        The channel in every record.
    period : float
        Sampling period [s].
    finer : int
        As for `lpvid.condition.interference.power_of`.

    Returns
    -------
    (m,) array
    """
    at, power, noise = power_of_all(several, period, finer)
    share = of_motion(np.interp(omega, 2 * np.pi * at, power), noise)
    share[omega < 2 * np.pi * at[1]] = 1.0  # no stretch resolves where a mean lies
    return np.where(omega <= omega[-1] / finer, share, 0.0)


def in_band(values: np.ndarray, signal: Continued, share: np.ndarray, at: np.ndarray, interfering: np.ndarray
            ) -> np.ndarray:
    """Rate of change of a channel without its sensor's noise beyond the band in which it moves.

    In the frequency domain: what multiplies noise besides motion is fitted too small, and central differences of a
    frequency f are too small by sin(x)/x, x = 2π f times the sample time. Up to `BAND` times the highest frequency of
    which more than half counts as motion all does, from there on less and less: weights that fall at once would ring.
    Bands of interference are left out: differentiated, hum is as large as a slow motion. Where the end of the band
    would take away what was meant to excite, there is none.

    Parameters
    ----------
    values : (n,) array
        The channel.
    signal : Continued
        Its spectrum.
    share : (m,) array
        Of motion at the frequencies of `signal`.
    at : (k,) array
        Frequencies of `interfering` [Hz].
    interfering : (k,) bool array
        Interference.

    Returns
    -------
    (n,) array
        In the unit of the channel over a second.
    """
    omega = signal.omega
    moves = np.interp(omega / (2 * np.pi), at, interfering.astype(float)) < 0.5
    place = omega / omega[(share > 0.5) & moves].max() / BAND - 1  # 0 at the end of the band, 1 at twice that
    inside = np.cos(np.pi / 2 * np.clip(place, 0.0, 1.0)) ** 2
    if is_meant(signal.back(signal.spectrum * moves * (1 - inside)), values):
        inside = np.ones_like(omega)
    return signal.back(signal.spectrum * 1j * omega * moves * inside)


def is_meant(taken: np.ndarray, values: np.ndarray) -> bool:
    """Whether what would be taken away as noise, (n,), is so much that it was rather meant to excite: a white input.

    Parameters
    ----------
    taken : (n,) array
    values : (n,) array
        The channel before, in the same unit.

    Returns
    -------
    bool
        Whether its mean square is `MEANT` of the channel's variance or more; True for a constant.
    """
    return not np.mean(taken**2) < MEANT * np.var(values)


def jumps(values: np.ndarray) -> bool:
    """Whether a channel mostly stays where it is, noise of its sensor aside, and sometimes jumps.

    Parameters
    ----------
    values : (n,) array

    Returns
    -------
    bool
        False for a constant, and for fewer than two samples.

    Examples
    --------
    >>> jumps(np.repeat([0.0, 2.0, 1.0], 10)), jumps(np.sin(np.linspace(0, 9, 200))), jumps(np.ones(9))
    (True, False, False)
    """
    increments = np.abs(np.diff(values))
    return bool(increments.size) and float(np.median(increments)) < STEPPED * float(np.sqrt(np.mean(increments**2)))


def quiet_pieces(parts: Sequence[list[Record]], notes: tuple[str, ...]
                 ) -> tuple[list[list[Record]], tuple[str, ...]]:
    """Pieces whose derived velocity is without the sensor's noise (`with_quiet_velocity`).

    Parameters
    ----------
    parts : sequence of list of Record
        Training and held-out pieces.
    notes : tuple of str
        On what was derived, as `lpvid.condition.preparing.with_motion` gives them.

    Returns
    -------
    parts : list of list of Record
    notes : tuple of str
        With what was done.
    """
    if not any(isinstance(n, Derivation) for n in notes):
        return list(parts), notes
    parts = [[with_quiet_velocity(r) for r in part] for part in parts]
    done = [next((n for n in r.notes if isinstance(n, QuietDerivation)), "")
            for part in parts for r in part if _derived(r)]
    quiet = [n for n in done if n]
    if quiet:
        rest = "" if all(done) else f", in {len(quiet)} of {len(done)} pieces; the others are too short for that"
        stated = QuietDerivation(max(quiet, key=len) + rest)
        notes = tuple(stated if isinstance(n, Derivation) else n for n in notes)
    return parts, notes


def with_quiet_velocity(record: Record) -> Record:
    """The record, a velocity that was derived without noise and interference of the displacement's sensor.

    A filter of so many samples, whatever the rate, leaves noise in the velocity of a slow record that is as large as
    the motion, and what multiplies noise besides motion is fitted too small.

    Parameters
    ----------
    record : Record
        Uniform and finite, displacement [m].

    Returns
    -------
    Record
        As it is where its velocity was measured, it has no displacement, or is too short (400 samples) to find the
        band in which it moves.
    """
    if not (_derived(record) and record.has("displacement") and np.ptp(record["displacement"])):
        return record
    period, moved = record.sample_time or record.time_base.period, record["displacement"]
    if moved.size < FEWEST * SHORT or jumps(moved):
        return record
    signal = Continued.predicted(moved, period)
    share = share_of_motion(signal.omega, [moved], period)
    at, interfering = interference(moved, record["force"] if record.has("force") else moved, period)
    velocity = in_band(moved, signal, share, at, interfering)
    plain = replace(record, notes=tuple(n for n in record.notes if not isinstance(n, Derivation)))
    left = ""
    if interfering.any():
        hertz = signal.omega / (2 * np.pi)
        fast = np.abs(signal.spectrum * hertz) * (np.interp(hertz, at, interfering.astype(float)) >= 0.5)
        left = f", nor interference about {hertz[np.argmax(fast)]:.0f} Hz, where the force does not follow"
    return plain.with_channel("velocity", velocity, record.channel("velocity").unit, QuietDerivation(QUIETER + left))


def _derived(record: Record) -> bool:
    """Whether the velocity of a record was not measured."""
    return any(isinstance(n, Derivation) for n in record.notes)
