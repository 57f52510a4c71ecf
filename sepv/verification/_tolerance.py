"""The bounds of the laws, derived: the meaning of "exact" in binary64.

Notation: u = eps/2; |·| of a matrix or vector is entrywise; M_g ≥ |∇H| and M_B ≥ |B| are majorants (sums of
absolute values of terms), to which rounding errors are relative whatever cancels.

**Residual.** A step that solves y1 = y0 + ΔB∇̄H as well as binary64 allows leaves, component by component,

    r_i = K u (max(|y0|_∞, |y1|_∞) + |Δ|₁ Σ_j M_B,ij M_g,j),     |Δ|₁ = |h| + Σ_j |c_j ΔW_j|:

one rounding of y1 itself, the stagnation of the iteration at the scale of y, and the rounding of R. K counts
the operations behind one entry: at most 2ν + T for a sum of T terms of degree ν evaluated at rounded
quadrature points, d for the product B∇̄H, and 8 for Δ, weights and the final sum. A factor of 4 covers
implementations that order the same operations differently. A scheme that states its own solver's
tolerance gets |y| times that in addition.

**Single precision** (`Scheme.dtype`). u is then 2⁻²⁴, in the residual alone: the suite evaluates H, Casimirs and
references as before. The step gets y0 and ΔW rounded, y0 + e with |e| ≤ u|y0|: as a step from y0 it leaves
r + e + Δ ∂R/∂y0 e, and INPUTS counts this. Cases have numbers that single precision has: zero bounds stay.

**Several stages.** A stage of an s-stage method leaves r too, with two more sums, of s stages and of ⌈sν/2⌉
nodes, and averages that multiply errors of ∇H by up to max_i b_i⁻¹∫|ℓ_i| (1.57 for six stages). y1 = y0 + Σ b_j z_j
with b_j ≥ 0 and Σ b_j = 1: what follows holds as for one stage, because H(y1) − H(y0) = Σ_j b_j g_jᵀ z_j.

**Energy.** H(y1) − H(y0) = ∇̄Hᵀ(y1 − y0) (fundamental theorem), and ∇̄Hᵀ B ∇̄H = 0 for the computed skew B, so that
|ΔH| ≤ Σ_i M_g,i r_i. **Casimirs**: the same with M_∇C. **Error of y1**: |(I − ∂R/∂y1)⁻¹| r.

**Many steps** (Brouwer 1937). The sum y0 + z is rounded to nearest, component by component, with errors that are
spread evenly over ±½ulp(y1_i): a step moves an invariant I by √(Σ_i (∂_iI ulp(y_i))²/12) in the root mean square,
n steps by √n times that. For small |Δ| this is nearly all: the rounding of z itself is |z|/|y| of it. Means that are
not quite zero show after 10⁶ steps and more, and are not predicted.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sepv.problem import (
    Array,
    Function,
    HamiltoniansProblem,
    Problem,
    StructuresProblem,
    matvec,
    noise_vectors,
)
from sepv.record import EPS, TINY, PolynomialMap, majorant
from sepv.schemes import Scheme, exact_nodes
from sepv.schemes import gauss_amplification as amplification


def gradient_majorant(problem: Problem, *states: Array) -> Array:
    """M_g (d,) over the given states: absolute coefficients for polynomials, else |∇H| + |H″||y|.

    The second form is the effect of one rounding of y on a well-written ∇H.
    """
    return np.asarray(np.max([_slope_majorant(problem.gradient, problem.hessian, y) for y in states], axis=0))


def _slope_majorant(gradient: Function, hessian: Function | None, y: Array) -> Array:
    if isinstance(gradient, PolynomialMap):
        return gradient.majorant(y)
    return np.asarray(np.abs(gradient(y)) + matvec(np.abs(slopes(gradient, hessian, y)), np.abs(y)))


def structure_majorant(problem: Problem, *states: Array) -> Array:
    """M_B (d, d) over the given states: absolute coefficients, else |B| + |B′||y|."""
    rows = []
    for y in states:
        if isinstance(problem.structure, PolynomialMap):
            rows.append(problem.structure.majorant(y))
        else:
            rows.append(np.abs(problem.structure(y)))
            slope = np.abs(slopes(problem.structure, problem.structure_derivative, y))
            rows[-1] = rows[-1] + np.einsum("ijk...,k...->ij...", slope, np.abs(y))
    return np.max(rows, axis=0)


def slopes(function: Function, derivative: Function | None, y: Array) -> Array:
    """∂function/∂y (…, d, ...) at y (d, ...), for sizes: as given, else by central differences good to six digits."""
    if derivative is not None:
        return derivative(y)
    columns = []
    with np.errstate(all="ignore"):
        for k in range(y.shape[0]):
            step = np.zeros_like(y)
            step[k] = 2.0**-17 * (1 + np.abs(y[k]))
            columns.append((function(y + step) - function(y - step)) / (2 * step[k]))
    return np.stack(columns, axis=function(y).ndim - (y.ndim - 1))


def _largest(structure: Any, *states: Array) -> Array:
    """M_G (d, d) of a noise structure over the states: its own majorant, else |G|."""
    return np.asarray(np.max([majorant(structure, y) for y in states], axis=0))


def operations(problem: Problem, stages: int = 1) -> float:
    """The constant K of the module's docstring."""
    terms, degree, nodes = 6, 2, 2 * (stages + 4)  # nodes of a quadrature that is refined until it is exact
    if isinstance(problem.gradient, PolynomialMap) and isinstance(problem.structure, PolynomialMap):
        rows = [*problem.gradient.rows, *problem.structure.rows]
        if isinstance(problem, HamiltoniansProblem):
            rows += [p for g in problem.noise_gradients if isinstance(g, PolynomialMap) for p in g.rows]
        terms, degree = max(len(p.terms) for p in rows), max(p.degree for p in rows) + 1
        nodes = exact_nodes(stages, degree)
    single = 4.0 * (2 * degree + terms + problem.dimension + 8)
    if stages == 1:
        return single
    return amplification(stages) * (single + 4.0 * (stages + nodes))


