"""Sweeps and a step of Newton's iteration where the equation is z = Δ P(ȳ), ȳ = y + z/2, with short polynomials P.

(2.1) and the midpoint rule are of that kind where H is quadratic and B linear. The unknown is ȳ itself then: a sweep
ȳ ← y + ½Δ P(ȳ) costs a product and a sum for each term, and 1 − K = 1 − ½Δ P′(ȳ) one for each of P′, since the ½Δ c are
multiplied once. What they leave is rounded at the size of y. The steps after them take R as the formula writes it,
whose roundings are those of B∇H and not those of the coefficients of P.
"""

from __future__ import annotations

from collections.abc import Sequence

from sepv.record import Polynomial
from sepv.record._polynomial import gradient
from sepv.simulate._engine.code_builder import CodeBuilder, Table, shown
from sepv.simulate._engine.linear import contraction, correct


def approach(
    code: CodeBuilder, P: Sequence[Polynomial], y: Sequence[str], sweeps: int
) -> tuple[list[str], str | None]:
    """ȳ after sweeps from y and a step, and 1/det(1 − K) where it is used; m is the size of the step in z."""
    middle = list(y)
    for _ in range(sweeps):
        middle = _swept(code, P, y, middle)
    A = matrix(code, P, middle)
    code.lines.append(contraction(code, A))
    F = [code.let(f"{a} - {b}") for a, b in zip(middle, _swept(code, P, y, middle), strict=True)]
    middle, inverse = correct(code, F, A, middle)
    code.lines.append("m = m + m")
    return middle, inverse


def matrix(code: CodeBuilder, P: Sequence[Polynomial], middle: Sequence[str]) -> Table:
    """1 − ½Δ P′(ȳ)."""
    half = code.let("0.5 * delta")
    return [
        [
            code.polynomial(slope, middle, "(-1.0)", half, value="(1.0)" if i == j else None)
            for j, slope in enumerate(gradient(p))
        ]
        for i, p in enumerate(P)
    ]


def _swept(code: CodeBuilder, P: Sequence[Polynomial], y: Sequence[str], middle: Sequence[str]) -> list[str]:
    """y + ½Δ P(ȳ)."""
    half = code.let("0.5 * delta")
    return [shown(code.polynomial(p, middle, half, value=start)) for p, start in zip(P, y, strict=True)]
