"""Accuracy with its price: error, invariant defects, time and work of several methods on the same paths."""
