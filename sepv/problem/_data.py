"""Problems as data: polynomials, or a built-in problem's name. Equal data are equal problems."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sepv.record import Polynomial

# The structure of polynomial data: entries (i, j, B_ij) with i < j.
Structure = tuple[tuple[int, int, Polynomial], ...]
Matrix = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class PolynomialSystem:
    """A problem as data: the polynomials H and B_ij with i < j, the coefficients of the noise,
    and Casimirs.

    Attributes
    ----------
    structure : tuple of (i, j, Polynomial) with i < j
        The entries B_ij. The others follow from B_ji = −B_ij, so that B is skew.
    casimirs : tuple of symmetric d × d matrices A, row by row
        C(y) = yᵀAy is a Casimir.
    linear_casimirs : tuple of vectors b
        C(y) = bᵀy is a Casimir.
    polynomial_casimirs : tuple of polynomials
        Casimirs of B of any degree. A Casimir in `casimirs` or `linear_casimirs` need not be listed
        here again.
    nambu : (g, C), optional
        For d = 3: g and C with B(y)v = g(y)(v × ∇C(y)). `structure` must be this B
        (`sepv.problems.nambu_system`).
    noise_structures : tuple of structures, optional
        G_1, …, G_m, one for each noise, each like `structure`. All Casimirs must then be common to
        B and all G_j.
    noise_hamiltonians : tuple of polynomials, optional
        H_1, …, H_m: several Hamiltonians (`sepv.problem.HamiltoniansProblem`), whether or not {H,
        H_j} = 0.
    noise_vectors : tuple of d numbers each, optional
        g_1, …, g_m: additive noise Σ c_j g_j dW_j. Give at most one of the three attributes
        `noise_…`.
    damping : float or matrix
        The rate γ of a damping −γy dt (`sepv.problem.DampedProblem`), for systems with none of the
        three `noise_…`; or the matrix Γ of a friction −Γy dt, row by row, for systems with
        `noise_vectors` or `noise_hamiltonians`, or without noise.
    invariants : tuple of (name, polynomial)
        Other functions I with LI = σ − λI, as in `Problem`.
    """

    dimension: int
    hamiltonian: Polynomial
    structure: Structure
    noise: tuple[float, ...] = (1.0,)
    casimirs: tuple[Matrix, ...] = ()
    linear_casimirs: tuple[tuple[float, ...], ...] = ()
    polynomial_casimirs: tuple[Polynomial, ...] = ()
    nambu: tuple[Polynomial, Polynomial] | None = None
    noise_structures: tuple[Structure, ...] = ()
    noise_hamiltonians: tuple[Polynomial, ...] = ()
    noise_vectors: Matrix = ()
    damping: Any = 0.0  # float | Matrix
    invariants: tuple[tuple[str, Polynomial], ...] = ()


@dataclass(frozen=True)
class NamedProblem:
    """A built-in problem, such as the four problems of the paper,
    given by its name and its parameters.
    """

    name: str
    parameters: tuple[tuple[str, tuple[float, ...]], ...] = ()
