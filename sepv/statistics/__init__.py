"""Estimates with intervals whose error probability is stated.

Read `_jackknife` first (an interval for a statistic of means over paths). `_quantiles` has
quantiles of Student's t, of F and of the binomial distribution.
"""

from __future__ import annotations

from sepv.statistics._jackknife import JACKKNIFE_GROUPS, Estimate, jackknife, jackknife_half
from sepv.statistics._quantiles import binomial, fishers_f, students_t
