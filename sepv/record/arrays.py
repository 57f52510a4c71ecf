"""Records as functions of NumPy arrays: a generated function of one elementwise operation a line."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sepv.record.derivative import reachable
from sepv.record.functions import FUNCTIONS
from sepv.record.symbols import Symbol

Array = NDArray[np.float64]

_TEXTS = {
    "add": "{} + {}",
    "subtract": "{} - {}",
    "multiply": "{} * {}",
    "whole": "{} * {}",
    "divide": "{} / {}",
    "negative": "-{}",
    "greater": "{} > {}",
    "greater_equal": "{} >= {}",
    "equal": "{} == {}",
    "and": "logical_and({}, {})",
    "or": "logical_or({}, {})",
    "not": "logical_not({})",
    "select": "where({}, {}, {})",
}
_NAMES: dict[str, Any] = {
    **{name: function.value for name, function in FUNCTIONS.items()},
    **{name: getattr(np, name) for name in ("where", "power", "logical_and", "logical_or", "logical_not")},
    "inf": np.inf,
}


def source(inputs: Sequence[Any], outputs: Any, name: str = "evaluate") -> str:
    """The function's text: an argument for each vector of inputs, the components of the outputs in a tuple."""
    tape = inputs[0][0].tape
    wanted = [tape.symbol(v) for v in np.asarray(outputs, dtype=object).ravel()]
    places = {x.index: f"x{n}[{i}]" for n, vector in enumerate(inputs) for i, x in enumerate(vector)}
    lines = [f"def {name}({', '.join(f'x{n}' for n in range(len(inputs)))}):"]
    shown: dict[int, str] = {}
    for symbol in reachable(wanted):
        index, line = symbol.index, symbol.line
        if line.name == "constant":
            shown[index] = repr(line.value) if line.value >= 0 else f"({line.value!r})"
            continue
        text = (
            places[index]
            if line.name == "input"
            else _text(line.name, line.value, [shown[i] for i in line.arguments])
        )
        shown[index] = f"t{index}"
        lines.append(f"    t{index} = {text}")
    lines.append(f"    return ({''.join(shown[s.index] + ', ' for s in wanted)})")
    return "\n".join(lines)


def _text(name: str, value: float, arguments: list[str]) -> str:
    if name == "power":
        return f"power({arguments[0]}, {value!r})"
    if name in _TEXTS:
        return _TEXTS[name].format(*arguments)
    return f"{name}({arguments[0]})"


def compiled(inputs: Sequence[Any], outputs: Any) -> Callable[..., tuple[Any, ...]]:
    """The components of the outputs one by one, as a function of sequences of the inputs' components.

    Components may be arrays or numbers; a constant component comes as a number whatever they are.
    """
    namespace = dict(_NAMES)
    exec(compile(source(inputs, outputs), "<record>", "exec"), namespace)
    function: Callable[..., tuple[Any, ...]] = namespace["evaluate"]
    return function


def evaluator(inputs: Sequence[Any], outputs: Any) -> Callable[..., Array]:
    """The outputs as a function of arrays (d, ...), of shape (*outputs.shape, ...)."""
    shape = np.shape(outputs)
    function = compiled(inputs, outputs)

    def evaluate(*arguments: Array) -> Array:
        values = function(*arguments)
        batch = np.shape(arguments[0])[1:]
        found = np.empty((len(values), *batch), dtype=np.result_type(*arguments, np.float64))
        for i, value in enumerate(values):
            found[i] = value
        return found.reshape(shape + batch)

    return evaluate


def is_symbolic(y: Any) -> bool:
    """Whether an array holds symbols, and not numbers."""
    return isinstance(y, Symbol) or (isinstance(y, np.ndarray) and y.dtype == object)
