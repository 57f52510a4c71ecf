"""Exact derivatives of recorded functions, on the same tape,
so that they use the functions' operations again.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable
from typing import Any

import numpy as np

from sepv.record._functions import FUNCTIONS
from sepv.record._numpy_protocol import CannotRecord, SymbolArray, select
from sepv.record._symbols import Symbol, array

# Operations whose derivative is taken as 0: inputs, constants, and comparisons, which are piecewise
# constant.
_CONSTANT_OPERATIONS = {"input", "constant", "greater", "greater_equal", "equal", "and", "or", "not"}


def reachable(outputs: Iterable[Symbol], given: Container[int] = ()) -> list[Symbol]:
    """The outputs and all symbols that they depend on, in the order of evaluation.

    A symbol whose line number is in `given` is included, but the search does not go on to its
    arguments.
    """
    outputs, seen = list(outputs), set()
    waiting = [symbol.index for symbol in outputs]
    while waiting:
        index = waiting.pop()
        if index not in seen:
            seen.add(index)
            if index not in given:
                waiting.extend(outputs[0].tape.lines[index].arguments)
    return [Symbol(outputs[0].tape, index) for index in sorted(seen)]


def _partials(symbol: Symbol) -> tuple[Any, ...]:
    """The partial derivatives of the operation that made `symbol`,
    by each argument of the operation.
    """
    name, arguments = symbol.line.name, symbol.arguments
    if name in FUNCTIONS:
        slope = FUNCTIONS[name].slope
        if slope is None:
            raise CannotRecord(f"{name} is differentiated no further")
        return (slope(arguments[0], symbol),)
    return _DERIVATIVE_RULES[name](symbol, *arguments)


# The derivatives of each operation, as functions of its symbol and its arguments.
_DERIVATIVE_RULES: dict[str, Callable[..., tuple[Any, ...]]] = {
    "add": lambda *_: (1.0, 1.0),
    "subtract": lambda *_: (1.0, -1.0),
    "negative": lambda *_: (-1.0,),
    "multiply": lambda _, a, b: (b, a),
    # In xⁿ = x^(n−1)·x the derivative by x^(n−1) is set to 0, because n x^(n−1), that by x, is
    # already (xⁿ)′.
    "whole": lambda s, lower, _: (0.0, s.line.value * lower),
    "divide": lambda s, _, b: (1 / b, -(s / b)),
    "power": lambda s, a: (s.line.value * a ** (s.line.value - 1),),
    "select": lambda _, condition, *__: (0.0, select(condition, 1.0, 0.0), select(condition, 0.0, 1.0)),
}


def jacobian(outputs: Any, inputs: Any) -> Any:
    """The derivatives ∂outputs/∂inputs (n, d) for arrays of symbols (n,) and (d,),
    by forward differentiation.
    """
    outputs, inputs = np.asarray(outputs, dtype=object), np.asarray(inputs, dtype=object)
    tape = inputs[0].tape
    rows = [tape.symbol(v) for v in outputs]
    column = {x.index: k for k, x in enumerate(inputs)}
    slopes: dict[int, dict[int, Symbol]] = {}
    for symbol in reachable(rows):
        index = symbol.index
        if index in column:
            slopes[index] = {column[index]: tape.constant(1.0)}
            continue
        fixed, declared = tape.declared.get(index, (set(), {}))
        if declared and not slopes.keys() & fixed:
            slopes[index] = _chain(declared.items(), slopes)
        elif symbol.line.name not in _CONSTANT_OPERATIONS and any(i in slopes for i in symbol.line.arguments):
            slopes[index] = _chain(zip(symbol.line.arguments, _partials(symbol), strict=True), slopes)
    # Most of the entries are zero: B′ has d³ entries, of which the user's B has some.
    entries = np.full((len(rows), len(inputs)), tape.constant(0.0), dtype=object)
    for place, row in enumerate(rows):
        for k, slope in slopes.get(row.index, {}).items():
            entries[place, k] = slope
    return entries.view(SymbolArray)


def _chain(partials: Iterable[tuple[int, Any]], slopes: dict[int, dict[int, Symbol]]) -> dict[int, Symbol]:
    """The derivatives of an operation by the inputs, from its `partials` and its arguments'
    `slopes` (chain rule).
    """
    total: dict[int, Symbol] = {}
    for i, partial in partials:
        for k, slope in slopes.get(i, {}).items():
            term = partial * slope
            total[k] = total[k] + term if k in total else term
    return total


def gradient(output: Any, inputs: Any) -> Any:
    """The gradient (d,) of an output by the inputs, in reverse mode,
    by a few times the output's own operations.
    """
    inputs = np.asarray(inputs, dtype=object)
    tape = inputs[0].tape
    last = tape.symbol(output)
    zero = tape.constant(0.0)
    adjoints: dict[int, Any] = {last.index: tape.constant(1.0)}
    wanted = {x.index for x in inputs}
    for symbol in reversed(reachable([last])):
        if symbol.index in wanted or symbol.line.name in _CONSTANT_OPERATIONS or symbol.index not in adjoints:
            continue
        adjoint = adjoints[symbol.index]
        for i, partial in zip(symbol.line.arguments, _partials(symbol), strict=True):
            term = partial * adjoint
            if tape.symbol(term).number != 0:
                adjoints[i] = adjoints[i] + term if i in adjoints else term
    return array(tape.symbol(adjoints.get(x.index, zero)) for x in inputs)


def hessian(slope: Any, inputs: Any) -> Any:
    """The second derivatives (d, d), from the gradient `slope`; the entries (i, j) and (j, i)
    are the same symbol.
    """
    second = jacobian(slope, inputs)
    d = len(second)
    return array((second[min(i, k), max(i, k)] for i in range(d) for k in range(d)), (d, d))
