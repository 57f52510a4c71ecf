"""The implicit midpoint rule with the random step Δ, for one state (d,) or a batch (d, M)."""

import numpy as np

SWEEPS = 200


def step(problem, y, h, dW):
    """y1 = y + Δ f((y + y1)/2) with f = B∇H and Δ = h + Σ c_j ΔW_j, by fixed-point iteration to rounding."""
    delta = problem.random_step(h, dW)
    y1, settled = y.copy(), 0
    for _ in range(SWEEPS):
        middle = (y + y1) / 2
        move = np.einsum("ij...,j...->i...", problem.structure(middle), problem.gradient(middle))
        before, y1 = y1, y + delta * move
        size = np.max(np.abs(y1), axis=0)
        # After four sweeps without a visible change every state of the batch has converged.
        settled = settled + 1 if np.all(np.max(np.abs(y1 - before), axis=0) <= 1e-15 * size) else 0
        if settled == 4 and np.all(np.isfinite(size)):
            return y1
    raise ArithmeticError("the fixed-point iteration did not converge: a smaller h")
