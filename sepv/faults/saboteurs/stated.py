"""Faults of schemes for problems that state functions (`Problem.invariants`):
each breaks the law *invariant*.

`RIGHT_OF_STATED` has the right scheme of each saboteur, which claims the law for the problems that
it names.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from sepv.problem import Array, HamiltoniansProblem, Problem, Systems, mechanics
from sepv.problems import damped_top
from sepv.schemes import Scheme, Step, conformal, leapfrog

from .record import Family

FAMILY = Family("stated")
RIGHT_OF_STATED: dict[str, Scheme] = {}
# The relative error of a force or of a noise in these faults: 2⁻³⁰ is 4e6 ulp.
STATED_ERROR = 2.0**-30


def _hat(y: Array) -> Array:
    zero = 0 * y[0]
    return np.array([[zero, -y[2], y[1]], [y[2], zero, -y[0]], [-y[1], y[0], zero]])


def spin() -> Problem:
    """A spin y in a field along its third axis, rotated by noises about its first and second:
    L y_3 = −c² y_3.
    """
    return HamiltoniansProblem(
        3, _hat, lambda y: y[2], noise=(0.5, 0.5), noise_hamiltonians=(lambda y: y[0], lambda y: y[1]),
        initial=(0.6, 0.0, 0.8), name="spin",
        invariants={"y_3": lambda y: y[2], "norm": lambda y: y[0] ** 2 + y[1] ** 2 + y[2] ** 2},
    )  # fmt: skip


def damped() -> Problem:
    """The damped top, which states |y|², with λ = 2γ, and ln |y|², with σ = −2γ."""
    top = damped_top()
    stated = {
        "square": lambda y: y[0] ** 2 + y[1] ** 2 + y[2] ** 2,
        "logarithm": lambda y: np.log(y[0] ** 2 + y[1] ** 2 + y[2] ** 2),
    }
    return replace(top, data=None, invariants=stated, check=False)


def rotations(problem: Problem, y: Array, h: float, dW: Array, loud: float = 1.0) -> Array:
    """Rotations of a spin about the axes 3, 1 and 2: the exact flows of y_3, y_1 and y_2,
    and so exact means.
    """
    noise = loud * problem.c.reshape(-1, *(1,) * (np.ndim(dW) - 1)) * dW
    for axis, angle in ((2, h), (0, noise[0]), (1, noise[1])):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        moved = np.array(y, copy=True)
        moved[i], moved[j] = (
            np.cos(angle) * y[i] + np.sin(angle) * y[j],
            np.cos(angle) * y[j] - np.sin(angle) * y[i],
        )
        y = moved
    return y


BODIES = replace(leapfrog, name="leapfrog-of-bodies", problems=("planets",), claims=("invariant",))
SPINS = Scheme(
    "rotations-of-a-spin", rotations, ("invariant",), systems=Systems.HAMILTONIANS, problems=(spin(),)
)
CONFORMAL_TOP = replace(conformal, name="conformal-of-a-top", problems=(damped(),), claims=("invariant",))


def _breaking(right: Scheme, broken: str) -> Callable[[Step], Step]:
    """Decorate a broken step of the scheme `right`; `broken` is the fault in words."""

    def added(step: Step) -> Step:
        RIGHT_OF_STATED[step.__name__.replace("_", "-")] = right
        return FAMILY.like(right, broken, ("invariant",))(step)

    return added


@_breaking(BODIES, "the pull on the first body is 2⁻³⁰ stronger than its reaction: momentum is lost")
def reaction_too_weak(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return _pushed(problem, y, h, dW, (0, 1))


@_breaking(BODIES, "all pulls in x are 2⁻³⁰ too strong: momentum is kept, angular momentum is not")
def pull_off_the_line(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return _pushed(problem, y, h, dW, range(0, len(y) // 2, 2))


def _pushed(problem: Problem, y: Array, h: float, dW: Array, places: Sequence[int]) -> Array:
    """The leapfrog, and at its end STATED_ERROR of the force of a step on the momenta at given
    places.
    """
    y1 = leapfrog.step(problem, y, h, dW).copy()
    system = mechanics(problem)
    q, p = system.split(y1)
    p = p.copy()
    p[list(places)] += STATED_ERROR * problem.random_step(h, dW) * system.force(q)[list(places)]
    return system.join(q, p)


@_breaking(SPINS, "noises are 2⁻³⁰ too large: the mean of y_3 decays too fast")
def spin_shaken_too_much(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return rotations(problem, y, h, dW, 1 + STATED_ERROR)


@_breaking(SPINS, "y is stored in single precision: |y| is lost")
def spin_in_single_precision(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return np.asarray(rotations(problem, y, h, dW).astype(np.float32), dtype=np.float64)


@_breaking(CONFORMAL_TOP, "each half of the damping is e^(−γh/2) with a rate γ that is 2⁻³⁰ too large")
def damped_a_little_more(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    return np.asarray(
        conformal.step(problem, y, h, dW) * np.exp(-STATED_ERROR * h * getattr(problem, "damping", 0.0))
    )
