"""The formula of a scheme: a function (fields, y, z, step) -> R for the step y1 = y + R, where z = y1 − y.

A formula is written once, and evaluated on arrays and on symbols. `fields` has the functions of a problem.
`CountedFields` evaluates them on arrays and counts the evaluations. The compiled engine evaluates them on symbols, and
derives Newton's matrix from the recorded operations of R. `step` (k, ...) has the numbers of a step that the scheme
uses, such as the random step Δ = h + Σ c_j ΔW_j (`sepv.schemes._one_step`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, cast

import numpy as np

from sepv.problem import (
    Array,
    Average,
    Problem,
    average_gradient,
    combined,
    combined_gradient,
    derivative_along,
    matvec,
)
from sepv.solve._solution import Increment

# Arrays (d, M) or symbols (d,).
Values = Any


class Fields(Protocol):
    """The functions of a problem that a formula may use, on arrays (d, M) or on symbols (d,)."""

    # The problem, for numbers such as the coefficients c and the degree of H.
    problem: Problem

    def structure(self, y: Any) -> Any:
        """The structure matrix B(y), (d, d, ...)."""

    def combined(self, y: Any, step: Any) -> Any:
        """The structure h B(y) + Σ c_jΔW_j G_j(y), (d, d, ...), G_j for noise j; `step` holds h and the c_jΔW_j."""

    def apply(self, y: Any, v: Any) -> Any:
        """The product B(y)v, (d, ...)."""
        return matvec(self.structure(y), v)

    def apply_combined(self, y: Any, step: Any, v: Any) -> Any:
        """The product [h B(y) + Σ c_jΔW_j G_j(y)]v, (d, ...); `step` holds h and the c_jΔW_j."""
        return matvec(self.combined(y, step), v)

    def gradient(self, y: Any) -> Any:
        """The gradient ∇H(y), (d, ...)."""

    def combined_gradient(self, y: Any, step: Any) -> Any:
        """The gradient (d, ...) of a step's Hamiltonian hH_0 + Σ c_jΔW_jH_j; `step` holds h and the c_jΔW_j."""

    def field(self, y: Any) -> Any:
        """The field f(y) = B(y)∇H(y), (d, ...)."""
        return self.apply(y, self.gradient(y))

    def derivative_along(self, y: Any, v: Any) -> Any:
        """The derivative of the field f in the direction v, f′(y)v, (d, ...)."""

    def mean_gradient(self, y: Any, z: Any) -> Any:
        """The average of ∇H along the segment from y to y + z, ∫₀¹∇H(y + τz)dτ, (d, ...)."""

    def edge_means(self, starts: Any, z: Any) -> Any:
        """The averages of ∂_iH along d edges, (d, ...); edge i has the length z_i along axis i from starts[:, i]."""

    def factor(self, y: Any) -> Any:
        """The factor g(y) in B(y)v = g(y)(v × ∇C(y)), (...)."""

    def mean_casimir_gradient(self, y: Any, z: Any) -> Any:
        """The average of ∇C along the segment from y to y + z, ∫₀¹∇C(y + τz)dτ, (3, ...)."""


Formula = Callable[[Fields, Any, Any, Any], Any]


class CountedFields(Fields):
    """The functions of a problem computed on arrays for steps from y0 to y1 (d, M), with counts of their evaluations.

    `gradients` (M,) counts evaluations of ∇H, `structures` (M,) those of B or h B + Σ c_jΔW_j G_j. `reliable` (M,) is
    True for each path if all its quadratures reached rounding. The lists `means` and `matrices` have the averaged
    gradients (d, M) and the structures (d, d, M) in the order of calls, for Newton's matrix.
    """

    def __init__(self, problem: Problem, y0: Array, y1: Array) -> None:
        self.problem, self._y0, self._y1 = problem, y0, y1
        self.gradients = np.zeros(y0.shape[1], dtype=np.int64)
        self.structures = np.zeros_like(self.gradients)
        self.reliable = np.ones(y0.shape[1], dtype=bool)
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
        return derivative_along(self.problem, y, v)

    def mean_gradient(self, y: Array, z: Array) -> Array:  # noqa: ARG002 - y + z may differ from y1 by a rounding
        """The average of ∇H along the segment from y0 to y1, for which a formula passes y = y0 and z = y1 − y0."""
        self.means.append(self._means(self._y0, self._y1))
        return self.means[-1]

    def edge_means(self, starts: Array, z: Array) -> Array:
        d = len(z)
        ends = starts.copy()
        ends[range(d), range(d)] += z
        return self._means(starts, ends)[range(d), range(d)]

    def factor(self, y: Array) -> Array:
        assert self.problem.nambu is not None
        return self.problem.nambu.factor(y)

    def mean_casimir_gradient(self, y: Array, z: Array) -> Array:  # noqa: ARG002 - as for H
        """The average of ∇C along the segment from y0 to y1, counted as evaluations of a structure."""
        average = average_gradient(cast(Any, self.problem.nambu), self._y0, self._y1)
        self.structures = self.structures + average.evaluations
        return self._value_of(average)

    def _means(self, y0: Array, y1: Array) -> Array:
        """The averages of ∇H along segments from y0 to y1 (d, M), or along n segments (d, n, M) for each path."""
        average = average_gradient(self.problem, y0, y1)
        self.gradients = self.gradients + average.evaluations.sum(axis=tuple(range(y0.ndim - 2)))
        return self._value_of(average)

    def _value_of(self, average: Average) -> Array:
        self.reliable = self.reliable & average.reliable.all(axis=tuple(range(average.reliable.ndim - 1)))
        return average.value


def counted(formula: Formula, problem: Problem, y0: Array, y1: Array, step: Array) -> Increment:
    """R of a formula for steps from y0 to y1 (d, M), with counts of evaluations.

    The `parts` of the result are averages and structures that Newton's matrix reuses (`sepv.solve._linearised`).
    """
    fields = CountedFields(problem, y0, y1)
    value = formula(fields, y0, y1 - y0, step)
    parts = fields.means, fields.matrices
    return Increment(value, fields.gradients, fields.structures, fields.reliable, parts)
