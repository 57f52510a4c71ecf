"""The reversal of momenta: a linear map ρ with ρ² = I that reverses the direction of every solution.

If H(ρy) = H(y) and B(ρy) = −ρB(y)ρᵀ, the field f = B∇H has f(ρy) = −ρf(y). Its flow φ is then reversible,
ρ∘φ_θ∘ρ = φ_{−θ} (Hairer, Lubich and Wanner, *Geometric Numerical Integration*, V.1). The solution of (1.1) is this
flow at the random time θ = t + Σ c_jW_j(t), so it is reversible too.
"""

from __future__ import annotations

import numpy as np

from sepv.problem import Array, PolynomialSystem, Problem, sample_states
from sepv.record import EPS, Polynomial

# If H and B are functions, H(ρy) = H(y) and B(ρy) = −ρB(y)ρᵀ must hold up to a relative error of ROUNDINGS·eps.
ROUNDINGS = 64


def momentum_flip(problem: Problem) -> Array | None:
    """Return the diagonal (d,), ±1, of the map ρ that reverses momenta, or None if ρ does not reverse the flow.

    Momenta are the second half of y if the upper right block of B has a positive trace, as in q̇ = ∂H/∂p, and the first
    half if the trace is negative. Polynomials are compared exactly, functions at a few states.
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
        H, B = problem.hamiltonian(y), problem.structure(y)
        gradient = problem.gradient(y)
        same = abs(problem.hamiltonian(rho * y) - H) <= ROUNDINGS * EPS * (
            abs(H) + float(np.abs(gradient) @ np.abs(y))
        )
        opposite = np.abs(rho[:, None] * problem.structure(rho * y) * rho + B) <= ROUNDINGS * EPS * np.max(
            np.abs(B)
        )
        if not (sign and same and opposite.all()):
            return None
    return rho


def _parity(polynomial: Polynomial, rho: Array) -> float:
    """Return the parity of a polynomial p under ρ: 1 for p(ρy) = p(y), −1 for p(ρy) = −p(y), and 0 for neither."""
    signs = {float(np.prod(rho ** np.array(e))) for e, _ in polynomial.terms}
    return signs.pop() if len(signs) == 1 else float(not signs)
