"""Many files on many processes: one result per file on disk, one model of all, and the files that differ from it.

The folder is the state: a file whose results stand there is not done again, so that a run that was cut short goes on
where it stopped. Needs the extra ``scale`` (Dask).
"""

from __future__ import annotations

from lpvid.fleet.differing import Differing, differing
from lpvid.fleet.plan import FleetPlan, Job, plan_fleet
from lpvid.fleet.running import FleetResult, run_fleet

__all__ = ["Differing", "FleetPlan", "FleetResult", "Job", "differing", "plan_fleet", "run_fleet"]
