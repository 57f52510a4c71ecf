"""Regression benchmarks: exact work counters, error with its standard error, time as a paired ratio."""
