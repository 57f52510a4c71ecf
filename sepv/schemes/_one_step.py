"""One-step schemes made from a formula for y1 − y0: the step, its solver, and the `Scheme`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from sepv.core.arrays import Lanes
from sepv.core.formula import CountedFields, Formula, IncrementFunction, JacobianFunction, counted
from sepv.core.newton import Status
from sepv.core.step import Solution
from sepv.core.step import solve as solve_implicit
from sepv.errors import StepFailure
from sepv.problem import Array, Problem, each_noise
from sepv.schemes._from_record import code
from sepv.schemes._further_increments import as_rows
from sepv.schemes._scheme import Scheme, Solve, as_lanes, truncation_for

# A function (problem, h, dW, ...) -> (k, M): the numbers of each step that a formula uses, such as
# Δ = h + Σ c_j ΔW_j.
Parts = Callable[..., Array]

# The attributes of `Solution` with counts that every solver reports.
SOLUTION_COUNTS = ("iterations", "gradient_evaluations", "structure_evaluations")

# Laws claimed by all built-in schemes, by methods for y′ = f(y) with step Δ, by symmetric, by
# energy-preserving ones.
CLAIMS_OF_ALL = frozenset(("contract", "reproducibility", "truncation"))
RANDOM_STEP = CLAIMS_OF_ALL | {"identity", "noise-sum", "random-step", "expansion", "equivariance"}
SYMMETRIC = RANDOM_STEP | {"casimir", "midpoint", "symmetry", "reversibility"}
ENERGY_PRESERVING = SYMMETRIC | {"energy", "reduction", "reference", "rounding"}


def random_step(problem: Problem, h: float, noise: Array) -> Array:
    """The random step Δ = h + Σ c_j ΔW_j of M paths, for formulas that use the noise through Δ
    alone: (1, M).
    """
    return problem.random_step(h, noise)[None]


def drift_and_noise(problem: Problem, h: float, noise: Array) -> Array:
    """The numbers h and S = Σ c_j ΔW_j of M paths, for formulas that treat drift and noise apart:
    (2, M).
    """
    return np.stack([np.full(noise.shape[1], float(h)), problem.random_step(0.0, noise)])


def noise_and_areas(problem: Problem, h: float, noise: Array, areas: Array) -> Array:
    """The numbers h, c_j ΔW_j, and c_i c_j A_ij for i < j of M paths, (k, M); A (m, m) or (m, m, M)
    are Lévy areas.
    """
    rows = as_rows(np.asarray(areas)).reshape(-1, noise.shape[1])
    weights = [problem.c[i] * problem.c[j] for i, j in combinations(range(problem.noises), 2)]
    return np.concatenate([each_noise(problem, h, noise), np.reshape(weights, (-1, 1)) * rows])


def no_jacobian(*_: Any) -> None:
    """Return None in the place of a Jacobian, so that the solver forms it from differences of the
    right side.
    """


def require_converged(problem: Problem, y: Array, h: float, dW: Array, solution: Solution) -> Array:
    """y1 of a solution, (d, M), if all paths converged.
    Raises StepFailure for the first path that did not.

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


def merge(whole: Solution, part: Solution, lanes: Lanes) -> None:
    """Write the solution `part` of some lanes (paths) into the solution `whole` of all lanes,
    and add up the counts.

    Attributes that are None in one of the two solutions stay unchanged.
    """
    for key, values in vars(whole).items():
        new = getattr(part, key)
        if values is not None and new is not None:
            before = values[lanes] if key in (*SOLUTION_COUNTS, "divisions", "continuations") else 0
            values[..., lanes] = before + new


