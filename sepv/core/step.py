"""The step of a formula: y1 = y0 + R, solved for z = y1 − y0 where R depends on z."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sepv.core.arrays import Array, Counts, Flags, Lanes, majorant, matvec
from sepv.core.equations import Equations, Evaluation, iterate
from sepv.core.formula import IncrementFunction, JacobianFunction
from sepv.core.newton import Advance, newton
from sepv.core.problem import System

# The most iterations by recorded code. Usual steps need 3 to 5.
RECORDED_MAXITER = 7


@dataclass(frozen=True)
class Solution:
    """The result of solving the equation y1 = y0 + R(y0, y1) for each path of a batch.

    Attributes
    ----------
    value : (d, M)
        y1 for each path that converged, and the last iterate for the others.
    residual : (M,)
        The largest |y1 − y0 − R(y0, y1)|, at the last iterate but one if the path converged.
    iterations, gradient_evaluations, structure_evaluations : (M,)
        Newton iterations, and evaluations of ∇H and B but for an analytic Jacobian.
    status : (M,)
        `Status` of each path.
    change : (d, M), optional
        y1 − y0 before it was rounded into `value`, for compensated summation.
    divisions : (M,), optional
        The number of steps and parts of steps that were halved (`sepv.schemes.divided`).
    continuations : (M,), optional
        The number of scaled steps (s·h, s·ΔW) that were solved (`sepv.schemes.continued`).
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


class Code(NamedTuple):
    """A faster `advance` for the equations of a step, and its evaluations of ∇H and of B.

    It ends a lane that leaves the domain, and does not report quadratures.
    """

    advance: Advance
    gradients: int
    structures: int


def solve(
    problem: System,
    y0: Array,
    step: Array,
    increment: IncrementFunction,
    jacobian: JacobianFunction,
    start: Array | None = None,
    code: Code | None = None,
) -> Solution:
    """Solve the equation y1 = y0 + R(y0, y1) of a step for each of M paths.

    Parameters
    ----------
    y0 : (d, M)
    step : (k, M)
        The numbers of the step that R uses, such as Δ = h + Σ c_j ΔW_j.
    increment : (problem, y0, y1, step) -> Increment
        The right side R with counts of its evaluations.
    jacobian : (problem, y0, y1, step, *parts) -> (d, d, M) or None
        ∂R/∂y1, with the `parts` of `Increment`. If it returns None, differences of R are taken.
    start : (d, M), optional
        A guess of y1 − y0; by default 0.
    code : Code, optional
        Recorded code for Newton's corrections. A path that it does not solve in RECORDED_MAXITER
        iterations starts again without it. So if there are several solutions, the one that is found
        does not depend on the code.
    """
    count = y0.shape[1]
    everything, start = np.arange(count), np.zeros_like(y0) if start is None else start
    gradients, structures = np.zeros((2, count), dtype=np.int64)

    def evaluate(z: Array, lanes: Lanes) -> Evaluation:
        whole = lanes is everything
        y, s = (y0, step) if whole else (y0.take(lanes, axis=1), step.take(lanes, axis=1))
        y1 = y + z
        R = increment(problem, y, y1, s)
        if whole:
            gradients[...] += R.gradients
            structures[...] += R.structures
        else:  # differences have several copies of a lane
            np.add.at(gradients, lanes, R.gradients)
            np.add.at(structures, lanes, R.structures)
        return Evaluation(R.value, R.reliable, lambda: jacobian(problem, y, y1, s, *R.parts))

    def inside(z: Array, lanes: Lanes) -> Flags:
        assert problem.domain is not None
        return np.asarray(problem.domain(y0.take(lanes, axis=1) + z), dtype=bool)

    def terms(z: Array, lanes: Lanes) -> Array:
        reach = np.maximum(np.abs(y0[:, lanes]), np.abs(y0[:, lanes] + z))
        flow = matvec(majorant(problem.structure, reach), majorant(problem.gradient, reach))
        total: Array = sum(np.abs(step[:, lanes])) * flow.max(axis=0)
        return total

    exact = None not in (problem.degree, problem.hessian, problem.structure_derivative)
    domain = None if problem.domain is None else inside
    equations = Equations(np.abs(y0), evaluate, domain, exact, terms)
    if code is None:
        root = iterate(equations, start, everything)
    else:
        rounding = equations.rounding if exact else None
        root = newton(code.advance, equations.size, start, everything, None, rounding, RECORDED_MAXITER)
        again = np.flatnonzero(root.status)
        coded = root.iterations
        if again.size:
            gradients[:] = structures[:] = 0  # those for the rounding of R
            coded = np.where(root.status, 0, coded)
            for whole, part in zip(root, iterate(equations, start[:, again], again), strict=True):
                whole[..., again] = part
        gradients, structures = gradients + code.gradients * coded, structures + code.structures * coded
    costs = root.iterations, gradients, structures
    return Solution(y0 + root.value, root.residual, *costs, root.status, change=root.value)
