"""What a reader sees of a law about whole paths: the worst of them, with what was expected and what came."""

from __future__ import annotations

import numpy as np

from sepv.problem import Problem
from sepv.verification._failed_step import row
from sepv.verification._orders.convergence import StrongErrors


def worst_path(problem: Problem, errors: StrongErrors, seed: int, *, drawn: bool) -> str:
    """The path with the largest error at the finest step: y0, W(T), y(T), where the scheme came, and its increments.

    Parameters
    ----------
    drawn : whether paths are those of `sepv.simulate.increments`, and not of `sepv.verification._orders.tilting`.
    """
    sizes = np.nan_to_num(errors.squared[-1], nan=np.inf)
    k = int(np.argmax(np.where(errors.weights[-1] > 0, sizes, -1.0)))
    exact = errors.ends[-1, :, k]
    came = exact + errors.errors[-1, :, k] / errors.weights[-1, k]
    text = (
        f"{problem.name}, path {k} of seed {seed}: from y0 = {row(problem.initial)} with W(T) = "
        f"{row(errors.W[-1, :, k])}: y(T) = {row(exact)} expected, {row(came)} came with {errors.steps[-1]} steps"
    )
    if not drawn or errors.reference:
        return text
    return (
        f"{text}; its increments are sepv.simulate.increments({seed}, T={errors.T!r}, steps={errors.steps[-1]}, "
        f"noises={problem.noises}, paths=range({k}, {k + 1}))"
    )
