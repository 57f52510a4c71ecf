"""Faults of the solver: the equation is (2.1), but y1 does not solve it to rounding,
and StepFailure is not raised.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sepv.errors import StepFailure
from sepv.problem import Array, Problem, forward_differences, linear_solve, vector_field
from sepv.record import EPS
from sepv.schemes import Scheme, Step, as_lanes, energy_preserving, random_step
from sepv.schemes import energy_preserving_jacobian as jacobian

from .record import Family, claiming, explicit, right_side

FAMILY = Family("solver")
_SOLVER_LAWS = ("energy", "casimir", "midpoint", "symmetry", "reference", "rounding")

Correction = Callable[[Problem, Array, Array, Array], Array]


def fixed_point(problem: Problem, y0: Array, z: Array, step: Array) -> Array:
    return right_side(problem, y0, y0 + z, step) - z


def _slope(problem: Problem, y0: Array, z: Array, step: Array) -> Array:
    """The derivative ∂R/∂z of the right side R of (2.1), by formulas if the problem has them,
    else by differences.
    """
    y1 = y0 + z
    known = jacobian(problem, y0, y1, step)
    if known is not None:
        return known
    base = right_side(problem, y0, y1, step)
    reach = np.max([np.abs(y0), np.abs(y1), np.abs(base)], axis=(0, 1))
    R = lambda at, lanes: right_side(problem, y0[:, lanes], at, step[:, lanes])  # noqa: E731
    domain = problem.domain
    inside = None if domain is None else lambda at, _: domain(at)
    return forward_differences(R, inside, y1, base, reach)


def _newton(problem: Problem, y0: Array, z: Array, step: Array) -> Array:
    A = np.eye(problem.dimension)[..., None] - _slope(problem, y0, z, step)
    return linear_solve(A, right_side(problem, y0, y0 + z, step) - z)


def _frozen_newton(problem: Problem, y0: Array, z: Array, step: Array) -> Array:
    A = np.eye(problem.dimension)[..., None] - _slope(problem, y0, np.zeros_like(y0), step)
    return linear_solve(A, right_side(problem, y0, y0 + z, step) - z)


def iterated(
    correction: Correction, most: int, tolerance: float = 0.0, *, together: bool = False
) -> Callable[[], Scheme]:
    """A saboteur that iterates z ← z + correction from 0,
    at most `most` times or until |correction| ≤ tolerance |y|.

    If `together` is true, all paths of a batch stop as soon as one of them has converged.
    """

    def update(problem: Problem, y0: Array, step: Array) -> Array:
        z, active = np.zeros_like(y0), np.arange(y0.shape[1])
        with np.errstate(all="ignore"):
            for _ in range(most):
                move = correction(problem, y0[:, active], z[:, active], step[:, active])
                z[:, active] += move
                scale = np.max(np.abs(y0[:, active]), axis=0) + np.max(np.abs(z[:, active]), axis=0)
                open_ = ~(np.max(np.abs(move), axis=0) <= tolerance * scale)
                if not open_.any() or (together and not open_.all()):
                    break
                active = active[open_]
        return y0 + z

    return explicit(update)


FAMILY.rows(
    *((f"stopped-at-{size}", f"the fixed-point iteration stops at a relative correction of {size}", _SOLVER_LAWS,
       iterated(fixed_point, 60, float(size))) for size in ("1e-8", "1e-12"))
)  # fmt: skip


@FAMILY.made("Newton's iteration stops at a residual of 1e-10", _SOLVER_LAWS, explicit)
def residual_of_1e_10(problem: Problem, y0: Array, step: Array) -> Array:
    z = np.zeros_like(y0)
    for _ in range(20):
        residual = np.max(np.abs(fixed_point(problem, y0, z, step)), axis=0)
        if np.all(residual <= 1e-10):
            break
        z = np.where(residual <= 1e-10, z, z + _newton(problem, y0, z, step))
    return y0 + z


FAMILY.rows(
    ("understated-tolerance", "the solver stops at 1e-8 and states a tolerance of 1e-13", _SOLVER_LAWS,
     lambda: replace(iterated(fixed_point, 60, 1e-8)(), solver_tolerance=1e-13)),
    ("newton-once", "one iteration of Newton, whatever it leaves", _SOLVER_LAWS, iterated(_newton, 1)),
    ("newton-twice", "two iterations of Newton, whatever they leave", _SOLVER_LAWS, iterated(_newton, 2)),
    # Inside the contraction radius three iterations meet the laws *casimir* and *midpoint* to
    # rounding.
    ("newton-thrice", "three iterations of Newton, whatever they leave",
     tuple(law for law in _SOLVER_LAWS if law not in ("casimir", "midpoint")), iterated(_newton, 3)),
    ("newton-four-times", "four iterations of Newton: right for all but long steps", ("energy",),
     iterated(_newton, 4)),
)  # fmt: skip


@FAMILY.around(
    "the right side is evaluated once more at the solution: no digit is left where |Δ| is 1e15",
    ("reference",),
)
def one_evaluation_more(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    """Replace the solved y1 by y0 + R(y0, y1), R the right side of (2.1);
    the error is that of y1 times ∂R/∂y1.
    """
    return y + right_side(problem, y, step(problem, y, h, dW), random_step(problem, h, dW))


FAMILY.rows(
    ("frozen-jacobian", "six iterations of Newton with the Jacobian of the first", _SOLVER_LAWS,
        iterated(_frozen_newton, 6)),
    ("fixed-point-thrice", "the fixed-point iteration stops silently after three times", _SOLVER_LAWS,
     iterated(fixed_point, 3)),
    # *energy* is not named: long steps overflow, for which this law has the verdict `error`.
    ("silent-cap", "the fixed-point iteration stops silently after 60 times, converged or not",
     ("rounding",), iterated(fixed_point, 60, 0.5 * EPS)),
    ("lanes-stop-together", "all states of a batch stop iterating when the first of them has converged",
     ("reproducibility",), iterated(_newton, 20, 1e-9, together=True)),
)  # fmt: skip


@FAMILY.around("a step that is not solved returns y0", ("refusal",))
def unmoved_where_unsolved(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    try:
        return step(problem, y, h, dW)
    except StepFailure:
        return y.copy()


@FAMILY.around("a step that is not solved is the explicit one", ("refusal",))
def explicit_where_unsolved(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    try:
        return step(problem, y, h, dW)
    except StepFailure:
        return y + problem.random_step(h, dW) * vector_field(problem, y)


@FAMILY.around("a step that is not solved is two half steps, where these are solved", ("refusal",))
def halved_where_unsolved(step: Step, problem: Problem, y: Array, h: float, dW: Array) -> Array:
    try:
        return step(problem, y, h, dW)
    except StepFailure:
        middle = step(problem, y, h / 2, dW / 2)
        return step(problem, middle, h / 2, dW / 2)


@FAMILY.made(
    "a step that is not solved returns the last iterate", ("refusal",), lambda step: lambda: claiming(step)
)
def last_iterate_where_unsolved(problem: Problem, y: Array, h: float, dW: Array) -> Array:
    states, noise = as_lanes(problem, y, h, dW)
    assert energy_preserving.solve is not None
    return energy_preserving.solve(problem, states, h, noise).value.reshape(y.shape)
