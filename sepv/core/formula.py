"""The formula of a scheme: a function (fields, y, z, step) -> R for the step y1 = y + R.

Here z = y1 − y. A formula is written once, and evaluated on arrays, on symbols, and on values that
carry their derivative. `fields` has the functions of a problem. `CountedFields` evaluates them on
arrays and counts the evaluations. `Linearised` evaluates the formula a second time, for Newton's
matrix ∂R/∂z: a derivative by z is a number times the identity until a function of the problem turns
it into a matrix. `step` (k, ...) has the numbers of a step that the scheme uses, such as the random
step Δ = h + Σ c_j ΔW_j (`sepv.core.problem`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np

from sepv.core.arrays import Array, matmul, matvec
from sepv.core.average import Average, average_gradient, average_hessian
from sepv.core.problem import System, combined, combined_gradient, combined_hessian, combined_slope


class Increment(NamedTuple):
    """The right side R of y1 = y0 + R(y0, y1), (d, M), with its evaluations of ∇H and of B.

    `reliable` is True where the quadrature of ∇H reached rounding. `parts` are values that the
    Jacobian reuses. All but `value` are numbers, or arrays (M,) if paths differ.
    """

    value: Array
    gradients: Any = 1
    structures: Any = 1
    reliable: Any = True
    parts: tuple[Any, ...] = ()


# Arrays (d, M) or symbols (d,).
Values = Any


class Fields(Protocol):
    """The functions of a problem that a formula may use, on arrays (d, M) or on symbols (d,)."""

    # The problem (`System`, or a wider record), for numbers such as c and the degree of H.
    problem: Any

    def structure(self, y: Any) -> Any:
        """The structure matrix B(y), (d, d, ...)."""

    def combined(self, y: Any, step: Any) -> Any:
        """The structure h B(y) + Σ c_jΔW_j G_j(y), (d, d, ...); `step` holds h, c_jΔW_j."""

    def apply(self, y: Any, v: Any) -> Any:
        """The product B(y)v, (d, ...)."""
        return matvec(self.structure(y), v)

    def apply_combined(self, y: Any, step: Any, v: Any) -> Any:
        """The product [h B(y) + Σ c_jΔW_j G_j(y)]v, (d, ...); `step` holds h and the c_jΔW_j."""
        return matvec(self.combined(y, step), v)

    def gradient(self, y: Any) -> Any:
        """The gradient ∇H(y), (d, ...)."""

    def combined_gradient(self, y: Any, step: Any) -> Any:
        """The gradient (d, ...) of hH_0 + Σ c_jΔW_jH_j; `step` holds h and the c_jΔW_j."""

    def field(self, y: Any) -> Any:
        """The field f(y) = B(y)∇H(y), (d, ...)."""
        return self.apply(y, self.gradient(y))

    def derivative_along(self, y: Any, v: Any) -> Any:
        """The derivative of the field f in the direction v, f′(y)v, (d, ...)."""

    def mean_gradient(self, y: Any, z: Any) -> Any:
        """The average of ∇H along the segment from y to y + z, ∫₀¹∇H(y + τz)dτ, (d, ...)."""

    def edge_means(self, starts: Any, z: Any) -> Any:
        """The averages (d, ...) of ∂_iH along d edges, of length z_i from starts[:, i]."""

    def factor(self, y: Any) -> Any:
        """The factor g(y) in B(y)v = g(y)(v × ∇C(y)), (...)."""

    def mean_casimir_gradient(self, y: Any, z: Any) -> Any:
        """The average of ∇C along the segment from y to y + z, ∫₀¹∇C(y + τz)dτ, (3, ...)."""


Formula = Callable[[Fields, Any, Any, Any], Any]


class CountedFields(Fields):
    """The functions of a problem on arrays, for steps from y0 to y1 (d, M), counted.

    `gradients` counts evaluations of ∇H, `structures` those of B or h B + Σ c_jΔW_j G_j. `reliable`
    is True for each path if all its quadratures reached rounding. They are numbers, or arrays (M,)
    if paths differ. The lists `means` and `matrices` have the averaged gradients (d, M) and the
    structures (d, d, M) in the order of calls, for Newton's matrix.
    """

    def __init__(self, problem: System, y0: Array, y1: Array) -> None:
        self.problem, self._y0, self._y1 = problem, y0, y1
        self.gradients: Any = 0
        self.structures: Any = 0
        self.reliable: Any = True
        self.means: list[Array] = []
        self.matrices: list[Array] = []

    def structure(self, y: Array) -> Array:
        self.structures = self.structures + 1
        self.matrices.append(self.problem.structure(y))
        return self.matrices[-1]

    def combined(self, y: Array, step: Array) -> Array:
        """The structure h B(y) + Σ c_jΔW_j G_j(y) of a step, counted as one evaluation."""
        self.structures = self.structures + 1
        self.matrices.append(combined(self.problem, y, step))
        return self.matrices[-1]

    def gradient(self, y: Array) -> Array:
        self.gradients = self.gradients + 1
        return self.problem.gradient(y)

    def combined_gradient(self, y: Array, step: Array) -> Array:
        """The gradient h∇H_0(y) + Σ c_jΔW_j∇H_j(y) of a step, counted as one evaluation."""
        self.gradients = self.gradients + 1
        return combined_gradient(self.problem, y, step)

    def derivative_along(self, y: Array, v: Array) -> Array:
        """The derivative f′(y)v of the field f = B∇H; its evaluations are not counted."""
        return self.problem.derivative_along(y, v)

    def mean_gradient(self, y: Array, z: Array) -> Array:  # noqa: ARG002 - y + z may differ from y1 by a rounding
        """The average of ∇H from y0 to y1; a formula passes y = y0 and z = y1 − y0."""
        self.means.append(self._means(self._y0, self._y1))
        return self.means[-1]

    def edge_means(self, starts: Array, z: Array) -> Array:
        d = len(z)
        ends = starts.copy()
        ends[range(d), range(d)] += z
        return self._means(starts, ends)[range(d), range(d)]

    def factor(self, y: Array) -> Array:
        factor: Array = self.problem.nambu.factor(y)
        return factor

    def mean_casimir_gradient(self, y: Array, z: Array) -> Array:  # noqa: ARG002 - as for H
        """The average of ∇C from y0 to y1, counted as evaluations of a structure."""
        average = average_gradient(self.problem.nambu, self._y0, self._y1)
        self.structures = self.structures + average.evaluations
        return self._value_of(average)

    def _means(self, y0: Array, y1: Array) -> Array:
        """The averages of ∇H from y0 to y1 (d, M), or along n segments a path (d, n, M)."""
        average = average_gradient(self.problem, y0, y1)
        evaluations = average.evaluations
        if y0.ndim > 2:
            evaluations = np.broadcast_to(evaluations, y0.shape[1:]).sum(axis=0)
        self.gradients = self.gradients + evaluations
        return self._value_of(average)

    def _value_of(self, average: Average) -> Array:
        reliable = average.reliable
        self.reliable = self.reliable & (reliable.all(axis=0) if np.ndim(reliable) > 1 else reliable)
        return average.value


def counted(formula: Formula, problem: System, y0: Array, y1: Array, step: Array) -> Increment:
    """R of a formula for steps from y0 to y1 (d, M), with counts of evaluations.

    The `parts` of the result are averages and structures that Newton's matrix reuses
    (`Linearised`).
    """
    fields = CountedFields(problem, y0, y1)
    value = formula(fields, y0, y1 - y0, step)
    parts = fields.means, fields.matrices
    return Increment(value, fields.gradients, fields.structures, fields.reliable, parts)


# (problem, y0, y1, step) -> Increment
IncrementFunction = Callable[..., Increment]
JacobianFunction = Callable[..., Array | None]


class Tangent:
    """A vector and its derivative by z: a matrix, or a number for its product with the identity.

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
    """The functions of `Fields` with derivatives by z, for steps from y0 to y1 (d, M).

    If `computed` is given, it has the lists of averaged gradients and of structures that `counted`
    made for this step. The result of B(y)v has a derivative but no value.
    """

    def __init__(self, problem: System, y0: Array, y1: Array, *computed: Sequence[Array]) -> None:
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
    """The derivative of B(y)v, with B (d, d, M) and B′ = `slope` (d, d, d, M)."""
    return Tangent(None, y.slope * matvec(slope, v.value) + matmul(B, v.slope))


def derivative(formula: Formula) -> JacobianFunction:
    """The function that computes a formula's ∂R/∂y1, the `jacobian` of `sepv.core.step.solve`.

    The returned function gives None for a problem without B′ or without H″.
    """
    return partial(_slope, formula)


def _slope(
    formula: Formula, problem: System, y0: Array, y1: Array, step: Array, *computed: Sequence[Array]
) -> Array | None:
    if problem.hessian is None or problem.structure_derivative is None:
        return None
    fields: Any = Linearised(problem, y0, y1, *computed)
    try:
        slope: Array = formula(fields, y0, Tangent(y1 - y0, 1.0), step).slope
    except NoDerivative:
        return None
    return slope
