"""Reference values for a problem made of Python functions: H as accurately as its code allows,
Casimirs exactly.

There is no second source for such an H, so its own code is used. If its operations can be recorded,
they are evaluated in extended precision, with the constants of the code as they are. Otherwise the
code is called, in the platform's longest float if it keeps that type, else in binary64. Then a
bound of the error of its values is stated, and laws add it to their bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from sepv.reference.arithmetic import Vector, context

from sepv.problem import Function, GivenProblem, recorded
from sepv.record import replay

# A well-written H of d variables is off by a few roundings of y and of its value. 16 is a
# heuristic: it covers a sum of some ten terms, each a product of a few factors, in any order.
FUNCTION_ROUNDINGS = 16.0


@lru_cache(maxsize=256)
def in_many_digits(function: Function, dimension: int, digits: int) -> Callable[[Vector], Any] | None:
    """A function of states (d,) evaluated with `digits` digits, by its recorded operations;
    None without a record.
    """
    record = recorded(function, dimension)
    if record is None:
        return None
    ctx = context(digits)
    elementary = {
        "arctan": ctx.atan,
        "log1p_ratio": lambda x: ctx.log1p(x) / x if x else ctx.one,
        "expm1_ratio": lambda x: ctx.expm1(x) / x if x else ctx.one,
    }

    def value(y: Vector) -> Any:
        at = {x.index: v for x, v in zip(record.y, y, strict=True)}
        return ctx.mpf(
            replay(
                record.values, at, lambda name, x: (elementary.get(name) or getattr(ctx, name))(x), ctx.mpf
            )[0]
        )

    return value


class GivenFunctions:
    """A problem made of Python functions (`GivenProblem`),
    with the methods of `ExactProblem` that laws call.
    """

    def __init__(self, given: GivenProblem, digits: int) -> None:
        self.problem = given.problem
        self.ctx = context(digits)
        self._value = in_many_digits(self.problem.hamiltonian, self.problem.dimension, digits)

    def state(self, y: Sequence[float]) -> Vector:
        """The binary64 state y as a vector, without a rounding."""
        return [self.ctx.mpf(float(v)) for v in y]

    def hamiltonian(self, y: Vector) -> Any:
        """The Hamiltonian H at a state, by the problem's own function;
        a state of its code alone is binary64.
        """
        if self._value is not None:
            return self._value(y)
        values = [float(v) for v in y]
        with np.errstate(all="ignore"):
            try:
                long = self.problem.hamiltonian(np.array(values, dtype=np.longdouble))
            except (TypeError, ValueError, ArithmeticError):
                long = None
            if isinstance(long, np.longdouble) and np.isfinite(long):
                head = float(long)
                return self.ctx.mpf(head) + self.ctx.mpf(float(long - np.longdouble(head)))
            return self.ctx.mpf(float(self.problem.hamiltonian(np.array(values))))

    def uncertainty(self, *states: Any) -> Any:
        """A bound of the error of H(y1) − H(y0): FUNCTION_ROUNDINGS half-ulps of |∇H|·|y| + |H| at
        each state, 0 for a record.

        Longest floats would allow a smaller bound. But the code of H may compute a part of H in
        binary64, which cannot be seen from outside, so the bound is that of binary64 in either
        case.
        """
        if self._value is not None:
            return 0.0
        slopes = [
            np.sum(np.abs(self.problem.gradient(y)) * np.abs(y), axis=0) + np.abs(self.problem.hamiltonian(y))
            for y in states
        ]
        return FUNCTION_ROUNDINGS * 2.0**-53 * sum(slopes)

    def casimir_values(self, y: Vector) -> Vector:
        """All quadratic Casimirs yᵀAy, then all linear ones bᵀy."""
        fsum, number = self.ctx.fsum, self.ctx.mpf
        quadratic = [
            fsum(number(float(A[i, j])) * y[i] * y[j] for i, j in zip(*np.nonzero(A), strict=True))
            for A in self.problem.casimirs
        ]
        linear = [
            fsum(number(float(b)) * v for b, v in zip(row, y, strict=True))
            for row in self.problem.linear_casimirs
        ]
        return quadratic + linear
