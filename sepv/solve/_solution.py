"""Records of a solve of the implicit equation, which solvers and schemes share: its equations and its result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from sepv.errors import StepFailure
from sepv.problem import DENSE, Algebra, Array, Problem

# Numbers of lanes (M,), flags and counts of lanes.
Lanes = NDArray[np.intp]
Flags = NDArray[np.bool_]
Counts = NDArray[np.int64]


class Worded(IntEnum):
    """Numbers for arrays, each with its `text`."""

    text: str

    def __new__(cls, value: int, text: str = "") -> Self:
        member = int.__new__(cls, value)
        member._value_, member.text = value, text
        return member


class Status(Worded):
    """The end of a solve."""

    CONVERGED = 0, "converged"
    NO_CONVERGENCE = 1, "no convergence"
    LEFT_DOMAIN = 2, "left the domain of the problem"
    OVERFLOW = 3, "overflow or NaN in B or ∇H"
    SINGULAR = 4, "singular Jacobian"
    QUADRATURE = 5, "the adaptive quadrature of ∇H did not reach rounding"
    UNDEFINED = 6, "a structure is undefined: ∇H_0 vanishes or nearly so, and B∇H_j does not"


class Increment(NamedTuple):
    """R(y0, y1) (d, M), evaluations of ∇H and of B (M,), and True where the quadrature is reliable.

    `parts` are further arguments of the Jacobian, which need not be computed again.
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
    """The result of a solve, lane by lane.

    Attributes
    ----------
    value : (d, M)
        y1 where converged; the last iterate elsewhere.
    residual : (M,)
        Largest component of |y1 − y0 − R(y0, y1)|, at `value` before its last correction if it converged.
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


# Counts that every solver reports.
COUNTS = ("iterations", "gradient_evaluations", "structure_evaluations")
IncrementFunction = Callable[[Problem, Array, Array, Array], Increment]
JacobianFunction = Callable[..., Array | None]


class Evaluation(NamedTuple):
    """R(z) for some lanes, and on demand ∂R/∂z (n, n, M) with its cost in evaluations of R."""

    right_side: Increment
    jacobian: Callable[[], tuple[Any, int]]


class Corrections(Protocol):
    """z − R(z), Newton's correction, and a test that z less the correction is in the domain, from a record."""

    @property
    def gradients(self) -> int:
        """Evaluations of ∇H in R."""

    @property
    def structures(self) -> int:
        """Evaluations of B in R."""

    def of_lanes(self, z: Array, lanes: Lanes) -> tuple[Array, Array, Flags]:
        """The residual and the correction (n, M), and the test (M,), for z (n, M)."""

    def of_one(self, lane: Lanes) -> Callable[[list[float]], tuple[list[float], list[float], bool]]:
        """A function of z (n,) with the same numbers for a single lane."""


@dataclass(frozen=True)
class Equations:
    """z = R(z) for n unknowns in every lane; `lanes` are the numbers of the lanes in a call.

    Attributes
    ----------
    size : (n, M)
        |y| of the state that each unknown is added to: corrections are compared with |y| + |z|.
    evaluate : (z, lanes) -> Evaluation
    inside : (z, lanes) -> (M,) of bool, optional
        True where the states that belong to z lie in the domain of the problem.
    exact : bool
        True if the Jacobian is that of R, not of R with H″ averaged by a few nodes.
    magnitude : (z, lanes) -> (M,), optional
        The sum of the absolute values of the terms of R, the scale of its rounding if R cancels.
    algebra : Algebra
        The kind of Jacobian: dense matrices (n, n, M) by default.
    corrections : Corrections, optional
        Corrections used in place of `evaluate`, except where the matrix is to be one of differences.
    """

    size: Array
    evaluate: Callable[[Array, Lanes], Evaluation]
    inside: Callable[[Array, Lanes], Flags] | None = None
    exact: bool = False
    magnitude: Callable[[Array, Lanes], Array] | None = None
    algebra: Algebra = DENSE
    corrections: Corrections | None = None


def merge(whole: Solution, part: Solution, lanes: Lanes) -> None:
    """Write lanes that were solved anew into a solution; counts add up. Fields that either lacks stay unchanged."""
    for key, values in vars(whole).items():
        new = getattr(part, key)
        if values is not None and new is not None:
            before = values[lanes] if key in (*COUNTS, "divisions", "continuations") else 0
            values[..., lanes] = before + new


def require_converged(problem: Problem, y: Array, h: float, dW: Array, solution: Solution) -> Array:
    """The value of a solution if all lanes converged; y (d, M) and dW (m, M) describe the steps.

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
