"""Lie algebras of matrices, so(n) and su(n), with coordinates in which B is linear with whole
coefficients.

A state y stands for W = Σ y_a E_a, with a basis E_a. So y_a = ⟨E*_a, W⟩ for its dual basis E*_a and
⟨A, B⟩ = −½ tr AB. With M = Σ ∂H/∂y_b E*_b and B_ab(y) = ⟨E*_a, [W, E*_b]⟩, the system y′ = B(y)∇H
is W′ = [W, M]. Its flow keeps the eigenvalues of W, so that every tr Wᵏ is a Casimir. All Casimirs
of so(3) and so(4) are functions of quadratic ones (|y|², and the Pfaffian of so(4)). The n − 1
Casimirs of su(n) are tr W², …, tr Wⁿ.

- so(3), n times: a 3 × 3 matrix for each block of three components of y, in which B(y)v = y × v.
- so(n): y_jk = W_jk, j < k.
- su(n): W = iP, P = P† with trace zero; y holds P_11, …, P_{n−1,n−1}, then the Re P_jk, then the Im
  P_jk, j < k.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from sepv.errors import Skipped
from sepv.problem import Array, Matrix, Problem, Structure
from sepv.problems._common import HAT
from sepv.record import EPS, Polynomial, poly


class MatrixAlgebra(NamedTuple):
    """A Lie algebra of n × n matrices, or the product of several `copies` of it.

    `basis` (d, n, n) holds the basis E_a of one copy, and `dual` (d, n, n) its dual basis: −½ tr
    E*_aE_b = δ_ab.
    """

    name: str
    basis: Any
    dual: Any
    copies: int = 1

    def matrix(self, y: Array) -> Any:
        """The matrices W = Σ y_a E_a, (M·copies, n, n), of states y (copies·d, M)."""
        return _combined(self._lanes(y), self.basis)

    def dual_matrix(self, m: Array) -> Any:
        """The matrices Σ_b m_b E*_b in the dual basis, (M·copies, n, n),
        for gradients m (copies·d, M).
        """
        return _combined(self._lanes(m), self.dual)

    def coordinates(self, W: Any) -> Array:
        """The states y (copies·d, M) of matrices W (M·copies, n, n);
        a part of W outside the algebra is dropped.
        """
        d = len(self.dual)
        traces = _combined(W.reshape(len(W), -1), self.dual.swapaxes(1, 2).reshape(d, -1).T)
        return np.ascontiguousarray(-0.5 * traces.real.reshape(-1, self.copies * d).T)

    def _lanes(self, y: Array) -> Array:
        """The coordinates (M·copies, d) of the matrices of states y (copies·d, M):
        one row for each matrix.
        """
        return y.T.reshape(-1, len(self.basis))


def product(X: Any, M: Any) -> Any:
    """The k products X M of matrices in two stacks (k, n, n), summed in the same order for every k,
    unlike by BLAS.
    """
    return sum(X[:, :, k, None] * M[:, k, None, :] for k in range(X.shape[1]))


def _combined(weights: Any, parts: Any) -> Any:
    """The sums Σ_a weights[:, a] parts[a] for weights (k, d), summed in the same order for
    every k.
    """
    return sum(np.multiply.outer(weights[:, a], part) for a, part in enumerate(parts))


@lru_cache(maxsize=16)
def spins(count: int) -> MatrixAlgebra:
    """The product of `count` copies of so(3), with B(y)v = y × v in blocks of three."""
    basis = np.zeros((3, 3, 3))
    for i, j, k, sign in HAT:
        basis[k, i, j], basis[k, j, i] = sign, -sign
    return MatrixAlgebra("so(3)" if count == 1 else f"{count} so(3)", basis, basis, count)


@lru_cache(maxsize=16)
def orthogonal(n: int) -> MatrixAlgebra:
    """The algebra so(n) of skew matrices."""
    pairs = list(combinations(range(n), 2))
    basis = np.zeros((len(pairs), n, n))
    for a, (j, k) in enumerate(pairs):
        basis[a, j, k], basis[a, k, j] = 1.0, -1.0
    return MatrixAlgebra(f"so({n})", basis, basis)


@lru_cache(maxsize=16)
def unitary(n: int) -> MatrixAlgebra:
    """The algebra su(n) of skew-Hermitian matrices with trace zero."""
    pairs, d = list(combinations(range(n), 2)), n * n - 1
    basis, dual = np.zeros((d, n, n), dtype=complex), np.zeros((d, n, n), dtype=complex)
    for j in range(n - 1):
        basis[j, j, j], basis[j, -1, -1] = 1j, -1j
        dual[j] = -2j / n * np.eye(n)
        dual[j, j, j] += 2j
    for a, (j, k) in enumerate(pairs, n - 1):
        basis[a, j, k] = basis[a, k, j] = 1j
        basis[a + len(pairs), j, k], basis[a + len(pairs), k, j] = -1.0, 1.0
    dual[n - 1 :] = basis[n - 1 :]
    return MatrixAlgebra(f"su({n})", basis, dual)


@lru_cache(maxsize=16)
def constants(name: str) -> Array:
    """The structure constants of an algebra: the whole numbers c_abc with B_ab(y) = Σ_c c_abc y_c,
    (d, d, d).
    """
    _, E, D, count = named(name)
    half = -0.5 * np.einsum("ajk,ckl,blj->abc", D, E, D, optimize=True).real
    one, d = np.rint(half - half.swapaxes(0, 1)), len(E)
    tensor = np.zeros((count * d, count * d, count * d))
    for n in range(0, count * d, d):
        tensor[n : n + d, n : n + d, n : n + d] = one
    return tensor


def named(name: str) -> MatrixAlgebra:
    """The algebra called `name`, such as so(4), su(3), or 2 so(3),
    the product of two copies of so(3).
    """
    count, _, rest = name.rpartition(" ")
    kind, n = rest[:2], int(rest[3:-1])
    if n == 3 and kind == "so":
        return spins(int(count or 1))
    return orthogonal(n) if kind == "so" else unitary(n)


def candidates(d: int) -> list[str]:
    """The names of the algebras of dimension d."""
    names = [] if d % 3 else [spins(d // 3).name]
    names += [f"so({n})" for n in range(4, d) if n * (n - 1) // 2 == d]
    return names + [f"su({n})" for n in range(3, d) if n * n - 1 == d]


def algebra_of(problem: Problem, y: Array) -> MatrixAlgebra:
    """The algebra of matrices whose B is the problem's B at the states y (d, M).
    Raises Skipped if there is none.
    """
    B = problem.structure(y)
    for name in candidates(len(y)):
        c = constants(name)
        # The two matrices may differ by a few roundings of terms, because a problem may add the
        # terms in any order.
        if np.all(np.abs(np.tensordot(c, y, 1) - B) <= 8 * EPS * np.tensordot(np.abs(c), np.abs(y), 1)):
            return named(name)
    raise Skipped(
        f"the structure of {problem.name} is not that of so(3) in blocks of three, so(n) or su(n), "
        "in the coordinates of sepv.problems._matrix_algebras"
    )


@lru_cache(maxsize=16)
def structure(name: str) -> Structure:
    """The structure B of an algebra as polynomial data."""
    c = constants(name)
    entries = ((i, j, poly.linear(c[i, j].tolist())) for i, j in combinations(range(len(c)), 2))
    return tuple(entry for entry in entries if entry[2].terms)


@lru_cache(maxsize=16)
def casimirs(name: str) -> tuple[tuple[Matrix, ...], tuple[Polynomial, ...]]:
    """The Casimirs of an algebra: the quadratic ones as matrices, and the others as polynomials.

    They are −½ tr W² (of each block for so(3)). so(4) also has the Pfaffian, and su(n) tr Pᵏ for
    k = 3 … n, W = iP.
    """
    _, E, _, count = named(name)
    n = E.shape[1]
    if name.endswith("so(3)"):
        return tuple(_rows(np.diag(block)) for block in np.eye(count).repeat(3, axis=1)), ()
    matrices = [_rows(-0.5 * np.einsum("ajk,bkj->ab", E, E).real)]
    if name == "so(4)":
        matrices.append(_rows(0.5 * np.fliplr(np.diag([1.0, -1.0, 1.0, 1.0, -1.0, 1.0]))))
    return tuple(matrices), tuple(power_trace(name, k) for k in range(3, n + 1) if name[:2] == "su")


def _rows(A: Array) -> Matrix:
    return tuple(map(tuple, A.tolist()))


def power_trace(name: str, k: int) -> Polynomial:
    """The polynomial tr Pᵏ in y for su(n) with W = iP,
    from products of matrices of complex polynomials.
    """
    P = named(name).basis / 1j
    d, n = P.shape[:2]
    one = [
        [tuple(poly.linear(part[:, j, k].tolist()) for part in (P.real, P.imag)) for k in range(n)]
        for j in range(n)
    ]
    zero, power = poly.polynomial(d, {}), one
    for _ in range(k - 1):
        power = [
            [_sum([_product(power[i][j], one[j][l]) for j in range(n)], zero) for l in range(n)]
            for i in range(n)
        ]
    return poly.add(zero, *(power[i][i][0] for i in range(n)))


# The real and the imaginary part of a complex polynomial.
Complex = tuple[Polynomial, ...]


def _product(p: Complex, q: Complex) -> Complex:
    real = poly.add(poly.multiply(p[0], q[0]), poly.scale(-1.0, poly.multiply(p[1], q[1])))
    return real, poly.add(poly.multiply(p[0], q[1]), poly.multiply(p[1], q[0]))


def _sum(parts: list[Complex], zero: Polynomial) -> Complex:
    return tuple(poly.add(zero, *(p[n] for p in parts)) for n in (0, 1))
