"""Budgets: the time and memory that a diagnosis may take. With more of any it takes longer; its answers are the same
unless a cause was missed."""

from __future__ import annotations

from lpvid.effects.effect import MOST_POINTS

SEARCH_SAMPLES = 3000
"""samples for a search, whose time is in proportion. A structured error counts as `STRUCTURED_SAMPLES` = 25 of them; in
white noise of 1 % they reveal a cause of .2 % (a log-likelihood ratio of 60)"""
SIMULATED, SCREENED_POINTS = MOST_POINTS, 4
"""effects simulated beside a set, those of the largest gain predicted from the screening beside the baseline alone; and
grid points of each, besides that of the largest predicted gain"""
BEAM_WIDTH, CHILDREN, CHILDREN_PER_KIND, MOST_MEMBERS = 3, 6, 2, 4
"""sets that are enlarged at a time; refitted children of each, and of these at least as many without memory and with
memory: at first the two kinds fit each other's error; members of a set at most, and rounds of the search"""
MOST_STARTS, REFITTED_STARTS = BEAM_WIDTH, CHILDREN_PER_KIND
"""start points of an effect that is added, and of either effect of a pair; start vectors of one set from which it is
refitted: those of the least cost, of all that were evaluated"""
COARSE_ITERATIONS, NEAR_ITERATIONS, ITERATIONS = 2, 8, 25
"""iterations of a descent at most: from each of several starts, from the best of these or the fit to both folds, and to
the end"""
SIGN_PATTERNS = 2000
"""sign patterns drawn for the distribution of the largest statistic: a p-value of .05 has a standard error of .005"""
LISTED = 8
"""entries of a list of an answer, such as laws, sets and regimes"""
