"""Linear maps ρ with ρ² = I that reverse the direction of every solution: of momenta,
or of a rigid body's one axis.

If H(ρy) = H(y) and B(ρy) = −ρB(y)ρᵀ, the field f = B∇H has f(ρy) = −ρf(y). Its flow φ is then
reversible, ρ∘φ_θ∘ρ = φ_{−θ} (Hairer, Lubich and Wanner, *Geometric Numerical Integration*, V.1).
The solution of (1.1) is this flow at the random time θ = t + Σ c_jW_j(t), so it is reversible too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sepv.problem import Array, PolynomialSystem, Problem, hessian, sample_states
from sepv.record import EPS, Polynomial

# If H and B are functions, H(ρy) = H(y) and B(ρy) = −ρB(y)ρᵀ must hold up to a relative error of
# REVERSAL_ROUNDINGS·eps.
REVERSAL_ROUNDINGS = 64


def momentum_flip(problem: Problem) -> Array | None:
    """Return the diagonal (d,), ±1, of the map ρ that reverses momenta,
    or None if ρ does not reverse the flow.

    Momenta are the second half of y if the upper right block of B has a positive trace, as in
    q̇ = ∂H/∂p, and the first half if the trace is negative. Polynomials are compared exactly,
    functions at a few states.
    """
    d = problem.dimension
    if d % 2:
        return None
    n, states = d // 2, [np.asarray(y, dtype=np.float64) for y in sample_states(problem)]
    sign = float(np.trace(problem.structure(states[0])[:n, n:]))
    rho = np.repeat([1.0, -1.0] if sign > 0 else [-1.0, 1.0], n)
    data = problem.data
    if isinstance(data, PolynomialSystem):
        turned = all(_parity(B, rho) == -rho[i] * rho[j] for i, j, B in data.structure if B.terms)
        return rho if sign and turned and _parity(data.hamiltonian, rho) == 1 else None
    for y in states:
        B, same = problem.structure(y), _same_energy(problem, y, rho * y)
        opposite = np.abs(
            rho[:, None] * problem.structure(rho * y) * rho + B
        ) <= REVERSAL_ROUNDINGS * EPS * np.max(np.abs(B))
        if not (sign and same and opposite.all()):
            return None
    return rho


def mirrors(problem: Problem) -> list[Array]:
    """Return unit vectors v whose reflection ρ = 1 − 2vvᵀ reverses a flow y′ = s y × ∇H with a
    constant s.

    ρ(a × b) = −ρa × ρb, so that H(ρy) = H(y) is enough. The vectors are tried among the coordinate
    axes and the eigenvectors of H″. The list is empty if B has another form.
    """
    states = [np.asarray(y, dtype=np.float64) for y in sample_states(problem)]
    if problem.dimension != 3 or turning(problem, states) is None:
        return []
    tried = [*np.eye(3), *np.linalg.eigh(hessian(problem, states[0]))[1].T]
    return [v for v in tried if all(_same_energy(problem, y, y - 2 * (v @ y) * v) for y in states)]


def turning(problem: Problem, states: Sequence[Array]) -> float | None:
    """Return the s for which B(y)v = s y × v at all states, or None if there is none."""
    crosses = [np.cross(y, np.eye(3), axisc=0) for y in states]
    B = [problem.structure(y) for y in states]
    s = float(np.sum(np.multiply(B, crosses)) / np.sum(np.square(crosses)))
    off = np.max(np.abs(np.subtract(B, np.multiply(s, crosses))))
    return s if s and off <= REVERSAL_ROUNDINGS * EPS * np.max(np.abs(B)) else None


def _same_energy(problem: Problem, y: Array, other: Array) -> bool:
    """True if H(y) and H(other) are equal up to the rounding of H and of `other`."""
    H, size = float(problem.hamiltonian(y)), float(np.abs(problem.gradient(y)) @ np.abs(y))
    return bool(abs(problem.hamiltonian(other) - H) <= REVERSAL_ROUNDINGS * EPS * (abs(H) + size))


def _parity(polynomial: Polynomial, rho: Array) -> float:
    """Return the parity of a polynomial p under ρ: 1 for p(ρy) = p(y), −1 for p(ρy) = −p(y),
    and 0 for neither.
    """
    signs = {float(np.prod(rho ** np.array(e))) for e, _ in polynomial.terms}
    return signs.pop() if len(signs) == 1 else float(not signs)