def step_residual(
    problem: Problem, y0: Array, y1: Array, h: float, dW: Array, scheme: Scheme | None = None
) -> Array:
    """The residual r (d,) that a solved step may leave, by the scheme's tolerance; (d, M) for a batch.

    Without a scheme: solved to rounding, with one stage.
    """
    tolerance, stages, eps = 0.0, 1, EPS
    if scheme is not None:
        tolerance, stages, eps = scheme.solver_tolerance, scheme.stages, scheme.eps
    scale = np.maximum(np.abs(y0).max(axis=0), np.abs(y1).max(axis=0))
    length = abs(h) + np.tensordot(problem.c, np.abs(dW), axes=1)
    B = structure_majorant(problem, y0, y1)
    if isinstance(problem, StructuresProblem):
        B = np.max([B, *(_largest(G, y0, y1) for G in problem.noise_structures)], axis=0)
    flow = matvec(B, _any_gradient(problem, y0, y1))
    flow = np.maximum(flow.T, pushes(problem)).T
    count, least = operations(problem, stages), TINY
    if eps > EPS:
        count, least = count + INPUTS, LEAST_SINGLE
    return 0.5 * eps * count * (scale + length * flow) + tolerance * scale + least


# Roundings of y0 and dW to single precision before the step: (1 + κ) of y and one of Δ, κ ≤ 1 its contraction factor.
INPUTS = 4.0
# Underflow of single precision, whose subnormal numbers some processors take for 0.
LEAST_SINGLE = 2.0**-120


def pushes(problem: Problem) -> Array:
    """The largest |g_j| of additive noise, (d,): a part of every field. Zeros for noise that is given otherwise."""
    return np.asarray(np.max(np.abs(noise_vectors(problem)), axis=0, initial=0.0))


