"""Steps of scheme (2.1) and of the midpoint rule (3.4) for one large state y (d,) with the random step Δ.

Newton's method is that of `sepv.solve._newton`, with sparse matrices. LAPACK's band solver is used for narrow bands,
and SuperLU for all other matrices. The cost of both is linear in d if only neighbours of a chain are coupled.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sepv.large._problem import LargeProblem, Sparse
from sepv.problem import Algebra, Array
from sepv.record import gauss_legendre, mean_nodes
from sepv.schemes import energy_preserving_formula as _energy_preserving
from sepv.schemes import midpoint_formula as _midpoint
from sepv.solve import Equations, Evaluation, Formula, Status, Tangent, newton, once

# The most rows of band storage. With pivoting, l lower and u upper diagonals need 2l + u + 1 rows. For wider bands
# SuperLU is faster.
WIDEST_BAND = 64


class LargeFields:
    """The functions B(y)v, ∇H and averaged ∇H of a large problem, with which a formula states a step y0 → y0 + z.

    `structures` lists the matrices B(y) used so far. Newton's matrix reuses these and averaged ∇H (`mean`).
    """

    def __init__(self, problem: LargeProblem, y0: Array, z: Array) -> None:
        self.problem: Any = problem
        self.y0, self.z = y0, z
        self.structures: list[Sparse] = []

    def apply(self, y: Array, v: Array) -> Array:
        self.structures.append(self.problem.structure(y))
        return np.asarray(self.structures[-1] @ v)

    def gradient(self, y: Array) -> Array:
        return np.asarray(self.problem.gradient(y))

    def field(self, y: Array) -> Array:
        return self.apply(y, self.gradient(y))

    def mean_gradient(self, y: Array, z: Array) -> Array:  # noqa: ARG002 - y0 and z
        return self.mean

    @cached_property
    def mean(self) -> Array:
        """The averaged gradient ∫₀¹∇H(y0 + τz)dτ, exact to rounding."""
        problem = self.problem
        if problem.mean_gradient is not None:
            return np.asarray(problem.mean_gradient(self.y0, self.y0 + self.z))
        points, weights = gauss_legendre(mean_nodes(problem.degree))
        return np.asarray(
            sum(w * problem.gradient(self.y0 + t * self.z) for t, w in zip(points, weights, strict=True))
        )


class LargeSlopes:
    """The functions of `LargeFields`, each with its sparse derivative by z = y1 − y0, for Newton's matrix."""

    def __init__(self, fields: LargeFields) -> None:
        self.problem, self.fields = fields.problem, fields
        self._structures = iter(fields.structures)

    def apply(self, y: Tangent, v: Tangent) -> Tangent:
        K = next(self._structures) @ v.slope
        if self.problem.structure_slope is not None:
            K = K + y.slope * self.problem.structure_slope(y.value, v.value)
        return Tangent(None, K)

    def gradient(self, y: Tangent) -> Tangent:
        return Tangent(self.problem.gradient(y.value), y.slope * self.problem.hessian(y.value))

    def field(self, y: Tangent) -> Tangent:
        return self.apply(y, self.gradient(y))

    def mean_gradient(self, y: Array, z: Tangent) -> Tangent:  # noqa: ARG002 - y0 and z
        """The averaged gradient, and its derivative by z: ∫₀¹τH″dτ with few nodes, enough for Newton's matrix."""
        fields, degree = self.fields, self.problem.degree
        points, weights = gauss_legendre(3 if degree is None else mean_nodes(degree))
        first, *others = (
            w * t * self.problem.hessian(fields.y0 + t * fields.z)
            for t, w in zip(points, weights, strict=True)
        )
        return Tangent(fields.mean, sum(others, first))


@dataclass(frozen=True)
class LargeSolution:
    """The result of a step: `value` (d,) is y1, or the last iterate if not converged; `residual` is a maximum norm."""

    value: Array
    residual: float
    iterations: int
    status: Status


def solve(problem: LargeProblem, y0: Array, formula: Formula, delta: float) -> LargeSolution:
    """Solve y1 = y0 + R(y0, y1, delta) by one attempt of Newton's method; `formula` computes R."""

    def evaluate(z: Array, _: NDArray[np.intp]) -> Evaluation:
        fields: Any = LargeFields(problem, y0, z[:, 0])
        slopes: Any = LargeSlopes(fields)
        R = formula(fields, y0, z[:, 0], [delta])
        slope = lambda: formula(slopes, y0, Tangent(z[:, 0], 1.0), [delta]).slope  # noqa: E731
        return Evaluation(once(R[:, None]), lambda: (slope(), 0))

    def inside(z: Array, _: NDArray[np.intp]) -> NDArray[np.bool_]:
        assert problem.domain is not None
        return np.array([problem.domain(y0 + change) for change in z.T])

    equations = Equations(
        np.abs(y0)[:, None], evaluate, None if problem.domain is None else inside,
        exact=problem.degree is not None, algebra=SPARSE,
    )  # fmt: skip
    solution = newton(equations, np.zeros((y0.size, 1)), np.arange(1), differences=False)
    status = Status(int(solution.status[0]))
    return LargeSolution(
        y0 + solution.value[:, 0], float(solution.residual[0]), int(solution.iterations[0]), status
    )


def newton_correction(K: Sparse, F: Array) -> Array:
    """Newton's correction (I − K)⁻¹F (d, 1) for z = R(z), with F = R(z) − z and sparse K = ∂R/∂z; NaN if singular."""
    entries = K.tocoo()
    lower = int(max((entries.row - entries.col).max(initial=0), 0))
    upper = int(max((entries.col - entries.row).max(initial=0), 0))
    d = F.size
    if 2 * lower + upper + 1 <= WIDEST_BAND:
        from scipy.linalg import LinAlgError, solve_banded

        # In band storage A_ij is in row u + i − j, with u = `upper`. Repeated entries are added.
        band = np.bincount(
            (upper + entries.row - entries.col) * d + entries.col,
            weights=entries.data,
            minlength=(lower + upper + 1) * d,
        ).reshape(lower + upper + 1, d)
        np.negative(band, out=band)
        band[upper] += 1
        try:
            return np.asarray(solve_banded((lower, upper), band, F, overwrite_ab=True, check_finite=False))
        except LinAlgError:
            return np.full_like(F, np.nan)
    from scipy.sparse import eye_array
    from scipy.sparse.linalg import splu

    try:
        return np.asarray(splu((eye_array(d) - K).tocsc()).solve(F))
    except RuntimeError:  # SuperLU's way to report "exactly singular"
        return np.full_like(F, np.nan)


# The linear algebra of Newton's iteration for one state, with a sparse matrix K.
SPARSE = Algebra(newton_correction, lambda K: np.isfinite(K.data).all(), lambda K, size: abs(K) @ size)

LargeStep = Callable[[LargeProblem, Array, float], LargeSolution]


def energy_preserving(problem: LargeProblem, y: Array, delta: float) -> LargeSolution:
    """One step of the energy-preserving scheme (2.1) from y (d,) with the random step `delta`."""
    return solve(problem, y, _energy_preserving, delta)


def midpoint(problem: LargeProblem, y: Array, delta: float) -> LargeSolution:
    """One step of the midpoint rule (3.4) from y (d,) with the random step `delta`."""
    return solve(problem, y, _midpoint, delta)
