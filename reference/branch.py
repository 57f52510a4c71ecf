"""The branch of solutions that starts at y0 for Δ = 0, followed to its end as the step grows.

The equation of an implicit scheme has one solution near y0 for small Δ. With the step t(h, ΔW), t from 0 to 1, that
solution moves until it meets another and both vanish: a fold, where the Jacobian is singular. The curve of solutions
turns back there, so that no solution beyond depends continuously on t from y0 on. One may exist all the same, on
this curve after a second fold or on another: where {H = H(y0)} is bounded there is one for every Δ (Leray and
Schauder). A solver that returns such a solution has changed branches.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from sepv.reference.arithmetic import Vector
from sepv.reference.equations import Equation, Step, make_step
from sepv.reference.problem import Description, ExactProblem, binary64_problem
from sepv.reference.solve import BROKEN, Root, largest, newton

_FIRST, _LEAST = 1 / 16, 1e-14
# A solution that moves by more than this share of its size in one step may lie on another branch.
_JUMP = 0.05


class Branch(NamedTuple):
    """The end of a branch of solutions: the share t of the step that was reached, 1 for all of it.

    `x` are the unknowns there, in floats.
    """

    reached: float
    x: Vector

    @property
    def whole(self) -> bool:
        """True if the solution exists for the whole step."""
        return self.reached == 1.0


def follow(
    equation: Equation, data: Description, y: Sequence[float], h: float, dW: Sequence[float]
) -> Branch:
    """Follow the branch of solutions that starts in y, with the share t of the step (h, dW), in binary64.

    Its end is found to about 13 digits of t.
    """
    problem = binary64_problem(data)
    y0, whole = problem.state(y), make_step(problem, h, tuple(dW))
    x = [0.0] * (len(y0) * equation.blocks) if equation.of_increments else list(y0)
    scale = largest(y0) or 1.0
    reached, width = 0.0, _FIRST
    while reached < 1.0 and width > _LEAST * max(reached, 1e-3):
        t = min(1.0, reached + width)
        point = _at(
            equation, problem, y0, Step(*(t * v for v in whole[:3]), tuple(t * w for w in whole.dW)), x, scale
        )
        if point is None:
            width /= 2
        else:
            reached, x, width = t, point, 1.5 * width
    return Branch(reached, x)


def _at(
    equation: Equation, problem: ExactProblem, y0: Vector, step: Step, x: Vector, scale: float
) -> Vector | None:
    """The solution of the step near the unknowns x. None if Newton's method finds none, or one too far from x."""
    assert equation.residual is not None
    residual = equation.residual
    try:
        root = newton(lambda z: residual(problem, y0, step, z), x, scale, problem.arithmetic, 1e-12, most=8)
    except BROKEN:
        return None
    if not isinstance(root, Root) or not problem.inside(equation.result(problem, y0, step, root.x)):
        return None
    moved = largest([a - b for a, b in zip(root.x, x, strict=True)])
    return root.x if moved <= _JUMP * max(scale, largest(root.x)) else None
