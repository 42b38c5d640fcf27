"""Check of the record's name against its data: ``25mm0p5Hz1A`` claims an amplitude, a frequency and a current."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from lpvid.auditing.findings import Finding
from lpvid.auditing.view import View

_NUMBER = r"(\d+(?:[p.]\d+)?)"


def _claimed(name: str, unit: str) -> float | None:
    """What a name states in a unit; None where it is nothing, several things, or may be a decimal (`1_5Hz`)."""
    found = re.findall(rf"(?<![\d.]){_NUMBER}\s?{unit}(?![a-z])", name)
    if re.search(rf"\d[_,-]{_NUMBER}\s?{unit}(?![a-z])", name):
        return None
    return float(found[0].replace("p", ".")) if len(found) == 1 else None


def nominal(view: View) -> Iterator[Finding]:
    """Amplitude [mm], frequency [Hz] and current [A] in the name against what the channels show.

    Parameters
    ----------
    view : View
        One record; a name without such parts claims nothing.

    Yields
    ------
    Finding
        ``nominal-amplitude``, ``nominal-frequency`` and ``nominal-current``, all warnings; their values are what
        the channel shows, in the units above.
    """
    amplitude, frequency, current = (_claimed(view.name, unit) for unit in ("mm", "Hz", "A"))
    motion = view.displacement
    found = view.run(motion) if motion and view.period is not None else None
    tone = _tone(found[0], view.period) if found is not None and view.period is not None else None
    if tone is not None and motion is not None:
        real_frequency, real_amplitude, resolution = tone
        if amplitude and abs(1e3 * real_amplitude - amplitude) > 0.1 * amplitude:
            yield Finding("nominal-amplitude", view.name, motion, "warning",
                          f"the name states {amplitude:g} mm, its amplitude is {1e3 * real_amplitude:.3g} mm",
                          "rename the record: the channel counts", 1e3 * real_amplitude)
        if frequency and abs(real_frequency - frequency) > max(0.05 * frequency, resolution):
            yield Finding("nominal-frequency", view.name, motion, "warning",
                          f"the name states {frequency:g} Hz, the sine has {real_frequency:.4g} Hz",
                          "rename the record: the channel counts", real_frequency)
    amps = [k for k, c in view.usable.items() if c.unit == "A"]
    if current is not None and len(amps) == 1 and view.finite(amps[0]).size:
        real = float(np.mean(view.finite(amps[0])))
        if not view.moves(amps[0]) and abs(real - current) > 0.02 + 0.05 * current:
            yield Finding("nominal-current", view.name, amps[0], "warning",
                          f"the name states {current:g} A, the channel {real:.4g} A", "find out which is right", real)


def _tone(x: np.ndarray, period: float) -> tuple[float, float, float] | None:
    """(frequency [Hz], amplitude, resolution [Hz]) of a signal that is one sine for the most part, or None."""
    centred = x - x.mean()
    window = np.hanning(x.size)
    spectrum = np.abs(np.fft.rfft(centred * window))
    top = int(np.argmax(spectrum))
    power = spectrum**2
    if top < 2 or top + 3 > spectrum.size or power[top - 2:top + 3].sum() < 0.9 * power.sum():
        return None
    left, mid, right = np.log(np.maximum(spectrum[top - 1:top + 2], 1e-12 * spectrum[top]))
    shift = 0.5 * (left - right) / (left - 2 * mid + right)
    resolution = 1 / (x.size * period)
    low, high = np.percentile(x, (0.2, 99.8))  # the drive's frequency may wander: no fit of one sine
    return float((top + shift) * resolution), float(high - low) / 2, resolution
