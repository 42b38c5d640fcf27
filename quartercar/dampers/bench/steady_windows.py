"""Steady windows of triangle runs: where on each slope the force has settled, and the point that it gives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from lpvid.codec import Encoded
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.toolkit import checks
from quartercar.dampers.bench.settling import settling, straight_line
from quartercar.dampers.bench.strokes import plateau, speed_varies, travel, turning_points

TURN = 0.1
"""a stroke shorter than this share of the record's travel is not one."""
COMPLETE = 0.75
"""share of the median stroke below which the first and the last count as cut off."""
LATER = ((0.5, 0.95), (0.75, 0.95))
"""parts of the plateau tried after the centre part while the pressure is still building up."""
LATE = 0.2
"""share of the plateau after which the approach to the steady force is taken for exponential."""
SPIKES = 0.1
"""share of spikes from which a window is refused."""


@dataclass(frozen=True)
class WindowSettings:
    """How steady a slope must be.

    Attributes
    ----------
    reaction_time : float
        Dropped after every turn [s]; at least 5 τ of the damper's pressure build-up (7.4).
    centre : float
        Share of the plateau that is kept, in its middle.
    straight : float
        Deviation of the displacement from a straight line that ends a plateau, as a share of the stroke.
    unsettled : float
        Part of the force that is still to build up above which a window is refused; below, it is added to the force,
        and 30 % of it to the standard error. As a share of the force, or of half its range in the record, if larger.
    drift : float
        Change of the force along the window above which it is refused, as a share of the same: a pressure that builds
        up more slowly than the stroke lasts looks straight.
    least : int
        Samples that a window needs.
    """

    reaction_time: float = 0.03
    centre: float = 0.5
    straight: float = 0.002
    unsettled: float = 0.02
    drift: float = 0.3
    least: int = 12

    def __post_init__(self) -> None:
        for name in ("centre", "straight", "unsettled", "drift"):
            if not 0 < checks.real(getattr(self, name), name) < 1:
                raise InputError(f"{name} is a share between 0 and 1", got=getattr(self, name))
        if checks.real(self.reaction_time, "reaction_time") < 0:
            raise InputError("reaction_time cannot be negative", got=f"{self.reaction_time} s")
        checks.count(self.least, "least", at_least=6)


@dataclass(frozen=True)
class SteadyWindow(Encoded):
    """One slope of one record and the point that it gives.

    Attributes
    ----------
    record : str
    start, stop : float
        Of the window, in the record's time from its first sample [s].
    velocity, force, std : float
        Slope of the displacement [m/s]; the force's line at the middle [N], with its standard error, which allows for
        correlated noise by the effective number of samples n(1−ρ)/(1+ρ).
    velocity_std : float
        Standard error of the velocity [m/s].
    position : float
        Displacement at the middle [m]; 0 where it is not measured.
    drift : float
        Slope of the force's line over the displacement [N/m]: a gas spring, or pressure still building up.
    fault : str
        Why it gives no point; empty where it does.
    """

    JSON = ("record", ("start_s", "start"), "fault")

    record: str
    start: float
    stop: float
    velocity: float
    force: float = float("nan")
    std: float = float("nan")
    velocity_std: float = 0.0
    position: float = 0.0
    drift: float = float("nan")
    fault: str = ""

    @property
    def direction(self) -> int:
        """+1 in extension, −1 in compression."""
        return 1 if self.velocity > 0 else -1

    @property
    def speed(self) -> float:
        """|v| [m/s]."""
        return abs(self.velocity)


