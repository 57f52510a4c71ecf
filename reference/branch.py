"""Continuation of an implicit step's solution from y0 while the step grows from zero,
up to a fold if there is one.

The equation of an implicit scheme has one solution near y0 if the random step Δ = h + Σ c_j ΔW_j is
small. Let the step be t(h, ΔW) with t growing from 0 to 1. The solution moves with t, and may meet
another solution at a fold, where the Jacobian is singular and the curve of solutions turns back. No
solution for a larger t continues this curve. A solution may still exist, after a second fold or on
another curve: if {H = H(y0)} is bounded, there is one for every Δ (Leray and Schauder). A solver
that returns it has changed branches.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from sepv.reference.arithmetic import Vector
from sepv.reference.equations import Equation, Step, make_step
from sepv.reference.problem import Description, ExactProblem, binary64_problem
from sepv.reference.solve import FLOAT_ERRORS, CertifiedRoot, largest, newton

_FIRST_PART, _LEAST_PART = 1 / 16, 1e-14
# A solution that moves by more than this fraction of its size in one step of t may lie on another
# branch.
_JUMP_SHARE = 0.05


class BranchEnd(NamedTuple):
    """The end of a branch of solutions: the fraction t of the step (h, ΔW) that was reached,
    1 for the whole step.

    `x` holds the unknowns of the equation at this t, in floats.
    """

    reached: float
    x: Vector

    @property
    def whole(self) -> bool:
        """True if the solution exists for the whole step."""
        return self.reached == 1.0


def follow(
    equation: Equation, data: Description, y: Sequence[float], h: float, dW: Sequence[float]
) -> BranchEnd:
    """Follow the solution of the step t(h, dW) from y while t grows from 0 to 1, in binary64.

    The end of this branch of solutions is located to about 13 digits of t.
    """
    problem = binary64_problem(data)
    y0, whole = problem.state(y), make_step(problem, h, tuple(dW))
    x = [0.0] * (len(y0) * equation.blocks) if equation.of_increments else list(y0)
    scale = largest(y0) or 1.0
    reached, width = 0.0, _FIRST_PART
    while reached < 1.0 and width > _LEAST_PART * max(reached, 1e-3):
        t = min(1.0, reached + width)
        point = _at(
            equation, problem, y0, Step(*(t * v for v in whole[:3]), tuple(t * w for w in whole.dW)), x, scale
        )
        if point is None:
            width /= 2
        else:
            reached, x, width = t, point, 1.5 * width
    return BranchEnd(reached, x)


def _at(
    equation: Equation, problem: ExactProblem, y0: Vector, step: Step, x: Vector, scale: float
) -> Vector | None:
    """The solution of the step near the unknowns x, or None if Newton's method finds none or one
    too far from x.
    """
    assert equation.residual is not None
    residual = equation.residual
    try:
        root = newton(lambda z: residual(problem, y0, step, z), x, scale, problem.arithmetic, 1e-12, most=8)
    except FLOAT_ERRORS:
        return None
    if not isinstance(root, CertifiedRoot) or not problem.inside(equation.result(problem, y0, step, root.x)):
        return None
    moved = largest([a - b for a, b in zip(root.x, x, strict=True)])
    return root.x if moved <= _JUMP_SHARE * max(scale, largest(root.x)) else None
