"""The implicit equation of a step: z = R(z) for z = y1 − y0, its solution and the stop rule of the iteration.

Read `_formula` first: a scheme's formula for R, and the functions of a problem that it may use. `_solution` has the
data types. `_newton` solves the equation for a batch, with `_stop_rule`, `_damped` and `_differences`. `_recorded` and
`_linearised` derive the Jacobian from a formula in two ways. `_from_record` writes an iteration as straight-line code.
"""

from __future__ import annotations

from sepv.solve import _formula as formula
from sepv.solve._differences import difference_jacobian
from sepv.solve._formula import CountedFields, Formula, counted
from sepv.solve._formula import Fields as Fields
from sepv.solve._formula import Values as Values
from sepv.solve._from_record import corrections
from sepv.solve._linearised import Tangent, derivative
from sepv.solve._newton import into_domain, iterate, newton
from sepv.solve._newton import solve as solve
from sepv.solve._recorded import Recorded
from sepv.solve._solution import (
    COUNTS,
    Equations,
    Evaluation,
    IncrementFunction,
    JacobianFunction,
    Lanes,
    Solution,
    Worded,
    merge,
    once,
    require_converged,
)
from sepv.solve._solution import Increment as Increment
from sepv.solve._solution import Status as Status
from sepv.solve._stop_rule import LEFT, QUANTA, ROUNDING, STAGNATION
