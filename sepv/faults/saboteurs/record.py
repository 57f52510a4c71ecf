"""The class of saboteurs, which are schemes broken on purpose, and functions that make them,
mostly from (2.1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from sepv import schemes
from sepv.core.formula import Formula, counted
from sepv.problem import Array, Problem
from sepv.schemes import Parts, Scheme, Step, as_lanes, random_step
from sepv.schemes import energy_preserving as original
from sepv.schemes import energy_preserving_formula as formula

Laws = tuple[str, ...]
CONTRACT = ("contract",)
# A function (problem, y0 (d, M), Δ (1, M)) -> y1.
Update = Callable[[Problem, Array, Array], Array]
FaultFunction = TypeVar("FaultFunction", bound=Callable[..., Any])
# A row: name, fault, the laws, and the argument that `By` turns into `make` of a `Saboteur`.
Row = tuple[Any, ...]
By = Callable[[Any], Callable[[], Scheme]]


@dataclass(frozen=True)
class Saboteur:
    """A scheme with one fault that still has all claims of the right scheme: (2.1),
    or the scheme that it imitates.
    """

    name: str
    family: str
    broken: str  # the fault, in one sentence
    make: Callable[[], Scheme]  # makes a new scheme, without memory of calls of an older one
    caught_by: tuple[str, ...]  # the laws that must catch it, by theory
    thread: str = ""  # the report of the fault in a real program; empty for an invented one

    @property
    def scheme(self) -> Scheme:
        """A new scheme with this saboteur's name."""
        return replace(self.make(), name=self.name, source=f"saboteur: {self.broken}")


def claiming(step: Step, **changes: Any) -> Scheme:
    """A scheme with this step and the claims of (2.1). Its `solve` is None,
    so that nothing bypasses `step`.
    """
    return replace(original, step=step, solve=None, **changes)


def middle(y: Any, z: Any) -> Any:
    """The midpoint ȳ = y + z/2."""
    return y + 0.5 * z


def right_side(problem: Problem, y0: Array, y1: Array, step: Array) -> Array:
    """The right side Δ B(ȳ) ∇̄H of (2.1), with ∇̄H = ∫∇H and Δ = `step`,
    for y0 and y1 of shape (d,) or (d, M).
    """
    lanes = (len(y0), -1)
    increment = counted(formula, problem, y0.reshape(lanes), y1.reshape(lanes), step.reshape(1, -1))
    return increment.value.reshape(y0.shape)


def explicit_step(update: Update) -> Step:
    """The step y1 = update(problem, y0, Δ), for formulas that are explicit or contain their own
    solver.
    """

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y0, noise = as_lanes(problem, y, h, dW)
        return update(problem, y0, random_step(problem, h, noise)).reshape(np.shape(y))

    return step


def implicit(R: Formula, parts: Parts = random_step, **more: Any) -> Callable[[], Scheme]:
    """Make a function that returns (2.1) with the step y1 = y0 + R(…);
    `parts` computes the data of R, such as Δ.
    """
    return lambda: claiming(schemes.implicit(R, parts=parts, **more))


def explicit(update: Update) -> Callable[[], Scheme]:
    """Make a function that returns a scheme with the claims of (2.1)
    and the step y1 = update(problem, y0, Δ).
    """
    return lambda: claiming(explicit_step(update))


def around(change: Callable[..., Array], memory: Callable[[], Any] | None = None) -> Callable[[], Scheme]:
    """Make a function that returns (2.1) with its step replaced by change(old step, problem, y, h,
    dW).

    If `memory` is given, the first argument of `change` is an object memory(), which is made anew
    for each scheme.
    """
    return lambda: claiming(partial(change, *([memory()] if memory else []), original.step))


def imitating(original: Scheme, step: Step, **changes: Any) -> Callable[[], Scheme]:
    """Make a function that returns the scheme `original` with another step and unchanged claims."""
    return lambda: replace(original, step=step, solve=None, **changes)


def answering(change: Callable[[Array, Array], Any]) -> Callable[[], Scheme]:
    """Make a function that returns (2.1) with the result of each step replaced by change(y, y1)."""
    return around(lambda step, problem, y, h, dW: change(y, step(problem, y, h, dW)))


def unchanged(make: Callable[[], Scheme]) -> Callable[[], Scheme]:
    """Return `make` itself, for rows that contain a function which makes a whole broken scheme."""
    return make


class Family(list[Saboteur]):
    """A list of saboteurs in the order of their definition,
    added by rows of a table or by decorated functions.

    `by` makes the whole scheme from the broken part. A saboteur has its decorated function's name,
    with hyphens.
    """

    def __init__(self, name: str) -> None:
        super().__init__()
        self.name = name

    def rows(self, *rows: Row, by: By = unchanged) -> None:
        """Add saboteurs by rows: name, fault in words, laws that find it, broken part,
        and a real fault's report.
        """
        for name, broken, laws, fault, *thread in rows:
            self.append(Saboteur(name, self.name, broken, by(fault), laws, *thread))

    def made(self, broken: str, laws: Laws, by: By) -> Callable[[FaultFunction], FaultFunction]:
        """Decorate the broken part of a saboteur, a function; `by` makes the scheme.
        `broken` states the fault.
        """

        def added(fault: FaultFunction) -> FaultFunction:
            self.rows((fault.__name__.replace("_", "-"), broken, laws, fault), by=by)
            return fault

        return added

    def like(self, right: Scheme, broken: str, laws: Laws) -> Callable[[FaultFunction], FaultFunction]:
        """Decorate a broken step: the saboteur is the scheme `right` with this step.
        `broken` is the fault in words.
        """
        return self.made(broken, laws, partial(imitating, right))

    def formula(self, broken: str, laws: Laws, **more: Any) -> Callable[[FaultFunction], FaultFunction]:
        """Decorate a broken right side R: the saboteur is (2.1) with y1 = y0 + R.
        `broken` is the fault in words.
        """
        return self.made(broken, laws, partial(implicit, **more))

    def around(self, broken: str, laws: Laws, memory: Any = None) -> Callable[[FaultFunction], FaultFunction]:
        """Decorate a broken step: a function of (2.1)'s own step, problem, y, h, dW.
        `broken` is the fault in words.
        """
        return self.made(broken, laws, partial(around, memory=memory))
