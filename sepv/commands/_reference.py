"""Parts that ``sepv exact`` and ``sepv step`` share: numbers of the command line, a problem's data,
digits as text.
"""

from __future__ import annotations

from typing import Any

from sepv.console import counted
from sepv.errors import UsageError
from sepv.problem import NamedProblem, PolynomialSystem, Problem


def numbers(
    given: tuple[float, ...] | None, option: str, count: int, default: Any = None
) -> tuple[float, ...]:
    """The `count` numbers given to an option such as --y 0.8,0.6,0x1p-3; for None the `default`."""
    if given is None and default is not None:
        return tuple(float(v) for v in default)
    if given is None or len(given) != count:
        each = {"--y": "one for each component of the problem", "--dW": "one for each noise of the problem"}
        raise UsageError(
            expected=f"{counted(count, 'number')} after {option}",
            received="none" if given is None else f"{len(given)}: {row(given)}",
            remedy=each.get(option, f"for example {option} 0.5"),
        )
    return given


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
