"""A scheme's formula is written once, for arrays and symbols: (fields, y, z, step) -> R of y1 = y0 + R, z = y1 − y0.

`fields` has the functions of a problem. `Asked` computes them on arrays and counts evaluations; the compiled engine
computes them on symbols, and derives Newton's matrix from the record of R. `step` (k, ...) is the data of the step
that the scheme takes: see `sepv.schemes._one_step`.
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

    # The problem, for its numbers: c, the degree of H.
    problem: Problem

    def structure(self, y: Any) -> Any:
        """B(y), (d, d, ...)."""

    def combined(self, y: Any, step: Any) -> Any:
        """h B(y) + Σ c_jΔW_j G_j(y), (d, d, ...), for `step` holding h and the c_jΔW_j."""

    def apply(self, y: Any, v: Any) -> Any:
        """B(y)v, (d, ...)."""
        return matvec(self.structure(y), v)

    def apply_combined(self, y: Any, step: Any, v: Any) -> Any:
        """[h B(y) + Σ c_jΔW_j G_j(y)]v, (d, ...)."""
        return matvec(self.combined(y, step), v)

    def gradient(self, y: Any) -> Any:
        """∇H(y), (d, ...)."""

    def combined_gradient(self, y: Any, step: Any) -> Any:
        """h∇H_0(y) + Σ c_jΔW_j∇H_j(y), (d, ...), for `step` holding h and the c_jΔW_j."""

    def field(self, y: Any) -> Any:
        """f(y) = B(y)∇H(y), (d, ...)."""
        return self.apply(y, self.gradient(y))

    def derivative_along(self, y: Any, v: Any) -> Any:
        """f′(y)v, (d, ...)."""

    def mean_gradient(self, y: Any, z: Any) -> Any:
        """∫₀¹∇H(y + τz)dτ, (d, ...)."""

    def edge_means(self, starts: Any, z: Any) -> Any:
        """The means of ∂_iH from column i of `starts` (d, d, ...) over z_i along the i-th axis, (d, ...)."""

    def factor(self, y: Any) -> Any:
        """The factor g(y) in B(y)v = g(y)(v × ∇C(y)), (...)."""

    def mean_casimir_gradient(self, y: Any, z: Any) -> Any:
        """∫₀¹∇C(y + τz)dτ, (3, ...)."""


Formula = Callable[[Fields, Any, Any, Any], Any]


class Asked(Fields):
    """A problem's functions on the segment from y0 to y1 (d, M), with counts of their evaluations.

    `gradients` and `structures` (M,) are evaluations of ∇H, and of B or its substitute; `reliable` (M,) is True where
    the quadratures are. `means` and `asked` are averaged gradients (d, M) and structures (d, d, M) in the order of
    their calls: Newton's matrix uses them again.
    """

    def __init__(self, problem: Problem, y0: Array, y1: Array) -> None:
        self.problem, self._y0, self._y1 = problem, y0, y1
        self.gradients = np.zeros(y0.shape[1], dtype=np.int64)
        self.structures = np.zeros_like(self.gradients)
        self.reliable = np.ones(y0.shape[1], dtype=bool)
        self.means: list[Array] = []
        self.asked: list[Array] = []

    def structure(self, y: Array) -> Array:
        self.structures = self.structures + 1
        self.asked.append(self.problem.structure(y))
        return self.asked[-1]

    def combined(self, y: Array, step: Array) -> Array:
        """The combined structure, counted as one evaluation."""
        self.structures = self.structures + 1
        self.asked.append(combined(self.problem, y, step))
        return self.asked[-1]

    def gradient(self, y: Array) -> Array:
        self.gradients = self.gradients + 1
        return self.problem.gradient(y)

    def combined_gradient(self, y: Array, step: Array) -> Array:
        """The combined gradient, counted as one evaluation."""
        self.gradients = self.gradients + 1
        return combined_gradient(self.problem, y, step)

    def derivative_along(self, y: Array, v: Array) -> Array:
        """f′(y)v, which is not counted."""
        return derivative_along(self.problem, y, v)

    def mean_gradient(self, y: Array, z: Array) -> Array:  # noqa: ARG002 - y0 and y1 − y0, which y1 is not rounded from
        """The mean gradient for the formula's own y and z."""
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
        """The mean of ∇C, counted as evaluations of a structure."""
        found = average_gradient(cast(Any, self.problem.nambu), self._y0, self._y1)
        self.structures = self.structures + found.evaluations
        return self._trusted(found)

    def _means(self, y0: Array, y1: Array) -> Array:
        """∇H averaged along segments (d, M), or several (d, n, M) for each lane."""
        found = average_gradient(self.problem, y0, y1)
        self.gradients = self.gradients + found.evaluations.sum(axis=tuple(range(y0.ndim - 2)))
        return self._trusted(found)

    def _trusted(self, found: Average) -> Array:
        self.reliable = self.reliable & found.reliable.all(axis=tuple(range(found.reliable.ndim - 1)))
        return found.value


def counted(formula: Formula, problem: Problem, y0: Array, y1: Array, step: Array) -> Increment:
    """R of arrays with its counts, and the values that Newton's matrix uses again (`sepv.solve._linearised`)."""
    asked = Asked(problem, y0, y1)
    value = formula(asked, y0, y1 - y0, step)
    return Increment(value, asked.gradients, asked.structures, asked.reliable, (asked.means, asked.asked))