@dataclass(frozen=True)
class Implicit:
    """The step y1 = y0 + R(y0, y1), solved to rounding.

    Attributes
    ----------
    increment, jacobian
        R and ∂R/∂y1, as in `sepv.core.step.solve`.
    parts : (problem, h, dW) -> (k, M)
        The k numbers of each step that R uses, such as Δ = h + Σ c_j ΔW_j.
    formula
        The formula of R, if there is one. The compiled engine records its operations.
    requires : (problem) -> anything
        A function that raises `Skipped` for a problem that the scheme cannot solve.
    examine : (problem, y0, step, solution) -> None
        A function that may change the status of a path in the solution.
    """

    increment: IncrementFunction
    jacobian: JacobianFunction = no_jacobian
    parts: Parts = random_step
    formula: Formula | None = None
    requires: Callable[[Problem], Any] | None = None
    examine: Callable[[Problem, Array, Array, Solution], None] | None = None

    def solve(self, problem: Problem, y: Array, h: float, dW: Array, start: Array | None = None) -> Solution:
        """Solve one step of each path of a batch; `start` (d, M) is a guess of y1 − y0."""
        return self._solved(problem, *as_lanes(problem, y, h, dW), h, start)

    def _solved(
        self, problem: Problem, state: Array, noise: Array, h: float, start: Array | None, *further: Array
    ) -> Solution:
        if self.requires is not None:
            self.requires(problem)
        step = self.parts(problem, h, noise, *further)
        recorded = None if self.formula is None else code(problem, self.formula, state, step)
        solution = solve_implicit(problem, state, step, self.increment, self.jacobian, start, recorded)
        if self.examine is not None:
            self.examine(problem, state, step, solution)
        return solution

    def __call__(self, problem: Problem, y: Array, h: float, dW: Array, *further: Array) -> Array:
        """y1 of one step for y (d,) or (d, M) and dW (m,) or (m, M), truncated by the caller.

        Raises Skipped for a problem that the scheme cannot solve, and StepFailure if the equation
        was not solved.
        """
        state, noise = as_lanes(problem, y, h, dW)
        solution = self._solved(problem, state, noise, h, None, *further)
        return require_converged(problem, state, h, noise, solution).reshape(np.shape(y))


@dataclass(frozen=True)
class Solved:
    """The step of a scheme with its own solver `of_lanes(problem, y, h, dW)` for batches y (d, M),
    dW (m, M).
    """

    of_lanes: Solve

    def solve(self, problem: Problem, y: Array, h: float, dW: Array) -> Solution:
        """Solve one step of each path of a batch."""
        state, noise = as_lanes(problem, y, h, dW)
        return self.of_lanes(problem, state, h, noise)

    def __call__(self, problem: Problem, y: Array, h: float, dW: Array) -> Array:
        """y1 of one step for y (d,) or (d, M), dW (m,) or (m, M).
        Raises StepFailure if the equation was not solved.
        """
        state, noise = as_lanes(problem, y, h, dW)
        solution = self.of_lanes(problem, state, h, noise)
        return require_converged(problem, state, h, noise, solution).reshape(np.shape(y))


@dataclass(frozen=True)
class Explicit:
    """The explicit step y1 = y0 + R(y0), for a formula of R that does not use z = y1 − y0."""

    formula: Formula
    parts: Parts = random_step

    def __call__(self, problem: Problem, y: Array, h: float, dW: Array) -> Array:
        """y1 of one step for y of shape (d,) or (d, M) and dW of shape (m,) or (m, M)."""
        y0, noise = as_lanes(problem, y, h, dW)
        fields, step = CountedFields(problem, y0, y0), self.parts(problem, h, noise)
        return np.asarray(y0 + self.formula(fields, y0, np.zeros_like(y0), step)).reshape(np.shape(y))


def implicit(formula: Formula, jacobian: JacobianFunction = no_jacobian, **more: Any) -> Implicit:
    """The implicit step y1 = y0 + R with the given formula of R;
    `more` are further attributes of `Implicit`.
    """
    return Implicit(partial(counted, formula), jacobian, formula=formula, **more)


def resolved(scheme: Scheme, word: str, of_lanes: Solve, how: str) -> Scheme:
    """A copy of a scheme with the solver `of_lanes` and no claims;
    `word` and `how` extend its name and source.
    """
    step = Solved(of_lanes)
    return replace(
        scheme, name=f"{scheme.name}, {word}", step=step, solve=step.solve, claims=(),
        mean_square_order=None, weak_order=None, source=f"{scheme.source}; {how}",
    )  # fmt: skip


def one_step(name: str, step: Any, claims: Any, source: str, order: float = 1.0, **facts: Any) -> Scheme:
    """The `Scheme` with a step of this module; `facts` are further attributes of `Scheme`.

    Unless `facts` say otherwise, mean-square and weak order are `order`, and `truncation_for` gives
    the truncation.
    """
    usual: dict[str, Any] = {"mean_square_order": order, "weak_order": order}
    usual |= {"truncation": truncation_for(order), "solve": getattr(step, "solve", None)}
    return Scheme(name, step, claims, source, batched=True, **usual | facts)
