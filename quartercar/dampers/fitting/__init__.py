"""Fitting damper models to the free run along records: `fit(damper, records) -> DamperFit`."""

from __future__ import annotations

from quartercar.dampers.fitting.estimate import Estimate, Starts
from quartercar.dampers.fitting.front import fit
from quartercar.dampers.fitting.result import DamperFit
from quartercar.dampers.fitting.settings import FitSettings

__all__ = ["DamperFit", "Estimate", "FitSettings", "Starts", "fit"]
