"""Polynomial systems in three dimensions with any Casimir: B(y)v = g(y)(v × ∇C(y)) as data."""

from __future__ import annotations

from sepv.errors import ProblemError
from sepv.problem import PolynomialSystem, Structure
from sepv.record import poly


def nambu_system(
    hamiltonian: poly.Polynomial,
    factor: poly.Polynomial,
    casimir: poly.Polynomial,
    noise: tuple[float, ...] = (1.0,),
) -> PolynomialSystem:
    """The polynomial system dy = g ∇H × ∇C (dt + Σ c_j∘dW_j) in dimension three as data,
    with any Casimir C.

    A homogeneous C of degree 2 is also listed in `casimirs`, and one of degree 1 in
    `linear_casimirs`.

    Raises
    ------
    ProblemError
        If one of H, g, C is not a polynomial in three variables.
    """
    for name, p in (("hamiltonian", hamiltonian), ("factor", factor), ("casimir", casimir)):
        if p.dimension != 3:
            raise ProblemError(
                expected=f"{name}: a polynomial in 3 variables",
                received=f"{p.dimension} variables",
                remedy="B(y)v = g(y)(v × ∇C(y)) is about dimension 3",
            )
    degrees = {sum(e) for e, _ in casimir.terms}
    slope = poly.gradient(casimir)
    matrix = tuple(tuple(0.5 * _value(poly.differentiate(g, j)) for j in range(3)) for g in slope)
    quadratic = (matrix,) if degrees == {2} else ()
    linear = (tuple(_value(g) for g in slope),) if degrees == {1} else ()
    return PolynomialSystem(
        3, hamiltonian, _structure(factor, casimir), noise, quadratic, linear, nambu=(factor, casimir)
    )


def _value(p: poly.Polynomial) -> float:
    """The value of a constant polynomial."""
    return sum((c for _, c in p.terms), 0.0)


def _structure(factor: poly.Polynomial, casimir: poly.Polynomial) -> Structure:
    """The structure of B(y)v = g(y)(v × ∇C(y)): B_12 = g ∂₃C, B_13 = −g ∂₂C, B_23 = g ∂₁C."""
    entries = [
        (i, j, poly.multiply(factor, poly.scale(sign, poly.differentiate(casimir, k))))
        for i, j, k, sign in ((0, 1, 2, 1.0), (0, 2, 1, -1.0), (1, 2, 0, 1.0))
    ]
    return tuple(entry for entry in entries if entry[2].terms)


def check_nambu(data: PolynomialSystem) -> None:
    """Raise ProblemError if the structure of a system with `nambu` = (g, C)
    is not the one that g and C define.
    """
    if data.nambu is None:
        return
    if data.dimension != 3 or sorted(data.structure) != sorted(_structure(*data.nambu)):
        raise ProblemError(
            expected="structure to be g(y)(v × ∇C(y)) for nambu = (g, C), in dimension 3",
            received=f"dimension {data.dimension}, structure {[(i, j, str(p)) for i, j, p in data.structure]}",
            remedy="make the system with sepv.problems.nambu_system(H, g, C)",
        )
