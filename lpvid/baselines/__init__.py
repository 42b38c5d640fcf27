"""Baselines: what a simulation must offer to be judged and extended, the signals it runs along, models as baselines.

`Baseline` is the contract, `Signals` its input: the channels of a record by role.
"""

from __future__ import annotations

from lpvid.baselines.baseline import Baseline, Coefficient
from lpvid.baselines.signals import Signals

__all__ = ["Baseline", "Coefficient", "Signals"]
