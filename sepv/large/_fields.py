"""What a scheme's formula is answered by a large problem, of one state (d,) and with sparse matrices."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from sepv.large._problem import LargeProblem, Sparse
from sepv.problem import Array
from sepv.record import gauss_legendre, mean_nodes
from sepv.solve._linearised import Tangent


class Answers:
    """The answers along the segment from y0 to y0 + z; B(y) and ∇̄H are kept for Newton's matrix."""

    def __init__(self, problem: LargeProblem, y0: Array, z: Array) -> None:
        self.problem: Any = problem
        self.y0, self.z = y0, z
        self.y1 = y0 + z
        self.structures: list[Sparse] = []

    def apply(self, y: Array, v: Array) -> Array:
        """B(y)v."""
        self.structures.append(self.problem.structure(y))
        return np.asarray(self.structures[-1] @ v)

    def gradient(self, y: Array) -> Array:
        """∇H(y)."""
        return np.asarray(self.problem.gradient(y))

    def field(self, y: Array) -> Array:
        """B(y)∇H(y)."""
        return self.apply(y, self.gradient(y))

    def mean_gradient(self, y: Array, z: Array) -> Array:  # noqa: ARG002 - y0 and z
        """∫₀¹∇H(y + τz)dτ, exact to rounding."""
        return self.mean

    @cached_property
    def mean(self) -> Array:
        """The averaged gradient of the segment."""
        problem = self.problem
        if problem.mean_gradient is not None:
            return np.asarray(problem.mean_gradient(self.y0, self.y1))
        points, weights = gauss_legendre(mean_nodes(problem.degree))
        return np.asarray(
            sum(w * problem.gradient(self.y0 + t * self.z) for t, w in zip(points, weights, strict=True))
        )


class Slopes:
    """The same with derivatives by z, sparse: see `sepv.solve._linearised`."""

    def __init__(self, asked: Answers) -> None:
        self.problem, self._asked = asked.problem, asked
        self._structures = iter(asked.structures)

    def apply(self, y: Tangent, v: Tangent) -> Tangent:
        """B(y)v."""
        K = next(self._structures) @ v.slope
        if self.problem.structure_slope is not None:
            K = K + y.slope * self.problem.structure_slope(y.value, v.value)
        return Tangent(None, K)

    def gradient(self, y: Tangent) -> Tangent:
        """∇H(y)."""
        return Tangent(self.problem.gradient(y.value), y.slope * self.problem.hessian(y.value))

    def field(self, y: Tangent) -> Tangent:
        """B(y)∇H(y)."""
        return self.apply(y, self.gradient(y))

    def mean_gradient(self, y: Array, z: Tangent) -> Tangent:  # noqa: ARG002 - y0 and z
        """∫₀¹∇H(y + τz)dτ; H″ by a few nodes, whose error costs iterations and no accuracy."""
        asked, degree = self._asked, self.problem.degree
        points, weights = gauss_legendre(3 if degree is None else mean_nodes(degree))
        first, *others = (
            w * t * self.problem.hessian(asked.y0 + t * asked.z) for t, w in zip(points, weights, strict=True)
        )
        return Tangent(asked.mean, sum(others, first))
