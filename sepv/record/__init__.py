"""Records: what a NumPy function does to symbols, as straight-line code that is differentiated, averaged and printed.

A function written with indexing, arithmetic and NumPy's elementwise functions is called once with arrays of symbols and
leaves a list of operations on a tape. Read `_symbols` first (the tape), then `_derivative`, `_expand` and `_means`
(averages of a gradient along a segment in closed form), `_arrays` (NumPy code); `_polynomial` has polynomials as data.
`sepv.simulate` prints records for compiled lanes.
"""

from __future__ import annotations

from sepv.record import _polynomial as poly
from sepv.record._arrays import Evaluator, Source, evaluator, source
from sepv.record._binary64 import EPS, TINY
from sepv.record._derivative import gradient, hessian, jacobian, reachable
from sepv.record._expand import expand
from sepv.record._flows import flow
from sepv.record._functions import FUNCTIONS
from sepv.record._means import Mean, NoClosedForm, degree, mean, mean_gradient
from sepv.record._numpy_protocol import CannotRecord, select
from sepv.record._polynomial import Exponents, Polynomial, PolynomialMap, majorant, polynomial, squares
from sepv.record._polynomial import add as add_polynomials
from sepv.record._polynomial import gradient as polynomial_gradient
from sepv.record._quadrature import gauss_legendre, legendre_values, mean_nodes
from sepv.record._replay import substitute
from sepv.record._symbols import Symbol, Tape
from sepv.record._symbols import array as symbol_array
