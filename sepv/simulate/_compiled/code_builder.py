"""Scalar code as text: expressions are strings, temporaries are named,
coefficients become parameters.

A zero expression is None, so that the zeros of sparse B, H″ and B′ cost nothing in the code.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import reduce

from sepv.record import Polynomial

Expression = str | None
Table = list[list[Expression]]

# Coefficients that are written into the code. All others are parameters, so that problems that
# differ only in these share one compiled kernel.
_WRITTEN_COEFFICIENTS = {0.0, 0.5, 1.0, 2.0, 3.0, 4.0, -0.5, -1.0, -2.0, -3.0, -4.0}


class CodeBuilder:
    """Straight-line code under construction: its lines,
    its temporaries and the parameters it reads.
    """

    def __init__(self, parameters: list[float] | None = None) -> None:
        self.lines: list[str] = []
        self.parameters: list[float] = [] if parameters is None else parameters
        self._known: dict[str, str] = {}

    def let(self, expression: str) -> str:
        """Return a name for an expression's value, set in a new line if needed;
        equal expressions have one name.
        """
        if expression.isidentifier():
            return expression
        name = self._known.get(expression)
        if name is None:
            name = f"t{len(self._known)}"
            self._known[expression] = name
            self.lines.append(f"{name} = {expression}")
        return name

    def number(self, value: float) -> str:
        """The text of a coefficient: its value if it is in `_WRITTEN_COEFFICIENTS`, else a
        parameter p0, p1, and so on.
        """
        if value in _WRITTEN_COEFFICIENTS:
            return f"({value!r})"
        if value not in self.parameters:
            self.parameters.append(value)
        return f"p{self.parameters.index(value)}"

    def product(self, *factors: Expression) -> Expression:
        """Code of a product, from left to right, without factors 1."""
        kept: list[str] = []
        sign = False
        for factor in factors:
            if factor is None:
                return None
            if factor == "(-1.0)":
                sign = not sign
            elif factor != "(1.0)":
                kept.append(factor)
        value = reduce(lambda a, b: self.let(f"{a} * {b}"), kept or ["(1.0)"])
        return self.let(f"-{value}") if sign and value != "(1.0)" else ("(-1.0)" if sign else value)

    def total(self, terms: Iterable[Expression]) -> Expression:
        """Code of a sum, from left to right, without terms 0."""
        kept = [t for t in terms if t is not None]
        return reduce(lambda a, b: self.let(f"{a} + {b}"), kept) if kept else None

    def dot(self, row: Sequence[Expression], vector: Sequence[Expression]) -> Expression:
        """Code of Σ row_j vector_j in the order of j."""
        value: Expression = None
        for a, b in zip(row, vector, strict=True):
            value = self.plus(a, b, value)
        return value

    def plus(self, a: Expression, b: Expression, c: Expression) -> Expression:
        """Code of a·b + c, fused unless a factor is 0, 1 or −1 or c is 0."""
        if a is None or b is None:
            return c
        if c is None or "(1.0)" in (a, b):
            return self.total([c, self.product(a, b)])
        if "(-1.0)" in (a, b):
            return self.let(f"{c} - {b if a == '(-1.0)' else a}")
        return self.let(f"fma({a}, {b}, {c})")

    def minus(self, c: Expression, a: Expression, b: Expression) -> Expression:
        """Code of c − a·b."""
        return self.plus(self.product("(-1.0)", a), b, c)

    def polynomial(
        self, p: Polynomial, y: Sequence[str], *factors: str, value: Expression = None
    ) -> Expression:
        """Code of `value` + p(y), in the canonical order of the terms of p,
        with powers as repeated products.

        The `factors` multiply the polynomial's coefficients.
        """
        for exponents, c in p.terms:
            value = self.plus(self.product(*factors, self.number(c)), self._monomial(exponents, y), value)
        return value

    def _monomial(self, exponents: Sequence[int], y: Sequence[str]) -> Expression:
        powers = [[v] * e for v, e in zip(y, exponents, strict=True) if e]
        return self.product(*(reduce(lambda a, b: self.let(f"{a} * {b}"), power) for power in powers))


def shown(expression: Expression) -> str:
    """The text of an expression, "0.0" for zero."""
    return "0.0" if expression is None else expression
