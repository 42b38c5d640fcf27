"""What a ride is judged by: weighted comfort, road holding, room of the suspension, gains by frequency.

`figures` computes them from a run, `gradient` with their derivatives by the run's signals.
"""

from __future__ import annotations

from quartercar.criteria.figures import (
    BANDS,
    COMFORT,
    FrequencyGains,
    RideFigures,
    band_gain,
    comfort_classes,
    comfort_transfer,
    comfort_transition,
    comfort_weighting,
    frequency_gains,
    judge,
    rms,
    transient_maximum,
    vibration_dose,
    weighted,
)

__all__ = ["BANDS", "COMFORT", "FrequencyGains", "RideFigures", "band_gain", "comfort_classes", "comfort_transfer",
           "comfort_transition", "comfort_weighting", "frequency_gains", "judge", "rms", "transient_maximum",
           "vibration_dose", "weighted"]
