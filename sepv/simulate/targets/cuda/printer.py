"""Recorded operations printed as C: a line for each, in the order and with the roundings of NumPy's
code.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sepv.record import reachable

_C_TEXTS = {
    "add": "{} + {}",
    "subtract": "{} - {}",
    "multiply": "{} * {}",
    "whole": "{} * {}",
    "divide": "{} / {}",
    "negative": "-{}",
    "greater": "{} > {}",
    "greater_equal": "{} >= {}",
    "equal": "{} == {}",
    "and": "{} && {}",
    "or": "{} || {}",
    "not": "!{}",
    "select": "{} ? {} : {}",
    "arctan": "atan({})",
}
_CONDITION_OPERATIONS = {"greater", "greater_equal", "equal", "and", "or", "not"}


def number(value: float) -> str:
    """A number as a C literal with all its bits."""
    if math.isinf(value):
        return "INF" if value > 0 else "(-INF)"
    text = repr(value) if value == round(value, 3) and abs(value) < 1e6 else value.hex()
    return f"({text})" if math.copysign(1.0, value) < 0 else text


def statements(names: Mapping[int, str], outputs: Mapping[str, Any]) -> list[str]:
    """C statements that assign recorded `outputs` {place: symbol};
    `names` has the texts of inputs by line number.
    """
    shown = dict(names)
    lines = []
    for symbol in reachable(outputs.values(), names) if outputs else []:
        index, line = symbol.index, symbol.line
        if index in shown:
            continue
        if line.name == "constant":
            shown[index] = number(line.value)
            continue
        arguments = [shown[i] for i in line.arguments]
        if line.name == "power":
            text = f"pow({arguments[0]}, {number(line.value)})"
        else:
            text = _C_TEXTS.get(line.name, f"{line.name}({{}})").format(*arguments)
        shown[index] = f"t{index}"
        lines.append(f"const {'int' if line.name in _CONDITION_OPERATIONS else 'double'} t{index} = {text};")
    return [*lines, *(f"{place} = {shown[symbol.index]};" for place, symbol in outputs.items())]


def function(
    head: str, inputs: Mapping[str, Any], outputs: Mapping[str, Any], last: Sequence[str] = ()
) -> str:
    """A C function: its head, and code that fills arrays by name from vectors of symbols by name.

    An output is an array of symbols; the name "return" stands for a single symbol that the function
    returns.
    """
    names = {x.index: f"{name}[{i}]" for name, vector in inputs.items() for i, x in enumerate(vector)}
    places: dict[str, Any] = {}
    for name, values in outputs.items():
        if name == "return":
            places["const int found"] = values
        else:
            places |= {f"{name}[{i}]": v for i, v in enumerate(np.ravel(values))}
    body = [*statements(names, places), *last, *(["return found;"] if "return" in outputs else [])]
    return "\n".join([f"DEVICE {head} {{", *(f"  {line}" for line in body), "}"])


def table(kind: str, name: str, values: Any) -> str:
    """A constant C array of numbers."""
    flat = np.ravel(values)
    shown = [str(int(v)) if kind == "int" else number(float(v)) for v in flat]
    return f"CONSTANT {kind} {name}[{max(len(shown), 1)}] = {{{', '.join(shown) or '0'}}};"
