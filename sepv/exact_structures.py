"""The exact solution with several structures: the closed form where the flows commute, else a finer reference.

Where they do not commute there is no formula, and the reference is Heun's method for the Stratonovich equation on the
increments of a path refined 16 times: another method than the one under test, of the same order, with an error
four times smaller at least, which is estimated from the same path with half as many steps. It is independent of the
error of the finest step and adds 3 % to its rms at most, 0.01 to a slope over step sizes that differ by 16.
"""

from __future__ import annotations

import numpy as np

from sepv import wiener
from sepv.exact import exact_flow
from sepv.fields import matvec
from sepv.problem import Array, Problem
from sepv.structures import StructuresProblem, combined

# Levels of refinement beyond the finest steps of a scheme.
REFINEMENT = 16


def ends(problem: Problem, y0: Array, T: float, W: Array) -> Array | None:
    """y(T) (d, M) for W(T) (m, M), or None where only a finer reference serves."""
    if not isinstance(problem, StructuresProblem):
        return exact_flow(problem, problem.random_step(T, W), y0).y
    return None if problem.closed_form is None else problem.closed_form(y0, T, W)


def finer(
    problem: Problem, y0: Array, T: float, steps: int, paths: range, seed: int
) -> tuple[Array, Array, float]:
    """Increments of `steps` steps (N, m, M), the reference y(T) (d, M), and the rms of its own error.

    The error of order ½ at step h is estimated by |y_h − y_2h|/(√2 − 1).
    """
    fine = wiener.increments(seed, T=T, steps=steps * REFINEMENT, noises=problem.noises, paths=paths)
    y = heun(problem, y0, T, fine)
    coarse = heun(problem, y0, T, wiener.coarsen(fine, 2))
    apart = float(np.sqrt(np.mean(np.sum((y - coarse) ** 2, axis=0))))
    return wiener.coarsen(fine, REFINEMENT), y, apart / (2**0.5 - 1)


def heun(problem: Problem, y0: Array, T: float, dW: Array) -> Array:
    """ŷ = y + F(y), y ← y + ½(F(y) + F(ŷ)), F = [h B + Σ c_j ΔW_j G_j]∇H: converges to the Stratonovich solution."""
    h = T / dW.shape[0]
    y = np.repeat(y0[:, None], dW.shape[2], axis=1)
    drift = np.full((1, dW.shape[2]), h)
    for increment in dW:
        parts = np.concatenate([drift, problem.c[:, None] * increment])
        slope = matvec(combined(problem, y, parts), problem.gradient(y))
        ahead = y + slope
        y = y + 0.5 * (slope + matvec(combined(problem, ahead, parts), problem.gradient(ahead)))
    return y
