"""The data types that solvers and schemes share: the equations z = R(z) of a batch, and the result of solving them.

A lane is a path of a batch of M paths.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from sepv.errors import StepFailure
from sepv.problem import DENSE, Algebra, Array, Problem

if TYPE_CHECKING:
    from sepv.solve._from_record import Corrections

# Arrays (M,) with a value for each lane: its number in the batch, a flag (True or False), a count.
Lanes = NDArray[np.intp]
Flags = NDArray[np.bool_]
Counts = NDArray[np.int64]


class Worded(IntEnum):
    """An integer constant with a `text` for messages; arrays hold the integers."""

    text: str

    def __new__(cls, value: int, text: str = "") -> Self:
        member = int.__new__(cls, value)
        member._value_, member.text = value, text
        return member


class Status(Worded):
    """The outcome of solving the equation of a step, for each lane (a path of a batch)."""

    CONVERGED = 0, "converged"
    NO_CONVERGENCE = 1, "no convergence"
    LEFT_DOMAIN = 2, "left the domain of the problem"
    OVERFLOW = 3, "overflow or NaN in B or ∇H"
    SINGULAR = 4, "singular Jacobian"
    QUADRATURE = 5, "the adaptive quadrature of ∇H did not reach rounding"
    UNDEFINED = 6, "a structure is undefined: ∇H_0 vanishes or nearly so, and B∇H_j does not"


class Increment(NamedTuple):
    """The right side R of y1 = y0 + R(y0, y1), (d, M), with the numbers of evaluations of ∇H and of B, (M,).

    `reliable` (M,) is True where the quadrature of ∇H reached rounding. `parts` are values that the Jacobian reuses.
    """

    value: Array
    gradients: np.ndarray
    structures: np.ndarray
    reliable: np.ndarray
    parts: tuple[Any, ...] = ()


def once(value: Array) -> Increment:
    """The `Increment` of a right side R (d, M) that took one evaluation of ∇H and one of B, and no quadrature."""
    ones = np.ones(value.shape[1], dtype=np.int64)
    return Increment(value, ones, ones, ones.astype(bool))


@dataclass(frozen=True)
class Solution:
    """The result of solving the equation y1 = y0 + R(y0, y1) for each path of a batch.

    Attributes
    ----------
    value : (d, M)
        y1 for each path that converged, and the last iterate for the others.
    residual : (M,)
        The largest component of |y1 − y0 − R(y0, y1)|. If the path converged, y1 is here the iterate before `value`.
    iterations, gradient_evaluations, structure_evaluations : (M,)
        Newton iterations, and evaluations of ∇H and B. Evaluations for an analytic Jacobian are not counted.
    status : (M,)
        `Status` of each path.
    change : (d, M), optional
        y1 − y0 before it was rounded into `value`, for compensated summation.
    divisions : (M,), optional
        The number of steps and parts of steps that were halved by `sepv.schemes._division.divided`.
    continuations : (M,), optional
        The number of scaled steps (s·h, s·ΔW) that were solved by `sepv.schemes._continuation.continued`.
    """

    value: Array
    residual: Array
    iterations: Counts
    gradient_evaluations: Counts
    structure_evaluations: Counts
    status: Counts
    change: Array | None = None
    divisions: Counts | None = None
    continuations: Counts | None = None


# The attributes of `Solution` with counts that every solver reports.
COUNTS = ("iterations", "gradient_evaluations", "structure_evaluations")
IncrementFunction = Callable[[Problem, Array, Array, Array], Increment]
JacobianFunction = Callable[..., Array | None]


class Evaluation(NamedTuple):
    """R(z) for M lanes (paths), and a function that returns ∂R/∂z (n, n, M) and its cost in evaluations of R."""

    right_side: Increment
    jacobian: Callable[[], tuple[Any, int]]


@dataclass(frozen=True)
class Equations:
    """The equations z = R(z) of M lanes (paths), each with n unknowns; a call is for the lanes with numbers `lanes`.

    Attributes
    ----------
    size : (n, M)
        The size |y_i| of the component to which each unknown is added. Corrections are compared with |y| + |z|.
    evaluate : (z, lanes) -> Evaluation
    inside : (z, lanes) -> (M,) of bool, optional
        True for each lane for which the states that belong to z lie in the domain of the problem.
    exact : bool
        True if the Jacobian is ∂R/∂z; False if it is approximate, because H″ is averaged by a few nodes only.
    magnitude : (z, lanes) -> (M,), optional
        The sum of the absolute values of the terms of R, the scale of its rounding if R cancels.
    algebra : Algebra
        The kind of Jacobian: dense matrices (n, n, M) by default.
    corrections : `sepv.solve._from_record.Corrections`, optional
        Straight-line code for Newton's corrections. It replaces `evaluate` unless the Jacobian comes from differences.
    """

    size: Array
    evaluate: Callable[[Array, Lanes], Evaluation]
    inside: Callable[[Array, Lanes], Flags] | None = None
    exact: bool = False
    magnitude: Callable[[Array, Lanes], Array] | None = None
    algebra: Algebra = DENSE
    corrections: Corrections | None = None


def merge(whole: Solution, part: Solution, lanes: Lanes) -> None:
    """Write the solution `part` of some lanes (paths) into the solution `whole` of all lanes, and add up the counts.

    Attributes that are None in one of the two solutions stay unchanged.
    """
    for key, values in vars(whole).items():
        new = getattr(part, key)
        if values is not None and new is not None:
            before = values[lanes] if key in (*COUNTS, "divisions", "continuations") else 0
            values[..., lanes] = before + new


def require_converged(problem: Problem, y: Array, h: float, dW: Array, solution: Solution) -> Array:
    """y1 of a solution, (d, M), if all paths converged. Raises StepFailure for the first path that did not.

    The message describes the step by y (d, M), h and dW (m, M).
    """
    failed = np.flatnonzero(solution.status != Status.CONVERGED)
    if failed.size:
        lane = int(failed[0])
        raise StepFailure(
            problem=problem.name,
            y=y[:, lane],
            delta=float(h + problem.c @ dW[:, lane]),
            residual=float(solution.residual[lane]),
            status=Status(int(solution.status[lane])).text,
            iterations=int(solution.iterations[lane]),
        )
    return solution.value
