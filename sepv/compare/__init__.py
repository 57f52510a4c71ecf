"""Accuracy with its price: error, invariant defects, time and work of several methods on the same paths."""

from sepv.compare.method import Method as Method
from sepv.compare.method import exact_time_change as exact_time_change
from sepv.compare.method import from_scheme as from_scheme
from sepv.compare.record import Comparison as Comparison
from sepv.compare.run import compare as compare
