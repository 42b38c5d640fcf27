"""Condition measured records: filter, differentiate, resample, align, split, cut into segments."""

from __future__ import annotations

from lpvid.condition.resampling import resample
from lpvid.condition.segmentation import segments

__all__ = ["resample", "segments"]
