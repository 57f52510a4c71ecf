"""One-step schemes from a formula and facts: their step, their solver and their record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np

from sepv.problem import Array, Problem, each_noise
from sepv.schemes._further_increments import as_rows
from sepv.schemes._scheme import Scheme, Solve, as_lanes, truncation_for
from sepv.solve import (
    Asked,
    Formula,
    IncrementFunction,
    JacobianFunction,
    Solution,
    corrections,
    counted,
    require_converged,
)
from sepv.solve import solve as solve_implicit

# A function (problem, h, noise) -> (k, M) of the data that a formula takes of a step; some schemes have more arguments.
Parts = Callable[..., Array]

# Claims of all schemes here, of methods for y′ = f(y) with the step Δ, and of symmetric ones.
EVERY = frozenset(("contract", "reproducibility", "truncation"))
RANDOM_STEP = EVERY | {"identity", "noise-sum", "random-step", "expansion", "equivariance"}
SYMMETRIC = RANDOM_STEP | {"casimir", "midpoint", "symmetry", "reversibility"}
ENERGY_PRESERVING = SYMMETRIC | {"energy", "reduction", "reference", "rounding"}


def random_step(problem: Problem, h: float, noise: Array) -> Array:
    """The random step Δ, (1, M)."""
    return problem.random_step(h, noise)[None]


def drift_and_noise(problem: Problem, h: float, noise: Array) -> Array:
    """The two parts h and S = Σ c_j ΔW_j of a step, (2, M)."""
    return np.stack([np.full(noise.shape[1], float(h)), problem.random_step(0.0, noise)])


def noise_and_areas(problem: Problem, h: float, noise: Array, areas: Array) -> Array:
    """The parts h, c_j ΔW_j and c_i c_j A_ij with i < j, for skew A (m, m) or (m, m, M)."""
    rows = as_rows(np.asarray(areas)).reshape(-1, noise.shape[1])
    weights = [problem.c[i] * problem.c[j] for i, j in combinations(range(problem.noises), 2)]
    return np.concatenate([each_noise(problem, h, noise), np.reshape(weights, (-1, 1)) * rows])


def no_jacobian(*_: Any) -> None:
    """The Jacobian of a right side whose derivative is formed from differences: None."""


@dataclass(frozen=True)
class Implicit:
    """The step y1 = y0 + R(y0, y1), solved to rounding.

    Attributes
    ----------
    increment, jacobian
        R and ∂R/∂y1, as in `sepv.solve.solve`.
    parts
        The data of a step that R takes.
    formula
        The formula of R, if there is one; the compiled engine records it.
    requires : (problem) -> anything
        Raises `Skipped` for a problem that the scheme does not take.
    examine : (problem, y0, step, solution) -> None
        Changes the status of lanes whose solution is not the scheme's.
    """

    increment: IncrementFunction
    jacobian: JacobianFunction = no_jacobian
    parts: Parts = random_step
    formula: Formula | None = None
    requires: Callable[[Problem], Any] | None = None
    examine: Callable[[Problem, Array, Array, Solution], None] | None = None

    def solve(self, problem: Problem, y: Array, h: float, dW: Array, start: Array | None = None) -> Solution:
        """Solve a batch, with residual, counts and status of each lane; `start` (d, M) is a guess of y1 − y0."""
        return self._solved(problem, *as_lanes(problem, y, h, dW), h, start)

    def _solved(
        self, problem: Problem, state: Array, noise: Array, h: float, start: Array | None, *further: Array
    ) -> Solution:
        if self.requires is not None:
            self.requires(problem)
        step = self.parts(problem, h, noise, *further)

        known = None if self.formula is None else corrections(problem, self.formula, state, step)
        solution = solve_implicit(problem, state, step, self.increment, self.jacobian, start, known)
        if self.examine is not None:
            self.examine(problem, state, step, solution)
        return solution

    def __call__(self, problem: Problem, y: Array, h: float, dW: Array, *further: Array) -> Array:
        """y1 for y (d,) or (d, M) and dW (m,) or (m, M); the caller truncates increments.

        Raises Skipped for a problem that the scheme does not take, StepFailure where the equation was not solved.
        """
        state, noise = as_lanes(problem, y, h, dW)
        solution = self._solved(problem, state, noise, h, None, *further)
        return require_converged(problem, state, h, noise, solution).reshape(np.shape(y))


@dataclass(frozen=True)
class Solved:
    """The step of a scheme with its own solver `of_lanes(problem, y (d, M), h, dW (m, M))`."""

    of_lanes: Solve

    def solve(self, problem: Problem, y: Array, h: float, dW: Array) -> Solution:
        """Solve a batch, with residual, counts and status of each lane."""
        state, noise = as_lanes(problem, y, h, dW)
        return self.of_lanes(problem, state, h, noise)

    def __call__(self, problem: Problem, y: Array, h: float, dW: Array) -> Array:
        """y1 for a state or a batch, with shapes and errors as for `Implicit`."""
        state, noise = as_lanes(problem, y, h, dW)
        solution = self.of_lanes(problem, state, h, noise)
        return require_converged(problem, state, h, noise, solution).reshape(np.shape(y))


@dataclass(frozen=True)
class Explicit:
    """The step y1 = y0 + R(y0), for a formula that does not use z."""

    formula: Formula
    parts: Parts = random_step

    def __call__(self, problem: Problem, y: Array, h: float, dW: Array) -> Array:
        """y1 for y of shape (d,) or (d, M) and dW of shape (m,) or (m, M)."""
        y0, noise = as_lanes(problem, y, h, dW)
        moved = self.formula(Asked(problem, y0, y0), y0, np.zeros_like(y0), self.parts(problem, h, noise))
        return np.asarray(y0 + moved).reshape(np.shape(y))


def implicit(formula: Formula, jacobian: JacobianFunction = no_jacobian, **more: Any) -> Implicit:
    """The step whose right side is this formula; `more` are attributes of `Implicit`."""
    return Implicit(partial(counted, formula), jacobian, formula=formula, **more)


def resolved(scheme: Scheme, word: str, of_lanes: Solve, how: str) -> Scheme:
    """A scheme with another solver and name; it claims nothing."""
    step = Solved(of_lanes)
    return replace(
        scheme, name=f"{scheme.name}, {word}", step=step, solve=step.solve, claims=(),
        mean_square_order=None, weak_order=None, source=f"{scheme.source}; {how}",
    )  # fmt: skip


def one_step(name: str, step: Any, claims: Any, source: str, order: float = 1.0, **facts: Any) -> Scheme:
    """The scheme of one of these steps, with this mean-square and weak order and truncation unless `facts` differ."""
    result: dict[str, Any] = {
        "mean_square_order": order,
        "weak_order": order,
        "truncation": truncation_for(order),
    }
    result["solve"] = getattr(step, "solve", None)
    return Scheme(name, step, claims, source, batched=True, **result | facts)
