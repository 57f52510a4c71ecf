"""Straight-line code that solves a small linear system in every lane."""

from __future__ import annotations

from collections.abc import Sequence

from sepv.simulate._engine.code_builder import CodeBuilder, Expression, Table, shown


def solve(
    code: CodeBuilder, A: Table, b: list[Expression], near: str | None = None
) -> tuple[list[str], str | None]:
    """x with A x = b, and 1/det A where it is used: Cramer's rule to d = 3, else elimination without pivoting.

    `near` is 1/det of a matrix next to A: a step of Newton's iteration for a reciprocal, which squares the relative
    distance, takes the place of the division, the longest of all operations. Where A moved with a correction m, that
    is O(m²) of the next one, as Newton's iteration itself leaves.

    A is 1 − K with K small where steps make sense, and Newton's iteration computes the next residual afresh:
    a bad pivot costs iterations and shows as a lane that does not converge, not as a wrong result.
    """
    d = len(b)
    if d == 1:
        return [code.let(f"{shown(b[0])} / {shown(A[0][0])}")], None
    if d == 2:
        (p, q), (r, s) = A
        inverse = _reciprocal(code, shown(code.minus(code.product(p, s), q, r)), near)
        first = code.minus(code.product(s, b[0]), q, b[1])
        second = code.minus(code.product(p, b[1]), r, b[0])
        return [code.let(f"{shown(v)} * {inverse}") for v in (first, second)], inverse
    if d == 3:
        rows = [cross(code, A[(i + 1) % 3], A[(i + 2) % 3]) for i in range(3)]
        inverse = _reciprocal(code, shown(code.dot(A[0], rows[0])), near)
        sums = [code.dot([row[i] for row in rows], b) for i in range(3)]
        return [code.let(f"{shown(v)} * {inverse}") for v in sums], inverse
    return _eliminate(code, [list(row) for row in A], list(b)), None


def _reciprocal(code: CodeBuilder, value: str, near: str | None) -> str:
    if near is None:
        return code.let(f"1.0 / {value}")
    return code.let(f"fma({near}, {code.let(f'fma(-{value}, {near}, 1.0)')}, {near})")


def _eliminate(code: CodeBuilder, A: Table, b: list[Expression]) -> list[str]:
    d = len(b)
    pivots = []
    for k in range(d):
        pivots.append(code.let(f"1.0 / {shown(A[k][k])}"))
        for i in range(k + 1, d):
            factor = code.product(A[i][k], pivots[k])
            if factor is None:
                continue
            for j in range(k + 1, d):
                A[i][j] = code.minus(A[i][j], factor, A[k][j])
            b[i] = code.minus(b[i], factor, b[k])
    x: list[str] = [""] * d
    for i in reversed(range(d)):
        value = b[i]
        for j in range(i + 1, d):
            value = code.minus(value, A[i][j], x[j])
        x[i] = code.let(f"{shown(value)} * {pivots[i]}")
    return x


def cross(code: CodeBuilder, u: Sequence[Expression], v: Sequence[Expression]) -> list[Expression]:
    """u × v."""
    return [code.minus(code.product(u[i], v[j]), u[j], v[i]) for i, j in ((1, 2), (2, 0), (0, 1))]
