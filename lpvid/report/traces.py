"""Interactive time traces: their data, and how their samples are packed into a page.

Every curve is quantised to 16 bits over the range of its panel, differenced, deflated and written in base64: about one
byte a sample for measured signals. Where all curves of a page do not fit into what the page may weigh, each is replaced
by the lowest and the highest sample of every bin, in their order, so that no peak is lost. The browser does the same
again for the stretch on view.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from lpvid.plot.style import extremes

LEVELS = 65534
"""Steps of a panel's range that a 16-bit code separates; one code more stands for a missing sample."""
MISSING = -32768
UNEVEN = 0.01
"""Share of a period by which the samples of an even clock may be off: below what a screen shows."""
ROLES = ("measured", "model", "input", "error", "other-1", "other-2", "other-3", "other-4", "other-5")
"""Colours by meaning; traces.js has their values, dark and light."""


@dataclass(frozen=True, eq=False)
class Curve:
    """One signal over time.

    Attributes
    ----------
    name : str
        In the legend.
    times : (n,) array
        Rising [s].
    values : (n,) array
        NaN where nothing was measured: the curve has a gap there.
    role : str
        One of `ROLES`: which colour.
    stepped : bool
        Whether a value holds until the next sample, as that of a command does.
    """

    name: str
    times: np.ndarray
    values: np.ndarray
    role: str = "measured"
    stepped: bool = False


@dataclass(frozen=True, eq=False)
class Panel:
    """Curves with one vertical axis.

    Attributes
    ----------
    label : str
        Of the axis, with its unit.
    curves : tuple of Curve
    limits : (float, float) or None
        Furthest that the axis reaches; None for all that is finite. Values beyond are cut off there.
    height : int
        [pixel]
    """

    label: str
    curves: tuple[Curve, ...]
    limits: tuple[float, float] | None = None
    height: int = 190


@dataclass(frozen=True, eq=False)
class Traces:
    """Panels over one time axis, with a common cursor and zoom.

    Attributes
    ----------
    panels : tuple of Panel
    caption : str
    alternative : str
        What it shows, for who cannot see it; the caption by default.
    marked : (float, float, str) or None
        A stretch [s] that is shaded and has its own button, and what it is.
    """

    panels: tuple[Panel, ...]
    caption: str
    alternative: str = ""
    marked: tuple[float, float, str] | None = None
    kind: ClassVar[str] = "traces"

    @property
    def n_samples(self) -> int:
        """Of the longest curve."""
        return max((c.values.size for p in self.panels for c in p.curves), default=0)


def pack(figures: Sequence[Traces], room: int) -> list[str]:
    """JSON of every figure, all together in at most about `room` bytes.

    Parameters
    ----------
    figures : sequence of Traces
    room : int
        [byte]

    Returns
    -------
    list of str
        One for each figure, safe inside a script element.
    """
    samples = sum(c.values.size for f in figures for p in f.panels for c in p.curves)
    most = max((f.n_samples for f in figures), default=0)
    while True:
        packed = [json.dumps(_figure(f, most), allow_nan=False, separators=(",", ":"), ensure_ascii=False)
                  .replace("<", "\\u003c") for f in figures]
        size = sum(len(text.encode("utf-8")) for text in packed)
        if size <= room or most <= 2 or not samples:
            return packed
        longest = min(most, max(f.n_samples for f in figures))
        most = max(2, min(longest - 1, int(0.95 * longest * room / size)))


def _figure(figure: Traces, most: int) -> dict[str, Any]:
    panels = [_panel(p, most) for p in figure.panels]
    kept = min((c["bin"] for p in panels for c in p["curves"]), default=1)
    widest = max((c["bin"] for p in panels for c in p["curves"]), default=1)
    data: dict[str, Any] = {"panels": panels, "bin": max(kept, widest)}
    if figure.marked is not None:
        data["marked"] = [float(figure.marked[0]), float(figure.marked[1]), figure.marked[2]]
    return data


