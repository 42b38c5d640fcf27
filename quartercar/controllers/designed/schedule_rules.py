"""Where a scheduled controller takes its scheduling variables from: one rule for each."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lpvid.codec import Coded
from lpvid.errors import InputError
from lpvid.export.expression import Expr, call, clipped
from lpvid.export.step_builder import StepBuilder
from lpvid.toolkit import checks
from quartercar.controllers.contract import SIGNALS, Setting, Signals

SMALL = 1.0
"""Demand beside the nominal damping below which it counts as met [N]."""


class Rule(Coded, ABC):
    """A scheduling variable from what a law reads. A rule with a memory keeps it in what `start` returns."""

    NOUN = "rule of a schedule"
    JSON = ("kind", ...)

    kind: ClassVar[str]

    @property
    @abstractmethod
    def reads(self) -> tuple[str, ...]:
        """Signals that it needs, of `contract.SIGNALS`."""

    @abstractmethod
    def start(self, setting: Setting) -> Callable[[Signals], np.ndarray]:
        """A function from signals to (cars,) values, called once per sample.

        Parameters
        ----------
        setting : Setting
            Cars and period.

        Returns
        -------
        callable
            Takes the signals of a sample, returns (cars,) values.
        """

    def expression(self, b: StepBuilder, seen: Mapping[str, Expr]) -> Expr:
        """The variable as an expression, for C, FMU and MATLAB.

        Parameters
        ----------
        b : StepBuilder
            Takes the states of a rule with memory.
        seen : mapping of str to Expr
            The signals in `reads`.

        Returns
        -------
        Expr

        Raises
        ------
        InputError
            A rule that has no exported step.
        """
        raise InputError("this rule of a schedule has no exported step", got=self.kind, mend="schedule on 'measured'")


@dataclass(frozen=True)
class Measured(Rule):
    """ρ = a signal, as it is measured or estimated.

    Parameters
    ----------
    signal : str
        Name of the signal.
    """

    signal: str
    kind: ClassVar[str] = "measured"

    def __post_init__(self) -> None:
        checks.known_name(self.signal, tuple(SIGNALS), "signal of a law")

    @property
    def reads(self) -> tuple[str, ...]:
        return (self.signal,)

    def start(self, setting: Setting) -> Callable[[Signals], np.ndarray]:
        return lambda seen: seen[self.signal]

    def expression(self, b: StepBuilder, seen: Mapping[str, Expr]) -> Expr:
        return seen[self.signal]


@dataclass(frozen=True)
class Yield(Rule):
    """ρ_1 = tanh ξ, or ρ_2 = tanh ξ/ξ with ``ratio=True``; ξ = c_1 v_d + k_1 z_d (equation sheet, E1).

    Attributes
    ----------
    per_velocity, per_deflection : float
        c_1 [s/m], k_1 [1/m].
    ratio : bool
    """

    per_velocity: float
    per_deflection: float = 0.0
    ratio: bool = False
    kind: ClassVar[str] = "yield"
    reads: ClassVar[tuple[str, ...]] = "suspension_velocity", "suspension_deflection"

    def start(self, setting: Setting) -> Callable[[Signals], np.ndarray]:
        def value(seen: Signals) -> np.ndarray:
            xi = self.per_velocity * seen["suspension_velocity"] + self.per_deflection * seen["suspension_deflection"]
            if not self.ratio:
                return np.tanh(xi)
            small = np.abs(xi) < 1e-4
            return np.where(small, 1 - xi**2 / 3, np.tanh(xi) / np.where(small, 1.0, xi))

        return value

    def expression(self, b: StepBuilder, seen: Mapping[str, Expr]) -> Expr:
        xi = b.let("xi", self.per_velocity * seen["suspension_velocity"]
                   + self.per_deflection * seen["suspension_deflection"])
        if not self.ratio:
            return call("tanh", xi)
        out = b.let("secant", 1.0 - xi * xi / 3.0)
        with b.when(call("fabs", xi) >= 1e-4):
            b.set(out, call("tanh", xi) / xi)
        return out


@dataclass(frozen=True)
class SaturationRatio(Rule):
    """ρ = attained/demanded of the last sample, between `lowest` and 1: sat(u)/u (equation sheet, E2).

    1 while nothing is demanded; below zero (a damper that cannot even have the sign) it counts as `lowest`.

    Attributes
    ----------
    lowest : float
    offset : float
        Of both before the ratio is taken: u = demand − offset.
    small : float
        Demand below which the ratio is 1, in the law's unit.
    """

    lowest: float = 0.0
    offset: float = 0.0
    small: float = 1e-6
    kind: ClassVar[str] = "saturation-ratio"
    reads: ClassVar[tuple[str, ...]] = "demanded", "attained"

    def start(self, setting: Setting) -> Callable[[Signals], np.ndarray]:
        def value(seen: Signals) -> np.ndarray:
            return share(seen["demanded"] - self.offset, seen["attained"] - self.offset, self.lowest, self.small)

        return value

    def expression(self, b: StepBuilder, seen: Mapping[str, Expr]) -> Expr:
        return _share_expression(b, seen["demanded"] - self.offset, seen["attained"] - self.offset, self.lowest,
                                 self.small)


@dataclass(frozen=True)
class Excess(Rule):
    """ρ = ρ_max μ ε⁴/(μ ε⁴ + 1/μ), ε = |demanded − attained|/scale of the last sample (equation sheet, E5).

    Attributes
    ----------
    scale : float
        Demand at which ε is one, in the law's unit.
    sharpness, highest : float
        μ, ρ_max.
    smoothing : float
        Time constant of a lag on ρ [s]; 0 for none.
    """

    scale: float
    sharpness: float = 1e2
    highest: float = 10.0
    smoothing: float = 0.0
    kind: ClassVar[str] = "excess"
    reads: ClassVar[tuple[str, ...]] = "demanded", "attained"

    def start(self, setting: Setting) -> Callable[[Signals], np.ndarray]:
        share = 1.0 if self.smoothing <= 0 else -np.expm1(-setting.sample_time / self.smoothing)
        last = np.zeros(setting.cars)

        def value(seen: Signals) -> np.ndarray:
            nonlocal last
            power = self.sharpness * (np.abs(seen["demanded"] - seen["attained"]) / self.scale) ** 4
            last = last + share * (self.highest * power / (power + 1 / self.sharpness) - last)
            return last

        return value

    def expression(self, b: StepBuilder, seen: Mapping[str, Expr]) -> Expr:
        share = 1.0 if self.smoothing <= 0 else float(-np.expm1(-b.sample_time / self.smoothing))
        last = b.state("excess", "", "excess of the last demand, smoothed")
        off = b.let("off", call("fabs", seen["demanded"] - seen["attained"]) / self.scale)
        power = b.let("power", self.sharpness * (off * off * off * off))
        b.set(last, last + share * (self.highest * power / (power + 1.0 / self.sharpness) - last))
        return b.let("excess_now", last)


@dataclass(frozen=True)
class GivenShare(Rule):
    """ρ = (attained − c_nom v_d)/(demanded − c_nom v_d) of the last sample, between `lowest` and 1 (E2 on E5).

    Attributes
    ----------
    nominal_damping : float
        c_nom [N·s/m].
    lowest : float
    """

    nominal_damping: float
    lowest: float = 0.0
    kind: ClassVar[str] = "given-share"
    reads: ClassVar[tuple[str, ...]] = "demanded", "attained", "suspension_velocity"

    def start(self, setting: Setting) -> Callable[[Signals], np.ndarray]:
        base = np.zeros(setting.cars)

        def value(seen: Signals) -> np.ndarray:
            nonlocal base
            found = share(seen["demanded"] - base, seen["attained"] - base, self.lowest)
            base = self.nominal_damping * seen["suspension_velocity"]
            return found

        return value

    def expression(self, b: StepBuilder, seen: Mapping[str, Expr]) -> Expr:
        base = b.state("nominal_before", "N", "nominal force of the last sample")
        out = _share_expression(b, seen["demanded"] - base, seen["attained"] - base, self.lowest, SMALL)
        b.set(base, self.nominal_damping * seen["suspension_velocity"])
        return out


def share(asked: np.ndarray, given: np.ndarray, lowest: np.ndarray | float, small: float = SMALL) -> np.ndarray:
    """(cars,) given/demanded within [lowest, 1]; 1 where next to nothing is demanded.

    Parameters
    ----------
    asked, given : (cars,) arrays
        Forces [N].
    lowest : float or (cars,) array
        Least share.
    small : float
        What counts as next to nothing [N].

    Returns
    -------
    (cars,) array
        Between `lowest` and 1.

    Examples
    --------
    >>> share(np.array([500.0, 500.0, 500.0, 0.0]), np.array([250.0, -100.0, 600.0, 3.0]), 0.1).tolist()
    [0.5, 0.1, 1.0, 1.0]
    """
    idle = np.abs(asked) <= small
    return np.where(idle, 1.0, np.clip(given / np.where(idle, 1.0, asked), lowest, 1.0))


def _share_expression(b: StepBuilder, asked: Expr, given: Expr, lowest: float, small: float) -> Expr:
    """given/demanded within [lowest, 1]; 1 where next to nothing is demanded."""
    wanted, out = b.let("asked", asked), b.let("share", 1.0)
    with b.when(call("fabs", wanted) > small):
        b.set(out, clipped(given / wanted, lowest, 1.0))
    return out
