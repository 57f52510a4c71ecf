"""Energy and two Casimirs that are not quadratic, in dimension four, all kept to rounding.

Cohen and Dujardin (2014), §5, ask for schemes that keep more invariants. Let B be a totally antisymmetric tensor
contracted with gradients of Casimirs, B_ij = Σ_kl ε_ijkl ∂_kC ∂_lD. Average all three gradients along the segment,
∇̄F = ∫₀¹∇F(y0 + τ(y1 − y0))dτ. This gives the scheme

    y1 = y0 + Δ ε(·, ∇̄H, ∇̄C, ∇̄D),   F(y1) − F(y0) = ∇̄Fᵀ(y1 − y0) = 0   for F = H, C, D,

because the contraction is orthogonal to each of the three gradients. For quadratic C and D the scheme is (2.1).

    python examples/casimirs_in_four_dimensions.py
    sepv verify examples/casimirs_in_four_dimensions.py:step -p examples/casimirs_in_four_dimensions.py:problem
"""

from __future__ import annotations

from itertools import permutations

import numpy as np

import sepv

# Gauss-Legendre quadrature with three nodes, which is exact for gradients of polynomials of degree six.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(3)
NODES, WEIGHTS = (NODES + 1) / 2, WEIGHTS / 2
EPSILON = np.zeros((4, 4, 4, 4))
for order in permutations(range(4)):
    EPSILON[order] = np.linalg.det(np.eye(4)[list(order)])


def hamiltonian(y):
    return 0.5 * y[0] ** 2 + y[1] ** 2 + 0.25 * y[2] ** 4 + 0.5 * y[0] * y[3]


def hamiltonian_gradient(y):
    return np.stack([y[0] + 0.5 * y[3], 2 * y[1], y[2] ** 3, 0.5 * y[0]])


def first(y):
    """C = y1²/2 + y2⁴/4 + y3²/2 + y4²/2."""
    return 0.5 * y[0] ** 2 + 0.25 * y[1] ** 4 + 0.5 * y[2] ** 2 + 0.5 * y[3] ** 2


def first_gradient(y):
    return np.stack([y[0], y[1] ** 3, y[2], y[3]])


def second(y):
    """D = y1y2 + y3³/3 + y4³/3."""
    return y[0] * y[1] + y[2] ** 3 / 3 + y[3] ** 3 / 3


def second_gradient(y):
    return np.stack([y[1], y[0], y[2] ** 2, y[3] ** 2])


def structure(y):
    return np.einsum("ijkl,k...,l...->ij...", EPSILON, first_gradient(y), second_gradient(y))


problem = sepv.Problem(
    dimension=4,
    structure=structure,
    hamiltonian=hamiltonian,
    gradient=hamiltonian_gradient,
    noise=(0.5,),
    degree=4,
    initial=(0.5, 0.75, -0.5, 0.25),
    name="two Casimirs in four dimensions",
)


def average(gradient, y, z):
    """∫₀¹ gradient(y + τz) dτ."""
    return sum(weight * gradient(y + node * z) for node, weight in zip(NODES, WEIGHTS, strict=True))


def step(problem, y, h, dW):
    """The step for a state (4,), by fixed-point iteration until it no longer moves."""
    if problem.dimension != 4 or not problem.name.startswith("two Casimirs"):
        raise sepv.Skipped("only for the problem of this file: its Casimirs are written down here")
    delta, z, before = h + problem.c @ dW, np.zeros(4), np.inf
    for _ in range(200):
        means = [average(g, y, z) for g in (hamiltonian_gradient, first_gradient, second_gradient)]
        # B_ij g_j = ε_ijkl g_j ∂_kC ∂_lD.
        new = delta * np.einsum("ijkl,j,k,l->i", EPSILON, *means)
        moved, z = np.max(np.abs(new - z)), new
        if moved == 0 or (moved >= before and moved < 1e-15):
            return y + z
        before = moved
    raise ArithmeticError("the fixed-point iteration did not settle: take a smaller step")


def main() -> None:
    rng = np.random.default_rng(1)
    y0 = np.array(problem.initial)
    for name, scheme in (("averaged gradients", step), ("(2.1)", sepv.schemes.energy_preserving.step)):
        y = y0
        for dW in 0.125 * rng.standard_normal((1000, 1)):
            y = scheme(problem, y, 1 / 64, dW)
        defects = ", ".join(
            f"{label} {abs(F(y) - F(y0)):.1e}"
            for label, F in (("H", hamiltonian), ("C", first), ("D", second))
        )
        print(f"{name}: after 1000 steps {defects}")


if __name__ == "__main__":
    main()
