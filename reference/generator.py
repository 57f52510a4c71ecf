"""The exact power series in h of E g(y(h) − y0): Σ_k h^k/k! (L^k g)(y0)
with the generator L of the system.

For dy = F_0 dt + Σ_j F_j∘dW_j the generator is L = A_0 + ½ Σ_j A_j², A_j = F_j·∇, with F_0 = B∇H,
and F_j = c_j B∇H, c_j G_j∇H (several structures), c_j B∇H_j (several Hamiltonians) or c_j g_j
(additive noise, beside which F_0 may have the friction −Γy). For polynomial data and monomials in
x = y − y0 all coefficients are rational numbers, and (L^k x^α)(y0) obeys a recursion in k. Let
L x^α = Σ_β ℓ_αβ x^β. Because L lowers degrees by two at most,

    (L^(k+1) x^α)(y0) = Σ_β ℓ_αβ (L^k x^β)(y0),    (L^k x^β)(y0) = 0 for |β| > 2k.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache
from math import factorial

from sepv.problem import PolynomialSystem
from sepv.record import Exponents, Polynomial

Rational = dict[Exponents, Fraction]


def _product(p: Rational, q: Rational) -> Rational:
    product: Rational = {}
    for a, s in p.items():
        for b, t in q.items():
            key = tuple(i + j for i, j in zip(a, b, strict=True))
            product[key] = product.get(key, Fraction(0)) + s * t
    return product


def _sum(*parts: Rational) -> Rational:
    total: Rational = {}
    for part in parts:
        for key, value in part.items():
            total[key] = total.get(key, Fraction(0)) + value
    return total


def _slope(p: Rational, i: int) -> Rational:
    """The derivative ∂p/∂x_i of a polynomial p."""
    return {tuple(e - (n == i) for n, e in enumerate(a)): s * a[i] for a, s in p.items() if a[i]}


def _shifted(p: Polynomial, y0: Sequence[Fraction]) -> Rational:
    """The polynomial p expanded about y0: p(y0 + x) as a polynomial in x."""
    d = len(y0)
    total: Rational = {}
    for exponents, coefficient in p.terms:
        term: Rational = {(0,) * d: Fraction(coefficient)}
        for i, e in enumerate(exponents):
            factor = {(0,) * d: y0[i], tuple(int(n == i) for n in range(d)): Fraction(1)}
            for _ in range(e):
                term = _product(term, factor)
        total = _sum(total, term)
    return total


def _field(
    structure: Sequence[tuple[int, int, Polynomial]], H: Polynomial, c: Fraction, y0: Sequence[Fraction]
) -> list[Rational]:
    """The field c B∇H expanded about y0."""
    h = _shifted(H, y0)
    gradient = [_slope(h, i) for i in range(len(y0))]
    components: list[Rational] = [{} for _ in y0]
    scale: Rational = {(0,) * len(y0): c}
    for i, j, entry in structure:
        B = _product(_shifted(entry, y0), scale)
        components[i] = _sum(components[i], _product(B, gradient[j]))
        minus = {key: -value for key, value in _product(B, gradient[i]).items()}
        components[j] = _sum(components[j], minus)
    return components


def _damped(data: PolynomialSystem, y0: Sequence[Fraction], field: list[Rational]) -> list[Rational]:
    """The field with the damping −Γ(y0 + x), Γ = γI for a number γ."""
    d, rate = len(y0), data.damping
    given = rate if isinstance(rate, tuple) else [[rate * (i == j) for j in range(d)] for i in range(d)]
    rows = [[Fraction(float(v)) for v in row] for row in given]
    units = [tuple(int(n == j) for n in range(d)) for j in range(d)]
    return [
        _sum(
            part,
            {(0,) * d: -sum((g * v for g, v in zip(row, y0, strict=True)), Fraction(0))},
            {unit: -g for unit, g in zip(units, row, strict=True)},
        )
        for part, row in zip(field, rows, strict=True)
    ]


def fields(data: PolynomialSystem, y0: Sequence[float]) -> list[list[Rational]]:
    """The fields F_0, F_1, …, F_m of drift and noises, as polynomials in x = y − y0."""
    at = [Fraction(float(v)) for v in y0]
    noise = [Fraction(float(c)) for c in data.noise]
    B, H = data.structure, data.hamiltonian
    drift = _damped(data, at, _field(B, H, Fraction(1), at))
    if data.noise_vectors:
        vectors = zip(data.noise_vectors, noise, strict=True)
        pushes = [[{(0,) * len(at): c * Fraction(float(v))} for v in g] for g, c in vectors]
        return [drift, *pushes]
    pairs = [(G, H) for G in data.noise_structures] or [(B, p) for p in data.noise_hamiltonians]
    pairs = pairs or [(B, H)] * len(noise)
    return [drift, *(_field(G, p, c, at) for (G, p), c in zip(pairs, noise, strict=True))]


def is_linear(data: PolynomialSystem) -> bool:
    """True if all fields have degree 1 at most, so that the generator L does not raise a
    polynomial's degree.
    """
    return all(
        sum(a) <= 1
        for field in fields(data, (0.0,) * data.dimension)
        for p in field
        for a, s in p.items()
        if s
    )


@lru_cache(maxsize=64)
def moments(
    data: PolynomialSystem, y0: tuple[float, ...], monomials: tuple[Exponents, ...], order: int
) -> list[list[Fraction]]:
    """The coefficients of h^0, …, h^order in E (y(h) − y0)^α, for each α;
    the remainder is O(h^(order + 1)).

    Parameters
    ----------
    monomials : the exponents α, a tuple of d integers for each moment.
    """
    F, d = fields(data, y0), len(y0)

    def along(field: list[Rational], g: Rational) -> Rational:
        return _sum(*(_product(field[i], _slope(g, i)) for i in range(d)))

    images: dict[Exponents, Rational] = {}
    known: dict[tuple[int, Exponents], Fraction] = {}

    def image(alpha: Exponents) -> Rational:
        """The generator L applied to the monomial x^α, as a polynomial."""
        if alpha not in images:
            g: Rational = {alpha: Fraction(1)}
            second = _sum(*(along(field, along(field, g)) for field in F[1:]))
            images[alpha] = _sum(along(F[0], g), {key: value / 2 for key, value in second.items()})
        return images[alpha]

    def at_start(k: int, alpha: Exponents) -> Fraction:
        """The value at x = 0 of the k-th power of the generator L applied to the monomial x^α."""
        if sum(alpha) > 2 * k:
            return Fraction(0)
        if k == 0:
            return Fraction(1)
        key = (k, alpha)
        if key not in known:
            known[key] = sum(
                (value * at_start(k - 1, beta) for beta, value in image(alpha).items() if value), Fraction(0)
            )
        return known[key]

    return [[at_start(k, alpha) / factorial(k) for k in range(order + 1)] for alpha in monomials]
