"""Recorded functions as functions of NumPy arrays, written as Python code with one elementwise
operation a line.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sepv.record._derivative import reachable
from sepv.record._functions import FUNCTIONS

Array = NDArray[np.float64]

_NUMPY_TEXTS = {
    "add": "{} + {}",
    "subtract": "{} - {}",
    "multiply": "{} * {}",
    "whole": "{} * {}",
    "divide": "{} / {}",
    "negative": "-{}",
    "greater": "{} > {}",
    "greater_equal": "{} >= {}",
    "equal": "{} == {}",
    "and": "({}) & ({})",
    "or": "({}) | ({})",
    "not": "logical_not({})",
    "select": "where({}, {}, {})",
}


def number_or_array(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate `function` to return a Python float for a Python float,
    because Python's floats are the fastest.
    """
    return lambda x, *more: float(function(x, *more)) if isinstance(x, float) else function(x, *more)


_NUMPY_FUNCTIONS: dict[str, Any] = {
    **{name: number_or_array(function.value) for name, function in FUNCTIONS.items()},
    "power": number_or_array(np.power),
    "where": lambda condition, a, b: (
        (a if condition else b) if isinstance(condition, (bool, np.bool_)) else np.where(condition, a, b)
    ),
    "logical_not": np.logical_not,
    "inf": np.inf,
}


# Constants that are written into the text of a function. Other constants are parameters, so that
# functions that differ only in them share one text.
_WRITTEN_CONSTANTS = {0.0, 0.5, 1.0, 2.0, 3.0, -0.5, -1.0, -2.0, -3.0, math.inf, -math.inf}


class Source(NamedTuple):
    """A Python function of arrays as text, and the numbers `parameters`,
    which are the function's last argument.
    """

    text: str
    parameters: tuple[float, ...]

    @property
    def function(self) -> Callable[..., tuple[Any, ...]]:
        """The compiled function. Its arguments are the components of each input vector,
        and at last the parameters.
        """
        return _compiled(self.text)


def source(inputs: Sequence[Any], outputs: Any) -> Source:
    """Write recorded outputs as the Python text of a function,
    which has an argument for each vector of inputs.

    The function returns the components of the outputs as a tuple.
    """
    tape = inputs[0][0].tape
    wanted = [tape.symbol(v) for v in np.asarray(outputs, dtype=object).ravel()]
    places = {x.index: f"x{n}[{i}]" for n, vector in enumerate(inputs) for i, x in enumerate(vector)}
    lines = [f"def evaluate({', '.join(f'x{n}' for n in range(len(inputs)))}, p):"]
    shown: dict[int, str] = {}
    parameters: dict[float, int] = {}
    order = reachable(wanted)
    last = {i: symbol.index for symbol in order for i in symbol.line.arguments}
    last.update((symbol.index, -1) for symbol in wanted)
    free: list[str] = []
    for symbol in order:
        index, line = symbol.index, symbol.line
        if line.name == "constant":
            number = (
                parameters.setdefault(line.value, len(parameters))
                if line.value not in _WRITTEN_CONSTANTS
                else 0
            )
            shown[index] = f"({line.value!r})" if line.value in _WRITTEN_CONSTANTS else f"p[{number}]"
            continue
        arguments = [shown[i] for i in line.arguments]
        if line.name == "input":
            text = places[index]
        elif line.name == "power":
            text = f"power({arguments[0]}, {line.value!r})"
        else:
            text = _NUMPY_TEXTS.get(line.name, f"{line.name}({{}})").format(*arguments)
        # Names whose values are no longer needed are used again, so that fewer arrays fill the
        # processor's cache.
        free += sorted({shown[i] for i in line.arguments if last[i] == index and shown[i][0] == "t"})
        shown[index] = free.pop() if free else f"t{index}"
        lines.append(f"    {shown[index]} = {text}")
    lines.append(f"    return ({''.join(shown[s.index] + ', ' for s in wanted)})")
    return Source("\n".join(lines), tuple(parameters))


@lru_cache(maxsize=256)
def _compiled(text: str) -> Callable[..., tuple[Any, ...]]:
    namespace = dict(_NUMPY_FUNCTIONS)
    exec(compile(text, "<record>", "exec"), namespace)
    function: Callable[..., tuple[Any, ...]] = namespace["evaluate"]
    return function


@dataclass(frozen=True)
class Evaluator:
    """A recorded function of arrays (d, ...), stored as Python text, so that it can be pickled.

    The result has the shape (*shape, ...). `places` are the indices of its components that are not
    identically zero.
    """

    source: Source
    shape: tuple[int, ...]
    places: tuple[int, ...]

    def __call__(self, *arguments: Array) -> Array:
        """The value of the function at arrays (d, ...). It has the shape (*self.shape, ...)."""
        given = [np.asarray(a) for a in arguments]
        try:
            values = self.source.function(*given, self.source.parameters)
        except ZeroDivisionError:  # Python numbers of a single state raise; arrays become infinite
            return np.asarray(self(*(a[..., None] for a in given))[..., 0])
        batch = given[0].shape[1:]
        filled = np.zeros((prod(self.shape), *batch), dtype=np.result_type(*given, np.float64))
        for i, value in zip(self.places, values, strict=True):
            filled[i] = value
        return filled.reshape(self.shape + batch)


def evaluator(inputs: Sequence[Any], outputs: Any) -> Evaluator:
    """Compile an array of symbols to a function that takes an array for each vector of inputs."""
    flat = np.asarray(outputs, dtype=object).ravel()
    tape = inputs[0][0].tape
    zero = tape.constant(0.0)  # by far the most entries of a derivative are this very symbol
    places = tuple(i for i, v in enumerate(flat) if v is not zero and tape.symbol(v).number != 0)
    return Evaluator(source(inputs, [flat[i] for i in places]), np.shape(outputs), places)
