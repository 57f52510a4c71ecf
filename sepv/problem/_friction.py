"""Friction with additive noise: Langevin dynamics dq = M⁻¹p dt, dp = (−∇V − γp)
dt + σ dW at a temperature.

The drift has the channels B∇H and −Γy, where the matrix Γ acts on p alone, and each noise is a
constant vector c_j g_j in p. With B = J and H = ½ pᵀM⁻¹p + V(q) the density e^{−H/kT} is stationary
if and only if

    Σ_j c_j² g_j g_jᵀ = kT (ΓM + MΓᵀ)                                                            (F)

in the components of p: fluctuation and dissipation (G. A. Pavliotis, Stochastic Processes and
Applications, 2014, §6.1). For Γ = γ and a diagonal M these are noises √(2γkT m_k) dW_k, one for
each momentum.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sepv._arguments import is_number
from sepv.core.arrays import EPS, Array, matvec
from sepv.errors import ProblemError, UsageError
from sepv.problem._data import Matrix, PolynomialSystem
from sepv.problem._facts import damping_matrix, noise_vectors
from sepv.problem._hamiltonians import HamiltoniansProblem
from sepv.problem._mechanics import Mechanics, mechanics
from sepv.problem._problem import Problem, constant

# The relative difference of both sides of (F), entry by entry, that counts as rounding: σ is a
# rounded square root.
BALANCE_TOLERANCE = 64 * EPS


def friction(problem: Problem, rate: ArrayLike, temperature: float, name: str = "") -> HamiltoniansProblem:
    """The Langevin dynamics of a mechanical problem: its H and initial state,
    with friction and the noise of (F).

    Parameters
    ----------
    problem : Problem
        A problem with H = ½ pᵀM⁻¹p + V(q) and B = ±J (`mechanics`). Its own noise is left out.
    rate : float, (n,) or (n, n)
        The rate γ ≥ 0 of −γp, a rate for each degree of freedom, or the matrix of the friction
        of p.
    temperature : float
        kT ≥ 0, in units of energy.

    Raises
    ------
    UsageError
        If the problem is not mechanical.
    ProblemError
        If kT is not a number ≥ 0, or (F) has no solution: ΓM + MΓᵀ must be positive definite, or
        diagonal and ≥ 0.

    Examples
    --------
    >>> import numpy as np
    >>> import sepv
    >>> trap = sepv.problems.harmonic_trap((1.0,))
    >>> problem = sepv.problem.friction(trap, rate=0.5, temperature=2.0)
    >>> problem.c.tolist(), problem.damping
    ([1.4142135623730951], ((0.0, 0.0), (0.0, 0.5)))
    >>> path = sepv.integrate("baoab", problem, h=0.125, T=4.0, seed=1)
    """
    system = mechanics(problem)
    n = system.degrees
    if not (is_number(temperature) and temperature >= 0):
        raise ProblemError(
            expected="temperature: kT, a number ≥ 0",
            received=f"{temperature!r:.80}",
            remedy="temperature=1.0",
        )
    rates = np.asarray(rate, dtype=np.float64)
    Gamma = constant("rate", rates if rates.ndim == 2 else np.diag(rates * np.ones(n)), (n, n))
    sigma = _square_root(temperature * (Gamma @ system.mass + system.mass @ Gamma.T))
    c = np.linalg.norm(sigma, axis=0)
    P = system.join(np.zeros((n, n)), np.eye(n))
    parts: dict[str, Any] = {f.name: getattr(problem, f.name) for f in fields(Problem) if f.init}
    parts |= {"noise": tuple(c.tolist()), "name": name or problem.name}
    channels: dict[str, Any] = {
        "noise_vectors": _rows((P @ (sigma / c)).T),
        "damping": _rows(P @ Gamma @ P.T),
    }
    data = problem.data
    if isinstance(data, PolynomialSystem):
        parts["data"] = PolynomialSystem(2 * n, data.hamiltonian, data.structure, parts["noise"], **channels)
    else:
        parts["data"] = None
    return HamiltoniansProblem(**parts, **channels, check=False)


def _rows(A: Array) -> Matrix:
    return tuple(map(tuple, A.tolist()))


def _square_root(D: Array) -> Array:
    """The matrix σ (n, m), σσᵀ = D, with a positive diagonal: of a positive definite D,
    or of a diagonal D ≥ 0.
    """
    if np.array_equal(D, np.diag(np.diag(D))) and np.all(np.diag(D) >= 0):
        return np.diag(np.sqrt(np.diag(D)))[:, np.diag(D) > 0]
    try:
        return np.asarray(np.linalg.cholesky(D))
    except np.linalg.LinAlgError as error:
        raise ProblemError(
            expected="kT(ΓM + MΓᵀ) positive definite, or diagonal and ≥ 0: the covariance of the noise in p",
            received=f"{D.tolist()!r:.120}",
            remedy="give rates γ ≥ 0",
        ) from error


@dataclass(frozen=True, eq=False)
class Langevin:
    """The parts of a problem with the friction −γp and constant noise in p,
    for a step of a splitting method.

    Attributes
    ----------
    mechanics : Mechanics
        M and V.
    rate : float
        γ.
    pushes : (n, m)
        The vectors c_j g_j of the noises, in components of p.
    """

    mechanics: Mechanics
    rate: float
    pushes: Array

    def pushed(self, dW: Array) -> Array:
        """The noise Σ_j c_j g_j ΔW_j in p, (n, ...), for increments dW (m, ...)."""
        if not self.pushes.size:
            return np.zeros((len(self.pushes), *dW.shape[1:]))
        return matvec(self.pushes.reshape(*self.pushes.shape, *(1,) * (dW.ndim - 1)), dW)

    def refreshed(self, p: Array, t: float, dW: Array) -> Array:
        """The exact solution of dp = −γp dt + σ dW after the time t, in distribution,
        for dW of variance t.

        It is e^{−γt}p + √((1 − e^{−2γt})/(2γt)) σ dW.
        """
        x = 2 * self.rate * t
        return np.asarray(np.exp(-0.5 * x) * p + np.sqrt(-np.expm1(-x) / x if x else 1.0) * self.pushed(dW))


@lru_cache(maxsize=1024)
def langevin(problem: Problem) -> Langevin:
    """The `Langevin` of a problem, computed once.

    Raises
    ------
    UsageError
        If the problem is not mechanical, its friction is not −γp on all momenta, or its noise moves
        positions.
    """
    system, vectors, Gamma = mechanics(problem), noise_vectors(problem), damping_matrix(problem)
    n = system.degrees
    P = system.join(np.zeros((n, n)), np.eye(n))
    rate = float(Gamma[np.argmax(P[:, 0]), np.argmax(P[:, 0])])
    moved = vectors.T * problem.c if problem.noises else np.zeros((2 * n, 0))
    q, p = system.split(moved) if len(vectors) == problem.noises else (np.ones(1), moved)
    if not np.array_equal(Gamma, rate * P @ P.T) or q.any():
        raise UsageError(
            expected="friction −γp on all momenta, and noise by constant vectors in the momenta",
            received=f"{problem.name}, Γ = {Gamma.tolist()}, noise_vectors = {vectors.tolist()}",
            remedy="make it by sepv.problem.friction(problem, rate, temperature)",
        )
    return Langevin(system, rate, p)


def temperature(problem: Problem) -> float:
    """kT of a Langevin problem, by (F).

    Raises
    ------
    UsageError
        If the problem is not one of `langevin` with γ > 0, or its noise is not that of one
        temperature.
    """
    own = langevin(problem)
    wanted, D = 2 * own.rate * own.mechanics.mass, own.pushes @ own.pushes.T
    kT = float(np.trace(D) / np.trace(wanted)) if own.rate > 0 else float("nan")
    if not np.all(np.abs(D - kT * wanted) <= BALANCE_TOLERANCE * kT * np.max(np.abs(wanted))):
        raise UsageError(
            expected="noise in balance with the friction, Σ c_j² g_j g_jᵀ = 2γkT M with γ > 0",
            received=f"{problem.name}: {D.tolist()} for 2γM = {wanted.tolist()}",
            remedy="make it by sepv.problem.friction(problem, rate, temperature)",
        )
    return kT
