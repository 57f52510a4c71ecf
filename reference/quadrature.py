"""A rigorous bound of the error of a Gauss rule in a scheme's equation,
which is needed if H is not a polynomial.

If g is analytic in the Bernstein ellipse of parameter ρ around [−1, 1] and |g| ≤ M in it, the
N-point Gauss rule is off by at most (64/15) M ρ^(−2(N−1))/(1 − ρ⁻²) (Trefethen,
*Approximation Theory and Approximation Practice*, Theorem 19.3). M is bounded by complex balls that
cover the ellipse, for all stage increments K within a distance R of the reference; Cauchy's
estimate then bounds the derivatives with respect to K as well.
"""

from __future__ import annotations

from typing import Any

from sepv.reference.arithmetic import Vector, total
from sepv.reference.balls import complex_balls, require_flint
from sepv.reference.equations import Equation, Step, collocation, combined, in_blocks
from sepv.reference.problem import ExactProblem, in_arithmetic
from sepv.reference.tableau import horner, stage_table

# With N = 150 nodes the factor ρ^(−2(N−1)) is 1e-52 for ρ = 3/2 and 1e-179 for ρ = 4.
_FIXED_NODES = 150
_ELLIPSES = (4.0, 3.0, 2.0, 1.5)
_CELLS = 10


def with_more_nodes(equation: Equation) -> Equation:
    """A copy of the equation with enough quadrature nodes for a proof."""
    return collocation(equation.blocks, max(equation.nodes, _FIXED_NODES)) if equation.nodes else equation


def quadrature_error(
    problem: ExactProblem, y0: Vector, parts: Step, equation: Equation, x: Vector
) -> tuple[Any, Any]:
    """Bounds of the quadrature error of the residual and of its derivatives near x; (0, 0)
    if the rule is exact.
    """
    flint = require_flint()
    if not equation.nodes:
        return flint.arb(0), flint.arb(0)
    bounds = [_bound(problem, y0, parts, equation, x, rho) for rho in _ELLIPSES]
    return min(bounds, key=lambda b: float(b[0].log()) if b[0].is_finite() else float("inf"))


def _bound(
    problem: ExactProblem, y0: Vector, parts: Step, equation: Equation, x: Vector, rho: float
) -> tuple[Any, Any]:
    flint = require_flint()
    arb, acb = flint.arb, flint.acb
    complexes = in_arithmetic(problem.data, complex_balls(flint.ctx.prec))
    table = stage_table(equation.blocks, problem.arithmetic)
    size = max(abs(v).upper() for v in y0)
    size = size if size > 0 else arb(1)
    # R is small because the coefficients of the basis enlarge it. The bound that R divides is tiny
    # in any case.
    R = size / 2**40

    def around(centre: Any, radius: Any) -> Any:
        spread = arb(0).union(radius.upper()).union(-radius.upper())
        return acb(centre + spread, spread)

    K = in_blocks([around(v, R) for v in x], equation.blocks)
    start = [acb(v) for v in y0]
    # The coefficients of u′ by powers of τ. Summing over the stages first makes the higher ones
    # small.
    slopes = [
        [
            total(k[c] * row[p] for k, row in zip(K, table.coefficients, strict=True)) / (p + 1)
            for p in range(len(K))
        ]
        for c in range(problem.dimension)
    ]
    # The ellipse lies in the rectangle |Re τ − 1/2| ≤ (ρ + 1/ρ)/4, |Im τ| ≤ (ρ − 1/ρ)/4.
    r = arb(rho)
    wide, high = (r + 1 / r) / 4, (r - 1 / r) / 4
    cells, largest = _CELLS, arb(0)
    for i in range(cells):
        for j in range(cells):
            re = arb(1) / 2 - wide + wide * (2 * i + 1) / cells
            im = -high + high * (2 * j + 1) / cells
            tau = acb(re + _spread(wide / cells), im + _spread(high / cells))
            g = complexes.gradient([a + tau * horner(p, tau) for a, p in zip(start, slopes, strict=True)])
            weights = [abs(v / b).upper() for v, b in zip(table.basis(tau), table.b, strict=True)]
            for v in g:
                for w in weights:
                    product = (abs(v).upper() * w).upper()
                    if not product.is_finite():
                        return product, product
                    largest = largest.max(product)
    B_size = arb(0)
    for row in table.a:
        B = complexes.structure(combined(start, [acb(v) for v in row], K))
        rows = [arb(0)] * problem.dimension
        for i, j, entry in B:
            rows[i], rows[j] = rows[i] + abs(entry).upper(), rows[j] + abs(entry).upper()
        for v in rows:
            B_size = B_size.max(v.upper())
    # The factor is half of 64/15, because [0, 1] has half the length of [−1, 1].
    rule = largest * 32 / 15 * r ** (-2 * (equation.nodes - 1)) / (1 - 1 / (r * r))
    error = (abs(parts.delta).upper() * B_size * rule).upper()
    return error, (2 * error / R).upper()


def _spread(radius: Any) -> Any:
    flint = require_flint()
    return flint.arb(0).union(radius.upper()).union(-radius.upper())
