"""Records: what a NumPy function does to symbols, as straight-line code that is differentiated, averaged and printed.

A function written with indexing, arithmetic and NumPy's elementwise functions is called once with arrays of symbols and
leaves a list of operations on a tape. `derivative` differentiates it, `means` averages a gradient along a segment in
closed form, `arrays` runs it on NumPy arrays; `sepv.engine.recorded` prints it for compiled lanes.
"""

from sepv.record.arrays import evaluator as evaluator
from sepv.record.derivative import gradient as gradient
from sepv.record.derivative import jacobian as jacobian
from sepv.record.means import NoClosedForm as NoClosedForm
from sepv.record.means import mean_gradient as mean_gradient
from sepv.record.symbols import CannotRecord as CannotRecord
from sepv.record.symbols import Symbol as Symbol
from sepv.record.symbols import Tape as Tape
from sepv.record.symbols import select as select
