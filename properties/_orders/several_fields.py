"""The exact solution with several structures or Hamiltonians, by a formula if the flows commute, else by finer steps.

**Several structures.** If the flows do not commute there is no formula. The reference is then Heun's method
for the Stratonovich equation with the increments of a path refined 16 times. This method has the same order
as the tested scheme and at most a quarter of its error. The reference's error is estimated from the same path
with half as many steps. It is independent of the scheme's error at the finest step, adds at most 3 % to the
rms of this error, and at most 0.01 to a slope over step sizes that differ by a factor of 16.

**Several Hamiltonians.** If all fields commute, y(T) is the flow of T f_0 + Σ c_j W_j(T) f_j at the time 1.
Else the reference is the log-ODE of step two (`sepv.properties._orders.log_ode`) over a path of increments
and Lévy areas refined LOG_ODE_REFINEMENT times. It has mean-square order 1, also if the noises do not
commute. So its error is smaller than that of a scheme of order 1 by the factor LOG_ODE_REFINEMENT, and than
that of a scheme of order ½ by more. Let y_δ be its result with the step size δ. The error is estimated by
|y_δ − y_2δ|. The reference is 2y_δ − y_2δ: this extrapolation hardly changes errors of paths, but makes their
mean O(δ²), which is enough for weak order 2.

A scheme of order 1.5 for commuting noises would soon be more accurate than this reference. For such a scheme
the log-ODE also has the brackets with the drift, by space-time areas. Its errors are then O(δ) in the mean,
which the extrapolation removes, and otherwise O(δ^{3/2}).
"""

from __future__ import annotations

import numpy as np
from sepv.properties._orders.log_ode import combined_field, log_flow, path

from sepv.exact import exact_flow
from sepv.problem import (
    Array,
    HamiltoniansProblem,
    Problem,
    column,
    commutes,
    each_noise,
    is_several,
)
from sepv.simulate import RoughPath, areas, wiener

# The number of reference steps in each of the finest steps of a scheme, for Heun's method and for the
# log-ODE.
HEUN_REFINEMENT = 16
LOG_ODE_REFINEMENT = 8


def ends(problem: Problem, y0: Array, T: float, W: Array) -> Array | None:
    """Return the exact solution y(T) (d, M) from y0 (d,) for given W(T) (m, M), or None if there is no formula."""
    if not is_several(problem):
        return exact_flow(problem, problem.random_step(T, W), y0).y
    form = getattr(problem, "closed_form", None)
    if form is None and isinstance(problem, HamiltoniansProblem) and commutes(problem):
        states = np.repeat(y0[:, None], W.shape[1], axis=1)
        return log_flow(problem, states, each_noise(problem, T, W), np.zeros((0, W.shape[1])))[0]
    return None if form is None else np.asarray(form(y0, T, W))


def refined(
    problem: Problem, y0: Array, T: float, steps: int, paths: range, seed: int, order: float
) -> tuple[RoughPath, Array, float]:
    """Return the reference for several Hamiltonians: finer noise and areas, y(T) (d, M), rms error.

    `order` is the mean-square order that the scheme claims for this problem.
    """
    fine = areas.drawn(seed, T=T, steps=LOG_ODE_REFINEMENT * steps, noises=problem.noises, paths=paths)
    half = fine.coarse(LOG_ODE_REFINEMENT * steps // 2)
    with_drift = order > 1 and column(problem) != "general"
    y, coarse = (path(problem, y0, rough, with_drift=with_drift) for rough in (fine, half))
    return fine, 2 * y - coarse, float(np.sqrt(np.mean(np.sum((y - coarse) ** 2, axis=0))))


def finer(
    problem: Problem, y0: Array, T: float, steps: int, paths: range, seed: int
) -> tuple[Array, Array, float]:
    """Return the reference for several structures: increments of `steps` steps (N, m, M), y(T) (d, M), rms error.

    The error, of order ½ in the step size h, is estimated by |y_h − y_2h|/(√2 − 1).
    """
    fine = wiener.increments(seed, T=T, steps=steps * HEUN_REFINEMENT, noises=problem.noises, paths=paths)
    y = heun(problem, y0, T, fine)
    coarse = heun(problem, y0, T, wiener.coarsen(fine, 2))
    apart = float(np.sqrt(np.mean(np.sum((y - coarse) ** 2, axis=0))))
    return wiener.coarsen(fine, HEUN_REFINEMENT), y, apart / (2**0.5 - 1)


def heun(problem: Problem, y0: Array, T: float, dW: Array) -> Array:
    """Solve the Stratonovich equation by Heun's method with increments dW (N, m, M), and return y(T) (d, M).

    A step is y ← y + ½(F(y) + F(ŷ)) with ŷ = y + F(y) and F = [h B + Σ c_j ΔW_j G_j]∇H.
    """
    h = T / dW.shape[0]
    y = np.repeat(y0[:, None], dW.shape[2], axis=1)
    for increment in dW:
        parts = each_noise(problem, h, increment)
        slope = combined_field(problem, y, parts)
        y = y + 0.5 * (slope + combined_field(problem, y + slope, parts))
    return y
