"""Newton's matrix ∂R/∂z from a scheme's formula, by forward differentiation.

The formula is evaluated a second time, on values that carry their derivative by z. A derivative is a number times the
identity until a function of the problem turns it into a matrix. There are rules for B(y)v, ∇H and the mean of ∇H along
the segment. For a formula with other functions Newton's matrix comes from differences. The recorded operations of a
formula (`sepv.solve._recorded`) give the same matrix, but recording takes longer than a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from sepv.problem import (
    Array,
    Problem,
    average_gradient,
    average_hessian,
    combined,
    combined_gradient,
    combined_hessian,
    combined_slope,
    matmul,
    matvec,
)
from sepv.solve._formula import Formula
from sepv.solve._solution import JacobianFunction


class Tangent:
    """A vector and its derivative by z, which is a matrix, or a number that stands for its product with the identity.

    The vector is None if only the derivative is needed.
    """

    # With this, NumPy's arrays use the arithmetic of this class.
    __array_ufunc__ = None

    def __init__(self, value: Any, slope: Any) -> None:
        self.value, self.slope = value, slope

    def __add__(self, other: Any) -> Tangent:
        """Add a value that does not depend on z."""
        return Tangent(self.value + other, self.slope)

    __radd__ = __add__

    def __mul__(self, factor: Any) -> Tangent:
        """Multiply by a factor that does not depend on z."""
        return Tangent(self.value if self.value is None else factor * self.value, factor * self.slope)

    __rmul__ = __mul__


class NoDerivative(Exception):
    """Raised if a problem does not give a derivative that Newton's matrix needs."""


class Linearised:
    """The functions of `Fields` for which there are derivatives by z, for steps from y0 to y1 (d, M).

    If `computed` is given, it has the lists of averaged gradients and of structures that `sepv.solve._formula.counted`
    made for this step. The result of B(y)v has a derivative but no value, because R is not needed here.
    """

    def __init__(self, problem: Problem, y0: Array, y1: Array, *computed: Sequence[Array]) -> None:
        self.problem, self._y0, self._y1 = problem, y0, y1
        self._means, self._structures = map(iter, computed or ((), ()))

    def apply(self, y: Tangent, v: Tangent) -> Tangent:
        assert self.problem.structure_derivative is not None
        B = next(self._structures, None)
        B = self.problem.structure(y.value) if B is None else B
        return _product(B, self.problem.structure_derivative(y.value), y, v)

    def apply_combined(self, y: Tangent, step: Array, v: Tangent) -> Tangent:
        slope = combined_slope(self.problem, y.value, step)
        if slope is None:
            raise NoDerivative
        B = next(self._structures, None)
        return _product(combined(self.problem, y.value, step) if B is None else B, slope, y, v)

    def gradient(self, y: Tangent) -> Tangent:
        assert self.problem.hessian is not None
        return Tangent(self.problem.gradient(y.value), y.slope * self.problem.hessian(y.value))

    def combined_gradient(self, y: Tangent, step: Array) -> Tangent:
        slope = y.slope * combined_hessian(self.problem, y.value, step)
        return Tangent(combined_gradient(self.problem, y.value, step), slope)

    def field(self, y: Tangent) -> Tangent:
        return self.apply(y, self.gradient(y))

    def mean_gradient(self, y: Array, z: Tangent) -> Tangent:  # noqa: ARG002 - y0 and y1 − y0
        value = next(self._means, None)
        value = average_gradient(self.problem, self._y0, self._y1).value if value is None else value
        return Tangent(value, average_hessian(self.problem, self._y0, self._y1))


def _product(B: Array, slope: Array, y: Tangent, v: Tangent) -> Tangent:
    """The derivative of B(y)v by the product rule, for B (d, d, M) and its derivative B′ = `slope` (d, d, d, M)."""
    return Tangent(None, y.slope * matvec(slope, v.value) + matmul(B, v.slope))


def derivative(formula: Formula) -> JacobianFunction:
    """The function that computes ∂R/∂y1 of a formula, for the argument `jacobian` of `sepv.solve.solve`.

    The returned function gives None for a problem without B′ or without H″.
    """
    return partial(_slope, formula)


def _slope(
    formula: Formula, problem: Problem, y0: Array, y1: Array, step: Array, *computed: Sequence[Array]
) -> Array | None:
    if problem.hessian is None or problem.structure_derivative is None:
        return None
    fields: Any = Linearised(problem, y0, y1, *computed)
    try:
        slope: Array = formula(fields, y0, Tangent(y1 - y0, 1.0), step).slope
    except NoDerivative:
        return None
    return slope
