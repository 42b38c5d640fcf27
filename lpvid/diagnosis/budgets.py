"""Budgets: the time and memory that a diagnosis may take. With more of any it takes longer; its answers are the same
unless a cause was missed."""

from __future__ import annotations

SEARCH_SAMPLES = 3000
"""samples for a search, whose time is in proportion. A structured error counts as `STRUCTURED_SAMPLES` = 25 of them; in
white noise of 1 % they reveal a cause of .2 % (a log-likelihood ratio of 60)"""
LONG = 65_536
"""samples from which on fewer results are kept, and refits run one after the other: of each kind two along ten
minutes"""
REMEMBERED, REPLACED = 24, 4
"""simulations kept along signals, and results of one kind kept for the last parameter values"""
MOST_POINTS, MOST_SIZES, SCREENED_POINTS = 14, 6, 4
"""grid points at which an effect is screened; sizes of a strength among them, two to a decade; grid points beside a
set, besides that of the largest predicted gain"""
SIMULATED = MOST_POINTS
"""effects simulated beside a set, those of the largest gain predicted from the screening beside the baseline alone"""
BEAM_WIDTH, CHILDREN, CHILDREN_PER_KIND, MOST_MEMBERS = 3, 6, 2, 4
"""sets that are enlarged at a time; refitted children of each, and of these at least as many without memory and with
memory: at first the two kinds fit each other's error; members of a set at most, and rounds of the search"""
MOST_STARTS, REFITTED_STARTS = BEAM_WIDTH, CHILDREN_PER_KIND
"""start points of an effect that is added, and of either effect of a pair; start vectors of one set from which it is
refitted: those of the least cost, of all that were evaluated"""
COARSE_ITERATIONS, NEAR_ITERATIONS, ITERATIONS = 2, 8, 25
"""iterations of a descent at most: from each of several starts, from the best of these or the fit to both folds, and to
the end"""
MOST_FREE = 60
"""number of coefficients of a model above which only those in which its free run is linear are free, and none of a
model with a vector of its own: each free one costs a run at every step of a refit"""
SIGN_PATTERNS = 2000
"""sign patterns drawn for the distribution of the largest statistic: a p-value of .05 has a standard error of .005"""
LISTED = 8
"""entries of a list of an answer, such as laws, sets and regimes"""