def _panel(panel: Panel, most: int) -> dict[str, Any]:
    low, high = _span(panel)
    return {"label": panel.label, "height": panel.height, "low": low, "high": high,
            "curves": [_curve(c, low, high, most) for c in panel.curves]}


def _span(panel: Panel) -> tuple[float, float]:
    """Ends of the codes: all finite values, no further than the limits."""
    finite = [c.values[np.isfinite(c.values)] for c in panel.curves]
    ends = [(float(v.min()), float(v.max())) for v in finite if v.size]
    if not ends:
        return (-1.0, 1.0)
    low, high = min(e[0] for e in ends), max(e[1] for e in ends)
    if panel.limits is not None:
        low, high = max(low, panel.limits[0]), min(high, panel.limits[1])
    if not high > low:
        room = 0.05 * abs(low) or 1.0
        return low - room, low + room
    return low, high


def _curve(curve: Curve, low: float, high: float, most: int) -> dict[str, Any]:
    times = np.asarray(curve.times, dtype=float)
    values = np.asarray(curve.values, dtype=float)
    kept, size = extremes(values, most)
    data: dict[str, Any] = {"name": curve.name, "role": curve.role, "bin": size, "n": int(kept.size),
                            "values": _deflated(_quantised(values[kept], low, high))}
    if curve.stepped:
        data["stepped"] = True
    clock = _clock(times)
    if clock is not None:
        start, period = clock
        pace = period * (size / 2 if size > 1 else 1)
        data["clock"] = [start + (0.5 * pace if size > 1 else 0.0), pace]
    else:
        data["times"] = base64.b64encode(zlib.compress(times[kept].astype("<f8").tobytes(), 9)).decode("ascii")
    return data


def _clock(times: np.ndarray) -> tuple[float, float] | None:
    """(first time, period) of an even clock, or None."""
    if times.size < 2:
        return (float(times[0]) if times.size else 0.0), 1.0
    period = float(times[-1] - times[0]) / (times.size - 1)
    if not period > 0:
        return None
    off = np.abs(times - times[0] - period * np.arange(times.size))
    return (float(times[0]), period) if float(off.max()) < UNEVEN * period else None


def _quantised(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """(n,) int16 codes of values between the ends: −32767 … 32767, and `MISSING` where a value is not finite."""
    with np.errstate(invalid="ignore", over="ignore"):
        codes = np.rint((np.clip(values, low, high) - low) / (high - low) * LEVELS - LEVELS / 2)
    return np.where(np.isfinite(values), codes, MISSING).astype("<i2")


def _deflated(codes: np.ndarray) -> str:
    """Differences modulo 2¹⁶, low bytes before high bytes, deflated, in base64."""
    steps = np.diff(codes.astype("<u2"), prepend=np.zeros(1, dtype="<u2"))
    planes = np.concatenate([steps & 255, steps >> 8]).astype(np.uint8)
    return base64.b64encode(zlib.compress(planes.tobytes(), 9)).decode("ascii")


def unpacked(curve: Mapping[str, Any], panel: Mapping[str, Any]) -> np.ndarray:
    """(n,) values of a packed curve, as traces.js decodes them.

    Parameters
    ----------
    curve : mapping of str to object
        As `pack` writes it: "values" holds the codes.
    panel : mapping of str to object
        As `pack` writes it: "low" and "high" are the ends of the codes.

    Returns
    -------
    (n,) array
        In the unit of the panel, within half a step of the code; NaN for a missing sample.
    """
    planes = np.frombuffer(zlib.decompress(base64.b64decode(curve["values"])), dtype=np.uint8).astype(np.uint16)
    steps = planes[: planes.size // 2] | (planes[planes.size // 2:] << 8)
    codes = np.cumsum(steps, dtype=np.uint16).view(np.int16).astype(float)
    values = panel["low"] + (codes + LEVELS / 2) / LEVELS * (panel["high"] - panel["low"])
    return np.where(codes == MISSING, np.nan, values)
