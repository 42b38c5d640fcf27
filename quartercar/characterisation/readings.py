"""Readings: everything that is read off the records of a damper dynamometer, as one result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quartercar.characterisation.currents import CurrentSpread, ReboundRatio
from quartercar.characterisation.cycles import Block
from quartercar.characterisation.drift import Drift
from quartercar.characterisation.forces import StandardForce
from quartercar.characterisation.gas import StaticForce
from quartercar.characterisation.histogram import VelocityHistogram
from quartercar.characterisation.loops import ForceLoop
from quartercar.characterisation.points import PeakPoint
from quartercar.characterisation.runs import RecordPieces
from quartercar.characterisation.settings import CharacteriseSettings
from quartercar.characterisation.switching import SwitchingSteps
from quartercar.characterisation.tolerance import Check, SpecimenSpread


@dataclass(frozen=True)
class Missing:
    """One thing that the records do not hold.

    Attributes
    ----------
    what : str
    why : str
    run : str
        The test that gives it.
    """

    what: str
    why: str
    run: str


@dataclass(frozen=True, eq=False)
class Readings:
    """What a damper dynamometer reads off records.

    Attributes
    ----------
    settings : CharacteriseSettings
    data : RecordPieces
    blocks : tuple of Block
        Periodic stretches, in the order of the files.
    peaks : tuple of PeakPoint
    forces : tuple of StandardForce
    static : tuple of StaticForce
        Gas, rate and friction of the slowest tests.
    loops : tuple of ForceLoop
    ratios : tuple of ReboundRatio
    spreads : tuple of CurrentSpread
    switching : tuple of SwitchingSteps
    drifts : tuple of Drift
    histograms : tuple of VelocityHistogram
    checks : tuple of Check
    specimens : tuple of SpecimenSpread
    missing : tuple of Missing
        What the records do not hold, why, and what to run.
    notes : tuple of str
    models : dict
        Simulated force along a run [N], by the run's `id`; empty without a model.
    model : str
        Name of the model; empty without one.
    """

    settings: CharacteriseSettings
    data: RecordPieces
    blocks: tuple[Block, ...]
    peaks: tuple[PeakPoint, ...]
    forces: tuple[StandardForce, ...]
    static: tuple[StaticForce, ...]
    loops: tuple[ForceLoop, ...]
    ratios: tuple[ReboundRatio, ...]
    spreads: tuple[CurrentSpread, ...]
    switching: tuple[SwitchingSteps, ...]
    drifts: tuple[Drift, ...]
    histograms: tuple[VelocityHistogram, ...]
    checks: tuple[Check, ...]
    specimens: tuple[SpecimenSpread, ...]
    missing: tuple[Missing, ...]
    notes: tuple[str, ...]
    models: dict[int, np.ndarray]
    model: str

    @property
    def given(self) -> tuple[StandardForce, ...]:
        """Forces that the records hold."""
        return tuple(f for f in self.forces if f.force is not None)
