"""Code of a problem's functions for the compiled engine,
printed from the recorded operations of each function.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np

from sepv.core.formula import Formula
from sepv.problem import Directions, casimir_gradients, dot, projections
from sepv.record import NoClosedForm, Symbol, Tape, jacobian, reachable
from sepv.record import symbol_array as array
from sepv.schemes import Recorded
from sepv.simulate._compiled.code_builder import CodeBuilder, Expression, Table, shown

# Recorded functions by name: the function to call in the code of a lane, and the value's place if a
# tuple is returned.
_CALLS: dict[str, tuple[str, int | None]] = {
    "sin": ("sincos", 0),
    "cos": ("sincos", 1),
    "log": ("logarithm", None),
    "sinc": ("sinc", 0),
    "sinc_slope": ("sinc", 1),
    "log1p_ratio": ("log1p_ratio", 0),
    "log1p_ratio_slope": ("log1p_ratio", 1),
    "expm1_ratio": ("expm1_ratio", 0),
    "expm1_ratio_slope": ("expm1_ratio", 1),
}
# Relative errors of derivatives that only Newton's matrix uses; the other derivatives are exact up
# to rounding.
_RATES = {"sinc_slope": 2.0**-26, "log1p_ratio_slope": 2.0**-10, "expm1_ratio_slope": 2.0**-26}
_EXACT = 2.0**-40
_PRODUCTS = ("multiply", "whole")


def emit(code: CodeBuilder, values: Mapping[int, Expression], outputs: Sequence[Symbol]) -> list[Expression]:
    """Write code for the outputs of a record; `values` has the expressions of lines that are
    already known.

    If a sum is the only user of a product, both are fused: a·b + c.
    """
    lines = reachable(outputs, values)
    users = Counter(i for symbol in lines for i in symbol.line.arguments)
    users.update(symbol.index for symbol in outputs)
    expressions: dict[int, Expression] = {}

    def value(index: int) -> Expression:
        """The expression of recorded line `index`; a product that is used only once is written
        where it is used.
        """
        if index not in expressions:
            expressions[index] = code.product(*map(value, tape.lines[index].arguments))
        return expressions[index]

    def factors(symbol: Symbol) -> tuple[Expression, Expression] | None:
        if symbol.index in expressions or symbol.line.name not in _PRODUCTS:
            return None
        a, b = symbol.line.arguments
        return value(a), value(b)

    for symbol in lines:
        index, line, tape = symbol.index, symbol.line, symbol.tape
        if index in values:
            expressions[index] = values[index]
        elif line.name == "constant":
            expressions[index] = code.number(line.value) if line.value else None
        elif line.name in ("add", "subtract"):
            a, b = symbol.arguments
            second = factors(b)
            first = factors(a) if second is None else None
            expressions[index] = _sum(code, line.name, (a, first), (b, second), value)
        elif line.name not in _PRODUCTS or users[index] > 1:
            expressions[index] = _operation(code, symbol, [value(i) for i in line.arguments])
    return [value(symbol.index) for symbol in outputs]


_Term = tuple[Symbol, tuple[Expression, Expression] | None]


def _sum(
    code: CodeBuilder, name: str, left: _Term, right: _Term, value: Callable[[int], Expression]
) -> Expression:
    """Code of the sum or difference of two terms (symbol, factors);
    a term has factors if it is a product to fuse.
    """
    (a, first), (b, second) = left, right
    if second is not None:
        before = value(a.index)
        return code.plus(*second, before) if name == "add" else code.minus(before, *second)
    last = value(b.index)
    if first is not None:
        return code.plus(*first, last if name == "add" else code.product("(-1.0)", last))
    if name == "add" or last is None:
        return code.total([value(a.index), last])
    return code.product("(-1.0)", last) if value(a.index) is None else code.let(f"{value(a.index)} - {last}")


def _operation(code: CodeBuilder, symbol: Symbol, arguments: list[Expression]) -> Expression:  # noqa: PLR0911 - an operation a line
    name, texts = symbol.line.name, [shown(a) for a in arguments]
    if name == "negative":
        return code.product("(-1.0)", arguments[0])
    if name in _PRODUCTS:
        return code.product(*arguments)
    if name == "divide":
        return None if arguments[0] is None else code.let(f"{texts[0]} / {texts[1]}")
    if name == "power":
        return code.let(f"{texts[0]} ** {code.number(symbol.line.value)}")
    if name == "select":
        return code.let(f"select({', '.join(texts)})")
    if name in _CONDITION_TEXTS:
        return code.let(_CONDITION_TEXTS[name].format(*texts))
    call, place = _CALLS.get(name, (name, None))
    result = code.let(f"{call}({texts[0]})")
    return result if place is None else code.let(f"{result}[{place}]")


_CONDITION_TEXTS = {
    "greater": "{} > {}",
    "greater_equal": "{} >= {}",
    "equal": "{} == {}",
    "and": "({}) & ({})",
    "or": "({}) | ({})",
    "not": "not_({})",
}


class RecordedProblem(Recorded):
    """The functions of a problem, written as code for given names of the components of y and of
    z = y1 − y.

    Raises
    ------
    CannotRecord
        If B, H or the domain cannot be recorded.
    """

    @property
    def preamble(self) -> str:
        """The import lines of the functions in the code."""
        return imports(self.tape)

    @property
    def gradient_evaluations(self) -> int:
        """The number of evaluations of ∇H in a mean gradient."""
        return self.mean.nodes

    @property
    def convergence_rate(self) -> float:
        """The relative error of Newton's matrix: the largest relative error of any recorded
        derivative.
        """
        with suppress(NoClosedForm):  # a formula with the mean gradient has raised it already
            jacobian(self.mean.value, self.z)
        return max(_RATES.get(line.name, _EXACT) for line in self.tape.lines)

    def cost(self, formula: Formula, step: Sequence[str]) -> tuple[int, int]:
        """The numbers of evaluations of ∇H, and of B (or h B + Σ c_jΔW_j G_j),
        in the formula's right side R.
        """
        equation = self.equation_of(formula, len(step))
        return equation.gradients, equation.structures

    def increment(
        self, code: CodeBuilder, formula: Formula, y: Sequence[str], z: Sequence[str], step: Sequence[str]
    ) -> list[Expression]:
        """Code of the right side R(y, z; step) of a formula; z is empty for an explicit formula."""
        equation = self.equation_of(formula, len(step), apart=bool(z))
        return printed(code, [(self.y, y), (self.z, z), (equation.step, step)], equation.R)

    def residual(
        self, code: CodeBuilder, formula: Formula, y: Sequence[str], z: Sequence[str], step: Sequence[str],
        middle: Sequence[str] = (),
    ) -> list[Expression]:  # fmt: skip
        """Code of the residual F = z − R(y, z; step); `middle` is the midpoint ȳ = y + z/2 if
        already known.
        """
        equation, F = self.equation_of(formula, len(step)), self.system(formula, len(step))[0]
        inputs = [(self.y, y), (self.z, z), (equation.step, step), (self.middle, middle)]
        return printed(code, inputs, F)

    def equation(
        self, code: CodeBuilder, formula: Formula, y: Sequence[str], z: Sequence[str], step: Sequence[str]
    ) -> tuple[list[Expression], Table]:
        """Code of F = z − R(y, z; step) and A = ∂F/∂z, from the record of the scheme's formula."""
        d, equation, (F, A) = (
            self.dimension,
            self.equation_of(formula, len(step)),
            self.system(formula, len(step)),
        )
        entries = printed(code, [(self.y, y), (self.z, z), (equation.step, step)], [*F, *A.ravel()])
        return entries[:d], _table(entries[d:], d)

    def hamiltonian(self, code: CodeBuilder, y: Sequence[str]) -> Expression:
        """Code of H(y)."""
        return self._printed(code, y, [self.H])[0]

    def gradient(self, code: CodeBuilder, y: Sequence[str]) -> list[Expression]:
        """Code of ∇H(y)."""
        return self._printed(code, y, self.slope)

    def structure(self, code: CodeBuilder, y: Sequence[str]) -> Table:
        """Code of B(y)."""
        return _table(self._printed(code, y, self.B.ravel()), self.dimension)

    def mean_gradient(self, code: CodeBuilder, y: Sequence[str], z: Sequence[str]) -> list[Expression]:
        """Code of the mean gradient ∫₀¹∇H(y + τz)dτ."""
        return self._printed(code, y, self.mean.value, z)

    def domain(self, code: CodeBuilder, y: Sequence[str]) -> str | None:
        """Code of the test that y is in the domain; None if the problem has no domain."""
        return None if self.inside is None else shown(self._printed(code, y, [self.inside])[0])

    def casimirs(self, code: CodeBuilder, y: Sequence[str]) -> list[Expression]:
        """Code of the quadratic Casimirs, then of the linear Casimirs."""
        return self._printed(code, y, self.casimir_symbols)

    @cached_property
    def casimir_symbols(self) -> list[Symbol]:
        """The quadratic, then the linear Casimirs of y."""
        y = self.y
        values = [y @ (A @ y) for A in self.problem.casimirs] + [b @ y for b in self.problem.linear_casimirs]
        return [self.tape.symbol(v) for v in values]

    @cached_property
    def directions(self) -> tuple[list[Symbol], list[Symbol], Any]:
        """A projection's directions at y, symbols that stand for them,
        and the correction of z in these symbols.

        See `sepv.schemes._projected` for the directions and the correction of z.
        """
        casimirs = self.problem.casimirs, self.problem.linear_casimirs
        orthogonal = projections(self.B, self.slope, casimir_gradients(*casimirs, 2.0 * self.y))
        values = [
            self.tape.symbol(v)
            for v in (*np.ravel(orthogonal.q), *orthogonal.inverse, *chain(*orthogonal.products))
        ]
        known = self.tape.vector(len(values))
        symbols, K = iter(known), len(orthogonal.q)
        q = [array([next(symbols) for _ in self.y], (self.dimension,)) for _ in range(K)]
        inverse = [next(symbols) for _ in range(K)]
        again = Directions(q, inverse, [[next(symbols) for _ in range(k)] for k in range(K)])
        averages = [*casimir_gradients(*casimirs, 2.0 * self.y + self.z), self.mean.value]
        return values, list(known), again.correction([dot(g, self.z) for g in averages])

    def printed_directions(self, code: CodeBuilder, end: Sequence[str]) -> list[Expression]:
        """Code of the directions of a projection at `end`, the end y* of the explicit step."""
        return self._printed(code, end, self.directions[0])

    def moved_back(
        self, code: CodeBuilder, y: Sequence[str], z: Sequence[str], known: Sequence[Expression]
    ) -> list[Expression]:
        """Code of the correction of z along directions `known`,
        from the change of the invariants from y to y + z.
        """
        _, symbols, correction = self.directions
        return printed(code, [(self.y, y), (self.z, z), (symbols, [shown(v) for v in known])], correction)

    def _printed(
        self, code: CodeBuilder, y: Sequence[str], outputs: Any, z: Sequence[str] = ()
    ) -> list[Expression]:
        return printed(code, [(self.y, y), (self.z, z)], outputs)


def printed(code: CodeBuilder, inputs: Sequence[tuple[Any, Sequence[str]]], outputs: Any) -> list[Expression]:
    """Write code of recorded outputs; `inputs` are vectors of symbols with their names in the code
    ("0.0" for zero).
    """
    values = {
        x.index: None if name == "0.0" else name
        for vector, names in inputs
        for x, name in zip(vector, names, strict=False)
    }
    return emit(code, values, list(outputs))


def imports(tape: Tape) -> str:
    """The import lines of the functions that a tape (a record of operations) uses."""
    names = {line.name for line in tape.lines}
    of = {
        "sepv.simulate._compiled.functions": {_CALLS[name][0] for name in names & _CALLS.keys()},
        "numpy": names & {"tan", "exp", "expm1", "log1p", "sqrt", "sinh", "cosh", "tanh", "arctan"},
    }
    return "".join(f"from {module} import {', '.join(sorted(own))}\n" for module, own in of.items() if own)


def _table(entries: list[Expression], d: int) -> Table:
    return [entries[i * d : (i + 1) * d] for i in range(len(entries) // d)]
