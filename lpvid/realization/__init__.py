"""Transfer function to state space, in every form, with the gap each one makes."""

from lpvid.realization.gap import Gap, RecordGap
from lpvid.realization.judgement import Judgement
from lpvid.realization.realization import FORMS, Realization, realize

__all__ = ["FORMS", "Gap", "Judgement", "Realization", "RecordGap", "realize"]
