"""The isospectral midpoint rule on so(3)*ⁿ, so(n)* and su(n)*:
a Poisson integrator without an exponential map.

S. Ephrati, E. Jansson, A. Lang and E. Luesink, An exponential map free implicit midpoint method for
stochastic Lie-Poisson systems (arXiv 2408.16701), after K. Modin and M. Viviani (Found. Comput.
Math. 20, 2020). A state y has the coordinates of a matrix W (`sepv.problems._matrix_algebras`). A
step goes from W_0 to W_1. Let x be the coordinates of a matrix X, and M the matrix of h∇H_0(x) + Σ
c_j ΔŴ_j ∇H_j(x) (ΔŴ_j: truncated ΔW_j). Then X and W_1 follow from
    W_0 = (1 + ½M)X(1 − ½M),  W_1 = (1 − ½M)X(1 + ½M).

So W_1 = UW_0U⁻¹ with the unitary matrix U = (1 − ½M)(1 + ½M)⁻¹. All eigenvalues are kept, and with
them all Casimirs tr Wᵏ and the coadjoint orbit. The equations are solved in the form

    X = W_0 + ½[X, M] + ¼MXM,   W_1 = W_0 + [X, M].

On su(n) MXM has a trace, so that X has one too: X = X′ + iτ·1 with X′ of trace zero and the unit
matrix 1. ∇H does not depend on the number τ. From tr W_0 = 0 follows iτ(n − ¼ tr M²) = ¼ tr MX′M,
where tr M² ≤ 0.

The paper proves that the rule is a Poisson map of mean-square order ½ and weak order 1. If the
noises commute, the mean-square order is 1, because y1 then has all terms of the order of h.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sepv.core.formula import Increment
from sepv.core.step import Solution
from sepv.core.step import solve as solve_implicit
from sepv.problem import Array, Problem, Systems, combined_gradient, each_noise
from sepv.problems import MatrixAlgebra, algebra_of, product
from sepv.schemes._one_step import CLAIMS_OF_ALL, Solved, no_jacobian, one_step
from sepv.schemes._order_claims import Orders


def parts(algebra: MatrixAlgebra, problem: Problem, x: Array, step: Array) -> tuple[Array, Array]:
    """The coordinates of the matrices [X, M] and MXM, two arrays (d, number of paths).

    X is the matrix of the state x, and M that of h∇H_0(x) + Σ c_j ΔŴ_j ∇H_j(x); `step` holds h and
    the c_j ΔŴ_j. On su(n) MXM includes the correction of its trace.
    """
    X, M = algebra.matrix(x), algebra.dual_matrix(combined_gradient(problem, x, step))
    XM = product(X, M)
    bent = product(M, XM)
    if algebra.name.startswith("su"):
        square = product(M, M)
        traces = np.trace(bent, axis1=1, axis2=2) / (4 * X.shape[1] - np.trace(square, axis1=1, axis2=2))
        bent = bent + traces[:, None, None] * square
    return algebra.coordinates(XM - product(M, X)), algebra.coordinates(bent)


def solve(problem: Problem, y: Array, h: float, dW: Array) -> Solution:
    """Solve one step of a batch y (d, M), dW (m, M); the residual of the solution is that of the
    equation for x.

    Raises Skipped if the structure of the problem is none of these: n copies of so(3), so(n),
    su(n).
    """
    algebra = algebra_of(problem, y)

    def increment(problem: Problem, y0: Array, x: Array, step: Array) -> Increment:  # noqa: ARG001 - as for all
        """R of the equation x = y0 + R: ½[X, M] + ¼MXM,
        with all gradients counted as one evaluation.
        """
        f, bent = parts(algebra, problem, x, step)
        return Increment(0.5 * f + 0.25 * bent)

    step = each_noise(problem, h, dW)
    solution = solve_implicit(problem, y, step, increment, no_jacobian)
    f, _ = parts(algebra, problem, solution.value, step)
    # The change is f itself, so that no digits of y1 − y0 cancel.
    return replace(solution, value=y + f, change=f)


scheme = one_step(
    "isospectral-midpoint",
    Solved(solve),
    CLAIMS_OF_ALL | {"identity", "casimir", "invariant:casimir", "poisson-map", "symmetry", "noise-sum"},
    "Ephrati, Jansson, Lang and Luesink, arXiv 2408.16701",
    weak_order=1.0,
    mean_square_order=Orders(0.5, commutative=1.0),
    systems=Systems.MATRIX_HAMILTONIANS,
)
