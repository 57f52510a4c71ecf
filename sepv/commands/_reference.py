"""Parts that ``sepv exact`` and ``sepv step`` share: numbers of the command line, a problem's data,
digits as text.
"""

from __future__ import annotations

import math
from typing import Any

from sepv._arguments import hex_float
from sepv.console import counted
from sepv.errors import UsageError
from sepv.problem import NamedProblem, PolynomialSystem, Problem


def numbers(text: str | None, option: str, count: int, default: Any = None) -> tuple[float, ...]:
    """Read the `count` finite numbers of an option such as --y "0.8,0.6,0x1p-3";
    for text None return `default`.
    """
    if text is None and default is not None:
        return tuple(float(v) for v in default)
    parts = [p.strip() for p in (text or "").split(",") if p.strip()]
    expected, received = f"{option}: numbers separated by commas, decimal or hexadecimal", repr(text)
    example = f"for example {option} {','.join(['0.5'] * max(count, 1))}"
    try:
        values = tuple(hex_float(p) if "x" in p.lower() else float(p) for p in parts)
    except ValueError as error:
        raise UsageError(expected=expected, received=received, remedy=example) from error
    if len(values) != count:
        expected, received = f"{counted(count, 'number')} after {option}", f"{len(values)}: {text!r}"
        each = {"--y": "one for each component of the problem", "--dW": "one for each noise of the problem"}
        raise UsageError(expected=expected, received=received, remedy=each.get(option, example))
    if not all(map(math.isfinite, values)):
        raise UsageError(expected=f"finite numbers after {option}", received=received, remedy=example)
    return values


def description(problem: Problem) -> PolynomialSystem | NamedProblem:
    """The problem as data (a name or polynomials), from which exact steps and flows are computed
    with many digits.
    """
    if problem.data is None:
        raise UsageError(
            expected="a problem by name, or polynomial data (a .json file)",
            received=f"{problem.name}, which is given by Python functions only",
            remedy="references evaluate a description at any precision; write H and B as polynomials",
        )
    return problem.data


def decimal(value: Any, digits: int) -> str:
    """Write an mpf with `digits` significant digits."""
    import mpmath

    return str(mpmath.nstr(value, digits, strip_zeros=False)) if value else "0.0"


def row(values: Any) -> str:
    """The text of a row of numbers, such as (0.8, 0.6, 0.0)."""
    return "(" + ", ".join(repr(float(v)) for v in values) + ")"
