"""Several steps of a path as one step, so that a law about a step can be measured in the middle of
a path.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from sepv.problem import Array, Problem
from sepv.schemes._further_increments import carry
from sepv.schemes._scheme import Scheme
from sepv.schemes._stateful import StatefulStep


@dataclass(frozen=True)
class StepsOfAPath:
    """The map y0 → y_N of N = `count` steps of a path of `scheme`, each with h/N and ΔW/N,
    as the step of a scheme.
    """

    scheme: Scheme
    count: int

    def __call__(self, problem: Problem, y: Array, h: float, dW: Array) -> Array:
        """y_N (d,) or (d, M) of the path that begins at y."""
        state: Any = None
        for _ in range(self.count):
            y, state = carry(self.scheme, problem, y, state, h / self.count, dW / self.count, any_path=True)
        return y


def has_memory(scheme: Scheme) -> bool:
    """True if the scheme carries more than y along a path."""
    return isinstance(scheme.step, StatefulStep)


def as_path(scheme: Scheme) -> tuple[Scheme, int]:
    """The scheme whose path a call follows, and the number of steps: (scheme, 1),
    except for schemes of `several`.
    """
    step = scheme.step
    return (step.scheme, step.count) if isinstance(step, StepsOfAPath) else (scheme, 1)


def several(scheme: Scheme, count: int) -> Scheme:
    """The scheme whose step is `count` steps of a path of `scheme`, each of the size h/count."""
    return replace(scheme, step=StepsOfAPath(scheme, count), solve=None, asks="")


def resumed(scheme: Scheme, state: Any) -> Scheme:
    """The scheme whose first step goes on from `state`,
    the one that a path carries at the y of the step.

    It takes one state a call. Without a state it is `scheme` itself, at the beginning of a path.
    """
    if state is None:
        return scheme
    assert isinstance(scheme.step, StatefulStep)
    rule = StatefulStep(lambda _problem, _y: state, scheme.step.step, scheme.step.value)
    return replace(scheme, step=rule, solve=None, batched=False)
