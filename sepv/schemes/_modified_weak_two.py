"""(2.1) with a modified structure matrix: one implicit equation a step, weak order two,
H and quadratic Casimirs kept.

The derivation follows A. Abdulle, D. Cohen, G. Vilmart and K. C. Zygalakis, High weak order methods
for stochastic differential equations based on modified equations (SIAM J. Sci. Comput. 34, 2012),
as Cohen and Dujardin (2014), §5, suggest.

**Derivation.** Let f = B∇H and g = ∇H. (2.1) is symmetric in Δ, so that it is the flow of
f + Δ²f₃ + O(Δ⁴) at the time Δ. The coefficients of Δ³ in the expansions of (2.1) and of
this flow give

    f₃ = S₃ g,   12 S₃ = −½ B″(f, f) + B′(f′f) + B H″B′(f) − B′(f)H″B + B H″B H″B,
    f′f = B′(f)g + BH″f.

With F = f·∇, G = f₃·∇ a step's expectation is E exp(ΔF + Δ³G + …). It differs from the exact E
exp(ΔF) by E[Δ³]G + ½E[Δ⁴](FG + GF) + O(h³), E[Δ³] = 3c²h² + O(h³), E[Δ⁴] = 3c⁴h² + O(h³), c² = Σ
c_j². If f is replaced by f − 3c²h f₃, both terms vanish, because E[Δ³ − 3c²hΔ] = O(h³) and E[Δ⁴
− 3c²hΔ²] = O(h³). So

    y1 = y0 + Δ [B(ȳ) − 3c²h S₃(ȳ)] ∇̄H,   with ∇̄H in the place of g in S₃,

has weak order 2, and like (2.1) mean-square order 1. S₃ is skew, so that H is kept. C = yᵀAy is
kept because ∇C(ȳ)ᵀS₃∇̄H = 0, by ∇CᵀB = 0, ∇CᵀB′(w) = −2wᵀAB and ∇CᵀB″(w, w) = −4wᵀAB′(w). H and C
are kept with any symmetric matrix in the place of H″ and any vector in the place of g.

**Large steps.** If 3c²h|S₃| exceeds |B|, the correction is no longer small, and the equation may
have no solution. The correction is therefore divided by 1 + θ², θ = 3c²h|S₃|/|B| in the Frobenius
norm, so that it is at most half of |B|. This factor changes no order, because θ² = O(h²), and H and
Casimirs are still kept. A norm depends on the coordinates. Therefore the scheme is equivariant
under rotations and translations, but not under every affine map.

A step depends on h and c besides Δ. The scheme is therefore not symmetric, and not a function of Σ
c_jΔW_j alone.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from sepv.core.formula import Increment, Values
from sepv.problem import Array, Problem, average_gradient, dot, matmul, matvec, slope_along, turned_along
from sepv.schemes._one_step import CLAIMS_OF_ALL, Implicit, one_step

# Weights of central differences of order six, exact for polynomials of degree 7 at any width.
SECOND_WEIGHTS = (270.0, -27.0, 2.0)
MIDDLE_WEIGHT = -490.0
# The width of differences, relative to |y| or the length of a step, whichever is larger. So the
# width has the units of y, and near y = 0 rounding errors are of the order of a rounding of the
# step.
WEAK_TWO_WIDTH = 2.0**-4
# A number that no square that matters is near: it keeps a quotient 0/0 from being no number.
DIVISOR_GUARD = 5e-324


def structure_slope(problem: Problem, y: Array, w: Array, length: Array | float = 1.0) -> Array:
    """The derivative of B at y in the direction w, B′(y)w, (d, d, M).

    It is computed from B′ if the problem gives B′, else from differences of order six along w.
    Their width is WEAK_TWO_WIDTH times the larger of |y| and `length` (1 if both are 0).
    """
    if problem.structure_derivative is not None:
        return turned_along(problem.structure_derivative(y), w)
    width, direction, size = _along(y, w, length)
    return np.asarray(slope_along(problem.structure, y, direction, width) * size)


def gradient_slope(problem: Problem, y: Array, length: Array | float) -> Array:
    """The second derivatives H″(y), (d, d, M): as given, else by differences of ∇H of order six.

    Differences of low order, as in Newton's matrix, are too rough here. `length` is as in
    `structure_slope`.
    """
    if problem.hessian is not None:
        return problem.hessian(y)
    columns = []
    for k in range(y.shape[0]):
        axis = np.zeros_like(y)
        axis[k] = 1.0
        width, direction, _ = _along(y, axis, length)
        columns.append(slope_along(problem.gradient, y, direction, width))
    return np.stack(columns, axis=1)


def structure_curvature(problem: Problem, y: Array, w: Array, length: Array | float = 1.0) -> Array:
    """The second derivative of B at y in the direction w, B″(y)(w, w), (d, d, M),
    by central differences.

    `length` is as in `structure_slope`.
    """
    width, direction, size = _along(y, w, length)
    total = MIDDLE_WEIGHT * problem.structure(y)
    for n, weight in enumerate(SECOND_WEIGHTS, 1):
        ahead, behind = y + n * width * direction, y - n * width * direction
        total = total + weight * (problem.structure(ahead) + problem.structure(behind))
    return np.asarray(total / (180 * width * width) * (size * size))


def _along(y: Array, w: Array, length: Array | float) -> tuple[Array, Array, Array]:
    """The width (M,) of differences along w, the direction w/|w| (d, M), and |w| (M,),
    the largest component of w.
    """
    size = np.max(np.abs(w), axis=0)
    scale = np.maximum(np.max(np.abs(y), axis=0), length)
    return WEAK_TWO_WIDTH * np.where(scale > 0, scale, 1.0), w / np.where(size > 0, size, 1.0), size


def correction(problem: Problem, middle: Array, mean: Array, variance: Array) -> Array:
    """The matrix S₃ (d, d, M) of this module's docstring, at ȳ = `middle`,
    for g = `mean` and 3c²h = `variance`.
    """
    B = problem.structure(middle)
    length = np.sqrt(np.abs(variance)) * np.max(np.abs(matvec(B, mean)), axis=0)
    curved = gradient_slope(problem, middle, length)
    curved = 0.5 * (curved + np.swapaxes(curved, 0, 1))  # differences are not symmetric

    def along(w: Array, times: int) -> Array:
        slope = structure_slope if times == 1 else structure_curvature
        return slope(problem, middle, w, length)

    return np.asarray(expanded(B, curved, mean, along))


def expanded(B: Values, curved: Values, mean: Values, along: Callable[[Values, int], Values]) -> Values:
    """S₃ from B, H″ = `curved` and g = `mean`, on arrays (d, d, M) or symbols (d, d).

    `along(w, n)` is the derivative number n = 1, 2 of B in the direction w.
    """
    f = matvec(B, mean)
    turned = along(f, 1)
    acceleration = matvec(turned, mean) + matvec(B, matvec(curved, f))
    BH = matmul(B, curved)
    crossed = matmul(BH, turned)
    total = along(acceleration, 1) - 0.5 * along(f, 2)
    return (total + crossed - np.swapaxes(crossed, 0, 1) + matmul(matmul(BH, BH), B)) / 12


def limited(change: Values, structure: Values) -> Values:
    """The matrix change/(1 + θ²), (d, d, ...), with θ = |change|/|structure|:
    its norm is at most |structure|/2.
    """
    # The squares are added entry by entry, because `np.sum` adds in another order for a single
    # path.
    d = len(change)
    size, whole = (
        dot(M.reshape(d * d, *M.shape[2:]), M.reshape(d * d, *M.shape[2:])) for M in (change, structure)
    )
    # S₃ is 0 where B is.
    return change / (1 + size / (whole + DIVISOR_GUARD))


def formula(fields: Any, y: Values, z: Values, step: Values) -> Values:
    """R of the step in symbols, from which B′, B″ and H″ are derived; `increment` is for arrays.

    `fields` are the functions of a recorded problem (`sepv.schemes._recorded`).
    """
    mean, middle = fields.mean_gradient(y, z), y + 0.5 * z
    structure = fields.structure(middle)
    change = expanded(structure, fields.hessian(middle), mean, partial(fields.structure_along, middle))
    return step[0] * matvec(structure - limited(step[1] * change, structure), mean)


def increment(problem: Problem, y0: Array, y1: Array, step: Array) -> Increment:
    """R of the step y1 = y0 + R: Δ [B(ȳ) − 3c²h S₃/(1 + θ²)] ∇̄H. `step` (2, M) holds Δ and 3c²h.

    S₃ and θ are those of the module. Each value of B for the differences in S₃ counts as an
    evaluation.
    """
    mean, middle = average_gradient(problem, y0, y1), y0 + 0.5 * (y1 - y0)
    structure = problem.structure(middle)
    structure = structure - limited(step[1] * correction(problem, middle, mean.value, step[1]), structure)
    # S₃ evaluates B seven times for B″, once for its own B, and twelve times for B′ if B′ is not
    # given.
    evaluations = 9 if problem.structure_derivative is not None else 21
    counts = np.full_like(mean.evaluations, evaluations)
    return Increment(step[0] * matvec(structure, mean.value), mean.evaluations, counts, mean.reliable)


def step_and_variance(problem: Problem, h: float, noise: Array) -> Array:
    """The numbers Δ and 3c²h of M paths, with c² = Σ c_j²: (2, M)."""
    return np.stack(
        [problem.random_step(h, noise), np.full(noise.shape[1], 3.0 * float(np.sum(problem.c**2)) * h)]
    )


# Newton's matrix comes from differences if the functions of a problem are not recorded.
# S₃′ would need third derivatives of B and H. The matrix of (2.1) would take fewer evaluations. But
# the iteration would converge linearly, with residuals of one sign: over 2048 steps n of the
# pendulum the energy drifted like n^0.70.
step = Implicit(increment, parts=step_and_variance, formula=formula)
scheme = one_step(
    "modified-weak-2",
    step,
    CLAIMS_OF_ALL | {"identity", "energy", "casimir", "rounding"},
    "(2.1) with the structure matrix of a modified equation (§5)",
    weak_order=2.0,
)
