"""Systems on so(4)*, su(3)* and su(N)*, W′ = [W, M] for matrices W, with Casimirs tr Wᵏ.

`sepv.problems._matrix_algebras` defines the coordinates and the Casimirs. The coefficients of B are
whole numbers.

- Manakov's top on so(4)*: H_0 = ½ Σ_{j<k} y_jk²/(I_j + I_k), the free rigid body in dimension four.
  Its Casimirs are quadratic: ½|W|² and the Pfaffian.
- A top on su(3)*, H_0 = ½ Σ w_a y_a², with W = iP, a quadratic Casimir C_2 = −½ tr W² and a cubic
  one, C_3 = tr P³.
- Euler's equations on the sphere after V. Zeitlin (Physica D 49, 1991; Phys. Rev. Lett. 93, 2004).
  The vorticity is a matrix P with W = iP in su(N), the stream function is Δ_N⁻¹P, and H_0 = ½⟨W,
  Δ_N⁻¹W⟩. The Laplacian of J. Hoppe and S.-T. Yau, Δ_N P = Σ_a [S_a, [S_a, P]] with the spin
  matrices S_1, S_2, S_3 of size N, has the sphere's eigenvalues l(l + 1), l = 1, …, N − 1. The N
  − 1 Casimirs tr Pᵏ approximate integrals of powers of the vorticity.

The noises have linear Hamiltonians, which describe transport by a fixed velocity and do not commute
with H_0. S. Ephrati, E. Jansson, A. Lang and E. Luesink (arXiv 2408.16701) treat the rigid body,
its generalisation, and Euler's equations on the sphere. Only the abstract and introduction of their
paper were read: the numbers here are not theirs.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from sepv.problem import Array, PolynomialSystem, Problem
from sepv.problems import _matrix_algebras as algebras
from sepv.problems._polynomial_system import started
from sepv.record import Polynomial, poly


def matrix_system(
    name: str, hamiltonian: Polynomial, noise: Sequence[float], others: Sequence[Polynomial]
) -> PolynomialSystem:
    """The system with B and all Casimirs of an algebra ("so(4)", "su(3)"),
    H_0 = `hamiltonian` and H_j in `others`.
    """
    quadratic, further = algebras.casimirs(name)
    B, c, H = algebras.structure(name), tuple(noise), tuple(others)
    return PolynomialSystem(
        len(quadratic[0]), hamiltonian, B, c, quadratic, polynomial_casimirs=further, noise_hamiltonians=H
    )


def manakov_top(
    inertia: Sequence[float] = (1.0, 1.5, 2.5, 4.0), noise: Sequence[float] = (0.5, 0.25)
) -> Problem:
    """The free rigid body in dimension four with two noises,
    whose Hamiltonians are H_1 = y_12 + y_24 and H_2 = y_23.

    The initial state is y_12, …, y_34 = 0.6, −0.3, 0.2, 0.5, −0.4, 0.3.
    """
    H = poly.squares([1 / (inertia[j] + inertia[k]) for j, k in combinations(range(4), 2)])
    others = [poly.linear((1, 0, 0, 0, 1, 0)), poly.linear((0, 0, 0, 1, 0, 0))]
    return started(matrix_system("so(4)", H, noise, others), "manakov-top", (0.6, -0.3, 0.2, 0.5, -0.4, 0.3))


def su3_top(
    weights: Sequence[float] = (1.0, 0.5, 0.75, 0.25, 1.25, 0.5, 1.0, 0.75),
    noise: Sequence[float] = (0.25, 0.25),
) -> Problem:
    """A top on su(3)* with two noises, whose Hamiltonians are H_1 = P_11 and H_2 = Re P_12 + Im
    P_23, for matrices iP.

    The initial state has P_11, P_22 = 0.5, −0.2 and P_12, P_13, P_23 = 0.3 + 0.1i, −0.4 + 0.25i,
    0.2 − 0.3i.
    """
    others = [poly.linear((1, *(0,) * 7)), poly.linear((0, 0, 1, 0, 0, 0, 0, 1))]
    data = matrix_system("su(3)", poly.squares(weights), noise, others)
    return started(data, "su3-top", (0.5, -0.2, 0.3, -0.4, 0.2, 0.1, 0.25, -0.3))


def zeitlin(size: float = 4, noise: Sequence[float] = (0.25, 0.25)) -> Problem:
    """Euler's equations on the sphere, truncated to su(N)*, N = `size`, with two noises:
    H_1 = P_11, H_2 = Re P_12.

    The entries of the initial state alternate in sign, with absolute values from 1/4 to 1. N is
    from 3 to 8.
    """
    n = int(size)
    d = n * n - 1
    inverse = _inverse_laplacian(n)
    terms = {(i, j): inverse[i, j] for i in range(d) for j in range(d) if inverse[i, j]}
    variables = [poly.variable(d, k).terms[0][0] for k in range(d)]
    H = poly.polynomial(
        d, [(tuple(np.add(variables[i], variables[j])), 0.5 * v) for (i, j), v in terms.items()]
    )
    others = [poly.linear([float(k == place) for k in range(d)]) for place in (0, n - 1)]
    start = [(-1.0) ** k * (1 + (3 * k) % 4) / 4 for k in range(d)]
    return started(matrix_system(f"su({n})", H, noise, others), "zeitlin", start)


def _inverse_laplacian(n: int) -> Array:
    """The matrix A (d, d) for which ½yᵀAy is Zeitlin's Hamiltonian ½⟨W,
    Δ_N⁻¹W⟩ of the matrix W in su(N), N = n.

    Entries are rounded to multiples of 2⁻⁴⁰, so that they are the same numbers on every machine.
    """
    algebra = algebras.unitary(n)
    z = 0.5 * (n - 1) - np.arange(n)
    raised = np.diag(np.sqrt(np.arange(1.0, n) * (n - np.arange(1.0, n))), 1)
    spin = (np.diag(z), 0.5 * (raised + raised.T), 0.5j * (raised.T - raised))
    images = sum(_twice(S, algebra.basis) for S in spin)
    gram = -0.5 * np.einsum("ajk,bkj->ab", algebra.basis, algebra.basis).real
    A = gram @ np.linalg.inv(algebra.coordinates(images))
    return np.asarray(np.rint(0.5 * (A + A.T) * 2.0**40) / 2.0**40)


def _twice(S: Array, W: Array) -> Array:
    """The double commutator [S, [S, W]]."""
    once = S @ W - W @ S
    return np.asarray(S @ once - once @ S)
