"""Extending an LPV structure: what each cause requires of an identified model, and what that gains on data not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lpvid.condition.constancy import at_rest, constant
from lpvid.condition.derivation import DERIVED, derived
from lpvid.effects.effect import Effect, LpvChange
from lpvid.errors import InputError
from lpvid.record import Record
from lpvid.scheduling import Polynomial
from lpvid.validation.figures import gain_percent

if TYPE_CHECKING:
    from lpvid.identification import Identification
    from lpvid.identification.arx import ARX



@dataclass(frozen=True, eq=False)
class LpvExtension:
    """An LPV model without and with the changes that the causes require.

    Attributes
    ----------
    base, extended : Identification
        Fitted to the same records, judged on the same held-out ones.
    changes : tuple of str
        What each cause required, in words.
    left_out : tuple of str
        Causes that no LPV structure represents, or not with these channels.
    """

    base: Identification
    extended: Identification
    changes: tuple[str, ...]
    left_out: tuple[str, ...]

    @property
    def esr(self) -> tuple[float | None, float | None]:
        """Free-run ESR on held-out records, before and after; None where a run diverged."""
        runs = [i.held_out for i in (self.base, self.extended)]
        before, after = (None if v is None else v.overall.free_run.esr for v in runs)
        return before, after

    @property
    def gain_percent(self) -> float | None:
        """100 (1 − ESR after / ESR before), free run, held-out."""
        before, after = self.esr
        return None if before is None or after is None or before <= 0 else gain_percent(before, after)

    def to_dict(self) -> dict:
        """Plain data for JSON.

        Returns
        -------
        dict
            ``changes``, ``left_out``, ``run``, ``data``, ``esr`` with ``before`` and ``after``, ``gain_percent`` and
            ``structure``, that of the extended model.
        """
        before, after = self.esr
        return {"changes": list(self.changes), "left_out": list(self.left_out), "run": "free-run", "data": "held-out",
                "esr": {"before": before, "after": after}, "gain_percent": self.gain_percent,
                "structure": self.extended.structure.to_dict()}

    def __str__(self) -> str:
        before, after = self.esr
        stated = "; ".join(self.changes) or "nothing changed"
        if before is None or after is None:
            return f"LPV extension ({stated}): a free run diverged on held-out data"
        end = "; no better than the mean of these data" if after >= 1 else "; no gain" if after >= before else ""
        return f"LPV extension ({stated}): free-run ESR {before:.4g} to {after:.4g} held-out{end}"


def extend_lpv(records: Sequence[Record], structure: ARX, effects: Sequence[Effect],
               held_out: Sequence[Record] | None = None) -> Identification:
    """Identify an LPV-ARX structure enlarged by what each effect requires.

    A lag filters the scheduling variable, a curved dependence raises the degree, a parallel force becomes a further
    input (derived where it is not measured), an unlogged quantity a further scheduling variable, a state a further
    order; for a delay of the input, nk is selected again by the free run on training data.

    Parameters
    ----------
    records : sequence of Record
        Uniform.
    structure : ARX
    effects : sequence of Effect
    held_out : sequence of Record, optional

    Returns
    -------
    Identification
        Of records with the derived channels that it requires (`lpvid.condition.derivation`).
    """
    from lpvid.identification import identify

    changes = [c for c in (e.lpv_change() for e in effects) if c is not None]
    training = derived(records)
    kept = None if held_out is None else derived(held_out)
    wide = enlarged(structure, changes, training)
    if not any(c.delay for c in changes):
        return identify(training, wide, held_out=kept)
    memory = structure.na + max(structure.width)
    delays = [0, *(2**k for k in range(memory.bit_length()))]  # doubled up to the samples that the structure recalls
    tried = [identify(training, replace(wide, nk=(nk, *wide.nk[1:]))) for nk in delays]  # type: ignore[index]
    best = min(tried, key=lambda i: _esr(i))
    return identify(training, best.structure, held_out=kept)


def measured_extension(records: Sequence[Record], structure: ARX, effects: Sequence[Effect],
                       held_out: Sequence[Record] = ()) -> LpvExtension:
    """The structure without and with the effects, both compared on held-out records.

    Without `held_out` the last third of every record is held out.

    Parameters
    ----------
    records : sequence of Record
        Uniform.
    structure : ARX
    effects : sequence of Effect
        Those that no LPV structure represents, or that need a channel which was not measured, are left out.
    held_out : sequence of Record, optional

    Returns
    -------
    LpvExtension
    """
    from lpvid.condition import split_tail
    from lpvid.identification import identify

    training, kept = list(records), list(held_out)
    if not kept:
        pairs = [split_tail(r) for r in records]
        training, kept = [a for a, _ in pairs], [b for _, b in pairs]
    stated, left, taken, names = [], [], [], structure.basis.names
    for effect in effects:
        change = effect.lpv_change()
        missing = None if change is None else _first_missing((*change.regressors, *change.schedule), derived(records))
        if change is None or missing is not None:
            why = f"{missing} was not measured" if missing else "no LPV structure represents it"
            left.append(f"{effect.name}: {why}")
        elif change.schedule_filter is not None and at_rest(training, names):
            left.append(f"{effect.name}: {', '.join(names)} is constant within every record")
        else:
            taken.append(effect)
            stated.append(f"{effect.name}: {change.description}")
    return LpvExtension(identify(training, structure, held_out=kept), extend_lpv(training, structure, taken, kept),
                        tuple(stated), tuple(left))


def common_structure(records: Sequence[Record], output: str) -> ARX | None:
    """The default LPV structure for these records: order 4, shaped velocity, first degree in the current if it varies.

    None where there is no velocity.

    Parameters
    ----------
    records : sequence of Record
        Prepared; a current that is not `constant` schedules.
    output : str
        Role of the output.

    Returns
    -------
    ARX or None
        None also where some record has no such output, or the output is the velocity.
    """
    from lpvid.identification.arx import ARX

    if output == "velocity" or not all(r.has("velocity") and r.has(output) for r in records):
        return None
    current = all(r.has("current") for r in records)
    if current:
        values = np.concatenate([r["current"] for r in records])
        current = not constant(float(values.min()), float(values.max()), "A")
    basis = Polynomial(("current",), degree=1) if current else Polynomial()
    return ARX(4, 4, 0, "velocity", output, basis, stage="tanh")


def enlarged(structure: ARX, changes: Sequence[LpvChange], records: Sequence[Record]) -> ARX:
    """The structure with all changes, as far as the records have the channels that these require.

    Parameters
    ----------
    structure : ARX
    changes : sequence of LpvChange
        Their orders add up; of their degrees the largest counts.
    records : sequence of Record
        With derived channels (`lpvid.condition.derivation`).

    Returns
    -------
    ARX

    Raises
    ------
    InputError
        A change requires a channel that was not measured, or the structure has no polynomial basis to raise.
    """
    basis, order = structure.basis, sum(c.order for c in changes)
    inputs = [n for c in changes for n in c.regressors if n != "1"]
    inputs = [n for n in dict.fromkeys(_channel(n, records) for n in inputs) if n not in structure.input]
    more = [n for n in dict.fromkeys(_channel(n, records) for c in changes for n in c.schedule)
            if n not in basis.names]
    degree = max((c.degree for c in changes), default=0)
    if degree or more:
        if not isinstance(basis, Polynomial):
            raise InputError("only a polynomial basis can be extended", got=type(basis).__name__)
        basis = Polynomial((*basis.names, *more), max((basis.degree or 0) + degree, 1))
    nb, nk = structure.width, structure.delay
    constant = any("1" in c.regressors for c in changes)
    return replace(structure, na=structure.na + order, nb=(*(n + order for n in nb), *(nb[0] + order for _ in inputs)),
                   nk=(*nk, *(nk[0] for _ in inputs)), input=(*structure.input, *inputs), basis=basis,
                   affine=max(structure.affine, int(constant)), schedule_filter=_filter(structure, changes))


def _filter(structure: ARX, changes: Sequence[LpvChange]):
    required = [c.schedule_filter for c in changes if c.schedule_filter is not None]
    if not required or not structure.basis.names:
        return structure.schedule_filter
    lag = "rise-fall" if any("rise-fall" in kind for kind in required) else "lag"
    return lag + ("-delay" if any("delay" in kind for kind in required) else "")


def _channel(name: str, records: Sequence[Record]) -> str:
    if _first_missing((name,), records) is not None:
        raise InputError(f"the LPV extension needs {name}, which some record does not have",
                         got=", ".join(records[0].channels))
    return DERIVED[name].name if name in DERIVED else name


def _first_missing(names: Sequence[str], records: Sequence[Record]) -> str | None:
    """The first name that some record does not have, measured or derived."""
    known = {n: DERIVED[n].name if n in DERIVED else n for n in names if n != "1"}
    return next((n for n, channel in known.items() if not all(r.has(channel) for r in records)), None)


def _esr(found: Identification) -> float:
    assert found.training is not None
    esr = found.training.overall.free_run.esr
    return np.inf if esr is None else esr
