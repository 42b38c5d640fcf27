"""The checks of an audit, in the order in which they run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from lpvid.auditing import clock, excitation, force, gains, motion, naming, resting, spectrum, values
from lpvid.auditing.findings import Finding
from lpvid.auditing.view import View

CLOCKED_CHECKS: tuple[Callable[[View], Iterator[Finding]], ...] = (
    motion.velocity_against_displacement, motion.hum, resting.rests, resting.flat_peaks,
    force.polarity, force.offset, force.drift,
    excitation.repeated, spectrum.moving_average,
)
"""Checks of one record that need a rate."""

RECORD_CHECKS: tuple[Callable[[View], Iterator[Finding]], ...] = (
    clock.short, clock.jitter, clock.rounded_stamps, clock.gaps, clock.disorder, clock.repeated_rows,
    clock.unitless,
    values.missing, values.unusable, values.units, values.constant, values.spiked, values.clipped, values.quantised,
    values.duplicates, *CLOCKED_CHECKS, naming.nominal,
)
"""Checks of one record at a time."""

DATA_SET_CHECKS: tuple[Callable[[Sequence[View]], Iterator[Finding]], ...] = (
    clock.mixed_rates, spectrum.noise, spectrum.oversampled, force.mixed_polarity, force.offset_between,
    motion.magnitude, excitation.scheduling, excitation.same_excitation, gains.motion_gain_varies,
    gains.force_gain_varies,
    gains.force_scale_varies,
)
"""Checks of all records together."""
