"""Polynomial systems in three dimensions with any Casimir: B(y)v = g(y)(v × ∇C(y)) as data."""

from __future__ import annotations

from sepv.errors import ProblemError
from sepv.problem import PolynomialSystem
from sepv.record import Polynomial
from sepv.record import _polynomial as poly


def nambu_system(
    hamiltonian: Polynomial, factor: Polynomial, casimir: Polynomial, noise: tuple[float, ...] = (1.0,)
) -> PolynomialSystem:
    """dy = g ∇H × ∇C (dt + Σ c_j∘dW_j).

    A homogeneous C of degree 2 is listed among the quadratic Casimirs too, of degree 1 among the linear ones.

    Raises
    ------
    ProblemError
        Where one of H, g, C is not a polynomial in three variables.
    """
    for name, p in (("hamiltonian", hamiltonian), ("factor", factor), ("casimir", casimir)):
        if p.dimension != 3:
            raise ProblemError(
                expected=f"{name}: a polynomial in 3 variables",
                received=f"{p.dimension} variables",
                remedy="B(y)v = g(y)(v × ∇C(y)) is about dimension 3",
            )
    degrees = {sum(e) for e, _ in casimir.terms}
    quadratic: tuple[tuple[tuple[float, ...], ...], ...] = ()
    linear: tuple[tuple[float, ...], ...] = ()
    if degrees == {2}:
        quadratic = (_matrix(casimir),)
    elif degrees == {1}:
        linear = (tuple(dict(casimir.terms).get(_unit(i), 0.0) for i in range(3)),)
    return PolynomialSystem(
        3, hamiltonian, _structure(factor, casimir), noise, quadratic, linear, nambu=(factor, casimir)
    )


def _structure(factor: Polynomial, casimir: Polynomial) -> tuple[tuple[int, int, Polynomial], ...]:
    """B_12 = g ∂₃C, B_13 = −g ∂₂C, B_23 = g ∂₁C."""
    entries = [
        (i, j, poly.multiply(factor, poly.scale(sign, poly.differentiate(casimir, k))))
        for i, j, k, sign in ((0, 1, 2, 1.0), (0, 2, 1, -1.0), (1, 2, 0, 1.0))
    ]
    return tuple(entry for entry in entries if entry[2].terms)


def check_nambu(data: PolynomialSystem) -> None:
    """Complain where `structure` is not that of (g, C)."""
    if data.nambu is None:
        return
    if data.dimension != 3 or sorted(data.structure) != sorted(_structure(*data.nambu)):
        raise ProblemError(
            expected="structure to be g(y)(v × ∇C(y)) for nambu = (g, C), in dimension 3",
            received=f"dimension {data.dimension}, structure {[(i, j, str(p)) for i, j, p in data.structure]}",
            remedy="make the system with sepv.problems.nambu_system(H, g, C)",
        )


def _unit(i: int) -> tuple[int, ...]:
    return tuple(int(i == k) for k in range(3))


def _matrix(casimir: Polynomial) -> tuple[tuple[float, ...], ...]:
    A = [[0.0] * 3 for _ in range(3)]
    for exponents, coefficient in casimir.terms:
        i, *rest = (k for k, e in enumerate(exponents) for _ in range(e))
        A[i][rest[0]] += 0.5 * coefficient
        A[rest[0]][i] += 0.5 * coefficient
    return tuple(tuple(row) for row in A)
