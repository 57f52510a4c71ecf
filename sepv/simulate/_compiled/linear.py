"""Straight-line code of a step of Newton's iteration: the small linear system,
the correction and its size.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sepv.problem import cramer
from sepv.record import Tape
from sepv.simulate._compiled.code_builder import CodeBuilder, Expression, Table, shown
from sepv.simulate._compiled.recorded import emit

# The largest number of unknowns for which Cramer's rule is written out.
CRAMER = 3


def correct(
    code: CodeBuilder, F: Sequence[Expression], A: Table, z: Sequence[str], near: str | None = None
) -> tuple[list[str], str | None]:
    """Write code of z − A⁻¹F, and of 1/det A if Cramer's rule is used;
    m in it is the correction's size Σ|A⁻¹F|_i.

    `near` is 1/det of a matrix near A. If it is given, a Newton step for the reciprocal replaces
    the division, the slowest operation, and squares the relative error of `near`. If `near` is from
    before a correction of size m, the next correction has a relative error O(m²), as in Newton's
    iteration itself.

    For sensible steps A = 1 − ∂R/∂z is near 1, and Newton's iteration computes the next residual
    afresh. A bad pivot therefore costs iterations or leads to a lane (path) that does not converge,
    but not to a wrong result.
    """
    before = [None if v == "0.0" else v for v in z]
    if len(F) > CRAMER:
        c = _eliminate(code, [list(row) for row in A], list(F))
        code.lines.append(magnitude(c))
        return [shown(code.minus(a, "(1.0)", b)) for a, b in zip(before, c, strict=True)], None
    numerators, determinant = _cramer(code, A, F)
    if near is None:
        inverse = code.let(f"1.0 / {determinant}")
    else:
        inverse = code.let(f"fma({near}, {code.let(f'fma(-{determinant}, {near}, 1.0)')}, {near})")
    code.lines.append(f"{magnitude(numerators, '(')}) * abs({inverse})")
    return [shown(code.minus(a, n, inverse)) for a, n in zip(before, numerators, strict=True)], inverse


def magnitude(c: Sequence[str], opened: str = "") -> str:
    """The line that computes the size m = Σ|c_i| of a correction c."""
    return f"m = {opened}{' + '.join(f'abs({v})' for v in c)}"


def contraction(code: CodeBuilder, A: Table) -> str:
    """Write a test that a sweep z ← R(z) at least halves the error:
    ‖K‖ ≤ ½ in the Frobenius norm for K = 1 − A.

    The equation z = R(z) then has one solution near zero (Banach). Newton's iteration finds it from
    the sweeps' result.
    """
    K = [
        v if i != j else None if v == "(1.0)" else code.let(f"1.0 - {shown(v)}")
        for i, row in enumerate(A)
        for j, v in enumerate(row)
    ]
    return f"contracts = {shown(code.dot(K, K))} <= 0.25"


def _cramer(code: CodeBuilder, A: Table, b: Sequence[Expression]) -> tuple[list[str], str]:
    """Code of the numerators and the determinant of Cramer's rule for A x = b."""
    tape, values = Tape(), dict[int, Expression]()

    def symbol(text: Expression) -> Any:
        if text in (None, "(1.0)"):
            return tape.constant(0.0 if text is None else 1.0)
        (found,) = tape.vector(1)
        values[found.index] = text
        return found

    numerators, determinant = cramer([[symbol(v) for v in row] for row in A], [symbol(v) for v in b])
    *found, value = emit(code, values, [tape.symbol(v) for v in (*numerators, determinant)])
    return [shown(v) for v in found], shown(value)


def _eliminate(code: CodeBuilder, A: Table, b: list[Expression]) -> list[str]:
    """Code of A⁻¹b by elimination without pivoting."""
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
