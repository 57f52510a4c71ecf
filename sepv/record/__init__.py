"""Records: the operations of a NumPy function as straight-line code that can be differentiated,
averaged and printed.

A function that consists of indexing, arithmetic and NumPy's elementwise functions is called once
with arrays of symbols, and its operations are listed on a tape. Read `_symbols` first (the tape),
then `_derivative`, `_expand`, `_means` (averages of gradients along a segment in closed form),
`_intervals` (bounds over a box) and `_arrays` (NumPy code). `_polynomial` has polynomials as data,
and `_polynomial_map` evaluates them. `sepv.simulate` prints records as code to be compiled.
"""

from __future__ import annotations

from sepv.core.arrays import EPS, TINY, majorant
from sepv.core.average import gauss_legendre as gauss_legendre
from sepv.core.average import mean_nodes as mean_nodes
from sepv.record import _polynomial as poly
from sepv.record._arrays import Evaluator, Source, source
from sepv.record._arrays import evaluator as evaluator
from sepv.record._derivative import gradient as gradient
from sepv.record._derivative import hessian as hessian
from sepv.record._derivative import jacobian as jacobian
from sepv.record._derivative import reachable
from sepv.record._expand import expand
from sepv.record._flows import flow
from sepv.record._functions import FUNCTIONS
from sepv.record._intervals import magnitudes
from sepv.record._legendre import legendre_values
from sepv.record._means import Mean, mean
from sepv.record._means import NoClosedForm as NoClosedForm
from sepv.record._means import degree as degree
from sepv.record._numpy_protocol import CannotRecord as CannotRecord
from sepv.record._numpy_protocol import select as select
from sepv.record._polynomial import Exponents, squares
from sepv.record._polynomial import Polynomial as Polynomial
from sepv.record._polynomial import add as add_polynomials
from sepv.record._polynomial import gradient as polynomial_gradient
from sepv.record._polynomial import polynomial as polynomial
from sepv.record._polynomial_map import PolynomialMap as PolynomialMap
from sepv.record._replay import replay as replay
from sepv.record._replay import substitute
from sepv.record._symbols import Symbol as Symbol
from sepv.record._symbols import Tape as Tape
from sepv.record._symbols import array as symbol_array
