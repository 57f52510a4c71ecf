"""Mechanical systems, H = ½ pᵀM⁻¹p + V(q) with a constant mass matrix M and B = J, split into M,
V and derivatives.

    q̇ = M⁻¹p,  ṗ = −∇V(q);  with v = M⁻¹p:  q̇ = v,  Mv̇ = −∇V(q)

`Mechanics.split` and `join` work for y = (q, p) and for y = (p, q): the sign of B shows the order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from sepv.core.arrays import EPS, Array, matvec
from sepv.errors import UsageError
from sepv.problem._checks import sample_states
from sepv.problem._data import PolynomialSystem
from sepv.problem._problem import Problem


@dataclass(frozen=True, eq=False)
class Mechanics:
    """The parts of a mechanical system of n degrees of freedom, for states (2n, ...) and q, p,
    v of shape (n, ...).

    Attributes
    ----------
    mass, inverse_mass : (n, n)
        M and M⁻¹, symmetric and positive definite.
    positions_first : bool
        True for y = (q, p), False for y = (p, q).

    Examples
    --------
    Störmer and Verlet's method for any mechanical problem:

    >>> import sepv
    >>> from sepv.problem import mechanics
    >>> def verlet(problem, y, h, dW):
    ...     system, dt = mechanics(problem), problem.random_step(h, dW)
    ...     q, p = system.split(y)
    ...     p = p + dt / 2 * system.force(q)
    ...     q = q + dt * system.velocity(p)
    ...     return system.join(q, p + dt / 2 * system.force(q))
    >>> claims = ["poisson-map:constant", "symmetry"]
    >>> scheme = sepv.Scheme("verlet", verlet, claims=claims, systems="mechanical")
    >>> sepv.verify(scheme, laws="symmetry").finding("symmetry").verdict.text
    'holds'
    """

    problem: Problem
    mass: Array
    inverse_mass: Array
    positions_first: bool

    @property
    def degrees(self) -> int:
        """The number n of degrees of freedom."""
        return len(self.mass)

    def split(self, y: Array) -> tuple[Array, Array]:
        """The positions and momenta (q, p) of a state y."""
        first, second = y[: self.degrees], y[self.degrees :]
        return (first, second) if self.positions_first else (second, first)

    def join(self, q: Array, p: Array) -> Array:
        """The state y of positions and momenta."""
        return np.concatenate([q, p] if self.positions_first else [p, q])

    def potential(self, q: Array) -> Array:
        """The potential V(q), (...); it includes the constant term of H."""
        return self.problem.hamiltonian(self.join(q, np.zeros_like(q)))

    def force(self, q: Array) -> Array:
        """The force −∇V(q), (n, ...)."""
        return -self.split(self.problem.gradient(self.join(q, np.zeros_like(q))))[0]

    def velocity(self, p: Array) -> Array:
        """The velocity v = M⁻¹p, (n, ...)."""
        return _product(self.inverse_mass, p)

    def momentum(self, v: Array) -> Array:
        """The momentum p = Mv, (n, ...)."""
        return _product(self.mass, v)


def _product(A: Array, v: Array) -> Array:
    """The product A v for v (n,) or (n, M), with the same bits for a state alone and in a batch."""
    return matvec(A.reshape(*A.shape, *(1,) * (v.ndim - 1)), v)


@lru_cache(maxsize=1024)
def mechanics(problem: Problem) -> Mechanics:
    """The `Mechanics` of a mechanical problem: mass matrix, potential and force,
    computed once for each problem.

    The noises do not matter here: they act through the step Δ = h + Σ c_jΔW_j
    (`Problem.random_step`).

    Raises
    ------
    UsageError
        If B is neither J nor −J, or H is not ½ pᵀM⁻¹p + V(q). The form of H is tested at a few
        states, and for polynomial data term by term too.
    """
    d = problem.dimension
    n, states = d // 2, [np.asarray(y, dtype=np.float64) for y in sample_states(problem)]
    J = np.kron([[0.0, 1.0], [-1.0, 0.0]], np.eye(n))
    B = [problem.structure(y) for y in states]
    signed = float(B[0][0, n]) if n else 0.0
    first = signed > 0
    if d % 2 or abs(signed) != 1 or not all(np.array_equal(b, signed * J) for b in B):
        raise _not_mechanical(problem, "B = ((0, I), (−I, 0)) for y = (q, p), or minus that for y = (p, q)",
                              f"B = {B[0].tolist()!r:.120} at y = {states[0].tolist()}")  # fmt: skip
    p_at, q_at = (slice(n, d), slice(0, n)) if first else (slice(0, n), slice(n, d))
    data = problem.data
    if isinstance(data, PolynomialSystem):
        for e, _ in data.hamiltonian.terms:
            if sum(e[p_at]) and (sum(e[p_at]) != 2 or sum(e[q_at])):
                raise _not_mechanical(
                    problem, "each term of H in p alone and quadratic, or in q alone", f"{e}"
                )
    units = []
    for k in range(*p_at.indices(d)):
        y = states[0].copy()
        y[p_at] = 0.0
        y[k] = 1.0
        units.append(problem.gradient(y)[p_at])
    W = np.array(units)
    usual = W / (np.max(np.abs(W)) or 1.0)
    if not (np.allclose(W, W.T, rtol=8 * EPS, atol=0.0) and np.all(np.linalg.eigvalsh(usual) > 0)):
        raise _not_mechanical(
            problem, "∂H/∂p = M⁻¹p with M symmetric and positive definite", f"M⁻¹ = {W.tolist()}"
        )
    for y in states:
        still = y.copy()
        still[p_at] = 0.0
        with np.errstate(all="ignore"):
            moving, resting, size = problem.gradient(y), problem.gradient(still), np.abs(W) @ np.abs(y[p_at])
        if not np.all(np.isfinite(moving)):  # a sample state far from the system's usual ones
            continue
        apart = np.abs(moving[p_at] - W @ y[p_at]) - 64 * d * EPS * size
        apart_q = np.abs(moving[q_at] - resting[q_at]) - 64 * d * EPS * np.max(np.abs(resting[q_at]))
        if not (np.all(apart <= 0) and np.all(apart_q <= 0)):
            raise _not_mechanical(
                problem, "∇H = (∇V(q), M⁻¹p)", f"∇H = {moving.tolist()} at y = {y.tolist()}"
            )
    return Mechanics(problem, _inverted(W), W, first)


def _inverted(W: Array) -> Array:
    """The inverse of the matrix W, refined in long double, so that entries with few bits are
    exact.
    """
    wide, inverse = W.astype(np.longdouble), np.linalg.inv(W).astype(np.longdouble)
    for _ in range(2):
        inverse = inverse + inverse @ (np.eye(len(W)) - wide @ inverse)
    return np.asarray(inverse.astype(np.float64))


def _not_mechanical(problem: Problem, expected: str, received: str) -> UsageError:
    return UsageError(
        expected=f"a mechanical problem, H = ½ pᵀM⁻¹p + V(q): {expected}",
        received=f"{problem.name}, {received}",
        remedy="take problems of the family mechanical (-p mechanical), or raise sepv.Skipped for others",
    )
