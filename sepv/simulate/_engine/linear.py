"""Straight-line code that solves a small linear system in every lane."""

from __future__ import annotations

from collections.abc import Sequence

from sepv.simulate._engine.text import Expression, Table, Text, shown


def solve(e: Text, A: Table, b: list[Expression], near: str | None = None) -> tuple[list[str], str | None]:
    """x with A x = b, and 1/det A where it is used: Cramer's rule to d = 3, else elimination without pivoting.

    `near` is 1/det of a matrix next to A: a step of Newton's iteration for a reciprocal, which squares the relative
    distance, takes the place of the division, the longest of all operations. Where A moved with a correction m, that
    is O(m²) of the next one, as Newton's iteration itself leaves.

    A is 1 − K with K small where steps make sense, and Newton's iteration computes the next residual afresh:
    a bad pivot costs iterations and shows as a lane that does not converge, not as a wrong result.
    """
    d = len(b)
    if d == 1:
        return [e.let(f"{shown(b[0])} / {shown(A[0][0])}")], None
    if d == 2:
        (p, q), (r, s) = A
        inverse = _reciprocal(e, shown(e.minus(e.product(p, s), q, r)), near)
        first = e.minus(e.product(s, b[0]), q, b[1])
        second = e.minus(e.product(p, b[1]), r, b[0])
        return [e.let(f"{shown(v)} * {inverse}") for v in (first, second)], inverse
    if d == 3:
        rows = [cross(e, A[(i + 1) % 3], A[(i + 2) % 3]) for i in range(3)]
        inverse = _reciprocal(e, shown(e.dot(A[0], rows[0])), near)
        sums = [e.dot([row[i] for row in rows], b) for i in range(3)]
        return [e.let(f"{shown(v)} * {inverse}") for v in sums], inverse
    return _eliminate(e, [list(row) for row in A], list(b)), None


def _reciprocal(e: Text, value: str, near: str | None) -> str:
    if near is None:
        return e.let(f"1.0 / {value}")
    return e.let(f"fma({near}, {e.let(f'fma(-{value}, {near}, 1.0)')}, {near})")


def _eliminate(e: Text, A: Table, b: list[Expression]) -> list[str]:
    d = len(b)
    pivots = []
    for k in range(d):
        pivots.append(e.let(f"1.0 / {shown(A[k][k])}"))
        for i in range(k + 1, d):
            factor = e.product(A[i][k], pivots[k])
            if factor is None:
                continue
            for j in range(k + 1, d):
                A[i][j] = e.minus(A[i][j], factor, A[k][j])
            b[i] = e.minus(b[i], factor, b[k])
    x: list[str] = [""] * d
    for i in reversed(range(d)):
        value = b[i]
        for j in range(i + 1, d):
            value = e.minus(value, A[i][j], x[j])
        x[i] = e.let(f"{shown(value)} * {pivots[i]}")
    return x


def cross(e: Text, u: Sequence[Expression], v: Sequence[Expression]) -> list[Expression]:
    """u × v."""
    return [e.minus(e.product(u[i], v[j]), u[j], v[i]) for i, j in ((1, 2), (2, 0), (0, 1))]
