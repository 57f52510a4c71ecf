"""Regression benchmarks: exact counts of work, errors with jackknife intervals,
and ratios of paired times.
"""
