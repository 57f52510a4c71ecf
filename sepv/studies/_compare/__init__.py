"""Comparison of methods on the same paths: errors, invariant defects,
times and counts of evaluations.
"""
