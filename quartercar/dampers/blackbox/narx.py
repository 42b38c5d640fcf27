"""NARX dampers: the next force from past forces, displacements and velocities, linear in its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.scheduling import Polynomial
from lpvid.toolkit import checks
from quartercar.dampers.blackbox.sampled import SampledDamper, boolean
from quartercar.dampers.facts import Facts

if TYPE_CHECKING:
    from lpvid.identification import Identification
    from lpvid.identification.arx import ARX

METHODS = ("least-squares", "one-step", "recursive")
"""How a NARX damper can be estimated."""
MOST_DEGREE = 2
"""degree of the coefficients in the current that `suited` proposes at most, as the thesis's tables do."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Narx(SampledDamper):
    """F(k) = Σ_j a_j(i) F(k−j) + Σ_j b_j(i) x(k−j) + Σ_j c_j(i) v(k−j), j = 1 … n (equation sheet 1.4.3 (2.3)).

    In the names of its parameters the past forces have the opposite sign, as in every model of lpvid: ``a1`` is −a_1.

    Attributes
    ----------
    method : {"least-squares", "one-step", "recursive"}
        Least squares re-estimated by simulation error, so that no model is kept that is good one step ahead and useless
        by itself (equation sheet 7.1); plain least squares, as the source; recursive least squares with forgetting
        (Niño-Juárez 2008).
    degree : int
        Degree of the coefficients in the current; 0 without current.
    displacement : bool
        Whether x is read; without it the map is that of velocity alone.
    constant : bool
        A constant force besides, which the source does not have: without one no gas force can be determined.
    first_lag : int
        First lag of motion; 0 lets force follow motion within the sample.
    forgetting : float
        λ of the recursive method, in (0, 1].
    """

    order: ClassVar[int]
    """n: lags of force, displacement and velocity"""

    method: str = "least-squares"
    degree: int = 0
    displacement: bool = True
    constant: bool = False
    first_lag: int = 1
    forgetting: float = 0.995

    def check_orders(self) -> None:
        checks.one_of(self.method, METHODS, "method")
        checks.count(self.degree, "degree")
        checks.count(self.first_lag, "first_lag")
        for name in ("displacement", "constant"):
            boolean(getattr(self, name), name)
        if not 0 < checks.real(self.forgetting, "forgetting") <= 1:
            raise InputError("forgetting lies in (0, 1]", got=self.forgetting)

    @property
    def wanted(self) -> tuple[str, ...]:
        return (*self._motion, *(("current",) if self.degree else ()))

    @property
    def past(self) -> int:
        return max(self.order, self.order + self.first_lag - 1)

    @classmethod
    def suited(cls, facts: Facts) -> Narx:
        degree = min(MOST_DEGREE, max(len(facts.levels) - 1, 1) if facts.levels else MOST_DEGREE)
        return cls(degree=degree if facts.current_varies else 0, displacement=facts.has_displacement, **facts.common)

    @property
    def _motion(self) -> tuple[str, ...]:
        return ("displacement", "velocity") if self.displacement else ("velocity",)

    def to_lpv(self, sample_time: float) -> Any:
        """The transfer function itself: this model is one."""
        return self.at_clock(sample_time)

    def arx(self) -> ARX:
        """The structure in lpvid's words.

        Returns
        -------
        ARX
            For `lpvid.identify`.
        """
        from lpvid.identification.arx import ARX

        basis = Polynomial(("current",), self.degree) if self.degree else Polynomial()
        return ARX(self.order, self.order, self.first_lag, self._motion, "force", basis, int(self.constant))

    def identified(self, records: Sequence[Record]) -> tuple[Self, Identification, tuple[str, ...]]:
        from lpvid.identification import identify
        from lpvid.identification.recursive import Recursive
        from quartercar.dampers.blackbox.simulation_error import by_simulation_error

        notes = () if self.displacement else ("no displacement: a map of velocity and past force alone",)
        if self.method == "one-step":
            return self, identify(records, self.arx()), (*notes, "least squares of one step, as the source")
        if self.method == "recursive":
            stated = f"recursive least squares, forgetting {self.forgetting:g}"
            return self, identify(records, Recursive(self.arx(), self.forgetting)), (*notes, stated)
        found, more = by_simulation_error(records, self.arx())
        return self, found, (*notes, *more)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Narx2(Narx):
    """NARX (2,2,2): Savaresi et al. 2005, in the form of the thesis."""

    name: ClassVar[str] = "narx-2"
    title: ClassVar[str] = "NARX (2,2,2)"
    source: ClassVar[str] = "Díaz Salas 2011 (2.3), after Savaresi et al. 2005"
    order: ClassVar[int] = 2


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Narx3(Narx):
    """NARX (3,3,3): Niño-Juárez et al. 2008."""

    name: ClassVar[str] = "narx-3"
    title: ClassVar[str] = "NARX (3,3,3)"
    source: ClassVar[str] = "Díaz Salas 2011 (2.3), after Niño-Juárez et al. 2008"
    order: ClassVar[int] = 3


__all__ = ["METHODS", "Narx", "Narx2", "Narx3"]
