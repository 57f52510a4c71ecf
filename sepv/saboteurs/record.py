"""What a saboteur is, and the few ways to make one out of (2.1) with a single thing broken."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from sepv.average import average_gradient
from sepv.fields import matvec
from sepv.implicit import Increment, JacobianFunction, Solution
from sepv.implicit import solve as solve_implicit
from sepv.problem import Array, Problem
from sepv.scheme import Scheme, Step, as_lanes, step_by
from sepv.schemes import energy_preserving as original

# R(problem, y0, y1, step) of shape (d, M), step being (k, M): the right side of an implicit equation.
RightSide = Callable[[Problem, Array, Array, Array], Array]
# (problem, h, noise) -> (k, M): what the right side needs to know of the step.
Parts = Callable[[Problem, float, Array], Array]


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
    """

    name: str
    family: str
    broken: str
    make: Callable[[], Scheme]
    caught_by: tuple[str, ...]

    @property
    def scheme(self) -> Scheme:
        """A new scheme by this saboteur's name."""
        return replace(self.make(), name=self.name, source=f"saboteur: {self.broken}")


def claiming(step: Step, **changes: Any) -> Scheme:
    """A scheme with this step that claims what (2.1) claims; `solve` is gone, so that only `step` is asked."""
    return replace(original, step=step, solve=None, **changes)


def random_step(problem: Problem, h: float, noise: Array) -> Array:
    """Δ, (1, M): what is right."""
    return problem.random_step(h, noise)[None]


def drift_and_noise(problem: Problem, h: float, noise: Array) -> Array:
    """h and S = Σ c_j ΔW_j, (2, M), for schemes that treat them differently."""
    return np.stack([np.full(noise.shape[1], float(h)), problem.random_step(0.0, noise)])


def mean(problem: Problem, y0: Array, y1: Array) -> Array:
    """∫₀¹∇H(y0 + τ(y1 − y0))dτ."""
    return average_gradient(problem, y0, y1).value


def middle(y0: Array, y1: Array) -> Array:
    """(y0 + y1)/2, as the core writes it."""
    return y0 + 0.5 * (y1 - y0)


def right_side(problem: Problem, y0: Array, y1: Array, step: Array) -> Array:
    """Δ B(ȳ) ∇̄H of (2.1): what is right."""
    return step[0] * matvec(problem.structure(middle(y0, y1)), mean(problem, y0, y1))


def implicit_step(R: RightSide, parts: Parts = random_step, jacobian: JacobianFunction | None = None) -> Step:
    """The step y1 = y0 + R(y0, y1), solved to stagnation by the core; Jacobians from differences of R."""

    def increment(problem: Problem, y0: Array, y1: Array, step: Array) -> Increment:
        once = np.ones(y0.shape[1], dtype=np.int64)
        return Increment(R(problem, y0, y1, step), once, once, once.astype(bool))

    def solve(problem: Problem, y: Array, h: float, dW: Array) -> Solution:
        y0, noise = as_lanes(problem, y, h, dW)
        return solve_implicit(problem, y0, parts(problem, h, noise), increment, jacobian or (lambda *_: None))

    return partial(step_by, solve)


def explicit_step(update: Callable[[Problem, Array, Array], Array], parts: Parts = random_step) -> Step:
    """The step y1 = update(problem, y0, parts), for formulas that need no solver or bring their own."""

    def step(problem: Problem, y: Array, h: float, dW: Array) -> Array:
        y0, noise = as_lanes(problem, y, h, dW)
        return update(problem, y0, parts(problem, h, noise)).reshape(np.shape(y))

    return step


def implicit(
    R: RightSide, parts: Parts = random_step, jacobian: JacobianFunction | None = None
) -> Callable[[], Scheme]:
    """`make` of a saboteur with another right side, or another idea of the step."""
    return lambda: claiming(implicit_step(R, parts, jacobian))


def explicit(
    update: Callable[[Problem, Array, Array], Array], parts: Parts = random_step
) -> Callable[[], Scheme]:
    """`make` of a saboteur with another update."""
    return lambda: claiming(explicit_step(update, parts))


def around(step: Callable[[Step], Step], **changes: Any) -> Callable[[], Scheme]:
    """`make` of a saboteur that puts something around the right step; its memory begins anew each time."""
    return lambda: claiming(step(original.step), **changes)
