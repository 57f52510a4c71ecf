"""Steps of schemes' equations solved in extended precision, kept between runs: they do not depend on the scheme."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

from sepv.reference.arithmetic import context
from sepv.reference.equations import Equation
from sepv.reference.steps import reference_step

from sepv._kept import kept
from sepv.problem import Description
from sepv.verification._tolerance import DIGITS


def exact_step(
    method: str | Equation, data: Description, y: Sequence[float], h: float, dW: Sequence[float],
    start: list[float] | None = None,
) -> tuple[list[Any], list[list[float]]]:  # fmt: skip
    """The solution y1 to DIGITS digits, d numbers of mpmath, and the condition (d, d) of its equation.

    Arguments and errors are those of `sepv.reference.steps.reference_step`. Only equations with a name are kept.
    """

    def solved() -> tuple[list[Any], list[list[float]]]:
        step = reference_step(method, data, y, h, dW, DIGITS, start=start)
        return [
            (int(s), int(man), int(e), int(n)) for s, man, e, n in (v._mpf_ for v in step.y1)
        ], step.condition

    if isinstance(method, str):
        question = f"{method} {data!r} {tuple(y)} {h!r} {tuple(dW)} {start}"
        parts, condition = kept("steps").get(hashlib.sha256(question.encode()).hexdigest(), solved)
    else:
        parts, condition = solved()
    return [context(DIGITS).make_mpf(part) for part in parts], condition
