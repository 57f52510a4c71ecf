"""The text of a kernel: constants, functions printed from the records of a problem and a scheme,
and the loops in C.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from sepv.core.newton import RESIDUAL_ROUNDING, STAGNATION, STOP_ERROR, ZERO_RESIDUAL, Status
from sepv.problem import Problem, cramer, dot
from sepv.record import EPS, TINY
from sepv.schemes import (
    MAX_NODES,
    Scheme,
    drift_and_noise,
    gauss_tableau,
    moments,
    random_step,
    step_and_variance,
)
from sepv.simulate._compiled.compile import printed
from sepv.simulate._compiled.layout import FIRST_CORRECTION, NEGLIGIBLE_CORRECTION
from sepv.simulate._compiled.linear import CRAMER
from sepv.simulate._compiled.recorded import RecordedProblem
from sepv.simulate._compiled.schemes import Collocation, Formula
from sepv.simulate._compiled.stages import BLIND_SWEEPS, SHRINKS, TESTED_MAX_SWEEPS, StagesWriter
from sepv.simulate._wiener import MIXING, STREAMS, TOP_INCREMENTS
from sepv.simulate.targets.cuda.printer import function, number, table

# The most unknowns for which elimination is written out.
WRITTEN_OUT = 6
# Newton iterations of an implicit equation, as of the core's straight-line code, and of a
# projection.
STRAIGHT_MAXITER, PROJECTION_MAXITER = 7, 40
# The largest relative error of Newton's matrix: that of recorded derivatives, and that of the
# slopes in `functions.c`.
EXACT_MATRIX, WITH_SLOPES = 2.0**-40, 2.0**-30
# Levels of Lévy's construction that are halved in registers.
IN_REGISTERS = 3


@dataclass(frozen=True)
class Text:
    """The C text of a kernel; `implicit` is False if the scheme solves no equation."""

    text: str
    implicit: bool


@lru_cache(maxsize=256)
def kernel_text(scheme: Scheme, problem: Problem, compensated: bool) -> Text:
    """Print the kernel of a scheme and a problem.

    Raise CannotCompile, with the reason, if it cannot be printed.
    """
    return printed(
        scheme,
        problem,
        lambda code, formula: Text(_written(code, formula, compensated), formula.implicit),
    )


def _written(code: RecordedProblem, formula: Formula, compensated: bool) -> str:
    kind = _implicit if formula.implicit else _explicit
    if isinstance(formula, Collocation):
        kind = _stages
    elif formula.projected:
        kind = _projected
    constants, functions, loop = kind(code, formula)
    invariants = [code.tape.symbol(code.H), *code.casimir_symbols]
    inside = code.tape.constant(1.0) if code.inside is None else code.tape.symbol(code.inside)
    constants = {
        "D": code.dimension, "NOISES": code.problem.noises, "NUMBERS": len(formula.names(code.problem.noises)),
        "INVARIANTS": len(invariants), "COMPENSATED": int(compensated), "HAS_DOMAIN": int(code.inside is not None),
        "LEFT_DOMAIN": int(Status.LEFT_DOMAIN),
        "OVERFLOW_": int(Status.OVERFLOW), "EPS": EPS, "TINY": TINY, "ZERO_RESIDUAL": ZERO_RESIDUAL,
        "STAGNATION": STAGNATION, "ROUNDING": RESIDUAL_ROUNDING, "STOP_ERROR": STOP_ERROR, "DIRECTIONS": 0,
        "FIRST_GRADIENTS": 0, "FIRST_STRUCTURES": 0,
        "FIRST": FIRST_CORRECTION, "EARLY": 0.0, **constants,
    }  # fmt: skip
    parts = [
        _defined(constants), _file("prelude"), _file("functions"),
        function("int inside(const double *y)", {"y": code.y}, {"return": inside}),
        function("void invariants(const double *y, double *v)", {"y": code.y}, {"v": invariants}),
        _step_numbers(code.problem, formula), *functions, *map(_file, loop), _file("path"),
    ]  # fmt: skip
    return "\n\n".join(parts)


def draw_text(noises: int) -> str:
    """The C text that draws increments of `noises` ≥ 1 noises;
    it is the same for all problems and schemes.
    """
    constants = {
        "NOISES": noises, "STREAMS": f"{STREAMS}ULL", "MIXING": MIXING, "TOP_LEVELS": TOP_INCREMENTS.bit_length() - 1,
        "IN_REGISTERS": IN_REGISTERS,
    }  # fmt: skip
    return "\n\n".join([_defined(constants), _file("prelude"), _file("draw")])


def _defined(constants: dict[str, Any]) -> str:
    return "\n".join(f"#define {k} {number(v) if isinstance(v, float) else v}" for k, v in constants.items())


@lru_cache(maxsize=16)
def _file(name: str) -> str:
    return (Path(__file__).parent / f"{name}.c").read_text(encoding="utf-8")


def _step_numbers(problem: Problem, formula: Formula) -> str:
    """The numbers of a step from increments u: Δ, or Δ and 3c²h; or h and Σ c_j u_j;
    or h and each c_j u_j.
    """
    terms = [f"{number(float(c))} * u[{j}]" for j, c in enumerate(problem.c)]
    if formula.parts in (random_step, step_and_variance):
        lines = ["s[0] = h;", *(f"s[0] = s[0] + {term};" for term in terms)]
        if formula.parts is step_and_variance:
            lines.append(f"s[1] = {number(3.0 * float((problem.c**2).sum()))} * h;")
    elif formula.parts is drift_and_noise:
        lines = ["s[0] = h;", "s[1] = 0.0;", *(f"s[1] = s[1] + {term};" for term in terms)]
    else:
        lines = ["s[0] = h;", *(f"s[{1 + j}] = {term};" for j, term in enumerate(terms))]
    return function("void step_numbers(double h, const double *u, double *s)", {}, {}, lines)


_Parts = tuple[dict[str, Any], list[str], Sequence[str]]


def _explicit(code: RecordedProblem, formula: Formula) -> _Parts:
    return _first_costs(code, formula), [_right_side(code, formula)], ["explicit"]


def _first_costs(code: RecordedProblem, formula: Formula, further: int = 0) -> dict[str, Any]:
    """Evaluations of ∇H and B at the start of a step: those of the formula,
    and `further` ones of both.
    """
    gradients, structures = code.cost(formula.recorded, formula.names(code.problem.noises))
    return {"FIRST_GRADIENTS": gradients + further, "FIRST_STRUCTURES": structures + further}


def _right_side(code: RecordedProblem, formula: Formula) -> str:
    equation = code.equation_of(formula.recorded, len(formula.names(code.problem.noises)), apart=False)
    head = "void right_side(const double *y, const double *s, double *R)"
    return function(head, {"y": code.y, "s": equation.step}, {"R": equation.R})


_ITERATION = (
    "int iteration(const double *y, const double *z, const double *s, const double *q, double *F, double *c)"
)
_BEGINNING = "void beginning(const double *y, const double *s, double *z, double *q)"


def _implicit(code: RecordedProblem, formula: Formula) -> _Parts:
    """Newton's iteration for z = R(z): as in the core, by Cramer's rule up to three unknowns."""
    count, tape, d = len(formula.names(code.problem.noises)), code.tape, code.dimension
    equation = code.equation_of(formula.recorded, count)
    F, A = code.system(formula.recorded, count)
    inputs = {"y": code.y, "z": code.z, "s": equation.step}
    if d > WRITTEN_OUT:
        last = ["for (int i = 0; i < D; i++) c[i] = F[i];", "eliminate(A, c);", "double moved[D];",
                "for (int i = 0; i < D; i++) moved[i] = y[i] + (z[i] - c[i]);", "return inside(moved);"]  # fmt: skip
        iteration = function(_ITERATION, inputs, {"F": F, "A": A}, last).replace(
            "{\n", "{\n  double A[D * D];\n", 1
        )
    else:
        if d <= CRAMER:
            numerators, determinant = cramer(A, F)
            inverse = tape.constant(1.0) / tape.symbol(determinant)
            c = [tape.symbol(v) * inverse for v in numerators]
        else:
            c = _eliminated([list(row) for row in A], list(F))
        moved = code.y + (code.z - tape.symbols(c))
        stays = tape.constant(1.0) if code.problem.domain is None else tape.symbol(code.problem.domain(moved))
        iteration = function(_ITERATION, inputs, {"F": F, "c": c, "return": stays})
    functions = [
        *([_file("eliminate")] if d > WRITTEN_OUT else []), iteration,
        function(_BEGINNING, {}, {}, ["for (int i = 0; i < D; i++) z[i] = 0.0;"]),
        function("i64 ends(const double *y, const double *z)", {}, {}, ["return 0;"]),
    ]  # fmt: skip
    costs: dict[str, Any] = {
        "MAXITER": STRAIGHT_MAXITER,
        "GRADIENTS": equation.gradients,
        "STRUCTURES": equation.structures,
    }
    slopes = any(line.name.endswith("_slope") for line in tape.lines)
    costs["EARLY"] = STOP_ERROR / (WITH_SLOPES if slopes else EXACT_MATRIX)
    return costs, functions, ["newton"]


def _eliminated(A: list[list[Any]], b: list[Any]) -> list[Any]:
    """A⁻¹b in symbols by elimination without pivoting.

    A = 1 − ∂R/∂z is near 1 for sensible steps. A bad pivot costs iterations, or leaves the step to
    the core.
    """
    n = len(b)
    for k in range(n):
        for i in range(k + 1, n):
            factor = A[i][k] / A[k][k]
            for j in range(k + 1, n):
                A[i][j] = A[i][j] - factor * A[k][j]
            b[i] = b[i] - factor * b[k]
    for i in reversed(range(n)):
        for j in range(i + 1, n):
            b[i] = b[i] - A[i][j] * b[j]
        b[i] = b[i] / A[i][i]
    return b


def _projected(code: RecordedProblem, formula: Formula) -> _Parts:
    """The explicit increment z, and the iteration that projects it: its residual is its
    correction.
    """
    directions, known, correction = code.directions
    functions = [
        _right_side(code, formula),
        function("void directions(const double *y, double *q)", {"y": code.y}, {"q": directions}),
        function(_ITERATION, {"y": code.y, "z": code.z, "q": known}, {"F": correction, "c": correction}, ["return 1;"]),
        function(_BEGINNING, {}, {}, ["double end[D];", "right_side(y, s, z);",
                 "for (int i = 0; i < D; i++) end[i] = y[i] + z[i];", "directions(end, q);"]),
        function("i64 ends(const double *y, const double *z)", {}, {}, ["double end[D];",
                 "for (int i = 0; i < D; i++) end[i] = y[i] + z[i];", "return inside(end) ? 0 : -1;"]),
    ]  # fmt: skip
    costs = {"MAXITER": PROJECTION_MAXITER, "GRADIENTS": code.mean.nodes, "STRUCTURES": 0}
    costs |= {"DIRECTIONS": len(directions)} | _first_costs(code, formula, 1)
    return costs, functions, ["newton"]


def _stages(code: RecordedProblem, formula: Formula) -> _Parts:
    """Sweeps for the stages of a collocation or Gauss method,
    with the quadrature rules of `StagesWriter`.
    """
    assert isinstance(formula, Collocation)
    s, writer = formula.stages, StagesWriter(code, formula, code.problem.noises, 1, False)
    tableau, ladder = gauss_tableau(s), writer.ladder()
    counts = [n for nodes in ladder for n in (nodes, min(nodes + nodes // 2, MAX_NODES * 2))]
    rules = [moments(s, n) for n in counts]
    v = code.tape.vector(code.dimension)
    f = [dot(row, v) for row in code.B]
    functions = [
        function("void gradient(const double *y, double *g)", {"y": code.y}, {"g": code.slope}),
        function("void apply(const double *y, const double *v, double *f)", {"y": code.y, "v": v},
                 {"f": code.tape.symbols(f)}),
        table("double", "TABLEAU", tableau.A), table("double", "WEIGHTS", tableau.b),
        table("int", "FIRSTS", np.concatenate([[0], np.cumsum(counts)])),
        table("double", "NODES", np.concatenate([np.concatenate([W.T, P], axis=1) for W, P in rules])),
    ]  # fmt: skip
    constants = {
        "STAGES": s, "RULES": len(ladder), "EXACT": int(writer.exact), "STRAIGHT": int(writer.straight),
        "BLIND": BLIND_SWEEPS, "TESTED": TESTED_MAX_SWEEPS, "SHRINKS": SHRINKS,
        "NEGLIGIBLE_CORRECTION": NEGLIGIBLE_CORRECTION,
    }  # fmt: skip
    return constants, functions, ["stages"]
