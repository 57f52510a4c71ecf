"""The form of each scheme for the compiled engine: its recorded formula,
or code for s-stage and projected methods.

Code of a scheme's equation z = R and of K = ∂R/∂z shares common parts, because equal expressions
have one name (`sepv.simulate._compiled.code_builder`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

from sepv import schemes
from sepv.core import formula
from sepv.schemes import (
    MAX_STAGES,
    Explicit,
    Implicit,
    Parts,
    Scheme,
    drift_and_noise,
    explicit,
    gauss_tableau,
    random_step,
    step_and_variance,
)
from sepv.schemes import energy_preserving_formula as energy_preserving
from sepv.schemes import midpoint_formula as midpoint
from sepv.simulate._compiled.code_builder import CodeBuilder, Expression, Table
from sepv.simulate._compiled.recorded import RecordedProblem


@dataclass(frozen=True)
class Formula:
    """A scheme's step in the form from which the compiled engine makes code.

    recorded : the formula of the scheme, from the scheme's file
    implicit : True for an equation z = R, which Newton's iteration solves
    parts : the function that computes the numbers of a step that the formula uses
    projected : True for an explicit increment that is projected on the invariants
    """

    recorded: formula.Formula
    implicit: bool = True
    parts: Parts = random_step
    stages: int = 1
    projected: bool = False

    def names(self, noises: int) -> list[str]:
        """The names, in the code of a lane (path), of the numbers of a step that the scheme uses,
        such as delta.
        """
        return _STEP_NAMES.get(self.parts) or ["span", *(f"noise{j}" for j in range(noises))]

    def update(self, code: CodeBuilder, z: Sequence[str]) -> list[str]:
        """Code of the update y1 − y0 from the unknowns z."""
        return list(z)

    def states(self, code: CodeBuilder, y: Sequence[str], z: Sequence[str]) -> list[list[str]]:
        """Code of the states that must lie in the domain: y1."""
        return [[code.let(f"{a} + {b}") for a, b in zip(y, z, strict=True)]]


_STEP_NAMES: dict[Parts, list[str]] = {
    random_step: ["delta"],
    drift_and_noise: ["span", "noise"],
    step_and_variance: ["delta", "variance"],
}


def field(code: CodeBuilder, B: Table, g: Sequence[Expression]) -> list[Expression]:
    """Code of the product B g."""
    return [code.dot(row, g) for row in B]


def scaled(code: CodeBuilder, factor: str, table: Table) -> Table:
    """Code of factor·table for a skew-symmetric table."""
    d = len(table)
    upper = {(i, j): code.product(factor, table[i][j]) for i in range(d) for j in range(i + 1, d)}
    found: Table = [[None] * d for _ in range(d)]
    for (i, j), value in upper.items():
        found[i][j], found[j][i] = value, code.product("(-1.0)", value)
    return found


def middle(code: CodeBuilder, y: Sequence[str], z: Sequence[str]) -> list[str]:
    """Code of the midpoint ȳ = y + z/2."""
    return [a if b == "0.0" else str(code.plus("(0.5)", b, a)) for a, b in zip(y, z, strict=True)]


def scaled_field(
    code: CodeBuilder, problem: RecordedProblem, y: Sequence[str], delta: str = "(1.0)"
) -> list[Expression]:
    """Code of Δ f(y), f = B∇H; if f has few monomials it is multiplied out,
    because only the product is needed.
    """
    if problem.field is not None:
        return [code.polynomial(p, y, delta) for p in problem.field]
    return [
        code.product(delta, v) for v in field(code, problem.structure(code, y), problem.gradient(code, y))
    ]


def at(code: CodeBuilder, y: Sequence[str], z: Sequence[str], integrals: Any) -> list[str]:
    """Code of the collocation polynomial u = y + Σ_j integrals_j z_j; z has the components of z_1,
    then of z_2, etc.
    """
    d = len(y)
    state = list(y)
    for j, weight in enumerate(integrals):
        for k in range(d):
            if z[j * d + k] != "0.0":
                state[k] = str(code.plus(code.number(float(weight)), z[j * d + k], state[k]))
    return state


@dataclass(frozen=True)
class Collocation(Formula):
    """The s-stage method: z_i = Δ B(Y_i) g_i with g_i = b_i⁻¹∫ℓ_i∇H(u), y1 = y0 + Σ b_i z_i.

    If not `averaged`, this is the Gauss method, g_i = ∇H(Y_i). `recorded` is the formula of the
    method of one stage.
    """

    averaged: bool = True

    def sweep(
        self, code: CodeBuilder, problem: RecordedProblem, y: Sequence[str], z: Sequence[str], delta: str,
        averages: Sequence[Sequence[Expression]] | None,
    ) -> list[Expression]:  # fmt: skip
        """Code of Δ B(Y_i) g_i, one stage after the other; `averages` has the g_i,
        or is None for g_i = ∇H(Y_i).
        """
        R: list[Expression] = []
        for i, row in enumerate(gauss_tableau(self.stages).A):
            Y = at(code, y, z, row)
            g = problem.gradient(code, Y) if averages is None else averages[i]
            R += field(code, scaled(code, delta, problem.structure(code, Y)), g)
        return R

    def update(self, code: CodeBuilder, z: Sequence[str]) -> list[str]:
        """Code of the update y1 − y0 = Σ b_i z_i."""
        d = len(z) // self.stages
        sums: list[Expression] = [None] * d
        for j, b in enumerate(gauss_tableau(self.stages).b):
            sums = [code.plus(code.number(float(b)), z[j * d + k], sums[k]) for k in range(d)]
        return [str(s) for s in sums]

    def states(self, code: CodeBuilder, y: Sequence[str], z: Sequence[str]) -> list[list[str]]:
        """Code of the states that must lie in the domain: y1 and the stages Y_i."""
        tableau = gauss_tableau(self.stages)
        return [at(code, y, z, row) for row in (tableau.b, *tableau.A)]


# The forms of the schemes that have their own solver.
FORMULAS: dict[str, Formula] = {
    **{f"projected-{p}": Formula(cast(Explicit, explicit(p).step).formula, projected=True) for p in (4, 8)},
    "collocation-1": Formula(energy_preserving),
    "gauss-1": Formula(midpoint),
    **{
        f"{family}-{s}": Collocation(energy_preserving, stages=s, averaged=family == "collocation")
        for family in ("collocation", "gauss")
        for s in range(2, MAX_STAGES + 1)
    },
}


def formula_of(scheme: Scheme) -> Formula | None:
    """The `Formula` from which the compiled engine makes code of a scheme's step;
    None if it makes none.

    A scheme is recognised by its step, so that a copy with another function as its step has no
    `Formula`.
    """
    rule = scheme.step
    if isinstance(rule, Explicit):
        return Formula(rule.formula, False, rule.parts)
    if isinstance(rule, Implicit):
        known = rule.formula is not None and scheme.solve in (None, rule.solve)
        return Formula(cast(formula.Formula, rule.formula), True, rule.parts) if known else None
    found = FORMULAS.get(scheme.name)
    own = None if found is None else schemes.by_name(scheme.name)
    return None if own is None or own.step is not rule or own.solve is not scheme.solve else found
