"""Budgets: the memory that simulations may take, and the time of a derivative. With more of either a diagnosis takes
longer; its answers are the same."""

from __future__ import annotations

LONG = 65_536
"""samples from which on fewer results are kept, and refits run one after the other: of each kind two along ten
minutes"""
REMEMBERED, REPLACED = 24, 4
"""simulations kept along signals, and results of one kind kept for the last parameter values"""
MOST_FREE = 60
"""number of coefficients of a model above which only those in which its free run is linear are free, and none of a
model with a vector of its own: each free one costs a run at every step of a refit"""
