"""What a solve of the implicit equation is asked, and what happened in it: records that solvers and schemes share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from sepv.errors import StepFailure
from sepv.problem import Array, Problem
from sepv.problem._fields import DENSE, Algebra

# Numbers of lanes (M,), whether they are something, and how often.
Lanes = NDArray[np.intp]
Flags = NDArray[np.bool_]
Counts = NDArray[np.int64]


class Worded(IntEnum):
    """Numbers that arrays hold, each with its `text`."""

    text: str

    def __new__(cls, value: int, text: str = "") -> Self:
        member = int.__new__(cls, value)
        member._value_, member.text = value, text
        return member


class Status(Worded):
    """How a solve ended."""

    CONVERGED = 0, "converged"
    NO_CONVERGENCE = 1, "no convergence"
    LEFT_DOMAIN = 2, "left the domain of the problem"
    OVERFLOW = 3, "overflow or NaN in B or ∇H"
    SINGULAR = 4, "singular Jacobian"
    QUADRATURE = 5, "the adaptive quadrature of ∇H did not reach rounding"
    UNDEFINED = 6, "a structure is undefined: ∇H_0 vanishes or nearly so, and B∇H_j does not"


class Increment(NamedTuple):
    """R(y0, y1) of shape (d, M), evaluations of ∇H and of B (M,), and where the quadrature is reliable.

    `parts` are what the Jacobian takes over instead of computing it again, as further arguments.
    """

    value: Array
    gradients: np.ndarray
    structures: np.ndarray
    reliable: np.ndarray
    parts: tuple[Any, ...] = ()


def once(value: Array) -> Increment:
    """R with one evaluation of ∇H and of B, and no quadrature."""
    ones = np.ones(value.shape[1], dtype=np.int64)
    return Increment(value, ones, ones, ones.astype(bool))


@dataclass(frozen=True)
class Solution:
    """What happened in a solve, lane by lane.

    Attributes
    ----------
    value : (d, M)
        y1 where converged; the last iterate elsewhere.
    residual : (M,)
        Largest component of |y1 − y0 − R(y0, y1)|, at `value`.
    iterations, gradient_evaluations, structure_evaluations : (M,)
        Newton iterations, and evaluations of ∇H and B (those of Newton's Jacobian not counted).
    status : (M,)
        `Status` of each lane.
    change : (d, M), optional
        y1 − y0 before it was rounded into `value`: compensated summation needs it.
    divisions : (M,), optional
        Steps and parts of steps that were divided, for schemes that do (`sepv.schemes._division.divided`).
    continuations : (M,), optional
        Shares of steps that were solved on the way to failed ones (`sepv.schemes._continuation.continued`).
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


# Its counts, whoever solved it.
COUNTS = ("iterations", "gradient_evaluations", "structure_evaluations")
IncrementFunction = Callable[[Problem, Array, Array, Array], Increment]
JacobianFunction = Callable[..., Array | None]


class Evaluation(NamedTuple):
    """R(z) for some lanes, and on demand ∂R/∂z (n, n, M) with the evaluations that cost, in units of R's."""

    right_side: Increment
    jacobian: Callable[[], tuple[Any, int]]


class Corrections(Protocol):
    """z − R(z), Newton's correction, and whether z less that is in the domain: what a record of the equation has."""

    @property
    def gradients(self) -> int:
        """Evaluations of ∇H that R takes."""

    @property
    def structures(self) -> int:
        """Evaluations of B that R takes."""

    def of_lanes(self, z: Array, lanes: Lanes) -> tuple[Array, Array, Flags]:
        """The first two (n, M), the third (M,), for z (n, M)."""

    def of_one(self, lane: Lanes) -> Callable[[list[float]], tuple[list[float], list[float], bool]]:
        """The function of z (n,) that gives the same numbers for a single lane."""


@dataclass(frozen=True)
class Equations:
    """z = R(z) for n unknowns in every lane; `lanes` are the numbers of the lanes asked about.

    Attributes
    ----------
    size : (n, M)
        |y| of the state that each unknown is added to: corrections are small or not beside |y| + |z|.
    evaluate : (z, lanes) -> Evaluation
    inside : (z, lanes) -> (M,) of bool, optional
        Whether the states that belong to z lie in the domain of the problem.
    exact : bool
        Whether the Jacobian is that of R, and not of R with H″ averaged by a few nodes.
    magnitude : (z, lanes) -> (M,), optional
        The sum of the absolute values of the terms of R, to which its rounding is relative whatever cancels.
    algebra : Algebra
        What the Jacobian is: dense matrices (n, n, M) unless it says otherwise.
    corrections : Corrections, optional
        What Newton's iteration takes in the place of `evaluate`, but where its matrix is to be that of differences.
    """

    size: Array
    evaluate: Callable[[Array, Lanes], Evaluation]
    inside: Callable[[Array, Lanes], Flags] | None = None
    exact: bool = False
    magnitude: Callable[[Array, Lanes], Array] | None = None
    algebra: Algebra = DENSE
    corrections: Corrections | None = None


def merge(whole: Solution, part: Solution, lanes: Lanes) -> None:
    """Write lanes that were solved anew into a solution; counts add up. What one of both lacks stays as it is."""
    for key, values in vars(whole).items():
        new = getattr(part, key)
        if values is not None and new is not None:
            before = values[lanes] if key in (*COUNTS, "divisions", "continuations") else 0
            values[..., lanes] = before + new


def require_converged(problem: Problem, y: Array, h: float, dW: Array, solution: Solution) -> Array:
    """The value of a solution whose lanes all converged; y (d, M) and dW (m, M) are what was solved for.

    Raises StepFailure for the first lane that did not.
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
