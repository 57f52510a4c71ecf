"""The flow of y′ = f(y) in closed form, recognised from the recorded operations of f.

- f′f = 0: f does not change along its own flow, which is y + t f(y).
- f is linear in the components that move, with a matrix M that does not change along the flow. For
  y_i′ = M_ii y_i the solution is y_i e^{t M_ii}. For y_i′ = M_ij y_j and y_j′ = −M_ij y_i the flow
  is a rotation by the angle t M_ij.

The parts of a separable H, quadratic parts about an axis, and the parts of a Lotka-Volterra system
are of these forms.
"""

from __future__ import annotations

from typing import Any

from sepv.record._derivative import jacobian
from sepv.record._means import NoClosedForm
from sepv.record._replay import substitute
from sepv.record._symbols import array


def flow(f: Any, y: Any, t: Any) -> Any:
    """The exact solution at the time t of y′ = f(y) with the initial state y, as symbols (d,),
    for a recorded field f.

    Raises NoClosedForm if f has none of the forms that the docstring of this module lists.
    """
    slopes = jacobian(f, y)
    if all(v.number == 0 for v in y[0].tape.symbols(slopes @ f)):
        return y + t * f
    moving = [i for i, v in enumerate(f) if v.number != 0]
    M = {i: {j: slopes[i, j] for j in moving if slopes[i, j].number != 0} for i in moving}
    entries = array(v for row in M.values() for v in row.values())
    at_rest = substitute(f, y, [0.0 if i in moving else v for i, v in enumerate(y)])
    changing = jacobian(entries, y)[:, moving].ravel() if len(entries) else entries
    if any(v.number != 0 for v in (*changing, *at_rest)):
        raise NoClosedForm("a flow that is not linear in what moves")
    return array(_moved(M, y, t, i) for i in range(len(f)))


def _moved(M: dict[int, dict[int, Any]], y: Any, t: Any, i: int) -> Any:
    """Component i of exp(tM)y, for a matrix M given by its nonzero entries;
    y_i is constant if M has no row i.
    """
    if i not in M:
        return y[i]
    ((j, rate),) = M[i].items() if len(M[i]) == 1 else ((None, None),)
    if i == j:
        return y[i] * (t * rate).exp()
    if j is None or set(M[j]) != {i} or (rate + M[j][i]).number != 0:
        raise NoClosedForm("a flow that is neither exponential nor a rotation")
    return (t * rate).cos() * y[i] + (t * rate).sin() * y[j]
