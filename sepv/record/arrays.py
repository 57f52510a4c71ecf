"""Records as functions of NumPy arrays: a generated function of one elementwise operation a line."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sepv.record.derivative import reachable
from sepv.record.functions import FUNCTIONS

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


@lru_cache(maxsize=256)
def _compiled(text: str) -> Callable[..., tuple[Any, ...]]:
    namespace = dict(_NAMES)
    exec(compile(text, "<record>", "exec"), namespace)
    function: Callable[..., tuple[Any, ...]] = namespace["evaluate"]
    return function


@dataclass(frozen=True)
class Evaluator:
    """Outputs of a shape as a function of arrays (d, ...): their text, so that it travels to other processes."""

    text: str
    shape: tuple[int, ...]

    def __call__(self, *arguments: Array) -> Array:
        """The outputs, of shape (*shape, ...)."""
        # Arrays, because a number of Python's divided by zero raises.
        given = [np.asarray(a) for a in arguments]
        values = _compiled(self.text)(*given)
        batch = given[0].shape[1:]
        found = np.empty((len(values), *batch), dtype=np.result_type(*given, np.float64))
        for i, value in enumerate(values):
            found[i] = value
        return found.reshape(self.shape + batch)


def evaluator(inputs: Sequence[Any], outputs: Any) -> Evaluator:
    """The outputs, an array of symbols, as a function of arrays, one for each vector of inputs."""
    return Evaluator(source(inputs, outputs), np.shape(outputs))
