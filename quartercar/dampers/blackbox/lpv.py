"""The thesis's LPV damper: a shaped input, then a linear filter whose coefficients follow the current."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.scheduling import Polynomial
from lpvid.toolkit import checks
from quartercar.dampers.blackbox.sampled import SampledDamper, boolean
from quartercar.dampers.facts import Facts

if TYPE_CHECKING:
    from lpvid.identification import Identification
    from lpvid.identification.arx import ARX

SHAPES = ("tanh", "three-zone")
"""How the velocity can be shaped."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class LpvArx(SampledDamper):
    """F(k) = −Σ a_j(i) F(k−j) + Σ b_j(i) u(k−j), u shaped from v (Díaz Salas 2011 (3.5)-(3.7), (3.22), (3.23)).

    With ``shape="three-zone"`` it is the thesis's own: least squares for the filter, three straight zones for the
    static law. With ``shape="tanh"`` (the default) tanh(v/v_0(i)) stands beside v, an affine term is there for gas and
    offset, the current passes a lag with its own times for rise and fall, and the whole is re-estimated by simulation
    error. Without a current both are filters of constant coefficients behind a static law (Hammerstein).

    Attributes
    ----------
    shape : {"tanh", "three-zone"}
    order : int
        Lags of force and velocity.
    degree : int
        Degree of the coefficients in the current; 0 without current.
    passive : bool
        The best model that never gives energy, whatever motion and current do (`lpvid.Passive`), with the tanh shape.
    """

    name: ClassVar[str] = "lpv-arx"
    title: ClassVar[str] = "LPV with shaped input"
    source: ClassVar[str] = "Díaz Salas 2011 (3.22), (3.23)"

    shape: str = "tanh"
    order: int = 4
    degree: int = 1
    passive: bool = False

    def check_orders(self) -> None:
        checks.one_of(self.shape, SHAPES, "shape")
        checks.count(self.order, "order", at_least=1)
        checks.count(self.degree, "degree")
        if boolean(self.passive, "passive") and self.shape != "tanh":
            raise InputError("a passive lpv-arx has the tanh shape", got=self.shape, mend="set shape to tanh")

    @property
    def wanted(self) -> tuple[str, ...]:
        return ("velocity", "current") if self.degree else ("velocity",)

    @property
    def past(self) -> int:
        return self.order

    @classmethod
    def suited(cls, facts: Facts) -> LpvArx:
        return cls(degree=1 if facts.current_varies else 0, **facts.common)

    def to_lpv(self, sample_time: float) -> Any:
        """The transfer function itself: this model is one."""
        return self.at_clock(sample_time)

    def arx(self, moving: bool) -> ARX:
        """The structure in lpvid's words; `moving` states whether the current ever moves within a record.

        Parameters
        ----------
        moving : bool
            Whether the current moves within a record, so that a lag of rise and fall is fitted too.

        Returns
        -------
        ARX
            For `lpvid.identify`.
        """
        from lpvid.identification.arx import ARX

        basis = Polynomial(("current",), self.degree) if self.degree else Polynomial()
        plain = self.shape == "three-zone"
        lag = None if plain or not moving or not self.degree else "rise-fall"
        return ARX(self.order, self.order, 0, "velocity", "force", basis, 0 if plain else 1, stage=self.shape,
                   schedule_filter=lag)

    def identified(self, records: Sequence[Record]) -> tuple[Self, Identification, tuple[str, ...]]:
        from lpvid.identification import identify
        from quartercar.dampers.blackbox.simulation_error import by_simulation_error

        arx = self.arx(bool(self.degree) and current_moves(records))
        if self.shape == "three-zone":
            return self, identify(records, arx), ()
        if self.passive:
            from lpvid.identification.passive import Passive
            from lpvid.report.passivity import cost_lines

            found = identify(records, Passive(arx))
            return self, found.replace(notes=()), (*found.notes, *cost_lines(found))
        found, notes = by_simulation_error(records, arx)
        return self, found, notes


def current_moves(records: Sequence[Record]) -> bool:
    """Whether the current moves within some record, so that a lag of it can be seen.

    Parameters
    ----------
    records : sequence of Record
        With current.

    Returns
    -------
    bool
        True where its range within one record exceeds a tenth of the range over all.
    """
    spread = max(float(np.ptp(r["current"])) for r in records)
    whole = max(float(r["current"].max()) for r in records) - min(float(r["current"].min()) for r in records)
    return spread > 0.1 * max(whole, 1e-12)
