"""Evaluation of recorded operations with any values that have arithmetic: other symbols,
numbers of any precision.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from sepv.record._derivative import reachable
from sepv.record._numpy_protocol import select
from sepv.record._symbols import Symbol, array

ARITHMETIC: dict[str, Callable[..., Any]] = {
    "add": operator.add,
    "subtract": operator.sub,
    "multiply": operator.mul,
    "whole": operator.mul,
    "divide": operator.truediv,
    "negative": operator.neg,
    "greater": operator.gt,
    "greater_equal": operator.ge,
    "equal": operator.eq,
    "and": operator.and_,
    "or": operator.or_,
    "not": lambda a: ~a if isinstance(a, Symbol) else not a,
    "select": select,
}


def replay(
    outputs: Iterable[Symbol],
    values: Mapping[int, Any],
    function: Callable[[str, Any], Any],
    constant: Callable[[float], Any] = float,
    power: Callable[[Any, float], Any] = operator.pow,
    operations: Mapping[str, Callable[..., Any]] = ARITHMETIC,
) -> list[Any]:
    """The values of recorded outputs, computed from `values` {line number:
    value} of inputs or of other lines.

    `function` evaluates an elementary function, given its name and argument, and `operations` all
    other operations, by default those of Python's operators. An input without value raises
    KeyError.
    """
    outputs = list(outputs)
    computed: dict[int, Any] = {}
    for symbol in reachable(outputs, values):
        line = symbol.line
        if symbol.index in values:
            computed[symbol.index] = values[symbol.index]
            continue
        arguments = [computed[i] for i in line.arguments]
        if line.name == "input":
            raise KeyError(symbol.index)
        if line.name == "constant":
            value = constant(line.value)
        elif line.name == "power":
            value = power(arguments[0], line.value)
        elif line.name in operations:
            value = operations[line.name](*arguments)
        else:
            value = function(line.name, arguments[0])
        computed[symbol.index] = value
    return [computed[s.index] for s in outputs]


def substitute(outputs: Any, inputs: Any, by: Any) -> Any:
    """The outputs as an array of symbols, with the symbols or numbers `by` in the place of the
    inputs.
    """
    outputs = np.asarray(outputs, dtype=object)
    tape = np.asarray(inputs, dtype=object)[0].tape
    rows = [tape.symbol(v) for v in outputs.ravel()]
    values = {x.index: tape.symbol(v) for x, v in zip(inputs, by, strict=True)}
    replayed = replay(rows, values, lambda name, x: x.apply(name), tape.constant)
    return array(replayed, outputs.shape)
