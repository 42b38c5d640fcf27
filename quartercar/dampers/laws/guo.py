"""Guo's tanh law of an MR damper, without current and in the thesis's current-dependent forms (source 004)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from lpvid.toolkit import checks
from quartercar.dampers.facts import Facts
from quartercar.dampers.laws.coefficients import Controlled, Proportional, Quotient
from quartercar.dampers.laws.tanh_law import POST_YIELD, RATIO, SHARPNESS, YIELD, TanhLaw, Terms
from quartercar.dampers.parameter import Parameter

YIELD_BY_DEGREE = {0: (600.0,), 1: (200.0, 1200.0), 2: (200.0, 900.0, 1200.0)}
DAMPING_BY_DEGREE = {0: (1500.0,), 1: (900.0, 1500.0), 2: (900.0, 1300.0, 1500.0)}
"""Typical control values of A_1 [N] and A_2 [N·s/m]."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Guo(TanhLaw):
    """F = A_1 tanh[A_3 (v + κ x)] + A_2 (v + κ x) [+ F_0], A_1 and A_2 affine in the current where it varies.

    Guo, Yang, Pan (2006), as (2.1) of source 004, whose five parameters A_1, A_2, A_3, V_0, X_0 are four identifiable
    ones with κ = V_0/X_0. The constant F_0 (gas preload, offset of the load cell) is an extension, taken in by
    ``offset=True``. Without a displacement in the data κ is left out and the law has no hysteresis.

    Attributes
    ----------
    degree : {0, 1, 2}
        Of A_1 and A_2 in the current; `suited` takes 1 where the current varies.
    hysteresis : bool
        Whether the displacement enters.

    Examples
    --------
    >>> law = Guo(values={"yield_force": 600.0, "sharpness": 20.0, "post_yield_damping": 1500.0, "critical_ratio": 3.0})
    >>> law.force(0.01, 0.1).round(4)
    array([788.4164])
    """

    name: ClassVar[str] = "guo"
    title: ClassVar[str] = "Guo"
    source: ClassVar[str] = "source 004, (2.1)"
    degree: int = 0
    hysteresis: bool = True

    @property
    def terms(self) -> Terms:
        degree = int(checks.one_of(str(self.degree), ("0", "1", "2"), "degree"))
        span = self.currents
        return Terms(Controlled(YIELD, YIELD_BY_DEGREE[degree], span), Controlled(SHARPNESS, (20.0,)),
                     Controlled(POST_YIELD, DAMPING_BY_DEGREE[degree], span),
                     Controlled(RATIO, (3.0,)) if self.hysteresis else None, None)

    @classmethod
    def suited(cls, facts: Facts) -> Guo:
        span = facts.current_range if facts.current_varies else None
        return cls(degree=int(facts.current_varies), span=span, hysteresis=facts.has_displacement, **facts.common)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Guo5(TanhLaw):
    """F = i A_1 tanh[A_3 (v + κ x)] + A_2 (v + κ x): no yield force without current.

    Díaz Salas (2011), (5.11) as the captions allow. It keeps the thesis's name; of its five parameters A_1, A_2, A_3,
    V_0, X_0 four are identifiable, κ = V_0/X_0 standing for two. ``offset=True`` adds a constant, an extension.
    """

    name: ClassVar[str] = "guo-5"
    title: ClassVar[str] = "Guo, 5 parameters"
    source: ClassVar[str] = "source 004, (5.11)"

    @property
    def terms(self) -> Terms:
        return Terms(_per_current(self.current_unit), Controlled(SHARPNESS, (20.0,)),
                     Controlled(POST_YIELD, (1200.0,)), Controlled(RATIO, (3.0,)), None)

    @classmethod
    def suited(cls, facts: Facts) -> Guo5:
        _need(facts, cls.name)
        return cls(**facts.common)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Guo6(TanhLaw):
    """F = (A_1 i + A_10) tanh[A_3 (v + κ x)] + A_2 (v + κ x).

    Díaz Salas (2011), (5.12) as the captions allow. Of the six parameters A_1, A_10, A_2, A_3, V_0, X_0 five are
    identifiable. The captions allow another reading, i A_1 tanh[A_3 (v + κ x)] + A_2 (v + κ' x) + F_0: that is
    `Guo7` with ``offset=True``. Here ``offset=True`` adds a constant, an extension.
    """

    name: ClassVar[str] = "guo-6"
    title: ClassVar[str] = "Guo, 6 parameters"
    source: ClassVar[str] = "source 004, (5.12)"

    @property
    def terms(self) -> Terms:
        span = self.currents
        return Terms(Controlled(YIELD, YIELD_BY_DEGREE[1], span), Controlled(SHARPNESS, (20.0,)),
                     Controlled(POST_YIELD, (1200.0,)), Controlled(RATIO, (3.0,)), None)

    @classmethod
    def suited(cls, facts: Facts) -> Guo6:
        return cls(span=_need(facts, cls.name), **facts.common)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Guo7(TanhLaw):
    """F = i A_1 tanh[A_3 (v + κ x)] + A_2 (v + κ' x): two critical pairs.

    Díaz Salas (2011), (5.13) as the captions allow. Of the seven parameters A_1, A_2, A_3 and two pairs (V_0, X_0) five
    are identifiable: each pair by its ratio. ``offset=True`` adds a constant, an extension.
    """

    name: ClassVar[str] = "guo-7"
    title: ClassVar[str] = "Guo, 7 parameters"
    source: ClassVar[str] = "source 004, (5.13)"

    @property
    def terms(self) -> Terms:
        post = replace(RATIO, name="post_yield_ratio", description="critical ratio κ' of the post-yield term")
        return Terms(_per_current(self.current_unit), Controlled(SHARPNESS, (20.0,)),
                     Controlled(POST_YIELD, (1200.0,)), Controlled(RATIO, (3.0,)), Controlled(post, (1.0,)))

    @classmethod
    def suited(cls, facts: Facts) -> Guo7:
        _need(facts, cls.name)
        return cls(**facts.common)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Guo15(TanhLaw):
    """F = A_1 tanh[A_3 (v + (V_0/X_0) x)] + A_2 (v + (V_0/X_0) x), all five quadratic in the current.

    Díaz Salas (2011), Table B.5 as its caption allows. Of the 15 parameters 14 are identifiable: V_0(i)/X_0(i) keeps
    its value when both are multiplied by one number, which is removed by X_0 = 1 at the lowest current. Where κ does
    not depend on the current, neither quadratic is determined by it and a fit reports so. ``offset=True`` adds a
    constant, an extension.
    """

    name: ClassVar[str] = "guo-15"
    title: ClassVar[str] = "Guo, 15 parameters"
    source: ClassVar[str] = "source 004, Table B.5"

    @property
    def terms(self) -> Terms:
        span = self.currents
        above = replace(RATIO, name="critical_speed", description="critical velocity V_0 by X_0 at the lowest current")
        below = Parameter("critical_stroke", "", "critical displacement X_0 by X_0 at the lowest current",
                          1.0, 0.05, 20.0)
        return Terms(Controlled(YIELD, (150.0, 800.0, 1200.0), span),
                     Controlled(replace(SHARPNESS, log=False), (30.0, 20.0, 12.0), span),
                     Controlled(POST_YIELD, (600.0, 1100.0, 1500.0), span),
                     Quotient(Controlled(above, (4.0, 5.0, 9.0), span),
                              Controlled(below, (1.0, 0.4, 0.8), span)), None)

    @classmethod
    def suited(cls, facts: Facts) -> Guo15:
        return cls(span=_need(facts, cls.name), **facts.common)


