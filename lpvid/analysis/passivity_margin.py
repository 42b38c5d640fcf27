"""Where a model with a held scheduling gives energy: its damping in steady sine motion, by scheduling and frequency."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lpvid import _checks
from lpvid.codec import encode
from lpvid.errors import InputError
from lpvid.model.transfer_function import LPVTransferFunction
from lpvid.units import quotient

BAND = 25.0
"""[Hz] Body (1 to 2 Hz) and wheel (10 to 15 Hz) motion of road vehicles with their first harmonics: what a damper in a
car is asked. The rest of the range, up to half the sampling rate, is reported beside it."""
ROUNDING = 1e-9
"""share of the largest damping within which a negative one is rounding."""
FREQUENCIES = 256
SCHEDULINGS = 26


@dataclass(frozen=True, eq=False)
class PassivityMargin:
    """Least damping of a model in steady sine motion, over the amplitudes, with the scheduling held.

    A motion v = V sin ωt does the work ½V²·d per second and sample on the model, with

        d(p, ω, V) = Re G₁(e^{jωT}) + N(V) Re G₂(e^{jωT}),      0 < N(V) ≤ 1/v₀(p)

    where N is the describing function of the tanh stage: the power of a sine depends on the fundamental alone, so that
    this is exact. d is least at V → 0, or at V → ∞ or the largest V that is asked for; `damping` is the smaller. Where
    it is negative the model gives energy in every period; d(p) ≥ 0 is necessary for passivity at held p, and without a
    stage sufficient too.

    Attributes
    ----------
    scheduling : (N, variables) array
    frequencies : (F,) array
        [Hz]
    damping : (N, F) array
        [output per input: N s/m]
    large : (N, F) array of bool
        Whether the least is that of large amplitudes (V ≫ v₀) rather than of small ones.
    names, units : tuple of str
        Of the scheduling variables.
    unit : str
        Of the damping.
    shaped : bool
        Whether there is an input stage, so that the amplitude matters.
    largest : float or None
        Largest amplitude that was judged, in the unit of the input; None for amplitudes without bound.
    source : str
        Unit of the input.
    """

    scheduling: np.ndarray
    frequencies: np.ndarray
    damping: np.ndarray
    large: np.ndarray
    names: tuple[str, ...]
    units: tuple[str, ...]
    unit: str
    shaped: bool = False
    largest: float | None = None
    source: str = ""

    @property
    def mask(self) -> np.ndarray:
        """(N, F) where energy is given in every period; unstable frozen models count throughout."""
        size = float(np.abs(self.damping[np.isfinite(self.damping)]).max(initial=0.0))
        return ~(self.damping >= -ROUNDING * size)

    @property
    def active(self) -> bool:
        """Whether energy is given anywhere."""
        return bool(self.mask.any())

    def within(self, band: float | None) -> np.ndarray:
        """(F,) which frequencies lie within a band [Hz]; all without one.

        Parameters
        ----------
        band : float or None
            Highest frequency [Hz]; None for all.

        Returns
        -------
        (F,) array of bool
            The end of the band included.
        """
        return np.ones(len(self.frequencies), dtype=bool) if band is None else self.frequencies <= band

    @property
    def unstable(self) -> np.ndarray:
        """(N,) at which scheduling the frozen model is unstable, so that it has no steady motion."""
        return np.array([not np.isfinite(row).all() for row in self.damping], dtype=bool)

    def description(self, band: float | None = BAND) -> str:
        """Where the frozen model is unstable, and where else it gives energy within a band; empty where neither.

        Parameters
        ----------
        band : float or None
            [Hz]; None for up to half the sampling rate.

        Returns
        -------
        str
            Scheduling, frequencies and least damping.
        """
        return " and ".join(filter(None, (self._instability(), self._energy(band))))

    def _instability(self) -> str:
        if not self.unstable.any():
            return ""
        return " at ".join(["is unstable", *filter(None, [", ".join(self._spans(self.unstable))])])

    def _energy(self, band: float | None) -> str:
        inside = self.within(band)
        mask = (self.mask & ~self.unstable[:, None])[:, inside]
        if not mask.any():
            return ""
        f, damping = self.frequencies[inside], self.damping[:, inside]
        columns = np.flatnonzero(mask.any(axis=0))
        where = ", ".join([*self._spans(np.array([row.any() for row in mask])),
                           f"{_number(float(f[columns[0]]))} to {_number(float(f[columns[-1]]))} Hz"])
        row, column = np.unravel_index(int(np.argmin(np.where(mask, damping, np.inf))), mask.shape)
        held = zip(self.scheduling[row].tolist(), self.units, strict=True)
        at = ", ".join([*(f"{_number(v)} {u}".rstrip() for v, u in held), f"{_number(float(f[column]))} Hz"])
        far = "large amplitudes" if self.largest is None else f"amplitude {self.largest:.3g} {self.source}".rstrip()
        size = f", {far if self.large[:, inside][row, column] else 'small amplitudes'}" if self.shaped else ""
        unit = f" {self.unit}" if self.unit else ""
        return f"gives energy at {where} (least damping {damping[row, column]:.4g}{unit} at {at}{size})"

    def _spans(self, rows: np.ndarray) -> list[str]:
        """Stretches of a single scheduling variable over the judged points; of several, the range of each."""
        if len(self.names) == 1:
            order = np.argsort(self.scheduling[:, 0], kind="stable")
            index = np.flatnonzero(rows[order])
            stretches = np.split(self.scheduling[order][index, 0], np.flatnonzero(np.diff(index) > 1) + 1)
            return [" and ".join(_span(values, self.names[0], self.units[0]) for values in stretches)]
        return [_span(self.scheduling[rows, i], n, u)
                for i, (n, u) in enumerate(zip(self.names, self.units, strict=True))]

    def statement(self) -> str:
        """What is reported of an unconstrained model: within `BAND`, and beyond it; empty if passive.

        Returns
        -------
        str
            One sentence without subject.
        """
        return "; ".join(filter(None, (self._instability(), self._energy_statement())))

    def _energy_statement(self) -> str:
        inside, everywhere = self._energy(BAND), self._energy(None)
        if not everywhere:
            return ""
        if not inside:
            return f"{everywhere}, all of it beyond {BAND:g} Hz"
        if inside == everywhere:
            return everywhere
        return f"up to {BAND:g} Hz it {inside}; up to {_number(float(self.frequencies[-1]))} Hz it {everywhere}"

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            Plain values by name; arrays as lists.
        """
        return {
            "active": self.active,
            "says": self.description(BAND),
            "says_to_nyquist": self.description(None),
            "band": BAND,
            "least_damping": encode(self.damping.min()),
            "least_damping_in_band": encode(self.damping[:, self.within(BAND)].min(initial=math.inf)),
            "unit": self.unit,
            "scheduling": self.scheduling.tolist(),
            "frequencies": self.frequencies.tolist(),
            "damping": encode(self.damping),
        }

    def __repr__(self) -> str:
        return f"passivity margin: {self.statement() or 'takes energy in every steady motion'}"


