"""Figures of dampers: one identified model on its experiments, several models beside each other."""

from __future__ import annotations

from quartercar.plot.comparing import experiments_by_model, force_over_time, force_over_velocity, livelier, ranking
from quartercar.plot.fan import force_velocity_fan
from quartercar.plot.identified import experiments, loops_by_current, overview

__all__ = ["experiments", "experiments_by_model", "force_over_time", "force_over_velocity",
           "force_velocity_fan", "livelier", "loops_by_current", "overview", "ranking"]
