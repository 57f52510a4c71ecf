"""What a saboteur is, and the few ways to make one out of (2.1) with a single thing broken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sepv.problem import Array, Problem
from sepv.schemes import Scheme
from sepv.schemes import _one_step as one_step
from sepv.schemes import energy_preserving as original
from sepv.schemes._energy_preserving import formula
from sepv.schemes._one_step import Parts, random_step
from sepv.schemes._scheme import Step, as_lanes
from sepv.solve._formula import Formula, counted


@dataclass(frozen=True)
class Saboteur:
    """A scheme that claims all that (2.1) claims, with one thing broken.

    Attributes
    ----------
    broken : str
        What is wrong, in one sentence.
    make : () -> Scheme
        A new scheme, which remembers nothing of the calls that another one has had.
    caught_by : tuple of law names
        The laws that must catch it, by theory.
    thread : str
        Where the fault was found in a real program; empty for one that was thought of.
    """

    name: str
    family: str
    broken: str
    make: Callable[[], Scheme]
    caught_by: tuple[str, ...]
    thread: str = ""

    @property
    def scheme(self) -> Scheme:
        """A new scheme by this saboteur's name."""
        return replace(self.make(), name=self.name, source=f"saboteur: {self.broken}")


def claiming(step: Step, **changes: Any) -> Scheme:
    """A scheme with this step that claims what (2.1) claims; `solve` is gone, so that only `step` is asked."""
    return replace(original, step=step, solve=None, **changes)


def middle(y: Any, z: Any) -> Any:
    """ȳ = y + z/2."""
    return y + 0.5 * z


def right_side(problem: Problem, y0: Array, y1: Array, step: Array) -> Array:
    """What is right, Δ B(ȳ) ∇̄H of (2.1), for y0 and y1 of shape (d,) or (d, M) and `step` holding Δ."""
    lanes = (len(y0), -1)
    found = counted(formula, problem, y0.reshape(lanes), y1.reshape(lanes), step.reshape(1, -1))
    return found.value.reshape(y0.shape)


def explicit_step(update: Callable[[Problem, Array, Array], Array], parts: Parts = random_step) -> Step:
    """The step y1 = update(problem, y0, parts), for formulas that need no solver or bring their own."""

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y0, noise = as_lanes(problem, y, h, dW)
        return update(problem, y0, parts(problem, h, noise)).reshape(np.shape(y))

    return step


def implicit(R: Formula, parts: Parts = random_step, **more: Any) -> Callable[[], Scheme]:
    """`make` of a saboteur with another right side, or another idea of the step."""
    return lambda: claiming(one_step.implicit(R, parts=parts, **more))


def explicit(
    update: Callable[[Problem, Array, Array], Array], parts: Parts = random_step
) -> Callable[[], Scheme]:
    """`make` of a saboteur with another update."""
    return lambda: claiming(explicit_step(update, parts))


def around(step: Callable[[Step], Step], **changes: Any) -> Callable[[], Scheme]:
    """`make` of a saboteur that puts something around the right step; its memory begins anew each time."""
    return lambda: claiming(step(original.step), **changes)
