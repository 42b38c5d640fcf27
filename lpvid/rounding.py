"""Rounding: the limits of double precision, of which guards and tolerances are powers."""

from __future__ import annotations

import sys

EPS, TINY, HUGE = sys.float_info.epsilon, sys.float_info.min, sys.float_info.max
"""relative rounding of a number; the least positive one without loss of digits, by which a divisor is no zero; the
largest"""
HALF_DIGITS = EPS ** (1 / 2)
"""half of the digits: what is left of a number after differences of that size, or where its square was computed"""
STEP = EPS ** (1 / 3)
"""step of a difference, as a share of the scale of what is changed: at a third of the digits its curvature and rounding
are small alike"""
VANISHING = TINY ** (1 / 2)
"""size whose square is no longer a number of all digits"""
EXPLODED = HUGE ** (1 / 3)
"""size from which on a simulation counts as exploded; its square, and sums of that, are finite"""
