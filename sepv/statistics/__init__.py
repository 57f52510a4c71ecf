"""Estimates with intervals whose error probability is stated.

Read `_jackknife` first (an interval for a statistic of means over paths); `_quantiles` has those of Student's t, of F
and of the binomial distribution.
"""

from __future__ import annotations

from sepv.statistics._jackknife import GROUPS as GROUPS
from sepv.statistics._jackknife import Estimate as Estimate
from sepv.statistics._jackknife import jackknife as jackknife
from sepv.statistics._jackknife import jackknife_half as jackknife_half
from sepv.statistics._quantiles import binomial as binomial
from sepv.statistics._quantiles import fishers_f as fishers_f
from sepv.statistics._quantiles import students_t as students_t