def steady_windows(record: Record, settings: WindowSettings | None = None, polarity: int = 1) -> list[SteadyWindow]:
    """One window for every slope of a record, refused ones with their reason.

    Parameters
    ----------
    record : Record
        With ``force`` and ``displacement`` or ``velocity``.
    settings : WindowSettings, optional
        How steady a slope must be; the defaults where left out.
    polarity : {1, −1}
        −1 where the force is measured against the velocity.

    Returns
    -------
    list of SteadyWindow
        In order of time; strokes cut off by the ends of the record are not among them, and none is where nothing moves.

    Raises
    ------
    InputError
        No force, neither displacement nor velocity, no uniform clock, NaN.
    """
    settings = settings or WindowSettings()
    if record.sample_time is None:
        raise InputError(f"record '{record.name}' has no uniform clock", mend="lpvid.condition.resample")
    if not record.has("force"):
        raise InputError(f"record '{record.name}' has no force", got=", ".join(record.channels),
                         mend=checks.role_mend("force"))
    force = polarity * checks.finite(record["force"], f"record '{record.name}': force")
    x, measured = travel(record)
    turns = turning_points(x, TURN * float(np.ptp(x)))
    slopes = [(int(a), int(b)) for a, b in pairwise(turns) if abs(x[b] - x[a]) > TURN * float(np.ptp(x))]
    whole = COMPLETE * float(np.median([abs(x[b] - x[a]) for a, b in slopes])) if len(slopes) > 2 else 0.0
    if slopes and abs(x[slopes[-1][1]] - x[slopes[-1][0]]) < whole:  # cut off by the ends of the record, off centre
        slopes.pop()
    if slopes and abs(x[slopes[0][1]] - x[slopes[0][0]]) < whole:
        slopes.pop(0)
    return [_window(record, x, force, a, b, settings, measured) for a, b in slopes]


def _window(record: Record, x: np.ndarray, force: np.ndarray, first: int, last: int, settings: WindowSettings,
            measured: bool) -> SteadyWindow:
    period = float(record.sample_time or 0.0)
    begin, end, velocity, share = plateau(x, first, last, settings.straight, period)

    def refuse(why: str) -> SteadyWindow:
        return SteadyWindow(record.name, begin * period, end * period, velocity, fault=why)

    place = f"record '{record.name}' at {first * period:.3g} s"
    if share < 0.5:
        return refuse(f"{place}: the speed is constant over {share:.0%} of the stroke only")
    length, dropped = end - begin, begin + int(np.ceil(settings.reaction_time / period))
    last_used = begin + round(LATER[-1][1] * length)
    if last_used - dropped < 2 * settings.least:
        return refuse(f"{place}: {max(last_used - dropped, 0)} steady samples, {2 * settings.least} needed")
    if speed_varies(x[begin:end]):
        return refuse(f"{place}: the speed is not constant")
    late = max(dropped, begin + round(LATE * length))
    lag = settling(force[late:last_used])
    swing = 0.5 * float(np.ptp(np.quantile(force, (0.05, 0.95))))  # the level itself may be next to zero: gas preload
    half, share = 0.5 * settings.centre, np.inf
    for low, high in ((0.5 - half, 0.5 + half), *LATER):
        a, b = max(begin + round(low * length), dropped), begin + round(high * length)
        if b - a < settings.least:
            continue
        level, std, slope, spikes = straight_line(force[a:b])
        left = lag.left(a - late, b - late)
        scale = max(abs(level), swing, 1e-300)
        share = abs(left) / scale
        if not lag.found or share <= settings.unsettled:
            window = _point(record, x, (*lag.settled(level, std, left), slope), a, b, measured)
            return replace(window, fault=_fault(window, spikes, abs(slope) * (b - a) / scale, settings, place))
    return refuse(f"{place}: the force does not settle, {min(share, 9.99):.1%} of it still to build up at the end")


def _point(record: Record, x: np.ndarray, line: tuple[float, float, float], a: int, b: int,
           measured: bool) -> SteadyWindow:
    """The window from the force's line (level, standard error, step per sample)."""
    period = float(record.sample_time or 0.0)
    level, std, slope = line
    _, error, step, _ = straight_line(x[a:b])
    return SteadyWindow(record.name, a * period, b * period, step / period, level, std,
                        float(error * np.sqrt(12.0) / (b - a) / period), float(x[a:b].mean()) if measured else 0.0,
                        slope / step)


def _fault(window: SteadyWindow, spikes: float, change: float, settings: WindowSettings, place: str) -> str:
    """Why a settled window cannot be used; empty where it can."""
    if spikes > SPIKES:
        return f"{place}: {spikes:.0%} of the force samples are spikes"
    if change > settings.drift:
        return f"{place}: the force changes by {change:.0%} along the window"
    if window.velocity == 0.0:
        return f"{place}: no motion within the window"
    return ""