def passivity_margin(model: LPVTransferFunction, currents: Sequence | np.ndarray | None = None,
                     frequencies: Sequence[float] | np.ndarray | None = None, *, largest: float | None = None
                     ) -> PassivityMargin:
    """Damping of a model in steady sine motion at the least favourable amplitude, by scheduling and frequency.

    Parameters
    ----------
    model : LPVTransferFunction
        One input, one output.
    currents : (N,) or (N, variables) array, optional
        Values of the scheduling; left out, a grid over the model's box.
    frequencies : (F,) array, optional
        [Hz]; left out, from a thousandth of half the sampling rate up to all of it.
    largest : float, optional
        Largest amplitude of the input, in its unit, where the model has an input stage; left out, without bound.

    Returns
    -------
    PassivityMargin

    Raises
    ------
    InputError
        More than one input or output, frequencies beyond half the sampling rate.

    Examples
    --------
    >>> from lpvid.scheduling import Polynomial
    >>> late = LPVTransferFunction.siso(a=[], b=[[0.0], [1.0]], basis=Polynomial(), sample_time=0.01)
    >>> passivity_margin(late, frequencies=[10.0, 25.0, 40.0]).damping.round(3).tolist()
    [[0.809, 0.0, -0.809]]
    """
    if not isinstance(model, LPVTransferFunction) or model.n_outputs != 1 or len(model.inputs) != 1:
        raise InputError("a passivity margin needs a transfer function from one input to one output",
                         got=type(model).__name__)
    nyquist = 0.5 / model.sample_time
    points = _points(model, currents)
    bound = math.inf if largest is None else _checks.positive(largest, "largest", model.inputs[0].unit)
    grid = (np.concatenate([np.geomspace(1e-3 * nyquist, nyquist, FREQUENCIES // 2),
                            np.linspace(1e-3 * nyquist, nyquist, FREQUENCIES // 2)])
            if frequencies is None else np.atleast_1d(np.asarray(frequencies, dtype=float)))
    f = np.unique(np.round(grid, 9)) if frequencies is None else _checks.finite(grid, "frequencies")
    if f.min(initial=0.0) < 0 or f.max(initial=0.0) > nyquist * (1 + 1e-9):
        raise InputError("frequencies reach beyond half the sampling rate", got=f"{f.max():.6g} Hz",
                         why=f"it is {nyquist:.6g} Hz")
    damping, large = np.empty((len(points), len(f))), np.zeros((len(points), len(f)), dtype=bool)
    for i, point in enumerate(points):
        damping[i], large[i] = _damping(model, point, f, bound)
    unit = _unit(model)
    return PassivityMargin(points, f, damping, large, model.box.names, model.box.units, unit,
                           model.input_stage is not None, largest, model.inputs[0].unit)


def _frozen_response(model: LPVTransferFunction, point: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    """(filter inputs, F) frozen responses of the linear part."""
    a, b, _ = model.coefficients(point)
    z = np.exp(-2j * np.pi * frequencies * model.sample_time)
    below = 1 + (a[:, 0, 0] @ z[None] ** np.arange(1, len(a) + 1)[:, None] if len(a) else 0.0)
    return np.array([b[:, 0, q] @ z[None] ** np.arange(len(b))[:, None] for q in range(b.shape[2])]) / below


def _damping(model: LPVTransferFunction, point: np.ndarray, f: np.ndarray, largest: float
             ) -> tuple[np.ndarray, np.ndarray]:
    if np.abs(model.frozen_poles(point)).max(initial=0.0) >= 1:
        return np.full(len(f), -np.inf), np.zeros(len(f), dtype=bool)
    response, stage = np.real(_frozen_response(model, point, f)), model.input_stage
    gains = None if stage is None else stage.amplitude_gains(point, largest)
    if gains is None:
        return response[0], np.zeros(len(f), dtype=bool)
    small, large = (np.tensordot(g, response[: len(g)], 1) for g in gains)
    return np.minimum(small, large), large < small


def _points(model: LPVTransferFunction, currents: Sequence | np.ndarray | None) -> np.ndarray:
    box = model.box
    if currents is None:
        count = SCHEDULINGS if len(box.names) < 2 else 6
        return box.grid(count) if box.names else np.zeros((1, 0))
    points = np.asarray(currents, dtype=float)
    points = points[:, None] if points.ndim == 1 else points
    return _checks.finite(_checks.shaped(np.atleast_2d(points), (None, len(box.names)), "currents"), "currents")


def _unit(model: LPVTransferFunction) -> str:
    pair = (model.outputs[0].unit, model.inputs[0].unit)
    if pair == ("N", "m/s"):
        return "N s/m"
    return quotient(*pair) if all(pair) else ""


def _span(values: np.ndarray, name: str, unit: str) -> str:
    low, high = float(values.min()), float(values.max())
    text = _number(low) if low == high else f"{_number(low)} to {_number(high)}"
    return f"{text} {unit}" if unit else f"{name} {text}"


def _number(value: float) -> str:
    return f"{round(value, 3) + 0.0:.3g}"
