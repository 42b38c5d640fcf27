"""Candidates: the ARX structures that a choice of orders, delays, bases and stages spans."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from lpvid import _checks
from lpvid.errors import InputError
from lpvid.identification.arx import ARX
from lpvid.model.input_stage import STAGES, InputStage
from lpvid.model.scheduling_stage import FITTED, SchedulingStage
from lpvid.scheduling import Basis, Polynomial

AFFINE = ("none", "one", "all")
"""affine terms: none, c_0 alone, or c_0 … c_na."""


@dataclass(frozen=True)
class Candidates:
    """A grid of ARX structures, to be searched by `select`.

    Parameters
    ----------
    input, output : str or sequence of str
        Channel names.
    scheduling : str or sequence of str
        Scheduling variables; empty for time-invariant candidates alone.
    na : sequence of int
        Numbers of output lags.
    nb : sequence of int, optional
        Numbers of input lags; left out, na − 1, na and na + 1 go with every na.
    nk : sequence of int
        First input lags.
    degree : sequence of int
        Degrees of the polynomial basis; 0 is time-invariant.
    bases : sequence of Basis
        Further bases beside the polynomials.
    affine : sequence of {"none", "one", "all"}
        Affine terms: none, c_0, or c_0 … c_na.
    lagged : sequence of bool
        Coefficients at p(k), or at p(k−i).
    stage, schedule_filter : sequences
        What `ARX` takes, None included.
    weight : str, optional
        Channel of weights.

    Examples
    --------
    >>> grid = Candidates("u", "y", "p", na=(1, 2), nk=(1,), degree=(0, 1), affine=("none",), lagged=(False, True))
    >>> len(list(grid)), len(grid)
    (15, 15)
    """

    input: str | tuple[str, ...]
    output: str | tuple[str, ...]
    scheduling: str | tuple[str, ...] = ()
    na: tuple[int, ...] = (1, 2, 3, 4, 5, 6)
    nb: tuple[int, ...] | None = None
    nk: tuple[int, ...] = (0, 1, 2)
    degree: tuple[int, ...] = (1, 2)
    bases: tuple[Basis, ...] = ()
    affine: tuple[str, ...] = AFFINE
    lagged: tuple[bool, ...] = (False, True)
    stage: tuple[InputStage | str | None, ...] = (None,)
    schedule_filter: tuple[SchedulingStage | str | None, ...] = (None,)
    weight: str | None = None

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        set_(self, "input", _checks.names(self.input, "input"))
        set_(self, "output", _checks.names(self.output, "output"))
        set_(self, "scheduling", _checks.names(self.scheduling, "scheduling") if self.scheduling else ())
        for name in ("na", "nb", "nk", "degree", "bases", "affine", "lagged", "stage", "schedule_filter"):
            values = getattr(self, name)
            if values is None:
                continue
            if isinstance(values, str | int) or (not tuple(values) and name != "bases"):
                raise InputError(f"candidates need a non-empty sequence of values for {name}", got=repr(values))
            set_(self, name, tuple(values))
        for value in self.affine:
            _checks.one_of(value, AFFINE, "affine")
        for value, allowed, name in [*((s, tuple(STAGES), "stage") for s in self.stage),
                                     *((s, tuple(FITTED), "schedule_filter") for s in self.schedule_filter)]:
            if isinstance(value, str):
                _checks.one_of(value, allowed, name)

    def _bases(self) -> list[Basis]:
        degrees = sorted(set(self.degree)) if self.scheduling else [0]
        polynomials = [Polynomial(tuple(self.scheduling), degree=d) if d else Polynomial() for d in degrees]
        return [*polynomials, *self.bases]

    def __iter__(self) -> Iterator[ARX]:
        for basis in self._bases():
            for stage in self.stage:
                for lag in self.schedule_filter:
                    if lag is None or basis.names:
                        start = ARX(input=self.input, output=self.output, basis=basis, stage=stage,
                                    schedule_filter=lag, weight=self.weight)
                        yield from self._orders(start)

    def _orders(self, start: ARX) -> Iterator[ARX]:
        constant = not start.basis.names
        for lagged in dict.fromkeys(False if constant else bool(v) for v in self.lagged):
            for na in self.na:
                widths = self.nb if self.nb is not None else tuple(b for b in (na - 1, na, na + 1) if b > 0)
                terms = dict.fromkeys(0 if a == "none" else 1 if a == "one" or constant else na + 1
                                      for a in self.affine)
                for nb in widths:
                    for nk in self.nk:
                        for affine in terms:
                            yield replace(start, na=na, nb=nb, nk=nk, affine=affine, lagged=lagged)

    def __len__(self) -> int:
        return sum(1 for _ in self)
