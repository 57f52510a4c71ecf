"""Steps solved in extended precision. Solutions do not depend on a scheme's code,
so they are cached between runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sepv.reference.arithmetic import context
from sepv.reference.equations import Equation
from sepv.reference.steps import reference_step

from sepv._kept import kept, key_of
from sepv.law.tolerance import STATE_ERROR_DIGITS
from sepv.problem import Description


def exact_step(
    method: str | Equation, data: Description, y: Sequence[float], h: float, dW: Sequence[float],
    start: list[float] | None = None,
) -> tuple[list[Any], list[list[float]]]:  # fmt: skip
    """Return y1 to STATE_ERROR_DIGITS digits, as d numbers of mpmath, and the condition matrix (d,
    d) of the step's equation.

    Arguments and errors are those of `sepv.reference.steps.reference_step`. Only steps of named
    equations are cached.
    """

    def solved() -> tuple[list[Any], list[list[float]]]:
        step = reference_step(method, data, y, h, dW, STATE_ERROR_DIGITS, start=start)
        return [
            (int(s), int(man), int(e), int(n)) for s, man, e, n in (v._mpf_ for v in step.y1)
        ], step.condition

    if isinstance(method, str):
        parts, condition = kept("steps").get(key_of(method, data, tuple(y), h, tuple(dW), start), solved)
    else:
        parts, condition = solved()
    return [context(STATE_ERROR_DIGITS).make_mpf(part) for part in parts], condition
