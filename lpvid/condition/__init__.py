"""Condition measured records: filter, differentiate, resample, align, split, cut into segments."""

from __future__ import annotations

from lpvid.condition.alignment import align, delay
from lpvid.condition.differentiation import differentiate, with_derived, with_velocity
from lpvid.condition.filtering import low_pass
from lpvid.condition.resampling import resample
from lpvid.condition.segmentation import segments
from lpvid.condition.splitting import Repetition, blocks, folds, leaks, repetition_period, split_tail

__all__ = ["Repetition", "align", "blocks", "delay", "differentiate", "folds", "leaks", "low_pass", "repetition_period",
           "resample", "segments", "split_tail", "with_derived", "with_velocity"]