def majorants(problem: Problem, reach: Array) -> tuple[Array, Array, Array, Array]:
    """M_B, M_g and the majorants of their derivatives for |y| ≤ `reach` (d, ...), for polynomial data.

    The largest over all structures, or over all Hamiltonians, where there are several.
    """
    B, g, dB, H = (
        _of_polynomials(f, reach)
        for f in (problem.structure, problem.gradient, problem.structure_derivative, problem.hessian)
    )
    if isinstance(problem, StructuresProblem) and problem.noise_structure_derivatives:
        B = np.max([B, *(_of_polynomials(G, reach) for G in problem.noise_structures)], axis=0)
        dB = np.max([dB, *(_of_polynomials(D, reach) for D in problem.noise_structure_derivatives)], axis=0)
    if isinstance(problem, HamiltoniansProblem):
        g = np.max([g, *(_of_polynomials(f, reach) for f in problem.noise_gradients)], axis=0)
        H = np.max([H, *(_of_polynomials(f, reach) for f in problem.noise_hessians)], axis=0)
    return B, g, dB, H


def _of_polynomials(function: object, reach: Array) -> Array:
    assert isinstance(function, PolynomialMap)
    return function.majorant(reach)


def _any_gradient(problem: Problem, y0: Array, y1: Array) -> Array:
    """The majorant M_g of H, and of all H_j if there are several Hamiltonians."""
    stated = gradient_majorant(problem, y0, y1)
    if not isinstance(problem, HamiltoniansProblem) or not problem.noise_gradients:
        return stated
    hessians = problem.noise_hessians or (None,) * problem.noises
    alike = zip(problem.noise_gradients, hessians, strict=True)
    return np.max([stated, *(_slope_majorant(g, H, y) for g, H in alike for y in (y0, y1))], axis=0)


def energy_bound(problem: Problem, y0: Array, y1: Array, residual: Array) -> Any:
    """A bound of |H(y1) − H(y0)| for this residual."""
    return np.sum(gradient_majorant(problem, y0, y1) * residual, axis=0) + TINY


def casimir_bound(A: Array, y0: Array, y1: Array, residual: Array) -> Any:
    """A bound of |C(y1) − C(y0)| for this residual, for C = yᵀAy (matrix A) or C = bᵀy (vector A)."""
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
    """The mean square change (M,) of an invariant by the rounding of one step to each of the states (see above).

    `gradient` (d, M) is the invariant's at `states` (d, M). 0 where it overflows, which excuses nothing.
    """
    with np.errstate(all="ignore"):
        roundings = gradient * np.spacing(np.abs(states))
        variances = np.sum(roundings * roundings, axis=0) / 12
    return np.where(np.isfinite(variances), variances, 0.0)


def rounding_walk(gradient: Array, states: Array) -> float:
    """The root mean square change of an invariant by the rounding of one step, averaged over states."""
    return float(np.sqrt(np.mean(rounding_variances(gradient, states))))


def state_ulp(*states: Array) -> float:
    """The unit of errors of a state: eps times its largest component."""
    return EPS * max(TINY, *(float(np.max(np.abs(y))) for y in states))


# Digits of the references for `state_error`: fourteen more than a binary64 number has, relative to the largest
# component, as the bound is.
DIGITS = 30


def state_error(
    exact: Sequence[Any], condition: Sequence[Sequence[float]], problem: Problem, y0: Array, y1: Array, h: float,
    dW: Array, scheme: Scheme | None = None,
) -> tuple[float, float]:  # fmt: skip
    """Error and bound of y1 against an exact step, in ulp of the largest component: the worst component.

    `exact` are d numbers of extended precision, `condition` (d, d) is |(I − ∂R/∂y1)⁻¹|, which turns residuals into
    errors. The bound adds the rounding of y1 itself.
    """
    unit = state_ulp(y0, y1)
    error = np.array([abs(float(a - float(b))) for a, b in zip(exact, y1, strict=True)])
    residual = step_residual(problem, y0, y1, h, dW, scheme)
    bound = np.array(condition) @ residual + EPS * np.abs(y1)
    k = int(np.argmax(error / bound))
    return float(error[k]) / unit, float(bound[k]) / unit
