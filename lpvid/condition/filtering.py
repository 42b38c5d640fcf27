"""Low-pass filters, causal or without phase; all channels alike by default."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lpvid import _checks
from lpvid.condition.resampling import finite_runs
from lpvid.errors import InputError
from lpvid.record import Record


def low_pass(record: Record, cutoff: float, *, order: int = 2, damping: float | None = None, zero_phase: bool = True,
             channels: Sequence[str] | None = None) -> Record:
    """Low-pass filter the channels of a record.

    With `damping`: H(s) = ω_c²/(s² + 2ζω_c s + ω_c²), ω_c = 2π·cutoff, discretised by zero-order hold (Díaz Salas
    2011, (4.5)). Without: Butterworth of `order`, bilinear with the cut-off prewarped. Zero phase runs the filter
    forward and backward, so the gain is |H|² (one half at a Butterworth's cut-off). A filter on some channels only
    gives them a lag that the others lack and fakes hysteresis; hence all channels alike by default.

    Parameters
    ----------
    record : Record
        Uniform.
    cutoff : float
        Cut-off (natural) frequency [Hz].
    order : int
        Order of the Butterworth filter.
    damping : float, optional
        ζ of the second-order filter; leave out for Butterworth.
    zero_phase : bool
        Forward and backward; False is the causal filter, started at rest at the first sample's value.
    channels : sequence of str, optional
        Names or roles; all by default.

    Returns
    -------
    Record
        Missing samples stay missing: each finite run is filtered alone. A note states what was filtered and how.

    Raises
    ------
    InputError
        Not uniform; cut-off not below half the sampling rate.

    Examples
    --------
    >>> t = np.arange(2000) / 1000
    >>> slow = low_pass(Record({"x": np.sin(2 * np.pi * 2 * t)}, sample_time=0.001), 100.0)
    >>> bool(np.abs(slow["x"] - np.sin(2 * np.pi * 2 * t)).max() < 1e-3)
    True
    """
    if record.sample_time is None:
        raise InputError(f"record '{record.name}' must be uniform to be filtered", got="unsteady time stamps",
                         mend="resample it or cut it into segments first")
    sections = _design(cutoff, record.sample_time, order, damping)
    names = list(record.channels) if channels is None else [record.resolve(c) for c in channels]
    new = dict(record.channels)
    for name in names:
        values = record.channels[name].values.copy()
        for first, last in finite_runs(values):
            values[first:last] = _apply(sections, values[first:last], zero_phase)
        new[name] = replace(new[name], values=values)
    kind = f"second order, damping {damping:g}, ZOH" if damping is not None else f"Butterworth of order {order}"
    which = "all channels" if channels is None else ", ".join(names)
    note = f"low-pass {cutoff:g} Hz ({kind}, {'zero phase' if zero_phase else 'causal'}) on {which}"
    return replace(record, channels=new, time=None, notes=(*record.notes, note))


def _design(cutoff: float, sample_time: float, order: int, damping: float | None) -> np.ndarray:
    """Second-order sections."""
    cutoff = _checks.positive(cutoff, "cutoff", "Hz")
    nyquist = 0.5 / sample_time
    if cutoff >= nyquist:
        raise InputError("cutoff must lie below half the sampling rate", got=f"{cutoff:g} Hz against {nyquist:g} Hz")
    if damping is not None:
        return _held_second_order(2 * np.pi * cutoff, _checks.positive(damping, "damping"), sample_time)
    from scipy.signal import butter

    return np.asarray(butter(_checks.count(order, "order", at_least=1), cutoff, fs=1 / sample_time, output="sos"))


def _held_second_order(omega: float, damping: float, sample_time: float) -> np.ndarray:
    """Zero-order-hold equivalent of ω²/(s² + 2ζω s + ω²) as one section [0, b1, b2, 1, a1, a2]."""
    from scipy.linalg import expm

    a = np.array([[0.0, 1.0, 0.0], [-(omega**2), -2 * damping * omega, omega**2], [0.0, 0.0, 0.0]])
    held = expm(a * sample_time)
    ad, bd = held[:2, :2], held[:2, 2]
    a1, a2 = -np.trace(ad), np.linalg.det(ad)
    # C adj(zI − A) B with C = [1 0]: b1 z + b2
    b1 = bd[0]
    b2 = ad[0, 1] * bd[1] - ad[1, 1] * bd[0]
    return np.array([[0.0, b1, b2, 1.0, a1, a2]])


def _apply(sections: np.ndarray, values: np.ndarray, zero_phase: bool) -> np.ndarray:
    from scipy.signal import sosfilt, sosfilt_zi

    at_rest = sosfilt_zi(sections)
    if not zero_phase:
        return np.asarray(sosfilt(sections, values, zi=at_rest * values[0])[0])
    if values.size < 2:
        return values
    poles = np.concatenate([np.roots(section[3:]) for section in sections])
    slowest = float(np.max(np.abs(poles)))
    memory = int(np.clip(np.ceil(np.log(1e-6) / np.log(min(max(slowest, 1e-3), 1 - 1e-9))), 6, 20 * values.size))
    padded = np.pad(values, memory, mode="reflect", reflect_type="odd")
    forward = sosfilt(sections, padded, zi=at_rest * padded[0])[0]
    backward = sosfilt(sections, forward[::-1], zi=at_rest * forward[-1])[0][::-1]
    return np.asarray(backward[memory:-memory])
