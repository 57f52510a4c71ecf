"""Derivation of the bounds of the laws, which say what "exact" means in binary64.

Notation: a step leads from y0 to y1; Δ = h + Σ_j c_jΔW_j; u = eps/2; |·| of a matrix or vector is
entrywise; ∇̄H is the average of ∇H from y0 to y1. M_g ≥ |∇H|, M_B ≥ |B| and M_C ≥ |∇C| are
majorants (sums of the absolute values of all terms). Rounding errors are relative to the majorants,
even if terms cancel.

**Majorants** bound the functions wherever a step evaluates them, not at y0 and y1 alone: ∇H =
(y2y3, y1y3, y1y2) vanishes nearly at (1, δ, δ) and at (δ, 1, δ), but not between. They hold on the
box with the corners y0 and y1, which contains the segment of (2.1) and the edges of coordinate
increments. Of a polynomial the majorant is the sum of the absolute terms at max(|y0_i|, |y1_i|). Of
another function F it is |F| + |F′||y|, where the second term is the effect of one rounding of y on
a well-written F, enclosed over the box by interval arithmetic (`sepv.problem._enclosures`), and at
least its value at the ends. Of a function that cannot be recorded it is the largest value at
SEGMENT_SAMPLES states of the segment, which is an estimate. A collocation polynomial u of s ≤ 6
stages deviates from the segment by at most max_τ Σ_j |∫₀^τ ℓ_j − τ b_j| < ½ times the largest z_i −
z_j (below), which inside the contraction radius is at most twice CONTRACTION·|y1 − y0|. So for s >
1 the box is larger by CONTRACTION·|y1 − y0| on each side.

**Residual.** A step solves y1 = y0 + R with R = ΔB∇̄H. If it does so as well as binary64 allows,
then |y1 − y0 − R| ≤ r with r_i = K u (max(|y0|_∞, |y1|_∞) + |Δ|₁ Σ_j M_B,ij M_g,j) in component i,
where |Δ|₁ = |h| + Σ_j |c_j ΔW_j|. This covers one rounding of y1, the stagnation of the iteration
at the scale of y, and the rounding of R. K counts the operations behind one entry: at most 2ν + T
for a sum of T terms of degree ν evaluated at rounded quadrature points, d for the product B∇̄H, and
8 for Δ, weights and the final sum. A factor of 4 covers implementations that order the same
operations differently. If a scheme states its solver's tolerance, |y| times the tolerance is added
to r.

**Single precision** (`Scheme.dtype`). u is 2⁻²⁴ in the residual alone, because the suite evaluates
H, Casimirs and references in binary64. The step starts from y0 rounded to single precision, y0 + e
with |e| ≤ u|y0|. As a step from y0 it has a residual of r + |e| + |∂R/∂y0 e| at most.
INPUT_ROUNDINGS counts the terms in e and the rounding of ΔW. Cases contain only numbers that single
precision represents, so that bounds of zero remain zero.

**s stages** of Gauss collocation: y1 = y0 + Σ_j b_j z_j, where z_j = ΔB g_j and g_j = b_j⁻¹∫ℓ_j∇H
averages ∇H with the Lagrange polynomial ℓ_j; b_j ≥ 0, Σ_j b_j = 1. The residual of each equation
for z_j is at most r, with a larger K. This K also counts sums over s stages and ⌈sν/2⌉ nodes. It is
multiplied by max_j b_j⁻¹∫|ℓ_j| (1.57 for s = 6), which bounds how the averages amplify errors of
∇H. Because H(y1) − H(y0) = Σ_j b_j g_jᵀ z_j, the bounds below hold for any s.

**Energy.** H(y1) − H(y0) = ∇̄Hᵀ(y1 − y0) (fundamental theorem), and ∇̄Hᵀ B ∇̄H = 0 for the computed
skew B. So |H(y1) − H(y0)| ≤ Σ_i M_g,i r_i.
**Casimirs**: |C(y1) − C(y0)| ≤ Σ_i M_C,i r_i. **Error of y1**: |(I − ∂R/∂y1)⁻¹| r.

**Velocities from positions.** A mechanical step may take its momenta from rounded positions, p1 =
M(q1 − q0 − …)/h, as programs with constraints do. If n additions make q1, it errs by n u|q1|. The
difference of near numbers adds little, so p1 errs by n u|M||q1|/h, which grows as h falls. ASE's
Langevin step has n = 2. BAOAB can take p after each half of a step, with n = 1 over h/2: together n
= 4 over h. Only laws with h of rounding size allow for it (`from_positions`). In (1.1) steps have a
random length, and it is not allowed for.

**Many steps** (Brouwer 1937). A step adds an increment z to y0. The sum is rounded to nearest. In
component i the error is spread evenly over ±½ulp(y1_i). So one step moves an invariant I by √(Σ_i
(∂_iI ulp(y_i))²/12) in the root mean square, and n steps by √n times as much. For small |Δ| other
errors are negligible, because the rounding of z itself is smaller by the factor |z|/|y|. Errors
whose mean is not quite zero show after 10⁶ steps and more, and are not predicted.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sepv.errors import UsageError
from sepv.problem import (
    Array,
    Function,
    Problem,
    hamiltonians_of,
    matmul,
    matvec,
    mechanics,
    noise_vectors,
    one_field,
    over_box,
    structures_of,
    structures_with_derivatives,
)
from sepv.record import EPS, TINY, PolynomialMap
from sepv.schemes import Scheme, as_path, exact_nodes
from sepv.schemes import gauss_amplification as amplification


def gradient_majorant(problem: Problem, *states: Array, beyond: Any = 0.0) -> Array:
    """The majorant M_g (d,) of |∇H| over the box with corners `states`,
    enlarged by `beyond` ("Majorants" above).
    """
    return majorant_over(problem.gradient, problem.hessian, states, beyond, problem.hamiltonian)


def structure_majorant(problem: Problem, *states: Array, beyond: Any = 0.0) -> Array:
    """The majorant M_B (d, d) of |B| over the box with corners `states`,
    enlarged by `beyond` ("Majorants" above).
    """
    return majorant_over(problem.structure, problem.structure_derivative, states, beyond)


def majorant_over(
    function: Function,
    derivative: Function | None,
    states: Sequence[Array],
    beyond: Any = 0.0,
    potential: Function | None = None,
) -> Array:
    """A majorant of |function|, the gradient of a `potential` if there is one, over a box.

    See "Majorants" in the module. Of one state it is the majorant there.
    """
    if isinstance(function, PolynomialMap):
        return function.majorant(np.max(np.abs(states), axis=0) + beyond)
    y0, y1 = states[0], states[-1]
    bound = None
    if len(states) > 1:
        source, of_gradient = (function, False) if potential is None else (potential, True)
        bound = over_box(source, y0, y1, beyond, differentiated=of_gradient)
        if bound is None:
            states = [y0 + share * (y1 - y0) for share in np.linspace(0, 1, SEGMENT_SAMPLES)]
    at = []
    for y in states:
        value = np.abs(function(y))
        slope = np.abs(slopes(function, derivative, y))
        at.append(value + np.sum(slope * np.abs(y), axis=value.ndim - y.ndim + 1))
    found = np.max(at, axis=0)
    return np.asarray(found if bound is None else np.maximum(found, bound.reshape(found.shape)))


def slopes(function: Function, derivative: Function | None, y: Array) -> Array:
    """The derivative ∂function/∂y (…, d, ...) at y (d, ...): `derivative`(y),
    or central differences to six digits.
    """
    if derivative is not None:
        return derivative(y)
    columns = []
    with np.errstate(all="ignore"):
        for k in range(y.shape[0]):
            step = np.zeros_like(y)
            step[k] = 2.0**-17 * (1 + np.abs(y[k]))
            columns.append((function(y + step) - function(y - step)) / (2 * step[k]))
    return np.stack(columns, axis=function(y).ndim - (y.ndim - 1))


def operations(problem: Problem, stages: int = 1) -> float:
    """The constant K in the bound of a step's residual:
    a count of the roundings behind one entry (see the module).
    """
    terms, degree, nodes = 6, 2, 2 * (stages + 4)  # nodes of a quadrature that is refined until it is exact
    if isinstance(problem.gradient, PolynomialMap) and isinstance(problem.structure, PolynomialMap):
        rows = [*problem.gradient.rows, *problem.structure.rows]
        others = (F.gradient for F in hamiltonians_of(problem)[1:])
        rows += [p for g in others if isinstance(g, PolynomialMap) for p in g.rows]
        terms, degree = max(len(p.terms) for p in rows), max(p.degree for p in rows) + 1
        nodes = exact_nodes(stages, degree)
    single = 4.0 * (2 * degree + terms + problem.dimension + 8)
    if stages == 1:
        return single
    return amplification(stages) * (single + 4.0 * (stages + nodes))


def step_residual(
    problem: Problem, y0: Array, y1: Array, h: float, dW: Array, scheme: Scheme | None = None
) -> Array:
    """A bound r (d,) of the residual y1 − y0 − R of a correctly solved step; (d, M) for a batch.

    `scheme` states its solver's tolerance and its number of stages. Without it, r is for one stage,
    solved to rounding.
    """
    tolerance, stages, eps = 0.0, 1, EPS
    if scheme is not None:
        tolerance, stages, eps = scheme.solver_tolerance, scheme.stages, scheme.eps
    scale = np.maximum(np.abs(y0).max(axis=0), np.abs(y1).max(axis=0))
    length = abs(h) + np.tensordot(problem.c, np.abs(dW), axes=1)
    # The stages of a collocation method leave the segment from y0 to y1 ("Majorants" in the
    # module).
    beyond = 0.0 if stages == 1 else CONTRACTION * np.abs(y1 - y0).max(axis=0)
    B = structure_majorant(problem, y0, y1, beyond=beyond)
    B = np.max([B, *(_of_noise(G, (y0, y1), beyond) for G in structures_of(problem)[1:])], axis=0)
    flow = matvec(B, _any_gradient(problem, y0, y1, beyond))
    flow = np.maximum(flow.T, pushes(problem)).T
    count, least = operations(problem, stages), TINY
    if eps > EPS:
        count, least = count + INPUT_ROUNDINGS, LEAST_SINGLE
    residual: Array = accumulated(scheme) * (
        0.5 * eps * count * (scale + length * flow) + tolerance * scale + least
    )
    return residual


# With the contraction factor 1/4, every scheme that evaluates B and ∇H between y0 and y1 has a
# unique solution near y0. If its equation is y1 = y0 + R, then |(I − ∂R/∂y1)⁻¹| is at most 4/3.
CONTRACTION = 0.25


def accumulated(scheme: Scheme | None) -> float:
    """The factor of the residual of a map of N steps of a path: N e^(2κ) with κ = ¼ (`_middle`),
    and 1 for one step.
    """
    count = 1 if scheme is None else as_path(scheme)[1]
    return 1.0 if count == 1 else count * PATH_GROWTH


# e^(2κ), which bounds the growth of errors over the steps of a path inside a contraction radius
# (`_middle`).
PATH_GROWTH = float(np.exp(2 * CONTRACTION))
# Roundings of y0 and ΔW to single precision before the step: 1 + κ for y0 (contraction factor κ
# ≤ 1) and 1 for Δ.
INPUT_ROUNDINGS = 4.0
# The number of states along a segment at which a function that cannot be recorded is evaluated.
SEGMENT_SAMPLES = 9
# A bound of underflow in single precision, because some processors take its subnormal numbers
# for 0.
LEAST_SINGLE = 2.0**-120


# Additions behind a position from which a momentum is taken ("Velocities from positions").
ADDITIONS = 4.0


def from_positions(problem: Problem, states: Array, h: Any) -> Any:
    """A bound of the errors |δp| of momenta that a step of length h takes from rounded positions
    near `states` (d, S); 0 if the problem is not mechanical, or of (1.1).
    """
    if one_field(problem):
        return 0.0 * h
    try:
        system = mechanics(problem)
    except UsageError:
        return 0.0 * h
    sizes = np.abs(system.mass) @ system.split(np.abs(states))[0]
    return ADDITIONS * 0.5 * EPS * np.max(np.linalg.norm(sizes, axis=0)) / h


def pushes(problem: Problem) -> Array:
    """The largest |g_j| (d,), entrywise, over the vectors of additive noise Σ c_j g_j∘dW_j;
    zeros for other noise.
    """
    return np.asarray(np.max(np.abs(noise_vectors(problem)), axis=0, initial=0.0))


def majorants(problem: Problem, reach: Array) -> tuple[Array, Array, Array, Array]:
    """Majorants of B, ∇H, B′ and H″ for all states with |y| ≤ `reach` (d, ...),
    for polynomial data.

    If there are several structures or several Hamiltonians, each majorant is the largest over them.
    """
    structures, gradients = structures_with_derivatives(problem), hamiltonians_of(problem)
    found = (
        [F.structure for F in structures], [F.gradient for F in gradients],
        [F.structure_derivative for F in structures], [F.hessian for F in gradients],
    )  # fmt: skip
    B, g, dB, H = (np.max([_of_polynomials(f, reach) for f in of], axis=0) for of in found)
    return B, g, dB, H


def correction_rounding(problem: Problem, y0: Array, y1: Array, h: float) -> Array:
    """A bound (d,) of the rounding errors in Itô's correction ½ Σ c_j² h f′f, f = B∇H,
    for polynomial data.

    A scheme that treats drift and noise apart may compute the correction. If the increments are
    small beside √h, these errors exceed the effect of the increments. Let u be the unit roundoff,
    and M_f, M_f′ the sums of absolute values of terms. With K operations f errs by K u M_f, f′ by K
    u M_f′, and the correction by Σ c_j² |h| K u M_f′ M_f.
    """
    B, g, dB, H = majorants(problem, np.maximum(np.abs(y0), np.abs(y1)))
    factor = 0.5 * EPS * operations(problem) * abs(h) * float(problem.c @ problem.c)
    return np.asarray(factor * matvec(matvec(dB, g) + matmul(B, H), matvec(B, g)))


def _of_polynomials(function: object, reach: Array) -> Array:
    assert isinstance(function, PolynomialMap)
    return function.majorant(reach)


def _of_noise(structure: Any, states: Sequence[Array], beyond: Any) -> Array:
    """A majorant (d, d) of a noise's structure; for a structure with a majorant of its own,
    the largest at the states.

    The second kind stands for several Hamiltonians, is singular where ∇H_0 = 0, and has no bound
    over a box.
    """
    if isinstance(structure, PolynomialMap) or not hasattr(structure, "majorant"):
        return majorant_over(structure, None, states, beyond)
    return np.asarray(np.max([structure.majorant(y) for y in states], axis=0))


def _any_gradient(problem: Problem, y0: Array, y1: Array, beyond: Any) -> Array:
    """A majorant (d,) of |∇H| and, if the noises have Hamiltonians H_j of their own, of all
    |∇H_j|.
    """
    stated = gradient_majorant(problem, y0, y1, beyond=beyond)
    others = (
        majorant_over(F.gradient, F.hessian, (y0, y1), beyond, F.hamiltonian)
        for F in hamiltonians_of(problem)[1:]
        if F.gradient
    )
    return np.asarray(np.max([stated, *others], axis=0))


def energy_bound(problem: Problem, y0: Array, y1: Array, residual: Array) -> Any:
    """A bound of |H(y1) − H(y0)| for a step whose equation is solved up to `residual`."""
    return np.sum(gradient_majorant(problem, y0, y1) * residual, axis=0) + TINY


def casimir_bound(A: Array, y0: Array, y1: Array, residual: Array) -> Any:
    """A bound of |C(y1) − C(y0)| for a step solved up to `residual`; C = yᵀAy,
    or Aᵀy if A is a vector.
    """
    slope = np.abs(A) if A.ndim == 1 else np.abs(A) @ (np.abs(y0) + np.abs(y1))
    return np.sum(slope.T * residual.T, axis=-1) + TINY


def energy_ulp(problem: Problem, y0: Array, y1: Array) -> Any:
    """The unit of energy defects: eps |∇H| |y|, the effect of one rounding of y on H."""
    slopes = [np.linalg.norm(problem.gradient(y), axis=0) * np.linalg.norm(y, axis=0) for y in (y0, y1)]
    return EPS * np.maximum(np.maximum(*slopes), TINY)


def casimir_ulp(A: Array, y0: Array, y1: Array) -> float:
    """The unit of Casimir defects: eps |∇C| |y|."""
    slopes = [float(np.linalg.norm(A if A.ndim == 1 else 2 * A @ y) * np.linalg.norm(y)) for y in (y0, y1)]
    return EPS * max(*slopes, TINY)


def rounding_variances(gradient: Array, states: Array) -> Array:
    """Mean squares (M,) of the change of an invariant by the rounding of each state ("Many steps"
    in the module).

    `gradient` (d, M) is the invariant's gradient at `states` (d, M). An overflow counts as 0: it
    excuses no defect.
    """
    with np.errstate(all="ignore"):
        roundings = gradient * np.spacing(np.abs(states))
        variances = np.sum(roundings * roundings, axis=0) / 12
    return np.where(np.isfinite(variances), variances, 0.0)


def rounding_walk(gradient: Array, states: Array) -> float:
    """The rms change of an invariant by the rounding of y1 in one step,
    over all the `states` y1 (d, M).
    """
    return float(np.sqrt(np.mean(rounding_variances(gradient, states))))


def state_ulp(*states: Array) -> float:
    """The unit of errors of a state: eps times its largest component."""
    return EPS * max(TINY, *(float(np.max(np.abs(y))) for y in states))


# Decimal digits of the references for `state_error`, fourteen more than binary64, relative to the
# largest component.
STATE_ERROR_DIGITS = 30


def state_error(
    exact: Sequence[Any], condition: Sequence[Sequence[float]], problem: Problem, y0: Array, y1: Array, h: float,
    dW: Array, scheme: Scheme | None = None,
) -> tuple[float, float]:  # fmt: skip
    """The error of y1 against an exact step, and its bound,
    in the component where error/bound is largest.

    `exact` is the exact step, d numbers of extended precision. `condition` (d, d) is |(I
    − ∂R/∂y1)⁻¹|, which turns residuals into errors. The bound adds the rounding of y1. Both are in
    units of eps times the largest component.
    """
    unit = state_ulp(y0, y1)
    error = np.array([abs(float(a - float(b))) for a, b in zip(exact, y1, strict=True)])
    residual = step_residual(problem, y0, y1, h, dW, scheme)
    bound = np.array(condition) @ residual + EPS * np.abs(y1)
    k = int(np.argmax(error / bound))
    return float(error[k]) / unit, float(bound[k]) / unit
