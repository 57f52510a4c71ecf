"""Counts of evaluations of B, ∇H and the like: a scheme gets a copy of the problem whose functions
count their calls.

Each count is the exact number of states at which a function was evaluated, whatever the scheme
reports. So a single additional evaluation is seen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import prod
from typing import Any

import numpy as np

from sepv.problem import Problem

# The functions of a problem whose evaluations are counted, and the kind of evaluation that each is
# counted as.
KIND_OF_EVALUATION = {
    "gradient": "gradient",
    "mean_gradient": "gradient",  # a closed form replaces a quadrature of ∇H
    "structure": "structure",
    "hamiltonian": "hamiltonian",
    "hessian": "hessian",
    "structure_derivative": "structure derivative",
}
EVALUATION_KINDS = tuple(dict.fromkeys(KIND_OF_EVALUATION.values()))


@dataclass
class Work:
    """The number of states at which each function was evaluated,
    and the Newton iterations that the scheme reports.
    """

    evaluations: dict[str, int] = field(default_factory=lambda: dict.fromkeys(EVALUATION_KINDS, 0))
    iterations: int | None = None

    def to_json(self) -> dict[str, int | None]:
        """The evaluations by kind, and the iterations,
        which are None if the scheme does not report them.
        """
        return {**self.evaluations, "iterations": self.iterations}


def counted(problem: Problem, work: Work) -> Problem:
    """A copy of the problem whose functions add the number of states of each call to `work`."""

    def counting(kind: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def wrapper(y: Any, *more: Any) -> Any:
            work.evaluations[kind] += prod(np.shape(y)[1:])
            return function(y, *more)

        return wrapper

    wrapped: dict[str, Any] = {
        name: counting(kind, getattr(problem, name))
        for name, kind in KIND_OF_EVALUATION.items()
        if getattr(problem, name) is not None
    }
    return replace(problem, **wrapped, check=False)
