"""Accuracy with its price: error, invariant defects, time and work of several methods on the same paths."""

from sepv.studies._compare.method import Method as Method
from sepv.studies._compare.method import exact_time_change as exact_time_change
from sepv.studies._compare.method import from_scheme as from_scheme
from sepv.studies._compare.record import Comparison as Comparison
from sepv.studies._compare.run import compare as compare