def jenkins_ratio(yield_force: float, stiffness: float, amplitude: float, frequency: float) -> float:
    """κ = V_0/X_0 of a yield element in series with a spring, on x = X sin ωt [1/s].

    Its force is zero at X_0 = X − F_y/k and V_0 = ω √(2 X F_y/k − (F_y/k)²), hence κ = ω √(1−(1−r)²)/(1−r) with
    r = F_y/(k X): in proportion to the frequency and falling with the amplitude. No constant κ can serve two
    amplitudes or two frequencies; infinite where the spring takes the whole stroke (r ≥ 1).

    Parameters
    ----------
    yield_force : float
        F_y [N].
    stiffness : float
        k [N/m].
    amplitude : float
        X [m].
    frequency : float
        f [Hz].

    Returns
    -------
    float
        [1/s].

    Examples
    --------
    >>> [round(jenkins_ratio(1e3, 1e6, x, 5.0), 1) for x in (0.002, 0.005, 0.02)]
    [54.4, 23.6, 10.3]
    """
    reach = yield_force / (checks.positive(stiffness, "stiffness", "N/m") * checks.positive(amplitude, "amplitude"))
    if reach >= 1:
        return math.inf
    return 2 * math.pi * frequency * math.sqrt(1 - (1 - reach) ** 2) / (1 - reach)


def _per_current(unit: str) -> Proportional:
    return Proportional(Parameter("yield_force_per_current", f"N/{unit}", "yield force per current A_1", 600.0, 0.0))


def _need(facts: Facts, model: str) -> tuple[float, float]:
    """The span of currents, or why there is none; these laws also read the displacement."""
    facts.need_current(model)
    facts.need_displacement(model)
    assert facts.current_range is not None
    return facts.current_range
